"""Linear solver of the primal form."""

import periodic
import pytest

from app import ContactSolver, InputError


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"ksp_type": "cg"}, "-ksp_type: .*CarryingCG"),
        ({"pc_type": "none"}, "-pc_type: .*TwoGrid"),
        ({"pc_python_type": "app.methods.free.circulant.Circulant"}, "TwoGrid"),
        ({"ksp_norm_type": "unpreconditioned"}, "-ksp_norm_type: .*preconditioned"),
        ({"pc_two_grid_sweeps": 0}, "-pc_two_grid_sweeps 0: allowed: 1 to 50"),
        ({"pc_two_grid_sweeps": 51}, "-pc_two_grid_sweeps 51: allowed: 1 to 50"),
    ],
)
def test_other_solvers_raise(options, match):
    with pytest.raises(InputError, match=match) as refusal:
        ContactSolver(periodic.rough(16, 12, 1), "primal", options)
    assert "\n" not in str(refusal.value)
