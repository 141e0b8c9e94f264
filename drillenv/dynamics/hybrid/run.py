"""The hybrid engine for a user: a run from a start over so many seconds, sampled."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numba import njit

from drillenv.checks import InputError, number
from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.compiled import ALLOCATING, INNER, NO, apart, constants
from drillenv.dynamics.effects import Chosen
from drillenv.dynamics.flow import FREE, LOADING, UNLOADING
from drillenv.dynamics.hybrid.advance import STEPS_TOO_SHORT, WENT_ON, advance, prepare, read_state
from drillenv.dynamics.hybrid.events import set_factor
from drillenv.dynamics.hybrid.model import Start, extra_places, model_for, motion_at, start_at
from drillenv.dynamics.hybrid.runge_kutta import (
    BEGIN_D,
    BEGIN_SLOPE,
    SPARE,
    SPARE_SLOPE,
    make_scratch,
)
from drillenv.dynamics.hybrid.vector_field import (
    BY_DRIVE,
    BY_EFFECTS,
    BY_STATIC,
    CARRY,
    IMPACT_DEPTH,
    IN_DAMPER,
    IN_ROCK,
    M1,
    M2,
    ORIGIN,
    PEAK,
    REGIME,
    ROTATION,
    ROTATION_RATE,
    THETA,
    TURN,
    UD,
    V1,
    V2,
    VIBRATION,
    VIBRATION_RATE,
    K,
    Model,
    U,
    W,
    Y,
    law_depth,
    law_force,
)
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

RATES = {ROTATION: ROTATION_RATE, VIBRATION: VIBRATION_RATE}
"""Scalars at whose rates parts of the discrete state go on."""
READ_FROM = 1e-9
"""Relative error from which events and samples are read off the polynomial inside a step; below, each is a step of its
own."""


class Impacts(NamedTuple):
    """One entry an impact: a turn from loading to unloading."""

    time: np.ndarray
    """s, of the turn."""
    force: np.ndarray
    """N, the largest force of the rock on the way to this turn."""
    speed: np.ndarray
    """m/s into the rock, where the contact began; 0 for a contact begun before the run."""
    depth: np.ndarray
    """m, X2 - Xp at the turn."""
    contact_time: np.ndarray
    """s, when the contact began."""


class Switches(NamedTuple):
    """One entry a switch of regime."""

    time: np.ndarray
    """s."""
    before: np.ndarray
    """0 no contact, 1 loading, 2 unloading."""
    after: np.ndarray


class Energy(NamedTuple):
    """Energies of a whole run in J. ``stored`` are those of the masses and the spring k."""

    drive: float
    """Work of the drive force F_a sin(theta)."""
    static: float
    """Work of the static force F_b."""
    damper: float
    """Lost in the damper c."""
    rock: float
    """Lost in the rock by the rock law (as bent by effects)."""
    effects: np.ndarray
    """(effects,) given to the rig by each effect, in the order chosen; negative where it takes."""
    stored_before: float
    stored_after: float

    @property
    def error(self) -> float:
        """What the balance fails to close by, in J."""
        given = self.drive + self.static - self.damper - self.rock + float(np.sum(self.effects))
        return self.stored_after - self.stored_before - given


class HybridRun(NamedTuple):
    """What :func:`run_hybrid` returns. SI; arrays of samples have shape (samples,)."""

    time: np.ndarray
    """s, 0 at the start."""
    x1: np.ndarray
    """m. X2 = 0 where Xf was at the start (Xp for a start while loading), the rock's face not displaced."""
    x2: np.ndarray
    v1: np.ndarray
    v2: np.ndarray
    acceleration: np.ndarray
    """m/s^2, of the indenter."""
    force: np.ndarray
    """N, of the rock, positive in compression."""
    penetration: np.ndarray
    """m, Xf."""
    regime: np.ndarray
    """0 no contact, 1 loading, 2 unloading."""
    extra: np.ndarray
    """(samples, extra states) of the chosen effects, in the order chosen."""
    impacts: Impacts
    switches: Switches
    energy: Energy
    end: Start
    """The state at the end, to start another run from, with ``end_phase``."""
    end_phase: float
    """rad."""
    end_origin: float
    """m. The place that ``end.w`` is counted from."""
    steps: int
    """Steps taken."""


INWARD, OUTWARD = constants(LOADING, UNLOADING)
SAMPLE_COLUMNS = 8
"""x1, x2, v1, v2, acceleration, force, penetration, regime; the extra states follow."""
IMPACT_COLUMNS = 5
"""Time, peak force, speed at contact, depth, time of contact."""
SWITCH_COLUMNS = 3
"""Time, regime before, regime after."""


@njit(**ALLOCATING)
def longer(table: np.ndarray) -> np.ndarray:
    """The same rows in twice the room."""
    result = np.zeros((2 * table.shape[0], table.shape[1]))
    for i in range(table.shape[0]):
        for j in range(table.shape[1]):
            result[i, j] = table[i, j]
    return result


@njit(**INNER)
def depth_of_face(m: np.ndarray, d: np.ndarray, w: float) -> float:
    """Xf in m: where the indenter would leave the rock if it turned back now, less the face's displacement."""
    apart()
    ahead = 0.0
    if int(d[REGIME]) == LOADING:
        ahead = w - law_depth(m, d, OUTWARD, law_force(m, d, INWARD, w))
    return d[ORIGIN] + (d[CARRY] + ahead)


@njit(**INNER)
def write_sample(
    m: np.ndarray,
    d: np.ndarray,
    z: np.ndarray,
    dz: np.ndarray,
    rock: float,
    shift: float,
    extras: np.ndarray,
    row: np.ndarray,
) -> None:
    """One row of the samples, of a state ``shift`` s after its discrete state."""
    apart()
    x2 = d[ORIGIN] + (d[CARRY] + (z[W] + z[U]))
    row[0], row[1], row[2], row[3] = x2 + z[Y], x2, z[V1], z[V2]
    row[4], row[5], row[6], row[7] = dz[V2], max(rock, 0.0), depth_of_face(m, d, z[W]), d[REGIME]
    for i in range(extras.shape[0]):
        at = extras[i, 1]
        if extras[i, 0] == 0:
            row[SAMPLE_COLUMNS + i] = z[at]
        else:
            rate = m[extras[i, 2]] if extras[i, 2] >= 0 else 0.0
            row[SAMPLE_COLUMNS + i] = d[at] + rate * shift


@njit(cache=True, nogil=True, error_model="numpy")
def integrate(
    exact: bool,
    model: Model,
    d: np.ndarray,
    z: np.ndarray,
    begins: bool,
    seconds: float,
    rate: float,
    samples: np.ndarray,
    extras: np.ndarray,
    rtol: float,
    scratch: np.ndarray,
):
    """Run for ``seconds`` from the state (d, z), which is left at the end.

    Args:
        exact: Whether events and samples are steps of their own, see :func:`is_exact`.
        model, d, z: The model and the state.
        begins: Whether the motion does.
        seconds, rate: How long, and samples a second, the first now.
        samples: (samples, SAMPLE_COLUMNS + extras), filled.
        extras: (extras, 3) where extra states stand: 0 for z or 1 for d, the index, and the scalar that is its rate or
            -1.
        rtol: Relative error of a step.
        scratch: From ``make_scratch``.

    Returns:
        Status, time reached, impacts, switches, and the number of steps.
    """
    m = borrowed(model.flat)
    d, z, samples, scratch, extras = borrowed(d), borrowed(z), borrowed(samples), borrowed(scratch), borrowed(extras)
    impacts, switches = np.zeros((64, IMPACT_COLUMNS)), np.zeros((256, SWITCH_COLUMNS))
    impact_count, switch_count, sampled, steps, now = 0, 0, 0, 0, 0.0
    speed, since, owed = 0.0, 0.0, 0.0
    if begins:
        set_factor(m, d)
    rock = prepare(m, d, z, begins, scratch)
    if samples.shape[0] > 0:
        write_sample(m, d, z, scratch[BEGIN_SLOPE], rock, 0.0, extras, samples[0])
        sampled = 1
    status = WENT_ON
    while now < seconds:
        before = int(d[REGIME])
        left = seconds - now
        status, taken = advance(m, d, z, left, rtol, exact, scratch)
        if status != WENT_ON:
            break
        steps += 1
        # time is added up with the rounding that it owes (Kahan)
        part = taken + owed
        following = now + part
        owed = part - (following - now)
        if taken >= left:
            following = seconds
        while sampled < samples.shape[0] and sampled / rate <= following and taken > 0.0:
            shift = min(max(sampled / rate - now, 0.0), taken)
            rock = read_state(m, shift, exact, scratch)
            write_sample(
                m, scratch[BEGIN_D], scratch[SPARE], scratch[SPARE_SLOPE], rock, shift, extras, samples[sampled]
            )
            sampled += 1
        now = following
        after = int(d[REGIME])
        if after == before:
            continue
        if before == FREE:
            speed, since = z[V2] - z[UD], now
        if after == UNLOADING:
            if impact_count == impacts.shape[0]:
                impacts = longer(impacts)
            impact = impacts[impact_count]
            impact[0], impact[1], impact[2], impact[3], impact[4] = now, d[PEAK], speed, d[IMPACT_DEPTH], since
            impact_count += 1
        if switch_count == switches.shape[0]:
            switches = longer(switches)
        switches[switch_count, 0], switches[switch_count, 1], switches[switch_count, 2] = now, before, after
        switch_count += 1
    while status == WENT_ON and sampled < samples.shape[0]:
        # the last sample, where rounding puts it just behind the end
        rock = prepare(m, d, z, NO, scratch)
        write_sample(m, d, z, scratch[BEGIN_SLOPE], rock, 0.0, extras, samples[sampled])
        sampled += 1
    return status, now, impacts[:impact_count], switches[:switch_count], steps


def extras_table(effects: tuple[Chosen, ...]) -> np.ndarray:
    """What :func:`integrate` takes as ``extras``."""
    rows = [(which, at, RATES.get(at, -1) if which else -1) for which, at in extra_places(effects)]
    return np.array(rows, dtype=np.int64).reshape(-1, 3)


def run_hybrid(
    rig: Rig,
    setting: Setting,
    rock: Rock,
    seconds: float,
    sample_rate: float,
    phase: float = 0.0,
    start: Start | None = None,
    effects: Iterable[Chosen] = (),
    rtol: float = 1e-12,
) -> HybridRun:
    """Run the rig with any effects.

    Args:
        rig: The rig.
        setting: Frequency, amplitude and pressure.
        rock: The rock.
        seconds: Duration in s.
        sample_rate: Samples a second, the first at time 0; 0 for none.
        phase: Phase of the excitation at time 0 in rad.
        start: State at time 0. Left out, the rig starts fresh: at rest, the cylinder leaning on the spring, the
            indenter touching rock never hit before.
        effects: From :func:`drillenv.dynamics.effects.make`, each effect at most once.
        rtol: Relative error tolerated a step; from 1e-9 on events and samples are read off polynomials.

    Raises:
        InputError: a value out of range, a start that does not fit its regime, an effect that does not act on the
            motion or is given twice, or effects under which the motion cannot be followed.
    """
    seconds = number("seconds", seconds, 0.0, 1e6, "s")
    sample_rate = number("sample_rate", sample_rate, 0.0, 1e8, "Hz")
    phase = number("phase", phase, -1e6, 1e6, "rad") % TURN
    rtol = number("rtol", rtol, 1e-14, 1e-3)
    effects = tuple(effects)
    exact = is_exact(rtol)
    model = model_for(rig, setting, rock, effects)
    motion = motion_at(model, effects, start, phase)
    d, z = motion
    stored_before = _stored(model, z)
    count = math.floor(seconds * sample_rate * (1 + 1e-12)) + 1 if sample_rate > 0 else 0
    extras = extras_table(effects)
    samples = np.zeros((count, SAMPLE_COLUMNS + len(extras)))
    status, reached, impacts, switches, steps = integrate(
        exact, model, d, z, True, seconds, sample_rate, samples, extras, rtol, make_scratch(model)
    )
    check_status(status, reached)
    energies = z[model.tally :]
    columns = np.ascontiguousarray(samples.T)
    return HybridRun(
        np.arange(count) / sample_rate if count else np.zeros(0),
        *columns[:7],
        regime=columns[7].astype(np.int8),
        extra=samples[:, SAMPLE_COLUMNS:],
        impacts=Impacts(*np.ascontiguousarray(impacts.T)),
        switches=Switches(switches[:, 0].copy(), switches[:, 1].astype(np.int8), switches[:, 2].astype(np.int8)),
        energy=Energy(
            drive=float(energies[BY_DRIVE]),
            static=float(energies[BY_STATIC]),
            damper=float(energies[IN_DAMPER]),
            rock=float(energies[IN_ROCK]),
            effects=energies[BY_EFFECTS:].copy(),
            stored_before=stored_before,
            stored_after=_stored(model, z),
        ),
        end=start_at(motion, effects),
        end_phase=float(d[THETA]) % TURN,
        end_origin=float(d[ORIGIN] + d[CARRY]),
        steps=steps,
    )


def is_exact(rtol: float) -> bool:
    """Whether, at this relative error, events and samples are steps of their own: see ``READ_FROM``."""
    return rtol < READ_FROM


def check_status(status: int, reached: float) -> None:
    """Raise InputError where a motion could not be followed beyond ``reached`` s."""
    if status != WENT_ON:
        raise InputError(f"the motion {lost_by(status)} at {reached:g} s: make the effects weaker, or rtol larger")


def lost_by(status: int) -> str:
    """In words, how a motion went that could not be followed."""
    return "grew without bound" if status == STEPS_TOO_SHORT else "switched without end"


def _stored(model: Model, z: np.ndarray) -> float:
    """Energy of the masses and the spring in J."""
    s = model.s
    return float(0.5 * (s[M1] * z[V1] ** 2 + s[M2] * z[V2] ** 2 + s[K] * z[Y] ** 2))
