"""Physics the paper leaves out: one file an effect, found by walking this package.

To add an effect, write one new module here that sets ``EFFECT``; nothing else changes. Effects of other distributions
join those of this package by the entry point group ``drillenv.effects``, see CONTRIBUTING.md. The module says
everything about the effect once: words, equation, source, parameters, and what it does. On the drilling rig that is

``laws``
    By place (:mod:`drillenv.dynamics.constitutive.places`), a law in plain NumPy: ``law(x, p, stiffness)``, from
    arguments (n,), the parameters in their order and the coupling's stiffness k in N/m to values (n,). At ``loading``
    and ``unloading`` it is the shape of the contact, a :class:`~drillenv.dynamics.constitutive.places.Shape`. Laws are
    continuous; corners are found. So that the rock gives nothing away, each force must be reached on a way out that is
    no softer than the way in.
``scalars``
    ``scalars(p)``: what it sets of the model that is no curve, by the names of ``places.SCALARS``: a mount, the air, a
    vibration, dry friction that grips.
``term``
    For what is neither, one compiled function with states of its own, ``term(now, own, p, push, rates)``: ordinary
    Python on numbers and one-dimensional arrays, within what Numba compiles, that raises nothing. It adds smooth forces
    to ``push[ON_SHAKER]`` and ``push[ON_INDENTER]`` (N, positive toward the rock) and to ``push[ON_ROCK]`` (N, positive
    where the rock resists more; ignored out of contact). ``now`` is a :class:`Moment`, ``own`` the effect's extra
    states, whose time derivatives go to ``rates``. A corner in it is found by the control of the step's error; a jump
    is not, and must not hide there. No effect of this package needs a term.

With every parameter at its neutral value an effect must change nothing, to the last bit. The engine takes care that the
contact never pulls.

Two more functions are NumPy, on whole arrays: ``measure(true, read, p)`` of a sensor, which acts on no motion but on
what is recorded, and ``on_body(position, velocity, applied, stiffness, p)``, the force on the mass of a one-body rig
along motions (..., n) of n samples, so that it may remember; ``body_forms`` say from where a diagnosis of such a rig
tries it.

A diagnosis tries the equations of ``forms`` and ``body_forms`` in the place of laws that it has fitted freely. Where no
equation follows such a law, it is reported as the effect that claims it by ``free_laws``. Most effects claim none, and
no two the same.

An effect that follows a measured curve has no parameters of its own, but ``axes``: what the curve is over and what it
gives. A module with several effects sets ``EFFECTS`` in place of ``EFFECT``.
"""

from __future__ import annotations

import difflib
import functools
import importlib
import importlib.metadata
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from drillenv.checks import InputError, number, shown
from drillenv.dynamics.constitutive.curves import LARGEST, Curve, curve_from
from drillenv.dynamics.constitutive.places import Law, Over, Shape
from drillenv.dynamics.constitutive.tables import Table
from drillenv.dynamics.forms import Form
from drillenv.dynamics.free_laws import FREE_LAWS

GROUP = "drillenv.effects"
"""Entry points of other distributions: each loads to an Effect, or to a list of them."""
if TYPE_CHECKING:
    REGISTRY: MappingProxyType[str, Effect]
    """Every effect with an equation and parameters, by name."""
    TABULATED: MappingProxyType[str, Effect]
    """Every effect that follows a measured curve, by name."""
    LIBRARY: MappingProxyType[str, Effect]
    """Those of REGISTRY that come with this package, whatever else is installed."""

ON_SHAKER, ON_INDENTER, ON_ROCK = 0, 1, 2
"""Where a force acts, as an index into ``push``."""

Balance = Literal["contact", "indenter", "shaker", "sensor", "body"]
RegimeName = Literal["no contact", "loading", "unloading"]
EVERYWHERE: tuple[RegimeName, ...] = ("no contact", "loading", "unloading")
IN_CONTACT: tuple[RegimeName, ...] = ("loading", "unloading")


class Moment(NamedTuple):
    """The rig at one moment, as a term sees it. SI throughout."""

    time: float
    """s since the start of the run."""
    theta: float
    """Phase of the excitation in rad; whole turns may have been taken off."""
    omega: float
    """Excitation frequency in rad/s."""
    y: float
    """X1 - X2 in m, the spring's shortening; F_b / k at rest."""
    closing: float
    """V1 - V2 in m/s."""
    v1: float
    v2: float
    depth: float
    """In contact the depth the rock law sees in m; out of contact the place behind the rock's face, negative."""
    into: float
    """Speed into the rock's face in m/s: V2, less the speed of the face where a mount lets it move."""
    face: float
    """Displacement of the rock's face in m, 0 unless a mount lets it move."""
    rock: float
    """Force of the rock law in N."""
    regime: int
    """0 no contact, 1 loading, 2 unloading."""
    drive: float
    """F_a in N, the amplitude of the drive force."""
    static: float
    """F_b in N."""
    m1: float
    m2: float
    k: float
    c: float
    kl: float
    ku: float


class Channels(NamedTuple):
    """What the sensors of the rig give, sampled evenly. SI, and V for the excitation; arrays have shape (samples,)."""

    rate: float
    """Samples a second."""
    begin: float
    """s, the time of the first sample."""
    excitation: np.ndarray
    """V."""
    force: np.ndarray
    """N, of the rock, positive in compression."""
    acceleration: np.ndarray
    """m/s^2, of the indenter."""
    from_rest: bool = False
    """Whether the rig stood still before the first sample, so that every channel was 0. Otherwise a sensor that
    remembers takes each channel to have stood at its first value."""

    def before(self, signal: np.ndarray) -> float:
        """What a channel stood at before its first sample."""
        return 0.0 if self.from_rest or not signal.size else float(signal[0])

    @property
    def time(self) -> np.ndarray:
        """s, of each sample."""
        return self.begin + np.arange(self.force.size) / self.rate


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of an effect. With all of them at ``neutral`` the effect is as if absent."""

    symbol: str
    meaning: str
    unit: str
    low: float
    high: float
    neutral: float
    typical: tuple[float, float]
    """Lowest and highest strength that a laboratory may meet and that shows on the paper's rig: a judgement."""


@dataclass(frozen=True, slots=True)
class Extra:
    """A state that an effect adds. ``size`` is what counts as large for it; errors are kept small against that."""

    symbol: str
    meaning: str
    unit: str
    size: float
    turns: bool = False
    """Whether it is an angle that goes round at a rate of its own, whatever the rig does, or is such an angle kept: a
    motion then comes back only where these angles do."""
    kept: str = ""
    """Where the engine keeps it, see ``MEMORY`` of :mod:`drillenv.dynamics.hybrid.model`; a state of the effect's own
    term where left out."""


@dataclass(frozen=True, slots=True)
class Axes:
    """What the measured curve of an effect is over, and what it gives."""

    argument: str
    """As in: the rig's own spring is shortened by ``argument``."""
    argument_unit: str
    quantity: str
    """What the curve gives, with the sign that it counts by."""
    unit: str
    place: int
    """The code of the place where it acts."""
    table: Callable[[Curve], Table]
    """Makes the table of a curve. A ``ValueError`` says why a curve cannot be one of this effect."""
    over: Over = "depth"
    """At a contact: what its table is over."""
    neutral: float = 0.0
    """The value at which the effect is as if absent."""
    low: float = -LARGEST
    high: float = LARGEST
    """Values allowed."""


@dataclass(frozen=True, slots=True)
class Effect:
    """All there is to say about one effect. See the package's docstring for its functions."""

    name: str
    """As in a report: ``contact-rate``."""
    sentence: str
    """One plain sentence for people who drill."""
    equation: str
    source: str
    """A publication, or ``constitutive`` for a textbook form that needs none."""
    parameters: tuple[Parameter, ...]
    """None where it follows a measured curve."""
    balances: tuple[Balance, ...]
    """The force balances in which it may act."""
    regimes: tuple[RegimeName, ...]
    """The regimes in which it acts."""
    energy: Literal["loses", "stores", "moves", "none"]
    """What it does to the rig's energy: only takes it, gives back what it took, either, or nothing of its own."""
    extras: tuple[Extra, ...] = ()
    laws: Mapping[str, Law | Shape] = field(default_factory=dict, hash=False)
    scalars: Callable[[tuple[float, ...]], Mapping[str, float]] | None = None
    term: Callable | None = None
    measure: Callable[[Channels, Channels, tuple[float, ...]], Channels] | None = None
    """What a sensor makes of the channels: from the true ones and from those that the sensors before it have read."""
    stage: int = 0
    """Sensors act in rising order of it: 0 what the transducer is fastened to, 1 to 3 the transducer and its line, 4
    what the line picks up, 5 its zero."""
    needs_fine: bool = False
    """``measure`` follows the signal between samples, so it wants them dense."""
    on_body: Callable[..., np.ndarray] | None = None
    """Force in N on the mass of a one-body rig, to be added to mass * acceleration = force - law."""
    forms: tuple[Form, ...] = ()
    """How a diagnosis tries its equations."""
    free_laws: tuple[str, ...] = ()
    """Names of ``FREE_LAWS`` (:mod:`drillenv.dynamics.free_laws`): a law of such a name that was measured, and that no
    equation follows, is reported as this effect. No other effect may claim it; leave it empty where in doubt."""
    body_forms: tuple[Form, ...] = ()
    """The same on a one-body rig; starts are in units of the body's typical force, travel and speed."""
    body_sentence: str = ""
    """What is said of a single body, where ``sentence`` speaks of the drilling rig."""
    body_told_apart: str = ""
    """What to record of a single body to tell it from what looks alike."""
    body_constant: str = ""
    """The constant of a one-body law that says the same, where a lab states it."""
    counted: Callable[[tuple[float, ...]], float] | None = None
    """Its first extra state counts impacts on a face, and all of them begin anew on a fresh one: after how many, for
    these parameters, nothing changes any more."""
    axes: Axes | None = None
    """Of the measured curve that it follows."""

    @property
    def neutral(self) -> tuple[float, ...]:
        """The neutral values, in the order of the parameters."""
        return tuple(parameter.neutral for parameter in self.parameters)

    @property
    def moves_rig(self) -> bool:
        """Whether it acts on the motion of the drilling rig, so that the hybrid engine takes it."""
        return bool(self.laws) or self.scalars is not None or self.term is not None or self.axes is not None

    def parameter(self, symbol: str) -> Parameter:
        """The parameter of this symbol.

        Raises:
            KeyError: there is none.
        """
        for each in self.parameters:
            if each.symbol == symbol:
                return each
        raise KeyError(symbol)


@dataclass(frozen=True, slots=True)
class Chosen:
    """An effect with values for its parameters, in their order. Get one from :func:`make`."""

    effect: Effect
    values: tuple[float, ...]
    """Of an effect that follows a measured curve its arguments, then its values."""
    curve: Curve | None = None
    """The measured curve that it follows, if any."""

    @property
    def is_neutral(self) -> bool:
        """Whether every parameter is at its neutral value."""
        if self.curve is not None and self.effect.axes is not None:
            return all(value == self.effect.axes.neutral for value in self.curve.y)
        return self.values == self.effect.neutral

    @property
    def given(self) -> dict[str, Any]:
        """What to give :func:`make` for it by name, as JSON takes it."""
        axes = self.effect.axes
        if self.curve is None or axes is None:
            return dict(zip((each.symbol for each in self.effect.parameters), self.values, strict=True))
        return {
            "argument_unit": axes.argument_unit,
            "unit": axes.unit,
            "x": list(self.curve.x),
            "y": list(self.curve.y),
            "beyond": self.curve.beyond,
        }


def make(name: str, /, **values: Any) -> Chosen:
    """An effect of the registry with values for its parameters by symbol; those left out are neutral.

    An effect that follows a measured curve (``TABULATED``) takes the curve in place of parameters: ``x`` and ``y``, 2
    to 64 numbers each in SI, and where they are to be other than these ``beyond="held"``, which says how the curve goes
    on outside its range (or ``"straight"``), and ``argument_unit`` and ``unit``, which are only compared.

    Raises:
        InputError: no such effect or parameter, a value outside its bounds, or not a curve for this effect.
    """
    effect = _named(name, _every())
    if effect.axes is not None:
        return _along(effect, values)
    symbols = tuple(parameter.symbol for parameter in effect.parameters)
    for symbol in values:
        if symbol not in symbols:
            raise InputError(f"effect {name} has no parameter {symbol!r}: its parameters are {', '.join(symbols)}")
    chosen = [
        number(f"{name} {part.symbol}", values.get(part.symbol, part.neutral), part.low, part.high, part.unit)
        for part in effect.parameters
    ]
    return Chosen(effect, tuple(chosen))


def drawn(name: str, rng: np.random.Generator) -> Chosen:
    """An effect of the registry at a strength drawn at random: each parameter evenly from its typical range.

    One with a single typical value is not drawn, so that a parameter more leaves what a seed draws as it is.

    Raises:
        InputError: no such effect.
    """
    values = {}
    for part in _named(name, _registry()).parameters:
        low, high = part.typical
        values[part.symbol] = float(rng.uniform(low, high)) if low < high else low
    return make(name, **values)


def mechanism_of_law(law: str) -> str:
    """The name of the effect that a free law is reported as where no equation follows it; ``law`` where none claims it.

    Raises:
        InputError: two effects claim the same free law, or one claims a law that there is not.
    """
    return _claims().get(law, law)


@functools.cache
def _claims() -> dict[str, str]:
    """The name of the effect that claims a free law, by law."""
    found: dict[str, str] = {}
    for effect in _registry().values():
        for law in effect.free_laws:
            if law not in FREE_LAWS:
                known = (difflib.get_close_matches(law, FREE_LAWS, 1) or ["a name of drillenv.dynamics.free_laws"])[0]
                raise InputError(f"effect {effect.name} claims the free law {shown(law)}, which is none: give {known}")
            if law in found:
                both = f"effects {found[law]} and {effect.name}"
                raise InputError(f"{both} both claim the free law {law!r}: leave it out of free_laws of one of them")
            found[law] = effect.name
    return found


def _named(name: object, among: Mapping[str, Effect]) -> Effect:
    """The effect of this name; where there is none, the message names those that are spelled alike."""
    if isinstance(name, str) and name in among:
        return among[name]
    near = difflib.get_close_matches(str(name)[:80], among, 5)
    known = f"one of {', '.join(near)}" if near else "a name of REGISTRY or TABULATED of drillenv.dynamics.effects"
    raise InputError(f"effect is {shown(name)}: give {known}")


def _along(effect: Effect, values: Mapping[str, object]) -> Chosen:
    """An effect with the curve that it is to follow."""
    axes = effect.axes
    assert axes is not None
    curve = curve_from(effect.name, values, axes.argument_unit, axes.unit, axes.low, axes.high)
    try:
        axes.table(curve)
    except ValueError as error:
        raise InputError(f"the curve of {effect.name} cannot be: {error}") from None
    return Chosen(effect, (*curve.x, *curve.y), curve)


@functools.cache
def _own() -> MappingProxyType[str, Effect]:
    """Every effect of this package by name."""
    found: dict[str, Effect] = {}
    for name in sorted(info.name for info in pkgutil.iter_modules(__path__)):
        module = importlib.import_module(f"{__name__}.{name}")
        for effect in getattr(module, "EFFECTS", None) or (module.EFFECT,):
            if effect.name in found:
                raise RuntimeError(f"two effects are called {effect.name}: rename the one in {name}.py")
            found[effect.name] = effect
    return MappingProxyType(found)


@functools.cache
def _every() -> MappingProxyType[str, Effect]:
    """Every effect of this package and of other distributions by name.

    Raises:
        InputError: an entry point that cannot be loaded or holds something else than effects, or two effects of a name.
    """
    found = dict(_own())
    owners = dict.fromkeys(found, "drillenv")
    points = importlib.metadata.entry_points(group=GROUP)
    for point in sorted(points, key=lambda each: (_owner(each), each.name)):
        owner = _owner(point)
        for effect in _loaded(point):
            if effect.name in found:
                raise InputError(
                    f"{owner} brings an effect {effect.name}, which {owners[effect.name]} has: rename or uninstall it"
                )
            found[effect.name], owners[effect.name] = effect, owner
    return MappingProxyType(found)


def _owner(point: importlib.metadata.EntryPoint) -> str:
    """The distribution that an entry point belongs to."""
    return point.dist.name if point.dist else "an unnamed distribution"


def _loaded(point: importlib.metadata.EntryPoint) -> tuple[Effect, ...]:
    """The effects of an entry point.

    Raises:
        InputError: it cannot be loaded, or holds something else.
    """
    where = f"{_owner(point)} names {point.value} as its entry point {point.name} of {GROUP}"
    try:
        given = point.load()
    except Exception as error:  # whatever another's code raises as it is imported
        raise InputError(f"{where}, which cannot be loaded ({shown(error)}): mend or uninstall it") from error
    effects = (given,) if isinstance(given, Effect) else given
    if not isinstance(effects, (list, tuple)) or not all(isinstance(each, Effect) for each in effects):
        raise InputError(f"{where}, which is {shown(given)}: let it be an Effect, or a list of them")
    return tuple(effects)


@functools.cache
def _registry() -> MappingProxyType[str, Effect]:
    """Every effect with an equation and parameters."""
    return MappingProxyType({name: each for name, each in _every().items() if each.axes is None})


def __getattr__(name: str) -> MappingProxyType[str, Effect]:
    """REGISTRY, TABULATED or LIBRARY.

    They are found where they are first asked for and not on import: a distribution whose effects join them imports this
    package itself.
    """
    if name == "REGISTRY":
        return _registry()
    if name == "TABULATED":
        return MappingProxyType({key: each for key, each in _every().items() if each.axes is not None})
    if name == "LIBRARY":
        return MappingProxyType({key: each for key, each in _own().items() if each.axes is None})
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
