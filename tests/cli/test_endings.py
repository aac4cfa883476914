"""Every refusal and every failure ends every rank: tests look at the exit, within a time limit, on one rank and two."""

import os
import subprocess
import sys

import numpy as np
import pytest
from processes import TESTS, on_two_hosts, run, solve_arguments

from app.io.result import read_result

LIMIT = 60  # seconds; a few are enough on an idle machine
HERTZ = [*solve_arguments("hertz", "norm")[2:], "-grid", "8"]
RANKS = pytest.mark.parametrize("ranks", [None, 2])
GAP = "-problem file -domain 0,1,0,1 -approach 2 -shear_modulus 1 -poisson_ratio 0.3".split()


@pytest.fixture
def solve(tmp_path):
    """``solve("-grid", 8, ranks=2)``: run app.solve in an empty folder, which is also the user's home."""

    def run_there(*arguments, ranks=None, program=("-m", "app.solve"), **environment):
        environment = {"HOME": str(tmp_path), "PYTHONPATH": str(TESTS), **environment}
        return run(*program, *arguments, ranks=ranks, timeout=LIMIT, env=environment, cwd=tmp_path)

    return run_there


def assert_ended(done, message, status=2):
    """One line from one rank, the right status, nothing computed."""
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert done.returncode == status, done.stderr
    assert len(errors) == 1, done.stderr
    assert message in errors[0]
    assert "Traceback" not in done.stderr
    assert "PETSC ERROR" not in done.stderr
    assert "Segmentation" not in done.stderr
    assert done.stdout == ""


@RANKS
def test_option_file_including_itself_is_refused(solve, tmp_path, ranks):
    (tmp_path / "a.opts").write_text("-grid 8\n-options_file a.opts\n")
    assert_ended(solve(*HERTZ, "-options_file", "a.opts", ranks=ranks), "a.opts: includes itself")


@pytest.mark.parametrize(
    ("ranks", "words", "message"),
    [
        (None, "-lcp_max_it 0", "-lcp_max_it 0: must be"),
        (2, "-lcp_rtoll 1e-3", "unknown option: -lcp_rtoll (did you mean -lcp_rtol?)"),
        (None, "-options_file nowhere.opts", "PETSc does not start: Unable to open"),
        (None, "-malloc_debug maybe", "PETSc does not start: Invalid argument: Unknown logical value: maybe"),
    ],
)
def test_nonsense_in_petsc_options_is_refused(solve, words, message, ranks):
    assert_ended(solve(*HERTZ, ranks=ranks, PETSC_OPTIONS=words), message)


def test_commands_of_one_rank_refuse_mpiexec():
    done = run("-m", "app.report", "nowhere.h5", ranks=2)
    assert_ended(done, "mpiexec -n 2: this command runs on one rank; start it without mpiexec")


def test_nonsense_in_petscrc_is_refused(solve, tmp_path):
    (tmp_path / ".petscrc").write_text("grid 8\n")
    assert_ended(solve(*HERTZ, ranks=2), ".petscrc line 1: grid")


@RANKS
def test_full_disk_is_an_error_and_keeps_the_result(solve, tmp_path, ranks):
    """By the default method on this grid PETSc's finalisation once waited for ever."""
    arguments = [*solve_arguments("hertz")[2:], "-grid", 128, "-output", "out.h5"]
    done = solve(*arguments, ranks=ranks, program=(TESTS / "troubled.py", "full_disk", 0))
    assert_ended(done, "out.h5: cannot be written: ")
    assert "No space left on device" in done.stderr
    assert list(tmp_path.iterdir()) == []


@RANKS
def test_journal_on_a_full_disk_is_an_error(solve, ranks):
    words = (*HERTZ[:-2], "-grid", 8, "-load_path", "10,20", "-path_csv", "a.csv")
    done = solve(*words, ranks=ranks, program=(TESTS / "troubled.py", "full_disk", 0))
    assert_ended(done, "a.path.jsonl: cannot be written: No space left on device")


def test_folder_removed_while_solving_is_an_error(solve, tmp_path):
    folder = tmp_path / "results"
    folder.mkdir()
    faulty = "-pc_type", "python", "-pc_python_type", "faults.RemovesFolder"
    done = solve(*HERTZ, *faulty, "-output", "results/out.h5", ranks=2, FOLDER_OF_RESULT=str(folder))
    assert_ended(done, "results does not exist")


def test_host_without_memory_is_named(solve):
    done = solve(*HERTZ, "-grid", 16, ranks=2, program=(TESTS / "troubled.py", "little_memory", 1))
    assert_ended(done, "grid 16,16: needs about ")


@pytest.mark.parametrize(
    ("ranks", "fault", "message"),
    [
        (None, "RefusesOnLastRank", "error: only this rank minds"),
        (2, "RefusesOnLastRank", "error: rank 1: only this rank minds"),
        (2, "HasNoMemoryOnLastRank", "error: rank 1: not enough memory: only this rank"),
    ],
)
def test_error_on_one_rank_aborts_the_others(solve, fault, message, ranks, tmp_path):
    faulty = "-pc_type", "python", "-pc_python_type", f"faults.{fault}"
    assert_ended(solve(*HERTZ, *faulty, "-output", "out.h5", ranks=ranks), message)
    assert list(tmp_path.iterdir()) == []


def test_files_need_to_be_on_the_first_host_only(tmp_path):
    folders = tmp_path / "first", tmp_path / "second"
    for folder in folders:
        folder.mkdir()
    (folders[0] / "first.opts").write_text("-options_file nested.opts\n")
    (folders[0] / "nested.opts").write_text("-grid 9\n")
    (folders[0] / ".petscrc").write_text("-approach 0.1\n")

    def solve_on_two_hosts(file):
        arguments = "-options_file", file, "-output", tmp_path / "out.h5"
        return on_two_hosts(folders, *solve_arguments("hertz", "norm"), *arguments, timeout=LIMIT)

    done = solve_on_two_hosts("first.opts")
    assert (done.returncode, done.stderr) == (0, "")
    assert read_result(tmp_path / "out.h5").pressure.shape == (9, 9)
    assert_ended(solve_on_two_hosts("second.opts"), "option file second.opts: No such file")


# ---------------------------------------------------------------------------------------------- lost data


@RANKS
def test_measurement_is_not_overwritten(solve, tmp_path, ranks):
    np.savetxt(tmp_path / "gap.txt", np.ones((8, 8)))
    before = (tmp_path / "gap.txt").read_bytes()
    (tmp_path / "link.h5").symlink_to("gap.txt")
    done = solve(*GAP, "-gap_file", "gap.txt", "-output", "link.h5", ranks=ranks)
    assert_ended(done, "is the input gap.txt; choose another name")
    assert (tmp_path / "gap.txt").read_bytes() == before


def test_files_of_a_user_defined_problem_are_not_overwritten(solve, tmp_path):
    (tmp_path / "own.py").write_text(
        "import numpy as np\n"
        "from app.options.option_table import Option, word\n"
        "from app.problems.problem import Problem\n"
        "class Own(Problem):\n"
        "    OPTIONS = (Option('my_file', word, None, 'slope'),)\n"
        "    def from_options(grid, material, options):\n"
        "        np.loadtxt(options['my_file'])\n"
        "        return Own(grid, material)\n"
        "    def shape_on(self, grid, rows=slice(None)):\n"
        "        return np.zeros((len(grid.y(rows)), grid.nx))\n"
    )
    (tmp_path / "mine.h5").write_text("1")
    words = "-problem python -problem_type own.Own -my_file mine.h5 -output mine.h5 -grid 8 -domain 0,1,0,1"
    done = solve(*words.split(), *GAP[4:], ranks=2)
    assert_ended(done, "is the input mine.h5; choose another name")
    assert (tmp_path / "mine.h5").read_text() == "1"


def test_missing_mpi4py_is_reported(solve):
    done = solve("-S", "-m", "app.solve", program=(), PYTHONPATH=str(TESTS.parent))
    assert_ended(done, f"{sys.executable} has no mpi4py")


@pytest.mark.parametrize(
    ("error", "message"),
    [
        ("numpy.dtype size changed", "petsc4py in {} does not work with numpy "),
        ("undefined symbol", "{}/petsc4py does not load: undefined symbol. Install by: "),
    ],
)
def test_incompatible_petsc4py_is_refused_in_one_line(solve, tmp_path, error, message):
    folder = tmp_path / "petsc4py"
    folder.mkdir()
    (folder / "__init__.py").write_text(f"def init(words):\n    raise ValueError({error!r})\n")
    done = solve("-problem", "hertz", PYTHONPATH=f"{tmp_path}:{TESTS.parent}")
    assert_ended(done, message.format(tmp_path))


# ------------------------------------------------------------------------------------------------ streams


def shell(line, tmp_path):
    command = f"{sys.executable} -m app.solve {' '.join(HERTZ)} {line}"
    return subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, timeout=LIMIT, cwd=tmp_path
    )


def test_closed_streams_do_not_stop_a_run(tmp_path):
    assert shell("-output out.h5 <&- >&- 2>&-", tmp_path).returncode == 0
    assert read_result(tmp_path / "out.h5").attributes["converged"]
    refused = shell("-bogus 2>&-", tmp_path)
    assert (refused.returncode, refused.stdout) == (2, "")


def test_full_standard_output_gives_a_warning(tmp_path):
    done = shell("-lcp_max_it 1 -output out.h5 >/dev/full", tmp_path)
    assert (done.returncode, done.stderr) == (3, "warning: standard output: No space left on device\n")
    assert read_result(tmp_path / "out.h5").attributes["converged"] is False


def test_removed_current_folder_is_reported(tmp_path):
    gone = tmp_path / "gone"
    gone.mkdir()
    command = f"rmdir {gone}; {sys.executable} -m app.solve {' '.join(HERTZ)}"
    environment = {**os.environ, "PYTHONPATH": ""}  # Python itself minds relative ones
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, timeout=LIMIT, cwd=gone, env=environment
    )
    assert_ended(done, "the current folder has been removed")
    assert len(done.stderr.splitlines()) == 1


# ---------------------------------------------------------------------------------------------- the rest


def test_log_view_in_a_file_has_events_and_stages(solve, tmp_path):
    (tmp_path / "log.opts").write_text("-log_view\n")
    done = solve(*HERTZ, "-options_file", "log.opts", ranks=2)
    assert done.returncode == 0
    events = "InfluenceMult", "InfluenceCoeffs", "InfluenceSpectra", "ContactCertify"
    for words in (*events, "Setup:", "Solve:", "Output:"):
        assert words in done.stdout


@pytest.mark.parametrize(("option", "ranks"), [("-log_view :", 2), ("-citations ", None)])
def test_unwritable_log_is_an_error(solve, tmp_path, option, ranks):
    done = solve(*HERTZ, *f"{option}/dev/full".split(), ranks=ranks)
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert done.returncode == 2
    assert errors == ["error: /dev/full: cannot be written: No space left on device"]
    done = solve(*HERTZ, *f"{option}{tmp_path / 'a.log'}".split())
    assert (done.returncode, done.stderr) == (0, "")
    log = (tmp_path / "a.log").read_text()
    assert "PETSc" in log and "/proc/" not in log


def test_user_defined_problem_is_solved(solve, tmp_path):
    (tmp_path / "mine.py").write_text("def bowl(x, y):\n    return (x**2 + y**2) / 40\n")
    problem = (
        "-problem python -grid 8 -domain -1,1,-1,1 -shear_modulus 80000 -poisson_ratio 0.3 -load 300".split()
    )
    done = solve(*problem, "-problem_type", "mine.py:bowl", ranks=2)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("mine.py:bowl 8 x 8: solved")
    assert_ended(solve(*problem, "-problem_type", "mine.bowls", ranks=2), "mine has no bowls")
    assert_ended(solve(*problem, "-problem_type", "mine.bowl", "-cone_slope", 1), "-cone_slope")


@RANKS
def test_user_defined_problem_that_exits_gives_status_1(solve, tmp_path, ranks):
    (tmp_path / "mine.py").write_text(
        "import sys\nseen = []\n"
        "def bowl(x, y):\n    seen.append(x)\n    return x**2 + y**2 if len(seen) < 3 else sys.exit()\n"
    )
    words = (
        "-problem python -problem_type mine.bowl -grid 64 -domain -1,1,-1,1 -contact_modulus 1e5 -load 300"
    )
    done = solve(*words.split(), ranks=ranks)
    assert (done.returncode, done.stdout) == (1, "")
    assert "SystemExit" in next(line for line in done.stderr.splitlines() if line.startswith("error: "))


KEEPS = """
import sys
import weakref

kept = weakref.finalize(type(sys), print)  # libraries register functions for the end of Python before the solver
kept.detach()
from app import ContactProblem, ContactSolver, Grid, Material
from app.halfspace.operator import InfluenceOperator
from petsc4py import PETSc

grid = Grid.from_domain(16, 16, (-1, 1, -1, 1))
operator = InfluenceOperator(grid, Material.from_contact_modulus(1e5).kernel)
mat = operator.mat(operator.petsc_comm)
own = PETSc.KSP().create(mat.comm)
own.setOperators(mat)
own.getPC().setType("none")
x, b = mat.createVecs()
b.set(1)
own.solve(b, x)
solver = ContactSolver(ContactProblem(grid, Material.from_contact_modulus(1e5), lambda x, y: x * x + y * y), "mg_v11")
ksp, pc = solver.ksp, solver.ksp.getPC()
print(solver.solve(approach=0.1).converged, end="")
"""


@pytest.mark.parametrize(("ranks", "end", "status"), [(None, "", 0), (2, "", 0), (None, "1 / 0", 1)])
def test_petsc_objects_may_live_until_the_program_ends(solve, ranks, end, status):
    done = solve(
        ranks=ranks, program=("-c", KEEPS + end), PYTHONPATH=os.pathsep.join([str(TESTS.parent), str(TESTS)])
    )
    assert done.returncode == status, done.stderr
    assert "PETSC ERROR" not in done.stderr
    assert done.stdout == "True" * (ranks or 1)


def test_option_file_is_not_overwritten(solve, tmp_path):
    (tmp_path / "opts.h5").write_text("-grid 8\n")
    assert_ended(solve(*HERTZ, "-options_file", "opts.h5", "-output", "opts.h5"), "is the input ")
    assert (tmp_path / "opts.h5").read_text() == "-grid 8\n"
