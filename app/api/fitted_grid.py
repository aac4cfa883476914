"""Grids whose patch is fitted to the contact."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from app.api.solver import ContactSolver
from app.base.errors import InputError, format_exact, plain_number
from app.base.mpi import MPI
from app.base.types import ArrayLike, Floats, Length
from app.base.units import to_length
from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.problems.contact_problem import ContactProblem
from app.problems.default_patch import END_MARGIN, MARGIN, default_patch
from app.problems.problem import Problem
from app.problems.shapes import Shape

PROBE_CELLS = 64  # per side of the small grids on which the contact is computed
MIN_PROBE_WIDTH = 20  # cells across the contact that give its size
MAX_GROWTH = 4.0  # factor of the patch's side from grid to grid, if the contact reaches that side
MAX_PROBES = 16
_UNIT_PATCH = (-1.0, 1.0, -1.0, 1.0)  # where a gap without a theory is first probed [mm]


def fit_grid(
    gap: Problem | Shape | Callable[[Floats, Floats], ArrayLike],
    material: Material,
    cells: int | tuple[int, int] = 256,
    patch: Sequence[Length] | None = None,
    *,
    approach: Length | None = None,
    load: float | None = None,
    hardness: float | None = None,
) -> Grid:
    """Return a grid around the contact of smooth bodies.

    The contact is computed on small grids, usually one or two. The sides of the patch are 1.5 times the extent of the
    contact. If the contact has the length of the bodies, a side is 8/7 of this length. Every rank computes the whole
    contact by itself.

    Parameters
    ----------
    gap : Problem, shape, or callable
        The `gap` of `ContactProblem`, except an array.
    material : Material
    cells : int or (int, int)
        nx, ny of the grid.
    patch : (float, float, float, float), optional
        x0, x1, y0, y1 of the first small grid [mm]. Default: from the analytic solution, or 2 mm wide about the origin.
    approach : float, optional
        Approach of the bodies [mm]; give this or the load.
    load : float, optional
        Total force [N].
    hardness : float, optional
        Hardness [N/mm2]; default: the hardness of `gap`, if `gap` is a problem.

    Raises
    ------
    InputError
        If there is no contact, or no patch contains it.

    Examples
    --------
    >>> from app import Material
    >>> steel = Material.isotropic(210e3, 0.3)
    >>> grid = fit_grid(lambda x, y: (x - 3) ** 2 / 20 + y**2 / 900, steel, load=100)
    >>> [round(float(end), 1) for end in (grid.x().mean(), *grid.sides)]
    [3.0, 0.3, 3.3]
    """
    if (approach is None) == (load is None):
        raise InputError("fit_grid: exactly one of approach [mm] and load [N] is needed")
    approach, load, hardness = map(plain_number, (approach, load, hardness))
    approach = to_length("approach", approach) if isinstance(approach, str) else approach
    loading = {"approach": approach} if load is None else {"load": load}
    if load is not None and not load > 0:
        raise InputError(f"fit_grid: load {load!r}: must be positive, for a contact to fit to")
    if patch is None:
        known = isinstance(gap, Shape)
        bounds = {**loading, "hardness": hardness}
        patch = default_patch(gap, material.contact_modulus, **bounds) if known else _UNIT_PATCH
    if load is not None and hardness is not None:
        patch = _enlarge(patch, MARGIN**2 * load / hardness)
    nx, ny = (cells, cells) if np.ndim(cells) == 0 else cells
    for _ in range(MAX_PROBES):
        grid = Grid.from_domain(PROBE_CELLS, PROBE_CELLS, patch)
        problem = gap.on(grid) if isinstance(gap, Problem) else gap
        if problem is gap or hardness is not None:
            problem = ContactProblem(grid, material, problem, hardness=hardness)
        contact, possible, found = _probe(problem, loading)
        spans = [_fit_side(contact.any(axis=k), possible.any(axis=k)) for k in (0, 1)]
        (a, b), (c, d) = (span for span, _ in spans)
        patch = grid.x0 + a * grid.dx, grid.x0 + b * grid.dx, grid.y0 + c * grid.dy, grid.y0 + d * grid.dy
        if found and all(done for _, done in spans):
            return Grid.from_domain(nx, ny, patch)
        if not (np.isfinite(patch).all() and min(patch[1] - patch[0], patch[3] - patch[2]) > 0):
            break
    if not found:
        raise InputError(f"fit_grid: no contact at the approach {format_exact(approach)} mm")
    sides = ", ".join(map(format_exact, patch))
    raise InputError(f"fit_grid: no patch contains the contact, last tried {sides} mm; give the domain")


def _enlarge(patch, area):
    """Enlarge a patch about its centre to at least an area [mm2]."""
    x0, x1, y0, y1 = patch
    half = max(math.sqrt(area / ((x1 - x0) * (y1 - y0))) - 1, 0.0) / 2
    return x0 - half * (x1 - x0), x1 + half * (x1 - x0), y0 - half * (y1 - y0), y1 + half * (y1 - y0)


def _probe(problem, loading):
    """Solve on a trial grid; return contact, admissible cells, whether in contact.

    In admissible cells contact is possible. Without contact, return the cells of the smallest distance as contact set.
    """
    shape = problem.shape_on(problem.grid)
    if not np.isfinite(shape).any():
        raise InputError("fit_grid: contact is impossible in all cells (NaN) of the first patch")
    with ContactSolver(problem, options={"lcp_precision": "double"}, comm=MPI.COMM_SELF) as solver:
        contact = solver.solve(**loading).contact
    found = contact.any()
    return contact if found else shape == np.nanmin(shape), np.isfinite(shape), found


def _fit_side(contact, possible):
    """Return the next patch's ends along a side; whether they are final.

    The ends are counted in cells. `contact` and `possible` are masks of the cells along the side: cells in contact, and
    cells where contact is possible.
    """
    n, cells, admissible = len(contact), np.flatnonzero(contact), np.flatnonzero(possible)
    first, last = int(cells[0]), int(cells[-1]) + 1
    middle, width = (first + last) / 2, last - first
    fills = (first, last) == (int(admissible[0]), int(admissible[-1]) + 1)
    if fills and first > 0 and last < n:  # the bodies end here
        half = END_MARGIN * width / 2
        return (middle - half, middle + half), width >= MIN_PROBE_WIDTH
    if first == 0 or last == n:
        half = MAX_GROWTH * n / 2
        return (middle - half, middle + half), False
    if width < MIN_PROBE_WIDTH:
        half = MARGIN * (width / 2 + 1)
        return (middle - half, middle + half), False
    half = math.ceil(MARGIN * width / 2 + 1)
    return (middle - half, middle + half), True
