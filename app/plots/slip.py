"""Picture of partial slip."""

import numpy as np

from app.plots.maps import PRESSURE_MAP, Canvas
from app.plots.style import new_panels, with_style


@with_style
def slip_figure(result, title):
    """Draw maps of the traction over its limit, and of the slip; return None for a result without slip."""
    facts, fields = result.attributes, result.extra
    if not (fields.keys() >= {"traction", "slip"} and facts.keys() >= {"friction", "tangential_load"}):
        return None
    canvas = Canvas(result, zoom=True, lie=True)
    figure, (first, second) = new_panels([canvas.size] * 2, 2, title)
    share = fields["traction"] / np.where(result.contact, facts["friction"] * result.pressure, np.nan)
    label = f"traction q / (μ p) at Q = {facts['tangential_load']:.4g} N\n1: slips"
    canvas.draw_field(first, share[canvas.view], PRESSURE_MAP, label, vmin=0, vmax=1)
    canvas.draw_other(second, fields["slip"], "slip", "mm")
    return figure
