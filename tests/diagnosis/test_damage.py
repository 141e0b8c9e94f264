"""However a campaign is damaged, the diagnosis begins its fit or refuses in one line: no other error comes through."""

import random
import shutil

import numpy as np
import pytest

from drillenv.blind.campaigns import plain_campaign
from drillenv.checks import InputError
from drillenv.diagnosis import drill_diagnosis
from drillenv.diagnosis.report import diagnose
from drillenv.recordings import write_campaign
from tests.recordings.test_fuzz import FORMATS, damage


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A small campaign in each format."""
    place = tmp_path_factory.mktemp("sound")
    made = plain_campaign(np.random.default_rng(3), 4, recordings=4, seconds=0.12).campaign
    for file_format in FORMATS:
        write_campaign(place / file_format, "sound", made.rig, made.nominal, made.recordings, file_format)
    return place


class BegunError(Exception):
    """The recordings were good enough to be fitted."""


@pytest.mark.slow
def test_damaged_campaigns_are_refused_in_one_line(sound, tmp_path, monkeypatch):
    def begin(*_args, **_more):
        raise BegunError

    monkeypatch.setattr(drill_diagnosis, "plain_fit", begin)
    counts = {"begun": 0, "refused": 0}
    for seed in range(200):
        rng = random.Random(seed)
        folder = tmp_path / str(seed)
        shutil.copytree(sound / rng.choice(FORMATS), folder)
        how = damage(folder, sound, rng)
        try:
            diagnose(folder)
        except BegunError:
            counts["begun"] += 1
        except InputError as error:
            assert "\n" not in str(error), how
            counts["refused"] += 1
        except Exception as error:
            raise AssertionError(f"seed {seed}: {how}") from error
        shutil.rmtree(folder)
    assert min(counts.values()) > 20
