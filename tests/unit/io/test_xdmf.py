"""XDMF files."""

import xml.etree.ElementTree as ElementTree

import h5py
import numpy as np
import pytest
from mpi4py import MPI
from results import made_up_result, with_attributes, write

from app import read_result
from app.cli import xdmf
from app.parallel.slabs import Slabs


def items(path):
    """The tree, and arrays of all data items by attribute name."""
    root = ElementTree.parse(path).getroot()
    arrays = {}
    for attribute in root.iter("Attribute"):
        (item,) = attribute
        name, dataset = item.text.split(":")
        with h5py.File(path.parent / name) as file:
            values = file[dataset][()]
        assert tuple(map(int, item.get("Dimensions").split())) == (1, *values.shape)
        assert int(item.get("Precision")) == values.dtype.itemsize
        arrays.setdefault(attribute.get("Name"), []).append(values)
    return root, arrays


def test_xdmf_names_the_fields(path, result, capsys):
    assert xdmf.main([str(path)]) == 0
    assert capsys.readouterr().out == f"{path.with_suffix('.xdmf')}\n"
    root, arrays = items(path.with_suffix(".xdmf"))
    assert arrays.keys() == {"pressure", "gap", "displacement", "undeformed_distance", "contact"}
    assert np.array_equal(arrays["pressure"][0], result.pressure)
    assert root.find(".//Topology").get("Dimensions") == "2 49 65"  # points; fields are on cells
    origin, steps = (np.array(item.text.split(), float) for item in root.find(".//Geometry"))
    assert origin[1:] == pytest.approx([-6, -10]) and steps[1:] == pytest.approx([12 / 48, 20 / 64])
    assert origin[0] + steps[0] == 0  # z, whose upper side is the surface


def test_xdmf_of_a_row_of_cells_has_their_size(tmp_path, capsys):
    path = tmp_path / "row.h5"
    row = with_attributes(made_up_result(64, 1), cell_size=np.array([0.1, 7.0]))
    write(path, MPI.COMM_SELF, Slabs(1), row)
    assert xdmf.main([str(path)]) == 0
    root, _ = items(path.with_suffix(".xdmf"))
    origin, steps = (np.array(item.text.split(), float) for item in root.find(".//Geometry"))
    grid = read_result(path).grid
    assert [*steps[1:], *origin[1:]] == [grid.dy, grid.dx, grid.y0, grid.x0]
    assert steps[1:] == pytest.approx([7, 20 / 64])
    capsys.readouterr()
    for size in ("wide", -7.0, np.array([0.1, -7.0])):
        with h5py.File(path, "r+") as file:
            file.attrs["cell_size"] = size
        assert xdmf.main([str(path)]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"error: result file {path}: ") and said.count("\n") == 1


def test_xdmf_of_a_link_names_the_link(path, tmp_path, capsys):
    folder = tmp_path / "links"
    folder.mkdir()
    (folder / "link.h5").symlink_to(path)
    # Where there is no link.h5.
    assert xdmf.main([str(folder / "link.h5"), "-o", str(tmp_path / "a.xdmf")]) == 2
    assert xdmf.main([str(folder / "link.h5")]) == 0
    assert ">link.h5:/pressure<" in (folder / "link.xdmf").read_text()


def test_xdmf_of_several_results_does_not_replace_that_of_one(path, capsys):
    other = path.with_name("other.h5")
    other.write_bytes(path.read_bytes())
    assert xdmf.main([str(path)]) == xdmf.main([str(other)]) == 0
    alone = [file.with_suffix(".xdmf").read_text() for file in (path, other)]
    assert xdmf.main([str(path), str(other)]) == 0
    assert [file.with_suffix(".xdmf").read_text() for file in (path, other)] == alone
    assert capsys.readouterr().out.endswith(f"{path.with_name(f'{path.stem}-other.xdmf')}\n")


def test_xdmf_of_several_results_is_a_series(path, result, tmp_path):
    for number, load in enumerate((10.0, 20.0)):
        write(tmp_path / f"{number} & more.h5", MPI.COMM_SELF, Slabs(48), with_attributes(result, load=load))
    files = [str(tmp_path / f"{number} & more.h5") for number in (0, 1)]
    assert xdmf.main([*files, "-o", str(tmp_path / "series.xdmf")]) == 0
    root, arrays = items(tmp_path / "series.xdmf")
    assert root.find(".//Grid").get("CollectionType") == "Temporal"
    assert [time.get("Value") for time in root.iter("Time")] == ["10.0", "20.0"]
    assert len(arrays["pressure"]) == 2
