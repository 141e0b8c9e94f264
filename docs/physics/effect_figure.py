"""The figure of an effect: its law, and the rig without it and with it."""

from textwrap import fill
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

import drillenv
from drillenv.dynamics.constitutive.places import CODE, PLACES, shape_of
from drillenv.dynamics.effects import REGISTRY, Channels, make
from drillenv.dynamics.sensors import read

SETTING, ROCK, RIG = drillenv.Setting(120.0, 0.45, 1.0), drillenv.ROCKS[4], drillenv.Rig()
SECONDS, RATE = 0.5, 2e5
SHOWN = slice(-round(2 * RATE / SETTING.frequency), None)
"""The last two periods."""
BEFORE, AFTER = "0.6", "C0"
GRIPS = {"guide": "shaker_grip", "indenter": "indenter_grip"}
"""Dry friction that holds fast, which is no curve."""


def draw(name):
    """Draw the effect of this name at the strongest that is typical: each parameter as far from neutral as may be."""
    effect = REGISTRY[name]
    far = {each.symbol: max(each.typical, key=lambda x, at=each.neutral: abs(x - at)) for each in effect.parameters}
    chosen = make(name, **far)
    plain = drillenv.simulate(SETTING, ROCK, seconds=SECONDS, sample_rate=RATE)
    law = _law(chosen, plain) if effect.laws else None
    _, axes = plt.subplots(1, 1 + bool(law), figsize=(9, 2.8), layout="constrained", squeeze=False)
    if law:
        _draw_law(axes[0, 0], law)
    if effect.moves_rig:
        changed = drillenv.simulate(SETTING, ROCK, seconds=SECONDS, sample_rate=RATE, effects=[chosen])
        _draw_time(axes[0, -1], plain.time, plain.force, changed.force, "force of the rock [N]")
    elif effect.measure:
        _draw_sensor(axes[0, -1], chosen, plain)
    else:
        _draw_on_body(axes[0, -1], chosen)
    plt.show()


def _draw_time(axes, time, before, after, label):
    axes.plot(1e3 * time[SHOWN], before[SHOWN], color=BEFORE, label="without")
    axes.plot(1e3 * time[SHOWN], after[SHOWN], color=AFTER, label="with")
    axes.set(xlabel="time [ms]", ylabel=label)
    axes.legend()


def _draw_sensor(axes, chosen, run):
    """The channel that the sensor changes most, as it is and as it is read."""
    true = Channels(RATE, 0.0, run.excitation, run.force, run.acceleration, True)
    told = read(true, [chosen])
    labels = {"force": "force [N]", "acceleration": "acceleration [m/s²]", "excitation": "excitation [V]"}

    def change(channel):
        before, after = getattr(true, channel)[SHOWN], getattr(told, channel)[SHOWN]
        return np.abs(after - before).max() / np.ptp(before)

    most = max(labels, key=change)
    _draw_time(axes, run.time, getattr(true, most), getattr(told, most), labels[most])


def _draw_on_body(axes, chosen):
    speed = np.linspace(-0.3, 0.3, 601)
    # each of a motion that has gone on like that
    rest = np.zeros((speed.size, 1))
    axes.plot(speed, chosen.effect.on_body(rest, speed[:, None], rest, RIG.stiffness, chosen.values), color=AFTER)
    axes.set(xlabel="speed [m/s]", ylabel="force on the body [N]")


class Law(NamedTuple):
    """Curves over what the motion without the effect visits."""

    argument: np.ndarray
    without: np.ndarray
    bent: np.ndarray
    labels: dict[str, str]


def _law(chosen, run):
    """The law at its first place; none where it is neutral, as the stiffening of a mount typically is."""
    place, law = next(iter(chosen.effect.laws.items()))
    if place in ("loading", "unloading"):
        return _law_of_contact(chosen, shape_of(law))
    scalars = chosen.effect.scalars(chosen.values) if chosen.effect.scalars else {}
    argument = _visited(place, run, scalars)
    at = PLACES[CODE[place]]
    value = law(argument, chosen.values, RIG.stiffness)
    if place in GRIPS:
        value = value + scalars.get(GRIPS[place], 0.0) * np.sign(argument)
    labels = {"xlabel": f"{at.argument} [{at.argument_unit}]", "ylabel": f"{at.quantity} [{at.unit}]"}
    return Law(argument, np.zeros_like(argument), value, labels) if value.any() else None


def _law_of_contact(chosen, shape):
    depth = np.linspace(0.0, 1e-4, 401)
    stiffness = ROCK.loading_stiffness
    straight = stiffness * depth
    if shape.over == "force":
        bent = shape.law(straight, chosen.values, RIG.stiffness)
    else:
        bent = stiffness * shape.law(depth, chosen.values, RIG.stiffness)
    return Law(1e6 * depth, straight, bent, {"xlabel": "depth while loading [um]", "ylabel": "force of the rock [N]"})


def _draw_law(axes, law):
    axes.plot(law.argument, law.without, color=BEFORE, zorder=0)
    axes.plot(law.argument, law.bent, color=AFTER)
    axes.locator_params(axis="x", nbins=5)
    axes.set(**{axis: fill(label, 28) for axis, label in law.labels.items()})


def _visited(place, run, scalars):
    """Values of a law's argument from the least to the largest that the motion reaches."""
    shortening = run.shaker_position - run.indenter_position
    reached = {
        "rate-factor": run.indenter_speed[run.force > 0.0],
        "rate-force": run.indenter_speed[run.force > 0.0],
        "compaction": np.array([0.0, 200.0]),
        "spring": shortening,
        "spring-from-rest": shortening - RIG.static_force(SETTING) / RIG.stiffness,
        "damper": run.shaker_speed - run.indenter_speed,
        "guide": run.shaker_speed,
        "indenter": run.indenter_speed,
        "drive-waveform": np.array([0.0, 2 * np.pi]),
        "drive-curve": RIG.drive_force(SETTING) * np.array([-1.0, 1.0]),
        # as far as the rock's force bends it at rest
        "mount-spring": run.force * scalars.get("mount_gain", 0.0) / scalars.get("mount_square", 1.0),
    }[place]
    return np.linspace(reached.min(), reached.max(), 1001)
