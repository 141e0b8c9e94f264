"""What a controller can know without peeking: the pressure, the lag of its cylinder, and the rock, from the readings.

Both are estimated as a bank of models. Each model predicts what the sensors should read; what they do read decides how
far each is believed.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from drillenv.controllers.chart import FREQUENCY, LOADING, RATIOS, Chart, read_chart
from drillenv.env.episodes import LAG_RANGE
from drillenv.env.observation import HIGH, LOW, READINGS
from drillenv.env.plant import INTERVAL

NAMES = tuple(reading.name for reading in READINGS)
MEAN_PEAK, LARGEST_PEAK = NAMES.index("mean_peak_force"), NAMES.index("largest_peak_force")
IMPACTS, PERIOD_TWO = NAMES.index("impacts_per_cycle"), NAMES.index("period_two")
SHARE, RATE = NAMES.index("contact_share"), NAMES.index("penetration_rate")
AT, AMPLITUDE, VALVE, GAUGE = (NAMES.index(n) for n in ("frequency", "amplitude", "valve_pressure", "pressure"))
NOISE = np.array([reading.noise for reading in READINGS])


def inside(observation: np.ndarray) -> np.ndarray:
    """The readings inside the ranges of their sensors, whatever was handed in."""
    return np.clip(np.nan_to_num(observation), LOW, HIGH)


def is_single(observation: np.ndarray) -> bool:
    """Whether the readings are those of one like blow a period."""
    return bool(abs(observation[IMPACTS] - 1.0) < 0.1 and observation[PERIOD_TWO] < 0.1)


class Cylinder:
    """The pressure in the cylinder and its lag, by a bank of lags.

    The valve is known, so each lag predicts the whole course of the pressure; the gauge says which lag is right.
    """

    LAGS = np.geomspace(0.7 * LAG_RANGE[0], 1.4 * LAG_RANGE[1], 24)
    TRUST = 0.1
    """Share of the gauge's difference that each course takes over, so that a wrong model does not drift away."""
    CAUTION = 2.0
    """Factor on the gauge's noise: the lag of a real cylinder is not quite constant."""

    def __init__(self) -> None:
        self._falls = np.exp(-INTERVAL / self.LAGS)
        self._courses: np.ndarray | None = None
        self._means = np.zeros(self.LAGS.size)
        self._logs = np.zeros(self.LAGS.size)
        self._beliefs = np.full(self.LAGS.size, 1.0 / self.LAGS.size)

    def update(self, valve: float, gauge: float) -> None:
        """Take in an interval with the valve at ``valve`` bar, after which the gauge showed ``gauge`` bar."""
        if self._courses is None:
            self._courses = np.full(self.LAGS.size, gauge)
            self._means = self._courses.copy()
            return
        ends = valve + (self._courses - valve) * self._falls
        self._means = valve + (self._courses - ends) * self.LAGS / INTERVAL
        misses = gauge - ends
        self._logs -= 0.5 * (misses / (self.CAUTION * NOISE[GAUGE])) ** 2
        self._logs -= self._logs.max()
        self._beliefs = np.exp(self._logs)
        self._beliefs /= self._beliefs.sum()
        self._courses = ends + self.TRUST * misses

    @property
    def pressure(self) -> float:
        """The present pressure in bar."""
        return float(self._beliefs @ self._courses) if self._courses is not None else 0.6

    @property
    def mean(self) -> float:
        """The mean pressure of the last interval in bar, which is what its blows answer to."""
        return float(self._beliefs @ self._means)

    @property
    def lag(self) -> float:
        """The time constant in s."""
        return float(math.exp(self._beliefs @ np.log(self.LAGS)))

    def ahead(self, valve: float) -> float:
        """The pressure in bar after another interval at a valve."""
        return valve + (self.pressure - valve) * math.exp(-INTERVAL / self.lag)

    def valve_for(self, goal: float, low: float, high: float) -> float:
        """The valve in bar that brings the pressure to ``goal`` within one interval, as far as ``low, high`` let it."""
        fall = math.exp(-INTERVAL / self.lag)
        return float(np.clip((goal - self.pressure * fall) / (1.0 - fall), low, high))


class Rocks(NamedTuple):
    """The rocks that are thought possible, n of them, and what the chart says of each."""

    loading: np.ndarray
    unloading: np.ndarray
    """(n,) in N/m."""
    compliance: np.ndarray
    """(n,) penetration that a blow leaves, in mm per kN of its peak: 1 / k_l - 1 / k_u."""
    features: np.ndarray
    """(ratios, 5, n) as in the chart, forces in kN."""
    boundary: np.ndarray
    """(n,) bar/V."""


@cache
def rocks_known() -> Rocks:
    """The grid of rocks of the estimate, finer than the chart's."""
    chart: Chart = read_chart()
    loading, hardening = np.meshgrid(np.geomspace(LOADING[0], LOADING[-1], 73), np.linspace(1.02, 1.6, 13))
    loading, hardening = loading.ravel(), hardening.ravel()
    features = np.moveaxis(chart.features_of(loading, hardening), 1, 0)
    features[:, :2] *= 1e-3
    return Rocks(
        loading,
        loading * hardening,
        1e6 / loading * (1.0 - 1.0 / hardening),
        np.ascontiguousarray(features),
        chart.boundary_of(loading, hardening),
    )


class RockEstimate:
    """Belief over rocks, from peak forces, impacts, time in contact and penetration of each interval.

    Between intervals the rock may change into any other with the probability ``hazard``. The interval in which it does
    is a mixture of both rocks and a fresh, soft face: it may look like anything, so it is given the same small
    likelihood ``odd`` whatever it reads, and the belief in a new rock starts from all of them alike.

    Args:
        hazard: Probability of a change in an interval.
        odd: Logarithm of the likelihood of an interval with a change, below that of a perfect match.
        error: Relative error of the chart when the motion is settled and single.
    """

    ROUGH = 0.1
    """Relative error of the chart where blows are not single: such motions are sensitive, and change slowly."""
    MOVING = 0.5
    """Added to it for a relative change of 1 of the pressure within the interval."""

    def __init__(self, hazard: float = 0.04, odd: float = 15.0, error: float = 0.015):
        self.rocks: Rocks = rocks_known()
        self._hazard, self._odd, self._error = hazard, odd, error
        self.beliefs = np.full(self.rocks.loading.size, 1.0 / self.rocks.loading.size)
        self.newness = 1.0
        """Probability that the rock has changed within the last interval."""

    def update(self, observation: np.ndarray, pressure: float, change: float) -> None:
        """Take in an interval.

        Args:
            observation: Its readings.
            pressure: Its mean pressure in bar.
            change: How far the pressure moved within it, in bar.
        """
        if abs(observation[AT] - FREQUENCY) > 1.0:
            return  # the chart is for one frequency
        models = self._models(pressure / float(observation[AMPLITUDE]))
        fits = self._fits(observation, models, abs(change) / pressure)
        same = (1.0 - self._hazard) * self.beliefs * np.exp(np.minimum(fits, 0.0))
        new = self._hazard * math.exp(-self._odd)
        total = same.sum() + new
        self.newness: float = new / total
        if self.newness > 1e-3:
            same += new * self._hint(observation, models[1])
            self.beliefs = same / same.sum()
        else:
            self.beliefs: np.ndarray = same / total

    def _models(self, ratio: float) -> np.ndarray:
        """(5, n) what the chart says of each rock at a ratio in bar/V."""
        place = float(np.interp(ratio, RATIOS, np.arange(RATIOS.size)))
        below = min(int(place), RATIOS.size - 2)
        lower, upper = self.rocks.features[below : below + 2]
        return lower + (place - below) * (upper - lower)

    def _hint(self, seen: np.ndarray, largest: np.ndarray) -> np.ndarray:
        """(n,) belief in each rock as a new one, by the strongest blow of the interval in which it was met.

        Blows stronger than the old rock gave are those of a harder one, the face of which is still somewhat softer.
        """
        amplitude, strongest = float(seen[AMPLITUDE]), float(seen[LARGEST_PEAK])
        peaks = np.log(np.maximum(amplitude * largest, 1e-3) / max(strongest, 1e-3))
        if strongest > 1.05 * amplitude * float(largest @ self.beliefs):
            belief = np.exp(-0.5 * (peaks / 0.08) ** 2) + 1e-3
        else:
            belief = np.where(peaks > 0.1, 0.2, 1.0)
        return belief / belief.sum()

    def _fits(self, seen: np.ndarray, models: np.ndarray, moved: float) -> np.ndarray:
        """(n,) the logarithm of the likelihood of the readings on each rock; 0 for a perfect match."""
        mean, largest, impacts, share, single = models
        error = self._error + self.ROUGH * (1.0 - single) + self.MOVING * moved
        amplitude = float(seen[AMPLITUDE])
        fits = np.zeros(mean.size)
        for reading, model in ((MEAN_PEAK, amplitude * mean), (LARGEST_PEAK, amplitude * largest), (SHARE, share)):
            fits += tailed(seen[reading] - model, NOISE[reading], error * model)
        fits += tailed(seen[IMPACTS] - impacts, NOISE[IMPACTS], 0.01 + error * impacts)
        blows = float(seen[IMPACTS] * seen[AT] * seen[MEAN_PEAK])
        if blows > 1.0:  # kN/s
            fits += tailed(
                seen[RATE] - blows * self.rocks.compliance, NOISE[RATE], 0.01 * blows * self.rocks.compliance
            )
        return fits

    @property
    def loading(self) -> float:
        """Loading stiffness in N/m."""
        return math.exp(float(self.beliefs @ np.log(self.rocks.loading)))

    @property
    def unloading(self) -> float:
        """Unloading stiffness in N/m."""
        return math.exp(float(self.beliefs @ np.log(self.rocks.unloading)))

    @property
    def spread(self) -> float:
        """Standard deviation of the loading stiffness, relative."""
        logs = np.log(self.rocks.loading)
        return math.sqrt(max(0.0, float(self.beliefs @ logs**2) - float(self.beliefs @ logs) ** 2))

    def peak_at(self, ratio: float) -> float:
        """Peak force in kN of settled blows at 1 V and a pressure over amplitude in bar/V, over what is believed."""
        return float(self._models(ratio)[1] @ self.beliefs)

    def boundary(self, share: float = 0.1) -> float:
        """The ratio in bar/V above which P-1-I-1 ends with the probability ``share``."""
        order = np.argsort(self.rocks.boundary)
        place = int(np.searchsorted(np.cumsum(self.beliefs[order]), share))
        return float(self.rocks.boundary[order[min(place, order.size - 1)]])


def tailed(miss: np.ndarray, noise: float, error: np.ndarray) -> np.ndarray:
    """Logarithm of Student's density (three degrees of freedom), 0 where there is no miss and no error of the model.

    Its tails let a single odd reading pass.
    """
    variance = noise**2 + error**2
    return -2.0 * np.log1p(miss**2 / (3.0 * variance)) - 0.5 * np.log(variance / noise**2)
