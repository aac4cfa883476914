"""Stopping test of the default methods."""

from dataclasses import dataclass, field, replace

from app.contact.certificate import estimate
from app.contact.stopping import ROUNDING_RESIDUAL, StoppingTest
from app.options.method import Settings

UNPROVED = "the certificate fails however small the residual"
IN_CONTACT = 100.0  # factor on rtol of the test with h on C alone: contact may be small in its patch


@dataclass(frozen=True)
class InexactStop(StoppingTest):
    """Stopping test of the target and coarser grids, and all other settings of the iteration.

    On the target grid the test is (5.1), ||r|| <= rtol ||h|| for the residual r, and a second limit from ||h|| on the
    contact set C alone.

    Parameters
    ----------
    settings : Settings
        Options of the method. Iterations read them here.
    """

    settings: Settings = field(default_factory=Settings)

    @classmethod
    def of(cls, settings):
        """Return the test that the settings choose."""
        return cls(settings.rtol, settings.max_it, settings=settings)

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
        norm = state.h_norm
        h_on_contact = state.on_contact(with_h=True).h if h_on_contact is None else h_on_contact
        if not h_on_contact:
            return self.rtol * norm
        if not self.final:
            coarse_rtol = self.settings.coarse_rtol / state.operator.kernel.contrast(state.grid)
            return max(coarse_rtol, ROUNDING_RESIDUAL) * min(norm, h_on_contact)
        return min(self.rtol * norm, max(IN_CONTACT * self.rtol, ROUNDING_RESIDUAL) * h_on_contact)

    @property
    def at_rounding(self):
        """True if rtol is so small that rounding limits the error."""
        return IN_CONTACT * self.rtol <= ROUNDING_RESIDUAL

    def certified(self, state, work=None):
        """Return whether the certificate proves an error of at most -lcp_error_bound.

        Collective. On coarse grids nothing is tested, and the result is true; also if rtol is so small that rounding
        limits the error. `work` is an array that may be overwritten.
        """
        if not self.final or self.at_rounding:
            return True
        wanted = self.settings.error_bound
        return estimate(state, wanted, work).error_bound <= wanted

    def is_weak(self, state, h_on_contact):
        """Return whether the test (5.1) is weak because contact is small.

        It is weak if `h_on_contact` is below 1% of the norm of the undeformed distance on all cells. `h_on_contact` is
        the norm on the contact cells [mm].
        """
        return self.final and IN_CONTACT * h_on_contact < state.h_norm

    def for_coarse_grid(self):
        """Return the test of coarser grids, where contact may still change.

        Step 3.b of Sec. 4.3 of the paper instead requires an unchanged contact set.
        """
        return replace(self, final=False)
