"""The stopping test (5.1), and iteration limits."""

from dataclasses import dataclass, replace

ROUNDING_RESIDUAL = 1e-13  # residual that rounding of displacements leaves, over ||h|| on C
BELOW_ROUNDING = "rounding leaves a larger residual than -lcp_rtol allows: choose a larger one"


@dataclass(frozen=True)
class StoppingTest:
    """Stopping test (5.1), step 6 of Sec. 4.1, and limit of iterations."""

    rtol: float = 1e-6
    max_it: int = 100
    final: bool = True  # True on the target grid

    def allowed(self, state):
        """Return the allowed residual norm, rtol ||h|| [mm]."""
        return self.rtol * state.h_norm

    def __call__(self, state, residual):
        """Return whether a residual ||r||_2 [mm] is at most rtol ||h||_2."""
        return residual <= self.allowed(state)  # (5.1)

    def tighter(self, factor):
        """Return a test with rtol multiplied by a factor."""
        return replace(self, rtol=factor * self.rtol)

    def for_coarse_grid(self):
        """Return the coarser grids' test, which accepts any residual.

        Step 3.b of Sec. 4.3 only requires that the contact area does not change.
        """
        return StoppingTest(float("inf"), self.max_it, final=False)
