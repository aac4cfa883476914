"""Recipes of CONTRIBUTING.md and docs/extending.md: examples are short, named, and change no more files than said."""

import ast
import io
import re
import tokenize

import pytest
from documents import ROOT, code_blocks, files_named

from extending.conftest import EXAMPLES, changes_of

MOST_LINES = 60
PAGE = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
SECTION = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split("\n## Add\n")[1].split("\n## ")[0]
RECIPES = {text.split("*")[1]: text for text in re.split(r"^- (?=\*)", SECTION, flags=re.MULTILINE)[1:]}
WITHOUT_EXAMPLE = {"A page.", "A technique of the default method."}
EXAMPLE = re.compile(r"tests/extending/(\w+\.\w+)")
each_example = pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)


def code_lines(text):
    """Numbers of the lines that are neither blank nor comments nor docstrings."""
    skipped = (
        tokenize.COMMENT,
        tokenize.NL,
        tokenize.NEWLINE,
        tokenize.INDENT,
        tokenize.DEDENT,
        tokenize.ENDMARKER,
    )
    tokens = [
        token for token in tokenize.generate_tokens(io.StringIO(text).readline) if token.type not in skipped
    ]
    lines = {line for token in tokens for line in range(token.start[0], token.end[0] + 1)}
    for node in ast.walk(ast.parse(text)):
        if (
            isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
            and ast.get_docstring(node) is not None
        ):
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return lines


@each_example
def test_example_is_short(path):
    text = path.read_text(encoding="utf-8")
    lines = code_lines(text) if path.suffix == ".py" else text.splitlines()
    assert len(lines) <= MOST_LINES


@each_example
def test_example_is_named_in_a_recipe(path):
    assert path.name in EXAMPLE.findall(PAGE + SECTION)


@pytest.mark.parametrize("recipe", RECIPES.keys() - WITHOUT_EXAMPLE)
def test_recipe_names_its_examples_and_the_files_that_they_change(recipe):
    text, changes = " ".join(RECIPES[recipe].split()), {path.name: set(changes_of(path)) for path in EXAMPLES}
    # Each sentence: examples, "which changes", and files or "no file"
    sentences = re.findall(r"([^.]*tests/extending/.*?), which changes (.*?)\.(?: |$)", text)
    assert (
        set(EXAMPLE.findall(text))
        == {name for named, _ in sentences for name in EXAMPLE.findall(named)}
        != set()
    )
    for named, files in sentences:
        for name in EXAMPLE.findall(named):
            assert changes[name] == (set() if files == "no file" else files_named(files)), name


def test_option_of_the_default_method(changed_program):
    script = """
from app import ContactProblem, Grid, Material, SelfAffineSurface, solve
surface = SelfAffineSurface(0.8, 0.25, 1 / 16, (1.0, 1.0), 3, rms_slope=0.1)
grid, steel = Grid.from_domain(64, 64, (0, 1, 0, 1)), Material.isotropic(210e3, 0.3)
problem = ContactProblem(grid, steel, surfaces=[surface])
counts = [solve(problem, load=300, options={"lcp_released": x}).operator_applications for x in (0, 0.01, 1)]
assert counts[1] == solve(problem, load=300).operator_applications and len(set(counts)) > 1, counts
solve(problem, load=300, method="norm", options={"lcp_released": 1})
"""
    done = changed_program("-W", "ignore", "-c", script)
    error = "InputError: -lcp_released 1: has no effect here; allowed with -lcp_type fast only"
    assert done.stderr.splitlines()[-1].endswith(error), done.stderr


def test_check(changed_program):
    done = changed_program("-m", "app.verify", "-o", "out", "--only", "energy", "--quick")
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    assert "pass  energy: 3 limits" in done.stdout


def test_shape(changed_program):
    command = "-m", "app.solve", "-problem", "wedge", "-wedge_angle", "1", "-contact_modulus", "1e4"
    done = changed_program(
        *command, "-grid", "64,16", "-domain", "-1,1,0,0.5", "-periodic", "y", "-load", "25"
    )
    assert done.returncode == 0 and ": solved (" in done.stdout, done.stderr
    area = float(re.search(r"contact area ([\d.]+)", done.stdout)[1])
    # A wedge of the slope tan(1 degree) is in contact on the half width load / (E* slope) per length.
    assert area == pytest.approx(2 * 25 / (1e4 * 0.017455), rel=0.1)


def test_method(changed_program):
    solve = "print(solve(hertz, approach=0.1091, method='minres').converged)"
    block = next(block for block in code_blocks(PAGE) if "hertz =" in block).split("smoother =")[0]
    done = changed_program("-c", f"{block}\n{solve}")
    assert done.stdout == "True\n", done.stderr
