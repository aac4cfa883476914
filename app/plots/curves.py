"""Distributions of pressure, gap and patches; the spectrum of the surface; stress below the contact.

Each function returns a figure of its own. Not collective: call on one rank.
"""

from __future__ import annotations

import numpy as np

from app.base.units import choose_length_unit
from app.halfspace.stress.subsurface import max_shear, von_mises
from app.plots.figures import EVEN_VALUES, format_load, make_title
from app.plots.maps import cell_edges, estimate_rounding, finite_pressure
from app.plots.style import (
    BESIDE,
    BLUE,
    DASHED,
    DOTTED,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    annotate_empty,
    new_figure,
    set_log_axes,
    with_style,
)
from app.problems.statistics import radial_spectrum
from app.problems.surfaces.moments import Moments, add_polynomial

_SMOOTH = "hertz", "sphere", "cylinder", "cone", "punch"  # but for surfaces on them
_BINS_PER_DECADE = 8
_STRESS_MAP = "magma_r"
EVEN = 1e-9  # of the largest: stresses that differ by less are one number
_STRESS_BOX = 0.6, 0.7  # height over width of a section at least, and at most


@with_style
def distribution_figure(result):
    """Probability densities of pressure and gap, and sizes of several patches, on logarithmic axes."""
    areas = result.contact_patches()
    panels = 3 if len(areas) > 1 else 2
    figure = new_figure(4.85 * panels, 4.6, make_title(result))
    pressure, gap, *several = figure.subplots(1, panels)
    p = finite_pressure(result.pressure)
    _density(pressure, p[p > 0], "pressure p  [N/mm²]", "[mm²/N]")
    apart = result.gap[(result.contact == 0) & (result.gap > 0) & np.isfinite(result.gap)]
    unit = choose_length_unit(float(apart.max(initial=0.0)))
    _density(gap, apart * unit.per_mm, f"gap e  [{unit.name}]", f"[1/{unit.name}]")
    for axes in several:
        _draw_patches(axes, areas)
    return figure


def _density(axes, values, label, unit):
    """Probability density by bins of equal width in the logarithm."""
    axes.set(xlabel=label, ylabel=f"probability density  {unit}")
    if not values.size:
        return annotate_empty(axes, "no values")
    low = np.quantile(values, 20 / values.size if values.size > 100 else 0.0)  # few have no bin of theirs
    high = values.max()
    if not high > low * EVEN_VALUES:
        return annotate_empty(axes, f"all of them {high:.4g} {label.partition('[')[2].rstrip(']')}")
    count = max(8, int(_BINS_PER_DECADE * np.log10(high / low)))
    edges = np.geomspace(low, high, count + 1)
    edges[0], edges[-1] = low, high
    share, _ = np.histogram(values, edges)
    density = share / values.size / np.diff(edges)
    shown = share > 0
    middle = np.sqrt(edges[1:] * edges[:-1])
    axes.plot(middle[shown], density[shown], "o-", color=BLUE, markersize=4)
    set_log_axes(axes)
    return None


def _draw_patches(axes, patches):
    """How many patches are at least so large."""
    unit = choose_length_unit(np.sqrt(patches.max(initial=0.0)))
    axes.set(xlabel=f"area A of a patch  [{unit.name}²]", ylabel="patches of at least A")
    sizes, counts = np.unique(patches, return_counts=True)
    areas, larger = sizes * unit.per_mm**2, counts[::-1].cumsum()[::-1]
    axes.step(areas, larger, where="pre", color=BLUE)
    axes.plot(areas, larger, "o", color=BLUE, markersize=3)
    set_log_axes(axes)
    axes.set_ylim(bottom=1)


def extract_roughness(result):
    """Surface whose spectrum tells something [mm]: the undeformed distance, on a free patch less its best paraboloid.

    Returns
    -------
    ndarray, shape (ny, nx), or None
        None with holes, with less than 8 cells in a direction, or where nothing is left.
    """
    h = result.undeformed_distance
    if min(h.shape) < 8 or not np.isfinite(h).all():
        return None
    rest = h - h.mean()
    if not result.grid.periodic:
        bowl = Moments("", lambda *rows: h[slice(*rows)], h.shape).fit("quadratic")
        rest = add_polynomial(h.copy(), bowl, 0, len(h), sign=-1)
    return rest if np.abs(rest).max() > 1e-9 * np.ptp(h) else None


@with_style
def spectrum_figure(result):
    """Radial average of the power spectrum of the undeformed distance, with its cut-offs; None if there is none.

    On a free patch the best paraboloid is taken off, and a Hann window is put on. Shapes without a surface have none.
    """
    values = result.attributes
    smooth = values.get("problem") in _SMOOTH and not values.get("surfaces")
    surface = None if smooth else extract_roughness(result)
    if surface is None or np.ptp(surface) <= estimate_rounding(result):
        return None
    figure = new_figure(7.4, 5.4, make_title(result))
    axes = figure.subplots()
    drawn = draw_spectrum(axes, surface, result.grid, "undeformed distance")
    if drawn is None:
        return None
    q, density, unit = drawn
    for name, label, line in (("surface_rolloff", "roll-off", DASHED), ("surface_cutoff", "cut-off", DOTTED)):
        if values.get(name):
            at = 2 * np.pi / values[name] / unit.per_mm
            wave = choose_length_unit(values[name])
            text = f"{label}, λ = {values[name] * wave.per_mm:.3g} {wave.name}"
            axes.axvline(at, color=ORANGE, linestyle=line, label=text)
    if values.get("surface_hurst"):
        power = -2 - 2 * values["surface_hurst"]
        first = max(q[0], 2 * np.pi / values.get("surface_rolloff", np.inf) / unit.per_mm)
        last = min(q[-1], 2 * np.pi / values.get("surface_cutoff", 1e-300) / unit.per_mm)
        if last > 2 * first:
            span = np.array([first, last])
            height = 3 * np.interp(first, q, density) * (span / first) ** power
            axes.plot(
                span, height, color=GREEN, linestyle=DASHED, label=f"slope {power:.2g}".replace("-", "−")
            )
    axes.legend(loc="lower left", frameon=True, framealpha=1, edgecolor="none")  # lines end at it
    return figure


def draw_spectrum(axes, surface, grid, label):
    """Draw the radial spectrum of a `rough_part` [mm], by a Hann window on a free patch.

    Not collective.

    Returns
    -------
    tuple or None
        Wave numbers, densities [mm4] and the `Unit` in which the wave numbers are; None if that is no curve.
    """
    spectrum = radial_spectrum(surface, grid.dx, grid.dy, window=not grid.periodic)
    unit = choose_length_unit(max(grid.nx * grid.dx, grid.ny * grid.dy))
    q, density = spectrum.wave_number / unit.per_mm, spectrum.density
    known = density > 1e-14 * density.max(initial=0.0)  # below that is round-off
    if np.count_nonzero(known) < 3:
        return None
    axes.plot(q[known], density[known], "-", color=BLUE, label=label)
    set_log_axes(axes)
    axes.set(xlabel=f"wave number q  [1/{unit.name}]", ylabel="power spectral density C  [mm⁴]")
    return q[known], density[known], unit


@with_style
def stress_figure(along, grid, depths, section, line, hottest, heading):
    """Von Mises stress on a section through the most stressed point, and stresses on the line through it.

    Parameters
    ----------
    along : str
        "x" or "y".
    grid : Grid
    depths : ndarray, [mm]
        From 0 on.
    section : ndarray, shape (6, depths, nx or ny), [N/mm2]
    line : ndarray, shape (6, depths), [N/mm2]
    hottest : app.halfspace.stress.subsurface.StressMaximum
    heading : str
    """
    figure = new_figure(13.5, 5.2, heading)
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [1.6, 1]})
    centres = grid.x() if along == "x" else grid.y()
    unit = choose_length_unit(max(np.ptp(centres), depths[-1]))
    sides, deepest = cell_edges(grid, along), depths[-1] or 1.0
    width = np.ptp(sides)
    box = float(np.clip(deepest / width, *_STRESS_BOX))
    times = box * width / deepest
    stretched = not np.isclose(times, 1)
    remark = f"   (z: {times:.3g} × the scale of {along})" if stretched else ""
    deep = choose_length_unit(depths[-1]) if stretched else unit
    z = depths * deep.per_mm
    mises = von_mises(section)
    bottom = z[-1] or 1.0
    between = np.concatenate([z[:1], (z[1:] + z[:-1]) / 2, [bottom]])
    colours = {"cmap": _STRESS_MAP, "vmin": 0, "vmax": mises.max() or 1.0}
    image = left.pcolormesh(sides * unit.per_mm, between, mises, rasterized=True, **colours)
    uneven = np.ptp(mises) > EVEN * mises.max()
    bar = figure.colorbar(image, cax=left.inset_axes([1.02, 0, 0.03, 1]))
    bar.set_label("von Mises stress  [N/mm²]")
    at = (hottest.x if along == "x" else hottest.y) * unit.per_mm
    depth = hottest.depth * deep.per_mm
    place = f"at depth {depth:.3g} {deep.name}" if uneven else "everywhere"
    cross = {"marker": "+" if uneven else "", "markersize": 12, "markeredgewidth": 2, "clip_on": False}
    largest = f"{format_load(hottest.von_mises)} N/mm² {place}"
    left.plot(at, depth, color=GREEN, linestyle="none", label=largest, **cross)
    left.legend(loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.2)
    left.set_box_aspect(box)
    left.set(xlabel=f"{along}  [{unit.name}]{remark}", ylabel=f"depth z  [{deep.name}]", ylim=(bottom, 0))
    for k, label, colour, style in (
        (0, "σx", GREEN, "-."), (1, "σy", PURPLE, DOTTED), (2, "σz", BLUE, DASHED)
    ):  # fmt: skip
        right.plot(line[k], z, color=colour, linestyle=style, label=label)
    right.plot(von_mises(line), z, color=ORANGE, label="von Mises")
    right.plot(max_shear(line), z, color="0.3", linestyle=DASHED, label="largest shear")
    right.axvline(0, color=GREY, linewidth=0.8, zorder=0)
    right.set(xlabel="stress  [N/mm²]", ylabel=f"depth z  [{deep.name}]", ylim=(bottom, 0))
    right.locator_params(axis="x", nbins=5)
    right.legend(**BESIDE)  # curves are everywhere
    return figure
