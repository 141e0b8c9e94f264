"""One door to the rig in motion: checks what it is given, picks the engine, returns a Run."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from drillenv.checks import InputError, choice, count, number, shown
from drillenv.dynamics import segments
from drillenv.dynamics.constitutive.places import CODE
from drillenv.dynamics.effects import Chosen
from drillenv.dynamics.exact import (
    CARRY,
    ORIGIN,
    REGIME,
    STATE_SIZE,
    TURN,
    TURNS,
    W,
    fresh_state,
    set_phase,
)
from drillenv.dynamics.flow import LOADING, STIFFNESS, UNLOADING, make_model
from drillenv.dynamics.hybrid.model import Start
from drillenv.dynamics.hybrid.run import Impacts, run_hybrid
from drillenv.dynamics.motion import Motion, checked_place, motion
from drillenv.dynamics.motion_hybrid import effects_meant
from drillenv.dynamics.orbits import put_on_section
from drillenv.files import whole
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

Floats = NDArray[np.float64]

SECONDS_LIMITS = (1e-3, 3600.0)
SAMPLE_RATE_LIMITS = (100.0, 1e6)  # Hz
PHASE_LIMITS = (-1e6, 1e6)  # rad
MOST_SAMPLES = 20_000_000
"""Of one run: 1.6 GB."""
LEAD_PERIODS = 8
"""Excitation periods run before a run on a motion without a period, to find how the contact going on then began."""
RESHAPING = ("loading", "unloading", "compaction")
"""Places at which a law changes the rock law."""
SETTLED = 30.0
"""Time constants of the shaker on its damper after which nothing is left of a start."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """What the rig did: samples, impacts, energies. SI; x and accelerations positive toward the rock.

    The first sample is at time 0 and the last at most ``seconds`` later, so 2 s at 25.6 kHz are 51,201 samples. X2 = 0
    is where Xf is at time 0: the rock's face, had the indenter just left it.
    """

    time: Floats
    """(samples,) in s."""
    excitation: Floats
    """(samples,) in V."""
    force: Floats
    """(samples,) of the rock on the indenter in N, positive in compression; exactly 0 out of contact."""
    acceleration: Floats
    """(samples,) of the indenter in m/s^2."""
    shaker_position: Floats
    """(samples,) X1 in m, the spring's rest length taken off."""
    indenter_position: Floats
    """(samples,) X2 in m."""
    shaker_speed: Floats
    """(samples,) in m/s."""
    indenter_speed: Floats
    """(samples,) in m/s."""
    penetration: Floats
    """(samples,) how far Xf has moved since time 0, in m."""
    impacts: Impacts
    """The force peaks (turns from loading to unloading), an array entry each: ``time`` in s, ``force`` in N, ``speed``
    of the indenter in m/s where its contact began, ``depth`` in m beyond Xp, ``contact_time`` in s, when the contact
    began (below 0 if before a run that starts on its motion). Speed and contact time are 0 where the run starts in
    contact and the contact's beginning is not known."""
    work_by_drive: float
    """Work of F_a sin(theta) on the indenter in J."""
    work_by_static: float
    """Work of F_b on the shaker in J."""
    work_by_effects: float
    """Work of all effects in J, negative where they take."""
    lost_in_damper: float
    """J."""
    lost_in_rock: float
    """J: the work done on the rock, less what it would still give back at the end. With effects that bend the rock law,
    what it would give back counts as lost."""
    stored_change: float
    """Change of the kinetic energy, of the energy in the spring k, and of what the rock would give back, in J."""
    penetration_rate: float
    """In m/s: from a fresh start, penetration over the run's time; on a motion, that of the motion if it is periodic,
    otherwise over the whole excitation periods in the run."""
    setting: Setting
    rock: Rock
    rig: Rig

    @property
    def work_in(self) -> float:
        """Work of both forces in J."""
        return self.work_by_drive + self.work_by_static

    @property
    def balance_error(self) -> float:
        """What the energy balance fails to close by, over the largest of its parts. Each part is found by itself."""
        parts = (
            self.work_by_drive,
            self.work_by_static,
            self.work_by_effects,
            -self.lost_in_damper,
            -self.lost_in_rock,
            -self.stored_change,
        )
        largest = max(abs(part) for part in parts)
        return abs(math.fsum(parts)) / largest if largest > 0.0 else 0.0

    def to_csv(self, path: str | os.PathLike[str]) -> None:
        """Write the samples, every digit of them; the file appears whole or not at all.

        Columns: time_s, excitation_V, force_N, acceleration_m_s2, shaker_position_m, indenter_position_m,
        penetration_m.

        Raises:
            InputError: ``path`` cannot be written.
        """
        columns = {
            "time_s": self.time,
            "excitation_V": self.excitation,
            "force_N": self.force,
            "acceleration_m_s2": self.acceleration,
            "shaker_position_m": self.shaker_position,
            "indenter_position_m": self.indenter_position,
            "penetration_m": self.penetration,
        }
        with whole(path) as name, open(name, "w", encoding="utf-8", newline="\n") as file:
            file.write(",".join(columns) + "\n")
            for at in range(0, self.time.size, 65536):
                block = [map(repr, column[at : at + 65536].tolist()) for column in columns.values()]
                file.writelines(",".join(row) + "\n" for row in zip(*block, strict=True))


class Strobe(NamedTuple):
    """The rig at the end of each excitation period, from the fresh start. SI."""

    x1: Floats
    """(periods + 1,) in m, the start included."""
    x2: Floats
    """(periods + 1,) in m."""
    v1: Floats
    """(periods + 1,) in m/s."""
    v2: Floats
    """(periods + 1,) in m/s."""
    penetration: Floats
    """(periods + 1,) Xf in m."""
    impact_times: Floats
    """In s, of the turns from loading to unloading."""
    contact_times: Floats
    """In s, when each contact began; 0 where the start goes straight into the rock."""


def simulate(
    setting: Setting | Sequence[float],
    rock: int | str | Rock = 4,
    rig: Rig | None = None,
    seconds: float = 2.0,
    sample_rate: float = 25600.0,
    start: str = "fresh",
    phase: float = 0.0,
    engine: str = "exact",
    effects: Iterable[Chosen] = (),
) -> Run:
    """Run the rig.

    The model is that of Section 3 of the paper with n_l = n_u = 1, solved in closed form between switches. The samples
    are read off that solution, so the motion does not depend on the sample rate.

    Args:
        setting: Setting, or (frequency in Hz, amplitude in V, pressure in bar).
        rock: Case of Table 2.2 (1 to 6), its name, or a Rock.
        rig: By default that of Table 2.1.
        seconds: Duration in s, 0.001 to 3600.
        sample_rate: Samples a second, 100 to 1e6; at most 20 million in all.
        start: ``fresh``, at rest against rock never hit before, the spring carrying the static force; or ``steady``, on
            the motion that the rig settles on from there.
        phase: Of the excitation at time 0 in rad. A motion of several periods passes a phase several times; the run
            starts at one of these.
        engine: ``exact``; or ``hybrid``, which integrates numerically and is also taken where there
            are effects or the exact engine cannot take the rig.
        effects: From :func:`drillenv.dynamics.effects.make`.

    Raises:
        InputError: an argument of the wrong kind or outside its limits.
    """
    setting, rock, rig = checked_place(_setting(setting), rock, rig)
    seconds = number("seconds", seconds, *SECONDS_LIMITS, "s", [(1e-3, "ms")])
    sample_rate = number("sample_rate", sample_rate, *SAMPLE_RATE_LIMITS, "Hz", [(1e3, "kHz")])
    times = _times(seconds, sample_rate)
    phase = number("phase", phase, *PHASE_LIMITS, "rad") % TURN % TURN  # the first may round up to a whole turn
    steady = choice("start", start, ("fresh", "steady")) == "steady"
    chosen = effects_meant(effects)
    if choice("engine", engine, ("exact", "hybrid")) == "exact" and not chosen:
        try:
            model = make_model(rig, rock, setting)
        except InputError:
            pass  # the exact engine cannot take this rig
        else:
            return _run_exact(model, setting, rock, rig, times, seconds, steady, phase)
    return _run_hybrid(setting, rock, rig, times, seconds, sample_rate, steady, phase, chosen)


def strobe(
    setting: Setting | Sequence[float],
    rock: int | str | Rock = 4,
    rig: Rig | None = None,
    periods: int = 500,
    phase: float = 0.0,
) -> Strobe:
    """The rig at the end of each of so many excitation periods from the fresh start.

    Args:
        setting, rock, rig, phase: As for :func:`simulate`.
        periods: 1 to 1,000,000.

    Raises:
        InputError: an argument of the wrong kind or outside its limits, or a rig that the exact engine cannot take.
    """
    setting, rock, rig = checked_place(_setting(setting), rock, rig)
    periods = count("periods", periods, 1, 1_000_000)
    phase = number("phase", phase, *PHASE_LIMITS, "rad") % TURN % TURN
    model = make_model(rig, rock, setting)
    state = np.zeros(STATE_SIZE)
    fresh_state(model, phase, state)
    log = segments.record(model, state, periods / setting.frequency)
    starts = segments.segment_times(model, log)
    samples = _sampled(model, log, starts, np.arange(periods + 1) / setting.frequency)
    contacts = starts[segments.landings(log)]
    if log[0, segments.L_REGIME] == LOADING:
        contacts = np.concatenate([starts[:1], contacts])
    return Strobe(
        x1=samples[segments.S_X1],
        x2=samples[segments.S_X2],
        v1=samples[segments.S_V1],
        v2=samples[segments.S_V2],
        penetration=samples[segments.S_PENETRATION],
        impact_times=starts[segments.force_peaks(log)],
        contact_times=contacts,
    )


# --- The exact engine


def _run_exact(
    model: Floats,
    setting: Setting,
    rock: Rock,
    rig: Rig,
    times: Floats,
    seconds: float,
    steady: bool,
    phase: float,
) -> Run:
    state = np.zeros(STATE_SIZE)
    settled, began, speed = None, 0.0, 0.0
    if steady:
        settled = motion(setting, rock, rig)
        began, speed = _join(model, settled, phase, state)
    else:
        fresh_state(model, phase, state)
    log = segments.record(model, state, seconds)
    starts = segments.segment_times(model, log)
    samples = _sampled(model, log, starts, times)
    drive, damper = segments.work_and_damping(model, log)
    if settled is not None and settled.period:
        rate = settled.penetration_rate
    else:
        periods = math.floor(seconds * setting.frequency * (1 + 1e-12)) if steady else 0
        until = periods / setting.frequency if periods else seconds
        rate = float(_sampled(model, log, starts, np.array([until]))[segments.S_PENETRATION, 0]) / until
    return Run(
        time=times,
        excitation=setting.amplitude * samples[segments.S_SINE],
        force=samples[segments.S_FORCE],
        acceleration=samples[segments.S_ACCELERATION],
        shaker_position=samples[segments.S_X1],
        indenter_position=samples[segments.S_X2],
        shaker_speed=samples[segments.S_V1],
        indenter_speed=samples[segments.S_V2],
        penetration=samples[segments.S_PENETRATION],
        impacts=_impacts(model, log, starts, began, speed),
        work_by_drive=drive,
        work_by_static=segments.work_of_static_force(model, log),
        work_by_effects=0.0,
        lost_in_damper=damper,
        lost_in_rock=segments.lost_in_rock(model, log),
        stored_change=segments.stored_energy_change(model, log),
        penetration_rate=rate,
        setting=setting,
        rock=rock,
        rig=rig,
    )


def _join(model: Floats, settled: Motion, phase: float, state: Floats) -> tuple[float, float]:
    """Put the state on a motion at ``phase``, Xf at 0. Returns when the latest contact began, in s, and how fast."""
    put_on_section(settled.point, settled.regime, state)
    # all the way around, so that the beginning of a contact going on at the phase is seen
    lead = ((settled.period or LEAD_PERIODS) + phase / TURN) / settled.setting.frequency
    log = segments.record(model, state, lead)
    set_phase(phase, state)
    state[TURNS] = state[CARRY] = state[ORIGIN] = 0.0
    if state[REGIME] == LOADING:
        state[ORIGIN] = -state[W] * (1.0 - model[LOADING, STIFFNESS] / model[UNLOADING, STIFFNESS])
    rows = segments.landings(log)
    if not rows.size:
        return 0.0, 0.0
    starts = segments.segment_times(model, log)
    return float(starts[rows[-1]] - starts[-1]), float(log[rows[-1], segments.L_V2])


def _impacts(model: Floats, log: Floats, starts: Floats, began: float, speed: float) -> Impacts:
    """The force peaks of a log; the contact in which it may start began at ``began`` with ``speed``."""
    peaks, landings = segments.force_peaks(log), segments.landings(log)
    contact = np.searchsorted(landings, peaks)
    force = segments.rock_force(model, log)[peaks]
    return Impacts(
        time=starts[peaks],
        force=force,
        speed=np.concatenate([[speed], log[landings, segments.L_V2]])[contact],
        depth=force / model[LOADING, STIFFNESS],
        contact_time=np.concatenate([[began], starts[landings]])[contact],
    )


def _sampled(model: Floats, log: Floats, starts: Floats, times: Floats) -> Floats:
    """(SAMPLE_ROWS, times) of a log."""
    samples = np.empty((segments.SAMPLE_ROWS, times.size))
    segments.sample(model, log, starts, times, samples)
    return samples


# --- The hybrid engine


def _run_hybrid(
    setting: Setting,
    rock: Rock,
    rig: Rig,
    times: Floats,
    seconds: float,
    sample_rate: float,
    steady: bool,
    phase: float,
    effects: tuple[Chosen, ...],
) -> Run:
    start = None
    if steady:
        whole_periods = math.ceil(_settling_time(rig) * setting.frequency)
        settling = whole_periods / setting.frequency
        start = run_hybrid(rig, setting, rock, settling, 0.0, phase, effects=effects).end
    run = run_hybrid(rig, setting, rock, seconds, sample_rate, phase, start, effects)
    elastic = 0.0
    if not any(map(_bends_rock, effects)):
        elastic = _elastic(rock, run.end) - (_elastic(rock, start) if start else 0.0)
    first = run.penetration[0]
    return Run(
        time=times,
        excitation=setting.amplitude * np.sin(phase + TURN * (setting.frequency * times % 1.0)),
        force=run.force,
        acceleration=run.acceleration,
        shaker_position=run.x1 - first,
        indenter_position=run.x2 - first,
        shaker_speed=run.v1,
        indenter_speed=run.v2,
        penetration=run.penetration - first,
        impacts=run.impacts,
        work_by_drive=run.energy.drive,
        work_by_static=run.energy.static,
        work_by_effects=math.fsum(run.energy.effects.tolist()),
        lost_in_damper=run.energy.damper,
        lost_in_rock=run.energy.rock - elastic,
        stored_change=run.energy.stored_after - run.energy.stored_before + elastic,
        penetration_rate=_rate(times, run.penetration, setting if steady else None),
        setting=setting,
        rock=rock,
        rig=rig,
    )


def _rate(times: Floats, penetration: Floats, setting: Setting | None) -> float:
    """Penetration over time between samples: of the whole periods at a setting where there are any, or of all."""
    last = times.size - 1
    if setting is not None and times[-1] >= setting.period:
        until = math.floor(times[-1] * setting.frequency * (1 + 1e-12)) * setting.period
        last = min(int(np.count_nonzero(times < until * (1 - 1e-12))), last)
    return float((penetration[last] - penetration[0]) / times[last]) if last else 0.0


def _settling_time(rig: Rig) -> float:
    """How long the hybrid engine runs before a run on a motion, in s: the shaker settles last."""
    return min(max(SETTLED * 2.0 * rig.shaker_mass / rig.damping, 1.0), 60.0)


def _bends_rock(chosen: Chosen) -> bool:
    """Whether an effect changes the rock law, so that what the rock would give back is not known."""
    effect = chosen.effect
    if chosen.is_neutral:
        return False
    if effect.axes is not None:
        return effect.axes.place in map(CODE.__getitem__, RESHAPING)
    turning = effect.scalars is not None and effect.scalars(chosen.values).get("rotation_share", 0.0) != 0.0
    return turning or any(place in effect.laws for place in RESHAPING)


def _elastic(rock: Rock, state: Start) -> float:
    """What the rock would give back, in J."""
    force = {LOADING: rock.loading_stiffness, UNLOADING: rock.unloading_stiffness}.get(state.regime, 0.0) * state.w
    return 0.5 * force**2 / rock.unloading_stiffness


# --- What the user gave


def _setting(given: Setting | Sequence[float]) -> Setting:
    """A Setting, or three numbers for one."""
    if isinstance(given, Setting):
        return given
    try:
        frequency, amplitude, pressure = given
    except (TypeError, ValueError):
        raise InputError(
            f"setting is {shown(given)}: give Setting(frequency, amplitude, pressure), or three numbers in Hz, V, bar"
        ) from None
    return Setting(frequency, amplitude, pressure)


def _times(seconds: float, sample_rate: float) -> Floats:
    """When the samples are taken."""
    samples = math.floor(seconds * sample_rate * (1 + 1e-12)) + 1
    if samples > MOST_SAMPLES:
        raise InputError(
            f"{seconds:g} s at {sample_rate:g} Hz are {samples} samples, above the {MOST_SAMPLES} allowed: "
            "give fewer seconds or a lower sample_rate"
        )
    return np.arange(samples) / sample_rate
