"""docs/architecture.md: every package of app/ has a layer, and imports only from layers below."""

import ast
import re
from graphlib import TopologicalSorter

import pytest
from processes import TESTS

ROOT = TESTS.parent
TABLE = re.findall(
    r"^\| (\d+) \| (`.*?`) \|", (ROOT / "docs/architecture.md").read_text(encoding="utf-8"), re.MULTILINE
)
LAYER = {package: int(layer) for layer, packages in TABLE for package in re.findall(r"`(\w+)`", packages)}
MODULES = sorted(path.relative_to(ROOT / "app").as_posix() for path in (ROOT / "app").rglob("*.py"))


def package_of(module):
    return module.split("/")[0].removesuffix(".py")


def imported_by(module):
    """Packages that a module imports from; a name of `app` counts as its package."""
    tree = ast.parse((ROOT / "app" / module).read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "app":
            names = {alias.name for alias in node.names} - {"__version__"}
            found |= {name if name in LAYER else "api" for name in names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("app."):
            found.add(node.module.split(".")[1])
        elif isinstance(node, ast.Import):
            found |= {alias.name.split(".")[1] for alias in node.names if alias.name.startswith("app.")}
        elif isinstance(node, ast.Constant) and re.fullmatch(r"app(\.\w+){2,}", str(node.value)):
            found.add(node.value.split(".")[1])  # for PETSc, which imports it
    return found


def test_every_package_is_in_the_table():
    assert {package_of(module) for module in MODULES} - {"__init__"} == LAYER.keys()


@pytest.mark.parametrize("module", [m for m in MODULES if m != "__init__.py"])
def test_module_imports_only_from_layers_below(module):
    here = LAYER[package_of(module)]
    above = {package for package in imported_by(module) if LAYER[package] > here}
    assert not above


def test_packages_of_a_layer_make_no_circle():
    graph = {package: set() for package in LAYER}
    for module in set(MODULES) - {"__init__.py"}:
        graph[package_of(module)] |= imported_by(module) - {package_of(module)}
    TopologicalSorter(graph).prepare()  # raises CycleError


def test_modules_make_no_circle():
    """Imports inside functions count, too."""
    graph = {}
    for module in set(MODULES) - {"__init__.py"}:
        tree = ast.parse((ROOT / "app" / module).read_text(encoding="utf-8"))
        imported = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module]
        names = {node.module for node in imported} | {
            f"{node.module}.{alias.name}" for node in imported for alias in node.names
        }
        files = {f"{name.removeprefix('app.').replace('.', '/')}.py" for name in names}
        graph[module] = files.intersection(MODULES) - {module}
    TopologicalSorter(graph).prepare()
