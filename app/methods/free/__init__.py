"""The default method, beyond the paper: FFT-preconditioned inexact active sets inside a nested iteration.

On each grid, from the coarsest to the target (`nested`):

1. *Start.* Pressure and contact set come from the coarser grid by `lift`; the grid is worked on in a window around
   contact (`windows`). The coarsest grid is solved directly.
2. *Sets.* `iteration` repeats the steps of Sec. 4.1, each set solved a little by conjugate gradients that start from
   the displacement there is (`tracking_cg`). Preconditioner is the inverse of A, continued periodically (`circulant`),
   of the residual continued over the rim of contact (`rim`) and from one contact to the next (`between`). What
   corrections of p do to u is computed by stencils on several grids, and so is the preconditioner (`levels`); after
   some sets a product corrects what they leave. The predictor lets cells in by the displacement to come.
3. *Enough.* A coarse grid is left as soon as its residual is small against h on C. The target grid is left by one
   product in double precision on all cells; it decides (5.1), and with it the certificate must hold. For a window
   all ranks make it (`verification_product`).
4. *Load.* A prescribed load moves the approach along the way (`app.contact.prescribed_load`).
5. *Safeguard.* Where the residual stagnates, `safeguard` takes over: slower, with a proof of convergence.

Words of this room, and what the field calls it:

- *Defect correction.* To solve by an operator that is nearly A, again and again, for what the true residual still is.
  Here the cheap one is A by levels, multilevel multi-summation of the lowest order, and true residuals cost a product.
- *Carried.* A displacement that has followed p by the changes of p, not computed anew: it costs no product to ask
  which cells penetrate.
- *Lift.* Prolongation of the pressure by way of the displacement. Pressures have infinite slopes at the rim of contact
  and interpolate badly, displacements well; B, from displacement to pressure (Dirichlet to Neumann), leads back.
- *Rim extension.* The inverse of A on C is a Schur complement of that on all cells, which is what the preconditioner
  has; to continue the residual over some cells around C makes one of the other, approximately.
- *Forcing term.* By how much the residual of a contact set is to become smaller, as in inexact Newton methods.
- *Predictor.* What u will be where the residual of C is gone, by the same continuation: cells enter C by it.
- *Tension.* The negative part of p, that step 4.a takes away.
- *Rehearsal.* Steps 4 to 6 by the u that was carried along. Only what passes is worth the *verification product*, which
  is in double precision and on all cells.
- *Window.* A rectangle around contact, with p = 0 outside: the iteration does not look there, the verification does.

What each device gains, switched off by the option named: geometric means over 17 solves at 512 x 512 (Hertz, rough
punches, self-affine surfaces from 1% to 99% contact), operator applications by approach, and what it is good for
beyond counts. docs/notebook/performance.md has them by load, too, and what happens if a constant is halved or doubled.

===================  =========================  ===============================================================
device               off by                     applications without it, of 8.4 with all
===================  =========================  ===============================================================
defect correction    -lcp_defect_correction 0   16.3
lift                 -lcp_prolongation copy     10.3
predictor            -lcp_predictor 0           9.0
between contacts     -pc_circulant_blocks 0     9.9; most where contact is scattered
rim extension        -pc_circulant_extend 0     12.0, with the two devices above switched off, too
loose coarse grids   -lcp_coarse_rtol 1e-6      9.5
windows              -lcp_window 0              9.0; most where contact is small in its patch
single precision     -lcp_precision double      8.4; half the time of a product
===================  =========================  ===============================================================
"""
