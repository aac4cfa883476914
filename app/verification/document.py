"""Tables and pictures of the verification document."""

import datetime
import platform
from typing import NamedTuple

import h5py
import matplotlib
import numba
import numpy as np
import scipy
from matplotlib.ticker import NullLocator
from petsc4py import PETSc

from app import __version__
from app.base.mpi import MPI
from app.halfspace.grid import SYMBOLS
from app.io.table import format_markdown
from app.plots.style import GREY, SERIES, new_figure, new_panels, set_log_axes, with_style
from app.verification import analytic, certificates, invariances, oracles, ranks
from app.verification.check import Check, Figure
from app.verification.solving import PATCHES, patch_name

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


class Result(NamedTuple):
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
    """Format the verification document in Markdown.

    `arguments` are the command line's arguments after the folder. `pictures` are the names of files in the same folder.
    """
    judged, failed = sum(r.judged for r in results), sum(len(r.failed) for r in results)
    kept = f"**{failed} of {judged} limits are not kept.**" if failed else f"All {judged} limits are kept."
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
    rows = []
    for r in results:
        title, seconds = r.check.title, f"{r.seconds:.1f}"
        anchor = "".join(c for c in title.lower().replace(" ", "-") if c.isalnum() or c in "-_")
        numbers = {"limits": r.judged, "kept": r.judged - len(r.failed), "seconds": seconds, "": r.verdict}
        rows.append({"check": f"[{title}](#{anchor})", **numbers})
    return format_markdown(rows)


def _table(result, quick):
    rows = []
    for figure in result.figures:
        verdict = "" if not figure.judged else "pass" if figure.passed else "**FAIL**"
        rows.append({"figure": figure.what, "value": figure.shown, "limit": figure.limit, "": verdict})
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
    figure, panels = new_panels([(4.1, 3.7)] * len(shown), columns)
    for panel, (result, lines) in zip(panels, shown, strict=True):
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
        panel.set(xscale="log", title=result.check.title, xlabel="cells in a direction")
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
    drawn = (figure for result in results for figure in result.figures if figure.points)
    shown = [figure for figure in drawn if "over its bound" in figure.what]
    if not shown:
        return None
    figure = new_figure(7.2, 6.2)
    panel = figure.subplots()
    for k, kind in enumerate(map(patch_name, PATCHES)):
        colour, marker, _ = SERIES[k]
        points = [f.points for f in shown if f.what.split(", ")[1] == kind]
        if points:
            true, bounds = (np.hstack([np.maximum(p[i], 1e-17) for p in points]) for i in (0, 1))
            label = f"periodic patch, {kind}" if kind in SYMBOLS else f"patch {kind}"
            panel.loglog(bounds, true, marker, color=colour, ms=4, alpha=0.5, mew=0, label=label)
    ends = panel.get_xlim()
    panel.plot(ends, ends, color=GREY, lw=1.5, zorder=0)
    panel.set(xlim=ends, xlabel="proved bound of the relative error", ylabel="true relative error (energy)")
    panel.legend(loc="upper left")
    return figure
