"""Where options come from, what overrides what, and what is wrong with files: read by PETSc, told in one line."""

import re
import tempfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from petsc4py import PETSc
from processes import OPTIONS

from app.commands import places
from app.commands.option_text import LARGEST_FILE, look_into
from app.commands.problem_options import loading, settle
from app.errors import InputError
from app.petsc import OptionDatabase


@pytest.fixture
def read(tmp_path, monkeypatch):
    """``read("-grid 8")``: read a command line in an empty folder that is also the home of the user."""
    monkeypatch.chdir(tmp_path)

    def read_line(line="", **environment):
        return places.read(["solve.py", *line.split()], {"HOME": str(tmp_path), **environment})

    return read_line


@pytest.fixture
def files(tmp_path):
    """Write files of these contents into the folder."""

    def write(**contents):
        for name, content in contents.items():
            path = tmp_path / name.replace("__", ".")
            path.write_bytes(content) if isinstance(content, bytes) else path.write_text(content)

    return write


@pytest.mark.parametrize("path", ["hertz.opts", "petsc_options/hertz.opts", "hertz"])
def test_option_file_of_the_program_where_there_is_none_here(path, read, files):
    assert read(f"-options_file {path}").texts["problem"] == "hertz"
    files(hertz__opts="-problem mine")
    assert read("-options_file hertz.opts").texts["problem"] == "mine"


def test_later_places_override_earlier_ones(read, files, tmp_path):
    files(__petscrc="-a 1\n-b 1\n-c 1\n-d 1\n-e 1\n", petscrc="-b 2\n", file__opts="-d 4\n-e 4\n")
    assert (tmp_path / ".petscrc").exists()
    found = read("-options_file file.opts -e 5", PETSC_OPTIONS="-c 3 -d 3 -e 3").texts
    assert found == {"a": "1", "b": "2", "c": "3", "d": "4", "e": "5"}
    assert read("-e 5 -options_file file.opts -skip_petscrc").texts == {"d": "4", "e": "4"}  # as in PETSc


def test_values_are_whole(read, files):
    files(a__opts='# c\n\n-grid 8,9 # cells\n\t-lcp_monitor\r\n-title "a -b c"\n-approach -inf\n')
    assert read("-options_file a.opts").texts == {
        "grid": "8,9", "lcp_monitor": "", "title": "a -b c", "approach": "-inf"
    }  # fmt: skip
    long = "x" * 3000
    assert read(f"-output {long} -load -7").texts == {"output": long, "load": "-7"}


def test_yaml(read, files):
    files(a__yml="grid: [8, 9]\nlcp:\n  rtol: 1e-3\n", b__txt="load: 5\n")
    assert read("-options_file a.yml").texts == {"grid": "8,9", "lcp_rtol": "1e-3"}
    assert read("-options_file_yaml b.txt").texts == {"load": "5"}
    assert read(PETSC_OPTIONS_YAML="load: 6").texts == {"load": "6"}
    files(
        c__yml="%YAML 1.1\n---\n$$b: !include b.txt\n$$set: &set {rtol: 1}\na: [1, {b: 2}]\n"
        "ksp: {<<: *set, type: cg}\nload: 7\n---\nlcp: {rtol: }\n"
    )
    expected = {"a": "1,b", "a_b": "2", "ksp_rtol": "1", "ksp_type": "cg", "load": "7", "lcp_rtol": ""}
    assert read("-options_file c.yml").texts == expected


def test_names_are_told_apart_without_regard_to_case(read):
    assert read("-Load 5 -LOAD 6 -Grid 8").texts == {"load": "6", "grid": "8"}


def test_prefixes_and_aliases_of_petsc(read, files):
    files(
        a__opts="-prefix_push x_\n-grid 3\n-prefix_pop\nalias -force -load\n-force 5\n", b__opts="-rtol 2\n"
    )
    assert read("-options_file a.opts").texts == {"x_grid": "3", "load": "5"}
    assert read("-prefix_push ksp_ -options_file b.opts -prefix_pop -a 1").texts == {
        "ksp_rtol": "2",
        "a": "1",
    }


def test_option_files_of_the_project_can_be_read(read):
    for path in OPTIONS.glob("*.opts"):
        given = read(f"-options_file {path}")
        assert given.texts
        assert given.files == [str(path)]


def test_options_that_are_petscs_own_are_kept_apart(read, files):
    files(a__opts="-options_left\n-grid 8\n")
    given = read("-options_file a.opts -log_view :log.txt -help")
    assert given.texts == {"grid": "8"}
    assert given.of_petsc == {"options_left": "", "log_view": ":log.txt", "help": ""}
    words = places.for_the_start(
        ["solve.py", "-grid", "8", "-log_view", "-options_file", "a.opts"],
        {"PETSC_OPTIONS": "-malloc_debug true"},
    )
    assert words == ["solve.py", "-options_left", "no", "-malloc_debug", "true", "-log_view", "-skip_petscrc"]


@pytest.mark.parametrize("view", [":nowhere/log", "log.txt", ":.", ":a.txt,:nowhere/b:ascii_xml"])
def test_place_for_the_log_that_there_is_not(view):
    """It is refused before PETSc starts, which would look at it when all is done."""
    with pytest.raises(
        InputError, match=r"-log_view .*: (there is no folder|allowed: nothing, or|\. is a folder)"
    ):
        places.for_the_start(["solve.py", "-log_view", view], {})


@pytest.mark.parametrize(("line", "environment"), [("-fp_trap", ""), ("", "-fp_trap"), ("-FP_TRAP true", "")])
def test_trapping_floating_point_operations_is_refused(line, environment):
    with pytest.raises(InputError, match="^-fp_trap: not available; "):
        places.for_the_start(["solve.py", *line.split()], {"PETSC_OPTIONS": environment})
    assert "-fp_trap" in places.for_the_start(["solve.py", "-fp_trap", "no"], {})


@pytest.mark.parametrize("name", ["citations", "history", "log_summary", "malloc_view"])
def test_file_of_petscs_that_there_cannot_be(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=f"^-{name} nowhere/a: there is no folder nowhere$"):
        places.for_the_start(["solve.py", f"-{name}", "nowhere/a"], {})
    for words in ([], ["a"]):
        assert [f"-{name}", *words, "-skip_petscrc"] == places.for_the_start(["", f"-{name}", *words], {})[3:]


@pytest.mark.parametrize("name", ["options_view", "options_left", "get_total_flops", "mpidump"])
def test_what_petsc_reads_as_yes_or_no_in_the_end_is_that(read, files, name):
    """It is refused at the start: PETSc fails when all is done, and then the run has status 0 all the same."""
    with pytest.raises(InputError, match=f"^-{name} :a.txt: not allowed; allowed: true or false$"):
        places.for_the_start(["solve.py", f"-{name}", ":a.txt"], {})
    for text in ("", "no", "TRUE"):
        assert f"-{name}" in places.for_the_start(["solve.py", f"-{name}", text], {})
    files(a__opts="-options_view :a.txt\n")
    with pytest.raises(InputError, match="-options_view :a.txt"):
        read("-options_file a.opts")


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            "# a comment\ngrid 8\n",
            "option file a.opts, line 2: grid 8: grid: is not an option; allowed: an option",
        ),
        ("-grid 8 -approach 1\n", "line 1: -grid 8 -approach 1: -approach: is more than a value; allowed: "),
        (
            "-grid 8\r\n\n-lcp_monitor -load 1 # N\n",
            "line 3: -lcp_monitor -load 1 # N: -load: is a second option",
        ),
        ("-domain -1, 1, -1, 1\n", "line 1: -domain -1, 1, -1, 1: 1,: is more than a value"),
        ("! PETSc knows # only\n", "line 1: ! PETSc knows # only: !: is not an option; allowed: "),
        ("-\n", "line 1: -: -: is not an option"),
        ("-inf 3\n", "line 1: -inf 3: -inf: is not an option"),
        ('-grid 8\n-title "a b\n', 'line 2: -title "a b: a quote is not closed'),
        (
            "-title 'a b'\n",
            "b': is more than a value; allowed: an option on a line, -name value, a value with",
        ),
        ('-size 5"\n-grid 8\n', 'line 1: -size 5": a quote is not closed, or stands inside a word'),
        ('-title "a"b\n', "b: is more than a value"),
        ("alias -force\n", "line 1: alias -force: needed: alias -name -other"),
        ("-prefix_push\n-grid 8\n", "line 1: -prefix_push: a prefix must follow"),
        ("-grid 8\n-prefix_pop\n", "option file a.opts: More prefixes popped than pushed"),
        (bytes(range(128, 256)), "option file a.opts: is not a text file"),
        (b"\x01\x1b[2J", "option file a.opts: is not a text file"),
        (
            "\ufeff-grid 8\n",
            "option file a.opts: begins with a byte order mark, which PETSc takes for an option",
        ),
        ("-grid=8\n", "option file a.opts, line 1: -grid=8: needed: -grid 8; allowed: "),
        ("-options_file a.opts\n", "option file a.opts: includes itself"),
        ("-grid 8\n-options_file b.opts\n", "option file ./a.opts: includes itself (included by"),
        ("-options_file\n", "a.opts, line 1: -options_file: a file name must follow; allowed: "),
        ("-options_file nowhere.opts\n", "option file nowhere.opts (included by"),
        ("-OPTIONS_FILE 'no.opts'\n", "No such file or directory"),
        ("-malloc_debug\n", "-malloc_debug in a.opts: PETSc needs it when it starts"),
        ("-log_view :nowhere/log\n", "-log_view :nowhere/log: there is no folder nowhere"),
        ("x" * (LARGEST_FILE + 1), "option file a.opts: is larger than 16 MiB"),
        (3 * "-options_file c0.opts\n", ".opts: more than 100 files are included; allowed: 100"),
        (10**5 * "x" + "\n", f"line 1: {42 * 'x'}...{15 * 'x'}: {42 * 'x'}..."),
    ],
    ids=lambda text: repr(text)[:60],
)
def test_file_that_is_no_option_file(content, message, read, files):
    files(a__opts=content, b__opts='-options_file "./a.opts"\n', c12__opts="")
    files(**{f"c{n}__opts": 3 * f"-options_file c{n + 1}.opts\n" for n in range(12)})
    with pytest.raises(InputError, match=re.escape(message)) as refusal:
        read("-options_file a.opts")
    assert "\n" not in str(refusal.value)


_WORDS = [
    "-a",
    "--b",
    "-a1",
    "-1",
    "-inf",
    "-",
    "--",
    "a",
    "1,",
    "alias",
    '"a b"',
    '"-a"',
    '""',
    '"',
    'a"b',
    "#",
    "\t",
    "\r",
]


@settings(max_examples=300, deadline=None)
@given(lines=st.lists(st.lists(st.sampled_from(_WORDS), max_size=5).map(" ".join), max_size=3))
def test_form_of_a_file_is_petscs_own(lines):
    """What it allows PETSc reads; what it refuses PETSc refuses, too, but for quotes, of which PETSc makes anything."""

    def refused(read, error, *arguments):
        try:
            read(*arguments)
        except error:
            return True
        return False

    with tempfile.NamedTemporaryFile("w", newline="") as file:
        file.write("\n".join(lines))
        file.flush()
        here = refused(look_into, InputError, "-options_file", file.name, ())
        there = refused(OptionDatabase().insert, PETSc.Error, f'-options_file "{file.name}"')
    assert here == there or (here and any('"' in line for line in lines))


# The last line stands for 2^25 times the first one.
ALIASES = "a0: &a0 {x: 1}\n" + "".join(f"a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}]}}\n" for n in range(1, 26))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.yml", "load: 1\ngrid: [8\nproblem: }\n", "option file a.yml, line 3: .*allowed: name: value"),
        ("a.yaml", "- grid\n- 8\n", "a.yaml, line 1: - grid: has no name; allowed: name: value"),
        ("a.json", '{"a": 1,\n"b": [[2]]}', "a.json, line 2: .*: is not a single value"),
        ("a.opts", "---\na: {b: 1}\n? [c]\n: 2\n", "a.opts, line 3: .*: a name must be a word"),
        ("a.yml", "a: [1, {b: 2, c: 3}]\n", "line 1: .*: is not a single value"),
        ("a.yml", "a: &a\n  b: *a\n", "option file a.yml"),
        ("a.yml", "$$other: !include a.yml\n", "includes itself"),
        ("a.yml", ALIASES, "a.yml, line [12]: .*: stands for more than 10000 nodes"),
        ("a.yml", f"- {10**5 * 'x'}\n", rf"a.yml, line 1: - {40 * 'x'}\.\.\.{15 * 'x'}: has no name"),
    ],
    ids=lambda text: repr(text)[:60],
)
def test_file_that_is_no_yaml(name, content, message, read, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message) as refusal:
        read(f"-options_file {name}")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("line", "environment", "message"),
    [
        ("-grid 8 9", "", "9: neither an option nor the value of one"),
        ("8", "", "8: neither an option"),
        ("-options_file", "", "-options_file: a file name must follow"),
        ("-options_file .", "", "option file .: Is a directory"),
        ("-options_file /dev/null", "", "/dev/null: is not a regular file"),
        ("", "bogus", "PETSC_OPTIONS: bogus: neither an option"),
        ("", "-x 'a", "PETSC_OPTIONS: No closing quotation"),
        ("", "-options_file nowhere", "option file nowhere: No such file"),
        ("", "-options_string_yaml 'a: [1'", "in PETSC_OPTIONS, line 1: "),
        ("-output \udce9.h5", "", "is not UTF-8 text"),
    ],
)
def test_words_that_are_no_options(line, environment, message, read):
    with pytest.raises(InputError, match=re.escape(message)):
        read(line, PETSC_OPTIONS=environment)


def test_start_file_that_is_none(read, files):
    files(__petscrc="grid 8\n")
    with pytest.raises(InputError, match="petscrc, line 1: grid 8: "):
        read()


# -------------------------------------------------------------------------------------- approach or load


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

    def value(line, **environment):
        given = read(re.sub(r"(\w+\.(opts|yml))", r"-options_file \1", line), **environment)
        return loading(given, settle(given))

    return value


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("approach.opts", ("approach", 0.1)),
        ("approach.opts -approach 0.2", ("approach", 0.2)),
        ("approach.opts -load 5", ("load", 5)),
        ("-load 5 approach.opts", ("load", 5)),  # the command line wins wherever it stands
        ("-approach 5 load.opts", ("approach", 5)),
        ("-approach 5 approach.opts", ("approach", 0.1)),  # as in PETSc: a file counts where it stands
        ("-load 5 approach.opts -load 6", ("load", 6)),
        ("load.opts -approach -0.2", ("approach", -0.2)),
        ("approach.opts load.opts", ("load", 7e3)),
        ("load.opts approach.opts", ("approach", 0.1)),
        ("approach.opts load.yml", ("load", 7e3)),
        ("own.opts", ("load", 8)),  # a file comes after those that it includes
        ("own.opts approach.opts", ("approach", 0.1)),
        ("both.opts -Approach 3", ("approach", 3)),
        ("replaced.opts", ("load", 8)),
    ],
)
def test_one_of_approach_and_load_replaces_the_other_from_an_earlier_place(prescribed, line, expected):
    assert prescribed(line) == expected


def test_the_one_replaced_is_forgotten(read):
    given = read("-load 5", PETSC_OPTIONS="-approach 0.3")
    assert loading(given, settle(given)) == ("load", 5)
    assert given.texts == {"load": "5"}


def test_environment_comes_first(prescribed):
    assert prescribed("-load 5", PETSC_OPTIONS="-approach 0.3") == ("load", 5)
    assert prescribed("", PETSC_OPTIONS="-approach 0.3") == ("approach", 0.3)
    assert prescribed("load.opts", PETSC_OPTIONS="-approach 0.3") == ("load", 7e3)


@pytest.mark.parametrize(
    ("line", "where"),
    [
        ("", "neither"),
        ("-grid 8", "neither"),
        ("-approach 1 -load 2", "on the command line"),
        ("both.opts", "in both.opts"),
        ("approach.opts both.opts", "in both.opts"),
        (
            "-approach 1 load.opts -load 2",
            "on the command line",
        ),  # one place, however many files stand between
    ],
)
def test_exactly_one_of_approach_and_load(prescribed, line, where):
    with pytest.raises(InputError, match=where):
        prescribed(line)


def test_what_a_later_file_takes_back_is_told(read, files):
    files(a__opts="-grid 8\n-approach 1\n")
    given = read("-Grid 9 -ksp_rtol 1 -load 5 -options_file a.opts")
    settle(given)
    assert given.texts == {"grid": "8", "ksp_rtol": "1", "load": "5"}
    assert given.warnings == ["-grid 9: a.opts comes later and says 8"]
    given = read("-grid 9 -options_file a.opts -grid 9 -approach 2")
    settle(given)
    assert given.warnings == []


def test_files_and_words_are_told_apart(read, files):
    files(a__opts="-a 1\n-b 1\n-c 1\n", b__opts="-b 2\n-d 2\n")
    given = read("-d 0 -options_file a.opts -c 3 -options_file b.opts", PETSC_OPTIONS="-a 0 -e 0")
    found = given.files_and_words(set("abcde"))
    assert found == (
        {"a.opts": {"a": "1", "b": "1", "c": "1"}, "b.opts": {"b": "2", "d": "2"}},
        {"c": "3", "e": "0"},
    )


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("approach.opts -mean_gap 0", ("mean_gap", 0)),
        ("load.opts -mean_pressure 3", ("mean_pressure", 3)),
        ("-mean_pressure 3 load.opts", ("mean_pressure", 3)),
    ],
)
def test_mean_pressure_and_mean_gap_are_loadings_too(prescribed, line, expected):
    assert prescribed(line) == expected


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
def test_a_later_way_to_give_the_material_replaces_the_other(read, files, line, left):
    files(pair__opts="-shear_modulus 1\n-poisson_ratio 0.3\n", one__opts="-contact_modulus 7\n")
    given = read(line)
    settle(given)
    assert given.texts == left


def test_two_ways_in_one_place_are_refused(read, files):
    files(both__opts="-contact_modulus 1\n-poisson_ratio 0.3\n")
    with pytest.raises(
        InputError, match="both -contact_modulus and -poisson_ratio are given in both.opts: exactly one"
    ):
        settle(read("-options_file both.opts"))
