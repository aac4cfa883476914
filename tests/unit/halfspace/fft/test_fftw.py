"""FFTW plans: transforms by address, and back."""

import ctypes

import numpy as np
import pytest

from app.halfspace.fft.fftw import FFTW


@pytest.mark.parametrize("dtype", [np.complex64, np.complex128, np.float32, np.float64])
def test_plans_transform_rows_and_back(dtype):
    rng, length = np.random.default_rng(1), 210
    cells, real = np.zeros((3, length), dtype), np.issubdtype(dtype, np.floating)
    spectrum = np.zeros((3, length // 2 + 1 if real else length), np.result_type(dtype, np.complex64))
    library = FFTW(np.dtype(cells.real.dtype))
    forward, backward = library.plans(cells, spectrum, length)
    execute = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(library.execute)
    cells[...] = before = rng.standard_normal(cells.shape)
    execute(forward)
    tolerance = 200 * np.finfo(dtype).eps
    expected = (np.fft.rfft if real else np.fft.fft)(before)
    np.testing.assert_allclose(spectrum, expected, rtol=0, atol=tolerance * length**0.5)
    execute(backward)
    np.testing.assert_allclose(cells, length * before, rtol=0, atol=tolerance * length)
