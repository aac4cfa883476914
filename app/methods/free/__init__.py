"""Default method on free patches.

The method is an active set method inside a nested iteration. The linear systems are solved inexactly by CG with an FFT
preconditioner.

On each grid, from the coarsest to the target (`nested`), it has these stages:

- *Start.* Pressure and contact set come from the coarser grid by `lift`. The grid is solved in a window around contact
  (`windows`). The coarsest grid is solved directly.
- *Contact sets.* `iteration` repeats the steps of Sec. 4.1. For each contact set, the system is solved roughly by
  conjugate gradients that start from the known displacement (`tracking_cg`). The preconditioner is the inverse of A
  continued periodically (`circulant`), applied to the residual extended past the contact edge (`contact_edge`) and
  between contact spots (`block_average`). For stiff layers it is also extended past the patch boundary
  (`padded_inverse`). The preconditioner and the changes of u are multilevel products
  (`app.methods.multilevel_operators`). After some contact sets a product by FFT corrects their error. The predictor
  adds cells to C by the predicted displacement.
- *Stop.* A coarse grid is left as soon as its residual is small compared with h on C. On the target grid, one product
  in double precision on all cells decides (5.1), and the certificate is tested. For a window all ranks compute this
  product (`verification_product`).
- *Load.* If the load is prescribed, the approach changes in each iteration (`app.contact.prescribed_load`). If moments
  are, too, the tilt also changes (`app.contact.tilted_load`).
- *Dilute contact.* If few cells of a large grid are in contact, the finer grids are solved on lists of cells
  (`app.methods.free.dilute`).
- *Compliance of each cell.* If the surface compliance varies, this method also solves on periodic patches, where the
  displacement cannot be the unknown. `circulant` divides the residual between bodies and springs, and pressures are
  copied from the coarser grid.
- *Safeguard.* If the residual stagnates, or is small without satisfying the certificate, `app.methods.safeguard`
  continues; it is slower, but convergence is proved.

Terms:

- *Defect correction.* Repeated solution with a nearby operator, here multilevel A (multilevel multi-summation of the
  lowest order), for the true residual, which costs a product by FFT.
- *Updated displacement.* u is changed together with p, so the test which cells penetrate costs no product.
- *Lift.* Prolongation of the pressure by the displacement. Pressures have infinite slopes at the contact edge, so they
  are interpolated badly, but displacements well. B computes the pressure from the displacement (Dirichlet to Neumann).
- *Edge extension.* The inverse of A on C is a Schur complement of the inverse on all cells, which the preconditioner
  applies. Extending the residual over some cells around C approximates this complement.
- *Forcing term.* Factor by which the residual of a contact set is reduced, as in inexact Newton methods.
- *Predictor.* Estimate of u for a zero residual on C, by the same extension. Cells without a gap for this u enter C.
  With plastic cells the estimate includes the trend of the residual over the patch (`residual_trend`).
- *Tension.* The negative part of p, removed by step 4.a of Sec. 4.1.
- *Rehearsal.* Steps 4 to 6 of Sec. 4.1 with the updated u, before the *verification product* in double precision on all
  cells.
- *Window.* A rectangle around contact. Outside p = 0, and only the verification product shows penetration there.

The table has the gain of each technique: operator applications if the technique is switched off by the option. The
numbers are geometric means over 17 solves with a prescribed approach at 512 x 512 cells (Hertz, rough punches,
self-affine surfaces from 1% to 99% contact). docs/notebook/performance.md also has the numbers for prescribed loads,
and the effect of each constant.

===================  =========================  ===============================================================
technique            off by                     applications without it, of 8.4 with all
===================  =========================  ===============================================================
defect correction    -lcp_defect_correction 0   16.3
lift                 -lcp_prolongation copy     10.3
predictor            -lcp_predictor 0           9.0
block means          -pc_circulant_blocks 0     9.9; most where contact is scattered
edge extension       -pc_circulant_extend 0     12.0, with the two techniques above switched off, too
loose coarse grids   -lcp_coarse_rtol 1e-6      9.5
windows              -lcp_window 0              9.0; most where contact is small in its patch
single precision     -lcp_precision double      8.4; half the time of a product
===================  =========================  ===============================================================
"""
