"""Problems made from options, as on the command line."""

from mpi4py import MPI

from app.cli.geometry import make_problem
from app.cli.problem_options import PROBLEM_OPTIONS
from app.options.option_table import OptionReader

ROUGH = {
    "problem": "rough", "domain": "-1,2,0,2", "contact_modulus": "100", "surface_cutoff": "0.25",
    "surface_rolloff": "1", "surface_rms_slope": "0.1", "surface_seed": "5", "periodic": "",
}  # fmt: skip


def problem_from(without=(), **texts):
    """Return the problem of some options, of E* 1e5 N/mm2 by default, or without some."""
    texts = {"contact_modulus": "1e5"} | {name: str(text) for name, text in texts.items()}
    texts = {name: text for name, text in texts.items() if name not in without}
    return make_problem(OptionReader(PROBLEM_OPTIONS, texts), texts, MPI.COMM_SELF)[0]


def rough_problem(grid, without=(), **texts):
    """Return a self-affine rough problem on a grid, with other options, or without some."""
    return problem_from(without, **{**ROUGH, "grid": grid, **texts})
