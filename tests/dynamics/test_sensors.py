"""What sensors make of the channels, against solutions that share nothing with the filters used."""

import math
import pickle
from itertools import pairwise

import numpy as np
import pytest

from drillenv.checks import InputError
from drillenv.dynamics.effects import Channels, make
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.dynamics.sensors import PerChannel, Recording, channels_of, digitised, in_order, read, record
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS

RIG, SETTING, ROCK = Rig(), Setting(90.0, 0.45, 1.0), ROCKS[4]
RATE = 25600.0
NOISE = PerChannel(0.002, 5.0, 2.0)


def tone(frequency, rate=400e3, seconds=0.05):
    """Channels that are sines, long enough for a sensor to settle on."""
    t = np.arange(round(seconds * rate)) / rate
    wave = np.sin(2 * math.pi * frequency * t)
    return Channels(rate, 0.0, 0.4 * wave, 900.0 * wave, 300.0 * wave), t


def recorded(*sensors, **more):
    return record(RIG, SETTING, ROCK, 0.1, RATE, sensors=sensors, lead=1.0, **more)


# --- Each sensor is its equation


@pytest.mark.parametrize(("natural", "zeta"), [(4480.0, 0.022), (3000.0, 0.3)])
@pytest.mark.parametrize("frequency", [200.0, 2500.0, 6000.0])
def test_resonance_has_its_gain_and_phase(natural, zeta, frequency):
    true, t = tone(frequency, rate=3.2e6)
    reading = read(true, [make("accelerometer-resonance", f_a=natural, zeta_a=zeta)]).acceleration
    ratio = frequency / natural
    response = 1 / complex(1 - ratio**2, 2 * zeta * ratio)
    late = t > 12 / (2 * math.pi * natural * zeta)
    expected = 300.0 * np.imag(response * np.exp(2j * math.pi * frequency * t))
    assert np.count_nonzero(late) > 1000
    # a sine taken straight between samples is lower by (w h)^2 / 12
    error = abs(response) * 300 * (2 * math.pi * frequency / true.rate) ** 2 / 12
    assert np.max(np.abs(reading - expected)[late]) < 1.01 * error + 300 * math.exp(-11)


@pytest.mark.parametrize("frequency", [100.0, 1500.0, 5000.0])
def test_lowpass_has_its_gain_and_phase(frequency):
    true, t = tone(frequency, rate=3.2e6)
    reading = read(true, [make("accelerometer-lowpass", f_b=1500.0)]).acceleration
    response = 1 / complex(1, frequency / 1500.0)
    expected = 300.0 * np.imag(response * np.exp(2j * math.pi * frequency * t))
    late = t > 20 / (2 * math.pi * 1500.0)
    assert np.max(np.abs(reading - expected)[late]) < 300 * (2 * math.pi * frequency / true.rate) ** 2 / 11 + 1e-6
    assert frequency != 1500.0 or math.isclose(abs(response), 10 ** (-3.0103 / 20), rel_tol=1e-5)


@pytest.mark.parametrize("frequency", [0.5, 2.0, 40.0])
def test_highpass_has_its_gain_and_phase(frequency):
    true, t = tone(frequency, rate=10e3, seconds=8.0)
    reading = read(true, [make("sensor-highpass", corner_f=2.0, corner_a=0.7)])
    late = t > 6.0
    for made, size, corner in ((reading.force, 900.0, 2.0), (reading.acceleration, 300.0, 0.7)):
        response = 1 / complex(1, -corner / frequency)
        expected = size * np.imag(response * np.exp(2j * math.pi * frequency * t))
        assert np.max(np.abs(made - expected)[late]) < 1e-4 * size
    assert np.array_equal(reading.excitation, true.excitation)


def test_highpass_has_settled_on_the_mean_unless_the_rig_stood_still():
    """A step of a channel dies out within its time constant; one that was always there is gone from the start."""
    time = np.arange(4000) / 1e3
    for from_rest, expected in ((False, np.zeros(4000)), (True, 50.0 * np.exp(-2 * math.pi * 0.5 * time))):
        true = Channels(1e3, 0.0, np.zeros(4000), np.full(4000, 50.0), np.full(4000, 50.0), from_rest)
        reading = read(true, [make("sensor-highpass", corner_f=0.5)])
        # the step is taken as a ramp over the sample before the first
        assert np.allclose(reading.force, expected, rtol=0, atol=0.1)
        assert np.all(reading.acceleration == 50.0)


def test_recorded_highpass_takes_the_mean_and_hardly_more():
    plain, coupled = recorded(), recorded(make("sensor-highpass", corner_f=0.3))
    mean = plain.channels.force.mean()
    assert abs(coupled.channels.force.mean()) < 0.05 * mean
    off = plain.channels.force - coupled.channels.force - mean
    assert np.max(np.abs(off)) < 0.2 * np.max(plain.channels.force)


def rung(run, w, zeta):
    """The reading of a ringing accelerometer at the samples of a run, by the classical Runge-Kutta method."""
    h, reading = run.time[1], np.empty(run.time.size)
    y = np.array([run.acceleration[0], 0.0])

    def slope(y, a):
        return np.array([y[1], w * w * (a - y[0]) - 2 * zeta * w * y[1]])

    for i, (now, later) in enumerate(pairwise(run.acceleration)):
        reading[i] = y[0]
        k1 = slope(y, now)
        k2 = slope(y + h / 2 * k1, (now + later) / 2)
        k3 = slope(y + h / 2 * k2, (now + later) / 2)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + slope(y + h * k3, later))
    reading[-1] = y[0]
    return reading


def test_recorded_resonance_on_a_motion():
    """A real motion with its corners, sampled 16 times a sample, against one known 64 times as densely."""
    lead = run_hybrid(RIG, SETTING, ROCK, 0.5, 0.0)
    dense = run_hybrid(RIG, SETTING, ROCK, 0.02, 64 * RATE, lead.end_phase, lead.end)
    w, zeta = 2 * math.pi * 4480.0, 0.022
    expected = rung(dense, w, zeta)[::64]
    given = record(
        RIG, SETTING, ROCK, 0.02, RATE, start=lead.end, phase=lead.end_phase,
        sensors=[make("accelerometer-resonance", f_a=4480.0, zeta_a=0.022)],
    )  # fmt: skip
    assert np.max(np.abs(dense.acceleration)) > 200
    assert np.max(np.abs(given.channels.acceleration - dense.acceleration[::64])) > 10
    assert np.max(np.abs(given.channels.acceleration - expected)) < 0.05
    assert np.allclose(given.truth.acceleration, dense.acceleration[::64], rtol=0, atol=1e-6)


@pytest.mark.parametrize("delay", [0.0, 1 / RATE, 7.3e-5, 1.523e-4, 4.0e-3])
def test_delay_is_the_motion_earlier(delay):
    """The delayed channel is that of a run which is sampled earlier."""
    given = recorded(make("channel-delay", delay_a=delay), phase=0.7)
    begun = run_hybrid(RIG, SETTING, ROCK, 1.0 - delay, 0.0, 0.7 - 2 * math.pi * 90.0)
    early = run_hybrid(RIG, SETTING, ROCK, 0.1, RATE, begun.end_phase, begun.end)
    error = np.abs(given.channels.acceleration - early.acceleration)
    # between four samples at 16 times the rate; next to a corner of the acceleration that is a fraction of its bend
    assert np.median(error) < 1e-4 and np.max(error) < 1.0
    assert np.array_equal(given.channels.force, given.truth.force)
    assert delay == 0.0 or np.max(np.abs(given.channels.acceleration - given.truth.acceleration)) > 10


def test_delay_of_every_channel_and_more_points():
    sensors = [make("channel-delay", delay_e=1.1e-4, delay_f=2.3e-4)]
    coarse, fine = (recorded(*sensors, oversample=n).channels for n in (16, 128))
    assert np.max(np.abs(coarse.force - fine.force)) < 1.0
    t = fine.time - 1.1e-4
    assert np.allclose(fine.excitation, 0.45 * np.sin(2 * math.pi * 90 * t), rtol=0, atol=1e-12)


def test_delay_from_rest_reads_nothing_until_it_is_through():
    given = record(RIG, SETTING, ROCK, 0.01, RATE, sensors=[make("channel-delay", delay_a=10 / RATE)])
    assert np.all(given.channels.acceleration[:10] == 0.0)
    assert given.channels.acceleration[10] == given.truth.acceleration[0] > 60  # the spring lets go at once
    assert np.array_equal(given.channels.acceleration[10:], given.truth.acceleration[:-10])


def test_load_cell_inertia_is_its_equation():
    given = recorded(make("load-cell-inertia", m_c=0.12))
    assert np.array_equal(given.channels.force, given.truth.force + 0.12 * given.truth.acceleration)
    assert np.array_equal(given.channels.acceleration, given.truth.acceleration)


def test_load_cell_feels_the_true_acceleration_whatever_the_accelerometer_says():
    slow, cell = make("accelerometer-lowpass", f_b=300.0), make("load-cell-inertia", m_c=0.2)
    one, other = recorded(slow, cell), recorded(cell, slow)
    assert np.array_equal(one.channels.force, other.channels.force)
    assert np.allclose(one.channels.force, one.truth.force + 0.2 * one.truth.acceleration, rtol=0, atol=1e-9)


def test_hum_is_its_equation():
    hum = make("mains-hum", f_m=60.0, b_e=0.01, psi_e=0.3, b_f=12.0, psi_f=-1.0, b_a=4.0, psi_a=2.0)
    given = recorded(hum)
    turned = 2 * math.pi * 60.0 * given.channels.time
    for name, size, phase in (("excitation", 0.01, 0.3), ("force", 12.0, -1.0), ("acceleration", 4.0, 2.0)):
        added = getattr(given.channels, name) - getattr(given.truth, name)
        assert np.allclose(added, size * np.sin(turned + phase), rtol=0, atol=1e-9)


def test_offset_is_its_equation_behind_all_else():
    given = recorded(make("sensor-offset", o_e=0.02, o_f=-30.0, o_a=5.0))
    for name, offset in (("excitation", 0.02), ("force", -30.0), ("acceleration", 5.0)):
        assert np.allclose(getattr(given.channels, name), getattr(given.truth, name) + offset, rtol=1e-12, atol=1e-12)
    slow = make("accelerometer-lowpass", f_b=300.0)
    both = recorded(make("sensor-offset", o_a=5.0), slow).channels.acceleration
    assert np.allclose(both, recorded(slow).channels.acceleration + 5.0, rtol=0, atol=1e-9)


# --- The recording


def test_recording_is_the_run():
    given = record(RIG, SETTING, ROCK, 0.2, RATE, phase=0.4)
    run = run_hybrid(RIG, SETTING, ROCK, 0.2, RATE, 0.4)
    assert np.array_equal(given.channels.force, run.force)
    assert np.array_equal(given.channels.acceleration, run.acceleration)
    assert np.allclose(given.channels.excitation, 0.45 * np.sin(0.4 + 2 * math.pi * 90 * run.time), rtol=0, atol=1e-12)
    assert given.end == run.end and given.end_phase == run.end_phase
    assert given.channels.rate == RATE and given.channels.begin == 0.0 and given.channels.time[1] == 1 / RATE


@pytest.mark.parametrize("sensors", [(), (make("accelerometer-lowpass", f_b=1000.0),)])
def test_lead_runs_the_rig_before_time_zero(sensors):
    """A recording with a lead is the later part of one that begins with the lead."""
    late = record(RIG, SETTING, ROCK, 0.05, RATE, lead=0.5, phase=1.0, sensors=sensors)
    whole = record(RIG, SETTING, ROCK, 0.55, RATE, phase=1.0 - 2 * math.pi * 90 * 0.5, sensors=sensors)
    at = round(0.5 * RATE)
    assert late.channels.time[0] == 0.0 and late.channels.force.size == round(0.05 * RATE) + 1
    for name in ("excitation", "force", "acceleration"):
        one, other = getattr(late.channels, name), getattr(whole.channels, name)[at:]
        assert np.allclose(one, other, rtol=0, atol=1e-6)
    assert np.allclose(late.end[:4], whole.end[:4], rtol=0, atol=1e-9)


def test_recording_goes_on_where_one_ended():
    first = record(RIG, SETTING, ROCK, 0.25, RATE)
    second = record(RIG, SETTING, ROCK, 0.25, RATE, start=first.end, phase=first.end_phase)
    whole = record(RIG, SETTING, ROCK, 0.5, RATE)
    at = round(0.25 * RATE)
    assert np.allclose(second.channels.force, whole.channels.force[at:], rtol=0, atol=1e-5)


def test_noise_has_its_size_and_comes_from_the_generator():
    given, again, other = (recorded(noise=NOISE, rng=np.random.default_rng(seed)).channels for seed in (3, 3, 4))
    truth = recorded().truth
    for name, std in NOISE._asdict().items():
        noise = getattr(given, name) - getattr(truth, name)
        assert abs(np.std(noise) / std - 1) < 0.05 and abs(np.mean(noise)) < 4 * std / math.sqrt(noise.size)
        assert np.array_equal(getattr(given, name), getattr(again, name))
        assert not np.array_equal(getattr(given, name), getattr(other, name))
        assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 0.08


@pytest.mark.parametrize("bits", [12, 16])
def test_digits_and_clipping(bits):
    spans = PerChannel(1.0, 5000.0, 200.0)
    given, truth = recorded(bits=bits, spans=spans).channels, recorded().truth
    for name, span in spans._asdict().items():
        digit = span / 2 ** (bits - 1)
        part, true = getattr(given, name), getattr(truth, name)
        assert np.allclose(part / digit, np.round(part / digit), rtol=0, atol=1e-6)
        assert np.max(np.abs(part - np.clip(true, -span, span - digit))) <= digit / 2 * (1 + 1e-9)
    assert np.max(truth.acceleration) > 200 > np.max(given.acceleration) >= 200 * (1 - 2.0 ** (1 - bits)) - 1e-9


def test_sensors_act_in_one_order():
    names = ["sensor-offset", "mains-hum", "channel-delay", "accelerometer-lowpass", "accelerometer-resonance"]
    ordered = in_order(make(name) for name in [*names, "load-cell-inertia"])
    assert [each.effect.name for each in ordered] == ["load-cell-inertia", *reversed(names)]


def test_channels_of_a_run():
    run = run_hybrid(RIG, SETTING, ROCK, 0.01, 1e4, 0.3)
    channels = channels_of(run, SETTING, 0.3)
    assert math.isclose(channels.rate, 1e4) and np.allclose(channels.time, run.time)
    assert np.allclose(channels.excitation, 0.45 * np.sin(0.3 + 2 * math.pi * 90 * run.time), rtol=0, atol=1e-13)


def test_recordings_pickle():
    given = recorded(make("sensor-offset", o_f=3.0))
    again = pickle.loads(pickle.dumps(given))
    assert isinstance(again, Recording) and np.array_equal(again.channels.force, given.channels.force)


def test_bad_input_is_said_in_one_line():
    hum = make("mains-hum", b_f=1.0)
    for message, call in (
        ("noise needs a numpy Generator", lambda: recorded(noise=NOISE)),
        ("noise on the force", lambda: recorded(noise=PerChannel(0, -1, 0), rng=np.random.default_rng())),
        ("bits is 3", lambda: recorded(bits=3, spans=NOISE)),
        ("bits without spans", lambda: recorded(bits=12)),
        ("span of the force", lambda: recorded(bits=12, spans=PerChannel(1, 0, 1))),
        ("none of a sensor", lambda: recorded(make("contact-rate", chi=1.0))),
        ("given twice", lambda: recorded(hum, hum)),
        ("effects.make", lambda: recorded("mains-hum")),
        ("lead is -1", lambda: record(RIG, SETTING, ROCK, 0.1, lead=-1.0)),
        ("oversample is 0", lambda: recorded(oversample=0)),
        ("sample_rate is 0", lambda: record(RIG, SETTING, ROCK, 0.1, 0.0)),
        ("does not act on the motion", lambda: record(RIG, SETTING, ROCK, 0.1, effects=[hum])),
        ("has 0 samples", lambda: channels_of(run_hybrid(RIG, SETTING, ROCK, 0.1, 0.0), SETTING)),
        ("bits without spans", lambda: digitised(recorded().truth, bits=12)),
    ):
        with pytest.raises(InputError, match=message) as caught:
            call()
        assert "\n" not in str(caught.value)
