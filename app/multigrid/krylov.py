"""Where option files of the first edition find the default method's KSP; it lives in `app.fast.tracking_cg`."""

from app.fast.tracking_cg import TrackingCG

__all__ = ["TrackingCG"]
