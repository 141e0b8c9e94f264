"""Runs over windows: signals against the reference engine's, derivatives against differences of runs."""

import itertools
import math
from typing import NamedTuple

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
    DRILLED_BEFORE,
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
from drillenv.dynamics.hybrid.shooting import UNCHAINED, Shot, Windows, shoot
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
    "compaction over the depth": (make("rock-compaction", soft=0.4, soft_l=1e-4),),
    "toe": (make("contact-toe", h=2e-5, r=0.1, e=0.5),),
    "tangents": (make("tabulated-unloading", x=[0.0, 300.0, 800.0, 2000.0], y=[0.5, 0.9, 1.0, 1.1]),),
    "mount and air": (
        make("rock-mount-compliance", s_r=2e-8, m_r=40.0, zeta_r=0.1),
        make("air-spring", k_a=5e4, tau=0.2),
    ),
    "bed": (
        make("rock-mount-compliance", s_r=2e-8, m_r=25.0, zeta_r=0.1, m_b=90.0, s_b=1.5e-8, zeta_b=0.07),
        make("contact-rate", c_d=300.0, p_d=0.25),
    ),
    "gas": (make("air-spring", g_a=300.0, tau=0.2),),
    "grip": (make("guide-friction", fc1=40.0, vs1=0.0), make("stiffness-hardening", k3=5e9)),
    "bristles": (
        make("guide-friction", fc1=40.0, ds1=1e-6),
        make("indenter-friction", fc2=40.0, ds2=1e-5, sd2=150.0, rs2=0.4),
    ),
    "waves": (
        make("external-vibration", F1=100.0, F2=3.0, f=33.0, psi=0.4),
        make("rock-rotation", eps=0.15, Omega=10.0, psi=0.2),
    ),
    "drive": (
        make("drive-harmonics", h2=0.1, phi2=0.3, h3=0.05, phi3=1.0),
        make("force-limit", F_max=200.0, F_s=300.0),
        make("drive-droop", s=0.005),
    ),
    "ramps and sine": (make("force-limit", F_max=300.0, S_max=1.3e5, tau_f=1e-4), make("drive-droop", s=0.002)),
    "ramps alone": (
        make("force-limit", S_max=7e4),
        make("drive-harmonics", h2=0.1, phi2=0.3, h3=0.05, phi3=1.0),
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


def run(model, begin, columns, rtol, phase=PHASE_AT_0, impacts=7.0, drilled=6e-5, chained=UNCHAINED):
    varied = varied_by(columns, len(begin))
    windows = Windows(STARTS, begin.copy(), varied, RATE, phase, impacts, drilled, chained, 4, 0.0)
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


NOT_OF_THE_PLAIN_STATES = ("mount and air", "bed", "contact", "waves", "bristles", "ramps and sine", "ramps alone",
                           "compaction over the depth")  # fmt: skip


@pytest.mark.parametrize("name", [name for name in EFFECTS if name not in NOT_OF_THE_PLAIN_STATES])
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
        force, acceleration = shot.signals[:, first:last]
        assert np.max(np.abs(force - ours.force)) < 2e-6 * np.max(ours.force)
        assert np.max(np.abs(acceleration - ours.acceleration)) < 5e-6 * np.max(np.abs(ours.acceleration))
        path = shot.path[:, first // 4 : -(-last // 4)]
        assert np.max(np.abs(path[V.V2] - ours.v2[::4])) < 1e-7
        assert np.max(np.abs(path[V.Y] - (ours.x1 - ours.x2)[::4])) < 1e-10


class Varied(NamedTuple):
    """A column, and two runs that differ by ``step`` of it either way: model, states, and what else."""

    what: str
    kind: int
    which: int
    turn: float
    step: float
    pair: list[tuple]


PLAIN = {"phase": PHASE_AT_0, "impacts": 7.0, "drilled": 6e-5}
WAYS = (1.0, -1.0)


def by_states(effects, model, begin):
    found = []
    mount = range(V.U, V.Q) if model.s[V.MOUNT_SQUARE] else range(0)
    air = range(V.Q, V.BENT1) if model.s[V.AIR_RATE] else range(0)
    bristles = range(V.BENT1, V.BED) if model.s[V.BRISTLES1] else range(0)
    bed = range(V.BED, V.OWN) if model.s[V.BED_SQUARE] else range(0)
    for state in (*range(4), *mount, *air, *bristles, *bed):
        step = (1e-9, 1e-6, 1e-6, 1e-9, 1e-10, 1e-6, 1e-4, 1e-4, 1e-4, 1e-10, 1e-6)[state]
        pair = []
        for way in WAYS:
            moved = begin.copy()
            moved[:, state] += way * step
            pair.append((model, moved, PLAIN))
        found.append(Varied(f"state {state}", STATE, state, 0.0, step, pair))
    return found


def by_scalars(effects, model, begin):
    """By every scalar that a column may be by, where it is there, and by the phase and the impacts before."""
    scalars = [V.M1, V.M2, V.K, V.C, V.F_A, V.F_B, V.KL, V.KU, V.MOUNT_GAIN, V.MOUNT_SQUARE, V.MOUNT_DAMPING]
    scalars += [V.AIR_STIFFNESS, V.AIR_PER_LENGTH, V.AIR_RATE, V.GRIP1, V.DRIVE_LAG]
    scalars += [V.ROTATION_SHARE, V.ROTATION_PHASE, V.ROTATION_RATE, V.BRISTLES1, V.BRISTLES2, V.SLIDING1, V.SLIDING2]
    scalars += [V.BED_SHARE, V.BED_SQUARE, V.BED_DAMPING, V.CONTACT_DAMPING, V.CONTACT_DAMPING_POWER]
    scalars += [V.SLEW_RATE, V.SLEW_SHARE, V.DRIVE_DELAY, V.COMPACTION_LENGTH]
    found = []
    for scalar in scalars:
        step = (1e-3 if scalar == V.AIR_RATE else 1e-5) * abs(model.s[scalar])
        pair = []
        for way in WAYS:
            other = model_for(Rig(), SETTING, ROCK, effects)
            other.s[scalar] += way * step
            pair.append((other, begin, PLAIN))
        if step > 0.0:
            found.append(Varied(f"scalar {scalar}", scalar, 0, 0.0, step, pair))
    for what, kind, key, step in (
        ("phase", PHASE, "phase", 1e-5),
        ("count", COUNTED, "impacts", 1e-3),
        ("drilled", DRILLED_BEFORE, "drilled", 1e-9),
    ):
        pair = [(model, begin, {**PLAIN, key: PLAIN[key] + way * step}) for way in WAYS]
        found.append(Varied(what, kind, 0, 0.0, step, pair))
    return found


def by_laws(effects, model, begin):
    """By the size of each law."""
    found = []
    for law in range(len(model.laws)):
        pair = []
        for way in WAYS:
            other = model_for(Rig(), SETTING, ROCK, effects)
            pieces_of(other, law)[...] *= 1.0 + way * 1e-5
            pair.append((other, begin, PLAIN))
        found.append(Varied(f"law {law}", LAW, law, 0.0, 1e-5, pair))
    return found


def pieces_of(model, law):
    """(pieces, DEGREE + 1) the coefficients of a law, not a copy."""
    first, count = int(model.laws[law, V.FIRST]), int(model.laws[law, V.PIECES])
    rows = model.flat[V.PIECES_AT :][: (first + count) * V.PIECE_COLUMNS].reshape(-1, V.PIECE_COLUMNS)
    return rows[first:, V.COEFFICIENTS :]


def by_waves(effects, model, begin):
    """By sine and cosine of what goes on at a frequency of its own."""
    found = []
    for kind, at, rate, phase in (
        (ON_SHAKER, V.SHAKER_VIBRATION, V.VIBRATION_RATE, V.VIBRATION_PHASE),
        (ON_INDENTER, V.INDENTER_VIBRATION, V.VIBRATION_RATE, V.VIBRATION_PHASE),
        (ON_STIFFNESS, V.ROTATION_SHARE, V.ROTATION_RATE, V.ROTATION_PHASE),
    ):
        size, ahead = model.s[at], 0.5 * math.pi if kind == ON_STIFFNESS else 0.0
        for code in range(2 if size else 0):
            pair = []
            for way in WAYS:
                other = model_for(Rig(), SETTING, ROCK, effects)
                wave = size * np.exp(1j * (model.s[phase] + ahead)) + way * 1e-5 * size * (1.0, 1j)[code]
                other.s[at], turned = abs(wave), np.angle(wave) - ahead
                if kind == ON_INDENTER:
                    other.s[V.VIBRATION_LEAD] = turned - model.s[phase]
                else:
                    other.s[phase] = turned
                if kind == ON_SHAKER:
                    # the indenter keeps its own
                    other.s[V.VIBRATION_LEAD] = model.s[phase] - turned
                pair.append((other, begin, PLAIN))
            found.append(Varied(f"wave {kind} {code}", kind, code, model.s[rate], 1e-5 * size, pair))
    return found


CHAINED = np.isin(np.arange(V.OWN), (V.V2, V.W), invert=True)
"""All states but the indenter's."""


@pytest.mark.parametrize(
    ("name", "chained"),
    [*((name, UNCHAINED) for name in EFFECTS), *((name, CHAINED) for name in ("mount and air", "bed", "bristles"))],
)
def test_derivatives_are_those_of_differences(name, chained):
    """Of both signals, and of the states at the windows' ends, by every kind of column at once."""
    effects, begin = EFFECTS[name], begins(EFFECTS[name])
    model = model_for(Rig(), SETTING, ROCK, effects)
    found = [each for by in (by_states, by_scalars, by_laws, by_waves) for each in by(effects, model, begin)]
    pieces = [pieces_of(model, law) for law in range(len(model.laws))]
    rows = np.cumsum([0, *map(len, pieces)])
    columns = Columns(
        np.array([each.kind for each in found], dtype=np.int64),
        np.array([each.which for each in found], dtype=np.int64),
        np.array([rows[each.which] if each.kind == LAW else 0 for each in found], dtype=np.int64),
        np.array([each.turn for each in found]),
        np.concatenate([np.zeros((0, DEGREE + 1)), *pieces]),
    )
    # the steps of a run adapt: a difference of two has their error in it
    shot = run(model, begin, columns, 1e-12, chained=chained)
    for c, (what, kind, _which, _turn, step, pair) in enumerate(found):
        # what was drilled in windows before is not followed by their states
        windows = 1 if model.s[V.COMPACTION_LENGTH] > 0.0 and kind == STATE else len(begin)
        inside = slice(int(STARTS[0]), int(STARTS[windows]))
        ahead, behind = (run(other, state, no_columns(), 1e-12, chained=chained, **more) for other, state, more in pair)
        for i in range(2):
            ours, theirs = shot.by_column[c, i, inside], (ahead.signals - behind.signals)[i, inside] / (2.0 * step)
            off = np.sort(np.abs(ours - theirs))
            # beside a landing a difference of runs holds one that has landed and one that has not
            assert off[int(0.98 * off.size)] < 1e-3 * np.sqrt(np.mean(theirs**2)) + 1e-12, (what, i)
        ours, theirs = shot.ends_by_column[:windows, c], ((ahead.ends - behind.ends) / (2.0 * step))[:windows]
        assert np.all(np.abs(ours - theirs) <= 1e-3 * np.max(np.abs(theirs), axis=0) + 1e-12), what


def test_derivatives_at_the_tolerance_of_a_fit():
    """Interpolated between five points of each step: to about 1e-4 of those of short steps."""
    effects = EFFECTS["mount and air"]
    model, begin = model_for(Rig(), SETTING, ROCK, effects), begins(effects)
    found = [*by_states(effects, model, begin), *by_scalars(effects, model, begin)]
    kind, which = (np.array([getattr(each, name) for each in found], dtype=np.int64) for name in ("kind", "which"))
    columns = Columns(kind, which, np.zeros_like(kind), np.zeros(kind.size), np.zeros((0, DEGREE + 1)))
    loose, tight = (run(model, begin, columns, rtol) for rtol in (1e-7, 1e-12))
    size = np.sqrt(np.mean(tight.by_column**2, axis=2))
    off = np.sqrt(np.mean((loose.by_column - tight.by_column) ** 2, axis=2))
    assert np.all(off <= 3e-4 * size)
    assert np.max(np.abs(loose.signals - tight.signals)) < 1e-6 * np.max(np.abs(tight.signals))


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
    windows = Windows(np.array([0, 21 * samples]), begin, varied_by(columns, 1), rate, 0.0, 0.0, 0.0, UNCHAINED, 1, 0.0)
    shot = shot_of(windows, columns)
    motion = fresh_motion(model)
    found = shoot(model, motion.d, 1e-6, windows, columns, shot, make_variation(model, 0), make_scratch(model))
    return *found, shot.signals[0], effects


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
    windows = Windows(
        np.array([0, 656]), begin, np.eye(4, V.OWN)[None], 51200.0, -0.0612026489, 0.0, 0.0, UNCHAINED, 1, 2e-3
    )
    shot = shot_of(windows, columns)
    status, _impacts = shoot(
        model, fresh_motion(model).d, 1e-6, windows, columns, shot, make_variation(model, 4), make_scratch(model)
    )
    assert status == 0
    # a force by a depth is a stiffness, and little more after one blow
    assert np.abs(shot.by_column).max() < 1e3 * model.s[V.KL]
    assert np.abs(shot.ends_by_column).max() < 1e6
