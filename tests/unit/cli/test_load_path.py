"""Load paths of the command."""

from app.cli.load_path import merge_notes


def test_merged_notes_keep_the_signs_of_numbers():
    notes = [
        ["from -0.1 mm on, as in a-2.txt"],
        ["from -0.5 mm on, as in a-2.txt"],
        ["from 0.2 mm on, as in a-2.txt"],
    ]
    assert merge_notes(notes) == ["all steps: from -0.5 to 0.2 mm on, as in a-2.txt"]
