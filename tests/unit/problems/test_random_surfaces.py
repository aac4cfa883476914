"""Random rough surfaces: waves, spectra, the same surface on every grid."""

import numpy as np
import pytest
import scipy.fft

from app import Grid, InputError, SelfAffineSurface
from app.problems.random_surfaces import WavySurface
from app.problems.statistics import normal_plot, radial_spectrum, roughness

DOMAIN = (-6.0, 6.0, -5.0, 5.0)


def wavy(**changes):
    """Return the paper's surface, Fig. 12(b), with changes."""
    data = {"modes": (12, 10), "decay": 0.8, "sigma": 0.1, "seed": 7, "extent": (12.0, 10.0)}
    return WavySurface(**{**data, "origin": (-6.0, -5.0), **changes})


def self_affine(**changes):
    data = {"hurst": 0.8, "rolloff_wavelength": 4.0, "shortest_wavelength": 0.5, "period": (12.0, 10.0)}
    return SelfAffineSurface(**{**data, "seed": 3, "rms_height": 0.1, "origin": (-6.0, -5.0), **changes})


def sampled(surface, nx, ny, domain=DOMAIN):
    grid = Grid.from_domain(nx, ny, domain)
    return surface.height(grid.x(), grid.y())


def every_wave(surface, x, y):
    """Sum the waves of a self-affine surface one by one."""
    total = 0
    for kx in surface.wave_numbers[0]:
        for ky in surface.wave_numbers[1]:
            c = surface.coefficients[ky + surface.wave_numbers[1][-1], kx]
            phase_x = kx * (x - surface.origin[0]) / surface.period[0]
            phase_y = ky * (y - surface.origin[1]) / surface.period[1]
            total = total + (c * np.exp(2j * np.pi * (phase_x + phase_y[:, None]))).real
    return total


@pytest.mark.parametrize("decay", [0.5, 0.8, 0.95, 1.0])
@pytest.mark.parametrize("modes", [(1, 1), (12, 10), (3, 17)])
def test_wavy_sigma_is_exact_for_any_modes_and_decay(modes, decay):
    surface = wavy(modes=modes, decay=decay)
    assert surface.rms_height == pytest.approx(0.1, rel=1e-14)
    # Distinct waves are orthogonal on a grid that resolves them, so the sampled value is exact, too.
    height = sampled(surface, 40, 48)
    assert height.std() == pytest.approx(0.1, rel=1e-12)
    assert height.mean() == pytest.approx(0, abs=1e-14)


def test_wavy_height_is_the_double_sum_of_6_1():
    surface = wavy()
    rng = np.random.default_rng(1)
    x, y = rng.uniform(-6, 6, 7), rng.uniform(-5, 5, 5)
    a, phi, theta = surface.coefficients
    expected = sum(
        a[m - 1, n - 1]
        * np.cos(2 * np.pi * m * (x + 6) / 12 + phi[m - 1, n - 1])
        * np.cos(2 * np.pi * n * (y[:, None] + 5) / 10 + theta[m - 1, n - 1])
        for m in range(1, 13)
        for n in range(1, 11)
    )
    np.testing.assert_allclose(surface.height(x, y), expected, rtol=0, atol=1e-14)


def test_wavy_random_numbers_come_as_amplitudes_then_phases():
    surface = wavy()
    rng = np.random.default_rng(7)
    a = rng.random((12, 10))
    phi = rng.uniform(0, 2 * np.pi, (12, 10))
    theta = rng.uniform(0, 2 * np.pi, (12, 10))
    a *= 0.8 ** np.add.outer(np.arange(12), np.arange(10))
    np.testing.assert_allclose(
        surface.coefficients[0] / surface.coefficients[0][0, 0], a / a[0, 0], rtol=1e-14
    )
    np.testing.assert_array_equal(surface.coefficients[1:], (phi, theta))


@pytest.mark.parametrize("rows", [slice(0, 1), slice(3, 4), slice(7, 60), slice(63, 64), slice(5, 5)])
@pytest.mark.parametrize("columns", [slice(None), slice(2, 3), slice(11, 50)])
def test_wavy_values_do_not_depend_on_their_block(rows, columns):
    grid = Grid.from_domain(70, 64, DOMAIN)
    whole = wavy().height(grid.x(), grid.y())
    part = wavy().height(grid.x()[columns], grid.y(rows))
    np.testing.assert_array_equal(part, whole[rows, columns])


@pytest.mark.parametrize("surface", [wavy(), self_affine()], ids=["wavy", "self-affine"])
def test_rms_slope_is_the_limit_of_differences(surface):
    errors = []
    for n in (128, 256):
        grid = Grid.from_domain(n, n, DOMAIN)
        errors.append(roughness(sampled(surface, n, n), grid.dx, grid.dy).rms_slope / surface.rms_slope - 1)
    assert abs(errors[0]) < 0.03
    assert abs(errors[1]) < 0.5 * abs(errors[0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"modes": (0, 10)}, "modes"),
        ({"decay": 0.0}, "decay 0: must be above 0 and at most 1"),
        ({"sigma": -0.1}, "sigma"),
        ({"seed": -1}, "seed"),
        ({"extent": (12.0, 0.0)}, "extent"),
        ({"origin": (np.nan, 0.0)}, "origin"),
        ({"modes": (10**7, 10**7)}, "10000000 x 10000000 modes: needs .* of memory"),
    ],
)
def test_wrong_parameters_of_wavy_surfaces_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        wavy(**changes)


def test_self_affine_rms_height_is_exact_over_the_period():
    surface = self_affine()
    height = sampled(surface, 64, 50)  # more than two cells per wave
    assert surface.rms_height == pytest.approx(0.1, rel=1e-14)
    assert height.std() == pytest.approx(0.1, rel=1e-12)
    assert height.mean() == pytest.approx(0, abs=1e-14)


def test_self_affine_rms_slope_is_exact_over_the_period():
    surface = self_affine(rms_height=None, rms_slope=0.2)
    height = sampled(surface, 64, 50)
    qx, qy = 2 * np.pi * scipy.fft.fftfreq(64, 12 / 64), 2 * np.pi * scipy.fft.fftfreq(50, 10 / 50)
    q_squared = qx**2 + qy[:, None] ** 2
    slope = np.sqrt(np.sum(np.abs(scipy.fft.fft2(height)) ** 2 * q_squared)) / height.size
    assert slope == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize("shape", [(64, 50), (17, 11), (4, 4)])  # resolved, aliased, aliased many times
def test_self_affine_fft_samples_the_sum_of_waves(shape):
    surface = self_affine()
    grid = Grid.from_domain(*shape, DOMAIN)
    expected = every_wave(surface, grid.x(), grid.y())
    np.testing.assert_allclose(surface.height(grid.x(), grid.y()), expected, rtol=0, atol=1e-13)


def test_self_affine_fft_and_matrix_products_agree():
    surface = self_affine(shortest_wavelength=0.1)
    grid = Grid.from_domain(48, 40, (-6.0, 2.0, -5.0, 3.0))  # 72 x 50 cells per period: FFT
    x, y = grid.x(), grid.y()
    by_fft = surface.height(x, y)
    irregular_x, irregular_y = np.append(x, 2.345), np.append(y, 3.456)
    np.testing.assert_allclose(surface.height(irregular_x, irregular_y)[:-1, :-1], by_fft, rtol=0, atol=1e-12)
    np.testing.assert_allclose(surface.height(irregular_x, y)[:, :-1], by_fft, rtol=0, atol=1e-12)
    np.testing.assert_allclose(surface.height(x[4:5], y[7:8]), by_fft[7:8, 4:5], rtol=0, atol=1e-12)


@pytest.mark.parametrize("period", [(12.0, 10.0), (12.0, 3.0)])
def test_shorter_cut_off_keeps_the_long_waves(period):
    coarse = self_affine(period=period)
    fine = self_affine(period=period, shortest_wavelength=0.25)
    kx, ky = (k[-1] for k in coarse.wave_numbers)
    middle = fine.wave_numbers[1][-1]
    waves = coarse.coefficients != 0
    common = fine.coefficients[middle - ky : middle + ky + 1, : kx + 1][waves]
    factor = fine.rms_height / coarse.rms_height * common / coarse.coefficients[waves]
    np.testing.assert_allclose(factor, factor[0], rtol=1e-12)
    assert 0 < factor[0].real < 1  # the short waves take their share of the rms height
    assert abs(factor[0].imag) < 1e-14


@pytest.mark.parametrize("hurst", [0.3, 0.8, 1.0])
def test_self_affine_spectrum_has_slope_minus_2_minus_2h_and_a_plateau(hurst):
    n, length, rolloff, shortest = 256, 10.0, 1.0, 0.1
    surface = SelfAffineSurface(hurst, rolloff, shortest, (length, length), 5, rms_height=0.1)
    height = sampled(surface, n, n, (0, length, 0, length))
    spectrum = radial_spectrum(height, length / n, length / n)
    q = spectrum.wave_number
    tail = (q > 1.2 * 2 * np.pi / rolloff) & (q < 0.98 * 2 * np.pi / shortest)
    plateau = q < 0.9 * 2 * np.pi / rolloff
    slope = np.polyfit(np.log(q[tail]), np.log(spectrum.density[tail]), 1)[0]
    assert slope == pytest.approx(-2 - 2 * hurst, abs=0.02)
    np.testing.assert_allclose(spectrum.density[plateau], spectrum.density[0], rtol=1e-10)
    beyond = q > 1.02 * 2 * np.pi / shortest
    assert beyond.any()
    assert spectrum.density[beyond].max() < 1e-20 * spectrum.density[0]


def test_self_affine_heights_are_gaussian():
    surface = SelfAffineSurface(0.8, 0.5, 0.1, (10.0, 10.0), 11, rms_height=0.1)
    height = sampled(surface, 256, 256, (0, 10, 0, 10))
    moments = roughness(height, 10 / 256, 10 / 256)
    assert normal_plot(height).correlation > 0.999
    assert moments.kurtosis == pytest.approx(3, abs=0.2)
    assert moments.skewness == pytest.approx(0, abs=0.2)


def test_self_affine_is_isotropic():
    surface = SelfAffineSurface(0.8, 1.0, 0.2, (10.0, 8.0), 11, rms_height=0.1)
    moments = roughness(sampled(surface, 400, 320, (0, 10, 0, 8)), 0.025, 0.025)
    assert moments.rms_slope_x == pytest.approx(moments.rms_slope_y, rel=0.01)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"hurst": 0.0}, "Hurst exponent 0: must be above 0 and at most 1"),
        ({"shortest_wavelength": 5.0}, "in this order"),
        ({"shortest_wavelength": 0.0}, "positive"),
        ({"period": (12.0, -1.0)}, "period"),
        ({"rms_slope": 0.1}, "either"),
        ({"rms_height": -1.0}, "rms value"),
        ({"seed": -1}, "seed"),
        ({"rolloff_wavelength": 40.0, "shortest_wavelength": 30.0}, "no wave"),
        ({"shortest_wavelength": 1e-9}, "down to 1e-09 mm: needs .* of memory"),
    ],
)
def test_wrong_parameters_of_self_affine_surfaces_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        self_affine(**changes)


def test_self_affine_points_beyond_the_period_are_refused():
    x = np.linspace(-6, 6, 13)
    with pytest.raises(ValueError, match="span 12 in x, not less than its period 12"):
        self_affine().height(x, x[:3])
    # Whatever rows a rank will ask for.
    with pytest.raises(ValueError, match="span 14.75 in y, not less than its period 10"):
        self_affine().check_grid(Grid(40, 60, 0.25, 0.25))


ROUGH = SelfAffineSurface(0.8, 1, 1, (3, 3), 1, rms_height=1e-4)


@pytest.mark.parametrize(
    ("message", "wrong"),
    [
        ("period 1: need two", lambda: SelfAffineSurface(0.8, 1, 1, 1, 1, rms_height=1e-4)),
        ("origin 1: need two", lambda: SelfAffineSurface(0.8, 1, 1, (3, 3), 1, rms_height=1e-4, origin=1)),
        ("exponent 'a': must be a number", lambda: SelfAffineSurface("a", 1, 1, (3, 3), 1, rms_slope=0.1)),
        ("value '1': must be a number", lambda: SelfAffineSurface(0.8, 1, 1, (3, 3), 1, rms_slope="1")),
        (r"shapes \(2, 2\) and \(2, 2\); .* \(nx,\)", lambda: ROUGH.height(*np.ones((2, 2, 2)))),
        (r"shapes \(\) and \(1,\)", lambda: WavySurface((2, 2), 0.8, 0.1, 7, (12, 10)).height(0, [1])),
        ("x: must be columns of a lattice", lambda: ROUGH.height(["a"], [0.1])),
    ],
)
def test_wrong_types_of_surface_parameters_are_refused(message, wrong):
    with pytest.raises(InputError, match=message) as refused:
        wrong()
    assert "\n" not in str(refused.value)
