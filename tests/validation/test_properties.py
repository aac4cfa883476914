"""Any problem, any tolerance: a solve ends within bounded work, and is right or says that it is not.

``CONTACT_EXAMPLES=2000 python -m pytest tests/validation/test_properties.py`` tries so many new random problems in each
test; without it, the same few every time.
"""

import os

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.extra.numpy import arrays

from app import ContactProblem, Grid, InputError, Material
from app.verification.dense import DenseProblem
from app.verification.solving import solved

EXAMPLES = int(os.environ.get("CONTACT_EXAMPLES", 0))
some = settings(
    max_examples=EXAMPLES or 20,
    derandomize=not EXAMPLES,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)
CELLS = 150  # at most: what is true is found on the matrix
ITERATIONS = 100  # of active sets on a grid; the safeguard and the search of a load have as many again
ROUNDING = 1e-13  # of the largest distance: what a gap may be off by


@st.composite
def gaps(draw, nx, ny):
    """Heights of all kinds: waves, noise, plateaus with ties, flat, single peaks; holes."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    x, y = np.linspace(0, 1, nx), np.linspace(0, 1, ny)[:, None]
    kind = draw(st.sampled_from(["waves", "noise", "plateaus", "flat", "ball", "peaks", "drawn"]))
    gap = {
        "waves": np.cos(7 * x + rng.uniform(0, 6)) + np.cos(5 * y + 2 * x),
        "noise": rng.normal(size=(ny, nx)),
        "plateaus": rng.integers(0, 3, (ny, nx)) * 1.0,
        "flat": np.zeros((ny, nx)),
        "ball": (x - rng.random()) ** 2 + (y - rng.random()) ** 2,
        "peaks": np.where(rng.random((ny, nx)) < 0.05, 0.0, 1.0 + rng.random((ny, nx))),
        "drawn": None,
    }[kind]
    if gap is None:
        numbers = st.one_of(st.integers(-3, 3).map(float), st.floats(-3, 3, width=32, allow_subnormal=False))
        gap = draw(arrays(float, (ny, nx), elements=numbers))
    gap = gap * draw(st.sampled_from([1.0, 1e-2, 1e-6, 1e4])) + draw(st.sampled_from([0.0, 0.0, 1.0, 1e6]))
    if draw(st.booleans()):
        holes = rng.random(gap.shape) < draw(st.sampled_from([0.1, 0.5, 0.9]))
        gap[holes & (holes.sum() < holes.size)] = np.nan
    return gap


@st.composite
def problems(draw, periodic):
    """A small problem with a loading and a tolerance."""
    nx = draw(st.sampled_from([1, 2, 3, 4, 5, 7, 8, 12, 16, 31, 64]))
    ny = draw(st.sampled_from([n for n in (1, 2, 3, 4, 5, 6, 8, 9, 16, 64) if n * nx <= CELLS]))
    dx = draw(st.sampled_from([1.0, 0.1, 1e-3]))
    aspect = draw(st.sampled_from([1.0, 1.0, 0.7, 4.0, 30.0, 1e3, 1e-3]))
    symbol = draw(st.sampled_from(["spectral", "love"] if periodic else ["", "", "x", "y"]))
    material = Material.combined(
        draw(st.sampled_from([1.0, 8e4, 1e-3])), draw(st.sampled_from([0.0, 0.3, 0.5]))
    )
    gap = draw(gaps(nx, ny))
    problem = ContactProblem(Grid(nx, ny, dx, dx * aspect), material, gap, periodic=symbol)
    least, spread = np.nanmin(gap), np.nanmax(gap) - np.nanmin(gap)
    share = draw(st.sampled_from([-1.0, 0.0, 1e-9, 1e-3, 0.1, 0.5, 0.9, 1.0, 3.0, 100.0]))
    mean = np.nanmean(gap)
    if draw(st.booleans()):
        depth = share * (spread or 0.1 * dx)
        if periodic and not np.isnan(gap).any():
            depth = min(depth, mean - least)
        loading = {"approach": least + depth}
    else:
        stress = material.contact_modulus * (spread or dx) / (dx * max(aspect, 1 / aspect) ** 0.5)
        factor = draw(st.sampled_from([0.0, 1e-12, 1e-6, 1e-3, 0.1, 1.0, 100.0]))
        loading = {"load": factor * stress * problem.grid.area}
    rtol = draw(st.sampled_from([1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12]))
    return problem, loading, rtol


def exact_pressure(dense, loading, found):
    """Return the pressure of the dense problem; under a load, at the approach of `found`."""
    if "approach" in loading:
        return dense.at(loading["approach"])
    if "mean_gap" in loading:
        return dense.with_mean_gap(loading["mean_gap"])
    # The load is met up to rounding, which counts if nearly all cells are plastic.
    load = float(np.sum(found.pressure, dtype=np.longdouble)) * found.grid.cell_area
    return dense.under(load, found.approach)[0]


def assert_right_or_says_not(problem, loading, rtol, method=None):
    """Every answer ends and is certified; one that is called solved is right."""
    gap, inside = problem.gap, ~np.isnan(problem.gap)
    hardness = np.broadcast_to(np.inf if problem.hardness is None else problem.hardness, gap.shape)
    try:
        found = solved(problem, method, options={"lcp_rtol": rtol}, **loading)
    except InputError as error:
        assert "patch one cell wide" in str(error) or "single" in str(error) or "halved" in str(error), error
        return
    p, levels = found.pressure, found.history.get("level", [])
    assert len(levels) <= 20 * ITERATIONS * max(len(set(levels)), 1)
    assert np.isfinite(p).all() and (p >= 0).all() and (p <= hardness).all() and (p[~inside] == 0).all()
    assert found.message
    met = "load" not in loading or found.load == pytest.approx(loading["load"], rel=1e-9, abs=0)
    assert met or not found.converged
    if "approach" in loading:
        assert found.approach == pytest.approx(loading["approach"], rel=1e-12, abs=0)
    dense = DenseProblem(problem)
    exact = exact_pressure(dense, loading, found)
    # The bound holds, but for what rounding leaves of distances that are large in all cells alike: four units in the
    # last place of an approach that is taken as that of full contact.
    size, error = dense.energy(p), dense.energy(exact - p)
    largest = np.nanmax(abs(gap - found.approach)) + 1e-2 * abs(found.approach)
    smallest = 2 * problem.material.compliance / np.hypot(1 / problem.grid.dx, 1 / problem.grid.dy)
    rounding = ROUNDING * largest * np.sqrt(inside.sum() / smallest)
    if met and size > np.finfo(float).tiny:
        assert error <= found.error_bound * size * (1 + 1e-6) + rounding
    if not found.converged:
        return
    assert found.error_bound <= 0.01 or size == 0
    # The conditions, by a product with the matrix. Of flat surfaces the mean pressure gives the scale.
    e = (gap - found.approach) + (dense.matrix @ p.ravel()).reshape(p.shape)
    scale = np.nanmax(abs(gap - found.approach)) or 1.0
    if problem.hardness is not None:
        scale += dense.matrix[0, 0] * found.mean_pressure
    allowed = 100 * rtol * scale * np.sqrt(inside.sum()) + ROUNDING * largest
    plastic = inside & (p == hardness)
    np.testing.assert_array_equal(found.plastic if found.plastic is not None else False, plastic)
    assert (e[found.contact] <= allowed).all() and found.contact[plastic].all()
    assert (e[inside & ~plastic] >= -allowed).all()
    assert (p[~found.contact] == 0).all()


@some
@given(problems(periodic=False))
def test_default_method_on_free_patches(case):
    assert_right_or_says_not(*case)


@some
@given(problems(periodic=True))
def test_default_method_on_periodic_patches(case):
    assert_right_or_says_not(*case)


@some
@given(
    st.booleans().flatmap(lambda periodic: problems(periodic=periodic)),
    st.sampled_from(["norm", "fmg_v11", "fmg_lift"]),
)
def test_other_methods(case, method):
    assert_right_or_says_not(*case, method)


@st.composite
def extremes(draw, periodic):
    """Cells a trillion times further away than others, plateaus and equal summits; next to no load, nearly full."""
    nx, ny = draw(st.sampled_from([(4, 5), (8, 8), (12, 9), (32, 4), (9, 16), (12, 12)]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    rough, some = rng.random((ny, nx)), rng.random((ny, nx)) < draw(st.sampled_from([0.02, 0.1, 0.3]))
    some.flat[rng.integers(nx * ny)] = True
    far = 10.0 ** draw(st.integers(0, 15))
    gap = {
        "asperities": np.where(some, rough, far * (1 + rough)),
        "wall": np.where(np.arange(nx) < nx // 2, rough, far),
        "plateaus": rng.integers(0, 3, (ny, nx)) * 1.0,
        "summits": np.where(some, 0.0, 0.5 + rough),
        "plateaus of rounding": rng.integers(0, 2, (ny, nx)) + rough / far,
    }[draw(st.sampled_from(["asperities", "wall", "plateaus", "summits", "plateaus of rounding"]))]
    gap = draw(st.sampled_from([1.0, 1e-3])) * (gap - gap.min())
    material = Material.from_contact_modulus(draw(st.sampled_from([1.0, 1e5])))
    symbol = draw(st.sampled_from(["spectral", "love"] if periodic else ["", "", "x", "y"]))
    problem = ContactProblem(Grid(nx, ny, 1.0, draw(st.sampled_from([1.0, 2.5]))), material, gap, symbol)
    # Single precision refuses the pressures of approaches below 1e-25 mm
    mean, near = gap.mean(), max(np.quantile(gap, draw(st.sampled_from([0.05, 0.3, 0.7]))), 1e-6)
    share = draw(st.sampled_from([1e-16, 1e-13, 1e-9, 1e-6, 1e-3, 0.1, 0.5]))
    kinds = ["load", "load", "approach", *["mean_gap"] * bool(periodic)]
    loading = {
        "load": draw(st.sampled_from([1, 30, 1e3])) * share * material.contact_modulus * max(near, 1e-3),
        "approach": draw(st.sampled_from([share, 1 - share])) * (mean if periodic else near),
        "mean_gap": draw(st.sampled_from([share, 1 - share])) * mean,
    }
    kind = draw(st.sampled_from(kinds))
    return problem, {kind: loading[kind]}, draw(st.sampled_from([1e-3, 1e-6, 1e-9, 1e-12, 1e-14]))


def assert_proved(case, method=None):
    """What is called solved has no larger error than is proved, and what is not has the load."""
    problem, loading, rtol = case
    found = solved(problem, method, options={"lcp_rtol": rtol}, **loading)
    if "load" in loading:
        assert found.load == pytest.approx(loading["load"], rel=1e-9, abs=0)
    dense = DenseProblem(problem)
    exact = exact_pressure(dense, loading, found)
    size, error = dense.energy(found.pressure), dense.energy(exact - found.pressure)
    if found.converged and size:
        assert error <= found.error_bound * size
    return found


@some
@given(extremes(periodic=False))
def test_far_cells_and_light_loads_on_free_patches(case):
    assert assert_proved(case).converged


@some
@given(extremes(periodic=True))
def test_far_cells_and_light_loads_on_periodic_patches(case):
    assert assert_proved(case).converged


@some
@given(
    st.booleans().flatmap(lambda periodic: extremes(periodic=periodic)), st.sampled_from(["norm", "fmg_v11"])
)
def test_far_cells_and_light_loads_by_other_methods(case, method):
    assert_proved(case, method)


def test_contact_impossible_everywhere_is_refused():
    for periodic in (False, True):
        problem = ContactProblem(
            Grid(3, 2, 1.0, 1.0), Material.combined(1.0, 0.0), np.full((2, 3), np.nan), periodic=periodic
        )
        with pytest.raises(InputError, match="impossible in all cells"):
            solved(problem, load=1.0)
