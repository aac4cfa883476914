"""Where option files of the first edition find the FFT preconditioner; it lives in `app.fast.circulant`."""

from app.fast.circulant import Circulant

__all__ = ["Circulant"]
