"""Default patches of base shapes, from analytic contact sizes."""

import math

from app.base.errors import InputError, format_exact
from app.problems.roller import Roller
from app.problems.shapes import Cylinder, FlatPunch, Paraboloid, Plane

MARGIN = 1.5  # half side of the patch over the semi-axis of the contact
LINE_MARGIN = 2.0  # the same for the half-width of a line contact, which is wider at the ends
END_MARGIN = 8 / 7  # side over a known length; the ends are edges of cells with a multiple of 16 cells


def default_patch(shape, contact_modulus, approach=None, load=None, hardness=None):
    """Return a patch (x0, x1, y0, y1) around a smooth shape's contact [mm].

    The patch is centred at the origin. Give the approach [mm] or the load [N]; a flat punch needs neither. With a
    hardness [N/mm2] the patch has room for a contact that is all plastic. Raises InputError if no analytic solution of
    the shape is known, or there is no contact.
    """
    if isinstance(shape, FlatPunch):
        return _centred(END_MARGIN * shape.diameter / 2, END_MARGIN * shape.diameter / 2)
    if approach is None and load is None:
        raise InputError("theory gives a patch for an approach or load only")
    if isinstance(shape, Plane) or (isinstance(shape, Cylinder) and not math.isfinite(shape.length)):
        kind = type(shape).__name__.lower()
        raise InputError(f"the contact of this {kind} has no end")
    (what, value), *_ = ((k, v) for k, v in (("load", load), ("approach", approach)) if v is not None)
    if not value > 0:
        raise InputError(f"without contact ({what} {format_exact(value)}) theory gives no patch")
    loading = {what: value}
    if isinstance(shape, Cylinder):
        shape = Roller(shape.radius, shape.length)
    plastic = value / hardness if what == "load" and hardness else 0.0  # area of plastic contact
    if isinstance(shape, Roller):
        half_x, half_y = _roller_sides(shape, contact_modulus, loading)
        return _centred(max(half_x, LINE_MARGIN * plastic / (4 * shape.half_length)), half_y)
    contact = shape.analytic(contact_modulus, **loading)
    if contact is None:
        raise InputError("this shape has no theory of its contact")
    growth = max(1.0, math.sqrt(plastic / (math.pi * contact.a * contact.b)))
    return _centred(growth * MARGIN * contact.a, growth * MARGIN * contact.b)


def _roller_sides(roller, contact_modulus, loading):
    """Return half the sides of a roller's patch [mm].

    The sides follow from line contact, or from Hertz's ellipse if an arc crown makes the contact shorter than the
    roller.
    """
    line = roller.line_contact(contact_modulus, **loading)
    # A tilt increases the load per length at one end, as on an elastic foundation.
    tilt = abs(roller.tilt) * roller.half_length / line.approach
    half_width = LINE_MARGIN * line.a * math.sqrt(1 + tilt if tilt < 1 else 2 * math.sqrt(tilt))
    half_length = END_MARGIN * roller.half_length
    if roller.crown == "arc":
        ellipse = Paraboloid(roller.radius, roller.crown_radius).analytic(contact_modulus, **loading)
        if ellipse.b < roller.half_length:
            shift = abs(roller.tilt) * roller.crown_radius
            return MARGIN * ellipse.a, min(MARGIN * ellipse.b + shift, half_length)
    return half_width, half_length


def _centred(half_x, half_y):
    return -half_x, half_x, -half_y, half_y
