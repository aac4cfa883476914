"""app.solve from outside: what it refuses and how, exit status, result file."""

import numpy as np
import pytest
from processes import run, solve_arguments

from app.cli.problem_options import PROBLEM_OPTIONS
from app.io.result import read_result
from app.options.method import METHOD_OPTIONS, PART_OPTIONS, read_method_file
from app.options.option_table import format_value
from app.plots.figures import make_title

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
    "nothing but an output": ([], "-problem is missing"),
    "equals sign": ([*HERTZ, "-grid=16"], "-grid=16: needed: -grid 16"),
    "approach is no number": ([*HERTZ, "-approach", "1,5"], "must be a finite number [mm]"),
    "unknown option": ([*HERTZ, "-gird", "8"], "-gird (did you mean -grid?)"),
    "options of another problem": ([*HERTZ, "-punch_diameter", "3", "-gap_file", "a"], "-gap_file, -punch_diameter: "),
    "stray word": ([*HERTZ, "16"], "16: neither an option"),
    "no such folder": ([*HERTZ, "-output", "/no/such/folder/out.h5"], "/no/such/folder"),
    "output of unknown type": ([*HERTZ, "-output", "out.txt"], ".h5"),
    "no such ksp_type": ([*HERTZ, "-ksp_type", "gc"], "KSP type gc"),
    "PETSc option is no number": ([*HERTZ, "-ksp_rtol", "small"], "small"),
    "pc that needs a matrix": ([*HERTZ, "-pc_type", "ilu"], "ILU"),
    "no such class": ([*HERTZ, "-pc_type", "python", "-pc_python_type", "faults.Thing"], "Thing"),
    "too many levels": ([*HERTZ, "-pc_type", "mg", "-pc_mg_levels", "7"], "-pc_mg_levels 7"),
    "option file without a dash": (with_file("a.opts", b"grid 8\n", *HERTZ, "-options_file", "FILE"), "line 1: grid"),
    "no such gap file": (gap_of(None), "gap.npy: no such file"),
    "bounds of nothing": ([*HERTZ, "-ksp_type", "chebyshev"], "needed: -ksp_chebyshev_eigenvalues"),
    "solver without bounds": ([*DEFAULT, "-lcp_type", "snesvi", "-snes_type", "newtonls"], "allowed: vinewtonrsls"),
    "pc that crashes without entries": ([*HERTZ, "-pc_type", "hypre"], "-pc_type hypre: needs the entries"),
    "no problem": (["-problem", "ball"], "must be one of hertz, punch, file"),
    "units beyond single precision": ([*DEFAULT, "-shear_modulus", "1e40"], "-lcp_precision double"),
    "heights beyond single precision": ([*DEFAULT, "-hertz_rx", "1e-30"], "-lcp_precision double"),
    "approach beyond full contact": ([*HERTZ, "-periodic", "-approach", "9"], "approach 9: the mean gap"),
    "path and approach": ([*HERTZ, "-load_path", "1,2", "-approach", "1"], "both -approach and -load_path"),
    "resumes nothing": ([*HERTZ, "-resume"], "-resume: has no effect here; it is: path: continue an interrupted"),
    "diameter of no punch": ([*HERTZ, "-punch_diameter", "3"], "-punch_diameter: has no effect here; it is: diam"),
    "refines a path": ([*HERTZ, "-load_path", "1,2", "-refine_until", "0.1"], "needs a single loading"),
    "negative load without a patch": (
        ["-problem", "sphere", "-sphere_radius", "1", "-contact_modulus", "9", "-load", "-1"], "must be at least 0 N"
    ),
    "one infinite value": (gap_of(infinite(7, 4)), "inf in row 7, column 4"),
    "hardness of another grid": (
        with_file("h.npy", np.ones((8, 9)), *HERTZ, "-grid", "8", "-hardness_file", "FILE"), "has shape (8, 9)"
    ),
}  # fmt: skip
ON_RANKS = "no such ksp_type", "one infinite value", "approach beyond full contact", "no such folder"


@pytest.mark.parametrize(
    ("case", "ranks"), [*((case, None) for case in CASES), *((case, 2) for case in ON_RANKS)]
)
def test_bad_input_gets_one_line_and_status_2(cli, cli_here, tmp_path, case, ranks):
    """And leaves everything as it was."""
    arguments, message = CASES[case]
    old = tmp_path / RESULT
    old.write_bytes(b"an earlier result")
    if callable(arguments):
        arguments = arguments(tmp_path)
    before = sorted(tmp_path.iterdir())
    line = ("-output", old, *arguments)
    done = cli(*line, ranks=ranks) if ranks else cli_here(*line)
    lines = done.stderr.splitlines()
    if ranks:  # mpiexec has something to say, too
        assert "Traceback" not in done.stderr
        lines = [line for line in lines if line.startswith("error: ")]
    assert (done.returncode, len(lines), done.stdout) == (2, 1, ""), done.stderr
    assert lines[0].startswith("error: ") and message in lines[0]
    assert old.read_bytes() == b"an earlier result"
    assert sorted(tmp_path.iterdir()) == before  # nothing is left lying about


# --------------------------------------------------------------------------------- results and exit status


def test_the_folder_one_is_in_has_parts_but_no_program(tmp_path):
    """contact-solve is ``python -P -m app.solve``."""
    (tmp_path / "app.py").write_text("raise SystemExit(9)\n")
    (tmp_path / "mine.py").write_text("class Mine:\n    def apply(self, pc, x, y):\n        x.copy(y)\n")
    own = ("-pc_type", "python", "-pc_python_type", "mine.Mine")
    done = run("-P", *solve_arguments("hertz", "norm"), "-grid", "8", *own, cwd=tmp_path)
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
    assert done.returncode == 0
    assert (
        done.stderr == "warning: contact is at most 6 cells wide in y: use a finer grid or a smaller patch\n"
    )
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
    level = str(result.history["level"][0])
    iterations = [line for line in done.stdout.splitlines() if line.split()[:2] == [level, "1"]]
    assert len(iterations) == 1
    shown = "influence matrix of 20 x 12 cells", "2 slabs", "InfluenceMult", "Setup:", "Solve:", "Output:"
    assert all(words in done.stdout for words in shown), done.stdout
    assert done.stdout.count("KSP Object: contact 20 x 12 ") == 1  # of the target grid, once


def test_what_is_analytic_is_not_all_hertz_s_and_rounding_is_no_angle(cli_here):
    patch = ("-grid", 8, "-domain", "-1.6,1.6,-1.2,1.2", "-contact_modulus", 1000, "-load", 1)
    said = cli_here("-problem", "cone", "-cone_angle", 3, *patch).stdout
    assert "analytic solution (deviation): approach" in said and "Hertz" not in said
    ellipse = ("-hertz_rx", 10, "-hertz_ry", 5, "-grid", 8, "-contact_modulus", 1000, "-load", 1)
    assert "the longer at 0 degrees" in cli_here("-problem", "hertz", *ellipse).stdout


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ([], "surface: the paper's waves, 12 x 10 of them, standard deviation 0.1 mm, seed 7"),
        (["-surface_sigma", "0"], "analytic solution (deviation): approach 5e-05"),
        (
            ["-surface_cutoff", "0.5", "-surface_rms_slope", "0.1", "-surface_seed", "3"],
            "surface: self-affine, Hurst exponent 0.8, roll-off 4 mm, cut-off 0.5 mm, rms slope 0.1, seed 3",
        ),
    ],
)
def test_random_surfaces_are_told_also_those_that_nobody_asked_for(cli_here, more, message):
    punch = ["-problem", "punch", "-punch_diameter", "2", "-contact_modulus", "1e5", "-domain", "-2,2,-2,2"]
    assert message in cli_here(*punch, "-load", "10", "-grid", "32", *more).stdout


def test_nothing_at_all_is_told_where_to_begin():
    done = run("-m", "app.solve")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "error: nothing to solve; to begin with: -options_file petsc_options/hertz.opts; all options: -help\n"
    )


def test_help_names_every_option(cli):
    done = cli("--help")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("usage: ")
    for option in (*PROBLEM_OPTIONS, *METHOD_OPTIONS):
        assert f"-{option.name} " in done.stdout


def test_help_needs_neither_mpi_nor_petsc():
    hide = (
        "import runpy, sys; from importlib.machinery import PathFinder; find = PathFinder.find_spec\n"
        "hidden = lambda name, *more: None if name.startswith(('mpi4py', 'petsc4py')) else find(name, *more)\n"
        "PathFinder.find_spec = staticmethod(hidden)\n"
        "sys.argv[1:] = ['--help']; runpy.run_module('app.solve', run_name='__main__', alter_sys=True)"
    )
    done = run("-c", hide)
    assert (done.returncode, done.stderr) == (0, "")
    assert run("-m", "app.solve", "--help").stdout.startswith(done.stdout)  # PETSc adds its own


def test_a_solution_that_is_not_saved_is_named(cli_here, tmp_path):
    lines = [
        cli_here(*HERTZ, *more).stdout.splitlines()[-1] for more in ([], ["-output", str(tmp_path / RESULT)])
    ]
    assert "not saved; -output F.h5" in lines[0] and lines[1].endswith(f"result in {tmp_path / RESULT}")


def test_title_is_kept_in_the_result(cli_here, tmp_path):
    cli_here(*HERTZ, "-output", str(tmp_path / RESULT), "-title", "Bearing 7, 20 kN")
    assert make_title(read_result(tmp_path / RESULT)) == "Bearing 7, 20 kN"
    assert "-title: has no effect" in cli_here(*HERTZ, "-title", "Bearing 7").stderr


def test_runs_from_any_folder_with_relative_names(cli, tmp_path):
    (tmp_path / "mine.opts").write_text("-grid 8\n-output out.h5\n")
    done = cli("-options_file", "mine.opts", methods=["hertz", "norm"], cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert read_result(tmp_path / "out.h5").pressure.shape == (8, 8)


def test_help_has_the_values_that_an_ordinary_run_uses(cli_here):
    """The default of an option is what a method file of one's own begins with."""
    told = cli_here("--help").stdout
    for name in ("fast", "primal"):
        for option, text in read_method_file(name).items():
            if table := [entry for entry in (*METHOD_OPTIONS, *PART_OPTIONS) if entry.name == option]:
                [line] = [line for line in told.splitlines() if line.startswith(f"  -{option} ")]
                assert f"{name}.opts {format_value(table[0].kind(text))}" in line


def test_nothing_in_sight_is_worth_a_warning(cli_here):
    away = cli_here(*HERTZ, "-domain", "20,30,20,30")
    assert away.returncode == 0
    assert "smallest distance is at the patch boundary" in away.stderr
    lifted = cli_here(*HERTZ, "-approach", "-1")
    assert lifted.returncode == 0
    assert lifted.stderr == ""
