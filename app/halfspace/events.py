"""Placeholders of PETSc's -log_view events, for modules that work without PETSc.

`app.halfspace.operator` replaces them by events of PETSc.
"""

from contextlib import nullcontext

alltoall = coeffs = spectra = nullcontext()
