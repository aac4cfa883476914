"""FFTW's plans, and what one process leaves to the next."""

import numpy as np
import pytest
from mpi4py_fft import fftw as mpi4py_fft

from app.halfspace.fft import fftw


@pytest.fixture
def process(tmp_path):
    """A function that begins anew, as a process would, with what is kept in `tmp_path`."""

    def begin(folder=tmp_path):
        library = fftw._Library(mpi4py_fft.fftwf_xfftn, "fftwf", None)
        library.call("forget_wisdom")
        return fftw._Library(mpi4py_fft.fftwf_xfftn, "fftwf", folder)

    return begin


def transformed(library, length):
    """Some sequences and their transforms, planned by a library."""
    plans = fftw.FFTW(np.dtype("float32"))
    plans._library = library
    cells = np.zeros((3, length), np.complex64)
    forward, _ = plans.plans(cells, cells, length)
    cells[...] = np.random.default_rng(length).standard_normal(cells.shape)
    before = cells.copy()
    library.call("execute", fftw.ctypes.c_void_p(forward))
    return before, cells


def test_what_is_known_need_not_be_learned_and_gives_the_same_digits(process):
    first = process()
    before, there = transformed(first, 210)
    np.testing.assert_allclose(there, np.fft.fft(before), atol=1e-4)
    assert first.learned
    first.save_wisdom()
    second = process()
    assert np.array_equal(transformed(second, 210)[1], there)
    assert not second.learned


def test_processes_add_to_what_others_know(process):
    one, other = process(), process()
    transformed(one, 210)
    one.save_wisdom()
    other.call("forget_wisdom")
    transformed(other, 330)
    other.save_wisdom()
    third = process()
    transformed(third, 210)
    transformed(third, 330)
    assert not third.learned


@pytest.mark.parametrize("text", ["", "nonsense", "(fftw-3.3.10 fftwf_wisdom #x1 #x2 #x3 #x4\n)", None])
def test_what_cannot_be_used_is_learned_anew(process, tmp_path, text):
    first = process()
    transformed(first, 210)
    first.save_wisdom()
    file = tmp_path / "fftwf.wisdom"
    file.write_text(file.read_text()[:200] if text is None else text)
    second = process()
    before, there = transformed(second, 210)
    np.testing.assert_allclose(there, np.fft.fft(before), atol=1e-4)
    assert second.learned
    second.save_wisdom()
    third = process()
    transformed(third, 210)
    assert not third.learned


def test_too_much_is_forgotten(process, tmp_path, monkeypatch):
    first = process()
    transformed(first, 210)
    first.save_wisdom()
    monkeypatch.setattr(fftw, "_MAX_WISDOM", 10)
    second = process()
    transformed(second, 330)
    second.save_wisdom()
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_not_there_is_not_made(process, tmp_path):
    library = process(tmp_path / "none")
    transformed(library, 210)
    library.save_wisdom()
    assert list(tmp_path.iterdir()) == []
