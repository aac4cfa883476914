"""Compute a contact law: ``python -m app.law``, see `app.cli.law`."""

import sys

from app.cli import law, session
from app.cli.law import main

if __name__ == "__main__":
    words = ["-output" if word == "-o" else word for word in sys.argv]
    if words[1:] and set(words[1:]) <= {"-h", "-help", "--help"}:
        law.print_help()
        sys.exit(0)
    session.run(main, words)
