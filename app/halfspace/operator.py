"""The influence matrix on one grid as PETSc sees it: context of a Mat of type python.

The Mat is the *masked* operator ``C A C``: rows and columns outside the contact set are zero. The set lives
in `InfluenceOperator.mask` and is changed in place; nothing is reallocated. Krylov methods that start from a
vector that vanishes outside C stay there, so they solve the system (2.11) on C.
"""

from __future__ import annotations

import weakref
from contextlib import contextmanager
from functools import cached_property, partial

import numpy as np
from petsc4py import PETSc

from app.base.errors import InputError
from app.base.mpi import MPI
from app.base.petsc import report_no_entries
from app.halfspace import events
from app.halfspace.fft.lengths import transform_length
from app.halfspace.fft.multiplier import EvenMultiplier, Layout
from app.halfspace.influence import dense_matrix, influence_quadrant, quadrant_rows
from app.halfspace.mat_methods import MatMethods, scale_and_shift
from app.halfspace.periodic_symbol import influence_symbol
from app.halfspace.product import BoxProduct, Convolution, DenseProduct, NoRows, PeriodicProduct
from app.parallel.reductions import sum_over
from app.parallel.slabs import Slabs

_FORWARD, _BACKWARD = 1 | 4, 2 | 8  # MatSORType: the "local" kinds mean the same here, see `SOR`
_ZERO_GUESS = 16
# Attributes, there when they are made:
_PRODUCTS = "product", "exact_product", "inverse", "exact_inverse", "screened_product"
_mult_event = PETSc.Log.Event("InfluenceMult")
_sweep_event = PETSc.Log.Event("InfluenceSOR")
for _name in ("Alltoall", "Coeffs", "SpectrumCache"):
    setattr(events, _name.lower(), PETSc.Log.Event(f"Influence{_name}"))


class InfluenceOperator(MatMethods):
    """A and C A C on one grid: products, diagonal, Gauss-Seidel sweeps. What PETSc calls is collective.

    Parameters
    ----------
    grid : Grid
    compliance : float
        (1 - nu) / (pi G) [mm2/N].
    slabs : Slabs, optional
        Row distribution; default: all here. A rank that is none of theirs has no rows, and takes no part.
    comm : mpi4py communicator, optional
        Ranks that share the rows; None: this rank has all of them, or none.
    dtype : numpy real type
        Precision of the products (PETSc's vectors are always float64); small grids have a stored matrix in double.
    exact_product : optional
        Whose ``apply(p, u)`` is the last word, if not that of a double precision product on this grid.
    target : InfluenceOperator, optional
        Of the target grid, if that is another one: its products are at rest while those of this one are computed.
    spectra : SpectrumCache, optional
        Of products and preconditioners, to be kept when those are freed.

    Notes
    -----
    A product by FFT works in an array that holds anything between products. The largest, of the double precision
    product of the target grid, is lent to all others (`storage`): from its first byte on to products and
    preconditioners, of which one works at a time. What the iteration's product, in single precision or on fewer cells,
    leaves of it holds vectors of the Krylov method (`spare_fields`): during the iteration nobody asks for
    the double precision product.

    Attributes
    ----------
    active : bool
        Whether this rank is one of those that share the rows.
    coarser_levels : tuple of InfluenceOperator, or None
        On the coarser grids of a multigrid method, the finest first; None until there are any.
    mask : ndarray of bool, shape (local rows, nx)
        The contact set C, at first all cells. Change it in place and then call `mask_changed`.
    contact_version : int
        Contact sets that solvers have been told of, by `mask_changed`. In steps 4.a and 4.b the mask is ahead of it.
    products, sweeps : int
        Products of the Mat asked for by PETSc, and Gauss-Seidel sweeps: the paper's work units.
        `product.count` has all products, those inside sweeps and of `displacement` too.
    """

    def __init__(
        self,
        grid,
        compliance,
        slabs=None,
        comm=None,
        dtype=np.float64,
        exact_product=None,
        target=None,
        spectra=None,
    ):
        self.grid, self.compliance, self.spectra = grid, compliance, spectra
        self.comm = comm if slabs is not None else None
        self.slabs = slabs or Slabs(grid.ny)
        self.active = self.slabs.active
        self._dense = grid.n <= DenseProduct.largest and self.slabs.size == 1
        self.dtype = np.dtype(np.float64 if self._dense else dtype)
        self._target = weakref.ref(
            self if target is None else target
        )  # which has this one in its `coarser_levels`
        self.coarser_levels = None
        if exact_product is not None:
            self.exact_product = exact_product
        self._verified_elsewhere = exact_product is not None
        self.multipliers = {}  # by name: the inverse of A and what stands for A, made by who uses them first, or None
        self.local_shape = (self.slabs.local, grid.nx)
        self.mask = np.ones(self.local_shape, bool)
        self.products = self.sweeps = 0
        self._spent = 0.0  # products of objects that are gone
        self.contact_version = 0
        self._energy = None, None  # of a contact set, by its number

    # -- products, made when first asked for ---------------------------------------------------------------

    @property
    def needs_verification(self):
        """Whether what `product` says must be checked by the exact one. Not collective."""
        return self._verified_elsewhere or self.dtype != np.float64

    def prepare(self, *products):
        """Make some products now, named as the attributes. Collective."""
        for name in products:
            getattr(self, name)

    @cached_property
    def product(self):
        """The product of this operator. Collective when first asked for."""
        if not self.active:
            return NoRows()
        if self._dense:
            return DenseProduct(dense_matrix(self.grid, self.compliance), self.grid.shape)
        if not self.needs_verification:
            return self.exact_product
        exact = vars(self).get("exact_product")
        if type(exact) is self._kind(self.dtype):
            return exact.in_precision(self.dtype)
        return self._convolution(self.dtype)

    @cached_property
    def exact_product(self):
        """A product in double precision. Collective when first asked for."""
        return self.product if self._dense or not self.active else self._convolution(np.float64)

    @property
    def target(self):
        """Operator of the target grid, or this one; None if that is gone. Not collective."""
        return self._target()

    @property
    def storage(self):
        """The product in whose working storage other transforms may work, if it has been made. Not collective."""
        exact = vars(self.target or self).get("exact_product")
        return exact if isinstance(exact, EvenMultiplier) else None

    def spare_fields(self, *types, others=()):
        """Fields to be worked on while no exact product is computed, in what `product` leaves of the `storage`.

        Collective when first asked for.

        Parameters
        ----------
        *types : numpy types
        others : sequence of EvenMultiplier
            Of other grids, that are to leave them alone, too.

        Returns
        -------
        list of ndarray, shape `local_shape`, or None
            One for each type; they hold anything. None where not enough is left.
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

    def forget_exact_support(self):
        """Let an exact product on other cells, too, free what it has found there. Not collective."""
        forget = getattr(vars(self).get("exact_product"), "forget", None)
        if forget is not None:
            forget()

    @cached_property
    def exact_inverse(self):
        """B, the inverse of A on fields without mean, of a periodic grid. Collective when first asked for."""
        exact = self.exact_product
        return (exact if isinstance(exact, PeriodicProduct) else self._convolution(np.float64)).inverse()

    @cached_property
    def inverse(self):
        """B in the operator's precision. Collective when first asked for."""
        return self.exact_inverse if self.dtype == np.float64 else self.product.inverse()

    @cached_property
    def screened_product(self):
        """A on springs, of a periodic grid, in the operator's precision. Collective when first asked for."""
        product = self.product if isinstance(self.product, PeriodicProduct) else self._convolution(self.dtype)
        return product.screened()

    @cached_property
    def diagonal(self):
        """Influence of a cell on itself [mm / (N/mm2)]. Collective when first asked for, on a periodic grid."""
        if self.grid.periodic and self.active and not self._dense:
            return float(self.exact_product.centre[1, 1])
        return float(influence_quadrant(self.grid, self.compliance, slice(0, 1), 1)[0, 0])

    def _kind(self, dtype):
        dtype = np.dtype(dtype)
        if self.grid.periodic:
            return PeriodicProduct
        return BoxProduct if BoxProduct.suits(self.grid, dtype) else Convolution

    def _convolution(self, dtype):
        of, kind, layout = (self.grid, self.compliance), self._kind(dtype), self.layout(dtype)
        if kind is PeriodicProduct:
            return kind(partial(influence_symbol, *of), self.grid.shape, layout)
        if kind is BoxProduct:
            return kind(*of, layout)
        return kind(quadrant_rows(*of), self.grid.shape, layout)

    def layout(self, dtype=None):
        """Layout of products and preconditioners, by default in the operator's precision. Not collective."""
        dtype = self.dtype if dtype is None else dtype
        return Layout(self.slabs, self.comm, dtype, self.storage, self.spectra)

    # -- set-up ------------------------------------------------------------------------------------------

    @property
    def petsc_comm(self):
        """PETSc communicator of the ranks that share the rows."""
        return petsc_comm(self.comm)

    def mat(self, comm=None):
        """Make a Mat with this context, the caller's to destroy. Collective over `comm`, a PETSc communicator.

        `comm` is by default that of the ranks that share the rows.
        """
        return symmetric_mat(self, comm or self.petsc_comm)

    def mask_changed(self):
        """Take notice of another contact set; who holds a Mat must tell PETSc. Not collective."""
        self.contact_version += 1

    @contextmanager
    def double_precision(self):
        """Products and preconditioners made inside the block are in double precision. Collective."""
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
        """Free the exact product. Not collective."""
        self._free("exact_product", multipliers=False)

    def free(self):
        """Free all products, preconditioners and sweeps. Not collective."""
        self._free(*_PRODUCTS, "relaxation")

    def _free(self, *made, multipliers=True):
        """Free some attributes; what they computed stays counted."""
        before = self.equivalent_products
        for name in made:
            vars(self).pop(name, None)
        if multipliers:
            self.multipliers.clear()
        self._spent += before - self.equivalent_products

    # -- numpy side --------------------------------------------------------------------------------------

    def displacement(self, p, u):
        """Compute u = A p, (2.6) and (2.7), on all cells. Collective; arrays of shape `local_shape`."""
        apply_logged(_mult_event, self.product, p, u)

    def exact_displacement(self, p, u):
        """Compute u = A p in double precision whatever that of the other products. Collective."""
        apply_logged(_mult_event, self.exact_product, p, u)

    def energy_of_contact(self):
        """p.Ap for p = 1 on C and 0 elsewhere [mm / (N/mm2)], and the cells of C; one product per set. Collective."""
        cells = sum_over(self.comm, [np.count_nonzero(self.mask)])[0]
        asked_for = self.contact_version, cells  # until the next number cells only leave
        if self._energy[0] != asked_for:
            p, u = self.mask.astype(float), np.empty(self.local_shape)
            self.displacement(p, u)
            self._energy = asked_for, (sum_over(self.comm, [np.vdot(p, u)])[0], cells)
        return self._energy[1]

    # -- what PETSc calls --------------------------------------------------------------------------------

    def mult(self, mat, x, y):
        """Compute y = (a C A C + s I) x, the left side of (2.11); from it PCMG has the defect of Sec. 4.2, 2."""
        self.products += 1
        a, s = scale_and_shift(mat)
        with y as out:
            p, out = x.getArray(readonly=True).reshape(self.local_shape), out.reshape(self.local_shape)
            apply_logged(_mult_event, self.product, p, out, self.mask)
            if (a, s) != (1.0, 0.0):
                out *= a
                out += s * p

    multTranspose = mult

    def getDiagonal(self, mat, diagonal):
        """Diagonal of the Mat; the same outside C, where it only has to be nonzero."""
        a, s = scale_and_shift(mat)
        with diagonal as values:
            values[...] = a * self.diagonal + s

    def SOR(self, mat, b, omega, kind, shift, its, lits, x):
        """Sec. 4.2, 1: damped lexicographic Gauss-Seidel on C, the sequential sweep on any number of ranks.

        PETSc's "local" sweeps (its default) would make the multigrid method diverge; here they are the global ones.
        """
        a, s = scale_and_shift(mat)
        if shift or s or kind & ~(_FORWARD | _BACKWARD | _ZERO_GUESS):
            raise ValueError("no Gauss-Seidel by parts of the matrix, or with a diagonal shift")
        if not self.active:
            x.stateIncrease()  # as on the others, which alone may not call what is collective
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
                relaxation.sweep(r, self.mask, omega, d, backward=backward)
                PETSc.Log.logFlops(relaxation.products_per_sweep * self.product.flops)
                p += d
                self.sweeps += 1

    @cached_property
    def relaxation(self):
        """The sweeps on this grid, on a rank that has rows of it. Collective when first asked for."""
        from app.halfspace.gauss_seidel.sweep import GaussSeidel

        rows, period = quadrant_rows(self.grid, self.compliance), bool(self.grid.periodic)
        return GaussSeidel(rows, self.grid.shape, self.slabs, self.comm, periodic=period)

    def begin(self):
        """Let nothing that an earlier solve has done be seen in the next one. Not collective."""
        if "relaxation" in vars(self):
            self.relaxation.begin()

    @property
    def equivalent_products(self):
        """Everything computed here so far, in products on this grid (a sweep by its flops)."""
        made = vars(self)
        products = {id(made[name]): made[name] for name in _PRODUCTS if name in made}
        total = self._spent + sum([product.count for product in products.values()])
        points = [multiplier.points for multiplier in self.multipliers.values() if multiplier]
        total += sum(points) / self._padded
        if "relaxation" in made:
            total += self.sweeps * self.relaxation.products_per_sweep
        return total

    @cached_property
    def _padded(self):
        """Cells that a product transforms."""
        grid = self.grid
        return grid.n if grid.periodic else transform_length(grid.ny) * transform_length(grid.nx)

    def view(self, mat, viewer):
        """Describe the operator for -ksp_view."""
        if viewer.getType() != PETSc.Viewer.Type.ASCII:
            return
        grid, kind = self.grid, type(self.product).__name__
        spread = f"{self.slabs.size} slab{'s'[: self.slabs.size > 1]}"
        viewer.printfASCII(
            f"  influence matrix of {grid.nx} x {grid.ny} cells of {grid.dx:g} x {grid.dy:g} mm, {kind}, {spread}\n"
        )


def apply_logged(event, product, *fields):
    """Compute a product for -log_view, with its flops. Collective over its ranks."""
    with event:
        product.apply(*fields)
        PETSc.Log.logFlops(product.flops)


def petsc_comm(comm):
    """PETSc's communicator of an mpi4py communicator; None: this rank alone. Not collective."""
    return PETSc.COMM_SELF if comm is None else PETSc.Comm(MPI.Intracomm(comm))


def get_operator(mat, kind, who):
    """Return the context of a Mat, for a solver that works on one kind of operator only. Not collective.

    Raises
    ------
    InputError
        If it is another one: of -lcp_type primal or not, or the assembled one of the coarsest grid of -pc_type mg.
    """
    context = mat.getPythonContext() if mat.getType() == "python" else None
    if not isinstance(context, kind):
        here = "an assembled matrix" if context is None else f"an {type(context).__name__}"
        raise InputError(f"{who}: needs an {kind.__name__}; this system has {here}")
    return context


def wrap_vec(field, operator):
    """Make a Vec of a field on an operator's grid, in its memory, for the caller to free. Collective over its ranks.

    A ValueError if the field is not C-contiguous: the Vec would be a copy.
    """
    if not field.flags.c_contiguous:
        raise ValueError("a Vec needs a field that is C-contiguous")
    # All cells, that PETSc need not sum; none where there are none, by a communicator of this rank's own.
    size = field.size, operator.grid.n if operator.active else 0
    return PETSc.Vec().createWithArray(field.reshape(-1), size, comm=operator.petsc_comm)


def symmetric_mat(context, comm):
    """Make a Mat of an operator with a `local_shape`, symmetric positive definite. Collective over `comm`."""
    size = context.local_shape[0] * context.local_shape[1], context.grid.n
    mat = PETSc.Mat().createPython((size, size), context, comm=comm)
    mat.setName(f"contact {context.grid.nx} x {context.grid.ny}")
    for option in ("HERMITIAN", "SYMMETRY_ETERNAL", "SPD"):
        mat.setOption(getattr(PETSc.Mat.Option, option), True)
    mat.setUp()
    report_no_entries(mat)
    return mat
