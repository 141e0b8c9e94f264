"""What a recording at a setting would say of each mechanism: its Fisher information, before anybody records it.

The rig as it is believed is simulated at a setting, and the simulated recording taken in as a diagnosis takes in a
measured one: cut into windows, whose states are unknowns of its own, thinned, weighed by the noise of the sensors.
Sensitivities are those of the diagnosis (:func:`drillenv.diagnosis.drill_jacobian.quadratic`), by the constants, the
logger's filter, and the strength of every effect at no strength. The recording's own unknowns are eliminated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag
from threadpoolctl import threadpool_limits

from drillenv.checks import InputError
from drillenv.compiling import helped
from drillenv.diagnosis.condition import Conditioned, condition
from drillenv.diagnosis.constants import constants, logger
from drillenv.diagnosis.drill import ShootingProblem
from drillenv.diagnosis.drill_rig import DRILL
from drillenv.diagnosis.drill_unknowns import first_states
from drillenv.diagnosis.equations import Around
from drillenv.diagnosis.fitting import RELAXED, TIGHT, priors_of
from drillenv.diagnosis.laws import MOUNT_LAW, Curve, axes_visited, families
from drillenv.diagnosis.noise import NoiseModel
from drillenv.diagnosis.solver import Floats, eliminated
from drillenv.diagnosis.tables import GRID, PLACES, Axes
from drillenv.diagnosis.terms import ModelStructure, Term
from drillenv.dynamics.effects import REGISTRY, Chosen
from drillenv.dynamics.hybrid.shooting import COMPILE_DERIVATIVES
from drillenv.dynamics.motion import motion
from drillenv.dynamics.sensors import PerChannel, record
from drillenv.planning.signatures import Signature, planned_for, signatures, stated_term
from drillenv.recordings import Channel, Recording
from drillenv.recordings.made import LEAD, NOISE, UNITS, believed
from drillenv.rig import Rig, Setting
from drillenv.rocks import Rock

LONGEST_PERIOD = 2
"""Excitation periods after which a motion that is planned for repeats itself at most."""
NEAREST = 0.85
"""Largest real multiplier, either way, of a motion that is planned for: folds and period doublings are at +1 and -1,
and a mechanism of typical strength is not to turn the motion into another one. The pair that is not real is the shaker
body's slow swing on the rock, which is there at every setting."""
SETTLING = 12
"""Steps in which the windows' states are found."""
LEFT_OVER = 30.0
"""Log-likelihood that may be left of a simulated recording once its states are found; what grazes the rock leaves
more."""
CORES = 2
SEARCH_FOR_A_MOTION = "import drillenv; drillenv.motion(drillenv.Setting(100.0, 0.4, 1.0), rock=4)"
"""What compiles the kernels that :func:`is_regular` needs."""


@dataclass(frozen=True, slots=True)
class Site:
    """The rig that is to be recorded, as it is believed, and how."""

    rig: Rig
    rock: Rock
    effects: tuple[Chosen, ...] = ()
    """Of its model, on the motion."""
    seconds: float = 0.4
    """Of each recording."""
    sample_rate: float = 25600.0
    noise: PerChannel = NOISE
    """Standard deviations of the channels in V, N and m/s^2."""


class Candidate(NamedTuple):
    """A recording that may be made."""

    setting: Setting
    starts: str
    """``running`` or ``fresh``."""
    information: Floats
    """(nuisances + signatures + free laws,) squared, of the constants and the logger in the solver's units, of
    strengths as shares of typical ones, and of the free laws' coefficients in the solver's units."""
    power: float
    """Sum of the squares of what is read about its mean, in variances of the noise."""

    @property
    def fresh(self) -> bool:
        """Whether it starts from rest on rock never hit."""
        return self.starts == "fresh"


class Survey(NamedTuple):
    """What recordings at many settings would say."""

    candidates: list[Candidate]
    signatures: list[Signature]
    """In the order of the informations' rows behind those of the nuisances."""
    laws: list[tuple[frozenset[int], slice]]
    """Of each family with free laws the places at which it acts, and its coefficients' rows."""
    prior: Floats
    """(nuisances,) precision of what is believed of the constants, in the solver's units."""
    irregular: int
    """Settings that were left aside: their motion does not repeat itself soon enough, or never leaves the rock."""
    axes: Axes
    around: Around
    example: tuple[Floats, Conditioned]
    """(2, n) force and acceleration of a recording, on which the sizes of misreadings are compared."""


def survey(site: Site, settings: Sequence[tuple[Setting, str]], seed: int, note: Callable[[str], object]) -> Survey:
    """What a recording at each of the settings, started as said, would say of each effect of the library.

    Raises:
        InputError: the motion is regular at none of them.
    """
    nuisances = (constants(believed(site.rig, site.rock)), logger(), *map(stated_term, site.effects))
    base = ModelStructure(nuisances, FLAT, DRILL)
    with helped(f"{COMPILE_DERIVATIVES}; {SEARCH_FOR_A_MOTION}") as wait:
        settle(site, *settings[0], base)  # which compiles all that it needs
        wait()
    regular = [each for each in settings if is_regular(site, each[0])]
    note(f"{len(regular)} of {len(settings)} recordings are of a regular motion")
    with threadpool_limits(1), ThreadPoolExecutor(CORES) as pool:
        settled = [each for each in pool.map(lambda at: settle(site, at[0], at[1], base), regular) if each is not None]
        if not settled:
            raise InputError("no setting of these ranges has a regular motion that leaves the rock: widen the ranges")
        axes = axes_over(settled, base, pool)
        around = Around(site.rig.stiffness, site.rock.loading_stiffness, site.rock.unloading_stiffness)
        found = signatures_of(site, axes, around, np.random.default_rng(seed))
        free = free_laws(axes, [each.setting.frequency for each in settled])
        terms = (*(term for each in found for term in each.terms), *(term for each in free for term in each))
        whole, known = ModelStructure((*nuisances, *terms), axes, DRILL), len(base.unknowns)
        candidates = list(pool.map(lambda each: candidate(each, whole, known, found), settled))
    prior = priors_of(base).precision ** 2
    laws = placed(free, known + len(found))
    example = settled[0].block.data
    read = np.stack([example.force, example.acceleration])
    return Survey(candidates, found, laws, prior, len(settings) - len(settled), axes, around, (read, example))


FLAT = Axes(np.ones(PLACES), -np.ones(PLACES), np.full(PLACES, 2.0 / (GRID - 1)))
"""Of a model without laws."""


def is_regular(site: Site, setting: Setting) -> bool:
    """Whether the motion at a setting repeats itself soon, and is not near to turning into another one."""
    found = motion(setting, site.rock, site.rig, effects=site.effects, patience=400)
    if not 0 < found.period <= LONGEST_PERIOD or not found.stable:
        return False
    return max((abs(each.real) for each in found.multipliers.tolist() if abs(each.imag) < 1e-9), default=0.0) <= NEAREST


class Settled(NamedTuple):
    """A simulated recording with the states of its windows."""

    setting: Setting
    starts: str
    block: ShootingProblem
    own: Floats


def settle(site: Site, setting: Setting, starts: str, base: ModelStructure) -> Settled | None:
    """A recording at a setting as a diagnosis takes it in; None where it cannot."""
    made = simulated(site, setting, starts)
    try:
        data = condition(made, site.rig)
    except InputError:
        return None
    # white noise loses by thinning what it does in a diagnosis
    less = 1.0 / math.sqrt(data.thinned)
    noise = tuple(NoiseModel(less * std, 0.0, (), data.rate) for std in site.noise[1:])
    shared = priors_of(base).centre
    # joined at once, windows that begin as first guessed would not find to one motion
    free, own = ShootingProblem(data, base, RELAXED, (noise[0], noise[1])).under(base, first_states(data))
    own = free.estimate_states(shared, own, SETTLING)
    block, own = free.under(base, free.rollout(shared, own), TIGHT)
    own = block.estimate_states(shared, own, SETTLING)
    cost = block.cost(shared, own)
    return Settled(setting, starts, block, own) if cost < LEFT_OVER else None


def simulated(site: Site, setting: Setting, starts: str) -> Recording:
    """What sensors without noise record of the rig as it is believed."""
    lead = 0.0 if starts == "fresh" else LEAD
    read = record(site.rig, setting, site.rock, site.seconds, site.sample_rate, effects=site.effects, lead=lead)
    channels = {name: Channel(getattr(read.channels, name), unit, name) for name, unit in UNITS.items()}
    return Recording("simulated", "simulated", site.sample_rate, MappingProxyType(channels), starts, setting)


def axes_over(settled: Sequence[Settled], base: ModelStructure, pool: Executor) -> Axes:
    """Axes over what all of the motions visit."""
    values = np.array([each.value for each in base.unknowns])
    models = [base.model(values, each.block.point) for each in settled]
    paths = list(pool.map(lambda each, model: each.block.path(model, each.own), settled, models))
    return axes_visited(paths, models)


def signatures_of(site: Site, axes: Axes, around: Around, rng: np.random.Generator) -> list[Signature]:
    """Those of every effect that is planned for and that the model has not."""
    there = {each.effect.name for each in site.effects}
    effects = [each for name, each in REGISTRY.items() if name not in there and planned_for(each)]
    return [one for each in effects for one in signatures(each, axes, around, rng)]


def free_laws(axes: Axes, frequencies: Sequence[float]) -> list[tuple[Curve, ...]]:
    """The curves of each family of the diagnosis that has nothing else."""
    every = [each.terms for each in families(axes, frequencies) if each.name != MOUNT_LAW]
    return [curves for terms in every if len(curves := curves_among(terms)) == len(terms)]


def curves_among(terms: Iterable[Term]) -> tuple[Curve, ...]:
    """Those that are curves."""
    return tuple(each for each in terms if isinstance(each, Curve))


def placed(free: Sequence[tuple[Curve, ...]], first: int) -> list[tuple[frozenset[int], slice]]:
    """Places and rows of free laws, the first row as given."""
    found = []
    for curves in free:
        last = first + sum(len(each.unknowns) for each in curves)
        found.append((frozenset(each.place for each in curves), slice(first, last)))
        first = last
    return found


def candidate(settled: Settled, whole: ModelStructure, known: int, found: Sequence[Signature]) -> Candidate:
    """What a recording says: each signature as one column, all else as it is."""
    block, own = settled.block.under(whole, settled.own)
    part = block.quadratic(priors_of(whole).centre, own)
    hessian = eliminated(part, 0.0)[1]
    parts = [len(each.terms) for each in found]
    free = len(hessian) - known - sum(parts)
    together = np.repeat(np.eye(len(found)), parts, axis=1)
    mixing = np.asarray(block_diag(np.eye(known), together, np.eye(free)))
    return Candidate(settled.setting, settled.starts, mixing @ hessian @ mixing.T, block.power)


def grid(ranges: Iterable[tuple[float, float]], points: Sequence[int], digits: Sequence[int]) -> list[Setting]:
    """Settings at even distances over ranges of frequency in Hz, amplitude in V and pressure in bar."""
    axes = [
        np.round(np.linspace(*span, count), digit) for span, count, digit in zip(ranges, points, digits, strict=True)
    ]
    every = [Setting(float(f), float(a), float(p)) for f in axes[0] for a in axes[1] for p in axes[2]]
    # a narrow range has fewer values than points
    return list(dict.fromkeys(every))
