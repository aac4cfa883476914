"""``run/bench-peers``: install, measure, write the page."""

import argparse
import tempfile
from pathlib import Path

from benchmarks import peers
from benchmarks.bench import PROBLEMS
from benchmarks.measure import ROOT
from benchmarks.peers.cases import (
    HARDNESS_PROBLEMS,
    LAYER_PROBLEMS,
    PERIODIC_PROBLEMS,
    Case,
    HardnessCase,
    LayerCase,
    PeriodicCase,
    warm_up,
    warm_up_hardness,
    warm_up_layer,
    warm_up_periodic,
)
from benchmarks.peers.comparison import compare
from benchmarks.peers.packages import PEERS, set_up
from benchmarks.peers.page import page
from benchmarks.peers.runs import Search, Solver

# For each kind of patch: ending of the page's name, problems, sizes, warm-up.
KINDS = {
    "free": ("", PROBLEMS, "256,512,1024", warm_up),
    "periodic": ("-periodic", PERIODIC_PROBLEMS, "512,1024,2048", warm_up_periodic),
    "hardness": ("-hardness", HARDNESS_PROBLEMS, "512", warm_up_hardness),
    "layer": ("-layer", LAYER_PROBLEMS, "512", warm_up_layer),
}
CASES = {"periodic": PeriodicCase, "hardness": HardnessCase, "layer": LayerCase}


def main():
    """Install, measure, write the page."""
    parser = argparse.ArgumentParser("run/bench-peers", description=peers.__doc__)
    kinds = parser.add_mutually_exclusive_group()
    for kind, what in (
        ("periodic", "periodic patches"),
        ("hardness", "periodic patches with a hardness"),
        ("layer", "layers on a rigid base, periodic"),
    ):
        kinds.add_argument(
            f"--{kind}",
            dest="kind",
            action="store_const",
            const=kind,
            default="free",
            help=f"{what}, on a page",
        )
    sizes = ", ".join(f"{kind}: {usual}" for kind, (_, _, usual, _) in KINDS.items())
    parser.add_argument("--sizes", help=f"cells per side; default: {sizes}")
    parser.add_argument("--problems", help="default: all of the kind of patches")
    parser.add_argument("--only", help="packages; default: all")
    parser.add_argument("--limit", type=float, default=900, help="seconds for one process of a package")
    parser.add_argument("--budget", type=float, default=20, help="seconds for the repetitions of one solve")
    parser.add_argument(
        "--environments", default=str(ROOT / ".venv-peers"), help="where the packages are installed"
    )
    parser.add_argument(
        "-o", "--output", help="default: docs/notebook/benchmark-peers[-periodic|-hardness|-layer].md"
    )
    options = parser.parse_args()
    ending, problems_here, usual, make_warm_up = KINDS[options.kind]
    peers_here = [
        name for name, peer in PEERS.items() if options.kind == "free" or getattr(peer, options.kind)
    ]
    names = options.only.split(",") if options.only else peers_here
    problems = options.problems.split(",") if options.problems else list(problems_here)
    output = Path(options.output or ROOT / f"docs/notebook/benchmark-peers{ending}.md")
    for given, allowed in ((names, peers_here), (problems, problems_here)):
        if set(given) - set(allowed):
            parser.error(
                f"unknown: {', '.join(sorted(set(given) - set(allowed)))}; allowed: {', '.join(allowed)}"
            )
    sizes = sorted(int(size) for size in (options.sizes or usual).split(","))

    packages = {name: set_up(name, Path(options.environments)) for name in names}
    comparisons = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        warmup = make_warm_up(folder)
        searches = {
            name: [
                Search(package["python"], name, variant, description, warmup, options)
                for variant, description in package["variants"].items()
                if kind_of(description) == options.kind
            ]
            for name, package in packages.items()
            if "python" in package
        }
        ours = {
            control: Solver.ours(control, options.kind != "free", warmup, options)
            for control in ("approach", "load")
        }
        for problem in problems:
            starts = {search: search.start for group in searches.values() for search in group}
            field = {name: list(group) for name, group in searches.items()}
            for size in sizes:
                for case, solvers in cases(problem, size, folder, field, packages, options.kind):
                    comparisons += compare(case, ours, solvers, field, folder)
                    output.write_text(page(packages, comparisons, options.kind))
            for search, start in starts.items():
                search.start = start
    print(page(packages, comparisons, options.kind))


def kind_of(variant):
    """Kind of patches that a described variant solves."""
    return next((kind for kind in ("layer", "hardness", "periodic") if variant[kind]), "free")


def cases(problem, size, folder, field, packages, kind):
    """Yield the patches of a problem, and the solvers on each."""
    if kind != "free":
        yield CASES[kind](problem, size, folder), dict(field)
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
