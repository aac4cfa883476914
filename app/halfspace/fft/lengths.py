"""Lengths of transforms that are quick, and long enough for a product without wrap-around."""

from __future__ import annotations

from functools import lru_cache
from math import ceil

from scipy.fft import next_fast_len


@lru_cache(maxsize=256)
def fast_length(n, even=False):
    """Length of at least n at which a transform and what goes with it take little time. Not collective.

    Per point FFTW needs (without measuring) half the time at powers of two, 0.8 of it at odd multiples of large
    ones; the rest of a product, as much again, does not care. Memory counts too, so that little is not bought dearly.
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
    """Even length >= 2 n - 1 for a product on n cells. Not collective."""
    return fast_length(max(2 * n - 1, 2), even=True)


def lengths_with_margin(shape, margin):
    """Quick lengths of at least a shape and shares of it more, in y and x. Not collective."""
    return tuple(fast_length(n + ceil(share * n)) for n, share in zip(shape, margin, strict=True))
