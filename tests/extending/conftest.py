"""Examples of docs/extending.md and CONTRIBUTING.md, in a folder of their own as a user's files are."""

import importlib
import os
import shutil
import sys
from pathlib import Path

import pytest
from processes import OPTIONS, TESTS, run

from app.contact.loading_input import LOADINGS

HERE = Path(__file__).resolve().parent
ROOT = TESTS.parent
EXAMPLES = sorted(path for path in HERE.glob("*.*") if not path.name.startswith(("test_", "__", "conftest")))
MODULES = [path.stem for path in EXAMPLES if path.suffix == ".py"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the examples and the project's option files, in which the test works."""
    for path in EXAMPLES:
        shutil.copy(path, tmp_path)
    shutil.copytree(OPTIONS, tmp_path / "petsc_options")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    for name in MODULES:
        monkeypatch.delitem(sys.modules, name, raising=False)
    loadings = dict(LOADINGS)
    yield tmp_path
    LOADINGS.clear()
    LOADINGS.update(loadings)
    for name in MODULES:
        sys.modules.pop(name, None)


@pytest.fixture
def example(folder):
    """``example("kernel")``: the module of an example."""
    return importlib.import_module


def changes_of(path):
    """Return the texts that an example replaces in files of the program: {file: {old: new}}."""
    names = {}
    if path.suffix == ".py" and "\nCHANGES = " in (text := path.read_text(encoding="utf-8")):
        exec(text, names)
    return names.get("CHANGES", {})


@pytest.fixture(scope="session")
def changed_program(tmp_path_factory):
    """``changed_program("-m", "app.solve", ...)``: run Python with a copy of the program that has all CHANGES."""
    copy = tmp_path_factory.mktemp("program")
    shutil.copytree(ROOT / "app", copy / "app")
    shutil.copytree(OPTIONS, copy / "petsc_options")
    shutil.copy(HERE / "minres.opts", copy / "petsc_options")
    for path in EXAMPLES:
        for name, texts in changes_of(path).items():
            file = copy / name
            for old, new in texts.items():
                text = file.read_text(encoding="utf-8")
                assert text.count(old) == 1, f"{path.name}: {name} must have this once: {old}"
                file.write_text(text.replace(old, new), encoding="utf-8")

    def run_in_copy(*command):
        paths = os.pathsep.join(filter(None, (str(copy), os.environ.get("PYTHONPATH"))))
        return run(*command, cwd=copy, env={"PYTHONPATH": paths})

    return run_in_copy
