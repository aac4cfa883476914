"""Options of solvers in PETSc's database, each under a prefix of its own."""

import re

import pytest
from cases import hertz
from mpi4py import MPI
from petsc4py import PETSc

from app import ContactSolver
from app.base.errors import InputError
from app.options.solver_options import SolverOptions, read_option_file, temporary_options

PROBLEM = hertz(16)


@pytest.fixture
def database():
    """PETSc's database, which a test leaves as it was."""
    options = PETSc.Options()
    before = options.getAll()
    yield options
    for name in options.getAll().keys() - before.keys():
        options.delValue(name)


def test_temporary_options_leave_the_database_as_it_was(database):
    database.setValue("x_given", "1")
    database.setValue("x_in_the_way", "2 3")
    before = database.getAll()
    with temporary_options("x_", {"given": "3", "wanted": "4"}, {"in_the_way": "5"}):
        assert PETSc.Options("x_").getAll() == {"given": "1", "wanted": "4", "in_the_way": "5"}
    assert database.getAll() == before and database.getString("x_in_the_way") == "2 3"


def test_options_of_a_solver_are_in_the_database_only_inside_the_block(database):
    database.setValue("x_Ksp_Type", "cg")
    options = SolverOptions("x_", {"ksp_type": "gmres", "ksp_rtol": "0.5", "pc_type": "none"})
    before = database.getAll()
    with pytest.raises(KeyboardInterrupt), options.inserted(), options.inserted():
        found = PETSc.Options("x_")
        assert (found.getString("ksp_type"), found.getReal("ksp_rtol")) == ("cg", 0.5)
        raise KeyboardInterrupt
    assert database.getAll() == before
    with options.inserted():
        assert database.getString("x_pc_type") == "none"
    assert options.unused(MPI.COMM_SELF) == []
    assert database.getAll() == before


def test_options_used_in_no_block_are_unused(database):
    options = SolverOptions(
        "x_", {"a": "", "b": "", "ksp_converged_reason": "", "other": ""}, ignored=["other"]
    )
    for _ in range(2):
        with options.inserted():
            database.getString("x_a")
    assert options.unused(MPI.COMM_SELF) == ["b"]
    assert options.unused(MPI.COMM_SELF, late=True) == ["b", "ksp_converged_reason"]
    options.insert_for_good({})
    assert database.getAll().keys() >= {"x_a", "x_b"}


def test_many_solvers_do_not_fill_the_database_of_petsc():
    """It holds 512 options."""
    solvers = [ContactSolver(PROBLEM, "norm", {"ksp_rtol": 0.1 / (1 + k)}) for k in range(3)]
    many = [SolverOptions(f"x{k}_", {f"name{j}": "1" for j in range(15)}) for k in range(40)]
    for options in many:
        with options.inserted():
            assert PETSc.Options(options.prefix).getInt("name14") == 1
    for k, solver in enumerate(solvers):
        assert solver.solve(approach=0.1).converged
        assert solver.ksp.getTolerances()[0] == pytest.approx(0.1 / (1 + k))
        solver.close()


def test_views_and_monitors_name_their_solver(capfd):
    shown = {"ksp_view": "", "ksp_converged_reason": "", "ksp_monitor": ""}
    with ContactSolver(PROBLEM, "norm", shown) as first, ContactSolver(hertz(24), "mg_v11", shown) as second:
        prefixes = [solver.options.prefix for solver in (first, second)]
        assert all(re.fullmatch(r"contact\d+_", prefix) for prefix in prefixes) and len(set(prefixes)) == 2
        found = [solver.solve(approach=0.1) for solver in (first, second, first)]
    text = capfd.readouterr().out
    for n, prefix in zip((16, 24), prefixes, strict=True):
        assert f"KSP Object: contact {n} x {n} ({prefix}) 1 MPI" in text
        assert f"Mat Object: contact {n} x {n} ({prefix}) 1 MPI" in text
        assert f"Residual norms for {prefix} solve." in text
        assert f"Linear {prefix} solve converged" in text
    assert "Mat Object: contact 12 x 12 " in text  # of a coarser level
    with ContactSolver(PROBLEM, "norm") as alone:
        assert alone.solve(approach=0.1).load == found[0].load == found[2].load


def test_a_prefix_must_be_a_word():
    for prefix in ("1_", "a b", "-a"):
        with pytest.raises(InputError, match=f"^prefix {prefix}: must begin with a letter"):
            ContactSolver(PROBLEM, prefix=prefix)


def test_options_of_the_user_under_the_prefix_override_and_must_be_used(database, capfd):
    database.setValue("mine_ksp_rtol", "0.25")
    database.setValue("mine_lcp_rtol", "1e-7")
    before = database.getAll()
    for prefix in ("mine_", "Mine_"):
        with ContactSolver(PROBLEM, "norm", {"ksp_rtol": 0.5, "lcp_rtol": 1e-3}, prefix=prefix) as solver:
            assert (solver.ksp.getTolerances()[0], solver.settings.rtol) == (0.25, 1e-7)
            solver.solve(approach=0.1)
        assert database.getAll() == before
    database.setValue("mine_ksp_rtoll", "0.25")
    with pytest.raises(
        InputError, match=r"^unknown or unused option: -ksp_rtoll \(did you mean -ksp_rtol\?\)$"
    ):
        ContactSolver(PROBLEM, "norm", prefix="mine_")


def test_without_a_prefix_unused_options_of_other_programs_are_ignored(database):
    database.setValue("ksp_rtol", "0.25")
    database.setValue("ksp_of_another_program", "")
    database.setValue("grid", "8")
    with ContactSolver(PROBLEM, "norm", {"ksp_max_it": 7}, prefix="") as solver:
        assert solver.ksp.getTolerances()[0] == 0.25
        assert solver.solve(approach=0.1).converged
    with pytest.raises(InputError, match="^unknown or unused option: -ksp_max_itt"):
        ContactSolver(PROBLEM, "norm", {"ksp_max_itt": 7}, prefix="")


def test_reading_an_option_file_leaves_the_database_as_it_was(database, tmp_path):
    database.setValue("file_a", "1")
    before = database.getAll()
    for content, found in (
        ("-A 2 # two\n-b\n", {"a": "2", "b": ""}),
        ("-a 1 2\n", None),
        ("-prefix_push x_\n-a\n", None),
    ):
        (tmp_path / "a.opts").write_text(content)
        if found is None:
            with pytest.raises(InputError, match="a.opts"):
                read_option_file(tmp_path / "a.opts")
        else:
            assert read_option_file(tmp_path / "a.opts") == found
        assert database.getAll() == before
