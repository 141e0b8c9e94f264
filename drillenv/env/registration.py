"""The environments' names in Gymnasium's registry. Imports Gymnasium only, so that ``import drillenv`` stays light."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.registration import register, registry

STEPS = {"Drill": 80, "DrillLayers": 240, "DrillHidden": 240}
"""Steps of an episode: 20 s on one rock, 60 s through layers."""
KINDS = {"Drill": "rock", "DrillLayers": "layers", "DrillHidden": "hidden"}
IDS = tuple(f"drillenv/{name}-v0" for name in KINDS)
HIDDEN_RIGS = "drillenv/DrillHidden-v0"
"""Whose rigs differ by one stated error each where no other number is given, and have an effect each."""
BUDGETS = {"Drill": 5.0, "DrillLayers": 10.0, "DrillHidden": 10.0}
"""N above the rating that a constrained task allows in the mean of all steps."""
HOLES: dict[str, dict[str, Any]] = {"DrillBit": {}, "DrillBitShort": {"depth": 1.0, "lost_bit_ends": True}}
"""The environments that drill a hole, with their arguments."""
HOLE_STEPS = {"DrillBit": 600, "DrillBitShort": 150}
HOLE_IDS = tuple(f"drillenv/{name}-v0" for name in HOLES)


def register_environments() -> None:
    """Register the environments; those that already are stay as they are."""
    rocks = ("drillenv.env.scalar:DrillEnv", "drillenv.env.vector:DrillVectorEnv")
    holes = ("drillenv.env.hole.envs:DrillBitEnv", "drillenv.env.hole.envs:DrillBitVectorEnv")
    made = [(name, *rocks, STEPS[name], {"kind": kind}) for name, kind in KINDS.items()]
    made += [(name, *holes, HOLE_STEPS[name], arguments) for name, arguments in HOLES.items()]
    for name, one, many, steps, arguments in made:
        identity = f"drillenv/{name}-v0"
        if identity not in registry:
            register(
                id=identity,
                entry_point=one,
                vector_entry_point=many,
                max_episode_steps=steps,
                kwargs=arguments,
            )
