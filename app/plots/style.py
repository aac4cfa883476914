"""Style, panels, axes and files of all figures.

Unless they are `interactive`, figures are made without pyplot, so that they need no display and are freed when they are
no longer used. Sizes in the code are for the style "screen". In the style "paper" all are smaller, and the panels of a
figure stand below each other in one column.
"""

from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import wraps
from typing import NamedTuple

import matplotlib.style
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from app.base.arithmetic import default_arithmetic
from app.io.files import atomic_file

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"  # distinct for colour-blind readers
PURPLE, GREY, PALE = "#aa4499", "#c8c8c8", "#cfe3f1"
DASHED, DOTTED, DASH_DOTTED = (0, (5, 2)), (0, (1, 1.5)), (0, (5, 1.5, 1, 1.5))
DASH_DOUBLE_DOTTED = (0, (6, 1, 1, 1, 1, 1))
SERIES = (
    (BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "^", "-."),
    (PURPLE, "D", ":"), ("#56b4e9", "v", DASH_DOUBLE_DOTTED), ("#8c6d31", "P", (0, (3, 1))),
)  # fmt: skip
RC = {
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
    "pdf.fonttype": 42,  # keep text as text
    "svg.fonttype": "none",
    "svg.hashsalt": "contact",  # makes files reproducible
}


class Style(NamedTuple):
    """Style of figures: scale, width of a column of panels, and settings.

    The width [inch] is the width before scaling; None if panels may be side by side.
    """

    scale: float
    column: float | None
    rc: dict


_PAPER_FONT, _PAPER_WIDTH = 8, 8.5 / 2.54  # [pt], [inch]
_SHRINK = _PAPER_FONT / RC["font.size"]
_IN_POINTS = (
    "lines.linewidth lines.markersize axes.linewidth axes.labelpad patch.linewidth "
    "xtick.major.size xtick.minor.size xtick.major.width xtick.minor.width xtick.major.pad "
    "ytick.major.size ytick.minor.size ytick.major.width ytick.minor.width ytick.major.pad "
    "figure.constrained_layout.h_pad figure.constrained_layout.w_pad"
).split()
_FONT_SIZES = "font.size", "axes.titlesize", "figure.titlesize", "legend.fontsize"
MIN_LOG_RATIO = 1.01  # of the largest to the smallest value on a logarithmic axis
STYLES = {
    "screen": Style(1.0, None, RC),
    "paper": Style(
        _SHRINK,
        _PAPER_WIDTH / _SHRINK,
        RC
        | {name: _SHRINK * RC.get(name, matplotlib.rcParamsDefault[name]) for name in _IN_POINTS}
        | dict.fromkeys(_FONT_SIZES, _PAPER_FONT),
    ),
}
_PAD = 0.08  # around saved pictures [inch]
_current = ContextVar("_current", default=STYLES["screen"])
_uses_pyplot = ContextVar("_uses_pyplot", default=False)


@contextmanager
def _set(variable, value):
    token = variable.set(value)
    try:
        yield
    finally:
        variable.reset(token)


def use_style(name):
    """Return a context manager in which figures have a style of `STYLES`."""
    return _set(_current, STYLES[name])


def interactive():
    """Return a context in which pyplot manages new figures.

    So notebooks and `pyplot.show` show them.
    """
    return _set(_uses_pyplot, True)


def with_style(draw):
    """Decorate a function to draw in the current style, whatever settings the user has changed."""

    @wraps(draw)
    def wrapper(*args, **kwargs):
        settings = _current.get().rc | {"figure.dpi": matplotlib.rcParams["figure.dpi"]}  # that of notebooks
        with matplotlib.style.context(["default", settings]), default_arithmetic():
            return draw(*args, **kwargs)

    return wrapper


def column_width():
    """Return the width of a single column of panels [inch], or None."""
    return _current.get().column


def new_figure(width, height, title=None):
    """Return an empty figure of a size [inch].

    The title is left out in a style of one column, where a caption replaces it.
    """
    style = _current.get()
    size, figure = (style.scale * width, style.scale * height), None
    if _uses_pyplot.get():
        from matplotlib import pyplot

        with suppress(ImportError):  # the user's backend needs a display or a package that is missing
            figure = pyplot.figure(figsize=size)
    if figure is None:
        figure = Figure(figsize=size)
        FigureCanvasAgg(figure)
    if title and not style.column:
        figure.suptitle(title)
    return figure


def new_mosaic(rows, widths, heights, title=None):
    """Return a figure, and its panels by name.

    `rows` are the names of the panels, as in `subplot_mosaic`; columns have these `widths`, rows `heights` [inch].
    """
    if column := column_width():
        stacked = {}
        for k, width in enumerate(widths):
            for row, height in zip(rows, heights, strict=True):
                taller = stacked.get(row[k], 0.0) + height * min(1.0, column / width)
                stacked[row[k]] = min(taller, column)
        stacked.pop(".", None)
        rows, widths, heights = [[name] for name in stacked], [column], [*stacked.values()]
    figure = new_figure(sum(widths), sum(heights), title)
    return figure, figure.subplot_mosaic(rows, width_ratios=widths, height_ratios=heights)


def new_panels(sizes, across=1, title=None):
    """Return a figure and a list of panels, `across` in a row.

    `sizes` are width and height of each panel with its labels [inch].
    """
    starts = range(0, len(sizes), across)
    rows = [[k if k < len(sizes) else "." for k in range(start, start + across)] for start in starts]
    heights = [max(height for _, height in sizes[start : start + across]) for start in starts]
    figure, panels = new_mosaic(rows, [width for width, _ in sizes[:across]], heights, title)
    return figure, [panels[k] for k in range(len(sizes))]


def add_legend(axes, **options):
    """Add a legend outside axes full of curves."""
    if column_width():
        place = {"loc": "lower left", "bbox_to_anchor": (0, 1.02), "borderaxespad": 0}
    else:
        place = {"loc": "upper left", "bbox_to_anchor": (1.02, 1)}
    axes.legend(**place, fontsize="small", title_fontsize="small", **options)


@with_style
def set_title(figure, title):
    """Replace the title of a figure."""
    figure.suptitle(title)


def series_style(number):
    """Return the style of line `number`; the first twelve styles differ."""
    cycle, index = divmod(number, len(SERIES))
    colour, marker, line = SERIES[index]
    return {
        "color": colour,
        "marker": marker,
        "linestyle": line,
        "markersize": matplotlib.rcParams["lines.markersize"] + cycle,
        "markerfacecolor": "white" if cycle % 2 else colour,
    }


def set_log_axes(axes, names="xy"):
    """Make axes logarithmic.

    If an axis has few powers of ten, 2 and 5 times these are labelled, too. If y hardly varies, its axis begins at
    zero instead, so that rounding does not look like a change.
    """
    for name in names:
        values = np.concatenate([line.get_ydata() for line in axes.lines] or [[]])
        if name == "y" and values.size and 0 < values.max() < MIN_LOG_RATIO * values.min():
            axes.set_ylim(0, 1.3 * values.max())
            continue
        axes.set(**{f"{name}scale": "log"})
        axis = getattr(axes, f"{name}axis")
        low, high = axis.get_view_interval()
        if 3 * low < high < 100 * low:  # below, matplotlib labels minor ticks
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())


def annotate_empty(axes, reason):
    """Write into an empty panel why it is empty."""
    axes.text(0.5, 0.5, reason, ha="center", va="center", transform=axes.transAxes)
    axes.set(xticks=[], yticks=[])


def save_figure(figure, path, dpi=200):
    """Write a figure atomically, in the suffix's format."""
    with atomic_file(path) as temporary:
        write_figure(figure, temporary, path.suffix.lstrip("."), dpi)


@with_style
def write_figure(figure, target, kind, dpi):
    """Write a figure to a file."""
    if column_width():  # keep the width; the second layout uses the ticks of the first
        figure.draw_without_rendering()
        tight = {}
    else:
        tight = {"bbox_inches": "tight", "pad_inches": _PAD}
    no_date = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(kind)
    figure.savefig(target, format=kind, dpi=dpi, metadata=no_date, **tight)
