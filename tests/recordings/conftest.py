"""Campaigns to spoil: the rig simulated and measured with noise, and one body on a spring."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

import drillenv
from drillenv.recordings import Campaign, Channel, Nominal, Recording

SHARED = Path(__file__).parents[2] / ".." / "shared" / "campaigns"

SAMPLE_RATE = 25600.0
SECONDS = 0.4
NOISE = {"excitation": 0.002, "force": 5.0, "acceleration": 2.5}  # SI, as on the practice campaigns
UNITS = {"excitation": "V", "force": "kN", "acceleration": "g"}
# One impact a period, several, deep contact, and a start from rest.
SETTINGS = [
    (118.0, 0.55, 0.8, "running"),
    (61.3, 0.45, 1.2, "running"),
    (93.0, 0.36, 1.5, "running"),
    (76.0, 0.5, 1.0, "fresh"),
]


@pytest.fixture(scope="session")
def shared() -> Path:
    """The campaigns beside the repository."""
    if not SHARED.is_dir():
        pytest.skip("no shared campaigns here")
    return SHARED


@pytest.fixture(scope="session")
def rig_nominal() -> dict[str, Nominal]:
    """Table 2.1 and case 4 of Table 2.2."""
    return {
        "shaker_mass": Nominal(265.0, 1.0, "kg"),
        "indenter_mass": Nominal(3.0, 0.01, "kg"),
        "stiffness": Nominal(68850.0, 2000.0, "N/m"),
        "damping": Nominal(2450.0, 75.0, "N*s/m"),
        "drive_gain": Nominal(1.0, 0.015, "1"),
        "pressure_gain": Nominal(1.0, 0.02, "1"),
        "loading_stiffness": Nominal(21.4e6, 0.56e6, "N/m"),
        "unloading_stiffness": Nominal(25.05e6, 1.0e6, "N/m"),
    }


@pytest.fixture(scope="session")
def record() -> Callable[..., Recording]:
    """A function that records the simulated rig: setting, starts, sample rate, noise as a factor on the usual."""

    def recorded(name, setting, starts="running", rate=SAMPLE_RATE, seconds=SECONDS, noise=1.0, seed=0, **simulated):
        rng = np.random.default_rng(seed)
        lead = 0 if starts == "fresh" else round(rate)
        run = drillenv.simulate(setting, seconds=lead / rate + seconds, sample_rate=rate, **simulated)
        part = slice(lead, lead + round(seconds * rate))
        channels = {
            channel: Channel(
                getattr(run, channel)[part] + noise * NOISE[channel] * rng.normal(size=part.stop - part.start),
                unit,
                f"{channel}_{unit}",
            )
            for channel, unit in UNITS.items()
        }
        return Recording(name, f"{name}.csv", rate, MappingProxyType(channels), starts, drillenv.Setting(*setting))

    return recorded


@pytest.fixture(scope="session")
def drill(record, rig_nominal) -> Campaign:
    """A sound campaign of four recordings."""
    recordings = [record(f"r{i:02d}", place[:3], place[3], seed=i) for i, place in enumerate(SETTINGS, 1)]
    return Campaign("simulated", "percussive-drill", rig_nominal, tuple(recordings), Path("."))


@pytest.fixture(scope="session")
def body() -> Campaign:
    """One body on a spring with a damper and dry friction, pushed by a chirp; three recordings of all channels."""
    units = {"force": "N", "position": "mm", "velocity": "m/s", "acceleration": "m/s^2"}
    noise = {"force": 0.05, "position": 2e-6, "velocity": 2e-3, "acceleration": 0.05}
    recordings = []
    for i in range(3):
        rng = np.random.default_rng(i)
        moved = _moved(6.0 + 3.0 * i, rate=1000.0, seconds=3.0)
        channels = {
            name: Channel(samples + noise[name] * rng.normal(size=samples.size), units[name], name)
            for name, samples in moved.items()
        }
        recordings.append(Recording(f"r{i + 1:02d}", f"r{i + 1:02d}.csv", 1000.0, MappingProxyType(channels)))
    nominal = {"mass": Nominal(2.0, 0.01, "kg"), "stiffness": Nominal(None, None, "N/m")}
    return Campaign("one body", "one-body", nominal, tuple(recordings), Path("."))


def _moved(amplitude: float, rate: float, seconds: float, inside: int = 10) -> dict[str, np.ndarray]:
    """2 kg x'' = F - 800 N/m x - 6 N s/m x' - 1.5 N sign(x') - 0.3 N, by small semi-implicit steps."""
    time = np.arange(round(rate * seconds)) / rate
    phase = 2 * np.pi * (0.5 * time + 0.5 * (8.0 - 0.5) / seconds * time**2)
    force = amplitude * (np.sin(phase) + 0.4 * np.sin(2.7 * phase))
    x = v = 0.0
    found = np.empty((time.size, 3))
    for i, push in enumerate(force.tolist()):
        for step in range(inside):
            a = (push - 800.0 * x - 6.0 * v - 1.5 * float(np.tanh(1e3 * v)) - 0.3) / 2.0
            if step == 0:
                found[i] = x, v, a
            v += a / (rate * inside)
            x += v / (rate * inside)
    return {"force": force, "position": found[:, 0], "velocity": found[:, 1], "acceleration": found[:, 2]}


@pytest.fixture(scope="session")
def spoil() -> Callable[..., Campaign]:
    """A function that hands back a campaign with one recording changed: by channels (None takes one away) or fields.

    The other recordings of a drilling rig are left out unless ``whole``: each is judged by itself.
    """

    def spoiled(campaign: Campaign, name: str, fields: dict | None = None, whole: bool = False, **samples) -> Campaign:
        recordings = []
        for recording in campaign.recordings:
            if recording.name == name:
                channels = dict(recording.channels)
                for channel, values in samples.items():
                    if values is None:
                        del channels[channel]
                    else:
                        channels[channel] = replace(channels[channel], samples=np.asarray(values, dtype=float))
                recording = replace(recording, channels=MappingProxyType(channels), **(fields or {}))
            elif campaign.rig == "percussive-drill" and not whole:
                continue
            recordings.append(recording)
        return replace(campaign, recordings=tuple(recordings))

    return spoiled


@pytest.fixture(scope="session")
def samples_of() -> Callable[..., dict[str, np.ndarray]]:
    """A function that hands back the samples of a recording by channel."""

    def samples(campaign: Campaign, name: str) -> dict[str, np.ndarray]:
        recording = next(each for each in campaign.recordings if each.name == name)
        return {channel: each.samples for channel, each in recording.channels.items()}

    return samples
