"""Campaigns of the concealed rig and the answers to them, drawn from a seed."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drillenv.blind import curves, sensors
from drillenv.blind.laws import RATTLE
from drillenv.blind.mechanisms import (
    MECHANISMS,
    MENDED_GAPS,
    OUTSIDE,
    Concealed,
    Site,
    concealed,
    kernel_parameters,
)
from drillenv.blind.rig import (
    DENSE_RATE,
    DRIVE_AT_ZERO,
    DRIVE_PER_HERTZ,
    PUSH_PER_BAR,
    Constants,
    Controls,
    Motion,
    Physics,
    move,
)
from drillenv.recordings import Campaign, Channel, Nominal, Recording
from drillenv.rig import Setting

# Table 2.1 and the tolerances with which a lab knows it; Table 2.2, means in N/m. Typed in again.
RIG_STATED = {
    "shaker_mass": (265.0, 1.0, "kg"),
    "indenter_mass": (3.0, 0.01, "kg"),
    "stiffness": (68.85e3, 2000.0, "N/m"),
    "damping": (2.45e3, 75.0, "N*s/m"),
    "drive_gain": (1.0, 0.015, "1"),
    "pressure_gain": (1.0, 0.02, "1"),
}
ROCKS_STATED = {
    1: (12.07e6, 13.70e6),
    2: (11.82e6, 13.90e6),
    3: (11.72e6, 13.41e6),
    4: (21.40e6, 25.05e6),
    5: (32.73e6, 40.64e6),
    6: (22.03e6, 27.14e6),
}
ROCK_TOLERANCE = (0.03, 0.04)
"""Standard deviation of k_l and k_u, as shares."""
MISJUDGED = 1.5
"""Factor by which a stated tolerance is too large or too small, at most."""
BOX = ((52.0, 120.0), (0.3, 0.6), (0.6, 1.4))
"""Hz, V and bar between which settings lie."""
NOISE = (0.002, 5.0, 2.0)
"""V, N and m/s^2."""
FRESH = (1, 4)
"""Which recordings are of rock never hit before."""
WARM = 0.1
"""s before a recording for which transducers are followed too."""
LABELS = 0.01
"""Share by which amplitude and pressure are off their labels, at most, in campaigns with bad labels."""

GROUPS = {
    "null": 6,
    "wrong-constant": 4,
    "library-equation": 7,
    "other-equation": 11,
    "weak-third": 4,
    "weak-tenth": 2,
    "two": 6,
    "three": 3,
    "beside-wrong-constant": 4,
    "absorbed": 4,
    "outside": 5,
    "noisy": 2,
    "slow": 2,
}
"""Groups of campaigns, and how many of each 60 are of each."""
STRENGTHS = (1.0, 0.5, 0.25, 0.12, 0.06, 0.03)
"""Shares of the full strength at which a detection curve is measured."""


class Conditions(NamedTuple):
    """How a campaign is recorded."""

    case: int
    seconds: float
    logger: sensors.Logger
    bad_labels: bool
    gaps: bool


@dataclass(frozen=True)
class Made:
    """A campaign and the answer to it."""

    campaign: Campaign
    answer: Mapping[str, Any]
    true: NamedTuple
    """The constants of the rig that was recorded, in SI."""
    hidden: tuple[Concealed, ...]


class _Recorded(NamedTuple):
    """One recording, the motion behind it, and by how much its channels misreport."""

    recording: Recording
    motion: Motion
    misread: sensors.Signals
    """Root mean square of what the transducers add to each channel, as arrays of one number."""
    realised: tuple[Mapping[str, float], ...]
    """Of each concealed mechanism the parameters that were drawn anew for this recording."""


def schedule(campaigns: int, groups: Mapping[str, int] = GROUPS) -> list[str]:
    """The groups of so many campaigns, in the given shares; at least one of each where there is room."""
    total = sum(groups.values())
    exact = {name: campaigns * share / total for name, share in groups.items()}
    count = {name: int(value) for name, value in exact.items()}
    if campaigns >= len(groups):
        count = {name: max(1, value) for name, value in count.items()}
    order = sorted(groups, key=lambda name: count[name] - exact[name])
    while sum(count.values()) < campaigns:
        for name in order[: campaigns - sum(count.values())]:
            count[name] += 1
    while sum(count.values()) > campaigns:
        # a group of one is kept
        count[max(count, key=lambda name: (count[name] > 1, count[name] - exact[name]))] -= 1
    return [name for name in groups for _ in range(count[name])]


class Planned(NamedTuple):
    """What a campaign is to conceal."""

    group: str
    cards: list[tuple[str, int]]
    """Mechanisms, and the index of the equation that each follows."""
    share: float | None = None
    """Of the full strength; that of the group where None."""


Card = tuple[str, int]
"""A mechanism, and the index of the equation that it follows."""


def deal(rng: np.random.Generator, decks: dict[str, list[Card]], name: str, cards: Sequence[Card]) -> Card:
    """The next card of a deck; one that is empty is shuffled anew from ``cards``."""
    if not decks.get(name):
        decks[name] = [cards[i] for i in rng.permutation(len(cards))]
    return decks[name].pop()


def plan(seed: int, campaigns: int) -> list[Planned]:
    """For each campaign its group and the mechanisms with the equations that it conceals, dealt from shuffled decks.

    So that few campaigns cover many mechanisms, each deck is dealt to its end before it is shuffled again.
    """
    rng = np.random.default_rng((seed, 0))
    decks: dict[str, list[Card]] = {}

    def dealt_from(deck: str) -> Card:
        return deal(rng, decks, deck, _deck(deck))

    def differing(names: Sequence[str]) -> list[Card]:
        while True:
            dealt = [dealt_from(each) for each in names]
            if len({name for name, _ in dealt}) == len(dealt):
                return dealt

    planned = []
    for group in schedule(campaigns):
        if group in ("null", "wrong-constant"):
            dealt: list[Card] = []
        elif group in ("two", "three"):
            # in half of them the second follows another equation than the library's
            second = "other" if rng.random() < 0.5 else "library"
            dealt = differing(["library", second, "library"][: 2 if group == "two" else 3])
        elif group == "other-equation":
            dealt = [dealt_from("other")]
        elif group == "outside":
            dealt = [dealt_from("outside")]
        elif group == "absorbed":
            dealt = [dealt_from("forces")]
        else:
            dealt = [dealt_from("library" if group == "library-equation" else "any")]
        planned.append(Planned(group, dealt))
    return planned


def plan_nulls(seed: int, campaigns: int) -> list[Planned]:
    """For each campaign its group: by turns one in which nothing is wrong, and one in which a constant is."""
    return [Planned(("null", "wrong-constant")[i % 2], []) for i in range(campaigns)]


def plan_curves(seed: int, repeats: int) -> list[Planned]:
    """For each mechanism and strength so many campaigns, of one equation after the other in a shuffled order."""
    rng = np.random.default_rng((seed, 0))
    planned = []
    for name, mechanism in MECHANISMS.items():
        order = rng.permutation(len(mechanism.equations))
        for share in STRENGTHS:
            for i in range(repeats):
                planned.append(Planned("curve", [(name, int(order[i % order.size]))], share))
    return planned


def _deck(name: str) -> list[tuple[str, int]]:
    """The cards of a deck: mechanisms with the index of an equation."""
    if name == "outside":
        listed = [(key, i) for key, each in OUTSIDE.items() for i in range(len(each.equations))]
        return [*listed, (MENDED_GAPS, 0)]
    cards = [(key, i) for key, each in MECHANISMS.items() for i in range(len(each.equations))]

    def has(card: tuple[str, int]) -> bool:
        equation = MECHANISMS[card[0]].equations[card[1]]
        if name == "library":
            return equation.of_library
        if name == "other":
            return not equation.of_library
        if name == "forces":
            return equation.place is not None
        return True

    return [card for card in cards if has(card)]


def make_campaign(seed: int, index: int, planned: Planned) -> Made:
    """Draw and record one campaign of a trial.

    Args:
        seed, index: Of the trial, and of the campaign in it; together they give all randomness.
        planned: What it conceals.
    """
    group, cards, share = planned
    rng = np.random.default_rng((seed, 1, index))
    conditions = draw_conditions(rng, group, gaps=any(name == MENDED_GAPS for name, _ in cards))
    if share is None:
        share = {"weak-third": 1 / 3, "weak-tenth": 0.1}.get(group, 1.0)
    wrong = _wrong_constant(rng) if group in ("wrong-constant", "beside-wrong-constant") else {}
    settings = draw_settings(rng, 8)
    site = _site(settings)
    hidden = tuple(
        concealed(*_found(name, i), rng=rng, share=share, site=site) for name, i in cards if name != MENDED_GAPS
    )
    made = record_campaign(rng, conditions, hidden, settings, wrong, f"campaign {index + 1}", group)
    return replace(made, answer={**made.answer, "share": share}) if group == "curve" else made


def plain_campaign(
    rng: np.random.Generator,
    case: int = 4,
    hidden: Sequence[Concealed] = (),
    wrong: Mapping[str, float] | None = None,
    recordings: int = 8,
    seconds: float = 0.5,
    rate: float = 25600.0,
    noise: tuple[float, float, float] = NOISE,
) -> Made:
    """A campaign under good conditions: white noise, right labels and clock, no anti-alias filter.

    Args:
        rng: All randomness comes from it.
        case: Rock and indenter, 1 to 6 of Table 2.2.
        hidden: What is concealed, from :func:`drillenv.blind.mechanisms.of_library` or the catalogue.
        wrong: Constants that the lab has wrong, and by how many tolerances.
        recordings: At least 2; the second and the fifth are of fresh rock.
        seconds: Of each recording.
        rate: Samples a second.
        noise: Standard deviations in V, N and m/s^2.
    """
    logger = sensors.Logger(rate, 0.0, "none", 0.4, 24, noise, "white")
    conditions = Conditions(case, seconds, logger, False, False)
    settings = draw_settings(rng, recordings)
    return record_campaign(rng, conditions, hidden, settings, dict(wrong or {}), f"case {case}", "plain")


def _found(name: str, i: int):
    mechanism = OUTSIDE[name] if name in OUTSIDE else MECHANISMS[name]
    return mechanism.name, mechanism.equations[i]


def _site(settings: Sequence[Setting]) -> Site:
    forces = [(DRIVE_PER_HERTZ * each.frequency + DRIVE_AT_ZERO) * each.amplitude for each in settings]
    return Site(max(forces), max(each.frequency for each in settings))


def draw_conditions(rng: np.random.Generator, group: str, gaps: bool = False) -> Conditions:
    """How a campaign of this group is recorded."""
    rate = float(rng.choice([8000.0, 10000.0] if group == "slow" else [12800.0, 25600.0, 25600.0, 25600.0, 51200.0]))
    louder = (5.0 if group == "noisy" else 1.0) * float(np.exp(rng.uniform(-0.4, 0.4)))
    logger = sensors.Logger(
        rate=rate,
        clock_error=float(rng.uniform(-50e-6, 50e-6)),
        anti_alias=str(rng.choice(["none", "butterworth", "linear-phase"])),
        corner=float(rng.uniform(0.38, 0.45)),
        bits=int(rng.choice([12, 16, 16])),
        noise=(louder * NOISE[0], louder * NOISE[1], louder * NOISE[2]),
        colour=str(rng.choice(["white", "pink", "lines"])),
    )
    return Conditions(
        case=int(rng.integers(1, 7)),
        seconds=round(float(rng.uniform(0.4, 0.6)), 2),
        logger=logger,
        bad_labels=bool(rng.random() < 0.5),
        gaps=gaps,
    )


def draw_settings(rng: np.random.Generator, recordings: int) -> list[Setting]:
    """Settings spread over the box: a Latin hypercube, to the digits that a lab writes down."""
    columns = []
    for (low, high), digits in zip(BOX, (1, 3, 2), strict=True):
        places = (rng.permutation(recordings) + rng.uniform(0.0, 1.0, recordings)) / recordings
        columns.append([round(float(each), digits) for each in low + (high - low) * places])
    return [Setting(*each) for each in zip(*columns, strict=True)]


def _wrong_constant(rng: np.random.Generator) -> dict[str, float]:
    """One constant, and by how many of its tolerances it is wrong."""
    name = str(rng.choice([*RIG_STATED, "loading_stiffness", "unloading_stiffness"]))
    # rock that is softer on the way out than on the way in would give energy away
    sign = {"unloading_stiffness": 1.0, "loading_stiffness": -1.0}.get(name, float(rng.choice([-1.0, 1.0])))
    return {name: sign * float(rng.uniform(6.0, 10.0))}


def draw_constants(
    rng: np.random.Generator, case: int, wrong: Mapping[str, float]
) -> tuple[dict[str, Nominal], Constants]:
    """What the lab states, and what is true: unclipped, and of tolerances that the lab has misjudged."""
    table = dict(RIG_STATED)
    for name, mean, share in zip(
        ("loading_stiffness", "unloading_stiffness"), ROCKS_STATED[case], ROCK_TOLERANCE, strict=True
    ):
        table[name] = (mean, share * mean, "N/m")
    spread = math.log(MISJUDGED)
    stated = {
        name: Nominal(value, std * math.exp(rng.uniform(-spread, spread)), unit)
        for name, (value, std, unit) in table.items()
    }
    while True:
        true = {
            name: value + std * (float(rng.normal()) + wrong.get(name, 0.0)) for name, (value, std, _) in table.items()
        }
        if true["unloading_stiffness"] > 1.01 * true["loading_stiffness"]:
            return stated, Constants(**true)


def record_campaign(
    rng: np.random.Generator,
    conditions: Conditions,
    hidden: Sequence[Concealed],
    settings: Sequence[Setting],
    wrong: Mapping[str, float],
    title: str,
    group: str,
    fresh: Collection[int] = FRESH,
) -> Made:
    """Record a campaign of a rig that conceals ``hidden``, and write down the answer.

    Args:
        rng: For constants, labels, phases and noise.
        conditions, settings, hidden: As drawn.
        wrong: Constants that the lab has wrong, and by how many tolerances.
        title: Of the campaign.
        group: What the answer is marked as.
        fresh: Which recordings are of rock never hit before.
    """
    stated, true = draw_constants(rng, conditions.case, wrong)
    made = [
        _record(rng, conditions, hidden, setting, true, f"r{i + 1:02d}", i in fresh)
        for i, setting in enumerate(settings)
    ]
    if conditions.gaps:
        made = _with_gaps(rng, made)
    if group == "absorbed":
        stated = _absorbing(stated, true, [each.motion for each in made], settings)
    campaign = Campaign(title, "percussive-drill", stated, tuple(each.recording for each in made), Path("."))
    return Made(campaign, _answer(conditions, hidden, settings, wrong, true, made, group), true, tuple(hidden))


def physics_of(hidden: Sequence[Concealed], true: Constants, controls: Controls, rng: np.random.Generator) -> Physics:
    """What the integrator is told in one recording."""
    physics = Physics.none()
    for each in hidden:
        place = each.equation.place
        if place is None:
            continue
        values = kernel_parameters(each, true, controls)
        physics.codes[place] = each.equation.code
        physics.parameters[place, : len(values)] = values
        if place == RATTLE:
            apart = rng.exponential(values[3], 200)
            physics = physics._replace(rattles=np.cumsum(apart) - 2.0)
    return physics._replace(chances=rng.uniform(0.0, 1.0, 1000))


def _record(rng, conditions, hidden, setting, true, name, fresh) -> _Recorded:
    """One recording."""
    logger = conditions.logger
    off = rng.uniform(-LABELS, LABELS, 2) if conditions.bad_labels else np.zeros(2)
    controls = Controls(setting.frequency, setting.amplitude * (1.0 + off[0]), setting.pressure * (1.0 + off[1]))
    every = math.ceil(DENSE_RATE / logger.rate)
    step = 1.0 / (logger.rate * (1.0 + logger.clock_error) * every)
    warm = 0 if fresh else round(WARM / step)
    phase, lead = (0.0, 0.0) if fresh else (float(rng.uniform(0.0, 2.0 * math.pi)), float(rng.uniform(1.0, 1.6)))
    motion = move(
        true,
        controls,
        physics_of(hidden, true, controls, rng),
        conditions.seconds + warm * step,
        step,
        phase - 2.0 * math.pi * controls.frequency * warm * step,
        max(lead - warm * step, 0.0),
    )
    time = motion.time - warm * step
    clean = sensors.Signals(controls.amplitude * np.sin(motion.theta), motion.rock, motion.acceleration)
    read, realised = clean, []
    for each in hidden:
        scene = sensors.Scene(1.0 / step, time, motion.regime > 0, fresh, rng, {})
        if each.equation.transducer is not None:
            read = each.equation.transducer(read, scene, each.parameters)
        realised.append(scene.realised)
    written = sensors.log_signals(read, step, warm, every, logger, rng)
    misread = sensors.Signals(
        *(np.sqrt(np.mean((a[warm:] - b[warm:]) ** 2, keepdims=True)) for a, b in zip(read, clean, strict=True))
    )
    channels = {
        "excitation": Channel(written.excitation, "V", "excitation"),
        "force": Channel(written.force, "N", "force"),
        "acceleration": Channel(written.acceleration, "m/s^2", "acceleration"),
    }
    starts = "fresh" if fresh else "running"
    recording = Recording(name, f"{name}.csv", logger.rate, channels, starts, setting)
    kept = Motion(*(each[warm::every] for each in motion))
    return _Recorded(recording, kept, misread, tuple(realised))


def _with_gaps(rng: np.random.Generator, made: Sequence[_Recorded]) -> list[_Recorded]:
    """Two recordings in which the logger lost samples and drew straight lines over them."""
    chosen = set(rng.choice(len(made), 2, replace=False).tolist())
    mended = []
    for i, each in enumerate(made):
        if i in chosen:
            size = each.recording.size
            begin, length = int(rng.integers(size // 4, 3 * size // 4)), int(rng.integers(20, 60))
            for channel in each.recording.channels.values():
                ends = channel.samples[[begin, begin + length]]
                channel.samples[begin : begin + length] = np.linspace(ends[0], ends[1], length, endpoint=False)
        mended.append(each)
    return mended


def _absorbing(stated, true: Constants, motions: Sequence[Motion], settings: Sequence[Setting]) -> dict[str, Nominal]:
    """Constants that a lab would fit to these motions without knowing of the concealed physics.

    Least squares on the measured balances of force (equation error), each constant held near its true value by ten
    tolerances.
    """
    names = ("stiffness", "damping", "drive_gain", "pressure_gain", "loading_stiffness", "unloading_stiffness")
    rows, right = [], []
    for motion, setting in zip(motions, settings, strict=True):
        amplitude = (DRIVE_PER_HERTZ * setting.frequency + DRIVE_AT_ZERO) * setting.amplitude
        zero = np.zeros_like(motion.time)
        push = np.full_like(zero, PUSH_PER_BAR * setting.pressure)
        loading, unloading = motion.depth * (motion.regime == 1), motion.depth * (motion.regime == 2)
        drive = amplitude * np.sin(motion.theta)
        s, v = motion.shortening, motion.closing
        rows += [
            np.column_stack([-s, -v, zero, push, zero, zero]),
            np.column_stack([s, v, drive, zero, zero, zero]),
            np.column_stack([zero, zero, zero, zero, loading, unloading]),
        ]
        right += [
            motion.shaker_added - motion.coupling_added,
            motion.indenter_added + motion.coupling_added,
            motion.contact_added,
        ]
    design, missing = np.vstack(rows), np.concatenate(right)
    widths = np.array([10.0 * (stated[name].std or 1.0) for name in names])
    # held near by as many samples as there are: one newton a tolerance
    held = np.diag(1.0 / widths) * math.sqrt(missing.size)
    shift = np.linalg.lstsq(np.vstack([design, held]), np.concatenate([missing, np.zeros(len(names))]), rcond=None)[0]
    fitted = {name: getattr(true, name) + float(by) for name, by in zip(names, shift, strict=True)}
    fitted["unloading_stiffness"] = max(fitted["unloading_stiffness"], 1.001 * fitted["loading_stiffness"])
    return {name: replace(each, value=fitted[name]) if name in fitted else each for name, each in stated.items()}


# --- The answer


def _answer(conditions, hidden, settings, wrong, true, made, group) -> dict[str, Any]:
    """What is true of a campaign, as the sealed file has it."""
    motions = [each.motion for each in made]
    statics = [true.pressure_gain * PUSH_PER_BAR * each.pressure for each in settings]
    where = curves.reference(
        motions,
        [each.frequency for each in settings],
        statics,
        true.drive_gain * _site(settings).drive,
        conditions.logger.rate,
        true.loading_stiffness,
        true.stiffness,
    )
    noise = conditions.logger.noise
    entries = [
        {
            "mechanism": each.mechanism,
            "equation": each.equation.name,
            "of_library": each.equation.of_library,
            "parameters": dict(each.parameters),
            "law": curves.law_of(each, where, noise),
            "law_realised": _law_realised(each, [recorded.realised[i] for recorded in made], where, noise),
        }
        for i, each in enumerate(hidden)
    ]
    if conditions.gaps:
        entries.append(
            {"mechanism": MENDED_GAPS, "equation": "straight lines", "of_library": False, "parameters": {}, "law": None}
        )
    return {
        "group": group,
        "verdict": _verdict(group),
        "mechanisms": entries,
        "wrong": {name: getattr(true, name) for name in wrong},
        "true": true._asdict(),
        "missing": _missing(made, noise),
        "reference": where._asdict(),
        "conditions": {
            "case": conditions.case,
            "seconds": conditions.seconds,
            "bad_labels": conditions.bad_labels,
            **conditions.logger._asdict(),
        },
    }


def _law_realised(
    each: Concealed, realised: Sequence[Mapping[str, float]], where: curves.Reference, noise: tuple[float, float, float]
) -> dict[str, Any] | None:
    """The curve with the means over the recordings of parameters that differ between them; None where none does."""
    if not realised[0]:
        return None
    means = {name: float(np.mean([one[name] for one in realised])) for name in realised[0]}
    return curves.law_of(each._replace(parameters=dict(each.parameters) | means), where, noise)


def _verdict(group: str) -> str:
    return {"null": "agrees", "wrong-constant": "parameters", "outside": "unexplained"}.get(group, "missing-physics")


def _missing(made: Sequence[_Recorded], noise: Sequence[float]) -> dict[str, float]:
    """Root mean square of what is missing: forces in N where they act, readings in V, N and m/s^2."""
    found = {}
    for name in ("contact", "coupling", "indenter", "shaker"):
        squares = [np.mean(getattr(each.motion, f"{name}_added") ** 2) for each in made]
        found[name] = float(np.sqrt(np.mean(squares)))
    for i, name in enumerate(sensors.Signals._fields):
        found[f"{name}_reading"] = float(np.sqrt(np.mean([each.misread[i][0] ** 2 for each in made])))
    return found
