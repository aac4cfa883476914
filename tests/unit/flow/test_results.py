"""Flow of solutions and of result files."""

import pickle

import numpy as np
import pytest

from app import ContactProblem, ContactSolver, Grid, Material, read_result
from app.flow import gap_flow
from app.flow.results import FLOW_FIELDS, FLOW_NUMBERS


@pytest.fixture(scope="module")
def solver():
    grid = Grid.from_domain(24, 20, (0, 1, 0, 1))
    x, y = grid.x(), grid.y()[:, None]
    shape = 1e-3 * (2 + np.cos(4 * np.pi * x) * np.cos(4 * np.pi * y))
    shape[3:6, 4:7] = np.nan
    with ContactSolver(ContactProblem(grid, Material.from_contact_modulus(1.0), shape)) as solver:
        yield solver


def test_flow_of_a_solution_is_saved_and_read(solver, tmp_path, monkeypatch):
    solution = solver.solve(approach=1.3e-3)
    with pytest.raises(AttributeError, match="computed by -flow"):
        _ = solution.transmissivity_x
    assert not set(FLOW_NUMBERS) & set(solution.attributes)
    flow = solution.flow()
    assert flow.percolates_x and flow.lower_x <= flow.transmissivity_x <= flow.upper_x
    assert flow.transmissivity_x == pytest.approx(flow.hydraulic_aperture_x**3 / 12)
    inside = np.s_[3:6, 4:7]  # contact is impossible
    assert np.isnan(flow.fluid_pressure[inside]).all() and not flow.flux_x[inside].any()
    assert (np.isnan(flow.fluid_pressure) >= solution.contact).all()
    monkeypatch.setattr(gap_flow, "solve_flow", None)  # it is solved once
    assert solution.flow() is solver.with_stiffness(solution).flow() is flow
    assert solution.attributes.items() >= flow.select(FLOW_NUMBERS).items()
    copy = pickle.loads(pickle.dumps(solution))
    assert copy.flow_error == solution.flow_error == flow.flow_error
    solution.save(tmp_path / "a.h5")
    result = read_result(tmp_path / "a.h5")
    assert {name: result.attributes[name] for name in FLOW_NUMBERS} == flow.select(FLOW_NUMBERS)
    for name in FLOW_FIELDS:
        assert np.array_equal(result.extra[name], getattr(flow, name), equal_nan=True)
    assert result.units["flux_x"] == "mm2"
    monkeypatch.undo()
    assert result.flow().upper_x == pytest.approx(flow.upper_x, rel=1e-9)
    with pytest.raises(AttributeError, match="no permeability"):
        _ = flow.permeability


def test_flow_of_a_path_falls_with_the_load(solver):
    path = solver.path(approach=[1.1e-3, 1.5e-3, 2.9e-3], flow=True)
    list(path)
    table = path.table
    assert (np.diff(table["transmissivity_x"]) < 0).all()
    assert table["percolates_x"].all() and table["flow_error"].max() < gap_flow.MAX_ERROR


def test_a_poor_solve_is_reported(solver, monkeypatch):
    monkeypatch.setattr("app.flow.gap_flow.MAX_ERROR", 0.0)
    with pytest.warns(RuntimeWarning, match="proved relative error of the transmissivities"):
        solver.solve(approach=1.3e-3).flow()
