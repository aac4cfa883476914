"""Compute the stress below the surface: ``python -m app.subsurface``, see `app.cli.subsurface`."""

import sys

from app.api.subsurface import stress
from app.cli.subsurface import main

__all__ = ["main", "stress"]

if __name__ == "__main__":
    sys.exit(main())
