"""Where PETSc is found, and differences between its releases."""

import sys
import weakref
from contextlib import suppress

import numpy as np
import pytest
from cases import APPROACH, punch
from mpi4py import MPI
from petsc4py import PETSc

from app import ContactProblem, Grid, InputError, Material, solve
from app.base.petsc import _MAT_INFO_BYTES, _forget_last_exception, calling_petsc, report_no_entries
from app.options import solver_options
from app.options.solver_options import is_used


@pytest.mark.parametrize("error", [KeyboardInterrupt(), InputError("as it was")])
def test_exceptions_of_callbacks_are_unwrapped(error):
    error.__cause__ = reason = LookupError()
    with pytest.raises(type(error)) as caught, calling_petsc():
        try:
            try:
                raise error
            except BaseException as cause:
                raise PETSc.Error(101) from cause  # as newer releases do, once for each call that is left
        except PETSc.Error as inner:
            raise PETSc.Error(101) from inner
    assert caught.value is error and error.__cause__ is reason


def test_frames_of_an_unwrapped_exception_are_freed_when_it_is_handled():
    frames = []

    def interrupted():
        field = np.zeros(1)
        frames.append(weakref.ref(field))
        with calling_petsc():
            try:
                raise KeyboardInterrupt
            except KeyboardInterrupt as cause:
                raise PETSc.Error(101) from cause

    with suppress(KeyboardInterrupt):
        interrupted()
    assert frames[0]() is None  # without Python's collector of cycles


def test_errors_of_petsc_are_unchanged():
    with pytest.raises(PETSc.Error), calling_petsc():
        raise PETSc.Error(73)


@pytest.mark.skipif(PETSc.IntType().itemsize > 4, reason="integers of 64 bits number every grid")
def test_a_grid_with_more_cells_than_petsc_can_number_is_refused():
    grid = Grid.from_domain(46341, 46341, (0, 1, 0, 1))
    with pytest.raises(InputError, match="64-bit integers"):
        solve(ContactProblem(grid, Material.from_contact_modulus(1e5), lambda x, y: x * y), approach=1.0)


def test_an_uncaught_exception_with_circular_causes_is_freed(monkeypatch):
    original = ZeroDivisionError()
    original.__context__ = PETSc.Error(101)
    original.__context__.__cause__ = original
    monkeypatch.setattr(sys, "last_value", original, raising=False)
    _forget_last_exception()


def test_communicators_of_petsc4py_and_mpi4py_are_alike():
    solutions = [solve(punch(24), approach=APPROACH, comm=package.COMM_SELF) for package in (PETSc, MPI)]
    np.testing.assert_array_equal(*(solution.pressure for solution in solutions))


def test_info_of_a_mat_has_the_numbers_that_are_set_to_zero():
    """PETSc does not say how large its MatInfo is; petsc4py reads all of it."""
    dense = PETSc.Mat().createDense((1, 1), comm=PETSc.COMM_SELF)
    dense.setUp()
    dense.assemble()
    assert 8 * len(dense.getInfo()) == _MAT_INFO_BYTES
    report_no_entries(operator := PETSc.Mat().createPython((1, 1), object(), comm=PETSc.COMM_SELF))
    assert set(operator.getInfo().values()) == {0.0}
    for mat in (dense, operator):
        mat.destroy()


def test_use_of_an_option_is_one_truth_value():
    PETSc.Options().setValue("app_test_option", "1")
    assert is_used("app_test_option") is False
    PETSc.Options().getInt("app_test_option")
    assert is_used("app_test_option") is True
    PETSc.Options().delValue("app_test_option")


def test_a_release_that_says_which_options_are_used_is_asked(monkeypatch):
    """A PetscBool has one byte from 3.24 on; petsc4py knows it."""

    class Options:
        def used(self, name):
            return name == "asked"

    monkeypatch.setattr(solver_options.PETSc, "Options", Options, raising=False)
    assert is_used("asked") and not is_used("other")
