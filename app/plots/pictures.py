"""Choice of a result's figures by name."""

import sys
from functools import partial
from types import SimpleNamespace
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from app.base.errors import InputError, check_type
from app.io.frames import UNITS
from app.plots import curves, figures, flow, load_curves, slip
from app.plots.maps import Canvas
from app.plots.style import interactive, new_figure, with_style
from app.reference.hertz import EllipticHertz


class Drawing(NamedTuple):
    """Result of `plot`: the matplotlib figure and axes of a picture.

    `axes` is a list if there are several.
    """

    figure: object
    axes: object

    def __getattr__(self, name):
        """Return an attribute of the figure, such as ``savefig``."""
        if name.startswith("_"):  # notebooks and copies look for these
            raise AttributeError(name)
        return getattr(self.figure, name)

    def _ipython_display_(self):
        """Show nothing, because a notebook shows the figure itself."""


def analytic_reference(result):
    """Return the Hertz solution of a result that has analytic values, None for other contacts."""
    values = result.attributes
    needed = ("hertz_rx", "hertz_ry", "contact_modulus", "analytic_approach")
    if values.get("problem") not in ("hertz", "sphere") or not values.keys() >= set(needed):
        return None
    return EllipticHertz.from_approach(*(values[name] for name in needed))


def _path_figure(result, _):
    path = load_curves.get_path(result)
    return path and load_curves.path_figure([path], figures.make_title(result, path=True))


def _worn_figure(result, reference):
    return _panel_figure("worn_depth", result, reference) if "worn_depth" in panels_of(result) else None


# Name -> function of a result and its `analytic_reference` that returns a figure or None.
PICTURES = {
    "contact": lambda result, _: figures.contact_figure(result),
    "pressure": figures.pressure_figure,
    "deformation": lambda result, _: figures.deformation_figure(result),
    "sections": figures.section_figure,
    "distributions": lambda result, _: curves.distribution_figure(result),
    "spectrum": lambda result, _: curves.spectrum_figure(result),
    "flow": lambda result, _: flow.flow_figure(result, figures.make_title(result)),
    "worn_depth": _worn_figure,
    "slip": lambda result, _: slip.slip_figure(result, figures.make_title(result)),
    "path": _path_figure,
    "history": lambda result, _: figures.history_figure(result),
    "summary": figures.summary_figure,
}


def pictures_of(result, names):
    """Yield name and figure of a result's pictures.

    `names` are the names of the pictures asked for, of `drawings_of` the result.
    """
    reference, drawings = analytic_reference(result), drawings_of(result)
    for name in names:
        if name not in drawings:
            raise InputError(f"plot {name!r}: must be one of {', '.join(drawings)}")
    for name in names:
        if figure := drawings[name](result, reference):
            yield name, figure


def _draw_section(along):
    def draw(axes, result, reference, **_):
        figures.draw_section(axes, result, along, *figures.section_place(result), reference)

    return draw


# Name -> function that draws one panel on given axes; `how` is `titled` of maps.
PANELS = {
    "contact": lambda axes, result, _, **how: Canvas(result, zoom=True, **how).draw_contact(axes),
    "pressure": lambda axes, result, _, **how: Canvas(result, zoom=True, **how).draw_pressure(axes),
    "displacement": lambda axes, result, _, **how: Canvas(result, **how).draw_displacement(axes),
    "gap": lambda axes, result, _, **how: Canvas(result, **how).draw_gap(axes),
    "plastic_depth": lambda axes, result, _, **how: Canvas(result, zoom=True, **how).draw_plastic_depth(axes),
    "section_x": _draw_section("x"),
    "section_y": _draw_section("y"),
    "residual": lambda axes, result, *_, **__: figures.draw_residual(axes, result),
}


def _other_fields(result):
    """Return the fields without a panel of their own, by name."""
    return {"undeformed_distance": result.undeformed_distance} | result.extra


def _draw_map(name, axes, result, _, **how):
    field, unit = _other_fields(result)[name], (UNITS | result.units).get(name, "1")
    canvas = Canvas(result, zoom=not np.nan_to_num(field[~result.contact]).any(), **how)
    canvas.draw_other(axes, field, name.replace("_", " "), unit)


def panels_of(result):
    """Return `PANELS`, and maps of the other fields of a result."""
    fields = {name: np.asarray(field) for name, field in _other_fields(result).items()}
    shown = [name for name, field in fields.items() if field.shape == result.pressure.shape]
    return PANELS | {name: partial(_draw_map, name) for name in shown if fields[name].dtype.kind in "biuf"}


def drawings_of(result):
    """Return `PICTURES`, and functions that draw single panels, by name."""
    return {name: partial(_panel_figure, name) for name in panels_of(result)} | PICTURES


@with_style
def _panel_figure(name, result, reference):
    size = (7.4, 4.4) if name in PANELS.keys() - {"displacement", "gap"} else Canvas(result).size
    figure = new_figure(*size, figures.make_title(result))
    panels_of(result)[name](figure.subplots(), result, reference)
    return figure


def plot(result, name="summary", axes=None):
    """Draw a picture of a result, or one panel on given axes; return a `Drawing`.

    `name` is in `drawings_of` the result; if axes are given, in `panels_of` it.
    """
    if axes is None:
        return show(lambda: dict(pictures_of(result, [name])).get(name), name)
    panels = panels_of(result)
    if name not in panels:
        raise InputError(f"plot {name!r}: must be one of {', '.join(panels)} with ax=")
    check_type("ax", axes, Axes, "axes of matplotlib")
    panels[name](axes, result, analytic_reference(result), titled=False)
    return on_axes(axes)


def on_axes(axes):
    """Return the `Drawing` on the user's axes.

    Room is made for the labels of the picture.
    """
    figure = axes.get_figure()
    # An axes of Figure.add_axes has no method get_subplotspec before matplotlib 3.7, and returns None afterwards.
    in_grid = all(hasattr(panel, "get_subplotspec") and panel.get_subplotspec() for panel in figure.axes)
    if in_grid and isinstance(figure, Figure) and figure.get_layout_engine() is None:
        figure.set_layout_engine("tight")
    return Drawing(figure, axes)


@with_style
def spots_figure(patches):
    """Draw a map of contact spots, given as `Patches`."""
    contact = patches.labels > 0
    shown = SimpleNamespace(
        grid=patches.grid,
        contact=contact,
        undeformed_distance=np.zeros(contact.shape),
        attributes={"contact_fraction": contact.mean()},
        patches=lambda: patches,
    )
    canvas = Canvas(shown, zoom=True, lie=True)
    figure = new_figure(*canvas.size)
    canvas.draw_contact(figure.subplots())
    return figure


def _prepare_notebook():
    """Register IPython's inline backend for pictures.

    Some versions of IPython register it too late for the first figure.
    """
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is not None and "inline" in matplotlib.get_backend():
        from matplotlib_inline.backend_inline import configure_inline_support

        matplotlib.interactive(True)
        configure_inline_support(shell, matplotlib.get_backend())


def show(draw, name):
    """Return the `Drawing` of ``draw()`` for a notebook.

    The message contains `name` if there is nothing to draw.
    """
    _prepare_notebook()
    with interactive():
        figure = with_style(draw)()
    if figure is None:
        raise InputError(f"plot {name!r}: the result has nothing to draw for it")
    with_style(figure.draw_without_rendering)()  # ticks are made in this style
    panels = {axes.get_subplotspec(): axes for axes in reversed(figure.axes)}
    panels = list(reversed(panels.values()))
    return Drawing(figure, panels[0] if len(panels) == 1 else panels)
