"""Notes: warnings about wrong units, coarse grids, and limits of the theory."""

import re

import numpy as np

from app.base.errors import format_distinct, warn_notes
from app.base.units import format_lengths
from app.contact.measures import contact_width
from app.problems.arrays import is_measured
from app.problems.surfaces.doubts import MAX_SLOPE, note_doubtful_units, note_spike

MAX_ELASTIC_PRESSURE = 0.2  # of E*; hardly any solid is elastic beyond
MIN_MODULUS, MAX_MODULUS = 1e-3, 1.5e6  # [N/mm2], of soft gels, and above diamond's 1.1e6
DOUBTFUL_MODULI = 1.0, 1e3  # [N/mm2] of the stiffer body; they may be meant in GPa (1: without units)
MIN_RUBBER_POISSON = 0.4  # rubbers with larger Poisson's ratios have such moduli
MAX_ASPECT = 0.1  # rms height over the longer side of the patch; more with wrong units or steep slopes
MAX_LOG_SQUARE = 0.2  # logarithm of the ratio of the sides of cells that may be meant to be square
MAX_COMPRESSIBLE_POISSON = 0.45  # of a layer that cells wider than its thickness describe well
MAX_SEAM = 3.0  # step where a periodic patch repeats, in neighbouring steps
MAX_FILLED_SHARE = 0.01  # of the load, on filled points
MIN_CONTACT_CELLS = 4  # across a contact; fewer do not show its shape
MIN_SHAPE_CELLS = 10  # along the longer side of a patch that is meant to show a contact's shape
_NUMBER = re.compile(r"\d[\d.]*(e[+-]?\d+)?")


def notes_on(state, problem, contact, roughness):
    """Return notes (warnings) on doubtful input and results. Collective.

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
    grid, notes = state.grid, list(problem.notes)
    side = max(grid.nx * grid.dx, grid.ny * grid.dy)
    modulus = problem.material.contact_modulus
    notes += note_doubtful_moduli(problem.material)
    if state.bounds.capped and contact.max_pressure > 0:
        notes += note_hardness(problem, contact)
    if contact.max_pressure > MAX_ELASTIC_PRESSURE * modulus:
        notes.append(
            f"the maximum pressure is {contact.max_pressure / modulus:.2g} E*: beyond what solids bear elastically, or "
            "a modulus is in another unit than N/mm2, a length in another one than mm"
        )
    measured = [surface for surface in getattr(problem, "surfaces", ()) if is_measured(surface)]
    doubts = [note for surface in measured if (note := note_doubtful_units(surface, grid))]
    notes += doubts
    notes += [note for surface in measured if (note := note_spike(surface))]
    notes += [note for surface in measured if (note := note_filled_points(surface, state))]
    if roughness.rms_slope > MAX_SLOPE and not doubts:
        notes.append(
            f"the rms slope is {format_distinct(roughness.rms_slope, MAX_SLOPE, 2)}: the theory is for slopes "
            f"below {MAX_SLOPE:g}"
        )
    if any(surface.spacing is None for surface in measured) and min(grid.nx, grid.ny) > 1:
        shape = np.log(grid.dx / grid.dy)
        exchanged = abs(shape + 2 * np.log(grid.nx / grid.ny)) < 1e-3  # sides of the patch
        if abs(shape) > 1e-3 and (exchanged or abs(shape) < MAX_LOG_SQUARE):
            what = "square if the sides of the patch are exchanged" if exchanged else "nearly square"
            notes.append(
                f"cells are {format_lengths(grid.dx, grid.dy, digits=4)}, {what}: is x exchanged with y?"
            )
    across, inside = roughness.steps_at_sides
    if across > MAX_SEAM * inside > 0:
        what = "the measured surface" if measured else "the shape"
        notes.append(
            f"across the sides of the periodic patch distances step by {format_lengths(across)} (rms), between other "
            f"cells by {format_lengths(inside)}: {what} is not periodic, and touches at these steps"
        )
    for coating in problem.material.coatings:
        notes += note_thin_layer(coating, grid)
    if roughness.rms_height > MAX_ASPECT * side:
        notes.append(
            f"the distances vary by {roughness.rms_height:.2g} mm (rms) on a patch {side:.2g} mm wide: are they in mm?"
        )
    if state.depth > side:
        notes.append(
            f"the bodies approach each other by {format_distinct(state.depth, side, 2)} mm beyond first touch, "
            f"more than the patch is wide ({format_distinct(side, state.depth, 2)} mm)"
        )
    if contact.max_pressure > 0 and max(grid.nx, grid.ny) >= MIN_SHAPE_CELLS:
        widths = contact_width(state, contact, MIN_CONTACT_CELLS)
        # A contact that crosses the patch has no width in that direction.
        narrow = [
            (width, axis)
            for width, n, axis in zip(widths, (grid.nx, grid.ny), "xy", strict=True)
            if width < min(n, MIN_CONTACT_CELLS)
        ]
        if narrow:
            width, axis = min(narrow)
            notes.append(
                f"contact is {width} cell{'s'[: width != 1]} only: that is its largest width in {axis}; take a finer "
                "grid or a smaller patch"
            )
    if grid.periodic and roughness.rms_height == 0:
        notes.append(
            "the distance is the same in all cells of this periodic patch: the cells show nothing of the bodies"
        )
    narrow, long = sorted((grid.nx, grid.ny))
    if not grid.periodic and (narrow == 1 < long or (narrow < MIN_CONTACT_CELLS and long >= MIN_SHAPE_CELLS)):
        notes.append(
            f"the patch is {narrow} cell{'s'[: narrow != 1]} wide: a strip pressed on that width, no plane strain "
            "(see periodic= (-periodic))"
        )
    if not grid.periodic and _touches_boundary(state, contact.contact_cells):
        what = "contact reaches" if contact.contact_cells else "the smallest distance is found at"
        notes.append(f"{what} the rim of the patch: enlarge the domain if the bodies go on beyond it")
    return notes


def note_thin_layer(coating, grid):
    """Return notes on a layer thinner than cells are wide.

    Only nearly incompressible layers on a rigid base are noted.
    """
    cell = max(grid.dx, grid.dy)
    if not coating.on_rigid_base or grid.periodic == "spectral" or cell <= coating.thickness:
        return []
    if coating.poisson[0] <= MAX_COMPRESSIBLE_POISSON:
        return []
    return [
        f"the layer, {format_lengths(coating.thickness)} thick and nearly incompressible, is thinner than cells are "
        "wide: uniform pressures on cells make it too soft"
    ]


def note_doubtful_moduli(material):
    """Return notes on moduli probably in a wrong unit."""
    bodies = zip(*((material.bodies or {}).get(name, ()) for name in ("young", "poisson")), strict=True)
    elastic = [body for body in bodies if np.isfinite(body[0])]
    young = [value for value, _ in elastic]
    what, values = (
        ("Young's modulus", young) if young else ("the contact modulus E*", [material.contact_modulus])
    )
    notes = [
        f"{what} is {value:.3g} N/mm2, {'more' if value > MAX_MODULUS else 'less'} than solids have; N/mm2 are MPa: "
        "is it in another unit, such as Pa or GPa?"
        for value in dict.fromkeys(values)
        if not MIN_MODULUS <= value <= MAX_MODULUS
    ]
    modulus, poisson = max(elastic, default=(np.inf, 0.5))
    if not notes and DOUBTFUL_MODULI[0] < modulus < DOUBTFUL_MODULI[1] and poisson < MIN_RUBBER_POISSON:
        notes.append(
            f"Young's modulus of the stiffer body, {modulus:.4g} N/mm2, is as soft as a plastic; N/mm2 are MPa: if GPa "
            f"was meant write {modulus:.4g}e3"
        )
    return notes


def note_hardness(problem, contact):
    """Return a note if no contact is plastic, or all contact is."""
    hardness, pressure = float(np.min(problem.hardness)), contact.max_pressure
    largest = MAX_ELASTIC_PRESSURE * problem.material.contact_modulus
    if not contact.plastic_area and problem.indentation is None:
        doubt = "; it is above E*/5: is it in another unit than N/mm2?" if hardness > largest else ""
        return [
            f"the hardness {format_distinct(hardness, pressure, 5)} N/mm2 has no effect: the maximum pressure is "
            f"{format_distinct(pressure, hardness, 5)} N/mm2{doubt}"
        ]
    if contact.plastic_area < contact.contact_area:
        return []
    if contact.plastic_fraction < 1:
        return ["all contact is plastic: several approaches have this load, this is one of them"]
    return [
        f"all cells are plastic: {contact.load:.6g} N is the largest load, and larger approaches have it, too"
    ]


def note_filled_points(surface, state):
    """Return a note if filled points carry load, else None. Collective."""
    share = surface.filled_on(state.grid, state.operator.slabs.rows)
    if share is None:
        return None
    carried, load = state.sum([np.vdot(share, state.p), state.p.sum()])
    if carried <= MAX_FILLED_SHARE * load:
        return None
    return (
        f"surface file {surface.file}: {100 * carried / load:.2g}% of the load is carried by points that were missing "
        "and are filled: their heights are a guess; leave them out by missing='hole' (-surface_missing hole), or crop"
    )


def _touches_boundary(state, contact_cells):
    """Return whether contact, or else the smallest distance, is at the patch boundary."""
    if contact_cells:
        cells = state.in_contact()
    else:
        b = np.where(state.admissible, state.distance.b, -np.inf)
        cells = -b == float(state.minimum(-b.max(initial=-np.inf)))
    rows = state.operator.slabs.rows
    touches = cells[:, 0].any() or cells[:, -1].any()
    if cells.size and not touches:
        touches = (rows.start == 0 and cells[0].any()) or (rows.stop == state.grid.ny and cells[-1].any())
    return state.sum([touches])[0] > 0


class NoteWarnings:
    """Python warnings about the notes of one solver, once for each kind."""

    def __init__(self):
        self._issued = set()  # notes without their numbers

    def issue(self, problem, notes):
        """Warn of the first note of each kind.

        Notes that differ only in numbers are of one kind. Notes that `read_surface` has issued as warnings are left
        out.
        """
        known = {note for part in getattr(problem, "surfaces", ()) for note in getattr(part, "warned", ())}
        for note in notes:
            kind = _NUMBER.sub("", note)
            if note not in known and kind not in self._issued:
                self._issued.add(kind)
                warn_notes([note])
