"""Conversion of measured surfaces."""

import gzip
import hashlib
import zipfile
from subprocess import CompletedProcess
from unittest import mock

import h5py
import numpy as np
import pytest
import yaml
from processes import run

from app import read_surface
from app.cli.convert import find_instruments_python, main
from app.cli.instruments import FAULTY
from app.problems.surfaces.moments import Moments

HEIGHTS = np.random.default_rng(4).normal(size=(20, 16)).round(3)
SDF = """aISO-1.0
ManufacID = TEST
CreateDate = 010120260000
ModDate = 010120260000
NumPoints = 16
NumProfiles = 20
Xscale = 2e-6
Yscale = 3e-6
Zscale = 1e-9
Zresolution = -1
Compression = 0
DataType = 7
CheckType = 0
*
"""


@pytest.fixture
def convert(capsys):
    """``convert("s.xyz", ...)``: run app.convert in this process."""

    def run_here(*arguments):
        status = main([*map(str, arguments)])
        return CompletedProcess(arguments, status, *capsys.readouterr())

    return run_here


def test_points_are_converted_with_units_and_origin(tmp_path):
    x, y = np.meshgrid(2.0 * np.arange(16), 3.0 * np.arange(20))
    points = np.stack([x, y, HEIGHTS], -1).reshape(-1, 3)[::-1]
    np.savetxt(tmp_path / "s.xyz", np.delete(points, 5, axis=0), fmt="%.4f")
    done = run("-m", "app.convert", tmp_path / "s.xyz", "-o", tmp_path / "s.h5", "--unit", "um")
    assert done.returncode == 0, done.stderr
    assert "16 x 20 heights in um, cells of 2 x 3 um, patch of 32 x 60 um" in done.stdout
    with h5py.File(tmp_path / "s.h5") as file:
        assert np.isnan(file["heights"]).sum() == 1 == file["mask"][()].sum()
        np.testing.assert_array_equal(file["heights"][:18], HEIGHTS[:18])
        assert file["heights"].attrs["unit"] == "um" and list(file["heights"].attrs["spacing"]) == [2, 3]
        assert file.attrs["sha256"] == hashlib.sha256((tmp_path / "s.xyz").read_bytes()).hexdigest()
        assert file.attrs["source"] == "s.xyz"


def test_arrays_of_an_archive_are_converted_unchanged(convert, tmp_path):
    np.savez(tmp_path / "s.npz", heights=HEIGHTS, other=HEIGHTS.T, x=HEIGHTS[0])
    for name, heights in (("s.npz", HEIGHTS), ("s.npz:/other", HEIGHTS.T)):
        done = convert(tmp_path / name, "-o", tmp_path / "s.h5", "--unit", "um", "--spacing", "0.002,0.003")
        assert done.returncode == 0, done.stderr
        surface = read_surface(tmp_path / "s.h5")
        np.testing.assert_allclose(surface.heights(), 1e-3 * heights, rtol=1e-12)
        assert surface.spacing == (0.002, 0.003)


def test_summary_is_that_of_a_solve_and_computed_once(convert, tmp_path):
    heights = HEIGHTS[:, :15] + np.arange(15)
    heights[3, 4] = np.nan
    np.save(tmp_path / "s.npy", heights)
    options = ("--unit", "nm", "--spacing", "0.002,0.003", "--orient", "transpose,flip_x")
    with mock.patch("app.problems.surfaces.reading.Moments", wraps=Moments) as moments:
        done = convert(tmp_path / "s.npy", "-o", tmp_path / "s.h5", *options)
    assert moments.call_count == 1
    surface = read_surface(tmp_path / "s.h5")
    understood = surface.understood(surface.grid())
    assert done.stdout == f"{tmp_path / 's.h5'}: {understood}\n" and "1 of 300 points missing" in understood


def test_unreadable_heights_are_not_written(convert, tmp_path):
    np.save(tmp_path / "s.npy", np.full((3, 4), np.nan))
    (tmp_path / "s.h5").write_text("an earlier one")
    done = convert(tmp_path / "s.npy", "-o", tmp_path / "s.h5", "--unit", "um", "--spacing", "1,1")
    assert done.returncode == 2 and "s.npy: all points are missing" in done.stderr
    assert (tmp_path / "s.h5").read_text() == "an earlier one"


needs_reader = pytest.mark.skipif(
    find_instruments_python() is None, reason="SurfaceTopography is not installed: run/setup --surfaces"
)


@needs_reader
def test_instrument_format_is_converted(convert, tmp_path):
    text = "\n".join(" ".join(map(str, row)) for row in HEIGHTS)
    (tmp_path / "s.sdf").write_text(SDF + text.replace(str(HEIGHTS[7, 2]), "BAD", 1) + "\n*\n")
    done = convert(tmp_path / "s.sdf", "-o", tmp_path / "s.h5")
    assert done.returncode == 0, done.stderr
    surface = read_surface(tmp_path / "s.h5", crop=(3, 16, 0, 7))
    np.testing.assert_allclose(surface.heights(), 1e-6 * HEIGHTS[:7, 3:], rtol=1e-12)
    assert surface.spacing == pytest.approx((2e-3, 3e-3))
    assert convert(tmp_path / "s.sdf", "-o", tmp_path / "s.h5", "--channel", "phase").returncode == 2


def nanoscope(names):
    """An image file of an atomic force microscope, and the numbers of its channels."""
    sensor = "V [Sens. Zsens] (0.0003 V/LSB) 20 V"
    scales = {"Height": sensor, "Deflection": sensor, "Phase": "V (0.005 deg/LSB) 360 deg"}
    lines = [
        "*File list", "Version: 0x05120003", "Start context: OL", "*Scanner list", "@Sens. Zsens: V 10 nm/V",
        "*Ciao scan list", "Samps/line: 16", "Lines: 20", "Scan Size: 1600 nm",
    ]  # fmt: skip
    values = np.random.default_rng(2).integers(-3000, 3000, (len(names), 20, 16)).astype("<i2")
    for k, name in enumerate(names):
        lines += [
            "*Ciao image list", f"Data offset: {4096 + 640 * k}", "Data length: 640", "Bytes/pixel: 2",
            "Samps/line: 16", "Number of lines: 20", "Scan Size: 1600 4000 nm", f'@2:Image Data: S [{name}] "{name}"',
            f"@2:Z scale: {scales.get(name, 'V (0.0003 V/LSB) 20 V')}",
        ]  # fmt: skip
    text = "".join(f"\\{line}\r\n" for line in [*lines, "*File list end"])
    return text.encode("latin-1").ljust(4096, b"\0") + values.tobytes(), values * (20 / 65536 * 10)


@needs_reader
def test_only_channels_of_heights_are_offered(convert, tmp_path):
    def write(*names):
        content, heights = nanoscope(names)
        (tmp_path / "s.spm").write_bytes(content)
        (tmp_path / "s.spm.gz").write_bytes(gzip.compress(content))
        return 1e-6 * heights[:, ::-1]  # the last row is at the smallest y

    out = "-o", tmp_path / "s.h5"
    heights = write("Phase", "Height", "AmplitudeError", "Deflection")
    assert convert(tmp_path / "s.spm.gz", *out).returncode == 0
    np.testing.assert_allclose(read_surface(tmp_path / "s.h5").heights(), heights[1], rtol=1e-9, atol=1e-15)
    write("Phase", "AmplitudeError", "Deflection", "Amplitude")
    done = convert(tmp_path / "s.spm", *out)
    assert (
        done.returncode == 2 and "has no channel of heights, only Phase, AmplitudeError, Def" in done.stderr
    )
    heights = write("Height", "Phase", "Height")
    done = convert(tmp_path / "s.spm", *out, "--channel", "Height")
    assert (
        done.returncode == 2 and "allowed: 0 Height, 2 Height" in done.stderr and done.stderr.count("\n") == 1
    )
    assert convert(tmp_path / "s.spm", *out, "--channel", 2).returncode == 0
    np.testing.assert_allclose(read_surface(tmp_path / "s.h5").heights(), heights[2], rtol=1e-9, atol=1e-15)


@needs_reader
def test_archive_of_contact_engineering_is_converted(convert, tmp_path):
    """Maps are told apart by number; line scans are not offered."""
    text = "\n".join(" ".join(map(str, row)) for row in HEIGHTS)
    files = {"a.txt": text, "b.txt": text.replace("-", ""), "c.txt": "\n".join(map(str, HEIGHTS[0]))}
    measured = [("map", "a.txt", [32, 60]), ("map", "b.txt", [32, 60]), ("line", "c.txt", [32])]
    described = [
        {"name": name, "datafile": {"original": file}, "size": size, "unit": "nm", "data_source": 0}
        for name, file, size in measured
    ]
    files["meta.yml"] = yaml.dump({"surfaces": [{"name": "s", "topographies": described}]})
    arguments = tmp_path / "s.zip", "-o", tmp_path / "s.h5"

    def write(names):
        with zipfile.ZipFile(tmp_path / "s.zip", "w") as archive:
            for name in names:
                archive.writestr(name, files[name])

    write(files)
    done = convert(*arguments)
    assert done.returncode == 2 and "choose one by --channel: 0 map, 1 map\n" in done.stderr
    done = convert(*arguments, "--channel", 1)
    assert done.returncode == 0, done.stderr
    surface = read_surface(tmp_path / "s.h5")
    np.testing.assert_allclose(surface.heights(), 1e-6 * abs(HEIGHTS), rtol=1e-12)
    assert surface.spacing == pytest.approx((2e-6, 3e-6))
    write(["a.txt"])
    assert "is no archive of contact.engineering: unpack it" in convert(*arguments).stderr


@needs_reader
def test_text_of_an_instrument_is_converted(convert, tmp_path):
    """Wyko's lines go along y, in units of the wavelength."""
    head = (
        "Wyko ASCII Data File Format 0\t1\t0\nX Size\t16\nY Size\t20\nBlock Name\tType\tLength\tValue\n"
        "Wavelength\t7\t4\t500\nAspect\t7\t4\t1\nPixel_size\t7\t4\t0.002\nMult\t6\t2\t1000\nRAW_DATA\t3\t80\n"
    )
    rows = "\n".join("\t".join(map(str, row)) for row in HEIGHTS.T)
    (tmp_path / "s.asc").write_text(head + rows.replace(str(HEIGHTS[7, 2]), "Bad", 1))
    done = convert(tmp_path / "s.asc", "-o", tmp_path / "s.h5")
    assert done.returncode == 0, done.stderr
    surface = read_surface(tmp_path / "s.h5")
    assert surface.missing_points == 1 and surface.spacing == pytest.approx((2e-3, 2e-3))
    assert sorted(surface.shape) == [16, 20]


@pytest.mark.parametrize(("status", "message"), [(2, "is a mesh"), (FAULTY, "cannot be read: strange")])
def test_a_fault_in_a_known_format_is_quoted(convert, tmp_path, monkeypatch, status, message):
    """The exit status of the reader decides, not the names of folders."""
    reader, folder = tmp_path / "reader", tmp_path / "seen: as is"
    reader.write_text(f"#!/bin/sh\necho x >>$(dirname $0)/runs\necho strange >&2\nexit {status}\n")
    reader.chmod(0o755)
    monkeypatch.setenv("ELASTIC_CONTACT_SURFACES", str(reader))
    folder.mkdir()
    (folder / "s.stp").write_bytes(b"\x00\xff" * 400)
    done = convert(folder / "s.stp", "-o", tmp_path / "s.h5", "--unit", "nm", "--spacing", "1,1")
    assert done.returncode == 2 and message in done.stderr
    assert (tmp_path / "runs").read_text() == "x\n"


@needs_reader
def test_file_of_unknown_format_is_refused(convert, tmp_path):
    """Formats without a mark of their own fit to any file of a suitable size."""
    (tmp_path / "s.bin").write_bytes(b"\x00\xff" * 9)
    done = convert(tmp_path / "s.bin", "-o", tmp_path / "s.h5", "--unit", "um", "--spacing", "1,1")
    assert done.returncode == 2 and "is in no format that SurfaceTopography knows" in done.stderr


@pytest.mark.parametrize(
    ("said", "given", "message"),
    [
        ({"unit": "nm", "spacing": (2.0, 3.0)}, [], "in nm, cells of 3 x 2 nm,"),
        ({"unit": "pm", "spacing": (2.0, 3.0)}, [], "in pm, cells of 0.003 x 0.002 nm,"),
        ({"unit": "Å", "spacing": None}, ["--spacing", "2,3"], "in angstrom, cells of 3 x 2 mm,"),
        ({"unit": None, "spacing": (2.0, 3.0)}, ["--unit", "um"], "in um, cells of 3 x 2 um,"),
        ({"unit": "V", "spacing": (2.0, 3.0)}, ["--unit", "um", "--override"], "in um, cells of 3 x 2 um,"),
        ({"unit": "V", "spacing": (2.0, 3.0)}, ["--unit", "um"], "surface file s.sdf: says V, which is no length"),
        ({"unit": "V", "spacing": (2.0, 3.0)}, [], "surface file s.sdf: says V, which is no length"),
        ({"unit": "nm", "spacing": (2.0, 3.0)}, ["--spacing", "2,3", "--override"], "in nm, cells of 3 x 2 mm,"),
        ({"unit": "nm", "spacing": (2.0, 3.0)}, ["--override"], "--override: has no effect"),
        ({"unit": "pm", "spacing": None}, ["--unit", "um"], "--unit um: surface file s.sdf says pm"),
        ({"unit": "m", "spacing": (2.0, 3.0)}, ["--spacing", "2,3"], "--spacing: surface file s.sdf says 2 x 3 m "),
        ({"unit": None, "spacing": (2.0, 3.0)}, ["--height-unit", "nm"], "does not say the unit of its x and y"),
    ],
)  # fmt: skip
def test_units_of_an_instrument_need_no_option(convert, tmp_path, monkeypatch, said, given, message):
    facts = {**said, "format": "sdf", "channel": "Z"}
    monkeypatch.setattr("app.cli.convert._read_instruments", lambda *_: (HEIGHTS.copy(), facts))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.sdf").write_bytes(b"\x00\xff")
    done = convert("s.sdf", "-o", "s.h5", "--orient", "transpose", *given)
    assert message in done.stdout + done.stderr
    assert (done.returncode == 0) == (tmp_path / "s.h5").exists() == message.startswith("in ")
    if done.returncode == 0:
        surface = read_surface("s.h5")
        scale = {"pm": 1e-9, "angstrom": 1e-7, "nm": 1e-6, "um": 1e-3}[surface.unit]
        np.testing.assert_allclose(surface.heights(), scale * HEIGHTS.T, rtol=1e-12)


@pytest.mark.parametrize(
    ("unit", "spacing", "read"), [("nm", (2.0, 3.0), True), (None, None, False), (None, (2.0, 3.0), False)]
)
def test_texts_of_unknown_format_need_unit_and_spacing(convert, tmp_path, monkeypatch, unit, spacing, read):
    """A reader that picks numbers out of any text takes a NODATA_value for a height, and two maps for one."""
    facts = {"unit": unit, "spacing": spacing, "format": "asc", "channel": "Default"}
    monkeypatch.setattr("app.cli.convert._read_instruments", lambda *_: (HEIGHTS.copy(), facts))
    monkeypatch.setattr("app.cli.convert.find_instruments_python", lambda: True)
    lines = "\n".join(" ".join(map(str, row)) for row in HEIGHTS)
    (tmp_path / "s.txt").write_text(f"NODATA_value -9999\n{lines}\n")
    options = () if read else ("--unit", "um", "--spacing", "1,1")
    done = convert(tmp_path / "s.txt", "-o", tmp_path / "s.h5", *options)
    assert done.returncode == (0 if read else 2)
    assert read or "skip the line at the head" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["s.npy"], "--unit is missing: surface file "),
        (["s.npy", "--unit", "um"], "--spacing is missing: surface file "),
        (
            ["s.npy", "--unit", "inch", "--spacing", "1,1"],
            "--unit inch: must be one of m, cm, mm, um, nm, pm, angstrom, in (µm is um, Å is angstrom)",
        ),
        (["s.npy", "--unit", "um", "--spacing", "1"], "1: must be DX,DY"),
        (["s.npy", "-o", "s.txt"], "the name must end in .h5"),
        (["none.npy"], "no such file"),
        (["wide.h5"], "wide.h5: spacing wide: must be two positive numbers"),
        (["s.txt"], "s.txt: cannot be read: "),
    ],
)
def test_invalid_conversions_are_refused_in_one_line(convert, tmp_path, arguments, message):
    np.save(tmp_path / "s.npy", HEIGHTS)
    with h5py.File(tmp_path / "wide.h5", "w") as file:
        file["heights"] = HEIGHTS
        file["heights"].attrs.update(unit="um", spacing="wide")
    (tmp_path / "s.txt").write_text("wide\n")
    done = convert(tmp_path / arguments[0], "-o", tmp_path / "s.h5", *arguments[1:])
    assert done.returncode == 2 and not (tmp_path / "s.h5").exists()
    assert done.stderr.startswith("error: ") and message in done.stderr and done.stderr.count("\n") == 1
