"""Play of controllers as datasets for offline learning, in the format of Minari (https://minari.farama.org).

    dataset = minari.load_dataset("drillenv/rules-v0")

An episode holds its seed and its number in the scenario, so that ``dataset.recover_environment()`` plays it again to
the last bit, and in its infos which controller acted, by its place in the dataset's ``algorithm_name``.
"""

from __future__ import annotations

import os
import shutil
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium as gym
import minari
import numpy as np
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_dataset import parse_dataset_id

from drillenv.checks import InputError, choice, shown
from drillenv.env.registration import IDS
from drillenv.training.evaluate import Run
from drillenv.training.rollout import Rollout, rollout

ROOT = "MINARI_DATASETS_PATH"
"""Environment variable that says where Minari keeps datasets."""
USUAL_ROOT = Path.home() / ".minari" / "datasets"
FORMAT = "hdf5"


def record(
    dataset: str,
    players: Mapping[str, list[Run]],
    environment: str = "drillenv/DrillLayers-v0",
    scenario: str = "train",
    episodes: int | None = None,
    steps: int | None = None,
    threads: int | None = None,
    root: str | Path | None = None,
) -> Path:
    """Let controllers drill, one after the other in turns of an episode, and write what they did.

    Args:
        dataset: Its name for Minari, such as "drillenv/rules-v0".
        players: The controllers by name, see :func:`drillenv.training.evaluate.entries`.
        environment: An id.
        scenario: A frozen set, or a file of one.
        episodes: The first so many; all where left out.
        steps: Of each episode; those of the registration where left out.
        threads: Of the rigs; all cores where left out.
        root: Folder of the datasets; that of Minari where left out.

    Returns:
        The folder of the dataset.

    Raises:
        InputError: a name that Minari does not take or that is taken, another bad argument, or a folder that cannot be
            written to.
    """
    choice("env", environment, IDS)
    place = Path(root or os.environ.get(ROOT) or USUAL_ROOT).expanduser().resolve()
    final = _free(place, dataset)
    turn = cycle([run for runs in players.values() for run in runs])
    kind = environment.removeprefix("drillenv/").removesuffix("-v0")
    made = rollout(lambda: next(turn).make(), kind, scenario, episodes, steps, threads)
    names = [name for name, runs in players.items() for _ in runs]
    try:
        place.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=place, prefix=".") as folder, _rooted(Path(folder)):
            _write(dataset, _buffers(made, len(names)), gym.make(environment, scenario=scenario), names)
            final.parent.mkdir(parents=True, exist_ok=True)
            for described in (Path(folder) / dataset).parent.glob("namespace_metadata.json"):
                if not (final.parent / described.name).exists():
                    shutil.copy(described, final.parent)
            os.replace(Path(folder) / dataset, final)
    except OSError as error:
        raise InputError(f"cannot write to {place} ({error.strerror or error}): give another folder") from None
    return final


def _free(place: Path, dataset: str) -> Path:
    """The folder of a dataset that is not there yet."""
    try:
        parse_dataset_id(dataset)
    except ValueError:
        raise InputError(f"dataset is {shown(dataset)}: give a name such as drillenv/rules-v0") from None
    final = place / dataset
    if final.exists():
        raise InputError(f"dataset {dataset} is in {place} already: give another name or version, or remove it")
    return final


@contextmanager
def _rooted(folder: Path) -> Iterator[None]:
    """Let Minari keep datasets in a folder for as long as the block lasts."""
    before = os.environ.get(ROOT)
    os.environ[ROOT] = str(folder)
    try:
        yield
    finally:
        if before is None:
            del os.environ[ROOT]
        else:
            os.environ[ROOT] = before


def _buffers(made: Rollout, players: int) -> list[EpisodeBuffer]:
    """The episodes as Minari takes them."""
    episodes, steps = made.rewards.shape
    last = np.arange(steps) == steps - 1
    return [
        EpisodeBuffer(
            id=i,
            seed=i,
            options={"episode": i},
            observations=made.observations[i],  # type: ignore[arg-type]  # arrays do, and are what it stores
            actions=made.actions[i],  # type: ignore[arg-type]
            rewards=made.rewards[i].tolist(),
            terminations=[False] * steps,
            truncations=last.tolist(),
            infos={"controller": np.full(steps + 1, i % players)},
        )
        for i in range(episodes)
    ]


def _write(dataset: str, buffers: list[EpisodeBuffer], env: gym.Env[Any, Any], names: list[str]) -> None:
    """Write a dataset where Minari keeps them."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that authors and links are missing
        minari.create_dataset_from_buffers(
            dataset,
            buffers,
            env=env,
            algorithm_name=", ".join(names),
            description="A percussive-drilling rig over hidden rock, played by controllers of drillenv.",
            requirements=["drillenv"],
            data_format=FORMAT,
        )
