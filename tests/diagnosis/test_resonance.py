"""Sharp resonances of a channel, against signals through resonators of scipy's."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from drillenv.diagnosis.resonance import sharp_resonance, spectra
from drillenv.diagnosis.sensing import ACCELERATION, broad_parts, response, sensor_families

RATE, FINE, OVER = 12800.0, 51200.0, 4


def through(x, frequency, ratio, part):
    """A part of a signal through a mass on a spring, which is read beside the rest of it."""
    turn = 2.0 * np.pi * frequency
    over, under, _ = cont2discrete(([turn**2], [1.0, 2.0 * ratio * turn, turn**2]), 1.0 / FINE, "bilinear")
    return part * (lfilter(over.ravel(), under, x) - x)


def recordings(rng, count=8, seconds=0.3):
    """Trains of blows, each at a period of its own."""
    made = []
    for _ in range(count):
        x = np.zeros(round(seconds * FINE))
        x[:: round(FINE / rng.uniform(60.0, 120.0))] = 1.0
        made.append(lfilter([1.0], np.poly([0.7, 0.7, 0.7]), x))
    return made


def found_in(residuals, predicted):
    predicted, residuals = ([each[::OVER] for each in rows] for rows in (predicted, residuals))
    return sharp_resonance(spectra(predicted, residuals, [RATE] * len(predicted)), broad_parts(FINE))


@pytest.mark.parametrize("frequency", [1500.0, 2700.0, 3900.0])
@pytest.mark.parametrize(("ratio", "part"), [(0.01, 0.3), (0.02, 1.0), (0.035, 0.5)])
def test_one_is_found_under_noise(frequency, ratio, part):
    rng = np.random.default_rng(3)
    predicted = recordings(rng)
    residuals = [through(x, frequency, ratio, part) for x in predicted]
    noise = 0.02 * np.std(predicted[0])
    found = found_in([each + noise * rng.normal(size=each.size) for each in residuals], predicted)
    assert found is not None
    # the bilinear transform warps frequencies
    warped = FINE / np.pi * np.arctan(np.pi * frequency / FINE)
    assert abs(found.frequency / warped - 1.0) < 0.3 * ratio
    assert found.ratio == pytest.approx(ratio, rel=0.3)


@pytest.mark.parametrize("misreading", ["nothing", "noise", "broad", "late", "low-pass"])
def test_none_is_found_where_there_is_none(misreading):
    for seed in range(6):
        rng = np.random.default_rng(seed)
        predicted = recordings(rng)
        noise = [0.05 * np.std(x) * rng.normal(size=x.size) for x in predicted]
        misread = {
            "nothing": lambda x: 0.0 * x,
            "noise": lambda x: 0.0 * x,
            "broad": lambda x: through(x, 2700.0, 0.15, 1.0),
            "late": lambda x: np.roll(x, 8) - x,
            "low-pass": lambda x: lfilter([0.1], [1.0, -0.9], x) - x,
        }[misreading]
        extra = noise if misreading != "nothing" else [0.0 * x for x in predicted]
        assert found_in([misread(x) + more for x, more in zip(predicted, extra, strict=True)], predicted) is None


def test_a_free_response_has_it():
    """Its parts draw the mode wherever it is within a quarter of the half-width of where it was taken to be."""
    rng = np.random.default_rng(1)
    predicted = recordings(rng)
    sharp = found_in([through(x, 2700.0, 0.02, 0.5) for x in predicted], predicted)
    (term,) = sensor_families(["r01"], RATE, sharp=(None, sharp))[0].terms
    frequency = np.linspace(300.0, 5000.0, 400)
    rows = [
        response(term, row, frequency, ACCELERATION, ACCELERATION, FINE) - 1.0 for row in np.eye(len(term.unknowns))
    ]
    for off in (-0.005, 0.0, 0.005):
        s = 1j * frequency / (sharp.frequency * (1.0 + off))
        true = 0.5 * (1.0 / (s**2 + 0.04 * s + 1.0) - 1.0)
        basis = np.concatenate([np.array(rows).real, np.array(rows).imag], axis=1).T
        goal = np.concatenate([true.real, true.imag])
        sizes = np.linalg.lstsq(basis, goal, rcond=None)[0]
        assert np.linalg.norm(basis @ sizes - goal) < 0.05 * np.linalg.norm(goal)
