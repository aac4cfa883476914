"""Compare estimated grid errors with true ones: ``python -m benchmarks.grid_errors``.

Writes docs/notebook/grid-errors.md. Every body is solved on some grids. True values are analytic, or extrapolated from
grids of 1024 and 2048 cells in each direction.
"""

import re
from functools import cached_property

import numpy as np
from tqdm import tqdm

from app import (
    Cone,
    ContactProblem,
    Cylinder,
    Grid,
    Material,
    Paraboloid,
    Roller,
    SelfAffineSurface,
    Sphere,
    solve,
)
from app.base.errors import InputError
from app.io.table import format_markdown
from benchmarks.measure import ROOT

STEEL = Material.pair((210e3, 210e3), (0.3, 0.3))
COATED = Material.coated((400e3, 210e3), (0.25, 0.3), thickness=0.1)
GRIDS = 12, 16, 24, 32, 64, 128, 256, 512
NEAR = 15 / 16, 17 / 16  # grids that show whether a number is right by chance
FINE = 1024, 2048
MIN_RATIO, MAX_RATIO = 0.7, 10.0  # allowed ratios of estimated and true errors
MIN_INFINITE = 0.25  # smallest allowed estimate if the right value is infinite
SMALL = 1e-3  # smaller true errors count as this one, since coarse grids are solved to -lcp_coarse_rtol only
QUANTITIES = {
    "max_pressure": "maximum pressure",
    "contact_area": "contact area",
    "approach": "approach, by load",
    "load": "load, by approach",
}
_NARROW = re.compile("wide in [xy]: use a finer grid")


class Body:
    """Body of the comparison, on a patch (x0, x1, y0, y1) [mm].

    Parameters
    ----------
    shape : object
        Shape or function of `ContactProblem`.
    domain : tuple
    material : Material
    periodic : bool or str
    surfaces : sequence
    right : dict
        Values known better than by extrapolation; inf if a value does not converge.
    **loading : float
        Prescribed quantity.
    """

    def __init__(self, shape, domain, material=STEEL, periodic=False, surfaces=(), right=None, **loading):
        self._shape, self._domain, self._material, self._periodic = shape, domain, material, periodic
        self._surfaces, self._right, self.loading = surfaces, right or {}, loading

    def solve(self, n):
        """Return the Solution on n x n cells; None if the cells cannot carry the waves of the surface."""
        try:
            grid = Grid.from_domain(n, n, self._domain, periodic=self._periodic)
            problem = ContactProblem(grid, self._material, self._shape, surfaces=self._surfaces)
        except InputError:
            return None
        return solve(problem, **self.loading)

    @cached_property
    def right(self):
        """Right value of each quantity, and the indentation."""
        coarse, fine = map(self.solve, FINE)
        right = {name: 1.5 * getattr(fine, name) - 0.5 * getattr(coarse, name) for name in QUANTITIES}
        right["contact_area"] = fine.contact_area * fine.contact_fraction_corrected / fine.contact_fraction
        analytic = {name: fine.attributes.get(f"analytic_{name}", right[name]) for name in QUANTITIES}
        return {"indentation": fine.indentation, **right, **analytic, **self._right}

    def error(self, solution, name):
        """Return the relative error of a quantity; that of the approach is relative to the indentation."""
        right, value = self.right[name], getattr(solution, name)
        if not np.isfinite(right):
            return np.inf
        return abs(value - right) / abs(self.right["indentation"] if name == "approach" else right)


_SQUARE = -0.5, 0.5, -0.5, 0.5
_BALL = -0.4, 0.4, -0.4, 0.4
_LOG = Roller(5, 10, crown="log", end_chamfer=0.5, design_load=5000, contact_modulus=STEEL.contact_modulus)
_LOG_PRESSURE = {"max_pressure": 2285.5}  # +- 0.6, by grids of up to 4096 cells


def _rough(seed):
    return (SelfAffineSurface(0.8, 1 / 4, 1 / 8, (1.0, 1.0), seed, rms_slope=0.02),)


def _rounded_punch(x, y):
    return np.maximum(np.hypot(x, y) - 0.2, 0.0) ** 2


def _annulus(x, y):
    return (np.hypot(x, y) - 0.3) ** 2 / 4


def _wavy_cylinder(x, y):
    return x**2 / 8 + 2e-4 * (1 - np.cos(2 * np.pi * y))


def _ellipse(x, y):
    """Return an elliptic paraboloid, turned and off the centre [mm]."""
    u, v = (
        (x - 0.06) * np.cos(0.5) + (y + 0.04) * np.sin(0.5),
        (y + 0.04) * np.cos(0.5) - (x - 0.06) * np.sin(0.5),
    )
    return u**2 / 40 + v**2 / 6


def _two_balls(x, y):
    return np.minimum((x - 0.2) ** 2 + y**2, (x + 0.2) ** 2 + y**2 + 1e-3) / 10


BODIES = {
    "sphere, by load": Body(Sphere(10), _BALL, load=100),
    "sphere, by approach": Body(Sphere(10), _BALL, approach=0.00348),
    "log-crowned roller": Body(_LOG, (-0.5, 0.5, -6.0, 6.0), right=_LOG_PRESSURE, load=5000),
    "log-crowned roller, default patch": Body(
        _LOG, (-0.35, 0.35, -5.143, 5.143), right=_LOG_PRESSURE, load=5000
    ),
    "arc-crowned roller": Body(Roller(6, 5, crown="arc", crown_radius=300), (-0.4, 0.4, -3.0, 3.0), load=600),
    "cylinder with sharp ends": Body(
        Cylinder(2, 0.8), (-0.5, 0.5, -0.6, 0.6), right={"max_pressure": np.inf}, load=600
    ),
    "cone": Body(Cone(2), _SQUARE, right={"max_pressure": np.inf}, load=400),
    "elliptic paraboloid": Body(Paraboloid(20, 5), _BALL, load=100),
    "ellipse, turned, off centre": Body(_ellipse, _BALL, load=80),
    "punch with rounded edge": Body(_rounded_punch, _SQUARE, load=300),
    "annulus": Body(_annulus, _SQUARE, load=300),
    "annulus, by approach": Body(_annulus, _SQUARE, approach=0.0046),
    "two balls": Body(_two_balls, _SQUARE, load=200),
    "coated sphere": Body(Sphere(10), _BALL, COATED, load=100),
    "coated sphere, by approach": Body(Sphere(10), _BALL, COATED, approach=0.003),
    "rough sphere": Body(Sphere(10), _SQUARE, surfaces=_rough(1), load=300),
    "wavy cylinder, periodic in y": Body(_wavy_cylinder, _SQUARE, periodic="y", load=300),
    "rough surface, periodic": Body(None, _SQUARE, periodic=True, surfaces=_rough(1), mean_pressure=200),
}


class Comparison:
    """Estimated and true error of a quantity on one grid.

    Attributes
    ----------
    estimated, true : float
        `true` is the error on this grid.
    ratio : float
        Estimated over true error. If the ratio is too large, the true error is the largest of this and of similar
        grids.
    by_chance : bool
        True if the true error is that of a similar grid.
    note : bool
        True if the program warns that the contact is few cells wide.
    """

    def __init__(self, body, n, solution, name):
        self.estimated, self.true = getattr(solution, f"{name}_error"), body.error(solution, name)
        self.note = any(map(_NARROW.search, solution.notes))
        self.ratio, self.by_chance = self.estimated / max(self.true, SMALL), False
        if np.isinf(self.true):
            return
        if self.true < SMALL and self.ratio < 1:
            self.ratio = 1.0
        if self.ratio > MAX_RATIO:
            near = [body.solve(round(n * share)) for share in NEAR]
            true = max(body.error(other, name) for other in near if other)
            self.by_chance = true > max(self.true, SMALL)
            self.ratio = self.estimated / max(true, self.true, SMALL)

    @property
    def allowed(self):
        """True if the ratio is within limits, or there is a note."""
        if np.isinf(self.true):
            return self.estimated >= MIN_INFINITE
        return self.note or MIN_RATIO <= self.ratio <= MAX_RATIO

    def __str__(self):
        marks = r"\*" * self.by_chance + " note" * self.note
        ratio = f"{self.ratio:.2g}{marks}"
        if np.isinf(self.true):
            ratio = f"({100 * self.estimated:.2g}%)" if self.estimated < 1 else "(diverges)"
        return ratio if self.allowed else f"**{ratio}**"


def compare(bodies=BODIES, grids=GRIDS):
    """Yield name of the body, cells, quantity and `Comparison`."""
    for name, body in tqdm(bodies.items(), disable=None):
        for n in grids:
            solution = body.solve(n)
            for quantity in QUANTITIES if solution else ():
                if getattr(solution, f"{quantity}_error") > 0:
                    yield name, n, quantity, Comparison(body, n, solution, quantity)


def table(found, quantity):
    """Return rows of ratios of a quantity."""
    rows = {}
    for name, n, of, comparison in found:
        if of == quantity:
            rows.setdefault(name, {"body": name} | {f"{n}²": "" for n in GRIDS})[f"{n}²"] = str(comparison)
    return list(rows.values())


def overview(found):
    """Yield a row for each quantity: numbers of ratios, and their quantiles."""
    for quantity, title in QUANTITIES.items():
        some = [comparison for _, _, of, comparison in found if of == quantity]
        plain = [comparison.ratio for comparison in some if comparison.ratio and not comparison.note]
        low, middle, high = np.percentile(plain, [5, 50, 95])
        yield {
            "quantity": title,
            "rows": len(some),
            "with a note": sum(comparison.note for comparison in some),
            "too small": sum(ratio < MIN_RATIO for ratio in plain),
            "too large": sum(ratio > MAX_RATIO for ratio in plain),
            "5%": f"{low:.2g}",
            "median": f"{middle:.2g}",
            "95%": f"{high:.2g}",
        }


INTRODUCTION = """# Estimated and true grid errors

Made by `python -m benchmarks.grid_errors`.

Each number is an estimated error due to the cell size, divided by the true one. The patch has 12² to 512² cells. True
values are Hertz's, or are extrapolated from grids of 1024² and 2048² cells; that of the log-crowned roller is 2285.5
N/mm2. Ratios should be between 0.7 and 10.

- \\*: the number is right by chance on this grid: it is wrong on grids of 15/16 and 17/16 of the cells, whose
  largest error counts as the true one.
- note: the program warns that the contact is few cells wide.
- (28%), (diverges): the estimated error of a maximum pressure that is infinite, at a sharp end or an apex. The
  program should say at least 25%.
- **bold**: the ratio is outside of the limits.

True errors below 0.1% count as 0.1%, because coarse grids are solved to `-lcp_coarse_rtol` only.
"""


def main():
    """Write the page."""
    found = list(compare())
    parts = [INTRODUCTION, format_markdown(list(overview(found)))]
    parts += [
        f"## {title.capitalize()}\n\n{format_markdown(table(found, of))}" for of, title in QUANTITIES.items()
    ]
    (ROOT / "docs/notebook/grid-errors.md").write_text("\n".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main()
