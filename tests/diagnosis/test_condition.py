"""First guesses: what sensors show that is not of the rock, and where windows begin."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import upfirdn

from drillenv.blind.campaigns import plain_campaign
from drillenv.blind.mechanisms import of_library
from drillenv.diagnosis.condition import (
    acceleration_level,
    condition,
    conditioned,
    contacts,
    fit_excitation,
    flight_reading,
    flights,
    is_near_mains,
    thin,
    thinning,
)
from drillenv.diagnosis.drill import decimated
from drillenv.rig import Rig

RATE, NOISE = 25600.0, 5.0


def blows(rng, frequency=73.0, lightly=0.0):
    """Force of blows of 800 N, every third one followed by one of ``lightly`` newtons, and where it is off the rock."""
    time = np.arange(int(0.4 * RATE)) / RATE
    turn = np.mod(time * frequency, 1.0)
    force = np.where(turn < 0.3, 800.0 * np.sin(np.pi * turn / 0.3), 0.0)
    off = force == 0.0
    if lightly:
        after = (turn >= 0.3) & (np.floor(time * frequency) % 3 == 0)
        force = np.where(after, lightly, force)
    return time, force + NOISE * rng.standard_normal(time.size), off


@pytest.mark.parametrize("level", [0.0, -40.0, 25.0])
@pytest.mark.parametrize("hum", [8.0, 30.0])
@pytest.mark.parametrize("mains", [49.97, 60.03])
def test_hum_and_zero_of_a_load_cell_are_read_in_flight(level, hum, mains):
    time, force, off = blows(np.random.default_rng(5))
    shown = level + hum * np.sin(2 * np.pi * mains * time + 1.0)
    read = flight_reading(force + shown, np.zeros_like(force), NOISE, RATE, 2 * np.pi * 73.0)
    assert np.abs(read - shown)[off].max() < 0.5 * NOISE


@pytest.mark.parametrize("hum", [0.0, 20.0])
def test_a_zero_that_drifts_is_read_in_flight(hum):
    time, force, off = blows(np.random.default_rng(5))
    shown = -40.0 + 30.0 * time / time[-1] + hum * np.sin(2 * np.pi * 50.0 * time + 1.0)
    read = flight_reading(force + shown, np.zeros_like(force), NOISE, RATE, 2 * np.pi * 73.0)
    assert np.abs(read - shown)[off].max() < 0.5 * NOISE


def test_a_hum_that_swells_is_read_in_flight():
    time, force, off = blows(np.random.default_rng(5))
    shown = 10.0 + (10.0 + 40.0 * time / time[-1]) * np.sin(2 * np.pi * 50.0 * time + 1.0)
    read = flight_reading(force + shown, np.zeros_like(force), NOISE, RATE, 2 * np.pi * 73.0)
    assert np.abs(read - shown)[off].max() < NOISE


@pytest.mark.parametrize("hum", [0.0, 20.0])
@pytest.mark.parametrize("mass", [0.03, 0.25])
def test_mass_that_a_load_cell_carries_is_read_in_flight(mass, hum):
    """The drive shakes it with the indenter; on the rock the indenter is slowed down by what the cell reads."""
    rng = np.random.default_rng(5)
    time, force, off = blows(rng)
    truly = 180.0 * np.sin(2 * np.pi * 73.0 * time + 0.7) + 40.0 * np.sin(2 * np.pi * 400.0 * time)
    truly = truly - np.where(off, 0.0, force / 3.0)
    shown = mass * truly + hum * np.sin(2 * np.pi * 49.97 * time + 1.0)
    acceleration = truly + 2.0 * rng.standard_normal(time.size)
    read = flight_reading(force + shown, acceleration, NOISE, RATE, 2 * np.pi * 73.0)
    # what the cell carries is taken off the blows too
    assert np.abs(read - shown)[off].max() < 0.5 * NOISE
    assert np.abs(read - shown).max() < NOISE


@pytest.mark.parametrize("frequency", [50.0, 60.0, 73.0, 100.0])
def test_a_load_cell_that_does_not_hum_shows_nothing(frequency):
    for seed in range(10):
        _time, force, _off = blows(np.random.default_rng(seed), frequency)
        assert not flight_reading(force, np.zeros_like(force), NOISE, RATE, 2 * np.pi * frequency).any()


@pytest.mark.parametrize(("frequency", "periods"), [(60.6, 1), (99.2, 2)])
def test_light_presses_in_step_with_the_mains_are_no_hum(frequency, periods):
    """Presses in every period of a drive close to 60 Hz, and in every other one of a drive close to 100 Hz."""
    time, force, off = blows(np.random.default_rng(5), frequency)
    force += np.where(off, np.maximum(28.0 * np.sin(2 * np.pi * frequency / periods * time + 4.0), 0.0), 0.0)
    assert not flight_reading(force, np.zeros_like(force), NOISE, RATE, 2 * np.pi * frequency).any()
    # a hum would be read into them otherwise
    assert flight_reading(force, np.zeros_like(force), NOISE, RATE, 2 * np.pi * 73.0).any()


def test_zero_of_an_accelerometer_is_its_mean_between_standstills():
    zero = of_library("sensor-offset", o_a=7.0)
    made = plain_campaign(np.random.default_rng(6), 4, (zero,), recordings=3, seconds=0.2)
    recording = made.campaign.recordings[0]
    force, acceleration = (recording.channels[name].samples for name in ("force", "acceleration"))
    touches = contacts(force, NOISE)
    assert acceleration_level(touches, force, acceleration, 2.0) == pytest.approx(7.0, abs=0.1)
    assert acceleration_level(touches, force, acceleration - 7.0, 2.0) == 0.0


def test_a_contact_that_the_end_cuts_off_is_left_out():
    _time, force, _off = blows(np.random.default_rng(5))
    touches = contacts(force, NOISE)
    peak = int(touches[7, 0] + np.argmax(force[slice(*touches[7])]))
    assert np.array_equal(contacts(force[:peak], NOISE), touches[:7])


def test_an_indenter_that_is_pressed_on_lightly_does_not_fly():
    _time, force, _off = blows(np.random.default_rng(5), lightly=20.0)
    touches = contacts(force, NOISE)
    found = flights(touches, force, NOISE)
    # 29 blows are whole, and ten of the flights between them are none
    assert len(found) == 18
    assert all(force[first:after].mean() < 3.0 for first, after in found)


@pytest.mark.slow
def test_states_are_guessed_by_the_lag_of_each_recording():
    """Recordings of the same motion, whose accelerations come late by as much, by something else and not at all."""
    rig, made = Rig(), []
    for late, rate in ((2e-4, 25600.0), (3.5e-4, 40000.0), (0.0, 25600.0), (0.0, 40000.0)):
        lagging = (of_library("channel-delay", delay_a=late),) if late else ()
        campaign = plain_campaign(np.random.default_rng(3), 4, lagging, recordings=3, seconds=0.2, rate=rate).campaign
        made.append(campaign.recordings[0])
    first, second, *true = conditioned(made, rig)
    for found, as_it_was, recording in zip((first, second), true, made, strict=False):
        told = np.abs(found.states - as_it_was.states).mean(axis=0)
        untold = np.abs(condition(recording, rig).states - as_it_was.states).mean(axis=0)
        # of the shortening, the closing speed and the indenter's speed
        assert (told[:3] < 0.1 * untold[:3]).all()


def test_its_first_windows_are_those_of_the_recording():
    made = plain_campaign(np.random.default_rng(4), 4, recordings=3, seconds=0.2)
    whole = condition(made.campaign.recordings[0], Rig())
    part = whole.first(5)
    assert np.array_equal(part.starts, whole.starts[:6])
    assert np.array_equal(part.states, whole.states[:5])
    assert part.force.size == part.acceleration.size == whole.starts[5]
    assert whole.first(1000) is whole


@pytest.mark.parametrize("factor", [2, 4])
def test_white_noise_stays_white_where_a_recording_is_thinned(factor):
    noise = np.random.default_rng(3).standard_normal(2**18)
    kept = thin(noise, factor)[10:-10]
    assert np.std(kept) == pytest.approx(1.0 / np.sqrt(factor), rel=0.01)
    for lag in range(1, 9):
        assert abs(kept[lag:] @ kept[:-lag]) / (kept @ kept) < 4.0 / np.sqrt(kept.size)


@pytest.mark.parametrize("factor", [1, 2, 4])
def test_a_slow_signal_stays_as_it_is_where_it_is_thinned(factor):
    time = np.arange(2000) / 51200.0
    slow = 3.0 + np.sin(2.0 * np.pi * 400.0 * time)
    assert thin(slow, factor)[20:-20] == pytest.approx(slow[::factor][20:-20], abs=2e-3)


@pytest.mark.parametrize(("fine", "factor"), [(1, 4), (2, 2), (4, 1), (3, 2)])
def test_a_model_is_thinned_as_the_recording_is(fine, factor):
    """Through the logger's filter, at its samples, and then thinned: all of it in one pass."""
    rng = np.random.default_rng(5)
    signal, kernel = rng.standard_normal(2400 * fine), rng.standard_normal(32 * fine + 1)
    half = 16 * fine
    logged = np.convolve(signal, kernel)[half : half + signal.size][::fine]
    there = slice(20, -20)
    assert decimated(signal, kernel, fine, factor)[there] == pytest.approx(thin(logged, factor)[there])
    assert decimated(signal, None, fine, factor) == pytest.approx(thin(signal[::fine], factor))


def test_filtering_and_decimation_are_those_of_scipy():
    """At all samples, those at the ends too, where a signal is 0 beyond."""
    rng = np.random.default_rng(6)
    signals, kernel = rng.standard_normal((3, 2, 400)), rng.standard_normal(33)
    expected = upfirdn(kernel, signals, 1, 1, axis=-1)[..., 16:416:1]
    assert decimated(signals, kernel, 1, 1) == pytest.approx(expected)
    assert decimated(np.asfortranarray(signals), kernel, 1, 1) == pytest.approx(expected)


def test_a_recording_is_thinned_to_what_is_enough():
    made = plain_campaign(np.random.default_rng(5), recordings=2, seconds=0.2)
    recording = made.campaign.recordings[0]
    data = condition(recording, Rig())
    assert data.thinned == 2
    assert data.rate == recording.sample_rate / 2
    assert data.force.size == recording.channels["force"].samples.size // 2
    assert np.sum(thinning(2) ** 2) == pytest.approx(0.5, rel=0.01)
    assert data.quanta == (0.0, 0.0) or min(data.quanta) > 0.0


@pytest.mark.parametrize("mains", [50.007, 59.99])
def test_mains_beside_the_excitation_are_not_taken_for_a_part_of_it(mains):
    """At a few turns' distance they would shift its amplitude by a per cent."""
    rng, rate, n = np.random.default_rng(8), 25600.0, 14336
    time, frequency = np.arange(n) / rate, 52.7013
    sine = 0.5 * np.sin(2 * np.pi * frequency * time + 0.4)
    hum = 0.02 * np.sin(2 * np.pi * mains * time + 2.0) + 0.004 * np.sin(6 * np.pi * mains * time)
    omega, phase, amplitude = fit_excitation(sine + hum + 2e-3 * rng.standard_normal(n), rate, 52.7)
    # standard deviations by the noise alone: 2.4e-5 V, and twice 4.7e-5 rad with the frequency free
    assert abs(amplitude - 0.5) < 2e-4 and abs(phase - 0.4) < 1e-3
    assert abs(omega / (2 * np.pi) - frequency) < 1e-3


@pytest.mark.parametrize(
    ("frequency", "near"), [(60.4, True), (59.1, True), (61.6, False), (100.2, False), (49.2, True)]
)
def test_an_excitation_is_near_the_mains_where_these_drift_by_less_than_half_a_turn(frequency, near):
    data = SimpleNamespace(omega=2.0 * np.pi * frequency, force=np.zeros(12800), rate=25600.0)
    assert is_near_mains(data) is near
