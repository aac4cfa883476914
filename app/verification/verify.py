"""All that the program is trusted for, checked: ``python -m app.verify -o DIR [--only NAME ...] [--quick]``.

Analytic solutions with observed orders, invariances, independent solvers, every method by every loading, numbers of
ranks, the certificate against true errors. DIR gets ``verification.md``, the figures with their limits, and its
pictures ``verification-orders.png`` and ``verification-certificate.png``. All takes some minutes on one core; --quick,
small cases, half a minute.

Exit status: 0 all limits are kept; 1 some are not; 2 bad input; 130 interrupted, nothing is written.
"""

from __future__ import annotations

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
    parser = Parser(prog="python -m app.verify", description="All that the program is trusted for, checked.")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder to write to")
    parser.add_argument("--only", action="append", metavar="NAME", help="one check; may be repeated")
    parser.add_argument("--quick", action="store_true", help="small cases only")
    given = parser.parse_args(argv)
    from app.verification.document import (
        CHECKS,
        ORDERS,
        SHARPNESS,
        document,
        orders_picture,
        sharpness_picture,
    )

    names = given.only or list(CHECKS)
    for name in names:
        if name not in CHECKS:
            raise InputError(f"--only {name}: unknown; allowed: {', '.join(CHECKS)}")
    if "ranks" in names:
        check_ranks(2)
    check_folder(given.output)
    results = [_run(check, given.quick) for name, check in CHECKS.items() if name in names]
    given.output.mkdir(exist_ok=True)
    pictures = {ORDERS: orders_picture(results), SHARPNESS: sharpness_picture(results)}
    for name, picture in pictures.items():
        if picture is not None:
            save_figure(picture, given.output / name, dpi=100)
    arguments = "".join(f" --only {name}" for name in given.only or ()) + " --quick" * given.quick
    text = document(results, arguments, [name for name, picture in pictures.items() if picture is not None])
    write_text(given.output / "verification.md", text)
    failed = sum(len(result.failed) for result in results)
    verdict = f"{failed} limits are not kept" if failed else "all limits are kept"
    streams.print_output(f"{given.output / 'verification.md'}: {verdict}")
    return int(failed > 0)


def _run(check, quick):
    """Measure a check, and tell what does not keep its limits."""
    from app.verification.document import Result

    started = time.perf_counter()
    result = Result(check, tuple(check.measure(quick)), time.perf_counter() - started)
    streams.print_output(f"{result.verdict}  {check.name}: {result.judged} limits, {result.seconds:.1f} s")
    for figure in result.failed:
        streams.print_output(f"      {figure.what}: {figure.shown}, has to be {figure.limit}")
    return result
