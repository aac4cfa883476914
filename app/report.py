"""Write an HTML report of results: ``python -m app.report``, see `app.cli.report`."""

import sys

from app.cli.report import main

if __name__ == "__main__":
    sys.exit(main())
