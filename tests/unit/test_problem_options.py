"""Problems made from options: sizes that cannot be, before anything is read."""

import numpy as np
import pytest
from mpi4py import MPI

from app.base import memory
from app.base.errors import InputError
from app.cli.option_sources import ParsedOptions
from app.cli.problem_options import PROBLEM_OPTIONS, list_input_files, make_problem, suggest_names
from app.options.option_table import OptionReader
from app.problems.gap_file import GapFile


def made(**texts):
    given = {"domain": "0,1,0,1", "shear_modulus": "1", "poisson_ratio": "0.3", **texts}
    return make_problem(OptionReader(PROBLEM_OPTIONS, given), given, MPI.COMM_SELF)


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ({"laod": "10"}, "unknown option: -laod (did you mean -load?); what is wrong"),
        (
            {"aproach": "1", "lcp_rtoll": "1"},
            "unknown options: -aproach (did you mean -approach?), -lcp_rtoll (did you mean -lcp_rtol?); what is wrong",
        ),
        ({"load": "10", "sub_0_pc_type": "2", "radius": "2"}, "unknown option: -radius; what is wrong"),
        ({"problem": "python", "ksp_rtol": "1", "mylaw": "2"}, "what is wrong"),
        ({"lcp_merge": "1"}, "unknown option: -lcp_merge; what is wrong"),
    ],
)  # fmt: skip
def test_options_that_nobody_knows_are_named(texts, message):
    with pytest.raises(InputError) as refusal, suggest_names(ParsedOptions(texts)):
        raise InputError("what is wrong")
    assert str(refusal.value) == message


@pytest.mark.parametrize("grid", ["5000000000", "99999999999999999999"])
def test_more_cells_than_petsc_can_number(grid):
    with pytest.raises(InputError, match=f"grid {grid},{grid}: this PETSc can number"):
        made(problem="cone", cone_angle="1", grid=grid, approach="1")


@pytest.fixture
def sparse(tmp_path):
    """``sparse("gap.npy", n)``: a file of n x n cells without content, a few kB on the disk."""

    def make(name, n):
        import h5py

        path = tmp_path / name
        if name.endswith(".h5"):
            with h5py.File(path, "w") as file:
                file.create_dataset("gap", (n, n), "f8", chunks=(1000, 1000))
        else:
            with path.open("wb") as file:
                if name.endswith(".npy"):
                    header = {"descr": "<f8", "fortran_order": False, "shape": (n, n)}
                    np.lib.format.write_array_header_1_0(file, header)
                file.truncate(file.tell() + 8 * n * n)
        return str(path)

    return make


def small_machine(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 1 << 30)


@pytest.mark.parametrize("name", ["gap.h5", "gap.npy"])
def test_sparse_and_huge_gap_file(sparse, name, monkeypatch):
    small_machine(monkeypatch)
    with pytest.raises(ValueError, match=r"grid 40000,40000: needs about 107 GiB .* 1 GiB are free"):
        made(problem="file", gap_file=sparse(name, 40_000))
    with pytest.raises(InputError, match=r"grid 1000000,1000000: this PETSc can number 2147483647 cells"):
        made(problem="file", gap_file=sparse(name, 1_000_000))


def test_sparse_and_huge_text(sparse, monkeypatch):
    small_machine(monkeypatch)
    with pytest.raises(ValueError, match=r"needs 477 GiB of memory; 1 GiB are free"):
        GapFile(sparse("gap.txt", 40_000))


def test_grid_beyond_the_machine(monkeypatch):
    small_machine(monkeypatch)
    with pytest.raises(ValueError, match="grid 20000,20000: needs about 26.8 GiB"):
        made(problem="hertz", grid="20000", hertz_rx="1", hertz_ry="1")


@pytest.mark.parametrize("link", ["/gap", "/other"])
def test_dataset_linked_to_itself(tmp_path, link):
    import h5py

    with h5py.File(tmp_path / "gap.h5", "w") as file:
        file["gap"] = h5py.SoftLink(link)
        file["other"] = h5py.SoftLink("/gap")
    with pytest.raises(ValueError, match="cannot be read: .*too many links"):
        GapFile(f"{tmp_path}/gap.h5:/gap")


def test_gap_files_have_no_unit(tmp_path):
    np.savetxt(tmp_path / "gap.txt", np.zeros((4, 4)))
    with pytest.raises(InputError, match="-surface_unit um: has no effect here; gap files are in mm"):
        made(problem="file", gap_file=str(tmp_path / "gap.txt"), surface_unit="µm")


@pytest.mark.parametrize("kind", ["load", "approach"])
def test_default_patch_is_that_of_the_largest_step(kind):
    def patch(**loading):
        given = {"problem": "sphere", "sphere_radius": "10", "contact_modulus": "1e5", **loading}
        return make_problem(OptionReader(PROBLEM_OPTIONS, given), given, MPI.COMM_SELF)[0].grid

    assert patch(**{f"{kind}_path": "0.01,1,0.1"}) == patch(**{kind: "1"}) != patch(**{kind: "0.1"})
    with pytest.raises(InputError, match="-domain is missing: without contact"):
        patch(**{f"{kind}_path": "0,0"})


def test_input_files():
    assert {"a.h5", "mine.py"} <= set(
        list_input_files({"gap_file": "a.h5:/b", "problem_type": "mine.py:bowl"})
    )
