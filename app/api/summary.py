"""Text that describes a solution, which app.solve prints."""

from math import nan

import numpy as np

from app.api.analytic_values import ANALYTIC
from app.api.contact_shape import contact_shape
from app.base.errors import format_exact
from app.base.quantities import ESTIMATED, label_of, unit_of
from app.base.units import format_quantity, round_to_cell
from app.io.table import format_text

NOT_CONVERGING = "does not converge with the grid"
_MIN_ERROR = 1e-9  # relative; smaller ones are of prescribed quantities


def summary(facts, grid, output=None, fields=()):
    """Return the text that app.solve prints on a solution.

    `facts` are the root attributes of the result file; `output` is the name of the file. `fields` has the names of
    further fields.
    """
    state = "solved" if facts["converged"] else "NOT CONVERGED"
    lines = [f"{facts['problem']} {grid.nx} x {grid.ny}: {state} ({facts['reason']})"]
    for number in ("", "2"):
        if f"surface_read{number}" in facts:
            read = facts[f"surface_read{number}"]
            lines.append(f"surface file {facts[f'surface_file{number}']}: {read}")
    lines += _describe_random_surfaces(facts)
    beyond = facts["indentation"]
    past = f"{beyond:z.6g} mm beyond" if beyond >= 0 else f"{-beyond:.6g} mm short of"
    past = f" ({past} first touch)" if facts["approach"] < 0 else ""
    lines.append(
        f"approach {facts['approach']:z.8g} mm{past}{remark(facts, 'approach')}, load {facts['load']:.8g} N"
        f"{remark(facts, 'load')}, maximum pressure {facts['max_pressure']:.8g} N/mm2{remark(facts, 'max_pressure')}"
    )
    if facts.get("periodic"):
        pressure, gap = facts["mean_pressure"], facts["mean_gap"]
        lines.append(f"mean pressure {pressure:.8g} N/mm2, mean gap {gap:z.8g} mm")
    if "body1_radii" in facts:
        lines.append(
            f"relative radii {facts['hertz_rx']:.6g} and {facts['hertz_ry']:.6g} mm, "
            f"x at {round_to_cell(facts['hertz_axes_angle'], 0.01):.4g} degrees to body 1's first axis"
        )
    lines += [_describe_material(facts), _describe_contact(facts, grid), *_describe_pressure(facts, grid)]
    lines += _describe_extensions(facts, fields)
    lines += _describe_accuracy(facts)
    ranks = format_count(facts["ranks"], "rank")
    if facts["solving_ranks"] < facts["ranks"]:
        ranks = f"{facts['solving_ranks']} of {ranks}"
    compiling = facts.get("compile_seconds")
    compiled = f", compiling, once: {compiling:.3g} s" if compiling else ""
    lines += [
        f"certificate: pressure within {facts['error_bound']:.2g} of this grid's exact one (relative, energy norm), "
        f"largest penetration {facts['largest_penetration']:.2g} mm, residual {facts['residual']:.3g}",
        f"{format_count(facts['active_set_iterations'], 'active set iteration')}, {facts['inner_iterations']} inner, "
        f"{facts['work_units']:.4g} work units, {facts['operator_applications']:.4g} operator applications",
        f"{facts['solve_seconds']:.3g} s on {ranks}, set-up {facts['setup_seconds']:.3g} s{compiled}",
    ]
    if output:
        lines.append(f"result in {output}")
    return "\n  ".join(lines)


def remark(facts, name):
    """Return a text after a number that does not converge with the grid; empty for other numbers."""
    return f" ({NOT_CONVERGING})" if fails_to_converge(facts, name) else ""


def fails_to_converge(facts, name):
    """Return whether the estimated grid error of a number is all of it."""
    return facts.get(f"{name}_error", 0.0) >= 1


def _describe_random_surfaces(facts):
    seed, lines = f"seed {facts.get('surface_seed')}", []
    if "surface_sigma" in facts:
        modes = " x ".join(map(str, facts["surface_modes"]))
        sigma = facts["surface_sigma"]
        lines.append(f"surface: the paper's waves, {modes} of them, standard deviation {sigma:g} mm, {seed}")
    if "surface_hurst" in facts:
        hurst, rolloff, cutoff = (facts[f"surface_{name}"] for name in ("hurst", "rolloff", "cutoff"))
        lines.append(
            f"surface: self-affine, Hurst exponent {hurst:g}, roll-off {rolloff:g} mm, cut-off {cutoff:g} mm, "
            f"rms slope {facts['surface_rms_slope']:.4g}, {seed}"
        )
    return lines


def _describe_material(facts):
    if "coating_thickness" in facts:
        names = "coating_young", "coating_poisson", "coating_thickness"
        coatings = zip(*(np.atleast_1d(facts[name]) for name in names), strict=True)
        bodies = [f"E {e:g}, nu {nu:g}" for e, nu in zip(facts["young"], facts["poisson"], strict=True)]
        parts = [
            f"coating of E {e:g} N/mm2, nu {nu:g}, thickness {thickness:.6g} mm on {body}"
            for (e, nu, thickness), body in zip(coatings, bodies, strict=False)
        ]
        return "; ".join(parts + [f"other body of {body}" for body in bodies[len(parts) :]])
    if "kernel" in facts:
        return f"bodies with the kernel {facts['kernel']}"
    text = f"contact modulus E* {facts['contact_modulus']:.6g} N/mm2"
    if "young" in facts:
        (e1, e2), (nu1, nu2) = facts["young"], facts["poisson"]
        text += f", of E {e1:g} and {e2:g}, nu {nu1:g} and {nu2:g}"
    if "shear_modulus" in facts:
        text += f" (combined G {facts['shear_modulus']:.6g} N/mm2, nu {facts['poisson_ratio']:.4g})"
    if "relaxation_times" in facts:
        spectrum = zip(facts["relaxation_moduli"], facts["relaxation_times"], strict=True)
        text += f", relaxing body: {facts.get('relaxing_body', '1 and 2')}, by "
        text += ", ".join(f"{100 * share:.4g}% in {time:.6g} s" for share, time in spectrum)
    return text


def _describe_contact(facts, grid):
    """Return a line on the contact area and the number of spots.

    For rough surfaces the line also has the contact fractions by Persson, and by Bush, Gibson and Thomas.
    """
    cells, fraction = facts["contact_cells"], facts["contact_fraction"]
    text = f"contact area {facts['contact_area']:.6g} mm2"
    if cells:
        corrected = facts["contact_area"] * facts["contact_fraction_corrected"] / fraction
        text += f" ({corrected:.6g} corrected for the stepped contact edge)"
    whole = "those where contact is possible" if cells and round(cells / fraction) < grid.n else "all"
    text += f": {format_count(cells, 'cell')}, {100 * fraction:.4g}% of {whole}"
    if facts.get("contact_patches", 0) > 1:
        text += f", in {facts['contact_patches']} spots, the largest {facts['largest_patch']:.6g} mm2"
    if "persson_fraction" in facts:
        persson, bgt = facts["persson_fraction"], facts["bush_gibson_thomas_fraction"]
        light = f", Bush, Gibson and Thomas {100 * bgt:.4g}%" if bgt == bgt else ""
        text += f" (Persson {100 * persson:.4g}%{light})"
    return text


def _describe_pressure(facts, grid):
    """Return lines with mean pressure, shape of the contact and stiffness."""
    lines = []
    if facts["contact_cells"]:
        lines.append(f"mean pressure in contact {facts['mean_contact_pressure']:.6g} N/mm2")
    shape, places = contact_shape(facts, grid), centre_of_pressure(facts, grid)
    if shape:
        parts = [f"{label_of(name)} {value:.6g} {unit_of(name)}" for name, value in shape.items()]
        if "semi_axis_major" in shape:
            axes = " and ".join(f"{axis:.6g}" for axis in shape.values())
            angle = round_to_cell(facts["major_axis_angle"], 0.01)
            parts = [f"elliptic contact: semi-axes {axes} mm, the longer at {angle:.4g} degrees from x"]
        lines.append(", ".join(parts))
    if "line_load" in facts:
        lines += _describe_roller(facts)
    if places:
        lines.append(
            f"centre of pressure {', '.join(f'{name} = {at:.6g} mm' for name, at in places.items())}"
        )
    if facts.get("tilt_x") or facts.get("tilt_y"):
        lines.append(
            "tilt {tilt_x:.6g}, {tilt_y:.6g}; moments {moment_x:.6g}, {moment_y:.6g} N mm".format(**facts)
        )
    if "plastic_area" in facts:
        lines.append(_describe_plastic(facts))
    if "stiffness" in facts:
        lines += _describe_stiffness(facts, grid)
    if "flow_error" in facts:
        lines.append(_describe_flow(facts))
    return lines


def _describe_extensions(facts, fields):
    """Return lines on background pressure, surface compliance, time and wear."""
    names = "background_pressure", "surface_compliance", *(["time"] if "relaxation_times" in facts else [])
    lines = [f"{label_of(name)} {facts[name]:.6g} {unit_of(name)}" for name in names if name in facts]
    lines += [f"{label_of(name)} of each cell" for name in names[:2] if name in fields]
    if {"worn_volume", "sliding_distance"} <= facts.keys():
        text = f"worn volume {facts['worn_volume']:.6g} mm3 at a sliding distance of "
        lines.append(text + format_quantity(facts["sliding_distance"], "mm", 6))
    return lines


def _describe_roller(facts):
    """Return lines on a roller's line load, edge factor and widths."""
    text = f"line load {facts['line_load']:.6g} N/mm"
    if "line_pressure" in facts:
        text += (
            f", for which Hertz's line contact has {facts['line_pressure']:.6g} N/mm2 and half width "
            f"{facts['line_half_width']:.6g} mm, edge factor {facts['edge_factor']:.4g}"
        )
    middle, *ends = (facts[f"half_width_{where}"] for where in ("middle", "lower_end", "upper_end"))
    return [text, f"half width {middle:.6g} mm in the middle, {ends[0]:.6g} and {ends[1]:.6g} mm at the ends"]


def centre_of_pressure(facts, grid):
    """Return the known coordinates of the centre of pressure by "x" and "y" [mm]."""
    cells = {"x": grid.dx, "y": grid.dy}
    places = {
        name: round_to_cell(facts.get(f"pressure_centre_{name}", nan), cell) for name, cell in cells.items()
    }
    return {name: at for name, at in places.items() if at == at}


def _describe_plastic(facts):
    """Return a line on hardness, plastic area and indentation."""
    text = f"hardness {facts['hardness']:.6g} N/mm2: " if "hardness" in facts else ""
    text += f"plastic area {facts['plastic_area']:.6g} mm2, {100 * facts['plastic_fraction']:.4g}%"
    if "persson_plastic_fraction" in facts:
        contact, plastic = facts["persson_hardness_fraction"], facts["persson_plastic_fraction"]
        text += f" (Persson with hardness: contact {100 * contact:.4g}%, plastic {100 * plastic:.4g}%)"
    text += f", plastic volume {facts['plastic_volume']:.6g} mm3"
    if "residual_depth" in facts:
        text += f", indented by earlier loads up to {facts['residual_depth']:.6g} mm deep"
    return text + (f"; largest load {facts['largest_load']:.8g} N" if "largest_load" in facts else "")


def _describe_stiffness(facts, grid):
    """Return lines with stiffness and conductance."""
    text = f"stiffness {facts['stiffness']:.8g} N/mm"
    if facts.get("unloading_stiffness", facts["stiffness"]) == facts["stiffness"]:
        lines = [f"{text}, by one more linear solve"]
    else:
        lines = [f"{text}, unloading {facts['unloading_stiffness']:.8g} N/mm, by two more linear solves"]
    width, area = facts.get("conductance_width", 0.0), grid.area
    if not width > 0:
        return lines
    text = f"conductance of a circular contact of diameter {width:.6g} mm"
    if (electrical := facts.get("electrical_conductance")) is not None:
        text += f"; electrical conductance {electrical:.6g} S"
        text += f" ({1 / electrical:.6g} ohm)" if electrical > 0 else ""
    if (thermal := facts.get("thermal_conductance")) is not None:
        text += f"; thermal conductance {thermal:.6g} W/K"
        # The patch is the nominal area of contact if it is periodic.
        text += f" ({1e6 * thermal / area:.6g} W/(m2 K))" if facts.get("periodic") == 1 else ""
    return [*lines, text]


def _describe_flow(facts):
    """Return a line on the flow through the gap."""
    parts = {}
    for along in "xy":
        aperture = format_quantity(facts[f"hydraulic_aperture_{along}"], "mm", 6)
        text = f"transmissivity {facts[f'transmissivity_{along}']:.6g} mm3, hydraulic aperture {aperture}"
        parts[along] = text if facts[f"percolates_{along}"] else "sealed"
    return f"flow in x: {parts['x']}; in y: {parts['y']}; proved relative error {facts['flow_error']:.2g}"


def _describe_accuracy(facts):
    """Return lines with deviations from theory, and grid errors."""
    lines, deviations, errors = [], [], []
    labels = {"semi_axis_major": "semi-axes", "semi_axis_minor": "and"}
    for name in ANALYTIC:
        exact = facts.get(f"analytic_{name}")
        if exact and name in facts and abs(facts[name] - exact) > 1e-12 * abs(exact):
            deviation = 100 * (facts[name] / exact - 1)
            deviations.append(f"{labels.get(name) or label_of(name)} {exact:.7g} ({deviation:+.2g}%)")
    if deviations:
        lines.append(f"analytic solution (deviation): {', '.join(deviations)}")
    for name in ESTIMATED:
        if (error := facts[f"{name}_error"]) > _MIN_ERROR:
            errors.append(f"{label_of(name)} {f'{100 * error:.2g}%' if error < 1 else 'does not converge'}")
    if facts["discretisation_error"] > 0:
        errors.append(f"pressure (rms) {100 * facts['discretisation_error']:.2g}%")
    if errors:
        lines.append(f"estimated grid error: {', '.join(errors)}")
    return lines


def format_grids(rows):
    """Return the rows of a `Refinement` as a table."""
    return format_text(rows, formats={name: ".1e" for name in rows[0] if name.endswith("_error")})


def refinement_table(refined, until, quantities):
    """Return a text: the table of grids, and whether the largest estimated error is below `until`."""
    state = "is below" if refined.reached else "is NOT below"
    if not refined.reached and refined.errors.largest_of(quantities) <= until:
        state = "is NOT confirmed to be below"
    errors = f"the largest error of {', '.join(map(label_of, quantities))}"
    return f"{format_grids(refined.rows)}{errors} {state} {format_exact(until)}"


def format_count(number, what):
    """Return a number with a noun `what`, in the plural if needed."""
    return f"{number} {what}{'s' if number != 1 else ''}"
