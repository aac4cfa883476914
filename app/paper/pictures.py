"""Figures of the paper."""

from functools import partial

import numpy as np
from matplotlib.colors import ListedColormap, LogNorm
from scipy.special import ndtri

from app.halfspace.grid import Grid
from app.halfspace.influence import influence_quadrant
from app.halfspace.material import Material
from app.paper import smoother_analysis, trace
from app.paper.item import CASES, Item
from app.paper.tables import converged
from app.paper.trace import HERTZ_DOMAIN, PUNCH_DOMAIN, make_surface
from app.plots.maps import LENGTH_MAP
from app.plots.style import BLUE, GREEN, GREY, ORANGE, new_figure, with_style
from app.problems.statistics import normal_plot

_MARKERS = ((BLUE, "o", "-"), (ORANGE, "s", "--"), (GREEN, "^", ":"))


def _nothing(largest):
    return {}


def _letter(axes, text):
    for letter, panel in zip("abcdefghi", np.ravel(axes), strict=False):
        panel.set_title(f"({letter}) {text[letter]}" if letter in text else f"({letter})", loc="left")


# -- Section 2: influence coefficients -----------------------------------------------------------------------


@with_style
def _figure2(outcomes):
    material = Material.combined(82000.0, 0.28)
    grid = Grid.from_domain(32, 32, HERTZ_DOMAIN)
    quadrant = material.shear_modulus * influence_quadrant(grid, material.kernel, slice(0, 17), 17)
    whole = np.block([[quadrant[:0:-1, :0:-1], quadrant[:0:-1]], [quadrant[:, :0:-1], quadrant]])
    figure = new_figure(10.0, 4.4)
    left, right = figure.subplots(1, 2)
    half = 16.5
    ends = -half, half, -half, half
    image = left.imshow(whole, cmap=LENGTH_MAP, origin="lower", norm=LogNorm(), extent=ends)
    left.set(xlabel="jx − ix  [cells]", ylabel="jy − iy  [cells]")
    figure.get_layout_engine().set(wspace=0.08)
    figure.colorbar(image, ax=left, shrink=0.9).set_label("G A  [mm]")
    cells = np.arange(17)
    distance = np.maximum(cells * grid.dx, 1e-300)
    point = (1 - material.poisson_ratio) / np.pi * grid.cell_area / distance
    right.semilogy(cells * grid.dx, quadrant[0], "o-", color=BLUE, label="cell under unit pressure")
    right.semilogy(cells[1:] * grid.dx, point[1:], "--", color=ORANGE, label="point force, 1/ρ")
    right.set(xlabel="distance along x  [mm]", ylabel="G A  [mm]")
    right.legend()
    _letter([left, right], {"a": "all neighbours", "b": "along a row"})
    return figure


# -- Section 4.4: smoothers ----------------------------------------------------------------------------------


@with_style
def _figure5(outcomes):
    matrix = smoother_analysis.LineContact().matrix()
    jacobi = np.sort(smoother_analysis.modes(smoother_analysis.jacobi(matrix)).values.real)
    values = smoother_analysis.modes(smoother_analysis.gauss_seidel(matrix)).values
    order = [smoother_analysis.paper_mode_index(j, 32) for j in range(1, 33)]
    figure = new_figure(12.0, 4.2)
    first, second, third = figure.subplots(1, 3)
    number = np.arange(1, 33)
    first.plot(number, jacobi[::-1], "o", color=BLUE)
    first.axhspan(-1, 1, color="0.9", linewidth=0, zorder=0)
    first.text(2, -2.4, "|λ| < 1", color="0.35")
    first.annotate(f"−{abs(jacobi[0]):.1f}", (32, jacobi[0]), (-44, 6), textcoords="offset points")
    first.set(xlabel="number j", ylabel="eigenvalue λ")
    angle = np.linspace(0, 2 * np.pi, 200)
    second.plot(np.cos(angle), np.sin(angle), color=GREY, linewidth=1.2, zorder=0)
    second.plot(values.real, values.imag, "o", color=BLUE)
    second.set(xlabel="Re λ", ylabel="Im λ", aspect="equal", xlim=(-1.1, 1.1), ylim=(-1.1, 1.1))
    third.plot(number, np.abs(values[order]), "o", color=BLUE)
    third.axhline(1, color=GREY, linewidth=1.2)
    third.set(xlabel="mode j", ylabel="|λ|", ylim=(-0.03, 1.1))
    _letter([first, second, third], {"a": "Jacobi", "b": "Gauss–Seidel", "c": "Gauss–Seidel, moduli"})
    return figure


@with_style
def _figure6(outcomes):
    contact = smoother_analysis.LineContact()
    iteration = smoother_analysis.gauss_seidel(contact.matrix())
    history = smoother_analysis.sweep_history(iteration, contact.pressure())
    order = [smoother_analysis.paper_mode_index(j, contact.cells) for j in range(1, contact.cells + 1)]
    figure = new_figure(11.0, 4.4)
    left, right = figure.subplots(1, 2)
    for i, error, c, (colour, marker, line) in zip(
        history.sweeps, history.errors, history.coefficients, _MARKERS, strict=True
    ):
        label = f"after {i} sweeps" if i else "start"
        style = {"color": colour, "marker": marker, "linestyle": line, "label": label}
        left.plot(contact.grid.x(), np.abs(error), **style)
        right.plot(np.arange(1, contact.cells + 1), np.abs(c[order]), **style)
    left.set(xlabel="x  [mm]", ylabel=r"error $|p - p^i|\ /\ \max\,p$", ylim=(0, 1.9))
    left.legend(loc="upper right")
    # The first sweep removes mode 1, which would make all others look flat.
    first = np.abs(history.coefficients[0, order[0]])
    right.set(xlabel="mode j", ylabel=r"coefficient $|c_j|$", ylim=(0, 1.6))
    arrow = {"arrowprops": {"arrowstyle": "->"}, "va": "center"}
    right.annotate(f"mode 1 at the start: {first:.1f}", (1, 1.6), (2.5, 1.45), **arrow)
    right.legend(loc="center right", bbox_to_anchor=(1, 0.5))
    _letter([left, right], {"a": "error of Gauss–Seidel", "b": "in its eigenvectors"})
    return figure


@with_style
def _figure7(outcomes):
    figure = new_figure(11.0, 8.0)
    panels = figure.subplots(2, 3).ravel()
    for letter, axes, pair in zip("abcdef", panels, smoother_analysis.compare_grids(), strict=True):
        axes.plot(pair.vector.real, pair.vector.imag, "o", color=ORANGE, label="32 cells")
        title = f"|λ| = {abs(pair.value):.2f}"
        if pair.coarse_vector is not None:
            coarse = pair.coarse_vector
            circles = {"color": BLUE, "markersize": 10, "markerfacecolor": "none", "label": "16 cells"}
            axes.plot(coarse.real, coarse.imag, "o", **circles)
            title += f", {abs(pair.coarse_value):.2f} on 16 cells"
        reach = 1.15 * np.abs(pair.vector).max()
        axes.set(xlabel="Re v", ylabel="Im v", xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
        axes.set_title(f"({letter}) mode {pair.number}\n{title}", loc="left")
    panels[0].legend(loc="upper right")
    return figure


# -- Section 5: contact areas --------------------------------------------------------------------------------


def _contact_panel(axes, fields, which):
    contact, admissible = np.array(fields[which]), np.array(fields["admissible"])
    x, y = np.array(fields["x"]), np.array(fields["y"])
    dx, dy = x[1] - x[0], y[1] - y[0]
    shown = np.where(admissible == 0, 2, contact)
    edges_x, edges_y = np.append(x - dx / 2, x[-1] + dx / 2), np.append(y - dy / 2, y[-1] + dy / 2)
    colours = ListedColormap(["white", BLUE, GREY])
    # Thin lines between the cells, so that cells can be counted.
    style = {"cmap": colours, "vmin": -0.5, "vmax": 2.5, "edgecolors": "0.85", "linewidth": 0.3}
    axes.pcolormesh(edges_x, edges_y, shown, **style)
    axes.set_aspect("equal")
    for spine in axes.spines.values():
        spine.set_visible(True)


_CONTACT_COLUMNS = (("norm", "first", "start: h ≤ 0"), ("fmg_v11", "first", "start: full multigrid"),
                    ("fmg_v11", "last", "end: full multigrid"))  # fmt: skip


def _plan_contact(problem, cases):
    def plan(largest):
        return {
            (str(case), method): trace.traced(
                problem, method, 32, trace.collect_contact, **({"approach": approach} if approach else {})
            )
            for case, approach in cases.items()
            for method in ("norm", "fmg_v11")
        }

    return plan


@with_style
def _contact_figure(cases, height, outcomes):
    """Draw contact areas, one case per row.

    `cases` maps the number of a case to its approach [mm]. A single case has the approach None, because the problem
    file has it.
    """
    figure = new_figure(11.0, height)
    panels = figure.subplots(len(cases), 3, sharex=True, sharey=True, squeeze=False)
    for number, (row, (case, approach)) in enumerate(zip(panels, cases.items(), strict=True)):
        end = outcomes[str(case), "fmg_v11"]
        last, wrong = np.array(end["last"]), "" if converged(end) else ", not converged"
        for axes, (method, which, title) in zip(row, _CONTACT_COLUMNS, strict=True):
            fields = outcomes[str(case), method]
            _contact_panel(axes, fields, which)
            contact = np.array(fields[which])
            different = int((contact != last).sum())
            count = f"{int(contact.sum())} cells" + (
                f", {different} unlike the last" if which == "first" else wrong
            )
            axes.set_title(f"{title}\n{count}" if number == 0 else count, loc="left")
        name = f"case {case} ({approach.replace('-', '−')} mm)\n" if approach else ""
        row[0].set_ylabel(f"{name}y  [mm]")
    for axes in panels[-1]:
        axes.set_xlabel("x  [mm]")
    return figure


# -- rough surfaces ------------------------------------------------------------------------------------------


def _height_map(axes, n, surface):
    grid = Grid.from_domain(n, n, PUNCH_DOMAIN)
    height = surface.height(grid.x(), grid.y())
    x0, x1, y0, y1 = PUNCH_DOMAIN
    scale = {"cmap": LENGTH_MAP, "vmin": -0.3, "vmax": 0.3}
    image = axes.imshow(height, origin="lower", extent=(x0, x1, y0, y1), **scale)
    axes.set(xlabel="x  [mm]", ylabel="y  [mm]")
    return height, image


@with_style
def _figure10(outcomes):
    figure = new_figure(10.0, 7.6)
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, n in zip(panels.ravel(), (16, 32, 64, 128), strict=True):
        _, image = _height_map(axes, n, make_surface())
        axes.label_outer()
    figure.colorbar(image, ax=panels, shrink=0.8, extend="both").set_label("height z  [mm]")
    _letter(panels, {letter: f"{n} × {n} cells" for letter, n in zip("abcd", (16, 32, 64, 128), strict=True)})
    return figure


@with_style
def _figure12(outcomes):
    figure = new_figure(10.0, 7.6)
    panels = figure.subplots(2, 2)
    heights = {}
    for axes, decay in zip(panels.ravel(), (0.5, 0.8, 0.95), strict=False):
        heights[decay], image = _height_map(axes, 64, make_surface(decay))
    figure.colorbar(image, ax=panels, shrink=0.8, extend="both").set_label("height z of a, b, c  [mm]")
    plot = normal_plot(heights[0.8])
    axes = panels[1, 1]
    axes.plot(plot.height, plot.quantile, ".", color=BLUE, markersize=3, rasterized=True)
    line = np.array([plot.quantile[0], plot.quantile[-1]])
    gaussian = heights[0.8].mean() + line * heights[0.8].std()
    axes.plot(gaussian, line, color=ORANGE, linestyle="--", label="Gaussian")
    probabilities = [0.001, 0.02, 0.16, 0.5, 0.84, 0.98, 0.999]
    axes.set_box_aspect(10 / 12)
    axes.set_yticks(ndtri(probabilities), [f"{p:g}" for p in probabilities])
    axes.set(xlabel="height z  [mm]", ylabel="probability")
    axes.legend(loc="upper left")
    _letter(panels, {"a": "γ = 0.5", "b": "γ = 0.8", "c": "γ = 0.95", "d": "heights of (b), normal plot"})
    return figure


FIGURES = [
    Item("fig2", "figure", "Influence coefficients of the Hertz problem, 32 × 32 cells", _nothing, _figure2),
    Item("fig5", "figure", "Eigenvalues of Jacobi and Gauss–Seidel, line contact of 32 cells", _nothing, _figure5),
    Item("fig6", "figure", "Gauss–Seidel on the line contact: error, and its expansion in eigenvectors",
         _nothing, _figure6),
    Item("fig7", "figure", "Eigenvectors of Gauss–Seidel on 32 and 16 cells", _nothing, _figure7),
    Item("fig8", "figure", "Hertz, 32 × 32 cells: contact area at the start and at the end",
         _plan_contact("hertz", {1: None}), partial(_contact_figure, {1: None}, 3.6)),
    Item("fig10", "figure", "The rough surface on four successive grids", _nothing, _figure10),
    Item("fig11", "figure", "Rough punch, 32 × 32 cells: contact area at the start and at the end",
         _plan_contact("punch", CASES), partial(_contact_figure, CASES, 9.6)),
    Item("fig12", "figure", "Rough surfaces with different decay, and normal probability plot", _nothing, _figure12),
]  # fmt: skip
