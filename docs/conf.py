"""The documentation site: run/docs. A page is a Markdown file and a line in `NAV`.

The pages are written for code-hosting sites, too: plain Markdown with relative links, from the root of the repository
on, which is the source folder. What a site needs besides is added here: the tree of pages, and web pages of the program
files that are linked to, with numbered lines.
"""

import re
from pathlib import Path

from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import TextLexer, get_lexer_for_filename
from pygments.util import ClassNotFound

ROOT = Path(__file__).resolve().parents[1]
NAV = {  # heading -> page -> its name there; None: that of the page
    "Begin": {
        "install": None,
        "cluster": "On a cluster",
        "tutorial": None,
        "gallery": None,
        "faq": "Questions",
    },
    "Guide": {
        "python": None,
        "jupyter": None,
        "commands": None,
        "command-line": None,
        "surfaces": "Surfaces and materials",
        "load-paths": "Load curves",
        "periodic": None,
        "tilt": "Moments and tilt",
        "hardness": "Hardness and unloading",
        "layers": None,
        "conductance": None,
        "creep": None,
        "slip": None,
        "wear": None,
        "flow": None,
        "law": None,
        "sensitivities": None,
        "methods": None,
        "operator": "The operator as a Mat",
        "results": None,
    },
    "Reference": {"options": None, "api": "Python"},
    "Theory": {"theory": "The problem", "glossary": None, "equations": None},
    "Verification and speed": {
        "verification": None,
        "contact-mechanics-challenge": "Contact Mechanics Challenge",
        "speed": None,
        "comparison": None,
        "coming-from": "Coming from ...",
        "paper": "Summary for a journal",
    },
    "Develop": {
        "extending": None,
        "../CONTRIBUTING": None,
        "architecture": None,
        "../CHANGELOG": None,
    },
}

project = "Elastic contact by full multigrid"
author = "The elastic-contact-fmg developers"
root_doc = "docs/index"
NOTEBOOK = "docs/notebook/"  # pages that are linked to, but are neither in the menu nor searched
include_patterns = ["docs/*.md", f"{NOTEBOOK}*.md", "CONTRIBUTING.md", "CHANGELOG.md"]
exclude_patterns = [".*"]
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax"]
html_theme = "furo"
html_static_path = ["site.css"]
html_css_files = ["site.css"]
html_search_scorer = str(ROOT / "docs/scorer.js")  # guides before everything else
html_title = project
html_copy_source = False
html_show_sourcelink = False
myst_heading_anchors = 3
myst_enable_extensions = ["dollarmath"]  # formulas of theory.md
suppress_warnings = ["ref.python"]  # names of types that several classes have
toc_object_entries_show_parents = "hide"
default_role = "code"  # single backticks in docstrings
autodoc_default_options = {"members": True, "member-order": "bysource", "show-inheritance": True}
autodoc_typehints = "none"  # the docstrings say more
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

_LINK = re.compile(r"(?<!!)\[([^]]*)\]\(([^)#\s]+)(?:#([^)\s]*))?\)")


class Sources:
    """Links of pages to files of the program, and the pages of these files."""

    def __init__(self):
        self.names = set()

    def read(self, app, docname, source):
        """Change the text of a page before it is parsed."""
        folder = (ROOT / docname).parent

        def changed(link):
            text, name, anchor = link.groups()
            path = (folder / name).resolve()
            if ":" in name or not path.is_file() or path.suffix in (".md", ".csv", ".png", ".ipynb"):
                return link[0]
            self.names.add(path.relative_to(ROOT))
            line = f"#line-{anchor[1:]}" if anchor else ""
            return f'<a href="{name}.html{line}">{text.replace("`", "")}</a>'

        source[0] = _LINK.sub(changed, source[0])
        if docname.startswith(NOTEBOOK):
            source[0] = f"---\norphan: true\nnosearch: true\n---\n{source[0]}"
        if docname == root_doc:
            source[0] += "".join(self.tree(heading, pages) for heading, pages in NAV.items())

    @staticmethod
    def tree(heading, pages):
        """Part of the tree of pages."""
        lines = [f"{name} <{page}>" if name else page for page, name in pages.items()]
        return "\n".join(["\n```{toctree}", ":hidden:", f":caption: {heading}", *lines, "```\n"])

    def write(self, app, error):
        """Write the pages of the files."""
        for name in sorted(self.names) if error is None else ():
            try:
                lexer = get_lexer_for_filename(name.name)
            except ClassNotFound:
                lexer = TextLexer()
            form = HtmlFormatter(
                full=True, title=str(name), linenos="inline", anchorlinenos=True, lineanchors="line"
            )
            page = Path(app.outdir) / f"{name}.html"
            page.parent.mkdir(parents=True, exist_ok=True)
            page.write_text(
                highlight((ROOT / name).read_text(encoding="utf-8"), lexer, form), encoding="utf-8"
            )


def setup(app):
    """Connect all that to Sphinx."""
    sources = Sources()
    app.connect("source-read", sources.read)
    app.connect("build-finished", sources.write)
    return {"parallel_read_safe": False}
