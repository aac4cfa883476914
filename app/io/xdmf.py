"""XDMF files, with which ParaView and other programs read result files.

A result becomes a uniform grid with fields on cells; several results, such as the steps of a load path, become a time
series. The XDMF file refers to HDF5 files of its own folder by name. The patch is written as a layer of cells below z =
0. ParaView would put a two-dimensional mesh (``2DCoRectMesh``) into the y-z plane, and only one of its readers reads
fields on a layer without thickness.
"""

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np

from app.base.errors import InputError
from app.io.files import write_text
from app.io.result import AXES, FIELDS, check_is_result, make_grid, open_result, read_attributes, read_dataset


def write_xdmf(results, path=None):
    """Write an XDMF file that refers to result files; return its path.

    `results` are files in one folder, in the order of time. The default `path` is that of the result, with suffix
    ``.xdmf``; for several results it has the names of the first and the last one, ``FIRST-LAST.xdmf``. Raises
    InputError if a file is no result file, or lies in another folder than the XDMF file.
    """
    results = [Path(result) for result in results]
    name = "-".join(dict.fromkeys(result.stem for result in (results[0], results[-1])))
    path = results[0].with_name(f"{name}.xdmf") if path is None else Path(path)
    if path.suffix != ".xdmf":
        raise InputError(f"{path}: the name must end in .xdmf")
    for result in results:
        if result.parent.resolve() != path.resolve().parent:  # which may have a link to the result
            raise InputError(f"{path}: must lie in the folder of {result}, which it refers to")
    loads, grids = zip(*map(_read_grid, results), strict=True)
    rising = len(loads) > 1 and (np.diff(loads) > 0).all()
    for grid, time in zip(grids, loads if rising else range(len(grids)), strict=True):
        SubElement(grid, "Time", Value=repr(float(time)))
    root = Element("Xdmf", Version="3.0")
    parent = SubElement(root, "Domain")
    if len(grids) > 1:
        parent = SubElement(parent, "Grid", Name="steps", GridType="Collection", CollectionType="Temporal")
    parent.extend(grids)
    indent(root)
    write_text(path, '<?xml version="1.0"?>\n' + tostring(root, "unicode") + "\n")
    return path


def _read_grid(result):
    """Return a result file's load [N], and its grid as XML element."""
    with open_result(result) as file:
        check_is_result(file)
        x, y = (read_dataset(file, name) for name in AXES)
        shapes = {name: getattr(file.get(name), "shape", None) for name in file}
        if wrong := [name for name in FIELDS if shapes.get(name) != (y.size, x.size)]:
            raise InputError(f"dataset {', '.join(wrong)} is missing, or of another shape than y and x say")
        types = {name: file[name].dtype for name, shape in shapes.items() if shape == (y.size, x.size)}
        attributes = read_attributes(file)
        grid = make_grid(x, y, attributes)
    nx, ny, dz = grid.nx, grid.ny, min(grid.dx, grid.dy)
    element = Element("Grid", Name=result.stem, GridType="Uniform")
    SubElement(element, "Topology", TopologyType="3DCoRectMesh", Dimensions=f"2 {ny + 1} {nx + 1}")
    geometry = SubElement(element, "Geometry", GeometryType="ORIGIN_DXDYDZ")
    for numbers in (-dz, grid.y0, grid.x0), (dz, grid.dy, grid.dx):
        _add_item(geometry, "3", "XML", " ".join(map(repr, numbers)))
    for name, dtype in types.items():
        attribute = SubElement(element, "Attribute", Name=name, AttributeType="Scalar", Center="Cell")
        _add_item(attribute, f"1 {ny} {nx}", "HDF", f"{result.name}:/{name}", dtype)
    return float(attributes.get("load", np.nan)), element


def _add_item(parent, dimensions, storage, text, dtype=np.float64):
    dtype = np.dtype(dtype)
    number = {"f": "Float", "i": "Int", "u": "UInt" if dtype.itemsize > 1 else "UChar"}.get(dtype.kind, "Int")
    facts = {"NumberType": number, "Precision": str(dtype.itemsize), "Format": storage}
    SubElement(parent, "DataItem", Dimensions=dimensions, **facts).text = text
