"""Solve one contact problem:  mpiexec -n 2 python -m app.solve -options_file petsc_options/hertz.opts ..."""

from __future__ import annotations

import sys

from app.base.errors import InputError
from app.cli import session


def main(given):
    """Solve, write, report; return the exit status. Collective."""
    # Not before the session has started: MPI and PETSc start when they are imported.
    import gc
    import shlex
    import time
    import warnings
    from contextlib import nullcontext
    from dataclasses import replace

    from petsc4py import PETSc

    from app.api.refinement import refine
    from app.api.solver import ContactSolver
    from app.base import numba_cache
    from app.base.mpi import MPI
    from app.cli import monitor
    from app.cli.load_path import run_path
    from app.cli.problem_options import Request, format_help, suggest_names
    from app.cli.summary import load_path_summary, refinement_table, summary
    from app.contact.history import Monitor
    from app.options.option_table import format_options

    Monitor.say = staticmethod(session.print_output)
    numba_cache.on_first_compile = lambda: session.note("compiling loops, once; this may take half a minute")
    if "help" in given.petsc_options:
        session.print_output(format_help())
        if "problem" not in given.texts:
            return 0
    if not given.texts:
        raise InputError(
            "nothing to solve; to begin with: -options_file petsc_options/hertz.opts; all options: -help"
        )
    started = time.perf_counter()
    facts = {"command_line": shlex.join(sys.argv)}
    with PETSc.Log.Stage("Setup"), suggest_names(given):
        request, solver = Request(given, MPI.COMM_WORLD), None
        listeners = [] if request.path else monitor.make_listeners()  # a path has a bar, or lines, of its own
        if not request.refine_until:
            solver = ContactSolver(
                request.problem, request.method, request.options, prefix="", listeners=listeners
            )
            facts["setup_seconds"] = time.perf_counter() - started
    gc.freeze()  # all this stays: looking for garbage in it takes as long as a small solve

    def save(solution, file, steps=None):
        with PETSc.Log.Stage("Output"):
            options = f"{format_options(request.texts)} {solution.options}"
            more = {**facts, "options": options, "peak_memory": session.peak_memory()}
            solution.save(file, steps, **more)

    said, steps, done, status = "", None, nullcontext(), 0
    with PETSc.Log.Stage("Solve"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of what the summary says: not converged
        if request.refine_until:
            refined = refine(
                request.problem, request.refine_until, request.refine_max, request.method, request.options,
                listeners=listeners, stiffness=request.stiffness, prefix="", **request.loading,
            )  # fmt: skip
            solution, notes, status = refined.solution, refined.solution.notes, 0 if refined.reached else 3
            facts |= refined.errors._asdict()
            facts |= {f"refinement_{name}": [row[name] for row in refined.rows] for name in refined.rows[0]}
            said = refinement_table(refined, request.refine_until)
        elif request.path:
            with solver:
                path, solution, done = run_path(request.path, solver, request.stiffness, save)
            steps, notes, status = path.table, path.notes, 0 if path.converged else 3
            facts |= {
                "notes": "\n".join(notes),
                "path_operator_applications": path.operator_applications,
                "path_seconds": path.solve_seconds,
            }
            said = load_path_summary(path, request.path)
        else:
            with solver:
                solution = solver.solve(**request.loading)
                if request.stiffness:
                    solution = replace(solution, stiffness=solver.stiffness(solution))
            notes = solution.notes
    (refined if request.refine_until else solver).options.insert_for_good(request.texts)
    with PETSc.Log.Stage("Output"):
        facts |= solution.count_patches()
    with done:
        if request.output:
            save(solution, request.output, steps)
    if said:
        session.print_output(said)
    session.print_output(summary(solution.attributes | facts, solution.grid, request.output))
    for line in notes:
        session.warn(line)
    return status if solution.converged else 3
