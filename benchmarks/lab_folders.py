"""What a diagnosis makes of folders as labs hand them over: wrong labels, faults of sensors and loggers, odd files.

    python -m benchmarks.lab_folders --seed 20262011 --campaigns 40 --out runs/lab --json lab-folders.json

Each campaign is one of the concealed rig of the blind trial, recorded under its conditions, with nothing missing or
with one mechanism of the library at full strength. One to three of the faults below are put into it, it is written
to a folder, and ``drillenv diagnose`` is run on that folder as a lab would run it. A row is right if the verdict is
and what was concealed is named, alone. It is refused if the program says in one line why it gives no verdict, where
the fault is one that only the lab can mend. Where it is neither, the same campaign is diagnosed without its faults, to
tell what they spoil ("spoilt") from what a diagnosis misses anyway ("missed"). Rows are written as they come; a run
that was stopped goes on.
"""

from __future__ import annotations

import argparse
import csv
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from drillenv.blind.campaigns import Planned, make_campaign, plan
from drillenv.files import whole
from drillenv.recordings import Campaign, Channel, Recording, write_campaign
from drillenv.recordings.write import FILE_FORMATS

LIMIT = 600.0
"""s after which a diagnosis is stopped."""
SHARES = (0.35, 0.45, 0.2)
"""Of campaigns with one, two and three faults."""
NOTHING_MISSING = 0.35
"""Share of campaigns that conceal nothing."""


@dataclass(frozen=True)
class Fault:
    """Something that is wrong with a campaign."""

    change: Callable[[Campaign, np.random.Generator], Campaign]
    lab_mends: bool = False
    """Whether the program may give no verdict, and say what the lab has to mend."""


# --- Labels


def with_recording(campaign: Campaign, i: int, recording: Recording) -> Campaign:
    """The campaign with its recording ``i`` in another's place."""
    recordings = list(campaign.recordings)
    recordings[i] = recording
    return replace(campaign, recordings=tuple(recordings))


def one_of(campaign: Campaign, rng: np.random.Generator, starts: str | None = None) -> int:
    """The place of a recording drawn, of those that start so."""
    places = [i for i, each in enumerate(campaign.recordings) if starts in (None, each.starts)]
    return int(rng.choice(places))


def wrong_setting(field: str, low: float, high: float) -> Callable[[Campaign, np.random.Generator], Campaign]:
    """One recording whose ``field`` is off by a share between these."""

    def change(campaign: Campaign, rng: np.random.Generator) -> Campaign:
        i = one_of(campaign, rng)
        recording = campaign.recordings[i]
        assert recording.setting is not None
        factor = 1.0 + float(rng.uniform(low, high)) * float(rng.choice([-1.0, 1.0]))
        value = round(getattr(recording.setting, field) * factor, 3)
        return with_recording(campaign, i, replace(recording, setting=replace(recording.setting, **{field: value})))

    return change


def fresh_that_ran(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """One recording said to be of fresh rock, of a rig that was running."""
    i = one_of(campaign, rng, "running")
    return with_recording(campaign, i, replace(campaign.recordings[i], starts="fresh"))


# --- Samples


def in_channels(recording: Recording, change: Callable[[str, np.ndarray], np.ndarray]) -> Recording:
    """The recording with the samples of every channel changed."""
    channels = {name: replace(each, samples=change(name, each.samples)) for name, each in recording.channels.items()}
    return replace(recording, channels=channels)


def everywhere(campaign: Campaign, change: Callable[[str, np.ndarray], np.ndarray]) -> Campaign:
    """The campaign with the samples of every channel of every recording changed."""
    return replace(campaign, recordings=tuple(in_channels(each, change) for each in campaign.recordings))


def lost_samples(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """Two recordings lack 10 to 60 samples, as after a buffer that ran over."""
    for i in rng.choice(len(campaign.recordings), 2, replace=False):
        recording = campaign.recordings[int(i)]
        begin = int(rng.integers(recording.size // 4, 3 * recording.size // 4))
        gap = slice(begin, begin + int(rng.integers(10, 61)))
        lacking = in_channels(recording, lambda _name, samples, gap=gap: np.delete(samples, gap))
        campaign = with_recording(campaign, int(i), lacking)
    return campaign


def pre_trigger(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """Recordings from rest begin 20 to 80 ms before the generator is switched on."""
    for i, recording in enumerate(campaign.recordings):
        if recording.starts != "fresh":
            continue
        size = round(float(rng.uniform(0.02, 0.08)) * recording.sample_rate)

        def extend_horizon(name: str, samples: np.ndarray, size: int = size) -> np.ndarray:
            noise = float(np.std(np.diff(samples[: max(8, samples.size // 400)]))) / 1.5 or 1e-3
            level = samples[0] if name == "force" else 0.0
            return np.concatenate([level + min(noise, 5.0) * rng.standard_normal(size), samples])

        campaign = with_recording(campaign, i, in_channels(recording, extend_horizon))
    return campaign


def dead_channel(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """A position that was never connected, in every recording."""
    recordings = []
    for each in campaign.recordings:
        position = Channel(np.full(each.size, float(rng.choice([0.0, 2.5e-3]))), "m", "position")
        recordings.append(replace(each, channels={**each.channels, "position": position}))
    return replace(campaign, recordings=tuple(recordings))


def coarse_converter(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """Steps of 8 to 30 N in the force, or of 4 to 12 m/s^2 in the acceleration."""
    channel, low, high = [("force", 8.0, 30.0), ("acceleration", 4.0, 12.0)][int(rng.integers(2))]
    step = float(rng.uniform(low, high))
    return everywhere(campaign, lambda name, x: step * np.round(x / step) if name == channel else x)


def dead_band(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """A force below 8 to 25 N reads 0."""
    band = float(rng.uniform(8.0, 25.0))
    return everywhere(campaign, lambda name, x: np.where(abs(x) < band, 0.0, x) if name == "force" else x)


def in_one_channel(campaign: Campaign, rng: np.random.Generator, spoil: Callable[[np.ndarray], None]) -> Campaign:
    """The campaign with the force or the acceleration of one recording spoilt, in place on a copy of its samples."""
    i = one_of(campaign, rng)
    channel = str(rng.choice(["force", "acceleration"]))

    def change(name: str, samples: np.ndarray) -> np.ndarray:
        samples = samples.copy()
        if name == channel:
            spoil(samples)
        return samples

    return with_recording(campaign, i, in_channels(campaign.recordings[i], change))


def missing_numbers(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """Ten samples of one channel of one recording are no numbers."""

    def spoil(samples: np.ndarray) -> None:
        begin = int(rng.integers(samples.size // 4, 3 * samples.size // 4))
        samples[begin : begin + 10] = np.nan

    return in_one_channel(campaign, rng, spoil)


def glitches(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """Single samples of one recording's force or acceleration, far off, as of a loose plug."""

    def spoil(samples: np.ndarray) -> None:
        places = rng.choice(samples.size, int(rng.integers(1, 5)), replace=False)
        samples[places] = 5.0 * np.abs(samples).max() * rng.choice([-1.0, 1.0], places.size)

    return in_one_channel(campaign, rng, spoil)


def clipped(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """An amplifier's range too small for the two recordings with the largest accelerations."""
    peaks = [np.abs(each.channels["acceleration"].samples).max() for each in campaign.recordings]
    ceiling = float(sorted(peaks)[-3]) * float(rng.uniform(1.0, 1.02))
    return everywhere(campaign, lambda name, x: np.clip(x, -ceiling, ceiling) if name == "acceleration" else x)


def not_running(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """One recording begun with the shaker off."""
    i = one_of(campaign, rng, "running")
    still = {"excitation": 2e-3, "force": 5.0, "acceleration": 2.0}
    recording = in_channels(
        campaign.recordings[i], lambda name, x: still[name] * rng.standard_normal(x.size) if name in still else x
    )
    return with_recording(campaign, i, recording)


def short(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """One recording stopped after 15 to 40 ms."""
    i = one_of(campaign, rng, "running")
    size = round(float(rng.uniform(0.015, 0.04)) * campaign.recordings[i].sample_rate)
    return with_recording(campaign, i, in_channels(campaign.recordings[i], lambda _name, x: x[:size]))


def few(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """Two to four recordings, of a rig that was running."""
    kept = [each for each in campaign.recordings if each.starts == "running"][: int(rng.integers(2, 5))]
    return replace(campaign, recordings=tuple(kept))


def off_balance(channel: str, factor: float) -> Callable[[Campaign, np.random.Generator], Campaign]:
    """A channel with another sign or unit than stated, in every recording."""

    def change(campaign: Campaign, _rng: np.random.Generator) -> Campaign:
        return everywhere(campaign, lambda name, x: factor * x if name == channel else x)

    return change


def wrong_clock(campaign: Campaign, rng: np.random.Generator) -> Campaign:
    """Every recording's stated sample rate is off by 0.5 to 2 %."""
    factor = 1.0 + float(rng.uniform(0.005, 0.02)) * float(rng.choice([-1.0, 1.0]))
    recordings = (replace(each, sample_rate=round(each.sample_rate * factor, 1)) for each in campaign.recordings)
    return replace(campaign, recordings=tuple(recordings))


FAULTS = {
    "pressure of one": Fault(wrong_setting("pressure", 0.1, 0.4)),
    "amplitude of one": Fault(wrong_setting("amplitude", 0.1, 0.4)),
    "frequency of one": Fault(wrong_setting("frequency", 0.02, 0.1)),
    "fresh that ran": Fault(fresh_that_ran),
    "lost samples": Fault(lost_samples),
    "pre-trigger": Fault(pre_trigger),
    "dead channel": Fault(dead_channel),
    "coarse converter": Fault(coarse_converter),
    "dead band": Fault(dead_band),
    "missing numbers": Fault(missing_numbers),
    "glitches": Fault(glitches),
    "clipped": Fault(clipped),
    "not running": Fault(not_running),
    "short": Fault(short),
    "few": Fault(few),
    "acceleration reversed": Fault(off_balance("acceleration", -1.0), lab_mends=True),
    "force in kN": Fault(off_balance("force", 1e-3), lab_mends=True),
    "acceleration in g": Fault(off_balance("acceleration", 1.0 / 9.80665), lab_mends=True),
    "wrong clock": Fault(wrong_clock, lab_mends=True),
}

# --- Files


def as_written_by_labs(folder: Path, rng: np.random.Generator) -> str:
    """The csv files of a folder written again as an instrument's software does; says how."""
    comma, units = bool(rng.random() < 0.5), bool(rng.random() < 0.5)
    encoding = str(rng.choice(["utf-8", "utf-8-sig", "latin-1", "utf-16"]))
    document = json.loads((folder / "campaign.json").read_text(encoding="utf-8"))
    for entry in document["recordings"]:
        path = folder / entry["file"]
        rows = list(csv.reader(path.read_text(encoding="utf-8").splitlines()))
        names, values = ["t [s]", *rows[0]], rows[1:]
        values = [[f"{i / entry['sample_rate']:.8f}", *row] for i, row in enumerate(values)]
        delimiter = ";" if comma else str(rng.choice([",", "\t"]))
        lines = ["Prüfstand 3; Schlagbohren" if comma else "Test rig 3", ""] if rng.random() < 0.5 else []
        lines.append(delimiter.join(names))
        if units:
            lines.append(delimiter.join(["s", *(entry["channels"][name]["unit"] for name in rows[0])]))
        lines += [delimiter.join(row).replace(".", ",") if comma else delimiter.join(row) for row in values]
        path.write_bytes(("\r\n".join(lines) + "\r\n" * int(rng.integers(1, 4))).encode(encoding))
    return f"csv, {'decimal comma, ' if comma else ''}{'line of units, ' if units else ''}{encoding}"


# --- A campaign


@dataclass(frozen=True)
class Drawn:
    """A campaign with its faults."""

    mechanisms: tuple[str, ...]
    faults: tuple[str, ...]
    campaign: Campaign
    sound: Campaign
    """Without the faults."""


def draw(seed: int, index: int, cards: Sequence[tuple[str, int]]) -> Drawn:
    """Campaign ``index`` of a run: what it conceals, and what is wrong with it."""
    rng = np.random.default_rng((seed, 2, index))
    concealed = [] if rng.random() < NOTHING_MISSING else [cards[index % len(cards)]]
    made = make_campaign(seed, index, Planned("library-equation" if concealed else "null", concealed))
    count = 1 + int(rng.choice(3, p=SHARES))
    # each fault comes first as often as any other; those that only the lab can mend stand alone
    names = list(FAULTS)
    first = names[index % len(names)]
    others = [name for name in names if not FAULTS[name].lab_mends and name != first]
    more = [] if FAULTS[first].lab_mends else [str(each) for each in rng.choice(others, count - 1, replace=False)]
    campaign = made.campaign
    chosen = sorted((first, *more), key=names.index)
    for name in chosen:
        campaign = FAULTS[name].change(campaign, rng)
    mechanisms = tuple(str(each["mechanism"]) for each in made.answer["mechanisms"])
    return Drawn(mechanisms, tuple(chosen), campaign, made.campaign)


def write(campaign: Campaign, folder: Path, rng: np.random.Generator) -> str:
    """Write the folder; says in which format."""
    file_format = str(rng.choice(["csv", "csv", *FILE_FORMATS]))
    write_campaign(folder, campaign.title, campaign.rig, campaign.nominal, campaign.recordings, file_format)
    return as_written_by_labs(folder, rng) if file_format == "csv" else file_format


def run(folder: Path, out: Path) -> dict[str, Any]:
    """Have ``drillenv diagnose`` look at a folder: exit code, what it wrote, seconds of time and of the processor."""
    begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "drillenv.cli", "diagnose", str(folder), "--out", str(out)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
        code, said = done.returncode, done.stderr.strip()
    except subprocess.TimeoutExpired:
        code, said = -1, f"stopped after {LIMIT:g} s"
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    path = out / "report.json"
    return {
        "code": code,
        "said": said[-2000:],
        "seconds": time.perf_counter() - begin,
        "processor": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "report": json.loads(path.read_text(encoding="utf-8")) if path.exists() else None,
    }


def judged(drawn: Drawn, ran: dict[str, Any]) -> str:
    """In a word: right, refused, wrong, traceback, or too long."""
    if "Traceback" in ran["said"] or ran["code"] == -1:
        return "traceback" if ran["code"] != -1 else "too long"
    report = ran["report"]
    if report is None:
        last = ran["said"].splitlines()[-1:] or [""]
        allowed = any(FAULTS[name].lab_mends for name in drawn.faults) or "few" in drawn.faults
        return "refused" if allowed and last[0].startswith("drillenv") else "wrong"
    if not drawn.mechanisms:
        return "right" if report["verdict"] in ("agrees", "parameters") else "wrong"
    findings = report["findings"]
    members = [{each["mechanism"], *each.get("equivalents", ())} for each in findings]
    hit = len(findings) == 1 and set(drawn.mechanisms) <= members[0] and len(members[0]) <= 3
    return "right" if report["verdict"] == "missing-physics" and hit else "wrong"


def row_of(seed: int, index: int, cards: Sequence[tuple[str, int]], out: Path) -> dict[str, Any]:
    """Draw, write, diagnose and judge one campaign."""
    drawn = draw(seed, index, cards)
    folder = out / f"{index:03d}"
    folder.mkdir(parents=True, exist_ok=True)
    written = write(drawn.campaign, folder / "campaign", np.random.default_rng((seed, 3, index)))
    ran = run(folder / "campaign", folder / "report")
    word = judged(drawn, ran)
    if word == "wrong":
        write(drawn.sound, folder / "sound", np.random.default_rng((seed, 3, index)))
        word = "spoilt" if judged(drawn, run(folder / "sound", folder / "report-sound")) == "right" else "missed"
    report = ran.pop("report") or {}
    return {
        "index": index,
        "mechanisms": drawn.mechanisms,
        "faults": drawn.faults,
        "files": written,
        "judged": word,
        "verdict": report.get("verdict"),
        "findings": [each["mechanism"] for each in report.get("findings", [])],
        "bookkeeping": report.get("bookkeeping"),
        **ran,
    }


def main() -> None:
    """Make the folders, diagnose them, and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--campaigns", type=int, default=40)
    parser.add_argument("--out", type=Path, required=True, help="folder for campaigns and reports")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    given = parser.parse_args()
    cards = [each.cards[0] for each in plan(given.seed, 60) if each.group == "library-equation"]
    cards += [each.cards[0] for each in plan(given.seed + 1, 60) if each.group == "library-equation"]
    rows = []
    for index in range(given.campaigns):
        path = given.out / f"{index:03d}" / "row.json"
        if not path.exists():
            row = row_of(given.seed, index, cards, given.out)
            with whole(path) as part:
                part.write_text(json.dumps(row, indent=1) + "\n", encoding="utf-8")
        row = json.loads(path.read_text(encoding="utf-8"))
        rows.append(row)
        print(
            f"{index:3d} {row['judged']:9s} {row['processor']:5.0f} s  {', '.join(row['faults'])}: "
            f"{', '.join(row['mechanisms']) or 'nothing'} -> {row['verdict']} {', '.join(row['findings'])}",
            flush=True,
        )
    counts = {word: sum(row["judged"] == word for row in rows) for word in sorted({row["judged"] for row in rows})}
    over = sum(row["processor"] > 60.0 for row in rows)
    print(counts, f"median {np.median([row['processor'] for row in rows]):.0f} s, {over} over a minute")
    if given.json is not None:
        kept = {"seed": given.seed, "counts": counts, "rows": rows}
        with whole(given.json) as part:
            part.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
