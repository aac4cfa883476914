"""Verify the program: ``python -m app.verify -o DIR [--only NAME ...] [--quick]``.

The checks are analytic solutions with observed orders, invariances, independent solvers, every method with every
loading, numbers of ranks, and the certificate against true errors. DIR gets ``verification.md`` with all figures and
limits, and the pictures ``verification-orders.png`` and ``verification-certificate.png``. All checks take some minutes
on one core; ``--quick`` runs small cases in half a minute.

Exit status: 0 all limits are kept; 1 some are not; 2 bad input; 130 interrupted, with nothing written.
"""

import time
from pathlib import Path

from app.base.errors import InputError
from app.cli import streams
from app.cli.arguments import Parser, check_folder, check_ranks, command
from app.io.files import write_text
from app.plots.style import save_figure


@command
def main(argv):
    """Run the command and return its exit status."""
    parser = Parser(prog="python -m app.verify", description="Compare results with known solutions and laws.")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.add_argument("--only", action="append", metavar="NAME", help="one check; may be repeated")
    parser.add_argument("--quick", action="store_true", help="small cases only")
    arguments = parser.parse_args(argv)
    from app.verification import document
    from app.verification.document import CHECKS, ORDERS, SHARPNESS

    names = arguments.only or list(CHECKS)
    for name in names:
        if name not in CHECKS:
            raise InputError(f"--only {name}: unknown; allowed: {', '.join(CHECKS)}")
    if "ranks" in names:
        check_ranks(2)
    check_folder(arguments.output)
    results = [_run_check(check, arguments.quick) for name, check in CHECKS.items() if name in names]
    arguments.output.mkdir(exist_ok=True)
    pictures = {ORDERS: document.draw_orders(results), SHARPNESS: document.draw_sharpness(results)}
    pictures = {name: picture for name, picture in pictures.items() if picture is not None}
    for name, picture in pictures.items():
        save_figure(picture, arguments.output / name, dpi=100)
    words = "".join(f" --only {name}" for name in arguments.only or ()) + " --quick" * arguments.quick
    write_text(arguments.output / "verification.md", document.format_document(results, words, pictures))
    failed = sum(len(result.failed) for result in results)
    verdict = f"{failed} limits are not kept" if failed else "all limits are kept"
    streams.print_output(f"{arguments.output / 'verification.md'}: {verdict}")
    return int(failed > 0)


def _run_check(check, quick):
    from app.verification.document import Result

    started = time.perf_counter()
    result = Result(check, tuple(check.measure(quick)), time.perf_counter() - started)
    streams.print_output(f"{result.verdict}  {check.name}: {result.judged} limits, {result.seconds:.1f} s")
    for figure in result.failed:
        streams.print_output(f"      {figure.what}: {figure.shown}, must be {figure.limit}")
    return result
