"""Solve one contact problem: ``python -m app.solve``, see `app.cli.solve`."""

import sys
import types

from app.cli import session, warm_up
from app.cli.solve import main


class _Command(types.ModuleType):
    """Callable module: after ``import app.solve``, ``app.solve(...)`` still solves a problem."""

    def __call__(self, *arguments, **named):
        from app.api.solver import solve

        return solve(*arguments, **named)


sys.modules[__name__].__class__ = _Command

if __name__ == "__main__":
    if sys.argv[1:] and set(sys.argv[1:]) <= {"-h", "-help", "--help"}:
        from app.base.missing_packages import is_installed

        if not (
            is_installed("mpi4py") and is_installed("petsc4py")
        ):  # the options help to choose what to install
            from app.cli import problem_options, streams

            streams.print_output(problem_options.format_help())
            sys.exit(0)
    if sys.argv[1:] == ["--warm-up"]:
        session.run(warm_up.main, sys.argv[:1])
    session.run(main)
