"""Entries of a table in text: numbers, marks of missing points, and groups of digits.

Narrow or no-break spaces, apostrophes, commas and blanks may stand between groups of three digits.
"""

import re

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([ed][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.IGNORECASE)
# Error values of spreadsheets, in English and German.
ERROR = r"#(?:N/A|N/D|NV|DIV/0!|NUM!|ZAHL!|VALUE!|WERT!|REF!|BEZUG!|NAME\?|NULL!)"
_MISSING = re.compile(
    rf"\*+|-+|_+|n/?a|null|none|bad|void|missing|no data|[+-]?1[.,]#\w+|[+-]?nan\(\w+\)|{ERROR}",
    re.IGNORECASE,
)
_MINUS = re.compile(
    r"(?:(?<=[\s;,|&eE$({\[])|^)[\u2010\u2011\u2012\u2013\ufe63\uff0d](?=[\d.,])|\u2212", re.MULTILINE
)
_SPACES = "\u00a0\u2007\u2009\u202f"
_MARKS = f"[{_SPACES}'’]"


def _grouped(mark):
    return rf"[1-9]\d{{0,2}}(?P<mark>{mark})\d{{3}}(?:(?P=mark)\d{{3}})*"


_BY_COMMAS = re.compile(rf"[+-]?{_grouped(',')}")
_BY_BLANKS = re.compile(rf"(?<![^\s+-]){_grouped(' ')}(?![^\s.,])")
_BY_MARKS = re.compile(rf"(?<![\w.,{_SPACES}'’])[+-]?{_grouped(_MARKS)}(?!\d|{_MARKS})")
_MARK = re.compile(rf"(?<=\d){_MARKS}(?=\d)")
# Apostrophes, and spaces in what may be one number: behind a first group of digits, or between decimals.
_POSSIBLE_MARK = re.compile(
    rf"(?<=\d)['’](?=\d)|(?<![\w.,])[1-9]\d{{0,2}}[{_SPACES}]\d{{3}}(?!\d)|[.,]\d{{3}}[{_SPACES}]\d{{1,3}}(?![\d.,])"
)


def is_missing(entry):
    """Return whether an entry marks a missing point."""
    return bool(_MISSING.fullmatch(entry))


def is_number(entry):
    """Return whether an entry is a number with a decimal point, or NaN."""
    return bool(_NUMBER.fullmatch(entry))


def commas_may_group(entries):
    """Return whether all commas in entries may group thousands.

    They may also begin three decimals.
    """
    return all(_BY_COMMAS.fullmatch(entry.strip()) for entry in entries if "," in entry)


def count_grouping_blanks(text):
    """Return the number of single blanks between groups of digits."""
    return sum(match[0].count(" ") for match in _BY_BLANKS.finditer(text))


def use_plain_characters(text, separated):
    """Return a text with plain minus signs and blanks, and with numbers as single groups of digits.

    `separated` is whether something else than special spaces separates the numbers. Raises ValueError if a space or
    apostrophe may stand between groups or between numbers.

    Examples
    --------
    >>> use_plain_characters("\u22121\u202f234.5;2", True)
    '-1234.5;2'
    """
    if text.isascii() and "'" not in text:
        return text
    text = _MINUS.sub("-", text)
    joined = _BY_MARKS.sub(lambda match: match[0].replace(match["mark"], ""), text) if separated else text
    if match := (_MARK if separated else _POSSIBLE_MARK).search(joined):
        raise ValueError(
            f"{joined[max(match.start() - 8, 0) : match.start() + 8]!r}: its space or apostrophe may group thousands "
            "or separate numbers: write numbers without groups, separated by semicolons"
        )
    return re.sub(f"[{_SPACES}]", " ", joined)
