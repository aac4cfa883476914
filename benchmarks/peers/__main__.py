"""``run/bench-peers``: install, measure, write the page."""

import argparse
import tempfile
from pathlib import Path

from benchmarks import peers
from benchmarks.bench import PROBLEMS
from benchmarks.measure import ROOT
from benchmarks.peers.cases import PERIODIC_PROBLEMS, Case, PeriodicCase, warm_up, warm_up_periodic
from benchmarks.peers.comparison import compare
from benchmarks.peers.packages import PEERS, set_up
from benchmarks.peers.page import page
from benchmarks.peers.runs import Search, Solver


def main():
    """Install, measure, write the page."""
    parser = argparse.ArgumentParser("run/bench-peers", description=peers.__doc__)
    parser.add_argument("--periodic", action="store_true", help="periodic patches, on a page of their own")
    parser.add_argument("--sizes", help="cells per side; default: 256,512,1024, periodic: 512,1024,2048")
    parser.add_argument("--problems", help=f"default: all; periodic: {','.join(PERIODIC_PROBLEMS)}")
    parser.add_argument("--only", help="packages; default: all")
    parser.add_argument("--limit", type=float, default=900, help="seconds for one process of a package")
    parser.add_argument("--budget", type=float, default=20, help="seconds for the repetitions of one solve")
    parser.add_argument(
        "--environments", default=str(ROOT / ".venv-peers"), help="where the packages are installed"
    )
    parser.add_argument(
        "-o", "--output", help="default: benchmark-peers.md, benchmark-peers-periodic.md in docs/notebook/"
    )
    options = parser.parse_args()
    periodic = options.periodic
    peers_here = [name for name, peer in PEERS.items() if peer.periodic or not periodic]
    problems_here = list(PERIODIC_PROBLEMS if periodic else PROBLEMS)
    names = options.only.split(",") if options.only else peers_here
    problems = options.problems.split(",") if options.problems else problems_here
    output = Path(
        options.output
        or ROOT / "docs/notebook" / ("benchmark-peers-periodic.md" if periodic else "benchmark-peers.md")
    )
    for given, allowed in ((names, peers_here), (problems, problems_here)):
        if set(given) - set(allowed):
            parser.error(
                f"unknown: {', '.join(sorted(set(given) - set(allowed)))}; allowed: {', '.join(allowed)}"
            )
    usual = "512,1024,2048" if periodic else "256,512,1024"
    sizes = sorted(int(size) for size in (options.sizes or usual).split(","))

    packages = {name: set_up(name, Path(options.environments)) for name in names}
    comparisons = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        warmup = (warm_up_periodic if periodic else warm_up)(folder)
        searches = {
            name: [
                Search(package["python"], name, variant, description, warmup, options)
                for variant, description in package["variants"].items()
                if description["periodic"] == periodic
            ]
            for name, package in packages.items()
            if "python" in package
        }
        ours = {control: Solver.ours(control, periodic, warmup, options) for control in ("approach", "load")}
        for problem in problems:
            starts = {search: search.start for group in searches.values() for search in group}
            field = {name: list(group) for name, group in searches.items()}
            for size in sizes:
                for case, solvers in cases(problem, size, folder, field, packages, periodic):
                    comparisons += compare(case, ours, solvers, field, folder)
                    output.write_text(page(packages, comparisons, periodic))
            for search, start in starts.items():
                search.start = start
    print(page(packages, comparisons, periodic))


def cases(problem, size, folder, field, packages, periodic):
    """Yield the patches of a problem, and the solvers on each."""
    if periodic:
        yield PeriodicCase(problem, size, folder), dict(field)
        return
    usual = Case(problem, size, folder)
    if usual.is_square:
        yield usual, dict(field)
        return
    for square in (False, True):
        solvers = {name: field[name] for name in field if packages[name]["square"] == square}
        if solvers:
            yield Case(problem, size, folder, True) if square else usual, solvers


if __name__ == "__main__":
    main()
