"""Records of active set iterations."""

import h5py
import numpy as np

from app.paper.trace import collect_contact, collect_cycles, collect_errors


def test_errors_are_over_the_last_contact_set(tmp_path):
    """They are root mean squares, before the first iteration and after each; other cells do not count."""
    path = tmp_path / "t.h5"
    contact = np.array([[[1, 1, 1]], [[1, 1, 0]]], np.uint8)
    with h5py.File(path, "w") as file:
        file["pressure"] = np.array([[[0.0, 0.0, 9.0]], [[3.0, 1.0, 0.0]]])
        file["exact_pressure"] = np.array([[3.0, 4.0, 0.0]])
        file["contact"], file["admissible"] = contact, np.ones((1, 3), np.uint8)
        file["linear_residuals"] = np.array([1.0, 0.2])
        file["x"], file["y"] = np.arange(3.0), np.zeros(1)
    np.testing.assert_allclose(collect_errors(path)["errors"], np.sqrt([12.5, 4.5]), rtol=1e-14)
    assert collect_cycles(path) == {"linear_residuals": [1.0, 0.2]}
    fields = collect_contact(path)
    assert (fields["first"], fields["last"]) == ([[1, 1, 1]], [[1, 1, 0]])
    assert fields["x"] == [0.0, 1.0, 2.0]
