"""Draw results: ``python -m app.plot``, see `app.cli.plot`."""

import sys

from app.cli.plot import main

if __name__ == "__main__":
    sys.exit(main())
