"""The example folder that ships: small, read as it stands, and what its page says it is."""

import re
from pathlib import Path

import numpy as np

from drillenv import cli
from drillenv.recordings import check_quality, read_campaign

FOLDER = Path(__file__).parents[2] / "docs" / "recordings"


def test_it_is_small_and_sound():
    campaign = read_campaign(FOLDER / "example")
    assert len(campaign.recordings) == 6
    assert check_quality(campaign) == ()
    assert sum(path.stat().st_size for path in (FOLDER / "example").iterdir()) < 1_500_000


def test_it_was_made_by_the_command_on_the_page(tmp_path, capsys):
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"^ {4}drillenv (simulate --campaign .*)$", page, flags=re.MULTILINE)
    arguments = command.replace("docs/recordings/example", str(tmp_path / "c")).split()
    assert cli.main(arguments) == 0
    shipped, made = read_campaign(FOLDER / "example"), read_campaign(tmp_path / "c")
    for one, other in zip(shipped.recordings, made.recordings, strict=True):
        assert one.setting == other.setting
        # processors round otherwise, which a chaotic motion shows after the second that the others run before
        for name in one.channels if one.starts == "fresh" else ("excitation",):
            channel = one.channels[name]
            np.testing.assert_allclose(other.channels[name].samples[:1000], channel.samples[:1000], atol=0.11)
