"""What sensors make of signals, against the library's own sensors on signals sampled many times as densely."""

import functools
import math

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter, lfilter_zi

from drillenv.diagnosis.sensing import (
    ACCELEROMETER,
    FALLING,
    LEVEL,
    OVERDAMPED,
    Response,
    Sensor,
    kind_of_response,
    response,
    sensor_families,
    textbook_sensors,
)
from drillenv.diagnosis.terms import OperatingPoint
from drillenv.dynamics.effects import REGISTRY, Channels, make
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.dynamics.sensors import channels_of
from drillenv.dynamics.sensors import read as library
from drillenv.rig import PUSH, Rig, Setting
from drillenv.rocks import ROCKS

SETTINGS = (Setting(90.0, 0.45, 1.0), Setting(60.0, 0.5, 0.8))
NAMES = ("r01", "r02")
NOISE = np.array([5.0, 2.0])
RINGING = "load cell with a response of its own"
RATE = 25600.0


@functools.cache
def dense(rate, fine) -> tuple[Channels, ...]:
    """True channels of 0.3 s of two rigs that had been running, ``fine`` times as dense as ``rate``."""
    found = []
    for setting in SETTINGS:
        lead = run_hybrid(Rig(), setting, ROCKS[4], 1.0, 0.0, 0.0, None, ())
        run = run_hybrid(Rig(), setting, ROCKS[4], 0.3, fine * rate, lead.end_phase, lead.end, ())
        found.append(channels_of(run, setting, lead.end_phase))
    return tuple(found)


def pair(channels, fine=1):
    return np.stack([channels.force, channels.acceleration])[:, ::fine]


def point(i, rate=RATE, fresh=False):
    setting = SETTINGS[i]
    return OperatingPoint(NAMES[i], setting.frequency, setting.amplitude, setting.pressure, rate, fresh)


def families() -> dict[str, Sensor]:
    found = {each.name: each.terms[0] for each in sensor_families(NAMES, RATE)}
    return {name: term for name, term in found.items() if isinstance(term, Sensor)}


def textbook(rate=RATE) -> dict[str, Sensor]:
    return {each.name: each for each in textbook_sensors(NAMES, rate)}


def at_start(term):
    return np.array([each.value for each in term.unknowns])


def read(term, values, signals, where, first=0):
    where = where._replace(touching=signals[0] > 0.0)
    added = term.add(values, where, signals.shape[-1], first)
    sensed = term.observe(values, signals, where)
    return sensed if added is None else sensed + added


EVERY = [*families().values(), *textbook().values()]
GIVEN = {
    "accelerometer-resonance": {"f_a": 4000.0, "zeta_a": 0.03},
    "accelerometer-lowpass": {"f_b": 1200.0},
    "load-cell-inertia": {"m_c": 0.1},
    "load-cell-inertia in contact": {"m_t": 0.1},
    "channel-delay": {"delay_f": 7e-5, "delay_a": 1.7e-4},
    "sensor-offset": {"o_f": 20.0, "o_a": -8.0},
    "sensor-highpass": {"corner_f": 0.4, "corner_a": 1.3},
}


@pytest.mark.parametrize("term", EVERY, ids=lambda term: f"{term.name} {len(term.unknowns)}")
def test_reading_is_linear_and_none_of_what_is_padded_comes_early(term):
    rng = np.random.default_rng(3)
    values = at_start(term) + np.array([each.scale for each in term.unknowns]) * rng.normal(size=len(term.unknowns))
    one, two = rng.normal(size=(2, 3, 2, 700))
    both = term.observe(values, 2.0 * one - two, point(0))
    apart = 2.0 * term.observe(values, one, point(0)) - term.observe(values, two, point(0))
    np.testing.assert_allclose(both, apart, atol=1e-9 * np.abs(both).max())
    each = np.stack([term.observe(values, row, point(0)) for row in one])
    np.testing.assert_allclose(term.observe(values, one, point(0)), each, atol=1e-9 * np.abs(both).max())
    padded = np.concatenate([np.zeros((2, 100)), one[0]], axis=-1)
    middle, pulses = term.pulses(values, RATE)
    shows = np.abs(pulses) > 1e-3 * np.abs(pulses).max(axis=-1, keepdims=True)
    ahead = max(0, middle - int(np.flatnonzero(shows.any(axis=(0, 1))).min()))
    early = term.observe(values, padded, point(0))[:, : 100 - ahead - 10]
    assert np.abs(early).max() < 0.02 * np.abs(both).max()


@pytest.mark.parametrize("term", families().values(), ids=lambda term: f"{term.name} {len(term.unknowns)}")
def test_free_laws_change_nothing_at_zero_and_then_do(term):
    signals = pair(dense(RATE, 16)[0], 16)
    values = at_start(term)
    assert not values.any()
    np.testing.assert_array_equal(read(term, values, signals, point(0)), signals)
    for i, each in enumerate(term.unknowns):
        step = np.zeros(len(values))
        step[i] = each.scale
        changed = np.abs(np.stack([read(term, step, signals, point(k)) for k in (0, 1)]) - signals).max()
        assert 1e-3 < changed < 1e3, each.name


def test_a_library_sensor_at_its_neutral_value_changes_nothing():
    signals = pair(dense(RATE, 16)[0], 16)
    for name, values in (("accelerometer-resonance", [1e6, 0.02]), ("accelerometer-lowpass", [1e6])):
        np.testing.assert_array_equal(textbook()[name].observe(np.array(values), signals, point(0)), signals)


@pytest.mark.parametrize("name", GIVEN)
def test_textbook_terms_read_what_the_library_reads(name):
    rate, fine = 51200.0, 8
    error = effect = 0.0
    for i, true in enumerate(dense(rate, fine)):
        term = textbook(rate)[name]
        said = pair(library(true, [make(term.effect, **GIVEN[name])]), fine)
        got = read(
            term,
            np.array([GIVEN[name].get(each.name, 0.0) for each in term.unknowns]),  # without charges
            pair(true, fine),
            point(i, rate),
        )
        judged = slice(1000, -20)
        error = error + np.sum((got - said)[:, judged] ** 2, axis=-1)
        effect = effect + np.sum((said - pair(true, fine))[:, judged] ** 2, axis=-1)
    assert np.all(np.sqrt(error) <= 0.02 * np.sqrt(effect))


@pytest.mark.parametrize(("f_a", "most"), [(2500.0, 0.02), (4800.0, 0.08), (7000.0, 0.2)])
def test_rings_that_the_rate_hardly_resolves(f_a, most):
    true = dense(RATE, 16)[0]
    measured = make("accelerometer-resonance", f_a=f_a, zeta_a=0.03)
    said = pair(library(true, [measured]), 16)[1, 800:]
    got = textbook()["accelerometer-resonance"].observe(np.array([f_a, 0.03]), pair(true, 16), point(0))[1, 800:]
    assert np.std(got - said) < most * np.std(said - true.acceleration[::16][800:])


def test_a_hum_has_its_frequency_and_an_amplitude_in_each_recording():
    true = dense(RATE, 16)[1]
    measured = make("mains-hum", f_m=49.97, b_f=10.0, psi_f=0.7, b_a=4.0, psi_a=-2.0)
    said = pair(library(true, [measured]), 16)
    term = textbook()["hum near 50 Hz"]
    assert [each.name for each in term.unknowns][:3] == [
        "f_m",
        "hum near 50 Hz 1 sin force r01",
        "hum near 50 Hz 1 cos force r01",
    ]
    own = [10.0 * math.cos(0.7), 10.0 * math.sin(0.7), 4.0 * math.cos(-2.0), 4.0 * math.sin(-2.0)]
    values = np.array([49.97, *[0.0] * 4, *own])
    np.testing.assert_allclose(read(term, values, pair(true, 16), point(1)), said, atol=1e-6)
    np.testing.assert_array_equal(read(term, values, pair(true, 16), point(0)), pair(true, 16))
    assert term.add(values, point(1)._replace(name="r09"), 10) is None


def test_free_laws_and_equations_have_names_of_their_own():
    """Terms of a model are found by name, and one may have a hum by the equation with a free law on top."""
    names = [each.name for each in (*families().values(), *textbook().values())]
    assert len({*names}) == len(names)


def test_a_hum_that_swells_is_a_family_where_a_hum_is_there():
    """By up to nine tenths of it, one to two times a second, in each recording otherwise."""
    found = {each.name: each.terms[0] for each in sensor_families(NAMES, RATE, lines=(50.0,))}
    assert found.keys() - families().keys() == {"hum 50 Hz that swells"}
    time = np.arange(pair(dense(RATE, 16)[0], 16).shape[1]) / RATE
    change = []
    for f_swell, phase in ((1.0, 0.4), (2.0, 2.5)):
        swell = 1.0 + 0.9 * np.sin(2.0 * math.pi * f_swell * time + phase)
        wave = np.sin(100.0 * math.pi * time + phase)
        change.append(swell * wave * np.array([[10.0], [4.0]]))
    steady, swelling = (1.0 - explained(found[f"hum 50 Hz{more}"], change) for more in ("", " that swells"))
    assert steady > 0.03 and swelling < 0.02 * steady
    # its mean is what it is stated by
    values = np.zeros(len(found["hum 50 Hz that swells"].unknowns))
    values[[0, 12]] = 3.0, 4.0
    stated = found["hum 50 Hz that swells"].stated(values, np.ones(values.size))
    assert stated["b_f"]["value"] == pytest.approx(math.sqrt(12.5))


def test_a_free_hum_is_stated_by_its_first_order():
    """By recording, channel, order, sine and cosine: 3 and 4 N, 6 and 8 m/s^2 in one, twice that in the other."""
    term = families()["hum 50 Hz"]
    once = [3.0, 4.0, 0.1, 0.1, 6.0, 8.0, 0.1, 0.1]
    values = np.array([*once, *(2.0 * each for each in once)])
    found = term.stated(values, np.full(values.size, 0.1))
    assert found["f_m"] == {"value": 50.0, "std": 0.0, "unit": "Hz"}
    assert found["b_f"]["value"] == pytest.approx(5.0 * math.sqrt(2.5)) and found["b_f"]["unit"] == "N"
    assert found["b_a"]["value"] == pytest.approx(10.0 * math.sqrt(2.5)) and found["b_a"]["unit"] == "m/s^2"


def explained(term, change, rate=RATE, fine=16):
    """Share of the sum of squares of changes, one (2, n) for each recording, that the free law's columns explain."""
    columns, wanted = [], []
    for i, true in enumerate(dense(rate, fine)):
        signals, where = pair(true, fine), point(i, rate)
        rows = []
        for j, each in enumerate(term.unknowns):
            step = np.zeros(len(term.unknowns))
            step[j] = 1e-3 * each.scale
            rows.append((read(term, step, signals, where) - signals) * 1e3 / NOISE[:, None])
        judged = slice(round(0.02 * rate), -20)
        columns.append(np.array(rows)[:, :, judged].reshape(len(rows), -1))
        wanted.append((change[i] / NOISE[:, None])[:, judged].ravel())
    a, y = np.concatenate(columns, axis=1).T, np.concatenate(wanted)
    # the prior's standard deviation is 30 scales
    padded = np.concatenate([y, np.zeros(a.shape[1])])
    best = np.linalg.lstsq(np.vstack([a, np.eye(a.shape[1]) / 30.0]), padded, rcond=None)[0]
    return 1.0 - np.sum((y - a @ best) ** 2) / np.sum(y**2)


def change_by(name, fine=16, rate=RATE, **values):
    measured = make(name, **values)
    every = dense(rate, fine)
    return [pair(library(true, [measured]), fine) - pair(true, fine) for true in every]


@pytest.mark.parametrize(
    ("family", "name", "values"),
    [
        *[(ACCELEROMETER, "accelerometer-lowpass", {"f_b": each}) for each in (400.0, 900.0, 4000.0)],
        *[(ACCELEROMETER, "channel-delay", {"delay_a": each}) for each in (2e-5, 5e-5, 1.4e-4, 4e-4)],
        *[
            (ACCELEROMETER, "accelerometer-resonance", {"f_a": each, "zeta_a": 0.08})
            for each in (2500.0, 3700.0, 6600.0)
        ],
        ("lag", "channel-delay", {"delay_f": 2e-5}),
        ("lag", "channel-delay", {"delay_f": 1e-4}),
        ("load cell", "load-cell-inertia", {"m_c": 0.2}),
        ("load cell in contact only", "load-cell-inertia", {"m_t": 0.2}),
        ("offset", "sensor-offset", {"o_f": 20.0, "o_a": 10.0}),
        ("hum 50 Hz", "mains-hum", {"f_m": 50.05, "b_f": 10.0, "psi_f": 1.0, "b_a": 5.0, "psi_a": 2.0}),
        ("hum 60 Hz", "mains-hum", {"f_m": 60.0, "b_f": 10.0, "psi_f": 1.0, "b_a": 5.0, "psi_a": 2.0}),
    ],
)
def test_free_laws_explain_the_library_at_once(family, name, values):
    assert explained(families()[family], change_by(name, **values)) > 0.9


@pytest.mark.parametrize("rate", [8000.0, 51200.0])
def test_free_responses_do_so_at_other_rates(rate):
    term = next(each for each in sensor_families(NAMES, rate)[0].terms)
    assert isinstance(term, Sensor)
    fine = round(400e3 / rate)
    for name, values in (
        ("accelerometer-lowpass", {"f_b": 1000.0}),
        ("channel-delay", {"delay_a": 2e-4}),
        ("accelerometer-resonance", {"f_a": 2600.0, "zeta_a": 0.08}),
    ):
        assert explained(term, change_by(name, fine, rate, **values), rate, fine) > 0.9


@pytest.mark.parametrize("f_a", [2500.0, 3400.0, 5200.0, 7000.0])
@pytest.mark.parametrize(("zeta_a", "least"), [(0.01, 0.3), (0.03, 0.7), (0.05, 0.85)])
def test_how_much_of_a_ring_a_free_response_explains(f_a, zeta_a, least):
    change = change_by("accelerometer-resonance", f_a=f_a, zeta_a=zeta_a)
    assert explained(families()[ACCELEROMETER], change) > least


@pytest.mark.parametrize("corner", [0.3, 0.7, 1.5])
@pytest.mark.parametrize("channel", [0, 1])
def test_ac_coupling_is_explained(channel, corner):
    change = []
    a = math.exp(-2.0 * math.pi * corner / RATE)
    for i, true in enumerate(dense(RATE, 16)):
        x = pair(true, 16)[channel]
        mean = (PUSH * SETTINGS[i].pressure, 0.0)[channel]
        slow = lfilter([1.0 - a], [1.0, -a], x, zi=lfilter_zi([1.0 - a], [1.0, -a]) * mean)[0]
        both = np.zeros((2, x.size))
        both[channel] = -slow
        change.append(both)
    assert explained(families()["high-pass"], change) > 0.97


def test_a_high_pass_had_settled_where_a_rig_was_running():
    term = families()["high-pass"]
    values = np.zeros(len(term.unknowns))
    values[1] = 1.0
    steady = np.zeros((2, 5000))
    steady[0, 300:] = PUSH * SETTINGS[0].pressure
    added = term.add(values, point(0), 5000, 300)
    assert added is not None
    left = term.observe(values, steady, point(0)) + added
    np.testing.assert_allclose(left, 0.0, atol=0.01 * steady.max())
    np.testing.assert_array_equal(term.add(values, point(0, fresh=True), 5000, 300), 0.0)


def test_the_charge_of_a_coupling_fades_with_its_corner():
    """Of each recording its own, 0.5 Hz on the force and 1 Hz on the acceleration; one that is new begins without."""
    term = families()["high-pass"]
    values = np.zeros(len(term.unknowns))
    values[:6] = [0.0, 0.5, 0.0, 0.0, 1.0, 0.0]
    values[6:8] = [20.0, -3.0]
    added = term.add(values, point(0, fresh=True), 5000, 300)
    seconds = np.arange(4700) / RATE
    assert np.all(added[:, :300] == 0.0)
    np.testing.assert_allclose(added[0, 300:], 20.0 * np.exp(-math.pi * seconds))
    np.testing.assert_allclose(added[1, 300:], -3.0 * np.exp(-2.0 * math.pi * seconds))
    alone, own = term.of_recording(NAMES[0], values)
    assert own.tolist() == [*values[:6], 20.0, -3.0] and alone.common == 6
    assert term.of_recording("r99", values)[1][6:].tolist() == [0.0, 0.0]
    assert term.corners(values).tolist() == [0.5, 1.0]
    # the library's begins with the same corners and charges
    equation = textbook()["sensor-highpass"]
    nearest = equation.begun_at(term, values, [point(0, fresh=True), point(1, fresh=True)])
    assert nearest is not None and nearest.tolist() == [0.5, 1.0, 20.0, -3.0, 0.0, 0.0]
    np.testing.assert_allclose(equation.add(nearest, point(0, fresh=True), 5000, 300), added)
    alone, own = equation.of_recording(NAMES[0], nearest)
    assert own.tolist() == [0.5, 1.0, 20.0, -3.0] and alone.common == 2
    assert equation.stated(nearest, np.ones(6)).keys() == {"corner_f", "corner_a"}


@pytest.mark.parametrize("name", ["sensor-highpass", "own offsets"])
def test_equations_of_a_coupling_begin_with_the_force_that_the_free_law_reads(name):
    """Of a running rig whose law lets half of the static force pass, most of it, or more."""
    free, equation, first = families()["high-pass"], textbook()[name], 300
    steady = np.zeros((2, 5000))
    steady[0, first:] = PUSH * SETTINGS[1].pressure
    for gains in ([0.0, 0.5, 0.0], [0.4, -0.12, 0.0], [0.1, -0.3, 0.0]):
        values = np.zeros(len(free.unknowns))
        values[:3], values[8] = gains, 7.0
        nearest = equation.begun_at(free, values, [point(0), point(1)])
        assert nearest is not None
        if name == "sensor-highpass":
            assert nearest[0] == free.corners(values)[0]
        pairs = (free, values), (equation, nearest)
        wanted, found = (read(term, own, steady, point(1), first) for term, own in pairs)
        # but for what low-passes take in during the first sample
        np.testing.assert_allclose(found[0, first], wanted[0, first], atol=1e-4 * steady.max())


def test_each_recording_has_a_delay_of_its_own():
    """By the library's delay in one recording and none in the other; a third has their mean."""
    term = families()["lag of each recording"]
    true = dense(RATE, 16)[1]
    said = pair(library(true, [make("channel-delay", delay_a=2e-4)]), 16)[:, 800:]
    values = np.array([0.0, 2e-4])
    got = read(term, values, pair(true, 16), point(1))[:, 800:]
    assert np.std(got[1] - said[1]) < 0.02 * np.std(said[1] - pair(true, 16)[1, 800:])
    np.testing.assert_array_equal(read(term, values, pair(true, 16), point(0)), pair(true, 16))
    alone, own = term.of_recording("r99", values)
    assert own.tolist() == [1e-4] and alone.common == 0


def test_responses_are_those_of_the_equations():
    f = np.array([50.0, 400.0, 1500.0, 3800.0, 6000.0])
    ring = response(textbook()["accelerometer-resonance"], np.array([4000.0, 0.05]), f)
    ratio = f / 4000.0
    np.testing.assert_allclose(ring, 1.0 / (1.0 - ratio**2 + 0.1j * ratio), rtol=2e-3)
    slow = response(textbook()["accelerometer-lowpass"], np.array([900.0]), f)
    np.testing.assert_allclose(slow, 1.0 / (1.0 + 1j * f / 900.0), rtol=5e-3)
    late = response(textbook()["channel-delay"], np.array([-3e-5, 2.2e-4]), f)
    np.testing.assert_allclose(late, np.exp(-2j * math.pi * f * 2.2e-4), atol=1e-3)
    early = response(textbook()["channel-delay"], np.array([-3e-5, 2.2e-4]), f, 0, 0)
    np.testing.assert_allclose(early, np.exp(2j * math.pi * f * 3e-5), atol=1e-3)
    mass = response(textbook()["load-cell-inertia"], np.array([0.2]), f, 1, 0)
    np.testing.assert_allclose(mass, 0.2)
    term = families()[ACCELEROMETER]
    values = np.random.default_rng(1).normal(0.0, 0.1, len(term.unknowns))
    np.testing.assert_allclose(response(term, values, np.array([1e-3])), 1.0, atol=1e-3)
    slowly = response(families()["high-pass"], np.array([0.0, 1.0, 0.0] * 2), np.array([1.0, 5.0]), 0, 0, 2e3, 8.0)
    np.testing.assert_allclose(slowly, 1.0 - 1.0 / (1.0 + 1j * np.array([1.0, 5.0])), rtol=0.01)


def test_parameters_are_those_of_the_library():
    for term in textbook().values():
        effect = term.effect
        symbols = {each.symbol: each for each in REGISTRY[effect].parameters}
        assert term.stage == REGISTRY[effect].stage
        for each in term.unknowns:
            if each.name in symbols:
                high = OVERDAMPED if each.name == "zeta_a" else symbols[each.name].high
                assert (each.unit, each.high) == (symbols[each.name].unit, high)
                assert each.low == (-each.high if effect == "channel-delay" else symbols[each.name].low)
        assert all(set(start) == {each.name for each in term.unknowns} for start in term.starts)
    assert {each.group for each in sensor_families(NAMES, RATE)} == {
        ACCELEROMETER, "lag", "load cell", "offset", "hum", "high-pass", "creep", "crosstalk",
    }  # fmt: skip


@pytest.mark.parametrize("corner", [5000.0, 7000.0, 9000.0])
def test_a_load_cell_that_rings_is_explained(corner):
    """A mass of 0.1 kg on a cell whose resonance has a damping ratio of 0.05."""
    change, rate = [], 16 * RATE
    turn = 2.0 * math.pi * corner
    given = ([turn**2], [1.0, 0.1 * turn, turn**2])
    over, under, _ = cont2discrete(given, 1.0 / rate, method="bilinear")
    for true in dense(RATE, 16):
        carried = true.force + 0.1 * true.acceleration
        settled = lfilter_zi(over[0], under) * carried[0]
        both = np.zeros((2, carried[::16].size))
        both[0] = (lfilter(over[0], under, carried, zi=settled)[0] - true.force)[::16]
        change.append(both)
    rigid, ringing = (explained(families()[name], change) for name in ("load cell", RINGING))
    assert 1.0 - ringing < 0.4 * (1.0 - rigid), (ringing, rigid)


@pytest.mark.parametrize("tau", [2e-3, 8e-3, 15e-3])
def test_a_load_cell_that_creeps_is_explained(tau):
    """A twentieth of its reading comes late, by a time constant that is none of the free law's."""
    change = []
    for true in dense(RATE, 16):
        late = lfilter([-math.expm1(-1.0 / (16 * RATE * tau))], [1.0, -math.exp(-1.0 / (16 * RATE * tau))],
                       true.force - true.force.mean()) + true.force.mean()  # fmt: skip
        both = np.zeros((2, true.force[::16].size))
        both[0] = 0.05 * (late - true.force)[::16]
        change.append(both)
    found = families()
    assert explained(found["creep"], change) > 0.99
    # no response above some hundreds of hertz, as of a cell that rings, is as slow
    assert 1.0 - explained(found["creep"], change) < 0.2 * (1.0 - explained(found[RINGING], change))


def test_a_response_that_ripples_about_one_is_level():
    """An echo of a tenth after 4 ms: its gain is 0.9 to 1.1, once every 250 Hz; with a low-pass behind it falls."""

    def echo(values, force, acceleration, rate):
        late = round(0.004 * rate)
        both = acceleration + 0.1 * np.pad(acceleration, [(0, 0)] * (acceleration.ndim - 1) + [(late, 0)])[..., :-late]
        share = -math.expm1(-2.0 * math.pi * values[0] / rate)
        return force, lfilter([share], [1.0, share - 1.0], both, axis=-1)

    term = Response("echo", (), law=echo)
    none, corner = np.array([1e6]), np.array([6000.0])
    assert np.ptp(np.abs(response(term, none, np.linspace(100.0, 4000.0, 400)))) > 0.15
    assert kind_of_response(term, none, 25600.0) == LEVEL
    assert kind_of_response(term, corner, 25600.0) == FALLING


@pytest.mark.parametrize("name", [ACCELEROMETER, RINGING])
def test_derivatives_of_a_free_response_are_those_of_what_it_reads(name):
    """It is linear: they are the same about any values, and those of differences of any size."""
    term, signals = families()[name], pair(dense(RATE, 1)[0])
    values = 0.3 * np.random.default_rng(4).normal(size=len(term.unknowns)) * term.scales
    by = term.derivatives(signals, point(0))
    for i in range(len(values)):
        more = values + np.eye(len(values))[i] * term.scales[i]
        moved = read(term, more, signals, point(0)) - read(term, values, signals, point(0))
        np.testing.assert_allclose(by[i] * term.scales[i], moved, atol=1e-9 * np.abs(signals).max())
