"""What app.solve says of a solution, on one page."""

from __future__ import annotations


def report(facts, grid, output=None):
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
    lines = [
        f"{facts['problem']} {grid.nx} x {grid.ny}: {state} ({facts['reason']})",
        f"approach {facts['approach']:.8g} mm, load {facts['load']:.8g} N, "
        f"maximum pressure {facts['max_pressure']:.8g} N/mm2",
        _elastic(facts),
        f"contact {_count(facts['contact_cells'], 'cell')}, "
        f"{100 * facts['contact_fraction']:.4g}% of the admissible ones",
        f"{_count(facts['active_set_iterations'], 'active set iteration')}, {facts['inner_iterations']} inner, "
        f"{facts['work_units']:.4g} work units, {facts['operator_applications']:.4g} operator applications",
        f"certificate: pressure within {facts['error_bound']:.2g} of this grid's exact one (energy norm), "
        f"largest penetration {facts['largest_penetration']:.2g} mm",
        f"residual {facts['residual']:.3g}, {facts['solve_seconds']:.3g} s on {_count(facts['ranks'], 'rank')} "
        f"(set-up {facts['setup_seconds']:.3g} s)",
    ]
    if "body1_radii" in facts:
        lines.insert(
            2,
            f"relative radii {facts['hertz_rx']:.6g} and {facts['hertz_ry']:.6g} mm, "
            f"x at {facts['hertz_axes_angle']:.4g} degrees to body 1's first axis",
        )
    if facts.get("periodic"):
        lines.insert(
            2, f"mean pressure {facts['mean_pressure']:.8g} N/mm2, mean gap {facts['mean_gap']:.8g} mm"
        )
    if facts["discretisation_error"] > 0:
        lines.append(
            f"discretisation error about {facts['discretisation_error']:.2g} of the pressure (rms, from two grids)"
        )
    if output:
        lines.append(f"result in {output}")
    return "\n  ".join(lines)


def _elastic(facts):
    """Contact modulus, and what it was made from."""
    text = f"contact modulus E* {facts['contact_modulus']:.6g} N/mm2"
    if "young" in facts:
        of_bodies = (
            f"{name} {facts[key][0]:g} and {facts[key][1]:g}"
            for name, key in (("E", "young"), ("nu", "poisson"))
        )
        text += f", of {', '.join(of_bodies)}"
    if "shear_modulus" in facts:
        text += f" (combined G {facts['shear_modulus']:.6g} N/mm2, nu {facts['poisson_ratio']:.4g})"
    return text


def _count(number, what):
    return f"{number} {what}{'s'[: number != 1]}"
