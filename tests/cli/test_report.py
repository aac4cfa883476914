"""Bad input of report, subsurface and xdmf."""

import pytest
from mpi4py import MPI
from results import made_up_result, with_attributes, write

from app.cli import report, subsurface, xdmf
from app.parallel.slabs import Slabs


@pytest.fixture(scope="module")
def made():
    return with_attributes(made_up_result(64, 48), notes="first note\nsecond note", error_bound=3e-4)


@pytest.fixture
def path(made, tmp_path):
    write(tmp_path / "result.h5", MPI.COMM_SELF, Slabs(48), made)
    return tmp_path / "result.h5"


@pytest.mark.parametrize(
    "command, arguments, message",
    [
        (report, ["absent.h5"], "absent.h5: no such file"),
        (report, ["RESULT", "-o", "report.pdf"], "must end in .html"),
        (report, ["RESULT", "-o", "/proc/report.html"], "cannot write in /proc"),
        (report, ["RESULT", "-o", "no/report.html"], "no does not exist"),
        (report, ["absent.h5", "--poisson", "0.7"], "--poisson 0.7: must be from 0 to 0.5"),
        (report, ["RESULT", "--body", "3"], "--body 3: must be 1 or 2"),
        (subsurface, ["absent.h5", "--poisson", "-1"], "--poisson -1: must be from 0 to 0.5"),
        (subsurface, ["RESULT", "--poisson", "abc"], "--poisson abc: must be from 0 to 0.5"),
        (subsurface, ["RESULT", "--body", "2"], "not those of the bodies"),
        (subsurface, ["RESULT", "--planes", "1"], "no effect without -o"),
        (
            subsurface,
            ["RESULT", "--section", "y", "--depths", "9"],
            "--section, --depths: no effect without -o",
        ),
        (report, ["RESULT", "--no-stress", "--poisson", "0.3"], "no effect with --no-stress"),
        (subsurface, ["RESULT", "-o", "TMP", "--planes", "1,-2"], "--planes 1,-2: must be"),
        (subsurface, ["RESULT", "-o", "TMP", "--at", "1"], "must be X,Y"),
        (subsurface, ["RESULT", "-o", "TMP", "--at", "-1,2,3"], "must be X,Y"),
        (subsurface, ["RESULT", "-o", "TMP", "--deepest", "1,2"], "one positive number"),
        (subsurface, ["RESULT", "-o", "TMP", "--deepest", "0"], "one positive number"),
        (subsurface, ["RESULT", "-o", "RESULT"], "not a folder"),
        (xdmf, ["absent.h5"], "absent.h5"),
        (xdmf, ["RESULT", "-o", "series.xml"], "must end in .xdmf"),
        (xdmf, ["RESULT", "-o", "/series.xdmf"], "must lie in the folder"),
    ],
)
def test_bad_input_is_one_line(path, tmp_path, capsys, command, arguments, message):
    names = {"RESULT": str(path), "TMP": str(tmp_path), "TMP/r.html": str(tmp_path / "r.html")}
    assert command.main([names.get(argument, argument) for argument in arguments]) == 2
    out, err = capsys.readouterr()
    assert out == "" and err.startswith("error: ") and err.count("\n") == 1 and message in err
    assert list(tmp_path.iterdir()) == [path]
