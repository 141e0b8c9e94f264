"""A run of training as it stands between two updates, in files that hold numbers and texts only.

    checkpoints/000000131072/
        policy.safetensors     all parameters, of policy and value
        optimizer.safetensors  the moments of Adam
        best.safetensors       the best policy so far, where there is one
        arrays.npz             the rigs, the last observations, the generators of torch, numpy and Python
        state.json             the counters, the generators of the rigs, the multiplier of a constrained task, and
                               the SHA-256 of the files above

A checkpoint is written to a folder with another name and takes its own when it is complete. Nothing is pickled.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import random
import secrets
import shutil
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.numpy
import torch
from sb3_contrib import RecurrentPPO
from sb3_contrib.common.recurrent.type_aliases import RNNStates

from drillenv.checks import InputError, shown
from drillenv.env.batch import Snapshot
from drillenv.env.hole.batch import Holes
from drillenv.env.plant import Plants
from drillenv.env.scalar import EnvState
from drillenv.training.learner import Learner

FORMAT = "drillenv-checkpoint/1"
KEPT = 2
"""Checkpoints that are kept: the last, and one to fall back on."""
STATE, ARRAYS = "state.json", "arrays.npz"
POLICY, OPTIMIZER, BEST = "policy.safetensors", "optimizer.safetensors", "best.safetensors"
LSTM = ("hidden", "cell")


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Everything that a run needs to go on exactly.

    Args:
        policy: All parameters by name.
        optimizer: The moments by parameter and name, such as "3.exp_avg".
        arrays: All other arrays by name.
        record: All other numbers and texts, as JSON takes them.
        best: The weights of the best policy so far, empty where there is none.
    """

    policy: Mapping[str, np.ndarray]
    optimizer: Mapping[str, np.ndarray]
    arrays: Mapping[str, np.ndarray]
    record: dict[str, Any]
    best: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def steps(self) -> int:
        """Steps done, all rigs together."""
        return int(self.record["steps"])


def take(learner: Learner, notes: dict[str, Any], best: Mapping[str, np.ndarray] | None = None) -> Checkpoint:
    """The run as it stands. ``notes`` are kept with it; to be called between two updates, not within a rollout."""
    model = learner.model
    arrays, rigs = _rigs(learner)
    arrays |= {
        "stacked": learner.stacked.stacked_obs.stacked_obs,
        "episode_returns": learner.monitor.episode_returns,
        "episode_lengths": learner.monitor.episode_lengths,
        "episode_starts": np.asarray(model._last_episode_starts),
    }
    for name, value in _lstm(learner).items():
        arrays[name] = value.numpy()
    arrays |= _belief(learner)
    generators, positions = _generators()
    record: dict[str, Any] = {
        "format": FORMAT,
        "steps": model.num_timesteps,
        "updates": model._n_updates,
        "rigs": rigs,
        "positions": positions,
        "episodes": [{key: float(value) for key, value in each.items()} for each in model.ep_info_buffer or ()],
        "notes": notes,
    }
    if learner.priced is not None:
        record["budget"] = learner.priced.state()
    moments = model.policy.optimizer.state_dict()["state"]
    return Checkpoint(
        {name: value.numpy() for name, value in model.policy.state_dict().items()},
        {f"{i}.{name}": value.numpy() for i, each in moments.items() for name, value in each.items()},
        arrays | generators,
        record,
        best or {},
    )


def put(learner: Learner, checkpoint: Checkpoint) -> None:
    """Make a learner that was built by the same recipe go on where the checkpoint was taken.

    Raises:
        InputError: the checkpoint is that of another recipe.
    """
    try:
        _put(learner, checkpoint)
    except (KeyError, IndexError, TypeError, ValueError, RuntimeError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            f"the checkpoint does not fit this recipe ({shown(str(error))}): go on with the one it was trained with"
        ) from None


def _put(learner: Learner, checkpoint: Checkpoint) -> None:
    model, arrays, record = learner.model, checkpoint.arrays, checkpoint.record
    model.policy.load_state_dict({name: torch.from_numpy(each.copy()) for name, each in checkpoint.policy.items()})
    moments: dict[int, dict[str, torch.Tensor]] = {}
    for key, value in checkpoint.optimizer.items():
        index, name = key.split(".", 1)
        moments.setdefault(int(index), {})[name] = torch.from_numpy(value.copy())
    optimizer = model.policy.optimizer
    optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
    _put_rigs(learner, arrays, record["rigs"])
    stack = learner.stacked.stacked_obs
    stack.stacked_obs = _like("stacked", arrays, stack.stacked_obs)
    learner.monitor.episode_returns = _like("episode_returns", arrays, learner.monitor.episode_returns)
    learner.monitor.episode_lengths = _like("episode_lengths", arrays, learner.monitor.episode_lengths)
    model._last_obs = stack.stacked_obs.copy()
    model._last_episode_starts = _like("episode_starts", arrays, np.zeros(model.n_envs, dtype=bool))
    if learner.believing is not None:
        for name, value in _belief(learner).items():
            value[:] = _like(name, arrays, value)
        learner.believing.known = stack.stacked_obs.copy()
    if learner.priced is not None:
        learner.priced.go_on(record["budget"])
    if isinstance(model, RecurrentPPO):
        states = {name: torch.from_numpy(arrays[name].copy()) for name in _lstm(learner)}
        pairs = [tuple(states[f"{part}_{each}"] for each in LSTM) for part in ("actor", "critic")]
        model._last_lstm_states = RNNStates(*pairs)
    model.num_timesteps, model._n_updates = int(record["steps"]), int(record["updates"])
    model.ep_info_buffer = deque(record["episodes"], maxlen=model._stats_window_size)
    model.ep_success_buffer = deque(maxlen=model._stats_window_size)
    _put_generators(arrays, record["positions"])


def _like(name: str, arrays: Mapping[str, np.ndarray], present: np.ndarray) -> np.ndarray:
    """A copy of an array of the checkpoint, if it is of the kind that is there now."""
    kept = arrays[name]
    if kept.shape != present.shape or kept.dtype != present.dtype:
        raise InputError(
            f"the checkpoint has {name} as {kept.dtype} {kept.shape}, here it is {present.dtype} {present.shape}: "
            "go on with the recipe that it was trained with"
        )
    return kept.copy()


def _lstm(learner: Learner) -> dict[str, torch.Tensor]:
    """The memory of a recurrent policy and value by name; nothing for another."""
    if not isinstance(learner.model, RecurrentPPO):
        return {}
    states = learner.model._last_lstm_states
    assert states is not None
    parts = {"actor": states.pi, "critic": states.vf}
    return {f"{part}_{each}": pair[i] for part, pair in parts.items() for i, each in enumerate(LSTM)}


def _belief(learner: Learner) -> dict[str, np.ndarray]:
    """The memory of each hole by name, itself and no copy; nothing where none is drilled."""
    if learner.believing is None:
        return {}
    return {f"belief{name}": value for name, value in learner.believing.belief.arrays.items()}


def _parts(learner: Learner) -> list[str]:
    """The names of the arrays of a rig's snapshot, in order."""
    plants = [f"plants_{name}" for name in Plants._fields]
    return [*plants, *(f"holes_{name}" for name in Holes._fields), "ended"] if learner.recipe.hole else plants


def _rigs(learner: Learner) -> tuple[dict[str, np.ndarray], list[dict[str, Any]]]:
    """The rigs: arrays with a row for each, and the rest of each as a record."""
    envs = learner.rigs.rigs
    states = [envs.get_state(i) for i in range(learner.rigs.num_envs)]
    arrays = {name: np.stack([state.rig.arrays[j] for state in states]) for j, name in enumerate(_parts(learner))}
    arrays["truths"] = np.stack([state.rig.truth for state in states])
    arrays["readings"] = np.stack([state.rig.seen for state in states])
    arrays["rewards"] = np.array([state.rig.reward for state in states])
    return arrays, [{"generator": state.noise, "hybrid": _hybrid_record(state.rig.hybrid)} for state in states]


def _hybrid_record(hybrid: Any) -> dict[str, Any] | None:
    """What the hybrid engine keeps of a rig, where it drives it."""
    if hybrid is None:
        return None
    effects = {name: {symbol: float(value) for symbol, value in each.items()} for name, each in hybrid.effects.items()}
    return {"effects": effects, "d": hybrid.motion.d.tolist(), "z": hybrid.motion.z.tolist()}


def _put_rigs(learner: Learner, arrays: Mapping[str, np.ndarray], records: list[dict[str, Any]]) -> None:
    """Put every rig back."""
    envs = learner.rigs.rigs
    n = learner.rigs.num_envs
    if len(records) != n or len(arrays["rewards"]) != n:
        raise InputError(f"the checkpoint is of {len(records)} rigs, not of {n}: go on with the recipe it was made by")
    parts = [arrays[name] for name in _parts(learner)]
    window = np.zeros(envs._batch.windows.shape[1:])
    for i, record in enumerate(records):
        rig = Snapshot(
            tuple(part[i] for part in parts),
            arrays["truths"][i],
            arrays["readings"][i],
            float(arrays["rewards"][i]),
            _hybrid(record["hybrid"]),
        )
        envs.set_state(EnvState(rig, record["generator"], window, None), [i])
    # set_state starts the count of steps anew; the monitor has counted the same steps
    envs._elapsed[:] = arrays["episode_lengths"]


def _hybrid(record: dict[str, Any] | None) -> Any:
    if record is None:
        return None
    from drillenv.dynamics.hybrid.model import Motion
    from drillenv.env.hybrid_plant import HybridSnapshot

    return HybridSnapshot(record["effects"], Motion(np.array(record["d"]), np.array(record["z"])))


def _generators() -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The generators that torch, numpy and Python share among everybody, since the algorithms draw from them."""
    name, keys, position, has_gauss, gauss = np.random.get_state(legacy=True)  # noqa: NPY002
    assert name == "MT19937"
    version, words, left = random.getstate()
    arrays = {
        "torch_generator": torch.get_rng_state().numpy(),
        "numpy_generator": np.asarray(keys, dtype=np.uint32),
        "python_generator": np.array(words, dtype=np.uint32),
    }
    return arrays, {"numpy": [int(position), int(has_gauss), float(gauss)], "python": [version, left]}


def _put_generators(arrays: Mapping[str, np.ndarray], positions: dict[str, Any]) -> None:
    torch.set_rng_state(torch.from_numpy(arrays["torch_generator"].copy()))
    np.random.set_state(("MT19937", arrays["numpy_generator"], *positions["numpy"]))  # noqa: NPY002
    version, left = positions["python"]
    random.setstate((version, tuple(arrays["python_generator"].tolist()), left))


def write(folder: Path, checkpoint: Checkpoint) -> Path:
    """Write a checkpoint into the folder of checkpoints and drop the oldest. Returns its own folder.

    Raises:
        InputError: the folder cannot be written to.
    """
    target = folder / f"{checkpoint.steps:012d}"
    temporary = folder / f".{secrets.token_hex(4)}.part"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for left_over in folder.glob(".*.part"):
            shutil.rmtree(left_over)
        temporary.mkdir()
        sums = {}
        for name, data in _files(checkpoint).items():
            sums[name] = hashlib.sha256(data).hexdigest()
            _write(temporary / name, data)
        state = checkpoint.record | {"files": sums}
        _write(temporary / STATE, json.dumps(state, indent=1).encode("utf-8"))
        if target.exists():
            shutil.rmtree(target)  # a run that fell back to an older checkpoint comes by again
        temporary.rename(target)
        for old in _found(folder)[KEPT:]:
            shutil.rmtree(old)
    except OSError as error:
        raise InputError(f"cannot write to {folder} ({error.strerror}): give another folder") from None
    return target


def _files(checkpoint: Checkpoint) -> dict[str, bytes]:
    """The content of the files by name, apart from the record."""
    arrays = io.BytesIO()
    np.savez(arrays, allow_pickle=False, **checkpoint.arrays)
    files = {
        POLICY: safetensors.numpy.save(dict(checkpoint.policy)),
        OPTIMIZER: safetensors.numpy.save(dict(checkpoint.optimizer)),
        ARRAYS: arrays.getvalue(),
    }
    if checkpoint.best:
        files[BEST] = safetensors.numpy.save(dict(checkpoint.best))
    return files


def _write(file: Path, data: bytes) -> None:
    """Write a file so that it has arrived before its folder gets its name."""
    with file.open("wb") as stream:
        stream.write(data)
        stream.flush()
        os.fsync(stream.fileno())


def _found(folder: Path) -> list[Path]:
    """The checkpoints in a folder, the last one first."""
    return sorted((each for each in folder.glob("[0-9]" * 12) if each.is_dir()), reverse=True)


def latest(folder: Path) -> tuple[Checkpoint | None, list[str]]:
    """The last checkpoint in a folder that can be read, None where there is none, and what is wrong with later ones."""
    wrong = []
    for each in _found(folder):
        try:
            return read(each), wrong
        except InputError as error:
            wrong.append(str(error))
    return None, wrong


def read(folder: Path) -> Checkpoint:
    """Read a checkpoint from its own folder.

    Raises:
        InputError: a file is missing, cut off, changed or of another version. Nothing in the files is run.
    """
    try:
        record = json.loads((folder / STATE).read_text(encoding="utf-8"))
        if not isinstance(record, dict) or record.get("format") != FORMAT:
            raise InputError(f"checkpoint {folder} is not of the format {FORMAT}: give one that is")
        sums = record["files"]
        files = {name: (folder / name).read_bytes() for name in (POLICY, OPTIMIZER, ARRAYS)}
        if BEST in sums:
            files[BEST] = (folder / BEST).read_bytes()
        for name, data in files.items():
            if hashlib.sha256(data).hexdigest() != sums[name]:
                raise InputError(f"checkpoint {folder}: {name} is not as it was written: use an earlier checkpoint")
        with np.load(io.BytesIO(files[ARRAYS]), allow_pickle=False) as kept:
            arrays = {name: kept[name] for name in kept.files}
        tensors = {name: safetensors.numpy.load(data) for name, data in files.items() if name != ARRAYS}
    except InputError:
        raise  # a ValueError too
    except OSError as error:
        raise InputError(f"checkpoint {folder} cannot be read ({error.strerror}): use an earlier one") from None
    except (ValueError, KeyError, TypeError, RecursionError, safetensors.SafetensorError) as error:
        raise InputError(f"checkpoint {folder} is damaged ({shown(str(error))}): use an earlier one") from None
    return Checkpoint(tensors[POLICY], tensors[OPTIMIZER], arrays, record, tensors.get(BEST, {}))
