"""Deprecated import paths of release 0.3.0; use `app.methods.free`.

Option files that were written for release 0.3.0 may contain these paths.
"""

import sys
import warnings
from importlib import import_module

warnings.warn(
    "app.fast is deprecated: use app.methods.free (app.methods.free.tracking_cg.TrackingCG)",
    DeprecationWarning,
    stacklevel=2,
)
for _name in ("tracking_cg", "circulant"):
    sys.modules[f"{__name__}.{_name}"] = import_module(f"app.methods.free.{_name}")
