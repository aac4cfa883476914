"""Solve one problem on one grid with every package that can."""

import math
from collections import defaultdict
from dataclasses import dataclass

from benchmarks.peers.processes import say
from benchmarks.peers.runs import Run

MAX_RATIO = 2  # of the times of two variants of a package, for the slower one to be kept


@dataclass(frozen=True)
class Comparison:
    """Runs of a problem on one grid by one loading; `unit` is the time of a plain product [s]."""

    problem: str
    size: int
    control: str
    unit: float
    ours: Run
    others: list[Run]


def compare(case, ours, solvers, field, folder):
    """Solve one case with all solvers; return a `Comparison` for each loading.

    The loading that the case does not state follows from our answer.

    Remove variants from `field` that need more than `MAX_RATIO` times the time of the best one of their package.
    """
    say(f"{case.name} {case.size}^2")
    unit = case.unit()
    our_runs = {}
    first, *others_of_ours = case.controls
    case.write()
    our_runs[first], pressure = ours[first].run(case, folder)
    if pressure is not None:
        case.learn(pressure)
        case.write()
        for control in others_of_ours:
            our_runs[control], _ = ours[control].run(case, folder)
    elif not case.known("load"):
        return [Comparison(case.name, case.size, first, unit, our_runs[first], [])]
    others = defaultdict(list)
    for name, searches in solvers.items():
        groups = defaultdict(list)
        for search in filter(lambda search: case.known(search.control), searches):
            group = groups[search.control]
            quickest = min((run.seconds for _, run in group if run.accepted), default=math.inf)
            group.append((search, search(case, folder, MAX_RATIO * quickest)))
        for control, found in groups.items():
            search, best = min(found, key=lambda pair: pair[1].rank())
            others[control].append(search.measure(case, folder, best) if best.accepted else best)
            for search, run in found:
                if best.accepted and not (run.accepted and run.seconds <= MAX_RATIO * best.seconds):
                    field[name].remove(search)
        unit = min(unit, case.unit())
    return [
        Comparison(case.name, case.size, control, unit, our_runs[control], found)
        for control, found in others.items()
    ]
