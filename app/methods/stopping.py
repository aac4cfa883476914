"""Stopping test of the default methods."""

from dataclasses import dataclass, replace

from app.contact.certificate import estimate
from app.contact.stopping import ROUNDING_RESIDUAL, StoppingTest

UNPROVED = "the certificate fails however small the residual"
IN_CONTACT = 100.0  # factor on rtol of the test with h on C alone: contact may be small in its patch


@dataclass(frozen=True)
class InexactStop(StoppingTest):
    """Stopping test of the target and coarser grids.

    On the target grid the test is (5.1), ||r|| <= rtol ||h|| for the residual r, and a second limit from ||h|| on the
    contact set C alone.

    Parameters
    ----------
    coarse_rtol : float
        Largest ||r|| / ||h|| on C for which a coarser grid is left.
    predictor : float
        Factor on the predicted displacement; cells that overlap by it enter C.
    error_bound : float
        Largest error bound (`app.contact.certificate`) for which the target grid counts as solved.
    defect_correction : float
        The next FFT product follows when multilevel products have reduced the residual to this fraction. If it is 0,
        all products are by FFT.
    """

    coarse_rtol: float = 0.0
    predictor: float = 0.0
    error_bound: float = float("inf")
    defect_correction: float = 0.0

    def allowed(self, state, h_on_contact=None):
        """Return the largest norm of the residual that passes the test [mm].

        Let ||h|| be the norm of the undeformed distance h on all cells, and ||h||_C its norm on the contact set C:

        - If ||h||_C is zero, the limit is rtol ||h||.
        - Else on the target grid, the limit is the smaller of rtol ||h|| and 100 rtol ||h||_C.
        - Else on a coarser grid, the limit is coarse_rtol times the smaller of ||h|| and ||h||_C. For a stiff layer on
          a soft substrate the limit is divided by the contrast of the compliances: h is then mostly the displacement of
          the substrate, and contact is decided by the smaller displacements of short waves.

        The argument `h_on_contact` is ||h||_C [mm]. Collective if it is None, because ||h||_C is then computed.
        """
        norm = state.distance.norm()
        h_on_contact = state.on_contact(with_h=True).h if h_on_contact is None else h_on_contact
        if not h_on_contact:
            return self.rtol * norm
        if not self.final:
            coarse_rtol = self.coarse_rtol / state.operator.kernel.contrast(state.grid)
            return max(coarse_rtol, ROUNDING_RESIDUAL) * min(norm, h_on_contact)
        return min(self.rtol * norm, max(IN_CONTACT * self.rtol, ROUNDING_RESIDUAL) * h_on_contact)

    @property
    def at_rounding(self):
        """True if rtol is so small that rounding limits the error."""
        return IN_CONTACT * self.rtol <= ROUNDING_RESIDUAL

    def certified(self, state, work=None):
        """Return whether the certificate proves an error of at most `error_bound`.

        Collective. On coarse grids nothing is tested, and the result is true; also if rtol is so small that rounding
        limits the error. `work` is an array that may be overwritten.
        """
        if not self.final or self.at_rounding:
            return True
        return estimate(state, self.error_bound, work).error_bound <= self.error_bound

    def is_weak(self, state, h_on_contact):
        """Return whether the test (5.1) is weak because contact is small.

        It is weak if `h_on_contact` is below 1% of the norm of the undeformed distance on all cells. `h_on_contact` is
        the norm on the contact cells [mm].
        """
        return self.final and IN_CONTACT * h_on_contact < state.distance.norm()

    def for_coarse_grid(self):
        """Return the test of coarser grids, where contact may still change.

        Step 3.b of Sec. 4.3 of the paper instead requires an unchanged contact set.
        """
        return replace(self, final=False)
