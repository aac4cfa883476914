"""Figures of distributions and of the roughness spectrum."""

import numpy as np

from app.base.units import choose_length_unit
from app.plots.figures import MIN_RATIO, make_title
from app.plots.maps import estimate_rounding, finite_pressure
from app.plots.style import (
    BLUE,
    DASH_DOTTED,
    DASHED,
    DOTTED,
    GREEN,
    ORANGE,
    annotate_empty,
    new_figure,
    new_panels,
    set_log_axes,
    with_style,
)
from app.problems.statistics import radial_spectrum
from app.problems.surfaces.moments import Moments, add_polynomial

_SMOOTH = "hertz", "sphere", "cylinder", "roller", "cone", "punch"  # problems without roughness of their own
_BINS_PER_DECADE = 8  # of a logarithmic axis


@with_style
def distribution_figure(result):
    """Draw the distributions of pressure, gap and size of contact spots."""
    areas = result.contact_patches()
    count = 3 if len(areas) > 1 else 2
    figure, (pressure, gap, *several) = new_panels([(4.85, 4.6)] * count, count, make_title(result))
    p = finite_pressure(result.pressure)
    _draw_density(pressure, p[p > 0], "pressure p  [N/mm²]", "[mm²/N]")
    gaps = result.gap[~result.contact & (result.gap > 0) & np.isfinite(result.gap)]
    unit = choose_length_unit(float(gaps.max(initial=0.0)))
    _draw_density(gap, gaps * unit.per_mm, f"gap e  [{unit.name}]", f"[1/{unit.name}]")
    for axes in several:
        _draw_patches(axes, areas)
    return figure


def _draw_density(axes, values, label, unit):
    """Draw positive values' probability density, in logarithmic bins."""
    axes.set(xlabel=label, ylabel=f"probability density  {unit}")
    if not values.size:
        annotate_empty(axes, "no values")
        return
    low = np.quantile(values, 20 / values.size if values.size > 100 else 0.0)  # omit bins of few values
    high = values.max()
    if not high > low * MIN_RATIO:
        annotate_empty(axes, f"all of them {high:.4g} {label.partition('[')[2].rstrip(']')}")
        return
    count = max(8, int(_BINS_PER_DECADE * np.log10(high / low)))
    edges = np.geomspace(low, high, count + 1)
    edges[0], edges[-1] = low, high
    share, _ = np.histogram(values, edges)
    density = share / values.size / np.diff(edges)
    shown = share > 0
    middle = np.sqrt(edges[1:] * edges[:-1])
    axes.plot(middle[shown], density[shown], "o-", color=BLUE, markersize=4)
    set_log_axes(axes)


def _draw_patches(axes, patches):
    """Draw how many contact spots have at least a given area."""
    unit = choose_length_unit(np.sqrt(patches.max(initial=0.0)))
    axes.set(xlabel=f"area A of a contact spot  [{unit.name}²]", ylabel="spots of at least A")
    sizes, counts = np.unique(patches, return_counts=True)
    areas, larger = sizes * unit.per_mm**2, counts[::-1].cumsum()[::-1]
    axes.step(areas, larger, where="pre", color=BLUE)
    axes.plot(areas, larger, "o", color=BLUE, markersize=3)
    set_log_axes(axes)
    axes.set_ylim(bottom=1)


def extract_roughness(result):
    """Return the undeformed distance without its smooth part [mm].

    The smooth part is the best paraboloid; on a periodic patch it is the mean. Return None if the patch has holes or
    fewer than 8 cells along x or y, or if there is no roughness.
    """
    h = result.undeformed_distance
    if min(h.shape) < 8 or not np.isfinite(h).all():
        return None
    roughness = h - h.mean()
    if not result.grid.doubly_periodic:
        paraboloid = Moments("", lambda *rows: h[slice(*rows)], h.shape).fit("quadratic")
        roughness = add_polynomial(h.copy(), paraboloid, 0, len(h), sign=-1)
    return roughness if np.abs(roughness).max() > 1e-9 * np.ptp(h) else None


@with_style
def spectrum_figure(result):
    """Draw the roughness spectrum, with roll-off and cut-off.

    Unless the patch is periodic, the best paraboloid is subtracted and a Hann window applied. None for smooth bodies.
    """
    values = result.attributes
    smooth = values.get("problem") in _SMOOTH and not values.get("surfaces")
    surface = None if smooth else extract_roughness(result)
    if surface is None or np.ptp(surface) <= estimate_rounding(result):
        return None
    figure = new_figure(7.4, 5.4, make_title(result))
    axes = figure.subplots()
    curve = draw_spectrum(axes, surface, result.grid, "undeformed distance")
    if curve is None:
        return None
    q, density, unit = curve
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
            slope = f"slope {power:.2g}".replace("-", "−")
            axes.plot(span, height, color=GREEN, linestyle=DASH_DOTTED, label=slope)
    axes.legend(loc="lower left", frameon=True, framealpha=1, edgecolor="none")  # lines end at it
    return figure


def draw_spectrum(axes, surface, grid, label):
    """Draw the radial power spectrum of heights `surface` [mm].

    Return wave numbers, densities [mm4] and the `Unit` of length in which wave numbers are drawn. If there are fewer
    than three points, draw nothing and return None.
    """
    spectrum = radial_spectrum(surface, grid.dx, grid.dy, window=not grid.doubly_periodic)
    unit = choose_length_unit(max(grid.sides))
    q, density = spectrum.wave_number / unit.per_mm, spectrum.density
    known = density > 1e-14 * density.max(initial=0.0)  # the rest is rounding error
    if np.count_nonzero(known) < 3:
        return None
    axes.plot(q[known], density[known], "-", color=BLUE, label=label)
    set_log_axes(axes)
    axes.set(xlabel=f"wave number q  [1/{unit.name}]", ylabel="power spectral density C  [mm⁴]")
    return q[known], density[known], unit
