"""Files appear whole or not at all."""

import os
import stat

import pytest

from drillenv.checks import InputError
from drillenv.files import check_writable, made_folder, whole


def test_a_file_takes_its_name_at_the_end(tmp_path):
    path = tmp_path / "table.csv"
    with whole(path) as name:
        name.write_text("1,2\n")
        assert not path.exists()
        assert (name.parent, name.suffix) == (tmp_path, ".csv")
    assert path.read_text() == "1,2\n"
    assert list(tmp_path.iterdir()) == [path]
    mask = os.umask(0)
    os.umask(mask)
    assert stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask


def test_what_breaks_off_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), whole(path) as name:
        name.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link(tmp_path):
    path, link = tmp_path / "table.csv", tmp_path / "link.csv"
    path.write_text("old")
    link.symlink_to(path)
    with whole(link) as name:
        name.write_text("new")
    assert link.is_symlink()
    assert path.read_text() == "new"


def test_a_device_is_written_to_and_not_replaced():
    with whole(os.devnull) as name:
        name.write_text("gone")
    assert not os.path.isfile(os.devnull)
    check_writable(os.devnull)


@pytest.mark.parametrize("make", [check_writable, lambda path: whole(path).__enter__()])
@pytest.mark.parametrize("path", ["", " ", "\0", None, 3, b"x.csv", ".", "missing/x.csv", "x" * 300, "file/x.csv"])
def test_bad_paths_are_refused_in_one_line(make, path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError) as caught:
        make(path)
    assert len(str(caught.value).splitlines()) == 1
    assert [each.name for each in tmp_path.iterdir()] == ["file"]


def test_check_leaves_nothing_and_changes_nothing(tmp_path):
    path = tmp_path / "table.csv"
    check_writable(path)
    assert not list(tmp_path.iterdir())
    path.write_text("old")
    check_writable(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_is_made_with_those_above_it(tmp_path):
    assert made_folder(tmp_path / "a" / "b").is_dir()
    assert made_folder(str(tmp_path / "a" / "b")) == tmp_path / "a" / "b"


@pytest.mark.parametrize("wrong", ["a/file/b", "a/file", "a\0b", None])
def test_a_folder_that_cannot_be_made_is_said_in_one_line(tmp_path, wrong):
    (made_folder(tmp_path / "a") / "file").touch()
    with pytest.raises(InputError, match=r"^cannot make the folder .*; give another$"):
        made_folder(wrong if wrong is None else f"{tmp_path}/{wrong}")
