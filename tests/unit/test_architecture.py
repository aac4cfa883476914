"""docs/architecture.md: every module of app/ is on a floor, and knows only what lies below."""

import ast
import re
from graphlib import TopologicalSorter

import pytest
from processes import TESTS

ROOT = TESTS.parent
TABLE = re.findall(
    r"^\| (\d) \| (`.*?`) \|", (ROOT / "docs/architecture.md").read_text(encoding="utf-8"), re.MULTILINE
)
FLOOR = {room: int(floor) for floor, rooms in TABLE for room in re.findall(r"`(\w+)`", rooms)}
MODULES = sorted(path.relative_to(ROOT / "app").as_posix() for path in (ROOT / "app").rglob("*.py"))


def room_of(module):
    return module.split("/")[0].removesuffix(".py")


def known_to(module):
    """Rooms that a module imports from; names of the API by their places."""
    tree = ast.parse((ROOT / "app" / module).read_text(encoding="utf-8"))
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == "app":
            names = {alias.name for alias in node.names} - {"__version__"}
            found |= {name if name in FLOOR else "solver" for name in names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("app."):
            found.add(node.module.split(".")[1])
        elif isinstance(node, ast.Import):
            found |= {alias.name.split(".")[1] for alias in node.names if alias.name.startswith("app.")}
        elif isinstance(node, ast.Constant) and re.fullmatch(r"app(\.\w+){2,}", str(node.value)):
            found.add(node.value.split(".")[1])  # for PETSc, which imports it
    return found


def test_every_room_is_in_the_table():
    assert {room_of(module) for module in MODULES} - {"__init__"} == FLOOR.keys()


@pytest.mark.parametrize("module", [m for m in MODULES if m != "__init__.py"])
def test_module_knows_only_what_lies_below(module):
    here = FLOOR[room_of(module)]
    above = {room for room in known_to(module) if FLOOR[room] > here}
    assert not above


def test_rooms_of_a_floor_make_no_circle():
    graph = {room: set() for room in FLOOR}
    for module in set(MODULES) - {"__init__.py"}:
        graph[room_of(module)] |= known_to(module) - {room_of(module)}
    TopologicalSorter(graph).prepare()  # raises CycleError


def test_modules_make_no_circle():
    """Neither do imports inside of functions: who needs them is not built on what it is needed by."""
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
