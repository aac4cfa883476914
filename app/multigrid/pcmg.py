"""Multigrid method (Sec. 4.2), a PC for any KSP.

PETSc's PCMG runs the cycles; its operators are masked by the contact set::

    -pc_type python -pc_python_type app.multigrid.ContactMG

All options are PETSc's: ``-pc_mg_type``, ``-pc_mg_cycle_type``, ``-pc_mg_levels``, the smoothers by ``-mg_levels_*``
(and ``-mg_levels_up_*`` with ``-pc_mg_distinct_smoothup``), the coarsest grid by ``-mg_coarse_*``. The defaults are the
paper's: one sweep of forward Gauss-Seidel with omega 0.8, and a direct solve. If the KSP needs a symmetric
preconditioner, the smoother after the coarse grid is the adjoint of the smoother before it. Cycles without smoothers
after it, ``-pc_mg_type additive`` and ``-pc_mg_levels 1``, then have symmetric sweeps.

=============================  ===============================================  ========================
Sec. 4.2                       here                                             in
=============================  ===============================================  ========================
1 smoothing within C           ``-mg_levels_*``; `InfluenceOperator.SOR`        halfspace/operator.py
2 defect, zero outside C       `InfluenceOperator.mult`, masked                 halfspace/operator.py
3 restriction of d and C       `restrict_defect`, `restrict_contact`            multigrid/transfer.py
4 coarse grid exactly          ``-mg_coarse_*``; `MaskedMatrix`                 multigrid/pcmg.py
5 interpolation, zero outside  `add_copies`                                     multigrid/transfer.py
6 correction                   ``multAdd`` of the interpolation                 multigrid/transfer.py
=============================  ===============================================  ========================
"""

import re

import numpy as np
from petsc4py import PETSc

from app.base.errors import InputError
from app.base.petsc import calling_petsc
from app.halfspace.mat_methods import check_unscaled
from app.halfspace.operator import InfluenceOperator, get_operator
from app.multigrid.direct import stored_matrix
from app.multigrid.hierarchy import get_coarser_levels, make_transfers
from app.options.solver_options import temporary_options

_SMOOTHER = {
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": "1",
    "mg_levels_pc_type": "sor",
    "mg_levels_pc_sor_forward": "",
    "mg_levels_pc_sor_omega": "0.8",
}
_OTHER_SWEEPS = ("symmetric", "backward", "local_symmetric", "local_backward", "local_forward")
# KSPs that need a symmetric preconditioner, for short recurrences or orthogonality
_NEED_SYMMETRY = (
    "cg groppcg pipecg pipecgrr pipelcg pipeprcg pipecg2 cr pipecr minres symmlq qcg nash stcg gltr chebyshev lsqr"
).split()
_OF_LEVELS = re.compile(r"mg_levels_(\d+_)?(up_)?(.+)")
_ONE_WAY = re.compile(r"(?<=^pc_sor_)(local_)?(forward|backward)$")
_WITHOUT_ADJOINT = "full", "kaskade"  # cycles whose adjoint is no cycle of PETSc
# |x.My - y.Mx| / |x| |My| of a cycle M; rounding makes 1e-13, one-way sweeps make 0.05 to 0.3
_MAX_ASYMMETRY = 1e-2
_DIRECT = {
    "mg_coarse_ksp_type": "preonly",
    "mg_coarse_pc_type": "bjacobi",
    "mg_coarse_sub_ksp_type": "preonly",
    "mg_coarse_sub_pc_type": "lu",
    "mg_coarse_sub_pc_factor_zeropivot": "1e-300",  # influence coefficients may be small in the user's units
}


class MaskedMatrix:
    """Assembled matrix of the coarsest grid, for step 4 of Sec. 4.2.

    The matrix is ``C A C + d (I - C)``, where d is the diagonal of A. One rank has the whole matrix; the grid has at
    most `MAX_DIRECT_CELLS` cells.
    """

    def __init__(self, operator, comm):
        self.operator = operator
        self._full = stored_matrix(operator)
        rows = len(self._full)
        self.mat = PETSc.Mat().createAIJ(((rows, PETSc.DETERMINE),) * 2, nnz=operator.grid.n, comm=comm)
        self._index = np.arange(rows, dtype=PETSc.IntType)
        self.update()

    def update(self, energy=0.0):
        """Assemble the matrix for the operator's contact set C. Collective.

        A constant is added to the entries on C, so that ``p.Ap >= energy`` for p = 1 on C.
        """
        if self.operator.active:
            inside = self.operator.mask.reshape(-1)
            both = inside[:, None] & inside
            values = np.where(both, self._full, 0.0)
            missing = (energy - values.sum()) / max(np.count_nonzero(inside), 1) ** 2
            values += np.where(both, max(missing, 0.0), 0.0)
            values[~inside, ~inside] = self.operator.diagonal
            self.mat.setValues(self._index, self._index, values)
        self.mat.assemble()

    def destroy(self):
        """Free the matrix. Collective."""
        self.mat.destroy()


class ContactMG:
    """PC context: multigrid cycles on a contact set.

    Collective. Each set-up restricts the contact set to the coarser grids. PETSc repeats the set-up when the Mat has
    changed, as by ``mat.assemble()``. The coarser operators come from the operator's hierarchy; without a hierarchy
    they are made here. Options, with the prefix of the PC: ``-pc_mg_*``, ``-mg_levels_*``, ``-mg_coarse_*``. The
    attribute `operators` has the operators of the levels, coarsest first.
    """

    operators = _transfers = _mats = ()
    _cycle = _mat = _coarse = None
    _contact = -1  # version of the contact set that was restricted last
    _ksp_type = ""  # of a KSP that may need a symmetric cycle
    _needs_symmetry = False
    _applied = None  # copies of x and y of the first application, before symmetry is checked; () afterwards
    _adjoint = None  # ContactMG whose cycle is the adjoint of this one
    _is_adjoint = False

    def setFromOptions(self, pc):
        """Reset, so that the next set-up reads options."""
        self.reset(pc)

    def setUp(self, pc):
        """Make the PCMG for a new Mat, and restrict the contact set."""
        try:
            mat = pc.getOperators()[1]
            if self._cycle is not None and mat != self._mat:
                self.reset(pc)
            with calling_petsc():
                if self._cycle is None:
                    self._make(pc, mat)
                else:
                    self._restrict_contact()
                    self._cycle.setUp()
            if self._adjoint is not None:
                self._adjoint.setUp(pc)
        except BaseException:
            self.reset(pc)
            raise

    def preSolve(self, pc, ksp, b, x):
        """Make the cycle symmetric if the KSP needs a symmetric preconditioner."""
        if ksp.getType() in (*_NEED_SYMMETRY, "python") and ksp.getType() != self._ksp_type:
            self._ksp_type = ksp.getType()
            self.reset(pc)
            self.setUp(pc)

    def apply(self, pc, x, y):
        """Compute y from x by ``-pc_mg_multiplicative_cycles`` cycles (default: one)."""
        if self._cycle is None:
            self.setUp(pc)
        try:
            with calling_petsc():
                self._cycle.apply(x, y)
        except BaseException:
            x.incRef()  # an interrupted PCMG keeps x and would free it
            self.reset(pc)
            raise
        if self._needs_symmetry and self._applied != ():
            self._check_symmetry(x, y)

    def applyTranspose(self, pc, x, y):
        """Compute y from x by the adjoint of the cycles."""
        if self._needs_symmetry:
            return self.apply(pc, x, y)
        if self._adjoint is None:
            self._adjoint = ContactMG()
            self._adjoint._is_adjoint = True
        self._adjoint.apply(pc, x, y)

    def _check_symmetry(self, x, y):
        """Raise InputError if two applications on a contact set show that the cycle is not symmetric.

        Methods such as CG would stagnate. The check needs no more cycles.
        """
        if self._applied is None:
            self._applied = x.copy(), y.copy()
            return
        first_x, first_y = self._applied
        difference = abs(first_x.dot(y) - x.dot(first_y))
        allowed = _MAX_ASYMMETRY * min(first_x.norm() * y.norm(), x.norm() * first_y.norm())
        self._forget_applied(())
        if difference > allowed:
            raise InputError(
                f"-ksp_type {self._ksp_type}: needs a symmetric preconditioner, and these smoothers before and "
                "after the coarse grid (-mg_levels_*, -mg_levels_up_*) are not adjoint; choose -ksp_type fcg or gmres"
            )

    def _forget_applied(self, value=None):
        for vec in self._applied or ():
            vec.destroy()
        self._applied = value

    def view(self, pc, viewer):
        """Print the PCMG with its levels to a viewer."""
        if self._cycle is not None:
            self._cycle.view(viewer)

    def reset(self, pc):
        """Free all PETSc objects until the next use."""
        if self._adjoint is not None:
            self._adjoint.reset(pc)
            self._adjoint = None
        self._forget_applied()
        # Also the Mat: PETSc's garbage_cleanup may call this, and loses what Python drops inside it.
        for part in (self._cycle, self._coarse, *self._mats, self._mat):
            if part is not None:
                part.destroy()
        self._cycle = self._mat = self._coarse = None
        self.operators = self._transfers = self._mats = ()

    destroy = reset

    def _make(self, pc, mat):
        operator, prefix = get_operator(mat, InfluenceOperator, "ContactMG"), pc.getOptionsPrefix() or ""
        check_unscaled(mat, "ContactMG")
        if pc.comm.size != operator.slabs.size:
            raise InputError("ContactMG: needs a Mat on the ranks that share the rows of its operator")
        options, coarser = PETSc.Options(prefix), get_coarser_levels(operator)
        coarser = coarser[: _levels_wanted(operator, options) - 1]
        self.operators, self._mat = [*coarser[::-1], operator], mat
        self._cycle = cycle = PETSc.PC().create(pc.comm)
        cycle.incrementTabLevel(1, parent=pc)
        cycle.setOptionsPrefix(pc.getOptionsPrefix())
        cycle.setOperators(*pc.getOperators())
        cycle.setType(PETSc.PC.Type.MG)
        cycle.setMGLevels(len(self.operators))
        self._set_levels(pc.comm)
        self._ksp_type = self._ksp_type or options.getString("ksp_type", "")
        defaults, forced = self._cycle_options(options)
        forced |= {"pc_type": "mg", "pc_mg_levels": str(len(self.operators))}
        with temporary_options(prefix, defaults, forced):
            cycle.setFromOptions()
            self._restrict_contact()
            cycle.setUp()  # levels read their options now
            # Fails now, on all ranks, instead of in a cycle on the rank of the coarsest grid.
            cycle.getMGCoarseSolve().getPC().setUpOnBlocks()

    def _cycle_options(self, options):
        """Return defaults of the cycle's options, and options that replace the user's."""
        kind, galerkin = (options.getString(f"pc_mg_{name}", "").lower() for name in ("type", "galerkin"))
        if galerkin not in ("", "none", "external"):
            raise InputError(
                f"-pc_mg_galerkin {galerkin}: coarser grids have operators of their own; must be none"
            )
        several = len(self.operators) > 1
        texts, one_smoother = options.getAll(), kind == "additive" or not several
        # This program's own KSPs are methods of CG that tolerate the usual cycle.
        ksp = self._ksp_type
        self._needs_symmetry = ksp in _NEED_SYMMETRY or (ksp == "python" and one_smoother)
        if several and kind in _WITHOUT_ADJOINT and (self._needs_symmetry or self._is_adjoint):
            reason = (
                f"-ksp_type {ksp} needs a symmetric cycle"
                if self._needs_symmetry
                else "has no transpose here"
            )
            advice = "choose -pc_mg_type multiplicative or additive, or -ksp_type fcg or gmres"
            raise InputError(f"-pc_mg_type {kind}: {reason}; {advice}")
        defaults = _default_options(texts, self._needs_symmetry and not one_smoother)
        if self._needs_symmetry and one_smoother:
            return defaults, _symmetric_sweeps(defaults | texts)
        return defaults, _transposed_smoothers(defaults | texts, one_smoother) if self._is_adjoint else {}

    def _set_levels(self, comm):
        """Set the PCMG's operators, transfers and coarsest matrix."""
        cycle, finest = self._cycle, len(self.operators) - 1
        self._transfers = make_transfers(self.operators, self.operators[-1].comm)
        self._mats = []
        for level, transfer in enumerate(self._transfers[1:], 1):
            mats = transfer.restriction_mat(comm), transfer.interpolation_mat(comm)
            cycle.setMGRestriction(level, mats[0])
            cycle.setMGInterpolation(level, mats[1])
            mat = self._mat if level == finest else self.operators[level].mat(comm)
            # getMGSmootherDown would make a separate up smoother.
            cycle.getMGSmoother(level).setOperators(mat)
            self._mats += mats if level == finest else (*mats, mat)
        coarsest = cycle.getMGCoarseSolve()
        if finest:
            self._coarse = MaskedMatrix(self.operators[0], comm)  # Sec. 4.2, 4
            self._coarse.mat.setOptionsPrefix(coarsest.getOptionsPrefix())
        # A single level has the options of a smoother, and the grid's own operator.
        coarsest.setOperators(self._coarse.mat if finest else self._mat)

    def _restrict_contact(self):
        """Restrict the contact set to all levels."""
        fine = self.operators[-1]
        if fine.contact_version == self._contact:
            fine.mask_changed()  # the Mat has a new state, not a new contact set
        self._contact = fine.contact_version
        for transfer in self._transfers[:0:-1]:
            transfer.restrict_contact()
        for operator in self.operators[:-1]:
            operator.mask_changed()
        if self._applied:
            self._forget_applied()  # of another contact set
        for mat in self._mats:
            mat.stateIncrease()
        if self._coarse:
            self._coarse.update(_energy_of_constant(fine, self.operators[0]))


def _levels_wanted(operator, options):
    """Return the number of levels, which ``-pc_mg_levels`` may limit."""
    levels = 1 + len(operator.coarser_levels)
    most = max(levels, 1 + len((operator.target or operator).coarser_levels or ()))
    wanted = options.getInt("pc_mg_levels", levels)
    if not 1 <= wanted <= most:
        raise InputError(f"-pc_mg_levels {wanted}: this grid allows 1 to {most}")
    if most == 1:
        grid = operator.grid
        least = "3 cells in a direction of a period" if grid.doubly_periodic else "2 cells"
        size = f"{grid.nx},{grid.ny}"
        raise InputError(f"multigrid: the grid {size} cannot be halved; it must have at least {least}")
    return min(wanted, levels)


def _energy_of_constant(fine, coarse):
    """Return the energy p.Ap of a constant pressure on C. Collective.

    The pressure is 1 on the contact set C. `MaskedMatrix.update` uses the energy on the coarsest grid of a periodic
    patch; on other patches it is 0. The energy is computed on the fine grid, because C may cover all cells of the
    coarsest grid, where a constant pressure has no energy.
    """
    if not fine.grid.doubly_periodic:
        return 0.0
    energy = max(fine.energy_of_contact()[0], fine.diagonal)  # at least that of one open cell
    return energy * coarse.grid.n / fine.grid.n


def _default_options(options, symmetric):
    """Return defaults of smoothers and coarsest grid, given the user's `options`."""
    defaults = _SMOOTHER | _DIRECT
    if any(f"mg_levels_pc_sor_{kind}" in options for kind in _OTHER_SWEEPS):
        del defaults["mg_levels_pc_sor_forward"]  # one direction excludes the others
    if symmetric and "pc_mg_distinct_smoothup" not in options:
        defaults |= _adjoint_smoothers(defaults | options)
    return defaults


def _smoothers(options):
    """Return the options of smoothers before and after the coarse grid: (level, name) -> text."""
    found = {"": {}, "up_": {}}
    for name, text in options.items():
        if match := _OF_LEVELS.fullmatch(name):
            level, after, option = match.groups(default="")
            found[after][level, option] = text or ""
    return found[""], found["up_"]


def _adjoint_of(smoother, after=""):
    """Return the options of a smoother's adjoint, which is `after` the coarse grid if that is ``up_``."""
    turned = {"forward": "backward", "backward": "forward"}
    return {
        f"mg_levels_{level}{after}{_ONE_WAY.sub(lambda m: (m[1] or '') + turned[m[2]], option)}": text
        for (level, option), text in smoother.items()
    }


def _adjoint_smoothers(options):
    """Return options of smoothers after the coarse grid: adjoints of those before."""
    return {"pc_mg_distinct_smoothup": "", **_adjoint_of(_smoothers(options)[0], "up_")}


def _symmetric_sweeps(options):
    """Return options by which all sweeps are symmetric; None: removed."""
    names = (name for name in options if (match := _OF_LEVELS.fullmatch(name)) and _ONE_WAY.search(match[3]))
    return {**dict.fromkeys(names), "mg_levels_pc_sor_symmetric": ""}


def _transposed_smoothers(options, one_smoother):
    """Return options that exchange smoothers before and after the coarse grid, and make them adjoint."""
    before, after = _smoothers(options)
    transposed = dict.fromkeys(name for name in options if _OF_LEVELS.fullmatch(name))
    if one_smoother or "pc_mg_distinct_smoothup" not in options:
        return transposed | _adjoint_of(before)
    return transposed | _adjoint_of(after) | _adjoint_of(before, "up_")
