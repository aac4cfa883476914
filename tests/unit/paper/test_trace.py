"""Records of active set iterations."""

from types import SimpleNamespace

import numpy as np

from app.paper.trace import Recorder, collect_contact, collect_errors, traced
from app.paper.trace import collect_cycles as cycles


def test_errors_are_over_the_last_contact_set():
    """They are root mean squares, before the first iteration and after each; other cells do not count."""
    recorder = Recorder()
    recorder.contact = [np.array([[1, 1, 1]]), np.array([[1, 1, 0]])]
    recorder.pressure = [np.array([[0.0, 0.0, 9.0]]), np.array([[3.0, 1.0, 0.0]])]
    solution = SimpleNamespace(x=np.arange(3.0), y=np.zeros(1), undeformed_distance=np.zeros((1, 3)))
    exact = SimpleNamespace(pressure=lambda x, y: np.array([[3.0, 4.0, 0.0]]))
    errors = collect_errors(recorder, solution, exact)["errors"]
    np.testing.assert_allclose(errors, np.sqrt([12.5, 4.5]), rtol=1e-14)
    fields = collect_contact(recorder, solution, exact)
    assert (fields["first"].tolist(), fields["last"].tolist()) == ([[1, 1, 1]], [[1, 1, 0]])


def test_norms_are_those_of_the_last_linear_solve():
    recorder = Recorder()
    for iteration, norm in enumerate((1.0, 0.2)):
        recorder.monitor(None, 0, 5.0) if iteration == 0 else None
        recorder.monitor(None, iteration, norm)
    assert cycles(recorder, None, None) == {"linear_residuals": [1.0, 0.2]}


def test_outcome_says_whether_a_solve_converged():
    for most, status in ((None, 0), (1, 3)):
        options = {"lcp_max_it": most} if most else {}
        assert traced("hertz", "norm", 16, collect_errors, **options)()["exit_status"] == status
