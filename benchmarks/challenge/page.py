"""Page and pictures, from the tables alone."""

import math
import shlex
import sys
from itertools import groupby

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from app.io.table import format_markdown
from app.plots.style import BLUE, GREY, ORANGE, STYLES, save_figure
from app.reference.rough import persson_fraction
from benchmarks.challenge.measures import persson_pressures, stiffness
from benchmarks.challenge.surface import CUTOFF, SIDE

KAPPAS = {"√(2π), Bush et al.": math.sqrt(2 * math.pi), "√(8/π), Persson": math.sqrt(8 / math.pi)}
REFERENCE = 0.01  # 250 kPa
SHOWN = (0.01, 0.1, 1.0)  # loads whose distributions are kept

TEXT = """\
Surface: {surface}. Published parameters: periodic patch of 0.1 mm; self-affine surface with Hurst exponent 0.8,
roll-off 20 µm, cut-off 0.1 µm and rms slope 1; E* = 25 MPa; reference mean pressure 250 kPa (`load` 0.01).
The Challenge has short-ranged adhesion, which this program does not model. A look-alike is another surface with the
same spectrum: its waves have random phases of their own.

The load is given as `load`: mean pressure / (E* rms slope of the whole surface). The shortest wave needs at least two
cells: on 2048 x 2048 cells it is 2.05 cells long. {coarse}Finer grids have the same waves, so results on two grids
differ only by the error due to the cell size.

| column | meaning |
|---|---|
| `contact` | share of the cells in contact |
| `corrected` | `contact`, corrected by the perimeter for the cells at the contact edge (Yastrebov et al. 2017) |
| `Persson` | contact fraction by Persson's theory, erf(sqrt(2) `load`) |
| `mean gap` | mean gap / rms height of the whole surface |
| `largest pressure` | largest pressure / (E* rms slope of the whole surface) |
| `patches` | number of contact spots: sets of contact cells connected by sides, also across the period |
| `largest` | area of the largest contact spot, as a share of the period |
| `applications` | operator applications of the solve |

The pictures also show the stiffness, -d(load)/d(mean gap) from neighbouring loads. All numbers are in {numbers} and
{densities}.
"""


def write_page(path, rows, densities, name):
    """Write page and pictures of one surface beside the tables.

    Parameters
    ----------
    path : Path
        Of the page.
    rows, densities : list of dict
        As `benchmarks.challenge.__main__` keeps them.
    name : str
        Of the surface.
    """
    rows = sorted((r for r in rows if r["surface"] == name), key=lambda r: (r["size"], r["load"]))
    densities = [r for r in densities if r["surface"] == name]
    pictures = {part: path.with_name(f"{path.stem}-{part}.png") for part in ("loads", "distributions")}
    with matplotlib.rc_context(STYLES["screen"].rc):
        save_figure(loads_figure(rows), pictures["loads"], dpi=110)
        save_figure(distributions_figure(rows, densities), pictures["distributions"], dpi=110)
    coarse = [size for size in _sizes(rows) if SIDE / size * 2 > CUTOFF]
    left_out = (
        f"On {' and '.join(f'{n}²' for n in coarse)} cells, shorter waves are left out. " if coarse else ""
    )
    text = TEXT.format(
        surface=name,
        coarse=left_out,
        numbers=f"[{path.stem}.csv]({path.stem}.csv)",
        densities=f"[{path.stem}-distributions.csv]({path.stem}-distributions.csv)",
    )
    parts = [
        "# Contact Mechanics Challenge, without adhesion\n",
        f"Made by `{shlex.join(['run/challenge', *sys.argv[1:]])}`.\n",
        text,
        f"![contact, mean gap and stiffness against load]({pictures['loads'].name})\n",
        f"![pressures, gaps and patches]({pictures['distributions'].name})\n",
        "## At the reference pressure\n",
        format_markdown([_line(r, "size") for r in rows if math.isclose(r["load"], REFERENCE)]),
        f"\n## All loads, {_sizes(rows)[-1]}²\n",
        format_markdown([_line(r, "load") for r in rows if r["size"] == _sizes(rows)[-1]]),
        "",
    ]
    path.write_text("\n".join(parts), encoding="utf-8")


def _sizes(rows):
    return sorted({row["size"] for row in rows})


def _line(row, key):
    """Return a line of a table that begins with `key`."""
    first = {"grid": f"{row['size']}²", "rms slope": f"{row['rms_slope']:.3f}"}
    if key == "load":
        first = {"load": f"{row['load']:g}"}
    return first | {
        "contact": f"{row['contact_fraction']:.3%}",
        "corrected": f"{row['corrected_fraction']:.3%}",
        "Persson": f"{persson_fraction(row['load']):.3%}",
        "contact / load": f"{row['contact_fraction'] / row['load']:.3f}",
        "mean gap": f"{max(row['mean_gap'], 0.0):.4g}",
        "largest pressure": f"{row['max_pressure']:.3g}",
        "patches": int(row["patches"]),
        "largest": f"{row['largest_patch']:.2%}",
        "applications": f"{row['applications']:.1f}",
        "seconds": f"{row['seconds']:.3g}",
        "solved": "yes" if row["converged"] else "no",
    }


def _figure(columns, rows=1):
    figure = Figure(figsize=(6.2 * columns, 5.2 * rows))
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns)


def _by_size(rows):
    """Yield cells per side, rows and colour of each grid, the finest last and darkest."""
    sizes = _sizes(rows)
    shades = matplotlib.colormaps["Blues"](np.linspace(0.4, 1, len(sizes)))
    for (size, group), shade in zip(groupby(rows, lambda row: row["size"]), shades, strict=True):
        yield size, list(group), shade


def loads_figure(rows):
    """Draw contact fraction, its ratio to the load, mean gap and stiffness against load."""
    figure, ((area, ratio), (gap, stiff)) = _figure(2, 2)
    for size, group, shade in _by_size(rows):
        load, contact = (np.array([row[key] for row in group]) for key in ("load", "contact_fraction"))
        corrected = np.array([row["corrected_fraction"] for row in group])
        style = {"color": shade, "marker": "o", "label": f"{size}²"}
        area.loglog(load, contact, **style)
        ratio.semilogx(load, contact / load, **style)
        ratio.semilogx(load, corrected / load, color=shade, linestyle=":")
        left = np.array([row["mean_gap"] for row in group])
        gap.semilogx(load, left, **style)
        stiff.loglog(*stiffness(group), **style)
    loads = np.logspace(*np.log10([rows[0]["load"], max(row["load"] for row in rows)]), 200)
    dashed = {"color": ORANGE, "linestyle": (0, (5, 2))}
    area.loglog(loads, persson_fraction(loads), **dashed, label="Persson")
    ratio.semilogx(loads, persson_fraction(loads) / loads, **dashed, label="Persson")
    for (name, kappa), style in zip(KAPPAS.items(), ("-", ":"), strict=True):
        light = loads[kappa * loads < 1]
        area.loglog(light, kappa * light, color=GREY, linestyle=style, zorder=0)
        ratio.axhline(kappa, color=GREY, linestyle=style, zorder=0, label=name)
    area.set(ylabel="contact fraction")
    ratio.set(ylabel="contact fraction / load   (dotted: corrected)", ylim=(0, None))
    gap.set(ylabel="mean gap / rms height")
    stiff.set(ylabel="stiffness  −d(load) / d(mean gap)")
    for axes in (area, ratio, gap, stiff):
        axes.set_xlabel("load  p / (E* h′rms)")
    area.legend(loc="lower right")
    ratio.legend(loc="upper right")
    return figure


def distributions_figure(rows, densities):
    """Draw pressures, gaps and contact spots at the loads of `SHOWN`, the finest grid darkest."""
    figure, axes = _figure(3)
    sizes = _sizes(rows)
    finest = sizes[-1] if sizes else 0
    colours = dict(zip(SHOWN, (BLUE, ORANGE, "#009e73"), strict=True))
    key = {"pressure": axes[0], "gap": axes[1], "patch": axes[2]}
    ordered = sorted(densities, key=lambda r: (r["kind"], r["load"], r["size"], r["x"]))
    for (kind, load, size), group in groupby(ordered, lambda r: (r["kind"], r["load"], r["size"])):
        x, y = np.array([(row["x"], row["density"]) for row in group]).T
        pale = {"alpha": 0.3, "linewidth": 1} if size != finest else {"label": f"load {load:g}"}
        seen = y > 0
        key[kind].plot(x[seen], y[seen], color=colours.get(load, GREY), **pale)
    for load in sorted({row["load"] for row in densities}):
        p = np.linspace(0, 4, 400)
        expected = persson_pressures(p, load)
        axes[0].plot(p, expected, color=colours.get(load, GREY), linestyle=(0, (2, 2)), linewidth=1)
    axes[0].set(yscale="log", ylim=(1e-6, 3), xlim=(0, 4))
    axes[0].set(xlabel="pressure / (E* h′rms)", ylabel="density   (dashed: Persson)")
    axes[1].set(
        xscale="log", yscale="log", xlabel="gap / rms height", ylabel="density, cells without contact"
    )
    axes[2].set(xscale="log", yscale="log", xlabel="area of a patch / period", ylabel="patches per decade")
    for one in axes:
        one.legend(loc="best")
    return figure
