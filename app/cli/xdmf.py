"""Write an XDMF file for ParaView: ``python -m app.xdmf RESULT.h5 ... [-o SERIES.xdmf]``.

Several results of one folder, such as the steps of a load path, become a time series. The times are the loads if loads
rise from result to result, otherwise 0, 1, 2, ... Exit status 0, or 2 after an error. Runs on one rank.
"""

from pathlib import Path

from app.cli import streams
from app.cli.arguments import Parser, command
from app.io.xdmf import write_xdmf


@command
def main(argv):
    """Run the command and return its exit status."""
    parser = Parser(
        prog="python -m app.xdmf", description="Write an XDMF file for ParaView, next to result files."
    )
    parser.add_argument(
        "results", type=Path, nargs="+", metavar="RESULT.h5", help="result files, in the order of time"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="F.xdmf", help="default: RESULT.xdmf, or FIRST-LAST.xdmf"
    )
    arguments = parser.parse_args(argv)
    streams.print_output(str(write_xdmf(arguments.results, arguments.output)))
    return 0
