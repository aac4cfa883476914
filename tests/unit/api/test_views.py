"""Pictures, tables and texts of solutions in Python: those of the commands, of any object, and small."""

import re
import subprocess
import sys
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from cases import hertz

from app import (
    ContactProblem,
    ContactSolver,
    Grid,
    InputError,
    Material,
    SelfAffineSurface,
    Solution,
    Sphere,
    read_result,
    read_surface,
    refine,
    solve,
    stress,
)
from app.api.summary import summary
from app.halfspace.kernel import HalfSpaceKernel
from app.plots.pictures import analytic_reference

mpl.use("Agg")
from matplotlib import pyplot

ONE_PANEL = ["contact", "pressure", "displacement", "gap", "section_x", "section_y", "residual"]


@pytest.fixture(scope="module")
def hertz_results(tmp_path_factory):
    with ContactSolver(hertz(32)) as solver:
        path = solver.path(load=[1000, 2000, 4000])
        solution = list(path)[-1]
    file = tmp_path_factory.mktemp("views") / "result.h5"
    solution.save(file)
    return {"solution": solution, "path": path, "result": read_result(file), "patches": solution.patches()}


@pytest.fixture(scope="module")
def surface():
    rough = SelfAffineSurface(0.8, 0.5, 0.1, (2.0, 2.0), 1, rms_slope=0.02)
    grid = Grid.from_domain(32, 32, (-1, 1, -1, 1))
    heights = rough.heights_on(grid) + 0.01 * grid.x()
    return read_surface(heights, "mm", spacing=(grid.dx, grid.dy))


@pytest.fixture(autouse=True)
def no_figures():
    yield
    pyplot.close("all")


@pytest.mark.parametrize("what", ["solution", "result"])
@pytest.mark.parametrize("name", [None, "deformation", "gap", "history"])
def test_figures_belong_to_pyplot_which_notebooks_show(hertz_results, what, name):
    figure, axes = hertz_results[what].plot(name)
    assert figure.number in pyplot.get_fignums()
    assert all(panel.figure is figure for panel in np.ravel(axes))
    assert np.ravel(axes)[0] in figure.axes


@pytest.mark.parametrize("name", ONE_PANEL)
def test_one_panel_is_drawn_on_the_axes_of_the_user(hertz_results, name):
    _, (left, right) = pyplot.subplots(1, 2)
    figure, axes = hertz_results["solution"].plot(name, ax=right)
    assert (figure, axes) == (right.figure, right)
    assert right.has_data() and not left.has_data()


@pytest.mark.parametrize("name", ["pressure", "displacement", "gap", "heights"])
def test_the_title_of_axes_is_the_users_and_the_bar_has_quantity_and_unit(hertz_results, surface, name):
    axes = pyplot.figure().subplots()
    axes.set_title("mine")
    surface.plot(ax=axes) if name == "heights" else hertz_results["solution"].plot(name, ax=axes)
    assert axes.get_title() == "mine"
    label = axes.child_axes[0].get_ylabel() + axes.child_axes[0].get_xlabel()
    assert label.startswith(name.removesuffix("s")[:6]) and "[" in label


@pytest.mark.parametrize(
    ("name", "unit", "factor"),
    [("worn_depth", "µm", 1e3), ("background_pressure", "N/mm²", 1), ("mine", "", 1)],
)
def test_any_field_is_drawn_by_its_name_with_its_unit(hertz_results, name, unit, factor):
    result = hertz_results["result"]
    values = np.where(result.contact, 1e-3 * (20 + result.x), 0)
    drawn = replace(result, extra={name: values, "list": np.zeros(3), "words": np.full((32, 32), "a")})
    for axes in drawn.plot(name).axes, drawn.plot(name, ax=pyplot.figure().subplots()).axes:
        shown = axes.images[-1].get_array()
        label = axes.get_title() or axes.child_axes[0].get_ylabel()
        assert label == name.replace("_", " ") + (f"  [{unit}]" if unit else "")
        assert np.sort(shown.compressed()) == pytest.approx(np.sort(factor * values[result.contact]))
    for other in "list", "words":
        with pytest.raises(InputError, match=f"plot '{other}': must be one of .*{name}"):
            drawn.plot(other)


@pytest.mark.parametrize("values", [0, np.inf, -1.5, np.nan, 7])
def test_unusual_fields_are_drawn(hertz_results, values):
    result = hertz_results["result"]
    for name, kind in (("worn_depth", float), ("mine", float), ("counts", int)):
        if kind is float or np.isfinite(values):
            field = np.full(result.grid.shape, values).astype(kind)
            assert replace(result, extra={name: field}).plot(name).axes.images


def test_panels_get_room_for_their_labels(hertz_results):
    figure, (left, right) = pyplot.subplots(1, 2)
    hertz_results["solution"].plot("pressure", ax=left)
    figure.draw_without_rendering()
    assert left.get_tightbbox().xmax <= right.get_tightbbox().xmin  # the colour bar is outside of the axes
    figure.tight_layout()
    constrained, axes = pyplot.subplots(layout="constrained")
    engine = constrained.get_layout_engine()
    hertz_results["solution"].plot("pressure", ax=axes)
    assert constrained.get_layout_engine() is engine
    free = pyplot.figure()
    hertz_results["solution"].plot("pressure", ax=free.add_axes((0.1, 0.1, 0.6, 0.8)))
    assert free.get_layout_engine() is None


def test_pictures_are_named_in_the_error(hertz_results, surface):
    with pytest.raises(
        InputError, match=r"plot 'stresses': must be one of contact, pressure, .*displacement"
    ):
        hertz_results["solution"].plot("stresses")
    with pytest.raises(InputError, match=r"must be one of contact.* with ax="):
        hertz_results["solution"].plot("summary", ax=pyplot.figure().subplots())
    for shown in hertz_results["solution"], surface:
        with pytest.raises(InputError, match="ax: is str; must be axes of matplotlib"):
            shown.plot(ax="pressure")
    with pytest.raises(InputError, match="nothing to draw"):
        hertz_results["solution"].plot("path")


def test_paths_surfaces_and_stresses_are_drawn(hertz_results, surface, tmp_path):
    assert len(hertz_results["path"].plot()[1]) == 4
    assert len(surface.plot()[1]) == 5
    surface.plot().savefig(tmp_path / "surface.png")  # as of a figure
    assert (tmp_path / "surface.png").stat().st_size > 1000 and not hasattr(surface.plot(), "nothing")
    below = stress(hertz_results["solution"])
    assert [axes.get_xlabel()[0] for axes in below.plot()[1]] == ["x", "s", "y"]
    axes = pyplot.figure().subplots()
    assert surface.plot(ax=axes)[1] is axes
    assert axes.has_data()


def test_heights_are_drawn_about_their_best_plane(surface):
    assert surface.heights_about_plane().std() == pytest.approx(surface.rms_level, rel=1e-9)
    assert surface.rms_height > surface.rms_level


def test_the_summary_is_that_of_the_command(hertz_results):
    solution, result = hertz_results["solution"], hertz_results["result"]
    facts = solution.attributes | solution.count_patches()
    assert solution.summary() == summary(facts, solution.grid) == result.summary()


def test_tables_for_notebooks_have_units_and_one_picture(hertz_results, surface):
    refined = refine(hertz(16), until=0.2, load=1000)
    for shown in (*hertz_results.values(), surface, refined):
        html = shown._repr_html_()
        assert html.count("<table>") == html.count("<img") == 1
        assert re.search(r"\bmm\b|\bum\b", html)
    assert not pyplot.get_fignums()


def test_patches_and_refinements_print_as_tables(hertz_results):
    assert str(hertz_results["patches"]).startswith("1 contact spot; mm2, N, N/mm2, mm\n  cells ")
    lines = str(refine(hertz(16), until=0.2, load=1000)).splitlines()
    assert lines[0].startswith("Refinement, reached")
    assert {"nx", "load", "max_pressure"} <= set(lines[1].split())


def test_completion_shows_fields_numbers_and_methods(hertz_results):
    for shown in hertz_results["solution"], hertz_results["result"]:
        names = set(dir(shown))
        assert names >= {"pressure", "gap", "load", "max_pressure", "plot", "patches", "attributes"}
        assert names >= {"converged", "notes", "error_bound", "iterations", "message"}
        assert names.isdisjoint({"work_units", "solving_ranks", "traffic", "slabs", "command_line"})
        assert shown.work_units == shown.attributes["work_units"]  # there all the same


def test_reprs_choose_units(hertz_results):
    assert "load 4 kN" not in repr(hertz_results["solution"])  # kN from 10,000 N
    assert re.search(r"load 4000 N, approach [\d.]+ (um|mm)", repr(hertz_results["solution"]))
    assert re.search(
        r"von Mises [\d.]+.* depth [\d.]+ (um|mm)>", repr(stress(hertz_results["solution"]).maximum())
    )


def test_tables_need_pandas_and_fields_xarray(hertz_results, monkeypatch):
    for package, method in (
        ("pandas", hertz_results["path"].to_dataframe),
        ("pandas", hertz_results["patches"].to_dataframe),
        ("xarray", hertz_results["solution"].to_xarray),
    ):
        monkeypatch.setitem(sys.modules, package, None)
        with pytest.raises(ImportError, match=f"pip install {package}"):
            method()


def test_dataframes_have_units(hertz_results):
    frame = hertz_results["path"].to_dataframe()
    assert frame["load"].to_list() == pytest.approx([1000, 2000, 4000])
    assert frame.index.name == "step"
    assert frame.attrs["units"]["max_pressure"] == "N/mm2"
    patches = hertz_results["patches"].to_dataframe()
    assert patches.attrs["units"]["area"] == "mm2"
    assert patches["load"].sum() == pytest.approx(4000)


def test_datasets_have_units(hertz_results, tmp_path):
    import xarray

    data = hertz_results["solution"].to_xarray()
    assert data.pressure.units == "N/mm2" and data.x.units == data.gap.units == "mm"
    total = float(data.pressure.sum() * data.attrs["cell_size"][0] * data.attrs["cell_size"][1])
    assert total == pytest.approx(data.attrs["load"])
    assert isinstance(data.pressure.sel(y=0, method="nearest"), xarray.DataArray)


def test_the_rows_of_one_rank_are_not_drawn(hertz_results):
    from dataclasses import replace

    part = hertz_results["solution"]
    part = replace(part, pressure=part.pressure[:5])
    with pytest.raises(InputError, match="gather"):
        part.plot()
    assert "<img" not in Solution._repr_html_(part)


def test_a_solve_imports_nothing_to_draw_with():
    code = (
        "import sys, app; from app import *; from app import solve\n"
        "grid, pair = Grid.from_domain(8, 8, (-1, 1, -1, 1)), Material.combined(8e4, 0.3)\n"
        "s = solve(ContactProblem(grid, pair, Sphere(9)), load=9)\n"
        "repr(s), dir(s)\n"
        "print({'matplotlib', 'pandas', 'xarray', 'IPython', 'tabulate'} & set(sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "set()\n"


def test_pictures_show_hertz_only_for_bodies_that_obey_it(tmp_path):
    steel, grid = Material.isotropic(210e3, 0.3), Grid.from_domain(16, 16, (-0.5, 0.5, -0.5, 0.5))
    own = Material.from_kernel(type("Own", (HalfSpaceKernel,), {})(steel.kernel.compliance))
    solutions = {
        "hertz": solve(ContactProblem(grid, steel, Sphere(10)), load=100),
        "tilt": solve(ContactProblem(grid, steel, Sphere(10)), load=100, load_centre=(0.1, 0)),
        "kernel": solve(ContactProblem(grid, own, Sphere(10)), load=100),
        "gas": solve(ContactProblem(grid, steel, Sphere(10), background_pressure=50), load=100),
        "compliance": solve(ContactProblem(grid, steel, Sphere(10), surface_compliance=1e-5), load=100),
    }
    with ContactSolver(ContactProblem(grid, steel, Sphere(10))) as solver:
        *_, solutions["wear"] = solver.wear(1e-8, 100, 2, load=100)
    with ContactSolver(ContactProblem(grid, steel.viscoelastic(1, 0.5), Sphere(10))) as solver:
        *_, solutions["creep"] = solver.creep([0, 1], load=100)
    for name, solution in solutions.items():
        solution.save(tmp_path / "result.h5")
        result = read_result(tmp_path / "result.h5")
        assert (analytic_reference(result) is not None) == (name == "hertz"), name
        assert result.plot("sections") is not None
