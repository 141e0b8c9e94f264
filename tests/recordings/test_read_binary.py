"""HDF5, MATLAB and LabVIEW files: only plain numbers, only from this file, and damage said in one line."""

import logging
import struct
import zlib

import h5py
import numpy as np
import pytest
import scipy.io
from nptdms import ChannelObject, RootObject, TdmsWriter

from drillenv.checks import InputError
from drillenv.recordings.read_h5 import read_h5
from drillenv.recordings.read_mat import read_mat
from drillenv.recordings.read_tdms import read_tdms

MOST = 1000


def refusal(read, path, column="x", most=MOST) -> str:
    with pytest.raises(InputError) as caught:
        read(path, [column], most)
    message = str(caught.value)
    assert message.isprintable()
    assert path.name in message
    return message


@pytest.fixture
def hdf5(tmp_path):
    """A file with something of everything."""
    path, other = tmp_path / "r.h5", tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["x"] = np.arange(5.0)
    with h5py.File(path, "w") as file:
        file["x"] = np.arange(5.0)
        file["rig/y"] = np.arange(5, dtype="i2")[:, None]
        file["soft"] = h5py.SoftLink("/rig/y")
        file["group"] = h5py.SoftLink("rig")
        file["nowhere"] = h5py.SoftLink("/nothing")
        file["ring"] = h5py.SoftLink("/gnir")
        file["gnir"] = h5py.SoftLink("/ring")
        file["outside"] = h5py.ExternalLink("other.h5", "/x")
        file["by way of"] = h5py.SoftLink("/outside")
        file["table"] = np.ones((5, 2))
        file["text"] = "12345"
        file["complex"] = np.ones(5) * 1j
        file["flags"] = np.ones(5, dtype=bool)
        file["references"] = np.array([file["x"].ref], dtype=h5py.ref_dtype)
        file["empty"] = h5py.Empty("f8")
        file["long"] = np.zeros(MOST + 1)
        file.create_dataset("huge", shape=(10**12,), dtype="f8", chunks=(2**26,))
        file.create_dataset("chunky", shape=(MOST,), maxshape=(None,), dtype="f8", chunks=(2**26,))
        file.create_dataset("raw", shape=(5,), dtype="f8", external=[("/etc/hostname", 0, 40)])
        layout = h5py.VirtualLayout(shape=(5,), dtype="f8")
        layout[:] = h5py.VirtualSource(other, "x", shape=(5,))
        file.create_virtual_dataset("virtual", layout)
        file["matlab text"] = np.frombuffer(b"a\0b\0", dtype="u2")
        file["matlab text"].attrs["MATLAB_class"] = np.bytes_("char")
    return path


@pytest.mark.parametrize("name", ["x", "rig/y", "/rig/y", "soft", "group/y"])
def test_hdf5_numbers(hdf5, name):
    samples = read_h5(hdf5, [name], MOST).columns[name]
    np.testing.assert_array_equal(samples, np.arange(5.0))
    assert samples.dtype == np.float64


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("z", "no dataset 'z': give one of those it has"),
        ("rig", "no dataset 'rig'"),
        ("x/y", "no dataset 'x/y'"),
        ("nowhere", "no dataset 'nowhere'"),
        ("../other.h5/x", "no dataset"),
        ("ring", "links in a circle"),
        ("outside", "links to another file"),
        ("by way of", "links to another file"),
        ("virtual", "lies in another file"),
        ("raw", "lies in another file"),
        ("table", "is 5 x 2"),
        ("text", "no real numbers"),
        ("complex", "no real numbers"),
        ("flags", "no real numbers"),
        ("references", "no real numbers"),
        ("empty", "is empty"),
        ("long", "has 1001 samples"),
        ("huge", "has 1000000000000 samples"),
        ("chunky", "too large pieces"),
        ("matlab text", "is a MATLAB"),
    ],
)
def test_hdf5_else_is_refused(hdf5, name, says):
    assert says in refusal(read_h5, hdf5, name)


def test_hdf5_time_is_read_only_where_it_is_plain(tmp_path):
    path = tmp_path / "r.h5"
    with h5py.File(path, "w") as file:
        file["x"], file["time_s"] = np.arange(3.0), [0.0, 0.1, 0.2]
    np.testing.assert_array_equal(read_h5(path, ["x"], MOST).clock.samples, [0.0, 0.1, 0.2])
    assert read_h5(path, ["time_s"], MOST).clock is None
    with h5py.File(path, "w") as file:
        file["x"], file["time_s"] = np.arange(3.0), h5py.ExternalLink("other.h5", "/x")
    assert read_h5(path, ["x"], MOST).clock is None


def test_matlab_5(tmp_path):
    path = tmp_path / "r.mat"
    content = {
        "row": np.arange(4.0)[None],
        "column": np.arange(4, dtype="i2")[:, None],
        "single": np.arange(4, dtype="f4"),
        "time_s": np.arange(4.0) / 10,
        "table": np.ones((2, 3)),
        "text": "abcd",
        "cells": np.array([1, "a"], dtype=object),
        "record": {"x": np.arange(4.0)},
        "flags": np.array([True, False]),
        "complex": np.ones(4) * 1j,
        "long": np.zeros(MOST + 1),
    }
    for compressed in (False, True):
        scipy.io.savemat(path, content, do_compression=compressed)
        table = read_mat(path, ["row", "column", "single"], MOST)
        for samples in table.columns.values():
            np.testing.assert_array_equal(samples, np.arange(4.0))
        np.testing.assert_array_equal(table.clock.samples, [0.0, 0.1, 0.2, 0.3])
        for name, says in [
            ("missing", "no variable 'missing': give one of those it has"),
            ("table", "is 2 x 3"),
            ("text", "is text"),
            ("cells", "is a cell"),
            ("record", "is a struct"),
            ("flags", "is a logical array"),
            ("complex", "no real numbers"),
            ("long", "has 1001 samples"),
        ]:
            assert says in refusal(read_mat, path, name)


def matlab_element(code: int, content: bytes) -> bytes:
    return struct.pack("<II", code, len(content)) + content.ljust((len(content) + 7) // 8 * 8, b"\0")


def test_matlab_5_beside_what_stays_shut(tmp_path):
    """Arrays are read from a file that also holds an object, and a file without its checksum is refused."""
    path = tmp_path / "r.mat"
    scipy.io.savemat(path, {"x": np.arange(4.0)})
    flags = matlab_element(6, struct.pack("<II", 17, 0))
    table = flags + matlab_element(1, b"t") + matlab_element(1, b"MCOS") + matlab_element(1, b"table")
    packed = zlib.compress(matlab_element(14, table))
    path.write_bytes(path.read_bytes() + matlab_element(14, table) + struct.pack("<II", 15, len(packed)) + packed)
    np.testing.assert_array_equal(read_mat(path, ["x"], MOST).columns["x"], np.arange(4.0))
    assert "is an object" in refusal(read_mat, path, "t")


@pytest.mark.parametrize("code", [0, 8, 10, 11, 14, 15, 19, 20, 2**31])
def test_matlab_5_types_that_end_scipys_reader(tmp_path, code):
    """https://github.com/scipy/scipy/pull/25829: to look these up ends the program, not only the reading."""
    path = tmp_path / "r.mat"
    scipy.io.savemat(path, {"x": np.arange(4.0)})
    data = bytearray(path.read_bytes())
    at = data.index(struct.pack("<II", 9, 32))
    data[at : at + 4] = struct.pack("<I", code)
    path.write_bytes(data)
    assert "damaged" in refusal(read_mat, path)


def test_matlab_5_of_the_other_byte_order(tmp_path):
    path = tmp_path / "r.mat"
    name, numbers = b"x".ljust(8, b"\0"), np.arange(3, dtype=">f8").tobytes()
    content = struct.pack(">6I", 6, 8, 6, 0, 5, 8) + struct.pack(">4I", 1, 3, 1, 1) + name + struct.pack(">II", 9, 24)
    element = struct.pack(">II", 14, len(content) + 24) + content + numbers
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI" + element)
    np.testing.assert_array_equal(read_mat(path, ["x"], MOST).columns["x"], np.arange(3.0))


def test_a_packed_bomb_is_refused_before_it_unfolds(tmp_path):
    path = tmp_path / "r.mat"
    bomb = zlib.compress(struct.pack("<II", 14, 2**31) + matlab_element(6, struct.pack("<II", 6, 0)) + bytes(10**8))
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + struct.pack("<II", 15, len(bomb)) + bomb)
    assert "damaged" in refusal(read_mat, path)


def test_matlab_of_other_versions_is_refused(tmp_path):
    path = tmp_path / "r.mat"
    scipy.io.savemat(path, {"x": np.arange(4.0)}, format="4")
    assert "version 5 or 7.3" in refusal(read_mat, path)
    path.write_bytes(b"")
    assert "version 5 or 7.3" in refusal(read_mat, path)


def test_labview(tmp_path):
    path = tmp_path / "r.tdms"
    with TdmsWriter(path) as writer:
        for part in (np.arange(2.0), np.arange(2.0, 5.0)):  # LabVIEW writes in segments
            writer.write_segment(
                [
                    RootObject({"operator": "somebody"}),
                    ChannelObject("rig", "x", part, {"wf_increment": 0.1}),
                    ChannelObject("a/b", "y", part.astype("i2"), {"wf_increment": 1.0}),
                    ChannelObject("rig", "text", ["a", "b"]),
                    ChannelObject("rig", "long", np.zeros(600)),
                ]
            )
    table = read_tdms(path, ["rig/x", "a/b/y"], MOST)
    np.testing.assert_array_equal(table.columns["rig/x"], np.arange(5.0))
    np.testing.assert_array_equal(table.columns["a/b/y"], np.arange(5.0))
    np.testing.assert_allclose(table.clock.samples, [0.0, 0.1, 0.2, 0.3, 0.4])
    assert read_tdms(path, ["a/b/y"], MOST).clock is None  # 1 s is what LabVIEW writes where nothing was stated
    assert "no channel 'x': give one of those it has, 'a/b/y', 'rig/x'" in refusal(read_tdms, path)
    assert "no real numbers" in refusal(read_tdms, path, "rig/text")
    assert "has 1200 samples" in refusal(read_tdms, path, "rig/long")


def test_labviews_scaling_is_applied(tmp_path):
    path = tmp_path / "r.tdms"
    scaling = {
        "NI_Number_Of_Scales": np.uint32(1),
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 0.5,
        "NI_Scale[0]_Linear_Y_Intercept": 10.0,
        "NI_Scale[0]_Linear_Input_Source": np.uint32(0xFFFFFFFF),
    }
    with TdmsWriter(path) as writer:
        writer.write_segment([ChannelObject("rig", "x", np.arange(4, dtype="i2"), scaling)])
    np.testing.assert_array_equal(read_tdms(path, ["rig/x"], MOST).columns["rig/x"], [10.0, 10.5, 11.0, 11.5])


@pytest.mark.parametrize("kind", ["h5", "mat", "mat73", "tdms"])
def test_a_file_cut_off_anywhere_is_refused(tmp_path, kind, capfd):
    path, whole = tmp_path / f"r.{kind.removesuffix('73')}", np.random.default_rng(0).normal(size=500)
    if kind == "tdms":
        with TdmsWriter(path) as writer:
            writer.write_segment([ChannelObject("rig", "x", whole)])
    elif kind == "mat":
        scipy.io.savemat(path, {"x": whole})
    else:
        with h5py.File(path, "w", userblock_size=512 if kind == "mat73" else 0) as file:
            file["x"] = whole
        if kind == "mat73":
            with open(path, "r+b") as file:
                file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    read, column = {
        "h5": (read_h5, "x"),
        "mat": (read_mat, "x"),
        "mat73": (read_mat, "x"),
        "tdms": (read_tdms, "rig/x"),
    }[kind]
    data = path.read_bytes()
    np.testing.assert_array_equal(read(path, [column], MOST).columns[column], whole)
    for size in [*range(0, len(data), 97), len(data) - 1]:
        path.write_bytes(data[:size])
        refusal(read, path, column)
    assert capfd.readouterr() == ("", "")
    assert logging.root.manager.disable == logging.NOTSET
