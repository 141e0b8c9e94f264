"""The rig once more, by other means: SciPy's DOP853 in absolute coordinates, with Xp and Xf spelled out.

Nothing is shared with the engine. Elements of the rig are plain functions; those with corners are :class:`Bent`. Every
corner ends an integration and begins another, so that SciPy only ever sees smooth equations. At an event the
integration is taken again up to it, corrected by Newton's rule: SciPy's own roots lie on a polynomial of lower order.
"""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, minimize_scalar

FREE, LOADING, UNLOADING = range(3)
X1, X2, V1, V2, FACE, FACE_SPEED, LOST, ROCK_FORCE, BEND1, BEND2, STATES = range(11)
SMALLEST = np.array([1e-17, 1e-17, 1e-15, 1e-15, 1e-18, 1e-15, 1e-13, 1e-11, 1e-18, 1e-18])
"""Absolute tolerances; that of the force of the rock is used only where it is a state."""
FIRST_STEP = 1e-7
"""s. Off an event steps begin short, so that it is left behind."""


class Bent:
    """A law of one argument: ``parts[i]`` applies from ``edges[i - 1]`` to ``edges[i]``. Each part goes on smoothly."""

    def __init__(self, edges, parts):
        self.edges, self.parts, self.part = list(edges), list(parts), 0

    def __call__(self, x):
        return self.parts[self.part](x)

    def settle(self, x, later):
        """Choose the part in which x lies; on an edge that into which it goes, ``later`` being x a moment later."""
        self.part = sum(edge < (later if abs(x - edge) <= 1e-12 * max(abs(x), abs(edge), 1e-3) else x)
                        for edge in self.edges)  # fmt: skip

    def exits(self):
        """(edge, direction, part behind it) of both ends of the present part."""
        if self.part < len(self.edges):
            yield self.edges[self.part], 1.0, self.part + 1
        if self.part > 0:
            yield self.edges[self.part - 1], -1.0, self.part - 1


def clipped(low, high, scale=1.0):
    """scale * min(max(x, low), high)."""
    return Bent([low, high], [lambda x: scale * low, lambda x: scale * x, lambda x: scale * high])


def _cubic(coefficients, left):
    a, b, c, d = map(float, coefficients)
    return lambda x: ((a * (x - left) + b) * (x - left) + c) * (x - left) + d


def measured(x, y, beyond="held", plus=lambda x: 0.0):
    """A curve by SciPy's monotone cubics, and what it is added to."""
    curve = PchipInterpolator(x, y)
    slope = [float(curve(x[i], 1)) if beyond == "straight" else 0.0 for i in (0, -1)]
    parts = [_cubic((0.0, 0.0, slope[0], y[0]), x[0])]
    parts += [_cubic(curve.c[:, i], x[i]) for i in range(len(x) - 1)]
    parts.append(_cubic((0.0, 0.0, slope[1], y[-1]), x[-1]))
    return Bent(x, [lambda x, part=part: plus(x) + part(x) for part in parts])


class Wave:
    """A measured curve over the phase, which repeats; settled for the time between two of its knots."""

    def __init__(self, x, y, omega):
        self.omega, turn = omega, 2.0 * math.pi
        x, y = np.asarray(x), np.asarray(y)
        around = np.concatenate([x + turn * n for n in range(-3, 4)])
        self.curve = PchipInterpolator(around, np.tile(y, 7))
        self.knots, self.cubic, self.turns = x, None, 0

    def times(self, end):
        """Times of all knots until the end."""
        period = 2.0 * math.pi / self.omega
        return [x / self.omega + n * period for n in range(-1, math.ceil(end / period) + 1) for x in self.knots]

    def settle(self, begin, end):
        middle = 0.5 * self.omega * (begin + end)
        self.turns = math.floor(middle / (2.0 * math.pi))
        at = int(np.searchsorted(self.curve.x, middle - 2.0 * math.pi * self.turns, side="right")) - 1
        self.cubic = _cubic(self.curve.c[:, at], float(self.curve.x[at]))

    def __call__(self, t):
        return self.cubic(self.omega * t - 2.0 * math.pi * self.turns)


class Ramped:
    """What a drive of limited slew rate has beyond the sine that is asked of it, over its size: by parts in time.

    It is asked for ``delay`` s late, follows where that is no steeper than ``steepest``, and ramps where it is.
    """

    def __init__(self, size, omega, steepest, delay, end):
        self.size, self.omega, self.steepest, self.delay = size, omega, steepest, delay
        self.parts, t, force, meets = [], 0.0, 0.0, False
        while t < end:
            steep = size * omega * math.cos(omega * (t - delay))
            if not meets and abs(force - self.late(t)) > 1e-12 * size:
                steep = math.inf if self.late(t) > force else -math.inf
            if abs(steep) <= steepest:
                # until the cosine is as steep again
                edge = math.acos(steepest / (size * omega)) if steepest < size * omega else -math.inf
                turn = math.ceil((omega * (t - delay) + edge) / math.pi + 1e-9) * math.pi
                after = (turn - edge) / omega + delay
                self.parts.append((t, self.late))
                force, meets, steep = self.late(after), True, math.cos(turn)
                t = after
                if t >= end:
                    break
            slope = math.copysign(steepest, steep)
            ramp = self.line(t, force, slope)
            self.parts.append((t, ramp))
            t, meets = self.meeting(t, ramp, slope), True
            force = ramp(t)
        self.part = self.parts[0][1]

    def late(self, t):
        return self.size * math.sin(self.omega * (t - self.delay))

    @staticmethod
    def line(begin, force, slope):
        return lambda t: force + slope * (t - begin)

    def meeting(self, begin, ramp, slope):
        """When a ramp that lags behind what is asked comes up to it."""

        def ahead(t):
            return math.copysign(1.0, slope) * (ramp(t) - self.late(t))

        step, t = 1e-3 / self.omega, begin + 1e-3 / self.omega
        while ahead(t + step) < 0.0:
            t += step
        return brentq(ahead, t, t + step, xtol=1e-18, rtol=1e-15)

    def times(self, end):
        return [begin for begin, _ in self.parts if begin < end]

    def settle(self, begin, end):
        self.part = [part for at, part in self.parts if at <= 0.5 * (begin + end)][-1]

    def __call__(self, t):
        return (self.part(t) - self.size * math.sin(self.omega * t)) / self.size


class Straight:
    """A contact with R = k S(depth), S(0) = 0; by default S is the depth."""

    def __init__(self, stiffness, shape=None, inverse=None):
        self.stiffness, self.shape, self.inverse = stiffness, shape, inverse

    def force(self, factor, depth):
        return factor * self.stiffness * (depth if self.shape is None or depth <= 0.0 else self.shape(depth))

    def depth(self, factor, force):
        goal = force / (factor * self.stiffness)
        if self.shape is None or goal <= 0.0:
            return goal
        if self.inverse is not None:
            return self.inverse(goal)
        high = goal
        while self.shape(high) < goal:
            high *= 2.0
        return brentq(lambda depth: self.shape(depth) - goal, 0.0, high, xtol=1e-22, rtol=1e-15)


class Tangent:
    """A contact with dR/dx = k f(R): its force is a state, and the depth at a force an integral."""

    def __init__(self, stiffness, x, y):
        self.stiffness, self.curve = stiffness, measured(x, y)

    def rate(self, force):
        return self.stiffness * self.curve(force)

    def depth(self, _factor, force):
        edges = [0.0, *(edge for edge in self.curve.edges if 0.0 < edge < force), force]
        held, total = self.curve.part, 0.0
        for low, high in pairwise(edges):
            self.curve.settle(0.5 * (low + high), 0.0)
            total += quad(lambda force: 1.0 / self.rate(force), low, high, epsabs=0.0, epsrel=1e-13)[0]
        self.curve.part = held
        return total


def inside(way_of, guard, way, begin, end, before, now):
    """When a guard is first crossed in a step. ``before`` and ``now``: its values there and a moment later."""

    def value(t):
        return way * guard(t, way_of(t))

    top = end if now[0] > 0.0 else None
    if before[1] > before[0] and now[1] < now[0] < 0.0:
        best = minimize_scalar(lambda t: -value(t), bounds=(begin, end), method="bounded", options={"xatol": 1e-12})
        top = best.x if best.fun < 0.0 else None
    return None if top is None else brentq(value, begin, top)


class Bristles(NamedTuple):
    """Friction of a mass that gives, after Canudas de Wit and others: stiffness in N/m, sliding force in N over the
    speed, damping in N s/m."""

    stiffness: float
    sliding: Callable
    damping: float


class Peer:
    """One rig on one rock at one setting. Its elements may be replaced before :meth:`run`."""

    def __init__(self, rig, setting, rock, rtol=1e-12, max_step=2e-4):
        self.rtol, self.max_step = rtol, max_step
        self.m1, self.m2, self.k, self.c = rig.shaker_mass, rig.indenter_mass, rig.stiffness, rig.damping
        self.f_a, self.f_b = rig.drive_force(setting), rig.static_force(setting)
        self.omega, self.period = 2.0 * math.pi * setting.frequency, setting.period
        self.kl, self.ku = rock.loading_stiffness, rock.unloading_stiffness
        self.contacts = {LOADING: Straight(self.kl), UNLOADING: Straight(self.ku)}
        # elements of the rig, each over its own argument
        self.spring = lambda y: self.k * y
        self.damper = lambda closing: self.c * closing
        self.guide = self.indenter = self.growth = self.added = self.resists = None
        """What the rock's force grows by, over that of the rock law; what is added to it, over the speed into the rock,
        and over depth and speed; friction on both masses."""
        self.drive = lambda asked: asked
        self.wave = None
        self.on_shaker = self.on_indenter = lambda t: 0.0
        self.air = lambda lost, v1: 0.0
        """How fast the cylinder loses force, in N/s."""
        self.mount = None
        """(compliance, mass, damping ratio, force by the deflection)."""
        self.factor_at = lambda t, impacts, drilled: 1.0
        self.grips = (0.0, 0.0)
        self.bristles = [None, None]
        """(stiffness, sliding force by the speed) of each mass."""

    # --- Balances

    def bends(self, t, z):
        """(law, argument) of every element with corners that acts now."""
        _, _, v1, v2, _, face_speed, _, rock = z[:8]
        y, closing, into = z[X1] - z[X2], v1 - v2, v2 - face_speed
        found = [(self.spring, y), (self.damper, closing), (self.guide, v1), (self.indenter, v2),
                 (self.drive, self.f_a * math.sin(self.omega * t))]  # fmt: skip
        if self.regime != FREE:
            found += [(self.growth, into), (self.added, into)]
            if isinstance(self.contact, Tangent):
                found.append((self.contact.curve, rock))
        return [(law, x) for law, x in found if isinstance(law, Bent)]

    def law(self, z):
        """Force of the rock law."""
        if self.regime == FREE:
            return 0.0
        if isinstance(self.contact, Tangent):
            return z[ROCK_FORCE]
        return self.contact.force(self.factor, z[X2] - z[FACE] - self.foot)

    def whole(self, z):
        """Force of the rock, were it able to pull."""
        if self.growth is not None:
            return self.law(z) * self.pull(z)
        return self.pull(z) if self.rated else self.law(z)

    def pull(self, z):
        """Below 0 where the rock would pull."""
        into = z[V2] - z[FACE_SPEED]
        if self.growth is not None:
            return 1.0 + self.growth(into)
        if self.resists is not None:
            return self.law(z) + self.resists(max(z[X2] - z[FACE] - self.foot, 0.0), into)
        return self.law(z) + self.added(into)

    def pushes(self, t, z):
        """Forces on both masses but dry friction, and that of the rock."""
        y, closing = z[X1] - z[X2], z[V1] - z[V2]
        rock = 0.0 if self.pulls or self.regime == FREE else self.whole(z)
        coupling = self.spring(y) + self.damper(closing)
        drive = self.drive(self.f_a * math.sin(self.omega * t))
        if self.wave is not None:
            drive += self.f_a * self.wave(t)
        one = self.f_b - z[LOST] - coupling + self.on_shaker(t)
        two = drive + coupling - rock + self.on_indenter(t)
        if self.guide is not None:
            one -= self.guide(z[V1])
        if self.indenter is not None:
            two -= self.indenter(z[V2])
        held = [
            0.0 if each is None else each.stiffness * z[BEND1 + mass] + each.damping * self.bending(mass, z)
            for mass, each in enumerate(self.bristles)
        ]
        return one - held[0], two - held[1], rock

    def flow(self, t, state):
        z = state.tolist()
        one, two, rock = self.pushes(t, z)
        a1, a2 = ((push - slide * grip) / mass if grip == 0.0 or slide != 0.0 else 0.0 for push, slide, grip, mass in
                  zip((one, two), self.slides, self.grips, (self.m1, self.m2), strict=True))  # fmt: skip
        face_bend, rock_rate = 0.0, 0.0
        if self.mount is not None:
            compliance, mass, ratio, held = self.mount
            face_bend = (rock - held(z[FACE]) - 2.0 * ratio * math.sqrt(mass / compliance) * z[FACE_SPEED]) / mass
        if self.regime != FREE and isinstance(self.contact, Tangent):
            rock_rate = self.contact.rate(z[ROCK_FORCE]) * (z[V2] - z[FACE_SPEED])
        bent = [self.bending(mass, z) for mass in range(2)]
        return [z[V1], z[V2], a1, a2, z[FACE_SPEED], face_bend, self.air(z[LOST], z[V1]), rock_rate, *bent]

    def bending(self, mass, z):
        """How fast bristles bend, in m/s."""
        if self.bristles[mass] is None:
            return 0.0
        own, v, bend = self.bristles[mass], z[V1 + mass], z[BEND1 + mass]
        return v - abs(v) * own.stiffness * bend / own.sliding(v)

    # --- Events

    @property
    def contact(self):
        return self.contacts[self.regime]

    @property
    def rated(self):
        return self.growth is not None or self.added is not None or self.resists is not None

    def events(self):
        """(guard, direction, what to do) of everything that ends the present equations."""
        found = []
        sticks = self.grips[1] > 0.0 and self.slides[1] == 0.0
        if self.regime == FREE:
            found.append((lambda t, z: z[X2] - z[FACE] - self.xf, 1.0, self.land))
        elif not sticks:
            way = -1.0 if self.regime == LOADING else 1.0
            found.append((lambda t, z: z[V2] - z[FACE_SPEED], way, self.turn))
        if self.regime == UNLOADING:
            found.append((lambda t, z: self.law(z), -1.0, self.release))
        if self.regime != FREE and self.rated:
            found.append((lambda t, z: self.pull(z), 1.0 if self.pulls else -1.0, self.let_go))
        for mass in range(2):
            if self.grips[mass] > 0.0:
                found += self.grip_events(mass)
            if self.bristles[mass] is not None:
                # the rates have a corner there
                found.append((lambda t, z, mass=mass: z[V1 + mass], -self.ways[mass],
                              lambda t, z, mass=mass: self.go_back(mass, z)))  # fmt: skip
        for at, (law, _) in enumerate(self.bends(0.0, [0.0] * STATES)):
            for edge, way, part in law.exits():

                def exits(t, z, at=at, edge=edge):
                    return self.bends(t, z)[at][1] - edge

                found.append((exits, way, lambda t, z, law=law, part=part: setattr(law, "part", part)))
        return found

    def grip_events(self, mass):
        slide, limit = self.slides[mass], self.grips[mass]
        if slide != 0.0:
            if mass == 1 and self.regime != FREE:
                return []
            return [(lambda t, z: z[V1 + mass], -slide, lambda t, z: self.stop(mass, t, z))]
        return [
            (lambda t, z, way=way: way * self.pushes(t, z)[mass] - limit, 1.0,
             lambda t, z, way=way: self.break_away(mass, way, t, z)) for way in (1.0, -1.0)
        ]  # fmt: skip

    def land(self, t, z):
        self.xp = self.foot = self.xf
        z[X2], z[ROCK_FORCE] = self.xf + z[FACE], 0.0
        self.since, self.speed = t, z[V2] - z[FACE_SPEED]
        self.factor = self.factor_at(t, len(self.impacts), self.xf)
        self.enter(LOADING, t, z)

    def release(self, t, z):
        z[X2], z[ROCK_FORCE] = self.xf + z[FACE], 0.0
        self.enter(FREE, t, z)

    def turn(self, t, z):
        """The indenter is at rest on the rock."""
        z[V2] = z[FACE_SPEED]
        if self.grips[1] > 0.0:
            self.stop(1, t, z)
            into = self.slides[1]
            if into == 0.0 or (into > 0.0) == (self.regime == LOADING):
                return
        self.reverse(t, z)

    def reverse(self, t, z):
        law = self.law(z)
        if self.regime == LOADING:
            self.peak = max(self.peak, self.pushes(t, z.tolist())[2])
            self.impacts.append((t, self.peak, self.speed, z[X2] - z[FACE] - self.xp, self.since))
            self.xf = self.foot = z[X2] - z[FACE] - self.contacts[UNLOADING].depth(self.factor, law)
            after = UNLOADING
        else:
            self.xp = self.foot = z[X2] - z[FACE] - self.contacts[LOADING].depth(self.factor, law)
            after = LOADING
        z[ROCK_FORCE] = law
        self.enter(after, t, z)

    def enter(self, after, t, z):
        self.switches.append((t, after))
        self.regime, self.peak, self.pulls = after, 0.0, False
        if after != FREE and isinstance(self.contact, Tangent):
            self.contact.curve.settle(z[ROCK_FORCE], z[ROCK_FORCE] + (1.0 if after == LOADING else -1.0))
        self.settle(t, z, (self.growth, self.added))
        self.pulls = after != FREE and self.rated and self.pull(z) < 0.0

    def let_go(self, _t, _z):
        self.pulls = not self.pulls

    def stop(self, mass, t, z):
        """A mass that slid is at rest: it sticks, or slides where it is pushed."""
        z[V1 + mass] = 0.0
        push = self.pushes(t, z.tolist())[mass]
        self.slides[mass] = 0.0 if abs(push) <= self.grips[mass] else math.copysign(1.0, push)

    def go_back(self, mass, z):
        z[V1 + mass] = 0.0
        self.ways[mass] = -self.ways[mass]

    def break_away(self, mass, way, t, z):
        self.slides[mass] = way
        if mass == 1 and ((self.regime == LOADING and way < 0.0) or (self.regime == UNLOADING and way > 0.0)):
            self.reverse(t, z)

    def settle(self, t, z, laws=None):
        """Choose the part of each law with corners."""
        later = z + 1e-9 * np.array(self.flow(t, z))
        for (law, x), (_, next_x) in zip(self.bends(t, z), self.bends(t + 1e-9, later), strict=True):
            if laws is None or law in laws:
                law.settle(x, next_x)

    # --- Going on

    def integrate(self, t, z, end, first_step, **more):
        return solve_ivp(self.flow, (t, end), z, "DOP853", rtol=self.rtol, atol=SMALLEST, max_step=self.max_step,
                         first_step=min(first_step, end - t), **more)  # fmt: skip

    def correct(self, guard, t, z, event):
        """Time and state of an event that was found at a time, from the last state before it."""
        end = z
        for _ in range(5):
            if event <= t:
                return t, z.copy()
            end = self.integrate(t, z, event, event - t).y[:, -1]
            small = 1e-9
            slope = np.array(self.flow(event, end))
            ahead, behind = (guard(event + way * small, end + way * small * slope) for way in (1.0, -1.0))
            change = guard(event, end) * 2.0 * small / (ahead - behind)
            if abs(change) <= 1e-16:
                break
            event -= change
        return event, end

    def follow(self, t, z, end):
        """Go on to the next event, or to the end. Returns time and state."""
        found = self.events()
        guards = []
        for guard, way, _ in found:

            def event(t, z, guard=guard):
                return guard(t, z)

            event.terminal, event.direction = True, way
            guards.append(event)
        part = self.integrate(t, z, end, min(FIRST_STEP, 0.5 * (end - t)), events=guards, dense_output=True)
        shown = next((i for i, times in enumerate(part.t_events) if len(times)), None) if part.status == 1 else None
        hidden = self.hidden(part, found, shown)
        if hidden is None and shown is not None:
            hidden = len(part.t) - 2, part.t[-1], shown
        last = len(part.t) - 1 if hidden is None else hidden[0]
        self.largest = np.maximum(self.largest, np.abs(part.y[:, : last + 1]).max(axis=1))
        z, when = part.y[:, -1].copy(), end
        if hidden is not None:
            guard, _, action = found[hidden[2]]
            when, z = self.correct(guard, part.t[last], part.y[:, last], hidden[1])
        if self.regime == LOADING and self.rated:
            self.look_for_peak(part, when)
        if hidden is not None:
            action(when, z)
        return when, z

    def hidden(self, part, found, shown):
        """(step, time, event) of the first event that shows at neither end of a step, since it is taken back in it.

        Or that comes before the one that shows, and is taken back after it.
        """
        small, before = 1e-9, None
        for i, (t, z) in enumerate(zip(part.t, part.y.T, strict=True)):
            later = z + small * np.array(self.flow(t, z))
            now = [(way * guard(t, z), way * guard(t + small, later)) for guard, way, _ in found]
            for which, (guard, way, _) in enumerate(found):
                itself = which == shown and i == len(part.t) - 1
                if before is None or before[which][0] >= 0.0 or itself:
                    continue
                time = inside(part.sol, guard, way, part.t[i - 1], t, before[which], now[which])
                if time is not None:
                    return i - 1, time, which
            before = now
        return None

    def look_for_peak(self, part, end):
        times = [*part.t[part.t < end], end]
        force = [self.pushes(t, part.sol(t))[2] for t in times]
        at = int(np.argmax(force))
        bounds = times[max(at - 1, 0)], times[min(at + 1, len(times) - 1)]
        best = minimize_scalar(lambda t: -self.pushes(t, part.sol(t))[2], bounds=bounds, method="bounded",
                               options={"xatol": 1e-10})  # fmt: skip
        self.peak = max(self.peak, -best.fun)

    def sample(self, t, z):
        ahead = self.xf
        if self.regime == LOADING:
            ahead = z[X2] - z[FACE] - self.contacts[UNLOADING].depth(self.factor, self.law(z))
        self.samples.append((z[X1], z[X2], z[V1], z[V2], self.pushes(t, z.tolist())[2], ahead))

    def run(self, periods, parts=4):
        """From rest; ``parts`` samples a period."""
        self.regime, self.xp, self.xf, self.foot, self.factor = FREE, 0.0, 0.0, 0.0, 1.0
        self.peak, self.speed, self.since, self.pulls = 0.0, 0.0, 0.0, False
        self.samples, self.impacts, self.switches, self.slides = [], [], [], [0.0, 0.0]
        t, z = 0.0, np.zeros(STATES)
        z[X1] = self.f_b / self.k
        self.largest = np.abs(z)
        end = periods * self.period
        marks = [i * self.period / parts for i in range(1, parts * periods + 1)]
        knots = self.wave.times(end) if self.wave else []
        # a knot on a mark is one stop
        stops = sorted([*marks, *(t for t in knots if 0.0 < t < end and min(abs(t - mark) for mark in marks) > 1e-13)])
        if self.wave:
            self.wave.settle(0.0, stops[0])
        self.settle(t, z)
        if self.grips[0] > 0.0 or self.grips[1] > 0.0:
            for mass in range(2):
                self.stop(mass, t, z)
        self.ways = [1.0 if rate >= 0.0 else -1.0 for rate in self.flow(t, z)[V1 : V2 + 1]]
        self.sample(t, z)
        self.land(t, z)  # pushed by the spring
        for stop in stops:
            if self.wave:
                self.wave.settle(t, stop)
            while t < stop:
                t, z = self.follow(t, z, stop)
            if stop in marks:
                self.sample(t, z)
        return self
