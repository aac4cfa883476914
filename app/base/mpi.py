"""MPI, without a search for networks where all ranks are on one host. Importable without mpi4py.

``from app.base.mpi import MPI`` starts MPI if nothing has started it before. Other packages may: see
`app.base.packages`.
"""

from __future__ import annotations

import os
from contextlib import contextmanager

# Names that begin so are of somebody else than mpiexec of Open MPI who starts ranks: the number of hosts is not known.
_LAUNCHERS = ("PMI", "SLURM_STEP", "PALS_", "FLUX_", "ALPS_", "JSM_")


def __getattr__(name):
    if name != "MPI":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with temporary_environment(single_host_variables(os.environ)):
        from mpi4py import MPI

    globals()[name] = MPI
    return MPI


def single_host_variables(environment):
    """Variables with which Open MPI starts: where all ranks are on one host, what it would choose there in the end.

    It need not look for networks then, which takes 0.2 s, a fifth of a small solve's command. Not collective.
    """
    chosen = {"OMPI_MCA_pml": "ob1", "OMPI_MCA_btl": "^openib,ofi,uct,usnic"}
    ranks, here = (environment.get(f"OMPI_COMM_WORLD_{size}") for size in ("SIZE", "LOCAL_SIZE"))
    launched = any(name.startswith(_LAUNCHERS) for name in environment)
    together = ranks == here if ranks else not launched
    if environment.get("OMPI_VERSION", "").startswith(
        "5"
    ):  # it complains of networks whose speed it does not know
        chosen["OMPI_MCA_btl_tcp_if_include"] = "lo"
    said = chosen.keys() | {"OMPI_MCA_btl_tcp_if_exclude"}
    return chosen if together and not said & environment.keys() else {}


@contextmanager
def temporary_environment(changes):
    """Set some variables of the environment inside the block, or remove those whose value is None."""
    kept = {name: os.environ.pop(name) for name in changes if name in os.environ}
    os.environ.update({name: value for name, value in changes.items() if value is not None})
    try:
        yield
    finally:
        for name in changes:
            os.environ.pop(name, None)
        os.environ.update(kept)
