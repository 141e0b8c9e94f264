"""Train the network that tells from the readings of a hole what cannot be read: wear, abrasivity, stiffness.

    python -m drillenv.training.hole_belief --json belief.json

drills holes at settings that wander over all that can be set, changes bits at any wear, and fits the network to the
truth: means by their squared error, standard deviations by the likelihood of normal distributions. It writes
``controllers/plant_models/hole_belief.npz`` anew, and says how far the estimates are from the truth on holes that it
was not trained on.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from tqdm import tqdm

from drillenv.checks import InputError, count
from drillenv.cli import Parser
from drillenv.controllers.hole.belief import (
    ESTIMATES,
    FEATURES,
    FILE,
    LOG_DEVIATIONS,
    NAMES,
    RECKONED,
    SHOWN,
    STIFFNESS,
    UNITS,
    Features,
    Weights,
)
from drillenv.controllers.hole.learned import settings_of
from drillenv.env.hole.bit import STRENGTH
from drillenv.env.hole.envs import DrillBitVectorEnv
from drillenv.files import check_writable, whole

RIGS = 128
"""Holes that are drilled at the same time."""
CHUNK = 64
"""Steps over which gradients are followed back."""
CHANGED = 0.06
"""Probability that a step begins with another setting."""
JITTER = 0.06
"""Standard deviation of the outputs from step to step."""
RATE = 2e-3
"""Learning rate of Adam at the start; it falls to 0 by a cosine."""
MOST_GRADIENT = 1.0
"""Norm to which gradients are clipped."""
WIDTHS = torch.tensor([0.3, 0.6, 0.4, 0.06])
"""Spread of each of NAMES over all holes, about."""
HELD_OUT = 1000
"""Steps of each of the rigs that the error is told of."""


class Drilled(NamedTuple):
    """What was seen of holes, and the truth."""

    features: np.ndarray
    """(steps, rigs, FEATURES) float32."""
    truth: np.ndarray
    """(steps, rigs, len(NAMES)) float32."""
    begins: np.ndarray
    """(steps, rigs) whether a hole begins."""


class Wanderer:
    """Settings that wander over all that can be set, and bits that are changed at any wear.

    Args:
        n: Number of rigs.
        rng: Draws everything.
    """

    def __init__(self, n: int, rng: np.random.Generator):
        self._rng = rng
        self._outputs, self._worn = self._draw(n), self._threshold(n)

    def _draw(self, n: int) -> np.ndarray:
        draw = self._rng
        return np.column_stack([draw.uniform(-0.7, 1.0, n), draw.uniform(-1.0, 1.0, n), draw.normal(-0.3, 0.35, n)])

    def _threshold(self, n: int) -> np.ndarray:
        return self._rng.uniform(0.1, 1.5 * STRENGTH, n)

    def act(self, wear: np.ndarray) -> np.ndarray:
        """(n, 4) actions where bits are so worn (n,)."""
        n = wear.size
        other = self._rng.random(n) < CHANGED
        self._outputs[other] = self._draw(int(other.sum()))
        change = wear > self._worn
        self._worn[change] = self._threshold(int(change.sum()))
        settings = settings_of(self._outputs + JITTER * self._rng.standard_normal((n, 3)))
        return np.column_stack([settings, np.where(change, 1.0, -1.0)]).astype(np.float32)


def drill(steps: int, seed: int, threads: int | None = None) -> Drilled:
    """Drill drawn holes with RIGS rigs for so many steps each."""
    envs = DrillBitVectorEnv(RIGS, None, autoreset_mode="SameStep", threads=threads)
    wanderer, seen = Wanderer(RIGS, np.random.default_rng(seed)), Features(RIGS)
    made = Drilled(
        np.empty((steps, RIGS, FEATURES), dtype=np.float32),
        np.empty((steps, RIGS, len(NAMES)), dtype=np.float32),
        np.zeros((steps, RIGS), dtype=bool),
    )
    readings, info = envs.reset(seed=seed)
    made.begins[0] = True
    for step in tqdm(range(steps), desc="drilling", disable=None):
        if step:
            readings, _, ended, cut, info = envs.step(wanderer.act(info["bit_wear"]))
            made.begins[step] = ended | cut
            seen.forget(np.flatnonzero(made.begins[step]))
        made.features[step] = seen.of(readings)
        loading, unloading = info["loading_stiffness"], info["unloading_stiffness"]
        rock = [info["abrasivity"], loading / STIFFNESS, unloading / loading]
        made.truth[step] = np.column_stack([info["bit_wear"], *np.log(rock)])
    envs.close()
    return made


class Network(torch.nn.Module):
    """The network of :class:`drillenv.controllers.hole.belief.Belief`, to be trained."""

    def __init__(self) -> None:
        super().__init__()
        self.input = torch.nn.Linear(FEATURES, UNITS)
        self.cell = torch.nn.GRUCell(UNITS, UNITS)
        self.output = torch.nn.Linear(UNITS, ESTIMATES)

    def forward(
        self, features: torch.Tensor, begins: torch.Tensor, hidden: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Outputs (steps, rigs, ESTIMATES) for features of that many steps, and the state (rigs, UNITS) after them."""
        given, states = torch.tanh(self.input(features)), []
        for step in range(features.shape[0]):
            hidden = self.cell(given[step], hidden * ~begins[step, :, None])
            states.append(hidden)
        return self.output(torch.stack(states)), hidden

    def weights(self) -> Weights:
        """As :class:`~drillenv.controllers.hole.belief.Belief` takes them."""
        cell = (self.cell.weight_ih, self.cell.weight_hh, self.cell.bias_ih, self.cell.bias_hh)
        every = (self.input.weight, self.input.bias, *cell, self.output.weight, self.output.bias)
        return Weights(*(each.detach().numpy().copy() for each in every))


def loss_of(outputs: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Squared errors of the means in units of WIDTHS, and what makes standard deviations likely, where means are given.

    The likelihood of both at once drives the network to what is known best: its gradient grows as one over the square
    of the standard deviation (Seitzer et al., On the pitfalls of heteroscedastic uncertainty estimation, ICLR 2022).
    """
    n = len(NAMES)
    means, log_deviation = outputs[..., :n], outputs[..., n:].clamp(*LOG_DEVIATIONS)
    away = (means - truth) / WIDTHS
    likely = 0.5 * ((means.detach() - truth) * torch.exp(-log_deviation)) ** 2 + log_deviation
    return (away**2).mean() + 0.1 * likely.mean()


def fit(made: Drilled, epochs: int, seed: int) -> Network:
    """A network fitted to what was drilled, by Adam."""
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    network = Network()
    optimizer = torch.optim.Adam(network.parameters(), RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, epochs)
    features, truth, begins = (torch.from_numpy(each) for each in made)
    with tqdm(total=epochs, desc="fitting", disable=None) as bar:
        for _ in range(epochs):
            hidden, total = torch.zeros(RIGS, UNITS), 0.0
            for first in range(0, len(features), CHUNK):
                part = slice(first, first + CHUNK)
                outputs, hidden = network(features[part], begins[part], hidden.detach())
                loss = loss_of(outputs, truth[part])
                optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(network.parameters(), MOST_GRADIENT)
                optimizer.step()
                total += loss.item() * len(outputs) / len(features)
            schedule.step()
            bar.update()
            bar.set_postfix(loss=f"{total:.3f}")
    return network


def errors_of(network: Network, made: Drilled) -> dict[str, float]:
    """Root mean squares of what is estimated less the truth, and of the wear that is reckoned without the network."""
    features, begins = torch.from_numpy(made.features), torch.from_numpy(made.begins)
    with torch.no_grad():
        outputs, _ = network(features, begins, torch.zeros(begins.shape[1], UNITS))
    away = (outputs[..., : len(NAMES)].numpy() - made.truth) ** 2
    reckoned = made.features[..., SHOWN : SHOWN + RECKONED].sum(axis=-1) - made.truth[..., 0]
    found = {name: float(np.sqrt(away[..., j].mean())) for j, name in enumerate(NAMES)}
    return {**found, "reckoned_wear": float(np.sqrt((reckoned**2).mean()))}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line. Returns the exit code: 0, 2 on bad input."""
    parser = Parser(prog="python -m drillenv.training.hole_belief", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--steps", type=int, default=8_000, help=f"of each of {RIGS} rigs (default 8000)")
    parser.add_argument("--epochs", type=int, default=28, help="passes over them (default 28)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=FILE, help="the weights (default: those that controllers read)")
    parser.add_argument("--json", type=Path, help="write the errors on holes held out")
    try:
        given = parser.parse_args(arguments)
        steps, epochs = count("steps", given.steps, 2, 10**6), count("epochs", given.epochs, 1, 1000)
        seed = count("seed", given.seed, 0, 2**31 - 2)
        for file in (given.out, given.json):
            if file is not None:
                check_writable(file)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    network = fit(drill(steps, seed), epochs, seed)
    with whole(given.out) as part, part.open("wb") as stream:
        np.savez(stream, **network.weights()._asdict())
    errors = errors_of(network, drill(min(steps, HELD_OUT), seed + 1))
    if given.json is not None:
        with whole(given.json) as part:
            part.write_text(json.dumps(errors, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(errors))
    return 0


if __name__ == "__main__":
    sys.exit(main())
