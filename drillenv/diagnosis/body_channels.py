"""One body: its recordings made comparable. Every channel through one filter, its derivatives, and what they are worth.

A force balance is a sum of terms, and a linear filter keeps a sum: force, acceleration, speed, position and every term
computed of them go through the same low-pass and are thinned alike, so the balance that holds between the true channels
holds between the filtered ones. The filter ends where differentiating would make more noise than signal.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.fft import dct
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import butter, convolve, sosfiltfilt
from scipy.stats import chi2

from drillenv.checks import InputError
from drillenv.diagnosis.condition import white_noise
from drillenv.recordings import Campaign, QualityFinding, Recording

ORDERS = {"position": 0, "velocity": 1, "acceleration": 2}
STENCILS = {
    0: np.array([0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]),
    1: np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]),
    2: np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]),
}
"""Central differences of eighth order, from four samples before to four after (B. Fornberg, Math. Comp. 51 (1988))."""
EDGE = 4
"""Samples lost to them at either end."""
WHOLE = 0.995
"""Share of the power of the motion that the filter passes."""
CLEAN = 0.01
"""Noise over signal of the acceleration up to which the band may be widened."""
FAIR = 0.05
"""The same, up to which the band may hold all of the motion: noise in what a law is fitted to makes it look weaker."""
WIDEST = 0.16
"""Of the sample rate: above it differences are no derivatives."""
SAMPLED = 2.5
"""Rows a second that are kept, over the edge of the filter."""
SURE = 4.0
"""Standard deviations of the speed's noise from which its sign is known."""
CREEP = 0.01
"""Of the root mean square speed, below which a body that may stick is left out."""
TURNING = 0.1
"""Share of the time between two turns of the motion, at most, that is left out on either side of each."""
TIED = 0.95
"""Correlation of a measured acceleration with the second derivative of the position from which both are the body's."""
MANY_ROWS, LEAST_ROWS = 200, 30
"""Of a recording: rows closer together than the filter asks for where they would be fewer, and what it must have."""
MOST_ROWS = 60_000
"""Of a campaign, to bound memory: they say as much as there is to say of a dozen constants."""
FALSE = 1e-3
"""Chance that anything of a recording's noise is taken for motion."""
WIDER = 8.0
"""By how much the band may be wider than the motion."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One recording of one body. Rows are filtered and thinned, (n,); what is called smooth has every sample."""

    name: str
    held: bool
    rate: float
    """Samples a second, as recorded."""
    edge: float
    """Hz, where the filter ends."""
    every: int
    """Samples a row."""
    force: np.ndarray | None
    """(n,) N."""
    acceleration: np.ndarray
    velocity: np.ndarray
    position: np.ndarray
    keep: np.ndarray
    """(n,) whether a row is used."""
    smooth_force: np.ndarray | None
    """(samples,) as recorded, of the applied force: what saturates saturates before it is filtered."""
    smooth_acceleration: np.ndarray
    """The same of the acceleration."""
    smooth_velocity: np.ndarray
    smooth_position: np.ndarray
    lag_force: np.ndarray | None
    """(n,) N/s, derivative of the force."""
    lag_acceleration: np.ndarray
    """(n,) m/s^3."""
    noise: dict[str, float]
    """Standard deviation in a row of the white noise of force, acceleration, velocity and position."""
    slow: float
    """m/s, the speed below which its sign is not known."""
    columns: OrderedDict[int, tuple[Any, np.ndarray]] = field(init=False, default_factory=OrderedDict)
    """Forces (m, n) of the latest terms that were asked for, by identity; see ``body.columns_of``."""

    def rows(self, samples: np.ndarray) -> np.ndarray:
        """What became of each channel, done to a term computed from smooth ones: (samples,) to (n,)."""
        return low_pass(samples, self.rate, self.edge)[:: self.every]

    @property
    def every_time(self) -> np.ndarray:
        """(samples,) s from the first sample."""
        return (EDGE + np.arange(self.smooth_velocity.size)) / self.rate

    @property
    def time(self) -> np.ndarray:
        """(n,) s from the first sample."""
        return (EDGE + self.every * np.arange(self.velocity.size)) / self.rate


def low_pass(samples: np.ndarray, rate: float, edge: float) -> np.ndarray:
    """Without lag: forward and back through a Butterworth filter of fourth order."""
    sections = _sections(rate, edge)
    # mirrored at its ends: turned about its last sample, as is usual, it would repeat the noise of that one sample
    reach = min(samples.size - 1, int(3 * rate / edge))
    return np.asarray(sosfiltfilt(sections, samples, padtype="even", padlen=reach))


def smoothed(samples: np.ndarray, rate: float, edge: float) -> np.ndarray:
    """The same for what bends with the motion: its slope goes on at either end, or squares and cubes would go wrong."""
    reach = min(samples.size - 1, int(3 * rate / edge))
    few = min(samples.size, max(8, int(0.5 * rate / edge)))
    # turned about a fitted end: about the last sample itself, its noise would be repeated
    ends = [float(np.polynomial.Polynomial.fit(np.arange(few), end[:few], 2)(0)) for end in (samples, samples[::-1])]
    whole = np.concatenate([2 * ends[0] - samples[reach:0:-1], samples, 2 * ends[1] - samples[-2 : -reach - 2 : -1]])
    return np.asarray(sosfiltfilt(_sections(rate, edge), whole, padlen=0))[reach : reach + samples.size]


@lru_cache(maxsize=64)
def _sections(rate: float, edge: float) -> np.ndarray:
    """Designed once, applied thousands of times."""
    return np.asarray(butter(4, edge, fs=rate, output="sos"))


def derivative(samples: np.ndarray, rate: float, order: int) -> np.ndarray:
    """(n,) to (n - 2 EDGE,), ``order`` times differentiated."""
    return np.asarray(convolve(samples, STENCILS[order][::-1], mode="valid")) * rate**order


def prepare(campaign: Campaign, faults: Sequence[QualityFinding] = ()) -> tuple[list[Body], list[str]]:
    """Make the recordings of a campaign comparable.

    Args:
        campaign: Of one body.
        faults: The stretches that these leave out are not used.

    Returns:
        The recordings, and sentences about the channels for the report.

    Raises:
        InputError: no recording has a position and a force or acceleration, or too few samples.
    """
    side = "force" if any("force" in each.channels for each in campaign.recordings) else "acceleration"
    forced = side == "force"
    cleaned, remarks = [], []
    for recording in campaign.recordings:
        why = _unusable(recording, side, faults)
        if why:
            remarks.append(f"{recording.name} is left out: {why}.")
        else:
            cleaned.append((recording, *_clean(recording, faults)))
    if not cleaned:
        raise InputError(f"campaign {campaign.title}: no recording can be used ({remarks[0]}): record it again")
    noises = [{name: white_noise(samples) for name, samples in channels.items()} for _each, channels, _bad in cleaned]
    used = [
        (channels, noise, recording.sample_rate)
        for (recording, channels, _bad), noise in zip(cleaned, noises, strict=True)
        if recording.use != "held-out"
    ]
    if not used:
        raise InputError(f"campaign {campaign.title}: every recording is held out: leave some to be fitted")
    edge = _edge(used, forced)
    tied = forced and all(
        _tied(channels, recording.sample_rate, edge)
        for recording, channels, _bad in cleaned
        if "acceleration" in channels
    )
    spacing = _spacing([recording for recording, _channels, _bad in cleaned], edge)
    bodies = [
        _body(recording, channels, bad, noise, edge, forced, tied, spacing)
        for (recording, channels, bad), noise in zip(cleaned, noises, strict=True)
    ]
    remarks += [
        f"{body.name} is left out: it hardly moves, {int(body.keep.sum())} rows remain."
        for body in bodies
        if int(body.keep.sum()) < LEAST_ROWS
    ]
    bodies = [body for body in bodies if int(body.keep.sum()) >= LEAST_ROWS]
    if all(body.held for body in bodies):
        raise InputError(f"campaign {campaign.title}: no recording moves for long enough to be fitted: record longer")
    remarks += [f"Every channel is compared below {edge:.3g} Hz."]
    if not forced:
        remarks.append("No force is measured: the measured acceleration is held against the law.")
    return bodies, remarks


def _unusable(recording: Recording, side: str, faults: Sequence[QualityFinding]) -> str:
    """Why a recording says nothing of the balance, or nothing."""
    for each in faults:
        if each.recording == recording.name and (
            each.severity == "exclude recording"
            or (each.severity == "exclude channel" and each.channel in ("position", side))
        ):
            return each.sentence
    missing = [name for name in ("position", side) if name not in recording.channels]
    return f"it has no {' and no '.join(missing)}" if missing else ""


def _clean(recording: Recording, faults: Sequence[QualityFinding]) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The channels, straight lines over what is bad, and which samples those are."""
    names = [name for name in ("force", *ORDERS) if name in recording.channels]
    dropped = {e.channel for e in faults if e.recording == recording.name and e.severity == "exclude channel"}
    names = [name for name in names if name not in dropped]
    bad = np.zeros(recording.size, dtype=bool)
    channels = {}
    for name in names:
        samples = recording.channels[name].samples
        wrong = ~np.isfinite(samples)
        for each in faults:
            if each.recording == recording.name and each.channel == name and each.severity == "exclude stretch":
                for start, stop in each.spans or ((each.start, each.stop),):
                    first, last = int(start * recording.sample_rate), math.ceil(stop * recording.sample_rate)
                    wrong[max(first - 1, 0) : last + 1] = True
        good = np.flatnonzero(~wrong)
        if good.size < max(100, 0.5 * samples.size):
            raise InputError(f"{recording.name}: {good.size} samples of {name} can be used: record more")
        channels[name] = np.interp(np.arange(samples.size), good, samples[good])
        bad |= wrong
    return channels, bad


def _noise_below(edge: float, sigma: float, order: int, rate: float) -> float:
    """Standard deviation, below ``edge`` Hz, of white noise differentiated ``order`` times."""
    power = 2 * order + 1
    return sigma * math.sqrt(2.0 / rate * (2 * math.pi) ** (2 * order) * edge**power / power)


def _best_source(channels, noise: dict[str, float], rate: float, wanted: str, edge: float) -> tuple[str, float]:
    """The channel that gives another with the least noise, and that noise."""
    found = [
        (_noise_below(edge, noise[name], ORDERS[wanted] - order, rate), name)
        for name, order in ORDERS.items()
        if name in channels and order <= ORDERS[wanted]
    ]
    least, name = min(found)
    return name, least


def _edge(recordings: Sequence[tuple[dict[str, np.ndarray], dict[str, float], float]], forced: bool) -> float:
    """Hz up to which the motion says something: of (channels, noise, samples a second) of each recording to be fitted.

    With a measured force: all that moves, and as far beyond as differentiating costs next to nothing. Without one, only
    what the law's own arguments, position and speed, hold can be explained by it.
    """
    wanted = "acceleration" if forced else "velocity"
    slowest = min(rate for _channels, _noise, rate in recordings)
    grid = np.geomspace(1e-4 * slowest, WIDEST * slowest, 400)
    below, seconds = np.zeros(grid.size), 0.0
    lowest = 0.0
    for channels, noise, rate in recordings:
        source, _ = _best_source(channels, noise, rate, wanted, 0.02 * rate)
        order = ORDERS[wanted] - ORDERS[source]
        signal = derivative(channels[source], rate, order)
        # cosines continue a signal without a jump at its ends, as it may well be a single stroke; the mean says nothing
        power = np.asarray(dct(signal, norm="ortho")) ** 2
        power[0] = 0.0
        frequencies = 0.5 * rate / signal.size * np.arange(signal.size)
        floor = noise[source] ** 2 * (2 * math.pi * frequencies) ** (2 * order)
        useful = np.cumsum(np.where(_before_the_noise(power, floor), power, 0.0)) / rate
        below += np.interp(grid, frequencies, useful)
        seconds += signal.size / rate
        lowest = max(lowest, 8.0 * rate / signal.size)
    if below[-1] <= 0.0:
        raise InputError("nothing moves beyond the noise of the position: record a body that moves")
    least = float(grid[int(np.searchsorted(below, WHOLE * below[-1]))])
    highest = WIDEST * slowest
    size = math.sqrt(below[-1] / seconds)

    def within(share: float) -> float:
        """The widest band whose noise is below this share of the motion."""
        fair = (
            all(
                _best_source(channels, noise, rate, wanted, edge)[1] < share * size
                for channels, noise, rate in recordings
            )
            for edge in grid
        )
        return float(max(grid[list(fair)], default=0.0))

    best = min(least, within(FAIR))
    if forced:
        best = max(best, min(within(CLEAN), WIDER * least))
    return float(np.clip(best, min(lowest, highest), highest))


def _before_the_noise(power: np.ndarray, floor: np.ndarray) -> np.ndarray:
    """Which frequencies hold signal: those before the first above which, over a factor of two, there is none.

    What stands out of white noise beyond such a gap is noise that is not white.
    """
    wide = 9
    # noise alone must not seem to stand out anywhere: one line of it far up would outweigh the motion
    above = np.convolve(power, np.ones(wide) / wide, mode="same") > chi2.isf(FALSE / power.size, wide) / wide * floor
    counts = np.concatenate([[0], np.cumsum(above)])
    first = np.arange(power.size)
    last = np.minimum(2 * first + wide, power.size)
    empty = np.flatnonzero((counts[last] - counts[first] == 0) & (first > 0))
    return above & (first < (empty[0] if empty.size else power.size))


def _tied(channels, rate: float, edge: float) -> bool:
    """Whether the measured acceleration is that of the position."""
    second = low_pass(derivative(channels["position"], rate, 2), rate, edge)
    read = low_pass(channels["acceleration"][EDGE:-EDGE], rate, edge)
    scale = float(np.std(second) * np.std(read))
    return scale > 0.0 and float(np.mean((second - second.mean()) * (read - read.mean()))) > TIED * scale


def _spacing(recordings: Sequence[Recording], edge: float) -> float:
    """s from row to row, in all recordings alike: what is left of them has one spectrum."""
    thin = math.ceil(sum(each.size for each in recordings) / MOST_ROWS)
    return min(
        max(thin, min(int(each.sample_rate / (SAMPLED * edge)), (each.size - 2 * EDGE) // MANY_ROWS)) / each.sample_rate
        for each in recordings
    )


def _body(recording: Recording, channels, bad, noise, edge: float, forced: bool, tied: bool, spacing: float) -> Body:
    rate = recording.sample_rate
    every = max(1, round(spacing * rate))
    inner = slice(EDGE, -EDGE)

    def had(wanted: str) -> tuple[np.ndarray, str]:
        name, _ = _best_source(channels, noise, rate, wanted, edge)
        if wanted == "acceleration" and wanted in channels and not tied:
            name = wanted
        return derivative(channels[name], rate, ORDERS[wanted] - ORDERS[name]), name

    made, sizes = {}, {}
    for wanted in ORDERS:
        samples, source = had(wanted)
        made[wanted] = samples
        sizes[wanted] = noise[source] * _gain(rate, edge, ORDERS[wanted] - ORDERS[source])
    fine = _fine(made["velocity"], channels, noise, rate, edge)
    smooth_position, smooth_velocity = (smoothed(made[name], rate, fine) for name in ("position", "velocity"))
    reach = round(0.5 * rate / edge)
    unsure = SURE * _best_source(channels, noise, rate, "velocity", fine)[1]
    slow = max(unsure, CREEP * float(np.sqrt(np.mean(smooth_velocity**2))))
    creeps = np.abs(smooth_velocity) < slow
    # where a body stands, friction is whatever holds it; the filter carries that beyond the stop
    keep = ~_widened(bad, EDGE + reach)[inner] & ~_widened(_long(creeps, reach), reach)
    turns = np.flatnonzero(np.diff(creeps.astype(int)) == 1)
    between = float(np.median(np.diff(turns))) if turns.size > 1 else float(creeps.size)
    keep &= ~_widened(creeps, min(reach, round(TURNING * between)))
    if had("acceleration")[1] != "acceleration":
        # a derivative's noise cancels over the filter's length, which it cannot do at an end
        keep[: 2 * reach], keep[-2 * reach :] = False, False
    force = channels["force"] if forced else None
    if force is not None:
        sizes["force"] = noise["force"] * _gain(rate, edge, 0)
    rows = slice(None, None, every)

    def filtered(samples: np.ndarray) -> np.ndarray:
        return low_pass(samples, rate, edge)

    lag = np.gradient(filtered(made["acceleration"]), 1 / rate)
    return Body(
        name=recording.name,
        held=recording.use == "held-out",
        rate=rate,
        edge=edge,
        every=every,
        force=None if force is None else filtered(force[inner])[rows],
        acceleration=filtered(made["acceleration"])[rows],
        velocity=filtered(made["velocity"])[rows],
        position=filtered(made["position"])[rows],
        keep=keep[rows],
        smooth_force=None if force is None else force[inner],
        smooth_acceleration=made["acceleration"],
        smooth_velocity=smooth_velocity,
        smooth_position=smooth_position,
        lag_force=None if force is None else filtered(derivative(force, rate, 1))[rows],
        lag_acceleration=lag[rows],
        noise=sizes,
        slow=slow,
    )


def _fine(velocity: np.ndarray, channels, noise: dict[str, float], rate: float, edge: float) -> float:
    """Hz, the widest band in which the speed is still clean: what bends with the motion is computed there.

    A smoother speed would turn round at another moment, and friction with it.
    """
    size = float(np.std(low_pass(velocity, rate, edge)))
    grid = np.geomspace(edge, max(WIDEST * rate, edge), 40)
    clean = [each for each in grid if _best_source(channels, noise, rate, "velocity", each)[1] < CLEAN * size]
    return float(max(clean, default=edge))


def _gain(rate: float, edge: float, order: int) -> float:
    """By how much filter and derivative make white noise larger: the root of the sum of their squared response."""
    length = int(12 * rate / edge) + 4 * EDGE
    pulse = np.zeros(2 * length + 1)
    pulse[length] = 1.0
    return float(np.sqrt(np.sum(low_pass(derivative(pulse, rate, order), rate, edge) ** 2)))


def _widened(mask: np.ndarray, by: int) -> np.ndarray:
    """True also ``by`` samples before and after."""
    return np.asarray(maximum_filter1d(mask.astype(np.uint8), 2 * by + 1, mode="constant") > 0)


def _long(mask: np.ndarray, least: int) -> np.ndarray:
    """True only where a mask is true for more than ``least`` samples on end."""
    size = least + 1
    begins = minimum_filter1d(mask.astype(np.uint8), size, mode="constant", origin=-(size // 2))
    return np.asarray(maximum_filter1d(begins, size, mode="constant", origin=(size - 1) // 2) > 0)
