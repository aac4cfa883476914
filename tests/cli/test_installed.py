"""An installed package: everything travels with it."""

import shutil
import subprocess
import sys
import tarfile
from importlib.util import find_spec
from pathlib import Path

import pytest
from processes import TESTS, run

import app
from app.io.result import read_result

SOURCE = TESTS.parent
pytest.importorskip("setuptools", reason="no setuptools to build a wheel with")
pytest.importorskip("wheel", reason="no wheel to build one with")

PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet"]
SOLVE = """
from pathlib import Path
import app
from app.io.result import read_result
from app import ContactProblem, Grid, Material, Paraboloid, solve
steel = Material.combined(82000, 0.28)
problem = ContactProblem(Grid.from_domain(32, 32, (-10, 10, -6, 6)), steel, Paraboloid(300, 163))
solution = solve(problem, approach=0.1091)
print(Path(app.__file__).parent, app.__version__, solution.converged, solution.load)
"""
WITHOUT_PETSC = """
import sys
from app.base import petsc_path
sys.path = [folder for folder in sys.path if "petsc" not in folder]  # where Debian has it
sys.argv = ["contact-solve", "-problem", "hertz"]
from app.cli.scripts import main
main()
"""


def copy_tree(tree):
    """Copy what a build needs, because it leaves files in the tree."""
    tree.mkdir()
    for name in ("app", "petsc_options"):
        shutil.copytree(SOURCE / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(SOURCE / name, tree)


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A clean environment with the wheel of this tree: its bin/ and where the package is. Debian gives the rest."""
    folder = tmp_path_factory.mktemp("wheel")
    tree, venv = folder / "tree", folder / "a venv"
    copy_tree(tree)
    call("wheel", "--no-deps", "--no-build-isolation", "--no-index", "-w", folder, tree)
    (wheel,) = folder.glob("*.whl")
    base = Path(sys.base_prefix, "bin", "python3")
    subprocess.run(
        [base, "-m", "venv", "--system-site-packages", "--without-pip", venv], check=True, timeout=60
    )
    # Ubuntu has no numba, Debian 13 no pyfftw.
    own = any(Path(sys.prefix) in Path(find_spec(name).origin).parents for name in ("numba", "pyfftw"))
    call("--python", venv / "bin" / "python", "install", *([] if own else ["--no-index"]), wheel)
    (site,) = venv.glob("lib/*/site-packages")
    take_compiled_loops_along(site)
    return venv / "bin", site


def call(*arguments):
    subprocess.run([*PIP, *map(str, arguments)], check=True, timeout=120)


def take_compiled_loops_along(site):
    """Spare numba what it has compiled already; it knows a source by its size and time."""
    for source in (SOURCE / "app").rglob("*.py"):
        copy = site / source.relative_to(SOURCE)
        if copy.is_file():
            shutil.copystat(source, copy)
            cache = copy.parent / "__pycache__"
            cache.mkdir(exist_ok=True)
            for compiled in source.parent.glob(f"__pycache__/{source.stem}.*.nb?"):
                shutil.copy(compiled, cache)


PIP_RUNS_SETUP = """
import subprocess, sys
sys.exit(subprocess.run([sys.executable, {!r}, "--name"]).returncode)
"""


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """The Python of a venv without packages."""
    venv = tmp_path_factory.mktemp("bare") / "venv"
    base = Path(sys.base_prefix, "bin", "python3")
    subprocess.run([base, "-m", "venv", "--without-pip", venv], check=True, timeout=60)
    return venv / "bin" / "python"


@pytest.mark.parametrize(
    ("words", "refused"),
    [
        (["install", "."], True),
        (["-q", "install", "--upgrade", str(SOURCE)], True),
        (["install", ".[wheels]"], False),
        (["install", ".", "petsc", "petsc4py", "h5py"], False),
        (["install", "--no-deps", "."], False),
        (["wheel", "."], False),
    ],
)
def test_pip_install_without_petsc4py_names_the_ways_that_work_before_a_build(bare, tmp_path, words, refused):
    """But not with it, and a wheel can be built anywhere."""
    pip = tmp_path / "pip3"
    pip.write_text(PIP_RUNS_SETUP.format(str(SOURCE / "setup.py")))
    environment = {"PYTHONPATH": "", "PETSC_DIR": ""}
    done = run(pip, *words, program=bare, cwd=SOURCE, env=environment)
    assert done.returncode
    *_, last = done.stderr.splitlines()
    if refused:
        assert last == done.stderr.strip()
        assert "pip install '.[wheels]'" in last and "--system-site-packages" in last
    else:
        assert last == "ModuleNotFoundError: No module named 'setuptools'"
    done = run(pip, *words, cwd=SOURCE)
    assert done.stdout.split()[-1:] == ["elastic-contact-fmg"], done.stderr


def test_a_bare_environment_does_not_see_the_petsc_of_the_system(bare):
    """Which is compiled for the numpy and the MPI of the system."""
    program = "from app.base.petsc_path import PathFinder; print(PathFinder.find_spec('petsc4py'))"
    done = run("-c", program, program=bare, env={"PYTHONPATH": str(SOURCE), "PETSC_DIR": ""})
    assert done.stdout == "None\n", done.stderr


@pytest.mark.parametrize(
    "command", [path.stem for path in (SOURCE / "app").glob("*.py") if "main" in path.read_text()]
)
def test_help_needs_neither_petsc_nor_hdf5(bare, tmp_path, command):
    """And without them a program ends with one line, below its own."""
    for folder in {Path(find_spec(name).origin).parents[1] for name in ("numpy", "numba", "pyfftw")}:
        for entry in folder.iterdir():
            if not entry.name.startswith(("h5py", "petsc4py", "_distutils", "__pycache__")):
                (tmp_path / entry.name).symlink_to(entry)
    environment = {"PYTHONPATH": f"{SOURCE}:{tmp_path}", "PETSC_DIR": ""}
    done = run("-m", f"app.{command}", "--help", program=bare, env=environment)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"usage: python -m app.{command} ")
    if command == "solve":
        done = run("-c", "import app\napp.solve()", program=bare, env=environment)
        lines = done.stderr.splitlines()
        assert [line for line in lines if "/app/" in line] == [lines[-3]] and "PackageMissing: " in lines[-1]


def test_wheel_has_every_file_of_the_package(installed):
    _, site = installed
    wanted = {
        path.relative_to(SOURCE)
        for path in (SOURCE / "app").rglob("*")
        if path.suffix in (".py", ".pyi", ".typed", ".json", ".html") and "__pycache__" not in path.parts
    }
    options = (SOURCE / "petsc_options").rglob("*.*")
    wanted |= {Path("app") / path.relative_to(SOURCE) for path in options}
    there = {path.relative_to(site) for path in (site / "app").rglob("*") if path.is_file()}
    assert not wanted - there


def test_source_distribution_has_types_and_tests(tmp_path):
    copy_tree(tree := tmp_path / "tree")
    for name in ("docs", "run", "tests"):
        shutil.copytree(SOURCE / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("CITATION.cff", "MANIFEST.in", "conftest.py"):
        shutil.copy(SOURCE / name, tree)
    done = run("setup.py", "--quiet", "sdist", "--dist-dir", tmp_path, cwd=tree)
    assert done.returncode == 0, done.stderr
    (archive,) = tmp_path.glob("*.tar.gz")
    with tarfile.open(archive) as files:
        names = {name.partition("/")[2] for name in files.getnames()}
    assert {"app/py.typed", "app/__init__.pyi", "app/reference/__init__.pyi"} <= names
    assert {
        "conftest.py",
        "run/test",
        "docs/index.md",
        "tests/cli/test_installed.py",
        "CITATION.cff",
    } <= names


def test_every_command_is_on_path(installed):
    scripts, _ = installed
    commands = {path.stem for path in (SOURCE / "app").glob("*.py") if "import main" in path.read_text()}
    assert {path.name for path in scripts.glob("contact-*")} == {f"contact-{name}" for name in commands}


def test_installed_package_solves_by_its_default_method(installed, tmp_path):
    scripts, site = installed
    done = run("-c", SOLVE, program=scripts / "python", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    *facts, load = done.stdout.removeprefix(str(site / "app")).split()
    assert facts == [app.__version__, "True"]
    assert float(load) == pytest.approx(82003.9, rel=2e-3)  # Hertz's


@pytest.mark.ranks(None, 2)
def test_installed_command_solves(installed, tmp_path, ranks):
    scripts, site = installed
    problem = site / "app" / "petsc_options" / "hertz.opts"
    line = "-options_file", problem, "-grid", "32", "-output", "r.h5"
    done = run(*line, program=scripts / "contact-solve", cwd=tmp_path, ranks=ranks)
    assert done.returncode == 0, done.stderr
    assert read_result(tmp_path / "r.h5").attributes["ranks"] == (ranks or 1)


@pytest.mark.ranks(None, 2)
def test_without_petsc4py_one_line_says_how_to_get_it(installed, tmp_path, ranks):
    scripts, _ = installed
    done = run("-c", WITHOUT_PETSC, program=scripts / "python", cwd=tmp_path, ranks=ranks)
    complaints = [line for line in done.stderr.splitlines() if line.startswith("error")]
    assert (done.returncode, len(complaints)) == (2, 1), done.stderr
    assert "not installed: petsc4py. Install by: " in complaints[0]


@pytest.mark.slow  # asks PyPI
def test_h5py_without_mpi_writes_the_same(installed, tmp_path):
    scripts, site = installed
    target = tmp_path / "h5py"
    call("install", "--no-deps", "--only-binary", ":all:", "--target", target, "h5py")
    problem = site / "app" / "petsc_options" / "hertz.opts"
    found = []
    for name, path in (("mpi", ""), ("wheel", str(target))):
        line = "-options_file", problem, "-grid", "32", "-output", f"{name}.h5"
        done = run(*line, program=scripts / "contact-solve", cwd=tmp_path, ranks=2, env={"PYTHONPATH": path})
        assert done.returncode == 0, done.stderr
        found.append(read_result(tmp_path / f"{name}.h5"))
    assert (found[0].pressure == found[1].pressure).all()
