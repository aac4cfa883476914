"""app.solve with something wrong on some ranks: ``python tests/troubled.py TROUBLE RANK [arguments of app.solve]``."""

import errno
import json
import os
import runpy
import sys
from pathlib import Path


def full_disk():
    """No space can be taken on any disk."""

    def refuse(*arguments, **named):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    os.posix_fallocate = json.dump = refuse  # of results, and of a journal


def little_memory():
    """The host has a single page."""
    read = Path.read_text

    def read_little(path, *arguments, **named):
        return "MemAvailable: 4 kB\n" if str(path) == "/proc/meminfo" else read(path, *arguments, **named)

    Path.read_text = read_little


if __name__ == "__main__":
    trouble, rank = sys.argv[1:3]
    if os.environ.get("OMPI_COMM_WORLD_RANK", "0") == rank:
        {"full_disk": full_disk, "little_memory": little_memory}[trouble]()
    sys.argv[1:] = sys.argv[3:]
    runpy.run_module("app.solve", run_name="__main__", alter_sys=True)
