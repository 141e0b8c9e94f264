"""From a training run, or a model of Stable-Baselines3, to a policy that runs with numpy alone.

Its folder holds policy.safetensors and policy.json, see :mod:`drillenv.controllers.policies`;
``controllers.make("learned", policy=FOLDER)`` acts by it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from drillenv.checks import InputError, choice, shown
from drillenv.controllers.hole import learned as hole
from drillenv.controllers.hole.learned import HolePolicy
from drillenv.controllers.policies import ACTIONS, DESCRIPTION, DIRECT, NAMES, Policy, read_policy, write_policy
from drillenv.controllers.policies.stable_baselines import PER_LAYER, lstm_of
from drillenv.training.recipe import OFF_POLICY, RECURRENT, WITH_CRITIC, Recipe, read_recipe, renamed
from drillenv.training.scaling import CENTRE, WIDTH

FORMAT, FORMER_FORMAT = "drillenv-training/2", "drillenv-training/1"
CONFIG, RESULT = "config.json", "result.json"
WHICH = ("best", "last")
LARGEST_CONFIG = 100_000
"""Bytes; a configuration has some thousand."""
HEADS = {"sac": ("actor.latent_pi", "actor.mu"), "td3": ("actor.mu", "")}
"""Where off-policy algorithms keep the layers and the last one; that of TD3 is the last of the layers."""
ON_POLICY_HEAD = ("mlp_extractor.policy_net", "action_net")


def controller_weights(parameters: Mapping[str, np.ndarray], recipe: Recipe) -> dict[str, np.ndarray]:
    """As :func:`weights_of`; nothing where the policy does not see the readings or give settings, as controllers do."""
    given = recipe.env_kwargs
    if given.get("actions", "absolute") != "absolute" or given.get("observations", "readings") != "readings":
        return {}
    weights = weights_of(parameters, recipe)
    if recipe.believing:
        return weights
    sizes = weights["action.bias"].size, weights.get("lstm.weight_input", weights["layer0.weight"]).shape[1]
    return weights if sizes == (len(ACTIONS), recipe.stack * len(NAMES)) else {}


def weights_of(parameters: Mapping[str, np.ndarray], recipe: Recipe) -> dict[str, np.ndarray]:
    """What the policy needs of all parameters of a model, by the names that a Policy has for them."""
    found = {}
    if recipe.algo == RECURRENT:
        found |= lstm_of(parameters)
    layers, head = HEADS.get(recipe.algo, ON_POLICY_HEAD)
    head = head or f"{layers}.{PER_LAYER * len(recipe.layers)}"
    for part in ("weight", "bias"):
        for i in range(len(recipe.layers)):
            found[f"layer{i}.{part}"] = parameters[f"{layers}.{PER_LAYER * i}.{part}"]
        found[f"action.{part}"] = parameters[f"{head}.{part}"]
    return {name: np.array(value, dtype=np.float32) for name, value in found.items()}


def policy_of(
    weights: Mapping[str, np.ndarray], recipe: Recipe, steps: int, score: float | None, scenario: str = "validation"
) -> Policy | HolePolicy:
    """The policy with these weights, as one that says where it comes from."""
    provenance: dict[str, str | float] = {"algorithm": recipe.algo, "seed": recipe.seed, "steps": steps}
    if recipe.ahead:
        provenance["ahead"] = recipe.ahead
    if recipe.constrained:
        provenance["cost_limit"] = recipe.cost_limit
    if recipe.rig_errors:
        provenance["rig_errors"] = recipe.rig_errors
    if recipe.algo in WITH_CRITIC:
        provenance["rigs"] = "prepared" if recipe.prepared else "as they are"
    for name in ("env_kwargs", "algo_kwargs"):
        if getattr(recipe, name):
            provenance[name] = json.dumps(getattr(recipe, name))
    if score is not None:
        provenance |= {"score": score, "score_unit": recipe.unit, "scenario": scenario, "episodes": recipe.episodes}
    if recipe.believing:
        return HolePolicy(weights, {**provenance, "gamma": recipe.gamma})
    return Policy(
        weights=weights,
        centre=CENTRE if recipe.prepared else np.zeros(len(NAMES), dtype=np.float32),
        width=WIDTH if recipe.prepared else np.ones(len(NAMES), dtype=np.float32),
        layers=recipe.layers,
        lstm=recipe.lstm if recipe.algo == RECURRENT else 0,
        activation=recipe.activation,
        stack=recipe.stack,
        environment=recipe.env,
        provenance=provenance,
        outputs=ACTIONS if recipe.prepared else DIRECT,
        squash="tanh" if recipe.algo in OFF_POLICY else "clip",
    )


def write(folder: str | Path, policy: Policy | HolePolicy) -> None:
    """Write the two files of a policy.

    Raises:
        InputError: the folder cannot be written to.
    """
    if isinstance(policy, HolePolicy):
        hole.write_policy(folder, policy)
    else:
        write_policy(folder, policy)


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
        if not isinstance(record, dict) or record.get("format") not in (FORMAT, FORMER_FORMAT):
            raise InputError(f"{file} is not of the format {FORMAT}: give the folder of a run")
        recipe = record["recipe"]
        if record["format"] == FORMER_FORMAT:
            recipe = renamed(recipe)
        return read_recipe(recipe), int(record["timesteps"])
    except InputError:
        raise  # a ValueError too
    except OSError as error:
        raise InputError(f"{file} cannot be read ({error.strerror}): give the folder of a run") from None
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"{file} is damaged ({shown(str(error))}): give the folder of a run") from None


def exported(run: Path, which: str = "best") -> Policy | HolePolicy:
    """The best policy of a run so far by its evaluations, or the last one, from its last checkpoint until it is done.

    Raises:
        InputError: no run, no checkpoint yet, no evaluation yet, or a policy that is none of controllers.
    """
    choice("which", which, WHICH)
    recipe, _ = read_config(run)
    written = (run / which / DESCRIPTION).is_file()
    if recipe.algo in OFF_POLICY and not written:
        raise InputError(f"{run} has no policy {which} for controllers: train for longer, or use {which}.zip there")
    # a run that is done was evaluated once more after its last checkpoint, since it may be lengthened
    if recipe.algo in OFF_POLICY or (which == "best" and written and (run / RESULT).is_file()):
        return hole.read_policy(run / which) if recipe.believing else read_policy(run / which)
    from drillenv.training.checkpoint import latest

    checkpoint, _ = latest(run / "checkpoints")
    if checkpoint is None:
        raise InputError(f"{run} has no checkpoint that can be read: train for longer")
    weights = controller_weights(checkpoint.policy, recipe)
    if not weights:
        raise InputError(f"{run} has policies of other actions or observations than controllers: use {which}.zip there")
    if which == "last":
        return policy_of(weights, recipe, checkpoint.steps, None)
    if not checkpoint.best:
        raise InputError(f"{run} was never evaluated: give --which last, or train it with --evaluate-every")
    notes = checkpoint.record["notes"]
    return policy_of(checkpoint.best, recipe, notes["best_steps"], notes["best_score"])
