"""Tables for pandas and fields for xarray."""

from types import SimpleNamespace

import numpy as np

from app.io.frames import to_dataframe, to_xarray


def test_units_of_a_table_are_those_of_its_quantities():
    columns = {"step": [1, 2], "load": [1.0, 2.0], "analytic_load": [1.1, 2.1], "wear": [0.0, 0.1]}
    frame = to_dataframe(columns, "step", {"wear": "um", "absent": "s"})
    assert frame.attrs["units"] == {"load": "N", "analytic_load": "N", "wear": "um"}
    assert frame.index.name == "step" and frame["load"].to_list() == [1.0, 2.0]


def test_fields_have_axes_and_units_and_numbers_are_attributes():
    names = ("pressure", "gap", "displacement", "undeformed_distance", "contact")
    fields = {name: np.full((2, 3), float(k)) for k, name in enumerate(names)}
    result = SimpleNamespace(
        **fields, plastic=None, plastic_depth=None, x=np.arange(3.0), y=np.arange(2.0),
        attributes={"converged": True, "load": 5.0}, units={"wear": "um"},
        extra={name: np.ones((2, 3)) for name in ("wear", "hardness", "other")} | {"profile": np.ones(3)},
    )  # fmt: skip
    data = to_xarray(result)
    assert data.sizes == {"y": 2, "x": 3}
    units = dict.fromkeys(names, "mm") | {
        "pressure": "N/mm2",
        "contact": "1",
        "wear": "um",
        "hardness": "N/mm2",
    }
    assert {name: data[name].attrs.get("units") for name in data} == units | {"other": None}
    assert data.attrs == {"converged": 1, "load": 5.0}
    depth = np.full((2, 3), 1e-3)
    result.plastic, result.plastic_depth = depth > 0, depth
    data = to_xarray(result)
    assert (data["plastic"].units, data["plastic_depth"].units) == ("1", "mm")
    np.testing.assert_array_equal(data["plastic_depth"], depth)
