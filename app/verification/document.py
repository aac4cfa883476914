"""Tables and pictures of the verification document."""

import datetime
import platform
from dataclasses import dataclass

import h5py
import matplotlib
import numba
import numpy as np
import scipy
from matplotlib.ticker import NullLocator
from petsc4py import PETSc

from app import __version__
from app.base.mpi import MPI
from app.io.table import format_markdown
from app.plots.style import GREY, SERIES, new_figure, set_log_axes, with_style
from app.verification import analytic, certificates, invariances, oracles, ranks
from app.verification.check import Check, Figure

SECTIONS = {
    "Analytic solutions": analytic.CHECKS,
    "Invariances": invariances.CHECKS,
    "Independent solvers": oracles.CHECKS,
    "Ranks": ranks.CHECKS,
    "Certificate": certificates.CHECKS,
}
CHECKS = {check.name: check for checks in SECTIONS.values() for check in checks}
ORDERS, SHARPNESS = "verification-orders.png", "verification-certificate.png"

_HEAD = """\
# Verification

{summary} Made by `python -m app.verify -o DIR{arguments}` on {date} with version {version}; {software}; {machine}.

The command above each table computes it; without `--only` it computes all tables. `≤` and `≥` are the limits of a
figure; some figures have no limit. Errors are relative, and pressures are divided by the largest one, unless stated
otherwise.
The test suite runs all checks on small cases (`--quick`).
"""


@dataclass(frozen=True)
class Result:
    """Result of a check: its figures, and the seconds that it took."""

    check: Check
    figures: tuple[Figure, ...]
    seconds: float

    @property
    def failed(self):
        """List of the figures outside their limits."""
        return [figure for figure in self.figures if not figure.passed]

    @property
    def judged(self):
        """Number of figures with a limit."""
        return sum(figure.judged for figure in self.figures)

    @property
    def verdict(self):
        """Either "pass" or "FAIL"."""
        return "FAIL" if self.failed else "pass"


def format_document(results, arguments, pictures):
    """Format the verification document.

    Parameters
    ----------
    results : sequence of Result
        Results of the checks.
    arguments : str
        Arguments of the command line after the folder.
    pictures : collection of str
        Names of the picture files in the same folder.

    Returns
    -------
    str
        Markdown.
    """
    judged, failed = sum(r.judged for r in results), sum(len(r.failed) for r in results)
    kept = (
        f"All {judged} limits are kept." if not failed else f"**{failed} of {judged} limits are not kept.**"
    )
    parts = [
        _HEAD.format(
            summary=kept, arguments=arguments, version=__version__, date=datetime.date.today().isoformat(),
            software=_software(), machine=f"{platform.machine()}, one core, except for the checks of ranks",
        ),
        _overview(results),
    ]  # fmt: skip
    for title, checks in SECTIONS.items():
        inside = [result for result in results if result.check in checks]
        if not inside:
            continue
        parts.append(f"## {title}\n")
        for name, caption in _PICTURES.get(title, {}).items():
            if name in pictures:
                parts.append(f"![{caption}]({name})\n")
        parts += [_table(result, "--quick" in arguments) for result in inside]
    return "\n".join(parts)


_PICTURES = {
    "Analytic solutions": {ORDERS: "Errors against the number of cells, with the observed orders"},
    "Certificate": {SHARPNESS: "True errors against their proved bounds: none lies above the line"},
}


def _overview(results):
    rows = [
        {
            "check": f"[{r.check.title}](#{_anchor(r.check.title)})",
            "limits": r.judged,
            "kept": r.judged - len(r.failed),
            "seconds": f"{r.seconds:.1f}",
            "": r.verdict,
        }
        for r in results
    ]
    return format_markdown(rows)


def _anchor(title):
    return "".join(c for c in title.lower().replace(" ", "-") if c.isalnum() or c in "-_")


def _table(result, quick):
    rows = [
        {
            "figure": figure.what,
            "value": figure.shown,
            "limit": figure.limit,
            "": "" if not figure.judged else "pass" if figure.passed else "**FAIL**",
        }
        for figure in result.figures
    ]
    command = f"python -m app.verify -o DIR --only {result.check.name}" + " --quick" * quick
    return f"### {result.check.title}\n\n{result.check.law}\n\n    {command}\n\n{format_markdown(rows)}"


def _software():
    versions = {
        "PETSc": ".".join(map(str, PETSc.Sys.getVersion())),
        "Python": platform.python_version(),
        **{module.__name__: module.__version__ for module in (np, scipy, numba, h5py, matplotlib)},
        "MPI": MPI.Get_library_version().split(",")[0].split("\n")[0].strip("\0"),
    }
    return ", ".join(f"{name} {version}" for name, version in versions.items())


@with_style
def draw_orders(results):
    """Draw errors against numbers of cells, with observed orders.

    Return the figure, or None if no result has an order.
    """
    shown = [(r, [f for f in r.figures if f.points and f.what.startswith("order of")]) for r in results]
    shown = [(result, figures) for result, figures in shown if figures]
    if not shown:
        return None
    columns = min(len(shown), 4)
    rows = -(-len(shown) // columns)
    figure = new_figure(4.1 * columns, 3.7 * rows)
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for panel in panels[len(shown) :]:
        panel.set_visible(False)
    for panel, (result, lines) in zip(panels, shown, strict=False):
        kinds = {}  # converging quantity -> its lines
        for line in lines:
            kinds.setdefault(line.what.removeprefix("order of the ").split(",")[0], []).append(line)
        for (kind, alike), (colour, marker, style) in zip(kinds.items(), SERIES, strict=False):
            label = f"{kind}: {', '.join(f'{line.value:.1f}' for line in alike)}"
            for line in alike:
                panel.plot(*line.points, color=colour, marker=marker, ls=style, lw=1.2, ms=3.5, label=label)
                label = None
        sizes = lines[0].points[0]
        set_log_axes(panel, "y")
        panel.set_xscale("log")
        panel.set_title(result.check.title)
        panel.set_xlabel("cells in a direction")
        ticks = sizes[:: -(-len(sizes) // 5)]
        panel.set_xticks(ticks, [str(n) for n in ticks])
        panel.xaxis.set_minor_locator(NullLocator())
        panel.legend(fontsize=9, loc="lower left")
    for panel in panels[::columns]:
        panel.set_ylabel("error")
    return figure


@with_style
def draw_sharpness(results):
    """Draw true errors against their proved bounds.

    Return the figure, or None if no result has such errors.
    """
    shown = [
        figure for r in results for figure in r.figures if figure.points and "over its bound" in figure.what
    ]
    if not shown:
        return None
    figure = new_figure(7.2, 6.2)
    panel = figure.subplots()
    for k, kind in enumerate(("free", "spectral", "love")):
        colour, marker, _ = SERIES[k]
        points = [f.points for f in shown if f.what.split(", ")[1] == kind]
        if points:
            true, bounds = (np.hstack([np.maximum(p[i], 1e-17) for p in points]) for i in (0, 1))
            label = "free patch" if kind == "free" else f"periodic patch, {kind}"
            panel.loglog(bounds, true, marker, color=colour, ms=4, alpha=0.5, mew=0, label=label)
    ends = panel.get_xlim()
    panel.plot(ends, ends, color=GREY, lw=1.5, zorder=0)
    panel.set_xlim(ends)
    panel.set_xlabel("proved bound of the relative error")
    panel.set_ylabel("true relative error, energy norm")
    panel.legend(loc="upper left")
    return figure
