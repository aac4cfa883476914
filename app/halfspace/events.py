"""Events for -log_view in modules that work without PETSc; `operator` replaces them."""

from contextlib import nullcontext

alltoall = coeffs = spectra = nullcontext()
