"""Alternatives, loadings and requests from options."""

import re

import pytest

from app.base.errors import InputError
from app.cli.option_sources import ParsedOptions
from app.cli.problem_options import list_input_files, read_loading, resolve_alternatives, suggest_names


@pytest.fixture
def prescribed(read, files):
    """What is prescribed by a command line."""
    files(
        approach__opts="-approach 0.1 # mm\n",
        load__opts="# N\n-load 7e3\n",
        load__yml="lcp:\n  rtol: 1e-6\nload: 7e3\n",
        both__opts="-load 1\n-approach 2\n",
        own__opts="-options_file approach.opts\n-Load 8\n",
        replaced__opts="-options_file both.opts\n-load 8\n",
    )

    def value(line, **started_with):
        given = read(re.sub(r"(\w+\.(opts|yml))", r"-options_file \1", line), **started_with)
        return read_loading(given, resolve_alternatives(given))

    return value


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("approach.opts -approach 0.2", ("approach", 0.2)),
        ("approach.opts -load 5", ("load", 5)),
        ("-load 5 approach.opts", ("load", 5)),  # the command line wins wherever it stands
        ("-approach 5 load.opts", ("approach", 5)),
        ("-approach 5 approach.opts", ("approach", 0.1)),  # as in PETSc: a file counts where it stands
        ("-load 5 approach.opts -load 6", ("load", 6)),
        ("approach.opts load.opts", ("load", 7e3)),
        ("approach.opts load.yml", ("load", 7e3)),
        ("own.opts", ("load", 8)),  # a file comes after those that it includes
        ("both.opts -Approach 3", ("approach", 3)),
        ("replaced.opts", ("load", 8)),
        ("approach.opts -mean_gap 0", ("mean_gap", 0)),
        ("-mean_pressure 3 load.opts", ("mean_pressure", 3)),
    ],
)
def test_later_loading_replaces_an_earlier_one(prescribed, line, expected):
    assert prescribed(line) == expected


def test_replaced_loading_is_removed(read):
    given = read("-load 5", approach="0.3")
    assert read_loading(given, resolve_alternatives(given)) == ("load", 5)
    assert given.texts == {"load": "5"}


def test_command_line_overrides_petsc_options_variable(prescribed):
    assert prescribed("-load 5", approach="0.3") == ("load", 5)
    assert prescribed("", approach="0.3") == ("approach", 0.3)
    assert prescribed("load.opts", approach="0.3") == ("load", 7e3)


@pytest.mark.parametrize(
    ("line", "where"),
    [
        ("", "neither"),
        ("-approach 1 -load 2", "on the command line"),
        ("both.opts", "in both.opts"),
        # One place, however many files stand between.
        ("-approach 1 load.opts -load 2", "on the command line"),
    ],
)
def test_exactly_one_of_approach_and_load(prescribed, line, where):
    with pytest.raises(InputError, match=where):
        prescribed(line)


@pytest.mark.parametrize(
    ("line", "left"),
    [
        ("-options_file pair.opts", {"shear_modulus": "1", "poisson_ratio": "0.3"}),
        ("-options_file pair.opts -contact_modulus 5", {"contact_modulus": "5"}),
        ("-options_file pair.opts -options_file one.opts", {"contact_modulus": "7"}),
        ("-options_file one.opts -shear_modulus 2", {"shear_modulus": "2"}),
        ("-options_file pair.opts -shear_modulus 2", {"shear_modulus": "2", "poisson_ratio": "0.3"}),
        ("-surface_rms_height 1 -grid 8", {"surface_rms_height": "1", "grid": "8"}),
    ],
)
def test_later_material_replaces_an_earlier_one(read, files, line, left):
    files(pair__opts="-shear_modulus 1\n-poisson_ratio 0.3\n", one__opts="-contact_modulus 7\n")
    given = read(line)
    resolve_alternatives(given)
    assert given.texts == left


def test_two_materials_in_one_source_are_refused(read, files):
    files(both__opts="-contact_modulus 1\n-poisson_ratio 0.3\n")
    with pytest.raises(
        InputError, match="both -contact_modulus and -poisson_ratio are given in both.opts: exactly one"
    ):
        resolve_alternatives(read("-options_file both.opts"))


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
def test_unknown_options_are_named(texts, message):
    with pytest.raises(InputError) as refusal, suggest_names(ParsedOptions(texts)):
        raise InputError("what is wrong")
    assert str(refusal.value) == message


def test_input_files_include_modules_and_datasets():
    assert {"a.h5", "mine.py"} <= set(
        list_input_files({"gap_file": "a.h5:/b", "problem_type": "mine.py:bowl"})
    )
