"""Lengths at which Fourier transforms are fast."""

from functools import lru_cache

from scipy.fft import next_fast_len


@lru_cache(maxsize=256)
def fast_length(n, even=False):
    """Return a length of at least n at which products are fast.

    The length has the least estimated cost of all lengths, or of all even lengths if `even` is true. Estimated cost:
    with FFTW's estimated plans, a transform at a power of two takes half of the usual time per point, and a transform
    at a multiple of 64 takes 0.8 of it. The rest of a product takes as long as its transforms at a power of two. The
    cost also grows with the memory.
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
    """Return a fast even length to convolve n cells.

    The length is at least 2 n - 1, so that the periodic convolution does not wrap around.
    """
    return fast_length(max(2 * n - 1, 2), even=True)
