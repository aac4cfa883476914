"""README.md, CONTRIBUTING.md and docs/: what they link to and name is there, and what is there can be found."""

import ast
import re

import options_page
import pytest
from documents import PAGES, ROOT, anchors, files_named, links, options_named

from app.cli.law import ARGUMENTS as LAW_ARGUMENTS
from app.cli.problem_options import PROBLEM_OPTIONS
from app.options.method import METHOD_OPTIONS, PART_OPTIONS, find_method_file

DOCS = ROOT / "docs"
NOTEBOOK = set(DOCS.glob("notebook/*.md"))
CHANGES = ROOT / "CHANGELOG.md"
TEXT = {page: page.read_text(encoding="utf-8") for page in (*PAGES, CHANGES)}
NAV = next(
    ast.literal_eval(node.value)
    for node in ast.parse((DOCS / "conf.py").read_text(encoding="utf-8")).body
    if isinstance(node, ast.Assign) and node.targets[0].id == "NAV"
)
KNOWN = {option.name for option in (*METHOD_OPTIONS, *PART_OPTIONS, *PROBLEM_OPTIONS, *LAW_ARGUMENTS)}
OTHERS = {"fp_trap", "options_file", "o", "skip_petscrc", "help", "citations", "cone_slope"}
OTHERS |= {"contact_area", "contact_area_path"}  # of an example
PETSCS = re.compile(
    r"((punch_|gear_|flow_)?(ksp|pc)|mg_levels|mg_coarse|snes|log|malloc|objects|options|prefix|on_error)_\w*|info|citations"
)
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)


@pytest.mark.parametrize("page", TEXT, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for name, anchor in links(TEXT[page]):
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), name
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target.read_text(encoding="utf-8")), f"{name}#{anchor}"
        elif anchor:
            assert int(anchor.removeprefix("L")) <= len(target.read_text(encoding="utf-8").splitlines())


@each_page
def test_files_named_are_there(page):
    there = {name for name in files_named(TEXT[page]) if (ROOT / name).exists()}
    assert files_named(TEXT[page]) - there <= {"petsc_options/NAME.opts"}


@each_page
def test_options_named_are_there(page):
    named = {name for name in options_named(TEXT[page]) if not PETSCS.fullmatch(name)}
    assert named - OTHERS <= KNOWN


def linked(page):
    """Files that a page links to."""
    return {(page.parent / name).resolve() for name, _ in links(TEXT[page])}


def test_every_page_is_in_the_menu_and_two_clicks_from_the_readme():
    in_menu = {(DOCS / f"{page}.md").resolve() for pages in NAV.values() for page in pages}
    assert in_menu == {*DOCS.glob("*.md"), ROOT / "CONTRIBUTING.md", CHANGES} - {DOCS / "index.md"}
    first = (ROOT / "README.md", DOCS / "index.md", DOCS / "speed.md")
    assert set(first[1:]) <= linked(first[0])
    assert in_menu <= {page for place in first for page in linked(place)}


def test_the_first_page_of_the_notebook_leads_to_the_others():
    index = DOCS / "notebook/index.md"
    assert index in linked(DOCS / "index.md")
    assert NOTEBOOK - {index} == {page for page in linked(index) if page.parent == index.parent}


def test_names_in_the_glossary_are_in_the_code():
    program = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "app").rglob("*.py"))
    rows = [line.split("|") for line in TEXT[DOCS / "glossary.md"].splitlines() if "`" in line]
    names = {name for row in rows for name in re.findall(r"`([a-zA-Z_]+)`", row[-2])}
    assert {name for name in names if not re.search(rf"\b{name}\b", program)} == set()
    assert all(row[-3].strip().endswith(".") for row in rows)


def test_parameters_that_share_a_description_share_a_unit():
    """The reference prints the description under each of their names."""
    several = re.compile(r"^( *)\w+(?:, \w+)+ : .*\n((?:\1 +.*\n)+)", re.MULTILINE)
    for path in sorted((ROOT / "app").rglob("*.py")):
        for section in re.findall(r"\n +Parameters\n +-+\n((?:.+\n)+)", path.read_text("utf-8")):
            for _, description in several.findall(section):
                assert len(set(re.findall(r"\[[^]]+\]", description))) < 2, f"{path.name}: {description}"


def test_readme_fits_a_screen():
    assert len(TEXT[ROOT / "README.md"].splitlines()) <= 80


def test_every_option_file_has_its_row():
    told = {
        name
        for page in ("methods", "commands")
        for name in re.findall(r"`(\w+)\.opts`", TEXT[DOCS / f"{page}.md"])
    }
    assert told == {path.stem for path in find_method_file("fast").parent.glob("*.opts")}


def test_page_of_options_is_today_s():
    assert TEXT[options_page.PAGE] == options_page.page(), "python tests/options_page.py writes it anew"


def test_page_of_options_has_every_option():
    for name in KNOWN:
        assert TEXT[options_page.PAGE].count(f"| `-{name}` |") == 1, name


def test_page_of_options_has_every_command():
    named = re.findall(r"\| `python -m (app\.\w+)", TEXT[DOCS / "commands.md"])
    assert {"app.solve", *options_page.commands()} == set(named)


def test_what_is_wrong_is_noticed():
    text = "# A (b)\n\n[x](gone.md#there) `app/gone.py` `-lcp_gone 1` run/gone [y](https://z.org/q)\n```\n[k](l)\n```\n"
    assert links(text) == [("gone.md", "there")]
    assert anchors(text) == {"a-b"}
    assert files_named(text) == {"app/gone.py", "run/gone"}
    assert options_named(text) == {"lcp_gone"}
