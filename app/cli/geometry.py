"""Options of geometry and material, and the problem they define."""

import numpy as np

from app.base.errors import InputError
from app.base.units import unit
from app.halfspace.grid import SYMBOLS
from app.options.option_table import (
    REQUIRED,
    Option,
    OptionReader,
    cells,
    choice,
    domain,
    flag,
    from_zero,
    half,
    integer,
    pair,
    pair_of_reals,
    positive,
    real,
    subset,
    word,
)
from app.problems.surfaces.height_map import TURNS
from app.problems.surfaces.reading import LEVELS, MISSING

AUTO = "auto"  # value of -domain
DEFAULT_CELLS = 256  # per side, of the default grid


grid_size = pair("nx,ny or n, whole numbers of at least 1")
frequencies = pair("M,N or M, whole numbers from 1 to 10000", highest=10000)
moduli = pair_of_reals("E1,E2, positive numbers; inf: a rigid body", above=0, highest=np.inf)
ratios = pair_of_reals("nu1,nu2, numbers from 0 to 0.5", lowest=0, highest=0.5)
resistivities = pair_of_reals("rho1,rho2, numbers of at least 0", lowest=0)
conductivities = pair_of_reals("k1,k2, positive numbers", above=0, highest=np.inf)
radii = pair_of_reals(
    "two numbers, not 0, or one for a ball; inf: straight; negative: concave",
    nonzero=True,
    highest=np.inf,
    one=True,
)
slant = real("above 0, at most 89.9", above=0, highest=89.9)
share = real("above 0, at most 1", above=0, highest=1)
hardness = real("a positive number; inf: elastic", above=0, highest=np.inf)


def domain_or_auto(text):
    """Convert ``x0,x1,y0,y1`` to numbers; leave the word auto as it is."""
    return text if text == AUTO else domain(text)


MATERIAL_OPTIONS = [
    Option("contact_modulus", positive, REQUIRED, "E* of the pair [N/mm2]; or else the next two, or the two after"),
    Option("young", moduli, REQUIRED, "E1,E2: Young's moduli of the two bodies [N/mm2]; inf: rigid"),
    Option("poisson", ratios, REQUIRED, "nu1,nu2: their Poisson's ratios"),
    Option("shear_modulus", positive, REQUIRED, "combined G of the pair, 2/G = 1/G1 + 1/G2 [N/mm2]"),
    Option("poisson_ratio", half, REQUIRED, "combined nu, 2 nu/G = nu1/G1 + nu2/G2"),
    Option("coating_young", positive, None, "Young's modulus of a coating on the first body of -young [N/mm2]"),
    Option("coating_poisson", half, None, "its Poisson's ratio"),
    Option("coating_thickness", positive, None, "its thickness [mm]"),
    Option("resistivity", resistivities, None, "rho1,rho2: with -stiffness, for the electrical conductance [ohm m]"),
    Option("thermal_conductivity", conductivities, None, "k1,k2: with -stiffness, for the thermal one [W/(m K)]"),
    Option("hardness", hardness, None, "upper bound of the pressure [N/mm2]; inf: elastic (default: none)"),
    Option("hardness_file", word, None, "hardness (ny, nx): .npy, .npz, .h5[:/dataset] or text; inf: elastic"),
]  # fmt: skip
SHAPES = ("hertz", "punch", "file", "python", "rough", "sphere", "cylinder", "roller", "cone")
GEOMETRY_OPTIONS = [
    Option("problem", choice(*SHAPES), REQUIRED, "what is pressed together"),
    Option("grid", grid_size, REQUIRED, "nx,ny or n: cells (default: a file's, or 256 without -domain)"),
    Option("domain", domain_or_auto, REQUIRED, "x0,x1,y0,y1: patch [mm] (default: a file's, or by theory), or auto"),
    Option("periodic", flag, False, "the patch repeats in x and y"),
    Option("periodic_symbol", choice(*SYMBOLS), SYMBOLS[0], "its numbers are values of waves, or constant on cells"),
    Option("hertz_rx", positive, REQUIRED, "relative radius of curvature in x [mm]"),
    Option("hertz_ry", positive, None, "relative radius of curvature in y [mm] (default: hertz_rx)"),
    Option("body1_radii", radii, REQUIRED, "hertz: radii of body 1, or one of a ball [mm]; inf: straight, -: concave"),
    Option("body2_radii", radii, REQUIRED, "hertz: radii of body 2 [mm]"),
    Option("body_angle", real(), 0.0, "hertz: from body 1's first axis to body 2's [degrees]"),
    Option("sphere_radius", positive, REQUIRED, "radius, of two spheres the relative one, 1/R = 1/R1 + 1/R2 [mm]"),
    Option("cylinder_radius", positive, REQUIRED, "radius of a cylinder lying along y [mm]"),
    Option("cylinder_length", positive, None, "its length [mm] (default: beyond the patch)"),
    Option("roller_radius", positive, REQUIRED, "radius of a roller along y; on a raceway 1/(1/R1 + 1/R2) [mm]"),
    Option("roller_length", positive, REQUIRED, "its length over the chamfers [mm]"),
    Option("roller_end_chamfer", from_zero, 0.0, "axial length of its chamfers, where contact is impossible [mm]"),
    Option("roller_crown", choice("none", "log", "arc", "profile"), "none", "crown between the chamfers"),
    Option("roller_design_load", positive, None, "crown log: load with nearly uniform pressure (default: -load) [N]"),
    Option("roller_crown_radius", positive, REQUIRED, "crown arc: its radius [mm], or else the next"),
    Option("roller_crown_drop", positive, None, "crown arc: its drop where the chamfers begin [mm]"),
    Option("roller_profile", word, REQUIRED, "crown profile: text file of y and its drop z, one pair a line [mm]"),
    Option("cone_angle", slant, REQUIRED, "angle between its flank and the flat body [degrees]"),
    Option("punch_diameter", positive, REQUIRED, "diameter of a flat punch at the origin [mm]"),
    Option("surface_seed", integer(0, "a whole number from 0"), 7, "seed of the random surface"),
    Option("surface_sigma", from_zero, 0.1, "the paper's surface: standard deviation of its heights [mm]"),
    Option("surface_decay", share, 0.8, "gamma: fall of its amplitudes"),
    Option("surface_modes", frequencies, (12, 10), "M,N: frequencies in x and y"),
    Option("surface_hurst", share, 0.8, "self-affine surface: Hurst exponent"),
    Option("surface_rolloff", positive, None, "its roll-off wavelength [mm] (default: longest side of the patch)"),
    Option("surface_cutoff", positive, REQUIRED, "its shortest wavelength [mm]"),
    Option("surface_rms_slope", from_zero, None, "rms slope of its spectrum (either this or the next)"),
    Option("surface_rms_height", from_zero, None, "its rms height [mm]"),
    Option("surface_file", word, None, "measured heights, peaks positive: .npy, .npz, .h5[:/dataset], text or points"),
    Option("surface_file2", word, None, "those of the other body, in the same x and y"),
    Option("surface_unit", unit, None, "of measured heights and points, where the file does not say"),
    Option("surface_height_unit", unit, None, "of the heights alone, where points x, y have another one"),
    Option("surface_skip", integer(0, "a whole number from 0"), 0, "lines at the head of a text to leave out"),
    Option("surface_orient", subset(*TURNS), None, "how rows and columns are turned, before all else, in this order"),
    Option("surface_level", choice(*LEVELS), "none", "what is subtracted from measured heights"),
    Option("surface_crop", cells, None, "i0,i1,j0,j1: columns i0 to i1 - 1 and rows j0 to j1 - 1 of them only"),
    Option("surface_resample", flag, False, "they are put on the cells of -grid and -domain, whatever these are"),
    Option("surface_missing", choice(*MISSING), "hole", "missing points (NaN): no contact there, or filled"),
    Option("surface_s_filter", positive, None, "measured waves shorter than this, as of noise, are removed [mm]"),
    Option("surface_l_filter", positive, None, "measured waves longer than this, as of waviness, are removed [mm]"),
    Option("gap_file", word, REQUIRED, "distance (ny, nx): .npy, .npz, .h5[:/dataset] or text; NaN: no contact"),
    Option("problem_type", word, REQUIRED, "python: module.Name or file.py:Name, a Problem or a function of x and y"),
]  # fmt: skip
_PAIR = "contact_modulus", "shear_modulus", "poisson_ratio"  # of both bodies together
COATING = "coating_young", "coating_poisson", "coating_thickness"
MATERIAL = ("contact_modulus", ("young", "poisson"), ("shear_modulus", "poisson_ratio"))
ROUGHNESS = ("surface_rms_slope", "surface_rms_height")
CROWN_ARC = ("roller_crown_radius", "roller_crown_drop")
RADII = (("hertz_rx", "hertz_ry"), ("body1_radii", "body2_radii", "body_angle"))
HARDNESS = ("hardness", "hardness_file")
ALTERNATIVES = (CROWN_ARC, MATERIAL, HARDNESS, ROUGHNESS, RADII)  # at most one of each
SURFACE_FILES = ("surface_file", "surface_file2")
FILES = ("gap_file", "hardness_file", "problem_type", "roller_profile", *SURFACE_FILES)
_WAVY = ("surface_sigma", "surface_decay", "surface_modes")
_SELF_AFFINE = ("surface_hurst", "surface_rolloff", "surface_cutoff", *ROUGHNESS)


def make_problem(options, texts, comm):
    """Make the problem that the options define.

    Parameters
    ----------
    options : OptionReader
        Reader of `MATERIAL_OPTIONS`, `GEOMETRY_OPTIONS` and the loading, which determines the default patch.
    texts : mapping of str to str
        All options, for a user-defined problem.
    comm : mpi4py.MPI.Comm
        Ranks that share the grid; this rank checks its rows only.

    Returns
    -------
    problem : app.problems.problem.Problem
    own : OptionReader
        Reader of the options of a user-defined problem (``-problem python``); empty for other problems.
    """
    from app.base.memory import check_rank_memory
    from app.base.petsc import check_cells
    from app.parallel.slabs import Slabs
    from app.problems.contact_problem import ContactProblem

    name, material, periodic = options["problem"], _make_material(options), _read_symbol(options)
    shape = None if name == "python" else _make_shape(name, options, material)
    measured = _read_measured(options)
    grid = _make_grid(options, name, shape, measured, material, periodic, texts)
    check_cells(grid)
    measured = [surface.filtered(grid, *_read_filters(options)) for surface in measured]
    slabs, own = Slabs.over(comm, grid.ny), OptionReader((), {})
    check_rank_memory(grid, slabs.local * grid.nx)
    rows = slabs.rows
    if name == "python":
        from app.problems import user_problem

        shape, own = user_problem.create(options["problem_type"], grid, material, texts)
        user_problem.validate(shape, options["problem_type"], rows)
    elif name != "file":
        from app.problems.shapes import check_strip

        check_strip(grid)
    surfaces = (*measured, *_make_random_surfaces(options, name, grid, bool(measured)))
    limit = _read_hardness(options, grid)
    if name == "python" and not surfaces and limit is None:
        return shape, own
    problem = ContactProblem(grid, material, shape, surfaces=surfaces, hardness=limit)
    if name == "file":
        shape.check(rows)
    return problem, own


def _make_material(options):
    material = _make_elastic_material(options)
    if not (options.given("stiffness") and options["stiffness"]):
        return material
    return material.conducting(options["resistivity"], options["thermal_conductivity"])


def _make_elastic_material(options):
    from app.halfspace.material import Material

    if options.given(*COATING):
        wrong = [f"-{name} does not suffice" for name in _PAIR if options.given(name)]
        wrong += [f"-{name} is missing" for name in (*COATING, "young", "poisson") if not options.given(name)]
        if wrong:
            raise InputError(
                f"{wrong[0]}: a coating needs {', '.join(f'-{name}' for name in COATING)}, and -young E1,E2 with "
                "-poisson nu1,nu2 of its substrate and of the other body; inf: rigid"
            )
        (e1, e2), (nu1, nu2) = options["young"], options["poisson"]
        coating, ratio, thickness = (options[name] for name in COATING)
        return Material.coated((coating, e1), (ratio, nu1), thickness, other=(e2, nu2))
    if options.given("contact_modulus"):
        return Material.from_contact_modulus(options["contact_modulus"])
    if options.given("young", "poisson"):
        return Material.pair(options["young"], options["poisson"])
    if not options.given("shear_modulus", "poisson_ratio"):
        raise InputError(
            "neither -contact_modulus [N/mm2], nor -young E1,E2 [N/mm2] with -poisson nu1,nu2, nor "
            "-shear_modulus [N/mm2] with -poisson_ratio is given: exactly one of these ways is needed"
        )
    return Material.combined(options["shear_modulus"], options["poisson_ratio"])


def _read_hardness(options, grid):
    """Return the hardness [N/mm2], an array of a file's, or None."""
    from app.problems.gap_file import HardnessFile

    return (
        HardnessFile(options["hardness_file"]).values_on(grid)
        if options["hardness_file"]
        else options["hardness"]
    )


def _read_symbol(options):
    """Return the symbol's name of a periodic patch, otherwise an empty text."""
    if options["periodic"]:
        return options["periodic_symbol"]
    if options.given("periodic_symbol"):
        raise InputError("-periodic_symbol: has no effect here; allowed with -periodic")
    return ""


def _make_shape(name, options, material):
    """Make a problem's base shape, such as a sphere."""
    from app.problems import shapes
    from app.problems.gap_file import GapFile

    if name == "file":
        if options.given("surface_unit") and not any(options[file] for file in SURFACE_FILES):
            raise InputError(
                f"-surface_unit {options['surface_unit']}: has no effect here; gap files are in mm, "
                "heights of -surface_file have units"
            )
        return GapFile(options["gap_file"])
    if name == "rough":
        return shapes.Plane()
    if name == "sphere":
        return shapes.Sphere(options["sphere_radius"])
    if name == "cylinder":
        return shapes.Cylinder(options["cylinder_radius"], options["cylinder_length"] or np.inf)
    if name == "roller":
        return _make_roller(options, material)
    if name == "cone":
        return shapes.Cone(options["cone_angle"])
    if name == "punch":
        return shapes.FlatPunch(options["punch_diameter"])
    if options.given(*RADII[1]):
        return shapes.Paraboloid.between(
            options["body1_radii"], options["body2_radii"], options["body_angle"]
        )
    if not options.given(*RADII[0]):
        raise InputError(
            "neither -hertz_rx and -hertz_ry [mm] nor -body1_radii and -body2_radii [mm] is given: exactly one of "
            "the two ways is needed"
        )
    return shapes.Paraboloid(options["hertz_rx"], options["hertz_ry"] or options["hertz_rx"])


def _make_roller(options, material):
    """Make a roller, with the crown from options."""
    from app.problems.roller import Roller, read_profile

    crown, numbers = options["roller_crown"], {}
    if crown == "profile":
        crown = read_profile(options["roller_profile"])
    elif crown == "arc":
        half = options["roller_length"] / 2 - options["roller_end_chamfer"]
        drop = options["roller_crown_drop"]
        numbers["crown_radius"] = half**2 / (2 * drop) if drop else options["roller_crown_radius"]
    elif crown == "log":
        load = options["roller_design_load"] or (options["load"] if options.given("load") else None)
        if not load:
            raise InputError(
                "-roller_design_load is missing: crown log: load with nearly uniform pressure [N]"
            )
        numbers |= {"design_load": load, "contact_modulus": material.contact_modulus}
    return Roller(
        options["roller_radius"], options["roller_length"], crown, options["roller_end_chamfer"], **numbers
    )


def _read_measured(options):
    """Read the measured surfaces; average or resample them by the options."""
    from app.problems.surfaces.filters import check_order
    from app.problems.surfaces.reading import read_surface

    surfaces = []
    for name in SURFACE_FILES:
        if options[name]:
            check_order(*_read_filters(options))
            surface = read_surface(
                options[name], options["surface_unit"], options["surface_level"], options["surface_crop"],
                options["surface_missing"], options["surface_height_unit"], options["surface_orient"] or (),
                options["surface_skip"],
            )  # fmt: skip
            if options["surface_resample"]:
                surface = surface.resampled()
            elif options.given("grid"):
                surface = surface.averaged(options["grid"][::-1])
            surfaces.append(surface)
    return surfaces


def _read_filters(options):
    """Return the cut-off wavelengths of S-filter and L-filter."""
    return options["surface_s_filter"], options["surface_l_filter"]


def _make_grid(options, name, shape, measured, material, periodic, texts):
    """Make the grid from options, a file, or the shape's analytic solution."""
    from app.halfspace.grid import Grid
    from app.problems.surfaces.resampling import common_grid

    domain = options["domain"] if options.given("domain") else None
    if domain == AUTO and name != "punch":
        if reason := _why_not_auto(name, periodic, measured, options.given(*_WAVY, *_SELF_AFFINE)):
            raise InputError(f"-domain auto: {reason}")
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
    if domain in (None, AUTO) and name not in ("python", "rough"):
        n = options["grid"] if options.given("grid") else (DEFAULT_CELLS,) * 2
        return Grid.from_domain(*n, _make_default_patch(options, shape, material, periodic))
    return Grid.from_domain(*options["grid"], options["domain"], periodic)


def _why_not_auto(name, periodic, measured, generated):
    """Return why no patch can be fitted to the contact, or None."""
    if periodic:
        return "a periodic patch is given by its period"
    if measured:
        return "a measured map has its own patch; -surface_crop i0,i1,j0,j1 solves on a part of it"
    if name == "file":
        return "a gap file has no positions, so its patch must be given"
    if name == "rough":
        return "nominally flat bodies touch everywhere on a patch"
    return "a generated surface belongs to its patch, which must be given" if generated else None


def _fit_grid(options, name, shape, material, texts):
    """Return a grid whose patch fits the contact, for -domain auto."""
    from app.api.fitted_grid import PROBE_CELLS, fit_grid
    from app.halfspace.grid import Grid
    from app.problems import user_problem

    loading = find_loading(options)
    if not loading:
        raise InputError("-domain auto: needs -approach or -load, or a path of them")
    cells = options["grid"] if options.given("grid") else DEFAULT_CELLS
    if name == "python":
        grid = Grid.from_domain(PROBE_CELLS, PROBE_CELLS, (-1, 1, -1, 1))
        shape, _ = user_problem.create(options["problem_type"], grid, material, texts)
    try:
        return fit_grid(shape, material, cells, hardness=options["hardness"], **loading)
    except InputError as error:
        raise InputError(f"-domain auto: {str(error).removeprefix('fit_grid: ')}") from None


def _make_default_patch(options, shape, material, periodic):
    """Return a patch around the contact that the analytic solution predicts."""
    from app.problems.default_patch import default_patch

    loading = find_loading(options)
    rough = options.given(*_WAVY, *_SELF_AFFINE) and shape.name != "punch"
    if periodic or rough:
        raise InputError(
            "-domain is missing: x0,x1,y0,y1 [mm]; it follows from theory only for smooth bodies on a free patch"
        )
    try:
        return default_patch(shape, material.contact_modulus, hardness=options["hardness"], **loading)
    except InputError as error:
        raise InputError(f"-domain is missing: {error}") from None


def find_loading(options):
    """Return the approach or load that the options prescribe, by its name.

    The result is a dict from the name to the value; for a load path, to the largest value. If neither is prescribed,
    the dict is empty.
    """
    names = (f"{name}{path}" for path in ("", "_path") for name in ("approach", "load"))
    loading = next(filter(options.given, names), None)
    return {loading.removesuffix("_path"): float(np.max(options[loading]))} if loading else {}


def _make_random_surfaces(options, name, grid, measured):
    """Make the random surfaces that the options ask for.

    If there is no measured or random surface, -problem punch gets the paper's waves, and -problem rough a self-affine
    surface.
    """
    from app.problems.random_surfaces import SelfAffineSurface, WavySurface, check_cut_off

    wavy, self_affine = options.given(*_WAVY), options.given(*_SELF_AFFINE)
    if not (measured or wavy or self_affine):
        wavy, self_affine = name == "punch", name == "rough"
    x0, y0 = grid.x0, grid.y0
    extent = options["domain"] if options.given("domain") and options["domain"] != AUTO else None
    extent = (extent[1] - x0, extent[3] - y0) if extent else (grid.nx * grid.dx, grid.ny * grid.dy)
    surfaces = []
    if wavy:
        parameters = [options[f"surface_{name}"] for name in ("modes", "decay", "sigma", "seed")]
        if options["surface_sigma"] > 0:
            surfaces.append(WavySurface(*parameters, extent, (x0, y0)))
    if self_affine:
        if not options.given(*ROUGHNESS):
            raise InputError(
                "neither -surface_rms_slope nor -surface_rms_height [mm] is given: exactly one is needed"
            )
        check_cut_off(grid, options["surface_cutoff"])  # before the waves are made
        rms = {name: options[f"surface_{name}"] for name in ("rms_slope", "rms_height")}
        numbers = (
            options["surface_hurst"],
            options["surface_rolloff"] or max(extent),
            options["surface_cutoff"],
        )
        surfaces.append(SelfAffineSurface(*numbers, extent, options["surface_seed"], **rms, origin=(x0, y0)))
    return surfaces
