"""Types in annotations of the public interface.

Only type checkers import the packages, some of which are optional. A running program has `Any` instead.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from os import PathLike as _PathLike

    import numpy as np
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpi4py.MPI import Comm
    from numpy.typing import ArrayLike, NDArray
    from pandas import DataFrame
    from petsc4py.PETSc import Comm as _PetscComm
    from xarray import Dataset

    AnyComm = Comm | _PetscComm | None
    Floats = NDArray[np.float64]
    Mask = NDArray[np.bool_]
    PathLike = str | _PathLike[str]
else:
    AnyComm = ArrayLike = Axes = Comm = DataFrame = Dataset = Figure = Floats = Mask = PathLike = Any

Length = float | str  # [mm], or a text with a unit; also numbers of other quantities
Prescribed = Length | tuple[float, float] | None  # a loading, or a pair such as load_centre
Method = str | Mapping[str, Mapping[str, Any]] | None
Options = Mapping[str, Any] | None
