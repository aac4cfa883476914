"""Users without a home, current folders that have been removed, and modules of the user that replace others."""

import os
import sys
import tempfile
from pathlib import Path

import pytest
from processes import HERTZ, run

from app.base import user_folder

SOLVE = """
from app import ContactProblem, Grid, Material, Sphere, read_result, solve, solve_many

grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
problem = ContactProblem(grid, Material.from_contact_modulus(1e5), Sphere(8))
solution = solve(problem, load=500)
"""
GONE = (
    "import os, sys\nfolder = os.getcwd()\nos.rmdir(folder)\n"
    + SOLVE
    + """
solution.plot()
solution._repr_html_()
solution.save(sys.argv[1])
assert read_result(sys.argv[1]).load == solution.load
assert solve(problem, load=500, method="norm").converged
assert len(solve_many([problem] * 2, 500, processes=2)) == 2
try:
    solution.save("r.h5")
except ValueError as error:
    print(error)
"""
)


def test_a_removed_current_folder_matters_only_to_relative_paths(tmp_path):
    (tmp_path / "gone").mkdir()
    program = tmp_path / "program.py"
    program.write_text(f"if __name__ == '__main__':\n    exec({GONE!r})\n")
    done = run(program, tmp_path / "r.h5", cwd=tmp_path / "gone")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == "result file r.h5: No such file or directory\n"


def test_a_user_unknown_to_the_system_has_a_lasting_private_home(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.delenv("HOME")
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    user_folder.ensure_home()
    home = os.environ["HOME"]
    assert (user_folder.private_folder() == tmp_path / home) and Path(home).stat().st_mode & 0o777 == 0o700
    Path(home).chmod(0o777)  # somebody else may write there
    assert user_folder.private_folder() not in (None, tmp_path / home)


@pytest.mark.parametrize("disturb", ["file", "dangling link", "other owner"])
def test_a_private_folder_is_found_whatever_has_its_name(disturb, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    taken = [tmp_path / f"elastic-contact-{os.getuid()}-{number}" for number in range(5)]
    for path in taken:
        if disturb == "file":
            path.touch()
        elif disturb == "dangling link":
            path.symlink_to(tmp_path / "nowhere")
    if disturb == "other owner":  # as on file systems that give files another owner
        lstat, uid = Path.lstat, os.getuid()
        monkeypatch.setattr(
            Path, "lstat", lambda path: os.stat_result([*lstat(path)[:4], uid + 1, *lstat(path)[5:]])
        )
    folder = user_folder.private_folder()
    assert folder.is_dir() and folder not in taken and folder.stat().st_mode & 0o777 == 0o700


def test_no_folder_for_temporary_files_does_not_end_an_import(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    monkeypatch.delenv("HOME")
    monkeypatch.delenv("MPLCONFIGDIR", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", "/dev/null")
    user_folder.ensure_home()
    user_folder.ensure_matplotlib_folder()
    assert "HOME" not in os.environ and "MPLCONFIGDIR" not in os.environ


@pytest.mark.skipif(os.getuid() != 0, reason="only root can run as somebody else")
@pytest.mark.parametrize("home", ["os.environ.pop('HOME', None)", "os.environ['HOME'] = '/root'"])
@pytest.mark.parametrize("uid", [65534, 54321])
def test_matplotlib_has_a_lasting_folder_for_a_user_without_a_home(uid, home):
    program = (
        f"import os; os.setgid({uid}); os.setuid({uid}); {home}\n"
        "import app, matplotlib; print(matplotlib.get_cachedir())"
    )
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o777)
        found = [run("-c", program, env={"TMPDIR": folder}) for _ in range(2)]
    assert {done.stderr for done in found} == {""}
    assert len({done.stdout for done in found}) == 1
    assert found[0].stdout.startswith(f"{folder}/elastic-contact-{uid}-0/")


@pytest.mark.parametrize("name", ["signal", "types", "random", "numpy", "contextlib", "numba"])
def test_a_module_of_the_user_beside_the_data_replaces_none(name, tmp_path):
    (tmp_path / f"{name}.py").write_text("raise SystemExit(9)")
    arguments = "-options_file", HERTZ, "-grid", "16"
    if name != "types" or sys.version_info < (3, 13):  # since then Python itself needs it before ``-m``
        done = run("-m", "app.solve", *arguments, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    command = Path(sys.executable).with_name("contact-solve")
    if command.exists() and name not in ("types", "contextlib"):  # which Python itself loads from PYTHONPATH
        done = run(*arguments, program=command, cwd=tmp_path, env={"PYTHONPATH": "."})
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("content", ["", "raise RuntimeError('mine')", "from collections import nothing"])
@pytest.mark.parametrize("name", ["signal", "random", "numpy", "scipy"])
def test_a_program_next_to_such_a_module_ends_with_its_name(name, content, tmp_path):
    (tmp_path / f"{name}.py").write_text(content)
    (tmp_path / "program.py").write_text(SOLVE)
    done = run(tmp_path / "program.py", cwd=tmp_path)
    message = f"{tmp_path}/{name}.py: has the name of a module that this program needs; rename the file"
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and last.startswith(f"ImportError: {message} ("), done.stderr
    assert {"": "Error: ", "raise": "RuntimeError: mine)", "from": "'nothing'"}[
        content.partition(" ")[0]
    ] in last


def test_modules_of_the_user_are_not_blamed_for_other_errors(tmp_path):
    for name in ("test", "profile"):
        (tmp_path / f"{name}.py").touch()
    program = tmp_path / "program.py"
    program.write_text("import sys, test, profile\nsys.modules['petsc4py'] = None\nfrom app import solve")
    done = run(program, cwd=tmp_path)
    assert done.returncode == 1
    assert "petsc4py" in done.stderr.splitlines()[-1] and "rename" not in done.stderr
    # A checkout that is also installed elsewhere.
    (tmp_path / "app").symlink_to(Path(user_folder.__file__).parents[1])
    (tmp_path / "elsewhere" / "app").mkdir(parents=True)
    (tmp_path / "elsewhere" / "app" / "__init__.py").touch()
    (tmp_path / "elsewhere" / "contextlib.py").write_text("raise RuntimeError('theirs')")
    program.write_text("import sys; sys.modules.pop('contextlib', None); import app")
    done = run("-S", program, cwd=tmp_path, env={"PYTHONPATH": str(tmp_path / "elsewhere")})
    assert done.returncode == 1 and done.stderr.endswith("RuntimeError: theirs\n"), done.stderr


@pytest.mark.parametrize("word", ["app.h5", "app.solve"])
def test_a_module_with_a_word_of_this_program_as_argument_is_no_command(word, tmp_path):
    (tmp_path / "random.py").write_text("raise RuntimeError('mine')")
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__init__.py").write_text("import app.api.solver")
    done = run("-m", "package", word, cwd=tmp_path)
    assert done.returncode == 1 and "Traceback" in done.stderr
