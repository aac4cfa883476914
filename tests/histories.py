"""Random histories of creep and wear, and random tilts, against dense solutions of every step.

``python tests/histories.py KIND FIRST LAST``, also under mpiexec, tries the problems of these numbers; KIND is creep,
wear or tilt. It prints what is wrong, and counts. Only the influence matrix is shared with the program: the bodies'
memory comes from the relaxation itself, and a step is solved by an active set method of quadratic programming.
"""

import sys
import warnings
from collections import Counter
from math import isclose

import numpy as np
from scipy.optimize import linprog

from app import ContactProblem, ContactSolver, Grid, InputError, Material
from app.verification.dense import long_matrix

ROUNDING = 1e-12  # relative; of a dense solution
RTOLS = 1e-2, 1e-4, 1e-4, 1e-4, 1e-6, 1e-8, 1e-10


# -- dense reference ---------------------------------------------------------------------------------------


class Quadratic:
    """Minimise p.Ap / 2 + h.p with 0 <= p <= upper and phi.T p = wanted.

    The iteration is an active set method of quadratic programming: each step minimises on the cells between their
    bounds, goes as far as the bounds allow, and releases the cell that gains most.
    """

    def __init__(self, matrix, h, upper=None, phi=None):
        n = len(h)
        self.long, self.matrix, self.h = matrix, matrix.astype(float), np.asarray(h, np.longdouble)
        self.upper = np.full(n, np.inf) if upper is None else np.broadcast_to(upper, n)
        self.phi = np.zeros((n, 0)) if phi is None else phi

    def newton(self, free, p):
        """Return the minimum on the free cells, and the multipliers."""
        cells, k = np.flatnonzero(free), self.phi.shape[1]
        f = self.phi[cells]
        system = np.block([[self.matrix[np.ix_(cells, cells)], -f], [-f.T, np.zeros((k, k))]])
        scale = np.sqrt(np.append(np.full(len(cells), self.matrix[0, 0]), np.ones(k)))
        inverse = np.linalg.pinv(system / scale / scale[:, None], hermitian=True, rcond=1e-14)
        new, z = p.copy(), np.zeros(k, np.longdouble)
        for _ in range(4):  # refined in extended precision
            rest = f @ z - self.h[cells] - self.long[cells] @ new
            rest = np.append(rest, self.phi.T @ (new - p)) / scale
            step = (inverse @ rest.astype(float)) / scale
            new[cells] += step[: len(cells)]
            z += step[len(cells) :]
        return new, z

    def solve(self, p):
        """Return the solution and its multipliers, from a p that is allowed; None if rounding keeps it from its end."""
        p = np.clip(p.astype(np.longdouble), 0, self.upper)
        size = max(float(abs(self.h).max()), 1e-300)
        free = (p > 0) & (p < self.upper)
        for _ in range(20 * len(p) + 50):
            new, z = self.newton(free, p)
            step = new - p
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(step < 0, -p / step, np.where(step > 0, (self.upper - p) / step, np.inf))
            room[~free] = np.inf
            most = max(float(p.max()), float(abs(new).max()), 1e-300)
            beyond = free & ((new < -1e-17 * most) | (new > self.upper * (1 + 1e-17)))
            if beyond.any():
                room[~beyond] = np.inf
                share = min(max(float(room.min()), 0.0), 1.0)
                p = np.clip(p + share * step, 0, self.upper)
                blocked = beyond & (room <= share)
                p[blocked] = np.where(step[blocked] < 0, 0, self.upper[blocked])
                free &= ~blocked
                continue
            p = np.clip(new, 0, self.upper)
            e = self.h + self.long @ p - self.phi @ z
            wrong = np.where(~free & (p < self.upper), -e, np.where(~free, e, -np.inf))
            rounding = 1e-16 * size + 1e-16 * float(abs(e).max())
            if wrong.max(initial=-np.inf) <= rounding:
                return p, z
            free[np.argmax(wrong)] = True
        return None


class Memory:
    """Internal state of a generalised Maxwell body, from its relaxation: q_i' = (v - q_i) / t_i, p = v - sum g_i q_i.

    The symmetric matrix of the q_i is diagonalised by Jacobi's rotations in extended precision.
    """

    def __init__(self, times, moduli, share=1.0):
        t, g = (np.asarray(x, np.longdouble) for x in (times, moduli))
        b, n = np.sqrt(g / t), len(t)
        matrix, self._vectors = np.diag(1 / t) - np.outer(b, b), np.eye(n, dtype=np.longdouble)
        for _ in range(60):
            for i in range(n):
                for j in range(i + 1, n):
                    if abs(matrix[i, j]) <= 1e-30 * np.sqrt(abs(matrix[i, i] * matrix[j, j])):
                        continue
                    theta = (matrix[j, j] - matrix[i, i]) / (2 * matrix[i, j])
                    tan = (1 if theta >= 0 else -1) / (abs(theta) + np.sqrt(theta * theta + 1))
                    cos = 1 / np.sqrt(tan * tan + 1)
                    turn = np.eye(n, dtype=np.longdouble)
                    turn[[i, j], [i, j]], turn[i, j], turn[j, i] = cos, tan * cos, -tan * cos
                    matrix, self._vectors = turn.T @ matrix @ turn, self._vectors @ turn
        self.rates, self.coupling = np.diag(matrix), self._vectors.T @ b
        self.share, self.state = share, 0.0

    def step(self, duration):
        """Return factors of the state, of p before and of p after."""
        x = self.rates * np.longdouble(duration)
        decay = np.exp(-x)
        tiny = x < 1e-2
        y, z = np.where(tiny, x, 0), np.where(tiny, 1, x)
        series = y / 2 - y**2 / 6 + y**3 / 24 - y**4 / 120 + y**5 / 720 - y**6 / 5040 + y**7 / 40320
        after = np.where(tiny, series, 1 + np.expm1(-z) / z)
        before = np.where(tiny, -np.expm1(-y) - series, -np.expm1(-z) / z - decay)
        return decay, before * self.coupling / self.rates, after * self.coupling / self.rates

    def advance(self, duration, before, after):
        """Return c and r of ``u = A (c p + r)`` at the end of a step; `after(p)` completes the step."""
        decay, first, last = self.step(duration)
        kept = np.multiply.outer(decay, np.ones_like(before)) * self.state + np.multiply.outer(first, before)
        factor = 1 + self.share * float(self.coupling @ last)
        past = self.share * np.tensordot(self.coupling, kept, 1)

        def finish(p):
            self.state = kept + np.multiply.outer(last, p)

        return factor, past, finish


# -- random bodies -----------------------------------------------------------------------------------------


def random_gap(rng, grid, holes=True):
    """Waves, noise, plateaus, a plane, a ball, single peaks, with holes or without."""
    x, y = (grid.x() - grid.x()[0]) / grid.sides[1], ((grid.y() - grid.y()[0]) / grid.sides[0])[:, None]
    shape = grid.shape
    gap = [
        lambda: np.cos(7 * x + rng.uniform(0, 6)) + np.cos(5 * y + 2 * x),
        lambda: rng.normal(size=shape),
        lambda: rng.integers(0, 3, shape) * 1.0,
        lambda: np.zeros(shape),
        lambda: (x - rng.random()) ** 2 + (y - rng.random()) ** 2,
        lambda: np.where(rng.random(shape) < 0.08, 0.0, 1.0 + rng.random(shape)),
    ][rng.choice(6, p=[0.2, 0.25, 0.15, 0.05, 0.2, 0.15])]()
    gap = gap * rng.choice([1.0, 0.01, 1e-4]) * np.sqrt(grid.cell_area) + rng.choice([0.0, 0.0, 1.0, -30.0])
    if holes and rng.random() < 0.3:
        gone = rng.random(shape) < rng.choice([0.1, 0.5])
        gap[gone & (gone.sum() < gone.size)] = np.nan
    return gap


def random_grid(rng, cells=110, least=1):
    while True:
        nx, ny = (int(n) for n in rng.choice([1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 12, 16, 25], 2))
        if least <= min(nx, ny) and nx * ny <= cells:
            break
    size = rng.choice([1.0, 0.1, 1e-3])
    return Grid(nx, ny, size, size * rng.choice([1.0, 1.0, 0.7, 4.0]))


def random_numbers(rng, problem, kind, steps):
    """Numbers of a loading that rise, fall, separate the bodies, and return."""
    gap, grid = problem.gap, problem.grid
    least, spread = float(np.nanmin(gap)), float(np.nanmax(gap) - np.nanmin(gap)) or 0.1 * grid.dx
    rise = [
        np.ones(steps),
        np.linspace(0.2, 1, steps),
        np.linspace(1, 0.1, steps),
        np.sin(np.linspace(0.3, 2.9, steps)),
        np.resize([1.0, 0.0, 0.7], steps),
        rng.random(steps),
        10 ** rng.uniform(-4, 1, steps),
        np.resize([0.0, 1.0], steps),
    ][rng.integers(8)]
    if kind in ("load", "mean_pressure"):
        stress = problem.material.contact_modulus * spread / np.sqrt(grid.cell_area)
        size = 10 ** rng.uniform(-4, 1) * stress * (grid.area if kind == "load" else 1.0)
        return (size * rise).tolist()
    mean = float(np.nanmean(gap))
    full = problem.grid.doubly_periodic and not np.isnan(gap).any()
    share = rng.choice([0.1, 0.5, 0.9, 1.5]) * rise - rng.choice([0.0, 0.0, 0.3])
    if full:
        share = np.minimum(share, 1.0)
    depths = least + share * (mean - least if full else spread)
    return ((mean - depths).clip(0) if kind == "mean_gap" else depths).tolist()


def random_history(rng, periodic):
    """A body, a kind of loading and its numbers."""
    grid = random_grid(rng, least=2 if periodic else 1)
    gap = random_gap(rng, grid)
    kinds = ["load", "mean_pressure", "approach", "approach"]
    if periodic in ("spectral", "love") and not np.isnan(gap).any():
        kinds.append("mean_gap")
    return grid, gap, str(rng.choice(kinds))


def solver_options(rng, comm):
    return {"lcp_rtol": float(rng.choice(RTOLS))} | ({} if comm.size == 1 else {"lcp_cells_per_rank": 16})


class Wrong(Exception):
    """A law that a solution breaks."""


def require(condition, what):
    if not condition:
        raise Wrong(what)


def is_comparable(found, kind, number, step, counts):
    """Return whether a step has an error bound. Check the prescribed number of a solved step; count all others."""
    if found.converged:
        check_loading(found, kind, number)
        return True
    counts["not converged"] += 1
    counts.setdefault("examples", []).append(
        (counts["problems"], step, kind, found.message, found.error_bound)
    )
    return bool(np.isfinite(found.error_bound))


def check_loading(found, kind, number):
    """A converged solution has the prescribed number."""
    value = getattr(found, kind)
    require(
        isclose(value, number, rel_tol=1e-9, abs_tol=1e-12 * abs(found.approach)),
        f"{kind} {value} for {number}",
    )


def loads_phi(kind, number, inside, total):
    """Constraint of a prescribed load."""
    return np.ones((inside.sum(), 1)) if kind in ("load", "mean_pressure") and total > 0 else None


# -- creep -------------------------------------------------------------------------------------------------


def random_creep(rng):
    periodic = str(rng.choice(["", "", "spectral", "love", "x", "y"]))
    grid, gap, kind = random_history(rng, periodic)
    terms = int(rng.integers(1, 5))
    times = (10 ** rng.uniform(-4, 4, terms)).tolist()
    moduli = rng.random(terms) + 0.01
    moduli *= rng.choice([0.1, 0.5, 0.9, 0.999, 1 - 1e-6]) / moduli.sum() * (1 - 1e-15)
    material, share = Material.pair((10.0, np.inf), (0.5, 0.3)), 1.0
    if rng.random() < 0.3:
        material = Material.pair((10.0, 30.0), (0.45, 0.2))
        body = [None, 1, 2][rng.integers(3)]
        if body:
            young, nu = (10.0, 30.0)[body - 1], (0.45, 0.2)[body - 1]
            share = (1 - nu**2) / young / ((1 - 0.45**2) / 10 + (1 - 0.2**2) / 30)
        material = material.viscoelastic(times, moduli.tolist(), **({"body": body} if body else {}))
    else:
        material = material.viscoelastic(times, moduli.tolist())
    problem = ContactProblem(grid, material, gap, periodic=periodic)
    steps = int(rng.integers(2, 8))
    durations = (
        10 ** rng.uniform(-6, 6, steps - 1) if rng.random() < 0.5 else 10 ** rng.uniform(-2, 2, steps - 1)
    )
    at = np.cumsum([rng.choice([0.0, -5.0, 1e3]), *durations])
    at = at[np.append(True, np.diff(at) > 0)]
    return (
        problem,
        Memory(times, moduli, share),
        at.tolist(),
        kind,
        random_numbers(rng, problem, kind, len(at)),
    )


def check_creep(rng, comm, counts):
    problem, memory, times, kind, numbers = random_creep(rng)
    with ContactSolver(problem, options=solver_options(rng, comm), comm=comm) as solver:
        path = [solution.gather() for solution in solver.creep(times, **{kind: numbers})]
    if comm.rank:
        return
    grid, inside = problem.grid, ~np.isnan(problem.gap)
    whole = long_matrix(grid, problem.kernel)
    matrix = whole[np.ix_(inside.ravel(), inside.ravel())]
    past, finish, factor = np.zeros(grid.shape, np.longdouble), None, 1.0
    memory.state = np.zeros((len(memory.rates), *grid.shape), np.longdouble)
    for step, found in enumerate(path):
        counts["steps"] += 1
        if step:
            before = path[step - 1].pressure.astype(np.longdouble)
            factor, past, finish = memory.advance(times[step] - times[step - 1], before, None)
        p = found.pressure.astype(np.longdouble)
        if finish:
            finish(p)
        u = (whole @ (factor * p + past).ravel()).reshape(grid.shape)
        parts = [
            whole @ (factor * p).ravel(),
            whole @ past.ravel(),
            1e-3 * abs(whole) @ (factor * p + past).ravel(),
        ]
        scale = sum(float(abs(part).max()) for part in parts)
        off, rounding = float(abs(found.displacement - u).max()), 1e-15 * abs(found.approach) + 1e-300
        require(off <= 1e-11 * scale + rounding, f"step {step}: displacement off by {off:.3g} of {scale:.3g}")
        gap = problem.gap - found.approach + u
        off = float(np.nanmax(abs(found.gap - gap)))
        require(
            off <= 1e-11 * scale + 1e-14 * np.nanmax(abs(problem.gap)), f"step {step}: gap off by {off:.3g}"
        )
        require(isclose(found.max_pressure, p.max(), rel_tol=1e-12), f"step {step}: max_pressure")
        total = float(p.sum()) * grid.cell_area
        require(isclose(found.load, total, rel_tol=1e-9), f"step {step}: load {found.load} is {total}")
        h = (problem.gap.astype(np.longdouble) + (whole @ past.ravel()).reshape(grid.shape))[inside]
        if not is_comparable(found, kind, numbers[step], step, counts):
            continue
        phi = loads_phi(kind, numbers[step], inside, total)
        dense = Quadratic(
            factor * matrix, h if phi is not None else h - np.longdouble(found.approach), None, phi
        )
        compare_step(counts, found, dense, p[inside], step, kind, problem)


def compare_step(counts, found, dense, p, step, kind, problem, matrix=None, far=0.0):
    require(
        (found.pressure >= 0).all() and np.isfinite(found.pressure).all(), f"step {step}: pressure below 0"
    )
    require((found.pressure[np.isnan(problem.gap)] == 0).all(), f"step {step}: pressure in a hole")
    exact = dense.solve(p)
    if exact is None:
        counts["not compared"] += 1
        counts.setdefault("uncompared", []).append((counts["problems"], step, kind))
        return
    p_exact, z = exact
    matrix, error = dense.long if matrix is None else matrix, p - p_exact
    norm = max(float(p @ (matrix @ p)), 0.0) ** 0.5
    error = max(float(error @ (matrix @ error)), 0.0) ** 0.5
    counts["compared"] += 1
    smallest = problem.kernel.smallest_eigenvalue(problem.grid)
    large = max(np.nanmax(abs(problem.gap)) + abs(found.approach), far)
    rounding = float(dense.long[0, 0] * (p @ p)) ** 0.5 * 4 * np.finfo(float).eps
    rounding += ROUNDING * norm + 4 * np.finfo(float).eps * large * (len(p) / smallest) ** 0.5
    if not error <= found.error_bound * norm * (1 + 1e-6) + rounding:
        above = f"error {error / (norm or 1):.3g} above its bound {found.error_bound:.3g}"
        raise Wrong(f"step {step}, {kind}, converged {found.converged}: {above}")
    if norm > 0 and error > rounding:
        counts["closest"] = max(counts["closest"], error / norm / found.error_bound)


# -- wear --------------------------------------------------------------------------------------------------


def random_wear(rng):
    periodic = str(rng.choice(["", "", "spectral", "love", "x", "y"]))
    grid, gap, kind = random_history(rng, periodic)
    thickness = grid.widest_cell * 10 ** rng.uniform(-0.3, 1)
    material = [
        Material.combined(80000, 0.3),
        Material.coated((4e5, 2e5), (0.2, 0.3), thickness),
        Material.layer(50.0, 0.3, thickness),
    ][rng.choice(3, p=[0.7, 0.15, 0.15])]
    local = np.sqrt(grid.cell_area) / material.contact_modulus
    compliance = float(rng.choice([0.0, 0.0, 10 ** rng.uniform(-3, 3) * local]))
    problem = ContactProblem(grid, material, gap, periodic=periodic, surface_compliance=compliance)
    steps = int(rng.integers(1, 7))
    worn = 10 ** rng.uniform(-3, 3) * local  # k s of a step
    k = 10 ** rng.uniform(-12, -3)
    return problem, k, worn / k * steps, steps, kind, random_numbers(rng, problem, kind, steps)


def check_wear(rng, comm, counts):
    problem, k, distance, steps, kind, numbers = random_wear(rng)
    options = solver_options(rng, comm)
    rtol = options["lcp_rtol"]
    with ContactSolver(problem, options=options, comm=comm) as solver:
        path = [solution.gather() for solution in solver.wear(k, distance, steps, **{kind: numbers})]
    if comm.rank:
        return
    grid, inside = problem.grid, ~np.isnan(problem.gap)
    bodies = long_matrix(grid, problem.kernel)
    own = k * distance / steps
    eye = np.eye(grid.n) - (1 / grid.n if grid.doubly_periodic else 0)
    worn, uniform = np.zeros(grid.shape, np.longdouble), problem.kernel.uniform_compliance(grid)
    uniform += own if grid.doubly_periodic else 0.0
    step_matrix = (bodies + own * eye)[np.ix_(inside.ravel(), inside.ravel())]
    for step, found in enumerate(path):
        counts["steps"] += 1
        p = found.pressure.astype(np.longdouble)
        h = problem.gap.astype(np.longdouble) + worn
        worn = worn + own * p
        mean = float(p.mean())
        u = (bodies @ p.ravel()).reshape(grid.shape) + problem.kernel.uniform_compliance(grid) * mean
        scale = float(abs(u).max()) + float(worn.max())
        off, rounding = float(abs(found.displacement - u).max()), 1e-15 * abs(found.approach) + 1e-300
        require(off <= 1e-10 * scale + rounding, f"step {step}: displacement off by {off:.3g} of {scale:.3g}")
        off = float(abs(found.extra["worn_depth"] - worn).max())
        require(off <= 1e-12 * float(worn.max()), f"step {step}: worn depth off by {off:.3g}")
        volume = float(worn.sum()) * grid.cell_area
        require(isclose(found.worn_volume, volume, rel_tol=1e-12), f"step {step}: worn volume")
        off = float(np.nanmax(abs(found.gap - (problem.gap + worn - found.approach + u))))
        left = 0.0
        if kind == "approach" and uniform:  # its search ends at a tolerance
            left = rtol * max(found.approach - float(np.nanmin(h)), float(np.nanstd(h.astype(float))))
        require(
            off <= left + 1e-10 * scale + 1e-14 * np.nanmax(abs(problem.gap)),
            f"step {step}: gap off by {off:.3g}",
        )
        total = float(p.sum()) * grid.cell_area
        require(isclose(found.load, total, rel_tol=1e-9), f"step {step}: load {found.load} is {total}")
        if not is_comparable(found, kind, numbers[step], step, counts):
            continue
        phi, at = (
            loads_phi(kind, numbers[step], inside, total),
            np.longdouble(found.approach) - uniform * mean,
        )
        matrix, h = step_matrix, h[inside]
        if kind == "approach" and uniform:  # the whole matrix, with the uniform displacement
            matrix, at = step_matrix + np.longdouble(uniform) / grid.n, np.longdouble(found.approach)
        dense = Quadratic(matrix, h if phi is not None else h - at, None, phi)
        compare_step(counts, found, dense, p[inside], step, kind, problem, step_matrix)


# -- tilt --------------------------------------------------------------------------------------------------


def random_tilt(rng):
    """A body on a free patch, with a loading that turns it."""
    grid = random_grid(rng)
    grid = Grid(grid.nx, grid.ny, grid.dx, grid.dy, *(rng.choice([0.0, -0.5, 3.0], 2) * grid.sides[::-1]))
    thickness = grid.widest_cell * 10 ** rng.uniform(-0.3, 1)
    materials = [
        Material.isotropic(210e3, 0.3),
        Material.coated((4e5, 2e5), (0.2, 0.3), thickness),
        Material.layer(50.0, 0.3, thickness),
    ]
    material, gap = materials[rng.choice(3, p=[0.7, 0.15, 0.15])], random_gap(rng, grid)
    spread = float(np.nanmax(gap) - np.nanmin(gap)) or 0.1 * grid.dx
    stress = material.contact_modulus * spread / np.sqrt(grid.cell_area)
    hardness = None
    if rng.random() < 0.5:
        hardness = 10 ** rng.uniform(-2, 1) * stress
        if rng.random() < 0.5:
            hardness = hardness * (0.1 + rng.random(grid.shape))
            hardness[rng.random(grid.shape) < rng.choice([0.0, 0.3])] = np.inf
    problem = ContactProblem(grid, material, gap, hardness=hardness)
    return problem, stress, spread


def largest_load(problem, centre):
    """Return the largest load with a centre, by linear programming; infinite without a limit."""
    inside = ~np.isnan(problem.gap)
    x, y = (part[inside] for part in np.broadcast_arrays(problem.grid.x(), problem.grid.y()[:, None]))
    upper = np.inf if problem.hardness is None else problem.hardness
    upper = np.broadcast_to(upper, problem.gap.shape)[inside]
    unit = upper[np.isfinite(upper)].max(initial=0.0) or 1.0
    size = max(problem.grid.sides)
    limits = np.stack([np.zeros(len(x)), np.minimum(upper / unit, 1e9)], axis=1)
    moments = [(x - centre[0]) / size, (y - centre[1]) / size]
    found = linprog(-np.ones(len(x)), A_eq=moments, b_eq=[0, 0], bounds=limits, method="highs")
    most = -found.fun if found.status == 0 else 0.0
    return np.inf if most > 1e8 else most * unit * problem.grid.cell_area


def check_tilt(rng, comm, counts):
    problem, stress, spread = random_tilt(rng)
    grid, inside = problem.grid, ~np.isnan(problem.gap)
    x, y = np.broadcast_arrays(grid.x(), grid.y()[:, None])
    how = rng.choice(["load_centre", "load_centre", "moment", "tilt with load", "tilt with approach"])
    load = float(10 ** rng.uniform(-3, 1) * stress * grid.area)
    phi, loading, refused = None, {}, False
    if "tilt" in how:
        slopes = rng.choice([0.0, 0.1, 1.0]) * rng.uniform(-1, 1, 2) * spread / grid.sides[::-1]
        loading["tilt"] = tuple(slopes.tolist())
        shape = (problem.gap - slopes[0] * x - slopes[1] * y)[inside]
        loading["approach"] = float(shape.min() + rng.uniform(-0.2, 1) * np.ptp(shape))
        if "load" in how:
            phi = np.ones((inside.sum(), 1))
            del loading["approach"]
            upper = np.broadcast_to(np.inf if problem.hardness is None else problem.hardness, grid.shape)
            loading["load"] = min(load, 0.9 * float(upper[inside].sum()) * grid.cell_area)
    else:
        weights = rng.random(grid.shape) ** rng.choice([0.5, 1, 4, 20]) * inside
        centre = [float((weights * part).sum() / weights.sum()) for part in (x, y)]
        if rng.random() < 0.1:
            centre = (np.array(centre) + rng.uniform(-1, 1, 2) * grid.sides[::-1]).tolist()
        most = largest_load(problem, centre)
        if np.isfinite(most) and most > 1e-9 * load:
            load = min(load, float(rng.choice([0.1, 0.5, 0.9, 0.99, 1.01, 2.0])) * most)
        corners = np.stack([x[inside], y[inside]])
        extent = np.linalg.svd(corners - corners.mean(axis=1)[:, None], compute_uv=False)[-1]
        refused = load > most or extent < 1e-9 * max(grid.sides)  # all cells on a line
        loading = {"load": load, how: tuple(centre)}
        if how == "moment":
            loading["moment"] = (load * centre[0], load * centre[1])
        phi = np.stack([np.ones(inside.sum()), (x - centre[0])[inside], (y - centre[1])[inside]], axis=1)
        phi[:, 1:] /= max(grid.sides)
    with ContactSolver(problem, options=solver_options(rng, comm), comm=comm) as solver:
        products = solver.hierarchy.operator_applications()
        try:
            found = solver.solve(**loading).gather()
        except InputError as error:
            counts["refused"] += 1
            require(refused, f"refused: {error}")
            require(solver.hierarchy.operator_applications() == products, "refused after work")
            return
    require(not refused, f"not refused: {loading}")
    if comm.rank:
        return
    counts["steps"] += 1
    p = found.pressure.astype(np.longdouble)
    total, in_x, in_y = (float((p * part).sum()) * grid.cell_area for part in (1.0, x, y))
    size = float(abs(x).max() + abs(y).max()) * total
    require(isclose(found.load, total, rel_tol=1e-9), f"load {found.load} is {total}")
    require(abs(found.moment_x - in_x) + abs(found.moment_y - in_y) <= 1e-9 * size, "moments")
    if not found.converged:
        counts["not converged"] += 1
        counts.setdefault("examples", []).append((counts["problems"], how, found.message, found.error_bound))
        if not np.isfinite(found.error_bound):
            return
    else:
        for kind in loading.keys() & {"load", "approach"}:
            check_loading(found, kind, loading[kind])
        if phi is not None and phi.shape[1] == 3:
            off = abs(phi.T @ p[inside])[1:].max() * grid.cell_area
            require(off <= 2e-9 * total, f"centre off by {off / total:.3g}")
    turned = found.tilt_x * x + found.tilt_y * y
    h = problem.gap - np.longdouble(found.approach) - turned
    matrix = long_matrix(grid, problem.kernel)
    u = (matrix @ p.ravel()).reshape(grid.shape)
    off = float(np.nanmax(abs(found.undeformed_distance + found.displacement - h - u)))
    far = float(np.nanmax(abs(problem.gap)) + abs(found.approach) + abs(turned).max())
    require(off <= 1e-13 * far + 1e-10 * float(abs(u).max()), f"gap off by {off:.3g}")
    upper = None if problem.hardness is None else np.broadcast_to(problem.hardness, grid.shape)[inside]
    dense = Quadratic(matrix[np.ix_(inside.ravel(), inside.ravel())], h[inside], upper, phi)
    compare_step(counts, found, dense, p[inside], 0, how, problem, far=far)


CHECKS = {"creep": check_creep, "wear": check_wear, "tilt": check_tilt}


def run(kind, numbers, comm):
    """Check problems by number; return the failures and the counts, on rank 0."""
    counts, failures = Counter(), []
    for number in numbers:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                CHECKS[kind](np.random.default_rng([number, sum(map(ord, kind))]), comm, counts)
            except Wrong as wrong:
                failures.append((number, str(wrong)))
            except InputError as error:
                failures.append((number, f"refused: {error}"))
        counts["problems"] += 1
    return failures, counts


if __name__ == "__main__":
    from mpi4py import MPI

    comm = MPI.COMM_WORLD
    failures, counts = run(sys.argv[1], range(int(sys.argv[2]), int(sys.argv[3])), comm)
    if comm.rank == 0:
        for failure in failures:
            print(*failure)
        print(comm.size, "ranks:", dict(counts))
