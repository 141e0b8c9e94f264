"""One control interval of a rig with effects beyond the paper's model: the rules of ``plant``, on the general engine.

As in :mod:`drillenv.env.plant` the pressure follows the valve and is held over each substep at its mean, and layers and
the indentations of a fresh face take effect while the indenter is off the rock. What differs is that the rig moves by
:func:`drillenv.dynamics.general.integrate`, in legs. A leg ends where the pressure changes, where the sampling for the
harmonics sets in, and where the rock changes. Whether it does is seen only when a leg has been run: the leg is then run
again, into the flight in which the change falls. An effect that reads ``Moment.time`` gets that since its leg began.

Two things may stiffen a fresh face, Table 2.2 and the effect ``rock-compaction``. Both act, one times the other, and a
new layer is a fresh face to both.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from drillenv.checks import InputError, shown
from drillenv.dynamics.borrow import borrowed
from drillenv.dynamics.effects import make
from drillenv.dynamics.exact import ORIGIN, REGIME, THETA, TURN, TURNS, set_phase, shift_origin
from drillenv.dynamics.flow import FREE, KERNEL, LOADING, STATIC, STIFFNESS, UNLOADING
from drillenv.dynamics.general import first_state, integrate, make_scratch, model_for
from drillenv.dynamics.general_equations import (
    FIRST,
    IN_ROCK,
    OWN,
    Model,
    W,
    bend,
    law_depth,
    law_force,
)
from drillenv.dynamics.general_runs import DONE, SAMPLE_COLUMNS, STEPS_TOO_SHORT
from drillenv.env.episodes import START
from drillenv.env.plant import (
    BLOWS,
    FACE_IMPACTS,
    FACES,
    FREQUENCY,
    HARMONICS,
    INTERVAL,
    LAG,
    LAYER,
    LAYER_END,
    LAYER_FACE,
    LAYER_KL,
    LAYER_KU,
    PRESSURE,
    S_CONTACT_TIME,
    S_CONTACTS,
    S_CYCLES,
    S_DRIVE,
    S_PENETRATION,
    S_ROCK,
    S_WAVES,
    SAMPLES,
    SETTLED,
    SUBSTEP,
    VALVE,
    VOLTAGE,
    WAVES,
    Plants,
    held_pressure,
    leave_rock,
    never_left,
    note_impact,
    set_layer,
    set_setting,
)
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

RTOL = 1e-9
"""Relative error tolerated a step. Peaks are then good to 1e-8 and better where the motion is not chaotic."""
SLACK = 1e-9
"""A sample this share of the spacing away from the border of a leg stands on it."""
SHORTEST_FLIGHT = 1e-9
"""s: a flight shorter than this is no time to change the rock in; the next one will do."""
PEAK_SAMPLES = 32
"""Samples of the piece of a loading that is searched for its largest force."""
_X1, _X2, _V2, _ACCELERATION, _FORCE, _FACE = 0, 1, 3, 4, 5, 6
"""Columns of a sample of the general engine."""
_TIME, _PEAK = 0, 1
"""Columns of an impact of the general engine."""
_BEFORE, _AFTER = 1, 2
"""Columns of a switch of the general engine, behind its time."""


def _waves() -> np.ndarray:
    """(2 SAMPLES, 2 HARMONICS) cosine and sine of each harmonic at the samples of two periods."""
    place = np.arange(2 * SAMPLES)
    table = np.empty((2 * SAMPLES, 2 * HARMONICS))
    for harmonic in range(HARMONICS):
        step = max(1, 2 * harmonic) * place
        table[:, 2 * harmonic] = WAVES[step % (2 * SAMPLES)]
        table[:, 2 * harmonic + 1] = WAVES[(step - SAMPLES // 2) % (2 * SAMPLES)]
    return table


_WAVES = _waves()
_NODES, _WEIGHTS = (part.copy() for part in np.polynomial.legendre.leggauss(32))


@njit(**KERNEL)
def sprung_depth(model: Model, regime: int, z: np.ndarray) -> float:
    """How far in m the indenter stands in front of Xf: the way the rock would spring back from here."""
    if regime == FREE:
        return 0.0
    return z[W] if regime == UNLOADING else law_depth(model, UNLOADING, law_force(model, LOADING, z[W], z), z)


@njit(**KERNEL)
def depth_at_force_of(model: Model, changed: Model, regime: int, z: np.ndarray) -> float:
    """Depth in m at which another rock resists as this one does now."""
    return law_depth(changed, regime, law_force(model, regime, z[W], z), z)


@njit(**KERNEL)
def sprung_energy(model: Model, regime: int, z: np.ndarray) -> float:
    """Energy in J that the rock law would give back from here, by Gauss' quadrature over the square root of depth."""
    depth = sprung_depth(model, regime, z)
    energy = 0.0
    for i in range(_NODES.size):
        s = 0.5 * (1.0 + _NODES[i])
        energy += _WEIGHTS[i] * s * bend(model, UNLOADING, depth * s * s, z)
    return model.ku * depth * energy


@njit(**KERNEL)
def find_cut(row, spare, rig, layers, memory, impacts, switches, reach: float) -> float:
    """Where a leg has to be cut for a change of the rock, in s from its start; -1 where it may stand.

    That is the middle of the flight in which the rock changes, or of one before it. A flight that goes on at the end of
    the leg needs no cut.

    Args:
        row: The model of the exact engine, which holds the stiffnesses in force.
        spare: Room for such a model.
        rig, layers, memory: Rows of the rig's Plants.
        impacts, switches: Of the leg, from the general engine.
        reach: The depth in m that Xf has not passed in the leg.
    """
    layer = int(memory[LAYER])
    passes = layer < layers.shape[0] - 1 and reach >= layers[layer, LAYER_END]
    young = layers[layer, LAYER_FACE] > 0.0 and memory[FACE_IMPACTS] <= FACES.shape[1] * memory[BLOWS]
    if not (passes or young):
        return -1.0
    later = memory.copy()
    flights, impact = 0, 0
    for k in range(switches.shape[0] - 1):
        if switches[k, _AFTER] != FREE or switches[k + 1, _TIME] - switches[k, _TIME] < SHORTEST_FLIGHT:
            continue
        flights += 1
        if young:
            while impact < impacts.shape[0] and impacts[impact, _TIME] <= switches[k, _TIME]:
                impact += 1
            later[FACE_IMPACTS] = memory[FACE_IMPACTS] + impact
            set_layer(spare, rig, layers, later)
            if spare[LOADING, STIFFNESS] != row[LOADING, STIFFNESS] or (
                spare[UNLOADING, STIFFNESS] != row[UNLOADING, STIFFNESS]
            ):
                return 0.5 * (switches[k, _TIME] + switches[k + 1, _TIME])
    if passes and flights > 0:
        # how deep the face lay in each flight is not known: halve the leg until it is
        wanted = flights // 2
        for k in range(switches.shape[0] - 1):
            if switches[k, _AFTER] == FREE and switches[k + 1, _TIME] - switches[k, _TIME] >= SHORTEST_FLIGHT:
                if wanted == 0:
                    return 0.5 * (switches[k, _TIME] + switches[k + 1, _TIME])
                wanted -= 1
    return -1.0


@njit(**KERNEL)
def enter_leg(plants: Plants, i: int, regime: int, z, leg, held: float, impacts, switches, sums, peaks):
    """Enter a leg that stands into the sums, the peaks and the row of its rig, and change the rock if it is left.

    Args:
        plants, i: The rig.
        regime, z: Regime and state vector of the general engine at the leg's end.
        leg: (5,) start of the leg in s since the start of the interval, its length in s, what the origin moved by in m
            as a sum of two numbers, and the phase at the end in rad.
        held: Pressure held in bar.
        impacts, switches: Of the leg, from the general engine.
        sums, peaks: As in ``plant.drill``.
    """
    model, state = borrowed(plants.models)[i], borrowed(plants.states)[i]
    rig, layers, memory = borrowed(plants.rigs)[i], borrowed(plants.layers)[i], borrowed(plants.memories)[i]
    start, seconds, theta = leg[0], leg[1], leg[4]
    for k in range(impacts.shape[0]):
        note_impact(impacts[k, _PEAK], (start + impacts[k, _TIME]) * memory[FREQUENCY], sums, peaks)
        memory[FACE_IMPACTS] += 1.0
    since, touching = 0.0, state[REGIME] != FREE
    for k in range(switches.shape[0]):
        if switches[k, _BEFORE] == FREE:
            sums[S_CONTACTS] += 1.0
            since, touching = switches[k, _TIME], True
        elif switches[k, _AFTER] == FREE:
            sums[S_CONTACT_TIME] += switches[k, _TIME] - since
            touching = False
    if touching:
        sums[S_CONTACT_TIME] += seconds - since
    # the engine has taken off whole turns, as many as it takes to come out at this phase
    state[TURNS] += round((state[THETA] + TURN * memory[FREQUENCY] * seconds - theta) / TURN)
    while theta >= TURN:
        theta -= TURN
        state[TURNS] += 1.0
    set_phase(theta, state)
    shift_origin(state, leg[2])
    shift_origin(state, leg[3])
    # both engines begin a state with y, v1, v2 and w
    state[:4] = z[:4]
    state[REGIME] = regime
    if regime == FREE and leave_rock(model, state, rig, layers, memory):
        set_layer(model, rig, layers, memory)
        set_setting(model, rig, memory[FREQUENCY], memory[VOLTAGE], held)


@dataclass(frozen=True, slots=True)
class GeneralSnapshot:
    """What a rig on the general engine keeps beside its row of Plants. Copies and pickles."""

    effects: Mapping[str, Mapping[str, Any]]
    z: np.ndarray
    peak: float


class GeneralPlant:
    """A rig with effects beyond the paper's model.

    Args:
        plants, i: The rig's row, just put at rest by :func:`drillenv.env.plant.place`.
        effects: Names of effects, with the values of their parameters by symbol.

    Raises:
        InputError: an effect that the registry does not have, or that does not act on the motion.
    """

    def __init__(self, plants: Plants, i: int, effects: Mapping[str, Mapping[str, Any]]):
        self._prepare(plants, i, effects)
        model, order = self.model_at(START)
        self.z, _regime = first_state(model, None, self.chosen, order)
        self.z[:4] = plants.states[i, :4]
        self.peak = 0.0
        """Largest force in N so far of a loading that has not come to its turn, where the force may peak before it."""

    def _prepare(self, plants: Plants, i: int, effects: Mapping[str, Mapping[str, Any]]) -> None:
        self.plants, self.i = plants, i
        self.effects = {name: dict(values) for name, values in effects.items()}
        self.chosen = tuple(make(name, **values) for name, values in self.effects.items())
        self.rig = Rig(*plants.rigs[i].tolist())

    @classmethod
    def restored(cls, plants: Plants, i: int, snapshot: GeneralSnapshot) -> GeneralPlant:
        """The rig as it was when the snapshot was taken; its row of plants has been put back already."""
        self = cls.__new__(cls)
        self._prepare(plants, i, snapshot.effects)
        self.z, self.peak = snapshot.z.copy(), snapshot.peak
        return self

    def snapshot(self) -> GeneralSnapshot:
        """What to go on from exactly, together with the rig's row of plants."""
        return GeneralSnapshot(self.effects, self.z.copy(), self.peak)

    def __getstate__(self) -> dict[str, Any]:
        return {"plants": self.plants, "i": self.i, "kept": self.snapshot()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(GeneralPlant.restored(state["plants"], state["i"], state["kept"]).__dict__)

    def model_at(self, setting: Setting) -> tuple[Model, np.ndarray]:
        """The model of the general engine at a setting, on the present face, and the order of the effects in it."""
        layer = self.plants.layers[self.i, int(self.plants.memories[self.i, LAYER])]
        model, order = model_for(self.rig, setting, Rock(layer[LAYER_KL], layer[LAYER_KU]), self.chosen)
        return on_rock(model, self.plants.models[self.i]), order

    def drill(self, setting: np.ndarray, sums: np.ndarray, peaks: np.ndarray, window: np.ndarray) -> None:
        """Run the rig for one interval at a setting (3,) in Hz, V and bar.

        Fills ``sums``, ``peaks`` and ``window`` and moves the rig's row of plants on, as
        :func:`drillenv.env.plant.drill` does.

        Raises:
            InputError: effects under which the motion cannot be followed. The rig then has to be put at rest anew.
        """
        frequency, amplitude, valve = setting.tolist()
        memory = self.plants.memories[self.i]
        memory[FREQUENCY], memory[VOLTAGE], memory[VALVE] = frequency, amplitude, valve
        sums[:] = 0.0
        _Interval(self, Setting(frequency, amplitude, valve), sums, peaks, window).run()


def on_rock(model: Model, row: np.ndarray) -> Model:
    """The model with the stiffnesses that stand in a model of the exact engine."""
    return model._replace(kl=float(row[LOADING, STIFFNESS]), ku=float(row[UNLOADING, STIFFNESS]))


class _Interval:
    """One interval of one rig while it runs."""

    def __init__(self, rig: GeneralPlant, setting: Setting, sums: np.ndarray, peaks: np.ndarray, window: np.ndarray):
        self.rig, self.sums, self.peaks, self.window = rig, sums, peaks, window
        self.z = rig.z
        plants, i = rig.plants, rig.i
        self.row, self.state, self.memory = plants.models[i], plants.states[i], plants.memories[i]
        self.constants, self.layers = plants.rigs[i], plants.layers[i]
        self.model, self.order = rig.model_at(setting)
        self.z[self.model.tally :] = 0.0
        self.scratch = make_scratch(self.z.size, len(rig.chosen))
        self.spare = np.empty_like(self.row)
        self.setting = setting
        # as in plant.drill: an even number of whole periods, up to the end of the interval
        cycles = 2 * int(0.5 * INTERVAL * setting.frequency)
        self.rate = setting.frequency * SAMPLES
        self.first = INTERVAL - cycles / setting.frequency
        self.rows = np.empty((cycles * SAMPLES, SAMPLE_COLUMNS + self.model.tally - OWN))
        self.held = 0.0

    def run(self) -> None:
        """Run it through."""
        state, memory, setting = self.state, self.memory, self.setting
        begin_theta = float(state[THETA])
        depth_before, sprung_before = self._face(), self._sprung()
        steps = round(INTERVAL / SUBSTEP)
        step, now = 0, 0.0
        while step < steps:
            pressure, valve = memory[PRESSURE], setting.pressure
            if abs(pressure - valve) <= SETTLED:
                step, self.held, memory[PRESSURE] = steps, valve, valve
            else:
                step += 1
                self.held, memory[PRESSURE] = held_pressure(pressure, valve, memory[LAG], SUBSTEP)
            end = INTERVAL if step == steps else step * SUBSTEP
            set_setting(self.row, self.constants, setting.frequency, setting.amplitude, self.held)
            self.model = self.model._replace(static=float(self.row[0, STATIC]))
            while now < end:
                now = self._leg(now, end)
        sums = self.sums
        sums[S_PENETRATION] = self._face() - depth_before
        sums[S_CYCLES] = INTERVAL * setting.frequency
        sums[S_ROCK] = self.z[self.model.tally + IN_ROCK] - (self._sprung() - sprung_before)
        self._harmonics(begin_theta)
        if never_left(state, sums):
            self._change_under_load()

    def _change_under_load(self) -> None:
        """As ``plant.change_under_load``, with the rock law as the effects bend it."""
        regime, layer = int(self.state[REGIME]), self.memory[LAYER]
        if not leave_rock(self.row, self.state, self.constants, self.layers, self.memory):
            return
        set_layer(self.row, self.constants, self.layers, self.memory)
        setting = self.setting
        set_setting(self.row, self.constants, setting.frequency, setting.amplitude, self.memory[PRESSURE])
        changed = on_rock(self.model, self.row)
        place = depth_at_force_of(self.model, changed, regime, self.z)
        shift_origin(self.state, self.z[W] - place)
        self.z[W] = self.state[3] = place
        self.model = changed
        if self.memory[LAYER] != layer:
            self._refresh_face()

    def _face(self) -> float:
        """Xf in m."""
        state = self.state
        regime = int(state[REGIME])
        ahead = self.z[W] - sprung_depth(self.model, regime, self.z) if regime == LOADING else 0.0
        return state[ORIGIN] + ahead

    def _sprung(self) -> float:
        """Energy in J that the rock would give back from here."""
        return sprung_energy(self.model, int(self.state[REGIME]), self.z)

    def _harmonics(self, begin_theta: float) -> None:
        """Work of the drive and harmonics of the acceleration, from the samples."""
        rows, sums = self.rows, self.sums
        theta = begin_theta + self.model.omega * (self.first + np.arange(len(rows)) / self.rate)
        sums[S_DRIVE] = INTERVAL * self.model.drive * np.mean(np.sin(theta) * rows[:, _V2])
        folded = rows[:, _ACCELERATION].reshape(-1, 2 * SAMPLES).sum(axis=0)
        sums[S_WAVES:] = 2.0 / len(rows) * (folded @ _WAVES)

    def _samples_before(self, time: float) -> int:
        """How many samples lie before a time in s."""
        return max(0, math.ceil((time - self.first) * self.rate - SLACK))

    def _leg(self, now: float, end: float) -> float:
        """Run from ``now`` on, to the next sample, to where the rock changes or to ``end``. Returns where, in s."""
        start = self.z.copy()
        regime, theta, layer = int(self.state[REGIME]), float(self.state[THETA]), self.memory[LAYER]
        index = self._samples_before(now)
        until = self.first + index / self.rate
        if not (index < len(self.rows) and now + SLACK / self.rate < until < end):
            until = end
        cut = 0.0
        while cut >= 0.0:
            samples = self.rows[index : self._samples_before(until)]
            after, origin, carry, phase, impacts, switches = self._go(
                theta, self.z, regime, until - now, self.rate, samples
            )
            reach = self.state[ORIGIN] + origin + carry + (self.z[W] if after == LOADING else 0.0)
            cut = find_cut(self.row, self.spare, self.constants, self.layers, self.memory, impacts, switches, reach)
            if cut >= 0.0:
                until = now + cut
                self.z[:] = start
        if len(self.window):
            self._watch(now, until, start, regime, theta)
        self._carry_peak(start, regime, theta, until - now, after, impacts, switches)
        leg = (now, until - now, origin, carry, phase)
        rig = self.rig
        enter_leg(rig.plants, rig.i, after, self.z, leg, self.held, impacts, switches, self.sums, self.peaks)
        if self.memory[LAYER] != layer:
            self._refresh_face()
        if self.row[LOADING, STIFFNESS] != self.model.kl or self.row[UNLOADING, STIFFNESS] != self.model.ku:
            self.model = on_rock(self.model, self.row)
        return until

    def _go(self, theta: float, z: np.ndarray, regime: int, seconds: float, rate: float, samples: np.ndarray):
        """Run ``z`` on. Returns regime, movement of the origin as a sum of two, phase, impacts and switches."""
        status, _reached, *rest = integrate(self.model, theta, z, regime, seconds, rate, samples, RTOL, self.scratch)
        if status != DONE:
            why = "grew without bound" if status == STEPS_TOO_SHORT else "switched without end"
            raise InputError(
                f"the motion {why} with the effects {shown(self.rig.effects)} at {self.setting}: make them weaker"
            )
        return rest[:6]

    def _carry_peak(self, start, regime: int, theta: float, seconds: float, after: int, impacts, switches) -> None:
        """Keep the largest force of a loading that the end of a leg cuts in two, for the turn it comes to."""
        rig = self.rig
        if not self.model.rated:
            return
        if regime == LOADING and len(switches):
            if len(impacts):
                impacts[0, _PEAK] = max(impacts[0, _PEAK], rig.peak)
            rig.peak = 0.0
        if after != LOADING:
            rig.peak = 0.0
            return
        begun = switches[-1, _TIME] if len(switches) else 0.0
        if begun >= seconds:
            return
        z, samples = start.copy(), np.empty((PEAK_SAMPLES + 1, self.rows.shape[1]))
        if begun > 0.0:
            regime, _origin, _carry, theta, *_ = self._go(theta, z, regime, begun, 1.0, samples[:0])
        self._go(theta, z, regime, seconds - begun, PEAK_SAMPLES / (seconds - begun), samples)
        rig.peak = max(rig.peak, highest(samples[:, _FORCE]))

    def _watch(self, now: float, until: float, start: np.ndarray, regime: int, theta: float) -> None:
        """Fill the rows of the window that lie behind ``now`` and up to ``until``, by a run of their own."""
        window, memory = self.window, self.memory
        rate = len(window) / INTERVAL
        column, last = (int(time * rate * (1.0 + 1e-12)) for time in (now, until))
        if column == last:
            return
        z, origin, carry = start.copy(), 0.0, 0.0
        ahead = max(0.0, (column + 1) / rate - now)
        samples = np.empty((last - column, self.rows.shape[1]))
        if ahead > 0.0:
            regime, origin, carry, theta, *_ = self._go(theta, z, regime, ahead, 1.0, samples[:0])
        self._go(theta, z, regime, max(0.0, until - now - ahead), rate, samples)
        rows = window[column:last]
        origin += self.state[ORIGIN] + carry
        rows[:, 0] = memory[VOLTAGE] * np.sin(theta + self.model.omega / rate * np.arange(len(rows)))
        rows[:, 1] = samples[:, _FORCE]
        rows[:, 2] = samples[:, _ACCELERATION]
        rows[:, 3] = memory[PRESSURE]
        rows[:, 4] = origin + samples[:, _X1]
        rows[:, 5] = origin + samples[:, _X2]
        rows[:, 6] = samples[:, _V2]
        rows[:, 7] = origin + samples[:, _FACE]

    def _refresh_face(self) -> None:
        """Let the effects that remember the face begin anew: the indenter has come to another layer."""
        for row, k in zip(self.model.effects, self.order, strict=True):
            effect = self.rig.chosen[k].effect
            if effect.counted is not None:
                self.z[row[FIRST] : row[FIRST] + len(effect.extras)] = 0.0


def highest(forces: np.ndarray) -> float:
    """The largest of evenly sampled forces, by the parabola through the three highest where it lies between them."""
    k = int(np.argmax(forces))
    if not 0 < k < len(forces) - 1:
        return float(forces[k])
    left, right = forces[k] - forces[k - 1], forces[k] - forces[k + 1]
    bend = left + right
    return float(forces[k] + (0.125 * (left - right) ** 2 / bend if bend > 0.0 else 0.0))
