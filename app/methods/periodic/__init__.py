"""Default method on periodic patches, in primal form.

In the primal form of a variational inequality the displacement is the unknown. (In `app.contact.certificate` that is
the dual side.) On a periodic patch A is diagonal in Fourier space. So its inverse B, on fields without mean, costs as
much as A, and the displacement can be the unknown in place of the pressure. With ``w = u - approach`` and the shape h0
the gap is ``e = h0 + w``, and

    w = -h0  on C,        p = B w + mean pressure = 0  on the free cells O, the others.

This is (2.11) with pressure and gap exchanged, and has three advantages:

- B is nearly local: it decays like 1 / r^3, A like 1 / r. A few sweeps with the 3 x 3 centre of B, and A on a coarser
  grid for long waves, with contact as springs, replace a Fourier transform (`two_grid`, `stencil`).
- B maps constants to zero: a load, that is a mean pressure, is met at once and needs no search for the approach.
- The system becomes smaller towards full contact.

On each grid, from the coarsest to the target (`nested`), it has these stages:

- *Start.* w and p are interpolated from the coarser grid, by quintics; the coarsest one starts from full contact.
- *Guess.* Some projected sweeps with the centre of B guess the contact set (`state.PrimalState.guess`).
- *Sets.* `iteration` solves for w on O a little, by CG that updates p (`cg`) with multilevel products
  (`app.methods.multilevel_operators`). Then cells with p < 0 are released from C and cells with e < 0 captured. If
  some are captured, or the error of the multilevel products is reached, p is recomputed by FFT.
- *Stop.* A coarse grid is left when few cells change and the residual is small against the deviation of h0 from its
  mean, or against the approach beyond first touch if that is less. The target grid is left when no cell changes, or
  the changes are negligible. One product A p in double precision and the certificate decide.
- *Approach.* A prescribed approach prescribes the mean of w: directions of CG have no mean, and the mean pressure is
  the Lagrange multiplier.
- *Hardness.* Plastic cells are free cells, too: there p must be H in place of 0, which only changes the right-hand side
  (`capped_state`).
- *Safeguard.* If the iteration makes no progress, `app.methods.safeguard` continues with the pressures as unknowns.

`app.contact.full_contact` tests for full contact before these stages if it is likely, otherwise after them if no cell
is free.

The contact set is that of the paper. So is the test (5.1), except that the root mean square gap over C is compared with
the deviation of h from its mean. This limit depends neither on the approach nor on the share of contact.
"""
