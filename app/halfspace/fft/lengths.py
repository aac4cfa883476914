"""Lengths of fast transforms."""

from functools import lru_cache

from scipy.fft import next_fast_len


@lru_cache(maxsize=256)
def fast_length(n, even=False):
    """Return a length >= n at which a product is fast.

    Per point, FFTW's estimated plans take half the time at powers of two, and 0.8 of it at odd multiples of large
    powers. The rest of a product takes as long again at any length. Memory has a cost, too.
    """

    def cost(length):
        twos = length & -length
        relative = 1.0 if twos == length else 1.6 if twos >= 64 else 2.0
        return length**1.5 * (1 + relative)

    lengths, length = [], next_fast_len(n, real=True)
    while not lengths or length < 1.5 * n:
        if length % 2 == 0 or not even:
            lengths.append(length)
        length = next_fast_len(length + 1, real=True)
    return min(lengths, key=cost)


def transform_length(n):
    """Return a fast even length >= 2 n - 1."""
    return fast_length(max(2 * n - 1, 2), even=True)
