"""docs/conductance.md, creep.md, slip.md, wear.md, law.md and sensitivities.md: their code runs."""

import numpy as np
import pytest
from documents import ROOT, code_blocks, run_blocks


def blocks_of(page):
    return code_blocks((ROOT / "docs" / page).read_text(encoding="utf-8"))


def test_creep_of_the_page_grows_as_the_creep_function():
    names = run_blocks(blocks_of("creep.md"))
    areas, growth = names["path"].table["contact_area"], names["rubber"].creep.at(names["times"])
    np.testing.assert_allclose(areas / areas[0], growth ** (2 / 3), rtol=0.03)


def test_slip_of_the_page_sums_to_the_tangential_load(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_blocks(blocks_of("slip.md"))
    assert names["slip"].traction.sum() * names["ball"].grid.cell_area == pytest.approx(15)
    assert np.all(np.diff([step.stick_area for step in names["curve"]]) < 0)
    table = np.genfromtxt("slips.csv", delimiter=",", names=True)
    assert table["tangential_load"].tolist() == [0, 5, 10, 15, 20, 25, 30]


def test_wear_of_the_page_has_the_volume_of_archard():
    names = run_blocks(blocks_of("wear.md"))
    assert names["path"].table["worn_volume"][-1] == pytest.approx(1e-9 * 50 * 4000)


def test_law_of_the_page_is_a_spring(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = run_blocks(blocks_of("law.md"))
    law, spring = names["law"], names["spring"]
    assert law.table["load"][0] < spring["load"] < law.table["load"][-1]
    assert spring["tangential_stiffness"] / spring["stiffness"] == pytest.approx(14 / 17, rel=0.01)
    assert (tmp_path / "law.csv").is_file()


def test_conductance_of_the_page_is_near_that_of_a_circle():
    names = run_blocks(blocks_of("conductance.md"))
    solution, table = names["solution"], names["path"].table
    assert solution.conductance_width == pytest.approx(2 * np.sqrt(solution.contact_area / np.pi), rel=0.01)
    assert table["electrical_conductance"][1] == pytest.approx(solution.electrical_conductance, rel=1e-6)


def test_sensitivities_of_the_page_are_derivatives():
    names = run_blocks(blocks_of("sensitivities.md")[:1])
    solver, solution, sphere, x = (names[name] for name in ("solver", "solution", "sphere", "x"))
    solver.update(names["ContactProblem"](names["grid"], names["material"], sphere + 1e-4 * x**2))
    moved = solver.solve(approach=solution.approach)
    assert moved.load - solution.load == pytest.approx(1e-4 * np.sum(names["of_load"] * x**2), rel=1e-2)


def test_wrapped_pressure_is_differentiable():
    pytest.importorskip("jax")
    names = run_blocks(blocks_of("sensitivities.md"))
    loss, step = names["loss"], 1e-3
    slope = (loss(20 + step) - loss(20 - step)) / (2 * step)
    assert names["jax"].grad(loss)(20.0) == pytest.approx(float(slope), rel=1e-3)
