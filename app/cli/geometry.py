"""The problem defined by the geometry and material options."""

import numpy as np

from app.api.fitted_grid import PROBE_CELLS, fit_grid
from app.base.errors import InputError
from app.base.memory import check_rank_memory
from app.base.petsc import check_cells
from app.cli.geometry_options import (
    AUTO,
    COATING,
    DEFAULT_CELLS,
    RADII,
    SELF_AFFINE,
    SURFACE_FILES,
    WAVY,
)
from app.contact.loading_input import validate_number
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.options.option_table import OptionReader
from app.parallel.slabs import Slabs
from app.problems import shapes, user_problem
from app.problems.contact_problem import ContactProblem
from app.problems.default_patch import default_patch
from app.problems.gap_file import ComplianceFile, GapFile, HardnessFile
from app.problems.random_surfaces import SelfAffineSurface, WavySurface
from app.problems.roller import Roller, read_profile
from app.problems.surfaces.reading import read_surface
from app.problems.surfaces.resampling import common_grid

_SHAPES = {  # -problem -> function that makes the shape from the options
    "rough": lambda options: shapes.Plane(),
    "sphere": lambda options: shapes.Sphere(options["sphere_radius"]),
    "cylinder": lambda options: shapes.Cylinder(
        options["cylinder_radius"], options["cylinder_length"] or np.inf
    ),
    "cone": lambda options: shapes.Cone(options["cone_angle"]),
    "punch": lambda options: shapes.FlatPunch(options["punch_diameter"]),
}


def make_problem(options, texts, comm):
    """Make the problem that the options define.

    `options` reads the problem's options and the loading, which determines the default patch. `texts` are all options,
    for a user-defined problem. The ranks of `comm` share the grid; each checks its rows only. Return the problem, and a
    reader of the options of a user-defined problem (``-problem python``), which is empty for other problems.
    """
    name, material, periodic = options["problem"], _make_material(options), _read_symbol(options)
    if options.given("creep_times"):
        material = material.viscoelastic(options["relaxation_times"], options["relaxation_moduli"])
    if options["stiffness"]:
        material = material.conducting(options["resistivity"], options["thermal_conductivity"])
    shape = None if name == "python" else _make_shape(name, options, material)
    measured = _read_measured(options)
    grid = _make_grid(options, name, shape, measured, material, periodic, texts)
    check_cells(grid)
    measured = [surface.filtered(grid, *_read_filters(options)) for surface in measured]
    slabs, own = Slabs.over(comm, grid.ny), OptionReader((), {})
    check_rank_memory(grid, slabs.local * grid.nx)
    if name == "python":
        shape, own = user_problem.create(options["problem_type"], grid, material, texts)
        user_problem.validate(shape, options["problem_type"], slabs.rows)
        material = shape.material
    elif name != "file":
        shapes.check_strip(grid)
    surfaces = (*measured, *_make_random_surfaces(options, name, grid, bool(measured)))
    laws = {law: options[law] for law in ("hardness", "background_pressure", "surface_compliance")}
    for law, kind in (("hardness", HardnessFile), ("surface_compliance", ComplianceFile)):
        if file := options[f"{law}_file"]:
            laws[law] = kind(file).values_on(grid)
    laws = {law: value for law, value in laws.items() if value is not None}
    if name == "python" and not surfaces and not laws:
        return shape, own
    problem = ContactProblem(grid, material, shape, surfaces=surfaces, **laws)
    if name == "file":
        shape.check(slabs.rows)
    return problem, own


def _make_material(options):
    if options.given(*COATING):
        numbers = [options[name] for name in COATING]
        if len(set(map(len, numbers))) > 1:
            raise InputError(
                f"{', '.join(f'-{name}' for name in COATING)}: must be one number each, or two each for two coatings"
            )
        other = options["young"][1], options["poisson"][1]
        for body in reversed(range(len(numbers[0]))):  # the first body last
            young, ratio, thickness = (values[body] for values in numbers)
            base, base_ratio = options["young"][body], options["poisson"][body]
            other = Material.coated((young, base), (ratio, base_ratio), thickness, None if body else other)
        return other
    if options.given("young", "poisson"):
        return Material.pair(options["young"], options["poisson"])
    if options.given("shear_modulus", "poisson_ratio"):
        return Material.combined(options["shear_modulus"], options["poisson_ratio"])
    return Material.from_contact_modulus(options["contact_modulus"])


def _read_symbol(options):
    """Return the direction or the symbol's name of a periodic patch, otherwise an empty text."""
    periodic = options["periodic"]
    if periodic is True:
        return options["periodic_symbol"]
    return periodic or ""


def _make_shape(name, options, material):
    if name in _SHAPES:
        return _SHAPES[name](options)
    if name == "roller":
        return _make_roller(options, material)
    if name == "file":
        return GapFile(options["gap_file"])
    if options.given(*RADII[1]):
        return shapes.Paraboloid.between(
            options["body1_radii"], options["body2_radii"], options["body_angle"]
        )
    return shapes.Paraboloid(options["hertz_rx"], options["hertz_ry"] or options["hertz_rx"])


def _make_roller(options, material):
    crown, numbers = options["roller_crown"], {}
    if crown == "profile":
        crown = read_profile(options["roller_profile"])
    elif crown == "arc":
        half = options["roller_length"] / 2 - options["roller_end_chamfer"]
        drop = options["roller_crown_drop"]
        numbers["crown_radius"] = half**2 / (2 * drop) if drop else options["roller_crown_radius"]
    elif crown == "log":
        load = options["roller_design_load"] or find_loading(options).get("load")
        numbers |= {"design_load": load, "contact_modulus": material.contact_modulus}
    return Roller(
        options["roller_radius"], options["roller_length"], crown, options["roller_end_chamfer"],
        tilt=options["roller_tilt"], **numbers,
    )  # fmt: skip


def _read_filters(options):
    return options["surface_s_filter"], options["surface_l_filter"]


def _read_measured(options):
    """Read the measured surfaces; average or resample them by the options."""
    names = [name for name in SURFACE_FILES if options[name]]
    if names:
        how = [options[f"surface_{name}"] for name in ("unit", "level", "crop", "missing", "height_unit")]
        how += [options["surface_orient"] or (), options["surface_skip"]]
    surfaces = [read_surface(options[name], *how) for name in names]
    if names and options["surface_resample"]:
        return [surface.resampled() for surface in surfaces]
    if names and options.given("grid"):
        return [surface.averaged(options["grid"][::-1]) for surface in surfaces]
    return surfaces


def _make_grid(options, name, shape, measured, material, periodic, texts):
    """Make the grid from options, a file, or the shape's analytic solution."""
    domain = options["domain"] if options.given("domain") else None
    if domain == AUTO and name != "punch":
        rough = measured or name in ("file", "rough") or options.given(*WAVY, *SELF_AFFINE)
        if periodic or rough:
            raise InputError(
                "-domain auto: only for smooth bodies on a patch that is not periodic; give x0,x1,y0,y1 [mm], or leave "
                "-domain out if a file states its patch"
            )
        return _fit_grid(options, name, shape, material, texts)
    if measured:
        known = [surface for surface in measured if surface.spacing] or measured
        if options["surface_resample"]:
            cells = options["grid"] if options.given("grid") else None
            return common_grid(known, cells, domain, periodic)
        return known[0].grid(domain, periodic)
    if name == "file":
        ny, nx = shape.shape
        if options.given("grid"):
            nx, ny = options["grid"]
        return Grid.from_domain(nx, ny, options["domain"], periodic)
    n = options["grid"] if options.given("grid") else (DEFAULT_CELLS,) * 2
    if domain in (None, AUTO) and name not in ("python", "rough"):
        return Grid.from_domain(*n, _make_default_patch(options, shape, material, periodic))
    return Grid.from_domain(*n, options["domain"], periodic)


def _fit_grid(options, name, shape, material, texts):
    """Return a grid whose patch fits the contact, for -domain auto."""
    loading = find_loading(options)
    if not loading:
        raise InputError("-domain auto: needs -approach or -load, or a path of them")
    cells = options["grid"] if options.given("grid") else DEFAULT_CELLS
    if name == "python":
        grid = Grid.from_domain(PROBE_CELLS, PROBE_CELLS, (-1, 1, -1, 1))
        shape, _ = user_problem.create(options["problem_type"], grid, material, texts)
    hardness = options["hardness"]
    try:
        return fit_grid(shape, material, cells, hardness=hardness, **loading)
    except InputError as error:
        raise InputError(f"-domain auto: {str(error).removeprefix('fit_grid: ')}") from None


def _make_default_patch(options, shape, material, periodic):
    """Return a patch around the contact that the analytic solution predicts."""
    loading = find_loading(options)
    rough = options.given(*WAVY, *SELF_AFFINE) and shape.name != "punch"
    if periodic or rough:
        raise InputError(
            "-domain is missing: x0,x1,y0,y1 [mm]; it follows from theory only for smooth bodies on a free patch"
        )
    hardness = options["hardness"]
    try:
        return default_patch(shape, material.contact_modulus, hardness=hardness, **loading)
    except InputError as error:
        raise InputError(f"-domain is missing: {error}") from None


def find_loading(options):
    """Return the approach or load that the options prescribe, by its name.

    The result is a dict from the name to the value; for a load path, to the largest value. If neither is prescribed,
    the dict is empty. Raises InputError if the value is not allowed.
    """
    if options.given("line_load"):
        return {"load": find_load(options)}
    names = (f"{name}{path}" for path in ("", "_path") for name in ("approach", "load"))
    loading = next(filter(options.given, names), None)
    if not loading:
        return {}
    kind = loading.removesuffix("_path")
    return {kind: validate_number(kind, float(np.max(options[loading])))}


def find_load(options):
    """Return the load [N] of the option -line_load: load per length times the length of the line.

    The length is that of the roller between its chamfers, or of the cylinder; or a side of the patch: in y of an
    endless cylinder, or in the direction in which the patch repeats.
    """
    value, name, periodic = options["line_load"], options["problem"], options["periodic"]
    length = None
    if name == "roller":
        length = options["roller_length"] - 2 * options["roller_end_chamfer"]
    elif name == "cylinder" and options["cylinder_length"]:
        length = options["cylinder_length"]
    elif name == "cylinder" or periodic in ("x", "y"):
        if not options.given("domain") or options["domain"] == AUTO:
            raise InputError(
                "-line_load: needs -domain x0,x1,y0,y1 [mm], whose side is the length of the line"
            )
        x0, x1, y0, y1 = options["domain"]
        length = x1 - x0 if periodic == "x" else y1 - y0
    if length is None or periodic is True:
        raise InputError(
            "-line_load: only for -problem roller or cylinder, or with -periodic x or y; otherwise give -load [N]"
        )
    return validate_number("load", value * length)


def _make_random_surfaces(options, name, grid, measured):
    """Make the random surfaces that the options ask for.

    Without a measured or random surface, -problem punch gets the paper's waves, and -problem rough a self-affine
    surface.
    """
    wavy, self_affine = options.given(*WAVY), options.given(*SELF_AFFINE)
    if not (measured or wavy or self_affine):
        wavy, self_affine = name == "punch", name == "rough"
    origin = x0, y0 = grid.x0, grid.y0
    extent = options["domain"] if options.given("domain") and options["domain"] != AUTO else None
    extent = (extent[1] - x0, extent[3] - y0) if extent else grid.sides
    surfaces = []
    if wavy:
        parameters = [options[f"surface_{name}"] for name in ("modes", "decay", "sigma", "seed")]
        if options["surface_sigma"] > 0:
            surfaces.append(WavySurface(*parameters, extent, origin))
    if self_affine:
        shortest = options["surface_cutoff"]
        numbers = options["surface_hurst"], options["surface_rolloff"] or max(extent), shortest
        rms = {name: options[f"surface_{name}"] for name in ("rms_slope", "rms_height")}
        surfaces.append(SelfAffineSurface(*numbers, extent, options["surface_seed"], **rms, origin=origin))
    return surfaces
