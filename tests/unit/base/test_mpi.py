"""Start of MPI, and the environment."""

import os

import pytest

from app.base import mpi

ONE_HOST = {"OMPI_COMM_WORLD_SIZE": "4", "OMPI_COMM_WORLD_LOCAL_SIZE": "4"}


@pytest.mark.parametrize(
    ("environment", "alone"),
    [
        ({}, True),
        (ONE_HOST, True),
        (ONE_HOST | {"PMIX_RANK": "0"}, True),  # mpiexec's own
        (ONE_HOST | {"OMPI_COMM_WORLD_SIZE": "8"}, False),
        ({"PMIX_RANK": "0"}, False),
        ({"SLURM_STEP_ID": "1"}, False),
        ({"SLURM_JOB_ID": "17"}, True),  # the script of a job, without srun
        ({"OMPI_MCA_pml": "ucx"}, False),
        (ONE_HOST | {"OMPI_MCA_btl": "tcp,self"}, False),
        (ONE_HOST | {"OMPI_VERSION": "5.0.7"}, True),
        (
            ONE_HOST | {"OMPI_MCA_btl_tcp_if_exclude": "docker0"},
            False,
        ),  # with another word Open MPI refuses it
    ],
)
def test_the_search_for_networks_is_skipped_only_on_a_single_host(environment, alone):
    found = mpi.single_host_variables(environment)
    assert bool(found) == alone
    assert not found.keys() & environment.keys()


def test_a_temporary_environment_is_restored(monkeypatch):
    """Else a program that a command starts, on other hosts maybe, would inherit it."""
    monkeypatch.setenv("CONTACT_KEPT", "1")
    monkeypatch.delenv("CONTACT_NEW", raising=False)
    before = dict(os.environ)
    with (
        pytest.raises(KeyError),
        mpi.temporary_environment({"CONTACT_KEPT": None, "CONTACT_NEW": "2", "CONTACT_NEVER": None}),
    ):
        assert "CONTACT_KEPT" not in os.environ
        assert os.environ["CONTACT_NEW"] == "2"
        raise KeyError
    assert dict(os.environ) == before
