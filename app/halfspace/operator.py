"""Influence matrix of a grid, a PETSc Mat context.

The Mat is the *masked* operator ``C A C``: rows and columns of A outside the contact set C are zero. The array
`InfluenceOperator.mask` has the set C; it is changed in place, so nothing is reallocated. All vectors of a Krylov
method that starts from zero are zero outside C, so the method solves the system (2.11) of the contact set.
"""

import weakref
from contextlib import contextmanager
from functools import cached_property, partial

import numpy as np
from petsc4py import PETSc

from app.base.errors import InputError
from app.base.mpi import MPI
from app.halfspace import events
from app.halfspace.fft.multiplier import EvenMultiplier, Layout
from app.halfspace.influence import dense_matrix, influence_quadrant, quadrant_rows
from app.halfspace.mat_methods import MatMethods, scale_and_shift, symmetric_mat
from app.halfspace.one_way_kernel import patch_kernel
from app.halfspace.product import BoxProduct, Convolution, DenseProduct, NoRows, PeriodicProduct
from app.halfspace.springs import SpringMethods
from app.parallel.reductions import sum_over
from app.parallel.slabs import Slabs

_KIND = PETSc.Mat.SORType
# "local" kinds are treated as global ones, see `SOR`
_FORWARD = _KIND.FORWARD_SWEEP | _KIND.LOCAL_FORWARD_SWEEP
_BACKWARD = _KIND.BACKWARD_SWEEP | _KIND.LOCAL_BACKWARD_SWEEP
_ZERO_GUESS = _KIND.ZERO_INITIAL_GUESS
# Cached properties:
_PRODUCTS = "product", "exact_product", "inverse", "exact_inverse", "screened_product"
_mult_event = PETSc.Log.Event("InfluenceMult")
_sweep_event = PETSc.Log.Event("InfluenceSOR")
for _name in ("Alltoall", "Coeffs", "Spectra"):
    setattr(events, _name.lower(), PETSc.Log.Event(f"Influence{_name}"))


class InfluenceOperator(MatMethods, SpringMethods):
    """Influence matrix A on one grid, restricted to contact.

    Methods called by PETSc are collective.

    Parameters
    ----------
    grid : Grid
        Grid of cells on which A acts.
    kernel : Kernel
        Kernel of the bodies, ``Material.kernel`` or ``Problem.kernel``.
    slabs, comm : Slabs, mpi4py communicator, optional
        Distribution of the rows; by default this rank has all rows. A rank beyond `slabs.size` has no rows and does not
        take part.
    dtype : numpy real type
        Precision of the products. PETSc's vectors are always float64. A small grid has a stored matrix, always in
        double precision.
    exact_product : optional
        Object whose ``apply(p, u)`` is used to verify solutions; by default a double precision product on this grid.
    target : InfluenceOperator, optional
        Operator of the target grid, if this is a coarser grid or a window. It lends its working storage, so its
        products must not be used while this operator works.
    spectra : SpectrumCache, optional
        Cache that keeps the spectra of products and preconditioners when these are freed.

    Attributes
    ----------
    error_bound : float
        Largest error of a coefficient in double precision, without rounding [mm / (N/mm2)]; zero except on lists.
    active : bool
        True if this rank is one of those that share the rows.
    coarser_levels : tuple of InfluenceOperator, or None
        Operators on the coarser grids of a multigrid method, the finest first; None until they are made.
    mask : ndarray of bool, shape (local rows, nx)
        The contact set C, initially all cells. Change the mask in place and then call `mask_changed`.
    contact_version : int
        Number of calls of `mask_changed`.
    products, sweeps : int
        Numbers of products that PETSc requested, and of Gauss-Seidel sweeps: the paper's work units. `product.count` is
        the number of all products, also of those in sweeps and in `displacement`.

    Notes
    -----
    A product by FFT needs a work array, whose contents do not matter between products. The double precision product on
    the target grid has the largest work array. All other products and preconditioners use the beginning of this work
    array, one at a time (`storage`). The products of the iteration are in single precision or have fewer cells, so they
    leave the end of the array unused. The end holds vectors of the Krylov method (`spare_fields`), because the
    iteration does not use the double precision product. A preconditioner that needs more than the iteration's product
    has a work array of its own.
    """

    error_bound = 0.0

    def __init__(
        self, grid, kernel, slabs=None, comm=None, dtype=float,
        exact_product=None, target=None, spectra=None,
    ):  # fmt: skip
        self.grid, self.kernel, self.spectra = grid, patch_kernel(kernel, grid), spectra
        self.comm = comm if slabs is not None else None
        self.slabs = slabs or Slabs(grid.ny)
        self.active = self.slabs.active
        self._dense = grid.n <= DenseProduct.largest and self.slabs.size == 1
        self.dtype = np.dtype(np.float64 if self._dense else dtype)
        # A weak reference, because the target refers to this operator in `coarser_levels`.
        self._target = weakref.ref(self if target is None else target)
        self.coarser_levels = None
        if exact_product is not None:
            self.exact_product = exact_product
        self._verified_elsewhere = exact_product is not None
        self.multipliers = {}  # By name: inverses and approximations of A, made on first use, or None.
        self.local_shape = (self.slabs.local, grid.nx)
        self.mask = np.ones(self.local_shape, bool)
        self.products = self.sweeps = 0
        self._spent = 0.0  # work of freed objects, in products
        self.contact_version = 0
        self._energy = None, None  # key of a contact set; its energy under unit pressure, and number of cells

    # -- products, made on first use -----------------------------------------------------------------------

    @property
    def needs_verification(self):
        """True if `product` must be verified by `exact_product`."""
        return self._verified_elsewhere or self.dtype != np.float64

    def prepare(self, *products):
        """Make the attributes that are named in `products`. Collective."""
        for name in products:
            getattr(self, name)

    @cached_property
    def product(self):
        """Product with A in the precision `dtype`. Collective on first use."""
        if not self.active:
            return NoRows()
        if self._dense:
            return DenseProduct(dense_matrix(self.grid, self.kernel), self.grid.shape)
        if not self.needs_verification:
            return self.exact_product
        exact = vars(self).get("exact_product")
        if type(exact) is self._kind(self.dtype):
            return exact.in_precision(self.dtype)
        return self._convolution(self.dtype)

    @cached_property
    def exact_product(self):
        """Double-precision product with A. Collective on first use."""
        return self.product if self._dense or not self.active else self._convolution(np.float64)

    @property
    def target(self):
        """Operator of the target grid; None if freed."""
        return self._target()

    @property
    def storage(self):
        """Product whose work array others may use, or None."""
        exact = vars(self.target or self).get("exact_product")
        return exact if isinstance(exact, EvenMultiplier) else None

    def spare_fields(self, *types, others=()):
        """Return unused parts of `storage` as work fields.

        There is one field for each numpy type in `types`, of shape `local_shape`; None if the storage is too small.
        Neither `product` and the `multipliers` of this operator nor the products `others` of other grids overwrite the
        fields. Collective on first use.
        """
        fields, spare = [], np.zeros(0, np.uint8)
        if self.storage is not None and isinstance(self.product, EvenMultiplier):
            used = max(other.working_storage.size for other in (self.product, *others))
            spare = self.storage.working_storage[used:]
        for dtype in types:
            left = spare.size - self.mask.size * np.dtype(dtype).itemsize
            fields.append(spare[left:].view(dtype).reshape(self.local_shape) if left >= 0 else None)
            spare = spare[:left] if left >= 0 else spare
        return fields

    def invalidate_exact_product(self):
        """Discard the displacement that a window's `exact_product` has stored."""
        forget = getattr(vars(self).get("exact_product"), "forget", None)
        if forget is not None:
            forget()

    @cached_property
    def exact_inverse(self):
        """Inverse B of A, in double precision. Collective on first use.

        Only on a periodic grid: B inverts A on fields without mean, and is zero on constants.
        """
        exact = self.exact_product
        return (exact if isinstance(exact, PeriodicProduct) else self._convolution(np.float64)).inverse()

    @cached_property
    def inverse(self):
        """Inverse B of A, in the precision `dtype`. Collective on first use."""
        return self.exact_inverse if self.dtype == np.float64 else self.product.inverse()

    @cached_property
    def screened_product(self):
        """`ScreenedProduct` of the half-space on springs. Collective on first use."""
        product = self.product if isinstance(self.product, PeriodicProduct) else self._convolution(self.dtype)
        return product.screened()

    @cached_property
    def diagonal(self):
        """Diagonal entry of A [mm3/N], without `compliance`. Collective on first use."""
        if self.grid.doubly_periodic and self.active and not self._dense:
            return float(self.exact_product.centre[1, 1])
        return float(influence_quadrant(self.grid, self.kernel, slice(0, 1), 1)[0, 0])

    def _kind(self, dtype):
        dtype = np.dtype(dtype)
        if self.grid.doubly_periodic:
            return PeriodicProduct
        return BoxProduct if BoxProduct.suits(self.grid, self.kernel, dtype) else Convolution

    def _convolution(self, dtype):
        grid, kernel, kind, layout = self.grid, self.kernel, self._kind(dtype), self.layout(dtype)
        if kind is PeriodicProduct:
            return kind(partial(kernel.eigenvalues, grid), grid.shape, layout)
        if kind is BoxProduct:
            return kind(grid, kernel, layout)
        return kind(quadrant_rows(grid, kernel), grid.shape, layout, grid.repeats)

    def layout(self, dtype=None):
        """Return the `Layout` of products with the precision `dtype`. Collective without `dtype`.

        Without `dtype` it is the layout of what the iteration uses together with `product`. This takes no more of the
        `storage` than `product` does, because the `spare_fields` have the rest.
        """
        if dtype is None:
            lender = self.product if isinstance(self.product, EvenMultiplier) else self.storage
            return Layout(self.slabs, self.comm, self.dtype, lender, self.spectra)
        return Layout(self.slabs, self.comm, dtype, self.storage, self.spectra)

    # -- set-up ------------------------------------------------------------------------------------------

    @property
    def petsc_comm(self):
        """PETSc communicator of the ranks that share the rows."""
        return petsc_comm(self.comm)

    def mat(self, comm=None):
        """Return a new Mat with this operator as context. Collective over `comm`.

        The caller destroys the Mat. `comm` is a PETSc communicator, by default of the ranks that share the rows.
        """
        return symmetric_mat(self, comm or self.petsc_comm)

    def mask_changed(self):
        """Register that the contact set has changed.

        A Mat of this operator must also be assembled, so that PETSc sets up its preconditioner again.
        """
        self.contact_version += 1

    @contextmanager
    def double_precision(self):
        """Use double precision in a ``with`` block, also in preconditioners. Collective."""
        if self.dtype == np.float64:
            yield
            return
        dtype, multipliers, product = self.dtype, self.multipliers, vars(self).pop("product", None)
        self.dtype, self.multipliers = np.dtype(np.float64), {}
        try:
            yield
        finally:
            self._free("product")
            self.dtype, self.multipliers = dtype, multipliers
            if product is not None:
                self.product = product

    def free_exact_product(self):
        """Free the product in double precision."""
        self._free("exact_product", multipliers=False)

    def free(self):
        """Free all products, preconditioners and tables of sweeps."""
        self._free(*_PRODUCTS, "relaxation")

    def _free(self, *made, multipliers=True):
        """Free attributes, given by their names, but keep the counts of work."""
        before = self.equivalent_products
        for name in made:
            vars(self).pop(name, None)
        if multipliers:
            self.multipliers.clear()
        self._spent += before - self.equivalent_products

    # -- numpy side --------------------------------------------------------------------------------------

    def displacement(self, p, u):
        """Compute u = A p on all cells. Collective."""
        apply_logged(_mult_event, self.product, p, u)
        self.add_springs(p, u)

    def exact_displacement(self, p, u):
        """Compute u = A p in double precision. Collective."""
        added = None if self.compliance is None else self.compliance * p  # u may be p
        apply_logged(_mult_event, self.exact_product, p, u)
        if added is not None and not self._verified_elsewhere:
            u += added

    def energy_of_contact(self):
        """Return p.Ap of unit pressure on C, and C's cells. Collective."""
        cells = sum_over(self.comm, [np.count_nonzero(self.mask)])[0]
        key = self.contact_version, cells  # Within a version, cells only leave C.
        if self._energy[0] != key:
            p, u = self.mask.astype(float), np.empty(self.local_shape)
            self.displacement(p, u)
            self._energy = key, (sum_over(self.comm, [np.vdot(p, u)])[0], cells)
        return self._energy[1]

    # -- what PETSc calls --------------------------------------------------------------------------------

    def mult(self, mat, x, y):
        """Compute y = (a C A C + s I) x."""
        self.products += 1
        a, s = scale_and_shift(mat)
        with y as out:
            p, out = x.getArray(readonly=True).reshape(self.local_shape), out.reshape(self.local_shape)
            # Sec. 4.2, 2
            apply_logged(_mult_event, self.product, p, out, self.mask)
            if self.has_springs:
                self.add_springs(p, out)
                out *= self.mask
            if (a, s) != (1.0, 0.0):
                out *= a
                out += s * p

    multTranspose = mult

    def SOR(self, mat, b, omega, kind, shift, its, lits, x):
        """Make damped Gauss-Seidel sweeps on the contact set C.

        On any number of ranks the result equals the result of the sequential sweep. Sweeps local to each rank, PETSc's
        default, would make the multigrid method diverge. So a global sweep is made even if a local one is requested.
        """
        a, s = scale_and_shift(mat)
        if shift or s or kind & ~(_FORWARD | _BACKWARD | _ZERO_GUESS):
            raise ValueError("no Gauss-Seidel by parts of the matrix, or with a diagonal shift")
        if self.compliance is not None:
            raise InputError("Gauss-Seidel sweeps (-pc_type): not with a surface compliance that varies")
        if not self.active:
            x.stateIncrease()  # as on the other ranks, so that they agree on collective calls
            return
        relaxation = self.relaxation
        zero = bool(kind & _ZERO_GUESS)
        directions = [backward for flag, backward in ((_FORWARD, False), (_BACKWARD, True)) if kind & flag]
        right = b.getArray(readonly=True).reshape(self.local_shape)
        right = right if a == 1 else right / a
        r, d = relaxation.defect, relaxation.correction
        with _sweep_event, x as solution:
            p = solution.reshape(self.local_shape)
            for backward in directions * max(1, its * lits):
                if zero:
                    p[...] = 0
                    np.multiply(right, self.mask, out=r)
                    zero = False
                else:
                    self.product.apply(p, r, self.mask)
                    np.subtract(right, r, out=r)
                    r *= self.mask
                # Sec. 4.2, 1
                relaxation.sweep(r, self.mask, omega, d, backward=backward)
                PETSc.Log.logFlops(relaxation.products_per_sweep * self.product.flops)
                p += d
                self.sweeps += 1

    @cached_property
    def relaxation(self):
        """Gauss-Seidel sweeps on this grid. Collective on first use."""
        from app.halfspace.gauss_seidel.gauss_seidel import GaussSeidel

        rows, (_, periodic) = quadrant_rows(self.grid, self.kernel), self.grid.repeats
        return GaussSeidel(rows, self.grid.shape, self.slabs, self.comm, periodic)

    def reset_sweeps(self):
        """Make the rounding of sweeps independent of earlier solves."""
        if "relaxation" in vars(self):
            self.relaxation.reset()

    @property
    def equivalent_products(self):
        """Work on this grid, in products with A."""
        cached = vars(self)
        products = {cached[name] for name in _PRODUCTS if name in cached}
        total = self._spent + sum([product.count for product in products])
        points = [multiplier.points for multiplier in self.multipliers.values() if multiplier]
        total += sum(points) / self._transformed_cells
        if "relaxation" in cached:
            total += self.sweeps * self.relaxation.products_per_sweep
        return total

    @property
    def product_points(self):
        """Points of the transform of a double-precision product."""
        in_box = self._kind(np.float64) is BoxProduct
        return np.prod(BoxProduct.periods_of(self.grid)) if in_box else self._transformed_cells

    @cached_property
    def _transformed_cells(self):
        ny, nx = Convolution.lengths(self.grid.shape, self.grid.repeats)
        return ny * nx


def apply_logged(event, product, *fields):
    """Apply a product in a -log_view event, with its flops. Collective."""
    with event:
        product.apply(*fields)
        PETSc.Log.logFlops(product.flops)


def petsc_comm(comm):
    """Convert an mpi4py communicator to PETSc's; None becomes COMM_SELF."""
    return PETSc.COMM_SELF if comm is None else PETSc.Comm(MPI.Intracomm(comm))


def get_operator(mat, kind, solver):
    """Return a Mat's context; InputError for `solver` unless it is a `kind`."""
    context = mat.getPythonContext() if mat.getType() == "python" else None
    if not isinstance(context, kind):
        actual = "an assembled matrix" if context is None else f"an {type(context).__name__}"
        raise InputError(f"{solver}: needs an {kind.__name__}; this system has {actual}")
    return context


def wrap_vec(field, operator):
    """Return a Vec in a field's memory. Collective.

    The caller destroys the Vec. Raises ValueError if the field is not C-contiguous, because the Vec would be a copy.
    """
    if not field.flags.c_contiguous:
        raise ValueError("a Vec needs a field that is C-contiguous")
    # The global size saves PETSc a reduction. A rank without rows has a communicator of its own, and size 0.
    size = field.size, operator.grid.n if operator.active else 0
    return PETSc.Vec().createWithArray(field.reshape(-1), size, comm=operator.petsc_comm)
