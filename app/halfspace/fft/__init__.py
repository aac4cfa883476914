"""Convolutions with even kernels by FFT, distributed over ranks."""
