"""What a solve returns: fields, numbers, history; on any number of ranks."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from app.base.errors import InputError, call_collectively, check_equal_on_ranks
from app.contact.certificate import Certificate
from app.contact.grid_errors import GridErrors
from app.halfspace.grid import Grid
from app.io.contact_fields import ATTRIBUTE_NAMES, ContactFields
from app.parallel.communicator import Traffic
from app.parallel.slabs import Slabs
from app.problems.arrays import real_numbers

# Attributes that who saves may know better: those of a whole run, and errors from more grids.
OF_RUN = {"command_line", "notes", "options", "setup_seconds", "stiffness", *GridErrors._fields}
_LARGE = 65_000  # bytes: HDF5 has no larger attributes, but texts
_OF_FILE = {"contact_patches", "largest_patch"}  # are counted for it, if nobody has


@dataclass(frozen=True, eq=False, repr=False)
class Solution(ContactFields):
    """The solution of a contact problem, or the best there is.

    Arrays hold the rows of this rank, (rows, nx); `gather` brings all of them to one. Can be pickled there.

    Attributes
    ----------
    pressure : ndarray of float64, [N/mm2]
    displacement : ndarray of float64, [mm]
        u = A p, (2.7).
    contact : ndarray of bool
    converged : bool
        Contact area unchanged, (5.1) met, and proved to the error bound asked for.
    message : str
        Why the iteration ended.
    load, approach, indentation : float
        [N], [mm]; the approach beyond first touch [mm].
    mean_pressure, mean_gap : float
        Load over the area of the patch [N/mm2]; mean of the gap over the cells where contact is possible [mm].
    contact_area, mean_contact_pressure : float
        [mm2]; load over it [N/mm2].
    pressure_centre_x, pressure_centre_y, moment_x, moment_y : float
        Centre of pressure [mm], and moments about the axes through the origin [N mm].
    semi_axis_major, semi_axis_minor, major_axis_angle : float
        Of the ellipse with the second moments of the contact set [mm]; its angle from the x axis [degree]. These seven
        are NaN on a periodic patch, which has no origin.
    contact_fraction, contact_fraction_corrected, perimeter : float
        Share of the cells where contact is possible; the same corrected for its stepped boundary; the length of that
        [mm]. See `app.contact.measures`.
    rms_height, rms_slope : float
        Of the undeformed distance [mm], [1].
    residual : float
        ||r|| / ||h||, (5.1).
    iterations, inner_iterations : int
        Active set iterations on the target grid, and those of the linear solver in them.
    work_units, operator_applications : float
        The paper's count; and everything computed, in products on the target grid.
    discretisation_error : float
        Relative rms difference of the pressures on the last two grids; NaN where it is not known.
    load_error, approach_error, max_pressure_error, contact_area_error : float
        Estimated relative errors that the size of the cells makes in these numbers, rather too large; the approach
        counts from first touch. NaN but of the default methods with nested iteration; see `app.contact.grid_errors`.
    fallbacks : int
        Grids on which a fallback took over: the safeguard, or the root search for a load.
    certificate : Certificate
    history : dict of str to list
        A column per quantity, an entry per active set iteration.
    problem : dict
        What the problem says of itself.
    options : str
    notes : tuple of str
        What a user should look at twice.
    solve_seconds, setup_seconds : float
    traffic : Traffic
        What rank 0, which has a part in every grid, sent to others for it.
    grid : Grid
    slabs : Slabs
    comm : mpi4py communicator
    stiffness : float or None
        dF/d(approach) [N/mm]; None where nobody has asked for it, see `ContactSolver.path`.
    """

    pressure: np.ndarray
    displacement: np.ndarray
    contact: np.ndarray
    converged: bool
    message: str
    load: float
    approach: float
    indentation: float
    residual: float
    iterations: int
    inner_iterations: int
    work_units: float
    operator_applications: float
    discretisation_error: float
    load_error: float
    approach_error: float
    max_pressure_error: float
    contact_area_error: float
    fallbacks: int
    max_pressure: float
    contact_cells: int
    contact_fraction: float
    contact_fraction_corrected: float
    perimeter: float
    contact_area: float
    mean_contact_pressure: float
    mean_pressure: float
    mean_gap: float
    pressure_centre_x: float
    pressure_centre_y: float
    moment_x: float
    moment_y: float
    semi_axis_major: float
    semi_axis_minor: float
    major_axis_angle: float
    rms_height: float
    rms_slope: float
    rtol: float
    certificate: Certificate
    history: dict
    problem: dict
    options: str
    notes: tuple
    solve_seconds: float
    setup_seconds: float
    traffic: Traffic
    grid: Grid
    slabs: Slabs
    comm: object
    distance: object  # gives `undeformed_distance` when called
    stiffness: float | None = None

    def __getstate__(self):
        """What is pickled: everything, on one rank; the copy has a communicator of its own process."""
        if self.comm.size > 1:
            raise TypeError("a Solution on several ranks cannot be pickled; gather() brings it to one")
        return self.__dict__ | {"distance": self.undeformed_distance, "comm": None}

    def __setstate__(self, state):
        from app.base.mpi import MPI

        h = state["distance"]
        self.__dict__.update(state, distance=lambda: h, comm=MPI.COMM_SELF)

    @property
    def undeformed_distance(self):
        """h, the approach taken off, shape (rows, nx) [mm]; NaN where contact is impossible. Made when asked for."""
        return self.distance()

    @property
    def gap(self):
        """Deformed distance e = h + u, (2.3), shape (rows, nx) [mm]; NaN where contact is impossible."""
        return self.undeformed_distance + self.displacement

    @property
    def error_bound(self):
        """Proved bound of the relative error of the pressure in the energy norm."""
        return self.certificate.error_bound

    @property
    def x(self):
        """Cell centres in x, shape (nx,) [mm]."""
        return self.grid.x()

    @property
    def y(self):
        """Cell centres in y of the rows here [mm]."""
        return self.grid.y(self.slabs.rows)

    @property
    def attributes(self):
        """All numbers and texts, as they go into the root of a result file. Not collective."""
        from app import __version__

        numbers = [field.name for field in fields(self) if field.type in ("bool", "int", "float", "str")]
        return {
            **self.problem,
            **{ATTRIBUTE_NAMES.get(name, name): getattr(self, name) for name in numbers},
            **({} if self.stiffness is None else {"stiffness": self.stiffness}),
            **vars(self.certificate),
            **vars(self.traffic),
            "cell_size": [self.grid.dx, self.grid.dy],
            "notes": "\n".join(self.notes),
            "ranks": self.comm.size,
            "solving_ranks": int(np.count_nonzero(self.slabs.counts)),
            "command_line": "",
            "version": __version__,
        }

    def gather(self, root=0):
        """Bring all rows to one rank. Collective.

        Returns
        -------
        Solution, or None on the other ranks
        """
        if self.comm.size == 1:
            return self
        from app.base.mpi import MPI

        here, whole, nx = self.comm.rank == root, {}, self.grid.nx
        for name in ("pressure", "displacement", "contact", "undeformed_distance"):
            mine = np.ascontiguousarray(getattr(self, name))
            row = MPI.BYTE.Create_contiguous(nx * mine.itemsize).Commit()  # pickles end at 2 GiB
            whole[name] = np.empty((self.grid.ny if here else 0, nx), mine.dtype)
            self.comm.Gatherv(
                [mine, len(mine), row], [whole[name], list(self.slabs.counts), row] if here else None, root
            )
            row.Free()
        if not here:
            return None
        h = whole.pop("undeformed_distance")
        return replace(self, **whole, distance=lambda: h, slabs=Slabs(self.grid.ny), comm=MPI.COMM_SELF)

    def _fields_among(self, attributes, taken, what):
        """Attributes that are arrays of the cells, of all or of those here: their rows here. Not collective."""
        found = {}
        for name, value in attributes.items():
            if name in taken:
                raise InputError(f"{what}: {name} is there already; allowed: another name")
            if not name or name == "." or "/" in name:
                raise InputError(f"{what}: {name!r} cannot be a name in it")
            try:
                array = real_numbers(name, value) if np.ma.is_masked(value) else np.asarray(value)
            except ValueError:  # a list of lists of several lengths
                raise InputError(f"{what}: attributes: needed: numbers, texts, and arrays") from None
            if array.shape == self.displacement.shape:
                found[name] = array
            elif array.shape == self.grid.shape:
                found[name] = array[self.slabs.rows]
            elif array.dtype.kind != "U" and array.nbytes >= _LARGE:
                raise InputError(f"{what}: {name}: needed: an array of the cells, or less than 64 KB")
        return found

    def save(self, path, steps=None, **attributes):
        """Write a result file (HDF5), whole or not at all. Collective.

        Parameters
        ----------
        path : str or Path
            Ends in ``.h5`` or ``.hdf5``.
        steps : mapping of str to ndarray, shape (steps,), optional
            Table of the load path that ended here, `app.api.load_path.LoadPath.table`; the group ``path`` of the file.
        **attributes
            More root attributes; arrays of all cells, or of the rows here, are more fields, which `app.read_result`
            has in ``extra``. Of those that are there `OF_RUN` may be others.

        Raises
        ------
        InputError
            If it cannot be written, or a name is the result's own.
        """
        from app.io.result import Result
        from app.io.write import ByRows, write_result

        check_equal_on_ranks(self.comm, list(attributes), f"result file {path}: names of attributes")
        h, u = self.undeformed_distance, self.displacement
        fields = {
            "pressure": self.pressure,
            "gap": ByRows(u.shape, u.dtype, lambda rows: h[rows] + u[rows]),
            "displacement": u,
            "undeformed_distance": h,
            "contact": self.contact.view(np.uint8),
        }
        facts = self.attributes | ({} if attributes.keys() >= _OF_FILE else self.count_patches())
        own = {*facts, *ATTRIBUTE_NAMES, *Result.__dataclass_fields__} - OF_RUN - _OF_FILE
        more = call_collectively(self.comm, self._fields_among, attributes, own, f"result file {path}")
        kinds = {name: field.dtype.str for name, field in more.items()}
        check_equal_on_ranks(self.comm, kinds, f"result file {path}: names and types of fields")
        fields |= more
        facts |= {name: value for name, value in attributes.items() if name not in more}
        try:
            write_result(
                path, self.comm, self.slabs, fields, self.x, self.grid.y(), facts, self.history, steps
            )
        except OSError as error:
            raise InputError(f"result file {path}: cannot be written: {error}") from None


def fingerprint(start):
    """What tells a Solution from another one, the same on all ranks; of anything else its type. Not collective."""
    if not isinstance(start, Solution):
        return type(start).__name__
    return start.load, start.approach, start.max_pressure, start.contact_cells
