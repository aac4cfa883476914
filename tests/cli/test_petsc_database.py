"""Options of the command, as PETSc's own views, logs and start files have them."""

import re

import pytest
from processes import run, solve_arguments

HERTZ = [*solve_arguments("hertz"), "-grid", 16]


def table(text):
    """Options of PETSc's table in an output: name with dash -> text."""
    rows = re.search(r"#PETSc Option Table entries:\n(.*?)#End", text, re.DOTALL)[1].splitlines()
    rows = (row.partition(" # (source")[0].partition(" ") for row in rows)  # newer PETSc's
    return {name: value for name, _, value in rows}


def test_run_can_be_repeated_from_options_view(tmp_path):
    """They are all there: those of the files, and of the default method, and none is unused."""
    done = run(*HERTZ, "-load", 5000, "-options_view", "-options_left", "-log_view", ":log", cwd=tmp_path)
    assert done.returncode == 0
    assert re.fullmatch(r"warning: contact is at most \d cells wide in [xy]: .*\n", done.stderr)
    assert "There are no unused options." in done.stdout
    shown = table(done.stdout)
    assert shown["-problem"] == "hertz" and shown["-load"] == "5000" and "-approach" not in shown
    assert (
        shown["-ksp_python_type"] == "app.methods.free.tracking_cg.TrackingCG"
        and shown["-lcp_type"] == "fast"
    )
    assert {
        name.strip() for name in re.findall(r"^-\w+", (tmp_path / "log").read_text(), re.MULTILINE)
    } == shown.keys()
    for name in ("-options_view", "-options_left", "-log_view"):
        del shown[name]
    words = [word for name, text in shown.items() for word in (name, text) if word]
    again = run("-m", "app.solve", *words)
    assert again.returncode == 0
    load = re.compile("load .*? N")
    assert load.search(again.stdout)[0] == load.search(done.stdout)[0]


def test_options_of_a_refined_run_are_those_of_its_first_grid(tmp_path):
    (tmp_path / "a.opts").write_text("-lcp_rtol 1e-5\n")
    words = ("-options_file", "a.opts", "-load", 5000, "-refine_until", 0.05, "-options_view")
    shown = table(run(*HERTZ, *words, cwd=tmp_path).stdout)
    assert shown["-lcp_rtol"] == "1e-5" and shown["-refine_until"] == "0.05" and shown["-lcp_type"] == "fast"


@pytest.mark.ranks(1, 2)
def test_petsc_start_options_count_least(ranks, tmp_path):
    (tmp_path / ".petscrc").write_text(
        "-grid 8\n-load 5\n-lcp_max_it 7\n-my_option 3\n-ksp_gmres_restart 9\n"
    )
    how = {"cwd": tmp_path, "ranks": ranks, "env": {"PETSC_OPTIONS": "-load 6 -lcp_max_it 8 -options_left"}}
    (tmp_path / "a.opts").write_text("-grid 12\n")
    words = [*solve_arguments("hertz")[2:], "-options_file", "a.opts", "-options_view"]
    done = run("-m", "app.solve", *words, **how)
    assert (done.returncode, "error" in done.stderr) == (0, False)
    shown = table(done.stdout)
    assert (shown["-grid"], shown["-approach"], shown["-lcp_max_it"]) == ("12", "0.1091", "8")
    left = set(re.findall(r"Option left: name:-(\w+)", done.stdout))
    assert left == {"load", "my_option", "ksp_gmres_restart"}  # hertz.opts has an approach
    skipped = run("-m", "app.solve", *words, "-skip_petscrc", **how)
    assert "-my_option" not in table(skipped.stdout)


def test_options_that_petsc_reads_at_its_start_only_are_refused_in_files(tmp_path):
    (tmp_path / "a.opts").write_text("-malloc_debug\n")
    done = run(*HERTZ, "-options_file", "a.opts", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (2, "error: unknown or unused option: -malloc_debug\n")
