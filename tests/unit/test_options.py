"""Values of options, option files, and which of approach and load counts."""

import re

import pytest
from processes import OPTIONS
from running import petsc_options

from app.options import Options, loading
from app.session import InputError, option_names

BAD_VALUES = [
    ("problem", "herz", "one of hertz"),
    ("problem", "", "one of hertz"),
    ("grid", "8,-8", "nx,ny or n"),
    ("grid", "10,20,30", "nx,ny or n"),
    ("grid", "8.5", "nx,ny or n"),
    ("grid", "", "nx,ny or n"),
    ("grid", ",", "nx,ny or n"),
    ("grid", "60000", "at most 2147483647 cells"),
    ("grid", "99999999999999999999", "at most 2147483647 cells"),
    ("domain", "0,0,0,1", "x0 < x1"),
    ("domain", "0,1", "x0,x1,y0,y1"),
    ("domain", "0,1,0,1,2", "x0,x1,y0,y1"),
    ("domain", "0,inf,0,1", "x0,x1,y0,y1"),
    ("domain", "-1e308,1e308,0,1", "x0,x1,y0,y1"),
    ("shear_modulus", "-82000", "a positive number"),
    ("shear_modulus", "1e-320", "1e-50 to 1e+50"),
    ("poisson_ratio", "-0.1", "from 0 to 0.5"),
    ("poisson_ratio", "nan", "from 0 to 0.5"),
    ("approach", "deep", "a finite number"),
    ("approach", "", "a finite number"),
    ("approach", "nan", "a finite number"),
    ("approach", "1e200", "1e-50 to 1e+50"),
    ("hertz_rx", "0", "a positive number"),
    ("lcp_nested", "maybe", "true or false"),
    ("lcp_rtol", "0", "a positive number"),
    ("lcp_max_it", "0", "a whole number"),
    ("lcp_max_it", "1e3", "a whole number"),
    ("lcp_beta", "-1", "a number from 0"),
    ("gap_file", "", "a name must follow"),
    ("output", "", "a name must follow"),
]


@pytest.mark.parametrize(("name", "text", "allowed"), BAD_VALUES)
def test_value_that_is_not_allowed(name, text, allowed):
    with petsc_options(**{name: text}), pytest.raises(InputError) as refusal:
        Options()[name]
    wrong = f"-{name} {text}: not allowed" if text else f"-{name}: its value is missing"
    assert str(refusal.value).startswith(f"{wrong}; allowed: ")
    assert allowed in str(refusal.value)


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("grid", "8", (8, 8)),
        ("grid", "8,5", (8, 5)),
        ("domain", "-1,1,0,1e-3", (-1, 1, 0, 1e-3)),
        ("approach", "-0.11", -0.11),
        ("poisson_ratio", "0.5", 0.5),
        ("lcp_nested", "", True),
        ("lcp_nested", "no", False),
    ],
)
def test_value_that_is(name, text, value):
    with petsc_options(**{name: text}):
        assert Options()[name] == value


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.opts", b"# a comment\ngrid 8\n", "line 2: grid 8"),
        ("a.opts", b"-grid 8 -approach 1\n", "line 1"),
        ("a.opts", b"-domain -1, 1, -1, 1\n", "line 1"),
        ("a.opts", b"-problem 'hertz\n", "line 1"),
        ("a.opts", b"-\n", "line 1"),
        ("a.opts", bytes(range(128, 256)), "not a text file"),
        ("a.yml", b"grid: [8\nproblem: }\n", "a.yml"),
        ("a.yaml", b"- grid\n- 8\n", "option: value"),
    ],
)
def test_file_that_is_no_option_file(name, content, message, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=re.escape(message)):
        option_names(str(tmp_path / name))


def test_folder_as_option_file(tmp_path):
    with pytest.raises(InputError, match="Is a directory"):
        option_names(str(tmp_path))


def test_names_in_option_files(tmp_path):
    opts, yml = tmp_path / "a.opts", tmp_path / "a.yml"
    opts.write_text("# c\n\n-grid 8,9 # cells\n  -lcp_monitor\n-domain '-1,1,-1,1'\n")
    yml.write_text("grid: [8, 9]\nlcp:\n  rtol: 1e-3\n")
    assert option_names(str(opts)) == ["-grid", "-lcp_monitor", "-domain"]
    assert option_names(str(yml)) == ["-grid", "-lcp"]
    for path in OPTIONS.glob("*.opts"):
        assert option_names(str(path))


def prescribed(*argv, environment="", monkeypatch=None):
    """What `loading` makes of a command line."""
    with petsc_options() as database:
        if monkeypatch:
            monkeypatch.setenv("PETSC_OPTIONS", environment)
        database.insertString(" ".join([environment, *map(str, argv)]))
        return loading(Options(), ["solve.py", *map(str, argv)])


@pytest.fixture
def files(tmp_path):
    (tmp_path / "approach.opts").write_text("-approach 0.1 # mm\n")
    (tmp_path / "load.opts").write_text("# N\n-load 7e3\n")
    (tmp_path / "load.yml").write_text("lcp:\n  rtol: 1e-6\nload: 7e3\n")
    return {path.name: ("-options_file", path) for path in tmp_path.iterdir()}


def test_one_of_approach_and_load_replaces_the_other_from_an_earlier_place(files):
    approach, load = files["approach.opts"], files["load.opts"]
    assert prescribed(*approach) == ("approach", 0.1)
    assert prescribed(*approach, "-approach", 0.2) == ("approach", 0.2)
    assert prescribed(*approach, "-load", 5) == ("load", 5)
    assert prescribed("-load", 5, *approach) == ("load", 5)  # the command line wins wherever it stands
    assert prescribed(*load, "-approach", -0.2) == ("approach", -0.2)
    assert prescribed(*approach, *load) == ("load", 7e3)
    assert prescribed(*load, *approach) == ("approach", 0.1)
    assert prescribed(*approach, *files["load.yml"]) == ("load", 7e3)


def test_environment_comes_first(files, monkeypatch):
    assert prescribed("-load", 5, environment="-approach 0.3", monkeypatch=monkeypatch) == ("load", 5)
    assert prescribed(environment="-approach 0.3", monkeypatch=monkeypatch) == ("approach", 0.3)


@pytest.mark.parametrize("argv", [[], ["-grid", 8], ["-approach", 1, "-load", 2]])
def test_exactly_one_of_approach_and_load(argv):
    with pytest.raises(InputError, match="exactly one"):
        prescribed(*argv)
