"""Solve and record every active set iteration.

Tables 1 and 4 and Figures 8 and 11 need these records.

``python -m app.paper.trace [options of app.solve] -output TRACE.h5``, on one rank. The file:

======================  ================  =====  ==================================================================
dataset                 shape             unit   meaning
======================  ================  =====  ==================================================================
``pressure``            (k + 1, ny, nx)   N/mm2  p before iteration 1, and after each of the k iterations
``contact``             (k + 1, ny, nx)   1      contact set C at the same times, uint8
``linear_residuals``    (m + 1)           mm     norms of the defect in the KSP of the last system
``exact_pressure``      (ny, nx)          N/mm2  analytic solution at the cell centres, if there is one
``admissible``          (ny, nx)          1      where contact is possible, uint8
``x``, ``y``            (nx), (ny)        mm     cell centres
======================  ================  =====  ==================================================================
"""

import numpy as np

from app.base import hdf5 as h5py
from app.cli import session
from app.contact.history import Listener


class Recorder(Listener):
    """Recorder of iterations on the target grid, and of linear solves."""

    def __init__(self):
        self.pressure, self.contact, self.linear_residuals = [], [], []

    def start(self, state, level):
        """Delete the iterations of a coarser grid; store the initial state."""
        self.pressure, self.contact = [], []
        self._keep(state)

    def iteration(self, entry, state):
        """Store pressure and contact set after an iteration."""
        self._keep(state)

    def monitor(self, ksp, iteration, norm):
        """Store the norm of the defect in an iteration of a KSP.

        The KSP calls this function as a monitor. Norms of earlier linear solves are deleted.
        """
        if iteration == 0:
            self.linear_residuals = []
        self.linear_residuals.append(norm)

    def _keep(self, state):
        self.pressure.append(state.p.copy())
        self.contact.append(state.contact.astype(np.uint8))


def main(given):
    """Solve, write the trace file, return the exit status."""
    # After the start of the session: importing PETSc starts it.
    from app.api.solver import ContactSolver
    from app.base.errors import InputError, call_collectively
    from app.base.mpi import MPI
    from app.cli.geometry import make_problem
    from app.cli.problem_options import PROBLEM_OPTIONS, read_loading, resolve_alternatives

    comm, options = MPI.COMM_WORLD, resolve_alternatives(given)
    if comm.size > 1 or not options["output"]:
        raise InputError("a trace needs one rank and -output")
    kind, value = read_loading(given, options)
    problem, own = call_collectively(comm, make_problem, options, given.texts, comm)
    of_problem = own.asked | {option.name for option in PROBLEM_OPTIONS}
    method = {name: text for name, text in given.texts.items() if name not in of_problem}
    recorder = Recorder()
    with ContactSolver(problem, options=method, comm=comm, prefix="", listeners=[recorder]) as solver:
        if solver.ksp is not None:
            # PETSc's own history stays empty if the PC iterates, as PCMG does.
            solver.ksp.setMonitor(recorder.monitor)
        solution = solver.solve(**{kind: value})
    write(options["output"], recorder, solution, problem.reference(solution.approach))
    return 0 if solution.converged else 3


def write(path, recorder, solution, exact):
    """Write the trace file.

    `exact` is the analytic solution, or None if unknown.
    """
    from app.io.files import atomic_hdf5

    with atomic_hdf5(path) as file:
        file["pressure"] = np.stack(recorder.pressure)
        file["contact"] = np.stack(recorder.contact)
        file["linear_residuals"] = np.array(recorder.linear_residuals)
        file["admissible"] = (~np.isnan(solution.undeformed_distance)).astype(np.uint8)
        file["x"], file["y"] = solution.x, solution.y
        if exact is not None:
            file["exact_pressure"] = exact.pressure(solution.x, solution.y[:, None])


def collect_cycles(path):
    """Return the defect norms of a trace's last linear system [mm]."""
    with h5py.File(path) as file:
        return {"linear_residuals": file["linear_residuals"][()].tolist()}


def collect_errors(path):
    """Return a trace's pressure errors for Table 4 [N/mm2].

    The errors are root mean squares over the last contact set, before iteration 1 and after each iteration.
    """
    with h5py.File(path) as file:
        p, contact, exact = (file[name][()] for name in ("pressure", "contact", "exact_pressure"))
    inside = contact[-1] == 1
    errors = np.sqrt(np.mean((p - exact)[:, inside] ** 2, axis=1))
    return {"errors": errors.tolist()}


def collect_contact(path):
    """Return contact sets, admissible cells and cell centres of a trace.

    The contact sets are the first and the last one.
    """
    with h5py.File(path) as file:
        fields = {"first": file["contact"][0], "last": file["contact"][-1]}
        fields |= {name: file[name][()] for name in ("admissible", "x", "y")}
    return {name: values.tolist() for name, values in fields.items()}


if __name__ == "__main__":
    session.run(main)
