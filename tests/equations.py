"""The table of docs/equations.md: which line of the program does which equation or step of the paper.

A row names the paper's equation or step, what it says, file and line, the function or class around the line, and the
words by which the line is found. The last two say where the line is; its number is written by

    python tests/equations.py
"""

import ast
import re
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "docs" / "equations.md"
_ROW = re.compile(
    r"\| (?P<paper>.*?) \| .* \| \[(?P<link>.*?)\]\(.*?\) \| `(?P<name>.*?)` \| `(?P<words>.*?)` \|"
)


@dataclass(frozen=True)
class Row:
    """A row of the table."""

    paper: str
    path: str
    line: int
    name: str
    words: str

    def found_in(self):
        """Number of the line that the row means: the first one of the function or class with the words.

        Raises
        ------
        LookupError
            If there is none.
        """
        text = (ROOT / self.path).read_text(encoding="utf-8")
        node = ast.parse(text)
        for part in self.name.split("."):
            inside = (n for n in ast.walk(node) if getattr(n, "name", None) == part and hasattr(n, "body"))
            node = next(inside, None)
            if node is None:
                raise LookupError(f"{self.paper}: {self.path} has no {self.name}")
        lines = text.splitlines()
        for number in range(node.lineno, node.end_lineno + 1):
            if self.words in lines[number - 1]:
                return number
        raise LookupError(f"{self.paper}: {self.name} in {self.path} does not say {self.words!r}")


def rows(text):
    """Rows of the table in a text."""
    for line in text.splitlines():
        match = _ROW.fullmatch(line)
        if match:
            path, number = match["link"].rsplit(":", 1)
            yield Row(match["paper"], path, int(number), match["name"], match["words"])


def renumbered(text):
    """Return the text with the line numbers of today."""
    lines = []
    for line in text.splitlines(keepends=True):
        for row in rows(line):
            number = row.found_in()
            line = line.replace(
                f"[{row.path}:{row.line}](../{row.path}#L{row.line})",
                f"[{row.path}:{number}](../{row.path}#L{number})",
            )
        lines.append(line)
    return "".join(lines)


if __name__ == "__main__":
    try:
        new = renumbered(TABLE.read_text(encoding="utf-8"))
    except LookupError as error:
        sys.exit(f"error: {error}")
    TABLE.write_text(new, encoding="utf-8")
