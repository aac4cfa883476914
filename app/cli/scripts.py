"""Installed commands' entry point: ``contact-solve`` is ``python -m app.solve``."""

import runpy
import sys
from pathlib import Path


def main():
    """Run the command named by ``sys.argv[0]``."""
    command = Path(sys.argv[0]).stem.removeprefix("contact-")
    runpy.run_module(f"app.{command}", run_name="__main__", alter_sys=True)
