"""Plans of campaigns: at which settings to record a rig, so that a diagnosis tells most mechanisms apart.

:mod:`~drillenv.planning.information` says what a recording at a setting would say of each mechanism,
:mod:`~drillenv.planning.choice` chooses, and :mod:`~drillenv.planning.sheet` writes the sheet for the lab.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from drillenv.checks import InputError, count, number
from drillenv.diagnosis.drill import point_of
from drillenv.diagnosis.equations import scalars_of
from drillenv.diagnosis.sinusoids import FEWEST_CYCLES
from drillenv.dynamics.effects import REGISTRY, Chosen
from drillenv.dynamics.motion_hybrid import effects_meant
from drillenv.dynamics.sensors import PerChannel
from drillenv.planning.choice import FAINTEST, INSEPARABLE, Judge, Resolution, chosen_from, places_held_out
from drillenv.planning.information import Site, Survey, grid, survey
from drillenv.planning.signatures import parameters_at, planned_for, size_of, waves_of
from drillenv.recordings.document import DRILL, SAMPLE_RATE_LIMITS
from drillenv.recordings.made import NOISE, STEPS
from drillenv.rig import (
    AMPLITUDE_LIMITS,
    AMPLITUDE_RANGE,
    FREQUENCY_LIMITS,
    FREQUENCY_RANGE,
    PRESSURE_LIMITS,
    PRESSURE_RANGE,
    Rig,
    Setting,
)
from drillenv.rocks import Rock

BOX = (FREQUENCY_RANGE, AMPLITUDE_RANGE, PRESSURE_RANGE)
"""Hz, V and bar: the ranges that the paper explores."""
POINTS = (7, 3, 4)
"""Values of frequency, amplitude and pressure among which settings are chosen."""
EVERY_FRESH = 3
"""One of so many settings may be recorded from rest too."""
SETTINGS_LIMITS, SECONDS_LIMITS = (3, 24), (0.1, 10.0)
LENGTHS = (0.2, 0.4, 0.8)
"""s, of which a plan takes the shortest that resolves about as much as any."""
USUAL_LENGTH = 0.4
ABOUT_AS_MUCH = 0.02
"""Of the criterion: strengths larger by two hundredths in the mean."""
PURPOSES = 2
"""Mechanisms that are named for each recording."""
FINER = math.log(1.05)
"""Logarithm of the factor by which a recording lowers a smallest strength to be named for it."""


@dataclass(frozen=True, slots=True)
class PlannedRecording:
    """A recording to make."""

    name: str
    setting: Setting
    starts: str
    """``running``: for at least a second. ``fresh``: from rest, on rock never hit."""
    seconds: float
    sample_rate: float
    """Hz, at least."""
    purpose: str
    """What it is for."""


@dataclass(frozen=True, slots=True)
class Resolvable:
    """The smallest strength of a mechanism that is expected to be found."""

    mechanism: str
    share: float
    """Of a typical strength, where nothing else is missing; infinite where ten times as much is not found."""
    told: float
    """The same from where it is taken for no other mechanism."""
    rival: str
    """The mechanism that it is told from last."""
    parameters: dict[str, float]
    """By symbol, at the strength ``told``; empty where it is infinite, or where any strength is found."""
    units: dict[str, str]
    seconds: float
    """That a recording has to last for a diagnosis to look for it."""


@dataclass(frozen=True, slots=True)
class Plan:
    """Which recordings to make, and what they are expected to show."""

    rock: str
    recordings: tuple[PlannedRecording, ...]
    """In the order in which to make them."""
    mechanisms: tuple[Resolvable, ...]
    criterion: float
    """See :meth:`drillenv.planning.choice.Judge.value`."""
    candidates: int
    """Recordings among which they were chosen."""
    irregular: int
    """Recordings that were left aside, for their motion is not regular or never leaves the rock."""
    remarks: tuple[str, ...]

    def record(self) -> dict[str, Any]:
        """As JSON takes it, once what is infinite is null."""
        return asdict(self) | {"format": "drillenv-plan/1"}

    def text(self) -> str:
        """The sheet as Markdown."""
        from drillenv.planning.sheet import markdown

        return markdown(self)

    def csv(self) -> str:
        """The recordings as a table of comma-separated values."""
        from drillenv.planning.sheet import comma_separated

        return comma_separated(self)


def plan_campaign(
    rock: Rock,
    rig: Rig | None = None,
    effects: Iterable[Chosen] = (),
    settings: int = 8,
    seconds: float | None = None,
    sample_rate: float = 25600.0,
    box: Sequence[Sequence[float]] = BOX,
    noise: PerChannel = NOISE,
    seed: int = 0,
    note: Callable[[str], object] | None = None,
) -> Plan:
    """Propose the recordings that let a diagnosis tell most mechanisms apart.

    Maximised is the mean, over the mechanisms of the library, of the negative logarithms of the smallest strength that
    is found alone and of that from which it is taken for no other: a compound of D_s- and T-optimality, see
    :mod:`drillenv.planning.choice` for sources.

    Args:
        rock: Under the indenter, as believed.
        rig: As believed; by default that of Table 2.1. Constants are known to within the paper's tolerances.
        effects: What a model of the rig has on its motion already, from :func:`drillenv.dynamics.effects.make`.
        settings: How many recordings, 3 to 24.
        seconds: Of each, 0.1 to 10; None for the shortest that does.
        sample_rate: Samples a second.
        box: Lowest and highest frequency in Hz, amplitude in V and pressure in bar that the lab can set.
        noise: Standard deviations of white noise on the channels in V, N and m/s^2.
        seed: Of the typical parameters that are drawn.
        note: Told what is being done.

    Raises:
        InputError: a number outside its limits; an effect that follows a measured curve, or does not act on the motion;
            no setting of the box has a regular motion.
    """
    many = count("settings", settings, *SETTINGS_LIMITS)
    length = USUAL_LENGTH if seconds is None else number("seconds", seconds, *SECONDS_LIMITS, "s")
    rate = number("sample_rate", sample_rate, *SAMPLE_RATE_LIMITS[DRILL], "Hz")
    site = Site(rig or Rig(), rock, known_effects(effects), length, rate, seen_noise(noise))
    say = note or (lambda _text: None)
    every = grid(ranges_of(box), POINTS, [-round(math.log10(step)) for step in STEPS.values()])
    wanted = [(each, "running") for each in every] + [(each, "fresh") for each in every[::EVERY_FRESH]]
    found = survey(site, wanted, count("seed", seed, 0, 2**53), say)
    if len(found.candidates) < many:
        raise InputError(
            f"settings is {many}, and {len(found.candidates)} recordings of regular motions are to choose from: give "
            "fewer, or wider ranges"
        )
    order = chosen_from(found, Judge(found), many, say)
    wanted = [(found.candidates[i].setting, found.candidates[i].starts) for i in order]
    lengths = LENGTHS if seconds is None else (length,)
    site, last = with_length(site, wanted, lengths, seed)
    return stated(site, last, len(found.candidates), found.irregular)


def seen_noise(noise: PerChannel) -> PerChannel:
    """Noise that is there.

    Raises:
        InputError: none, or no number.
    """
    return PerChannel(*(number(f"noise on the {name}", std, 1e-9, 1e6) for name, std in noise._asdict().items()))


def ranges_of(box: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    """The ranges of a box.

    Raises:
        InputError: one that a setting does not have, or whose ends are the wrong way round.
    """
    found = []
    controls = zip(STEPS, (FREQUENCY_LIMITS, AMPLITUDE_LIMITS, PRESSURE_LIMITS), box, strict=True)
    for name, limits, (low, high) in controls:
        low, high = number(f"lowest {name}", low, *limits), number(f"highest {name}", high, *limits)
        if low > high:
            raise InputError(f"{name} goes from {low:g} to {high:g}: give the lowest first")
        found.append((low, high))
    return found


def known_effects(effects: Iterable[Chosen]) -> tuple[Chosen, ...]:
    """Effects of a model, as a plan takes them.

    Raises:
        InputError: one that follows a measured curve, or does not act on the motion.
    """
    chosen = effects_meant(effects)
    for each in chosen:
        if each.curve is not None or not each.effect.moves_rig:
            raise InputError(
                f"effect {each.effect.name} of the model follows no equation of the drilling rig's motion: "
                "plan without it"
            )
    return tuple(chosen)


def with_length(
    site: Site, wanted: Sequence[tuple[Setting, str]], lengths: Sequence[float], seed: int
) -> tuple[Site, Survey]:
    """The site with the shortest recordings that resolve about as much as any, and what these would say.

    Mechanisms are weighed anew over what the motions of these recordings visit.

    Raises:
        InputError: at no length can all of the recordings be followed to their ends.
    """
    surveys = {each: survey(replace(site, seconds=each), wanted, seed, lambda _text: None) for each in lengths}
    values = {
        each: Judge(found).value(range(len(wanted)))
        for each, found in surveys.items()
        if len(found.candidates) == len(wanted)
    }
    if not values:
        raise InputError(f"recordings of {lengths[-1]:g} s cannot all be followed to their ends: plan others")
    best = max(values.values())
    chosen = next(each for each in values if values[each] > best - ABOUT_AS_MUCH)
    return replace(site, seconds=chosen), surveys[chosen]


def stated(site: Site, found: Survey, candidates: int, irregular: int) -> Plan:
    """The plan of the recordings of a survey, in their order; ``candidates`` were to choose from."""
    judge, order = Judge(found), range(len(found.candidates))
    held = places_held_out(found, order)
    fitted = [i for i in order if i not in held]
    resolution = judge.resolution(fitted)
    recordings = []
    for i, each in enumerate(found.candidates):
        purpose = purpose_of(found, judge, order, i)
        if i in held:
            purpose += "; held out of the fit, to prove what is found"
        name = f"r{i + 1:02d}"
        recordings.append(PlannedRecording(name, each.setting, each.starts, site.seconds, site.sample_rate, purpose))
    mechanisms = tuple(resolvable(found, judge, resolution, each) for each in judge.mechanisms)
    skipped = [name for name, each in REGISTRY.items() if each.moves_rig and not planned_for(each)]
    remarks = [f"No plan is made for {', '.join(skipped)}, which state no law."] if skipped else []
    remarks += limit_remarks(judge, fitted) + slow_remarks(site, mechanisms)
    value = judge.value(fitted)
    return Plan(site.rock.name, tuple(recordings), mechanisms, value, candidates, irregular, tuple(remarks))


def limit_remarks(judge: Judge, fitted: Sequence[int]) -> list[str]:
    """What limits the strengths that are found."""
    if judge.needed(fitted) > judge.chance:
        return [
            "What limits the strengths is that no sensor is more linear than 0.05 % of what it reads, and not noise: "
            "longer recordings, or more at the same settings, would find little less."
        ]
    return ["What limits the strengths is noise: longer recordings would find less."]


def slow_remarks(site: Site, mechanisms: Sequence[Resolvable]) -> list[str]:
    """What is too slow for the recordings."""
    slow = [each for each in mechanisms if each.seconds > site.seconds]
    return [
        f"{each.mechanism} is looked for where a recording holds two of its turns: let one last {each.seconds:.1f} s."
        for each in slow
    ]


def purpose_of(found: Survey, judge: Judge, order: Sequence[int], i: int) -> str:
    """For which mechanisms a recording does most: those whose smallest strengths would be the larger without it."""
    own, without = judge.resolution(order), judge.resolution([each for each in order if each != i])
    gains = []
    for j, name in enumerate(judge.mechanisms):
        at = judge.of == j
        for sort in ("alone", "hardest"):
            now, then = getattr(own, sort)[at], getattr(without, sort)[at]
            gain = float(np.mean(np.log((FAINTEST + then) / (FAINTEST + now))))
            gains.append((gain, name, sort, rival_of(judge, without, j)))
    gains.sort(key=lambda each: -each[0])
    said: dict[str, str] = {}
    for gain, name, sort, rival in gains:
        if gain >= FINER or not said:
            said.setdefault(name, f"finds {name}" if sort == "alone" else f"tells {name} from {rival}")
    return ", ".join(list(said.values())[:PURPOSES])


def rival_of(judge: Judge, resolution: Resolution, j: int) -> str:
    """The mechanism that another is told from last."""
    against = np.mean(np.log(np.delete(resolution.against[judge.of == j], j, axis=1)), axis=0)
    return [each for i, each in enumerate(judge.mechanisms) if i != j][int(np.argmax(against))]


def resolvable(found: Survey, judge: Judge, resolution: Resolution, mechanism: str) -> Resolvable:
    """The smallest strength of a mechanism that is expected to be found, about the middle of what is typical of it."""
    j = judge.mechanisms.index(mechanism)
    at = int(np.flatnonzero(judge.of == j)[0])
    share, told = float(resolution.alone[at]), float(max(resolution.alone[at], resolution.hardest[at]))
    effect, signature = REGISTRY[mechanism], found.signatures[at]
    size = size_of(effect, found.axes, found.around, found.example[0], point_of(found.example[1]))
    parameters = parameters_at(signature, told, size) if told < INSEPARABLE else {}
    turns = [each[2] for each in waves_of(scalars_of(mechanism, signature.parameters))]
    return Resolvable(
        mechanism,
        share if share < INSEPARABLE else math.inf,
        told if told < INSEPARABLE else math.inf,
        rival_of(judge, resolution, j),
        parameters,
        {symbol: effect.parameter(symbol).unit for symbol in parameters},
        FEWEST_CYCLES * 2.0 * math.pi / min(turns) if turns else 0.0,
    )
