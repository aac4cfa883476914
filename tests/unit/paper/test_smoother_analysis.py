"""Jacobi and Gauss-Seidel on the line contact of Sec. 4.4."""

import numpy as np
import pytest

from app.paper.smoother_analysis import (
    PAPER_MODES,
    SMOOTH_MODES,
    LineContact,
    compare_grids,
    gauss_seidel,
    jacobi,
    modes,
    paper_mode_index,
    sweep_history,
)


@pytest.fixture(scope="module")
def matrix():
    return LineContact().matrix()


def paper_order(coefficients):
    """Moduli of the coefficients in the paper's numbering, entry 0 being mode 1."""
    n = coefficients.shape[-1]
    return np.abs(coefficients)[..., [paper_mode_index(j, n) for j in range(1, n + 1)]]


def parabola(contact):
    """Undeformed distance h per unit of the maximum pressure that gives `contact.pressure` on a long strip.

    K.L. Johnson, Contact Mechanics, Sec. 4.2(c), the displacement counted from infinity, not from a depth.
    """
    a, x = contact.half_width, contact.grid.x()
    approach = np.log(4 * contact.half_length / a) + 0.5
    return a / contact.material.contact_modulus * ((x / a) ** 2 - approach)


def test_semi_ellipse_solves_the_cylinder_contact_to_first_order():
    errors = []
    for n in (16, 32, 64):
        contact = LineContact(n)
        p = np.linalg.solve(contact.matrix(), -parabola(contact))
        errors.append(np.sqrt(np.mean((p - contact.pressure()) ** 2)))
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    assert errors[0] < 0.02
    np.testing.assert_allclose(rates, 1, atol=0.05)


@pytest.mark.parametrize("omega", [0.8, 1.0, 1.1])
@pytest.mark.parametrize("name", ["jacobi", "gauss_seidel"])
def test_iteration_matrix_is_what_a_sweep_does(matrix, name, omega):
    n = len(matrix)
    rng = np.random.default_rng(0)
    p, exact = rng.normal(size=(2, n))
    b = matrix @ exact
    new = p.copy()
    for i in range(n):
        known = new if name == "gauss_seidel" else p
        new[i] = p[i] + omega * (b[i] - matrix[i] @ known) / matrix[i, i]
    iteration = {"jacobi": jacobi, "gauss_seidel": gauss_seidel}[name](matrix, omega)
    np.testing.assert_allclose(exact - new, iteration @ (exact - p), rtol=0, atol=1e-10)


@pytest.mark.parametrize("omega", [0.1, 1.0])
def test_jacobi_eigenvalues(matrix, omega):
    values = modes(jacobi(matrix, omega)).values
    assert np.abs(values.imag).max() < 1e-12
    assert values.sum() == pytest.approx(len(matrix) * (1 - omega), abs=1e-10)  # trace
    expected = np.sort(1 - omega * np.linalg.eigvalsh(matrix) / matrix[0, 0])
    np.testing.assert_allclose(np.sort(values.real), expected, rtol=0, atol=1e-12)


def test_jacobi_has_one_eigenvalue_far_outside_the_unit_disk_and_most_near_0_9(matrix):
    values = modes(jacobi(matrix)).values.real
    assert values[0] == pytest.approx(-19.8, abs=0.05)
    assert np.abs(values[1:]).max() < 1.5
    assert np.median(values) > 0.8
    assert np.count_nonzero(np.abs(values - 0.85) < 0.06) > len(values) / 2
    # Enough damping to make it converge leaves the others all but untouched.
    damped = modes(jacobi(matrix, 2 / (1 - values[0]) * 0.99)).values
    assert np.count_nonzero(np.abs(damped) > 0.98) > len(values) / 2


def test_modes_are_eigenvectors_in_order(matrix):
    iteration = gauss_seidel(matrix)
    result = modes(iteration)
    np.testing.assert_allclose(iteration @ result.vectors, result.vectors * result.values, rtol=0, atol=1e-11)
    np.testing.assert_allclose(np.mean(np.abs(result.vectors) ** 2, axis=0), 1, rtol=1e-12)
    assert (np.diff(np.abs(result.values)) <= 0).all()
    assert abs(result.values[-1]) < 1e-14  # undamped Gauss-Seidel forgets the first unknown
    first, second = result.values[:30:2], result.values[1:30:2]
    np.testing.assert_array_equal(first, second.conj())
    assert (first.imag > 0).all()


def test_sweep_history_is_gauss_seidel_from_zero(matrix):
    p = LineContact().pressure()
    b = matrix @ p
    iterate = np.zeros_like(p)
    errors = [p]
    for _ in range(20):
        iterate += np.linalg.solve(np.tril(matrix), b - matrix @ iterate)
        errors.append(p - iterate)
    history = sweep_history(gauss_seidel(matrix), p)
    np.testing.assert_allclose(history.errors, [errors[i] for i in (0, 10, 20)], rtol=0, atol=1e-12)


def test_coefficients_rebuild_the_error_and_shrink_by_their_eigenvalues(matrix):
    iteration = gauss_seidel(matrix)
    history = sweep_history(iteration, LineContact().pressure())
    basis = modes(iteration)
    np.testing.assert_allclose(history.coefficients @ basis.vectors.T, history.errors, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        history.coefficients[2], history.coefficients[0] * basis.values**20, rtol=0, atol=1e-11
    )


def test_after_20_sweeps_modes_2_to_9_remain(matrix):
    history = sweep_history(gauss_seidel(matrix), LineContact().pressure())
    start, _, end = paper_order(history.coefficients)
    others = np.r_[0, 9:32]
    assert end[1:9].min() > end[others].max()
    assert end[others].max() < 0.2 * end.max()
    assert end[others].max() < 0.01 * start[others].max()
    assert start[1:9].max() < start[others].max()  # they did not stand out before


def bumpiness(errors):
    return np.linalg.norm(np.diff(errors, axis=1), axis=1) / np.linalg.norm(errors, axis=1)


def test_gauss_seidel_smooths_the_error_and_jacobi_does_not_reduce_it(matrix):
    rough = np.random.default_rng(5).normal(size=len(matrix))
    for solution in (rough, LineContact().pressure()):
        ten, twenty = bumpiness(sweep_history(gauss_seidel(matrix), solution, (10, 20)).errors)
        assert twenty < 0.7 * ten
    assert bumpiness(rough[None]) > 1.2
    assert bumpiness(sweep_history(gauss_seidel(matrix), rough, (20,)).errors) < 0.6
    assert np.abs(sweep_history(jacobi(matrix), rough, (20,)).errors).max() > 1e20


def test_smooth_modes_live_on_the_coarse_grid_and_decay_faster_there():
    pairs = compare_grids()
    assert [pair.number for pair in pairs] == list(PAPER_MODES)
    for pair in pairs[:4]:
        averaged = pair.vector.reshape(16, 2).mean(axis=1)
        overlap = np.vdot(pair.coarse_vector, averaged)
        assert overlap.imag == pytest.approx(0, abs=1e-10)
        lengths = np.linalg.norm(pair.coarse_vector) * np.linalg.norm(averaged)
        assert 0.98 < overlap.real / lengths <= 1
        assert abs(pair.coarse_value) < abs(pair.value) - 0.03
    assert all(pair.coarse_vector is None for pair in pairs if pair.number not in SMOOTH_MODES)


def test_averaging_keeps_smooth_modes_and_loses_rough_ones():
    kept = {
        pair.number: np.sqrt(np.mean(np.abs(pair.vector.reshape(-1, 2).mean(axis=1)) ** 2))
        for pair in compare_grids()
    }
    assert min(kept[j] for j in SMOOTH_MODES) > 0.85
    assert kept[18] < 0.65
    assert kept[32] < 0.1
