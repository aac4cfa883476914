"""Comparisons with analytic solutions, and observed orders of convergence."""

import numpy as np
from scipy.special import gammaln

from app.halfspace.grid import Grid
from app.halfspace.material import Material
from app.problems.contact_problem import ContactProblem
from app.problems.random_surfaces import SelfAffineSurface
from app.problems.shapes import Cylinder
from app.reference import Bisinusoidal, Cone, EllipticHertz, FlatCircularPunch, Sphere, Westergaard
from app.reference import full_contact_pressure as flattening
from app.verification.check import Check, Figure, order_figure
from app.verification.solving import difference, solved

E_STAR = 1000.0  # [N/mm2]
MATERIAL = Material.from_contact_modulus(E_STAR)
_TIGHT = {"lcp_rtol": 1e-8}
_SIZES = 16, 24, 32, 48, 64, 96, 128, 192, 256  # Many, because the contact edge moves by whole cells.


def solve_at_approach(contact, nx, ny, half_x, half_y):
    """Solve at the approach of an analytic solution `contact`.

    The patch is centred at the origin, with half sides `half_x` and `half_y` [mm]. Return the solution, its grid and
    the exact pressure.
    """
    grid = Grid.from_domain(nx, ny, (-half_x, half_x, -half_y, half_y))
    problem = ContactProblem(grid, MATERIAL, contact.undeformed_distance)
    found = solved(problem, options=_TIGHT, approach=contact.approach)
    return found, grid, contact.pressure(grid.x(), grid.y()[:, None])


def _ellipse(contact, sizes, label=""):
    """Compare load and pressure of an ellipse with Hertz, on several grids."""
    loads, pressures, peaks = [], [], []
    for n in sizes:
        found, _, exact = solve_at_approach(contact, n, n, 1.5 * contact.a, 1.5 * contact.b)
        loads.append(abs(found.load / contact.load - 1))
        pressures.append(np.sqrt(np.mean((found.pressure - exact) ** 2)) / contact.max_pressure)
        peaks.append(abs(found.max_pressure / contact.max_pressure - 1))
    finest = 60 / sizes[-1] ** 2
    return [
        order_figure(f"the load{label}", sizes, loads, 1.2),
        order_figure(f"the pressure, rms{label}", sizes, pressures, 0.9),
        Figure(f"error of the load on {sizes[-1]}²{label}", loads[-1], most=finest),
        Figure(f"error of the largest pressure{label}", peaks[-1], most=finest),
    ]


def sphere(quick):
    """Compare a sphere with the solution of Hertz (1882)."""
    return _ellipse(Sphere.from_approach(5.0, E_STAR, 0.2), _SIZES[: 5 if quick else None])


def ellipses(quick):
    """Compare ellipsoids with Hertz's solution, the paper's among them."""
    sizes, ratios = _SIZES[: 5 if quick else None], (300 / 163, 30) if quick else (300 / 163, 4, 30, 1000)
    figures = []
    for ratio in ratios:
        contact = EllipticHertz.from_approach(10.0 * ratio, 10.0, E_STAR, 0.05)
        figures += _ellipse(contact, sizes, f", radii 1 : {ratio:.3g}, axes 1 : {contact.a / contact.b:.3g}")
    return figures


def cone(quick):
    """Compare a cone with the solution of Sneddon (1965).

    All grids have a cell on the tip.
    """
    contact, sizes = Cone.from_approach(0.05, E_STAR, 0.05), (17, 33, 65) if quick else (17, 33, 65, 129, 257)
    loads, areas = [], []
    for n in sizes:
        found, _, _ = solve_at_approach(contact, n, n, 1.0, 1.0)
        loads.append(abs(found.load / contact.load - 1))
        areas.append(abs(found.contact_area / contact.contact_area - 1))
    return [
        order_figure("the load", sizes, loads, 1.0),
        Figure(f"error of the load on {sizes[-1]}²", loads[-1], most=0.3 / sizes[-1]),
        Figure("error of the contact area", areas[-1], most=2.6 / sizes[-1]),
    ]


def punch(quick):
    """Compare a flat circular punch with the analytic solution.

    The load is compared with the load of a punch whose area is the computed contact area.
    """
    contact, sizes = (
        FlatCircularPunch.from_approach(1.0, E_STAR, 0.01),
        (16, 32, 64, 128, 256)[: 3 if quick else 5],
    )
    loads, wrong = [], 0
    for n in sizes:
        found, grid, exact = solve_at_approach(contact, n, n, 1.0, 1.0)
        r = np.hypot(grid.x(), grid.y()[:, None])
        wrong += int((found.contact != (r <= 1)).sum())
        radius = np.sqrt(found.contact_area / np.pi)
        loads.append(abs(found.load / FlatCircularPunch.from_approach(radius, E_STAR, 0.01).load - 1))
        middle = abs(found.pressure / np.where(r < 0.8, exact, 1.0) - 1)[r < 0.8].max()
    return [
        order_figure("the load", sizes, loads, 0.8, 1.2),
        Figure("cells in contact outside the punch, or not in contact under it", wrong, 0, 0),
        Figure(f"error of the pressure on {sizes[-1]}², r < 0.8 a", middle, most=1.3 / sizes[-1]),
    ]


def power_laws(quick):
    """Compare bodies of revolution z = c r^n with Galin's and Sneddon's solution."""
    sizes, figures = ((17, 33, 65) if quick else (33, 65, 129, 257)), []
    for n in (1.5, 4) if quick else (1.5, 3, 4, 8):
        # approach = k c a^n, load = 2 E* a approach n / (n + 1), p(0) = E* approach n / (pi a (n - 1))
        k = np.sqrt(np.pi) * np.exp(gammaln(n / 2 + 1) - gammaln(n / 2 + 0.5))
        a, c = 1.0, 0.05
        approach = k * c * a**n
        load, middle = 2 * E_STAR * a * approach * n / (n + 1), E_STAR * approach * n / (np.pi * a * (n - 1))
        loads, areas, middles = [], [], []
        for size in sizes:
            grid = Grid.from_domain(size, size, (-1.4, 1.4, -1.4, 1.4))
            problem = ContactProblem(grid, MATERIAL, lambda x, y, c=c, n=n: c * np.hypot(x, y) ** n)
            found = solved(problem, options=_TIGHT, approach=approach)
            loads.append(abs(found.load / load - 1))
            areas.append(abs(found.contact_area / np.pi - 1))
            middles.append(abs(found.pressure[size // 2, size // 2] / middle - 1))
        figures += [
            order_figure(f"the load, n = {n:g}", sizes, loads, 1.5),
            Figure(f"error of the load on {sizes[-1]}², n = {n:g}", loads[-1], most=0.2 / sizes[-1]),
            Figure(f"error of the contact area, n = {n:g}", areas[-1], most=4 / sizes[-1]),
            Figure(
                f"error of the pressure in the middle, n = {n:g}", middles[-1], most=0.5 / sizes[-1] ** 0.5
            ),
        ]
    return figures


_AMPLITUDE, _LENGTH = 0.02, 1.7


def _waves(contact, nx, ny, symbol):
    """Return a wavy surface's problem on one period.

    `symbol` is the kind of the periodic patch, "spectral" or "love".
    """
    grid = Grid.from_domain(nx, ny, (0.0, _LENGTH, 0.0, _LENGTH * min(ny / nx, 1)))
    return ContactProblem(grid, MATERIAL, contact.undeformed_distance, periodic=symbol)


def westergaard(quick):
    """Compare waves in one direction with Westergaard's solution."""
    sizes = (32, 48, 64, 96, 128) if quick else (32, 48, 64, 96, 128, 192, 256, 384, 512)
    c = Westergaard(_AMPLITUDE, _LENGTH, E_STAR, 0.3 * np.pi * E_STAR * _AMPLITUDE / _LENGTH)
    figures = []
    for symbol in ("spectral", "love"):
        tops, rms, loads, cells = [], [], [], []
        for n in sizes:
            found = solved(_waves(c, n, 4, symbol), options=_TIGHT, approach=c.approach)
            rms.append(np.sqrt(np.mean((found.pressure - c.pressure(found.x, 0.0)) ** 2)) / c.max_pressure)
            tops.append(abs(found.max_pressure / c.max_pressure - 1))
            loads.append(abs(found.mean_pressure / c.mean_pressure - 1))
            cells.append(abs(found.contact[0].sum() - c.contact_fraction * n))
        by_pressure = solved(_waves(c, sizes[-1], 4, symbol), mean_pressure=c.mean_pressure)
        figures += [
            order_figure(f"the pressure on the summits, {symbol}", sizes, tops, 1.7),
            order_figure(f"the pressure, rms, {symbol}", sizes, rms, 0.8),
            order_figure(f"the mean pressure, {symbol}", sizes, loads, 1.5),
            Figure(f"error of the mean pressure on {sizes[-1]}, {symbol}", loads[-1], most=5e-4),
            Figure(f"contact too wide or too narrow by so many cells, {symbol}", max(cells), most=2),
            Figure(
                f"error of the mean gap by mean pressure, {symbol}",
                abs(by_pressure.mean_gap / c.mean_gap - 1),
                most=2e-3,
            ),
        ]
    return figures


def bisinusoidal(quick):
    """Compare waves in two directions with Johnson, Greenwood and Higginson (1985).

    The solution is known in two limits: Hertz's on every summit under a light load, and a crack around every valley
    near full contact.
    """
    n, figures = 128 if quick else 512, []

    def at(share, n=n):
        needed = np.sqrt(2) * np.pi * E_STAR * _AMPLITUDE / _LENGTH
        c = Bisinusoidal(_AMPLITUDE, _LENGTH, E_STAR, share * needed)
        return c, solved(_waves(c, n, n, "spectral"), mean_pressure=c.mean_pressure)

    for share in (0.003,) if quick else (0.001, 0.003):
        c, found = at(share)
        peak = found.max_pressure / c.on_a_summit.max_pressure
        area = found.contact_fraction_corrected / c.light_contact_fraction
        figures += [
            Figure(f"error of the largest pressure at {share:g} p*", abs(peak - 1), most=0.02),
            Figure(f"error of the contact area at {share:g} p*", abs(area - 1), most=0.04),
        ]  # fmt: skip
    for share in (0.9, 0.95) if quick else (0.9, 0.95, 0.98):
        c, found = at(share)
        area, gap = c.heavy_contact_fraction, c.heavy_mean_gap
        figures += [
            Figure(f"error of the contact share at {share:g} p*", abs(found.contact_fraction - area), most=2e-3),
            Figure(f"error of the mean gap at {share:g} p*", abs(found.mean_gap / gap - 1), most=0.6 * (1 - share)),
        ]  # fmt: skip
    c, found = at(1.1)
    exact = c.full_pressure(found.x, found.y[:, None])
    off = abs(found.pressure - exact).max() / exact.max()
    return [*figures, Figure("error of the pressure at 1.1 p*, full contact", off, most=1e-12)]


def full_contact(quick):
    """Compare full contact of a rough surface with the exact pressure.

    A wave h_q of the undeformed distance gives the wave p_q = -E* |q| h_q / 2 of the pressure.
    """
    n, figures = 40 if quick else 256, []
    for nx, ny in ((n, n), (n, n + 8)):
        grid = Grid.from_domain(nx, ny, (0.0, 1.5, 0.0, 0.8))
        distance = -SelfAffineSurface(0.8, 0.4, 0.1, (1.5, 0.8), 5, rms_slope=0.1).height(grid.x(), grid.y())
        problem = ContactProblem(grid, MATERIAL, distance, periodic=True)
        needed = -flattening(distance, grid.dx, grid.dy, E_STAR).min()
        found, less = (solved(problem, mean_pressure=share * needed) for share in (1.01, 0.97))
        exact = flattening(distance, grid.dx, grid.dy, E_STAR, 1.01 * needed)
        open_still = abs(found.gap).max() / np.ptp(distance)
        figures += [
            Figure(f"error of the pressure, {nx} × {ny}", difference(found.pressure, exact), most=1e-12),
            Figure("largest gap over that of the undeformed bodies", open_still, most=1e-12),
            Figure("contact share at 0.97 of the load that it needs", less.contact_fraction, most=1 - 1e-9),
        ]  # fmt: skip
    return figures


def line_contact(quick):
    """Compare a cylinder with Hertz, on a periodic patch one cell wide."""
    sizes = (256, 384, 512, 768, 1024) if quick else (256, 384, 512, 768, 1024, 1536, 2048)
    width, load, radius = 0.25, 2.0, 10.0
    half = np.sqrt(4 * load * radius / (np.pi * E_STAR))
    top = 2 * load / (np.pi * half)
    errors = []
    for n in sizes:
        # Images bend the surface by (half / patch)^2 of what the cylinder does: the patch grows with the grid.
        reach = 8.0 * n / sizes[0]
        grid = Grid.from_domain(2 * n * n // sizes[0], 1, (-reach, reach, 0.0, width))
        found = solved(
            ContactProblem(grid, MATERIAL, Cylinder(radius), periodic=True),
            options={"lcp_rtol": 1e-10},
            load=load * width,
        )
        exact = top * np.sqrt(np.maximum(1 - (grid.x() / half) ** 2, 0))
        errors.append(abs(found.max_pressure / top - 1))
        inside = abs(found.pressure[0] - exact)[abs(grid.x()) < 0.9 * half].max() / top
        wide = abs(found.contact_cells * grid.dx - 2 * half) / grid.dx
    return [
        order_figure("the largest pressure, on patches that grow like the grid", sizes, errors, 1.2),
        Figure("error of the pressure on the finest grid, |x| < 0.9 a", inside, most=0.005),
        Figure("contact too wide or too narrow by so many cells", wide, most=2.5),
    ]


CHECKS = (
    Check("sphere", "Sphere", "Hertz's load and pressure, and their orders of convergence.", sphere),
    Check("ellipses", "Ellipses", "Hertz, with the paper's radii and others up to 1 : 1000.", ellipses),
    Check("cone", "Cone", "Sneddon; the pressure at the tip is infinite.", cone),
    Check("punch", "Flat circular punch", "The pressure at the edge is infinite: the load has first order.", punch),
    Check("power-laws", "Indenters z = c r^n", "Galin, Sneddon.", power_laws),
    Check("westergaard", "Waves in one direction", "Westergaard, with both periodic symbols.", westergaard),
    Check("bisinusoidal", "Waves in two directions", "Johnson, Greenwood, Higginson.", bisinusoidal),
    Check("full-contact", "Full contact of a rough surface", "The exact solution, for any surface.", full_contact),
    Check("line", "Line contact", "Hertz's cylinder.", line_contact),
)  # fmt: skip
