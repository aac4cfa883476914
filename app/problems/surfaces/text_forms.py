r"""Tables in the notation of other programs, as plain rows of numbers.

- LaTeX: cells between ``&``, rows that end with ``\\``, lines and environments around them;
- Markdown, Org and grid tables: cells between ``|``, lines of ``---``;
- nested brackets of JSON, Python, numpy, Mathematica and C, and matrices ``[1 2; 3 4]`` of MATLAB and Julia;
- ``sep=;`` in the first line, as spreadsheets write it;
- typographic minus signs and groups of thousands, of `app.problems.surfaces.text_numbers`.

A text that could be read in two ways is refused.
"""

import re
from itertools import pairwise

from app.base.errors import shorten
from app.problems.surfaces.text_numbers import is_missing, is_number, use_plain_characters

_FACTOR = re.compile(r"[\d.]+e[+-]?\d+\s*\*", re.IGNORECASE)
_SEP_LINE = re.compile(r'"?sep=(.?)"?', re.IGNORECASE)
_BRACES = r"\{(?:[^{}]|\{[^{}]*\})*\}"
# Commands around the rows of a LaTeX table; the first alternative has columns as its second argument.
_LATEX_FRAME = re.compile(
    rf"\\begin\s*\{{(?:tabular\*?|tabularx|longtable|array)\}}(?:\[[^\]]*\]|{_BRACES})*|\\(?:begin|end)\s*{_BRACES}|"
    r"\\(?:hline|toprule|midrule|bottomrule|centering|left\s*[(\[|]|right\s*[)\]|]|\[|\]|[()])|"
    rf"\\(?:cline|cmidrule(?:\([^)]*\))?)\s*{_BRACES}"
)
_LATEX_ROW_END = re.compile(r"\\\\(?:\*|\s*\[[\d.]+\s*\w+\])?")  # maybe with a space below, such as [2pt]
_LATEX_POWER = re.compile(r"\s*\\(?:times|cdot)\s*10\s*\^\s*\{?\s*([+-]?\d+)\s*\}?")
# A name, and a function that changes neither values nor places.
_PREFIX = re.compile(
    r"(?:[A-Za-z_][\w.: ]*(?:\[\d*\])*\s*:?=)?\s*(?:(?:(?:np|numpy)\.)?(?:array|asarray|matrix|Matrix)\s*\()?\s*"
)
_SUFFIX = re.compile(r"\s*(?:,\s*dtype\s*=\s*[\w.'\"]+\s*)?\)?\s*[;.]?\s*")
_INNER = {"[": re.compile(r"\[([^\[\]{}]*)\]"), "{": re.compile(r"\{([^\[\]{}]*)\}")}
_CLOSING = {"[": "]", "{": "}"}
_NO_NUMBERS = {"", *"+-*_"}  # in brackets
_CONTINUED = re.compile(r"\.\.\.[ \t]*\n")
_SEPARATED = re.compile(r"\S[ \t;|]+\S")
_SEPARATORS = ";,|\t"  # that spreadsheets may state


def plain_rows(rows):
    r"""Return plain rows of a table, and the separator that its notation states.

    `rows` are pairs of line number and text, as in the result. The separator is None if the notation states none.
    Raises ValueError if the notation is known, but the table is not plain.

    Examples
    --------
    >>> plain_rows([(1, "{{1., 2.}, {3., 4.*^-3}}")])
    ([(1, '1.;2.'), (1, '3.;4.e-3')], ';')
    >>> plain_rows([(4, r"0,5 & $-1{,}5$ \\ \hline")])
    ([(4, '0,5;-1,5')], ';')
    """
    text = written = "\n".join(text for _, text in rows)
    separator = None
    if is_latex := "&" in text and "\\\\" in text:
        text = text.replace("\\,", "\u2009").replace("~", "\u00a0")
    separated = bool(_SEPARATED.search(text)) or ("," in text and "." in text)
    text = use_plain_characters(text, is_latex or (separated and not re.search(r"[\[{]", text)))
    texts = text.split("\n")
    if text != written:
        rows = [(j, line.strip(" ")) for (j, _), line in zip(rows, texts, strict=True)]
    if match := _SEP_LINE.fullmatch(texts[0]):
        separator, rows = match[1] or "\t", rows[1:]
        if separator not in _SEPARATORS or not any(separator in text for _, text in rows):
            raise ValueError(f"line {texts[0]!r}: no line has this separator; must be one of ; , | or a tab")
    elif is_latex:
        rows, separator = _latex_rows(rows), ";"
    elif "|" in text and all("|" in text or _is_rule(text) for text in texts):
        rows, separator = _pipe_rows(rows), ";"
    elif (found := _bracket_rows(rows)) is not None:
        rows, separator = found, ";"
    elif any(_FACTOR.fullmatch(text) for text in texts):
        raise ValueError("MATLAB's display with a common factor: write all digits, as by writematrix")
    elif all(text.startswith("- ") for text in texts):
        raise ValueError("its lines begin with '- ', as lists of YAML: write rows of numbers")
    return rows, separator


def _latex_rows(rows):
    lines = [(j, re.sub(r"(?<!\\)%.*", "", text)) for j, text in rows]
    found, row, start = [], "", lines[0][0]
    for j, text in lines:
        *ended, rest = (_LATEX_FRAME.sub(" ", piece) for piece in _LATEX_ROW_END.split(text))
        for piece in ended:
            found.append((start if row.strip() else j, row + piece))
            row = ""
        start = start if row.strip() else j
        row += f" {rest}"
    found.append((start, row))
    return [
        (j, ";".join(_latex_number(j, cell) for cell in text.split("&"))) for j, text in found if text.strip()
    ]


def _latex_number(j, cell):
    number = _LATEX_POWER.sub(r"e\1", re.sub(r"\\num\s*\{([^{}]*)\}", r"\1", cell.replace("$", "")))
    number = number.replace("{,}", ",").replace("{-}", "-").strip()
    number = number[1:-1] if re.fullmatch(r"\{[^{}]*\}", number) else number
    if re.search(r"[\\{}^&;]", number):
        raise ValueError(
            f"line {j}: {shorten(cell.strip())!r} in a LaTeX table is no plain number; keep the rows of numbers, "
            "with & between cells and \\\\ at the end"
        )
    return number


def _pipe_rows(rows):
    if all("||" in text for _, text in rows):  # as in MediaWiki, or a column without any number
        raise ValueError(
            "'||' on all lines may separate two cells, or enclose an empty one: write single '|'"
        )
    # An unmarked line of dashes may be a row of missing points, except below the first row.
    marked = [_is_rule(text) and bool(set("+:=") & set(text)) for _, text in rows]
    rules = [mark or (k == 1 and not marked[0] and _is_rule(rows[1][1])) for k, mark in enumerate(marked)]
    top = rules.index(False) if False in rules else len(rules)
    rows, rules = rows[top:], rules[top:]
    # Grid tables without a head have lines between all rows.
    if rules[1:2] == [True] and (not top or "=" in rows[1][1] or (False, False) in pairwise(rules)):
        (j, head), rows, rules = rows[0], rows[1:], rules[1:]
        if any(map(_may_be_height, head.split("|"))):
            raise ValueError(
                f"line {j}: numbers in the head of a table in Markdown: if they are heights, remove the line of "
                "dashes below; if names of columns, remove the head"
            )
    return [
        (j, re.sub(r"\s*\|\s*", ";", re.sub(r"^\||\|$", "", text)).strip())
        for (j, text), rule in zip(rows, rules, strict=True)
        if not rule
    ]


def _is_rule(text):
    return set("-=+|: ") >= set(text) and ("--" in text or "==" in text)


def _may_be_height(cell):
    number = cell.strip().replace(",", ".")
    digits_only = re.search(r"\d", number) and not re.search(r"[^\W\d_]", number)
    return is_number(number) or is_missing(number) or digits_only


def _bracket_rows(rows):
    """Return the rows of a matrix in brackets; None if the text is no such matrix."""
    text = "\n".join(text for _, text in rows)
    if not re.search(r"[\[{]", text):
        return None
    text = re.sub(r"(?m)^- (?=\[)", "", text)  # YAML
    body = text[_PREFIX.match(text).end() :]
    opening = body[:1]
    bracket = _CLOSING.get(opening, "\0")
    closing = body.rfind(bracket)
    if closing < 0 or not _SUFFIX.fullmatch(body[closing + 1 :]):
        is_head = bracket in rows[0][1] and bracket not in rows[-1][1]  # such as [mm]
        if opening == text[0] in _CLOSING and not is_head:
            raise ValueError(f"{shorten(text)!r}: its brackets enclose no matrix; keep one matrix only")
        return None
    parts, body = [], body[: closing + 1]
    if body.count(opening) == 1:  # of MATLAB
        body = _CONTINUED.sub(" ", body)
        parts = [part for part in re.split(r"[;\n]" if ";" in body else ";", body[1:-1]) if part.strip()]
        rest = ""
    else:
        rest = _INNER[opening].sub(lambda match: parts.append(match[1]) or "", body)
    if re.search(r"\.\.\.|…", body):
        raise ValueError("the matrix in brackets is abbreviated (...): write all its numbers")
    if len(parts) == 1 and "\n" in parts[0].strip():
        raise ValueError(
            "one pair of brackets: its lines may be rows or one long row: separate rows by semicolons"
        )
    if not parts or not re.fullmatch(r"[\[{]?[\s,]*[\]}]?", rest) or not all(part.strip() for part in parts):
        raise ValueError(
            f"{shorten(text)!r}: must be one matrix: rows in brackets, within one pair of brackets; keep it alone"
        )
    found = [_bracket_numbers(k, part) for k, part in enumerate(parts, 1)]
    for k, numbers in enumerate(found, 1):
        if len(numbers) != len(found[0]):
            raise ValueError(
                f"row {k} of the matrix in brackets has {len(numbers)} numbers, row 1 has {len(found[0])}"
            )
    return [(rows[0][0], ";".join(numbers)) for numbers in found]


def _bracket_numbers(k, text):
    text = re.sub(r",\s*$", "", text)
    if "`" in text or "*^" in text:  # of Mathematica
        text = re.sub(r"`[\d.]*", "", text).replace("*^", "e")
    numbers = [number for part in text.split(",") for number in part.split() or [""]]
    wrong = next((number for number in numbers if number in _NO_NUMBERS or ";" in number), None)
    if wrong is not None:
        raise ValueError(
            f"row {k} of the matrix in brackets: {wrong!r} is no number; must be numbers, separated by commas or blanks"
        )
    return numbers
