"""An installed package: everything travels with it."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest
from processes import TESTS, run

import app

SOURCE = TESTS.parent
pytest.importorskip("setuptools", reason="no setuptools to build a wheel with")
pytest.importorskip("wheel", reason="no wheel to build one with")

SOLVE = """
from pathlib import Path
import app
from app import ContactProblem, Grid, Material, Paraboloid, solve
problem = ContactProblem(Grid.from_domain(32, 32, (-10, 10, -6, 6)), Material(82000, 0.28), Paraboloid(300, 163))
solution = solve(problem, approach=0.1091)
print(Path(app.__file__).parent, app.__version__, solution.converged, solution.load)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the package of this tree, unpacked from its wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    tree = folder / "tree"  # a build leaves files in the tree
    tree.mkdir()
    for name in ("app", "petsc_options"):
        shutil.copytree(SOURCE / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(SOURCE / name, tree)
    options = "--no-deps --no-build-isolation --no-index --disable-pip-version-check --quiet".split()
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", *options, "-w", folder, "."], cwd=tree, check=True, timeout=120
    )
    (wheel,) = folder.glob("*.whl")
    with ZipFile(wheel) as packed:
        packed.extractall(folder / "site")
    take_compiled_loops_along(folder / "site")
    return folder / "site"


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


def test_wheel_has_every_file_of_the_package(installed):
    wanted = {
        path.relative_to(SOURCE)
        for path in (SOURCE / "app").rglob("*")
        if path.is_file() and path.suffix in (".py", ".json", ".html") and "__pycache__" not in path.parts
    }
    options = (SOURCE / "petsc_options").rglob("*.*")
    wanted |= {Path("app") / path.relative_to(SOURCE) for path in options}
    there = {path.relative_to(installed) for path in (installed / "app").rglob("*") if path.is_file()}
    assert not wanted - there


@pytest.fixture
def elsewhere(installed, tmp_path):
    """How to run what is installed, from another folder."""
    path = [str(installed), os.environ.get("PYTHONPATH", "")]
    return {"cwd": tmp_path, "env": {"PYTHONPATH": os.pathsep.join(filter(None, path))}}


def test_installed_package_solves_by_its_default_method(installed, elsewhere):
    done = run("-c", SOLVE, **elsewhere)
    assert done.returncode == 0, done.stderr
    *facts, load = done.stdout.split()
    assert facts == [str(installed / "app"), app.__version__, "True"]
    assert float(load) == pytest.approx(82003.9, rel=2e-3)  # Hertz's


def test_installed_command_solves(installed, elsewhere):
    problem = installed / "app" / "petsc_options" / "hertz.opts"
    done = run("-m", "app.solve", "-options_file", problem, "-grid", "32", "-output", "r.h5", **elsewhere)
    assert done.returncode == 0, done.stderr
    assert (elsewhere["cwd"] / "r.h5").is_file()
