"""Notes: warnings about wrong units, coarse grids, and limits of the theory."""

import re
from math import nan

import numpy as np

from app.base.errors import format_distinct, format_exact, warn_notes
from app.base.units import format_lengths
from app.contact.measures import contact_width
from app.problems.arrays import is_measured
from app.problems.surfaces.doubts import MAX_SLOPE, note_doubtful_units, note_spike

MAX_ELASTIC_PRESSURE = 0.2  # of E*; hardly any solid is elastic beyond
MAX_METAL_PRESSURE = 0.05  # of E*; no metal is elastic beyond
MIN_METAL_MODULUS = 1e4  # of E* of metals [N/mm2]
MIN_MODULUS, MAX_MODULUS = 1e-3, 1.5e6  # [N/mm2], of soft gels, and above diamond's 1.1e6
DOUBTFUL_MODULI = 1.0, 1e3  # [N/mm2] of the stiffer body; they may be meant in GPa (1: without units)
MIN_RUBBER_POISSON = 0.4  # rubbers with larger Poisson's ratios have such moduli
MAX_ASPECT = 0.1  # rms height over the longer side of the patch; more with wrong units or steep slopes
MAX_LOG_SQUARE = 0.2  # logarithm of the ratio of the sides of cells that may be meant to be square
MIN_HARDNESS = 1 / 5000  # of E*; indium and lead have more than 1/2000
MAX_THICKNESS = 5.0  # of a layer over the longer side of the patch
MAX_COMPRESSIBLE_POISSON = 0.45  # of a layer that cells wider than its thickness describe well
MAX_SEAM = 3.0  # step where a periodic patch repeats, in neighbouring steps
MAX_FILLED_SHARE = 0.01  # of the load, on filled points
MIN_THICKNESS = 1e-5  # of a layer [mm]; thinner ones are no continua
MIN_CONTACT_CELLS = 10  # across a contact; with fewer, numbers are wrong by percents
MIN_STRIP_CELLS = 4  # across a patch that is not a strip
MIN_SHAPE_CELLS = 10  # along the longer side of a patch that is meant to show a contact's shape
_NUMBER = re.compile(r"\d[\d.]*(e[+-]?\d+)?")


def notes_on(state, problem, contact, moments, roughness):
    """Return notes (warnings) on doubtful input and results. Collective.

    Parameters
    ----------
    state : app.contact.state.ContactState
    problem : app.problems.problem.Problem
    contact : app.contact.measures.ContactMeasures
    moments : app.contact.contact_moments.ContactMoments
    roughness : app.contact.measures.ShapeRoughness

    Returns
    -------
    list of str
    """
    grid, notes, material = state.grid, list(problem.notes), problem.material
    notes += note_doubtful_moduli(material)
    modulus = elastic_modulus(material, contact, grid)
    if problem.hardness is not None and contact.max_pressure > 0:
        notes += note_hardness(problem, contact, modulus)
    if contact.max_pressure > MAX_ELASTIC_PRESSURE * modulus:
        name = " E*"
        if not material.is_half_space:
            name = f" times the effective modulus of these bodies ({modulus:.3g} N/mm2)"
        notes.append(
            f"the maximum pressure is {contact.max_pressure / modulus:.2g}{name}: solids do not bear this elastically, "
            "or a modulus is not in N/mm2, or a length not in mm"
        )
    elif (
        problem.hardness is None
        and modulus >= MIN_METAL_MODULUS
        and contact.max_pressure > MAX_METAL_PRESSURE * modulus
    ):
        notes.append(
            f"the maximum pressure is {contact.max_pressure:.0f} N/mm2, {contact.max_pressure / modulus:.2g} of "
            f"{'E*' if material.is_half_space else 'the effective modulus'}: metals yield at less than a twentieth of "
            "it; give their hardness, unless the bodies are of glass or ceramics"
        )
    measured = [surface for surface in getattr(problem, "surfaces", ()) if is_measured(surface)]
    doubts = [note for surface in measured for note in note_doubtful_units(surface, grid)]
    notes += doubts
    notes += [note for surface in measured for note in note_spike(surface)]
    notes += [note for surface in measured for note in note_filled_points(surface, state)]
    if roughness.rms_slope > MAX_SLOPE and not doubts:
        notes.append(
            f"the rms slope is {format_distinct(roughness.rms_slope, MAX_SLOPE, 2)}: the theory holds for slopes "
            f"below {MAX_SLOPE:g}"
        )
    if any(surface.spacing is None for surface in measured):
        notes += _note_cell_shape(grid)
    across, inside = roughness.steps_at_sides
    if across > MAX_SEAM * inside > 0:
        what = "the measured surface" if measured else "the shape"
        notes.append(
            f"distances step by {format_lengths(across)} (rms) across the sides of the periodic patch, and by "
            f"{format_lengths(inside)} between other cells: {what} is not periodic, and touches at these steps"
        )
    notes += [note for coating in material.coatings for note in note_thickness(coating, grid, moments.width)]
    side = max(grid.sides)
    if roughness.rms_height > MAX_ASPECT * side:
        notes.append(
            f"the distances vary by {roughness.rms_height:.2g} mm (rms) on a patch {side:.2g} mm wide: are they in mm?"
        )
    if state.depth > side:
        notes.append(
            f"the bodies approach each other by {format_distinct(state.depth, side, 2)} mm beyond first touch, "
            f"more than the patch is wide ({format_distinct(side, state.depth, 2)} mm)"
        )
    if grid.doubly_periodic and roughness.rms_height == 0:
        notes.append(
            "the distance is the same in all cells of this periodic patch: the bodies have no shape here"
        )
    return notes + _note_narrow_contact(state, contact) + _note_boundary(state, contact)


def _note_cell_shape(grid):
    """Return a note if x and y may have been exchanged."""
    shape = np.log(grid.dx / grid.dy)
    exchanged = abs(shape + 2 * np.log(grid.nx / grid.ny)) < 1e-3  # sides of the patch
    if min(grid.nx, grid.ny) == 1 or abs(shape) <= 1e-3 or not (exchanged or abs(shape) < MAX_LOG_SQUARE):
        return []
    what = "square if the sides of the patch are exchanged: is x exchanged with y?"
    what = what if exchanged else "nearly square: are the sides of the patch, domain (-domain), right?"
    return [f"cells are {format_lengths(grid.dx, grid.dy, digits=4)}, {what}"]


def _note_narrow_contact(state, contact):
    """Return a note on contacts few cells wide. Collective."""
    grid = state.grid
    if not contact.max_pressure > 0 or max(grid.nx, grid.ny) < MIN_SHAPE_CELLS:
        return []
    widths = contact_width(state, contact, MIN_CONTACT_CELLS)
    # A contact that crosses the patch has no width in that direction.
    sides = zip(widths, (grid.nx, grid.ny), "xy", strict=True)
    narrow = [(width, axis) for width, n, axis in sides if width < min(n, MIN_CONTACT_CELLS)]
    if not narrow:
        return []
    width, axis = min(narrow)
    cells = f"{width} cell{'s'[: width != 1]}"
    return [f"contact is at most {cells} wide in {axis}: use a finer grid or a smaller patch"]


def _note_boundary(state, contact):
    """Return notes on narrow patches and contact at the boundary. Collective."""
    grid, notes = state.grid, []
    (narrow, repeats), (long, _) = sorted(zip(grid.shape, grid.repeats, strict=True))
    if not repeats and (narrow == 1 < long or (narrow < MIN_STRIP_CELLS and long >= MIN_SHAPE_CELLS)):
        notes.append(
            f"the patch is {narrow} cell{'s'[: narrow != 1]} wide: this is a strip of that width, no plane strain "
            "(see periodic= (-periodic))"
        )
    if _touches_boundary(state, contact.contact_cells):
        what = "contact" if contact.contact_cells else "the smallest distance"
        notes.append(f"{what} is at the patch boundary: enlarge the domain if the bodies extend beyond it")
    return notes


def elastic_modulus(material, contact, grid):
    """Return the modulus to compare pressures with [N/mm2].

    The modulus is E*. If the bodies are not half-spaces, it is E* for waves twice as long as a contact spot is wide,
    but at most the confined modulus of a layer.
    """
    if material.is_half_space:
        return material.contact_modulus
    width = 4 * contact.contact_area / contact.perimeter if contact.perimeter else max(grid.sides)
    confined = min((layer.confined_modulus for layer in material.coatings), default=np.inf)
    return min(1 / material.kernel.compliance_at(2 * width), confined)


def note_thickness(coating, grid, width=nan):
    """Return a note if cells are too wide for a layer, or the layer is too thick or too thin.

    `width` is the width of the contact [mm], NaN if unknown. Only coatings are usually thinner than this. Wide cells
    matter only to nearly incompressible layers on a rigid base.
    """
    thickness, side = coating.thickness, max(grid.sides)
    if thickness > MAX_THICKNESS * side:
        below = "rigid base" if coating.on_rigid_base else "substrate"
        return [
            f"the layer is {format_lengths(thickness)} thick, {thickness / side:.3g} times the longer side of the "
            f"patch: the {below} has hardly any effect; is the thickness in mm?"
        ]
    if thickness < MIN_THICKNESS or (thickness > width and not coating.on_rigid_base):
        contact = f", and the contact {format_lengths(width)} wide" if thickness > width else ""
        return [f"the layer is {format_lengths(thickness)} thick{contact}: is the thickness in mm?"]
    is_thin = grid.widest_cell > thickness and grid.symbol != "spectral"
    if not (is_thin and coating.on_rigid_base and coating.poisson[0] > MAX_COMPRESSIBLE_POISSON):
        return []
    return [
        f"the layer, {format_lengths(thickness)} thick and nearly incompressible, is thinner than cells are wide: it "
        "is too soft under uniform pressures on cells"
    ]


def note_doubtful_moduli(material):
    """Return notes on moduli probably in a wrong unit."""
    bodies = zip(*((material.bodies or {}).get(name, ()) for name in ("young", "poisson")), strict=True)
    elastic = [body for body in bodies if np.isfinite(body[0])]
    young = [value for value, _ in elastic]
    what = "Young's modulus" if young else "the contact modulus E*"
    notes = [
        f"{what} is {value:.3g} N/mm2, {'more' if value > MAX_MODULUS else 'less'} than any solid has; N/mm2 are "
        "MPa: is it in another unit, such as Pa or GPa?"
        for value in dict.fromkeys(young or [material.contact_modulus])
        if not MIN_MODULUS <= value <= MAX_MODULUS
    ]
    modulus, poisson = max(elastic, default=(np.inf, 0.5))
    if not notes and DOUBTFUL_MODULI[0] < modulus < DOUBTFUL_MODULI[1] and poisson < MIN_RUBBER_POISSON:
        notes.append(
            f"the stiffer body is as soft as a plastic, with Young's modulus {modulus:.4g} N/mm2; N/mm2 are MPa: for "
            f"GPa write {modulus:.4g}e3"
        )
    return notes


def note_hardness(problem, contact, modulus):
    """Return notes if no contact is plastic, all contact is, or a unit is doubtful.

    `modulus` is the `elastic_modulus`.
    """
    hardness, pressure = float(np.min(problem.hardness)), contact.max_pressure
    name = "E*" if problem.material.is_half_space else f"{modulus:.3g} N/mm2"
    notes, highest = [], np.max(problem.hardness, where=np.isfinite(problem.hardness), initial=0.0)
    if highest < MIN_HARDNESS * modulus:
        notes.append(
            f"the hardness {format_exact(highest)} N/mm2 is {highest / modulus:.1e} of {name}, less than any solid "
            f"has; N/mm2 are MPa: for GPa write {1e3 * highest:g}"
        )
    if not contact.plastic_area and problem.indentation is None:
        doubt = (
            f"; it is above {name}/5: is it in N/mm2?" if hardness > MAX_ELASTIC_PRESSURE * modulus else ""
        )
        notes.append(
            f"the hardness {format_distinct(hardness, pressure, 5)} N/mm2 has no effect: the maximum pressure is "
            f"{format_distinct(pressure, hardness, 5)} N/mm2{doubt}"
        )
    elif contact.plastic_area == contact.contact_area and contact.plastic_fraction < 1:
        notes.append("all contact is plastic: several approaches have this load")
    elif contact.plastic_area == contact.contact_area:
        notes.append(
            f"all cells are plastic: {contact.load:.6g} N is the largest load, also of larger approaches"
        )
    return notes


def note_filled_points(surface, state):
    """Return a note if filled points carry load. Collective."""
    share = surface.filled_on(state.grid, state.operator.slabs.rows)
    if share is None:
        return []
    carried, load = state.sum([np.vdot(share, state.p), state.p.sum()])
    if carried <= MAX_FILLED_SHARE * load:
        return []
    return [
        f"surface file {surface.file}: {100 * carried / load:.2g}% of the load is carried by filled points, whose "
        "heights are interpolated; leave them out by missing='hole' (-surface_missing hole), or crop"
    ]


def _touches_boundary(state, contact_cells):
    """Return whether contact is at a boundary where the patch ends."""
    in_y, in_x = state.grid.repeats
    if contact_cells:
        cells = state.in_contact()
    else:
        b = np.where(state.admissible, state.distance.b, -np.inf)
        cells = -b == float(state.minimum(-b.max(initial=-np.inf)))
    rows = state.operator.slabs.rows
    touches = not in_x and (cells[:, 0].any() or cells[:, -1].any())
    if cells.size and not (touches or in_y):
        touches = (rows.start == 0 and cells[0].any()) or (rows.stop == state.grid.ny and cells[-1].any())
    return state.sum([touches])[0] > 0


class NoteWarnings:
    """Python warnings about the notes of one solver, once for each kind."""

    def __init__(self):
        self._issued = set()  # notes without their numbers

    def issue(self, problem, notes):
        """Warn of the first note of each kind.

        Notes that differ only in numbers are of one kind. Notes that `read_surface` issued as warnings are left out.
        """
        known = {note for part in getattr(problem, "surfaces", ()) for note in getattr(part, "warned", ())}
        for note in notes:
            kind = _NUMBER.sub("", note)
            if note not in known and kind not in self._issued:
                self._issued.add(kind)
                warn_notes([note])
