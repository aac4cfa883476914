"""Background pressure: the pressure in the gap, of a gas or a fluid, is a lower bound of the contact pressure.

The contact problem with ``p >= p0`` becomes the usual one by the change of variables

    p' = p - p0,    h' = h + A p0,    H' = H - p0,    so that e = h + A p = h' + A p' and p' >= 0.

So the solvers know nothing of p0: they get the distance h', the hardness H' and the load that the contact carries. The
solution gets p0 and its displacement A p0 back. The energy norm of p - p* is that of p' - p'*, so the proof holds; the
relative error bound is relative to p'.
"""

from dataclasses import replace

import numpy as np

from app.base.errors import InputError, format_exact
from app.contact.distance import UndeformedDistance
from app.contact.full_plasticity import LOAD_ROUNDING
from app.contact.loading_input import LOADINGS, validate_number
from app.contact.measures import measure_roughness
from app.parallel.reductions import minimum_over, sum_over

_PER_LOAD = "load", "mean_pressure"  # loadings that include the load of the background pressure


class BackgroundPressure:
    """Background pressure of one problem, on the ranks of a hierarchy. Collective.

    Parameters
    ----------
    problem : Problem
    hierarchy : Hierarchy

    Attributes
    ----------
    pressure, displacement : ndarray, shape (local rows, nx)
        p0 [N/mm2] and A p0 [mm].
    hardness : float, ndarray or None
        The problem's hardness minus p0 [N/mm2].
    load : float
        Load of p0 [N].
    roughness : ShapeRoughness
        Roughness of the undeformed distance without A p0, once `raise_shapes` has been called.
    """

    def __init__(self, problem, hierarchy):
        operator, p0 = hierarchy.target, np.asarray(problem.background_pressure)
        self._grid, self._comm, rows = problem.grid, hierarchy.comm, hierarchy.slabs.rows
        self._field = p0[rows] if p0.ndim else None
        self.pressure = np.array(np.broadcast_to(p0, problem.grid.shape)[rows], dtype=float, order="C")
        self.displacement = np.empty_like(self.pressure)
        operator.exact_displacement(self.pressure, self.displacement)
        self.hardness = None if problem.hardness is None else problem.hardness - p0
        x, y = problem.grid.x(), problem.grid.y(rows)[:, None]
        p = self.pressure
        sums = sum_over(self._comm, [p.sum(), (p * x).sum(), (p * y).sum()])
        self.load, self._at_x, self._at_y = (problem.grid.cell_area * np.asarray(sums)).tolist()

    def raise_shapes(self, shapes, hierarchy):
        """Add A p0 to the undeformed distances of all levels, coarsest first. Collective.

        The roughness is measured before.
        """
        own, raised = UndeformedDistance(hierarchy.target, shapes[-1]), self.displacement
        self.roughness = measure_roughness(hierarchy.target, own, shapes[-1])
        own.destroy()
        for number in reversed(range(len(shapes))):
            shapes[number] += raised
            if number:
                raised = hierarchy.transfers[number].restrict_shape(raised)

    def net_loading(self, values, largest_load):
        """Return the loading of the contact alone.

        `largest_load` is the largest load of the contact [N]. Raises InputError if the prescribed load is less than
        that of the background pressure, or more than the bodies can carry.
        """
        kinds = [kind for kind in _PER_LOAD if values.get(kind) is not None]
        if len(kinds) != 1:
            return values
        kind, to_load = kinds[0], 1.0 if kinds[0] == "load" else self._grid.area
        number, least = validate_number(kind, values[kind]), self.load / to_load
        most = least + largest_load / to_load
        if not least * (1 - LOAD_ROUNDING) <= number <= most * (1 + LOAD_ROUNDING):
            limits = f"at least {format_exact(least)} {LOADINGS[kind]}, which the background pressure carries"
            if number > least:
                limits = (
                    f"at most {format_exact(most)} {LOADINGS[kind]}, which all cells carry at their hardness"
                )
            raise InputError(f"{kind} {format_exact(number)}: must be {limits}")
        return values | {kind: max(number - least, 0.0)}

    def total(self, measures, state):
        """Return `ContactMeasures` of a state with the largest total pressure on C. Collective."""
        highest = (state.p + self.pressure).max(where=state.contact, initial=0.0)
        [lowest] = minimum_over(self._comm, [-highest])
        return measures._replace(max_pressure=-float(lowest))

    def net(self, solution):
        """Return a Solution of the contact alone, to start from."""
        load = max(solution.load - self.load, 0.0)
        return replace(
            solution,
            pressure=solution.pressure - self.pressure,
            displacement=solution.displacement - self.displacement,
            load=load,
            mean_pressure=load / self._grid.area,
        )

    def add_to(self, solution, values):
        """Return a Solution of the contact alone with the background pressure added. Collective.

        `values` has the loading as the user gave it.
        """
        p, grid, distance = solution.pressure + self.pressure, self._grid, solution.distance
        [lowest] = minimum_over(self._comm, [-p.max(initial=-np.inf)])
        [inside] = sum_over(self._comm, [p.sum(where=solution.contact)])
        load, area = solution.load + self.load, solution.contact_area
        load = values["load"] if values.get("load") else load
        load = values["mean_pressure"] * grid.area if values.get("mean_pressure") else load
        moment_x, moment_y = solution.moment_x + self._at_y, solution.moment_y - self._at_x
        return replace(
            solution,
            pressure=p,
            background_field=self._field,
            displacement=solution.displacement + self.displacement,
            distance=lambda: distance() - self.displacement,
            load=load,
            mean_pressure=load / grid.area,
            max_pressure=-float(lowest),
            mean_contact_pressure=float(inside * grid.cell_area / area) if area else 0.0,
            moment_x=moment_x,
            moment_y=moment_y,
            pressure_centre_x=-moment_y / load if load else np.nan,
            pressure_centre_y=moment_x / load if load else np.nan,
        )
