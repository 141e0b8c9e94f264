"""``drillenv campaign``: what the commands print, and with which exit code they end."""

import json
import time

import numpy as np
import pytest

from drillenv import cli
from drillenv.recordings import check_quality, read_campaign, write_campaign


@pytest.fixture
def command(capsys):
    """Runs a command; returns its exit code, what it prints, and what it complains of."""

    def run(*arguments):
        code = cli.main([str(each) for each in arguments])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


@pytest.fixture
def folder_of(tmp_path):
    """A function that writes a campaign and returns its folder."""

    def write(campaign):
        return write_campaign(tmp_path / "c", campaign.title, campaign.rig, campaign.nominal, campaign.recordings)

    return write


def test_check_of_a_sound_campaign(command, folder_of, drill):
    folder = folder_of(drill)
    begun = time.perf_counter()
    assert command("campaign", "check", folder) == (0, "4 recordings: nothing to leave out\n", "")
    assert time.perf_counter() - begun < 10.0
    code, printed, _ = command("campaign", "check", folder, "--json")
    record = json.loads(printed)
    assert (code, record["sound"], record["findings"]) == (0, True, [])
    assert [each["name"] for each in record["recordings"]] == ["r01", "r02", "r03", "r04"]


def test_check_says_what_must_go(command, folder_of, drill, spoil, samples_of):
    force = samples_of(drill, "r02")["force"].copy()
    force[3000:3004] = np.nan
    folder = folder_of(spoil(drill, "r02", whole=True, force=force))
    code, printed, complaint = command("campaign", "check", folder)
    findings = check_quality(read_campaign(folder))
    assert (code, complaint) == (1, "")
    assert printed.splitlines() == [
        *(f"quality: {each}" for each in findings),  # as a diagnosis says them
        "4 recordings: 1 with stretches to leave out",
    ]
    assert "r02, force, 0.1172 to 0.1173 s: 4 samples are no numbers" in printed
    code, printed, _ = command("campaign", "check", folder, "--json")
    record = json.loads(printed)
    assert (code, record["sound"]) == (1, False)
    assert record["findings"][0]["kind"] == "not-a-number"
    assert record["findings"][0]["spans"] == [[3000 / 25600, 3004 / 25600]]


def test_notes_alone_are_no_fault(command, folder_of, drill):
    folder = folder_of(drill)
    text = (folder / "r01.csv").read_text()
    (folder / "r01.csv").write_text(text.rstrip("\n"))
    code, printed, _ = command("campaign", "check", folder)
    assert code == 0
    assert "may be cut off there (reading, note)" in printed
    assert printed.endswith("4 recordings: nothing to leave out\n")


def test_check_of_no_campaign(command, tmp_path):
    code, printed, complaint = command("campaign", "check", tmp_path)
    assert (code, printed) == (2, "")
    assert complaint.startswith("drillenv: campaign ") and complaint.count("\n") == 1
    assert command("campaign")[0] == 2
