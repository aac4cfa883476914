"""The style of all pictures: sizes, colours, units, ticks, files. Nothing here or above it touches pyplot.

So pictures need no display and do not pile up. Not collective: call on one rank.
"""

from __future__ import annotations

from functools import wraps

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from app.output.files import whole_file

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"  # told apart by colour-blind readers
PURPLE, GREY, PALE = "#aa4499", "#c8c8c8", "#cfe3f1"
DASHED, DOTTED = (0, (5, 2)), (0, (1, 1.5))
SERIES = (
    (BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "^", "-."),
    (PURPLE, "D", ":"), ("#56b4e9", "v", (0, (6, 1, 1, 1, 1, 1))), ("#8c6d31", "P", (0, (3, 1))),
)  # fmt: skip
STYLE = {
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.08,
    "font.family": "DejaVu Sans",
    "font.size": 13,
    "axes.titlesize": 13,
    "figure.titlesize": 14,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 12,
    "lines.linewidth": 1.8,
    "lines.markersize": 5,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "none",
    "svg.hashsalt": "contact",  # the same picture is the same file
}
_INCHES_PER_TICK = 0.75
_SUBS = ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7))  # of the decades of logarithmic axes: ticks
_NARROWEST = 1.1  # end over beginning of logarithmic axes
_LEAST_TICKS = 3  # with numbers, on logarithmic axes


def styled(draw):
    """Draw in `STYLE`."""

    @wraps(draw)
    def drawn(*args, **kwargs):
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return drawn


def new_figure(width, height, title=None):
    """Empty figure [inch] with a title above all."""
    figure = Figure(figsize=(width, height))
    FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title)
    return figure


def series(number):
    """How the line of a number, from 0, is drawn: as no other of the first twelve."""
    again, which = divmod(number, len(SERIES))
    colour, marker, line = SERIES[which]
    paper = "white" if again % 2 else colour  # a line does not shine through
    return {
        "color": colour, "marker": marker, "linestyle": line, "markersize": 5 + again, "markerfacecolor": paper,
    }  # fmt: skip


def linear_ticks(axis, inches):
    """Ticks that do not touch on an axis so long, two at least."""
    axis.set_major_locator(MaxNLocator(int(np.clip(inches / _INCHES_PER_TICK, 2, 7)), steps=[1, 2, 5, 10]))


def log_axis(axis, values, narrowest=_NARROWEST):
    """Logarithmic axis with at least three ticks that have numbers, whatever the positive `values` span.

    Its end is at least `narrowest` times its beginning.
    """
    axes = axis.axes
    in_x = axis is axes.xaxis
    values = np.ravel(values)
    values = values[np.isfinite(values) & (values > 0)]
    low, high = (values.min(), values.max()) if values.size else (0.1, 1.0)
    if high < narrowest * low:
        low, high = low / narrowest**0.5, high * narrowest**0.5
    (axes.set_xscale if in_x else axes.set_yscale)("log")
    margin = (high / low) ** 0.06
    low, high = low / margin, high * margin
    (axes.set_xlim if in_x else axes.set_ylim)(low, high)
    subs = next((subs for subs in _SUBS if _ticks_between(low, high, subs) >= _LEAST_TICKS), ())
    if subs != (1,):
        even = MaxNLocator(5, steps=[1, 2, 5, 10], min_n_ticks=_LEAST_TICKS)
        axis.set_major_locator(LogLocator(subs=subs) if subs else even)
        axis.set_major_formatter(FuncFormatter(lambda value, _: _number(value)))
        axis.set_minor_formatter(NullFormatter())
        axis.set_minor_locator(NullLocator())


def _ticks_between(low, high, subs):
    """How many numbers of (subs) 10^k there are."""
    powers = 10.0 ** np.arange(np.floor(np.log10(low)), np.log10(high) + 1)
    values = np.outer(powers, subs)
    return np.count_nonzero((low <= values) & (values <= high))


def _number(value):
    """A number as text, very large and small ones as in 5·10⁻⁵."""
    if 1e-3 <= value < 1e5:
        return f"{value:g}"
    factor, _, power = f"{value:e}".partition("e")
    times = "" if float(factor) == 1 else f"{float(factor):g}\\cdot "
    return f"${times}10^{{{int(power)}}}$"


def say_instead(axes, why):
    """Say in an empty panel why it is empty."""
    axes.text(0.5, 0.5, why, ha="center", va="center", transform=axes.transAxes)
    axes.set(xticks=[], yticks=[])


def save_figure(figure, path, dpi=200):
    """Write a figure; the suffix of `path` chooses the format. The file appears whole or not at all."""
    with whole_file(path) as temporary:
        write_figure(figure, temporary, path.suffix.lstrip("."), dpi)


@styled
def write_figure(figure, target, kind, dpi):
    """Write a figure to a path or an open binary file."""
    undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(kind)
    figure.savefig(target, format=kind, dpi=dpi, metadata=undated, bbox_inches="tight", pad_inches=0.08)
