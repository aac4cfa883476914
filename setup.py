"""What pyproject.toml cannot say.

The option files, which stand beside app/, are installed inside of it. And ``pip install .`` ends in one line if this
Python has no petsc4py: pip would install a program that cannot run.
"""

import os
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).resolve().parent
FIND = "exec(open('app/base/petsc_path.py').read(), {}); import petsc4py"
WAYS = (
    "this Python has no petsc4py, which pip would have to compile. Two ways work: pip install '.[wheels]' (Linux on "
    "x86-64, Python 3.12 or newer); or apt-get install python3-petsc4py-real python3-h5py python3-h5py-mpi "
    "openmpi-bin, and pip install . in a venv made with --system-site-packages. See docs/install.md for other systems"
)


def check_petsc4py():
    """Exit if pip installs this folder without petsc4py. A wheel can be built without it."""
    try:
        process = Path("/proc", str(os.getppid()))  # pip
        words = process.joinpath("cmdline").read_text().split("\0")
        folder, entries = (
            process.joinpath("cwd").resolve(),
            process.joinpath("environ").read_text().split("\0"),
        )
    except (OSError, ValueError):  # a system without /proc
        return
    start = words.index("install") if "install" in words else 0
    if not any(Path(word).name.startswith("pip") for word in words[:start]):
        return
    words = words[start + 1 :]
    brings_petsc = any("petsc" in word or "dolfinx" in word for word in words) or "--no-deps" in words
    if brings_petsc or not any(folder.joinpath(word).resolve() == SOURCE for word in words if word):
        return  # another requirement, such as .[wheels]
    # pip hides the packages of this Python from the build, but not from a process with pip's own environment.
    environment = dict(entry.partition("=")[::2] for entry in entries if entry)
    found = subprocess.run([sys.executable, "-c", FIND], cwd=SOURCE, env=environment, capture_output=True)
    if found.returncode:
        sys.exit(f"error: {WAYS}")


check_petsc4py()

from setuptools import find_packages, setup  # noqa: E402

setup(
    packages=[*find_packages(include=["app", "app.*"]), "app.petsc_options"],
    package_dir={"app.petsc_options": "petsc_options"},
)
