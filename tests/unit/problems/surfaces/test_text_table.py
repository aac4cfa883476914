"""Tables of numbers in text: every common way to write them, and ambiguous ones."""

import numpy as np
import pytest

from app.problems.surfaces.text_table import read_table

VALUES = np.array([[0.12, -3.5, 4.0, 1e-3], [2.25, 0.5, -0.75, 10.0], [7.0, 1.5, 0.25, 8.0]])
LINES = [["0.12", "-3.5", "4", "1e-3"], ["2.25", "0.5", "-0.75", "10"], ["7", "1.5", "+0.25", "8"]]


def text_of(separator, comma=False, end=""):
    lines = [separator.join(row) + end for row in LINES]
    return "\n".join(line.replace(".", ",") for line in lines) if comma else "\n".join(lines)


@pytest.mark.parametrize(
    "text",
    [
        *(text_of(separator) for separator in (" ", "  ", "\t", " \t ", ";", "; ", ",", ", ", " , ")),
        *(text_of(separator, comma=True) for separator in (" ", "\t", " \t", ";", "; ")),
        *(text_of(separator, end=separator) for separator in ("\t", ";", ",", " ")),
        text_of(",").replace("0.5", ".5").replace("7,", "7.,"),
        f"# head\n\n% more, words\n{text_of(' ')}\n\n",
    ],
)
def test_all_ways_to_write_a_table_give_the_same_numbers(text):
    np.testing.assert_array_equal(read_table(text.splitlines()), VALUES)


@pytest.mark.parametrize(
    "text", ["1,2,3,4\n5,6,7,8", "100,2000\n5,64", "12,34,56\n78,90,12", "10,20\n30,-40", "2e3,1e3"]
)
def test_whole_numbers_between_commas_are_no_decimals(text):
    expected = [[float(entry) for entry in line.split(",")] for line in text.splitlines()]
    np.testing.assert_array_equal(read_table(text.splitlines()), expected)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,12,0,34\n0,50,1,25", "commas may separate numbers or begin their decimals"),
        ("-2,3087e-02,1,5e-02", "commas may separate numbers or begin their decimals"),
        ("-65,6,-41,3,-207,5\n-76,2,-74,3,-16,2\n-7,2,-4,3,16,2", "commas may separate numbers or begin"),
        ("0,12, 0,34", "commas with and without a blank behind"),
        ("1.234,5;2.345,6", "both points and commas"),
        ('"1,234","5,678"', "may begin decimals or group thousands"),
        ('0.5,"1,25"', "may begin decimals or group thousands"),
        ("#N/A;1\n2;3", "'#N/A' is no number"),
        ("1,,2", "line 1, entry 2: '' is no number"),
        ("Height\n1 2", "line 1: 'Height' is no number; lines that are no row of cells begin with #"),
    ],
)
def test_ambiguous_texts_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        read_table(text.splitlines())


@pytest.mark.parametrize(
    "mark", [*'*** --- NaN BAD n/a 1.#QNAN -1.#IND -nan(ind) #N/A #NV "#DIV/0!"'.split(), "", "No Data"]
)
def test_marks_of_missing_points_are_nan(mark):
    table = read_table(["0.5;1;2", f"3;{mark};1", f"{mark};2;{mark}"], heights=True)
    np.testing.assert_array_equal(table, [[0.5, 1, 2], [3, np.nan, 1], [np.nan, 2, np.nan]])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1.0D-03 2.5d+1\n-3D0 4", [[1e-3, 25], [-3, 4]]),
        ('"0.5","1.25"\n"2","-3"', [[0.5, 1.25], [2, -3]]),
        ('"0,5","1,25"\n"2","-3"', [[0.5, 1.25], [2, -3]]),
        ('"0,5";"1,25"\n2;3', [[0.5, 1.25], [2, 3]]),
        ("0,5 1,#IND\n1,5 2,5", [[0.5, np.nan], [1.5, 2.5]]),
        ("#N/A 1\n# no row\n2 3", [[np.nan, 1], [2, 3]]),
    ],
)
def test_numbers_of_fortran_and_spreadsheets_are_read(text, expected):
    np.testing.assert_array_equal(read_table(text.splitlines(), heights=True), expected)


@pytest.mark.parametrize("between", ["", "# next", "\n# New slice\n"])
def test_blocks_below_each_other_are_no_map(between):
    text = f"# two maps\n{text_of(' ')}\n{between}\n{text_of(' ')}\n".splitlines()
    with pytest.raises(ValueError, match="2 blocks of 3 lines, the second one from line"):
        read_table(text)


@pytest.mark.parametrize("lines", [["1; 2;\t", "3; 4; "], ["1,\t 2,\t", "3,\t4,"]])
def test_blanks_behind_the_last_separator_are_no_missing_point(lines):
    np.testing.assert_array_equal(read_table(lines, heights=True), [[1, 2], [3, 4]])


def test_nodata_value_of_a_skipped_head_is_missing():
    head = ["ncols 3", "nrows 2", "cellsize 0.5", "NODATA_value -9999"]
    rows = ["1 -9999 2", "-9999.0 3 -99"]
    expected = [[1, np.nan, 2], [np.nan, 3, -99]]
    np.testing.assert_array_equal(read_table(head + rows, 4, heights=True), expected)
    np.testing.assert_array_equal(read_table(head + rows, skip=4), np.nan_to_num(expected, nan=-9999))
    with pytest.raises(ValueError, match="line 4, entry 2: '9e' is no number"):
        read_table([*head[:3], "NODATA_value 9e", *rows], 4, heights=True)
