"""When the default methods stop: (5.1), on contact alone, too, and the certificate."""

from __future__ import annotations

from dataclasses import dataclass, replace

from app.contact.certificate import estimate
from app.contact.stopping import ROUNDING_RESIDUAL, StoppingTest

# (5.1) holds with h on C alone and so many times rtol, too: contact may be small in its patch.
IN_CONTACT = 100.0


@dataclass(frozen=True)
class InexactStop(StoppingTest):
    """(5.1), also with h on C alone; and what is enough on coarser grids.

    Parameters
    ----------
    coarse_rtol : float
        ||r|| / ||h|| on C that is enough on coarser grids.
    predictor : float
        Factor on the expected change of u in (4.b).
    error_bound : float
        Proved error up to which the target grid counts as solved (`app.contact.certificate`).
    defect_correction : float
        Changes of u are multiplied by levels until so much is left of the residual that a product has told; 0: by FFT.
    """

    coarse_rtol: float = 0.0
    predictor: float = 0.0
    error_bound: float = float("inf")
    defect_correction: float = 0.0

    def allowed(self, state, h_on_contact=None):
        """Largest norm of r on C that passes [mm]. Collective, unless ||h|| on C is given [mm].

        On the target grid (5.1), and 100 rtol ||h|| on C; on coarser ones coarse_rtol times the smaller of these ||h||;
        where h vanishes on C, rtol ||h|| on any grid.
        """
        whole = state.distance.norm()
        h_on_contact = state.on_contact(with_h=True).h if h_on_contact is None else h_on_contact
        if not h_on_contact:
            return self.rtol * whole
        if not self.final:
            return max(self.coarse_rtol, ROUNDING_RESIDUAL) * min(whole, h_on_contact)
        return min(self.rtol * whole, max(IN_CONTACT * self.rtol, ROUNDING_RESIDUAL) * h_on_contact)

    def certified(self, state, work=None):
        """Return whether the certificate, computed with the u there is, is within `error_bound`. Collective.

        Always true on coarse grids, and where a smaller rtol would be rounding. `work`: a field to work in.
        """
        if not self.final or IN_CONTACT * self.rtol <= ROUNDING_RESIDUAL:
            return True
        return estimate(state, self.error_bound, work).error_bound <= self.error_bound

    def says_little(self, state, h_on_contact):
        """Whether (5.1) says little here, because ||h|| on C [mm] is below 1% of ||h||. Not collective.

        Then the certificate is asked before the verification product is spent.
        """
        return self.final and IN_CONTACT * h_on_contact < state.distance.norm()

    def for_coarse_grid(self):
        """On the way to the target grid coarse_rtol is enough, and the contact set may change. Not collective.

        Sec. 4.3, 3.b asks for the opposite.
        """
        return replace(self, final=False)
