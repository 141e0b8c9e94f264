"""A residual model that names nothing: what the paper's model leaves, learned over its states and inputs."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from benchmarks.alternatives.following import Followed
from drillenv.diagnosis.solver import Floats

SAMPLES = {"gaussian process": 800, "neural network": 40_000}
"""Drawn from the recordings to learn from."""
LEAST = 300
"""Of these, by which a Gaussian process finds its lengths."""
ON_ROCK = 0.5
"""Share of the samples drawn in contact: what is missing of the rock shows there, and contacts are short."""
Learned = Callable[[Floats], Floats]
"""From features (n, k) to what is left (n, 2), in standard deviations of the noise."""


def features(recording: Followed) -> Floats:
    """(n, 14) states and inputs of the model, and what it says of both channels with their slopes."""
    motion = recording.motion
    said = recording.sampled(recording.signals)
    slopes = np.gradient(said, axis=1)
    return np.column_stack(
        [
            motion.y,
            motion.v1 - motion.v2,
            motion.v1,
            motion.v2,
            motion.loading,
            np.sin(motion.theta),
            np.cos(motion.theta),
            np.full_like(motion.y, motion.drive),
            np.full_like(motion.y, motion.static),
            np.full_like(motion.y, motion.frequency),
            *said,
            *slopes,
        ]
    )


def gaussian_process(x: Floats, y: Floats, rng: np.random.Generator) -> Learned:
    """Two Gaussian processes with a length for each feature; their lengths are those of most likelihood."""
    scaler = StandardScaler().fit(x)
    lengths: Any = np.full(x.shape[1], 3.0)
    kernel = ConstantKernel(1.0, (1e-3, 1e4)) * RBF(lengths, (0.1, 1e3)) + WhiteKernel(1.0, (0.1, 1e3))
    models: list[Any] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        for channel in y.T:
            few = rng.permutation(len(x))[:LEAST]
            begun = GaussianProcessRegressor(kernel).fit(scaler.transform(x[few]), channel[few])
            as_begun: Any = None
            again = GaussianProcessRegressor(begun.kernel_, optimizer=as_begun)
            models.append(again.fit(scaler.transform(x), channel))
    return lambda new: np.column_stack([each.predict(scaler.transform(new)) for each in models])


def neural_network(x: Floats, y: Floats, rng: np.random.Generator) -> Learned:
    """Two hidden layers; training ends where a tenth of the samples that is kept out gains nothing any more."""
    at_once: Any = 256
    network = MLPRegressor(
        hidden_layer_sizes=(48, 48), alpha=1e-3, batch_size=at_once, early_stopping=True, n_iter_no_change=4,
        max_iter=30, random_state=int(rng.integers(2**31)),
    )  # fmt: skip
    size = np.maximum(y.std(axis=0), 1e-12)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        fitted = make_pipeline(StandardScaler(), network).fit(x, y / size)
    return lambda new: np.asarray(fitted.predict(new)) * size


KINDS: dict[str, Callable[[Floats, Floats, np.random.Generator], Learned]] = {
    "gaussian process": gaussian_process,
    "neural network": neural_network,
}


def learned(recordings: Sequence[Followed], kind: str, rng: np.random.Generator) -> Learned:
    """A model of what is left of recordings."""
    x = np.vstack([features(each) for each in recordings])
    y = np.vstack([(each.left / each.noise[:, None]).T for each in recordings])
    touching = np.concatenate([each.motion.rock > 0.0 for each in recordings])
    share = np.where(touching, ON_ROCK / max(touching.mean(), 1e-9), (1.0 - ON_ROCK) / max(1.0 - touching.mean(), 1e-9))
    size = min(SAMPLES[kind], len(x))
    drawn = rng.choice(len(x), size, replace=False, p=share / share.sum()) if size < len(x) else np.arange(len(x))
    return KINDS[kind](x[drawn], y[drawn], rng)


def correction(model: Learned, recording: Followed) -> Floats:
    """(2, n) what the model adds to the readings of a recording, N and m/s^2."""
    return model(features(recording)).T * recording.noise[:, None]
