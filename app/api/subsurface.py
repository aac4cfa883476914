"""Stress below the surface of a solution."""

from types import SimpleNamespace

import numpy as np

from app.base.errors import InputError
from app.halfspace.stress.layered import LayeredStress
from app.halfspace.stress.subsurface import StressMaximum, SubsurfaceStress, is_largest, von_mises
from app.io.contact_fields import ContactFields
from app.io.result import find_layer, find_poisson_ratio

_SECTION_DEPTH = 4.0  # of a section, over the depth of the largest stress


def stress(
    solution: ContactFields, poisson_ratio: float | None = None, body: int | None = None
) -> SubsurfaceStress:
    """Return the stress in a body, from the pressure of a solution.

    If the solution is on several ranks, call this function on one rank with ``solution.gather()``.

    Parameters
    ----------
    solution : Solution or Result
    poisson_ratio : float, optional
        Poisson's ratio of the body; default: the problem's.
    body : int, optional
        Number of the body, 1 or 2, if the problem states both materials; default: the first that is not rigid. If
        only one body is coated, it is body 1.

    Returns
    -------
    SubsurfaceStress
        A `LayeredStress` if the body has a coating.

    Raises
    ------
    InputError
        If Poisson's ratio is unknown or not allowed, or if `solution` is no Solution or has the rows of one rank only.

    Examples
    --------
    >>> from app import ContactProblem, Grid, Material, solve
    >>> grid = Grid.from_domain(64, 64, (-1, 1, -1, 1))
    >>> sphere = ContactProblem(grid, Material.combined(80000, 0.3), lambda x, y: (x**2 + y**2) / 40)
    >>> hottest = stress(solve(sphere, approach=0.02)).maximum()
    >>> round(hottest.depth, 1)  # 0.48 radii of the contact
    0.3
    """
    if not (hasattr(solution, "pressure") and hasattr(solution, "attributes")):
        raise InputError(
            f"stress: is {type(solution).__name__}; needed: a Solution, or read_result(FILE) of a result file"
        )
    grid, facts = solution.grid, solution.attributes
    if "kernel" in facts:
        raise InputError(
            f"stress: is not known below the surface of bodies with the kernel {facts['kernel']}"
        )
    if poisson_ratio is not None and "coating_thickness" in facts:
        raise InputError(
            "poisson_ratio= (--poisson): has no effect with a coating; the result has all ratios"
        )
    if poisson_ratio is not None and body is not None:
        raise InputError("body: has no effect with a Poisson ratio")
    layer = find_layer(facts, body)
    if layer is None and poisson_ratio is None:
        poisson_ratio = find_poisson_ratio(facts, body)
    if layer is None and poisson_ratio is None:
        raise InputError(
            "Poisson's ratio of the body is not known: the material was given by its contact modulus alone; "
            "needed: poisson_ratio= (--poisson NU)"
        )
    if solution.pressure.shape != grid.shape:
        raise InputError("solution: has the rows of one rank; needed: solution.gather() on one rank")
    if layer is not None:
        return LayeredStress(solution.pressure, grid, layer)
    return SubsurfaceStress(solution.pressure, grid, poisson_ratio)


def survey(below, depths=64, at=None, deepest=None):
    """Return largest stresses, and stresses on sections and line.

    The result has the attributes

    - `hottest` and `sheared`, the largest von Mises and the largest shear stress, each a StressMaximum;
    - `layers`, the LayerMaxima of a coated body, and `interface`, the depth of its interface [mm]; else None;
    - `section_x`, `section_y` and `line`, the stresses on two vertical sections and on a vertical line;
    - `at`, the StressMaximum on the line.

    Parameters
    ----------
    below : SubsurfaceStress
    depths : int
        Number of depths, from 0 on. Both sides of an interface, and depths in a thin coating, are added.
    at : (float, float), optional
        Point (x, y) [mm] through which sections and line go; default: the point of the largest stress.
    deepest : float, optional
        Last depth [mm]; default: 4 times the depth of the largest stress, or the contact's width if larger.
    """
    hottest, sheared = below.maxima()
    x, y = at or (hottest.x, hottest.y)
    least = max(4 * max(below.grid.dx, below.grid.dy), _contact_width(below, hottest))
    depths = np.linspace(0.0, deepest or max(_SECTION_DEPTH * hottest.depth, least), depths)
    depths = below.include_interface(depths)
    line = below.line(depths, x, y)
    largest = hottest
    if at is not None:
        k = int(np.argmax(is_largest(mises := von_mises(line))))
        largest = StressMaximum(float(mises[k]), x, y, float(depths[k]), line[:, k])
    return SimpleNamespace(
        hottest=hottest,
        sheared=sheared,
        layers=below.layer_maxima(),
        interface=below.interface,
        at=largest,
        depths=depths,
        section_x=below.section(depths, y=y),
        section_y=below.section(depths, x=x),
        line=line,
        poisson_ratio=below.nu,
        body=below.describe("ν"),
    )


def _contact_width(below, at):
    """Return the smaller width of the contact along x and y [mm].

    The width is measured through the point `at`.
    """
    grid, widths = below.grid, []
    i, j = int((at.x - grid.x0) / grid.dx), int((at.y - grid.y0) / grid.dy)
    for line, cell, k in ((below.pressure[j], grid.dx, i), (below.pressure[:, i], grid.dy, j)):
        apart = np.flatnonzero(line <= 0)
        before, behind = apart[apart < k], apart[apart > k]
        widths.append(
            cell * ((behind[0] if behind.size else line.size) - (before[-1] + 1 if before.size else 0))
        )
    return min(widths)
