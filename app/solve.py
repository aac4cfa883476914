"""Solve one contact problem:  mpiexec -n 2 python -m app.solve -options_file petsc_options/hertz.opts ..."""

from __future__ import annotations

import sys
import types

from app.commands import session


def main(given):
    """Solve, write, report; return the exit status. Collective."""
    # Not before the session has started: MPI and PETSc start when they are imported.
    import gc
    import shlex
    import time
    import warnings

    from mpi4py import MPI
    from petsc4py import PETSc

    from app.commands import monitor
    from app.commands.problem_options import Request, help_text
    from app.commands.report import report
    from app.solver import ContactSolver

    if "help" in given.of_petsc:
        session.say(help_text())
        if "problem" not in given.texts:
            return 0
    started = time.perf_counter()
    with PETSc.Log.Stage("Setup"):
        request = Request(given, MPI.COMM_WORLD)
        solver = ContactSolver(request.problem, options=request.method)
        solver.listeners += monitor.listeners(request.wants_monitor, solver.settings.rtol)
    facts = {
        "setup_seconds": time.perf_counter() - started,
        "command_line": shlex.join(sys.argv),
    }
    gc.freeze()  # all this stays: looking for garbage in it takes as long as a small solve
    with solver, PETSc.Log.Stage("Solve"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of what the report says: not converged
        solution = solver.solve(**request.loading)
    facts["options"] = f"{request.options_text} {solution.options}"
    with PETSc.Log.Stage("Output"):
        facts["peak_memory"] = session.peak_memory()
        if request.output:
            solution.save(request.output, **facts)
    session.say(report(solution.attributes | facts, solution.grid, request.output))
    for line in solution.notes:
        session.warn(line)
    return 0 if solution.converged else 3


class _Command(types.ModuleType):
    """Where a program imports the command, ``from app import solve`` still solves."""

    def __call__(self, *arguments, **named):
        from app.solver import solve

        return solve(*arguments, **named)


sys.modules[__name__].__class__ = _Command

if __name__ == "__main__":
    session.run(main)
