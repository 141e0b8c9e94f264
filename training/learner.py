"""An algorithm of Stable-Baselines3 on the native vector environment, as a recipe says."""

from __future__ import annotations

import numpy as np
import torch
from sb3_contrib import RecurrentPPO
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecFrameStack, VecMonitor

from drillenv.controllers.policies import outputs_for
from drillenv.training.branches import BranchedPPO, Branches
from drillenv.training.recipe import START, Recipe
from drillenv.training.sb3 import DrillVecEnv
from drillenv.training.scaling import Scaled

SLOWEST = 0.02
"""Share of the learning rate that is left after the annealing."""
MOST_GRADIENT = 0.5
"""Norm to which gradients are clipped."""
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}


class Learner:
    """The rigs, what prepares their observations, and the algorithm.

    Args:
        recipe: What to train with.
        threads: Of the rigs; all cores where left out. Results do not depend on it.

    Attributes:
        rigs: The environments themselves.
        monitor: Keeps the statistics of episodes.
        stacked: Observations as the policy sees them: scaled, and the last ones side by side.
        model: The algorithm.
    """

    def __init__(self, recipe: Recipe, threads: int | None = None):
        # The network is far too small to share out, and the rigs have the cores. All that the algorithms do on one
        # thread is deterministic as it is; torch.use_deterministic_algorithms would load a compiler for nothing.
        torch.set_num_threads(1)
        self.recipe = recipe
        self.threads = threads
        self.rigs = DrillVecEnv(recipe.env, recipe.envs, threads=threads)
        self.monitor = VecMonitor(self.rigs)
        self.stacked = VecFrameStack(Scaled(self.monitor, 1.0 - recipe.gamma), recipe.stack)
        self._left = 1.0
        self.model = self._algorithm()
        head = self.model.policy.action_net
        assert isinstance(head, torch.nn.Linear)
        with torch.no_grad():
            head.bias.copy_(torch.from_numpy(outputs_for(*START)))
        self.model.policy.log_std.requires_grad_(False)
        self.anneal()

    def _algorithm(self) -> PPO | RecurrentPPO:
        """Untrained."""
        recipe = self.recipe
        policy = {
            "net_arch": list(recipe.layers),
            "activation_fn": ACTIVATIONS[recipe.activation],
        }
        common = {
            "learning_rate": lambda _: recipe.learning_rate * max(SLOWEST, self._left),
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
        if recipe.algo == "recurrent-ppo":
            policy["lstm_hidden_size"] = recipe.lstm
            return RecurrentPPO("MlpLstmPolicy", self.stacked, policy_kwargs=policy, **common)
        if recipe.ahead:
            branches = Branches(self.stacked, self.rigs, recipe.ahead, recipe.seed)
            return BranchedPPO("MlpPolicy", branches, policy_kwargs=policy, vf_coef=0.0, **common)
        return PPO("MlpPolicy", self.stacked, policy_kwargs=policy, **common)

    def anneal(self) -> None:
        """Set learning rate and noise of the actions for the steps done so far.

        They go by these steps alone, not by how many are wanted in the end, so that a run that is lengthened is the run
        that was long from the start.
        """
        recipe = self.recipe
        steps = self.model.num_timesteps
        self._left = max(0.0, 1.0 - steps / recipe.anneal)
        loud = max(0.0, 1.0 - steps / recipe.noise_anneal)
        noise = loud * np.log(recipe.noise) + (1.0 - loud) * np.log(recipe.noise_end)
        with torch.no_grad():
            self.model.policy.log_std.copy_(torch.from_numpy(noise))

    def close(self) -> None:
        """Let the threads of the rigs go."""
        self.rigs.close()
