"""What a user should look at twice in a solution that solves the problem as it was given."""

from __future__ import annotations

import numpy as np

from app.base.errors import format_distinct
from app.base.units import format_lengths
from app.contact.measures import contact_width
from app.problems.contact_problem import is_measured

HIGH_PRESSURE = 0.2  # of E*, beyond which hardly any solid is elastic
SOFTEST, HARDEST = 1e-3, 1.5e6  # of moduli [N/mm2]: soft gels, and diamond, which has 1.1e6
PLASTIC = 1.0, 1e3  # moduli [N/mm2] of the stiffer body that may be GPa (1: without units) ...
RUBBERY = 0.4  # ... but where Poisson's ratio is larger, as that of rubber
STEEP = 0.5  # rms slope, beyond which a body is no half-space
FLAT = 2e-4  # rms slope of measured heights, below which heights or spacing may be in another unit ...
COARSE, COARSE_FLAT = 0.05, 5e-3  # ... and the same where cells are as wide as this [mm]
SPIKE = 12.0  # rms steps by which a point may stand above all beside it: of Gaussian noise, however long, it is five
TALL = 0.1  # rms height over the longer side of the patch: with wrong units, or slopes that are steep anyway
SQUARISH = 0.2  # of cells by a domain that are meant to be square, perhaps: logarithm of their sides' ratio
SEAM = 3.0  # steps where a periodic patch repeats, in those beside: larger ones are not the surface's
FILLED = 0.01  # of the load, carried by filled points, more of which is not negligible
FEW_CELLS = 4  # across a contact; fewer do not show its shape
LONG_PATCH = 10  # cells along the longer side of a patch that is meant to show one


def notes_on(state, problem, contact, roughness):
    """Say in a line each what a user should look at twice.

    Collective.

    Parameters
    ----------
    state : app.contact.state.ContactState
    problem : app.problems.problem.Problem
    contact : app.contact.measures.ContactMeasures
    roughness : app.contact.measures.ShapeRoughness

    Returns
    -------
    list of str
    """
    grid, found = state.grid, list(problem.notes)
    side = max(grid.nx * grid.dx, grid.ny * grid.dy)
    modulus = problem.material.contact_modulus
    found += doubtful_moduli(problem.material)
    if contact.max_pressure > HIGH_PRESSURE * modulus:
        found.append(
            f"the maximum pressure is {contact.max_pressure / modulus:.2g} E*: beyond what solids bear elastically, or "
            "a modulus is in another unit than N/mm2, a length in another one than mm"
        )
    measured = [surface for surface in getattr(problem, "surfaces", ()) if is_measured(surface)]
    doubts = [note for surface in measured if (note := note_doubtful_units(surface, grid))]
    found += doubts
    found += [note for surface in measured if (note := note_spike(surface))]
    found += [note for surface in measured if (note := note_filled_points(surface, state))]
    if roughness.rms_slope > STEEP and not doubts:
        found.append(
            f"the rms slope is {format_distinct(roughness.rms_slope, STEEP, 2)}: the theory is for slopes "
            f"below {STEEP:g}"
        )
    if any(surface.spacing is None for surface in measured) and min(grid.nx, grid.ny) > 1:
        shape = np.log(grid.dx / grid.dy)
        exchanged = abs(shape + 2 * np.log(grid.nx / grid.ny)) < 1e-3  # sides of the patch
        if abs(shape) > 1e-3 and (exchanged or abs(shape) < SQUARISH):
            what = "square if the sides of the patch are exchanged" if exchanged else "nearly square"
            found.append(
                f"cells are {format_lengths(grid.dx, grid.dy, digits=4)}, {what}: is x exchanged with y?"
            )
    across, beside = roughness.steps_at_sides
    if across > SEAM * beside > 0:
        what = "a measured surface is not periodic, and" if measured else "what is not periodic"
        found.append(
            f"where the patch repeats distances step by {format_lengths(across)} (rms), from cell to cell beside by "
            f"{format_lengths(beside)}: {what} touches there as at a cliff"
        )
    if roughness.rms_height > TALL * side:
        found.append(
            f"the distances vary by {roughness.rms_height:.2g} mm (rms) on a patch {side:.2g} mm wide: are they in mm?"
        )
    if state.depth > side:
        found.append(
            f"the bodies approach each other by {format_distinct(state.depth, side, 2)} mm beyond first touch, "
            f"more than the patch is wide ({format_distinct(side, state.depth, 2)} mm)"
        )
    if contact.max_pressure > 0 and max(grid.nx, grid.ny) >= LONG_PATCH:
        widths = contact_width(state, contact, FEW_CELLS)
        # A contact that goes through the patch has no width in that direction.
        narrow = [
            (width, axis)
            for width, n, axis in zip(widths, (grid.nx, grid.ny), "xy", strict=True)
            if width < min(n, FEW_CELLS)
        ]
        if narrow:
            width, axis = min(narrow)
            found.append(
                f"contact is {width} cell{'s'[: width != 1]} only: that is its largest width in {axis}; take a finer "
                "grid or a smaller patch"
            )
    if grid.periodic and roughness.rms_height == 0:
        found.append(
            "the distance is the same in all cells of this periodic patch: the cells show nothing of the bodies"
        )
    narrow, long = sorted((grid.nx, grid.ny))
    if not grid.periodic and (narrow == 1 < long or (narrow < FEW_CELLS and long >= LONG_PATCH)):
        found.append(
            f"the patch is {narrow} cell{'s'[: narrow != 1]} wide: a strip pressed on that width, no plane strain "
            "(see periodic= (-periodic))"
        )
    if not grid.periodic and _touches_rim(state, contact.contact_cells):
        what = "contact reaches" if contact.contact_cells else "the smallest distance is found at"
        found.append(f"{what} the rim of the patch: enlarge the domain if the bodies go on beyond it")
    return found


def doubtful_moduli(material):
    """Notes on moduli that no solid has, as with Pa taken for N/mm2. Not collective."""
    known = zip(*((material.bodies or {}).get(name, ()) for name in ("young", "poisson")), strict=True)
    elastic = [body for body in known if np.isfinite(body[0])]
    young = [value for value, _ in elastic]
    what, values = (
        ("Young's modulus", young) if young else ("the contact modulus E*", [material.contact_modulus])
    )
    found = [
        f"{what} is {value:.3g} N/mm2, {'more' if value > HARDEST else 'less'} than solids have; N/mm2 are MPa: is it "
        "in another unit, such as Pa or GPa?"
        for value in dict.fromkeys(values)
        if not SOFTEST <= value <= HARDEST
    ]
    modulus, poisson = max(elastic, default=(np.inf, 0.5))
    if not found and PLASTIC[0] < modulus < PLASTIC[1] and poisson < RUBBERY:
        found.append(
            f"Young's modulus of the stiffer body, {modulus:.4g} N/mm2, is as soft as a plastic; N/mm2 are MPa: if GPa "
            f"was meant write {modulus:.4g}e3"
        )
    return found


def note_doubtful_units(surface, grid):
    """Note on a measured surface that is not as steep as surfaces are, as with a unit mistaken by 1000; None: it is.

    Not collective.
    """
    slope, flat = surface.rms_slope(grid), COARSE_FLAT if max(surface.cell(grid)) > COARSE else FLAT
    if slope > STEEP:
        what = f"steeper than the theory is for (slopes below {STEEP:g}), by spikes, perhaps"
    elif 0 < slope < flat and surface.rms_level > surface.rounding:
        what = "flatter than most surfaces"
    else:
        return None
    what = f"surface file {surface.file}: is {what}"
    return f"{what}; are heights and spacing in the units said? {surface.understood(grid)}"


def note_spike(surface):
    """Note on a point of a measured surface that stands out of all beside it; None: no one does. Not collective."""
    height, steps, row, column = surface.spike
    if steps <= SPIKE or height <= surface.rounding:
        return None
    return (
        f"surface file {surface.file}: has spikes: the point in row {row}, column {column} stands "
        f"{format_lengths(height)} above all beside it, {steps:.0f} times the rms step from cell to cell; they "
        "carry the load: take them out first"
    )


def note_filled_points(surface, state):
    """Note on the load that filled points of a measured surface carry; None: hardly any. Collective."""
    share = surface.filled_on(state.grid, state.operator.slabs.rows)
    if share is None:
        return None
    carried, load = state.sum([np.vdot(share, state.p), state.p.sum()])
    if carried <= FILLED * load:
        return None
    return (
        f"surface file {surface.file}: {100 * carried / load:.2g}% of the load is carried by points that were missing "
        "and are filled: their heights are a guess; leave them out by missing='hole' (-surface_missing hole), or crop"
    )


def _touches_rim(state, contact_cells):
    """Whether a cell on the rim of the patch is in contact, or is nearest to it if there is none. Collective."""
    if contact_cells:
        cells = state.contact
    else:
        b = np.where(state.admissible, state.distance.b, -np.inf)
        cells = -b == float(state.minimum(-b.max(initial=-np.inf)))
    rows = state.operator.slabs.rows
    touches = cells[:, 0].any() or cells[:, -1].any()
    if cells.size and not touches:
        touches = (rows.start == 0 and cells[0].any()) or (rows.stop == state.grid.ny and cells[-1].any())
    return state.sum([touches])[0] > 0
