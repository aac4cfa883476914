"""The user's locale: programs with windows set it, as by ``%matplotlib qt``, and PETSc reads numbers by it."""

import locale
import os
import subprocess
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from cases import hertz
from petsc4py import PETSc

from app import ContactSolver, Listener, read_surface, solve
from app.base.petsc import calling_petsc
from app.halfspace.operator import InfluenceOperator

GERMAN, TURKISH, LATIN = "de_DE.UTF-8", "tr_TR.UTF-8", "de_DE.ISO-8859-1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of locales, made here because few systems have them."""
    folder = tmp_path_factory.mktemp("locales")
    for name in (GERMAN, TURKISH, LATIN):
        language, charmap = name.split(".")
        try:
            subprocess.run(
                ["localedef", "--no-archive", "-i", language, "-f", charmap, folder / name],
                check=True, capture_output=True,
            )  # fmt: skip
        except (OSError, subprocess.CalledProcessError):
            pytest.skip("no sources of locales; Debian's package locales has them")
    return folder


@pytest.fixture
def speak(folder, monkeypatch):
    """Set the locale of the process, as the user's program does, until the end of the test."""
    monkeypatch.setenv("LOCPATH", os.fspath(folder))
    before = locale.setlocale(locale.LC_ALL)
    yield lambda name: locale.setlocale(locale.LC_ALL, name)
    locale.setlocale(locale.LC_ALL, before)


class Hears(Listener):
    """Asks for the decimal point, as a program that prints a table would."""

    def __init__(self):
        self.points = set()

    def iteration(self, entry, state):
        """Ask."""
        self.points.add(locale.localeconv()["decimal_point"])


@pytest.mark.parametrize("name", [GERMAN, TURKISH, LATIN])
@pytest.mark.parametrize("method", [None, "fmg_v11", "norm"])
def test_a_solution_does_not_depend_on_the_locale(speak, name, method):
    expected = solve(hertz(32), load=1e5, method=method).pressure
    speak(name)
    listener = Hears()
    with ContactSolver(hertz(32), method, listeners=[listener]) as solver:
        np.testing.assert_array_equal(solver.solve(load=1e5).pressure, expected)
    assert listener.points == {","} == {locale.localeconv()["decimal_point"]}  # the program keeps its locale


@pytest.mark.parametrize("when", ["before", "after"])
def test_the_locale_may_change_between_set_up_and_solve(speak, when):
    options = {"ksp_type": "cg", "pc_type": "mg", "mg_levels_pc_sor_omega": 0.7, "ksp_rtol": 0.03}
    if when == "before":
        speak(GERMAN)
    with ContactSolver(hertz(32), options=options) as solver:
        speak(GERMAN if when == "after" else "C")
        numbers = [solver.solve(load=load).inner_iterations for load in (1e4, 1e5)]
    speak("C")
    with ContactSolver(hertz(32), options=options) as solver:
        assert numbers == [solver.solve(load=load).inner_iterations for load in (1e4, 1e5)]


def test_a_thread_solves_in_any_locale(speak):
    speak(GERMAN)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(solve, hertz(16), load=1e5).result().converged


def test_multigrid_reads_its_options_in_any_locale_of_a_program_of_the_users(speak):
    speak(TURKISH)
    problem = hertz(32)
    operator = InfluenceOperator(problem.grid, problem.kernel)
    operator.mask[8:24, 8:24] = True
    operator.mask_changed()
    mat = operator.mat(PETSc.COMM_SELF)
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setOperators(mat)
    ksp.setType("gmres")
    ksp.getPC().setType("python")
    ksp.getPC().setPythonType("app.multigrid.ContactMG")
    x, b = mat.createVecs()
    b.setArray(operator.mask.reshape(-1).astype(float))
    ksp.solve(b, x)
    assert ksp.getConvergedReason() > 0
    for part in (ksp, mat, x, b):
        part.destroy()


def test_a_block_of_petsc_leaves_the_locale_of_other_threads_alone(speak):
    speak(GERMAN)
    with ThreadPoolExecutor(1) as pool, calling_petsc():
        assert locale.localeconv()["decimal_point"] == "."
        assert pool.submit(locale.localeconv).result()["decimal_point"] == ","
    assert locale.localeconv()["decimal_point"] == ","


@pytest.mark.parametrize("name", [GERMAN, LATIN])
def test_texts_are_read_and_written_alike_in_any_locale(speak, name, tmp_path):
    heights = np.random.default_rng(0).normal(size=(8, 8))
    np.savetxt(tmp_path / "höhe.txt", heights, header="µm", encoding="utf-8")
    solution = solve(hertz(16), load=1e5)

    def texts():
        surface = read_surface(tmp_path / "höhe.txt", unit="um", spacing=(1.0, 1.0))
        return surface.heights().tobytes(), solution.summary()

    expected = texts()
    speak(name)
    assert texts() == expected
