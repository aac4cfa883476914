"""Multiplication by even functions in Fourier space, distributed: lengths, strips, transpose, multiplier."""
