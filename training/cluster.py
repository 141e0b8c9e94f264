"""The same environment on Ray RLlib, for where one machine is too small.

    python -m drillenv.training.cluster --out DIR [--address local|auto|HOST:PORT] [--runners N] [--timesteps N] [...]

Needs the extra "cluster". ``--address local`` starts a Ray on this machine, ``auto`` takes the one that runs on it, and
``HOST:PORT`` (or ray://HOST:10001) that of a cluster, on each of whose machines drillenv with that extra has to be
installed. Each of the runners drives its own vector of rigs on the batch kernel, on one core. What lies in DIR at the
end is a policy for ``controllers.make("learned", policy=DIR)``, two files that need neither Ray nor torch.

RLlib's PPO learns the noise of its actions instead of having it annealed, and goes through the recipe's other numbers:
discount, network, stack, steps of an update for each runner, minibatches. A run cannot be resumed to the bit.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorWrapper
from gymnasium.vector.utils import batch_space

from drillenv.checks import InputError, count, shown
from drillenv.cli_options import Parser
from drillenv.controllers.policies import Policy, actions_of, outputs_for, write_policy
from drillenv.env.observation import READINGS
from drillenv.env.registration import IDS, KINDS, STEPS
from drillenv.env.vector import DrillVectorEnv
from drillenv.files import made_folder
from drillenv.training.export import policy_of
from drillenv.training.recipe import START, Recipe
from drillenv.training.scaling import scaled

if TYPE_CHECKING:
    from ray.rllib.algorithms.ppo import PPO, PPOConfig

NAME = "drillenv-rigs"
TIMESTEPS = 300_000
ENCODER = "encoder.actor_encoder.net.mlp"
"""Where RLlib keeps the layers of the policy, numbered with their activations as in torch."""
HEAD = "pi.net.mlp.0"


class Prepared(VectorWrapper):
    """Rigs as RLlib is to see them: readings scaled, the last ones side by side, rewards by the horizon.

    Args:
        rigs: The native vector environment.
        stack: Observations that are seen at once; zeros stand before the first of an episode.
        worth: Factor on the rewards.
    """

    def __init__(self, rigs: DrillVectorEnv, stack: int, worth: float):
        super().__init__(rigs)
        self._worth = worth
        self._seen = np.zeros((rigs.num_envs, stack, len(READINGS)), dtype=np.float32)
        self._done = np.ones(rigs.num_envs, dtype=bool)
        self.single_observation_space = gym.spaces.Box(-np.inf, np.inf, (self._seen[0].size,), np.float32)
        self.observation_space = batch_space(self.single_observation_space, rigs.num_envs)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Start an episode with every rig."""
        observations, infos = self.env.reset(seed=seed, options=options)
        self._done[:] = True
        seen = self._stacked(observations)
        self._done[:] = False
        return seen, infos

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Drill for one interval; a rig that was done before starts its next episode instead."""
        observations, rewards, terminations, truncations, infos = self.env.step(actions_of(actions))
        seen = self._stacked(observations)
        self._done = terminations | truncations
        return seen, rewards * self._worth, terminations, truncations, infos

    def _stacked(self, observations: np.ndarray) -> np.ndarray:
        """(n, stack * 15) with the present observation last."""
        self._seen[self._done] = 0.0
        self._seen = np.roll(self._seen, -1, axis=1)
        self._seen[:, -1] = scaled(observations)
        return self._seen.reshape(len(self._seen), -1).copy()


def rigs_for(recipe: Recipe) -> Callable[[Mapping[str, Any]], Prepared]:
    """What makes the rigs of a runner, on one thread, from RLlib's description of it."""

    def make(context: Mapping[str, Any]) -> Prepared:
        name = _kind(recipe)
        rigs = DrillVectorEnv(context["num_envs"], max_episode_steps=STEPS[name], kind=KINDS[name], threads=1)
        return Prepared(rigs, recipe.stack, 1.0 - recipe.gamma)

    return make


def configuration(recipe: Recipe, runners: int) -> PPOConfig:
    """RLlib's PPO by the numbers of a recipe; ``runners`` 0 drills in the process that learns."""
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
    from ray.tune.registry import register_env

    register_env(NAME, rigs_for(recipe))
    network = DefaultModelConfig(
        fcnet_hiddens=list(recipe.layers),
        fcnet_activation=recipe.activation,
        head_fcnet_hiddens=[],
        vf_share_layers=False,
        free_log_std=True,
    )
    return (
        PPOConfig()
        .environment(NAME)
        .framework("torch")
        .env_runners(
            num_env_runners=runners,
            num_envs_per_env_runner=recipe.envs,
            gym_env_vectorize_mode="vector_entry_point",
            rollout_fragment_length=recipe.rollout,
        )
        .learners(num_learners=0)
        .training(
            lr=recipe.learning_rate,
            gamma=recipe.gamma,
            lambda_=recipe.gae_lambda,
            clip_param=recipe.clip,
            train_batch_size_per_learner=recipe.update * max(1, runners),
            minibatch_size=recipe.batch,
            num_epochs=recipe.epochs,
            use_kl_loss=False,
            entropy_coeff=0.0,
            grad_clip=0.5,
        )
        .rl_module(model_config=network)
        .debugging(seed=recipe.seed, log_level="ERROR")
    )


def begin(algorithm: PPO, recipe: Recipe) -> None:
    """Let the untrained policy ask for the recipe's careful setting, with the recipe's first noise."""
    weights = algorithm.get_module().get_state()
    weights[f"{HEAD}.bias"] = outputs_for(*START).astype(np.float32)
    weights["pi.log_std"] = np.log(recipe.noise).astype(np.float32)
    algorithm.learner_group.set_weights({"default_policy": weights})
    algorithm.env_runner_group.sync_weights(from_worker_or_learner_group=algorithm.learner_group)


def learned(algorithm: PPO, recipe: Recipe, steps: int) -> Policy:
    """The policy as it stands, for numpy alone."""
    state = algorithm.get_module().get_state()
    weights = {}
    for part in ("weight", "bias"):
        for i in range(len(recipe.layers)):
            weights[f"layer{i}.{part}"] = np.array(state[f"{ENCODER}.{2 * i}.{part}"], dtype=np.float32)
        weights[f"action.{part}"] = np.array(state[f"{HEAD}.{part}"], dtype=np.float32)
    policy = policy_of(weights, recipe, steps, None)
    assert isinstance(policy, Policy)
    return policy


def train(recipe: Recipe, timesteps: int, out: str, address: str = "local", runners: int = 1) -> dict[str, float]:
    """Train on a Ray until ``timesteps`` steps are done, and write the policy.

    Args:
        recipe: What to train with; ``envs`` is the number of rigs of each runner.
        timesteps: Steps of all rigs together, rounded up to whole updates.
        out: Folder for the policy.
        address: Of the Ray: "local", "auto", or that of a cluster.
        runners: Processes that drill, one core each; 0 drills in the process that learns.

    Returns:
        Steps done, seconds, and the mean reward in mm/s of the last episodes, with the noise of training.

    Raises:
        InputError: Ray is not installed, or none is at the address, or an argument is not what it should be.
    """
    count("timesteps", timesteps, 1, 10**12)
    count("runners", runners, 0, 10_000)
    if recipe.algo != "ppo" or not recipe.prepared or recipe.env_kwargs:
        raise InputError(
            f"algo is {shown(recipe.algo)}: the cluster trains ppo on prepared rigs without env_kwargs only"
        )
    made_folder(out)
    ray = _connected(address)
    try:
        algorithm = configuration(recipe, runners).build_algo()
        begin(algorithm, recipe)
        began, steps, score = time.monotonic(), 0, math.nan
        length = STEPS[_kind(recipe)]
        while steps < timesteps:
            result = algorithm.train()
            drilled = result["env_runners"]
            steps = int(drilled["num_env_steps_sampled_lifetime"])
            earned = drilled.get("episode_return_mean", math.nan)
            if math.isfinite(earned):  # episodes ended
                score = earned / length / (1.0 - recipe.gamma)
                print(f"{steps} steps, {score:.3f} mm/s in the last episodes", flush=True)
        seconds = time.monotonic() - began
        write_policy(out, learned(algorithm, recipe, steps))
        algorithm.stop()
    finally:
        ray.shutdown()
    return {"steps": steps, "seconds": seconds, "score": score}


def _kind(recipe: Recipe) -> str:
    """The name of the environment as :data:`STEPS` has it."""
    return recipe.env.removeprefix("drillenv/").removesuffix("-v0")


def _connected(address: str) -> Any:
    """Ray, connected to what is at the address."""
    try:
        import ray
        import ray.rllib
    except ImportError as error:
        raise InputError(f"{error.name} is not installed: pip install drillenv[cluster]") from None
    # the policy is far too small for a GPU, and usage is nobody's business
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        ray.init(address=address, log_to_driver=False, include_dashboard=False if address == "local" else None)
    except (ConnectionError, ValueError, RuntimeError) as error:
        line = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"no Ray at {shown(address)} ({line}): give local, auto or HOST:PORT") from None
    return ray


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Returns the exit code: 0, or 2 on bad input."""
    usual = Recipe(algo="ppo", prepared=True)
    parser = Parser(prog="python -m drillenv.training.cluster", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--out", required=True, help="folder for the policy")
    parser.add_argument("--address", default="local", help="local, auto or HOST:PORT (default local)")
    parser.add_argument("--runners", type=int, default=1, help="processes that drill, one core each (default 1)")
    parser.add_argument("--env", default=usual.env, help=f"one of {', '.join(IDS)} (default {usual.env})")
    parser.add_argument("--envs", type=int, default=usual.envs, help=f"rigs of each (default {usual.envs})")
    parser.add_argument("--timesteps", type=int, default=TIMESTEPS, help=f"in all (default {TIMESTEPS})")
    parser.add_argument("--seed", type=int, default=0, help="of everything random (default 0)")
    try:
        given = parser.parse_args(arguments)
        recipe = replace(usual, env=given.env, envs=given.envs, seed=given.seed)
        made = train(recipe, given.timesteps, given.out, given.address, given.runners)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(f"{made['steps']} steps, {made['steps'] / made['seconds']:.0f} a second; the policy is in {given.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
