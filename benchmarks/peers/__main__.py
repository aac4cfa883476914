"""``run/bench-peers``: install, measure, write the pages."""

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from benchmarks import peers
from benchmarks.bench import PROBLEMS
from benchmarks.measure import ROOT
from benchmarks.peers import cases
from benchmarks.peers.comparison import compare
from benchmarks.peers.packages import PEERS, set_up
from benchmarks.peers.page import page
from benchmarks.peers.processes import say
from benchmarks.peers.quotes import NOTEBOOK, write_quotes
from benchmarks.peers.runs import Search, Solver


@dataclass(frozen=True)
class Kind:
    """Kind of problems: what its option does, its page, problems, sizes, and the class of a case."""

    about: str
    page: str
    problems: dict
    sizes: str
    warm_up: callable
    case: type


KINDS = {
    "free": Kind("", "benchmark-peers", PROBLEMS, "512", cases.warm_up, cases.Case),
    "dilute": Kind(
        "small contacts on free patches, CPU seconds of set-up and solve",
        "dilute",
        cases.DILUTE_PROBLEMS,
        "1024,2048,4096",
        cases.warm_up_dilute,
        cases.DiluteCase,
    ),
    "periodic": Kind(
        "periodic patches",
        "benchmark-peers-periodic",
        cases.PERIODIC_PROBLEMS,
        "512",
        cases.warm_up_periodic,
        cases.PeriodicCase,
    ),
    "hardness": Kind(
        "periodic patches with a hardness",
        "benchmark-peers-hardness",
        cases.HARDNESS_PROBLEMS,
        "512",
        cases.warm_up_hardness,
        cases.HardnessCase,
    ),
    "layer": Kind(
        "layers on a rigid base, periodic",
        "benchmark-peers-layer",
        cases.LAYER_PROBLEMS,
        "512",
        cases.warm_up_layer,
        cases.LayerCase,
    ),
}
# The pages that --all writes: their names, and the options of each.
PAGES = {
    "benchmark-peers": ["--limit", "120"],
    "dilute": ["--dilute", "--limit", "120"],
    "benchmark-peers-periodic": ["--periodic", "--limit", "120"],
    "benchmark-peers-layer": ["--layer", "--limit", "60"],
    "benchmark-peers-periodic-1024": ["--periodic", "--only", "aspher", "--sizes", "1024", "--limit", "60"],
    "benchmark-peers-1024": ["--only", "aspher", "--sizes", "1024", "--limit", "60"],
    "benchmark-peers-hardness": ["--hardness", "--limit", "60", "--budget", "10"],
}


def make_parser():
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser("run/bench-peers", description=peers.__doc__)
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--all",
        nargs="?",
        const=",".join(PAGES),
        help=f"write pages: {', '.join(PAGES)}; default without other options: all of them",
    )
    for name, kind in KINDS.items():
        if kind.about:
            what.add_argument(
                f"--{name}", dest="kind", action="store_const", const=name, default="free", help=kind.about
            )
    what.add_argument("--quote", action="store_true", help="only copy the ratios of the pages into the docs")
    sizes = ", ".join(f"{name}: {kind.sizes}" for name, kind in KINDS.items())
    parser.add_argument("--sizes", help=f"cells per side; default: {sizes}")
    parser.add_argument("--problems", help="default: all of the kind of patches")
    parser.add_argument("--only", help="packages; default: all")
    parser.add_argument("--limit", type=float, default=900, help="seconds for one process of a package")
    parser.add_argument("--budget", type=float, default=20, help="seconds for the repetitions of one solve")
    parser.add_argument(
        "--environments", default=str(ROOT / ".venv-peers"), help="where the packages are installed"
    )
    parser.add_argument("-o", "--output", help="file of the page; default: docs/notebook/NAME.md")
    return parser


def main():
    """Write one page or all of them."""
    parser = make_parser()
    options = parser.parse_args()
    if options.quote:
        write_quotes()
    elif options.all or len(sys.argv) == 1:
        for name in ("sizes", "problems", "only", "limit", "budget", "output"):
            if getattr(options, name) != parser.get_default(name):
                parser.error(f"--{name}: has no effect with --all")
        names = (options.all or ",".join(PAGES)).split(",")
        check_names(parser, names, PAGES)
        for name in names:
            output = ["--environments", options.environments, "-o", str(NOTEBOOK / f"{name}.md")]
            started = time.perf_counter()
            write_page(parser, parser.parse_args([*PAGES[name], *output]), ["--all", name])
            write_quotes()
            say(f"{name}: {(time.perf_counter() - started) / 60:.1f} minutes")
    else:
        print(write_page(parser, options, sys.argv[1:]))


def check_names(parser, given, allowed):
    """Refuse names that are not allowed."""
    if unknown := set(given) - set(allowed):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; allowed: {', '.join(allowed)}")


def write_page(parser, options, words):
    """Measure, and write the page after each case; return it. `words` are the options that the page states."""
    kind = KINDS[options.kind]
    peers_here = [
        name for name, peer in PEERS.items() if options.kind == "free" or getattr(peer, options.kind)
    ]
    names = options.only.split(",") if options.only else peers_here
    problems = options.problems.split(",") if options.problems else list(kind.problems)
    check_names(parser, names, peers_here)
    check_names(parser, problems, kind.problems)
    output = Path(options.output or NOTEBOOK / f"{kind.page}.md")
    sizes = sorted(int(size) for size in (options.sizes or kind.sizes).split(","))

    packages = {name: set_up(name, Path(options.environments)) for name in names}
    comparisons = []
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        warmup = kind.warm_up(folder)
        searches = {
            name: [
                Search(package["python"], name, variant, description, warmup, options)
                for variant, description in variants_for(options.kind, package["variants"])
            ]
            for name, package in packages.items()
            if "python" in package
        }
        is_free = options.kind in ("free", "dilute")
        ours = {
            control: Solver.ours(control, not is_free, warmup, options) for control in ("approach", "load")
        }
        for problem in problems:
            starts = {search: search.start for group in searches.values() for search in group}
            field = {name: list(group) for name, group in searches.items()}
            for size in sizes:
                for case, solvers in cases_of(problem, size, folder, field, packages, options.kind):
                    comparisons += compare(case, ours, solvers, field, folder)
                    text = page(packages, comparisons, options.kind, words)
                    output.write_text(text, encoding="utf-8")
            for search, start in starts.items():
                search.start = start
    if not comparisons:
        parser.error(
            f"--sizes: none of these problems is solved at {', '.join(map(str, sizes))} cells per side"
        )
    return text


def variants_for(kind, variants):
    """Return names and descriptions of the variants for a kind of problems, in the order in which they are tried."""
    solves = "free" if kind == "dilute" else kind
    found = [(name, described) for name, described in variants.items() if kind_of(described) == solves]
    return sorted(found, key=lambda item: not item[1]["dilute"]) if kind == "dilute" else found


def kind_of(variant):
    """Kind of patches that a described variant solves."""
    return next((kind for kind in ("layer", "hardness", "periodic") if variant[kind]), "free")


def cases_of(problem, size, folder, field, packages, kind):
    """Yield the patches of a problem, and the solvers on each."""
    if kind == "dilute" and size > cases.DILUTE_PROBLEMS[problem][1]:
        return
    if kind != "free":
        yield KINDS[kind].case(problem, size, folder), dict(field)
        return
    usual = cases.Case(problem, size, folder)
    if usual.is_square:
        yield usual, dict(field)
        return
    for square in (False, True):
        solvers = {name: field[name] for name in field if packages[name]["square"] == square}
        if solvers:
            yield cases.Case(problem, size, folder, True) if square else usual, solvers


if __name__ == "__main__":
    main()
