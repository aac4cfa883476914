"""Adapter of CONTACT (Vollebregt): bound-constrained CG with an FFT preconditioner.

CONTACT is a program, not a package: CONTACT_EXE is the path of its executable. Each solve writes an input file, runs
the program, and reads the pressures (six digits) and the program's own timers. The time of a solve is the processor
time of the CG solver alone. Set-up is the influence coefficients, the preconditioner, and the check after the solve.
Files, other output and the start of the program do not count.

The potential contact area is cut to the contact of a first, unmeasured run: in a larger one, the program transforms
the influence coefficients again whenever the rectangle around the contact changes.
"""

import os
import re
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from protocol import Outcome, Variant, serve

VARIANTS = {"BCCG": Variant("approach"), "BCCG by load": Variant("load")}
MOST_ITERATIONS = 9999  # allowed by CONTACT
MARGIN = 1  # cells around the contact of the first run
FIRST_TOLERANCE = 1e-6

INPUT = """\
3 MODULE
200{norm}00 P-B-T-N-F-S: new, without friction
022020 L-D-C-M-Z-E: elastic half-spaces, new grid and undeformed distance
0001131 H-G-I-A-O-W-R: print pressures of cells in contact
{iterations} 1 1 1 {tolerance:.17g} MAXGS, MAXIN, MAXNR, MAXOUT, EPS
{loading:.17g} 0 0 0 PEN or FN, CKSI, CETA, CPHI
0.3 0.3 FSTAT, FKIN
{poisson:.17g} {poisson:.17g} {shear:.17g} {shear:.17g} POISS, GG
1 IPOTCN
{nx} {ny} 0 0 {dx:.17g} {dy:.17g} MX, MY, XL, YL, DX, DY
9 1 IBASE, IPLAN: undeformed distances
"""
END = "0 MODULE\n"


class Clock:
    """Clock that advances by the times that CONTACT prints."""

    seconds = 0.0

    def __call__(self):
        """Return the sum of these times [s]."""
        return self.seconds


CLOCK = Clock()


def run(text):
    """Run CONTACT on the text of an input file.

    Returns
    -------
    output : str
        Text of its output file.
    table : str
        Text of its file of pressures; empty if it wrote none.
    """
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "a.inp").write_text(text)
        command = [os.environ["CONTACT_EXE"], "2", "a"]
        subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
        table = Path(folder, "a.0001.mat")
        return Path(folder, "a.out").read_text(), table.read_text() if table.exists() else ""


def revision():
    """Return revision and date of CONTACT."""
    output, _ = run(END)
    return " of ".join(re.search(r"Revision: (\d+) \$, \$Date:: ([\d-]+)", output).groups())


def timer(output, name):
    """Return the processor time that CONTACT prints for one of its timers [s]."""
    seconds = re.search(rf"^\|{re.escape(name)} *\| *\d+ \| *(\S+)", output, re.MULTILINE)[1]
    if len(seconds.partition(".")[2]) < 4:
        raise RuntimeError("CONTACT must print its timers with four or more decimals")
    return float(seconds)


def prepare(problem, variant):
    """Set up; see `protocol.serve`."""
    by_load = VARIANTS[variant].control == "load"
    touching = problem.open_gap.min()
    everywhere = slice(0, problem.ny), slice(0, problem.nx)
    area = everywhere if by_load else box(problem.interpenetrating)

    def attempt(tolerance):
        gap = problem.open_gap[area] - touching
        ny, nx = gap.shape
        head = INPUT.format(
            norm=int(by_load),
            iterations=MOST_ITERATIONS,
            tolerance=tolerance,
            loading=problem.load if by_load else problem.approach - touching,
            poisson=problem.poisson_ratio,
            shear=problem.shear_modulus,
            nx=nx,
            ny=ny,
            dx=problem.dx,
            dy=problem.dy,
        )
        output, table = run(head + "\n".join(map("{:.17g}".format, gap.flat)) + "\n" + END)
        if not table:
            raise RuntimeError("CONTACT error: " + " ".join(output[output.rfind("ERROR") :].split()))
        cells = np.loadtxt(re.split(r"%\s+I\s+IGS.*\n", table)[1].splitlines(), usecols=(0, 4), ndmin=2)
        values = np.zeros(gap.size)
        values[cells[:, 0].astype(int) - 1] = cells[:, 1]
        pressure = np.zeros_like(problem.open_gap)
        pressure[area] = values.reshape(gap.shape)
        return pressure, output

    first, _ = attempt(FIRST_TOLERANCE)
    around = zip(box(first > 0), area, strict=True)
    area = tuple(
        slice(max(cut.start - MARGIN, possible.start), min(cut.stop + MARGIN, possible.stop))
        for cut, possible in around
    )

    def solve(tolerance):
        pressure, output = attempt(tolerance)
        iterations = int(re.search(r"ItCG= *(\d+)", output)[1])
        solver = timer(output, "Norm: ConjGrd solver")
        setup = timer(output, "Influence coeffic.") + timer(output, "Algorithm Norm") - solver
        CLOCK.seconds += setup + solver
        return Outcome(pressure, iterations, converged=iterations < MOST_ITERATIONS, setup_seconds=setup)

    return solve


def box(cells):
    """Return the slices of the rectangle around some cells."""
    spans = [np.flatnonzero(cells.any(axis)) for axis in (1, 0)]
    return tuple(slice(occupied[0], occupied[-1] + 1) for occupied in spans)


if __name__ == "__main__":
    serve(["numpy"], VARIANTS, prepare, programs=[("CONTACT revision", revision)], clock=CLOCK)
