"""Runs over windows: signals against the reference engine's, derivatives against differences of runs."""

import itertools
import math

import numpy as np
import pytest

from drillenv.dynamics.constitutive.tables import DEGREE
from drillenv.dynamics.effects import make
from drillenv.dynamics.hybrid import vector_field as V
from drillenv.dynamics.hybrid.model import Start, fresh_motion, model_for
from drillenv.dynamics.hybrid.run import run_hybrid
from drillenv.dynamics.hybrid.runge_kutta import make_scratch
from drillenv.dynamics.hybrid.sensitivity import (
    COUNTED,
    LAW,
    ON_INDENTER,
    ON_SHAKER,
    ON_STIFFNESS,
    PHASE,
    STATE,
    Columns,
    by_state,
    make_variation,
)
from drillenv.dynamics.hybrid.shooting import Shot, Windows, shoot
from drillenv.rig import Rig, Setting
from drillenv.rocks import ROCKS

SETTING, ROCK, RATE, PHASE_AT_0 = Setting(60.0, 0.45, 1.0), ROCKS[4], 48e3, 0.3
STARTS = np.array([480, 1280, 2080, 3200])
EFFECTS = {
    "none": (),
    "contact": (
        make("contact-power-law", n=1.3),
        make("contact-rate", chi=0.6),
        make("rock-compaction", soft=0.3, soft_n=20.0),
    ),
    "toe": (make("contact-toe", h=2e-5, r=0.1, e=0.5),),
    "tangents": (make("tabulated-unloading", x=[0.0, 300.0, 800.0, 2000.0], y=[0.5, 0.9, 1.0, 1.1]),),
    "mount and air": (
        make("rock-mount-compliance", s_r=2e-8, m_r=40.0, zeta_r=0.1),
        make("air-spring", k_a=5e4, tau=0.2),
    ),
    "grip": (make("guide-friction", fc1=40.0, vs1=0.0), make("stiffness-hardening", k3=5e9)),
    "waves": (
        make("external-vibration", F1=100.0, F2=3.0, f=33.0, psi=0.4),
        make("rock-rotation", eps=0.15, Omega=10.0, psi=0.2),
    ),
    "drive": (
        make("drive-harmonics", h2=0.1, phi2=0.3, h3=0.05, phi3=1.0),
        make("force-limit", F_max=200.0, F_s=300.0),
        make("drive-droop", s=0.005),
    ),
}


def no_columns():
    none = np.zeros(0, dtype=np.int64)
    return Columns(none, none, none, np.zeros(0), np.zeros((0, DEGREE + 1)))


def shot_of(windows, columns):
    n, count, last = len(windows.starts) - 1, columns.kind.size, int(windows.starts[-1])
    return Shot(
        np.zeros((V.OWN, last // windows.stride)),
        np.zeros((2, last)),
        np.zeros((count, 2, last)),
        np.zeros((n, V.OWN)),
        np.zeros((n, count, V.OWN)),
    )


def varied_by(columns, windows):
    """(windows, columns, OWN) derivatives of their own states, which stand in ``which``."""
    varied = np.zeros((windows, columns.kind.size, V.OWN))
    for c, (kind, which) in enumerate(zip(columns.kind, columns.which, strict=True)):
        varied[:, c, which] = kind == STATE
    return varied


def run(model, begin, columns, rtol, phase=PHASE_AT_0, impacts=7.0):
    windows = Windows(STARTS, begin, varied_by(columns, len(begin)), RATE, phase, impacts, False, 4, 0.0)
    shot = shot_of(windows, columns)
    d = fresh_motion(model).d
    status, _made = shoot(
        model, d, rtol, windows, columns, shot, make_variation(model, columns.kind.size), make_scratch(model)
    )
    assert status == 0
    return shot


def begins(effects):
    """(windows, OWN) states that a running rig has at the starts, pushed off the rock where it is in contact."""
    run_ = run_hybrid(Rig(), SETTING, ROCK, STARTS[-1] / RATE, RATE, phase=PHASE_AT_0, effects=effects)
    begin = np.zeros((len(STARTS) - 1, V.OWN))
    begin[:, V.Y] = (run_.x1 - run_.x2)[STARTS[:-1]]
    begin[:, V.V1], begin[:, V.V2] = run_.v1[STARTS[:-1]], run_.v2[STARTS[:-1]]
    begin[:, V.W] = -3e-5
    begin[:, V.W] *= np.array([1.0, 2.0, 0.5])
    return begin


@pytest.mark.parametrize("name", [n for n in EFFECTS if n not in ("mount and air", "contact", "waves")])
def test_signals_are_those_of_the_reference(name):
    """Of each window by a run of its own, to within the relative error of the steps."""
    effects = EFFECTS[name]
    model, begin = model_for(Rig(), SETTING, ROCK, effects), begins(effects)
    shot = run(model, begin, no_columns(), 1e-8, impacts=0.0)
    for window, (first, last) in enumerate(itertools.pairwise(STARTS)):
        start = Start(*(float(begin[window, i]) for i in (V.Y, V.V1, V.V2, V.W)), 0)
        theta = PHASE_AT_0 + 2.0 * math.pi * SETTING.frequency * first / RATE
        ours = run_hybrid(
            Rig(), SETTING, ROCK, (last - first - 1) / RATE, RATE, phase=theta, start=start, effects=effects
        )
        force, acceleration = shot.said[:, first:last]
        assert np.max(np.abs(force - ours.force)) < 2e-6 * np.max(ours.force)
        assert np.max(np.abs(acceleration - ours.acceleration)) < 5e-6 * np.max(np.abs(ours.acceleration))
        path = shot.path[:, first // 4 : -(-last // 4)]
        assert np.max(np.abs(path[V.V2] - ours.v2[::4])) < 1e-7
        assert np.max(np.abs(path[V.Y] - (ours.x1 - ours.x2)[::4])) < 1e-10


def rigs(name):
    """Pairs of a column, and the two runs' models, states, phases and impacts, that differ by a step of it."""
    effects = EFFECTS[name]
    begin = begins(effects)
    model = model_for(Rig(), SETTING, ROCK, effects)
    found = []
    plain = {"phase": PHASE_AT_0, "impacts": 7.0}
    for state in range(V.OWN if name == "mount and air" else 4):
        step = (1e-9, 1e-6, 1e-6, 1e-10, 1e-10, 1e-6, 1e-4)[state]
        pair = []
        for way in (1.0, -1.0):
            moved = begin.copy()
            moved[:, state] += way * step
            pair.append((model, moved, plain))
        found.append((f"state {state}", STATE, state, 0.0, step, pair))
    scalars = [V.M1, V.M2, V.K, V.C, V.F_A, V.F_B, V.KL, V.KU]
    scalars += [V.MOUNT_GAIN, V.MOUNT_SQUARE, V.MOUNT_DAMPING, V.AIR_STIFFNESS, V.AIR_RATE] * (name == "mount and air")
    scalars += [V.GRIP1] * (name == "grip") + [V.DRIVE_LAG] * (name == "drive")
    scalars += [V.ROTATION_SHARE, V.ROTATION_PHASE, V.ROTATION_RATE] * (name == "waves")
    for scalar in scalars:
        step = 1e-5 * abs(model.s[scalar])
        pair = []
        for way in (1.0, -1.0):
            other = model_for(Rig(), SETTING, ROCK, effects)
            other.s[scalar] += way * step
            pair.append((other, begin, plain))
        found.append((f"scalar {scalar}", scalar, 0, 0.0, step, pair))
    found.append(
        ("phase", PHASE, 0, 0.0, 1e-5, [(model, begin, dict(plain, phase=PHASE_AT_0 + w)) for w in (1e-5, -1e-5)])
    )
    if name == "contact":
        found.append(
            ("count", COUNTED, 0, 0.0, 1e-3, [(model, begin, dict(plain, impacts=7.0 + w)) for w in (1e-3, -1e-3)])
        )
    for law in range(len(model.laws)):
        pair = []
        for way in (1.0, -1.0):
            other = model_for(Rig(), SETTING, ROCK, effects)
            first, count = int(model.laws[law, V.FIRST]), int(model.laws[law, V.PIECES])
            pieces = other.flat[V.PIECES_AT :][: (first + count) * V.PIECE_COLUMNS].reshape(-1, V.PIECE_COLUMNS)
            pieces[first:, V.COEFFICIENTS :] *= 1.0 + way * 1e-5
            pair.append((other, begin, plain))
        found.append((f"law {law}", LAW, law, 0.0, 1e-5, pair))
    if name == "waves":
        for kind, at, rate, phase in (
            (ON_SHAKER, V.SHAKER_VIBRATION, V.VIBRATION_RATE, V.VIBRATION_PHASE),
            (ON_INDENTER, V.INDENTER_VIBRATION, V.VIBRATION_RATE, V.VIBRATION_PHASE),
            (ON_STIFFNESS, V.ROTATION_SHARE, V.ROTATION_RATE, V.ROTATION_PHASE),
        ):
            for code in (0, 1):
                pair = []
                for way in (1.0, -1.0):
                    other = model_for(Rig(), SETTING, ROCK, effects)
                    cosine = kind == ON_STIFFNESS
                    size, turned = other.s[at], other.s[phase] + (0.5 * math.pi if cosine else 0.0)
                    sine, cosine_ = size * math.cos(turned), size * math.sin(turned)
                    step = 1e-5 * size
                    sine, cosine_ = (
                        sine + (way * step if code == 0 else 0.0),
                        cosine_ + (way * step if code == 1 else 0.0),
                    )
                    other.s[at], turned = math.hypot(sine, cosine_), math.atan2(cosine_, sine)
                    other.s[phase] = turned - (0.5 * math.pi if cosine else 0.0)
                    if kind != ON_STIFFNESS:
                        # the other mass keeps its own
                        lead = model.s[phase] - other.s[phase]
                        if kind == ON_SHAKER:
                            other.s[V.VIBRATION_LEAD] = lead
                        else:
                            other.s[V.VIBRATION_LEAD], other.s[phase] = -lead, model.s[phase]
                    pair.append((other, begin, plain))
                found.append((f"wave {kind} {code}", kind, code, model.s[rate], 1e-5 * model.s[at], pair))
    return model, begin, found


@pytest.mark.parametrize("name", EFFECTS)
def test_derivatives_are_those_of_differences(name):
    """Of both signals, and of the states at the windows' ends, by every kind of column at once."""
    model, begin, found = rigs(name)
    pieces, first, rows = [np.zeros((0, DEGREE + 1))], [], 0
    for _what, kind, which, *_rest in found:
        first.append(rows)
        if kind == LAW:
            at, count = int(model.laws[which, V.FIRST]), int(model.laws[which, V.PIECES])
            table = model.flat[V.PIECES_AT :][: (at + count) * V.PIECE_COLUMNS].reshape(-1, V.PIECE_COLUMNS)
            pieces.append(table[at:, V.COEFFICIENTS :].copy())
            rows += count
    columns = Columns(
        np.array([each[1] for each in found], dtype=np.int64),
        np.array([each[2] for each in found], dtype=np.int64),
        np.array(first, dtype=np.int64),
        np.array([each[3] for each in found]),
        np.concatenate(pieces),
    )
    shot = run(model, begin, columns, 1e-12)
    inside = slice(int(STARTS[0]), int(STARTS[-1]))
    for c, (what, _kind, _which, _turn, step, pair) in enumerate(found):
        ahead, behind = (run(other, state, no_columns(), 1e-12, **more) for other, state, more in pair)
        for i in range(2):
            ours, theirs = shot.by_column[c, i, inside], (ahead.said - behind.said)[i, inside] / (2.0 * step)
            size = np.sqrt(np.mean(theirs**2))
            off = np.abs(ours - theirs)
            # beside a landing a difference of runs holds one that has landed and one that has not
            assert np.sort(off)[int(0.98 * off.size)] < 4e-3 * size + 1e-12, (what, i)
        ours, theirs = shot.ends_by_column[:, c], (ahead.ends - behind.ends) / (2.0 * step)
        size = np.max(np.abs(theirs), axis=0)
        assert np.all(np.abs(ours - theirs) <= 1e-3 * size + 1e-12), what


def from_rest(setting, rock, mount, samples):
    """21 periods of the paper's rig from rest, of so many samples each, on a mount (kg, m/N, damping ratio).

    Returns the status, the impacts and the rock's force.
    """
    mass, compliance, ratio = mount
    effects = (make("rock-mount-compliance", m_r=mass, s_r=compliance, zeta_r=ratio),)
    model = model_for(Rig(), setting, rock, effects)
    begin = np.zeros((1, V.OWN))
    begin[0, V.Y] = model.s[V.F_B] / model.s[V.K]
    columns, rate = no_columns(), samples * setting.frequency
    windows = Windows(np.array([0, 21 * samples]), begin, varied_by(columns, 1), rate, 0.0, 0.0, False, 1, 0.0)
    shot = shot_of(windows, columns)
    motion = fresh_motion(model)
    found = shoot(model, motion.d, 1e-6, windows, columns, shot, make_variation(model, 0), make_scratch(model))
    return *found, shot.said[0], effects


@pytest.mark.parametrize("samples", [191, 195, 203])
def test_a_flight_shorter_than_a_step_is_followed(samples):
    """The departure once passed for the landing: the contact chattered, and the rest of the step was lost."""
    setting, mount = Setting(58.69982935, 0.50118732, 1.37662741), (40.0, 2e-8, 0.08)
    status, impacts, force, effects = from_rest(setting, ROCK, mount, samples)
    assert status == 0
    rate = samples * setting.frequency
    true = run_hybrid(Rig(), setting, ROCK, 21.0 / setting.frequency, rate, effects=effects, rtol=1e-9)
    assert impacts == true.impacts.time.size
    assert np.mean(force) == pytest.approx(np.mean(true.force[:-1]), rel=1e-5)


def test_no_random_run_sticks():
    rng = np.random.default_rng(1)
    for _ in range(400):
        setting = Setting(rng.uniform(50.0, 120.0), rng.uniform(0.3, 0.6), rng.uniform(0.6, 1.8))
        mount = rng.uniform(10.0, 100.0), rng.uniform(5e-9, 5e-8), rng.uniform(0.02, 0.2)
        rock = ROCKS[int(rng.integers(1, 7))]
        assert from_rest(setting, rock, mount, 200)[0] == 0


def test_a_contact_that_is_left_at_next_to_no_speed_says_little():
    """A window that begins pressed, whose indenter leaves the rock just as it stops: met in a campaign."""
    model = model_for(Rig(), SETTING, ROCK, ())
    model.s[: V.OMEGA + 1] = [
        265.364698, 2.98878161, 75301.497, 2545.65039, 452.349791, 157.641541, 12074311.8, 13068640.8, 500.771053,
    ]  # fmt: skip
    begin = np.zeros((1, V.OWN))
    begin[0, :4] = 2.10750419e-03, -1.07984894e-04, -6.36024386e-03, 4.19875301e-07
    columns = by_state(4)
    windows = Windows(np.array([0, 656]), begin, np.eye(4, V.OWN)[None], 51200.0, -0.0612026489, 0.0, False, 1, 2e-3)
    shot = shot_of(windows, columns)
    status, _impacts = shoot(
        model, fresh_motion(model).d, 1e-6, windows, columns, shot, make_variation(model, 4), make_scratch(model)
    )
    assert status == 0
    # a force by a depth is a stiffness, and little more after one blow
    assert np.abs(shot.by_column).max() < 1e3 * model.s[V.KL]
    assert np.abs(shot.ends_by_column).max() < 1e6
