"""Two hosts with a network between them: the same answer, and one line where they differ (docs/cluster.md)."""

import subprocess
import time
from contextlib import contextmanager

import hosts
import numpy as np
import pytest
from processes import TESTS, run, solve_arguments

from app.io.result import read_result

pytestmark = pytest.mark.skipif(bool(hosts.missing()), reason=f"no hosts can be made here: {hosts.missing()}")
LIMIT = 60  # s
# Both hosts are this machine: bound to cores, ranks of both would share the first.
MPI = [TESTS.parent / "run" / "mpi", *"--net 10.77.0.0/24 --bind-to none -n 2 --host one,two".split()]
HERTZ = ["python", *solve_arguments("hertz"), "-grid", 32]


@pytest.fixture(scope="module")
def pair():
    with hosts.Hosts(delay=1e-3) as both:
        yield both


@pytest.fixture
def solve(pair):
    """``solve("-grid", 8)``: run app.solve on both hosts."""

    def run_there(*arguments, **how):
        process = pair.start(
            [*MPI, *HERTZ, *arguments], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **how
        )
        try:
            out, err = process.communicate(timeout=LIMIT)
        finally:
            process.kill()
        return subprocess.CompletedProcess(process.args, process.returncode, out, err)

    return run_there


@contextmanager
def hidden(pair, folder):
    """What is in a folder is not there on the second host."""
    pair.on("two", f"mount -t tmpfs none {folder}")
    try:
        yield
    finally:
        pair.on("two", f"umount {folder}")


def errors(done):
    return [line for line in done.stderr.splitlines() if line.startswith("error: ")]


@pytest.mark.parametrize("cells", [8192, 64])
def test_answer_is_that_of_one_host(solve, tmp_path, cells):
    """Option files, what PETSC_OPTIONS and the working folder mean, are those of the first host."""
    (tmp_path / "more.opts").write_text(
        f"-lcp_error_bound 1e-4\n-lcp_precision double\n-lcp_cells_per_rank {cells}\n"
    )
    done = solve(
        "-options_file",
        tmp_path / "more.opts",
        "-output",
        tmp_path / "two.h5",
        env={"PETSC_OPTIONS": "-lcp_rtol 1e-7"},
    )
    # Open MPI warns if the program that it starts on a host is faster than its own call of setpgid.
    said = [line for line in done.stderr.splitlines() if "plm:rsh: Warning: setpgid" not in line]
    assert (done.returncode, said) == (0, [])
    more = ["-options_file", tmp_path / "more.opts", "-lcp_rtol", 1e-7, "-output", tmp_path / "one.h5"]
    assert run(*HERTZ[1:], *more, ranks=2).returncode == 0
    one, two = (read_result(tmp_path / f"{name}.h5") for name in ("one", "two"))
    assert (two.attributes["solving_ranks"], two.attributes["ranks"]) == (2, 2)
    np.testing.assert_allclose(two.pressure, one.pressure, rtol=0, atol=1e-10 * one.pressure.max())


def test_folder_of_results_is_another_one(solve, pair, tmp_path):
    with hidden(pair, tmp_path):
        done = solve("-output", tmp_path / "out.h5")
    assert done.returncode == 2
    assert [line.partition(str(tmp_path))[0] for line in errors(done)] == ["error: host two: result file "]
    assert "share" in errors(done)[0]
    assert list(tmp_path.iterdir()) == []


def test_input_is_missing(solve, pair, tmp_path):
    np.save(tmp_path / "heights.npy", np.zeros((32, 32)))
    with hidden(pair, tmp_path):
        done = solve("-surface_file", tmp_path / "heights.npy", "-surface_unit", "um")
    assert done.returncode == 2
    assert len(errors(done)) == 1
    assert errors(done)[0].startswith("error: host two: ")
    assert "heights.npy" in errors(done)[0]


@pytest.mark.slow
def test_host_that_is_gone(pair, tmp_path):
    """A cut cable is noticed within half a minute, a killed host at once; an earlier result stays."""
    for what, limit in ((lambda two: two.cable.cut.update({0, 1}), 40), (lambda two: two.kill("two"), 10)):
        (tmp_path / "out.h5").write_bytes(b"an earlier result")
        long = "-grid 256 -lcp_rtol 1e-14 -lcp_max_it 100000 -ksp_rtol 1e-15 -lcp_monitor -output".split()
        with hosts.Hosts() as both:
            process = both.start(
                [*MPI, "python", *solve_arguments("hertz", "norm"), *long, tmp_path / "out.h5"],
                text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            assert process.stdout.readline().startswith("level")
            started = time.monotonic()
            what(both)
            process.communicate(timeout=limit)
            assert process.returncode not in (0, 2, 3)
            assert time.monotonic() - started < limit
            if both.cable.cut:  # nobody can tell the other host
                both.on(
                    "two", "timeout 40 sh -c 'while grep -qsx python /proc/[0-9]*/comm; do sleep 1; done'"
                )
        assert [file.name for file in tmp_path.iterdir()] == ["out.h5"]
        assert (tmp_path / "out.h5").read_bytes() == b"an earlier result"
