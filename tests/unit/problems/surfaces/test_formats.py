"""Formats of files: each is read, or refused with advice."""

import gzip

import pytest

from app import InputError, read_surface
from app.cli.convert import main as convert
from app.problems.gap_file import GapFile
from app.problems.surfaces.formats import FORMATS, detect_format

REFUSED = [
    *[(suffix, known.description) for known in FORMATS if known.kind == "other" for suffix in known.suffixes],
    (".zip", "an archive: unpack it, unless it is of contact.engineering; python -m app.convert"),
    (".npy.gz", "compressed: unpack it"),
    (".x3p.gz", "python -m app.convert FILE"),
]


@pytest.mark.parametrize(("suffix", "message"), REFUSED, ids=[suffix for suffix, _ in REFUSED])
def test_formats_that_are_not_read_are_refused_with_advice(tmp_path, capsys, suffix, message):
    path = tmp_path / f"s{suffix}"
    path.write_bytes(gzip.compress(b"\x00\xff") if suffix.endswith(".gz") else b"\x89PNG\r\n\x1a\n\x00")
    with pytest.raises(InputError) as refused:
        read_surface(path, "um")
    assert message in str(refused.value) and "\n" not in str(refused.value)
    with pytest.raises(InputError):
        GapFile(path)
    assert convert([str(path), "-o", str(tmp_path / "s.h5"), "--unit", "um", "--spacing", "1,1"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ") and error.count("\n") == 1


def test_each_suffix_has_one_format():
    suffixes = [suffix for known in FORMATS for suffix in known.suffixes]
    assert len(suffixes) == len(set(suffixes))


@pytest.mark.parametrize(
    ("head", "name_of_format"),
    [
        ("Wyko ASCII Data File Format\t0\nRAW_DATA\t3\n", "Wyko's ASCII format"),
        ("aISO-1.0\n", "an SDF file"),
        ("# File Format = ASCII\n# Bit2nm = 0.1\n", "SPIP's"),
    ],
)
@pytest.mark.parametrize("name", ["s.asc", "s.txt", "s.sdf"])
def test_texts_of_instruments_are_sent_to_their_reader(tmp_path, head, name_of_format, name):
    (tmp_path / name).write_text(f"{head}0.5 1.5 2\n3 4 5.25\n")
    with pytest.raises(InputError, match=f"is {name_of_format}.*app.convert FILE -o surface.h5"):
        read_surface(tmp_path / name, "um")
    assert read_surface(tmp_path / name, "um", skip=head.count("\n")).shape == (2, 3)
    assert detect_format(tmp_path / name).kind == "instrument"


def test_binary_files_named_like_texts_are_sent_to_their_reader(tmp_path):
    (tmp_path / "zygo.dat").write_bytes(b"\x88\x1b\x03\x6f\x00\x01\xff")
    with pytest.raises(InputError, match="app.convert FILE -o surface.h5 reads what instruments write"):
        read_surface(tmp_path / "zygo.dat", "um")
