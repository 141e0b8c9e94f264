"""What a policy is trained with: everything that decides on the result, but for the number of steps."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from types import MappingProxyType
from typing import Any

from drillenv.checks import InputError, choice, count, number, shown
from drillenv.controllers.policies import ACTIONS, ACTIVATIONS, MOST_LAYERS, MOST_STACKED, MOST_UNITS
from drillenv.env.registration import BUDGETS, HIDDEN_RIGS, HOLE_IDS, IDS

RECURRENT = "recurrent-ppo"
ALGORITHMS: Mapping[str, str] = MappingProxyType(
    {
        "ppo-vine": "PPO whose advantages are measured on copies of the rigs",
        "ppo": "PPO with a critic",
        "ppo-lagrangian": "PPO with a critic, on a budget of force above the rating",
        RECURRENT: "PPO with a critic and an LSTM",
        "sac": "SAC",
        "td3": "TD3",
    }
)
"""The algorithms by name; all but ppo-vine are those of Stable-Baselines3 and sb3-contrib as they are."""
LAGRANGIAN = "ppo-lagrangian"
WITH_CRITIC = ("ppo", LAGRANGIAN)
"""On rigs as they are, or on prepared ones."""
PREPARED = ("ppo-vine", RECURRENT)
"""Always on prepared rigs, holes apart: scaled readings, pressure over amplitude as output, noise that is annealed."""
OFF_POLICY = ("sac", "td3")
"""They have a buffer of all that they saw, which is too large for checkpoints: no resume."""
HOLE_PREPARED = ("ppo-vine", "ppo")
"""Those that learn to drill a hole on prepared rigs; ppo does on rigs as they are too."""
HOLE_ALGORITHMS = (*HOLE_PREPARED, RECURRENT, *OFF_POLICY)
"""Those that learn to drill a hole."""
START = (116.5, 0.45, 0.9)
"""Hz, V and bar that an untrained policy on prepared rigs asks for: a careful setting that gives single blows on most
rocks."""
TIMESTEPS = {"sac": 100_000, "td3": 100_000}
"""Steps in all where none are given, in place of USUAL_TIMESTEPS."""
USUAL_TIMESTEPS = 500_000
HOLE_TIMESTEPS = 4_000_000
HOLE_VINE_TIMESTEPS = 150_000
CHECKPOINT_SECONDS = 15.0
"""Between two checkpoints."""
MOST_AHEAD = 100
NOT_ASKED = ("id", "kind", "num_envs", "threads", "autoreset_mode", "vectorization_mode", "render_mode", "info_keys")
"""Arguments of environments that are not for the user of training."""
USUAL: Mapping[str, Any] = MappingProxyType(
    {
        "prepared": True,
        "envs": 64,
        "stack": 4,
        "rollout": 16,
        "batch": 256,
        "epochs": 5,
        "learning_rate": 1e-3,
        "noise": (0.2, 0.2, 0.4),
        "noise_end": (0.015, 0.01, 0.04),
        "noise_anneal": 300_000,
        "anneal": 500_000,
        "ahead": 4,
        "gamma": 0.7,
        "gae_lambda": 0.6,
        "clip": 0.2,
        "layers": (64, 64),
        "activation": "tanh",
        "lstm": 64,
        "cost_limit": BUDGETS["DrillLayers"],
        "multiplier_rate": 0.002,
        "multiplier_gain": 0.05,
        "evaluate_every": 20_000,
    }
)
"""What is not given, with ppo-vine."""
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
"""What goes with a critic on prepared rigs: there the noise has to be large for an action to be told from others."""
PLAIN: Mapping[str, Any] = MappingProxyType({"prepared": False, "ahead": 0, "stack": 1, "gamma": 0.99})
PLAIN_PPO: Mapping[str, Any] = MappingProxyType(
    {**PLAIN, "envs": 8, "rollout": 256, "batch": 64, "epochs": 10, "learning_rate": 3e-4, "gae_lambda": 0.95}
)
OTHERWISE: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "ppo-vine": {},
        RECURRENT: {**CRITIC, "stack": 1, "batch": 512},
        **dict.fromkeys(WITH_CRITIC, PLAIN_PPO),
        "sac": {**PLAIN, "envs": 1, "learning_rate": 3e-4, "layers": (256, 256), "activation": "relu"},
        "td3": {**PLAIN, "envs": 1, "learning_rate": 1e-3, "layers": (400, 300), "activation": "relu"},
    }
)
"""What is otherwise with the other algorithms: the numbers of Stable-Baselines3 itself, and, for ppo, its 2048 steps of
an update shared out among eight rigs."""

ROCK: Mapping[str, Any] = MappingProxyType({"cost_limit": BUDGETS["Drill"]})
"""What is otherwise with one rock an episode."""
HOLE: Mapping[str, Any] = MappingProxyType(
    {
        "ahead": 0,
        "stack": 1,
        "rollout": 128,
        "batch": 2048,
        "anneal": HOLE_TIMESTEPS,
        "gamma": 0.99,
        "gae_lambda": 0.95,
        "evaluate_every": 200_000,
    }
)
"""What is otherwise where a hole is drilled by ppo on rigs that are prepared, in a way of their own."""
HOLE_VINE: Mapping[str, Any] = MappingProxyType(
    {
        "ahead": 24,
        "rollout": 32,
        "batch": 512,
        "anneal": HOLE_VINE_TIMESTEPS,
        "noise": (0.3, 0.3, 0.3),
        "noise_end": (0.03, 0.03, 0.05),
        "noise_anneal": 100_000,
        "evaluate_every": 25_000,
    }
)
"""What is then otherwise with ppo-vine, whose steps say more and take fifty times as long."""
PLAIN_RECURRENT: Mapping[str, Any] = MappingProxyType({**PLAIN_PPO, "rollout": 128, "batch": 128, "lstm": 256})
"""What is otherwise where recurrent-ppo drills a hole: the numbers of sb3-contrib itself, on eight rigs."""


def option(default: Any, text: str) -> Any:
    """A field that is an option of the command line too; where ``default`` is None, the algorithm decides."""
    return field(default=default, metadata={"help": text})


@dataclass(frozen=True, slots=True)
class Recipe:
    """See the help of ``drillenv train``. What is left out is that of the algorithm, see USUAL and OTHERWISE.

    Raises:
        InputError: a value is not what it should be, or two of them contradict each other.
    """

    env: str = option("drillenv/DrillLayers-v0", f"one of {', '.join((*IDS, *HOLE_IDS))}")
    env_kwargs: Mapping[str, Any] = option(None, "other arguments of gymnasium.make, as JSON")
    algo: str = option("ppo-vine", f"one of {', '.join(ALGORITHMS)}")
    algo_kwargs: Mapping[str, Any] = option(None, "other arguments of the class in Stable-Baselines3, as JSON")
    seed: int = option(0, "of everything random")
    prepared: bool = option(None, "scaled readings, pressure over amplitude as output, noise that is annealed")
    envs: int = option(None, "rigs that drill at the same time")
    stack: int = option(None, "observations that the policy sees at once, for the rock is hidden")
    rollout: int = option(None, "steps of each rig between two updates")
    batch: int = option(None, "steps of a minibatch")
    epochs: int = option(None, "passes over the steps of an update")
    learning_rate: float = option(None, "of Adam, at the start")
    noise: tuple[float, ...] = option(
        None, "standard deviations of frequency, amplitude and pressure over amplitude at the start"
    )
    noise_end: tuple[float, ...] = option(None, "the same at the end of the annealing")
    noise_anneal: int = option(None, "steps over which the noise goes down; then it stays")
    anneal: int = option(None, "steps over which the learning rate goes down; then it stays")
    ahead: int = option(None, "intervals over which copies of the rigs measure what an action earns; 0 for a critic")
    gamma: float = option(None, "discount of a control interval, of a critic")
    gae_lambda: float = option(None, "of the generalised advantage estimate of a critic")
    clip: float = option(None, "of the ratio of probabilities")
    layers: tuple[int, ...] = option(None, "units of each layer, of policy and value alike")
    activation: str = option(None, f"one of {', '.join(ACTIVATIONS)}")
    lstm: int = option(None, "units of the LSTM of recurrent-ppo")
    cost_limit: float = option(None, "N above the rating in the mean of all steps, that ppo-lagrangian keeps to")
    multiplier_rate: float = option(None, "mm/s a kN that an update adds to the multiplier for each N above the limit")
    multiplier_gain: float = option(None, "the same, by the cost of the last rollout alone")
    evaluate_every: int = option(None, "steps between two evaluations on the scenario validation; 0 for none")
    episodes: int = option(30, "episodes of an evaluation")

    def __post_init__(self) -> None:
        algo = choice("algo", self.algo, tuple(ALGORITHMS))
        for name, value in {**usual(algo, self.prepared, self.hole), **(ROCK if self.env == IDS[0] else {})}.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        for name, value in self._checked().items():
            object.__setattr__(self, name, value)
        self._check_together()

    def _checked(self) -> dict[str, Any]:
        """Every value, if it is what it should be."""
        return {
            "env": choice("env", self.env, (*IDS, *HOLE_IDS)),
            "env_kwargs": self._unpenalised(_env_kwargs(self.env_kwargs)),
            "algo_kwargs": _json_record("algo_kwargs", self.algo_kwargs),
            "seed": count("seed", self.seed, 0, 2**31 - 1),
            "prepared": choice("prepared", self.prepared, (True, False)),
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
            "cost_limit": number("cost_limit", self.cost_limit, 0.0, 1e5, "N"),
            "multiplier_rate": number("multiplier_rate", self.multiplier_rate, 1e-6, 1e3, "mm/s a kN"),
            "multiplier_gain": number("multiplier_gain", self.multiplier_gain, 0.0, 1e3, "mm/s a kN"),
            "evaluate_every": count("evaluate_every", self.evaluate_every, 0, 10**12),
            "episodes": count("episodes", self.episodes, 1, 30),
        }

    def _unpenalised(self, given: dict[str, Any]) -> dict[str, Any]:
        """The arguments of the environment; where the task is constrained, with a reward that does not count force."""
        weights = {} if given.get("reward") is None else given["reward"]
        if not self.constrained or not isinstance(weights, Mapping):  # what is none, the environment says best
            return given
        if weights.get("force", 0.0) != 0.0:
            raise InputError(
                f"reward force is {shown(weights['force'])}, but {self.algo} finds that weight by itself: "
                "leave it out, or give 0"
            )
        return {**given, "reward": {**weights, "force": 0.0}}

    def _check_together(self) -> None:
        """See that no two values contradict each other."""
        if self.hole and self.algo not in HOLE_ALGORITHMS:
            known = ", ".join(HOLE_ALGORITHMS)
            raise InputError(f"{self.env} is a hole, which {self.algo} does not learn: give {known}")
        if self.ahead and self.algo != "ppo-vine":
            raise InputError(f"ahead is {self.ahead}, but only ppo-vine measures on copies: leave it out, or give 0")
        if not self.ahead and self.algo == "ppo-vine":
            raise InputError("ahead is 0, which is a critic: give ppo --prepared for that, or 1 and more for ppo-vine")
        either, prepared = (("ppo",), HOLE_PREPARED) if self.hole else (WITH_CRITIC, PREPARED)
        if self.algo not in either and self.prepared != (self.algo in prepared):
            state = "prepared" if self.prepared else "not prepared"
            raise InputError(f"algo is {self.algo} and the rigs are {state}: leave prepared out with it")
        if self.believing and (self.stack, self.activation) != (1, "tanh"):
            raise InputError("stack and activation are those of policies for holes, 1 and tanh: leave them out")
        if self.prepared:
            for name in ("actions", "observations"):
                if name in self.env_kwargs:
                    raise InputError(f"env_kwargs has {name}, which prepared rigs decide: leave it out, or take ppo")
            if self.algo_kwargs:
                raise InputError("algo_kwargs go with ppo, sac and td3 on rigs as they are: leave them out")
        if self.algo not in OFF_POLICY and self.batch > self.envs * self.rollout:
            raise InputError(
                f"batch is {self.batch}, more than the {self.envs * self.rollout} steps of an update "
                "(envs times rollout): give a smaller batch or a longer rollout"
            )

    @property
    def hole(self) -> bool:
        """Whether a hole is drilled, at the least cost."""
        return self.env in HOLE_IDS

    @property
    def believing(self) -> bool:
        """Whether a hole is drilled by what can be known of it, on prepared rigs."""
        return self.hole and self.prepared

    @property
    def anneals_noise(self) -> bool:
        """Whether the noise of the actions is annealed; else it is learned.

        Advantages that are measured against the mirror image have no gradient by the noise: an action earns as much as
        its opposite loses. In a hole the noise on the change of bits stays as it begins then.
        """
        return self.prepared and (self.ahead > 0 or not self.believing)

    @property
    def constrained(self) -> bool:
        """Whether a budget of force above the rating is kept to."""
        return self.algo == LAGRANGIAN

    @property
    def rig_errors(self) -> float:
        """Stated errors by which the constants of the rigs are off, drawn anew for each episode."""
        given = self.env_kwargs.get("errors")
        return given if given is not None else float(self.env == HIDDEN_RIGS)

    @property
    def timesteps(self) -> int:
        """Steps in all where none are given."""
        if self.believing:
            return HOLE_VINE_TIMESTEPS if self.ahead else HOLE_TIMESTEPS
        return TIMESTEPS.get(self.algo, USUAL_TIMESTEPS)

    @property
    def unit(self) -> str:
        """Of a score: the mean reward, or what a metre of hole costs."""
        return "EUR/m" if self.hole else "mm/s"

    @property
    def update(self) -> int:
        """Steps between two updates, all rigs together."""
        return self.envs if self.algo in OFF_POLICY else self.envs * self.rollout

    def as_record(self) -> dict[str, Any]:
        """The recipe as JSON takes it."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}


def usual(algo: str, prepared: bool | None = None, hole: bool = False) -> dict[str, Any]:
    """What is not given is this, with an algorithm, on rigs that are prepared, not, or (None) as it has them."""
    if hole and algo in HOLE_PREPARED and prepared is not False:
        return {**USUAL, **HOLE, **(HOLE_VINE if algo == "ppo-vine" else {})}
    if hole and algo == RECURRENT:
        return {**USUAL, **PLAIN_RECURRENT}
    return {**USUAL, **(CRITIC if algo in WITH_CRITIC and prepared is True else OTHERWISE[algo])}


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


def renamed(record: Mapping[str, Any]) -> dict[str, Any]:
    """A record of the time when "ppo" was the name of ppo-vine too, and all rigs were prepared."""
    vine = record.get("algo", "ppo") == "ppo" and record.get("ahead", USUAL["ahead"])
    return {**record, "prepared": True, **({"algo": "ppo-vine"} if vine else {})}


def _env_kwargs(given: object) -> dict[str, Any]:
    """A copy of the arguments of an environment; what they are worth is seen where it is made."""
    found = _json_record("env_kwargs", given)
    for name in found:
        if name in NOT_ASKED:
            raise InputError(f"env_kwargs has {name}, which training decides: leave it out")
    return found


def _json_record(name: str, given: object) -> dict[str, Any]:
    """A copy of a record of JSON, empty where none is given."""
    if given is None:
        return {}
    if not isinstance(given, Mapping) or not all(isinstance(key, str) for key in given):
        raise InputError(f'{name} is {shown(given)}: give a record of JSON, such as {{"rock": 4}}')
    try:
        return json.loads(json.dumps(dict(given), allow_nan=False))
    except (TypeError, ValueError, RecursionError):
        raise InputError(f"{name} is {shown(given)}: give a record that JSON can hold") from None


def _noise(name: str, given: object) -> tuple[float, ...]:
    if not isinstance(given, list | tuple) or len(given) != len(ACTIONS):
        raise InputError(f"{name} is {shown(given)}: give {len(ACTIONS)} numbers, for {', '.join(ACTIONS)}")
    return tuple(number(f"{name} of an action", each, 1e-3, 10.0) for each in given)


def _layers(given: object) -> tuple[int, ...]:
    if not isinstance(given, list | tuple) or not 1 <= len(given) <= MOST_LAYERS:
        raise InputError(f"layers is {shown(given)}: give 1 to {MOST_LAYERS} numbers of units")
    return tuple(count("units of a layer", units, 1, MOST_UNITS) for units in given)
