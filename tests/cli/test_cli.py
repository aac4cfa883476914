"""app.solve from outside: what it refuses and how, exit status, result file."""

import numpy as np
import pytest
from cases import APPROACH, hertz
from processes import TESTS, run, solve_arguments
from running import solve

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
    "unknown option of the method": ([*HERTZ, "-lcp_rtool", "1e-3"], "unknown option: -lcp_rtool"),
    "misspelt PETSc option": ([*HERTZ, "-ksp_rtoll", "1e-3"], "option: -ksp_rtoll (did you mean -ksp_rtol?)"),
    "misspelt logging option": ([*HERTZ, "-log_vieww"], "-log_vieww"),
    "options of another problem": ([*HERTZ, "-punch_diameter", "3", "-gap_file", "a"], "-gap_file, -punch_diameter: "),
    "stray word": ([*HERTZ, "16"], "16: neither an option"),
    "approach and load": ([*HERTZ, "-approach", "0.1", "-load", "5"], "both -approach and -load"),
    "nu too large": ([*HERTZ, "-poisson_ratio", "0.51"], "-poisson_ratio 0.51: must be from 0 to 0.5"),
    "G zero": ([*HERTZ, "-shear_modulus", "0"], "-shear_modulus 0: must be a positive number"),
    "reversed domain": ([*HERTZ, "-domain", "0,1,1,-1"], "-domain 0,1,1,-1"),
    "grid zero": ([*HERTZ, "-grid", "0"], "-grid 0: must be nx,ny or n"),
    "no such folder": ([*HERTZ, "-output", "/no/such/folder/out.h5"], "/no/such/folder"),
    "output of unknown type": ([*HERTZ, "-output", "out.txt"], ".h5"),
    "no such ksp_type": ([*HERTZ, "-ksp_type", "gc"], "KSP type gc"),
    "PETSc option is no number": ([*HERTZ, "-ksp_rtol", "small"], "small"),
    "pc that needs a matrix": ([*HERTZ, "-pc_type", "ilu"], "ILU"),
    "no such class": ([*HERTZ, "-pc_type", "python", "-pc_python_type", "faults.Thing"], "Thing"),
    "too many levels": ([*HERTZ, "-pc_type", "mg", "-pc_mg_levels", "7"], "-pc_mg_levels 7"),
    "no such option file": ([*HERTZ, "-options_file", "nowhere.opts"], "nowhere.opts: No such file"),
    "option file without a dash": (with_file("a.opts", b"grid 8\n", *HERTZ, "-options_file", "FILE"), "line 1: grid"),
    "no such gap file": (gap_of(None), "gap.npy: no such file"),
    "gap file is none": (gap_of(b"\x93NUMPY nonsense"), "gap.npy"),
    "gap of three dimensions": (gap_of(np.ones((2, 8, 8))), "shape (2, 8, 8)"),
    "decimal commas": (gap_of(b"0,12,0,34\n0,13,0,35\n", "gap.csv"), "commas may separate numbers or begin"),
    "empty field": (gap_of(b"1,,3\n4,,6\n", "gap.csv"), "line 1, entry 2: '' is no number"),
    "archive": (gap_of(b"PK\x03\x04\xff\xfe", "gap.zip"), "gap.zip: is an archive: unpack it"),
    "value that cannot be squared": (gap_of(np.full((8, 8), 1e200)), "1e+200 in row 0, column 0; must be numbers"),
    "mistyped option in a file": (
        with_file("a.opts", b"-pc_mg_tipe full\n", *HERTZ, "-options_file", "FILE", "-pc_type", "jacobi"),
        "unknown or unused option: -pc_mg_tipe",
    ),
    "prefix of nothing": ([*HERTZ, "-foo_ksp_view"], "unknown or unused option: -foo_ksp_view"),
    "bounds of nothing": ([*HERTZ, "-ksp_type", "chebyshev"], "needed: -ksp_chebyshev_eigenvalues"),
    "method of the active set": (
        [*DEFAULT, "-lcp_type", "tao", "-lcp_nested"], "-lcp_nested: has no effect here; allowed with -lcp_type"
    ),
    "multigrid of another solver": (
        [*DEFAULT, "-lcp_type", "snesvi", "-pc_type", "mg"], "works on contact sets, snesvi on submatrices"
    ),
    "preconditioner of another solver": (
        [*DEFAULT, "-lcp_type", "snesvi", "-pc_type", "python",
         "-pc_python_type", "app.methods.free.circulant.Circulant"],
        "Circulant: needs an InfluenceOperator",
    ),
    "solver without bounds": (
        [*DEFAULT, "-lcp_type", "snesvi", "-snes_type", "newtonls"], "allowed: vinewtonrsls"
    ),
    "solver that crashes": ([*DEFAULT, "-lcp_type", "tao", "-tao_type", "ssils"], "-tao_type ssils: allowed: tron"),
    "pc of another solver that needs a matrix": ([*DEFAULT, "-lcp_type", "tao", "-pc_type", "ilu"], "ILU"),
    "pc that crashes without entries": ([*HERTZ, "-pc_type", "hypre"], "-pc_type hypre: needs the entries"),
    "no problem": (["-problem", "ball"], "must be one of hertz, punch, file"),
    "no frequencies": ([*HERTZ, "-problem", "punch", "-punch_diameter", "3", "-surface_modes", "0"], "must be M,N"),
    "no iterations": ([*DEFAULT, "-ksp_max_it", "0"], "-ksp_max_it 0: must be at least 1"),
    "no tolerance": ([*HERTZ, "-ksp_rtol", "-7"], "-7"),
    "options of another solver": ([*DEFAULT, "-lcp_type", "tao", "-pc_circulant_extend", "3"], "-pc_circulant_extend"),
    "all NaN": (gap_of(np.full((8, 8), np.nan)), "NaN"),
    "units beyond single precision": ([*DEFAULT, "-shear_modulus", "1e40"], "-lcp_precision double"),
    "heights beyond single precision": ([*DEFAULT, "-hertz_rx", "1e-30"], "-lcp_precision double"),
    "symbol of a free patch": ([*HERTZ, "-periodic_symbol", "love"], "-periodic_symbol: has no effect here"),
    "unknown symbol": ([*HERTZ, "-periodic", "-periodic_symbol", "saw"], "must be one of spectral, love"),
    "mean gap of a free patch": ([*HERTZ, "-mean_gap", "0.1"], "mean_gap 0.1: only on a periodic patch"),
    "negative mean gap": ([*HERTZ, "-periodic", "-mean_gap", "-0.1"], "mean_gap -0.1: the bodies do not penetrate"),
    "approach beyond full contact": ([*HERTZ, "-periodic", "-approach", "9"], "approach 9: the mean gap"),
    "two moduli": (
        [*HERTZ, "-contact_modulus", "3", "-shear_modulus", "3"], "both -contact_modulus and -shear_modulus"
    ),
    "half a pair of bodies": ([*HERTZ, "-young", "3,inf"], "-poisson is missing: nu1,nu2"),
    "strip one cell wide": ([*HERTZ, "-grid", "8,1"], "no line contact; for plane strain"),
    "no path": ([*HERTZ, "-load_path", "1:2"], "-load_path 1:2: must be first:last:n"),
    "path and approach": ([*HERTZ, "-load_path", "1,2", "-approach", "1"], "both -approach and -load_path"),
    "path of negative loads": ([*HERTZ, "-load_path", "1,-2"], "load -2: the bodies do not stick together"),
    "resumes nothing": ([*HERTZ, "-resume"], "-resume: has no effect here; it is: path: go on after the steps"),
    "diameter of no punch": ([*HERTZ, "-punch_diameter", "3"], "-punch_diameter: has no effect here; it is: diam"),
    "refines a path": ([*HERTZ, "-load_path", "1,2", "-refine_until", "0.1"], "needs a single loading"),
    "refines a file": (
        with_file(
            *("gap.npy", np.ones((8, 8)), "-problem", "file", "-gap_file", "FILE", "-domain", "0,1,0,1"),
            *("-approach", "2", "-contact_modulus", "1", "-refine_until", "0.1"),
        ),
        "known on one grid only",
    ),
    "one infinite value": (gap_of(infinite(7, 4)), "inf in row 7, column 4"),
    "hardness zero": ([*HERTZ, "-hardness", "0"], "-hardness 0: must be a positive number; inf: elastic [N/mm2]"),
    "two hardnesses": ([*HERTZ, "-hardness", "9", "-hardness_file", "a"], "both -hardness and -hardness_file are"),
    "hardness of another grid": (
        with_file("h.npy", np.ones((8, 9)), *HERTZ, "-grid", "8", "-hardness_file", "FILE"), "has shape (8, 9)"
    ),
    "load above all hardness": ([*HERTZ, "-hardness", "9", "-load", "1e9"], "it must be at most 2160 N"),
}  # fmt: skip
ON_RANKS = [
    "solver without bounds",
    "no such ksp_type",
    "option file without a dash",
    "one infinite value",
    "approach beyond full contact",
    "no such folder",
]


@pytest.fixture
def refused(cli, cli_here, tmp_path):
    """``refused(case, ranks)``: assert that a case is refused in one line and leaves everything as it was."""

    def assert_refused(case, ranks=None):
        arguments, message = CASES[case]
        old = tmp_path / RESULT
        old.write_bytes(b"an earlier result")
        if callable(arguments):
            arguments = arguments(tmp_path)
        before = sorted(tmp_path.iterdir())
        line = ("-output", old, *arguments)
        done = cli(*line, ranks=ranks, env={"PYTHONPATH": str(TESTS)}) if ranks else cli_here(*line)
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
        assert sorted(tmp_path.iterdir()) == before  # nothing is left lying about

    return assert_refused


@pytest.mark.parametrize("case", CASES)
def test_bad_input_gets_one_line_and_status_2(refused, case):
    refused(case)


@pytest.mark.ranks(2)
@pytest.mark.parametrize("case", ON_RANKS)
def test_bad_input_from_outside(refused, case, ranks):
    refused(case, ranks)


# --------------------------------------------------------------------------------- results and exit status


def test_the_folder_one_is_in_has_parts_but_no_program(tmp_path):
    """contact-solve is ``python -P -m app.solve``."""
    (tmp_path / "app.py").write_text("raise SystemExit(9)\n")
    (tmp_path / "mine.py").write_text("class Mine:\n    def apply(self, pc, x, y):\n        x.copy(y)\n")
    own = ("-pc_type", "python", "-pc_python_type", "mine.Mine")
    done = run("-P", *solve_arguments("hertz", "norm"), "-grid", "8", *own, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


def test_default_method_without_nested_iteration(cli_here):
    done = cli_here("-grid", 32, "-lcp_nested", "false", methods=["hertz"])
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
    level = str(result.history["level"][0])
    iterations = [line for line in done.stdout.splitlines() if line.split()[:2] == [level, "1"]]
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


def test_help_names_the_choices(cli_here):
    told = cli_here("--help").stdout
    assert "what is pressed together: hertz, punch, file" in told
    assert "(default 12,10)" in told


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


def test_command_line_solves_a_gap_file_on_two_ranks(cli, tmp_path):
    problem = hertz(32)
    np.save(tmp_path / "gap.npy", problem.shape_on(problem.grid))
    done = cli(
        *("-problem", "file", "-gap_file", tmp_path / "gap.npy", "-domain", "-10,10,-6,6"),
        *("-shear_modulus", 82000, "-poisson_ratio", 0.28, "-approach", APPROACH),
        *("-output", tmp_path / "out.h5", "-lcp_rtol", 1e-12),
        methods=["norm"],
        ranks=2,
    )
    assert (done.returncode, done.stderr) == (0, "")
    result = read_result(tmp_path / "out.h5")
    assert result.attributes["converged"] is True
    assert result.attributes["ranks"] == 2
    alone = solve(problem, APPROACH, lcp_rtol=1e-12)
    np.testing.assert_allclose(result.pressure, alone.pressure, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(result.contact, alone.contact)
    np.testing.assert_allclose(result.gap, result.undeformed_distance + result.displacement, atol=1e-15)


def test_no_contact_is_a_valid_answer(cli_here, tmp_path):
    done = cli_here("-grid", 16, "-approach", -0.1, "-output", tmp_path / "out.h5", methods=["hertz", "norm"])
    assert (done.returncode, done.stderr) == (0, "")
    result = read_result(tmp_path / "out.h5")
    assert result.attributes["converged"] is True
    assert result.attributes["load"] == result.attributes["max_pressure"] == 0
    assert not result.pressure.any()
    np.testing.assert_array_equal(result.gap, result.undeformed_distance)


def test_contact_at_the_rim_is_solved_with_a_warning(cli, tmp_path):
    done = cli(
        *("-grid", 16, "-domain", "-3,3,-3,3", "-output", tmp_path / "out.h5"),
        methods=["hertz", "norm"],
        ranks=2,
    )
    assert done.returncode == 0
    warnings = done.stderr.splitlines()
    assert len(warnings) == 1
    assert warnings[0].startswith("warning: ")
    assert "patch boundary" in warnings[0]
    result = read_result(tmp_path / "out.h5")
    assert result.attributes["converged"] is True
    assert result.contact.all()
    assert np.abs(result.gap).max() < 1e-5


def test_windows_are_refused_where_they_mean_nothing():
    common = (*solve_arguments("hertz"), "-grid", "32", "-lcp_window", "0.1")
    for more, why in (
        (("-lcp_nested", "false"), "-lcp_nested only"),
        (("-lcp_nested", "-ksp_type", "cg"), "-lcp_type fast only"),
    ):
        done = run(*common, *more)
        assert done.returncode == 2
        assert "-lcp_window" in done.stderr
        assert why in done.stderr
