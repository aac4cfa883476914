"""Reproduce the paper's tables and figures: ``python -m app.reproduce``, see `app.paper.reproduce`."""

import sys

from app.paper.reproduce import main

if __name__ == "__main__":
    sys.exit(main())
