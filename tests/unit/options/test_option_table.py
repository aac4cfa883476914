"""Tables of options: which values are allowed, who asked for what."""

import numpy as np
import pytest

from app.base.errors import InputError
from app.cli.option_sources import startup_args
from app.cli.problem_options import PROBLEM_OPTIONS
from app.options.method import METHOD_OPTIONS, find_method_file
from app.options.option_table import REQUIRED, Option, OptionReader, domain, real, series, to_texts

TABLE = [*PROBLEM_OPTIONS, *METHOD_OPTIONS]
BAD_VALUES = [
    ("problem", "herz", "one of hertz"),
    ("grid", "8,-8", "nx,ny or n"),
    ("grid", "8.5", "nx,ny or n"),
    ("domain", "0,0,0,1", "x0 < x1"),
    ("domain", "0,inf,0,1", "x0,x1,y0,y1"),
    ("domain", "-1e308,1e308,0,1", "x0,x1,y0,y1"),
    ("shear_modulus", "-82000", "a positive number"),
    ("shear_modulus", "1e-320", "1e-50 to 1e+50"),
    ("poisson_ratio", "-0.1", "from 0 to 0.5"),
    ("approach", "deep", "a finite number"),
    ("approach", "1e200", "1e-50 to 1e+50"),
    ("hertz_rx", "0", "a positive number"),
    ("lcp_nested", "maybe", "true or false"),
    ("lcp_rtol", "0", "above 0 and below 1"),
    ("lcp_max_it", "0", "a whole number"),
    ("lcp_max_it", "1_0", "a whole number"),
    ("approach", "1_0", "a finite number"),
    ("load_path", "1:2:1_0", "n from 2 to 100000"),
    ("lcp_beta", "-1", "a number from 0"),
    ("output", "", "a name"),
]


@pytest.mark.parametrize(("name", "text", "allowed"), BAD_VALUES)
def test_a_wrong_value_is_refused_with_what_is_allowed(name, text, allowed):
    with pytest.raises(InputError) as refusal:
        OptionReader(TABLE, {name: text})[name]
    wrong = f"-{name} {text}" if text else f"-{name}: its value is missing"
    assert str(refusal.value).startswith(f"{wrong}: must be ")
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
def test_an_allowed_text_becomes_a_value(name, text, value):
    assert OptionReader(TABLE, {name: text})[name] == value


SMALL = (
    Option("force", real(), REQUIRED, "what presses [N]"),
    Option("size", real(), 1.0, "how large [mm]"),
    Option("shift", real(), None, "where [mm]"),
)
LONG = "x" * 10**5


@pytest.mark.parametrize(
    "refuse",
    [
        lambda: OptionReader(TABLE, {"problem": LONG})["problem"],
        lambda: OptionReader(TABLE, {"grid": "8 " * 10**5})["grid"],
        lambda: to_texts([LONG], LONG),
        lambda: startup_args(["solve", LONG]),
        lambda: startup_args(["solve", f"-grid={LONG}"]),
        lambda: find_method_file(LONG),
        lambda: raise_(InputError(f"{LONG}: {LONG}")),
        lambda: raise_(InputError(" ".join(10**5 * ["unknown"]))),
    ],
)
def test_a_refusal_quotes_long_input_shortened(refuse):
    with pytest.raises(InputError) as refusal:
        refuse()
    message = str(refusal.value)
    assert len(message) <= 4000
    assert max(map(len, message.split())) < 72


def raise_(error):
    raise error


def test_a_refusal_quotes_file_names_unshortened():
    message = f"{'/folder' * 30}/file.h5: no such file"
    assert str(InputError(message)) == message


def test_names_of_options_are_case_insensitive():
    reader = OptionReader([Option("Own_Slope", real(), 1.0, "slope")], {"own_slope": 2})
    assert reader.given("Own_Slope") and reader["Own_Slope"] == reader["own_slope"] == 2.0
    assert not reader.unused() and reader.asked == {"own_slope"}


def test_a_reader_reports_missing_and_unused_options():
    reader = OptionReader(SMALL, {"Size": 2, "SHIFT": "0.5", "ksp_rtol": "1"})
    assert reader.given("size") and not reader.given("force")
    assert reader.unused() == ["shift", "size"]
    assert reader["size"] == 2.0
    assert reader.unused() == ["shift"]
    with pytest.raises(InputError, match=r"^-force is missing: what presses \[N\]$"):
        reader["force"]
    assert reader.asked == {"size", "force"}
    assert OptionReader(SMALL, {})["size"] == 1.0


def test_values_of_python_are_read_like_texts():
    values = {"domain": (-1, 1.5, 0, np.float64(2)), "lcp_nested": np.True_, "grid": [8, 4], "lcp_rtol": 1e-8}
    reader = OptionReader(TABLE, values)
    assert [reader[name] for name in values] == [(-1, 1.5, 0, 2), True, (8, 4), 1e-8]
    assert to_texts({"lcp_rtol": 0.1 + 0.2})["lcp_rtol"] == "0.30000000000000004"


@pytest.mark.parametrize(
    ("kind", "meaning", "text", "allowed"),
    [
        (domain, "patch [mm]", "0,1e-150,0,1", "y0 < y1 [mm], of size 1e-50 to 1e+50"),
        (series, "first:last:n[:log] or a,b,c [N]", "1:2:1", "or numbers a,b,c [N]"),
    ],
)
def test_a_refusal_ends_with_what_is_allowed(kind, meaning, text, allowed):
    with pytest.raises(InputError) as refused:
        OptionReader([Option("it", kind, None, meaning)], {"it": text})["it"]
    assert str(refused.value).endswith(allowed)
