"""Contact problems that become the usual one by a change of variables.

A pressure r that is known before a solve displaces the surfaces by A r. With a factor c and

    q = c p - r,    h' = h + A r,    so that e = h + c A p = h' + A q,

the usual problem of q and h' is solved: its distance is larger by A r, and its load is c times the load minus that of
r. The loops know nothing of r and c.

- *Background pressure* p0, of a gas or a fluid in the gap: p >= p0. Here c = 1, r = p0 and q = p - p0; a hardness H
  becomes H - p0.
- *Creep*: in a time step of viscoelastic bodies e = h + A (c p + r), where r is due to the pressures before. So q = c
  p, and r is added to q in the displacement only.

The energy norm of q - q* is that of c (p - p*), so the error bound is that of q: relative to q.
"""

from dataclasses import replace

import numpy as np

from app.base.errors import InputError, format_exact
from app.contact.distance import UndeformedDistance
from app.contact.full_plasticity import LOAD_ROUNDING
from app.contact.loading_input import LOADINGS, single_loading, validate_number
from app.contact.measures import measure_roughness
from app.contact.prescribed_load import PrescribedLoad
from app.contact.tilting_input import split_tilting
from app.parallel.reductions import minimum_over, sum_over


def check_kind(kind, what):
    """Raise InputError unless the prescribed number of p gives that of q."""
    if not (_load_kinds({kind: 1}) or LOADINGS[kind].is_geometric):
        raise InputError(f"{kind}: not with {what}; use approach or load")


def _load_kinds(values):
    """Return the names of the prescribed numbers that are loads, or loads per something."""
    given = (kind for kind in LOADINGS if values.get(kind) is not None)
    return [kind for kind in given if issubclass(LOADINGS[kind], PrescribedLoad)]


class ShiftedProblem:
    """Displacement A r that is added to a problem's shape. Collective.

    Parameters
    ----------
    problem : Problem
    hierarchy : Hierarchy
    pressure : ndarray, shape (local rows, nx)
        Known pressure r [N/mm2].

    Attributes
    ----------
    factor : float
        Factor c.
    uniform : float
        Uniform displacement by the background pressure of a layer on a rigid base, which A does not include [mm].
    displacement : ndarray, shape (local rows, nx)
        A r [mm].
    hardness : float, ndarray or None
        Upper bound of q [N/mm2].
    touching, roughness : float, ShapeRoughness
        First touch [mm] and roughness without A r, once `raise_shapes` has been called.
    """

    factor, uniform = 1.0, 0.0

    def __init__(self, problem, hierarchy, pressure):
        self.grid, self.comm, self.hardness = problem.grid, hierarchy.comm, problem.hardness
        self.displacement = np.empty_like(pressure)
        hierarchy.prepare_target()
        hierarchy.target.exact_displacement(pressure, self.displacement)

    def raise_shapes(self, shapes, hierarchy, known=None):
        """Add A r to the undeformed distances of all levels, coarsest first. Collective.

        First touch and roughness are measured before, unless they are `known`.
        """
        self.touching, self.roughness = known or _measure(hierarchy.target, shapes[-1])
        raised = self.displacement
        for number in reversed(range(len(shapes))):
            shapes[number] += raised
            if number:
                raised = hierarchy.transfers[number].restrict_shape(raised)

    def net_loading(self, values, largest_load):
        """Return the loading of q; `largest_load` is its largest load [N]."""
        return values | {kind: self.factor * values[kind] for kind in _load_kinds(values)}

    def total(self, measures, state):
        """Return the `ContactMeasures` of q with the largest pressure p on C. Collective."""
        return measures._replace(max_pressure=measures.max_pressure / self.factor)

    def net(self, solution):
        """Return the Solution of q, to start from."""
        raise NotImplementedError

    def totals(self, values, load):
        """Return load [N] and mean pressure [N/mm2], exactly as in `values` if one of them is prescribed."""
        for kind in _load_kinds(values):
            number, to_load = validate_number(kind, values[kind]), LOADINGS[kind].load_per_number(self.grid)
            load = number * to_load
            return load, number if to_load == self.grid.area else load / self.grid.area
        return load, load / self.grid.area

    def add_to(self, solution, values):
        """Return the Solution of p, given that of q. Collective.

        `values` has the loading as the user gave it.
        """
        distance = solution.distance
        return replace(
            solution,
            deformation=solution.deformation_plus(self.displacement),
            distance=lambda: distance() - self.displacement,
        )


class BackgroundPressure(ShiftedProblem):
    """Background pressure p0 of one problem. Collective.

    Attributes
    ----------
    pressure : ndarray, shape (local rows, nx)
        p0 [N/mm2].
    load : float
        Load of p0 [N].
    """

    def __init__(self, problem, hierarchy):
        p0, rows = np.asarray(problem.background_pressure), hierarchy.slabs.rows
        self._field = {"background_pressure": p0[rows]} if p0.ndim else {}
        self.pressure = np.array(np.broadcast_to(p0, problem.grid.shape)[rows], dtype=float, order="C")
        super().__init__(problem, hierarchy, self.pressure)
        self.hardness = None if problem.hardness is None else problem.hardness - p0
        x, y, p = self.grid.x(), self.grid.y(rows)[:, None], self.pressure
        sums = sum_over(self.comm, [p.sum(), (p * x).sum(), (p * y).sum()])
        self.load, self._at_x, self._at_y = (self.grid.cell_area * np.asarray(sums)).tolist()
        self.uniform = problem.kernel.uniform_compliance(self.grid) * self.load / self.grid.area

    def net_loading(self, values, largest_load):
        """Return the loading of p - p0; see `ShiftedProblem.net_loading`.

        Raises InputError if the prescribed load is less than that of the background pressure, or more than the bodies
        can carry.
        """
        kinds = _load_kinds(values)
        if len(kinds) != 1:
            check_kind(single_loading(split_tilting(values)[1])[0], "a background pressure")
            return values
        kind, to_load = kinds[0], LOADINGS[kinds[0]].load_per_number(self.grid)
        number, least = validate_number(kind, values[kind]), self.load / to_load
        most = least + largest_load / to_load
        if not least * (1 - LOAD_ROUNDING) <= number <= most * (1 + LOAD_ROUNDING):
            unit = LOADINGS[kind].unit
            limits = f"at least {format_exact(least)} {unit}, which the background pressure carries"
            if number > least:
                limits = f"at most {format_exact(most)} {unit}, which all cells carry at their hardness"
            raise InputError(f"{kind} {format_exact(number)}: must be {limits}")
        return values | {kind: max(number - least, 0.0)}

    def total(self, measures, state):
        """Return measures with the largest pressure on C; see `ShiftedProblem.total`."""
        highest = (state.p + self.pressure).max(where=state.contact, initial=0.0)
        [lowest] = minimum_over(self.comm, [-highest])
        return measures._replace(max_pressure=-float(lowest))

    def net(self, solution):
        """Return the Solution of p - p0; see `ShiftedProblem.net`."""
        load = max(solution.load - self.load, 0.0)
        return replace(
            solution,
            pressure=solution.pressure - self.pressure,
            deformation=solution.deformation_plus(-(self.displacement + self.uniform)),
            load=load,
            mean_pressure=load / self.grid.area,
        )

    def add_to(self, solution, values):
        """Return the Solution of p; see `ShiftedProblem.add_to`."""
        p = solution.pressure + self.pressure
        [lowest] = minimum_over(self.comm, [-p.max(initial=-np.inf)])
        [inside] = sum_over(self.comm, [p.sum(where=solution.contact)])
        load, mean_pressure = self.totals(values, solution.load + self.load)
        area = solution.contact_area
        moment_x, moment_y = solution.moment_x + self._at_x, solution.moment_y + self._at_y
        facts = solution.problem
        if "largest_load" in facts:
            facts = facts | {"largest_load": facts["largest_load"] + self.load}
        return replace(
            super().add_to(solution, values),
            pressure=p,
            extra=solution.extra | self._field,
            problem=facts,
            load=load,
            mean_pressure=mean_pressure,
            max_pressure=-float(lowest),
            mean_contact_pressure=float(inside * self.grid.cell_area / area) if area else 0.0,
            moment_x=moment_x,
            moment_y=moment_y,
            pressure_centre_x=moment_x / load if load else np.nan,
            pressure_centre_y=moment_y / load if load else np.nan,
        )


def _measure(operator, shape):
    """Return first touch [mm] and roughness of an undeformed distance. Collective."""
    own = UndeformedDistance(operator, shape)
    measured = own.touching, measure_roughness(operator, own)
    own.destroy()
    return measured
