"""Every fault is found when it is put into sound recordings of the drilling rig, and sound recordings have none."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

import drillenv
from drillenv.checks import InputError
from drillenv.recordings import Campaign, Channel, check_quality, read_campaign
from drillenv.recordings.findings import KINDS

NAMES = ["r01", "r02", "r03", "r04"]
RATE = 25600.0


def kinds(findings, name=None) -> set[tuple[str, str | None]]:
    return {(finding.kind, finding.channel) for finding in findings if name in (None, finding.recording)}


def well_formed(findings) -> None:
    for finding in findings:
        assert finding.kind in KINDS
        assert finding.severity in ("note", "exclude stretch", "exclude channel", "exclude recording")
        assert 0.0 <= finding.start < finding.stop
        assert finding.sentence.isprintable()
        assert str(finding).startswith(finding.recording)
        assert str(finding).isprintable()
        for start, stop in finding.spans:
            assert finding.start <= start < stop <= finding.stop


def only_finding(findings, name: str, kind: str, channel: str | None):
    well_formed(findings)
    assert [(each.recording, each.kind, each.channel) for each in findings] == [(name, kind, channel)]
    return findings[0]


# --------------------------------------------------------------------------------------------------------------------
# sound campaigns


def test_a_sound_campaign_has_no_findings(drill):
    assert check_quality(drill) == ()


@pytest.mark.parametrize("name", [f"practice/p{i:02d}" for i in range(1, 13)] + ["real/emps", "real/cyberdiver-a"])
def test_the_shared_campaigns_have_no_findings(shared, name):
    assert check_quality(read_campaign(shared / name)) == ()


def rounded(samples, step):
    return np.round(samples / step) * step


def noisier(samples):
    return samples + 0.05 * samples.std() * np.random.default_rng(9).normal(size=samples.size)


HARMLESS = {
    "twelve bits": lambda s: {name: rounded(one, np.abs(one).max() / 2000) for name, one in s.items()},
    "coarse": lambda s: {"force": rounded(s["force"], 20.0), "acceleration": rounded(s["acceleration"], 4.0)},
    "noisy": lambda s: {name: noisier(one) for name, one in s.items()},
    "load cell cannot pull": lambda s: {"force": np.maximum(s["force"], 0.0)},
    "force offset": lambda s: {"force": s["force"] + 80.0},
    "force without its mean": lambda s: {"force": s["force"] - s["force"].mean()},
    "acceleration offset": lambda s: {"acceleration": s["acceleration"] + 20.0},
    "late by 1 ms": lambda s: {"acceleration": np.concatenate((s["acceleration"][:26], s["acceleration"][:-26]))},
    "mass before the load cell": lambda s: {"force": s["force"] + 0.3 * s["acceleration"]},
    "hum": lambda s: {"force": s["force"] + 60.0 * np.sin(2 * np.pi * 50.0 * np.arange(s["force"].size) / RATE)},
    "slow accelerometer": lambda s: {"acceleration": low_passed(s["acceleration"], 300.0)},
}


def low_passed(samples, frequency):
    share = 1.0 - np.exp(-2 * np.pi * frequency / RATE)
    state, found = samples[0], np.empty_like(samples)
    for i, value in enumerate(samples.tolist()):
        state += share * (value - state)
        found[i] = state
    return found


@pytest.mark.parametrize("harm", HARMLESS)
@pytest.mark.parametrize("name", NAMES)
def test_what_the_diagnosis_is_for_is_no_quality_fault(harm, name, drill, spoil, samples_of):
    assert check_quality(spoil(drill, name, **HARMLESS[harm](samples_of(drill, name)))) == ()


WRONG_RIGS = [
    {"indenter_mass": 4.5},
    {"damping": 1225.0},
    {"damping": 4900.0},
    {"stiffness": 2e5},
    {"drive_gain": 0.6},
    {"pressure_gain": 1.6},
]


@pytest.mark.parametrize("off", WRONG_RIGS)
def test_wrong_constants_are_no_quality_fault(off, drill, record):
    rig = drillenv.Rig(**off)
    recordings = (record("a", (118, 0.55, 0.8), rig=rig), record("b", (61, 0.45, 1.4), rig=rig))
    assert check_quality(replace(drill, recordings=recordings)) == ()


@pytest.mark.parametrize("rate", [6400.0, 10240.0, 51200.0])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_other_sample_rates_with_and_without_noise(rate, noise, drill, record):
    recordings = (
        record("a", (101.7, 0.5, 0.9), rate=rate, noise=noise),
        record("b", (57.9, 0.35, 1.7), "fresh", rate=rate, noise=noise),
    )
    assert check_quality(replace(drill, recordings=recordings)) == ()


@pytest.mark.parametrize("case", [1, 5, drillenv.Rock(3e6, 5e6), drillenv.Rock(8e7, 1.2e8)])
def test_other_rocks(case, drill, record):
    recordings = (record("a", (101.7, 0.5, 0.9), rock=case), record("b", (57.9, 0.35, 1.7), rock=case))
    assert check_quality(replace(drill, recordings=recordings)) == ()


@pytest.mark.slow
def test_a_hundred_random_recordings_have_no_findings(drill, record):
    rng = np.random.default_rng(12)
    for i in range(100):
        place = (float(rng.uniform(50, 120)), float(rng.uniform(0.3, 0.6)), float(rng.uniform(0.6, 1.8)))
        starts = "fresh" if i % 4 == 0 else "running"
        recording = record(f"r{i}", place, starts, seed=i, rock=int(rng.integers(1, 7)), seconds=0.5)
        assert check_quality(replace(drill, recordings=(recording,))) == (), place


# --------------------------------------------------------------------------------------------------------------------
# signs, units and swapped channels

TURNED = [["force"], ["acceleration"], ["excitation"], ["force", "acceleration"]]


@pytest.mark.parametrize("which", TURNED)
@pytest.mark.parametrize("name", NAMES)
def test_turned_signs(which, name, drill, spoil, samples_of):
    samples = samples_of(drill, name)
    findings = check_quality(spoil(drill, name, **{channel: -samples[channel] for channel in which}))
    well_formed(findings)
    assert kinds(findings) == {("sign", channel) for channel in which}
    assert {finding.recording for finding in findings} == {name}
    assert all((finding.start, finding.stop) == (0.0, pytest.approx(0.4)) for finding in findings)


@pytest.mark.parametrize("channel", ["force", "acceleration"])
def test_a_sign_that_turns_on_the_way_is_placed_in_time(channel, drill, spoil, samples_of):
    samples = samples_of(drill, "r02")[channel].copy()
    samples[samples.size // 2 :] *= -1
    finding = only_finding(check_quality(spoil(drill, "r02", **{channel: samples})), "r02", "sign", channel)
    assert finding.start == pytest.approx(0.2, abs=4.5 / 61.3)
    assert finding.stop == pytest.approx(0.4)


@pytest.mark.parametrize("channel", ["force", "acceleration", "excitation"])
@pytest.mark.parametrize("factor", [1000.0, 1e-3, 9.80665, 1 / 9.80665])
@pytest.mark.parametrize("name", ["r01", "r03"])
def test_units(channel, factor, name, drill, spoil, samples_of):
    samples = samples_of(drill, name)[channel] * factor
    finding = only_finding(check_quality(spoil(drill, name, **{channel: samples})), name, "unit", channel)
    assert f"{max(factor, 1 / factor):.4g} times too {'large' if factor > 1 else 'small'}" in finding.sentence


def test_the_unit_that_was_meant_is_named(drill, spoil, samples_of):
    samples = samples_of(drill, "r01")
    found = check_quality(spoil(drill, "r01", force=samples["force"] * 1e3))
    assert "give its unit as N instead of kN" in found[0].sentence
    found = check_quality(spoil(drill, "r01", acceleration=samples["acceleration"] * 9.80665))
    assert "give its unit as m/s^2 instead of g" in found[0].sentence
    found = check_quality(spoil(drill, "r01", excitation=samples["excitation"] * 1e3))
    assert "give its unit as mV instead of V" in found[0].sentence


def test_a_unit_wrong_in_every_recording_is_found(drill, spoil, samples_of):
    campaign = drill
    for name in NAMES:
        campaign = spoil(campaign, name, whole=True, acceleration=samples_of(drill, name)["acceleration"] / 9.80665)
    found = check_quality(campaign)
    assert [(finding.recording, finding.kind) for finding in found] == [(name, "unit") for name in NAMES]


SWAPPED = {
    "force, acceleration": {"force": "acceleration", "acceleration": "force"},
    "excitation, force": {"excitation": "force", "force": "excitation"},
    "excitation, acceleration": {"excitation": "acceleration", "acceleration": "excitation"},
    "excitation, force, acceleration": {"excitation": "force", "force": "acceleration", "acceleration": "excitation"},
}


@pytest.mark.parametrize("which", SWAPPED)
@pytest.mark.parametrize("in_units", [False, True])
@pytest.mark.parametrize("name", ["r02", "r03"])
def test_swapped_channels(which, in_units, name, drill, spoil, samples_of):
    samples = samples_of(drill, name)
    # in_units: the columns are swapped in campaign.json, so the numbers are taken in the other's unit
    factor = {"excitation": 1.0, "force": 1e3, "acceleration": 9.80665} if in_units else dict.fromkeys(samples, 1.0)
    changed = {to: samples[source] / factor[source] * factor[to] for to, source in SWAPPED[which].items()}
    finding = only_finding(check_quality(spoil(drill, name, **changed)), name, "swapped", which)
    for to, source in SWAPPED[which].items():
        assert f"{to} holds what looks like the {source}" in finding.sentence


def test_channels_of_another_recording(drill, spoil, samples_of):
    other = samples_of(drill, "r03")["acceleration"]
    found = check_quality(spoil(drill, "r01", acceleration=other))
    only_finding(found, "r01", "unrelated", "force, acceleration")
    dead = np.random.default_rng(0).normal(size=other.size)
    found = check_quality(spoil(drill, "r01", acceleration=dead))
    only_finding(found, "r01", "unrelated", "force, acceleration")


# --------------------------------------------------------------------------------------------------------------------
# excitation, sample rate, time


def test_a_missing_excitation(drill, spoil, samples_of):
    rng, silent = np.random.default_rng(0), np.zeros(samples_of(drill, "r01")["excitation"].size)
    noise = [rng.normal(0.0, size, silent.size) for size in (0.002, 0.4)]
    for excitation in (None, silent, silent + 3.0, *noise):
        found = check_quality(spoil(drill, "r01", excitation=excitation))
        only_finding(found, "r01", "missing-excitation", "excitation")


@pytest.mark.parametrize("channel", ["force", "acceleration"])
def test_another_missing_channel(channel, drill, spoil):
    found = check_quality(spoil(drill, "r02", **{channel: None}))
    only_finding(found, "r02", "missing-channel", channel)


@pytest.mark.parametrize("factor", [0.5, 0.98, 1.02, 2.0])
@pytest.mark.parametrize("name", NAMES)
def test_the_sample_rate_against_the_excitation(factor, name, drill, spoil):
    found = check_quality(spoil(drill, name, {"sample_rate": factor * RATE}))
    finding = only_finding(found, name, "sample-rate", "excitation")
    assert "to about 25600 Hz" in finding.sentence or "to about 2560" in finding.sentence


def test_an_excitation_that_differs_from_its_setting(drill, spoil, samples_of):
    excitation = samples_of(drill, "r01")["excitation"]
    found = check_quality(spoil(drill, "r01", excitation=1.3 * excitation))
    finding = only_finding(found, "r01", "excitation", "excitation")
    assert "0.7152 V, the setting says 0.55 V" in finding.sentence
    found = check_quality(spoil(drill, "r01", {"setting": drillenv.Setting(112.0, 0.55, 0.8)}))
    assert ("sample-rate", "excitation") in kinds(found)


@pytest.mark.parametrize(("every", "severity"), [(6, "note"), (16, "exclude recording")])
def test_a_sample_rate_too_low_for_the_impacts(every, severity, drill, spoil, samples_of):
    thin = {channel: samples[::every] for channel, samples in samples_of(drill, "r02").items()}
    found = check_quality(spoil(drill, "r02", {"sample_rate": RATE / every}, **thin))
    finding = only_finding(found, "r02", "sample-rate", None)
    assert finding.severity == severity


@pytest.mark.parametrize("lost", [25, 100, 250])
@pytest.mark.parametrize("name", NAMES)
def test_lost_samples_show_in_the_phase(lost, name, drill, spoil, samples_of):
    cut = {channel: np.delete(one, slice(5000, 5000 + lost)) for channel, one in samples_of(drill, name).items()}
    finding = only_finding(check_quality(spoil(drill, name, **cut)), name, "time-gap", None)
    assert finding.start == pytest.approx(5000 / RATE, abs=0.002)
    assert len(finding.spans) == 1


def test_the_files_own_time(drill, spoil, samples_of):
    size = samples_of(drill, "r01")["force"].size
    clock = np.arange(size) / RATE
    assert check_quality(spoil(drill, "r01", {"clock": clock})) == ()
    assert check_quality(spoil(drill, "r01", {"clock": 1e9 + clock})) == ()
    assert check_quality(spoil(drill, "r01", {"clock": np.round(clock, 3)})) == ()  # few digits
    late = clock.copy()
    late[4000:] += 0.020
    finding = only_finding(check_quality(spoil(drill, "r01", {"clock": late})), "r01", "time-gap", "time")
    assert finding.start == pytest.approx(4000 / RATE, abs=1e-4)
    assert "+20 ms" in finding.sentence
    finding = only_finding(check_quality(spoil(drill, "r01", {"clock": clock * 2})), "r01", "sample-rate", "time")
    assert "12800 samples a second" in finding.sentence
    found = check_quality(spoil(drill, "r01", {"clock": np.zeros(size)}))
    only_finding(found, "r01", "sample-rate", "time")
    clock[7] = np.nan
    only_finding(check_quality(spoil(drill, "r01", {"clock": clock})), "r01", "time-gap", "time")


def test_a_pressure_gauge(drill):
    def gauged(bar):
        recording = drill.recordings[0]
        gauge = Channel(np.full(recording.size, bar * 1e5), "bar", "p")
        channels = MappingProxyType({**recording.channels, "pressure": gauge})
        return check_quality(replace(drill, recordings=(replace(recording, channels=channels),)))

    assert gauged(0.82) == ()
    only_finding(gauged(1.6), "r01", "pressure", "pressure")
    only_finding(gauged(-0.8), "r01", "pressure", "pressure")
    only_finding(gauged(800.0), "r01", "unit", "pressure")


# --------------------------------------------------------------------------------------------------------------------
# faults of one channel


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("channel", ["excitation", "force", "acceleration"])
def test_what_is_no_number(value, channel, drill, spoil, samples_of):
    samples = samples_of(drill, "r03")[channel].copy()
    samples[2000:2010] = samples[7000:7050] = value
    finding = only_finding(check_quality(spoil(drill, "r03", **{channel: samples})), "r03", "not-a-number", channel)
    assert finding.spans == ((2000 / RATE, 2010 / RATE), (7000 / RATE, 7050 / RATE))
    assert finding.severity == "exclude stretch"
    samples[1000:9000] = value
    finding = only_finding(check_quality(spoil(drill, "r03", **{channel: samples})), "r03", "not-a-number", channel)
    assert finding.severity == ("exclude channel" if channel == "excitation" else "exclude recording")


@pytest.mark.parametrize("channel", ["excitation", "force", "acceleration"])
@pytest.mark.parametrize("share", [0.9, 0.6])
@pytest.mark.parametrize("bits", [None, 12])
@pytest.mark.parametrize("name", ["r01", "r03"])
def test_clipping(channel, share, bits, name, drill, spoil, samples_of):
    samples = samples_of(drill, name)[channel]
    low, high = -np.inf if channel == "force" else share * samples.min(), share * samples.max()
    clipped = np.clip(samples, low, high)
    if bits:
        clipped = rounded(clipped, 2.2 * np.abs(samples).max() / 2**bits)
    found = check_quality(spoil(drill, name, **{channel: clipped}))
    well_formed(found)
    assert kinds(found) == {("clipping", channel)}
    assert {finding.recording for finding in found} == {name}
    first = int(np.flatnonzero(samples >= high)[0])
    assert any(finding.start == pytest.approx(first / RATE, abs=2 / RATE) for finding in found)


def held(samples, at, size, value):
    found = samples.copy()
    found[at : at + size] = samples[at - 1] if value == "held" else value
    return found


@pytest.mark.parametrize("channel", ["excitation", "force", "acceleration"])
@pytest.mark.parametrize("value", [0.0, "held"])
@pytest.mark.parametrize(("at", "size"), [(1111, 300), (6400, 450), (3333, 3500)])
@pytest.mark.parametrize("name", ["r02", "r04"])
def test_dropouts(channel, value, at, size, name, drill, spoil, samples_of):
    samples = samples_of(drill, name)[channel]
    found = check_quality(spoil(drill, name, **{channel: held(samples, at, size, value)}))
    finding = only_finding(found, name, "dropout", channel)
    assert finding.start == pytest.approx(at / RATE, abs=0.002)
    assert finding.stop == pytest.approx((at + size) / RATE, abs=0.002)


@pytest.mark.parametrize("channel", ["force", "acceleration"])
@pytest.mark.parametrize("name", NAMES)
def test_short_dropouts(channel, name, drill, spoil, samples_of):
    samples = samples_of(drill, name)[channel]
    for at in range(700, samples.size - 200, 2345):
        samples = held(samples, at, 12, "held")
    finding = only_finding(check_quality(spoil(drill, name, **{channel: samples})), name, "dropout", channel)
    assert len(finding.spans) == 4


@pytest.mark.parametrize("channel", ["force", "acceleration"])
def test_a_dropout_in_coarse_or_noiseless_samples(channel, drill, record, spoil, samples_of):
    """Values repeat by themselves there; that the rig moved meanwhile is seen by the other channel."""
    clean = replace(drill, recordings=(record("a", (101.7, 0.5, 0.9), noise=0.0),))
    samples = samples_of(clean, "a")[channel]
    found = check_quality(spoil(clean, "a", **{channel: held(samples, 4000, 400, 0.0)}))
    only_finding(found, "a", "dropout", channel)
    samples = rounded(held(samples_of(drill, "r01")[channel], 4000, 400, 0.0), samples.std() / 20)
    only_finding(check_quality(spoil(drill, "r01", **{channel: samples})), "r01", "dropout", channel)


@pytest.mark.parametrize("channel", ["force", "acceleration"])
def test_a_dead_channel(channel, drill, spoil, samples_of):
    samples = np.full_like(samples_of(drill, "r01")[channel], 3.0)
    finding = only_finding(check_quality(spoil(drill, "r01", **{channel: samples})), "r01", "dropout", channel)
    assert finding.severity == "exclude recording"
    assert "never moves" in finding.sentence


@pytest.mark.parametrize("channel", ["excitation", "force", "acceleration"])
def test_spikes(channel, drill, spoil, samples_of):
    samples = samples_of(drill, "r01")[channel].copy()
    samples[[800, 5000]] = 3e7, -1e300
    finding = only_finding(check_quality(spoil(drill, "r01", **{channel: samples})), "r01", "spike", channel)
    assert [start for start, _ in finding.spans] == [800 / RATE, 5000 / RATE]


# --------------------------------------------------------------------------------------------------------------------
# the rest


def test_faults_at_once_are_told_apart(drill, spoil, samples_of):
    samples = samples_of(drill, "r02")
    force = held(-samples["force"], 4000, 300, 0.0)
    force[1000:1020] = np.nan
    found = check_quality(spoil(drill, "r02", force=force, excitation=samples["excitation"] * 1e3))
    well_formed(found)
    assert kinds(found) == {("sign", "force"), ("dropout", "force"), ("not-a-number", "force"), ("unit", "excitation")}


def test_findings_come_in_order(drill, spoil, samples_of):
    campaign = spoil(drill, "r03", whole=True, force=-samples_of(drill, "r03")["force"])
    campaign = spoil(
        campaign, "r01", whole=True, acceleration=held(samples_of(drill, "r01")["acceleration"], 900, 300, 0.0)
    )
    campaign = spoil(campaign, "r01", whole=True, force=held(samples_of(drill, "r01")["force"], 500, 300, 0.0))
    found = check_quality(campaign)
    order = [(each.recording, each.channel) for each in found]
    assert order == [("r01", "force"), ("r01", "acceleration"), ("r03", "force")]


def test_nothing_is_mended(drill, spoil, samples_of):
    force = held(samples_of(drill, "r01")["force"], 500, 300, np.nan)
    before = force.copy()
    campaign = spoil(drill, "r01", force=force)
    check_quality(campaign)
    np.testing.assert_array_equal(samples_of(campaign, "r01")["force"], before)


def test_a_short_recording_is_said_to_be_short(drill, spoil, samples_of):
    short = {channel: one[:1500] for channel, one in samples_of(drill, "r02").items()}
    only_finding(check_quality(spoil(drill, "r02", **short)), "r02", "short", None)


def test_what_reading_noted_is_passed_on(drill, tmp_path):
    from drillenv.recordings import write_campaign

    folder = write_campaign(tmp_path / "c", "t", drill.rig, drill.nominal, drill.recordings[:1])
    text = (folder / "r01.csv").read_text()
    (folder / "r01.csv").write_text(text.replace(",", ";").replace(".", ","))
    finding = only_finding(check_quality(read_campaign(folder)), "r01", "reading", None)
    assert "decimal commas" in finding.sentence


@pytest.mark.parametrize("given", [None, "folder", ()])
def test_what_is_no_campaign_is_refused(given):
    with pytest.raises(InputError, match="read_campaign"):
        check_quality(given)


@pytest.mark.slow
def test_faults_put_into_the_practice_campaigns(shared, spoil, samples_of):
    """One fault of each kind into a recording of each practice campaign."""
    for i, place in enumerate(sorted((shared / "practice").glob("p*"))):
        campaign = read_campaign(place)
        campaign = replace(campaign, recordings=tuple(replace(each, clock=None) for each in campaign.recordings))
        name = campaign.recordings[(3 * i) % 8].name
        campaign = replace(campaign, recordings=tuple(each for each in campaign.recordings if each.name == name))
        s = samples_of(campaign, name)
        faults = {
            ("sign", "force"): {"force": -s["force"]},
            ("sign", "acceleration"): {"acceleration": -s["acceleration"]},
            ("sign", "excitation"): {"excitation": -s["excitation"]},
            ("unit", "force"): {"force": s["force"] / 1e3},
            ("unit", "acceleration"): {"acceleration": s["acceleration"] * 9.80665},
            ("unit", "excitation"): {"excitation": s["excitation"] * 1e3},
            ("swapped", "force, acceleration"): {"force": s["acceleration"], "acceleration": s["force"]},
            ("missing-excitation", "excitation"): {"excitation": 0 * s["excitation"]},
            ("dropout", "force"): {"force": held(s["force"], 5000, 400, "held")},
            ("clipping", "acceleration"): {"acceleration": s["acceleration"].clip(0.7 * s["acceleration"].min())},
            ("not-a-number", "force"): {"force": held(s["force"], 5000, 40, np.nan)},
            ("time-gap", None): {channel: np.delete(one, slice(6000, 6060)) for channel, one in s.items()},
        }
        for (kind, channel), changed in faults.items():
            found = check_quality(spoil(campaign, name, **changed))
            assert [(each.recording, each.kind, each.channel) for each in found] == [(name, kind, channel)], place.name


def test_a_campaign_in_memory_needs_no_file(drill):
    campaign = Campaign("t", drill.rig, drill.nominal, drill.recordings, drill.folder)
    assert check_quality(campaign) == ()
