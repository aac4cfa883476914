"""A proved error bound of any pressure.

Let ``f(p) = p.Ap / 2 + h.p``. The contact problem is ``min f(p), p >= 0``, and its dual is
``max -q.Aq / 2, h + A q >= 0``. Let G = f(p) + q.Aq / 2 be the duality gap of a feasible pair p, q, and D the distance
of p and q in the energy norm. Then

    ||p - p*||_A^2 / 2 + ||q - p*||_A^2 / 2 <= (f(p) - f(p*)) + (f(p*) + q.Aq / 2) = G

because f and the dual are quadratic with the matrix A, and p* is the solution of both. By the triangle inequality the
error of p is at most D larger than that of q, so

    ||p - p*||_A <= (D + sqrt(4 G - D^2)) / 2,

which grows with G and D, from sqrt(G) for q = p to sqrt(2 G). So upper bounds of G and D suffice. Below, u = A p, and
e = h + u is the gap.

*Free patch.* There are two ways to a dual feasible q that cost no product; the smaller bound is taken. The first way
lifts the cells that penetrate, because all entries of A are positive: ``q = (1 + t) p + w`` lifts all cells a little by
t >= 0, and ``w = max(-(e + t u), 0) / A_II`` lifts the cells that still penetrate. With ``L >= ||A||`` the duality gap
of the pair is at most

    p.e + (t + t^2 / 2) p.u + (1 + t) w.u + L w.w / 2,

and the smallest of these bounds for several t is taken, so that few large and many small penetrations both cost little.
The second way changes the gap e to any ``g >= 0``: ``q = p + B w``, ``w = g - e``, B the inverse of A. Since B w.A p =
w.p,

    f(p) + q.Aq / 2 = p.g + w.Bw / 2 <= p.g + w.w / (2 smallest eigenvalue),

with the smallest eigenvalue of A. Cell by cell, this bound is least for ``g = max(e - smallest p, 0)``, where
`smallest` is this eigenvalue. The bound is of second order in the error, so it is better near the solution. Instead of
the smallest eigenvalue we use ``2 / (E* |q|)`` of the shortest wave, ``|q| = pi sqrt(1/dx^2 + 1/dy^2)``. No eigenvalue
is smaller: constant pressures on cells displace their centres by 1.17 (long cells) to 1.4 times as much as this wave.

*Periodic patch.* A has entries of both signs, and no pressure lifts all cells alike. But every field without mean is
the displacement of some pressure. So any ``g >= 0`` with the mean of e is the gap of a dual feasible q:
``A q = u + w``. Here B is the inverse of A on fields without mean. The equation above costs one product with B, or none
if ``w.Bw <= ||B|| w.w`` is used. Cell by cell p g + B_II (g - e)^2 / 2 is least for ``g = max(e - p / B_II, 0)``, which
is the gap outside contact, and 0 on C. Multiplying g by a factor corrects the mean; if the factor would exceed 2, a
constant is added, too. Near first touch the factor is 1 up to rounding, so its difference from 1, and w, are stored
separately from g. In inadmissible cells any g is allowed: it is the mean gap, or larger to keep the factor below 2. If
B is in single precision, the error of w.Bw is added. The energy norm of a constant pressure is zero, so the bound says
nothing about the mean pressure.

*Hardness.* If p <= H, the dual is ``max -q.Aq / 2 - H.max(-(h + A q), 0)`` over all q, and the duality gap of p and
``q = p + B w`` is

    p.max(g, 0) + (H - p).max(-g, 0) + w.Bw / 2,    g = e + w.

Cell by cell, this is least if w moves e towards zero, by at most smallest p from above and by at most smallest (H - p)
from below. On a free patch w = 0 gives a second bound. If no cell is plastic, the dual with g >= 0 is used, which is
feasible here, too. On a periodic patch B_II replaces 1 / smallest, and the mean of w is made zero as above, by a factor
on the gaps or on the overlaps that are left.

*Compliance of each cell.* If the matrix is A + D with a diagonal D >= 0, the proofs hold with numbers of A alone: no
diagonal entry of A + D, and no eigenvalue, is smaller. Only L is larger, by the largest entry of D. On a periodic patch
w may have a sum s: ``w.(A + D)^-1 w`` is the least ``v.Bv + z.D^-1 z`` with v + z = w, so it is at most ``v.Bv + s^2 /
sum(D)`` with ``v = w - D s / sum(D)``, which has no mean.

*Prescribed load and moments.* Both bounds hold if p has the prescribed load: f at the computed approach and f under the
load then differ by a constant, and so do the duals, where the approach of the solution is an unknown like q. The same
holds for moments and the tilt.

*Rounding.* u is A p only up to an error d. The bounds are valid for the problem with h + d, whose solution differs from
the solution with h by ``||d||_B <= ||d|| / sqrt(smallest eigenvalue)`` at most. The error of a product by FFT is about
``eps (sqrt(A_II) ||p|| + ||u|| / sqrt(smallest))`` in this norm (measured: 0.26 to 0.72 times this number).
`_ROUNDING_FACTOR` times this number is added to the bound. The stored matrix of a small periodic patch has rounded
coefficients, which cancel in short waves: there ``||row of A|| / sqrt(smallest)`` replaces sqrt(A_II), with ``||row of
A||^2 <= A_II largest eigenvalue``. Undeformed distances count as exact. A product between lists of cells
has a larger error, of known bound: ``||d|| / sqrt(smallest)`` is added, and ``||p|| ||d||`` is subtracted from p.u, by
which the bound is divided. The first way is not used there, because it needs another product with u. All sums are over
the listed cells: in no other cell do the bodies penetrate (`app.contact.exclusion`), so p = w = 0 there, and the cell
adds nothing, also with a hardness. On a patch periodic in x and y, where w has no mean, 1 / smallest replaces B_II and
||B||, and the open gaps of the listed cells correct the mean.

On a periodic patch of n cells, let m be one unit in the last place of the depth, plus the mean gap that full contact
neglects. Spread over the k cells without pressure, m changes the pressure by about ``n m sqrt(B_II / k)``. If cells are
plastic, u may be much smaller than the depth. Then m is the larger of one unit in the last place of u and the rounding
error of the depth: the gap of elastic cells has no other error, and the gaps of open and of plastic cells have no
price.
"""

import math
from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np
from petsc4py import PETSc

from app.contact import certificate_loops as loops
from app.contact.state import Displacement
from app.halfspace.product import DenseProduct
from app.parallel.reductions import sums_and_minima

_event = PETSc.Log.Event("ContactCertify")
_LIFTS = 12  # trial values of t
_NEGLIGIBLE_BOUND = 1e-5  # error bound below which a product is spent only if a smaller one is needed
_ROUNDING_FACTOR = 4.0  # factor on the expected rounding error of a product
_TRANSFORM_ERROR = 50.0  # error of w.Bw over its largest possible value, in units of the precision of B
_CONSTANT_ROUNDING = 1e3  # deviation of a pressure that is constant up to rounding, in units of its precision
_GAP_ULPS = 4  # rounding error of a gap, in units in the last place of depth or displacements
_LOAD_RTOL = 1e-6  # allowed relative error of a prescribed load


@dataclass(frozen=True)
class Certificate:
    """Proved error bound of a pressure; the same on all ranks."""

    duality_gap: float  # f(p) + q.Aq / 2, times the cell area [N mm]
    error_bound: float  # of ||p - p*||_A / ||p||_A; infinite without pressure, or if p or load is invalid
    largest_penetration: float  # max(-e) over the admissible cells below the hardness, at least 0 [mm]
    smallest_pressure: float  # least p or H - p, at most 0; p in inadmissible cells is negative [N/mm2]
    complementarity: float  # max |p e|, or max (H - p) |e| in plastic cells, over max p * max |h|

    def under(self, prescribed, load, moment_error=0.0):
        """Return the certificate, given the prescribed and the actual load [N].

        If they differ, the proof holds for the approach only, so the bound becomes infinite. Without a
        prescribed load (None) the certificate does not change. `moment_error` is the relative error of prescribed
        moments.
        """
        met = prescribed is None or math.isclose(load, prescribed, rel_tol=_LOAD_RTOL)
        if met and moment_error <= _LOAD_RTOL:
            return self
        return replace(self, error_bound=np.inf)


_certificates = WeakKeyDictionary()  # key of `estimate` and Certificate, by state


def certify(state, wanted=np.inf):
    """Return the `Certificate` of the pressure of a `Pressed`. Collective.

    The displacement is computed in double precision, unless `state` has it. If the first bound is below `wanted`, no
    product is spent on a smaller bound.
    """
    if state.displacement_status is not Displacement.EXACT:
        state.compute_displacement(exact=True)
    return estimate(state, wanted)


def estimate(state, wanted=np.inf, work=None):
    """Return the `Certificate` of a pressure, assuming u = A p. Collective.

    `wanted` and the result are as in `certify`; `work` is a field of work space. The certificate is cached until the
    pressure, the depth or the accuracy of u changes.
    """
    key = _key(state)
    cached_key, certificate = _certificates.get(state, (None, None))
    if key != cached_key:
        with _event:
            certificate = _prove(state, min(wanted, _NEGLIGIBLE_BOUND), work)
        _certificates[state] = key, certificate
    return certificate


def adopt(state, certificate):
    """Use a known certificate of the pressure of `state`."""
    _certificates[state] = _key(state), certificate


def _key(state):
    return state.pressure.stateGet(), state.depth, state.distance.tilt, state.displacement_status


def _prove(state, enough, work):
    b, depth, u, p, admissible = state.distance.b, state.depth, state.u, state.p, state.admissible
    grid = state.distance.patch
    kernel = state.operator.kernel
    smallest = kernel.smallest_eigenvalue(grid)
    bounds, penetrates = state.bounds, np.empty(len(b), bool)
    # Beyond full contact no gap without overlaps has the mean of e.
    overlaps = state.distance.is_beyond_full_contact(depth)
    upper = bounds.upper if overlaps or state.plastic_cells() else None
    largest, sums = np.full(6, -np.inf), np.zeros(6)
    error_of_u = 0.0
    if state.operator.error_bound:
        error_of_u = state.operator.error_bound * np.abs(p).sum() * math.sqrt(p.size)
    lifts = upper is None and not (state.grid.doubly_periodic or error_of_u)
    loops.survey(b, depth, u, p, upper, admissible, smallest, lifts, penetrates, largest, sums)
    sums, lowest = sums_and_minima(state.comm, sums, -largest)
    lift, penetration, deepest, tension, product, highest = (-lowest).tolist()
    u_squares, energy, defect, to_p, moved, p_squares = sums
    if np.isnan(sums).any() or not np.isfinite(moved + energy):  # comparisons with NaN would pass
        return Certificate(np.nan, np.inf, np.nan, np.nan, np.nan)
    shifted = squares = 0.0
    if tension > bounds.rounding * highest:
        gap = np.inf
    elif state.grid.doubly_periodic:
        gap, squares, energy, shifted = _close_gap(state, energy, u_squares, enough, work, upper)
    elif grid.doubly_periodic:
        gap, squares, shifted = _close_gap_on_list(state, 1 / smallest)
    else:
        gap, squares = to_p + moved / (2 * smallest), moved / smallest
        if upper is not None:
            gap, squares = _best([defect, gap], [0.0, squares])
        elif lifts and state.operator.kernel.is_positive(grid):
            lifted, distances = _lift_penetrations(state, lift, energy, penetrates)
            gap, squares = _best([gap, *(defect + lifted)], [squares, *distances])
    gap = max(gap, 0.0)
    diagonal = state.operator.diagonal
    if state.grid.doubly_periodic and state.grid.n <= DenseProduct.largest:
        diagonal *= max(kernel.largest_eigenvalue(grid) / smallest, 1.0)
    rounding = np.sqrt(diagonal * p_squares) + np.sqrt(u_squares / smallest)
    if error_of_u:
        shifted += error_of_u / math.sqrt(smallest)
        energy -= error_of_u * math.sqrt(p_squares)
    error = _largest_error(gap, squares) + _ROUNDING_FACTOR * np.finfo(float).eps * rounding + shifted
    if upper is not None and not error_of_u and _is_plastic_everywhere(state):
        gap = error = 0.0  # p is exact, even if its energy is only rounding
    without_energy = 0.0 if gap == 0 else np.inf
    return Certificate(
        duality_gap=gap * state.grid.cell_area,
        error_bound=float(error / np.sqrt(energy)) if energy > 0 and error > 0 else without_energy,
        largest_penetration=penetration + 0.0,
        smallest_pressure=0.0 - tension,
        complementarity=product / (highest * deepest) if highest * deepest > 0 else 0.0,
    )


def _largest_error(gap, squares):
    """Return a bound of ||p - p*||_A, from upper bounds of the duality gap and of ||p - q||_A^2."""
    gap = np.maximum(gap, 0.0)
    squares = np.clip(squares, 0.0, 2 * gap)  # sums may be negative by rounding
    return (np.sqrt(squares) + np.sqrt(4 * gap - squares)) / 2


def _best(gaps, squares):
    """Return the duality gap and ||p - q||_A^2 of the pair with the least bound; each bound holds."""
    best = np.argmin(_largest_error(gaps, squares))
    return float(gaps[best]), float(squares[best])


def _is_plastic_everywhere(state):
    """Return whether all admissible cells are plastic, gap-free. Collective."""
    if state.plastic_cells() < state.distance.statistics.cells:
        return False
    fields = state.gap(), np.abs(state.u), state.p
    maxima = [field.max(where=state.admissible, initial=-np.inf) for field in fields]
    gap, u, highest = (-np.asarray(state.minimum(np.negative(maxima)))).tolist()
    rounding = np.finfo(float).eps * (u + state.operator.diagonal * highest)
    return gap <= _GAP_ULPS * max(rounding, state.distance.depth_rounding(state.depth))


def _lift_penetrations(state, most, energy, penetrates):
    """Return duality gaps without p.e, and ||p - q||_A^2, by lifting penetrations. Collective.

    This is the first way of the module docstring, on a free patch, for several t up to `most`. `energy` is p.u, and
    `penetrates` marks the rows with penetration.
    """
    sums = np.zeros((3, _LIFTS + 1))  # of -e u, e e, u u
    loops.lift(state.distance.b, state.depth, state.u, state.admissible, most, penetrates, sums)
    product, e_squares, u_squares = np.cumsum(state.sum(sums), axis=1)
    shares = most * np.append(0.5 ** np.arange(_LIFTS), 0.0)
    to_u, squares = product - shares * u_squares, e_squares + shares * (shares * u_squares - 2 * product)
    grid, diagonal = state.distance.patch, state.operator.diagonal
    to_u, squares = to_u / diagonal, squares / diagonal**2
    # No row of A sums to more than the displacement in the middle of twice the patch under unit pressure.
    norm = state.operator.kernel.middle_displacement([2 * side for side in grid.sides[::-1]])
    if (compliance := state.operator.compliance) is not None:
        norm -= float(state.minimum([-compliance.max(initial=0.0)])[0])
    distances = shares * (shares * energy + 2 * to_u) + norm * squares
    return shares * energy + to_u + distances / 2, distances


def _close_gap(state, energy, u_squares, enough, work, upper):
    """Return duality gap, ||p - q||_A^2, p.Ap and rounding error on a periodic patch. Collective.

    The duality gap is ``p.g + w.Bw / 2`` with ``w = g - e``; g is the changed gap, and B the inverse of A (module
    docstring). If the bound ``||B|| w.w`` of w.Bw already shows an error below `enough`, it replaces w.Bw, which saves
    the product with B. If p is constant, p.Ap would be 0 up to rounding; its rounding error is returned if that is
    larger.
    """
    inverse, n = state.operator.inverse, state.grid.n
    diagonal = float(inverse.centre[1, 1]) or 1.0
    rounded = math.ulp(state.depth)  # of the mean gap
    if upper is not None:
        of_u = min(rounded, math.ulp(math.sqrt(u_squares)))
        rounded = max(state.distance.depth_rounding(state.depth), of_u)
    rounded += state.neglected_gap
    fields = state.distance.b, state.depth, state.u, state.p, upper, state.admissible, 1 / diagonal
    gaps, depths, excess, to_p, to_plastic, pressures, squares, total_u, free = state.sum(loops.gaps(*fields))
    inside, mean, *_ = state.distance.statistics
    if not state.distance.is_singular:
        squares = _close_gap_of_springs(state, fields)
        return to_p + to_plastic + squares / 2, squares, energy, 0.0
    excess += total_u  # zero up to rounding, which matters near full contact
    if inside == n and not gaps and not depths:  # full contact: the mean of e is known without rounding
        excess = -n * (mean - state.depth)
    stretch, constant, elsewhere = _gap_with_mean(gaps, excess, inside, n, depths)
    deepen, to_gap = 0.0, (1 + stretch) * to_p + constant * pressures  # p.g
    if upper is not None:
        # If a factor up to 2 on open gaps does not suffice, overlaps get a larger one.
        rest = excess + stretch * gaps + (n - inside) * elsewhere + inside * constant
        negligible = max(1e-12 * abs(excess), n * rounded)
        deepen = rest / depths if depths else 0.0 if abs(rest) <= negligible else np.inf
        if np.isinf(deepen) and rest > 0 and inside == n:  # no overlap is left: all cells get the same
            room = state.bounds.largest_load / state.grid.cell_area - pressures
            deepen, constant, to_gap = 0.0, constant - rest / n, to_gap + rest / n * room
        to_gap = to_gap + (1 + deepen) * to_plastic if -1 <= deepen < np.inf else np.inf
    energy -= pressures * total_u / n  # A 1 = 0 up to rounding
    most, eps = state.operator.diagonal * squares, np.finfo(float).eps
    if state.distance.is_flat or (upper is not None and energy <= (_CONSTANT_ROUNDING * eps) ** 2 * most):
        energy = max(energy, eps * most)  # constant up to rounding: h is flat, or all cells are plastic
    moved = *fields, stretch, deepen, constant, elsewhere
    squares = state.sum([loops.move(*moved, 1.0, np.empty((len(state.u), 0)))[0]])[0]  # w.w
    curved = most = inverse.norm() * squares / 2
    if squares > 0 and _largest_error(to_gap + curved, 2 * curved) > enough * math.sqrt(max(energy, 0.0)):
        field = np.empty(state.u.shape) if work is None else work
        scale = np.sqrt(n / squares)  # the least w underflow in single precision
        loops.move(*moved, scale, field)  # w
        inverse.apply(field, field)  # B w
        curved = state.sum([loops.move(*moved, 1.0, field)[1]])[0] / (2 * scale)  # w.Bw / 2
        curved += _TRANSFORM_ERROR * np.finfo(inverse.dtype).eps * most
    shifted = n * rounded * math.sqrt(diagonal / max(free, 1.0))
    return float(to_gap + curved), float(2 * curved), float(energy), shifted


def _close_gap_on_list(state, norm):
    """Return duality gap, ||p - q||_A^2 and rounding error on a list of cells of a periodic patch.

    `norm` is an upper bound of ||B||, which stands for B here; see `_close_gap`.
    """
    listed, cells = state.grid.n, state.distance.patch.n
    fields = state.distance.b, state.depth, state.u, state.p, None, state.admissible, 1 / norm
    gaps, _, excess, to_p, _, pressures, *_, free = loops.gaps(*fields)
    stretch, constant, _ = _gap_with_mean(gaps, excess, listed, listed)
    if excess + stretch * gaps + listed * constant > 1e-12 * abs(excess):
        return np.inf, 0.0, 0.0  # the listed cells overlap on average
    moved = loops.move(*fields, stretch, 0.0, constant, 0.0, 1.0, np.empty((len(state.u), 0)))[0]
    rounded = math.ulp(state.depth) + state.neglected_gap
    shifted = cells * rounded * math.sqrt(norm / max(free + cells - listed, 1.0))
    return (1 + stretch) * to_p + constant * pressures + norm * moved / 2, norm * moved, shifted


def _close_gap_of_springs(state, fields):
    """Return a bound of ||p - q||_A^2 on a periodic patch whose cells have a compliance. Collective.

    The gap is changed to ``g = max(e - p / B_II, 0)``, see the module docstring; `fields` are the arguments of
    `loops.move`.
    """
    inverse, compliance = state.operator.inverse, state.operator.compliance
    w, product = np.empty((2, *state.u.shape))
    loops.move(*fields, 0.0, 0.0, 0.0, 0.0, 1.0, w)
    total, springs = state.sum([w.sum(), compliance.sum()])
    w -= compliance * (total / springs)
    [squares] = state.sum([np.vdot(w, w)])
    if squares > 0:
        w *= (scale := 1 / math.sqrt(squares))  # the least w underflow in single precision
        inverse.apply(w, product)
        curved = state.sum([np.vdot(w, product)])[0]
        curved += _TRANSFORM_ERROR * np.finfo(inverse.dtype).eps * inverse.norm()
        squares = curved / scale**2
    return squares + total**2 / springs


def _gap_with_mean(gaps, excess, inside, n, depths=0.0):
    """Choose a dual feasible gap g with the same mean as e.

    Here e is the gap, and g0 = max(e - p / B_II, 0), with the diagonal entry B_II of A's inverse. Then ``g = (1 +
    stretch) g0 + constant``, where the constant is 0 if the stretch is within -1 and 1. In inadmissible cells any g is
    allowed; there the change of the gap is `elsewhere`. `inside` of the n cells are admissible. `gaps` is the sum of
    g0, `excess` the sum of g0 - e, `depths` the sum of overlaps, which get the factor 1 minus the stretch.
    """
    elsewhere = max(gaps / inside, (2 * abs(excess) - gaps) / (n - inside)) if inside < n else 0.0
    total = gaps + (n - inside) * elsewhere + depths
    stretch = -excess / total if total > 0 else np.inf
    if abs(stretch) <= 1:
        return stretch, 0.0, stretch * elsewhere
    stretch = float(np.sign(stretch)) if total > 0 else 0.0
    constant = max(-(excess + stretch * total) / n, 0.0)
    return stretch, constant, stretch * elsewhere + constant
