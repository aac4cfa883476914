"""Units of length in files, options and messages."""

import math
import re
import unicodedata
from typing import NamedTuple

from app.base.errors import InputError, is_number, plain_number

UNITS = {
    "m": 1e3, "cm": 10.0, "mm": 1.0, "um": 1e-3, "nm": 1e-6, "pm": 1e-9, "angstrom": 1e-7, "in": 25.4
}  # fmt: skip  # [mm]
ALLOWED = f"{', '.join(UNITS)} (µm is um, Å is angstrom)"  # for messages
_LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*([^\W\d_]*)\s*", re.IGNORECASE)


class Unit(NamedTuple):
    """A unit of length: its number per millimetre, and its name."""

    per_mm: float
    name: str


def find_unit(name):
    """Return the name in `UNITS` of a unit, or None if unknown."""
    if isinstance(name, bytes):
        name = name.decode(errors="replace")
    # Two code points mean micro, and two angstrom: NFKC makes them one.
    name = unicodedata.normalize("NFKC", str(name).strip()).replace("\u03bc", "u")
    name = "angstrom" if name in ("Å", "Angstrom") else name
    return name if name in UNITS else None


def unit(text):
    """Return the name of a length unit, from text.

    Examples
    --------
    >>> unit("nm"), unit("µm"), unit("Å")  # either micro sign
    ('nm', 'um', 'angstrom')
    """
    name = find_unit(text)
    if name is None:
        raise ValueError(f"one of {ALLOWED}")
    return name


unit.names = (ALLOWED,)  # for the help


def to_millimetres(text):
    """Convert lengths with units to numbers of mm, in a text.

    The lengths are separated by commas, or are the ends of ranges, ``first:last:n``. Raises ValueError if a unit is
    unknown, or if only some lengths have units. Other texts, such as words, are returned as they are.

    Examples
    --------
    >>> to_millimetres("2um"), to_millimetres("-0.5 mm,1e-3m"), to_millimetres("1um:10um:5:log"), to_millimetres("auto")
    ('0.002', '-0.5,1.0', '0.001:0.01:5:log', 'auto')
    """
    has_unit, parts = set(), []
    for part in text.split(","):
        values = part.split(":")
        for k, length in enumerate(map(_LENGTH.fullmatch, values[:2])):
            if length and (length[2] or float(length[1])):
                has_unit.add(bool(length[2]))
            if length and length[2]:
                name = find_unit(length[2])
                if name is None:
                    raise ValueError(f"a number [mm], or have a unit of {ALLOWED}")
                values[k] = repr(_times(length[1], UNITS[name]))
        parts.append(":".join(values))
    if len(has_unit) > 1:
        raise ValueError("lengths that all have units, or none")
    return ",".join(parts) if True in has_unit else text


def _times(number, factor):
    """Multiply a number, a text, by a factor, so that 0.7 um are 0.0007 mm to the last bit."""
    from decimal import Context  # most runs meet no unit

    exact = Context(prec=60, traps=[])
    return float(exact.multiply(exact.create_decimal(number), exact.create_decimal(str(factor))))


def to_length(name, value):
    """Return the length `name` [mm], a number or a text with a unit, as a float; raise InputError for others.

    Examples
    --------
    >>> to_length("thickness", "2 um"), to_length("thickness", 3)
    (0.002, 3.0)
    """
    value = plain_number(value)
    try:
        if is_number(value):
            return float(value)
        if isinstance(value, str) and (text := to_millimetres(value)) != value:
            return float(text)
    except (ValueError, OverflowError):  # a list of lengths; a huge integer
        pass
    raise InputError(f"{name} {value!r}: must be a number [mm], or have a unit of {ALLOWED}")


def _scale(size, unit):
    """Return factor and name of a unit that makes a number of this size short."""
    scales = _SCALES.get(unit, ()) if 0 < size < math.inf else ()
    return next(((factor, name) for least, factor, name in scales if size >= least), (1.0, unit))


def choose_length_unit(largest):
    """Return a unit that makes lengths up to `largest` [mm] short numbers."""
    return Unit(*_scale(largest, "mm"))


def choose_unit(largest, unit):
    """Return factor and name of a unit for numbers up to `largest`.

    Lengths [mm] and forces [N] have several units; other units are kept.

    Examples
    --------
    >>> choose_unit(3e4, "N"), choose_unit(0.02, "mm"), choose_unit(3e4, "N/mm²")
    ((0.001, 'kN'), (1000.0, 'µm'), (1.0, 'N/mm²'))
    """
    if unit == "mm":
        return _scale(largest, unit)
    return (1e-3, "kN") if unit == "N" and largest >= MIN_KILONEWTONS else (1.0, unit)


MIN_KILONEWTONS = 1e4  # N; smaller forces are in N
_SCALES = {  # unit -> least value, factor and name of others, by decreasing size
    "mm": ((2e4, 1e-3, "m"), (0.2, 1.0, "mm"), (2e-4, 1e3, "µm"), (0.0, 1e6, "nm")),
    "N": ((MIN_KILONEWTONS, 1e-3, "kN"), (0.1, 1.0, "N"), (1e-4, 1e3, "mN"), (0.0, 1e6, "uN")),
    "mm2": ((1e-2, 1.0, "mm2"), (0.0, 1e6, "um2")),
}


def format_quantity(value, unit, digits=4):
    """Format a number in a unit that makes it short, in ASCII.

    `unit` is the unit of `value`; "1" means a number without unit.

    Examples
    --------
    >>> format_quantity(0.0021, "mm"), format_quantity(25300.0, "N"), format_quantity(0.25, "1")
    ('2.1 um', '25.3 kN', '0.25')
    """
    factor, unit = _scale(abs(value), unit)
    name = "" if unit == "1" else f" {unit.replace('µ', 'u')}"
    return f"{value * factor:z.{digits}g}{name}"


def round_to_cell(value, cell):
    """Round a position to about a thousandth of the cell size.

    Examples
    --------
    >>> round_to_cell(2e-10, 0.02), round_to_cell(0.123456789, 0.02), round_to_cell(float("nan"), 1.0)
    (0.0, 0.12346, nan)
    """
    return round(value, 3 - math.floor(math.log10(cell))) + 0.0 if math.isfinite(value) else value


def format_lengths(*lengths, digits=3):
    """Format lengths [mm] with a common unit, in ASCII.

    Examples
    --------
    >>> format_lengths(0.5, 0.48), format_lengths(4e-7)
    ('0.5 x 0.48 mm', '0.4 nm')
    """
    unit = choose_length_unit(max(map(abs, lengths)))
    numbers = " x ".join(f"{length * unit.per_mm:.{digits}g}" for length in lengths)
    return f"{numbers} {unit.name.replace('µ', 'u')}"
