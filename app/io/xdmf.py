"""XDMF: a small text file beside result files that tells ParaView and others what is in them.

A result becomes a uniform grid with its fields on cells; several results, such as the steps of a load path, a series in
time. The file names the HDF5 files by their names alone: keep them in one folder. The patch is one layer of cells below
z = 0: ParaView's readers stand a mesh of two directions (``2DCoRectMesh``) in the y-z plane, and only one of them reads
fields on a layer without thickness.

Not collective: call on one rank.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from app.base.errors import InputError
from app.io.files import write_text
from app.io.result import AXES, FIELDS, check_is_result, make_grid, open_result, read_attributes, read_dataset


def write_xdmf(results, path=None):
    """Write the XDMF file of some result files.

    Parameters
    ----------
    results : sequence of str or Path
        In one folder, in the order of time.
    path : str or Path, optional
        Default: beside the first of them, with its name and the suffix ``.xdmf``.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        If a file is no result file, or lies in another folder.
    """
    results = [Path(result) for result in results]
    path = results[0].with_suffix(".xdmf") if path is None else Path(path)
    if path.suffix != ".xdmf":
        raise InputError(f"{path}: the name must end in .xdmf")
    for result in results:
        if result.parent.resolve() != path.resolve().parent:  # a link may stand there for the result
            raise InputError(f"{path}: must lie in the folder of {result}, which it refers to")
    loads, grids = zip(*map(_read, results), strict=True)
    rising = len(loads) > 1 and (np.diff(loads) > 0).all()
    for grid, time in zip(grids, loads if rising else range(len(grids)), strict=True):
        grid.find("Time").set("Value", repr(float(time)))
    root = Element("Xdmf", Version="3.0")
    place = SubElement(root, "Domain")
    if len(grids) > 1:
        place = SubElement(place, "Grid", Name="steps", GridType="Collection", CollectionType="Temporal")
    place.extend(grids)
    indent(root)
    write_text(path, '<?xml version="1.0"?>\n' + tostring(root, "unicode") + "\n")
    return path


def _read(result):
    """Load [N], and element of a grid whose time is not known yet, of a result."""
    with open_result(result) as file:
        check_is_result(file)
        x, y = (read_dataset(file, name) for name in AXES)
        there = {name: getattr(file.get(name), "shape", None) for name in file}
        if wrong := [name for name in FIELDS if there.get(name) != (y.size, x.size)]:
            raise InputError(f"dataset {', '.join(wrong)} is missing, or of another shape than y and x say")
        fields = {name: file[name].dtype for name, shape in there.items() if shape == (y.size, x.size)}
        attributes = read_attributes(file)
        return float(attributes.get("load", np.nan)), _grid(result, make_grid(x, y, attributes), fields)


def _grid(result, grid, fields):
    nx, ny, dz = grid.nx, grid.ny, min(grid.dx, grid.dy)
    found = Element("Grid", Name=result.stem, GridType="Uniform")
    SubElement(found, "Time")
    SubElement(found, "Topology", TopologyType="3DCoRectMesh", Dimensions=f"2 {ny + 1} {nx + 1}")
    geometry = SubElement(found, "Geometry", GeometryType="ORIGIN_DXDYDZ")
    for numbers in (-dz, grid.y0, grid.x0), (dz, grid.dy, grid.dx):
        _add_item(geometry, "3", "XML", " ".join(map(repr, numbers)))
    for name, kind in fields.items():
        attribute = SubElement(found, "Attribute", Name=name, AttributeType="Scalar", Center="Cell")
        _add_item(attribute, f"1 {ny} {nx}", "HDF", f"{result.name}:/{name}", kind)
    return found


def _add_item(parent, dimensions, where, text, kind=np.float64):
    kind = np.dtype(kind)
    number = {"f": "Float", "i": "Int", "u": "UInt" if kind.itemsize > 1 else "UChar"}.get(kind.kind, "Int")
    facts = {"NumberType": number, "Precision": str(kind.itemsize), "Format": where}
    SubElement(parent, "DataItem", Dimensions=dimensions, **facts).text = text
