"""The stopping test (5.1)."""

from types import SimpleNamespace

from app.contact.stopping import StoppingTest

STATE = SimpleNamespace(h_norm=4.0)


def test_residual_is_allowed_up_to_rtol_of_the_undeformed_distance():
    stop = StoppingTest(1e-3)
    assert stop(STATE, 4e-3) and not stop(STATE, 4.01e-3)
    assert not stop.tighter(0.5)(STATE, 4e-3)


def test_any_residual_is_allowed_on_coarse_grids():
    coarse = StoppingTest(1e-3, max_it=7).for_coarse_grid()
    assert coarse(STATE, 1e9) and coarse.max_it == 7 and not coarse.final
