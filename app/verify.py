"""Verify the program: ``python -m app.verify``, see `app.verification.verify`."""

import sys

from app.verification.verify import main

if __name__ == "__main__":
    sys.exit(main())
