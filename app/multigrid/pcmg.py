"""The multigrid method (Sec. 4.2) as a PC for any KSP: PETSc's PCMG on masked operators.

::

    -pc_type python -pc_python_type app.multigrid.ContactMG

Everything that may be chosen is PETSc's: ``-pc_mg_type``, ``-pc_mg_cycle_type``, ``-pc_mg_levels``, the smoothers by
``-mg_levels_*`` (and ``-mg_levels_up_*`` with ``-pc_mg_distinct_smoothup``), the coarsest grid by ``-mg_coarse_*``.
The defaults are the paper's: one sweep of forward Gauss-Seidel with omega 0.8, and a direct solve.
A KSP that needs a symmetric preconditioner gets one: the smoother after the coarse grid is the adjoint of that before
it, so a forward sweep is followed by a backward one.

=============================  ========================================================================
Sec. 4.2                       here
=============================  ========================================================================
1 smoothing within C           ``-mg_levels_*``; Gauss-Seidel is `InfluenceOperator.SOR`
2 defect, zero outside C       PCMG, by the masked `InfluenceOperator.mult`
3 restriction of d and C       `Transfer.restrict_defect`, `Transfer.restrict_contact`
4 coarse grid exactly          `MaskedMatrix`, ``-mg_coarse_*``
5 interpolation, zero outside  `Transfer.add_copies`
6 correction                   PCMG, by ``multAdd`` of the interpolation
=============================  ========================================================================
"""

from __future__ import annotations

import re

import numpy as np
from petsc4py import PETSc

from app.base.errors import InputError
from app.halfspace.mat_methods import check_unscaled
from app.halfspace.operator import InfluenceOperator, get_operator
from app.multigrid.direct import stored_matrix
from app.multigrid.hierarchy import coarser_levels, transfers_between
from app.options.solver_options import temporary_options

_SMOOTHER = {
    "mg_levels_ksp_type": "richardson",
    "mg_levels_ksp_max_it": "1",
    "mg_levels_pc_type": "sor",
    "mg_levels_pc_sor_forward": "",
    "mg_levels_pc_sor_omega": "0.8",
}
_OTHER_SWEEPS = ("symmetric", "backward", "local_symmetric", "local_backward", "local_forward")
# KSPs that need a symmetric preconditioner: short recurrences, or an orthogonality that holds for symmetric ones only
_NEED_SYMMETRY = (
    "cg groppcg pipecg pipecgrr pipelcg pipeprcg pipecg2 cr pipecr minres symmlq qcg nash stcg gltr chebyshev"
).split()
_OF_LEVELS = re.compile(r"mg_levels_(\d+_)?(?!up_)(.+)")
_DIRECT = {
    "mg_coarse_ksp_type": "preonly",
    "mg_coarse_pc_type": "bjacobi",
    "mg_coarse_sub_ksp_type": "preonly",
    "mg_coarse_sub_pc_type": "lu",
    "mg_coarse_sub_pc_factor_zeropivot": "1e-300",  # the size of influence coefficients is a matter of units
}


class MaskedMatrix:
    """Sec. 4.2, 4: the coarsest system, assembled ``C A C + d (I - C)``, all of it on the rank that has the grid.

    Parameters
    ----------
    operator : InfluenceOperator
        On a grid of at most `MAX_DIRECT_CELLS` cells.
    comm : PETSc communicator
    """

    def __init__(self, operator, comm):
        self.operator = operator
        self._full = stored_matrix(operator)
        rows = len(self._full)
        self.mat = PETSc.Mat().createAIJ(((rows, PETSc.DETERMINE),) * 2, nnz=operator.grid.n, comm=comm)
        self._index = np.arange(rows, dtype=PETSc.IntType)
        self.update()

    def update(self, energy=0.0):
        """Take over the operator's contact set. Collective.

        Parameters
        ----------
        energy : float
            What ``p.Ap`` should at least be for p = 1 on C.
        """
        if self.operator.active:
            self._set_values(energy)
        self.mat.assemble()

    def _set_values(self, energy):
        inside = self.operator.mask.reshape(-1)
        values = np.where(inside[:, None] & inside, self._full, 0.0)
        lacks = (energy - values.sum()) / max(np.count_nonzero(inside), 1) ** 2
        values += np.where(inside[:, None] & inside, max(lacks, 0.0), 0.0)
        values[~inside, ~inside] = self.operator.diagonal
        self.mat.setValues(self._index, self._index, values)

    def destroy(self):
        """Free the matrix. Collective."""
        self.mat.destroy()


class ContactMG:
    """PC context: multigrid cycles on the contact set of an `InfluenceOperator`, which each set-up restricts.

    Collective. PETSc sets it up again when the state of the Mat has grown, as by ``mat.assemble()``. The coarser
    operators are those of the hierarchy that the operator belongs to, or they are made. Options under the prefix of the
    PC: ``-pc_mg_*``, ``-mg_levels_*``, ``-mg_coarse_*``.

    Attributes
    ----------
    operators : list of InfluenceOperator
        Of the levels, coarsest first.
    """

    operators = _transfers = _mats = ()
    _cycle = _mat = _coarse = None
    _contact = -1  # number of the set that was restricted last
    _symmetric = False  # whether the KSP is known to need that

    def setFromOptions(self, pc):
        """Read the options again in the next set-up."""
        self.reset(pc)

    def setUp(self, pc):
        """Make the PCMG, if there is none for this Mat, and restrict the contact set to all levels."""
        try:
            mat = pc.getOperators()[1]
            if self._cycle is not None and mat != self._mat:
                self.reset(pc)
            if self._cycle is None:
                self._make(pc, mat)
            else:
                self._restrict_contact()
                self._cycle.setUp()
        except BaseException:
            self.reset(pc)
            raise

    def preSolve(self, pc, ksp, b, x):
        """Make the cycle symmetric if the KSP needs that, which was not set from options."""
        if ksp.getType() in _NEED_SYMMETRY and not self._symmetric:
            self._symmetric = True
            self.reset(pc)
            self.setUp(pc)

    def apply(self, pc, x, y):
        """Compute y = M x, by one cycle (or more of them: ``-pc_mg_multiplicative_cycles``)."""
        if self._cycle is None:
            self.setUp(pc)
        try:
            self._cycle.apply(x, y)
        except BaseException:
            x.incRef()  # an interrupted PCMG keeps x as if it were its own, and frees it
            self.reset(pc)
            raise

    def view(self, pc, viewer):
        """View the PCMG."""
        if self._cycle is not None:
            self._cycle.view(viewer)

    def reset(self, pc):
        """Free everything made here. Made again when needed."""
        if self._cycle is not None:
            self._cycle.destroy()
        if self._coarse is not None:
            self._coarse.destroy()
        for mat in self._mats:
            mat.destroy()
        self._cycle = self._mat = self._coarse = None
        self.operators = self._transfers = self._mats = ()

    destroy = reset

    def _make(self, pc, mat):
        operator, prefix = get_operator(mat, InfluenceOperator, "ContactMG"), pc.getOptionsPrefix() or ""
        check_unscaled(mat, "ContactMG")
        if pc.comm.size != operator.slabs.size:
            raise InputError("ContactMG: needs a Mat on the ranks that share the rows of its operator")
        options, coarser = PETSc.Options(prefix), coarser_levels(operator)
        coarser = coarser[: _levels_wanted(operator, options) - 1]
        self.operators, self._mat = [*coarser[::-1], operator], mat
        self._cycle = cycle = PETSc.PC().create(pc.comm)
        cycle.incrementTabLevel(1, parent=pc)
        cycle.setOptionsPrefix(pc.getOptionsPrefix())
        cycle.setOperators(*pc.getOperators())
        cycle.setType(PETSc.PC.Type.MG)
        cycle.setMGLevels(len(self.operators))
        self._set_levels(pc.comm)
        self._symmetric |= options.getString("ksp_type", "") in _NEED_SYMMETRY
        defaults = _default_options(options.getAll(), self._symmetric)
        forced = {"pc_type": "mg", "pc_mg_levels": str(len(self.operators))}
        with temporary_options(prefix, defaults, forced):
            cycle.setFromOptions()
            self._restrict_contact()
            cycle.setUp()  # levels read their options here
            # What cannot be had is refused now, not by the rank that has the coarsest grid in a cycle.
            cycle.getMGCoarseSolve().getPC().setUpOnBlocks()

    def _set_levels(self, comm):
        """Give the PCMG its operators, transfers and coarsest matrix."""
        cycle, finest = self._cycle, len(self.operators) - 1
        self._transfers = transfers_between(self.operators, self.operators[-1].comm)
        self._mats = []
        for level, transfer in enumerate(self._transfers[1:], 1):
            mats = transfer.restriction_mat(comm), transfer.interpolation_mat(comm)
            cycle.setMGRestriction(level, mats[0])
            cycle.setMGInterpolation(level, mats[1])
            mat = self._mat if level == finest else self.operators[level].mat(comm)
            # getMGSmootherDown would silently make the up smoother another one.
            cycle.getMGSmoother(level).setOperators(mat)
            self._mats += mats if level == finest else (*mats, mat)
        coarsest = cycle.getMGCoarseSolve()
        if finest:
            self._coarse = MaskedMatrix(self.operators[0], comm)
            self._coarse.mat.setOptionsPrefix(coarsest.getOptionsPrefix())
        # PETSc's only level is a smoother, as it has options of one: it works on the grid's own operator.
        coarsest.setOperators(self._coarse.mat if finest else self._mat)

    def _restrict_contact(self):
        """Sec. 4.2, 3: restrict the contact set of the finest grid to all others."""
        fine = self.operators[-1]
        if fine.contact_version == self._contact:
            fine.mask_changed()  # only the state of the Mat was raised
        self._contact = fine.contact_version
        for transfer in self._transfers[:0:-1]:
            transfer.restrict_contact()
        for operator in self.operators[:-1]:
            operator.mask_changed()
        for mat in self._mats:
            mat.stateIncrease()
        if self._coarse:
            self._coarse.update(_energy_of_constant(fine, self.operators[0]))


def _levels_wanted(operator, options):
    """Number of levels of a cycle, by ``-pc_mg_levels`` or all; a grid of a nested iteration may have fewer."""
    levels = 1 + len(operator.coarser_levels)
    most = max(levels, 1 + len((operator.target or operator).coarser_levels or ()))
    wanted = options.getInt("pc_mg_levels", levels)
    if not 1 <= wanted <= most:
        raise InputError(f"-pc_mg_levels {wanted}: this grid allows 1 to {most}")
    if most == 1:
        grid = operator.grid
        least = "3 cells in a direction of a period" if grid.periodic else "2 cells"
        raise InputError(
            f"multigrid: the grid {grid.nx},{grid.ny} cannot be halved; allowed: at least {least}"
        )
    return min(wanted, levels)


def _energy_of_constant(fine, coarse):
    """p.Ap for p = 1 on C of a periodic patch, as the coarsest grid should see it; 0 on a free one. Collective.

    The coarser the grid the more of it is in C, in the end all, where a constant costs nothing: its correction
    would be much too large, or infinite.
    """
    if not fine.grid.periodic:
        return 0.0
    energy = max(fine.energy_of_contact()[0], fine.diagonal)  # that of one open cell, at the least
    return energy * coarse.grid.n / fine.grid.n


def _default_options(given, symmetric):
    """Options of smoothers and coarsest grid that the user has not given, maybe for a symmetric cycle."""
    defaults = _SMOOTHER | _DIRECT
    if any(f"mg_levels_pc_sor_{kind}" in given for kind in _OTHER_SWEEPS):
        del defaults["mg_levels_pc_sor_forward"]  # one direction excludes the others
    if symmetric and "pc_mg_distinct_smoothup" not in given:
        defaults |= _adjoint_smoothers(defaults | given)
    return defaults


def _adjoint_smoothers(options):
    """Options with which each smoother after the coarse grid is the adjoint of the one before it."""
    turned = {"forward": "backward", "backward": "forward"}
    adjoint = {"pc_mg_distinct_smoothup": ""}
    for name, text in options.items():
        if level := _OF_LEVELS.fullmatch(name):
            what = re.sub(
                r"(?<=^pc_sor_)(local_)?(forward|backward)$", lambda m: (m[1] or "") + turned[m[2]], level[2]
            )
            adjoint[f"mg_levels_{level[1] or ''}up_{what}"] = text or ""
    return adjoint
