"""Load paths of the command."""

import tracemalloc
from types import SimpleNamespace

import pytest
from mpi4py import MPI

from app.cli.load_path import hash_inputs, merge_notes
from app.parameter_study.run import Run


def test_merged_notes_keep_the_signs_of_numbers():
    notes = [
        ["from -0.1 mm on, as in a-2.txt"],
        ["from -0.5 mm on, as in a-2.txt"],
        ["from 0.2 mm on, as in a-2.txt"],
    ]
    assert merge_notes(notes) == ["all steps: from -0.5 to 0.2 mm on, as in a-2.txt"]


def test_merged_notes_have_ranges_of_numbers():
    """Surfaces whose names differ in a number only have notes of their own; a plural follows a singular."""
    tilts = ["s1.npy: is tilted by 1 um", "s2.npy: is tilted by 2 um"]
    steps = [[*tilts, "at most 1 cell wide"], [*tilts, "at most 2 cells wide", "the pressure is 0.3 E*"]]
    steps.append([*tilts, "the pressure is 1.5 E*"])
    assert merge_notes(steps) == [
        *(f"all steps: {note}" for note in tilts),
        "steps 1, 2: at most 1 to 2 cells wide",
        "steps 2, 3: the pressure is 0.3 to 1.5 E*",
    ]


@pytest.mark.parametrize("of", ["path", "sweep"])
def test_hashing_an_input_needs_little_memory(tmp_path, of):
    """Measured surfaces are large, and rank 0 of a path has work arrays beside them."""
    size, file = 32 << 20, tmp_path / "surface.npy"
    with file.open("wb") as large:
        large.truncate(size)
    path = SimpleNamespace(
        inputs=[file, tmp_path / "absent"], relevant_options="", kind="load", numbers=(1.0,)
    )
    keys, run = [], Run(options={"surface_file": str(file)})
    for end in b"", b"\1":
        with file.open("ab") as large:
            large.write(end)
        tracemalloc.start()
        keys.append(hash_inputs(path, SimpleNamespace(comm=MPI.COMM_SELF)) if of == "path" else run.key())
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < size / 4
    assert keys[0] != keys[1]
