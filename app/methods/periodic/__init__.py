"""Default method on periodic patches, with displacement as unknown.

In the primal form of a variational inequality the displacement is the unknown. On a periodic patch A is diagonal in
Fourier space. So a product with its inverse B, on fields without mean, costs as much as a product with A, and the
displacement can be the unknown instead of the pressure. Let ``w = u - approach``, and let h0 be the shape. Then the gap
is ``e = h0 + w``, and

    w = -h0  on C,        p = B w + mean pressure = 0  on O, the free cells outside C.

This is (2.11) with pressure and gap exchanged, and has three advantages:

- B is nearly local: it decays like 1 / r^3, A like 1 / r. So the preconditioner needs no Fourier transform on the fine
  grid. It consists of a few sweeps with the 3 x 3 centre of B, and of A on a coarser grid for long waves, with contact
  as springs (`two_grid`, `stencil`).
- B maps constants to zero. So a load, that is a mean pressure, is met at once, without a search for the approach.
- The system becomes smaller towards full contact.

On each grid, from the coarsest to the target (`nested`), it has these stages:

- *Start.* Quintic polynomials interpolate w and p from the coarser grid; the coarsest grid starts from full contact.
- *Guess.* Some projected sweeps with the centre of B guess the contact set (`state.PrimalState.guess`).
- *Contact sets.* `iteration` solves roughly for w on O, by CG that updates p (`cg`) with multilevel products
  (`app.methods.multilevel_operators`). Then cells with p < 0 are released from C, and cells with e < 0 are captured. If
  cells are captured, or if the residual is as small as the error of the multilevel products, p is recomputed by FFT.
- *Stop.* A coarse grid is left when few cells change and the residual is small compared with the deviation of h0 from
  its mean, or with the approach beyond first touch if that is smaller. The target grid is left when no cell changes, or
  the changes are negligible. A product A p in double precision and the certificate decide if the problem is solved.
- *Approach.* A prescribed approach prescribes the mean of w. So directions of CG have no mean, and the mean pressure is
  the Lagrange multiplier.
- *Hardness.* Plastic cells are free cells, too: there p must be H in place of 0, which only changes the right-hand side
  (`capped_state`).
- *Dilute contact.* If few cells of a large grid are in contact, the finer grids are solved on lists of cells, with the
  pressures as unknowns (`app.methods.free.dilute`).
- *Safeguard.* If the iteration makes no progress, `app.methods.safeguard` continues with the pressures as unknowns.

`app.contact.full_contact` tests for full contact before these stages if it is likely, or after them if no cell is free.

The contact set is the paper's. In the test (5.1), the root mean square gap over C is compared with the deviation of h
from its mean, not with h. So the limit depends neither on the approach nor on the share of contact.
"""
