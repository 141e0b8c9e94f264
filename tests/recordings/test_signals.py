"""Ceilings, held values, spikes, tones and clocks, each on a signal made for it."""

import numpy as np
import pytest

from drillenv.recordings.excitation import phase_jumps, strongest_tone, tone_at, tone_share
from drillenv.recordings.signal_faults import (
    Run,
    at_ceiling,
    habits,
    jumps_out,
    loses_its_noise,
    rate_of,
    runs_of_equals,
    spikes,
    sticks,
    stretches,
    time_jumps,
)

RATE = 10000.0
TIME = np.arange(5000) / RATE


def sine(frequency=61.7, phase=0.3):
    return np.sin(2 * np.pi * frequency * TIME + phase)


def noise(size=5000, seed=0):
    return np.random.default_rng(seed).normal(size=size)


def test_stretches():
    mask = np.array([1, 1, 0, 1, 0, 0, 0, 1], dtype=bool)
    assert stretches(mask) == [(0, 2), (3, 4), (7, 8)]
    assert stretches(mask, join=2) == [(0, 4), (7, 8)]
    assert stretches(~mask | mask) == [(0, 8)]
    assert stretches(mask & ~mask) == []


@pytest.mark.parametrize("bits", [None, 16, 12, 10, 8])
def test_a_peak_is_no_ceiling_however_coarse(bits):
    for frequency in (61.7, 50.0, 100.0, 333.3):
        for signal in (sine(frequency), np.maximum(sine(frequency), 0.0) ** 2):
            step = 2.0 / 2 ** (bits or 60)
            coarse = np.round(signal / step) * step
            assert not at_ceiling(coarse).any()
            clipped = np.round(np.minimum(signal, 0.8) / step) * step
            np.testing.assert_array_equal(at_ceiling(clipped), signal >= clipped.max() - step / 2)


def test_a_ceiling_is_found_at_either_end():
    clipped = np.clip(sine() + 0.01 * noise(), -0.9, 0.7)
    np.testing.assert_array_equal(at_ceiling(clipped), clipped == 0.7)
    np.testing.assert_array_equal(at_ceiling(-clipped), clipped == -0.9)
    assert not at_ceiling(np.full(100, 3.0)).any()


def test_runs_of_equals():
    samples = np.array([1.0, 1, 1, 1, 1, 2, 3, 3, 3, 3, 3, 3, 4])
    assert runs_of_equals(samples) == [Run(0, 5, 1.0), Run(6, 12, 3.0)]
    assert habits(samples).equal == 9


@pytest.mark.parametrize(("step", "length"), [(0.0, 5), (0.1, 8), (1.0, 40), (3.0, 400)])
def test_a_held_value_among_noise(step, length):
    samples = noise() if step == 0.0 else np.round(noise() / step) * step
    runs = runs_of_equals(samples)
    assert not any(sticks(samples, run, habits(samples)) for run in runs)
    samples[1000 : 1000 + length] = samples[999]
    runs = runs_of_equals(samples)
    held = [run for run in runs if sticks(samples, run, habits(samples))]
    assert len(held) == 1
    assert held[0].start == pytest.approx(999, abs=3)


def test_coming_to_rest_is_not_being_held():
    resting = noise() * np.exp(-TIME * 100.0)
    resting[2000:2020] = resting[1999]
    resting[3000:] = 0.0
    for run in runs_of_equals(resting):
        assert not loses_its_noise(resting, run, habits(resting))
    samples = noise()
    samples[2000:2020] = samples[1999]
    (run,) = runs_of_equals(samples)
    assert loses_its_noise(samples, run, habits(samples))
    smooth = sine()
    smooth[2000:2020] = smooth[1999]
    (run,) = runs_of_equals(smooth)
    assert not loses_its_noise(smooth, run, habits(smooth))


def test_a_smooth_channel_jumps_out_of_a_held_value():
    smooth = sine()
    smooth[2000:2060] = smooth[1999]
    (run,) = runs_of_equals(smooth)
    assert jumps_out(smooth, run)
    coarse = np.round(sine() / 0.02) * 0.02
    assert not any(jumps_out(coarse, run) for run in runs_of_equals(coarse))


def test_spikes_stand_alone():
    samples = noise()
    samples[[10, 4999]] = 1e4, -1e5
    np.testing.assert_array_equal(np.flatnonzero(spikes(samples)), [10, 4999])
    blow = 0.01 * noise()
    blow[100:104] = 20.0, 50.0, 50.0, 20.0
    assert not spikes(blow).any()
    samples[2000:2010] = 1e13
    assert spikes(samples)[2000:2010].all()


@pytest.mark.parametrize("frequency", [50.0, 61.73, 119.9])
def test_tones(frequency):
    samples = 0.4 * sine(frequency) + 0.1 + 0.002 * noise()
    tone = strongest_tone(samples, RATE)
    assert tone.frequency == pytest.approx(frequency, rel=2e-5)
    assert (tone.amplitude, tone.offset) == (pytest.approx(0.4, abs=1e-3), pytest.approx(0.1, abs=1e-3))
    assert tone.phase == pytest.approx(0.3, abs=0.01)
    assert tone.purity > 0.999
    assert tone_at(samples, RATE, 2 * frequency).purity < 0.01
    assert tone_share(samples, RATE, frequency) == pytest.approx(1.0, abs=0.01)
    assert tone_share(noise(), RATE, frequency) < 0.1
    assert phase_jumps(samples, RATE, frequency) == []


@pytest.mark.parametrize("lost", [10, 40, 81, 120])
@pytest.mark.parametrize("drift", [0.0, 0.05])
def test_phase_jumps(lost, drift):
    """81 samples are half a period: the jump that is hardest to place."""
    samples = np.delete(sine(61.7 + drift) + 0.005 * noise(), slice(2500, 2500 + lost))
    ((at, seconds),) = phase_jumps(samples, RATE, 61.7)
    assert at == pytest.approx(2500, abs=6)
    period = RATE / 61.7
    assert (seconds * RATE - lost + period / 2) % period == pytest.approx(period / 2, abs=2)


def test_a_tone_that_is_away_for_a_while_does_not_jump():
    for value in (0.0, 0.9):
        for length in (50, 162, 400, 1500):
            samples = sine() + 0.005 * noise()
            samples[2000 : 2000 + length] = value
            assert phase_jumps(samples, RATE, 61.7) == []


@pytest.mark.parametrize("digits", [9, 5, 4, 3, 2])
@pytest.mark.parametrize("begin", [0.0, 1.7e9])
def test_clocks(digits, begin):
    """A time written with fewer digits than the sampling needs still shows what is missing."""
    clock = np.round(TIME, digits) + begin
    assert time_jumps(clock, RATE) == []
    assert rate_of(clock) == pytest.approx(RATE, rel=0.01)
    late = np.round(np.where(np.arange(TIME.size) < 3000, TIME, TIME + 0.05), digits) + begin
    ((at, seconds),) = time_jumps(late, RATE)
    assert at == 3000
    assert seconds == pytest.approx(0.05, abs=1.1 * 10.0**-digits + 5e-7)
    assert rate_of(late) == pytest.approx(RATE, rel=0.01)
    back = np.where(np.arange(TIME.size) < 3000, TIME, TIME - 0.1) + begin
    ((at, seconds),) = time_jumps(back, RATE)
    assert (at, seconds) == (3000, pytest.approx(-0.1, abs=1e-3))


def test_a_clock_that_stands_has_no_rate():
    assert np.isnan(rate_of(np.zeros(100)))
    assert np.isnan(rate_of(-TIME))
