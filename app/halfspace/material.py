"""Elastic constants of the two bodies (paper, Sec. 2.2)."""

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from app.base.errors import InputError, format_exact, is_number, to_float
from app.base.types import Length
from app.base.units import to_length
from app.base.usage import usage
from app.halfspace.creep import CreepFunction
from app.halfspace.kernel import HalfSpaceKernel, Kernel
from app.halfspace.layer import Layer
from app.halfspace.layered_kernel import LayeredKernel

_SHORTEST, _LONGEST = 1e-50, 1e50  # relaxation times [s]


@usage("Material.isotropic(E, nu) of equal bodies, or Material.combined(G, nu) of the pair")
@dataclass(frozen=True, init=False, repr=False)
class Material:
    """Combined elastic constants of both bodies (Sec. 2.2).

    The constructor takes keywords only. `isotropic` and `pair` make a material from Young's moduli.

    Parameters
    ----------
    shear_modulus : float
        G with 2/G = 1/G1 + 1/G2 [N/mm2]; a rigid body has 1/G1 = 0.
    poisson_ratio : float
        nu with 2 nu/G = nu1/G1 + nu2/G2, from 0 to 0.5.

    Attributes
    ----------
    bodies : mapping or None
        ``young`` and ``poisson`` of both bodies, if the material was made from these. Empty if it was made from E*
        alone; None if it was made from G and nu.
    resistivity, thermal_conductivity : tuple of float, or None
        Constants of the two bodies, see `conducting`.
    coatings : tuple of app.halfspace.layer.Layer
        Layers of the bodies, see `coated` and `layer`: none, one (of the first body), or two. For a body with a layer,
        all numbers above describe the layer's material, which determines the displacement by short waves.
    own_kernel : app.halfspace.kernel.Kernel or None
        Kernel of the bodies if they are neither half-spaces nor coated, see `from_kernel`.
    creep : app.halfspace.creep.CreepFunction, or None
        Creep function of the displacement, see `viscoelastic`; None if both bodies are elastic.
    relaxation : mapping or None
        ``relaxation_times`` and ``relaxation_moduli``, as given.

    Notes
    -----
    Without friction only the contact modulus ``E* = G / (1 - nu)`` matters, 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2. So
    `from_contact_modulus` makes the material with G = E* and nu = 0.
    """

    shear_modulus: float
    poisson_ratio: float
    bodies: Mapping[str, tuple[float, float]] | None = field(default=None, init=False, compare=False)
    resistivity: tuple[float, float] | None = field(default=None, init=False, compare=False)
    thermal_conductivity: tuple[float, float] | None = field(default=None, init=False, compare=False)
    coatings: tuple[Layer, ...] = field(default=(), init=False)
    own_kernel: Kernel | None = field(default=None, init=False)
    creep: CreepFunction | None = field(default=None, init=False, compare=False)
    relaxation: Mapping[str, Any] | None = field(default=None, init=False, compare=False)

    def __init__(self, *, shear_modulus: float, poisson_ratio: float) -> None:
        for name, value in (("shear_modulus", shear_modulus), ("poisson_ratio", poisson_ratio)):
            object.__setattr__(self, name, _real(name.replace("_", " "), value))
        if not (np.isfinite(self.shear_modulus) and self.shear_modulus > 0):
            raise InputError(f"shear modulus {format_exact(self.shear_modulus)}: must be positive and finite")
        if not 0 <= self.poisson_ratio <= 0.5:
            raise InputError(f"Poisson ratio {format_exact(self.poisson_ratio)}: must be from 0 to 0.5")
        if not np.isfinite(self.compliance):
            small = format_exact(self.shear_modulus)
            raise InputError(f"shear modulus {small}: too small, its reciprocal is infinite")

    def __repr__(self):
        """Return the call that makes this material."""

        def both(values):
            return f"({', '.join(map(format_exact, values))}{',' if len(values) == 1 else ''})"

        if self.own_kernel is not None:
            made = f".from_kernel({self.own_kernel!r})"
        elif self.coatings:
            made = f"({', '.join(f'{name}={value!r}' for name, value in self.describe().items())})"
        elif self.bodies:
            made = f".pair(young={both(self.bodies['young'])}, poisson={both(self.bodies['poisson'])})"
        elif self.bodies is not None:
            made = f".from_contact_modulus({format_exact(self.contact_modulus)})"
        else:
            pair = {"shear_modulus": self.shear_modulus, "poisson_ratio": self.poisson_ratio}
            made = f"({', '.join(f'{name}={value!r}' for name, value in pair.items())})"
        constants = {name: getattr(self, name) for name in ("resistivity", "thermal_conductivity")}
        constants = ", ".join(f"{name}={both(pair)}" for name, pair in constants.items() if pair is not None)
        made += f".conducting({constants})" if constants else ""
        if self.relaxation:
            times, moduli, *body = self.relaxation.values()
            made += f".viscoelastic({both(times)}, {both(moduli)}{f', body={body[0]}' if body else ''})"
        return f"Material{made}"

    @classmethod
    def combined(cls, shear_modulus: float, poisson_ratio: float) -> Self:
        """Make the material from combined G and nu; see the parameters of `Material`."""
        return cls(shear_modulus=shear_modulus, poisson_ratio=poisson_ratio)

    @classmethod
    @usage("Material.isotropic(E, nu), of two materials Material.pair((E1, E2), (nu1, nu2))")
    def isotropic(cls, young: float, poisson: float) -> Self:
        """Make the material of two bodies that consist of the same material.

        `young`: E of each body [N/mm2]; `poisson`: nu of each body, from 0 to 0.5.

        Examples
        --------
        >>> steel = Material.isotropic(210e3, 0.3)
        >>> round(steel.contact_modulus)
        115385
        """
        young, poisson = _real("Young's modulus", young), _real("Poisson's ratio", poisson)
        return cls.pair((young, young), (poisson, poisson))

    @classmethod
    @usage("Material.pair((E1, E2), (nu1, nu2)), of equal bodies Material.isotropic(E, nu)")
    def pair(cls, young: Sequence[float], poisson: Sequence[float]) -> Self:
        """Make the material from Young's moduli and Poisson's ratios of both bodies.

        `young`: E1, E2 [N/mm2], inf for a rigid body; `poisson`: nu1, nu2, each from 0 to 0.5, ignored for a rigid
        body. Raises InputError if a number is out of range, or both bodies are rigid.

        Examples
        --------
        >>> steel_on_polymer = Material.pair((210e3, 3e3), (0.3, 0.35))
        >>> round(steel_on_polymer.contact_modulus)
        3369
        """
        try:
            young, poisson = (tuple(map(to_float, pair)) for pair in (young, poisson))
        except (TypeError, ValueError):
            wanted = "must be two Young's moduli and two Poisson's ratios, (E1, E2), (nu1, nu2)"
            raise InputError(f"pair: {wanted}") from None
        if not (len(young) == 2 and all(modulus > 0 for modulus in young)):
            given = ",".join(map(format_exact, young))
            raise InputError(f"Young's moduli {given}: must be two positive numbers; inf: a rigid body")
        if not (len(poisson) == 2 and all(0 <= ratio <= 0.5 for ratio in poisson)):
            given = ",".join(map(format_exact, poisson))
            raise InputError(f"Poisson's ratios {given}: must be two numbers from 0 to 0.5")
        if all(map(math.isinf, young)):
            raise InputError("Young's moduli inf,inf: one body at least must be elastic")
        reciprocal = [2 * (1 + ratio) / modulus for modulus, ratio in zip(young, poisson, strict=True)]  # 1/G
        ratio = sum(one * other for one, other in zip(reciprocal, poisson, strict=True)) / sum(reciprocal)
        pair = cls(shear_modulus=2 / sum(reciprocal), poisson_ratio=ratio)
        return pair._made_from(young=young, poisson=poisson)

    @classmethod
    def from_contact_modulus(cls, contact_modulus: float) -> Self:
        """Make the material from the modulus E* [N/mm2].

        Examples
        --------
        >>> Material.from_contact_modulus(25.0).describe()
        {'contact_modulus': 25.0}
        """
        contact_modulus = _real("contact modulus", contact_modulus)
        if not (np.isfinite(contact_modulus) and contact_modulus > 0):
            raise InputError(f"contact modulus {format_exact(contact_modulus)}: must be positive and finite")
        return cls(shear_modulus=contact_modulus, poisson_ratio=0.0)._made_from()

    @classmethod
    @usage(
        "Material.coated((E_coat, E_substrate), (nu_coat, nu_substrate), thickness, other=(E, nu) or a coated body)"
    )
    def coated(
        cls,
        young: Sequence[float],
        poisson: Sequence[float],
        thickness: Length,
        other: Sequence[float] | Self | None = None,
    ) -> Self:
        """Make the material of a coated body and of another one.

        The coating is bonded to its substrate.

        Parameters
        ----------
        young, poisson : two floats
            E [N/mm2] and nu of the coating and of the substrate; E inf: a rigid substrate.
        thickness : float or str
            Thickness of the coating [mm]; a text may have a unit, as in "2 um".
        other : two floats or Material, optional
            E [N/mm2] and nu of the other body, or a Material from `coated` or `layer` without `other`; default: rigid.

        Examples
        --------
        >>> tool = Material.coated((450e3, 210e3), (0.25, 0.3), thickness=2e-3, other=(210e3, 0.3))
        >>> tool.describe()["coating_thickness"]
        0.002
        """
        thickness = to_length("thickness", thickness)
        if not (np.isfinite(thickness) and thickness > 0):
            raise InputError(f"thickness {format_exact(thickness)}: must be positive and finite [mm]")
        moduli, ratios = _pair_of_reals(young, poisson, "coated")
        if not np.isfinite(moduli[0]):
            raise InputError(f"Young's modulus {format_exact(moduli[0])} of the coating: must be finite")
        cls.pair(moduli, ratios)  # checks the substrate
        layers = [Layer(thickness, moduli, ratios)]
        if isinstance(other, Material):
            if len(other.coatings) != 1 or np.isfinite(other.bodies["young"][1]):
                wanted = "E, nu of the other body, or Material.coated or Material.layer without other="
                raise InputError(f"other: must be {wanted}")
            layers += other.coatings
            (surface, below) = zip(layers[1].young, layers[1].poisson, strict=True)
        elif other is None:
            surface = below = np.inf, 0.0
        else:
            surface = below = _pair_of_reals(other, (0, 0), "other")[0]
        material = cls.pair((moduli[0], surface[0]), (ratios[0], surface[1]))
        material._made_from(young=(moduli[1], below[0]), poisson=(ratios[1], below[1]))
        object.__setattr__(material, "coatings", tuple(layers))
        return material

    @classmethod
    @usage("Material.layer(E, nu, thickness, other=(E, nu))")
    def layer(
        cls,
        young: float,
        poisson: float,
        thickness: Length,
        other: Sequence[float] | Self | None = None,
    ) -> Self:
        """Make the material of a layer on a rigid base.

        `young` E [N/mm2] and `poisson` nu describe the layer. `thickness` and the other body, `other`, are as in
        `coated`.

        Examples
        --------
        >>> lining = Material.layer(5.0, 0.49, thickness=3.0)
        """
        young, poisson = _real("Young's modulus", young), _real("Poisson's ratio", poisson)
        return cls.coated((young, np.inf), (poisson, 0.0), thickness, other)

    @classmethod
    def from_kernel(cls, kernel: Kernel) -> Self:
        """Make the material of two bodies from their `app.halfspace.kernel.Kernel`.

        Estimates and notes use the contact modulus of the kernel's `compliance`.
        """
        if not isinstance(kernel, Kernel):
            raise InputError(f"kernel: {kernel!r}; must be a Kernel")
        if not 0 < kernel.compliance < np.inf:
            raise InputError(
                f"kernel: its compliance is {format_exact(kernel.compliance)}; must be positive and finite"
            )
        material = cls.from_contact_modulus(1 / (np.pi * kernel.compliance))
        object.__setattr__(material, "own_kernel", kernel)
        return material

    def _made_from(self, **bodies):
        object.__setattr__(self, "bodies", bodies)
        return self

    def conducting(
        self,
        resistivity: float | Sequence[float] | None = None,
        thermal_conductivity: float | Sequence[float] | None = None,
    ) -> Self:
        """Return a copy with constants for the conductance.

        Parameters
        ----------
        resistivity : float or two floats, optional
            Electrical resistivity of each body [ohm m], at least 0; 0: a perfect conductor, one of the two at most.
        thermal_conductivity : float or two floats, optional
            Thermal conductivity of each body [W/(m K)], above 0; inf: a perfect conductor, one of the two at most.

        Examples
        --------
        >>> copper = Material.isotropic(120e3, 0.34).conducting(resistivity=1.7e-8, thermal_conductivity=390)
        >>> copper.resistivity
        (1.7e-08, 1.7e-08)
        """
        if not (self.is_half_space or (resistivity is None and thermal_conductivity is None)):
            bodies, place = ("coated bodies", "a layer") if self.coatings else ("such bodies", "them")
            raise InputError(
                f"resistivity, thermal_conductivity: not for {bodies}: current and pressure spread differently in "
                f"{place}, so the stiffness does not give the conductance"
            )
        copied = copy(self)
        for name, values, wanted in (
            ("resistivity", resistivity, "at least 0, and one above 0 [ohm m]"),
            ("thermal_conductivity", thermal_conductivity, "above 0, and one finite [W/(m K)]"),
        ):
            if values is None:
                continue
            try:
                pair = np.broadcast_to([*map(to_float, np.atleast_1d(values))], 2)
            except (TypeError, ValueError):
                pair = np.full(2, np.nan)
            # A resistivity is the reciprocal of a conductivity.
            finite, positive = np.isfinite(pair), pair > 0
            every, some = (finite & (pair >= 0), positive) if name == "resistivity" else (positive, finite)
            if not (every.all() and some.any()):
                given = ",".join(map(str, values)) if np.ndim(values) else values
                raise InputError(f"{name} {given}: must be a number or one for each body, {wanted}")
            object.__setattr__(copied, name, tuple(pair.tolist()))
        return copied

    def viscoelastic(
        self, times: float | Sequence[float], moduli: float | Sequence[float], body: int | None = None
    ) -> Self:
        """Return a copy whose bodies relax, for `ContactSolver.creep`.

        The moduli of the material are the instantaneous ones. Poisson's ratios do not change with time.

        Parameters
        ----------
        times : float or sequence of float
            Relaxation times t_i [s], positive.
        moduli : float or sequence of float
            Relaxing shares g_i of the modulus, each above 0, which sum to less than 1: the relaxation modulus is
            E (1 - sum g_i (1 - exp(-t/t_i))).
        body : int, optional
            1 or 2: only this body relaxes. Default: both do.

        Examples
        --------
        >>> rubber = Material.pair((10, np.inf), (0.5, 0.3)).viscoelastic(times=(0.1, 10), moduli=(0.3, 0.4))
        >>> round(float(rubber.creep.at(1e6)), 6)
        3.333333
        """
        if not self.is_half_space:
            raise InputError("viscoelastic: only for half-spaces without coatings")
        if self.creep is not None:
            raise InputError(
                "viscoelastic: the material is viscoelastic already; both bodies, or one of them, relax"
            )
        try:
            times, moduli = (tuple(map(to_float, np.atleast_1d(values))) for values in (times, moduli))
        except (TypeError, ValueError):
            raise InputError("viscoelastic: must be times [s] and as many moduli, numbers") from None
        if not (len(times) == len(moduli) > 0 and all(_SHORTEST <= time <= _LONGEST for time in times)):
            raise InputError(
                "viscoelastic: must be one or more times from "
                f"{format_exact(_SHORTEST)} to {format_exact(_LONGEST)} s, and as many moduli"
            )
        if not (min(moduli) > 0 and sum(moduli) < 1):
            given = ",".join(map(format_exact, moduli))
            raise InputError(
                f"moduli {given}: must be above 0, and sum to less than 1 (else the body is a fluid)"
            )
        creep, relaxation = CreepFunction.from_relaxation(times, moduli), {}
        if body is not None:
            if not is_number(body) or body not in (1, 2) or not self.bodies:
                raise InputError(f"body {body}: must be 1 or 2, of a material made by Material.pair")
            young, poisson = (self.bodies[name][int(body) - 1] for name in ("young", "poisson"))
            creep = creep.mixed(self.contact_modulus * (1 - poisson**2) / young)
            relaxation["relaxing_body"] = int(body)
        copied, relaxation = (
            copy(self),
            {"relaxation_times": list(times), "relaxation_moduli": list(moduli)} | relaxation,
        )
        object.__setattr__(copied, "creep", creep)
        object.__setattr__(copied, "relaxation", relaxation)
        return copied

    @property
    def is_half_space(self) -> bool:
        """True if one modulus E* describes the bodies: they are isotropic half-spaces."""
        return not self.coatings and self.own_kernel is None

    @property
    def is_conducting(self) -> bool:
        """True if the material has constants for the conductance."""
        return self.resistivity is not None or self.thermal_conductivity is not None

    def describe(self) -> dict[str, Any]:
        """Return E* and the constants given by the user.

        Bodies that are no half-spaces have no E*. Of coated bodies `young` and `poisson` describe the substrates, and
        the numbers of the coatings are lists if both bodies are coated.
        """
        if self.own_kernel is not None:
            return self.own_kernel.describe()
        bodies = {name: list(values) for name, values in (self.bodies or {}).items()}
        if self.coatings:
            each = [(layer.young[0], layer.poisson[0], layer.thickness) for layer in self.coatings]
            numbers = each[0] if len(each) == 1 else [list(values) for values in zip(*each, strict=True)]
            names = "coating_young", "coating_poisson", "coating_thickness"
            return bodies | dict(zip(names, numbers, strict=True))
        pair = {"shear_modulus": self.shear_modulus, "poisson_ratio": self.poisson_ratio}
        constants = {name: getattr(self, name) for name in ("resistivity", "thermal_conductivity")}
        constants = {name: list(values) for name, values in constants.items() if values is not None}
        pair = {} if self.bodies == {} else pair
        return pair | bodies | {"contact_modulus": self.contact_modulus} | constants | (self.relaxation or {})

    @property
    def compliance(self) -> float:
        """Compliance (1 - nu) / (pi G) [mm2/N].

        A point force displaces the surface at a distance by compliance times force divided by distance.
        """
        return (1 - self.poisson_ratio) / (np.pi * self.shear_modulus)

    @property
    def kernel(self) -> Kernel:
        """Kernel of the influence matrix; see `app.halfspace.kernel`."""
        if self.own_kernel is not None:
            return self.own_kernel
        if not self.coatings:
            return HalfSpaceKernel(self.compliance)
        young, poisson = (values[1] for values in (self.bodies["young"], self.bodies["poisson"]))
        other = (1 - poisson**2) / (np.pi * young) if len(self.coatings) == 1 else 0.0
        return LayeredKernel(self.coatings, other)

    @property
    def contact_modulus(self) -> float:
        """Contact modulus E* = G / (1 - nu) [N/mm2].

        With coatings, this is E* for waves much shorter than the coatings are thick.
        """
        return self.shear_modulus / (1 - self.poisson_ratio)


def _real(name, value):
    try:
        return to_float(value)
    except (TypeError, ValueError):
        raise InputError(f"{name} {value!r}: must be a number") from None


def _pair_of_reals(first, second, what):
    """Return both pairs of numbers as tuples of floats."""
    try:
        pairs = tuple(tuple(map(to_float, pair)) for pair in (first, second))
    except (TypeError, ValueError):
        pairs = ()
    if [len(pair) for pair in pairs] != [2, 2]:
        both = "(E_coat, E_substrate), (nu_coat, nu_substrate)"
        raise InputError(f"{what}: must be {'E, nu of the other body' if what == 'other' else both}")
    return pairs
