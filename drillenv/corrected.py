"""The model file: corrected constants of a rig and a rock, and the effects that the paper's model leaves out.

    {
      "format": "drillenv-model/1",
      "rig": "percussive-drill",
      "constants": {"damping": 2790.0, "loading_stiffness": 21.9e6, "unloading_stiffness": 25.1e6},
      "effects": [{"name": "contact-rate", "parameters": {"chi": 0.52}}]
    }

Constants carry the names that a campaign gives them and are in SI; those left out are Table 2.1's, and without
stiffnesses the model holds on any rock. ``rig`` may be left out; a diagnosis of another rig ("one-body") names it, and
such a model is no model of the drill.

In place of an equation's parameters an effect may carry a measured curve, of 2 to 64 knots in SI; those that do are in
``drillenv.dynamics.effects.TABULATED``:

    {"name": "tabulated-spring",
     "parameters": {"argument_unit": "m", "unit": "N",
                    "x": [0.0, 0.004, 0.008], "y": [0.0, 3.1, 24.8], "beyond": "held"}}

Outside its range a curve is held at its last value, or goes on straight where ``beyond`` is "straight". ``beyond`` and
the units may be left out. The curves, over what and of what:

    tabulated-loading, -unloading   force of the rock (N), factor on k_l or k_u at that force
    tabulated-rate-factor           speed into the rock (m/s), what its force grows by, as a share
    tabulated-rate-force            speed into the rock (m/s), force added to the rock's (N)
    tabulated-compaction            impacts on a fresh face, factor on k_l and k_u, less 1
    tabulated-spring                X1 - X2 (m), force added to the coupling's (N)
    tabulated-spring-from-rest      X1 - X2 - F_b / k (m), force added to the coupling's (N)
    tabulated-damper                X1' - X2' (m/s), force added to the coupling's (N)
    tabulated-guide, -indenter      speed of the mass (m/s), force against its motion (N)
    tabulated-drive-waveform        phase of the excitation (rad), force added to the drive's, over F_a
    tabulated-drive-curve           F_a sin(theta) (N), force added to the drive's (N)
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drillenv.checks import InputError, shown
from drillenv.files import read_record, whole
from drillenv.recordings.document import DRILL
from drillenv.rig import Rig
from drillenv.rocks import Rock

if TYPE_CHECKING:
    from drillenv.dynamics.effects import Chosen

FORMAT = "drillenv-model/1"
LARGEST_FILE = 1_000_000
"""Bytes; a model file has a few hundred."""
RIG_CONSTANTS = tuple(each.name for each in fields(Rig))
ROCK_CONSTANTS = ("loading_stiffness", "unloading_stiffness")


@dataclass(frozen=True, slots=True)
class Corrected:
    """A model of the rig: constants, and effects beyond those of the paper."""

    rig: Rig = field(default_factory=Rig)
    rock: Rock | None = None
    """None where the model says nothing of the rock."""
    effects: tuple[Chosen, ...] = ()

    @property
    def on_motion(self) -> tuple[Chosen, ...]:
        """The effects that act on the motion of the drilling rig.

        Raises:
            InputError: an effect that only a one-body rig knows.
        """
        for chosen in self.effects:
            if not chosen.effect.moves_rig and chosen.effect.measure is None:
                raise InputError(
                    f"model has the effect {chosen.effect.name}, which is one of a one-body rig: "
                    "give a model of the drilling rig"
                )
        return tuple(chosen for chosen in self.effects if chosen.effect.moves_rig)

    @property
    def on_sensors(self) -> tuple[Chosen, ...]:
        """The effects that act on what a sensor reads, and not on the motion."""
        return tuple(chosen for chosen in self.effects if chosen.effect.measure is not None)


def read_model(path: str | Path) -> Corrected:
    """Read a model file.

    Raises:
        InputError: no such file, not JSON, or not what the head of this module describes.
    """
    return read_record(path, "model", FORMAT, LARGEST_FILE, model_from_record)


def model_from_record(record: object) -> Corrected:
    """The model of a parsed model file.

    Raises:
        InputError: not what the head of this module describes.
    """
    from drillenv.dynamics.effects import make

    if not isinstance(record, dict) or record.get("format") != FORMAT:
        given = shown(record.get("format")) if isinstance(record, dict) else shown(record)
        raise InputError(f"format is {given}: give a record whose format is {FORMAT!r}")
    for key in record:
        if key not in ("format", "rig", "constants", "effects"):
            raise InputError(f"unknown key {shown(key)}: a model has format, rig, constants and effects")
    if record.get("rig", DRILL) != DRILL:
        raise InputError(f"rig is {shown(record['rig'])}: give a model of the {DRILL}, the rig that is simulated")
    constants = record.get("constants", {})
    if not isinstance(constants, dict):
        raise InputError(f"constants is {shown(constants)}: give a record of names and values")
    for name in constants:
        if name not in RIG_CONSTANTS + ROCK_CONSTANTS:
            raise InputError(
                f"unknown constant {shown(name)}: the constants are {', '.join(RIG_CONSTANTS + ROCK_CONSTANTS)}"
            )
    rig = Rig(**{name: constants[name] for name in RIG_CONSTANTS if name in constants})
    given = [name for name in ROCK_CONSTANTS if name in constants]
    if len(given) == 1:
        raise InputError(f"constants has {given[0]} alone: give both stiffnesses of the rock, or none")
    rock = Rock(*(constants[name] for name in ROCK_CONSTANTS), name="corrected") if given else None
    chosen = record.get("effects", [])
    if not isinstance(chosen, list):
        raise InputError(f"effects is {shown(chosen)}: give a list of records with name and parameters")
    effects = []
    for entry in chosen:
        if not isinstance(entry, dict) or set(entry) != {"name", "parameters"} or not isinstance(entry["name"], str):
            raise InputError(f"an effect is {shown(entry)}: give a record with name and parameters")
        if not isinstance(entry["parameters"], dict):
            raise InputError(f"parameters of {shown(entry['name'])} is {shown(entry['parameters'])}: give a record")
        effects.append(make(entry["name"], **entry["parameters"]))
    names = [each.effect.name for each in effects]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"effect {name} is given twice: give it once")
    return Corrected(rig, rock, tuple(effects))


def model_record(model: Corrected) -> dict[str, Any]:
    """What :func:`model_from_record` reads back."""
    constants = asdict(model.rig)
    if model.rock is not None:
        constants |= {name: getattr(model.rock, name) for name in ROCK_CONSTANTS}
    effects = [effect_record(chosen) for chosen in model.effects]
    return {"format": FORMAT, "rig": DRILL, "constants": constants, "effects": effects}


def effect_record(chosen: Chosen) -> dict[str, Any]:
    """An effect as it stands in a model file: its name, and its parameters by symbol or its curve."""
    return {"name": chosen.effect.name, "parameters": chosen.given}


def write_model(path: str | Path, model: Corrected) -> None:
    """Write a model file, whole or not at all."""
    with whole(Path(path)) as part:
        part.write_text(json.dumps(model_record(model), indent=2) + "\n", encoding="utf-8")
