"""PPO of Stable-Baselines3 with its critic on ``DrillBit``: from what can be known of a hole to outputs of a policy.

    python -m drillenv.training.hole_ppo --out runs/hole-0 --seed 0
    python -m drillenv.training.hole_ppo --out runs/myopic-0 --seed 0 --gamma 0

Writes the last policy (two files that :class:`drillenv.controllers.hole.learned.HoleLearned` plays with numpy alone)
and ``curve.json``, the cost per metre on the frozen set "validation" along the way. There are no checkpoints: a run of
four million steps takes ten minutes on one core.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from drillenv.controllers.hole.belief import SIZE, Belief
from drillenv.controllers.hole.learned import HoleLearned, actions_of, write_policy
from drillenv.files import whole
from drillenv.training.hole_search import costs_per_metre
from drillenv.training.sb3 import DrillVecEnv

RIGS, STEPS, BATCH, EPOCHS = 64, 128, 2048, 5
LAYERS = (64, 64)
LEARNING_RATE, LEAST = 1e-3, 0.05
"""At the start, and the share of it that is left at the end; it falls in a line."""
LAMBDA = 0.95
NOISE = -1.2
"""Logarithm of the standard deviation of the outputs at the start; it is learned."""
BEGIN = (0.4, 0.0, -0.3, 0.0)
"""Outputs of the untrained policy: 99 Hz, 0.45 V, careful pressure, and a new bit at the wear that is usual."""
METRE = 120.0
"""EUR that a metre is worth in training: about what it costs. The best way to a given depth is the same at any price,
but a discount makes waiting the dearer the more is still to be earned: at 600 EUR and gamma 0.995 a step costs ten
times what the rig does, and no bit is ever changed."""
WORTH = 0.05
"""Factor on the rewards, for the critic."""
EVALUATE = 24
"""Updates between two points of the curve."""


class Believing(VecEnvWrapper):
    """Turns readings into what is known of each hole, and outputs of a policy into actions.

    Args:
        venv: Holes to drill.
    """

    def __init__(self, venv: VecEnv):
        super().__init__(venv, gym.spaces.Box(-np.inf, np.inf, (SIZE,), dtype=np.float32))
        self.belief = Belief(venv.num_envs)
        self.known = np.zeros((venv.num_envs, SIZE), dtype=np.float32)

    def reset(self) -> np.ndarray:
        """Start a hole with every rig."""
        self.belief = Belief(self.num_envs)
        readings = self.venv.reset()
        assert isinstance(readings, np.ndarray)
        self.known = self.belief.of(readings)
        return self.known

    def step_async(self, actions: np.ndarray) -> None:
        """Take the outputs of the policy, (n, 4)."""
        self.venv.step_async(actions_of(actions, self.known))

    def step_wait(self) -> VecEnvStepReturn:
        """Drill for one step."""
        readings, rewards, dones, infos = self.venv.step_wait()
        assert isinstance(readings, np.ndarray)
        over = np.flatnonzero(dones)
        last = readings.copy()
        for i in over.tolist():
            last[i] = infos[i]["terminal_observation"]
        known = self.belief.of(last)
        for i in over.tolist():
            infos[i]["terminal_observation"] = known[i].copy()
        if over.size:
            self.belief.forget(over)
            known[over] = self.belief.of(readings[over], over)
        self.known = known
        return known, rewards * np.float32(WORTH), dones, infos


class Curve(BaseCallback):
    """Between updates: writes the policy and a point of the curve."""

    def __init__(self, out: Path, seed: int):
        super().__init__()
        self.out, self.seed = out, seed
        self.points: list[list[float]] = []
        self._updates = 0

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        self._updates += 1
        if self._updates % EVALUATE == 0:
            self.point()

    def point(self) -> None:
        """Write the policy as it stands, and what it costs on "validation"."""
        gamma = float(self.model.gamma)  # type: ignore[attr-defined]
        provenance = {"algorithm": "ppo", "seed": self.seed, "steps": self.num_timesteps, "gamma": gamma}
        write_policy(self.out, weights_of(self.model), provenance)
        costs = costs_per_metre(HoleLearned(self.out), "validation", 30)
        self.points.append([self.num_timesteps, float(costs.mean())])
        with whole(self.out / "curve.json") as part:
            part.write_text(json.dumps(self.points) + "\n", encoding="utf-8")
        print(f"{self.num_timesteps} steps: {costs.mean():.1f} EUR/m on validation", flush=True)


def weights_of(model: Any) -> dict[str, np.ndarray]:
    """The weights of the policy's mean, by the names of a policy."""
    network = model.policy.mlp_extractor.policy_net
    linear = [part for part in network if isinstance(part, torch.nn.Linear)]
    weights = {}
    for name, part in [*((f"layer{i}", part) for i, part in enumerate(linear)), ("action", model.policy.action_net)]:
        weights[f"{name}.weight"] = part.weight.detach().numpy()
        weights[f"{name}.bias"] = part.bias.detach().numpy()
    return weights


def train(out: Path, steps: int, seed: int, gamma: float, threads: int | None) -> list[list[float]]:
    """Train; returns the curve, (steps, EUR/m on "validation") a point."""
    torch.set_num_threads(1)
    rigs = DrillVecEnv("drillenv/DrillBit-v0", RIGS, threads=threads, costs={"metre": METRE})
    model = PPO(
        "MlpPolicy",
        Believing(rigs),
        gamma=gamma,
        gae_lambda=LAMBDA,
        n_steps=STEPS,
        batch_size=BATCH,
        n_epochs=EPOCHS,
        learning_rate=lambda left: LEARNING_RATE * max(left, LEAST),
        policy_kwargs={"net_arch": list(LAYERS), "log_std_init": NOISE},
        seed=seed,
        device="cpu",
    )
    with torch.no_grad():
        model.policy.action_net.bias.copy_(torch.tensor(BEGIN))  # type: ignore[operator]
    curve = Curve(out, seed)
    model.learn(steps, callback=curve)
    curve.point()
    rigs.close()
    return curve.points


def main(arguments: list[str] | None = None) -> int:
    """The command line."""
    about = (__doc__ or "").split("\n")[0]
    parser = argparse.ArgumentParser(prog="python -m drillenv.training.hole_ppo", description=about)
    parser.add_argument("--out", type=Path, required=True, help="folder of the policy")
    parser.add_argument("--timesteps", type=int, default=4_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--gamma", type=float, default=0.99, help="discount of a step of 15 s")
    parser.add_argument("--threads", type=int, default=None, help="of the rigs (default: all cores)")
    given = parser.parse_args(arguments)
    train(given.out, given.timesteps, given.seed, given.gamma, given.threads)
    return 0


if __name__ == "__main__":
    sys.exit(main())
