"""Tables of numbers in text.

All lines of a text have the same layout. Numbers are separated by the first of these that applies:

- semicolons, or tabs if all blanks are beside tabs; commas are then decimal commas, and a comma and a point are an
  error,
- commas, if some numbers have points, or if a blank follows every comma,
- blanks; commas are then decimal commas,
- commas without blanks, if they cannot be decimal commas.

If commas outside of quotes separate, commas in quotes are decimal commas. Exponents may begin with D, as in Fortran.
"""

import re

import numpy as np

from app.base.errors import shorten
from app.problems.surfaces.text_forms import plain_rows
from app.problems.surfaces.text_numbers import (
    ERROR,
    commas_may_group,
    count_grouping_blanks,
    is_missing,
    is_number,
)

_NO_DATA = re.compile(r"\bno data\b", re.IGNORECASE)
_COMMA_NAN = re.compile(r"\b1,#(?=IND|INF|[QS]?NAN)")  # 1.#QNAN with a decimal comma
# A line that begins so is no comment.
_ERROR_FIRST = re.compile(rf'\s*"?{ERROR}"?(?![^\s;,])')
_NO_DATA_VALUE = re.compile(r"\s*nodata_value\s+(\S+)", re.IGNORECASE)
_NUMBER_CHARACTERS = frozenset("0123456789+-.,;eE \t")
_FORTRAN_EXPONENT = re.compile(r"(?<=[\d.])[dD](?=[+-]?\d)")
_QUOTED = re.compile(r'"([^"\n]*)"')
_COMMA_AT_QUOTE = re.compile(r"^ *,|, *$")
_BLANK = re.compile(r"(?<=\S) (?=\S)")  # within an entry between tabs
# Commas may begin decimals if so many different negative numbers stand before every second comma, and none behind it.
MIN_SIGNED_INTEGERS = 8


class UnknownText(ValueError):
    """Error for a file that is no text in a known format.

    `is_text` is False if the file is no text.
    """

    def __init__(self, message, is_text=True):
        super().__init__(message)
        self.is_text = is_text


def is_comment(line):
    """Return whether a line is a comment, beginning with # or %.

    A line that begins with an error value of a spreadsheet, such as #N/A, is not a comment.
    """
    return line.lstrip().startswith(("#", "%")) and not _ERROR_FIRST.match(line)


def is_row(line):
    """Return whether a line has only numbers and missing points."""
    return bool(line.strip()) and not is_comment(line) and _first_word(line, heights=True) is None


def read_table(lines, skip=0, heights=False):
    """Return a table's numbers as a 2-D array.

    The first `skip` lines are left out. If `heights` is true, missing points are NaN: entries like ``***``, empty
    entries, and the number in a skipped line ``NODATA_value``. Raises UnknownText if only the head has words. Raises
    ValueError if a line has other entries or another length, or can be read in two ways.

    Examples
    --------
    >>> read_table(["x y", "0,5 1,5", "*** 2"], skip=1, heights=True)
    array([[0.5, 1.5],
           [nan, 2. ]])
    """
    rows = [
        (j, line.strip(" \r"))
        for j, line in enumerate(lines, 1)
        if j > skip and line.strip() and not is_comment(line)
    ]
    if not rows:
        raise ValueError("it is empty")
    rows, stated = plain_rows(rows)
    if not rows:
        raise ValueError("it has no numbers")
    numbers, texts = zip(*rows, strict=True)
    if heights:
        texts = [_NO_DATA.sub("nan", text) if "data" in text.lower() else text for text in texts]
    _check_head(numbers, texts, heights)
    texts = [_FORTRAN_EXPONENT.sub("e", text) if "d" in text.lower() else text for text in texts]
    texts = _unquote(texts)
    separator, decimal_commas = _find_layout(texts, stated)
    if decimal_commas and commas_may_group(entry for text in texts for entry in text.split(separator)):
        raise ValueError("all commas may begin three decimals or group thousands: write decimal points")
    if separator and separator != "\t":
        texts = [text.rstrip() for text in texts]
    if separator and all(text.endswith(separator) for text in texts):
        texts = [text[:-1] for text in texts]
    _check_rim(numbers, texts, separator)
    table = []
    for j, text in zip(numbers, texts, strict=True):
        entries = text.split(separator)
        if table and len(entries) != len(table[0]):
            skipping = ", or are skipped at the head" if heights else ""
            raise ValueError(
                f"line {j} has {len(entries)} entries, line {numbers[0]} has {len(table[0])}; must be lines of "
                f"numbers, a row of cells each; others begin with #{skipping}"
            )
        if decimal_commas:
            entries = [entry.replace(",", ".", 1) for entry in entries]
        try:
            table.append(np.array(entries, float))
        except ValueError:
            table.append(np.array([_number(entry, j, i, heights) for i, entry in enumerate(entries, 1)]))
    table = np.array(table)
    _check_blocks(numbers, table.shape[1])
    for j, line in enumerate(lines[:skip] if heights else (), 1):
        if match := _NO_DATA_VALUE.match(line):
            table[table == _number(match[1], j, 2, heights)] = np.nan
    return table


def _check_head(numbers, texts, heights):
    """Raise if words precede the first row of numbers.

    The message says how many lines to skip.
    """
    first = next((k for k, text in enumerate(texts) if _first_word(text, heights) is None), 0)
    if numbers[first] == numbers[0]:  # one line may have several rows
        return
    skip = numbers[first] - 1
    advice = "lines that are no row of cells begin with #"
    if heights:
        head = f"{skip} lines" if skip > 1 else "line"
        advice = (
            f"skip the {head} at the head by skip={skip} (-surface_skip {skip}, app.convert --skip {skip}), "
            "or begin them with #"
        )
    # Words further down may be the head of another map.
    refusal = ValueError if any(_first_word(text, heights) for text in texts[first:]) else UnknownText
    word = _first_word(texts[0], heights)
    raise refusal(f"line {numbers[0]}: {shorten(word)!r} is no number; {advice}")


def _check_blocks(numbers, columns):
    """Raise if empty or other lines divide the rows into equal blocks.

    The blocks may be several maps.
    """
    starts = np.flatnonzero(np.diff(numbers, prepend=-1) > 1)
    rows = np.diff(starts, append=len(numbers))
    if columns != 3 and len(rows) > 1 and rows[0] > 1 and (rows == rows[0]).all():
        raise ValueError(
            f"it has {len(rows)} blocks of {rows[0]} lines, the second one from line {numbers[starts[1]]}: keep one "
            "map, or remove the empty lines and comments between rows of the same map"
        )


def _check_rim(numbers, texts, separator):
    """Raise if the first or last row or column is empty, as spreadsheets write cells beside a table."""
    if not separator:
        return
    first, last = (not text.strip(f"{separator} ") for text in (texts[0], texts[-1]))
    if first or last:
        raise ValueError(
            f"line {numbers[0 if first else -1]} has no numbers; remove it, or write nan for missing points"
        )
    for name, empty in (("first", str.startswith), ("last", str.endswith)):
        if all(empty(text.strip(" "), separator) for text in texts):
            raise ValueError(f"the {name} column has no numbers; remove it, or write nan for missing points")


def _unquote(lines):
    """Replace commas in quotes by points, and other commas by semicolons."""
    text = "\n".join(lines)
    if '"' not in text:
        return lines
    outside, entries = _QUOTED.split(text)[::2], _QUOTED.findall(text)
    if re.search("[;\t]", "".join(outside)) or not any(map(_COMMA_AT_QUOTE.search, outside)):
        return text.replace('"', "").splitlines()
    commas = [entry for entry in entries if "," in entry]
    if commas and ("." in text or commas_may_group(commas)):
        raise ValueError(
            f"the comma in {commas[0][:40]!r} may begin decimals or group thousands: write decimal points"
        )
    parts = zip(outside, [*entries, ""], strict=True)
    return "".join(part.replace(",", ";") + entry.replace(",", ".") for part, entry in parts).splitlines()


def _first_word(line, heights):
    """Return the first entry that is never a number.

    None if there is no such entry.
    """
    if _NUMBER_CHARACTERS.issuperset(line):
        return None
    for entry in re.split(r'[\s;,"]+', _COMMA_NAN.sub("1.#", line)):
        if entry and not is_number(entry) and not (heights and is_missing(entry)):
            return entry
    return None


def _find_layout(lines, stated=None):
    """Return the separator of numbers, and whether commas are decimal commas.

    `stated` is the separator, if the text states it.
    """
    text = "\n".join(lines)
    points, commas = "." in text, text.count(",")
    separator = ";" if ";" in text else stated
    if "\t" in text and not separator and not re.search(r",[ \t]*\t", text):
        blanks = len(_BLANK.findall(text))
        if blanks and blanks == count_grouping_blanks(text):
            raise ValueError("numbers are separated by tabs, and blanks group thousands: remove these blanks")
        separator = None if blanks else "\t"
    if separator and separator != ",":
        if points and commas:
            raise ValueError("numbers have both points and commas: write decimals in one way")
        return separator, bool(commas)
    if separator:
        return ",", False
    if not commas:
        return None, False
    blanks = re.search(r"\S[ \t]+\S", text)
    commas_at_blanks = len(re.findall(r",(?=[ \t]|$)|[ \t],", text, re.MULTILINE))
    if points and blanks and not commas_at_blanks:
        raise ValueError(
            "numbers are separated by blanks and have both points and commas: write decimals in one way"
        )
    if points or commas_at_blanks == commas:
        return ",", False
    if blanks and commas_at_blanks:
        raise ValueError(
            "commas with and without a blank behind: they may be separators or begin decimals; separate numbers by "
            "semicolons, or write decimal points"
        )
    if not blanks:
        _check_commas_separate(lines)
    return (None, True) if blanks else (",", False)


def _check_commas_separate(lines):
    """Raise if separators may be decimal commas."""
    rows = [line.rstrip(",").split(",") for line in lines]
    if any(len(row) % 2 for row in rows):
        return
    integers, decimals = ({entry.strip() for row in rows for entry in row[k::2]} for k in (0, 1))
    powers = "e" in "".join(decimals).lower() and "e" not in "".join(integers).lower()
    decimals = {re.split("[eE]", entry)[0] for entry in decimals}
    if not all(entry.isdigit() for entry in decimals):
        return
    lengths, digits = ({len(entry.lstrip("+-")) for entry in part} for part in (integers, decimals))
    if (
        powers
        or any(len(entry) > 1 and entry.startswith("0") for entry in decimals)
        or "-0" in integers
        or integers <= {"0", "+0"}
        or (len(digits) == 1 and digits != {1} and digits != lengths)
        or sum(entry.startswith("-") for entry in integers) >= MIN_SIGNED_INTEGERS
    ):
        raise ValueError(
            f"line of {shorten(lines[0])!r}: commas may separate numbers or begin their decimals; separate numbers by "
            "semicolons, tabs or blanks, or write decimal points"
        )


def _number(entry, j, i, heights):
    """Return the value of an entry in row j and column i.

    If `heights` is true, an entry for a missing point is NaN.
    """
    entry = entry.strip()
    if heights and (not entry or is_missing(entry)):
        return np.nan
    try:
        return float(entry)
    except ValueError:
        missing = "missing points" if heights else "cells where contact is impossible"
        raise ValueError(
            f"line {j}, entry {i}: {shorten(entry)!r} is no number; must be numbers, and nan for {missing}"
        ) from None
