"""Channels of instruments."""

import gzip
import io
import json
import struct
import subprocess
import zipfile
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from app.cli import instruments
from app.cli.convert import find_instruments_python, main


@pytest.mark.parametrize(
    ("wanted", "chosen"),
    [
        ("3", 3),
        ("0", 0),
        ("ZSensor", 3),
        ("", "several channels of heights; choose one by --channel: 0 Height, 2 Height, 3 ZSensor"),
        ("Height", "several have this name, choose by number; allowed: 0 Height, 2 Height, 3 ZSensor"),
        ("Phase", "it is no map of heights; allowed: 0"),
        ("1", "it is no map of heights; allowed: 0"),
        ("4", "there is none; allowed: 0"),
    ],
)
def test_channel_is_found_by_name_or_number(wanted, chosen):
    names = "Height", "Phase", "Height", "ZSensor"
    channels = [instruments.Channel(k, name, name != "Phase", None) for k, name in enumerate(names)]
    if isinstance(chosen, int):
        assert instruments.choose_channel(channels, wanted).index == chosen
        return
    with pytest.raises(instruments.FaultyFile, match=chosen):
        instruments.choose_channel(channels, wanted)


@pytest.mark.parametrize("unit", ["nm", ("nm", "V"), ("nm", None)])
@pytest.mark.parametrize("name", ["Height", "ZSensor", "Deflection", "AmplitudeRetrace", "Phase", "Lateral"])
def test_channels_of_heights_have_lengths_and_names(unit, name):
    """Deflection and amplitude may be lengths, too; a pair of units is that of another quantity."""
    channel = SimpleNamespace(index=3, name=name, unit=unit, is_height_channel=True)
    assert instruments._channel(channel).has_heights == (unit == "nm" and name in ("Height", "ZSensor"))


CODES = np.random.default_rng(4).integers(0, 60000, (7, 10)).astype("<u2")
X3P = """<?xml version="1.0" encoding="UTF-8"?><p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2"><Record1>
<Revision>{}</Revision><FeatureType>SUR</FeatureType><Axes><CX><AxisType>I</AxisType><DataType>D</DataType><Increment>
2E-6</Increment><Offset>0</Offset></CX><CY><AxisType>I</AxisType><DataType>D</DataType><Increment>3E-6</Increment>
<Offset>0</Offset></CY><CZ><AxisType>A</AxisType><DataType>D</DataType><Increment>1</Increment><Offset>0</Offset></CZ>
</Axes></Record1><Record3><MatrixDimension><SizeX>10</SizeX><SizeY>7</SizeY><SizeZ>1</SizeZ></MatrixDimension><DataLink>
<PointDataLink>z.bin</PointDataLink><MD5ChecksumPointData>0</MD5ChecksumPointData></DataLink></Record3></p:ISO5436_2>"""


def archive(**files):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as written:
        for name, content in files.items():
            written.writestr(name.replace("_", "."), content)
    return file.getvalue()


def x3p(revision="ISO5436 - 2000", size=70):
    return archive(main_xml=X3P.format(revision), z_bin=(1e-9 * CODES).astype("<f8").tobytes()[: 8 * size])


def nanofocus():
    head = bytearray(3468)
    struct.pack_into("<2d", head, 16, 0.0, 65.534)
    struct.pack_into("<2I2d", head, 1368, 10, 7, 2e-3, 3e-3)
    codes = CODES.copy()
    codes[2, 3] = 65535
    return bytes(head) + codes.tobytes()


def digital_surf(kind=2, bits=16):
    def words(*texts):
        return b"".join(text.encode("latin-1").ljust(16, b"\0") for text in texts)

    return b"".join([
        b"DIGITAL SURF", struct.pack("<4H", 0, 1, 1, kind), bytes(78), struct.pack("<H", bits),
        struct.pack("<5i", 0, 60000, 10, 7, 70), struct.pack("<3f", 2e-3, 3e-3, 1e-3),
        words("X", "Y", "Z", "mm", "mm", "\xb5m", "mm", "mm", "\xb5m"), struct.pack("<3f", 1, 1, 1), bytes(18),
        struct.pack("<7H", 0, 0, 0, 1, 1, 2020, 1), bytes(192), (CODES // 2).astype("<i2").tobytes(),
    ])  # fmt: skip


def contact_engineering():
    described = {"name": "map", "datafile": {"original": "a.txt"}, "size": [20, 21], "unit": "nm"}
    return archive(index_json=json.dumps({"surfaces": [{"name": "s", "topographies": [described]}]}))


FILES = {
    "a.x3p": (x3p(), "70 0"),
    "old.x3p": (x3p("ISO5436 - 98"), "as X3P: Revision should be 'ISO5436 - 2000'"),
    "short.x3p": (x3p(size=69), "as X3P: The file ended"),
    "no.x3p": (b"no\xff\0", "is in no format"),
    "a.nms": (nanofocus(), "69 1"),
    "a.nms.gz": (gzip.compress(nanofocus()), "69 1"),
    "short.nms": (nanofocus()[:-2], "no NMS: File too small"),
    "renamed.bin": (nanofocus(), "is in no format"),
    "a.sur": (digital_surf(), "70 0"),
    "renamed.x3p": (digital_surf(), "70 0"),
    "series.sur": (digital_surf(kind=5), "as SUR: is a series of surfaces"),
    "wide.sur": (digital_surf(bits=64), "as SUR: "),
    "alone.zip": (contact_engineering(), "as CE: lacks the file 'a.txt'"),
    "wrong.zip": (
        archive(index_json='{"surfaces": [{}]}'),
        "as CE: The container's 'index.json' does not conform",
    ),
    "other.zip": (archive(a_txt="1 2"), "is no archive of contact.engineering"),
    "a.hdf": (b"\x89HDF\r\n\x1a\n", "is HDF5 of no known instrument"),
}


@pytest.mark.skipif(find_instruments_python() is None, reason="needs SurfaceTopography: run/setup --surfaces")
def test_the_reader_that_knows_a_file_reads_it_or_names_its_fault(tmp_path):
    """One process reads all files: to import the readers takes seconds."""
    for name, (content, _) in FILES.items():
        (tmp_path / name).write_bytes(content)
    code = (
        "import sys, warnings, numpy as np; sys.path.insert(0, sys.argv[1]); from instruments import read_heights\n"
        "warnings.simplefilter('ignore')\n"
        "for path in sys.argv[2:]:\n"
        "    try: missing = np.isnan(read_heights(path, '')[0]); print((~missing).sum(), missing.sum())\n"
        "    except Exception as error: print(str(error).splitlines()[0], type(error).__name__)\n"
    )
    folder, paths = Path(instruments.__file__).parent, [tmp_path / name for name in FILES]
    done = subprocess.run(
        [find_instruments_python(), "-P", "-c", code, folder, *paths],
        capture_output=True,
        text=True,
        check=True,
    )
    for line, (name, (_, expected)) in zip(done.stdout.splitlines(), FILES.items(), strict=True):
        assert line.startswith(expected), (name, line)
        assert ("FaultyFile" in line) == expected.startswith("as "), (name, line)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("s.sur", b"DSCOMPRESSED" + digital_surf()[12:], "is compressed by Digital Surf: save it without"),
        ("s.h5-jpk", None, "is a JPK file of HDF5, which holds raw counts and thumbnails"),
        ("s.h5", None, "it is a JPK file of HDF5, which holds raw counts and thumbnails"),
        ("s.h5:/Measurement_000/Channel_000/Image", None, "it is a JPK file of HDF5"),
    ],
)
def test_files_whose_numbers_are_no_heights_are_refused_by_name(tmp_path, capsys, name, content, message):
    path = tmp_path / name.partition(":/")[0]
    if content:
        path.write_bytes(content)
    else:
        with h5py.File(path, "w") as file:
            file["Measurement_000/Channel_000/Image"] = CODES.astype("i4")
    arguments = tmp_path / name, "-o", tmp_path / "out.h5", "--unit", "um", "--spacing", "1,1"
    assert main([*map(str, arguments)]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1
