"""Force, acceleration and excitation of the drilling rig against each other: signs, units, and values that stick.

The acceleration is split by least squares into what the measured rock force makes of it, through the structure, and
what runs at the excitation's frequency. The first is 1 on a sound recording, the second what Eq. 3.5 makes of it; and
the mean rock force is the static force of Eq. 3.6.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.recordings.document import Nominal
from drillenv.recordings.excitation import TONE, tone_share
from drillenv.recordings.findings import (
    EXCLUDE_CHANNEL,
    EXCLUDE_RECORDING,
    QualityFinding,
    here_and_there,
    how_often,
    off_by_a_unit,
    severity_of,
    throughout,
)
from drillenv.recordings.signal_faults import runs_of_equals
from drillenv.recordings.structure import acceleration_from, response_at, settling_time
from drillenv.recordings.units import SLIP_MARGIN, SLIPS
from drillenv.rig import Rig, Setting

if TYPE_CHECKING:
    from drillenv.recordings.campaign import Recording

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

BLOCK_PERIODS, MOST_BLOCKS = 4, 8
"""A recording is judged in blocks, so that a fault that comes or goes is placed in time."""
LONGEST_LAG = 2e-3
"""s by which force and acceleration may be out of step before they count as unrelated."""
RELATED, FOLLOWS = 0.3, 0.5
"""Correlation of the acceleration with what the force explains of it, on the whole and for a block to be judged: 0.9
and more on sound recordings."""
LEAST_HARMONICS = 0.6
"""Of the acceleration, before the two may be called unrelated. A rig that never leaves the rock moves at the frequency
of its excitation alone, and then what the force and what the drive explain cannot be told apart."""
SHORT_LAG = 1.5e-4
"""s, an eighth of a usual impact."""
ONE_SIDED = 2.0
"""Times as far to one side of its median as to the other: a rock force has a side."""
LEAST_HELD = 8
"""Equal samples in a row that are held against the other channel."""


class _Block(NamedTuple):
    """What one stretch of a recording says. Signs are 0, and factors NaN, where it cannot tell."""

    start: int
    stop: int
    force_sign: int
    acceleration_sign: int
    excitation_sign: int
    force_factor: float
    """log of how many times too large the force reads."""
    acceleration_factor: float


class Balance:
    """The balances of one recording, judged block by block."""

    force: Floats
    acceleration: Floats
    by_force: Floats
    by_drive: complex
    excitation: Floats | None
    on_tone: Mask
    first: int
    last: int
    blocks: list[slice]

    def __init__(
        self,
        recording: Recording,
        setting: Setting,
        nominal: Mapping[str, Nominal],
        filled: Mapping[str, Floats],
        bad: Mapping[str, Mask],
        frequency: float,
    ) -> None:
        self.recording = recording
        rate = recording.sample_rate
        gains = {name: nominal[name].value or 1.0 for name in ("drive_gain", "pressure_gain")}
        rig = Rig(**gains)
        self.static_force: float = rig.static_force(setting)
        self.force, self.acceleration = filled["force"], filled["acceleration"]
        self.sound: np.ndarray = ~(bad["force"] | bad["acceleration"])
        # The mean force is held by the static one and moves nothing; left in, it would shake the filter at its start.
        self.by_force = acceleration_from(float(self.force.mean()) - self.force, rate, nominal)
        angle = 2 * math.pi * frequency / rate * np.arange(recording.size)
        self.tone: np.ndarray = np.column_stack((np.sin(angle), np.cos(angle), np.ones(angle.size)))
        self.by_drive = rig.drive_force(setting) * response_at(frequency, nominal)
        self.excitation, self.on_tone = None, ~bad.get("excitation", np.zeros(recording.size, dtype=bool))
        if "excitation" in filled and tone_share(filled["excitation"], rate, frequency) > TONE:
            self.excitation = filled["excitation"]
        self.first = min(math.ceil(settling_time(nominal) * rate), recording.size // 3)
        self.last = recording.size
        self.blocks = self._blocks(rate / frequency)
        lag = self._best_lag(rate)
        self.by_force = np.roll(self.by_force, lag)
        self.first, self.last = self.first + abs(lag), self.last - abs(lag)
        self.blocks = self._blocks(rate / frequency)

    def findings(self) -> list[QualityFinding]:
        """Everything the balances show."""
        if not self.blocks:
            return []
        if self._harmonics() > LEAST_HARMONICS and self._typical_correlation() < RELATED:
            text = (
                "the acceleration does not follow the measured force, not even shifted by 2 ms: see that both were "
                "connected and belong to this recording"
            )
            return [throughout(self.recording, "force, acceleration", "unrelated", text, EXCLUDE_RECORDING)]
        judged = [self._judged(block) for block in self.blocks]
        found = []
        for channel, signs in (
            ("force", [block.force_sign for block in judged]),
            ("acceleration", [block.acceleration_sign for block in judged]),
            ("excitation", [block.excitation_sign for block in judged]),
        ):
            found += self._sign(channel, judged, signs)
        for channel, factors in (
            ("force", [block.force_factor for block in judged]),
            ("acceleration", [block.acceleration_factor for block in judged]),
        ):
            found += self._unit(channel, judged, factors)
        return found or self._held()

    def _best_lag(self, rate: float) -> int:
        """Samples by which the acceleration comes after what the force explains of it."""
        from scipy.signal import correlate

        most = max(1, round(LONGEST_LAG * rate))
        near = np.zeros(2 * most + 1)
        for block in self.blocks:  # each by itself, for a sign may turn on the way
            cause, effect = (self._without_tone(series, block) for series in (self.by_force, self.acceleration))
            if cause.size > 2 * most:
                products = correlate(effect, cause, mode="full", method="fft")
                near += np.abs(products[cause.size - 1 - most : cause.size + most])
        return int(np.argmax(near)) - most if near.any() else 0

    def _without_tone(self, series: Floats, part: slice) -> Floats:
        """The sound samples of a part less their mean and what runs at the excitation's frequency."""
        weight = self.sound[part]
        columns = self.tone[part] * weight[:, None]
        fit, *_ = np.linalg.lstsq(columns, series[part] * weight, rcond=None)
        return series[part] * weight - columns @ fit

    def _typical_correlation(self) -> float:
        return float(np.median([self._correlation(block) for block in self.blocks]))

    def _harmonics(self) -> float:
        """The share of the acceleration, measured or explained by the force, that is neither tone nor noise.

        Noise has forgotten itself after a fraction of an impact, which the covariance over that lag uses.
        """
        part = slice(self.first, self.last)
        lag = max(1, round(SHORT_LAG * self.recording.sample_rate))
        spread = float(np.var(self.acceleration[part]))
        left = [self._without_tone(series, part) for series in (self.by_force, self.acceleration)]
        most = max(float(np.mean(one[lag:] * one[:-lag])) for one in left)
        return math.sqrt(max(most, 0.0) / spread) if spread > 0.0 else 0.0

    def _correlation(self, part: slice) -> float:
        cause, effect = (self._without_tone(series, part) for series in (self.by_force, self.acceleration))
        scale = math.sqrt(float(cause @ cause) * float(effect @ effect))
        return abs(float(cause @ effect)) / scale if scale > 0.0 else 0.0

    def _blocks(self, period: float) -> list[slice]:
        count = int((self.last - self.first) / (BLOCK_PERIODS * period))
        count = max(1, min(MOST_BLOCKS, count))
        edges = np.linspace(self.first, self.last, count + 1).astype(int)
        parts = [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]
        return [part for part in parts if np.count_nonzero(self.sound[part]) > 0.5 * (part.stop - part.start) > period]

    def _judged(self, part: slice) -> _Block:
        sound = self.sound[part]
        force, acceleration = self.force[part][sound], self.acceleration[part][sound]
        columns = np.column_stack((self.by_force[part], self.tone[part]))[sound]
        (by_force, sine, cosine, _), *_ = np.linalg.lstsq(columns, acceleration, rcond=None)
        by_drive = complex(sine, cosine) / (self.by_drive * self._phase(part))
        force_sign = _side(force)
        follows = self._correlation(part) > FOLLOWS
        acceleration_sign = int(np.sign(by_force)) * (force_sign or 1) if follows else 0
        drive_sign = 0
        if follows and self._knows_phase(part) and abs(by_drive.real) > 0.5 * abs(by_drive):
            drive_sign = int(np.sign(by_drive.real)) * acceleration_sign
        force_factor, acceleration_factor = math.nan, math.nan
        mean = abs(float(force.mean())) / self.static_force
        if follows and min(mean, abs(by_force), abs(by_drive)) > 0.0:
            force_factor, acceleration_factor = _factors(
                math.log(mean), math.log(abs(by_force)), math.log(abs(by_drive))
            )
        return _Block(
            part.start, part.stop, force_sign, acceleration_sign, drive_sign, force_factor, acceleration_factor
        )

    def _knows_phase(self, part: slice) -> bool:
        return self.excitation is not None and bool(self.on_tone[part].mean() > 0.9)

    def _phase(self, part: slice) -> complex:
        """exp(i phase) of the excitation in a part; 1 where it is not known."""
        if self.excitation is None:
            return 1.0 + 0.0j
        (sine, cosine, _), *_ = np.linalg.lstsq(self.tone[part], self.excitation[part], rcond=None)
        size = math.hypot(sine, cosine)
        return complex(sine, cosine) / size if size > 0.0 else 1.0 + 0.0j

    def _where(self, judged: Sequence[_Block], wrong: Sequence[bool]) -> list[tuple[int, int]]:
        """The stretches of samples that the wrong blocks make; the first and the last reach to the ends."""
        found: list[tuple[int, int]] = []
        for block, is_wrong in zip(judged, wrong, strict=True):
            start = 0 if block is judged[0] else block.start
            stop = self.recording.size if block is judged[-1] else block.stop
            if not is_wrong:
                continue
            if found and found[-1][1] == start:
                found[-1] = (found[-1][0], stop)
            else:
                found.append((start, stop))
        return found

    def _sign(self, channel: str, judged: Sequence[_Block], signs: Sequence[int]) -> list[QualityFinding]:
        if -1 not in signs:
            return []
        why = {
            "force": "a rock pushes, and this force pulls",
            "acceleration": "an impact must throw the indenter back, and here it goes on",
            "excitation": "the rig moves as if driven by its opposite",
        }[channel]
        text = f"its sign is turned round ({why}): correct it in the file"
        severity = EXCLUDE_CHANNEL if channel == "excitation" else EXCLUDE_RECORDING
        if 1 not in signs:
            return [throughout(self.recording, channel, "sign", text, severity)]
        where = self._where(judged, [sign == -1 for sign in signs])
        return [here_and_there(self.recording, channel, "sign", where, f"{text} in these stretches", severity)]

    def _unit(self, channel: str, judged: Sequence[_Block], factors: Sequence[float]) -> list[QualityFinding]:
        known = [factor for factor in factors if not math.isnan(factor)]
        why = {
            "force": "its mean against the static force, and the acceleration that it causes",
            "acceleration": "against what the measured force and the drive make of the indenter's mass",
        }[channel]
        found = []
        for slip in sorted({factor for factor in known if factor != 0.0}):
            where = [] if set(known) == {slip} else self._where(judged, [factor == slip for factor in factors])
            unit = self.recording.channels[channel].unit
            found.append(off_by_a_unit(self.recording, channel, unit, slip, why, where, EXCLUDE_RECORDING))
        return found

    def _held(self) -> list[QualityFinding]:
        """A value that stays while the other channel shows that it cannot have."""
        part = slice(self.first, self.last)
        sound = self.sound[part]
        columns = np.column_stack((self.by_force, self.tone))[part]
        fit, *_ = np.linalg.lstsq(columns[sound], self.acceleration[part][sound], rcond=None)
        left = np.zeros(self.recording.size)
        left[part] = self.acceleration[part] - columns @ fit
        # Faulty runs must not set the measure themselves: it is that of the better half of the samples.
        size = np.sort(np.abs(left[part][sound]))
        quiet = math.sqrt(float(np.mean(size[: max(1, size.size // 2)] ** 2)))
        least = max(0.3 * float(np.std(self.acceleration[part][sound])), 4.0 * quiet)
        found = []
        for channel, samples in (("force", self.force), ("acceleration", self.acceleration)):
            where = [
                (run.start, run.stop)
                for run in runs_of_equals(samples, LEAST_HELD)
                if self.sound[run.start : run.stop].all()
                and math.sqrt(float(np.mean(left[run.start : run.stop] ** 2))) > least
            ]
            if where:
                text = (
                    f"it stays at one value {how_often(where)} while the other channel shows that it moved: leave "
                    "these stretches out"
                )
                severity = severity_of(self.recording, where, True)
                found.append(here_and_there(self.recording, channel, "dropout", where, text, severity))
        return found


def _side(force: Floats) -> int:
    """1 for a force that pushes, -1 for one that pulls, 0 where it cannot be told."""
    mean, spread = float(force.mean()), float(force.std())
    if abs(mean) > spread:  # always in contact
        return int(np.sign(mean))
    low, middle, high = np.quantile(force, (0.005, 0.5, 0.995))
    if high - middle > ONE_SIDED * (middle - low):
        return 1
    if middle - low > ONE_SIDED * (high - middle):
        return -1
    return int(np.sign(mean)) if abs(mean) > 0.5 * spread else 0


def _factors(mean: float, by_force: float, by_drive: float) -> tuple[float, float]:
    """Logarithms of how many times too large force and acceleration read, from three balances; NaN if they disagree.

    ``mean`` is that of the force over the static force, ``by_force`` the acceleration over what the force explains, and
    ``by_drive`` that over what the drive explains, all as logarithms.
    """
    best, least = (math.nan, math.nan), math.inf
    for force in SLIPS:
        for acceleration in SLIPS:
            misses = (mean - force, by_force - (acceleration - force), by_drive - acceleration)
            if max(map(abs, misses)) < SLIP_MARGIN and math.hypot(*misses) < least:
                best, least = (force, acceleration), math.hypot(*misses)
    return best
