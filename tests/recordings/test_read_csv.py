"""Comma-separated text as laboratories write it, and what it must not be taken for."""

import numpy as np
import pytest

from drillenv.checks import InputError
from drillenv.recordings.read_csv import read_csv


@pytest.fixture
def read(tmp_path):
    """A function that reads columns b and c of a text."""

    def reads(text, columns=("b", "c"), most=1000):
        path = tmp_path / "r.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_csv(path, columns, most)

    return reads


@pytest.mark.parametrize(
    "text",
    [
        "b,c\n1,-2.5\n30,4e-1\n",
        "a,c,b\n9,-2.5,1\n9,.4,30.\n",
        "c,b,note\n-2.5,1,warm\n0.4,30,cold\n",
        "\ufeffb,c\n1,-2.5\n30,0.4\n",
        "b,c\r\n1,-2.5\r\n30,0.4\r\n",
        "b,c\r1,-2.5\r30,0.4\r",
        "\n\n b , c \n\n 1 ,  -2.5\n\n30, +0.4 \n\n   \n",
        "# measured on Monday\n# with care\nb,c\n1,-2.5\n30,0.4\n",
        "# b,c\n1,-2.5\n30,0.4\n",
        "% b, c\n1, -2.5\n30, 0.4\n",
        "LabVIEW Measurement\nOperator,Somebody\nChannels,2\n***End_of_Header***\nb,c\n1,-2.5\n30,0.4\n",
        '"b","c"\n"1","-2.5"\n"30","0.4"\n',
        '"b","c"\n1,-2.5\n30,0.4\n',
        "b;c\n1;-2.5\n30;0.4\n",
        "b\tc\n1\t-2.5\n30\t0.4\n",
        "b,c,\n1,-2.5,\n30,0.4,\n",
        "b,c\n1,-2.5,\n30,0.4,\n",
        "b;c\n1;-2.5; \n30;0.4; \n",
    ],
)
def test_the_same_numbers(read, text):
    table = read(text)
    np.testing.assert_array_equal(table.columns["b"], [1.0, 30.0])
    np.testing.assert_array_equal(table.columns["c"], [-2.5, 0.4])
    assert table.clock is None
    assert table.notes == ()


@pytest.mark.parametrize(
    "text",
    [
        "b;c\n1;-2,5\n30;0,4\n",
        "b\tc\n1,0\t-2,5\n30\t4,0E-1\n",
        "t;b;c\n01.02.2024;1;-2,5\n02.02.2024;30;0,4\n",
        'b;c\n"1";"-2,5"\n30;0,4\n',
    ],
)
def test_decimal_commas_are_read_and_said(read, text):
    table = read(text)
    np.testing.assert_array_equal(table.columns["b"], [1.0, 30.0])
    np.testing.assert_array_equal(table.columns["c"], [-2.5, 0.4])
    assert table.notes == ("the numbers were read with decimal commas",)


def test_every_digit_is_kept(read):
    values = np.random.default_rng(0).normal(size=200) * 10.0 ** np.random.default_rng(1).integers(-300, 300, 200)
    text = "b,c\n" + "".join(f"{value!r},{-value!r}\n" for value in values.tolist())
    np.testing.assert_array_equal(read(text).columns["b"], values)


def test_what_is_no_number_becomes_nan(read):
    table = read("b,c\n1,\nnan,inf\n#N/A,-Inf\n  ,4\nnull,5\n")
    np.testing.assert_array_equal(table.columns["b"], [1.0, np.nan, np.nan, np.nan, np.nan])
    np.testing.assert_array_equal(table.columns["c"], [np.nan, np.inf, -np.inf, 4.0, 5.0])


def test_the_files_own_time(read):
    np.testing.assert_array_equal(read("time_s,b,c\n0,1,2\n0.5,3,4\n").clock.samples, [0.0, 0.5])
    asked = read("time_s,b,c\n0,1,2\n0.5,3,4\n", ("time_s", "b"))
    assert asked.clock is None
    np.testing.assert_array_equal(asked.columns["time_s"], [0.0, 0.5])


HEADED = "Kraft_\u00b5,b,c\n7,1,-2.5\n7,30,0.4\n"


@pytest.mark.parametrize(
    ("data", "note"),
    [
        (HEADED.encode("utf-8"), None),
        (HEADED.encode("latin-1"), "its text is no UTF-8 (byte 6) and was read as Windows-1252"),
        (
            HEADED.replace("\u00b5", "\u20ac").encode("cp1252"),
            "its text is no UTF-8 (byte 6) and was read as Windows-1252",
        ),
        (HEADED.replace("\u00b5", "\x81").encode("latin-1"), "its text is no UTF-8 (byte 6) and was read as Latin-1"),
        (HEADED.encode("utf-16"), "its text was read as UTF-16"),
        (b"\xfe\xff" + HEADED.encode("utf-16-be"), "its text was read as UTF-16"),
    ],
)
def test_encodings_are_read_and_said(read, data, note):
    table = read(data)
    np.testing.assert_array_equal(table.columns["b"], [1.0, 30.0])
    np.testing.assert_array_equal(table.columns["c"], [-2.5, 0.4])
    assert table.notes == (() if note is None else (note,))


def test_a_name_in_latin_1_is_found(read):
    table = read(HEADED.encode("latin-1"), ("Kraft_\u00b5",))
    np.testing.assert_array_equal(table.columns["Kraft_\u00b5"], [7.0, 7.0])


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("b,c\nV,kN\n1,-2.5\n30,0.4\n", {"b": "V", "c": "kN"}),
        ("t,b,c\ns,[V],(kN)\n0,1,-2.5\n0.1,30,0.4\n", {"t": "s", "b": "V", "c": "kN"}),
        ("b;c\n-;m/s\u00b2\n1;-2,5\n30;0,4\n", {"c": "m/s^2"}),
        ("# b,c\n# Volts,Newtons\n1,-2.5\n30,0.4\n", {"b": "V", "c": "N"}),
        ("b\tc\n\nV\tg\t\n\n1\t-2.5\n30\t0.4\n", {"b": "V", "c": "g"}),
        ("b,c\n1,-2.5\n30,0.4\n", {}),
    ],
)
def test_a_line_of_units(read, text, units):
    table = read(text)
    np.testing.assert_array_equal(table.columns["b"], [1.0, 30.0])
    np.testing.assert_array_equal(table.columns["c"], [-2.5, 0.4])
    assert table.units == units


def test_an_end_that_may_be_cut_off_is_said(read):
    assert read("b,c\n1,2\n3,4").notes == ("its last line has no end, so it may be cut off there",)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("\n \n", "is empty"),
        ("1,2\n3,4\n", "no header line with 'b', 'c'"),
        ("b,d\n1,2\n", "no column 'c'"),
        ("b;d\n1;2\n", "no column 'c': give one of those it has, 'b', 'd'"),
        ("b c\n1 2\n", "no column 'b'"),
        ("b,c,b\n1,2,3\n", "column 'b' twice"),
        ("b,c\n1,2\n3\n", "line 3 of 'r.csv' has 1 cells where its header has 2"),
        ("b,c\n1,2\n\n3,4,5\n", "line 4 of 'r.csv' has 3 cells"),
        ("b,c\n0,1,0,2\n", "line 2 of 'r.csv' has 4 cells"),
        ("b,c\n1,2\n3,4,\n", "line 3 of 'r.csv' has 3 cells"),
        ("b,c\nV,warm\n1,2\n", "line 2 of 'r.csv', column 'b', holds 'V'"),
        ("b,c\nV,kN\nV,kN\n1,2\n", "line 3 of 'r.csv', column 'b', holds 'V'"),
        ("b,c\n1,2\n1,0x10\n", "line 3 of 'r.csv', column 'c', holds '0x10'"),
        ("b,c\n1,1_0\n", "holds '1_0'"),
        ("b,c\n1,1.2.3\n", "holds '1.2.3'"),
        ("b,c\n1,2 3\n", "holds '2 3'"),
        ("b;c\n1.5;2,5\n", "numbers with . and numbers with ,"),
        ("b;c\n1.000,5;2,5\n", "holds '1.000,5'"),
        ("b;c\n1,000,5;2\n", "holds '1.000,5'"),
        (b"b,c\n1,\xb5\n", "column 'c', holds '\u00b5'"),
        (b"b,c\n1,\xb5\x01\n", "is no text (byte 6)"),
        (b"b,c\n1,\0\n", "zero byte"),
        (b"\xff\xfeb", "is no text"),
        ("b,c\n" + "1,2\n" * 1001, "has 1001 samples: give at most 1000"),
    ],
)
def test_what_cannot_be_told_is_refused(read, text, says):
    with pytest.raises(InputError) as caught:
        read(text)
    message = str(caught.value)
    assert says in message
    assert message.isprintable()


def test_an_empty_table_has_no_samples(read):
    assert read("b,c\n").columns["b"].size == 0
