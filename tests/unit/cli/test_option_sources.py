"""Sources of options: order, files read by PETSc, and one-line errors."""

import re
from pathlib import Path

import pytest
from processes import OPTIONS

from app.base.errors import InputError
from app.cli import option_sources
from app.cli.problem_options import resolve_alternatives


@pytest.mark.parametrize("path", ["hertz.opts", "petsc_options/hertz.opts", "hertz"])
def test_shipped_option_files_are_found_unless_a_local_one_exists(path, read, files):
    assert read(f"-options_file {path}").texts["problem"] == "hertz"
    files(hertz__opts="-problem mine")
    assert read("-options_file hertz.opts").texts["problem"] == "mine"


def test_later_sources_override_earlier_ones(read, files):
    files(file__opts="-d 4\n-e 4\n")
    found = read("-options_file file.opts -e 5", a="1", d="1", e="1")
    assert found.texts == {"a": "1", "d": "4", "e": "5"}
    assert found.explicit_names() == {"d", "e"} and found.database_options == {"e": "5"}
    assert read("-e 5 -options_file file.opts").texts == {"d": "4", "e": "4"}  # as in PETSc


def test_values_are_read_completely(read, files):
    files(a__opts='# c\n\n-grid 8,9 # cells\n\t-lcp_monitor\r\n-title "a -b c"\n-approach -inf\n')
    assert read("-options_file a.opts").texts == {
        "grid": "8,9", "lcp_monitor": "", "title": "a -b c", "approach": "-inf"
    }  # fmt: skip
    long = "x" * 3000
    assert read(f"-output {long} -load -7").texts == {"output": long, "load": "-7"}


def test_yaml_files_are_read(read, files):
    files(a__yml="grid: [8, 9]\nlcp:\n  rtol: 1e-3\n", b__txt="load: 5\n")
    assert read("-options_file a.yml").texts == {"grid": "8,9", "lcp_rtol": "1e-3"}
    assert read("-options_file_yaml b.txt").texts == {"load": "5"}
    files(d__opts="-options_file_yaml b.txt\n-grid 8\n")
    assert read("-options_file d.opts").texts == {"load": "5", "grid": "8"}
    files(
        c__yml="%YAML 1.1\n---\n$$b: !include b.txt\n$$set: &set {rtol: 1}\na: [1, {b: 2}]\n"
        "ksp: {<<: *set, type: cg}\nload: 7\n---\nlcp: {rtol: }\n"
    )
    expected = {"a": "1,b", "a_b": "2", "ksp_rtol": "1", "ksp_type": "cg", "load": "7", "lcp_rtol": ""}
    assert read("-options_file c.yml").texts == expected


def test_names_are_case_insensitive(read):
    assert read("-Load 5 -LOAD 6 -Grid 8").texts == {"load": "6", "grid": "8"}


def test_prefixes_in_files_are_applied(read, files):
    files(a__opts="-prefix_push x_\n-grid 3\n-prefix_pop\n-load 5\n")
    assert read("-options_file a.opts").texts == {"x_grid": "3", "load": "5"}


def test_shipped_option_files_are_read(read):
    for path in OPTIONS.glob("*.opts"):
        given = read(f"-options_file {path}")
        assert given.texts
        assert given.files == [str(path)]


def test_global_petsc_options_are_separate(read, files):
    files(a__opts="-options_left\n-grid 8\n")
    given = read("-options_file a.opts -log_view :log.txt -help")
    assert given.texts == {"grid": "8"}
    assert given.petsc_options == {"options_left": "", "log_view": ":log.txt", "help": ""}
    assert given.database_options == given.petsc_options
    words = option_sources.startup_args("solve.py -grid 8 -log_view -help -options_file a.opts".split())
    assert words == ["solve.py", "-grid", "8", "-log_view"]


@pytest.mark.parametrize("view", [":nowhere/log", "log.txt", ":.", ":a.txt,:nowhere/b:ascii_xml"])
def test_log_without_a_folder_is_refused(view, read):
    with pytest.raises(
        InputError, match=r"-log_view .*: (there is no folder|must be nothing, or|\. is a folder)"
    ):
        read(f"-log_view {view}")


@pytest.mark.parametrize("line", ["-fp_trap", "-FP_TRAP true"])
def test_fp_trap_is_refused(line, read):
    with pytest.raises(InputError, match="^-fp_trap: not available; "):
        option_sources.startup_args(["solve.py", *line.split()])
    with pytest.raises(InputError, match="^-fp_trap: not available; "):
        read(fp_trap="")
    assert "-fp_trap" in option_sources.startup_args(["solve.py", "-fp_trap", "no"])


def test_folder_of_citations_must_exist(read):
    with pytest.raises(InputError, match="^-citations nowhere/a: there is no folder nowhere$"):
        read("-citations nowhere/a")
    assert read("-citations a").petsc_options == {"citations": "a"}


@pytest.mark.parametrize("name", ["options_view", "options_left", "get_total_flops", "mpidump"])
def test_flags_read_at_petscs_end_are_checked(read, files, name):
    files(a__opts=f"-{name} :a.txt\n")
    for line in (f"-{name} :a.txt", "-options_file a.opts"):
        with pytest.raises(InputError, match=f"^-{name} :a.txt: must be true or false$"):
            read(line)
    for text in ("", "no", "TRUE"):
        assert read(f"-{name} {text}").petsc_options == {name: text}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("# a comment\ngrid 8\n", "Unknown first token in options file a.opts line 2: grid"),
        ("-grid 8 -approach 1\n", "Error in options file a.opts line 1: extra token -approach"),
        (
            "-grid 8\r\n\n-lcp_monitor -load 1 # N\n",
            "a.opts line 3: cannot specify two options per line (-lcp_monitor -load)",
        ),
        ("-domain -1, 1, -1, 1\n", "a.opts line 1: extra token 1,"),
        ("-inf 3\n", "a.opts line 1: invalid option -inf"),
        ('-grid 8\n-title "a b\n', 'line 2: -title "a b: a quote is not closed'),
        ('-title "a"b\n', "a.opts line 1: extra token b"),
        ("-prefix_push\n-grid 8\n", "option file a.opts: -prefix_push and -prefix_pop do not match"),
        (bytes(range(128, 256)), "option file a.opts: is not a text file"),
        ("\ufeff-grid 8\n", "Unknown first token in options file a.opts line 1: \ufeff-grid"),
        ("-options_file a.opts\n", "option file a.opts: includes itself"),
        ("-grid 8\n-options_file b.opts\n", "option file ./a.opts: includes itself (included by"),
        ("-options_file\n", "options file"),
        ("-options_file nowhere.opts\n", "option file nowhere.opts (included by"),
        ("-log_view :nowhere/log\n", "-log_view :nowhere/log: there is no folder nowhere"),
        ("x" * (option_sources.MAX_FILE_BYTES + 1), "option file a.opts: is larger than 16 MiB"),
        (3 * "-options_file c0.opts\n", ".opts: at most 100 files may be included"),
        (10**5 * "x" + "\n", f"line 1: {42 * 'x'}...{15 * 'x'}"),
    ],
    ids=lambda text: repr(text)[:60],
)
def test_invalid_option_file_is_refused_in_one_line(content, message, read, files):
    files(a__opts=content, b__opts='-options_file "./a.opts"\n', c12__opts="")
    files(**{f"c{n}__opts": 3 * f"-options_file c{n + 1}.opts\n" for n in range(12)})
    with pytest.raises(InputError) as refusal:
        read("-options_file a.opts")
    told = str(refusal.value).replace(f"{Path.cwd()}/", "")  # newer PETSc names whole paths
    assert message in told and "\n" not in told


# The last line stands for 2^25 times the first one.
ALIASES = "a0: &a0 {x: 1}\n" + "".join(f"a{n}: &a{n} {{<<: [*a{n - 1}, *a{n - 1}]}}\n" for n in range(1, 26))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.yml", "load: 1\ngrid: [8\nproblem: }\n", "option file a.yml, line 3: "),
        ("a.yaml", "- grid\n- 8\n", "option file a.yaml: Unsupported YAML node type: expected mapping"),
        (
            "a.json",
            '{"a": 1,\n"b": [[2]]}',
            "option file a.json: Unsupported YAML node type: expected scalar or mapping",
        ),
        ("a.opts", "---\na: {b: 1}\n? [c]\n: 2\n", "option file a.opts: Unsupported YAML node type: expected scalar"),
        ("a.yml", "a: [1, {b: 2, c: 3}]\n", "a.yml: Unsupported YAML node value: expected a single key:value"),
        ("a.yml", "a: &a\n  b: *a\n", "option file a.yml"),
        ("a.yml", "$$other: !include a.yml\n", "includes itself"),
        ("a.yml", ALIASES, "option file a.yml: expands to more than 10000 nodes"),
    ],
    ids=lambda text: repr(text)[:60],
)  # fmt: skip
def test_invalid_yaml_is_refused_in_one_line(name, content, message, read, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=message) as refusal:
        read(f"-options_file {name}")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("-grid 8 9", "9: neither an option nor the value of one"),
        ("8", "8: neither an option"),
        ("-young 210e3, 70e3", "70e3: neither an option nor the value of one (is there a blank"),
        ("-options_file", "-options_file: a file name must follow"),
        ("-options_file .", "option file .: Is a directory"),
        ("-options_file /dev/null", "/dev/null: is not a regular file"),
        ("-output \udce9.h5", "is not UTF-8 text"),
        ("-prefix_push x_ -grid 8", "-prefix_push: only in option files"),
    ],
)
def test_invalid_words_are_refused(line, message, read):
    with pytest.raises(InputError, match=re.escape(message)):
        option_sources.startup_args(["solve.py", *line.split()])
        read(line)


def test_overridden_words_give_warnings(read, files):
    files(a__opts="-grid 8\n-approach 1\n")
    given = read("-Grid 9 -ksp_rtol 1 -load 5 -options_file a.opts")
    resolve_alternatives(given)
    assert given.texts == {"grid": "8", "ksp_rtol": "1", "load": "5"}
    assert list(given.overridden()) == ["-grid 9: a.opts comes later and says 8"]
    given = read("-grid 9 -options_file a.opts -grid 9 -approach 2")
    resolve_alternatives(given)
    assert list(given.overridden()) == []


def test_options_are_split_by_source(read, files):
    files(a__opts="-a 1\n-b 1\n-c 1\n", b__opts="-b 2\n-d 2\n")
    given = read("-d 0 -options_file a.opts -c 3 -options_file b.opts", a="0", e="0")
    found = given.split_by_source(set("abcde"))
    assert found == ({"a.opts": {"a": "1", "b": "1", "c": "1"}, "b.opts": {"b": "2", "d": "2"}}, {"c": "3"})
