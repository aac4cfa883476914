"""Stopping test of the default methods."""

from dataclasses import dataclass, replace

from app.contact.certificate import estimate
from app.contact.stopping import ROUNDING_RESIDUAL, StoppingTest

IN_CONTACT = 100.0  # factor on rtol of the test with h on C alone: contact may be small in its patch


@dataclass(frozen=True)
class InexactStop(StoppingTest):
    """Stopping test (5.1), also on contact alone; that of coarser grids.

    Parameters
    ----------
    coarse_rtol : float
        ||r|| / ||h|| on C at which a coarser grid is left.
    predictor : float
        Factor on the predicted change of u by which cells enter C.
    error_bound : float
        Largest proved error of a solved target grid (`app.contact.certificate`).
    defect_correction : float
        Share of the residual that is left to the next product by FFT. Changes of u are multilevel products until
        then; 0: all products are by FFT.
    """

    coarse_rtol: float = 0.0
    predictor: float = 0.0
    error_bound: float = float("inf")
    defect_correction: float = 0.0

    def allowed(self, state, h_on_contact=None):
        """Return the largest norm of r on C that passes [mm].

        Collective, unless ||h|| on C is given [mm]. On the target grid the test is (5.1), and 100 rtol ||h|| on C. On
        coarser grids it is coarse_rtol times the smaller of these ||h||. If h vanishes on C it is rtol ||h||.
        """
        norm = state.distance.norm()
        h_on_contact = state.on_contact(with_h=True).h if h_on_contact is None else h_on_contact
        if not h_on_contact:
            return self.rtol * norm
        if not self.final:
            return max(self.coarse_rtol, ROUNDING_RESIDUAL) * min(norm, h_on_contact)
        return min(self.rtol * norm, max(IN_CONTACT * self.rtol, ROUNDING_RESIDUAL) * h_on_contact)

    def certified(self, state, work=None):
        """Return whether the certificate is within `error_bound`.

        Collective. True on coarse grids, and where a smaller rtol is below rounding. `work`: a field to work in.
        """
        if not self.final or IN_CONTACT * self.rtol <= ROUNDING_RESIDUAL:
            return True
        return estimate(state, self.error_bound, work).error_bound <= self.error_bound

    def is_weak(self, state, h_on_contact):
        """Return whether ||h|| on C [mm] is below 1% of ||h||.

        (5.1) is weak then. The certificate is checked before a verification product then.
        """
        return self.final and IN_CONTACT * h_on_contact < state.distance.norm()

    def for_coarse_grid(self):
        """Return the test of a coarse grid; C may change.

        Step 3.b of Sec. 4.3 requires the opposite.
        """
        return replace(self, final=False)
