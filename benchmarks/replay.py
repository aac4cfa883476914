"""Messages of a solve on many ranks: recorded on two, replayed for any number and network.

Two ranks that share every grid and window write down what they say to each other, in order: on which grid, what for.
For P ranks the program lays out the same grids itself (`RankGroups`, `Slabs`, `Halo`, `Transfer`, `Scatter`, columns
dealt to ranks), with a communicator that only counts. No job of P ranks is needed, and nothing is computed.

Time is a model. Collectives go along a tree, inside of machines first; a rank sends one message after the other; ranks
of a machine share its way to others. Computing is divided by the ranks of a grid.

Started by ``run/bench --replay``.
"""

import os
import pickle
import subprocess
import sys
import tempfile
from collections import Counter
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple
from unittest import mock

import numpy as np
from mpi4py import MPI

from app import ContactProblem, ContactSolver, Grid
from app.base.petsc import logged_reductions
from app.contact.full_multigrid import GridSequence
from app.halfspace.fft.multiplier import EvenMultiplier
from app.halfspace.fft.transpose import ColumnGroup, deal_columns
from app.halfspace.material import Material
from app.halfspace.window import Scatter
from app.io.table import format_markdown
from app.methods.free.verification_product import VerificationProduct
from app.methods.multilevel_product import MultilevelOperator
from app.multigrid.transfer import Transfer
from app.parallel.communicator import Communicator, Traffic
from app.parallel.fetch import Fetch
from app.parallel.halo import CoarseHalo, Halo
from app.parallel.rank_groups import RankGroups
from app.parallel.slabs import Slabs
from app.problems.shapes import Paraboloid
from benchmarks.measure import ROOT, publish

STENCILS = 4e-9  # for a cell of a preconditioner by levels
SECONDS = 2.5e-9  # per point of a quarter of a transform and logarithm, all of a solve: Hertz 1024 x 1024 on one core
SAMPLE = 64  # ranks whose messages to neighbours are looked at, spread evenly
COLLECTIVES = "Allreduce", "allreduce", "allgather", "bcast"
ALL, AROUND = "all", "around"


class Network(NamedTuple):
    """Network: ranks of a machine, latency and gap of messages [s], bytes per second."""

    name: str
    ranks: int
    latency: float
    gap: float
    rate: float


INSIDE = Network("one machine", 1 << 30, 5e-7, 2e-7, 1e11)  # the rate is that of its memory
NETWORKS = [
    Network("InfiniBand", 64, 1.5e-6, 3e-7, 2.5e10),
    Network("Ethernet", 64, 3e-5, 3e-6, 3e9),
    Network("5 ms", 64, 5e-3, 3e-6, 1.2e9),
]


# -- recording -----------------------------------------------------------------------------------------------


class _Events(list):
    """Record of a message, with PETSc's own messages on the same grid."""

    def append(self, event):
        """Add an event; sums will be counted by PETSc, too."""
        petsc = logged_reductions() - self._ours
        if petsc > self._before:
            super().append(("petsc", self._key, petsc - self._before))
        self._before = petsc
        self._ours += event[0] == "sum"
        if event[0] in ("sum", "product", "kernel"):
            self._key = event[1]
        super().append(event)

    def clear(self):
        """Begin."""
        super().clear()
        self._ours, self._key, self._before = 0, ALL, logged_reductions()

    def __init__(self):
        self.clear()


@contextmanager
def recording():
    """Record the messages inside the block in a list. Collective."""
    events, holders, made = _Events(), [], set()

    def wrap(owner, name, before=lambda *a, **k: None, after=lambda result, *a, **k: result):
        plain = getattr(owner, name)

        def method(*arguments, **named):
            before(*arguments, **named)
            return after(plain(*arguments, **named), *arguments, **named)

        stack.enter_context(mock.patch.object(owner, name, method))

    def dealt(found, ranks, grid, size=None):
        slabs, comm = found
        slabs.key = grid, ALL if size and ranks not in made else 1 if size == 1 else None, ()
        made.add(ranks)
        if comm is not None:
            comm = Communicator(comm.plain(), comm.traffic)
            comm.key = slabs.key
        return slabs, comm

    def coarsened(slabs, fine, *factor):
        if slabs is not fine:
            grid, size, before = fine.key
            slabs.key = grid, size, (*before, *(factor or [AROUND]))
        return slabs

    def fetched(fetch, field, out=None):
        for holder, recipe in holders:
            for name, part in vars(holder).items():
                if part is fetch:
                    events.append(("rows", recipe, name, field.shape[1] * field.itemsize))
                    return
        events.append(("row", field.shape[1] * field.itemsize))

    def told(found, grids, operator, *_):
        hierarchy = grids.hierarchy
        level = hierarchy.levels[grids.following]
        if hierarchy.gains_ranks(operator, grids.following):
            events.pop()
        wide = ALL if hierarchy.may_be_windowed(level) else level.slabs.key
        events.append(("told", operator.slabs.key, wide))
        return found

    def multiplied(multiplier, *_, **__):
        if multiplier.comm is not None:
            kind = multiplier.slabs.key, multiplier.periods, multiplier.dtype.itemsize
            events.append(("product", *kind))

    def by_stencils(inverse, *_, **__):
        if inverse.comm is not None:
            events.append(("stencils", inverse.slabs.key, inverse.shape))

    def set_kernel(multiplier, _, rows, columns):
        if multiplier.comm is not None:
            kind = multiplier.slabs.key, multiplier.periods, multiplier.dtype.itemsize
            events.append(("kernel", *kind, rows))

    with ExitStack() as stack:
        wrap(RankGroups, "distribute", after=dealt)
        wrap(Slabs, "coarsen", after=coarsened)
        wrap(Slabs, "surround", after=coarsened)
        for kind in (Halo, CoarseHalo, Transfer, Scatter):
            wrap(
                kind,
                "__init__",
                after=lambda _, holder, *a, **k: holders.append((holder, recipe_of(holder, a, k))),
            )
        wrap(Fetch, "__call__", before=fetched)
        for name in COLLECTIVES:
            wrap(
                Communicator,
                name,
                before=lambda comm, *sent, **_: events.append(
                    ("sum", getattr(comm, "key", ALL), size_of(sent))
                ),
            )
        wrap(EvenMultiplier, "apply", before=multiplied)
        wrap(EvenMultiplier, "set_kernel", before=set_kernel)
        wrap(MultilevelOperator, "apply", before=by_stencils)
        wrap(GridSequence, "broadcast_to_next", after=told)
        for name in ("apply", "end"):  # ranks outside of the window are called, and let go
            wrap(VerificationProduct, name, before=lambda v, *_: events.append(("told", v._inner.key, ALL)))
        yield events


def size_of(sent):
    """Return the bytes of the arrays of a collective call; small ones count as 0."""
    return max((part.nbytes for part in sent if isinstance(part, np.ndarray)), default=0)


def recipe_of(holder, arguments, named):
    """Return the arguments that made an object, layouts by their keys, without communicators."""

    def known(value):
        if isinstance(value, Slabs):
            return "slabs", value.key
        if hasattr(value, "slabs"):
            return "operator", (value.slabs.key, value.grid)
        return ("comm", None) if isinstance(value, MPI.Comm) or value is None else ("value", value)

    return (
        type(holder),
        tuple(map(known, arguments)),
        tuple((name, known(value)) for name, value in named.items()),
    )


def hertz(n):
    """Return the paper's problem and its approach."""
    grid = Grid.from_domain(n, n, (-10.0, 10.0, -6.0, 6.0))
    return ContactProblem(grid, Material.combined(82000.0, 0.28), Paraboloid(300.0, 163.0)), 0.1091


def record(n, comm=None):
    """Solve Hertz's problem; return the messages of the first solve. Collective over two ranks."""
    problem, approach = hertz(n)
    with recording() as events, ContactSolver(problem, "fast", {"lcp_cells_per_rank": 1}, comm) as solver:
        events.clear()
        solution = solver.solve(approach=approach)
    return SimpleNamespace(
        grid=problem.grid,
        events=list(events),
        applications=solution.operator_applications,
        steps=sum(solution.history["inner_iterations"]),
    )


# -- replaying -----------------------------------------------------------------------------------------------


class Counting:
    """Stand-in for a communicator of `size` ranks that counts the messages of one rank."""

    def __init__(self, size, rank=0):
        self.size, self.rank, self.traffic, self.sent = size, rank, Traffic(), Counter()

    def Isend(self, rows, dest, tag=0):
        """Count an array."""
        self.sent[dest] += rows.nbytes
        return MPI.REQUEST_NULL

    def Recv(self, rows, source):
        """Get nothing."""

    def Alltoallv(self, sent, received):
        """Count parts."""
        array, (counts, _) = sent
        self.traffic.all_to_alls += 1
        self.traffic.messages += int(np.count_nonzero(counts))
        self.traffic.message_bytes += int(np.sum(counts)) * array.itemsize


class Replay:
    """Messages of the recorded solve on a number of ranks.

    Parameters
    ----------
    recorded : SimpleNamespace
        See `record`.
    ranks : int
    network : Network
    cells : int
        Least number of cells of a rank that shares a coarser grid or a window.

    Attributes
    ----------
    traffic : Traffic
        Of rank 0.
    petsc : int
        Reductions of PETSc's own, which traffic does not count.
    computing, communicating : float
        Seconds, of all in turn.
    """

    def __init__(self, recorded, ranks, network=INSIDE, cells=8192):
        self._network, self.sharing = network, ranks
        self._ranks = RankGroups.__new__(RankGroups)
        vars(self._ranks).update(comm=Counting(ranks), size=ranks, rank=0, cells=cells)
        self.traffic, self.petsc, self.computing, self.communicating = Traffic(), 0, 0.0, 0.0
        self._rows = cache(self._rows)
        self._exchange = cache(self._exchange)
        self._slabs = cache(self._slabs)
        for kind, *event in recorded.events:
            getattr(self, f"_{kind}")(*event) if kind != "rows" else self._neighbours(*event)

    def _slabs(self, key):
        grid, size, steps = key
        slabs = self._ranks.slabs(grid, self.sharing if size == ALL else size)
        for factor in steps:
            slabs = slabs.surround() if factor == AROUND else slabs.coarsen(factor)
        return slabs

    @property
    def seconds(self):
        """Return the time of computing and communicating."""
        return self.computing + self.communicating

    def size(self, key):
        """Return how many ranks share a grid."""
        return self.sharing if key == ALL else self._slabs(key).size

    def _tree(self, size, nbytes=0):
        """Seconds of a reduction or broadcast."""
        here = min(size, self._network.ranks)
        steps = np.ceil(np.log2([here, -(-size // here)]))
        costs = [near.latency + nbytes * here / near.rate for near in (INSIDE, self._network)]
        return float(steps @ costs)

    def _sum(self, key, nbytes=0):
        size = self.size(key)
        if size > 1:
            self.traffic.small_collectives += 1
            self.communicating += self._tree(size, nbytes)

    def _petsc(self, key, number):
        """Reductions by which PETSc makes vectors and matrices."""
        if self.size(key) > 1:
            self.petsc += number
            self.communicating += number * self._tree(self.size(key))

    def _told(self, key, wide):
        """Count a broadcast to the ranks that share only wider grids."""
        if self.size(key) < self.size(wide):
            self._sum(ALL)

    def _product(self, key, periods, itemsize):
        cells = periods[0] * periods[1] / 4
        seconds = SECONDS * (itemsize / 4) ** 0.8 * cells * np.log2(4 * cells)
        self.computing += seconds / self.size(key)
        for _ in range(2):
            self._all_to_all(key, periods, 2 * itemsize, None)

    def _stencils(self, key, shape):
        self.computing += STENCILS * shape[0] * shape[1] / self.size(key)

    def _kernel(self, key, periods, itemsize, rows):
        self._all_to_all(key, periods, itemsize, rows)

    def _all_to_all(self, *what):
        traffic = self._exchange(*what)
        if traffic is None:
            return
        for name, value in vars(traffic).items():
            setattr(self.traffic, name, getattr(self.traffic, name) + value)
        size, network = self.size(what[0]), self._network
        here = min(size, network.ranks)
        outside = (size - here) / (size - 1)  # of what is sent
        latency = network.latency if outside else INSIDE.latency
        gaps = traffic.messages * (outside * network.gap + (1 - outside) * INSIDE.gap)
        size = traffic.message_bytes * here
        rates = outside * size / network.rate + (1 - outside) * size / INSIDE.rate
        self.communicating += traffic.all_to_alls * latency + gaps + rates

    def _exchange(self, key, periods, itemsize, kernel_rows):
        """All-to-alls one way, of rank 0; None if there is nobody else."""
        slabs = self._slabs(key)
        if slabs.size == 1:
            return None
        comm = Counting(slabs.size)
        groups = deal_columns(periods[1] // 2 + 1, slabs.counts, comm)
        if kernel_rows is not None:
            counts = Slabs.over(comm, kernel_rows).counts
            groups = [ColumnGroup(g.edges[0], g.edges[-1], comm.size, 0, counts) for g in groups]
        nothing = np.empty(0, f"V{itemsize}")
        for group in groups:
            group.deal(comm, nothing, nothing)
        return comm.traffic

    def _neighbours(self, recipe, name, width):
        messages, size, seconds = self._rows(recipe, name, width)
        self.traffic.messages += messages
        self.traffic.message_bytes += size
        self.communicating += seconds

    def _row(self, width):
        """Count a row sent to the next rank of the target grid."""
        if self.sharing > 1:
            self.traffic.messages += 1
            self.traffic.message_bytes += width
            self.communicating += (self._network if self.sharing > self._network.ranks else INSIDE).latency

    def _rows(self, recipe, name, width):
        """Return messages and bytes of rank 0, and seconds of the slowest sampled rank."""
        kind, arguments, _ = recipe
        size = (
            self.size(arguments[0][1]) if kind in (Halo, CoarseHalo) else self.sharing
        )  # those between the ranks of a grid alone
        found, machine = [], self._network.ranks
        for rank in {*np.linspace(0, size - 1, SAMPLE, dtype=int).tolist()}:
            comm = Counting(size, rank)
            fetch = getattr(self._made(recipe, comm), name)
            fetch(np.empty((fetch.have.local, 1), f"V{width}"))
            outside = [sent for to, sent in comm.sent.items() if to // machine != rank // machine]
            inside = sum(comm.sent.values()) - sum(outside)
            here, there = len(comm.sent) - len(outside), len(outside)
            seconds = there * self._network.gap + sum(outside) / self._network.rate
            seconds += here * INSIDE.gap + inside * min(size, machine) / INSIDE.rate
            seconds += self._network.latency if there else INSIDE.latency if here else 0.0
            found.append((rank, len(comm.sent), sum(comm.sent.values()), seconds))
        _, messages, sent, _ = min(found)
        return messages, sent, max(seconds for *_, seconds in found)

    def _made(self, recipe, comm):
        """Make a holder, seen by one rank."""

        def slabs_of(key):
            slabs = self._slabs(key)
            return Slabs.starting(slabs.starts, comm.rank)

        def make(kind, value):
            if kind == "slabs":
                return slabs_of(value)
            if kind == "operator":
                return SimpleNamespace(slabs=slabs_of(value[0]), grid=value[1])
            return comm if kind == "comm" else value

        kind, arguments, named = recipe
        return kind(*(make(*part) for part in arguments), **{name: make(*part) for name, part in named})


# -- the table -----------------------------------------------------------------------------------------------


def recorded_on_two(n):
    """Return what `record` finds, in a job of two ranks."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "recorded"
        command = [
            "mpiexec",
            "-n",
            "2",
            "--oversubscribe",
            sys.executable,
            "-m",
            "benchmarks.replay",
            str(n),
            str(file),
        ]
        subprocess.run(command, cwd=ROOT, check=True, env=dict(os.environ))  # without what MPI has put there
        return pickle.loads(file.read_bytes())


def table(recorded, counts):
    """Return rows of all networks and numbers of ranks.

    Rows of a single machine are the same for all networks.
    """
    alone = Replay(recorded, 1).seconds
    for network in NETWORKS:
        for count in counts:
            if count <= network.ranks and network is not NETWORKS[0]:
                continue
            found = Replay(recorded, count, network)
            yield {
                "network": network.name if count > network.ranks else INSIDE.name,
                "ranks": count,
                "messages": found.traffic.messages,
                "MB": f"{found.traffic.message_bytes / 1e6:.3g}",
                "all-to-alls": found.traffic.all_to_alls,
                "small collectives": f"{found.traffic.small_collectives} + {found.petsc}",
                "computing": f"{1e3 * found.computing:.0f} ms",
                "communicating": f"{1e3 * found.communicating:.0f} ms",
                "speed-up": f"{alone / found.seconds:.3g}",
            }


def write_page(sizes, counts, output):
    """Replay Hertz's problem on some grids; write or show the tables."""
    parts = []
    for n in sizes:
        recorded = recorded_on_two(n)
        title = f"Hertz, {n} x {n}: {recorded.applications:.1f} applications, {recorded.steps} steps of CG\n"
        parts += [title, format_markdown(list(table(recorded, counts))), ""]
    publish(output, parts) if output else print("\n".join(parts))


if __name__ == "__main__":
    found = record(int(sys.argv[1]))
    if MPI.COMM_WORLD.rank == 0:
        Path(sys.argv[2]).write_bytes(pickle.dumps(found))
