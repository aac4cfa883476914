"""The style of all pictures: sizes, colours, units, ticks, files. Nothing here or above it touches pyplot.

So pictures need no display and do not pile up. Not collective: call on one rank.
"""

from __future__ import annotations

from functools import wraps

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from app.io.files import atomic_file

BLUE, ORANGE, GREEN = "#0072b2", "#d55e00", "#009e73"  # told apart by colour-blind readers
PURPLE, GREY, PALE = "#aa4499", "#c8c8c8", "#cfe3f1"
DASHED, DOTTED = (0, (5, 2)), (0, (1, 1.5))
SERIES = (
    (BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "^", "-."),
    (PURPLE, "D", ":"), ("#56b4e9", "v", (0, (6, 1, 1, 1, 1, 1))), ("#8c6d31", "P", (0, (3, 1))),
)  # fmt: skip
BESIDE = {
    "loc": "upper left",
    "bbox_to_anchor": (1.02, 1),
    "fontsize": 11,
    "title_fontsize": 11,
}  # of legends
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


def with_style(draw):
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


def series_style(number):
    """How the line of a number, from 0, is drawn: as no other of the first twelve."""
    again, which = divmod(number, len(SERIES))
    colour, marker, line = SERIES[which]
    paper = "white" if again % 2 else colour  # a line does not shine through
    return {
        "color": colour, "marker": marker, "linestyle": line, "markersize": 5 + again, "markerfacecolor": paper,
    }  # fmt: skip


def set_log_axes(axes, names="xy"):
    """Make what is drawn logarithmic in these directions, with numbers between the powers of ten where they are few."""
    for name in names:
        axes.set(**{f"{name}scale": "log"})
        axis = getattr(axes, f"{name}axis")
        low, high = axis.get_view_interval()
        if 3 * low < high < 100 * low:  # matplotlib shows some below that
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())


def annotate_empty(axes, why):
    """Say in an empty panel why it is empty."""
    axes.text(0.5, 0.5, why, ha="center", va="center", transform=axes.transAxes)
    axes.set(xticks=[], yticks=[])


def save_figure(figure, path, dpi=200):
    """Write a figure; the suffix of `path` chooses the format. The file appears whole or not at all."""
    with atomic_file(path) as temporary:
        write_figure(figure, temporary, path.suffix.lstrip("."), dpi)


@with_style
def write_figure(figure, target, kind, dpi):
    """Write a figure to a path or an open binary file."""
    undated = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(kind)
    figure.savefig(target, format=kind, dpi=dpi, metadata=undated, bbox_inches="tight", pad_inches=0.08)
