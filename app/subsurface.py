"""Compute the stress below a result: ``python -m app.subsurface``, see `app.cli.subsurface`."""

import sys

from app.cli.subsurface import main, stress

__all__ = ["main", "stress"]

if __name__ == "__main__":
    sys.exit(main())
