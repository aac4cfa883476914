"""Tests that run on several ranks: ``@pytest.mark.mpi(2, 3)`` on a function with an argument `comm`.

Such a function is an ordinary test that every rank calls. The session that was started by hand (the parent) does
not call it: for each number of ranks it starts ``mpiexec -n RANKS python -m pytest IDS --on-ranks=FOLDER`` once, for
starting takes longer than most tests, and tells what became of each test. With ``mpi(1, 2)`` the parent calls the
function for one rank itself.

Every rank writes what it finds to a file of its own in FOLDER, line by line. A test fails if it fails on any rank.
After each test the ranks meet. If one waits for ever, be it in the test or for ranks that a failure elsewhere left
behind, it ends the job: the test at fault fails with the tracebacks of all ranks, and a new job runs the tests after
it.
"""

import faulthandler
import json
import re
import signal
from collections import defaultdict
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from mpi4py import MPI
from processes import run

AFTER_A_FAILURE = 10  # seconds that the others have to end a test that has failed on one rank
TOGETHER = 500  # seconds for all tests on so many ranks; less than the time limit of the parent's test
STARTS = 3  # of mpiexec on so many ranks, if tests end the job


def pytest_addoption(parser):
    parser.addoption(
        "--on-ranks", metavar="FOLDER", help="run as one rank of several; used by tests marked mpi"
    )
    parser.addini("seconds_on_ranks", "how long one test on several ranks may take", default="90")


def pytest_configure(config):
    config.addinivalue_line("markers", "mpi(*ranks): called on this many ranks each, with an argument `comm`")
    folder = config.getoption("--on-ranks")
    if folder:
        config.pluginmanager.register(Rank(Path(folder), float(config.getini("seconds_on_ranks"))))


def pytest_generate_tests(metafunc):
    marker = metafunc.definition.get_closest_marker("mpi")
    if marker:
        names = [f"{n}ranks" if n > 1 else "1rank" for n in marker.args]
        metafunc.parametrize("comm", marker.args, indirect=True, ids=names)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    if not config.getoption("--on-ranks"):
        items[:] = [OnRanks.of(item) if ranks_of(item) > 1 else item for item in items]


def ranks_of(item):
    """How many ranks a test runs on."""
    return item.callspec.params["comm"] if item.get_closest_marker("mpi") else 1


@pytest.fixture
def comm(request):
    """All ranks of a test marked mpi."""
    assert MPI.COMM_WORLD.size == request.param
    return MPI.COMM_WORLD


class OnRanks(pytest.Item):
    """In the parent: a test that other processes run."""

    @classmethod
    def of(cls, function):
        """Stand in for the function on several ranks."""
        item = cls.from_parent(function.parent, name=function.name)
        item.ranks, item.location_of_function = ranks_of(function), function.reportinfo()
        item.own_markers.extend(function.own_markers)
        item.keywords.update(function.keywords)
        return item

    def reportinfo(self):
        return self.location_of_function

    def runtest(self):
        outcomes = self.session.stash.setdefault(OUTCOMES, {})
        if self.nodeid not in outcomes:
            like = [i for i in self.session.items if isinstance(i, OnRanks) and i.ranks == self.ranks]
            outcomes.update(run_on_ranks(like))
        outcome, text = outcomes[self.nodeid]
        if outcome == "skipped":
            pytest.skip(text)
        if outcome == "failed":
            raise FailedOnRanks(text)

    def repr_failure(self, excinfo):
        return str(excinfo.value) if excinfo.errisinstance(FailedOnRanks) else super().repr_failure(excinfo)


OUTCOMES = pytest.StashKey()


class FailedOnRanks(Exception):
    """The message has the tracebacks of the ranks."""


def run_on_ranks(items):
    """Run tests on as many ranks as they ask for: ``{node id: (outcome, text)}``."""
    config, ranks = items[0].config, items[0].ranks
    left, outcomes = [item.nodeid for item in items], {}
    for _ in range(STARTS):
        with TemporaryDirectory(prefix="on_ranks-", ignore_cleanup_errors=True) as folder:
            command = ["-m", "pytest", *left, f"--on-ranks={folder}", "-p", "no:cacheprovider", "--timeout=0"]
            try:
                done = run(*command, ranks=ranks, timeout=TOGETHER, cwd=config.rootpath)
                end = f"mpiexec ended with status {done.returncode}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
                bad_end = done.returncode != 0
            except AssertionError as error:  # it hangs outside of any test
                end, bad_end = str(error), True
            outcomes |= read_outcomes(Path(folder), left, ranks, end)
        if left[-1] in outcomes:
            if bad_end and outcomes[left[-1]][0] != "failed":
                outcomes[left[-1]] = "failed", f"after this last test on {ranks} ranks: {end}"
            return outcomes
        *_, culprit = outcomes
        left = left[left.index(culprit) + 1 :]
    return outcomes | {name: ("failed", f"not run: {culprit} and others ended the job") for name in left}


def read_outcomes(folder, names, ranks, end):
    """What the ranks have written, up to the test that ended the job, if one did; `end` says how it ended."""
    found = defaultdict(dict)  # name -> rank -> (outcome, text)
    for rank in range(ranks):
        path = folder / f"{rank}.jsonl"
        for line in path.read_text().splitlines() if path.is_file() else ():
            name, outcome, text = json.loads(line)
            found[name][rank] = outcome, text
    outcomes = {}
    for name in names:
        outcomes[name] = verdict(found[name])
        if len(found[name]) < ranks:
            stacks = [stack_of(folder, rank) for rank in range(ranks) if rank not in found[name]]
            text = "\n".join(["the ranks did not all come to its end", outcomes[name][1], *stacks, end])
            outcomes[name] = "failed", text
            break
    return outcomes


def verdict(reports):
    """One outcome of those of the ranks."""
    for kind in ("failed", "skipped", "passed"):
        said = {rank: text for rank, (outcome, text) in sorted(reports.items()) if outcome == kind}
        if said:
            texts = [f"--- rank {rank}\n{text}" for rank, text in said.items()]
            return kind, "\n".join(texts) if kind == "failed" else next(iter(said.values()))
    return "failed", ""


def stack_of(folder, rank):
    path = folder / f"{rank}.stack"
    lines = path.read_text().splitlines() if path.is_file() else []
    where = [line for line in lines if not re.search(r"/_pytest/|/pluggy/|/pytest/|runpy", line)]
    return "\n".join([f"--- rank {rank} did not come to the end", *where])


class Rank:
    """One of several ranks."""

    def __init__(self, folder, seconds):
        self.comm = MPI.COMM_WORLD.Dup()  # not that of the tests
        self.folder, self.seconds = folder, seconds
        self.outcomes = (folder / f"{self.comm.rank}.jsonl").open("w")
        self.stack = (folder / f"{self.comm.rank}.stack").open("w")
        # faulthandler's clock runs in C: it ends a rank that waits inside MPI, too. mpiexec then ends the others,
        # by SIGTERM.
        faulthandler.register(signal.SIGTERM, file=self.stack, chain=True)

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item):
        self.outcome, self.texts = "passed", []
        faulthandler.dump_traceback_later(self.seconds, exit=True, file=self.stack)
        yield
        self.outcomes.write(json.dumps([item.nodeid, self.outcome, "\n".join(self.texts)]) + "\n")
        self.outcomes.flush()
        if self.outcome == "failed":
            faulthandler.dump_traceback_later(AFTER_A_FAILURE, exit=True, file=self.stack)
        self.comm.Barrier()
        faulthandler.cancel_dump_traceback_later()

    def pytest_runtest_logreport(self, report):
        if report.failed:
            self.outcome = "failed"
            self.texts += [report.longreprtext, *(f"{title}\n{text}" for title, text in report.sections)]
        elif report.skipped and self.outcome == "passed":
            self.outcome = "skipped"
            self.texts += [report.longrepr[2] if isinstance(report.longrepr, tuple) else ""]

    @pytest.hookimpl(trylast=True)
    def pytest_sessionfinish(self, session):
        if session.exitstatus == pytest.ExitCode.TESTS_FAILED:
            session.exitstatus = 0  # mpiexec would end the other ranks

    @pytest.fixture
    def tmp_path(self, request):
        """One folder for all ranks."""
        folder = None
        if self.comm.rank == 0:
            folder = self.folder / f"test{len(list(self.folder.iterdir()))}"
            folder.mkdir()
        return self.comm.bcast(folder)
