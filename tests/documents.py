"""What the documents say, to be checked: code to be run, links, headings, options and files that are named."""

import re
import shlex
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
_FENCED = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def code_blocks(text, language="python"):
    """Blocks of a language in a Markdown text, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands(text):
    """Words behind ``python -m`` of the commands that a Markdown text shows, fenced or indented, on one rank."""
    indented = re.findall(r"(?:^ {4}\S.*\n)(?:^ {4}.*\n)*", _FENCED.sub("", text), re.MULTILINE)
    blocks = "\n".join([*code_blocks(text, "sh"), *indented]).replace("\\\n", " ")
    found = re.findall(r"^\s*(?:mpiexec -n 2 )?python -m (app\..*)$", blocks, re.MULTILINE)
    return [shlex.split(line, comments=True) for line in found if "..." not in line]


def run_blocks(blocks, names=None):
    """Run blocks one after the other with the same names; return these."""
    names = {"__name__": "document"} if names is None else names
    for block in blocks:
        exec(compile(block, block.splitlines()[0], "exec"), names)
    return names


def links(text):
    """Targets of the links and pictures of a Markdown text that lead into the repository: file and anchor."""
    found = re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]*))?\)", _FENCED.sub("", text))
    return [(name, anchor) for name, anchor in found if ":" not in name]


def anchors(text):
    """Anchors that code-hosting sites give the headings of a Markdown text."""
    headings = re.findall(r"^#+ (.*?)$", _FENCED.sub("", text), re.MULTILINE)
    plain = (re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower().strip() for heading in headings)
    return {re.sub(r"[^\w\- ]", "", heading).replace(" ", "-") for heading in plain}


def files_named(text):
    """Files and folders of the repository that a text names with their folder, in code or commands."""
    return set(re.findall(r"(?<![\w./-])(?:app|benchmarks|docs|petsc_options|run|tests)/[\w./-]*\w/?", text))


def options_named(text):
    """Options of app.solve that a text names in code, without dash."""
    code = re.findall(r"`((?:-|python|mpiexec)[^`\n]+)`", text)
    return {name for line in code for name in re.findall(r"(?:^|\s)-([a-z]\w+)", line)}
