"""Partial slip under a tangential load, from two normal solves.

Cattaneo (1938), Mindlin (1949), and for any contact Jaeger (1998) and Ciavarella (1998): under a constant normal load F
and a growing tangential load Q, the tangential traction is

    q = mu (p(F) - p(F*)),    F* = F - Q / mu,

with the pressures p of the normal contact. The contact of the smaller load sticks, the rest of the contact slips. With
the ratio k of tangential to normal compliance, the tangential displacement of distant points is k mu times the
difference of the approaches, and the slip is k mu times the gap under F*. If the bodies are similar and nu = 0, this
solves the discrete problem exactly. For other nu it neglects that the traction bends sideways.

In a cycle between -Q and Q the slip goes to and fro (Mindlin and Deresiewicz 1953), so friction dissipates 4 times the
integral of traction and slip.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any, overload

import numpy as np

from app.api.arguments import check_parts
from app.api.solution import Solution
from app.base import views
from app.base.errors import InputError, check_equal_on_ranks, format_exact, is_number, plain_number
from app.base.types import Axes, Figure, Floats, PathLike
from app.base.usage import usage
from app.contact.prescribed_load import LOAD_ROUNDING
from app.parallel.reductions import sum_over

_LARGEST_COUPLING = 1e-6  # Dundurs' constant beta up to which bodies are similar
_SMALL_LOAD = 1e-4  # Tangential load over mu F below which errors of the approaches outweigh the curvature.


@dataclass(frozen=True, eq=False)
class PartialSlip:
    """Contact under a normal and a tangential load; the same numbers on all ranks.

    For nu = 0 all numbers are exact on the grid. At nu = 0.3 the tangential displacement of a ball is up to 0.1% too
    large, and its tractions differ by 3% (rms) from those with lateral tractions; at nu = 0.5 by 0.3% and 6%.

    Attributes
    ----------
    normal, stuck : Solution
        Solutions under the normal load F, and under F - Q / mu, whose contact sticks.
    friction, tangential_load : float
        Coefficient of friction mu, and tangential load Q [N].
    tangential_displacement : float
        Displacement of distant points in the direction of Q [mm].
    stick_area, slip_area : float
        [mm2]
    tangential_stiffness : float
        Derivative of Q with respect to the tangential displacement, while Q grows [N/mm].
    dissipated_energy : float
        Energy that a full cycle between -Q and Q dissipates [N mm].
    error_bound : float
        Proved bound of the relative error of the traction in the energy norm, as a solution of the decoupled problem;
        infinite if Q is so small that the traction is lost in rounding.
    traction, slip : ndarray, shape (local rows, nx)
        Tangential traction [N/mm2], and relative displacement of the surfaces where they slip [mm].
    """

    normal: Solution
    stuck: Solution
    friction: float
    tangential_load: float
    tangential_displacement: float
    stick_area: float
    slip_area: float
    tangential_stiffness: float
    dissipated_energy: float
    error_bound: float
    traction: Floats
    slip: Floats

    def __repr__(self):
        contact = self.stick_area + self.slip_area
        share = self.stick_area / contact if contact else 0.0
        return (
            f"<PartialSlip: {self.tangential_load:g} N, {1e3 * self.tangential_displacement:.4g} um, "
            f"{share:.1%} of the contact sticks>"
        )

    @property
    def numbers(self) -> dict[str, float]:
        """Numbers by name; that of `error_bound` is ``traction_error_bound``."""
        numbers = {each.name: getattr(self, each.name) for each in fields(self) if each.type is float}
        return numbers | {"traction_error_bound": numbers.pop("error_bound")}

    @property
    def _solution(self):
        extra = self.normal.extra | {"traction": self.traction, "slip": self.slip}
        return replace(self.normal, extra=extra, problem=self.normal.problem | self.numbers)

    def plot(self, name: str = "slip", ax: Axes | None = None) -> tuple[Figure, Any]:
        """Draw maps of traction over mu p, and of slip; see `Solution.plot`.

        On several ranks, save the slip, and plot the result file.
        """
        return views.load().plot_solution(self._solution, name, ax)

    def save(self, path: PathLike, **attributes: Any) -> None:
        """Write the result file of `normal` with the fields and numbers of the slip; see `Solution.save`.

        Collective.
        """
        self._solution.save(path, **attributes)


def compliance_ratio(material):
    """Return the tangential over the normal compliance of similar bodies, (2 - nu) / (2 - 2 nu).

    Raises InputError if the bodies are coated or not similar, or Poisson's ratios are unknown.
    """
    if not material.is_half_space:
        raise InputError(
            "slip: only for half-spaces without coatings, whose compliances have a constant ratio"
        )
    if material.bodies == {}:
        raise InputError(
            "slip: E* alone does not give the tangential compliance; give the moduli of both bodies "
            "(Material.pair, -young and -poisson)"
        )
    if material.bodies:
        young, nu = (np.array(material.bodies[name]) for name in ("young", "poisson"))
        soft = (1 + nu) * (1 - 2 * nu) / young
        beta = (soft[0] - soft[1]) / (4 / material.contact_modulus)
        if abs(beta) > _LARGEST_COUPLING:
            raise InputError(
                f"slip: the bodies are not similar (Dundurs' beta {beta:.2g}; must be 0): pressure and friction are "
                "coupled"
            )
    return (2 - material.poisson_ratio) / (2 - 2 * material.poisson_ratio)


class Friction:
    """Methods of `ContactSolver` for tangential loads."""

    @overload
    def slip(self, *, load: float, friction: float, tangential_load: float) -> PartialSlip: ...

    @overload
    def slip(
        self, *, load: float, friction: float, tangential_load: Iterable[float]
    ) -> list[PartialSlip]: ...

    @usage("solver.slip(load=700, friction=0.3, tangential_load=100)")
    def slip(
        self, *, load: float, friction: float, tangential_load: float | Iterable[float]
    ) -> PartialSlip | list[PartialSlip]:
        """Solve for partial slip by two normal solves, and one linear solve for the stiffness.

        Parameters
        ----------
        load : float
            Normal load F, constant while the tangential load grows [N].
        friction : float
            Coefficient of friction mu, positive.
        tangential_load : float or sequence of float
            Tangential load Q in any direction, from 0 to mu F [N].

        Returns
        -------
        PartialSlip, or a list of them
            One for each tangential load.

        Raises
        ------
        InputError
            If a number is not allowed, the bodies are not similar, or the problem has a hardness, a background
            pressure or a surface compliance.
        """
        self._check_open()
        loads = [plain_number(each) for each in np.atleast_1d(tangential_load).tolist()]
        load, friction = plain_number(load), plain_number(friction)
        check_equal_on_ranks(self.comm, (load, friction, loads), "slip")
        ratio = self._check_slip(load, friction, loads)
        normal = self.solve(load=load)
        slips = [self._slip(normal, ratio, float(friction), float(each)) for each in loads]
        return slips if np.ndim(tangential_load) else slips[0]

    def _check_similar(self):
        """Return the ratio of the compliances, if slip can be solved for this problem."""
        check_parts("slip", self.problem, "hardness", "background_pressure", "surface_compliance")
        return compliance_ratio(self.problem.material)

    def _check_slip(self, load, friction, loads):
        """Check the arguments of `slip`; return the ratio of the compliances."""
        ratio = self._check_similar()
        for name, values in (("load", [load]), ("friction", [friction]), ("tangential_load", loads)):
            for value in values:
                if not (
                    is_number(value)
                    and np.isfinite(value)
                    and (value > 0 or (value == 0 and values is loads))
                ):
                    limits = "a number from 0" if values is loads else "a positive number"
                    raise InputError(f"{name} {value}: must be {limits}")
        for each in loads:
            if each > friction * load * (1 + LOAD_ROUNDING):
                most = f"must be at most {format_exact(friction * load)} N, friction times load"
                raise InputError(f"tangential_load {format_exact(each)}: the bodies slide; {most}")
        return ratio

    def _slip(self, normal, ratio, friction, tangential_load):
        smaller = max(normal.load - tangential_load / friction, 0.0)
        stuck = self.solve(load=smaller) if tangential_load else normal
        p, u = normal.pressure - stuck.pressure, normal.displacement - stuck.displacement
        slip = np.where(normal.contact & ~stuck.contact, np.maximum(stuck.gap, 0.0), 0.0)
        products = [np.vdot(p, slip), np.vdot(p, u)]
        products += [np.vdot(each.pressure, each.displacement) for each in (normal, stuck)]
        work, change, *energies = np.maximum(sum_over(normal.comm, products), 0.0)
        stiffness = self.stiffness(stuck) / ratio
        moved = friction * ratio * (normal.approach - stuck.approach)
        if tangential_load < _SMALL_LOAD * friction * normal.load:
            moved = tangential_load / stiffness
        errors = normal.error_bound * np.sqrt(energies[0]) + stuck.error_bound * np.sqrt(energies[1])
        return PartialSlip(
            normal=normal,
            stuck=stuck,
            friction=friction,
            tangential_load=tangential_load,
            tangential_displacement=moved,
            stick_area=stuck.contact_area,
            slip_area=normal.contact_area - stuck.contact_area,
            tangential_stiffness=stiffness,
            dissipated_energy=float(4 * friction * (friction * work) * ratio) * self.problem.grid.cell_area,
            error_bound=float(errors / np.sqrt(change)) if change else np.inf if tangential_load else 0.0,
            traction=friction * p,
            slip=friction * ratio * slip,
        )
