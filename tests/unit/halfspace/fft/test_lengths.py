"""Lengths of fast transforms."""

from app.halfspace.fft.lengths import transform_length


def test_transform_length_is_even_and_avoids_wraparound():
    for n in [*range(1, 70), 127, 1000, 1024]:
        period = transform_length(n)
        assert 2 * n - 1 <= period <= 1.34 * 2 * n + 1
        assert period % 2 == 0
