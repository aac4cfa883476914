"""What app.solve says of a solution, on one page."""

from __future__ import annotations

from app.api.analytic_values import ANALYTIC
from app.base.errors import format_exact
from app.base.quantities import label_of
from app.base.units import round_to_cell
from app.cli.load_path import format_steps
from app.io.table import format_text

_ROUNDING = 1e-9  # relative error that is none, as of an approach that a mean gap prescribes
_WITH_ERROR = ("load", "approach", "max_pressure", "contact_area")


def summary(facts, grid, output=None):
    """Text for standard output.

    Not collective.

    Parameters
    ----------
    facts : mapping
        Root attributes of the result file.
    grid : app.halfspace.grid.Grid
    output : str, optional
        Where the result was written.
    """
    state = "solved" if facts["converged"] else "NOT CONVERGED"
    lines = [f"{facts['problem']} {grid.nx} x {grid.ny}: {state} ({facts['reason']})"]
    for number in ("", "2"):
        if f"surface_read{number}" in facts:
            read = facts[f"surface_read{number}"]
            lines.append(f"surface file {facts[f'surface_file{number}']}: {read}")
    lines += _generated(facts)
    beyond = f" ({facts['indentation']:z.6g} beyond first touch)" if facts["approach"] < 0 else ""
    lines.append(
        f"approach {facts['approach']:z.8g} mm{beyond}, load {facts['load']:.8g} N, "
        f"maximum pressure {facts['max_pressure']:.8g} N/mm2"
    )
    if facts.get("periodic"):
        lines.append(
            f"mean pressure {facts['mean_pressure']:.8g} N/mm2, mean gap {facts['mean_gap']:z.8g} mm"
        )
    if "body1_radii" in facts:
        lines.append(
            f"relative radii {facts['hertz_rx']:.6g} and {facts['hertz_ry']:.6g} mm, "
            f"x at {round_to_cell(facts['hertz_axes_angle'], 0.01):.4g} degrees to body 1's first axis"
        )
    lines += [_elastic(facts), _contact(facts, grid), *_more(facts, grid)]
    ranks = _count(facts["ranks"], "rank")
    if facts["solving_ranks"] < facts["ranks"]:
        ranks = f"{facts['solving_ranks']} of {ranks}"
    lines += [
        f"certificate: pressure within {facts['error_bound']:.2g} of this grid's exact one (relative, energy norm), "
        f"largest penetration {facts['largest_penetration']:.2g} mm, residual {facts['residual']:.3g}",
        f"{_count(facts['active_set_iterations'], 'active set iteration')}, {facts['inner_iterations']} inner, "
        f"{facts['work_units']:.4g} work units, {facts['operator_applications']:.4g} operator applications",
        f"{facts['solve_seconds']:.3g} s on {ranks}, set-up {facts['setup_seconds']:.3g} s",
    ]
    if output:
        lines.append(f"result in {output}")
    return "\n  ".join(lines)


def _generated(facts):
    """What random surfaces there are: a punch has one, though nobody has asked for it."""
    seed, found = f"seed {facts.get('surface_seed')}", []
    if "surface_sigma" in facts:
        modes = " x ".join(map(str, facts["surface_modes"]))
        found.append(
            f"surface: the paper's waves, {modes} of them, standard deviation {facts['surface_sigma']:g} mm, {seed}"
        )
    if "surface_hurst" in facts:
        found.append(
            f"surface: self-affine, Hurst exponent {facts['surface_hurst']:g}, roll-off "
            f"{facts['surface_rolloff']:g} mm, cut-off {facts['surface_cutoff']:g} mm, "
            f"rms slope {facts['surface_rms_slope']:.4g}, {seed}"
        )
    return found


def _theories(facts):
    """What theories of rough surfaces say of the contact fraction."""
    if "persson_fraction" not in facts:
        return ""
    persson, bgt = facts["persson_fraction"], facts["bush_gibson_thomas_fraction"]
    light = f", Bush, Gibson and Thomas {100 * bgt:.4g}%" if bgt == bgt else ""
    return f" (Persson {100 * persson:.4g}%{light})"


def _elastic(facts):
    """Contact modulus, and what it was made from."""
    text = f"contact modulus E* {facts['contact_modulus']:.6g} N/mm2"
    if "young" in facts:
        (e1, e2), (nu1, nu2) = facts["young"], facts["poisson"]
        text += f", of E {e1:g} and {e2:g}, nu {nu1:g} and {nu2:g}"
    if "shear_modulus" in facts:
        text += f" (combined G {facts['shear_modulus']:.6g} N/mm2, nu {facts['poisson_ratio']:.4g})"
    return text


def _contact(facts, grid):
    """How much is in contact, and how it hangs together."""
    cells, share = facts["contact_cells"], facts["contact_fraction"]
    whole = "those where contact is possible" if cells and round(cells / share) < grid.n else "all"
    text = f"contact area {facts['contact_area']:.6g} mm2"
    if cells:
        corrected = facts["contact_area"] * facts["contact_fraction_corrected"] / share
        text += f" ({corrected:.6g} corrected for its stepped rim)"
    text += f": {_count(cells, 'cell')}, {100 * share:.4g}% of {whole}"
    if facts.get("contact_patches", 0) > 1:
        text += f", in {facts['contact_patches']} patches, the largest {facts['largest_patch']:.6g} mm2"
    return text + _theories(facts)


def _more(facts, grid):
    """Observables and errors, as far as they are known."""
    lines = []
    if facts["contact_cells"]:
        lines.append(f"mean pressure in contact {facts['mean_contact_pressure']:.6g} N/mm2")
    x, y = (round_to_cell(facts[f"pressure_centre_{name}"], getattr(grid, f"d{name}")) for name in "xy")
    centre = f"; centre of pressure ({x:.6g}, {y:.6g}) mm" if x == x else ""
    if facts["semi_axis_major"] == facts["semi_axis_major"]:
        lines.append(
            f"ellipse of the contact: semi-axes {facts['semi_axis_major']:.6g} and {facts['semi_axis_minor']:.6g} mm, "
            f"the longer at {round_to_cell(facts['major_axis_angle'], 0.01):.4g} degrees from x{centre}"
        )
    if "stiffness" in facts:
        lines.append(f"stiffness {facts['stiffness']:.8g} N/mm, by one more linear solve")
    analytic = [
        f"{_words(name)} {known:.7g} ({100 * (facts[name] / known - 1):+.2g}%)"
        for name in ANALYTIC
        if name in facts
        and (known := facts.get(f"analytic_{name}"))
        and abs(facts[name] - known) > 1e-12 * abs(known)
    ]
    if analytic:
        lines.append(f"analytic solution, and how far off this is: {', '.join(analytic)}")
    errors = [
        f"{_words(name)} {_error(facts[f'{name}_error'])}"
        for name in _WITH_ERROR
        if facts[f"{name}_error"] > _ROUNDING
    ]
    if facts["discretisation_error"] > 0:
        errors.append(f"pressure (rms) {100 * facts['discretisation_error']:.2g}%")
    if errors:
        lines.append(f"errors that the size of the cells makes, about: {', '.join(errors)}")
    return lines


def _error(value):
    return f"{100 * value:.2g}%" if value < 1 else "does not converge"


def load_path_summary(path, wanted):
    """Text on a load path: what is where, and what it cost. Not collective."""
    failed = [row["step"] for row in path.rows if not row["converged"]]
    state = f"{format_steps(failed, len(path))} NOT CONVERGED" if failed else "all solved"
    table = f"; table in {wanted.csv}" if wanted.csv else ""
    return (
        f"path of {_count(len(path), 'step')}: {state}; {path.operator_applications:.4g} operator applications, "
        f"{path.solve_seconds:.3g} s{table}"
    )


def refinement_table(refined, until):
    """Table of the grids of a refinement, and whether the last is fine enough. Not collective."""
    formats = {name: ".1e" for name in refined.rows[0] if name.endswith("_error")}
    end = "is below" if refined.reached else "is NOT below"
    return (
        f"{format_text(refined.rows, formats=formats)}the largest of the errors {end} {format_exact(until)}"
    )


def _words(name):
    return {"semi_axis_major": "semi-axes", "semi_axis_minor": "and"}.get(name) or label_of(name)


def _count(number, what):
    return f"{number} {what}{'s' if number != 1 else ''}"
