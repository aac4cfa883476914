"""Numbers in messages: the given one differs from the allowed one."""

import ast
import re
from math import inf, nextafter

import numpy as np
import pytest
from processes import TESTS

from app import ContactProblem, Grid, Material, SelfAffineSurface, Sphere, read_surface, solve
from app.base.errors import InputError, format_distinct, format_exact
from app.base.memory import check_fits
from app.contact.history import Outcome
from app.problems.random_surfaces import WavySurface
from app.verification.check import Figure

STEEL = Material.from_contact_modulus(1e3)
GRID = Grid.from_domain(8, 8, (0, 1, 0, 1))
HEIGHTS = np.linspace(0, 1e-3, 64).reshape(8, 8)


@pytest.mark.parametrize("number", [0.1, -1.0, 1e50, 5.0, 1e-12, 12345678.0, 4.9999501, inf])
def test_neighbouring_numbers_are_written_differently(number):
    other = nextafter(number, 0.0)
    assert float(format_exact(number)) == number and format_exact(number) != format_exact(other)
    assert format_distinct(number, other) != format_distinct(other, number)
    assert format_distinct(number, 2 * number + 1) == f"{number:.3g}"


def rough(**changed):
    numbers = {
        "hurst": 0.8,
        "rolloff_wavelength": 0.5,
        "shortest_wavelength": 0.25,
        "period": (1, 1),
        "seed": 1,
    }
    return SelfAffineSurface(**numbers | changed, rms_slope=0.1)


def measured(**filters):
    return read_surface(HEIGHTS, "mm", spacing=(0.1, 0.1), **filters)


def periodic(**loading):
    return solve(ContactProblem(GRID, STEEL, 5 + HEIGHTS, periodic=True), **loading)


ABOVE_HALF, ABOVE_ONE, TOO_LARGE = nextafter(0.5, 1), nextafter(1, 2), nextafter(1e50, inf)
REFUSED = {
    "Poisson ratio": (ABOVE_HALF, lambda nu: Material.combined(1.0, nu)),
    "Poisson's ratios": (ABOVE_HALF, lambda nu: Material.pair((1, 1), (0.3, nu))),
    "domain": (1.0000001, lambda x1: Grid.from_domain(4, 4, (1.0000002, x1, 0, 1))),
    "approach": (5.0005001, lambda approach: periodic(approach=approach)),
    "load": (TOO_LARGE, lambda load: solve(ContactProblem(GRID, STEEL, Sphere(1)), load=load)),
    "gap": (TOO_LARGE, lambda gap: ContactProblem(GRID, STEEL, np.full((8, 8), gap))),
    "decay": (ABOVE_ONE, lambda decay: WavySurface((1, 1), decay, 0.1, 1, (1, 1), (0, 0))),
    "Hurst exponent": (ABOVE_ONE, lambda hurst: rough(hurst=hurst)),
    "wavelengths": (0.5000001, lambda shortest: rough(shortest_wavelength=shortest)),
    "cut-off": (0.2499999, lambda shortest: rough(shortest_wavelength=shortest).check_grid(GRID)),
    "s_filter": (0.1999999, lambda index: measured(s_filter=index)),
    "l_filter": (0.8000001, lambda index: measured(l_filter=index)),
    "both filters": (0.3000001, lambda index: measured(s_filter=index, l_filter=0.3)),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_refused_number_is_written_with_all_its_digits(what):
    number, use = REFUSED[what]
    with pytest.raises(InputError) as refused:
        use(number)
    assert format_exact(number) in re.split(r"[ ,:;]+", str(refused.value))


def test_a_limit_can_be_taken_as_it_is_written():
    with pytest.raises(InputError, match="must be at most ") as refused:
        periodic(approach=5.1)
    assert periodic(approach=float(re.search(r"at most (\S+) mm", str(refused.value))[1])).converged


def test_needed_and_free_memory_are_written_differently(monkeypatch):
    monkeypatch.setattr("app.base.memory.available_memory", lambda: 3.0001 * 2**30)
    with pytest.raises(InputError, match="needs 3.0002 GiB of memory; 3.0001 GiB are free"):
        check_fits(3.0002 * 2**30, "this")


def test_a_number_that_misses_its_limit_is_written_differently():
    assert (
        "proved to 0.01000001 only (-lcp_error_bound 0.01)"
        in Outcome(True, "").require_bound(0.01000001, 0.01).reason
    )
    assert Figure("error", 1.0000001e-9, most=1e-9).shown == "1.0000001e-09"
    assert Figure("error", 0.9, least=0.5).shown == "0.9"
    steep = ContactProblem(GRID, STEEL, lambda x, y: 0.5002 * x + 0 * y)
    [note] = [note for note in solve(steep, approach=1e-3).notes if "slopes below 0.5" in note]
    assert "rms slope is 0.5002" in note


def _formats(tree):
    """Formats of the numbers in the messages of errors that are raised."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and node.exc is not None:
            for part in ast.walk(node.exc):
                if isinstance(part, ast.FormattedValue) and part.format_spec:
                    constant = "LARGEST" in ast.unparse(part.value)
                    yield part.lineno, "" if constant else ast.unparse(part.format_spec)


def test_no_error_rounds_a_number_to_six_digits():
    rounded = [
        f"{path.name}:{line}"
        for path in (TESTS.parent / "app").rglob("*.py")
        for line, form in _formats(ast.parse(path.read_text("utf-8")))
        if form in ("f'g'", "f'.3g'", "f'.4g'")
    ]
    assert not rounded, "write these numbers by format_exact or format_distinct"
