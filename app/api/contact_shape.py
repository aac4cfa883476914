"""Lengths that describe the shape of a contact: of an ellipse, of a line contact, or of any other contact."""

from math import cos, hypot, nan, pi, radians, sin

EXTENTS = "contact_extent_x", "contact_extent_y"
SEMI_AXES = "semi_axis_major", "semi_axis_minor"
MAX_DEVIATION = 0.05  # relative, of the extents and the area of an ellipse
MIN_LINE_ASPECT = 3.0  # length over width of a line contact


def is_ellipse(facts, grid):
    """Return whether the contact is an ellipse, up to the size of cells.

    `facts` are the attributes of a result. The ellipse with the second moments of the contact must have its area and
    extents.
    """
    a, b, angle = (facts.get(name, nan) for name in (*SEMI_AXES, "major_axis_angle"))
    if not a > 0:
        return False
    turn = radians(angle)
    pairs = (
        ("contact_extent_x", 2 * hypot(a * cos(turn), b * sin(turn)), grid.dx),
        ("contact_extent_y", 2 * hypot(a * sin(turn), b * cos(turn)), grid.dy),
    )
    # Results of old versions have no extents.
    fits = [
        abs(facts.get(name, size) - size) <= max(2 * cell, MAX_DEVIATION * size) for name, size, cell in pairs
    ]
    edge = facts["perimeter"] * max(grid.dx, grid.dy) / 8  # a part of the area of the cells at the edge
    return all(fits) and abs(facts["contact_area"] - pi * a * b) <= max(MAX_DEVIATION * pi * a * b, edge)


def contact_shape(facts, grid):
    """Return lengths that describe the contact, by their names; no lengths if unknown.

    The lengths are the semi-axes of an ellipse, the half length and half width of a line contact, together with its
    load per length, or the extents of other contacts in x and in y.
    """
    if is_ellipse(facts, grid):
        return {name: facts[name] for name in SEMI_AXES}
    x, y = (facts.get(name, 0.0) for name in EXTENTS)
    if grid.one_way:
        length, width = (grid.sides[0], y) if grid.one_way == "x" else (grid.sides[1], x)
    else:
        length, width = max(x, y), min(x, y)
    if not width > 0:
        return {}
    if not grid.one_way and length < MIN_LINE_ASPECT * width:
        return dict(zip(EXTENTS, (x, y), strict=True))
    shape = {"load_per_length": facts["load"] / length}
    shape |= {} if grid.one_way else {"half_length": length / 2}
    return shape | {"half_width": width / 2, "mean_half_width": facts["contact_area"] / length / 2}
