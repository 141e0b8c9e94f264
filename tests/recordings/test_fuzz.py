"""However a campaign is damaged, it is read or refused in one line: no other error, no words, no waiting."""

import json
import random
import shutil
import time
import warnings
from dataclasses import replace
from types import MappingProxyType

import pytest

from drillenv.checks import InputError
from drillenv.recordings import check_quality, read_campaign, write_campaign

FORMATS = ("csv", "mat", "mat73", "h5", "tdms")
JUNK = [None, True, 0, -1, 1e308, "", "x", [], {}, [1], {"a": 1}, 10**400, "../x.csv", "/etc/passwd", "a\nb", "\ud800"]
PATIENCE = 10.0  # s, of a busy machine; a second on an idle one


@pytest.fixture(scope="module")
def sound(drill, tmp_path_factory):
    """Small campaigns in each format."""
    place = tmp_path_factory.mktemp("sound")
    recordings = []
    for recording in drill.recordings[:2]:
        channels = {name: replace(each, samples=each.samples[:4000]) for name, each in recording.channels.items()}
        recordings.append(replace(recording, channels=MappingProxyType(channels)))
    for file_format in FORMATS:
        write_campaign(place / file_format, "sound", drill.rig, drill.nominal, recordings, file_format)
    return place


def places(value, path=()):
    """The path of every value inside a JSON value."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in inside:
        yield (*path, key)
        yield from places(part, (*path, key))


def flip(data, rng):
    last = len(data) if rng.random() < 0.4 else min(len(data), 3000)
    for _ in range(rng.choice((1, 1, 3, 10, 100))):
        data[rng.randrange(last)] = rng.randrange(256)


def truncate(data, rng):
    del data[rng.randrange(len(data)) :]


def insert(data, rng):
    at = rng.randrange(len(data))
    data[at:at] = rng.randbytes(rng.choice((1, 4, 1000)))


def blank(data, rng):
    at, size = rng.randrange(len(data)), rng.choice((8, 64, 4096))
    data[at : at + size] = bytes(len(data[at : at + size]))


def repeat(data, rng):
    at, size = rng.randrange(len(data)), rng.choice((1, 10, 300))
    data[at:at] = data[at : at + size]


def damage(folder, sound, rng) -> str:
    """Spoil one file of a campaign; says how."""
    files = sorted(path for path in folder.iterdir() if path.suffix != ".json")
    path, document = rng.choice(files), folder / "campaign.json"
    way = rng.choice(["bytes"] * 5 + ["text", "value", "drop", "swap", "gone"])
    if way in ("bytes", "text"):
        path = path if way == "bytes" else document
        data = bytearray(path.read_bytes())
        change = rng.choice((flip, flip, truncate, insert, blank, repeat))
        change(data, rng)
        path.write_bytes(data)
        return f"{change.__name__} {path.name}"
    if way == "swap":
        other = rng.choice([each for each in sorted(sound.rglob("*")) if each.is_file()])
        shutil.copyfile(other, path)
        return f"{other.parent.name}/{other.name} for {path.name}"
    if way == "gone":
        path.unlink()
        return f"no {path.name}"
    content = json.loads(document.read_text())
    where = rng.choice(list(places(content)))
    inner = content
    for key in where[:-1]:
        inner = inner[key]
    if way == "drop":
        del inner[where[-1]]
    else:
        inner[where[-1]] = rng.choice(JUNK)
    document.write_text(json.dumps(content))
    return f"{way} {where}"


def outcome(folder) -> str:
    """How reading and checking a campaign ends, every warning an error."""
    began = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            campaign = read_campaign(folder)
            for finding in check_quality(campaign):
                assert str(finding).isprintable()
            ended = "read"
        except InputError as error:
            message = str(error)
            assert message.isprintable(), message
            assert 20 < len(message) < 600, message
            ended = "refused"
    assert time.perf_counter() - began < PATIENCE
    return ended


def fuzz(sound, tmp_path, capfd, seeds) -> dict[str, int]:
    counts = {"read": 0, "refused": 0}
    for seed in seeds:
        rng = random.Random(seed)
        folder = tmp_path / str(seed)
        shutil.copytree(sound / rng.choice(FORMATS), folder)
        how = damage(folder, sound, rng)
        try:
            counts[outcome(folder)] += 1
        except Exception as error:
            raise AssertionError(f"seed {seed}: {how}") from error
        shutil.rmtree(folder)
    assert capfd.readouterr() == ("", "")
    return counts


def test_the_undamaged_campaigns_are_read(sound):
    assert [outcome(sound / file_format) for file_format in FORMATS] == ["read"] * 5


@pytest.mark.slow
def test_two_hundred_damaged_campaigns(sound, tmp_path, capfd):
    counts = fuzz(sound, tmp_path, capfd, range(200))
    assert counts["refused"] > 100
    assert counts["read"] > 20


@pytest.mark.slow
@pytest.mark.parametrize("count", [400, pytest.param(2000, marks=pytest.mark.thorough)])
def test_many_more(sound, tmp_path, capfd, count):
    fuzz(sound, tmp_path, capfd, range(1000, 1000 + count))
