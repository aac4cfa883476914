"""What an installed package puts on PATH: ``contact-solve`` is ``python -m app.solve``, and so on."""

import runpy
import sys
from pathlib import Path


def main():
    """Run the command by whose name this was called. Does not return."""
    command = Path(sys.argv[0]).stem.removeprefix("contact-")
    runpy.run_module(f"app.{command}", run_name="__main__", alter_sys=True)
