"""Kernel of the bodies: surface displacement by a pressure.

Products, sweeps, preconditioners and the certificate get all numbers that depend on the elasticity of the bodies from a
kernel. So another kind of body needs only another `Kernel`. `Material.kernel` makes the kernel of a material;
`Material.from_kernel` makes a material of a kernel.
"""

from itertools import product

import numpy as np

from app.base.errors import InputError
from app.halfspace.love import love_coefficients
from app.halfspace.periodic_symbol import influence_symbol, wave_numbers

_SAMPLES = 200  # wave numbers at which the smallest and the largest eigenvalue are sought
_DIRECTIONS = 17  # of these waves, from x to y, if the compliance depends on the direction
_ALIASES = 6  # in each direction, of waves in multilevel products
_LOVE_FACTORS = 0.5, 2.0  # bounds of an eigenvalue for uniform cells over that of the same wave


class Kernel:
    """Elasticity of two bodies: displacements by pressures.

    A subclass defines `parameters`, `in_units`, `wave_compliance` and, for free patches, `unit_coefficients`. All other
    methods follow from these four; replace them by faster or sharper ones. The subclass must satisfy three conditions:

    - A is even in x and in y: a load displaces the cells at offsets (i, j), (-i, j) and (i, -j) equally, and waves
      (qx, qy) and (-qx, qy) have the same compliance. Quadrants of coefficients, real spectra and Gauss-Seidel sweeps
      contain only one of these numbers. So x and y are axes of symmetry of an anisotropic body.
    - A is symmetric and positive definite, on periodic patches except for constants.
    - Kernels with equal `parameters` are equal. Caches rely on it.

    Parameters
    ----------
    compliance : float
        Unit of the influence coefficients [mm2/N]. It is near the largest compliance of short waves.

    Attributes
    ----------
    scale_free : bool
        True if the compliance of waves does not depend on their length.
    isotropic : bool
        True if the compliance of waves does not depend on their direction.
    far_reaching : bool
        True if, far from a load, the displacement is proportional to the load divided by the distance.
    encloses_images : bool
        True if coefficients contain the images of a load in a direction in which the patch repeats.
    has_image_sums : bool
        True if a point force displaces the surface like that of a half-space, plus `layer_influence` with layers. Then
        there are products in a periodic box, and kernels of patches periodic in one direction.
    has_love_symbol : bool
        True if `eigenvalues` also has the symbol ``love``.
    layers : tuple of Layer
        Layers of the bodies.
    film : (float, float) or None
        Numbers of the method ``film``, see `LayeredKernel.film`.
    """

    scale_free = encloses_images = has_image_sums = has_love_symbol = False
    isotropic = far_reaching = True
    film = None
    layers = ()

    def __init__(self, compliance):
        self.compliance = float(compliance)

    def __repr__(self):
        return f"<{type(self).__name__}, compliance {self.compliance:.6g} mm2/N>"

    @property
    def parameters(self):
        """Numbers that define the kernel, a tuple."""
        raise NotImplementedError(f"{type(self).__name__}.parameters")

    def in_units(self, length):
        """Return the kernel for lengths in units of `length` [mm], and compliance 1.

        Influence coefficients are divided by this kernel's compliance and by `length`.
        """
        raise NotImplementedError(f"{type(self).__name__}.in_units")

    def wave_compliance(self, qx, qy=0.0):
        """Return the compliance for pressure waves [mm2/N].

        The wave numbers `qx` and `qy` [1/mm] are arrays that broadcast, not both 0. A pressure wave displaces the
        surface by 2 pi / q times the compliance, q^2 = qx^2 + qy^2.
        """
        raise NotImplementedError(f"{type(self).__name__}.wave_compliance")

    def unit_coefficients(self, grid, rows, columns):
        """Return influence coefficients of a free patch for unit compliance [mm].

        They are displacements of cell centres by pressure 1 on a cell. `rows` and `columns` are arrays of offsets in y
        and x, from 0 on. The shape is (rows, columns).
        """
        raise NotImplementedError(f"{type(self).__name__}.unit_coefficients")

    def __eq__(self, other):
        return type(self) is type(other) and self.parameters == other.parameters

    def __hash__(self):
        return hash((type(self), self.parameters))

    def describe(self):
        """Return names and values that describe the bodies in result files."""
        return {"kernel": type(self).__name__}

    # -- patches -------------------------------------------------------------------------------------------

    @property
    def base(self):
        """Kernel without the images of a load."""
        return self

    def check_patch(self, grid):
        """Raise InputError if there is no influence matrix for the periodicity of a grid."""
        named = f"with the kernel {type(self).__name__}"
        if not grid.doubly_periodic and type(self).unit_coefficients is Kernel.unit_coefficients:
            raise InputError(f"periodic: must be True {named}, which has no influence coefficients")
        if grid.one_way and not self.has_image_sums:
            raise InputError(f"periodic: {grid.one_way!r}; must be True or False {named}")
        if grid.symbol == "love" and not self.has_love_symbol:
            raise InputError(f"periodic: 'love'; must be True, 'spectral' or False {named}")

    def period_cells(self, grid):
        """Return the periods of coefficients in y and x [cells], 0 without a period."""
        return 0, 0

    def line_reach(self):
        """Return the least distance [mm] at which a line of force may be without effect."""
        return 0.0

    def layer_influence(self, distances):
        """Return what layers add to the displacement 1/r by a point force, for unit compliance [1/mm]."""
        raise NotImplementedError(f"{type(self).__name__}.layer_influence")

    def point_influence(self, distances):
        """Return the displacement by a unit point force [mm/N]."""
        return self.compliance * (1 / distances + self.layer_influence(distances))

    def least_influence(self, near, far):
        """Return lower bounds of the displacement by a unit point force [mm/N].

        They hold at all distances from `near` to `far`, arrays of one shape [mm].
        """
        raise NotImplementedError(f"{type(self).__name__}.least_influence")

    # -- matrix --------------------------------------------------------------------------------------------

    def coefficients(self, grid, rows, columns):
        """Return influence coefficients of a free patch; see `love_coefficients`."""
        return self.compliance * self.unit_coefficients(grid, rows, np.arange(columns))

    def self_displacement(self, grid):
        """Estimate the displacement of a cell by pressure 1 on it [mm / (N/mm2)]."""
        cell = HalfSpaceKernel(self.compliance_at(max(grid.dx, grid.dy)) / np.pi)
        return float(cell.coefficients(grid, np.arange(1), 1)[0, 0])

    def eigenvalues(self, grid, columns, rows):
        """Return eigenvalues of the periodic influence matrix; see `influence_symbol`."""
        qx, qy = np.broadcast_arrays(*np.ix_(*wave_numbers(grid, columns, rows)))
        q = np.hypot(qx, qy)
        waves = q > 0
        values = np.zeros(q.shape)
        values[waves] = 2 * np.pi * self.wave_compliance(qx[waves], qy[waves]) / q[waves]
        return values

    def uniform_compliance(self, grid):
        """Return the displacement by pressure 1 on all cells [mm / (N/mm2)].

        The patch is periodic. A p is relative to its mean, and does not include this displacement. For half-spaces,
        where it would be infinite, the result is 0.
        """
        return 0.0

    # -- preconditioners and multilevel products -----------------------------------------------------------

    def scale(self, eigenvalues, qx, qy):
        """Return eigenvalues for unit compliance times the compliance at `qx`, `qy` [1/mm]."""
        with np.errstate(invalid="ignore"):  # on a rigid base the compliance for constants is 0
            return self.wave_compliance(np.maximum(qx, np.finfo(float).tiny), qy) * eigenvalues

    def scale_sampled(self, eigenvalues, grid, columns, rows):
        """Return eigenvalues for the compliance of this kernel.

        In contrast to `scale`, each aliased wave has its own compliance. `eigenvalues` are for unit compliance and
        uniform pressures on cells, at frequencies `columns` and `rows`, as in `influence_symbol`, not both 0. An error
        of some 0.1% does no harm.
        """
        total = self.compliance * eigenvalues
        for i, j in product(range(-_ALIASES, _ALIASES + 1), repeat=2):
            x, y = columns[:, None] / grid.nx + i, rows / grid.ny + j
            qx, qy = 2 * np.pi * x / grid.dx, 2 * np.pi * y / grid.dy
            difference = self.wave_compliance(qx, qy) - self.compliance
            total += 2 * np.pi * np.sinc(x) * np.sinc(y) * difference / np.hypot(qx, qy)
        return total

    def relative_stiffness(self, q, compliance):
        """Return a `compliance` over that for waves of wave number `q`; 1 if all waves have the same."""
        return 1.0 if self.scale_free else compliance / self._mean_compliance(q)

    def is_resolved(self, grid):
        """Return whether the cells of a grid resolve the layer."""
        return True

    def is_thin_film(self, grid):
        """Return whether long waves displace the bodies much less than shorter ones.

        This is true of thin, nearly incompressible layers on a rigid base. Then the inverse of A is not nearly local.
        """
        return False

    # -- bounds and estimates ------------------------------------------------------------------------------

    def is_positive(self, grid):
        """Return True if no influence coefficient of a free patch is negative, False if unknown."""
        return False

    def smallest_eigenvalue(self, grid):
        """Return a lower bound of A's eigenvalues on fields without mean [mm / (N/mm2)].

        Error bounds of solutions rely on it. The eigenvalues of waves are sampled. For uniform pressures on cells half
        of the smallest one is taken; the smallest eigenvalue of A is at least 2.4 times as large, even if the
        compliance varies by a factor of 20 with the direction.
        """
        return (1.0 if grid.symbol == "spectral" else _LOVE_FACTORS[0]) * float(self._spectrum(grid).min())

    def largest_eigenvalue(self, grid):
        """Return an upper bound of a periodic patch's eigenvalues of A [mm / (N/mm2)]."""
        return (_LOVE_FACTORS[1] if grid.symbol == "love" else 1.0) * float(self._spectrum(grid).max())

    def softest_parts(self, length):
        """Return an estimate of a displacement, and an upper bound of a compliance.

        The displacement [mm / (N/mm2)] is for layers on a rigid base, by pressure 1 in waves twice the `length` long;
        shorter waves may displace nearly incompressible layers more. The compliance [mm2/N] is for half-spaces; a
        layered body counts as a half-space of its softer material.
        """
        return 0.0, max(self.compliance, float(self._in_directions(np.pi / length).max()))

    def middle_displacement(self, lengths):
        """Return the displacement in the middle of a loaded rectangle, (2.4) [mm].

        The pressure is 1 N/mm2; `lengths` are the sides of the rectangle in y and x [mm]. It is an upper bound, except
        for layers on a rigid base (`softest_parts`).
        """
        rigid, compliance = self.softest_parts(max(lengths))
        b, a = lengths[0] / 2, lengths[1] / 2
        return rigid + 4 * compliance * (a * np.arcsinh(b / a) + b * np.arcsinh(a / b))

    def punch_stiffness(self, area):
        """Return the stiffness [N/mm] of a round flat punch with an end `area` [mm2].

        It is exact for half-spaces, and for radii much smaller than the thickness of a layer and, on a compressible
        layer, much larger.
        """
        radius = np.sqrt(area / np.pi)
        return 2 / (np.pi * self._mean_compliance(4 / (np.pi * radius))) * radius

    def contrast(self, grid):
        """Return how much softer the bodies are for long waves than for short ones.

        This is the compliance for the longest waves on a grid over that for the shortest ones, at least 1. It exceeds 1
        if a layer is stiffer than its substrate.
        """
        longest, shortest = max(grid.sides), 2 * min(grid.dx, grid.dy)
        return max(1.0, self.compliance_at(longest) / self.compliance_at(shortest))

    def compliance_at(self, length):
        """Return 1 / E* [mm2/N] for waves of a `length` [mm], a mean over their directions."""
        return np.pi * self._mean_compliance(2 * np.pi / length)

    def _mean_compliance(self, q):
        return float(self._in_directions(q).mean())

    def _in_directions(self, q):
        """Return compliances for waves of wave numbers `q` in several directions, the last axis."""
        angles = np.linspace(0, np.pi / 2, 1 if self.isotropic else _DIRECTIONS)
        return self.wave_compliance(
            np.multiply.outer(q, np.cos(angles)), np.multiply.outer(q, np.sin(angles))
        )

    def _spectrum(self, grid):
        """Return samples of the eigenvalues of A, from long to short waves."""
        longest = max(grid.sides) * (1 if grid.doubly_periodic else 2)
        q = np.geomspace(2 * np.pi / longest, np.pi * np.hypot(1 / grid.dx, 1 / grid.dy), _SAMPLES)
        return 2 * np.pi * self._in_directions(q) / q[:, None]


class HalfSpaceKernel(Kernel):
    """Kernel of two elastic half-spaces (paper, eqs. (2.4)-(2.6)).

    A point force displaces the surface at a distance by compliance times force divided by distance.

    Parameters
    ----------
    compliance : float
        (1 - nu) / (pi G) = 1 / (pi E*) [mm2/N].
    """

    scale_free = has_image_sums = has_love_symbol = True

    @property
    def parameters(self):
        """The compliance, in a tuple."""
        return (self.compliance,)

    def in_units(self, length):
        """Return the kernel of compliance 1, for any unit; see `Kernel.in_units`."""
        return UNIT

    def wave_compliance(self, qx, qy=0.0):
        """Return the compliance, for all waves."""
        return np.full(np.broadcast_shapes(np.shape(qx), np.shape(qy)), self.compliance)

    def softest_parts(self, length):
        """Return no displacement, and the compliance."""
        return 0.0, self.compliance

    def _mean_compliance(self, q):
        return self.compliance

    def eigenvalues(self, grid, columns, rows):
        """Return eigenvalues of the periodic influence matrix; see `influence_symbol`."""
        return influence_symbol(grid, self.compliance, columns, rows)

    def coefficients(self, grid, rows, columns):
        """Return influence coefficients of a free patch; see `love_coefficients`."""
        return love_coefficients((grid.dx, grid.dy), self.compliance, rows, columns)

    def unit_coefficients(self, grid, rows, columns):
        """Return coefficients for unit compliance; see `Kernel.unit_coefficients`."""
        return love_coefficients((grid.dx, grid.dy), 1.0, rows, columns)

    def layer_influence(self, distances):
        """Return zeros: half-spaces have no layers."""
        return np.zeros_like(distances)

    def least_influence(self, near, far):
        """Return the displacement at the larger distance; see `Kernel.least_influence`."""
        return self.compliance / far

    def scale_sampled(self, eigenvalues, grid, columns, rows):
        """Return the eigenvalues times the compliance, which all waves have."""
        return self.compliance * eigenvalues

    def is_positive(self, grid):
        """Return True: all influence coefficients are positive."""
        return True

    def smallest_eigenvalue(self, grid):
        """Return a lower bound of the eigenvalues of A [mm / (N/mm2)].

        The constant field of a periodic patch is left out. The bound is the eigenvalue of the shortest wave, also on a
        free patch, because constant pressures on cells displace their centres by 1.17 (long cells) to 1.4 times as much
        as this wave.
        """
        return 2 * self.compliance / np.hypot(1 / grid.dx, 1 / grid.dy)

    def largest_eigenvalue(self, grid):
        """Return a periodic patch's largest eigenvalue of A [mm / (N/mm2)]."""
        return self.compliance * max(grid.sides)


UNIT = HalfSpaceKernel(1.0)
