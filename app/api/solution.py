"""Solutions: fields, numbers and history, on all ranks."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, make_dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from app.base.errors import InputError, call_collectively, check_equal_on_ranks
from app.base.types import Comm, Floats, Mask, PathLike
from app.contact.certificate import Certificate
from app.contact.contact_moments import ContactMoments
from app.contact.grid_errors import GridErrors
from app.contact.measures import PLASTIC_NUMBERS, ContactMeasures
from app.flow.results import FLOW_NUMBERS
from app.halfspace.grid import Grid
from app.io.contact_fields import ATTRIBUTE_NAMES, STIFFNESS_NUMBERS, ContactFields
from app.parallel.communicator import Traffic
from app.parallel.slabs import Slabs
from app.problems.arrays import real_numbers

# Attributes that the caller of `save` may replace: those of a whole run, and errors from more grids.
RUN_ATTRIBUTES = {
    "command_line", "notes", "options", "setup_seconds", *STIFFNESS_NUMBERS, *GridErrors._fields,
}  # fmt: skip
_MAX_ATTRIBUTE_BYTES = 65_000  # HDF5 stores no larger ones, texts excepted
_COUNTED = {"contact_patches", "largest_patch"}  # attributes of a file that are not numbers of a Solution


if TYPE_CHECKING:  # a type checker cannot read the list; tests/unit/test_types.py compares both

    class _Numbers:
        contact_cells = 0
        load = mean_pressure = mean_gap = max_pressure = mean_contact_pressure = 0.0
        contact_area = contact_fraction = contact_fraction_corrected = perimeter = 0.0
        plastic_area = plastic_fraction = plastic_volume = mean_plastic_depth = 0.0
        pressure_centre_x = pressure_centre_y = moment_x = moment_y = 0.0
        semi_axis_major = semi_axis_minor = major_axis_angle = 0.0
        contact_extent_x = contact_extent_y = 0.0
        load_error = approach_error = max_pressure_error = contact_area_error = 0.0

else:
    _Numbers = make_dataclass(  # their names are listed once, where they are computed
        "_Numbers",
        [pair for kind in (ContactMeasures, ContactMoments, GridErrors) for pair in kind.__annotations__.items()],
        frozen=True, eq=False, repr=False,
    )  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class Solution(_Numbers, ContactFields):
    """Solution of a contact problem; the last iterate if not ``converged``.

    Arrays have the rows of this rank, shape (rows, nx). `gather` collects all rows on one rank. A solution with all
    rows can be pickled.

    Attributes
    ----------
    pressure : ndarray of float64, [N/mm2]
    contact : ndarray of bool
    converged : bool
        True if the contact set is unchanged, (5.1) holds, and the error bound is at most -lcp_error_bound.
    message : str
        Why the iteration ended.
    prescribed : str
        Prescribed quantity: load (also as mean pressure), approach or mean_gap.
    load, approach, indentation : float
        Load [N], approach [mm], and approach beyond first touch [mm].
    tilt_x, tilt_y : float
        Slopes by which the bodies are turned: h = shape - approach - x tilt_x - y tilt_y. The `approach` is at the
        origin of x and y.
    mean_pressure, mean_gap : float
        Load over the area of the patch [N/mm2]; mean of the gap over the cells where contact is possible [mm].
    contact_area, mean_contact_pressure : float
        Area in contact [mm2]; load over this area [N/mm2].
    plastic_area, plastic_fraction : float
        Area of the cells at the hardness [mm2]; their share of the cells where contact is possible.
    plastic_volume, mean_plastic_depth : float
        Volume of the permanent indentation [mm3]; its mean over the cells where contact is possible [mm].
    pressure_centre_x, pressure_centre_y, moment_x, moment_y : float
        Centre of pressure [mm], and first moments, the integrals of p x and p y [N mm].
    semi_axis_major, semi_axis_minor, major_axis_angle : float
        Semi-axes of the ellipse that has the second moments of the contact set [mm]; angle from the x axis to the major
        one [degree]. These three and the four numbers before are NaN on a periodic patch, which has no origin.
    contact_extent_x, contact_extent_y : float
        From the first to the last column, or row, of cells in contact [mm]; NaN in a direction in which the patch
        repeats, and without contact.
    contact_fraction, contact_fraction_corrected, perimeter : float
        Share of cells in contact, among cells where contact is possible; the same, corrected because the contact edge
        follows cell edges; length of this edge [mm]. See `app.contact.measures`.
    rms_height, rms_slope : float
        Standard deviation of the undeformed distance [mm], and its root mean square slope.
    residual : float
        ||r|| / ||h||, residual divided by undeformed distance, as in the stopping test (5.1).
    iterations, inner_iterations : int
        Active set iterations on the target grid, and iterations of the linear solver in them.
    work_units, operator_applications : float
        Work in the paper's units; work of all products and sweeps, in products on the target grid.
    discretisation_error : float
        Relative rms difference of the pressures on the last two grids; NaN if unknown.
    load_error, approach_error, max_pressure_error, contact_area_error : float
        Estimated relative errors due to the cell size, rather too large than too small. That of the approach is
        relative to the approach beyond first touch. NaN unless a default method with nested iteration was used; see
        `app.contact.grid_errors`.
    fallbacks : int
        Number of grids on which the safeguard, or the root search for a load, continued the solve.
    certificate : Certificate
        Proved error bound of the pressure.
    history : dict of str to list
        Columns with an entry for each active set iteration.
    problem : dict
        Names and values that describe the problem.
    options : str
        Options of the solver, as on a command line.
    notes : tuple of str
        Warnings about units, grid or theory, see `app.api.notes`.
    solve_seconds, setup_seconds : float
    traffic : Traffic
        Messages of rank 0, which has a part of every grid.
    grid : Grid
    slabs : Slabs
        Distribution of the rows over the ranks.
    comm : mpi4py communicator
    stiffness, unloading_stiffness : float or None
        dF/d(approach), and the same while the whole contact unloads [N/mm]. These and the next three numbers are None
        unless requested by `ContactSolver.with_stiffness`, or by a material with the constants of
        `Material.conducting`.
    conductance_width : float or None
        Diameter of the circular contact with the same conductance [mm].
    electrical_conductance, thermal_conductance : float or None
        Conductance of the contact [S] and [W/K]; only for a material with the constants of `Material.conducting`.
    tilt_stiffness : ndarray of float64, shape (3, 3), or None
        Derivatives of the load and of the integrals of p x and p y with respect to the approach, tilt_x and tilt_y
        [N/mm, N, N mm]; symmetric. None unless requested by ``ContactSolver.with_stiffness(solution, tilts=True)``.
    plastic : ndarray of bool, or None
        Cells at the hardness; None without a hardness.
    indentation_before : ndarray of float64, or None
        Depth of the residual surfaces of the problem [mm]; None without one or without a hardness.
    extra : dict of str to ndarray
        More fields by their names in a result file, also attributes of the solution: ``hardness``,
        ``background_pressure`` [N/mm2] and ``surface_compliance`` [mm3/N] of the cells if they differ, ``worn_depth``
        of `ContactSolver.wear` [mm], and those of `flow`.
    computed : dict
        Results that methods have computed: that of `flow`.
    """

    pressure: Floats
    contact: Mask
    converged: bool
    message: str
    prescribed: str
    approach: float
    indentation: float
    tilt_x: float
    tilt_y: float
    residual: float
    iterations: int
    inner_iterations: int
    work_units: float
    operator_applications: float
    discretisation_error: float
    fallbacks: int
    rms_height: float
    rms_slope: float
    rtol: float
    certificate: Certificate
    history: dict[str, list[Any]]
    problem: dict[str, Any]
    options: str
    notes: tuple[str, ...]
    solve_seconds: float
    setup_seconds: float
    traffic: Traffic
    grid: Grid
    slabs: Slabs
    comm: Comm
    distance: Callable[[], Floats]  # function that returns `undeformed_distance`
    deformation: Callable[[], Floats]  # function that returns `displacement`
    stiffness: float | None = None
    unloading_stiffness: float | None = None
    conductance_width: float | None = None
    electrical_conductance: float | None = None
    thermal_conductance: float | None = None
    tilt_stiffness: Floats | None = None
    plastic: Mask | None = None
    indentation_before: Floats | None = None
    extra: dict[str, np.ndarray] = field(default_factory=dict)
    computed: dict[str, Any] = field(default_factory=dict)

    def __getstate__(self):
        """Return the state without communicator; TypeError on several ranks."""
        if self.comm.size > 1:
            raise TypeError("a Solution on several ranks cannot be pickled; gather() brings it to one")
        fields = {"distance": self.undeformed_distance, "deformation": self.displacement}
        return self.__dict__ | fields | {"comm": None}

    def __setstate__(self, state):
        from app.base.mpi import MPI

        h, u = state["distance"], state["deformation"]
        self.__dict__.update(state, distance=lambda: h, deformation=lambda: u, comm=MPI.COMM_SELF)

    @property
    def displacement(self) -> Floats:
        """Displacement u = A p of both surfaces together, (2.7), (rows, nx) [mm].

        After a solve on lists of cells the first access computes it, by a product.
        """
        return self.deformation()

    def deformation_plus(self, change: Floats) -> Callable[[], Floats]:
        """Return a function that returns the displacement plus a `change` [mm]."""
        deformation = self.deformation
        return lambda: deformation() + change

    @property
    def undeformed_distance(self) -> Floats:
        """Undeformed distance at the approach, (rows, nx) [mm].

        With a hardness it belongs to the bodies before any permanent indentation.
        """
        return self.distance()

    @property
    def gap(self) -> Floats:
        """Gap between the deformed bodies, shape (rows, nx) [mm].

        The gap is e = h + u; with a hardness it is e + `plastic_depth`.
        """
        gap = self.undeformed_distance + self.displacement
        return gap if self.plastic is None else gap + self.plastic_depth

    @property
    def plastic_depth(self) -> Floats | None:
        """Depth of the permanent indentation, shape (rows, nx) [mm].

        In cells at the hardness it is the overlap -e. In other cells it is zero, or the `indentation_before`. None
        without a hardness.
        """
        if self.plastic is None:
            return None
        overlap = -(self.undeformed_distance + self.displacement)
        before = 0.0 if self.indentation_before is None else self.indentation_before
        return np.where(self.plastic, np.maximum(overlap, before), before)

    @property
    def error_bound(self) -> float:
        """Proved bound of the pressure's relative error in the energy norm."""
        return self.certificate.error_bound

    @property
    def x(self) -> Floats:
        """Cell centres in x, shape (nx,) [mm]."""
        return self.grid.x()

    @property
    def y(self) -> Floats:
        """Cell centres in y of the local rows [mm]."""
        return self.grid.y(self.slabs.rows)

    @property
    def requested_numbers(self) -> dict[str, float]:
        """Stiffness, conductance and flow by name, if they were requested."""
        values = {name: getattr(self, name) for name in STIFFNESS_NUMBERS}
        flow = self.computed["flow"].select(FLOW_NUMBERS) if self.computed else {}
        return {name: value for name, value in values.items() if value is not None} | flow

    @property
    def attributes(self) -> dict[str, Any]:
        """Numbers and texts of this solution: the root attributes of its file."""
        from app import __version__

        numbers = [field.name for field in fields(self) if field.type in (bool, int, float, str)]
        if self.plastic is None:
            numbers = [name for name in numbers if name not in PLASTIC_NUMBERS]
        return {
            **self.problem,
            **{ATTRIBUTE_NAMES.get(name, name): getattr(self, name) for name in numbers},
            **self.requested_numbers,
            **({} if self.tilt_stiffness is None else {"tilt_stiffness": self.tilt_stiffness.ravel()}),
            **vars(self.certificate),
            **vars(self.traffic),
            "cell_size": [self.grid.dx, self.grid.dy],
            "notes": "\n".join(self.notes),
            "ranks": self.comm.size,
            "solving_ranks": int(np.count_nonzero(self.slabs.counts)),
            "command_line": "",
            "version": __version__,
        }

    def gather(self, root: int = 0) -> Self | None:
        """Return the whole solution on rank `root`. Collective.

        Returns
        -------
        Solution, or None on the other ranks
        """
        if self.comm.size == 1:
            return self
        from app.base.mpi import MPI

        names = "pressure", "displacement", "contact", "undeformed_distance"
        names += "plastic", "indentation_before"
        fields = {name: field for name in names if (field := getattr(self, name)) is not None}
        gather = partial(self._all_rows, root=root)
        whole = {name: gather(field) for name, field in fields.items()}
        whole["extra"] = {name: gather(field) for name, field in self.extra.items()}
        whole["computed"] = {name: result.map_fields(gather) for name, result in self.computed.items()}
        if self.comm.rank != root:
            return None
        h, u = whole.pop("undeformed_distance"), whole.pop("displacement")
        functions = {"distance": lambda: h, "deformation": lambda: u}
        return replace(self, **whole, **functions, slabs=Slabs(self.grid.ny), comm=MPI.COMM_SELF)

    def _all_rows(self, local, root=None):
        """Return a field's rows of all ranks. Collective.

        Only the rank `root` gets them, by default all ranks.
        """
        from app.base.mpi import MPI

        local, nx, receives = np.ascontiguousarray(local), self.grid.nx, root in (None, self.comm.rank)
        # Counts of items are limited to 2^31, so an item is a row.
        row = MPI.BYTE.Create_contiguous(nx * local.itemsize).Commit()
        whole = np.empty((self.grid.ny if receives else 0, nx), local.dtype)
        sent, received = [local, len(local), row], [whole, list(self.slabs.counts), row] if receives else None
        if root is None:
            self.comm.Allgatherv(sent, received)
        else:
            self.comm.Gatherv(sent, received, root)
        row.Free()
        return whole

    def _select_fields(self, attributes, taken, what):
        """Return the local rows of attributes that are fields."""
        selected = {}
        for name, value in attributes.items():
            if name in taken:
                raise InputError(f"{what}: {name} exists already; choose another name")
            if not name or name == "." or "/" in name:
                raise InputError(f"{what}: {name!r} is not allowed as a name")
            try:
                array = real_numbers(name, value) if np.ma.is_masked(value) else np.asarray(value)
            except ValueError:  # a list of lists of several lengths
                raise InputError(f"{what}: attributes: must be numbers, texts, and arrays") from None
            if array.shape == self.pressure.shape:
                selected[name] = array
            elif array.shape == self.grid.shape:
                selected[name] = array[self.slabs.rows]
            elif array.dtype.kind != "U" and array.nbytes >= _MAX_ATTRIBUTE_BYTES:
                raise InputError(f"{what}: {name}: must be an array of the cells, or less than 64 KB")
        return selected

    def save(self, path: PathLike, steps: Mapping[str, np.ndarray] | None = None, **attributes: Any) -> None:
        """Write a result file (HDF5). Collective.

        Parameters
        ----------
        path : str or Path
            Name of the file, which must end in ``.h5`` or ``.hdf5``.
        steps : mapping of str to ndarray, shape (steps,), optional
            Table of a load path, `app.api.load_path.LoadPath.table`, for the group ``path`` of the file.
        **attributes
            More root attributes of the file. Arrays of all cells, or of the local rows, become fields, which
            `app.read_result` returns in ``extra``. Only the attributes in `RUN_ATTRIBUTES` may be replaced.

        Raises
        ------
        InputError
            If the file cannot be written, or the name of an attribute is taken.
        """
        from app.io.result import Result
        from app.io.write import write_result

        check_equal_on_ranks(self.comm, list(attributes), f"result file {path}: names of attributes")
        h, u, depth = self.undeformed_distance, self.displacement, self.plastic_depth
        fields = {
            "pressure": self.pressure,
            "gap": h + u if depth is None else h + u + depth,
            "displacement": u,
            "undeformed_distance": h,
            "contact": self.contact.view(np.uint8),
        }
        if depth is not None:
            fields |= {"plastic": self.plastic.view(np.uint8), "plastic_depth": depth}
        fields |= self.extra
        facts = self.attributes | ({} if attributes.keys() >= _COUNTED else self.count_patches())
        own = {*facts, *fields, *ATTRIBUTE_NAMES, *Result.__dataclass_fields__} - RUN_ATTRIBUTES - _COUNTED
        more = call_collectively(self.comm, self._select_fields, attributes, own, f"result file {path}")
        kinds = {name: field.dtype.str for name, field in more.items()}
        check_equal_on_ranks(self.comm, kinds, f"result file {path}: names and types of fields")
        fields |= more
        facts |= {name: value for name, value in attributes.items() if name not in more}
        contents = fields, self.x, self.grid.y(), facts, self.history, steps
        try:
            write_result(path, self.comm, self.slabs, *contents)
        except OSError as error:
            raise InputError(f"result file {path}: cannot be written: {error}") from None


def fingerprint(start):
    """Return numbers that identify this solution, compared between ranks."""
    if not isinstance(start, Solution):
        return type(start).__name__
    return start.load, start.approach, start.max_pressure, start.contact_cells
