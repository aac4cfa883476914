"""Picture of the flow through the gap."""

import numpy as np
from matplotlib.colors import LogNorm

from app.plots.maps import LENGTH_MAP, PRESSURE_MAP, Canvas, format_number
from app.plots.style import new_panels, with_style


@with_style
def flow_figure(result, title):
    """Draw maps of fluid pressure and flux; return None for a result without flow.

    White cells have no fluid, or no flow.
    """
    if "fluid_pressure" not in result.extra:
        return None
    pressure, flux = result.extra["fluid_pressure"], np.hypot(result.extra["flux_x"], result.extra["flux_y"])
    canvas, highest = Canvas(result, lie=True), float(flux.max())
    figure, (first, second) = new_panels([canvas.size] * 2, 2, title)
    canvas.draw_field(first, pressure, LENGTH_MAP, "fluid pressure P, drop of 1 along x\nwhite: no flow")
    norm = LogNorm(1e-4 * highest, highest) if highest else None
    label = f"flux, drop and viscosity of 1  [mm\u00b2]\nmaximum {format_number(highest)}"
    canvas.draw_field(second, flux, PRESSURE_MAP, label, "min" if highest else "neither", True, norm=norm)
    return figure
