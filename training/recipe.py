"""What a policy is trained with: everything that decides on the result, but for the number of steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from types import MappingProxyType
from typing import Any

from drillenv.checks import InputError, choice, count, number, shown
from drillenv.controllers.policies import ACTIONS, ACTIVATIONS, MOST_LAYERS, MOST_STACKED, MOST_UNITS
from drillenv.env.registration import IDS

ALGORITHMS = ("ppo", "recurrent-ppo")
START = (116.5, 0.45, 0.9)
"""Hz, V and bar that an untrained policy asks for: a careful setting that gives single blows on most rocks."""
MOST_AHEAD = 100
CRITIC: Mapping[str, Any] = MappingProxyType(
    {
        "ahead": 0,
        "learning_rate": 5e-4,
        "noise": (0.3, 0.3, 0.5),
        "noise_end": (0.03, 0.02, 0.2),
        "noise_anneal": 600_000,
        "anneal": 600_000,
    }
)
"""What goes with a critic: there the noise has to be large for an action to be told from others."""


def option(default: Any, text: str) -> Any:
    """A field that is an option of the command line too."""
    return field(default=default, metadata={"help": text})


@dataclass(frozen=True, slots=True)
class Recipe:
    """See the help of ``python -m drillenv.training.train``.

    Raises:
        InputError: a value is not what it should be, or two of them contradict each other.
    """

    env: str = option("drillenv/DrillLayers-v0", f"one of {', '.join(IDS)}")
    algo: str = option("ppo", f"one of {', '.join(ALGORITHMS)}")
    seed: int = option(0, "of everything random")
    envs: int = option(64, "rigs that drill at the same time")
    stack: int = option(4, "observations that the policy sees at once, for the rock is hidden")
    rollout: int = option(16, "steps of each rig between two updates")
    batch: int = option(256, "steps of a minibatch")
    epochs: int = option(5, "passes over the steps of an update")
    learning_rate: float = option(1e-3, "of Adam, at the start")
    noise: tuple[float, ...] = option(
        (0.2, 0.2, 0.4), "standard deviations of frequency, amplitude and pressure over amplitude at the start"
    )
    noise_end: tuple[float, ...] = option((0.015, 0.01, 0.04), "the same at the end of the annealing")
    noise_anneal: int = option(300_000, "steps over which the noise goes down; then it stays")
    anneal: int = option(500_000, "steps over which the learning rate goes down; then it stays")
    ahead: int = option(4, "intervals over which copies of the rigs measure what an action earns; 0 for a critic")
    gamma: float = option(0.7, "discount of a control interval, of a critic")
    gae_lambda: float = option(0.6, "of the generalised advantage estimate of a critic")
    clip: float = option(0.2, "of the ratio of probabilities")
    layers: tuple[int, ...] = option((64, 64), "units of each layer, of policy and value alike")
    activation: str = option("tanh", f"one of {', '.join(ACTIVATIONS)}")
    lstm: int = option(64, "units of the LSTM of recurrent-ppo")
    evaluate_every: int = option(20_000, "steps between two evaluations on the scenario validation; 0 for none")
    episodes: int = option(30, "episodes of an evaluation")

    def __post_init__(self) -> None:
        checked = {
            "env": choice("env", self.env, IDS),
            "algo": choice("algo", self.algo, ALGORITHMS),
            "seed": count("seed", self.seed, 0, 2**31 - 1),
            "envs": count("envs", self.envs, 1, 4096),
            "stack": count("stack", self.stack, 1, MOST_STACKED),
            "rollout": count("rollout", self.rollout, 2, 65_536),
            "batch": count("batch", self.batch, 2, 2**20),
            "epochs": count("epochs", self.epochs, 1, 100),
            "learning_rate": number("learning_rate", self.learning_rate, 1e-8, 1.0),
            "noise": _noise("noise", self.noise),
            "noise_end": _noise("noise_end", self.noise_end),
            "noise_anneal": count("noise_anneal", self.noise_anneal, 1, 10**12),
            "anneal": count("anneal", self.anneal, 1, 10**12),
            "ahead": count("ahead", self.ahead, 0, MOST_AHEAD),
            "gamma": number("gamma", self.gamma, 0.0, 0.9999),
            "gae_lambda": number("gae_lambda", self.gae_lambda, 0.0, 1.0),
            "clip": number("clip", self.clip, 1e-3, 1.0),
            "layers": _layers(self.layers),
            "activation": choice("activation", self.activation, ACTIVATIONS),
            "lstm": count("lstm", self.lstm, 1, MOST_UNITS),
            "evaluate_every": count("evaluate_every", self.evaluate_every, 0, 10**12),
            "episodes": count("episodes", self.episodes, 1, 30),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        if self.ahead and self.algo == "recurrent-ppo":
            raise InputError(f"ahead is {self.ahead}, but the copies of a rig have no memory: give recurrent-ppo 0")
        if self.batch > self.envs * self.rollout:
            raise InputError(
                f"batch is {self.batch}, more than the {self.envs * self.rollout} steps of an update "
                "(envs times rollout): give a smaller batch or a longer rollout"
            )

    @property
    def update(self) -> int:
        """Steps between two updates, all rigs together."""
        return self.envs * self.rollout

    def as_record(self) -> dict[str, Any]:
        """The recipe as JSON takes it."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}


def read_recipe(record: object) -> Recipe:
    """The recipe of a record as :meth:`Recipe.as_record` makes it; what it leaves out keeps its default.

    Raises:
        InputError: not a record, an unknown name, or a value that is not what it should be.
    """
    names = [each.name for each in fields(Recipe)]
    if not isinstance(record, Mapping):
        raise InputError(f"recipe is {shown(record)}: give a record of {', '.join(names)}")
    for name in record:
        if name not in names:
            raise InputError(f"recipe has {shown(name)}: its names are {', '.join(names)}")
    return Recipe(**record)


def _noise(name: str, given: object) -> tuple[float, ...]:
    if not isinstance(given, list | tuple) or len(given) != len(ACTIONS):
        raise InputError(f"{name} is {shown(given)}: give {len(ACTIONS)} numbers, for {', '.join(ACTIONS)}")
    return tuple(number(f"{name} of an action", each, 1e-3, 10.0) for each in given)


def _layers(given: object) -> tuple[int, ...]:
    if not isinstance(given, list | tuple) or not 1 <= len(given) <= MOST_LAYERS:
        raise InputError(f"layers is {shown(given)}: give 1 to {MOST_LAYERS} numbers of units")
    return tuple(count("units of a layer", units, 1, MOST_UNITS) for units in given)
