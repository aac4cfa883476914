"""PETSc's PCMG on the masked operators of a hierarchy (Sec. 4.2).

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

from app.multigrid.direct import stored_matrix

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
        On a grid of at most `LARGEST_DIRECT` cells.
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


class Multigrid:
    """Sets up the PCMG of a KSP and keeps its contact sets.

    Collective over `comm`.

    Parameters
    ----------
    ksp : KSP
        With operators set; its options are read here.
    operators, transfers : lists
        Levels of a `Hierarchy`, coarsest first, up to the KSP's own grid.
    most : int
        Number of levels of the target grid: what -pc_mg_levels may ask for.
    comm : PETSc communicator
    """

    def __init__(self, ksp, operators, transfers, comm, most):
        wanted = PETSc.Options(ksp.getOptionsPrefix()).getInt("pc_mg_levels", len(operators))
        if not 1 <= wanted <= most:
            raise ValueError(f"-pc_mg_levels {wanted}: this grid allows 1 to {most}")
        wanted = min(wanted, len(operators))
        if most == 1:
            grid = operators[-1].grid
            least = "3 cells in a direction of a period" if grid.periodic else "2 cells"
            raise ValueError(
                f"-pc_type mg: the grid {grid.nx},{grid.ny} cannot be halved; allowed: at least {least}"
            )
        self.operators, self.transfers = operators[-wanted:], transfers[-wanted:]
        # PETSc's only level is a smoother, as it has options of one: it works on the grid's own operator.
        self.coarse = MaskedMatrix(self.operators[0], comm) if wanted > 1 else None
        pc = ksp.getPC()
        pc.setType(PETSc.PC.Type.MG)
        pc.setMGLevels(wanted)
        self._transfer_mats, self._level_mats = [], []
        for l in range(1, wanted):
            restriction = self.transfers[l].restriction_mat(comm)
            interpolation = self.transfers[l].interpolation_mat(comm)
            self._transfer_mats += [restriction, interpolation]
            pc.setMGRestriction(l, restriction)
            pc.setMGInterpolation(l, interpolation)
            # Only the finest Mat exists; getMGSmootherDown would silently make the up smoother another one.
            if l == wanted - 1:
                mat = ksp.getOperators()[0]
            else:
                mat = self.operators[l].mat(comm)
                self._level_mats.append(mat)
            pc.getMGSmoother(l).setOperators(mat)
        coarse = pc.getMGCoarseSolve()
        if self.coarse:
            self.coarse.mat.setOptionsPrefix(coarse.getOptionsPrefix())
        coarse.setOperators(self.coarse.mat if self.coarse else ksp.getOperators()[0])

    def contact_changed(self):
        """Sec. 4.2, 3: restrict the contact set of the finest grid to all others. Collective."""
        for transfer in self.transfers[:0:-1]:
            transfer.restrict_contact()
        for operator in self.operators:
            operator.mask_changed()
        for mat in self._level_mats:
            mat.stateIncrease()
        if self.coarse:
            self.coarse.update(self._energy_of_constant())

    def _energy_of_constant(self):
        """p.Ap for p = 1 on C of a periodic patch, as the coarsest grid should see it; 0 on a free one. Collective.

        The coarser the grid the more of it is in C, in the end all, where a constant costs nothing: its correction
        would be much too large, or infinite.
        """
        fine, coarse = self.operators[-1], self.operators[0]
        if not fine.grid.periodic:
            return 0.0
        energy = max(fine.energy_of_contact()[0], fine.diagonal)  # that of one open cell, at the least
        return energy * coarse.grid.n / fine.grid.n

    def destroy(self):
        """Free the Mats made here. Collective."""
        if self.coarse:
            self.coarse.destroy()
        for mat in (*self._transfer_mats, *self._level_mats):
            mat.destroy()


def default_options(prefix, ksp_type):
    """Return the options of smoothers and coarsest grid that the user has not given. Not collective.

    Parameters
    ----------
    prefix : str
        Of all options.
    ksp_type : str
        Of the KSP around the cycle; some need a symmetric one.
    """
    given = {name: text or "" for name, text in PETSc.Options(prefix).getAll().items()}
    defaults = _SMOOTHER | _DIRECT
    if any(f"mg_levels_pc_sor_{kind}" in given for kind in _OTHER_SWEEPS):
        del defaults["mg_levels_pc_sor_forward"]  # one direction excludes the others
    if ksp_type in _NEED_SYMMETRY and "pc_mg_distinct_smoothup" not in given:
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
            adjoint[f"mg_levels_{level[1] or ''}up_{what}"] = text
    return adjoint
