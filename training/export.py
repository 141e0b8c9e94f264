"""From a training run to a policy that runs with numpy alone.

    python -m drillenv.training.export --run DIR --out FOLDER [--which best|last]

The folder then holds policy.safetensors and policy.json, see :mod:`drillenv.controllers.policies`;
``controllers.make("learned", policy=FOLDER)`` acts by it.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from drillenv.checks import InputError, choice, shown
from drillenv.cli import Parser
from drillenv.controllers.policies import Policy, write_policy
from drillenv.training.recipe import Recipe, read_recipe
from drillenv.training.scaling import CENTRE, WIDTH

FORMAT = "drillenv-training/1"
CONFIG = "config.json"
WHICH = ("best", "last")
LARGEST_CONFIG = 100_000
"""Bytes; a configuration has some thousand."""
_PER_LAYER = 2
"""Stable-Baselines3 numbers its modules: a linear one and its activation for each layer."""


def weights_of(parameters: Mapping[str, np.ndarray], recipe: Recipe) -> dict[str, np.ndarray]:
    """What the policy needs of all parameters of a model, by the names that a Policy has for them."""
    found = {}
    if recipe.algo == "recurrent-ppo":
        found["lstm.weight_input"] = parameters["lstm_actor.weight_ih_l0"]
        found["lstm.weight_hidden"] = parameters["lstm_actor.weight_hh_l0"]
        found["lstm.bias"] = parameters["lstm_actor.bias_ih_l0"] + parameters["lstm_actor.bias_hh_l0"]
    for i in range(len(recipe.layers)):
        for part in ("weight", "bias"):
            found[f"layer{i}.{part}"] = parameters[f"mlp_extractor.policy_net.{_PER_LAYER * i}.{part}"]
    found |= {f"action.{part}": parameters[f"action_net.{part}"] for part in ("weight", "bias")}
    return {name: np.array(value, dtype=np.float32) for name, value in found.items()}


def policy_of(
    weights: Mapping[str, np.ndarray], recipe: Recipe, steps: int, score: float | None, scenario: str = "validation"
) -> Policy:
    """The policy with these weights, as one that says where it comes from."""
    provenance: dict[str, str | float] = {
        "algorithm": recipe.algo,
        "ahead": recipe.ahead,
        "seed": recipe.seed,
        "steps": steps,
    }
    if score is not None:
        provenance |= {"score": score, "score_unit": "mm/s", "scenario": scenario, "episodes": recipe.episodes}
    return Policy(
        weights=weights,
        centre=CENTRE,
        width=WIDTH,
        layers=recipe.layers,
        lstm=recipe.lstm if recipe.algo == "recurrent-ppo" else 0,
        activation=recipe.activation,
        stack=recipe.stack,
        environment=recipe.env,
        provenance=provenance,
    )


def read_config(run: Path) -> tuple[Recipe, int]:
    """The recipe of a run and how many steps it was to take.

    Raises:
        InputError: the folder holds no run, or its configuration is damaged.
    """
    file = run / CONFIG
    try:
        if file.stat().st_size > LARGEST_CONFIG:
            raise InputError(f"{file} has more than {LARGEST_CONFIG} bytes: give the folder of a run")
        record = json.loads(file.read_text(encoding="utf-8"))
        if not isinstance(record, dict) or record.get("format") != FORMAT:
            raise InputError(f"{file} is not of the format {FORMAT}: give the folder of a run")
        return read_recipe(record["recipe"]), int(record["timesteps"])
    except InputError:
        raise  # a ValueError too
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): give the folder of a run") from None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{file} is damaged ({shown(str(error))}): give the folder of a run") from None


def exported(run: Path, which: str = "best") -> Policy:
    """The best policy of a run so far by its evaluations, or the last one, from its last checkpoint.

    Raises:
        InputError: no run, no checkpoint yet, or no evaluation yet.
    """
    from drillenv.training.checkpoint import latest

    choice("which", which, WHICH)
    recipe, _ = read_config(run)
    checkpoint, _ = latest(run / "checkpoints")
    if checkpoint is None:
        raise InputError(f"{run} has no checkpoint that can be read: train for longer")
    if which == "last":
        return policy_of(weights_of(checkpoint.policy, recipe), recipe, checkpoint.steps, None)
    if not checkpoint.best:
        raise InputError(f"{run} was never evaluated: give --which last, or train it with --evaluate-every")
    notes = checkpoint.record["notes"]
    return policy_of(checkpoint.best, recipe, notes["best_steps"], notes["best_score"])


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Returns the exit code: 0, or 2 on bad input."""
    parser = Parser(prog="python -m drillenv.training.export", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--run", required=True, help="folder of a training run")
    parser.add_argument("--out", required=True, help="folder for the policy")
    parser.add_argument("--which", default="best", help="best (by the evaluations on validation) or last")
    try:
        given = parser.parse_args(arguments)
        write_policy(given.out, exported(Path(given.run), given.which))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
