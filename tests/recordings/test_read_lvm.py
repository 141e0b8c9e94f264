"""LabVIEW's measurement files, laid out as its specification and files found in the wild lay them out."""

import numpy as np
import pytest

from drillenv.checks import InputError
from drillenv.recordings.read_lvm import read_lvm

FORCE, ACCELERATION = [0.5, -1.25, 3e-05, 4.0], [10.0, 20.5, -3.0, 7.0]


def lvm(
    x="One",
    separator="\t",
    decimal=".",
    step="3.906250E-5",
    units=("Newtons", "m/s^2"),
    comment="",
    version=2,
    end="\r\n",
):
    """A file of one segment with two channels."""
    word = {"\t": "Tab", ",": "Comma", ";": "Semicolon"}[separator]
    head = [("LabVIEW Measurement", ""), ("Writer_Version", str(version)), ("Reader_Version", str(version))]
    head += [("Separator", word)] + ([("Decimal_Separator", decimal)] if version == 2 else [])
    head += [("Multi_Headings", "Yes"), ("X_Columns", x), ("Time_Pref", "Relative"), ("Operator", "M\u00fcller")]
    head += [("Date", "2024/03/01"), ("Time", f"09:51:39{decimal}1970510"), ("***End_of_Header***", ""), ("", "")]
    rows = [list(pair) for pair in head]
    gap = [""] if x == "Multi" else []

    def both(tag, *values):
        return [tag, values[0], *gap, values[-1], *gap]

    rows += [["Channels", "2", *gap, "", *gap], both("Samples", "4"), both("Date", "2024/03/01")]
    rows += [both("Time", f"09:51:40{decimal}5"), both("Y_Unit_Label", "Newtons", "m/s^2"), both("X_Dimension", "Time")]
    rows += [both("X0", f"0{decimal}0000000000000000E+0"), both("Delta_X", step.replace(".", decimal))]
    rows += [["***End_of_Header***", "", *gap, "", *gap]]
    rows += [["X_Value", "Force", *(["X_Value"] if gap else []), "Response (Trigger)", "Comment"]]
    for i, (f, a) in enumerate(zip(FORCE, ACCELERATION, strict=True)):
        t, f, a = (f"{value:.8g}".replace(".", decimal) for value in (i * 3.90625e-5, f, a))
        rows.append({"One": [t, f, a], "No": ["", f, a], "Multi": [t, f, t, a]}[x] + ([comment] if i == 0 else []))
    return "".join(separator.join(row) + "\r\n" for row in rows).encode("utf-8")


@pytest.fixture
def read(tmp_path):
    """A function that reads columns of a file."""

    def reads(data, columns=("Force", "Response (Trigger)"), most=1000):
        path = tmp_path / "r.lvm"
        path.write_bytes(data)
        return read_lvm(path, columns, most)

    return reads


@pytest.mark.parametrize("x", ["One", "Multi", "No"])
@pytest.mark.parametrize(("separator", "decimal"), [("\t", "."), (",", "."), (";", "."), ("\t", ","), (";", ",")])
@pytest.mark.parametrize("comment", ["", "begun"])
def test_the_same_numbers(read, x, separator, decimal, comment):
    table = read(lvm(x, separator, decimal, comment=comment))
    np.testing.assert_array_equal(table.columns["Force"], FORCE)
    np.testing.assert_array_equal(table.columns["Response (Trigger)"], ACCELERATION)
    np.testing.assert_allclose(table.clock.samples, np.arange(4) * 3.90625e-5, rtol=1e-7)
    assert table.units == {"Force": "Newtons", "Response (Trigger)": "m/s^2"}
    assert table.notes == (("the numbers were read with decimal commas",) if decimal == "," else ())


def test_before_version_2_the_decimal_comma_is_not_announced(read):
    table = read(lvm("No", "\t", ",", version=1))
    np.testing.assert_array_equal(table.columns["Force"], FORCE)


def test_latin_1_is_said(read):
    table = read(lvm("No").decode().encode("latin-1"))
    assert "was read as Windows-1252" in table.notes[0]
    np.testing.assert_array_equal(table.columns["Force"], FORCE)


def test_the_x_column_goes_before_the_increment(read):
    assert read(lvm("One", step="1.000000")).clock.samples[1] == pytest.approx(3.90625e-5)


@pytest.mark.parametrize("step", ["1.000000", "0.000020", "", "x"])  # not stated, written too coarsely, no number
def test_no_clock_where_none_is_told(read, step):
    assert read(lvm("No", step=step)).clock is None


def segmented(starts=("09:51:40.0", "09:51:40.4"), names=("Force", "Force"), heads=True):
    """Two segments of four samples, 0.1 s apart."""
    text = "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
    text += f"Multi_Headings\t{'Yes' if heads else 'No'}\nX_Columns\tOne\n***End_of_Header***\t\n\t\n"
    for i, (start, name) in enumerate(zip(starts, names, strict=True)):
        if heads or i == 0:
            text += f"Channels\t1\t\nSamples\t4\t\nDate\t2024/03/01\t\nTime\t{start}\t\nX_Dimension\tTime\t\n"
            text += "X0\t0.0\t\nDelta_X\t0.100000\t\n***End_of_Header***\t\t\n"
            text += "***Start_Special***\nWaveform_Attributes\nSome words\t1\n***End_Special***\n" if i == 0 else ""
            text += f"X_Value\t{name}\tComment\n"
        for k in range(4):
            text += f"{0.1 * (k + (0 if heads else 4 * i)):.6f}\t{10 * i + k}.5\n"
        text += "\n"
    return text.encode()


@pytest.mark.parametrize("heads", [True, False])
def test_segments_are_put_one_after_the_other(read, heads):
    table = read(segmented(heads=heads), ["Force"])
    np.testing.assert_array_equal(table.columns["Force"], [0.5, 1.5, 2.5, 3.5, 10.5, 11.5, 12.5, 13.5])
    np.testing.assert_allclose(table.clock.samples, np.arange(8) * 0.1, atol=1e-6)
    assert table.notes == ("its 2 segments were put one after the other",)


def test_the_time_between_segments_is_kept(read):
    table = read(segmented(("09:51:40.0", "09:51:42.0")), ["Force"])
    np.testing.assert_allclose(np.diff(table.clock.samples), [0.1, 0.1, 0.1, 1.7, 0.1, 0.1, 0.1], atol=1e-6)


def test_one_segment_of_several(read):
    data = segmented(names=("Force", "Other"))
    np.testing.assert_array_equal(read(data, ["Other"]).columns["Other"], [10.5, 11.5, 12.5, 13.5])
    np.testing.assert_array_equal(read(segmented(), ["2/Force"]).columns["2/Force"], [10.5, 11.5, 12.5, 13.5])
    with pytest.raises(InputError, match="no channel '3/Force': give one of those it has, 'Force'"):
        read(segmented(), ["3/Force"])


def test_a_channel_that_is_shorter_than_another(read):
    text = lvm("One").decode().replace("\t-3\r\n", "\t\r\n").replace("\t7\r\n", "\t\r\n")
    np.testing.assert_array_equal(read(text.encode()).columns["Response (Trigger)"], ACCELERATION[:2])
    text = lvm("One").decode().replace("\t-3\r\n", "\t\r\n")
    np.testing.assert_array_equal(
        read(text.encode()).columns["Response (Trigger)"], [*ACCELERATION[:2], np.nan, ACCELERATION[3]]
    )


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "does not begin with LabVIEW Measurement"),
        (b"a,b\n1,2\n", "does not begin with LabVIEW Measurement"),
        (b"LabVIEW Measurement\t\nSeparator\tTab\n", "cut off in its header"),
        (b"LabVIEW Measurement\t\n***End_of_Header***\t\n", "no numbers below a line that names them"),
        (b"LabVIEW Measurement\t\n***End_of_Header***\t\n1.0\t2.0\n", "no numbers below a line that names them"),
        (lvm().replace(b"\t0.5\t", b"\thalf\t"), "line 24 of 'r.lvm', channel 'Force', holds 'half'"),
        (lvm().replace(b"Response (Trigger)", b"Force"), "channel 'Force' twice"),
        (b"LabVIEW Measurement\t\0\n", "zero byte"),
        (segmented().replace(b"10.5", b"1.0.5"), "holds '1.0.5'"),
    ],
)
def test_what_cannot_be_told_is_refused(read, data, says):
    with pytest.raises(InputError) as caught:
        read(data, ("Force",) if b"0.100000" in data else ("Force", "Response (Trigger)"))
    assert says in str(caught.value)
    assert str(caught.value).isprintable()


def test_more_than_the_most(read):
    with pytest.raises(InputError, match="give at most 3"):
        read(lvm(), most=3)


def test_a_damaged_file_is_read_or_refused(read):
    rng = np.random.default_rng(5)
    for sound in (lvm("Multi"), lvm("No", ";", ","), segmented()):
        for _ in range(150):
            data = bytearray(sound)
            for at in rng.integers(len(data), size=rng.choice([1, 3, 30])):
                data[at] = rng.integers(256)
            del data[int(rng.integers(len(data))) if rng.random() < 0.3 else len(data) :]
            try:
                read(bytes(data), ["Force"])
            except InputError as error:
                assert str(error).isprintable()
