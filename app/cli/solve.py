"""Solve one contact problem.

Run ``mpiexec -n 2 python -m app.solve -options_file petsc_options/hertz.opts ...``.
"""

import sys

from app.base.errors import InputError, call_collectively
from app.cli import session


def main(parsed):
    """Solve the requested problem, write the result, and print a summary.

    Collective. Return the exit status.
    """
    # The session starts MPI and PETSc first.
    import shlex
    import warnings
    from contextlib import nullcontext

    from petsc4py import PETSc

    with session.imports_uncollected():
        from app.api.arguments import check_disks
        from app.api.refinement import refine
        from app.api.solver import ContactSolver
        from app.api.summary import refinement_table, summary
        from app.base.mpi import MPI
        from app.base.numba_cache import clock, compile_seconds
        from app.cli.load_path import load_path_summary, run_path
        from app.cli.problem_options import Request, format_help, suggest_names
        from app.contact.history import Monitor
        from app.options.option_table import format_options

    Monitor.say = staticmethod(session.print_output)
    if "help" in parsed.petsc_options:
        session.print_output(format_help())
        if "problem" not in parsed.texts:
            return 0
    if not parsed.texts:
        raise InputError(
            "nothing to solve; to begin with: -options_file petsc_options/hertz.opts; all options: -help"
        )
    started = clock()
    facts = {"command_line": shlex.join(sys.argv)}
    with PETSc.Log.Stage("Setup"), suggest_names(parsed):
        request, solver = Request(parsed, MPI.COMM_WORLD), None
        if not request.refine_until:
            solver = ContactSolver(request.problem, request.method, request.options, prefix="")
            facts["setup_seconds"] = clock() - started
    facts |= {"title": request.title} if request.title else {}

    def save(solution, file, steps=None):
        with PETSc.Log.Stage("Output"):
            options = f"{format_options(request.texts)} {solution.options}"
            solution.save(file, steps, **facts, options=options, peak_memory=session.peak_memory())

    text, steps, finished, status = "", None, nullcontext(), 0
    with PETSc.Log.Stage("Solve"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # the summary says what has not converged
        if request.refine_until:
            refined = refine(
                request.problem, request.refine_until, request.refine_max, request.method, request.options,
                stiffness=request.stiffness, prefix="", quantities=request.quantities,
                **request.loading,
            )  # fmt: skip
            solution, notes, status = refined.solution, refined.solution.notes, 0 if refined.reached else 3
            facts |= {f"refinement_{name}": [row[name] for row in refined.rows] for name in refined.rows[0]}
            text = refinement_table(refined, request.refine_until, request.quantities)
        elif request.path:
            with solver:
                path, solution, finished = run_path(
                    request.path, solver, save, request.stiffness, request.flow
                )
            steps, notes, status = path.table, path.notes, 0 if path.converged else 3
            facts |= {
                "notes": "\n".join(notes),
                "path_operator_applications": path.operator_applications,
                "path_seconds": path.solve_seconds,
            }
            text = load_path_summary(path, request.path)
        else:
            with solver:
                solution = solver.solve(**request.loading)
                if request.stiffness:
                    solution = solver.with_stiffness(
                        solution, tilts=bool(request.tilting) and not any(solution.grid.repeats)
                    )
            notes = solution.notes
        if request.flow:
            solution.flow()
    options = (refined if request.refine_until else solver).options
    options.insert_for_good(request.texts)
    with PETSc.Log.Stage("Output"):
        facts |= solution.count_patches()
    with finished:
        if request.output:
            save(solution, request.output, steps)
    if text:
        session.print_output(text)
    facts["compile_seconds"] = compile_seconds()
    session.print_output(summary(solution.attributes | facts, solution.grid, request.output, solution.extra))
    if not request.output:
        session.print_output("  the solution is not saved; -output F.h5 saves it for app.plot and app.report")
    for line in notes:
        session.warn(line)
    call_collectively(MPI.COMM_WORLD, check_disks, options.texts, only_root=True)
    return status if solution.converged else 3
