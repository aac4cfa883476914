"""Packages of the comparison, and how to install each in its own environment."""

import json
import os
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path

from benchmarks.peers.processes import capture, reason, say

ADAPTERS = Path(__file__).with_name("adapters")


@dataclass(frozen=True)
class Peer:
    """Package: how to install it, and its features beyond the table of times."""

    requirement: str
    about: str
    pythons: tuple[str, ...] = ()  # versions that have wheels for its dependencies; () for any
    first: str = ""  # to be installed before, for the build or the adapter
    build: tuple[tuple[str, str], ...] = ()  # environment variables of the build
    periodic: bool = True  # whether it takes part on periodic patches
    hardness: bool = False  # whether it takes part with a hardness
    layer: bool = False  # whether it takes part with a layer on a rigid base
    dilute: bool = False  # whether it takes part with dilute contact
    executable: str = ""  # environment variable: path of a program that is built apart, not installed here


PEERS = {
    "aspher": Peer(
        "aspher==0.1.3.post1",
        "Load only; square patches of square cells; contact everywhere. Also periodic contact, friction, and an FMM "
        "product with very little memory per cell. It is built for the instructions of this processor, with Eigen from "
        "PyPI.",
        first="cmeel-eigen",  # headers that the build would otherwise fetch from elsewhere
        build=(("CMAKE_PREFIX_PATH", "{site}/cmeel.prefix"), ("CMAKE_ARGS", "-DASPHER_NATIVE=ON")),
        dilute=True,
    ),
    "slippy": Peer(
        "slippy==0.5.2",
        "Approach and load; contact everywhere. Also lubrication, wear, plastic limits, GPUs. Needs "
        "numpy < 1.21, so Python 3.9 at most.",
        pythons=("3.9", "3.8"),
        periodic=False,
    ),
    "tamaas": Peer(
        "tamaas==2.9.0",
        "Load only (its other control is the mean gap); contact everywhere. Periodic at heart: the free half-space is "
        "its operator `dcfft`. Also adhesion, friction, plasticity, a hardness limit, MPI.",
        first="scipy",  # for the unit of times
        hardness=True,
    ),
    "contactmechanics": Peer(
        "ContactMechanics==1.8.3",
        "Approach and load; cells where contact is impossible can be masked in its constrained CG. Also periodic "
        "contact, adhesion (in a sister package), a hardness limit, layers on a rigid base, MPI.",
        hardness=True,
        layer=True,
    ),
    "contact": Peer(
        "CONTACT",
        "Approach and load; contact everywhere. Made for rolling and sliding contact with friction, above all of wheel "
        "and rail. A program: built as peer-contact.md describes, timed by its own timers.",
        periodic=False,
        executable="CONTACT_EXE",
    ),
}


class Unavailable(Exception):
    """A package that cannot be installed here; the message is pip's."""


def install(name, folder):
    """Return the Python of a package's environment, made if need be.

    Raises
    ------
    Unavailable
        With the line in which pip says why, or if the path of a program is not set.
    """
    peer = PEERS[name]
    if peer.executable:
        path = Path(os.environ.get(peer.executable, ""))
        if not (path.is_absolute() and shutil.which(path)):
            raise Unavailable(f"{peer.executable} must be the absolute path of its executable")
        return sys.executable
    home = folder / name
    python, stamp = home / "bin" / "python", home / "installed.txt"
    recipe = repr((peer.requirement, peer.pythons, peer.first, peer.build))
    if stamp.exists() and stamp.read_text() == recipe:
        return python
    shutil.rmtree(home, ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ".gitignore").write_text("*\n")
    say(f"installing {peer.requirement} in {home}")
    made = capture([find_python(peer.pythons), "-m", "venv", home])
    if made.returncode:
        raise Unavailable(reason(made))
    site = capture([python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]).stdout.strip()
    environment = dict(os.environ) | {key: value.format(site=site) for key, value in peer.build}
    pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    for requirement in filter(None, (peer.first, peer.requirement)):
        done = capture([*pip, requirement], env=environment)
        if done.returncode:
            shutil.rmtree(home)
            raise Unavailable(reason(done))
    stamp.write_text(recipe)
    return python


def find_python(versions):
    """Return an interpreter of one of these versions that can make environments."""
    if not versions:
        return "/usr/bin/python3"
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for version in versions:
        for candidate in (f"python{version}", *pyenv.glob(f"{version}.*/bin/python")):
            path = shutil.which(candidate)
            if path and capture([path, "-c", "import ensurepip, venv"]).returncode == 0:
                return path
    raise Unavailable(f"needs Python {' or '.join(versions)}, which is not on this machine")


def set_up(name, folder):
    """Environment and description of a package, or why there is none."""
    try:
        python = install(name, folder)
        command = [python, ADAPTERS / f"{name}_adapter.py", "describe"]
        done = capture(command)
        if done.returncode:
            raise Unavailable(reason(done))
    except Unavailable as failure:
        say(f"{name} is not available: {failure}")
        return {"failure": str(failure), "square": False}
    return {"python": python, **json.loads(done.stdout.strip().splitlines()[-1])}
