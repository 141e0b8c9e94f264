"""A trained policy, run with numpy alone: neither the library it was trained with nor torch is needed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from drillenv.controllers.policies import SHIPPED, Policy, read_policy


class Learned:
    """Acts as the policy it is given: without chance, by the mean of the distribution it was trained with.

    Args:
        policy: The folder of a policy that ``drillenv export`` wrote, a model that Stable-Baselines3
            saved (a file that ends in .zip), or a policy that was read already; by default the one that ships with the
            package.

    Raises:
        InputError: the folder holds no policy that can be used, see :func:`drillenv.controllers.policies.read_policy`.
    """

    sees_truth = False

    def __init__(self, policy: str | Path | Policy = SHIPPED):
        self.policy: Policy = policy if isinstance(policy, Policy) else read_policy(policy)
        weights = self.policy.weights
        names = [f"layer{i}" for i in range(len(self.policy.layers))]
        self._layers = [(weights[f"{name}.weight"].T, weights[f"{name}.bias"]) for name in names]
        self._action = weights["action.weight"].T, weights["action.bias"]
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Forget the episode so far."""
        self._seen = np.zeros((self.policy.stack, self.policy.centre.size), dtype=np.float32)
        self._hidden, self._cell = np.zeros((2, self.policy.lstm), dtype=np.float32)

    def act(self, observation: np.ndarray, info: dict[str, Any]) -> np.ndarray:
        """The mean action."""
        policy = self.policy
        self._seen[:-1] = self._seen[1:]
        self._seen[-1] = (observation - policy.centre) / policy.width
        values = self._seen.ravel()
        if policy.lstm:
            values = self._remember(values)
        for weight, bias in self._layers:
            values = values @ weight + bias
            values = np.tanh(values) if policy.activation == "tanh" else np.maximum(values, 0.0)
        weight, bias = self._action
        return policy.actions(values @ weight + bias)

    def _remember(self, values: np.ndarray) -> np.ndarray:
        """A step of the LSTM (Hochreiter and Schmidhuber, 1997, with forget gates); its output."""
        weights = self.policy.weights
        gates = weights["lstm.weight_input"] @ values + weights["lstm.weight_hidden"] @ self._hidden
        let_in, forget, new, let_out = np.split(gates + weights["lstm.bias"], 4)
        self._cell = _sigmoid(forget) * self._cell + _sigmoid(let_in) * np.tanh(new)
        self._hidden = _sigmoid(let_out) * np.tanh(self._cell)
        return self._hidden


def _sigmoid(values: np.ndarray) -> np.ndarray:
    """1 / (1 + exp(-values)), which cannot overflow in this form."""
    return 0.5 * (1.0 + np.tanh(0.5 * values))
