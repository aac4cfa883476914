"""Lengths at which Fourier transforms are fast."""

from functools import lru_cache

from scipy.fft import next_fast_len


@lru_cache(maxsize=256)
def fast_length(n, even=False):
    """Return a length of at least n at which products are fast.

    Of all lengths, or of all even lengths if `even` is true, the result has the least estimated cost. The cost of a
    length N is N^1.5 (1 + t). The term 1 stands for the work of a product without its transforms. The term t stands for
    the transforms by FFTW's estimated plans: t is 1 for powers of two, 1.6 for other multiples of 64, and 2 for all
    other lengths. The exponent is above 1 because the cost also grows with the memory.
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
    """Return a fast even length of at least 2 n - 1."""
    return fast_length(max(2 * n - 1, 2), even=True)
