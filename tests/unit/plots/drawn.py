"""What figures show: texts that touch, values of images, panels."""

from itertools import pairwise

import numpy as np

from app.plots import heights
from app.problems.surfaces.reading import read_surface


def overlaps(labels, renderer):
    """Whether texts that follow each other touch."""
    boxes = [label.get_window_extent(renderer) for label in labels if label.get_text()]
    return any(a.overlaps(b) for a, b in pairwise(boxes))


def image_values(figure):
    """The topmost image of the first axes, and the coordinates of its pixel centres."""
    image = figure.axes[0].images[-1]
    values = np.ma.masked_invalid(image.get_array())
    x0, x1, y0, y1 = image.get_extent()
    ny, nx = values.shape
    assert image.origin == "lower"
    return values, x0 + (np.arange(nx) + 0.5) * (x1 - x0) / nx, y0 + (np.arange(ny) + 0.5) * (y1 - y0) / ny


def surface_panels(z, spacing=(0.001, 0.001)):
    figure = heights.surface_figure(read_surface(z, unit="um", level="plane", spacing=spacing))
    figure.draw_without_rendering()
    return figure, dict(zip(("map", "x", "y", "heights", "spectrum"), figure.axes, strict=False))


def panel_names(figure):
    return [axes.get_ylabel().partition("  [")[0] for axes in figure.axes]
