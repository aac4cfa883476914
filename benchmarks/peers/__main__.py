"""``run/bench-peers``: install, measure, write the page."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from benchmarks import peers
from benchmarks.bench import PROBLEMS, ROOT
from benchmarks.peers.cases import Case, warm_up
from benchmarks.peers.contest import compare
from benchmarks.peers.packages import PEERS, set_up
from benchmarks.peers.page import page
from benchmarks.peers.runs import Search


def main():
    """Install, measure, write the page."""
    parser = argparse.ArgumentParser("run/bench-peers", description=peers.__doc__)
    parser.add_argument("--sizes", default="256,512,1024", help="cells per side")
    parser.add_argument("--problems", default=",".join(PROBLEMS))
    parser.add_argument("--only", default=",".join(PEERS), help="packages")
    parser.add_argument("--limit", type=float, default=900, help="seconds for one process of a package")
    parser.add_argument("--budget", type=float, default=20, help="seconds for the repetitions of one solve")
    parser.add_argument(
        "--environments", default=str(ROOT / ".venv-peers"), help="where the packages are installed"
    )
    parser.add_argument("-o", "--output", default=str(ROOT / "docs" / "benchmark-peers.md"))
    options = parser.parse_args()
    names, problems = options.only.split(","), options.problems.split(",")
    for given, allowed in ((names, PEERS), (problems, PROBLEMS)):
        if set(given) - set(allowed):
            parser.error(
                f"unknown: {', '.join(sorted(set(given) - set(allowed)))}; allowed: {', '.join(allowed)}"
            )
    sizes = sorted(int(size) for size in options.sizes.split(","))

    packages = {name: set_up(name, Path(options.environments)) for name in names}
    contests = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        warmup = warm_up(folder)
        searches = {
            name: [
                Search(package["python"], name, variant, description, warmup, options)
                for variant, description in package["variants"].items()
            ]
            for name, package in packages.items()
            if "python" in package
        }
        for problem in problems:
            starts = {search: search.start for group in searches.values() for search in group}
            field = {name: list(group) for name, group in searches.items()}
            for size in sizes:
                for square in (False, True):
                    entrants = {name: field[name] for name in field if packages[name]["square"] == square}
                    case = Case(problem, size, folder, square)
                    if case.is_square:
                        entrants = dict(field) if not square else {}
                    if entrants:
                        contests += compare(case, entrants, field, folder)
                        Path(options.output).write_text(page(packages, contests))
            for search, start in starts.items():
                search.start = start
    print(page(packages, contests))


if __name__ == "__main__":
    main()
