"""Zero of a monotone function with plateaus, as the load of plastic contact."""

import numpy as np
import pytest

from app.contact.plastic_load import _MAX_TRIALS, _zero


@pytest.mark.parametrize("target", [1e-6, 0.3, 7.5, 19.0, 19.9999])
@pytest.mark.parametrize("spread", [0.0, 0.1, 10.0, 1e4])
def test_zero_of_a_sum_of_clipped_lines(spread, target):
    """Between and outside the cells' ranges the slope is zero."""
    gaps, trials = spread * np.random.default_rng(1).normal(size=20), []

    def function(t):
        trials.append(t)
        values = t - gaps
        return np.clip(values, 0, 1).sum() - target, ((values > 0) & (values < 1)).sum()

    t = _zero(function, *function(0.0), 1.0, 1e-3 * target)
    assert abs(function(t)[0]) <= 1e-3 * target
    assert len(trials) < _MAX_TRIALS
