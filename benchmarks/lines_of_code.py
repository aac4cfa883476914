"""Lines of code of ten tasks, here and in other packages: those of docs/notebook/lines-of-code.md.

``python -m benchmarks.lines_of_code`` runs all scripts of that page, and prints its table and what the scripts print.
The other packages are installed in .venv-peers.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from app import SelfAffineSurface
from app.io.table import format_text
from benchmarks.peers.packages import install

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "notebook" / "lines-of-code.md"
PACKAGES = "This program", "Tamaas", "ContactMechanics"


def read_scripts(text):
    """Return task -> package -> script of a page, in order."""
    tasks = {}
    for section in text.split("\n## ")[1:]:
        scripts = re.findall(r"^([A-Z][\w ]*):\n\n```\w+\n(.*?)^```$", section, re.MULTILINE | re.DOTALL)
        tasks[section.partition("\n")[0]] = dict(scripts)
    return tasks


def count_lines(script):
    """Count the lines of a script that are not empty or comments."""
    return sum(line.strip()[:1] not in ("", "#") for line in script.splitlines())


def write_inputs(folder):
    """Write the files that the scripts read: a periodic rough surface, and a measured one with a tilt."""
    x = np.arange(128) / 128
    rough = SelfAffineSurface(0.8, 0.25, 0.06, (1, 1), seed=1, rms_slope=0.02)
    np.save(folder / "rough.npy", rough.height(x, x))
    x = 0.002 * np.arange(256)
    ground = SelfAffineSurface(0.8, 0.1, 0.016, (0.6, 0.6), seed=3, rms_slope=0.02)
    heights = 1e3 * ground.height(x, x) + 2 * x + 3 * x[:, None]
    np.savetxt(folder / "plate.txt", heights, fmt="%.5f")


def main():
    """Run all scripts and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.parse_args()
    pythons = {PACKAGES[0]: sys.executable}
    for name in PACKAGES[1:]:
        pythons[name] = python = install(name.lower(), ROOT / ".venv-peers")
        subprocess.run([python, "-m", "pip", "install", "--quiet", "h5py", "matplotlib", "scipy"], check=True)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        write_inputs(Path(folder))
        for task, scripts in read_scripts(PAGE.read_text(encoding="utf-8")).items():
            rows.append({"task": task} | {name: count_lines(script) for name, script in scripts.items()})
            for name, script in scripts.items():
                command = [pythons[name], "-c", script]
                done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
                shown = done.stdout.strip().splitlines() if done.returncode == 0 else ["failed", done.stderr]
                print(f"{task}, {name}: {' '.join(shown[-1:])}")
    print(format_text(rows))


if __name__ == "__main__":
    main()
