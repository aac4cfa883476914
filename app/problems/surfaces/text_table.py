"""Tables of numbers in text: which characters separate numbers, and which one begins their decimals.

One rule for the whole file, so that no line is read in another way than its neighbours:

==================================  =======================================
the lines have                      they are read as
==================================  =======================================
semicolons                          separated by these, else
tabs and no blanks                  by tabs, else
commas, some numbers have points    by commas, else
commas that blanks follow           by commas, else
commas and blanks                   by blanks; the commas begin decimals
commas only                         by commas, if they cannot be decimal
neither                             by blanks and tabs
==================================  =======================================

Commas between semicolons or tabs begin decimals, unless there are points as well. Commas in quotes begin decimals,
those beside quotes separate. Exponents may begin with D, as Fortran writes them.
"""

from __future__ import annotations

import re

import numpy as np

from app.base.errors import shorten

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([ed][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.IGNORECASE)
# What spreadsheets write instead of a number, in English and German.
_ERROR = r"#(?:N/A|N/D|NV|DIV/0!|NUM!|ZAHL!|VALUE!|WERT!|REF!|BEZUG!|NAME\?|NULL!)"
_MARK = re.compile(
    rf"\*+|-+|_+|n/?a|null|none|bad|void|missing|[+-]?1[.,]#\w+|[+-]?nan\(\w+\)|{_ERROR}", re.IGNORECASE
)  # of missing points
_COMMA_MARK = re.compile(r"\b1,#(?=IND|INF|[QS]?NAN)")  # with a decimal comma
_ERROR_FIRST = re.compile(rf'\s*"?{_ERROR}"?(?![^\s;,])')  # in a line that is no comment
_NO_DATA_VALUE = re.compile(r"\s*nodata_value\s+(\S+)", re.IGNORECASE)  # at the head of an ESRI grid
_NO_DATA = re.compile(r"\bno data\b", re.IGNORECASE)  # one more of them, in two words
_PLAIN = frozenset("0123456789+-.,;eE \t")
_EXPONENT = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")  # as Fortran writes it
_QUOTED = re.compile(r'"([^"\n]*)"')
_COMMA_BESIDE = re.compile(r"^ *,|, *$")  # a quote
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")  # may be thousands, or a decimal comma
_COMMENTS = ("#", "%")
_SIGNS = 8  # different numbers below 0, all before the first comma of two: by chance none stands behind one


class UnknownText(ValueError):
    """The text has words where only a reader of its format can tell what they mean."""


def is_comment(line):
    """True if a line begins with # or %, except for the error values of spreadsheets. Not collective."""
    return line.lstrip().startswith(_COMMENTS) and not _ERROR_FIRST.match(line)


def is_row(line):
    """True if a line has numbers or marks of missing points, and nothing else. Not collective."""
    return bool(line.strip()) and not is_comment(line) and _word_in(line, marks=True) is None


def read_table(lines, missing, skip=0, marks=False, how_to_skip=""):
    """Read the rows of a table.

    Not collective.

    Parameters
    ----------
    lines : list of str
        Empty ones, and those that begin with # or %, do not count.
    missing : str
        What nan stands for, for messages.
    skip : int
        Lines at the head that are none of the table.
    marks : bool
        Whether entries like ``***``, empty ones, and the number that a line ``NODATA_value`` at the head names, are
        missing values (NaN).
    how_to_skip : str
        What a user may do about words at the head, ``{0}``: which lines, ``{1}``: how many; empty: nothing.

    Returns
    -------
    ndarray, shape (rows, columns)

    Raises
    ------
    UnknownText
        If there are words at the head, and nowhere else.
    ValueError
        If a line holds something else, is of another length, or could be read in two ways; it says which.

    Examples
    --------
    >>> read_table(["x y", "0,5 1,5", "*** 2"], "missing", skip=1, marks=True)
    array([[0.5, 1.5],
           [nan, 2. ]])
    """
    numbered = [
        (j, _NO_DATA.sub("nan", line.strip(" \r")) if marks else line.strip(" \r"))
        for j, line in enumerate(lines, 1)
        if j > skip and line.strip() and not is_comment(line)
    ]
    if not numbered:
        raise ValueError("it is empty")
    _refuse_words_at_the_head(numbered, marks, how_to_skip)
    texts = _unquoted(
        [_EXPONENT.sub("e", line) if "d" in line or "D" in line else line for _, line in numbered]
    )
    separator, decimal_commas = _layout(texts)
    if separator and separator != "\t":
        texts = [line.rstrip() for line in texts]
    if separator and all(line.endswith(separator) for line in texts):  # a habit of some programs
        texts = [line[: -len(separator)] for line in texts]
    rows = []
    for (j, _), line in zip(numbered, texts, strict=True):
        row = line.split(separator)
        if rows and len(row) != len(rows[0]):
            raise ValueError(
                f"line {j} has {len(row)} entries, line {numbered[0][0]} has {len(rows[0])}; needed: lines of "
                f"numbers, a row of cells each; others begin with #{how_to_skip and ', or are skipped at the head'}"
            )
        if decimal_commas:
            row = [entry.replace(",", ".", 1) for entry in row]
        try:
            rows.append(np.array(row, float))
        except ValueError:
            rows.append(np.array([_value(entry, j, i, missing, marks) for i, entry in enumerate(row, 1)]))
    table = np.array(rows)
    _refuse_blocks([j for j, _ in numbered], table.shape[1])
    for j, line in enumerate(lines[:skip] if marks else (), 1):
        if said := _NO_DATA_VALUE.match(line):
            table[table == _value(said[1], j, 2, missing, marks)] = np.nan
    return table


def _refuse_words_at_the_head(numbered, marks, how_to_skip):
    """Say how many lines at the head are words, as far as a table follows them."""
    first = next((k for k, (_, line) in enumerate(numbered) if not _word_in(line, marks)), None)
    if first:
        j, line = numbered[0]
        skipped = numbered[first][0] - 1
        what = f"{skipped} lines" if skipped > 1 else "line"
        advice = how_to_skip.format(what, skipped) or "lines that are no row of cells begin with #"
        more = any(_word_in(line, marks) for _, line in numbered[first:])  # perhaps the head of another map
        refusal = ValueError if more else UnknownText
        raise refusal(f"line {j}: {shorten(_word_in(line, marks))!r} is no number; {advice}")


def _refuse_blocks(numbers, columns):
    """Refuse blocks of equally many rows with other lines between them, by the numbers of the lines with rows.

    Points x, y, z may be written so.
    """
    starts = np.flatnonzero(np.diff(numbers, prepend=-1) > 1)
    rows = np.diff(starts, append=len(numbers))
    if columns != 3 and len(rows) > 1 and rows[0] > 1 and (rows == rows[0]).all():
        raise ValueError(
            f"it has {len(rows)} blocks of {rows[0]} lines, the second one from line {numbers[starts[1]]}: keep one "
            "map, or remove the empty lines and comments between rows of the same map"
        )


def _unquoted(lines):
    """Take quotes off. Commas beside quotes become semicolons, those within quotes decimal points."""
    if not any('"' in line for line in lines):
        return lines
    text = "\n".join(lines)
    outside, entries = _QUOTED.split(text)[::2], _QUOTED.findall(text)
    if re.search("[;\t]", "".join(outside)) or not any(map(_COMMA_BESIDE.search, outside)):
        return text.replace('"', "").splitlines()
    commas = [entry for entry in entries if "," in entry]
    if commas and ("." in text or all(_GROUPED.fullmatch(entry.strip()) for entry in commas)):
        raise ValueError(
            f"the comma in {commas[0][:40]!r} may begin decimals or group thousands: write decimal points"
        )
    parts = zip([part.replace(",", ";") for part in outside], [*entries, ""], strict=True)
    return "".join(part + entry.replace(",", ".") for part, entry in parts).splitlines()


def _word_in(line, marks):
    """First entry of a line that is no number, whatever separates numbers; None if all are."""
    if _PLAIN.issuperset(line):
        return None
    for entry in re.split(r'[\s;,"]+', _COMMA_MARK.sub("1.#", line)):
        if entry and not _NUMBER.fullmatch(entry) and not (marks and _MARK.fullmatch(entry)):
            return entry
    return None


def _layout(lines):
    """Separator, None for blanks and tabs, and whether decimals begin with a comma."""
    text = "\n".join(lines)
    points, commas = "." in text, "," in text
    if ";" in text or ("\t" in text and " " not in text):
        if points and commas:
            raise ValueError("numbers have both points and commas: write decimals in one way")
        return ";" if ";" in text else "\t", commas
    if not commas:
        return None, False
    blanks = re.search(r"\S[ \t]+\S", text)
    before_blanks = len(re.findall(r",(?=[ \t]|$)|[ \t],", text, re.MULTILINE))
    if points or before_blanks == text.count(","):
        if points and blanks and not before_blanks:
            raise ValueError(
                "numbers are separated by blanks and have both points and commas: write decimals in one way"
            )
        return ",", False
    if blanks:
        if before_blanks:
            raise ValueError(
                "commas with and without a blank behind: they may be separators or begin decimals; separate numbers by "
                "semicolons, or write decimal points"
            )
        return None, True
    _refuse_if_decimal(lines)
    return ",", False


def _refuse_if_decimal(lines):
    """Refuse ``0,12,0,34``, which may be two numbers or four; whole numbers look otherwise."""
    rows = [line.rstrip(",").split(",") for line in lines]
    if any(len(row) % 2 for row in rows):
        return
    before, behind = ({entry.strip() for row in rows for entry in row[k::2]} for k in (0, 1))
    powers = "e" in "".join(behind).lower() and "e" not in "".join(before).lower()
    behind = {re.split("[eE]", entry)[0] for entry in behind}
    if not all(entry.isdigit() for entry in behind):
        return
    lengths = [{len(entry.lstrip("+-")) for entry in entries} for entries in (before, behind)]
    zeros = any(len(entry) > 1 and entry.startswith("0") for entry in behind) or "-0" in before
    alike = len(lengths[1]) == 1 and lengths[1] != {1} and lengths[0] != lengths[1]
    signs = sum(entry.startswith("-") for entry in before) >= _SIGNS
    if powers or signs or zeros or alike or before <= {"0", "+0"}:
        raise ValueError(
            f"line of {shorten(lines[0])!r}: commas may separate numbers or begin their decimals; separate numbers by "
            "semicolons, tabs or blanks, or write decimal points"
        )


def _value(entry, j, i, missing, marks):
    """Value of an entry in line j, the i-th, both counted from 1."""
    entry = entry.strip()
    if marks and (not entry or _MARK.fullmatch(entry)):
        return np.nan
    try:
        return float(entry)
    except ValueError:
        raise ValueError(
            f"line {j}, entry {i}: {shorten(entry)!r} is no number; needed: numbers, and nan for {missing}"
        ) from None
