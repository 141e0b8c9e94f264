"""What a search for missing physics is restricted to: parts of the rig, or mechanisms."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from drillenv.checks import InputError, shown
from drillenv.diagnosis.laws import PLACE_NAMES, Curve, Family
from drillenv.dynamics.effects import REGISTRY, Balance, Effect
from drillenv.recordings.document import DRILL

PARTS: tuple[str, ...] = get_args(Balance)
"""Of a rig: the balances of force in which a mechanism may act, and the sensors."""


@dataclass(frozen=True)
class Scope:
    """Names of parts of the rig, of places of laws, or of mechanisms, of which one at least has to fit."""

    names: tuple[str, ...]

    def has(self, family: Family, mechanisms: Iterable[str]) -> bool:
        """Whether a family is searched, which may turn out to be any of these mechanisms.

        A constant that need not be as stated always is: it is no mechanism, and passes for one where it is off.
        """
        if family.constant:
            return True
        there = {family.name, family.group, *mechanisms}
        there |= {PLACE_NAMES[each.place] for each in family.terms if isinstance(each, Curve)}
        there |= {part for name in mechanisms if name in REGISTRY for part in REGISTRY[name].balances}
        there |= {"sensor" for each in family.terms if each.observes}
        return any(name in there for name in self.names)


def scope_of(names: Sequence[str], rig: str) -> Scope | None:
    """The scope of a search by names as they were given; None where there are none.

    Raises:
        InputError: a name of no part, place or mechanism of this rig.
    """
    known = [*PARTS, *PLACE_NAMES, *(name for name, each in REGISTRY.items() if acts_on(each, rig))]
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, 3)
            ways = f"did you mean {' or '.join(near)}?" if near else f"give a part ({', '.join(PARTS)}) or a mechanism"
            raise InputError(f"only names {shown(name)}, which is none of the rig: {ways}")
    return Scope(tuple(names)) if names else None


def acts_on(effect: Effect, rig: str) -> bool:
    """Whether a rig may have an effect."""
    return effect.measure is not None or (effect.moves_rig if rig == DRILL else effect.on_body is not None)


def bounded(record: Mapping[str, Any], names: Sequence[str], stopped: str) -> dict[str, Any]:
    """A report that says what was not looked for: outside of ``names``, or after the stage where it was ``stopped``.

    Either may be empty.
    """
    said = []
    if names:
        said.append(f"Nothing but {' and '.join(names)} was looked for: what else may be missing is not known.")
    if stopped:
        said.append(f"The diagnosis was ended while {stopped}: it is unfinished, and more may be missing.")
    if not said:
        return dict(record)
    where = dict(record["where"]) | {"summary": " ".join([*said, record["where"]["summary"]])}
    more: dict[str, Any] = {"only": list(names)} if names else {}
    more |= {"unfinished": stopped} if stopped else {}
    return {**record, "where": where, **more, "remarks": [*said, *record["remarks"]]}


def limits_of(record: Mapping[str, Any]) -> str:
    """What a verdict is to be read with, in a few words; empty where it is of a whole search."""
    said = [f"only {' and '.join(record['only'])} looked for"] if record.get("only") else []
    said += ["unfinished"] if record.get("unfinished") else []
    return ", ".join(said)
