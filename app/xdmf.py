"""Describe results for ParaView: ``python -m app.xdmf``, see `app.cli.xdmf`."""

import sys

from app.cli.xdmf import main

if __name__ == "__main__":
    sys.exit(main())
