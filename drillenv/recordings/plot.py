"""Pictures of recordings, each beside what the nominal model says of force and acceleration at its setting."""

from __future__ import annotations

import base64
import html
import io
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import choice
from drillenv.files import whole
from drillenv.recordings.campaign import Campaign, Recording
from drillenv.recordings.document import DRILL, Nominal
from drillenv.recordings.excitation import tone_at
from drillenv.recordings.findings import NOTE, QualityFinding
from drillenv.recordings.signal_faults import ABSURD
from drillenv.recordings.units import CHANNEL_UNITS
from drillenv.rig import Rig
from drillenv.rocks import Rock

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ENDINGS = (".html", ".png")
PERIODS = 3
"""Of the excitation, shown closely."""
AROUND = 10
"""Periods before and behind, over which the phase of the excitation is fitted."""
SHARE = 0.05
"""Of the recording of one body, shown closely."""
COLUMNS = 1200
"""Of the picture of a whole recording; in each, all between the smallest and the largest sample is filled."""
RATES = (100.0, 1e6)
"""Hz, at which the model can be sampled."""
FROM_MODEL = ("excitation", "force", "acceleration")
MEASURED, MODEL = "#1f5f8b", "#d1495b"
DPI = 110

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Modelled:
    """What the nominal model says over the periods shown."""

    samples: Mapping[str, Floats]
    """(samples,) in SI, by channel."""
    motion: str
    """Its name, such as P-1-I-1."""


def plot_campaign(
    campaign: Campaign,
    path: str | os.PathLike[str],
    findings: Sequence[QualityFinding] = (),
    note: Callable[[str], object] | None = None,
) -> None:
    """Draw every recording into one file that needs nothing else: over three periods, and as a whole.

    Args:
        campaign: From :func:`drillenv.recordings.read_campaign`.
        path: Ends in .html or .png.
        findings: Of the quality check. Stretches to be left out are shaded, and a page lists them.
        note: Told what is being done.

    Raises:
        InputError: ``path`` ends otherwise, or cannot be written.
    """
    ending = choice("the ending of --out", Path(path).suffix.lower(), ENDINGS)
    pictures = []
    for recording in campaign.recordings:
        if note is not None:
            note(f"drawing {recording.name}")
        own = [each for each in findings if each.recording == recording.name]
        pictures.append((recording, _drawn(campaign, recording, own), own))
    with whole(path) as part:
        if ending == ".html":
            part.write_text(_page(campaign, [(each, _png(figure), own) for each, figure, own in pictures]), "utf-8")
        else:
            _write_stacked(part, [figure for _, figure, _ in pictures])


# --------------------------------------------------------------------------------------------------------------------
# the model


def part_shown(recording: Recording, rig: str) -> slice:
    """The samples that are shown closely: the first periods of a fresh start, or else some from the middle."""
    size, setting = recording.size, recording.setting
    wanted = SHARE * size if setting is None else PERIODS * recording.sample_rate / setting.frequency
    width = min(size, max(2, round(wanted) + 1))
    start = 0 if recording.starts == "fresh" and rig == DRILL else (size - width) // 2
    return slice(start, start + width)


def modelled(campaign: Campaign, recording: Recording, part: slice) -> Modelled | None:
    """What the nominal model says over a part of a recording, in phase with its excitation.

    None for one body, and for a sample rate beyond ``RATES``. A motion of several periods passes each phase several
    times: it is shown from where the force fits best.
    """
    setting = recording.setting
    if campaign.rig != DRILL or setting is None or not RATES[0] <= recording.sample_rate <= RATES[1]:
        return None
    from drillenv.dynamics.motion import motion
    from drillenv.dynamics.simulate import simulate

    rig, rock = believed(campaign.nominal)
    size, rate = part.stop - part.start, recording.sample_rate
    period = rate / setting.frequency
    phase = phase_at(recording, part)
    if recording.starts == "fresh":
        seconds = (part.stop + 1) / rate
        run = simulate(setting, rock, rig, seconds, rate, "fresh", phase or 0.0)
        samples = {name: getattr(run, name)[part] for name in FROM_MODEL}
        return Modelled(samples, "from rest")
    settled = motion(setting, rock, rig)
    turns = max(1, settled.period or 8)
    seconds = (size + (turns + 1) * period) / rate
    run = simulate(setting, rock, rig, seconds, rate, "steady", phase or 0.0)
    measured = recording.channels["force"].samples[part] if "force" in recording.channels else None
    lags = np.round(np.arange(turns) * period).astype(int) if phase is not None else np.arange(round(turns * period))
    at = best_lag(run.force, measured, lags, size)
    return Modelled({name: getattr(run, name)[at : at + size] for name in FROM_MODEL}, settled.label)


def believed(nominal: Mapping[str, Nominal]) -> tuple[Rig, Rock]:
    """The rig and the rock that a campaign's constants describe."""
    values = {name: float(each.value) for name, each in nominal.items() if each.value is not None}
    rock = Rock(values.pop("loading_stiffness"), values.pop("unloading_stiffness"))
    return Rig(**values), rock


def phase_at(recording: Recording, part: slice) -> float | None:
    """rad of the excitation at the first sample of a part; None where there is no excitation."""
    setting = recording.setting
    if setting is None or "excitation" not in recording.channels:
        return None
    margin = round(AROUND * recording.sample_rate / setting.frequency)
    begin = max(0, part.start - margin)
    near = recording.channels["excitation"].samples[begin : part.stop + margin]
    known = np.where(np.abs(near) < ABSURD, near, 0.0)
    tone = tone_at(known, recording.sample_rate, setting.frequency)
    turned = 2 * np.pi * setting.frequency * (part.start - begin) / recording.sample_rate
    return float((tone.phase + turned) % (2 * np.pi))


def best_lag(model: Floats, measured: Floats | None, lags: NDArray[np.int_], size: int) -> int:
    """The one of ``lags`` from which ``size`` samples of the model differ least from what was measured."""
    if measured is None:
        return int(lags[0])
    apart = [float(np.nansum((model[lag : lag + size] - measured) ** 2)) for lag in lags]
    return int(lags[int(np.argmin(apart))])


# --------------------------------------------------------------------------------------------------------------------
# the pictures


def _drawn(campaign: Campaign, recording: Recording, findings: Sequence[QualityFinding]) -> Figure:
    from matplotlib.figure import Figure

    part = part_shown(recording, campaign.rig)
    model = modelled(campaign, recording, part)
    shown = [name for name in recording.channels if name != "time"]
    figure = Figure(figsize=(12.0, 0.9 + 1.7 * len(shown)), dpi=DPI, layout="constrained")
    axes: Any = figure.subplots(len(shown), 2, squeeze=False, sharex="col", width_ratios=(3, 2))
    for (close, far), name in zip(axes, shown, strict=True):
        _draw_close(close, recording, name, part, model)
        _draw_far(far, recording, name, part, [each for each in findings if each.channel in (name, None)])
    handles, labels = axes[-1, 0].get_legend_handles_labels()
    if any(len(each.lines) > 1 for each in axes[:, 0]):
        handles, labels = next(each.get_legend_handles_labels() for each in axes[:, 0] if len(each.lines) > 1)
    figure.legend(handles, labels, loc="upper right", fontsize=9, ncols=2, frameon=False)
    figure.align_ylabels(axes[:, 0])
    axes[-1, 0].set_xlabel("time (s)")
    axes[-1, 1].set_xlabel("time (s)")
    figure.suptitle(_title(recording, model), fontsize=11, x=0.01, ha="left")
    return figure


def _title(recording: Recording, model: Modelled | None) -> str:
    title = recording.name
    if recording.setting is not None:
        setting = recording.setting
        title += f": {setting.frequency:g} Hz, {setting.amplitude:g} V, {setting.pressure:g} bar, {recording.starts}"
    if model is not None:
        title += f"; the nominal model: {model.motion}"
    return title


def _draw_close(axes: Axes, recording: Recording, name: str, part: slice, model: Modelled | None) -> None:
    channel = recording.channels[name]
    factor = CHANNEL_UNITS[name][channel.unit]
    time = recording.time[part]
    axes.plot(time, channel.samples[part] / factor, color=MEASURED, linewidth=1.1, label="measured")
    if model is not None and name in model.samples:
        samples = model.samples[name]
        axes.plot(
            time[: samples.size], samples / factor, color=MODEL, linewidth=1.0, linestyle="--", label="nominal model"
        )
    axes.set_ylabel(f"{name} ({channel.unit})", fontsize=9)
    axes.set_xlim(time[0], time[-1])
    axes.grid(alpha=0.3)


def _draw_far(axes: Axes, recording: Recording, name: str, part: slice, findings: Sequence[QualityFinding]) -> None:
    channel = recording.channels[name]
    samples = channel.samples / CHANNEL_UNITS[name][channel.unit]
    edges = np.unique(np.linspace(0, samples.size, min(COLUMNS, samples.size) + 1).astype(int))
    finite_low = np.where(np.isfinite(samples), samples, np.inf)
    finite_high = np.where(np.isfinite(samples), samples, -np.inf)
    low, high = np.minimum.reduceat(finite_low, edges[:-1]), np.maximum.reduceat(finite_high, edges[:-1])
    low, high = np.where(np.isfinite(low), low, np.nan), np.where(np.isfinite(high), high, np.nan)
    axes.fill_between(edges[:-1] / recording.sample_rate, low, high, color=MEASURED, linewidth=0.6)
    axes.axvspan(part.start / recording.sample_rate, part.stop / recording.sample_rate, color="0.5", alpha=0.35)
    for each in findings:
        if each.severity != NOTE:
            for start, stop in each.spans or ((each.start, each.stop),):
                axes.axvspan(start, max(stop, start + recording.seconds / 500), color=MODEL, alpha=0.25)
    axes.set_xlim(0.0, recording.seconds)
    axes.grid(alpha=0.3)


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def _write_stacked(path: Path, figures: Sequence[Figure]) -> None:
    """All pictures, one below the other."""
    from matplotlib.image import imsave
    from matplotlib.pyplot import imread

    arrays = [imread(io.BytesIO(_png(figure))) for figure in figures]
    imsave(path, np.concatenate(arrays), format="png")


STYLE = """body{font:15px/1.45 system-ui,sans-serif;max-width:1340px;margin:2em auto;padding:0 1em;color:#222}
img{width:100%;height:auto}h1{font-size:1.4em}h2{font-size:1.1em;margin-top:2em}li{color:#a12}p{color:#555}"""


def _page(campaign: Campaign, pictures: Sequence[tuple[Recording, bytes, Sequence[QualityFinding]]]) -> str:
    """One page with the pictures in it."""
    title = html.escape(campaign.title)
    parts = [f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>']
    parts.append(f"<h1>{title}</h1>")
    if campaign.rig == DRILL:
        parts.append(
            "<p>Left, three periods of the excitation, with what the nominal model says at the setting, in phase with "
            "the excitation; of a chaotic motion it can only show the kind. Right, the whole recording: grey is what "
            "the left shows, red what the quality check would leave out.</p>"
        )
    for recording, png, findings in pictures:
        name = html.escape(recording.name)
        parts.append(f"<h2>{name} ({html.escape(recording.file)}, {recording.sample_rate:g} Hz)</h2>")
        parts.append(
            f'<img alt="recording {name}" src="data:image/png;base64,{base64.b64encode(png).decode("ascii")}">'
        )
        if findings:
            parts.append("<ul>" + "".join(f"<li>{html.escape(str(each))}</li>" for each in findings) + "</ul>")
    return "\n".join([*parts, "</html>"]) + "\n"
