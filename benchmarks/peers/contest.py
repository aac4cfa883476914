"""One problem on one grid, solved by everything that can."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

from benchmarks.peers.processes import say
from benchmarks.peers.runs import Run, run_ours


@dataclass(frozen=True)
class Contest:
    """What solved one problem on one grid with one thing given; `unit`: seconds of a plain product."""

    problem: str
    size: int
    control: str
    unit: float
    ours: Run
    others: list[Run]


def compare(case, entrants, field, folder):
    """Run one problem on one grid with everything that can.

    Variants that need more than twice the time of the best one of their package are taken out of `field`.
    """
    say(f"{case.name} {case.size}^2")
    unit = case.unit()
    ours = {}
    first, second = case.controls
    ours[first], facts = run_ours(case, first, 3, folder)
    if facts is not None:
        setattr(case, second, facts[second])
        ours[second], _ = run_ours(case, second, 3, folder)
    elif not case.known("load"):
        return [Contest(case.name, case.size, first, unit, ours[first], [])]
    problem_file = case.write()
    others = defaultdict(list)
    for name, searches in entrants.items():
        groups = defaultdict(list)
        for search in filter(lambda search: case.known(search.control), searches):
            groups[search.control].append((search, search(case, problem_file, folder)))
        for control, found in groups.items():
            best = min((run for _, run in found), key=Run.rank)
            others[control].append(best)
            for search, run in found:
                if best.accepted and not (run.accepted and run.seconds <= 2 * best.seconds):
                    field[name].remove(search)
        unit = min(unit, case.unit())
    return [
        Contest(case.name, case.size, control, unit, ours[control], found)
        for control, found in others.items()
    ]
