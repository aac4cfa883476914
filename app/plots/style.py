"""Style, axes and files of all figures.

Figures are made without pyplot, unless they are `interactive`: they need no display and are freed when they are no
longer used.
"""

from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from app.io.files import atomic_file

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"  # distinct for colour-blind readers
PURPLE, GREY, PALE = "#aa4499", "#c8c8c8", "#cfe3f1"
DASHED, DOTTED = (0, (5, 2)), (0, (1, 1.5))
SERIES = (
    (BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "^", "-."),
    (PURPLE, "D", ":"), ("#56b4e9", "v", (0, (6, 1, 1, 1, 1, 1))), ("#8c6d31", "P", (0, (3, 1))),
)  # fmt: skip
LEGEND_RIGHT = {"loc": "upper left", "bbox_to_anchor": (1.02, 1), "fontsize": 11, "title_fontsize": 11}
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
    "pdf.fonttype": 42,  # keep text as text
    "svg.fonttype": "none",
    "svg.hashsalt": "contact",  # makes files reproducible
}


def with_style(draw):
    """Decorate a function so that it draws in `STYLE`."""

    @wraps(draw)
    def wrapper(*args, **kwargs):
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return wrapper


_uses_pyplot = ContextVar("_uses_pyplot", default=False)


@contextmanager
def interactive():
    """Let pyplot own new figures of the block.

    So notebooks and `pyplot.show` show them.
    """
    token = _uses_pyplot.set(True)
    try:
        yield
    finally:
        _uses_pyplot.reset(token)


def new_figure(width, height, title=None):
    """Return an empty figure of a width and height [inch]."""
    if _uses_pyplot.get():
        from matplotlib import pyplot

        figure = pyplot.figure(figsize=(width, height))
    else:
        figure = Figure(figsize=(width, height))
        FigureCanvasAgg(figure)
    if title:
        figure.suptitle(title)
    return figure


def series_style(number):
    """Return the style of line `number`; the first twelve styles differ."""
    cycle, index = divmod(number, len(SERIES))
    colour, marker, line = SERIES[index]
    face = "white" if cycle % 2 else colour
    return {
        "color": colour, "marker": marker, "linestyle": line, "markersize": 5 + cycle, "markerfacecolor": face,
    }  # fmt: skip


def set_log_axes(axes, names="xy"):
    """Make axes logarithmic.

    If an axis has few powers of ten, 2 and 5 times these are labelled, too.
    """
    for name in names:
        axes.set(**{f"{name}scale": "log"})
        axis = getattr(axes, f"{name}axis")
        low, high = axis.get_view_interval()
        if 3 * low < high < 100 * low:  # below, matplotlib labels minor ticks
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())


def annotate_empty(axes, reason):
    """Write into an empty panel why there is nothing to draw."""
    axes.text(0.5, 0.5, reason, ha="center", va="center", transform=axes.transAxes)
    axes.set(xticks=[], yticks=[])


def save_figure(figure, path, dpi=200):
    """Write a figure atomically, in the format of the path's suffix."""
    with atomic_file(path) as temporary:
        write_figure(figure, temporary, path.suffix.lstrip("."), dpi)


@with_style
def write_figure(figure, target, kind, dpi):
    """Write a figure to a path or an open binary file."""
    no_date = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(kind)
    figure.savefig(target, format=kind, dpi=dpi, metadata=no_date, bbox_inches="tight", pad_inches=0.08)
