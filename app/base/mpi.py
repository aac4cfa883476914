"""Start MPI; on one host, without searching for networks.

``from app.base.mpi import MPI`` starts MPI, unless another package such as h5py has started it. The module itself can
be imported without mpi4py.
"""

import os
from contextlib import contextmanager

from app.base.missing_packages import missing
from app.base.user_folder import existing_folder

# First letters of variables of launchers other than Open MPI's mpiexec. With these the number of hosts is unknown.
_LAUNCHERS = ("PMI", "SLURM_STEP", "PALS_", "FLUX_", "ALPS_", "JSM_")

# A process without mpiexec needs no daemon of Open MPI. Its version 4 would remove a folder that all processes share.
SINGLE_RANK = {"OMPI_MCA_ess_singleton_isolated": "1", "OMPI_MCA_orte_create_session_dirs": "0"}
# First letters of variables with which mpiexec makes a process a rank.
_OF_RANKS = (
    "OMPI_COMM_WORLD_", "OMPI_MCA_ess", "OMPI_MCA_orte_", "OMPI_MCA_pmix", "OMPI_UNIVERSE_SIZE", "PMIX_", "PMI_",
)  # fmt: skip

# Environment variables: number of ranks -> rank, for Open MPI and MPICH.
_SIZES = {"OMPI_COMM_WORLD_SIZE": "OMPI_COMM_WORLD_RANK", "PMI_SIZE": "PMI_RANK"}

# What Open MPI 4 sets in a process without mpiexec. A program that inherits it cannot be mpiexec.
_OF_SINGLE_RANK = ("OMPI_MCA_ess", "OMPI_MCA_pmix")


def __getattr__(name):
    if name != "MPI":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    with temporary_environment(single_host_variables(os.environ)), existing_folder():
        try:
            from mpi4py import MPI
        except (RuntimeError, ModuleNotFoundError) as error:  # pip's mpi4py brings no MPI library
            if "MPI library" not in str(error) and getattr(error, "name", None) != "mpi4py":
                raise
            raise missing("mpi4py") from None

    check_running(MPI)
    for variable in _OF_SINGLE_RANK:
        if variable not in os.environ:  # which has what the process was started with
            os.unsetenv(variable)
    globals()[name] = MPI
    return MPI


def check_running(library):
    """Raise if MPI or PETSc (`library`) has been finalized by the user's program."""
    ended = getattr(library, "Is_finalized", None) or library.Sys.isFinalized
    if ended():
        from app.base.errors import InputError

        raise InputError(f"{library.__name__} has been finalized; do this after the last solve")


def single_host_variables(environment):
    """Return environment variables for Open MPI on one host, name -> value.

    The variables choose transports. Open MPI would choose the same ones after a search for networks, which takes 0.2 s,
    a fifth of the time of a small solve. The result is empty if the ranks may be on several hosts, or if the user has
    set one of the variables in `environment`.
    """
    variables = {"OMPI_MCA_pml": "ob1", "OMPI_MCA_btl": "^openib,ofi,uct,usnic"}
    ranks, local_ranks = (environment.get(f"OMPI_COMM_WORLD_{size}") for size in ("SIZE", "LOCAL_SIZE"))
    launched = any(name.startswith(_LAUNCHERS) for name in environment)
    one_host = ranks == local_ranks if ranks else not launched
    if environment.get("OMPI_VERSION", "").startswith("5"):  # warns of networks of unknown speed
        variables["OMPI_MCA_btl_tcp_if_include"] = "lo"
    chosen = variables.keys() | {"OMPI_MCA_btl_tcp_if_exclude"}
    return variables if one_host and not chosen & environment.keys() else {}


def single_rank_variables(environment):
    """Return environment changes (None: remove) for a child that is no rank."""
    changes = {name: None for name in environment if name.startswith(_OF_RANKS)}
    return changes | SINGLE_RANK | {"OMP_NUM_THREADS": environment.get("OMP_NUM_THREADS", "1")}


def launched_rank(environment):
    """Return the rank and the number of ranks that mpiexec has started, without starting MPI.

    The result is (0, 1) without mpiexec.
    """
    for size, rank in _SIZES.items():
        if environment.get(size, "").isdecimal():
            return int(environment.get(rank, 0)), int(environment[size])
    return 0, 1


@contextmanager
def temporary_environment(changes):
    """Set environment variables in a block; None removes one."""
    before = {name: os.environ.pop(name) for name in changes if name in os.environ}
    os.environ.update({name: value for name, value in changes.items() if value is not None})
    try:
        yield
    finally:
        for name in changes:
            os.environ.pop(name, None)
        os.environ.update(before)
