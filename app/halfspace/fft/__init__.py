"""Multiplication by even functions in Fourier space, distributed over ranks."""
