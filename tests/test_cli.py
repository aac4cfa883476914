"""app.solve from outside: what it refuses and how, exit status, result file; and crashes that must not hang."""

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np
import pytest
from running import OPTIONS, TESTS, petsc_options, solve_arguments

from app.halfspace.grid import Grid
from app.halfspace.influence import Material
from app.options import TABLE, Options, loading
from app.output.result import read_result
from app.problems.gap_file import GapArray, GapFile
from app.session import InputError, option_names

AT_ONCE = 3  # processes; half of their time is waiting
RESULT = "result.h5"


DEFAULT = [*solve_arguments("hertz")[2:], "-grid", "8"]
COMMAND = [*solve_arguments("hertz", "norm"), "-grid", "8"]
HERTZ = COMMAND[2:]


def with_file(name, content, *arguments):
    """Arguments after a file has been made in the folder of the case."""

    def make(folder):
        if isinstance(content, bytes):
            (folder / name).write_bytes(content)
        elif content is not None:
            np.save(folder / name, content)
        return [str(folder / name) if argument == "FILE" else argument for argument in arguments]

    return make


def gap_of(content, name="gap.npy"):
    """Arguments for a problem whose gap file holds this."""
    return with_file(
        *(name, content, "-problem", "file", "-gap_file", "FILE", "-domain", "0,1,0,1", "-approach", "2"),
        *("-shear_modulus", "1", "-poisson_ratio", "0.3", *solve_arguments("norm")[2:]),
    )


def infinite(j, i):
    values = np.ones((8, 8))
    values[j, i] = np.inf
    return values


# Name of the case: arguments (or a function of a folder that makes them), and a part of the line that must appear.
CASES = {
    "nothing at all": ([], "-problem is missing"),
    "unknown option": ([*HERTZ, "-gird", "8"], "-gird"),
    "misspelt PETSc option": ([*HERTZ, "-ksp_rtoll", "1e-3"], "-ksp_rtoll"),
    "misspelt logging option": ([*HERTZ, "-log_vieww"], "-log_vieww"),
    "options of another problem": ([*HERTZ, "-punch_diameter", "3", "-gap_file", "a"], "s: -gap_file, -punch_diameter"),
    "stray word": ([*HERTZ, "16"], "16: neither an option"),
    "approach and load": ([*HERTZ, "-approach", "0.1", "-load", "5"], "both -approach and -load"),
    "nu too large": ([*HERTZ, "-poisson_ratio", "0.51"], "-poisson_ratio 0.51: not allowed; allowed: from 0 to 0.5"),
    "G zero": ([*HERTZ, "-shear_modulus", "0"], "-shear_modulus 0: not allowed; allowed: a positive number"),
    "reversed domain": ([*HERTZ, "-domain", "0,1,1,-1"], "-domain 0,1,1,-1"),
    "grid zero": ([*HERTZ, "-grid", "0"], "-grid 0: not allowed; allowed: nx,ny or n"),
    "no such folder": ([*HERTZ, "-output", "/no/such/folder/out.h5"], "/no/such/folder"),
    "output of unknown type": ([*HERTZ, "-output", "out.txt"], ".h5"),
    "no such ksp_type": ([*HERTZ, "-ksp_type", "gc"], "KSP type gc"),
    "PETSc option is no number": ([*HERTZ, "-ksp_rtol", "small"], "small"),
    "pc that needs a matrix": ([*HERTZ, "-pc_type", "ilu"], "ILU"),
    "no such class": ([*HERTZ, "-pc_type", "python", "-pc_python_type", "faults.Thing"], "Thing"),
    "too many levels": ([*HERTZ, "-pc_type", "mg", "-pc_mg_levels", "7"], "-pc_mg_levels 7"),
    "no such option file": ([*HERTZ, "-options_file", "nowhere.opts"], "nowhere.opts: No such file"),
    "option file without a dash": (with_file("a.opts", b"grid 8\n", *HERTZ, "-options_file", "FILE"), "line 1: grid 8"),
    "no such gap file": (gap_of(None), "gap.npy: no such file"),
    "gap file is none": (gap_of(b"\x93NUMPY nonsense"), "gap.npy"),
    "gap of three dimensions": (gap_of(np.ones((2, 8, 8))), "shape (2, 8, 8)"),
    "decimal commas": (gap_of(b"1,5;2,5\n3;4\n", "gap.csv"), "line 1, entry 1: '1,5' is no number"),
    "empty field": (gap_of(b"1,,3\n4,,6\n", "gap.csv"), "line 1, entry 2: '' is no number"),
    "archive of arrays": (gap_of(b"PK\x03\x04\xff\xfe", "gap.npz"), "it is no text; formats: .npy"),
    "value that cannot be squared": (gap_of(np.full((8, 8), 1e200)), "1e+200 in row 0, column 0; allowed: numbers"),
    "method of another solver": (
        [*DEFAULT, "-lcp_type", "tao", "-options_file", str(OPTIONS / "fast.opts")], "active_set only"
    ),
    "method of the active set": (
        [*DEFAULT, "-lcp_type", "tao", "-lcp_nested", "-lcp_merge", "0.4"], "unused options: -lcp_merge, -lcp_nested"
    ),
    "multigrid of another solver": (
        [*DEFAULT, "-lcp_type", "snesvi", "-options_file", str(OPTIONS / "fmg_v11.opts")], "-pc_type mg: works with"
    ),
    "preconditioner of another solver": (
        [*DEFAULT, "-lcp_type", "snesvi", "-pc_type", "python", "-pc_python_type", "app.multigrid.circulant.Circulant"],
        "works with active_set only",
    ),
    "solver without bounds": (
        [*DEFAULT, "-lcp_type", "snesvi", "-snes_type", "newtonls"], "allowed: vinewtonrsls"
    ),
    "solver that crashes": ([*DEFAULT, "-lcp_type", "tao", "-tao_type", "ssils"], "-tao_type ssils: allowed: tron"),
    "pc of another solver that needs a matrix": ([*DEFAULT, "-lcp_type", "tao", "-pc_type", "ilu"], "ILU"),
    "pc that crashes without entries": ([*HERTZ, "-pc_type", "hypre"], "-pc_type hypre: needs the entries"),
    "no problem": (["-problem", "ball"], "allowed: one of hertz, punch, file"),
    "no frequencies": ([*HERTZ, "-problem", "punch", "-surface_modes", "0"], "allowed: M,N or M"),
    "no iterations": ([*DEFAULT, "-ksp_max_it", "0"], "-ksp_max_it 0: allowed: from 1"),
    "no tolerance": ([*HERTZ, "-ksp_rtol", "-1"], "-ksp_rtol -1: allowed: from 0"),
    "options of another solver": ([*DEFAULT, "-lcp_type", "tao", "-pc_circulant_extend", "3"], "-pc_circulant_extend"),
    "all NaN": (gap_of(np.full((8, 8), np.nan)), "NaN"),
    "units beyond single precision": ([*DEFAULT, "-shear_modulus", "1e40"], "-lcp_precision double"),
    "heights beyond single precision": ([*DEFAULT, "-hertz_rx", "1e-30"], "-lcp_precision double"),
    "one infinite value": (gap_of(infinite(7, 4)), "inf in row 7, column 4"),
}  # fmt: skip
ON_TWO_RANKS = [
    "solver without bounds",
    "no such ksp_type",
    "option file without a dash",
    "one infinite value",
    "no such folder",
]


@pytest.fixture(scope="module")
def refused(cli, tmp_path_factory, request):
    """``refused(case, ranks)``: the run of a case and its folder; all cases that were asked for run ahead."""
    wanted = {
        (item.callspec.params["case"], item.callspec.params.get("ranks"))
        for item in request.session.items
        if "case" in getattr(getattr(item, "callspec", None), "params", ())
    }

    # The factory is not made for several threads: all folders are made here.
    folders = {key: tmp_path_factory.mktemp("case") for key in sorted(wanted, key=str)}

    def run_case(case, ranks):
        folder = folders[case, ranks]
        arguments, _ = CASES[case]
        old = folder / RESULT
        old.write_bytes(b"an earlier result")
        if callable(arguments):
            arguments = arguments(folder)
        before = sorted(folder.iterdir())
        done = cli("-output", old, *arguments, ranks=ranks, env={"PYTHONPATH": str(TESTS)})
        return done, old, before

    with ThreadPoolExecutor(AT_ONCE) as pool:
        runs = {key: pool.submit(run_case, *key) for key in sorted(wanted, key=str)}
        yield lambda *key: runs[key].result()


def assert_refused(run, message, ranks=None):
    done, old, before = run
    lines = done.stderr.splitlines()
    if ranks:  # mpiexec has something to say, too
        assert "Traceback" not in done.stderr
        lines = [line for line in lines if line.startswith("error: ")]
    assert done.returncode == 2, done.stderr
    assert len(lines) == 1, done.stderr
    assert lines[0].startswith("error: ")
    assert message in lines[0]
    assert done.stdout == ""
    assert old.read_bytes() == b"an earlier result"
    assert sorted(old.parent.iterdir()) == before  # nothing is left lying about


@pytest.mark.parametrize("case", CASES)
def test_bad_input_gets_one_line_and_status_2(refused, case):
    assert_refused(refused(case, None), CASES[case][1])


@pytest.mark.mpi(2)
@pytest.mark.parametrize("case", ON_TWO_RANKS)
def test_bad_input_on_two_ranks(refused, case, ranks):
    assert_refused(refused(case, ranks), CASES[case][1], ranks)


# ------------------------------------------------------------------------ bad input, without a process each

BAD_VALUES = [
    ("problem", "herz", "one of hertz"),
    ("problem", "", "one of hertz"),
    ("grid", "8,-8", "nx,ny or n"),
    ("grid", "10,20,30", "nx,ny or n"),
    ("grid", "8.5", "nx,ny or n"),
    ("grid", "", "nx,ny or n"),
    ("grid", ",", "nx,ny or n"),
    ("grid", "60000", "at most 2147483647 cells"),
    ("grid", "99999999999999999999", "at most 2147483647 cells"),
    ("domain", "0,0,0,1", "x0 < x1"),
    ("domain", "0,1", "x0,x1,y0,y1"),
    ("domain", "0,1,0,1,2", "x0,x1,y0,y1"),
    ("domain", "0,inf,0,1", "x0,x1,y0,y1"),
    ("domain", "-1e308,1e308,0,1", "x0,x1,y0,y1"),
    ("shear_modulus", "-82000", "a positive number"),
    ("shear_modulus", "1e-320", "1e-50 to 1e+50"),
    ("poisson_ratio", "-0.1", "from 0 to 0.5"),
    ("poisson_ratio", "nan", "from 0 to 0.5"),
    ("approach", "deep", "a finite number"),
    ("approach", "", "a finite number"),
    ("approach", "nan", "a finite number"),
    ("approach", "1e200", "1e-50 to 1e+50"),
    ("hertz_rx", "0", "a positive number"),
    ("lcp_nested", "maybe", "true or false"),
    ("lcp_rtol", "0", "a positive number"),
    ("lcp_max_it", "0", "a whole number"),
    ("lcp_max_it", "1e3", "a whole number"),
    ("lcp_beta", "-1", "a number from 0"),
    ("gap_file", "", "a name must follow"),
    ("output", "", "a name must follow"),
]


@pytest.mark.parametrize(("name", "text", "allowed"), BAD_VALUES)
def test_value_that_is_not_allowed(name, text, allowed):
    with petsc_options(**{name: text}), pytest.raises(InputError) as refusal:
        Options()[name]
    wrong = f"-{name} {text}: not allowed" if text else f"-{name}: its value is missing"
    assert str(refusal.value).startswith(f"{wrong}; allowed: ")
    assert allowed in str(refusal.value)


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("grid", "8", (8, 8)),
        ("grid", "8,5", (8, 5)),
        ("domain", "-1,1,0,1e-3", (-1, 1, 0, 1e-3)),
        ("approach", "-0.11", -0.11),
        ("poisson_ratio", "0.5", 0.5),
        ("lcp_nested", "", True),
        ("lcp_nested", "no", False),
    ],
)
def test_value_that_is(name, text, value):
    with petsc_options(**{name: text}):
        assert Options()[name] == value


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.opts", b"# a comment\ngrid 8\n", "line 2: grid 8"),
        ("a.opts", b"-grid 8 -approach 1\n", "line 1"),
        ("a.opts", b"-domain -1, 1, -1, 1\n", "line 1"),
        ("a.opts", b"-problem 'hertz\n", "line 1"),
        ("a.opts", b"-\n", "line 1"),
        ("a.opts", bytes(range(128, 256)), "not a text file"),
        ("a.yml", b"grid: [8\nproblem: }\n", "a.yml"),
        ("a.yaml", b"- grid\n- 8\n", "option: value"),
    ],
)
def test_file_that_is_no_option_file(name, content, message, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=re.escape(message)):
        option_names(str(tmp_path / name))


def test_folder_as_option_file(tmp_path):
    with pytest.raises(InputError, match="Is a directory"):
        option_names(str(tmp_path))


def test_names_in_option_files(tmp_path):
    opts, yml = tmp_path / "a.opts", tmp_path / "a.yml"
    opts.write_text("# c\n\n-grid 8,9 # cells\n  -lcp_monitor\n-domain '-1,1,-1,1'\n")
    yml.write_text("grid: [8, 9]\nlcp:\n  rtol: 1e-3\n")
    assert option_names(str(opts)) == ["-grid", "-lcp_monitor", "-domain"]
    assert option_names(str(yml)) == ["-grid", "-lcp"]
    for path in OPTIONS.glob("*.opts"):
        assert option_names(str(path))


def save_archive(path):
    np.savez(path.with_suffix(".npz"), a=np.ones((8, 8)))
    path.with_suffix(".npz").rename(path)


def save_hdf5(**datasets):
    def save(path):
        with h5py.File(path, "w") as file:
            for name, values in datasets.items():
                file[name] = values

    return save


def save_part(save, share):
    def save_and_cut(path):
        save(path)
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])

    return save_and_cut


def save_array(values):
    return lambda path: np.save(path, values, allow_pickle=True)


def save_bytes(content):
    return lambda path: path.write_bytes(content)


SQUARE = np.ones((8, 8))


@pytest.mark.parametrize(
    ("name", "save", "message"),
    [
        ("gap.npy", lambda path: path.mkdir(), "not a file"),
        ("gap.npy", save_array(np.ones(8)), "shape (8,)"),
        ("gap.npy", save_array(np.float64(8)), "shape ()"),
        ("gap.npy", save_array(np.ones((0, 8))), "shape (0, 8)"),
        ("gap.npy", save_array(SQUARE.astype(complex)), "complex128"),
        ("gap.npy", save_array(SQUARE.astype(bool)), "bool"),
        ("gap.npy", save_array(np.array([[1, None]], object)), "objects"),
        ("gap.npy", save_array(np.array([["a", "b"]])), "U1"),
        ("gap.npy", save_part(save_array(SQUARE), 0.6), "cannot be read"),
        ("gap.npy", save_part(save_array(SQUARE), 0.05), "cannot be read"),
        ("gap.npy", save_bytes(b""), "cannot be read"),
        ("gap.npy", save_archive, "archive"),
        ("gap.h5", save_part(save_hdf5(gap=SQUARE), 0.5), "cannot be read"),
        ("gap.h5", save_bytes(b"not HDF5"), "cannot be read"),
        ("gap.h5", save_hdf5(a=SQUARE, b=SQUARE), "FILE:/DATASET; there are: a, b"),
        ("gap.h5", save_hdf5(a=np.ones(8)), "there are: none"),
        ("gap.h5:/c", save_hdf5(a=SQUARE), "no dataset /c"),
        ("gap.h5:/g", save_hdf5(**{"g/a": SQUARE}), "no dataset /g"),
        ("gap.h5:/a", save_hdf5(a=h5py.Empty("f8")), "shape None"),
        ("gap.h5:/a", save_hdf5(a=SQUARE.astype(complex)), "complex128"),
        ("gap.h5:/a", save_hdf5(a="text"), "object"),
        ("gap.npy", save_bytes(b"0.1 0.2"), "no .npy file"),
        ("gap.h5:a", save_hdf5(a=SQUARE), "FILE:/DATASET"),
        ("gap.txt", save_bytes(b""), "empty"),
        ("gap.txt", save_bytes(b"# nothing\n"), "empty"),
        ("gap.txt", save_bytes(b"1 2 3\n4 5\n"), "line 2 has 2 entries, line 1 has 3"),
        ("gap.txt", save_bytes(b"1 2\n3 four\n"), "four"),
        ("gap.txt", save_bytes(b"1 2\n3 4+5j\n"), "4+5j"),
        ("gap.txt", save_bytes(bytes(range(128, 256))), "cannot be read"),
    ],
)
def test_file_that_is_no_gap(name, save, message, tmp_path):
    path = str(tmp_path / name)
    save(tmp_path / name.partition(":")[0])
    with pytest.raises(ValueError, match=re.escape(message)) as refusal:
        GapArray(path)
    assert str(refusal.value).startswith(f"gap file {tmp_path}/gap.")


def test_gap_of_another_shape_than_the_grid(tmp_path):
    np.save(tmp_path / "gap.npy", np.ones((8, 9)))
    with pytest.raises(ValueError, match=re.escape("-grid 8,9 needs (ny, nx) = (9, 8)")):
        GapFile(Grid(8, 9, 1.0, 1.0), Material(1.0, 0.3), GapArray(str(tmp_path / "gap.npy")))


@pytest.mark.parametrize("value", [np.inf, -np.inf])
def test_infinite_gap(value, tmp_path):
    values = SQUARE.copy()
    values[5, 2], values[6, 0] = value, np.nan
    np.save(tmp_path / "gap.npy", values)
    gap = GapArray(str(tmp_path / "gap.npy"))
    with pytest.raises(ValueError, match="row 5, column 2"):
        gap.check(slice(4, 8))
    assert gap.check(slice(0, 4)) == 32
    assert gap.check(slice(6, 8)) == 15


# -------------------------------------------------------------------------------------- approach or load


def prescribed(*argv, environment="", monkeypatch=None):
    """What `loading` makes of a command line."""
    with petsc_options() as database:
        if monkeypatch:
            monkeypatch.setenv("PETSC_OPTIONS", environment)
        database.insertString(" ".join([environment, *map(str, argv)]))
        return loading(Options(), ["solve.py", *map(str, argv)])


@pytest.fixture
def files(tmp_path):
    (tmp_path / "approach.opts").write_text("-approach 0.1 # mm\n")
    (tmp_path / "load.opts").write_text("# N\n-load 7e3\n")
    (tmp_path / "load.yml").write_text("lcp:\n  rtol: 1e-6\nload: 7e3\n")
    return {path.name: ("-options_file", path) for path in tmp_path.iterdir()}


def test_one_of_approach_and_load_replaces_the_other_from_an_earlier_place(files):
    approach, load = files["approach.opts"], files["load.opts"]
    assert prescribed(*approach) == ("approach", 0.1)
    assert prescribed(*approach, "-approach", 0.2) == ("approach", 0.2)
    assert prescribed(*approach, "-load", 5) == ("load", 5)
    assert prescribed("-load", 5, *approach) == ("load", 5)  # the command line wins wherever it stands
    assert prescribed(*load, "-approach", -0.2) == ("approach", -0.2)
    assert prescribed(*approach, *load) == ("load", 7e3)
    assert prescribed(*load, *approach) == ("approach", 0.1)
    assert prescribed(*approach, *files["load.yml"]) == ("load", 7e3)


def test_environment_comes_first(files, monkeypatch):
    assert prescribed("-load", 5, environment="-approach 0.3", monkeypatch=monkeypatch) == ("load", 5)
    assert prescribed(environment="-approach 0.3", monkeypatch=monkeypatch) == ("approach", 0.3)


@pytest.mark.parametrize("argv", [[], ["-grid", 8], ["-approach", 1, "-load", 2]])
def test_exactly_one_of_approach_and_load(argv):
    with pytest.raises(InputError, match="exactly one"):
        prescribed(*argv)


# --------------------------------------------------------------------------------- results and exit status


def test_default_method_without_nested_iteration(cli):
    done = cli("-grid", 32, "-lcp_nested", "false", methods=["hertz"])
    assert (done.returncode, done.stderr) == (0, "")


def test_not_converged_is_status_3_with_a_result(cli, tmp_path):
    path = tmp_path / RESULT
    done = cli("-grid", 16, "-lcp_max_it", 1, "-output", path, methods=["hertz", "norm"])
    assert done.returncode == 3
    assert done.stderr == ""
    assert "NOT CONVERGED" in done.stdout
    result = read_result(path)
    assert result.attributes["converged"] is False
    assert result.attributes["active_set_iterations"] == 1
    assert "not enough" in result.attributes["reason"]
    assert result.history["changed_cells"][-1] > 0


def test_result_holds_what_was_printed_and_asked_for(cli, tmp_path):
    path = tmp_path / RESULT
    done = cli(
        *("-grid", "20,12", "-approach", 0.07, "-output", path, "-lcp_monitor", "-ksp_view", "-log_view"),
        methods=["hertz", "norm"],
        ranks=2,
    )
    assert (done.returncode, done.stderr) == (0, "")
    result = read_result(path)
    facts = result.attributes
    assert (facts["approach"], facts["ranks"], facts["converged"]) == (0.07, 2, True)
    assert result.pressure.shape == (12, 20)
    cell_area = (20 / 20) * (12 / 12)
    assert facts["load"] == pytest.approx(cell_area * result.pressure.sum(), rel=1e-12)
    assert facts["max_pressure"] == result.pressure.max()
    assert facts["contact_cells"] == result.contact.sum() == round(facts["contact_fraction"] * 240)
    assert facts["inner_iterations"] == result.history["inner_iterations"].sum()
    assert facts["work_units"] == pytest.approx(result.history["work_units"].sum())
    assert facts["active_set_iterations"] == len(result.history["level"])
    assert f"{facts['load']:.8g} N" in done.stdout
    assert "-grid 20,12" in facts["options"]
    assert "app" in facts["command_line"]
    # -lcp_monitor, -ksp_view and -log_view show the iterations, our operator, stages and events
    iterations = [line for line in done.stdout.splitlines() if line.split()[:2] == ["0", "1"]]
    assert len(iterations) == 1
    for words in (
        "influence matrix of 20 x 12 cells",
        "2 slabs",
        "InfluenceMult",
        "Setup:",
        "Solve:",
        "Output:",
    ):
        assert words in done.stdout


def test_help_names_every_option(cli):
    done = cli("-help")
    assert done.returncode == 0
    for option in TABLE:
        assert f"-{option.name} " in done.stdout


def test_runs_from_any_folder_with_relative_names(cli, tmp_path):
    (tmp_path / "mine.opts").write_text("-grid 8\n-output out.h5\n")
    done = cli("-options_file", "mine.opts", methods=["hertz", "norm"], cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert read_result(tmp_path / "out.h5").pressure.shape == (8, 8)


# ------------------------------------------------------------------------------------------------- crashes

FAULTY = ["-grid", "16", "-ksp_type", "cg", "-pc_type", "python", "-pc_python_type"]


@pytest.mark.mpi(1, 2, 3)
def test_exception_on_one_rank_ends_the_job_with_its_traceback(cli, ranks, tmp_path):
    path = tmp_path / RESULT
    path.write_bytes(b"an earlier result")
    done = cli(
        *FAULTY, "faults.RaisesOnLastRank", "-output", path,
        methods=["hertz"], ranks=ranks, env={"PYTHONPATH": str(TESTS)},
    )  # fmt: skip
    assert done.returncode not in (0, 2, 3)
    assert "Traceback" in done.stderr
    assert "RuntimeError: this rank has a problem of its own" in done.stderr
    assert "Segmentation" not in done.stderr
    assert path.read_bytes() == b"an earlier result"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("ranks", [None, 2])
def test_killed_run_leaves_the_earlier_result_whole(cli, ranks, tmp_path):
    path, begun = tmp_path / RESULT, tmp_path / "begun"
    assert cli("-grid", 16, "-output", path, methods=["hertz", "norm"]).returncode == 0
    before = path.read_bytes()
    python = [sys.executable, *solve_arguments("hertz"), *FAULTY, "faults.TakesForEver", "-output", str(path)]
    process = subprocess.Popen(
        python if ranks is None else ["mpiexec", "-n", str(ranks), *python],
        env={**os.environ, "PYTHONPATH": str(TESTS), "SOLVE_HAS_BEGUN": str(begun)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        deadline = time.monotonic() + 60
        while not begun.exists() and process.poll() is None and time.monotonic() < deadline:
            time.sleep(0.05)
        assert begun.exists()
    finally:
        process.send_signal(signal.SIGKILL if ranks is None else signal.SIGTERM)
        process.wait(timeout=30)
    begun.unlink()
    assert path.read_bytes() == before
    assert read_result(path).attributes["converged"] is True
    assert list(tmp_path.iterdir()) == [path]


def test_help_names_the_choices(cli):
    told = cli("-help").stdout
    assert "what is pressed together: hertz, punch, file" in told
    assert "(default 12,10)" in told


def test_nothing_in_sight_is_worth_a_warning(cli):
    away = cli(*HERTZ, "-domain", "20,30,20,30")
    assert away.returncode == 0
    assert "smallest distance is found at the rim" in away.stderr
    lifted = cli(*HERTZ, "-approach", "-1")
    assert lifted.returncode == 0
    assert lifted.stderr == ""


def test_a_reader_may_go_away(tmp_path):
    """A closed pipe is no crash, and what was asked for is still written."""
    out = tmp_path / "out.h5"
    command = shlex.join([sys.executable, *COMMAND, "-output", str(out)])
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {command} -lcp_monitor | head -1"],
        cwd=TESTS.parent, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.stdout.startswith("level")
    assert done.stderr == ""
    assert done.returncode == 0
    assert read_result(out).attributes["converged"]


def test_interrupted(tmp_path):
    """Ctrl-C: one line, status 130, no file."""
    out = tmp_path / "out.h5"
    slow = "-grid 512 -lcp_rtol 1e-14 -lcp_max_it 100000 -ksp_rtol 1e-15 -lcp_monitor".split()
    process = subprocess.Popen(
        [sys.executable, *COMMAND, *slow, "-output", str(out)],
        cwd=TESTS.parent, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    assert process.stdout.readline().startswith("level")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert errors == "interrupted\n"
    assert list(tmp_path.iterdir()) == []
