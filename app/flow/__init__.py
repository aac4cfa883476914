"""Flow of a fluid through the gap between two bodies, with proved bounds.

Reynolds' equation for an incompressible fluid is div(g^3 grad P) = 0 in the open cells, where g is the gap and P the
fluid pressure. No fluid flows into cells in contact, and into inadmissible cells, whose gap is unknown. The pressure
drops by one across the patch, along x or along y:

- Where the patch does not repeat in this direction, P = 1 on its first side and P = 0 on its last.
- Where the patch repeats, P has a mean gradient: P drops by one from each period to the next.

No fluid flows through the other two sides, unless the patch repeats there, too.

P is constant in a cell. Two neighbouring cells are in series, so the conductance k of their face is a harmonic mean,
and the flux through the face is k times the drop of P. Cells at a side with given pressure have half a cell to it. Then
the flow rate K for a drop of one has bounds from both sides, by the principles of Dirichlet and of Thomson [1]_:

- K is at most the energy, the sum of k drop^2, of any P with the given drop.
- K is at least F^2 / sum(flux^2 / k) of any flux that enters no cell without leaving it, and flows at the rate F.

A linear solve gives P. Its fluxes do not quite conserve fluid. `conserving_flux` repairs them, so both bounds hold for
any accuracy of the linear solve.

.. [1] P. G. Doyle, J. L. Snell, Random walks and electric networks, MAA 1984, sections 1.3.5 and 1.4.
"""
