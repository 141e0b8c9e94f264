"""Transducers and logger of the concealed rig against closed forms, and against the library's own sensors."""

import math

import numpy as np
import pytest

from drillenv.blind import sensors
from drillenv.blind.mechanisms import MECHANISMS, OUTSIDE, Site, of_library
from drillenv.dynamics.effects import Channels, make
from drillenv.dynamics.sensors import read

RATE = 204800.0
TIME = np.arange(int(0.2 * RATE)) / RATE


def scene(from_rest=True):
    return sensors.Scene(RATE, TIME, np.zeros(TIME.size, dtype=bool), from_rest, np.random.default_rng(0), {})


def linear_transducers():
    for mechanism in (*MECHANISMS.values(), *OUTSIDE.values()):
        for equation in mechanism.equations:
            if equation.transfer is not None:
                yield pytest.param(equation, id=f"{mechanism.name} {equation.name}")


@pytest.mark.parametrize("equation", list(linear_transducers()))
@pytest.mark.parametrize("frequency", [160.0, 1250.0])
def test_a_filter_has_the_gain_and_phase_of_its_transfer_function(equation, frequency):
    p = equation.draw(np.random.default_rng(1), 1.0, Site(400.0, 100.0))
    make_transfer, names = equation.transfer
    above, over = make_transfer(*(p[name] for name in names))
    s = 2j * math.pi * frequency
    response = np.polyval(above, s) / np.polyval(over, s)
    wave = np.sin(2.0 * math.pi * frequency * TIME)
    true = sensors.Signals(wave, wave, wave)
    channel = "force" if "load cell" in equation.name or equation.transfer[0] in SLOW else "acceleration"
    found = getattr(equation.transducer(true, scene(), p), channel)
    later = TIME > 0.15
    late, turned = TIME[later] - 0.15, 2.0 * math.pi * frequency * TIME[later]
    # beside the wave, what is left of the start of a slow filter
    columns = np.column_stack([np.sin(turned), np.cos(turned), np.ones_like(late), late, late**2])
    amplitudes = np.linalg.lstsq(columns, found[later], rcond=None)[0]
    assert complex(amplitudes[0], amplitudes[1]) == pytest.approx(response, abs=2e-3 * max(1.0, abs(response)))


SLOW = (sensors.high_pass_two, sensors.leaky_charge)


@pytest.mark.parametrize("late", [1.7e-6, 1.234e-4, 3e-4])
def test_a_delay_by_part_of_a_sample_is_exact_below_the_band(late):
    wave = np.sin(2.0 * math.pi * 3000.0 * TIME)
    found = sensors.delayed(wave, late, RATE)[500:-500]
    assert np.max(np.abs(found - np.sin(2.0 * math.pi * 3000.0 * (TIME - late))[500:-500])) < 1e-5


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("accelerometer-resonance", {"f_a": 4000.0, "zeta_a": 0.05}),
        ("accelerometer-lowpass", {"f_b": 900.0}),
        ("channel-delay", {"delay_a": 2.3e-4, "delay_f": 1e-4}),
        ("load-cell-inertia", {"m_c": 0.2}),
        ("sensor-offset", {"o_e": 0.01, "o_f": 20.0, "o_a": -5.0}),
    ],
)
def test_the_librarys_sensors_read_the_same(name, values):
    rng = np.random.default_rng(2)
    # smooth between the points of the grid, and from rest
    rough = np.convolve(rng.normal(size=TIME.size), np.hanning(400), mode="same") * np.minimum(TIME / 0.02, 1.0) ** 3
    force, acceleration, excitation = 100.0 * rough, 20.0 * rough[::-1] * np.minimum(TIME / 0.02, 1.0) ** 3, 0.1 * rough
    library = read(Channels(RATE, 0.0, excitation, force, acceleration, True), [make(name, **values)])
    mine = of_library(name, **values)
    found = mine.equation.transducer(sensors.Signals(excitation, force, acceleration), scene(), mine.parameters)
    for channel in sensors.Signals._fields:
        a, b = getattr(found, channel)[200:-200], getattr(library, channel)[200:-200]
        assert np.max(np.abs(a - b)) < 2e-4 * np.max(np.abs(b))


def logger(**changes):
    made = sensors.Logger(25600.0, 0.0, "none", 0.4, 24, (1.0, 1.0, 1.0), "white")
    return made._replace(**changes)


@pytest.mark.parametrize("colour", ["white", "pink", "lines"])
def test_noise_has_its_standard_deviation(colour):
    zero = sensors.Signals(*(1e-9 * np.ones(TIME.size) for _ in range(3)))
    made = sensors.log_signals(zero, 1 / RATE, 0, 8, logger(colour=colour), np.random.default_rng(3))
    assert made.force.size == TIME[::8].size
    assert np.std(made.force) == pytest.approx(1.0, abs=0.05)


def test_a_converter_rounds_to_its_steps():
    wave = 900.0 * np.sin(2.0 * math.pi * 80.0 * TIME)
    quiet = logger(bits=12, noise=(0.0, 0.0, 0.0))
    made = sensors.log_signals(sensors.Signals(wave, wave, wave), 1 / RATE, 0, 8, quiet, np.random.default_rng(0)).force
    digit = 2000.0 / 2**11  # the range above 1.2 times 900 is 2000
    assert np.allclose(made / digit, np.round(made / digit), atol=1e-9)
    assert 0 < np.max(np.abs(made - wave[::8])) <= digit / 2 + 1e-9


@pytest.mark.parametrize("kind", ["butterworth", "linear-phase"])
def test_an_anti_alias_filter_keeps_the_band_and_stops_what_folds(kind):
    quiet = logger(anti_alias=kind, noise=(0.0, 0.0, 0.0))
    for frequency, low, high in ((500.0, 0.98, 1.02), (22000.0, 0.0, 0.05)):
        wave = np.sin(2.0 * math.pi * frequency * TIME)
        made = sensors.log_signals(sensors.Signals(wave, wave, wave), 1 / RATE, 0, 8, quiet, np.random.default_rng(0))
        middle = made.force[1000:-1000]
        assert low <= math.sqrt(2.0) * np.std(middle) <= high


@pytest.mark.parametrize(
    ("mechanism", "name", "parameters"),
    [
        ("sensor-offset", "another in each recording", {"o_e": 0.01, "o_f": 20.0, "o_a": -5.0, "spread": 0.7}),
        ("channel-delay", "another in each recording", {"delay_a": 2e-4}),
        (
            "mains-hum",
            "swelling",
            {"f_m": 50.0, "b_e": 0.01, "b_f": 20.0, "b_a": 5.0, "swell": 0.5, "f_swell": 1.0},
        ),
    ],
)
def test_a_transducer_says_what_it_drew_for_a_recording(mechanism, name, parameters):
    """The mean over a campaign is then what its recordings tell."""
    equation = next(each for each in MECHANISMS[mechanism].equations if each.name == name)
    wave = np.sin(2.0 * math.pi * 160.0 * TIME)
    told = scene()
    read = equation.transducer(sensors.Signals(wave, wave, wave), told, parameters)
    assert set(told.realised) <= set(parameters)
    if mechanism == "mains-hum":
        turned = np.column_stack([f(2.0 * math.pi * 50.0 * TIME) for f in (np.sin, np.cos)])
        assert np.hypot(*np.linalg.lstsq(turned, read.force - wave, rcond=None)[0]) == pytest.approx(
            told.realised["b_f"], rel=0.03
        )
    elif mechanism == "sensor-offset":
        np.testing.assert_allclose(read.force - wave, told.realised["o_f"])
        assert told.realised["o_f"] != parameters["o_f"]
    else:
        late = np.sin(2.0 * math.pi * 160.0 * (TIME - told.realised["delay_a"]))
        np.testing.assert_allclose(read.acceleration[2000:-2000], late[2000:-2000], atol=5e-6)


def test_a_mass_in_contact_only_is_read_as_by_the_library():
    force, acceleration = 100.0 * np.sin(600.0 * TIME), 20.0 * np.cos(700.0 * TIME)
    force = np.maximum(force, 0.0)
    told = scene()._replace(touching=force > 0.0)
    found = sensors.mass_in_contact(sensors.Signals(force, force, acceleration), told, {"m_c": 0.2}).force
    library = read(Channels(RATE, 0.0, force, force, acceleration, True), [make("load-cell-inertia", m_t=0.2)])
    np.testing.assert_allclose(found, library.force, atol=1e-12)
