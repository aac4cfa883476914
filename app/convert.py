"""Convert a measured surface: ``python -m app.convert``, see `app.cli.convert`."""

import sys

from app.cli.convert import main

if __name__ == "__main__":
    sys.exit(main())
