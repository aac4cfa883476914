"""Default method for thin, nearly incompressible layers on a rigid base.

`LayeredKernel.is_thin_film` recognises such layers by the eigenvalues of A: those of long waves are much smaller than
those of shorter waves. On such layers the methods of `app.methods.free` and `app.methods.periodic` would fail.

The unknown is the pressure. The steps are those of the paper, Sec. 4.1, with three differences:

- *Linear solver.* CG is preconditioned by a multigrid method for membranes (`membrane`), and ends before it has
  converged.
- *Load.* A prescribed load is a constraint on the pressure: the directions of CG have no mean, and the mean of the
  residual is the change of the approach (`cg`). So the load and the contact set converge together. If the approach were
  changed after each contact set, it would oscillate, because the load depends so strongly on it.
- *Safeguard.* If the iteration makes no progress, `app.methods.safeguard` continues.

Except with `-periodic_symbol spectral`, the nested iteration begins on a grid whose cells are at most three times as
wide as the layer is thick. On wider cells the influence coefficients vanish, because a uniform pressure hardly
displaces the middle of a wide cell.
"""
