"""Types of the public interface: every public function states them, mypy finds them, and values have them."""

import ast
import inspect
import re
import runpy
import subprocess
import sys
import types
import typing
from dataclasses import fields
from importlib import import_module
from importlib.util import find_spec

import numpy as np
import pytest
from processes import TESTS

import app
from app import reference
from app.api.solution import Solution

ROOT = TESTS.parent
PROGRAM = TESTS / "typed_program.py"
DOCUMENTED = re.findall(r"auto(\w+):: ([\w.]+)", (ROOT / "docs/api.md").read_text(encoding="utf-8"))
STUBS = {
    "app/__init__.pyi": app._PLACES,
    "app/reference/__init__.pyi": {
        name: f"app.reference.{module}" for name, module in reference._MODULES.items()
    },
}


def public_functions(target):
    """Functions of a documented class, function or module, with the base classes of classes."""
    if inspect.ismodule(target):
        own = [value for name, value in vars(target).items() if name[0] != "_"]
        for value in own:
            if getattr(value, "__module__", "") == target.__name__:
                yield from public_functions(value)
    elif inspect.isclass(target):
        bases = [base for base in target.__mro__ if base.__module__.split(".")[0] == "app"]
        for name, value in (pair for base in bases for pair in vars(base).items()):
            value = getattr(value, "fget", None) or getattr(value, "func", None) or value
            value = getattr(value, "__func__", value)
            if (name[0] != "_" or name == "__init__") and inspect.isfunction(value):
                yield value
    else:
        yield target


@pytest.mark.parametrize(("kind", "name"), DOCUMENTED, ids=[name for _, name in DOCUMENTED])
def test_every_public_function_states_its_types(kind, name):
    module, _, attribute = (name, "", "") if kind == "module" else name.rpartition(".")
    target = getattr(import_module(module), attribute) if attribute else import_module(module)
    for function in public_functions(target):
        parameters = set(inspect.signature(function).parameters) - {"self", "cls"}
        assert not (parameters | {"return"}) - function.__annotations__.keys(), function.__qualname__


@pytest.mark.parametrize("stub", STUBS)
def test_stub_has_the_names_of_its_module(stub):
    tree = ast.parse((ROOT / stub).read_text(encoding="utf-8"))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    assert {alias.asname: node.module for node in imports for alias in node.names} == STUBS[stub]


def test_program_uses_every_exported_name():
    imports = [node for node in ast.walk(ast.parse(PROGRAM.read_text())) if isinstance(node, ast.ImportFrom)]
    assert {alias.name for node in imports if node.module == "app" for alias in node.names} == {*app.__all__}


def test_mypy_finds_the_types(tmp_path):
    if find_spec("mypy") is None:
        pytest.skip("no mypy")
    numbers = [
        f"assert_type(s.{f.name}, {f.type.__name__})" for f in fields(Solution) if type(f.type) is type
    ]
    lines = ["from typing import assert_type", "import app", "def check(s: app.Solution) -> None:"]
    numbers = [line for line in numbers if line.split()[-1][:-1] in ("bool", "int", "float", "str")]
    program = tmp_path / "numbers_of_a_solution.py"
    program.write_text("\n    ".join(["\n".join(lines), *numbers]))
    command = [sys.executable, "-m", "mypy", "--cache-dir", tmp_path, PROGRAM, program]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert len(numbers) > 40 and done.returncode == 0, done.stdout + done.stderr


def has_type(value, kind):
    """Whether a value has a type: its class, or an array's type of numbers. Entries of containers are not checked."""
    origin = typing.get_origin(kind)
    if origin in (types.UnionType, typing.Union):
        return any(has_type(value, one) for one in typing.get_args(kind))
    if origin is np.ndarray:
        return isinstance(value, np.ndarray) and value.dtype == typing.get_args(typing.get_args(kind)[1])[0]
    return kind is typing.Any or isinstance(value, origin or kind)


def test_values_have_the_types(monkeypatch):
    def check(value, kind):
        assert has_type(value, kind), (value, kind)

    monkeypatch.setattr(typing, "assert_type", check)
    runpy.run_path(str(PROGRAM))
