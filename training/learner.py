"""An algorithm of Stable-Baselines3 on the native vector environment, as a recipe says."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO, SAC, TD3
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.vec_env import VecEnv, VecFrameStack, VecMonitor

from drillenv.checks import InputError, shown
from drillenv.controllers.policies import outputs_for
from drillenv.training import believing
from drillenv.training.believing import Believing
from drillenv.training.branches import BranchedPPO, Branches, HoleCopies, RockCopies
from drillenv.training.lagrangian import Priced
from drillenv.training.recipe import OFF_POLICY, RECURRENT, START, Recipe
from drillenv.training.sb3 import DrillVecEnv
from drillenv.training.scaling import CENTRE, Scaled

SLOWEST = 0.02
"""Share of the learning rate that is left after the annealing."""
MOST_GRADIENT = 0.5
"""Norm to which gradients are clipped."""
TD3_NOISE = 0.1
"""Standard deviation of the noise on the actions of TD3, that of its authors (Fujimoto et al., 2018)."""
SET_HERE = ("policy", "env", "use_sde", "tensorboard_log", "verbose", "_init_setup_model")
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}


class Learner:
    """The rigs, what prepares their observations, and the algorithm.

    Args:
        recipe: What to train with.
        threads: Of the rigs; all cores where left out. Results do not depend on it.

    Attributes:
        rigs: The environments themselves.
        believing: What remembers of each hole what can be known of it; None where none is drilled so.
        monitor: Keeps the statistics of episodes.
        priced: What takes the price of the force off the rewards; None where no budget is kept to.
        stacked: Observations as the policy sees them: scaled where rigs are prepared, and the last ones side by side.
        model: The algorithm.

    Raises:
        InputError: ``env_kwargs`` or ``algo_kwargs`` are not what the environment or the algorithm takes.
    """

    def __init__(self, recipe: Recipe, threads: int | None = None):
        # The network is far too small to share out, and the rigs have the cores. All that the algorithms do on one
        # thread is deterministic as it is; torch.use_deterministic_algorithms would load a compiler for nothing.
        torch.set_num_threads(1)
        self.recipe = recipe
        self.threads = threads
        told = {"info_keys": ["cost"]} if recipe.constrained else {}
        self.rigs: DrillVecEnv = rigs_of(recipe, recipe.envs, threads, **told, **_training_price(recipe))
        self.monitor = VecMonitor(self.rigs)
        self.priced: Priced | None = None
        self.believing: Believing | None = None
        self._left = 1.0
        rewarded: VecEnv = self.monitor
        if recipe.constrained:
            numbers = recipe.cost_limit, recipe.multiplier_rate, recipe.multiplier_gain
            rewarded = self.priced = Priced(self.monitor, *numbers)
        if not recipe.prepared:
            self.stacked = VecFrameStack(rewarded, recipe.stack)
            self.model: Any = _plain(recipe, self.stacked)
            return
        if recipe.believing:
            self.believing = Believing(self.monitor)
            self.stacked = VecFrameStack(self.believing, recipe.stack)
        else:
            spaces = self.rigs.observation_space.shape, self.rigs.action_space.shape
            if spaces != (CENTRE.shape, (len(START),)):
                raise InputError(f"rigs of {recipe.env} cannot be prepared, they have other readings: take ppo")
            self.stacked = VecFrameStack(Scaled(rewarded, 1.0 - recipe.gamma), recipe.stack)
        self.model = self._algorithm()
        head = self.model.policy.action_net
        assert isinstance(head, torch.nn.Linear)
        with torch.no_grad():
            head.bias.copy_(torch.from_numpy(np.array(believing.BEGIN) if recipe.believing else outputs_for(*START)))
            if recipe.believing:
                self.model.policy.log_std.copy_(torch.tensor(believing.NOISE))
        self.model.policy.log_std.requires_grad_(not recipe.anneals_noise)
        self.anneal()

    def _algorithm(self) -> PPO | RecurrentPPO:
        """Untrained."""
        recipe = self.recipe
        policy = network(recipe)
        slowest = believing.SLOWEST if recipe.believing else SLOWEST
        common = {
            "learning_rate": lambda _: recipe.learning_rate * max(slowest, self._left),
            "n_steps": recipe.rollout,
            "batch_size": recipe.batch,
            "n_epochs": recipe.epochs,
            "gamma": recipe.gamma,
            "gae_lambda": recipe.gae_lambda,
            "clip_range": recipe.clip,
            "max_grad_norm": MOST_GRADIENT,
            "seed": recipe.seed,
            "device": "cpu",
        }
        if recipe.algo == RECURRENT:
            return RecurrentPPO("MlpLstmPolicy", self.stacked, policy_kwargs=policy, **common)
        if recipe.ahead:
            if self.believing is None:
                copies, common["vf_coef"] = RockCopies(self.stacked, self.rigs), 0.0
            else:
                copies = HoleCopies(self.believing, self.rigs, recipe.gamma)
            branches = Branches(self.stacked, copies, recipe.ahead, recipe.seed)
            return BranchedPPO("MlpPolicy", branches, policy_kwargs=policy, **common)
        return PPO("MlpPolicy", self.stacked, policy_kwargs=policy, **common)

    @property
    def resumes(self) -> bool:
        """Whether a checkpoint can hold all that the run needs to go on."""
        return self.recipe.algo not in OFF_POLICY

    def parameters(self) -> dict[str, np.ndarray]:
        """All parameters by name, as they stand."""
        return {name: value.numpy().copy() for name, value in self.model.policy.state_dict().items()}

    def anneal(self) -> None:
        """Set learning rate and noise of the actions for the steps done so far, where the rigs are prepared.

        They go by these steps alone, not by how many are wanted in the end, so that a run that is lengthened is the run
        that was long from the start.
        """
        recipe = self.recipe
        if not recipe.prepared:
            return
        steps = self.model.num_timesteps
        self._left = max(0.0, 1.0 - steps / recipe.anneal)
        if not recipe.anneals_noise:
            return
        loud = max(0.0, 1.0 - steps / recipe.noise_anneal)
        noise = loud * np.log(recipe.noise) + (1.0 - loud) * np.log(recipe.noise_end)
        with torch.no_grad():
            self.model.policy.log_std[: noise.size].copy_(torch.from_numpy(noise))

    def close(self) -> None:
        """Let the threads of the rigs go."""
        self.rigs.close()


def rigs_of(recipe: Recipe, number: int, threads: int | None = None, **arguments: Any) -> DrillVecEnv:
    """Rigs of a recipe.

    Args:
        recipe: Which environment, with which arguments.
        number: How many.
        threads: Of the rigs; all cores where left out.
        arguments: Of the environment, in the place of those of the recipe.

    Raises:
        InputError: the environment does not take these arguments.
    """
    try:
        return DrillVecEnv(recipe.env, number, threads=threads, **{**recipe.env_kwargs, **arguments})
    except TypeError as error:
        raise InputError(
            f"env_kwargs do not fit {recipe.env} ({shown(str(error))}): give what gymnasium.make takes"
        ) from None


def network(recipe: Recipe) -> dict[str, Any]:
    """The network of a recipe as Stable-Baselines3 takes it."""
    memory = {"lstm_hidden_size": recipe.lstm} if recipe.algo == RECURRENT else {}
    return {"net_arch": list(recipe.layers), "activation_fn": ACTIVATIONS[recipe.activation], **memory}


def _training_price(recipe: Recipe) -> dict[str, Any]:
    """The arguments of an environment that give a metre of hole its worth on prepared rigs, unless its price is given.

    Raises:
        InputError: the costs given are no record.
    """
    if not recipe.believing:
        return {}
    given = recipe.env_kwargs.get("costs")
    if not isinstance(given, dict | None):
        raise InputError(f"costs is {shown(given)}: give a record of costs")
    return {"costs": {"metre": believing.METRE, **(given or {})}}


def _plain(recipe: Recipe, rigs: VecFrameStack) -> Any:
    """An algorithm of Stable-Baselines3 as it is, untrained, on rigs as they are."""
    common = {
        "learning_rate": recipe.learning_rate,
        "batch_size": recipe.batch,
        "gamma": recipe.gamma,
        "policy_kwargs": network(recipe),
        "seed": recipe.seed,
        "device": "cpu",
    }
    kind: Callable[..., Any] = {"sac": SAC, "td3": TD3, RECURRENT: RecurrentPPO}.get(recipe.algo, PPO)
    if recipe.algo not in OFF_POLICY:
        common |= {"n_steps": recipe.rollout, "n_epochs": recipe.epochs}
        common |= {"gae_lambda": recipe.gae_lambda, "clip_range": recipe.clip}
    elif recipe.algo == "td3":
        size = rigs.action_space.shape or (0,)
        common["action_noise"] = NormalActionNoise(np.zeros(size), np.full(size, TD3_NOISE))
    for name in recipe.algo_kwargs:
        if name in common or name in SET_HERE:
            raise InputError(f"algo_kwargs has {name}, which other options set: leave it out")
    try:
        return kind("MlpLstmPolicy" if recipe.algo == RECURRENT else "MlpPolicy", rigs, **common, **recipe.algo_kwargs)
    except (TypeError, ValueError, AssertionError) as error:
        raise InputError(
            f"algo_kwargs do not fit {recipe.algo} ({shown(str(error))}): give what its class in the library takes"
        ) from None
