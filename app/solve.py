"""Solve one contact problem:  mpiexec -n 2 python -m app.solve -options_file petsc_options/hertz.opts ..."""

from __future__ import annotations

from app.commands import session


def main(given):
    """Solve, write, report; return the exit status. Collective."""
    # Not before the session has started: PETSc and MPI start when they are imported.
    from app.commands import solving
    from app.commands.problem_options import PROBLEM_OPTIONS
    from app.commands.report import help_text
    from app.options import METHOD_OPTIONS

    if "help" in given.of_petsc:
        session.say(help_text(PROBLEM_OPTIONS, METHOD_OPTIONS))
        if "problem" not in given.texts:
            return 0
    options = solving.Options(given)
    with options.database.active():
        return solving.run(options)


if __name__ == "__main__":
    session.run(main)
