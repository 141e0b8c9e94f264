"""From a recording to what the fit starts from: the excitation's phase, the noise, and windows with a first guess.

The motion is nonsmooth and partly chaotic, so no long run is ever fitted. A recording is cut into windows of about one
excitation period, each beginning while the indenter is off the rock. The state at the beginning of a window is first
read from the measurements themselves: the spring from the structure driven by the measured force, the indenter's speed
from the measured acceleration back from the next force peak, where it is zero, and its distance to the rock from that
speed back from the moment at which the force sets in. None of these needs the contact law.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter, ss2tf, upfirdn

from drillenv.checks import InputError
from drillenv.diagnosis.coupling import ADDED
from drillenv.diagnosis.noise import converter_lsb, dead_band, peak_offset
from drillenv.recordings import Campaign, Recording
from drillenv.recordings.signal_faults import stretches
from drillenv.rig import Rig, Setting

SHORTEST_FLIGHT = 12
"""Samples off the rock between which a window may begin."""
USUAL, PRESSED = 20.0, 2.0
"""A flight comes down to within so many standard deviations of the noise of where this per cent of them do."""
SHORTEST, LONGEST = 0.6, 1.4
"""Excitation periods between which a window's length is, where there is a flight to end it."""
MULTIPLE = 4
"""Windows begin and end at samples that this divides, so that they do at those that are left of a recording too."""
ENOUGH = 12e3
"""Hz from which a recording is sampled densely enough: what the rock and the coupling do is over by a few kHz."""
ROLL_OFF, LOBES = 0.5, 6
"""Of the filter by which a recording is thinned: the excess of its band, and samples on either side that it takes."""
LONGEST_LAG = 1e-3
"""Seconds by which a channel may lag to be told at once."""
EVIDENT = 1.0
"""Samples that a lag has at least to be told at once."""
RESOLUTION = 1e-4
"""Of a channel's standard deviation, the least noise that it is judged by: no sensor of a rig is better."""
TOUCH = 6.0
"""Standard deviations of the force's noise above which the indenter is on the rock."""
MAINS = tuple(around + off for around in (50.0, 60.0) for off in (-0.1, -0.05, 0.0, 0.05, 0.1))
"""Hz at which a load cell may hum."""
ORDERS = ((1,), (1, 2, 3))
"""Of the mains that are read off the force in flight: a transformer that saturates adds odd ones, a rectifier even."""
LEVEL = 0.25
"""Standard deviations of the acceleration's noise from which its mean is no noise."""
HUM = 40.0
"""Half a sum of squares that a hum has to explain of the force in flight."""
MAINS_DRIFT = 2e-3
"""Share by which the mains may be off their frequency."""
IN_STEP = 0.5
"""Turns by which mains drift away from the excitation, or from every other of its periods, to be told from it."""
HEAVY = 1.0
"""Mass in kg from which no load cell carries it."""
STEEP = 3.0
"""Standard deviations of the force in flight beyond which no hum is read into it: flights locked to the mains say
nothing of what it is between them."""


@dataclass(frozen=True, slots=True, eq=False)
class Conditioned:
    """A recording of the drilling rig, ready to be fitted. Arrays of samples have shape (n,)."""

    name: str
    setting: Setting
    fresh: bool
    rate: float
    """Samples a second."""
    force: np.ndarray
    """N."""
    acceleration: np.ndarray
    """m/s^2."""
    omega: float
    """rad/s, of the measured excitation."""
    phase: float
    """rad, at the first sample."""
    amplitude: float
    """V, of the measured excitation."""
    noise_force: float
    """Standard deviation of the white noise in N."""
    noise_acceleration: float
    """In m/s^2."""
    starts: np.ndarray
    """(windows + 1,) samples at which windows begin, and where the last one ends."""
    states: np.ndarray
    """(windows, 4) first guess at the beginning of each window: coordinate of the spring and force of the damper in N,
    the indenter's speed in m/s and its depth in m, negative off the rock."""
    thinned: int = 1
    """How many samples of the logger make one of these: see :func:`thinning`."""
    blow: float = 0.0
    """N, mean of the force's peaks."""
    quanta: tuple[float, float] = (0.0, 0.0)
    """Steps of the converter on force and acceleration that would leave as much noise on these samples, at least
    :data:`RESOLUTION`."""

    def first(self, windows: int) -> Conditioned:
        """Its first windows only, where it has more."""
        if windows >= len(self.starts) - 1:
            return self
        end = int(self.starts[windows])
        return replace(
            self,
            force=self.force[:end],
            acceleration=self.acceleration[:end],
            starts=self.starts[: windows + 1],
            states=self.states[:windows],
        )


def white_noise(signal: np.ndarray) -> float:
    """Standard deviation of the white noise on a signal, from the median of its fourth differences.

    The median passes over the samples at which the signal itself turns quickly; a signal that is slow against the
    sample rate leaves next to nothing in fourth differences.
    """
    return float(np.median(np.abs(np.diff(signal, 4))) / (0.674490 * math.sqrt(70.0)))


def converter_step(signal: np.ndarray) -> float:
    """Step of the converter, or twice its dead band, which loses as much."""
    step, band = converter_lsb(signal), dead_band(signal)
    # the least value of a converter without a dead band is a step
    return 2.0 * band if band > 1.5 * step else step


def fit_excitation(signal: np.ndarray, rate: float, frequency: float) -> tuple[float, float, float]:
    """Frequency in rad/s, phase in rad at the first sample and amplitude of a sine in a signal.

    Mains on the same channel are fitted beside it where they are more than noise: near the excitation's frequency they
    would be taken for a part of it.

    Raises:
        InputError: the signal holds no sine near this frequency.
    """
    time = np.arange(signal.size) / rate
    found = _fit_sine(signal, time, 2 * math.pi * frequency)
    if found.amplitude <= 5 * float(np.std(found.left)) / math.sqrt(signal.size / 2):
        raise InputError(f"the excitation holds no sine near {frequency:g} Hz: check the channel and the setting")
    explained = {}
    for mains in _apart(time, found.omega):
        hum = np.column_stack(_sines(time, 2 * math.pi * mains, ORDERS[-1]))
        explained[mains] = float((found.left @ hum) @ np.linalg.solve(hum.T @ hum, hum.T @ found.left))
    most = max(explained, key=lambda mains: explained[mains], default=0.0)
    if explained and explained[most] > 2.0 * HUM * float(np.var(found.left)):
        found = _fit_sine(signal, time, found.omega, 2 * math.pi * most)
    return found.omega, found.phase, found.amplitude


class _Sine(NamedTuple):
    """A sine in a signal."""

    omega: float
    """rad/s."""
    phase: float
    """rad at the first sample."""
    amplitude: float
    left: np.ndarray
    """(n,) what is left."""


def _fit_sine(signal: np.ndarray, time: np.ndarray, omega: float, mains: float = 0.0) -> _Sine:
    """The sine near a frequency of ``omega`` rad/s, with a constant, and the mains near another beside it."""
    # at 0.5 s a tenth of a period is 0.2 % of 100 Hz; more than that would be another setting
    limits = np.array([0.006, MAINS_DRIFT])[: 2 if mains else 1]

    def parts(off: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        columns = [*_sines(time, omega * (1 + off[0]), (1,)), np.ones_like(time)]
        columns += _sines(time, mains * (1 + off[1]), ORDERS[-1]) if mains else []
        basis = np.column_stack(columns)
        # sines of unlike frequencies are next to orthogonal
        weights = np.linalg.solve(basis.T @ basis, basis.T @ signal)
        return weights, signal - basis @ weights

    start = np.zeros(limits.size)
    found = least_squares(lambda off: parts(off)[1], start, bounds=(-limits, limits), x_scale=1e-4).x
    (sine, cosine, *_), left = parts(found)
    return _Sine(omega * (1 + float(found[0])), math.atan2(cosine, sine), math.hypot(sine, cosine), left)


def spring_from_force(
    rig: Rig, setting: Setting, force: np.ndarray, acceleration: np.ndarray, angle: np.ndarray, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """y in m and y' in m/s at each sample, of the structure driven by the measured force.

    The relative motion of the two masses is damped out within 0.1 s, whatever the indenter does; where it began is
    what makes the predicted acceleration fit best.
    """
    k, c, m1, m2 = rig.stiffness, rig.damping, rig.shaker_mass, rig.indenter_mass
    mass = m1 * m2 / (m1 + m2)
    flow = np.array([[0.0, 1.0], [-k / mass, -c / mass]])
    push = rig.static_force(setting) / m1 - (rig.drive_force(setting) * np.sin(angle) - force) / m2
    given = (flow, np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1)))
    discrete: Any = cont2discrete(given, 1 / rate, method="foh")
    numerators, denominator = ss2tf(*discrete[:4])
    driven = np.stack([lfilter(each, denominator, push) for each in numerators])
    values, vectors = np.linalg.eig(discrete[0])
    modes = vectors[:, :, None] * values[:, None] ** np.arange(force.size)
    # of a pair of modes, real and imaginary parts; what is there twice least squares shares out
    free = np.concatenate([modes.real, modes.imag], axis=1)
    lacking = acceleration - (rig.drive_force(setting) * np.sin(angle) + k * driven[0] + c * driven[1] - force) / m2
    shape = (k * free[0] + c * free[1]) / m2
    first_steps = slice(0, min(force.size, int(0.15 * rate)))
    weights = np.linalg.lstsq(shape[:, first_steps].T, lacking[first_steps], rcond=None)[0]
    return driven[0] + weights @ free[0], driven[1] + weights @ free[1]


def flight_reading(force: np.ndarray, acceleration: np.ndarray, noise: float, rate: float, omega: float) -> np.ndarray:
    """(n,) what the load cell shows off the rock in N: its zero, a mass it carries, and the mains.

    A zero may drift, and mains may swell. Each where it is more than noise. Flights are the lowest part of the force:
    what lies within noise of its twentieth part, and of what is read there. Mains in step with the excitation of
    ``omega`` rad/s are not read: light presses on the rock pass for them.
    """
    low = force < np.percentile(force, 5.0) + 4.0 * noise
    level = float(np.median(force[low]))
    level = level if abs(level) > noise else 0.0
    own, time = np.ones_like(force), np.arange(force.size) / rate
    mains = _apart(time, omega)
    least, found, hummed, zero = 0.0, np.full(force.size, level), False, [own]
    swelling: list[np.ndarray] = []
    drift = _read_off(force, np.column_stack([own, time]), level, noise)
    if drift is not None and drift.gain > HUM:
        least, found, zero = drift.gain, drift.said, [own, time]
    best, mass_at = least, len(zero)
    # the simplest come first, others have to say more than these, and overtones more than their fundamental
    for orders, some_mass in (((1,), False), ((), True), ((1,), True), (ORDERS[-1], False), (ORDERS[-1], True)):
        if (orders and some_mass and best == least) or (len(orders) > 1 and not hummed):
            break
        needed = best + HUM
        for hum in (_sines(time, 2 * math.pi * each, orders) for each in mains) if orders else [()]:
            columns = (*zero, acceleration, *hum) if some_mass else (*zero, *hum)
            read = _read_off(force, np.column_stack(columns), level, noise)
            if read is None or read.gain <= max(needed, best):
                continue
            if some_mass and not 0.0 < read.weights[mass_at] < HEAVY:
                continue
            if math.hypot(*read.weights[mass_at + some_mass :]) < STEEP * read.height:
                best, found, hummed = read.gain, read.said, bool(orders)
                swelling = [*columns, *(time * wave for wave in hum)]
    if hummed:
        read = _read_off(force, np.column_stack(swelling), level, noise)
        if read is not None and read.gain > best + HUM:
            found = read.said
    return found


def _apart(time: np.ndarray, omega: float) -> list[float]:
    """Frequencies of the mains in Hz that are not in step with an excitation of ``omega`` rad/s."""
    tone, longest = omega / (2 * math.pi), time[-1] - time[0]
    return [each for each in MAINS if min(abs(each - tone), abs(2 * each - tone)) * longest >= IN_STEP]


def is_near_mains(data: Conditioned) -> bool:
    """Whether a hum on the excitation's channel is not told from the excitation: what is read of that may have it in.

    Mains drift away from it by less than half a turn.
    """
    tone, longest = data.omega / (2 * math.pi), data.force.size / data.rate
    return any(abs(each - tone) * longest < IN_STEP for each in MAINS)


def _sines(time: np.ndarray, omega: float, orders: Sequence[int]) -> list[np.ndarray]:
    """(n,) sine and cosine of each order of a frequency in rad/s."""
    return [wave(order * omega * time) for order in orders for wave in (np.sin, np.cos)]


class _Reading(NamedTuple):
    """What a load cell shows in flight, fitted there."""

    weights: np.ndarray
    """(k,)."""
    said: np.ndarray
    """(n,) in N."""
    gain: float
    """Half a sum of squares that it explains beyond a level."""
    height: float
    """Standard deviation of the force in flight in N."""


def _read_off(force: np.ndarray, basis: np.ndarray, level: float, noise: float) -> _Reading | None:
    """Columns (n, k) fitted to the force in flight; None where no flight is left."""
    # the first flights are those in the trough of what is read, with some of its height
    off, weights, said = force < level + 2.0 * TOUCH * noise, np.zeros(0), force
    for _round in range(6):
        weights = np.linalg.lstsq(basis[off], force[off], rcond=None)[0]
        said = basis @ weights
        off = np.abs(force - said) < 4.0 * noise
        if np.count_nonzero(off) < SHORTEST_FLIGHT:
            return None
    gain = 0.5 * float((force[off] - np.median(force[off])).var() - (force[off] - said[off]).var())
    return _Reading(weights, said, gain * np.count_nonzero(off) / noise**2, float(force[off].std()))


def lag(
    rig: Rig, setting: Setting, force: np.ndarray, acceleration: np.ndarray, angle: np.ndarray, rate: float
) -> float:
    """Seconds by which the acceleration comes later than the force says, negative if earlier.

    The balance of the indenter gives its acceleration from the measured force and the drive, whatever the rock does;
    their correlation is highest where the two lie on each other.
    """
    y, closing = spring_from_force(rig, setting, force, acceleration, angle, rate)
    spring = rig.stiffness * y + rig.damping * closing
    said = (rig.drive_force(setting) * np.sin(angle) + spring - force) / rig.indenter_mass
    reach = int(LONGEST_LAG * rate)
    inside = slice(reach, said.size - reach)
    products = [float(said[inside] @ acceleration[reach + k : said.size - reach + k]) for k in range(-reach, reach + 1)]
    top = int(np.argmax(products))
    if not 0 < top < 2 * reach:
        return 0.0
    return (top - reach + peak_offset(*products[top - 1 : top + 2])) / rate


def contacts(force: np.ndarray, noise: float) -> np.ndarray:
    """(m, 2) first sample on the rock and first sample off it again, for each contact that the force shows.

    One that the end of the recording cuts off has no peak to be read from, and is left out.
    """
    on = force > TOUCH * noise
    # a single loud sample in flight is noise
    on &= np.convolve(on, [1, 0, 1], mode="same") > 0
    found = np.array(stretches(on), dtype=int).reshape(-1, 2)
    return found[found[:, 1] < force.size]


def what_is_needed(recording: Recording) -> tuple[Setting, list[np.ndarray]]:
    """Setting, and samples (n,) of excitation in V, force in N and acceleration in m/s^2.

    Raises:
        InputError: one of them is missing, or a sample is no number.
    """
    names = ("excitation", "force", "acceleration")
    missing = [name for name in names if name not in recording.channels]
    if recording.setting is None or missing:
        raise InputError(f"{recording.name}: lacks {', '.join(missing) or 'a setting'}: record it to have it diagnosed")
    samples = [np.ascontiguousarray(recording.channels[name].samples) for name in names]
    if not all(np.isfinite(each).all() for each in samples):
        raise InputError(f"{recording.name}: holds samples that are no numbers: leave the recording out")
    return recording.setting, samples


@lru_cache(64)
def condition(recording: Recording, rig: Rig, late: float = 0.0) -> Conditioned:
    """Prepare a recording of the drilling rig; one that was prepared already is not prepared again.

    ``late`` is by how many seconds the acceleration is taken to lag, for the first guess of the states.

    Raises:
        InputError: it lacks a setting or a channel, has samples that are no numbers, no excitation or no contact.
    """
    setting, (excitation, force, acceleration) = what_is_needed(recording)
    rate = recording.sample_rate
    omega, phase, amplitude = fit_excitation(excitation, rate, setting.frequency)
    angle = phase + omega * np.arange(force.size) / rate
    (noise, least_noise), (acceleration_noise, least_acceleration_noise) = map(noise_seen, (force, acceleration))
    now = acceleration
    if late != 0.0:
        samples = np.arange(force.size)
        now = np.interp(samples + late * rate, samples, acceleration)
    # whatever the load cell says in flight is not of the rock
    resting = force - flight_reading(force, now, noise, rate, omega)
    touches = contacts(resting, noise)
    if len(touches) < 3:
        raise InputError(f"{recording.name}: the force shows {len(touches)} contacts: record a rig that drills")
    now = now - acceleration_level(touches, resting, now, acceleration_noise)
    y, closing = spring_from_force(rig, setting, resting, now, angle, rate)
    fresh = recording.starts == "fresh"
    starts = window_starts(
        flights(touches, resting, noise), touches[-1, 1], force.size, 2 * math.pi / omega * rate, fresh
    )
    if len(starts) < 4:
        raise InputError(
            f"{recording.name}: {len(starts) - 1} stretches begin off the rock: record for longer, with less pressure"
        )
    states = np.array([_state_at(int(s), touches, resting, now, rate, y, closing, noise) for s in starts[:-1]])
    states = as_unknowns(states, rig, setting, fresh)
    factor = next(each for each in (4, 2, 1) if rate / each >= ENOUGH or each == 1)
    # white noise and rounding lose as much as is averaged
    less = 1.0 / math.sqrt(factor)
    return Conditioned(
        recording.name,
        setting,
        fresh,
        rate / factor,
        thin(force, factor),
        thin(acceleration, factor),
        omega,
        phase,
        amplitude,
        less * max(noise, least_noise),
        less * max(acceleration_noise, least_acceleration_noise),
        starts // factor,
        states,
        factor,
        float(np.mean([resting[on:after].max() for on, after in touches[1:-1]])),
        (less * math.sqrt(12.0) * least_noise, less * math.sqrt(12.0) * least_acceleration_noise),
    )


def conditioned(recordings: Sequence[Recording], rig: Rig) -> list[Conditioned]:
    """Recordings prepared, the states guessed by an acceleration that is as late as the balance of each says."""
    data = []
    for recording in recordings:
        made = condition(recording, rig)
        angle = made.phase + made.omega * np.arange(made.force.size) / made.rate
        late = lag(rig, made.setting, made.force, made.acceleration, angle, made.rate)
        data.append(condition(recording, rig, late) if abs(late) * made.rate >= EVIDENT else made)
    return data


def without_unusable(campaign: Campaign, rig: Rig) -> tuple[Campaign, list[str]]:
    """A campaign without the recordings that cannot be prepared, and a sentence for each of these.

    Raises:
        InputError: none can.
    """
    kept, said = [], []
    for each in campaign.recordings:
        try:
            condition(each, rig)
        except InputError as error:
            said.append(str(error))
        else:
            kept.append(each)
    if not kept:
        raise InputError(f"no recording can be used: {'; '.join(said[:3])}")
    return replace(campaign, recordings=tuple(kept)), [f"{each}; it is left out." for each in said]


def noise_seen(signal: np.ndarray) -> tuple[float, float]:
    """Standard deviations of the noise that is seen on a signal (n,), and of the least by which it is judged.

    What rounding leaves is white noise of its step over the root of 12. Without any noise recordings are simulated.
    """
    rounding = converter_step(signal) / math.sqrt(12.0)
    return max(white_noise(signal), rounding, 1e-6), max(rounding, RESOLUTION * float(np.std(signal)))


def as_unknowns(read: np.ndarray, rig: Rig, setting: Setting, fresh: bool) -> np.ndarray:
    """States (windows, 4) as read (y, x1', x2', depth) as the unknowns of windows: see :class:`Conditioned`."""
    static, states = rig.static_force(setting), read.copy()
    states[:, 0] = rig.stiffness * read[:, 0] + ADDED * (read[:, 0] - static / rig.stiffness)
    states[:, 1] = rig.damping * (read[:, 1] - read[:, 2])
    if fresh:
        states[0] = static, 0.0, 0.0, 0.0
    return states


@lru_cache(maxsize=8)
def thinning(factor: int) -> np.ndarray:
    """(taps,) centred filter with which every so many-th sample is kept; its sum is 1.

    A root-raised-cosine filter: its convolution with itself has zeros at the distance of the samples that are kept, so
    that white noise stays white (J. G. Proakis, Digital Communications, McGraw-Hill, 2001, Section 9.2.1). Part of what
    lies above their Nyquist frequency is folded down; models pass through the same filter.
    """
    if factor == 1:
        return np.ones(1)
    t = np.arange(-LOBES * factor, LOBES * factor + 1) / factor
    edge = np.isclose(np.abs(4.0 * ROLL_OFF * t), 1.0)
    safe = np.where(edge | (t == 0.0), 0.123, t)
    top = np.sin(math.pi * safe * (1.0 - ROLL_OFF))
    top += 4.0 * ROLL_OFF * safe * np.cos(math.pi * safe * (1.0 + ROLL_OFF))
    taps = top / (math.pi * safe * (1.0 - (4.0 * ROLL_OFF * safe) ** 2))
    taps[t == 0.0] = 1.0 + ROLL_OFF * (4.0 / math.pi - 1.0)
    quarter = math.pi / (4.0 * ROLL_OFF)
    taps[edge] = (1.0 + 2.0 / math.pi) * math.sin(quarter) + (1.0 - 2.0 / math.pi) * math.cos(quarter)
    taps[edge] *= ROLL_OFF / math.sqrt(2.0)
    return taps / taps.sum()


def thin(signals: np.ndarray, factor: int) -> np.ndarray:
    """Signals (..., n) through :func:`thinning`, at every so many-th sample; at their ends they lack what is beyond."""
    if factor == 1:
        return signals
    made = upfirdn(thinning(factor), signals, 1, factor, axis=-1)
    return np.ascontiguousarray(made[..., LOBES : LOBES + signals.shape[-1] // factor])


def flights(touches: np.ndarray, resting: np.ndarray, noise: float) -> np.ndarray:
    """(m, 2) first sample off the rock and first sample on it again, of flights long enough to begin a window in.

    An indenter that is pressed on lightly shows as little force as one that flies. So a flight comes as far down as
    others do, and ends where it is last so low.
    """
    found = np.column_stack([np.concatenate([[0], touches[:-1, 1]]), touches[:, 0]])
    found = found[found[:, 1] - found[:, 0] >= SHORTEST_FLIGHT]
    if not len(found):
        return found
    half = SHORTEST_FLIGHT // 2
    level = np.convolve(resting, np.full(half, 1.0 / half), "valid")
    levels = [level[first : after - half + 1] for first, after in found]
    lowest = np.array([each.min() for each in levels])
    for flight, each, low in zip(found, levels, lowest, strict=True):
        flight[1] = flight[0] + np.flatnonzero(each <= low + PRESSED * noise)[-1] + half
    deep = lowest <= np.percentile(lowest, USUAL) + PRESSED * noise
    return found[deep & (found[:, 1] - found[:, 0] >= SHORTEST_FLIGHT)]


def acceleration_level(touches: np.ndarray, resting: np.ndarray, acceleration: np.ndarray, noise: float) -> float:
    """What the accelerometer shows on the average from one standstill to another in m/s^2, 0 where that is but noise.

    The indenter stands still where the force is largest.
    """
    first, last = (int(on + np.argmax(resting[on:after])) for on, after in touches[[1, -2]])
    level = float(acceleration[first:last].mean()) if last > first else 0.0
    return level if abs(level) > LEVEL * noise else 0.0


def window_starts(off: np.ndarray, last: int, size: int, period: float, fresh: bool) -> np.ndarray:
    """Samples at which windows begin, and where the last one ends.

    Each begins in the longest flight that is about a period after the last one: there its state is read best, and
    the impacts that follow each other closely stay in one window. ``off`` is of :func:`flights`, ``last`` where the
    last contact ends.
    """
    lengths = off[:, 1] - off[:, 0]
    # near the end of the flight: what is left of it is read back from the coming contact
    places = (off[:, 1] - np.maximum(SHORTEST_FLIGHT // 2, lengths // 3)) // MULTIPLE * MULTIPLE
    end = min(size, int(last) + SHORTEST_FLIGHT) // MULTIPLE * MULTIPLE
    chosen: list[int] = []
    reach = (0.0, LONGEST) if not fresh else (SHORTEST, LONGEST)
    now = 0
    while True:
        near = np.flatnonzero((places >= now + reach[0] * period) & (places <= now + reach[1] * period))
        if near.size:
            # of flights about as long the first
            good = near[lengths[near] >= 0.8 * lengths[near].max()][0]
        else:
            after = np.flatnonzero(places > now + reach[1] * period)
            if not after.size:
                break
            good = after[0]
        now = int(places[good])
        chosen.append(now)
        reach = (SHORTEST, LONGEST)
    if fresh:
        chosen.insert(0, 0)
    if len(chosen) > 1 and end - chosen[-1] < 0.3 * period:
        chosen.pop()
    return np.array([*chosen, end])


def _state_at(s: int, touches, force, acceleration, rate: float, y, closing, noise: float) -> tuple[float, ...]:
    """y, v1, v2, w at sample s, off the rock, from the contact that comes next."""
    step = 1.0 / rate
    coming = touches[np.searchsorted(touches[:, 0], s)]
    peak = int(coming[0] + np.argmax(force[coming[0] : coming[1]]))
    # speed at every sample from s to the peak, zero at the peak
    gained = np.concatenate([[0.0], np.cumsum(0.5 * (acceleration[s:peak] + acceleration[s + 1 : peak + 1])) * step])
    # where the top of the force lies, in samples from its largest one
    top = peak_offset(*force[peak - 1 : peak + 2]) if 0 < peak < force.size - 1 else 0.0
    offset = top * step * acceleration[peak]
    speed = gained - gained[-1] - offset
    first = int(coming[0])
    slope = max(force[min(first + 1, force.size - 1)] - force[first - 1], noise)
    onset = first - min(2.0, 2.0 * force[first] / slope)
    place = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1])) * step])
    w = -float(np.interp(onset - s, np.arange(place.size), place))
    return float(y[s]), float(closing[s] + speed[0]), float(speed[0]), min(w, 0.0)
