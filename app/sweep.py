"""Run a parameter study: ``python -m app.sweep``, see `app.cli.sweep`."""

import sys

from app.cli.sweep import main

if __name__ == "__main__":
    sys.exit(main())
