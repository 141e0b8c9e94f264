"""The commands around controllers: league, train, export, record and film. Each imports what it needs as it is run."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

from drillenv.checks import InputError, choice, count, shown
from drillenv.cli_options import Parser, plain_number, whole_number

EXTRAS: dict[str, tuple[str, ...]] = {
    "datasets": ("minari", "safetensors"),
    "controllers": ("control", "safetensors"),
    "train": ("control", "safetensors", "sb3_contrib", "stable_baselines3", "tensorboard", "torch"),
}
"""Modules that the extras of the package bring."""
CONTROLLERS = (
    "names of this package, controllers that are installed, package.module:Class, policies (folders), or models of "
    "Stable-Baselines3 (files that end in .zip); ROW=CONTROLLER gives a row a name of its own"
)
NOISE = ("noise", "noise_end", "noise_anneal")
"""ppo has no use for them in holes, where it learns its noise."""
ANNEALED = (*NOISE, "anneal")
ON_POLICY = ("rollout", "epochs", "gae_lambda", "clip")
BUDGET = ("cost_limit", "multiplier_rate", "multiplier_gain")
NO_USE: dict[str, tuple[str, ...]] = {
    "ppo-vine": ("gae_lambda", "lstm", *BUDGET),
    "recurrent-ppo": BUDGET,
    "ppo": (*ANNEALED, "ahead", "lstm", *BUDGET),
    "ppo-lagrangian": (*ANNEALED, "ahead", "lstm"),
    "sac": (*ANNEALED, *ON_POLICY, "ahead", "lstm", *BUDGET),
    "td3": (*ANNEALED, *ON_POLICY, "ahead", "lstm", *BUDGET),
}
"""Numbers of a recipe that an algorithm has no use for; of ppo and ppo-lagrangian where rigs are as they are."""
NO_USE_IN_HOLES = ("lstm", "stack", "activation", *BUDGET)


@contextmanager
def needs(extra: str) -> Iterator[None]:
    """Say in one line which extra is missing where the block imports what is not installed.

    Raises:
        InputError: it is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing not in EXTRAS[extra]:
            raise
        raise InputError(f"{missing} is not installed: pip install drillenv[{extra}]") from None


def _filled(extra: str, fill: Callable[[Parser], None]) -> Callable[[Parser], None]:
    """``fill``, with a line where what it imports is not installed."""

    def filled(parser: Parser) -> None:
        with needs(extra):
            fill(parser)

    return filled


def add_league(parser: Parser) -> None:
    """The command ``league``."""
    parser.fill = _filled("controllers", _league_options)
    parser.set_defaults(run=_league)


def add_train(parser: Parser) -> None:
    """The command ``train``."""
    parser.fill = _filled("train", _train_options)
    parser.set_defaults(run=_train)


def add_export(parser: Parser) -> None:
    """The command ``export``."""
    parser.add_argument("--run", dest="folder", metavar="DIR", help="folder of a run of drillenv train")
    parser.add_argument("--model", metavar="FILE.zip", help="a model that Stable-Baselines3 saved")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for the policy; made if it is not there")
    parser.add_argument("--which", metavar="{best,last}", help="of a run, by its evaluations (default best)")
    parser.add_argument("--env", metavar="ID", help="what a model was trained on (default drillenv/DrillLayers-v0)")
    parser.set_defaults(run=_export, compiles=False)


def add_record(parser: Parser) -> None:
    """The command ``record``."""
    note = f"who drills, in turns of an episode: {CONTROLLERS}"
    parser.add_argument("--controllers", nargs="+", required=True, metavar="NAME", help=note)
    note = "name of the dataset for Minari, such as drillenv/rules-v0"
    parser.add_argument("--dataset", required=True, metavar="NAME", help=note)
    parser.add_argument("--out", metavar="DIR", help="folder of the datasets (default that of Minari)")
    note = "what is drilled (default drillenv/DrillLayers-v0)"
    parser.add_argument("--env", default="drillenv/DrillLayers-v0", metavar="ID", help=note)
    parser.add_argument("--scenario", default="train", help="a frozen set, or a file of one (default train)")
    parser.add_argument("--episodes", type=whole_number, metavar="N", help="the first so many (default all)")
    parser.add_argument("--steps", type=whole_number, metavar="N", help="of each episode (default as registered)")
    parser.add_argument("--threads", type=whole_number, metavar="N", help="threads of the rigs (default all cores)")
    _add_trust(parser)
    parser.set_defaults(run=_record)


def add_film(parser: Parser) -> None:
    """The command ``film``."""
    parser.add_argument("--controllers", nargs="+", required=True, metavar="NAME", help=CONTROLLERS)
    parser.add_argument("--out", required=True, metavar="FILE.gif", help="where the film goes")
    parser.add_argument("--scenario", default="test", help="a frozen set, or a file of one (default test)")
    parser.add_argument("--episode", type=whole_number, default=0, metavar="N", help="of the scenario (default 0)")
    parser.add_argument(
        "--first", type=whole_number, default=0, metavar="N", help="steps before the first picture (default 0)"
    )
    parser.add_argument(
        "--frames", type=whole_number, default=48, metavar="N", help="pictures, one every 0.25 s (default 48)"
    )
    note = "of each controller's picture in pixels (default 640)"
    parser.add_argument("--width", type=whole_number, default=640, metavar="N", help=note)
    _add_trust(parser)
    parser.set_defaults(run=_film)


def _add_trust(parser: Parser) -> None:
    note = "let Stable-Baselines3 load models, which runs whatever is pickled in their files: for your own files only"
    parser.add_argument("--trust-pickle", action="store_true", help=note)


# --- league


def _league_options(parser: Parser) -> None:
    from drillenv.training.conditions import CONDITIONS
    from drillenv.training.evaluate import ALL
    from drillenv.training.hole_league import LEARNED, ROWS

    note = f"all, or of {', '.join(ALL)}; on holes of {', '.join((*ROWS, LEARNED))}; {CONTROLLERS}"
    parser.add_argument("--controllers", nargs="+", default=["all"], metavar="NAME", help=note)
    note = "policies, each a run of the row of its algorithm"
    parser.add_argument("--policies", nargs="+", default=[], metavar="DIR", help=note)
    note = f"one of the conditions {', '.join(CONDITIONS)}, a frozen set, or a file of one (default test)"
    parser.add_argument("--scenario", default="test", help=note)
    note = (
        "of a scenario that is no condition (default DrillLayers); DrillBit has holes, and what a metre of them costs"
    )
    parser.add_argument("--environment", help=note)
    parser.add_argument("--episodes", type=whole_number, metavar="N", help="the first so many (default all)")
    parser.add_argument("--steps", type=whole_number, metavar="N", help="of each episode (default as registered)")
    parser.add_argument("--threads", type=whole_number, metavar="N", help="threads of the rigs (default all cores)")
    note = "write the record to this file, after each row; other rows in it stay"
    parser.add_argument("--json", metavar="FILE.json", help=note)
    note = "write the table to this file, or into its place in a page"
    parser.add_argument("--table", metavar="FILE.md", help=note)
    _add_trust(parser)


def _league(given: argparse.Namespace) -> None:
    from drillenv.env.registration import KINDS
    from drillenv.training.hole_league import ENVIRONMENT

    if given.environment is not None and choice("environment", given.environment, (*KINDS, ENVIRONMENT)) == ENVIRONMENT:
        _hole_league(given)
        return
    from drillenv.training.conditions import condition
    from drillenv.training.evaluate import evaluate, read_record
    from drillenv.training.league_table import league_table, write_table

    chosen = condition(given.scenario, given.environment)
    wanted = _entries(given.controllers, given.policies, given.trust_pickle)
    threads = None if given.threads is None else count("threads", given.threads, 1, 1024)
    kept, save = _kept(given, read_record)
    with _saying_what_is_kept():
        record = evaluate(wanted, given.scenario, chosen, given.episodes, given.steps, kept, threads, save)
    save(record)
    if given.table is not None:
        write_table(given.table, record)
    print(league_table(record))


def _hole_league(given: argparse.Namespace) -> None:
    from drillenv.training import hole_league
    from drillenv.training.evaluate import read_record
    from drillenv.training.league_table import put

    for name, value in (("threads", given.threads), ("trust-pickle", given.trust_pickle or None)):
        if value is not None:
            raise InputError(f"--{name} has no use with {given.environment}: leave it out")
    _look_here(given.controllers)
    wanted = hole_league.entries(given.controllers, given.policies)
    kept, save = _kept(given, lambda file: read_record(file, hole_league.FORMAT, "rows"))
    with _saying_what_is_kept():
        record = hole_league.evaluate(wanted, given.scenario, given.episodes, given.steps, kept, save)
    save(record)
    rows = hole_league.league_table(record)
    if given.table is not None:
        name = given.environment
        put(given.table, {f"league {name}": hole_league.page_part(record), f"league-rows {name}": rows})
    print(rows)


def _kept(
    given: argparse.Namespace, read: Callable[[str], dict[str, Any]]
) -> tuple[dict[str, Any] | None, Callable[[dict[str, Any]], None]]:
    """The record in the file of --json, where there is one, and what writes it anew; both files can be written to."""
    from drillenv.files import check_writable
    from drillenv.training.evaluate import write_record

    for file in (given.json, given.table):
        if file is not None:
            check_writable(file)

    def save(record: dict[str, Any]) -> None:
        if given.json is not None:
            write_record(given.json, record)

    file = given.json
    return read(file) if file is not None and Path(file).is_file() else None, save


@contextmanager
def _saying_what_is_kept() -> Iterator[None]:
    """Say at Ctrl-C where the rows are that were done."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt("interrupted: rows that were done are in the file of --json") from None


def _entries(names: Sequence[str], policies: Sequence[str], trust_pickle: bool) -> dict[str, list[Any]]:
    """The runs asked for."""
    from drillenv.training.evaluate import entries

    _look_here(names)
    return entries(names, policies, trust_pickle)


def _look_here(names: Sequence[str]) -> None:
    """Look for modules in the present folder too, as Python itself does with -m."""
    present = os.getcwd()
    if any(":" in name for name in names) and present not in sys.path:
        sys.path.insert(0, present)


# --- train


def _train_options(parser: Parser) -> None:
    from drillenv.training.recipe import (
        ALGORITHMS,
        CHECKPOINT_SECONDS,
        HOLE_TIMESTEPS,
        HOLE_VINE,
        HOLE_VINE_TIMESTEPS,
        OTHERWISE,
        ROCK,
        TIMESTEPS,
        USUAL,
        USUAL_TIMESTEPS,
        Recipe,
        usual,
    )

    said = "; ".join(f"{name}: {meaning}" for name, meaning in ALGORITHMS.items())
    parser.epilog = (
        f"Algorithms: {said}. Defaults are those of ppo-vine; those of the others are given where they differ. "
        "DrillBit is learned by ppo and ppo-vine, with the numbers given for it; on rigs as they are by sac, td3, "
        "recurrent-ppo and ppo --no-prepared, with their own."
    )
    parser.add_argument("--out", required=True, metavar="DIR", help="folder of the run")
    note = "go on with the run in --out; other options may be left out"
    parser.add_argument("--resume", action="store_true", help=note)
    holes = {"DrillBit": HOLE_TIMESTEPS, "ppo-vine on DrillBit": HOLE_VINE_TIMESTEPS}
    others = ", ".join(f"{name} {steps}" for name, steps in {**TIMESTEPS, **holes}.items())
    note = f"steps in all, all rigs together (default {USUAL_TIMESTEPS}; {others})"
    parser.add_argument("--timesteps", type=whole_number, metavar="N", help=note)
    parser.add_argument("--threads", type=whole_number, metavar="N", help="threads of the rigs (default all cores)")
    note = f"time between checkpoints (default {CHECKPOINT_SECONDS:g})"
    parser.add_argument("--checkpoint-seconds", type=plain_number, default=CHECKPOINT_SECONDS, metavar="S", help=note)
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    plain = {**USUAL, **OTHERWISE["ppo"]}
    hole = {
        name: value
        for name, value in usual("ppo", hole=True).items()
        if name not in (*NO_USE_IN_HOLES, *NOISE, "ahead") and not USUAL[name] == plain[name] == value
    }
    otherwise = {**OTHERWISE, "Drill": ROCK, "DrillBit": hole, "ppo-vine on DrillBit": HOLE_VINE}
    for each in fields(Recipe):
        default = USUAL.get(each.name, each.default)
        others = {name: numbers[each.name] for name, numbers in otherwise.items() if each.name in numbers}
        _add_number(parser, each.name, default, others, each.metadata["help"])


def _add_number(parser: Parser, name: str, default: Any, others: dict[str, Any], note: str) -> None:
    """The option for a value of the recipe, of the type of its default."""
    option = f"--{name.replace('_', '-')}"
    if isinstance(default, bool):
        parser.add_argument(option, action=argparse.BooleanOptionalAction, default=None, help=note)
        return
    if name.endswith("_kwargs"):
        parser.add_argument(option, type=json_record, metavar="JSON", help=note)
        return
    several = isinstance(default, tuple)
    kinds: dict[type, Callable[[str], Any]] = {int: whole_number, float: plain_number, str: str}
    named = "; ".join([_words(default), *(f"{algo} {_words(other)}" for algo, other in others.items())])
    parser.add_argument(
        option,
        type=kinds[type(default[0] if several else default)],
        nargs="+" if several else None,
        metavar="X" if not isinstance(default, str) else None,
        help=f"{note} (default {named})",
    )


def _words(value: Any) -> str:
    return " ".join(str(part) for part in value) if isinstance(value, tuple) else str(value)


def json_record(text: str) -> dict[str, Any]:
    """A record in JSON, as an option gives it."""
    try:
        record = json.loads(text)
    except (ValueError, RecursionError):
        record = None
    if not isinstance(record, dict):
        raise argparse.ArgumentTypeError(f"{shown(text)} is no record of JSON: give one such as '{{\"rock\": 4}}'")
    return record


def asked(given: argparse.Namespace) -> dict[str, Any]:
    """The arguments of :func:`drillenv.training.train.train` that a command line asks for.

    Raises:
        InputError: a value is not what it should be, or has no use with the algorithm.
    """
    from drillenv.training.export import CONFIG, read_config
    from drillenv.training.recipe import WITH_CRITIC, Recipe, read_recipe

    chosen = {each.name: value for each in fields(Recipe) if (value := getattr(given, each.name)) is not None}
    own = set(chosen)
    timesteps = given.timesteps
    if given.resume and (Path(given.out) / CONFIG).exists():
        there, steps = read_config(Path(given.out))
        chosen = there.as_record() | chosen
        timesteps = steps if timesteps is None else timesteps
    recipe = read_recipe(chosen)
    useless = NO_USE_IN_HOLES if recipe.believing else NO_USE[recipe.algo]
    if recipe.believing and not recipe.anneals_noise:
        useless = (*NOISE, *useless)
    if recipe.prepared and recipe.algo in WITH_CRITIC and not recipe.believing:
        useless = () if recipe.constrained else BUDGET
    for name in useless:
        if name in own and (name, chosen[name]) != ("ahead", 0):
            partner = recipe.env if recipe.believing else recipe.algo
            raise InputError(f"--{name.replace('_', '-')} has no use with {partner}: leave it out")
    return {
        "recipe": recipe,
        "timesteps": recipe.timesteps if timesteps is None else timesteps,
        "out": given.out,
        "resume": given.resume,
        "threads": given.threads,
        "checkpoint_seconds": given.checkpoint_seconds,
        "quiet": given.quiet,
    }


def _train(given: argparse.Namespace) -> None:
    with needs("train"):
        from drillenv.training.train import train

        wanted = asked(given)
    try:
        result = train(**wanted)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            "interrupted: the same command with --resume goes on from the last checkpoint"
        ) from None
    print(f"{result['steps']} steps, {result['steps_a_second']:.0f} a second")
    if result["best_score"] is not None:
        out = shlex.quote(str(wanted["out"]))
        unit = wanted["recipe"].unit
        print(f"best evaluation: {result['best_score']:.4f} {unit} after {result['best_steps']} steps, in {out}/best")
    if wanted["recipe"].constrained:
        best = "" if result["best_cost"] is None else f"{result['best_cost']:.1f} N above the rating there, "
        print(f"{best}limit {result['cost_limit']:g} N, multiplier {result['multiplier']:.3f} mm/s a kN")


# --- export and film


def _export(given: argparse.Namespace) -> None:
    with needs("train"):
        from drillenv.controllers.policies.stable_baselines import read_model
        from drillenv.training.export import exported, write

        if (given.folder is None) == (given.model is None):
            raise InputError("the source is missing, or there are two: give one of --run and --model")
        if given.model is not None:
            _check_left_out(given, "which", "--run")
            environment = {} if given.env is None else {"environment": given.env}
            policy = read_model(given.model, **environment)
        else:
            _check_left_out(given, "env", "--model")
            policy = exported(Path(given.folder), given.which or "best")
    write(given.out, policy)


def _check_left_out(given: argparse.Namespace, name: str, partner: str) -> None:
    if getattr(given, name) is not None:
        raise InputError(f"--{name} goes with {partner} only: leave it out")


def _film(given: argparse.Namespace) -> None:
    with needs("controllers"):
        from drillenv.env.registration import STEPS
        from drillenv.files import check_writable
        from drillenv.training.film import beside, pictures, write_film

        if not given.out.lower().endswith(".gif"):
            raise InputError(f"--out is {given.out!r}: give a file that ends in .gif")
        wanted = _entries(given.controllers, (), given.trust_pickle)
    frames = count("frames", given.frames, 1, STEPS["DrillLayers"])
    first = count("first", given.first, 0, STEPS["DrillLayers"] - frames)
    width = count("width", given.width, 64, 1280)
    check_writable(given.out)
    runs = [(name, run) for name, each in wanted.items() for run in each]
    columns = [pictures(run.make(), given.scenario, given.episode, first, frames, width) for _, run in runs]
    write_film(given.out, beside(columns, [name for name, _ in runs]))


def _record(given: argparse.Namespace) -> None:
    with needs("datasets"):
        from drillenv.training.datasets import record

        players = _entries(given.controllers, (), given.trust_pickle)
    threads = None if given.threads is None else count("threads", given.threads, 1, 1024)
    folder = record(given.dataset, players, given.env, given.scenario, given.episodes, given.steps, threads, given.out)
    print(f"wrote {folder}")
