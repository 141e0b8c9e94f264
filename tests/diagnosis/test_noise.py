"""Noise of known spectrum is made here; what is estimated from it must be right, with and without periodic misfit."""

import math

import numpy as np
import pytest
from scipy import signal, stats

from drillenv.diagnosis.comb import without_harmonics
from drillenv.diagnosis.noise import (
    NoiseModel,
    _sections,
    converter_lsb,
    dead_band,
    estimate,
    find_lines,
    line_columns,
    whiten,
)

RATE, SIZE = 25_600.0, 12_800
LINES = (431.7, 977.13, 1503.4, 2222.2, 3333.3)
"""In Hz; none within 1.5 bins of a harmonic of 40 Hz."""


def white(seed: int, size: int = SIZE) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=size)


def pink(seed: int, share: float, size: int = SIZE, rate: float = RATE) -> tuple[np.ndarray, float]:
    """White noise of standard deviation 1 plus 1/f noise that is this share of the power; the corner in Hz."""
    rng = np.random.default_rng(seed)
    frequencies = np.fft.rfftfreq(size, 1.0 / rate)[1:]
    corner = share / (1.0 - share) * 0.5 * size / np.sum(1.0 / frequencies)
    draws = rng.normal(size=(2, frequencies.size)) * np.sqrt(0.5 * size * corner / frequencies)
    return rng.normal(size=size) + np.fft.irfft(np.r_[0.0, draws[0] + 1j * draws[1]], size), float(corner)


def tones(seed: int, frequencies, amplitude: float = 0.3) -> np.ndarray:
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, len(frequencies))
    t = np.arange(SIZE) / RATE
    return amplitude * np.sin(2.0 * np.pi * np.outer(frequencies, t) + phases[:, None]).sum(axis=0)


def misfit(seed: int, fundamental: float, power: float, order: int = 2) -> np.ndarray:
    """Sixty harmonics of fundamental / order, with as much power together."""
    rng = np.random.default_rng(seed)
    k = np.arange(1, 61)
    t = np.arange(SIZE) / RATE
    sizes = np.exp(-k / 20.0) * rng.exponential(size=k.size)
    phases = rng.uniform(0.0, 2.0 * np.pi, k.size)
    found = sizes @ np.sin(2.0 * np.pi * fundamental / order * np.outer(k, t) + phases[:, None])
    return found * math.sqrt(power / np.mean(found**2))


def portmanteau(series: np.ndarray, lags: int = 20) -> float:
    """P-value of Ljung and Box."""
    n = series.size
    products = signal.correlate(series, series, method="fft")[n - 1 : n + lags]
    total = n * (n + 2) * np.sum((products[1:] / products[0]) ** 2 / (n - np.arange(1, lags + 1)))
    return float(stats.chi2.sf(total, lags))


@pytest.mark.slow
@pytest.mark.parametrize("order", [0, 2, 3])
def test_level_of_white_noise_is_unbiased_even_under_ten_times_its_power_of_periodic_misfit(order):
    errors = []
    for seed in range(20):
        fundamental = 50.0 + 3.5 * seed
        added = misfit(seed, fundamental, 40.0, order) if order else 0.0
        model = estimate(2.0 * white(seed) + added, RATE, fundamental)
        assert model.corner == 0.0 and model.lines == ()
        errors.append(model.std / 2.0 - 1.0)
    assert abs(np.mean(errors)) < 0.005
    assert np.std(errors) < 0.0085  # 0.62 % if every bin were used
    assert np.max(np.abs(errors)) < 0.03


@pytest.mark.parametrize("power", [0.0, 10.0])
@pytest.mark.parametrize("share", [0.1, 0.25])
def test_level_and_corner_of_one_over_f_noise(share, power):
    errors, corners, true = [], [], 0.0
    for seed in range(20):
        noise, true = pink(seed, share)
        model = estimate(noise + (misfit(seed, 70.3, power) if power else 0.0), RATE, 70.3)
        errors.append(model.std - 1.0)
        corners.append(model.corner / true - 1.0)
    assert abs(np.mean(errors)) < 0.006 and np.max(np.abs(errors)) < 0.03
    assert abs(np.mean(corners)) < 0.08 and np.std(corners) < 0.25


def test_a_corner_is_seldom_found_in_white_noise():
    found = [estimate(white(1000 + seed, 4000), 8000.0, 63.0).corner > 0.0 for seed in range(100)]
    assert sum(found) <= 4  # 1 % are expected; with 2 %, 5 or more come up in one case of twenty


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["white", "pink", "lines"])
def test_whitened_noise_is_white_with_variance_one(kind):
    p_values, squares = [], []
    for seed in range(24):
        noise = pink(seed, 0.2)[0] if kind == "pink" else white(seed) + (tones(seed, LINES) if kind == "lines" else 0.0)
        model = estimate(3.0 * noise, RATE, 80.0)
        rest = whiten(model, 3.0 * noise)
        if model.lines:
            columns = whiten(model, line_columns(model.lines, RATE, SIZE)).T
            rest -= columns @ np.linalg.lstsq(columns, rest)[0]
        squares.append(rest @ rest / (SIZE - 2 * len(model.lines)))
        p_values.append(portmanteau(rest))
    assert abs(np.mean(squares) - 1.0) < 0.005 and np.max(np.abs(np.array(squares) - 1.0)) < 0.025
    assert stats.kstest(p_values, "uniform").pvalue > 0.01


@pytest.mark.parametrize("power", [0.0, 10.0])
def test_lines_are_found_to_a_fraction_of_a_bin(power):
    noise = white(5) + tones(5, LINES) + (misfit(5, 80.0, power) if power else 0.0)
    model = estimate(noise, RATE, 80.0)
    assert model.lines == pytest.approx(LINES, abs=0.1 * RATE / SIZE)  # bins are 2 Hz wide
    assert model.std == pytest.approx(1.0, abs=0.02)
    assert find_lines(noise, RATE, 80.0, model) == pytest.approx(model.lines)


def test_misfit_of_period_three_is_no_noise_line():
    lines = estimate(white(6) + tones(6, LINES[:2]) + misfit(6, 80.0, 1.0, 3), RATE, 80.0).lines
    assert lines == pytest.approx(LINES[:2], abs=0.2)


@pytest.mark.parametrize(
    ("corner", "rate", "size"), [(120.0, 8e3, 4000), (343.0, RATE, SIZE), (1000.0, 51.2e3, 40_000)]
)
def test_the_whitening_filter_undoes_the_spectrum(corner, rate, size):
    frequencies = np.geomspace(2.0 * rate / size, 0.5 * rate, 2000)
    _, response = signal.freqz_sos(_sections(corner / rate, size), frequencies, fs=rate)
    whitened = np.abs(response) ** 2 * NoiseModel(1.0, corner, (), rate).spectrum(frequencies)
    assert whitened == pytest.approx(2.0 / rate, rel=0.05)


@pytest.mark.parametrize(
    ("corner", "size"), [(0.4753983171376023, 1165), (0.6713024722925717, 1208), (0.852761260745442, 1244)]
)
def test_a_corner_near_to_the_nyquist_frequency_has_a_filter(corner, size):
    """In cycles per sample: with as many steps as SciPy takes by itself, the least squares ended in an error."""
    _, response = signal.freqz_sos(_sections(corner, size), np.geomspace(2.0 / size, 0.5, 500), fs=1.0)
    assert np.isfinite(response).all()


def test_white_noise_is_divided_and_columns_are_filtered_one_by_one():
    columns = white(8, 3000).reshape(3, 1000)
    assert np.array_equal(whiten(NoiseModel(4.0, 0.0, (), 8e3), columns), columns / 4.0)
    model = NoiseModel(4.0, 200.0, (), 8e3)
    assert whiten(model, columns)[1] == pytest.approx(whiten(model, columns[1]))
    assert whiten(model, columns)[:, 0] == pytest.approx(columns[:, 0] / 4.0, rel=0.2)  # causal, from rest


def test_the_columns_of_a_line_span_every_phase():
    columns = line_columns(LINES, RATE, SIZE)
    assert columns.shape == (10, SIZE)
    wanted = tones(9, LINES, 2.0)
    assert columns.T @ np.linalg.lstsq(columns.T, wanted)[0] == pytest.approx(wanted, abs=1e-9)
    assert line_columns((), RATE, 50).shape == (0, 50)


def test_the_comb_is_the_least_squares_fit():
    series, tone = white(10, 1000), 0.0317
    k = np.unique(np.r_[np.arange(1, 40) / 2.0, np.arange(1, 60) / 3.0])
    k = k[k * tone < 0.499]
    phase = 2.0 * np.pi * tone * np.outer(np.arange(1000), k)
    columns = np.c_[np.ones(1000), np.cos(phase), np.sin(phase)]
    rest = series - columns @ np.linalg.lstsq(columns, series, rcond=None)[0]
    assert without_harmonics(series, tone, (1, 2, 3)) == pytest.approx(rest, abs=1e-5)


@pytest.mark.parametrize("step", [1.0, 0.37, 2.44140625e-4 * 9.81])
def test_the_converters_step_is_found(step):
    samples = 30.0 * step * np.sin(np.arange(5000) / 7.0) + step * white(11, 5000)
    assert converter_lsb(0.123 + step * np.round(samples / step)) == pytest.approx(step, rel=1e-6)


def test_numbers_that_were_not_rounded_have_no_step():
    assert converter_lsb(white(12)) == 0.0
    assert converter_lsb(np.full(100, 3.0)) == 0.0
    assert converter_lsb([1.0, np.nan, 1.0]) == 0.0


def test_a_dead_band_is_found_and_nothing_else_is_one():
    samples = 100.0 * white(14)
    assert dead_band(np.where(np.abs(samples) < 20.0, 0.0, samples)) == pytest.approx(20.0, rel=0.02)
    # a body of no force at all for half of the time, as a simulated rock in flight
    assert dead_band(np.maximum(samples, 0.0)) < 0.5
    assert dead_band(samples) == dead_band(np.zeros(100)) == dead_band([np.nan, 1.0]) == 0.0


def test_rounding_counts_as_white_noise():
    carrier = 20.0 * np.sin(2.0 * np.pi * 80.0 * np.arange(SIZE) / RATE)
    residual = np.round(white(13) + carrier) - carrier
    assert estimate(residual, RATE, 80.0, 1.0).std == pytest.approx(math.sqrt(1.0 + 1.0 / 12.0), rel=0.02)
    assert estimate(1e-3 * white(14), RATE, 80.0, 1.0).std == pytest.approx(1.0 / math.sqrt(12.0))


@pytest.mark.parametrize("residual", [np.zeros(100), np.arange(10.0)])
def test_too_little_to_estimate_from_is_refused(residual):
    with pytest.raises(ValueError, match="give 64"):
        estimate(residual, RATE, 80.0)
