"""Time further solves of a problem on the same solver.

Started by `benchmarks.measure` as ``mpiexec -n P python -m benchmarks.again`` with the options of app.solve.
"""

from app.cli import session

_FEWEST = 8
_SECONDS = 1.0  # solved for at least as long: small problems more often


def main(given):
    """Print the seconds, those of the slowest rank. Collective."""
    import time

    from mpi4py import MPI

    from app.api.solver import ContactSolver
    from app.cli.problem_options import Request

    comm, times = MPI.COMM_WORLD, []
    request = Request(given, comm)
    with ContactSolver(request.problem, request.method, request.options) as solver:
        solver.solve(**request.loading)
        while len(times) < _FEWEST or sum(times) < _SECONDS:
            comm.Barrier()
            begun = time.perf_counter()
            solver.solve(**request.loading)
            times.append(comm.allreduce(time.perf_counter() - begun, MPI.MAX))
    session.print_output(f"{min(times)}")


if __name__ == "__main__":
    session.run(main)
