"""When an iteration may stop: the paper's test (5.1) and the limit on iterations."""

from __future__ import annotations

from dataclasses import dataclass, replace

ROUNDING_RESIDUAL = 1e-13  # of ||h|| on C: what it leaves of displacements there
BELOW_ROUNDING = "rounding leaves a larger residual than -lcp_rtol allows: choose a larger one"


@dataclass(frozen=True)
class StoppingTest:
    """Accuracy of Sec. 4.1, step 6, and the limit of iterations on one grid."""

    rtol: float = 1e-6
    max_it: int = 100
    final: bool = True  # on the target grid

    def allowed(self, state):
        """Norm of the residual that solves the problem, rtol ||h|| over the admissible cells [mm]. Not collective."""
        return self.rtol * state.distance.norm()

    def __call__(self, state, residual):
        """(5.1): ||r||_rms / ||h||_rms <= rtol, for the norm of r on C [mm]. As collective as `allowed`."""
        return residual <= self.allowed(state)

    def tighter(self, factor):
        """Return a test that asks for a residual smaller by a factor. Not collective."""
        return replace(self, rtol=factor * self.rtol)

    def for_coarse_grid(self):
        """On the way to the target grid an unchanged contact area is enough (Sec. 4.3, 3.b). Not collective."""
        return StoppingTest(float("inf"), self.max_it, final=False)
