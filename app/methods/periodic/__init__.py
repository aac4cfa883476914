"""The default method on periodic patches: the active set iteration in its primal form.

Primal as in variational inequalities: the displacement is the unknown. In `app.contact.certificate` that is the dual
side.

There A is diagonal in Fourier space and its inverse B, on fields without mean, is known as well as A. So the
displacement can be the unknown in place of the pressure. With ``w = u - approach``, the gap is ``e = h0 + w``, h0 the
shape, and

    w = -h0  on C,        p = B w + mean pressure = 0  on the free cells O, the others.

This is (2.11) with pressure and gap exchanged, and has three advantages:

- B is nearly local: it decays like 1 / r^3, where A decays like 1 / r. A few sweeps with its 3 x 3 centre, and A on a
  coarser grid for the long waves, held by contact as by springs, do what takes a Fourier transform in the other form
  (`two_grid`, `stencil`).
- B does not see constants: a load, that is a mean pressure, is met at once and needs no search for the approach.
- The closer to full contact, the smaller is the system.

On each grid, from the coarsest to the target (`nested`):

1. *Start.* w and p are interpolated from the coarser grid, by quintics; the coarsest one starts from full contact.
2. *Guess.* Some projected sweeps with the centre of B guess the contact set (`state.PrimalState.guess`).
3. *Sets.* `iteration` solves for w on O a little, by CG that carries p along (`cg`) and multiplies by B nearly
   (`app.methods.multilevel_operators`); then cells with p < 0 are released from C and cells with e < 0
   captured. Where some are
   captured, or levels tell no more, p follows by a product with B; else CG goes on with what it has carried along.
4. *Enough.* A coarse grid is left when few cells change and the residual is small against the deviation of h0 from its
   mean, or the approach beyond first touch, if that is less. The target grid is left when no cell changes, or those
   that do change nothing that matters, by one product A p in double precision; it and the certificate decide.
5. *Approach.* A prescribed approach prescribes the mean of w: directions of CG have no mean, and the mean pressure is
   the Lagrange multiplier.
6. *Safeguard.* Where it makes no progress, that of `app.methods.free` takes over, in terms of pressures.

Full contact is tried before all that, where it is likely, else where no cell is free afterwards:
`app.contact.full_contact`.

The contact set is that of the paper, so is the acceptance (5.1), with the deviation of h from its mean for ||h|| and
counted over C: it does not depend on the approach, nor on how much of the patch is in contact.
"""
