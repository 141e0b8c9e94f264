"""One body: which mechanisms its recordings ask for, one after the other, and what stays unexplained."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import minimize

from drillenv.diagnosis.one_body.channels import Body
from drillenv.diagnosis.one_body.fit import (
    Fitted,
    Noise,
    Rows,
    Score,
    best_beside,
    fit,
    floor,
    noise_of,
    scored,
    sizes_of,
)
from drillenv.diagnosis.one_body.terms import APART, Term, Variant, hats, library, outside, renamed, timing
from drillenv.recordings import Campaign

MOST = 3
"""Mechanisms at once."""
WORTH = 0.2
"""Share of what is left beyond the sensors' noise that a mechanism has to explain of recordings left out."""
TINY = 2e-3
"""Of the force, root mean square: what explains less than that is no physics that anybody misses."""
TELLING = 9.0
"""Difference of squares over noise on what was left out, from which two mechanisms are told apart."""
ABOVE = 1.3
"""Mean square over the sensors' noise, from which more than noise is left."""
CORNERS = 8
"""Of the flexible function."""
MOVES = 0.05
"""Share of the power of the speed from which a frequency is the motion's own."""
LEAST_LINE = 128
"""Rows of a recording in which a frequency is looked for."""
SURE = 3.0
"""Standard deviations from zero: by that a constant may not lie on the wrong side, and a strength must lie away."""


@dataclass(slots=True, eq=False)
class Step:
    """A mechanism that was added."""

    variant: Variant
    terms: tuple[Term, ...]
    gain: float
    """Over what chance explains in the mean."""
    needed: float
    share: float
    """Of what was left beyond the sensors' noise on what was left out."""
    equivalents: tuple[str, ...] = ()


@dataclass(slots=True, eq=False)
class Rest:
    """What the terms do not account for."""

    excess: float
    """N, root mean square beyond the sensors' noise."""
    ratio: float
    """Mean square over that of the sensors' noise."""
    shapes: list[tuple[str, float, float]]
    """(in words, gain over the needed one, share of what is left that it describes), of what is surely there."""
    lines: list[tuple[str, float, float]]
    """(recording, Hz, share of its mean square)."""

    @property
    def structured(self) -> bool:
        """Whether it is more than the noise of the sensors."""
        return bool(self.shapes or self.lines) or self.ratio > ABOVE


@dataclass(slots=True, eq=False)
class Search:
    """Looks for mechanisms among the rows of a campaign."""

    rows: Rows
    law: tuple[Term, ...]
    campaign: Campaign
    rng: np.random.Generator
    say: Callable[[str], object]
    library: list[Variant] = field(init=False)
    outside: list[Variant] = field(init=False)
    flexible: tuple[Term, ...] = field(init=False)
    noise: Noise = field(init=False)
    rejected: dict[str, tuple[float, str]] = field(init=False, default_factory=dict)
    """Gain and reason by mechanism."""

    def __post_init__(self):
        bodies, mass = self.rows.bodies, self.rows.mass
        self.library, self.outside = library(self.campaign, bodies, mass), outside(bodies)
        corners = int(np.clip(self.rows.y.size // 100, 4, CORNERS))
        self.flexible = tuple(hats(bodies, corners))
        # sampling alone may part the channels; how much it does is settled first, for good
        most = self._most()
        self.noise = noise_of(self.rows, most, self.rng)
        self.law = (*self.law, timing(mass, self._parted(most)))

    def _most(self) -> list[Term]:
        """The law, a lag, the flexible function and the best of the mechanisms and shapes beside them."""
        terms = [*self.law, timing(self.rows.mass), *self.flexible]
        for variants in (self.library, self.outside):
            best = best_beside(self.rows, terms, variants)
            terms += best.terms if best else ()
        return terms

    def _parted(self, most: Sequence[Term]) -> float:
        """s, by which the channels are apart, where the recordings tell it and it is no more than sampling does.

        Beside all that may be missing, or a lag would stand in for it.
        """
        beside = self.lagging(most)
        lag, std = beside.constants()["timing"], beside.spreads()["timing"]
        least = APART / max(body.rate for body in self.rows.bodies)
        # a little beyond, so that no lag falls between this and what is called a delay
        return lag if SURE * std < abs(lag) <= 1.25 * least else 0.0

    def lagging(self, terms: Sequence[Term]) -> Fitted:
        """These terms beside a lag of the left side behind the motion that is free."""
        terms = [term for term in terms if term.name != "timing"]
        return fit(self.rows, [*terms, timing(self.rows.mass)], self.noise)

    def fitted(self, steps: Sequence[Step] = (), extra: Sequence[Term] = (), local: bool = False) -> Fitted:
        """The law with mechanisms and further terms."""
        terms = [*self.law, *(term for step in steps for term in step.terms), *extra]
        return fit(self.rows, terms, self.noise, local)

    def floor(self, now: Fitted) -> float:
        """N, of the sensors alone; never above what a fit leaves."""
        return min(floor(self.rows, now.constants()), self.noise.size)

    def next(self, steps: Sequence[Step]) -> Step | None:
        """The mechanism to add, if one is missing."""
        now = self.fitted(steps)
        there = {step.variant.mechanism for step in steps}
        variants = [each for each in self.library if each.mechanism not in there]
        scores, needed, hidden = scored(self.rows, now.terms, variants, self.noise, self.rng)
        for name in hidden:
            self.rejected[name] = 0.0, "these recordings cannot tell it from the constants of the law"
        best: dict[str, Score] = {}
        for score in scores:
            best.setdefault(score.variant.mechanism, score)
        for name, score in best.items():
            self.rejected[name] = score.gain, f"explains no more than chance does (needs {needed:.1f})"
        found = []
        for score in [each for each in best.values() if each.gain > needed]:
            tried = self._tried(steps, score, needed)
            if tried is not None:
                found.append(tried)
        if not found:
            return None
        found.sort(key=lambda each: each[1].mean_square)
        step, made = found[0]
        for other, beside in found[1:]:
            name = other.variant.mechanism
            more = float(np.sum(beside.left_out**2 - made.left_out**2)) / self.noise.counted**2
            if more < TELLING:
                step.equivalents = (*step.equivalents, name)
            self.rejected[name] = other.gain, f"explains less of what it did not see than {step.variant.mechanism}"
        self.rejected.pop(step.variant.mechanism, None)
        return step

    def _tried(self, steps: Sequence[Step], score: Score, needed: float) -> tuple[Step, Fitted] | None:
        """A mechanism fitted for good, if it can be."""
        variant = self._reshaped(steps, score.variant)
        name = variant.mechanism
        terms = tuple(renamed(term, name) for term in variant.terms)
        local = any(term.local for term in terms)
        now, made = self.fitted(steps, local=local), self.fitted(steps, terms)
        strengths = made.values[-len(terms) :]
        why = variant.sensible(strengths, made.constants()) or _unphysical(made, len(self.law))
        if not why and len(terms) == 1 and abs(strengths[0]) < SURE * math.sqrt(made.covariance[-1, -1]):
            why = "its strength is not told from nothing: it jumps when recordings or stretches are left out"
        least = self.floor(made) ** 2
        gained = now.mean_square - made.mean_square
        share = gained / max(now.mean_square - least, 1e-300)
        if not why and share < WORTH:
            why = f"explains {100 * max(share, 0.0):.0f} % of what is left on recordings or stretches it did not see"
        if not why and gained < (TINY * float(np.std(self.rows.y))) ** 2:
            why = f"explains less than {100 * TINY:g} % of the force"
        if why:
            self.rejected[name] = score.gain, why
            return None
        return Step(variant, terms, score.gain, needed, share), made

    def _reshaped(self, steps: Sequence[Step], variant: Variant) -> Variant:
        """The variant at those numbers of its shape that fit best."""
        reshaped = variant.reshaped
        if reshaped is None:
            return variant
        terms = [*self.law, *(term for step in steps for term in step.terms)]

        def misfit(scaled: np.ndarray) -> float:
            tried = reshaped([x * s for x, s in zip(scaled, sizes, strict=True)])
            columns = np.hstack([base, self.rows.fresh(tried.terms)])
            norms = sizes_of(columns)
            weights = np.linalg.lstsq(columns / norms, self.rows.y, rcond=1e-10)[0]
            return float(np.sum((self.rows.y - columns / norms @ weights) ** 2))

        base = self.rows.columns(terms)
        sizes = [abs(each) or 1.0 for each in variant.shape]
        start = np.array([x / s for x, s in zip(variant.shape, sizes, strict=True)])
        corner = np.vstack([start, *(start + 0.1 * np.eye(start.size))])
        found = minimize(
            misfit, start, method="Nelder-Mead", options={"initial_simplex": corner, "maxfev": 60, "xatol": 1e-4}
        )
        return reshaped([x * s for x, s in zip(found.x, sizes, strict=True)])

    def pruned(self, steps: list[Step]) -> list[Step]:
        """Without mechanisms that later ones have made needless: those that would not be added to the others now."""
        while len(steps) > 1:
            final = self.fitted(steps)
            least = self.floor(final) ** 2
            local = any(term.local for term in final.terms)
            shares = []
            for step in steps:
                without = self.fitted([each for each in steps if each is not step], local=local).mean_square
                shares.append((without - final.mean_square) / max(without - least, 1e-300))
            needless = int(np.argmin(shares))
            if shares[needless] >= WORTH:
                break
            step = steps[needless]
            self.rejected[step.variant.mechanism] = step.gain, "is not needed beside the others"
            steps = [each for each in steps if each is not step]
        return steps

    def rest(self, steps: Sequence[Step]) -> Rest:
        """What the law and the mechanisms leave, and what it looks like."""
        now = self.fitted(steps)
        least = self.floor(now)
        there = set(now.terms)
        whole = Variant("flexible", self.flexible, text="it depends on position and speed")
        scores, needed, _ = scored(self.rows, now.terms, [*self.outside, whole], self.noise, self.rng)
        shapes = []
        seen = set()
        for score in scores:
            variant = score.variant
            if variant.mechanism in seen or score.gain <= needed:
                continue
            seen.add(variant.mechanism)
            extra = [term for term in variant.terms if term not in there]
            share = 1.0 - self.fitted(steps, extra).mean_square / now.mean_square
            if share > WORTH / 2:
                shapes.append((variant.text, score.gain / needed, share))
        shapes.sort(key=lambda each: -each[2])
        excess = max(now.mean_square - least**2, 0.0)
        lines = []
        for i, body in enumerate(self.rows.bodies):
            tone = line(body, now.left[self.rows.owner == i], len(self.rows.bodies))
            lines += [(body.name, *tone)] if tone else []
        return Rest(math.sqrt(excess), now.mean_square / least**2, shapes, lines)


def _unphysical(made: Fitted, count: int) -> str:
    """Which constant of the law a mechanism would turn round, in a sentence, or nothing."""
    spreads = made.spreads()
    for term in made.terms[:count]:
        value = made.constants()[term.name]
        if term.name not in ("offset", "timing") and value < -SURE * spreads[term.name]:
            return f"the {term.name} would have to be negative beside it"
    return ""


def line(body: Body, left: np.ndarray, recordings: int = 1) -> tuple[float, float] | None:
    """Hz and share of the power of a frequency that stands far out of what is left of a recording, if one does.

    One at which the body mostly moves is not meant: whatever depends on the motion has it.

    Args:
        body: The recording.
        left: (rows kept,) what is left.
        recordings: How many are looked at: chance must not find one among all of them.
    """
    signal = np.zeros(body.keep.size)
    signal[body.keep] = left
    if signal.size < LEAST_LINE or body.rate < 2.0 * body.edge * body.every:
        return None
    power, *motions = (
        np.abs(np.fft.rfft(each * np.hanning(each.size))) ** 2
        for each in (signal, body.velocity, np.abs(body.velocity) - np.abs(body.velocity).mean())
    )
    own = np.maximum(*(np.convolve(each, np.ones(3), mode="same") / each[1:].sum() for each in motions)) > MOVES
    around = median_filter(power, 41, mode="nearest")
    needed = math.log(power.size * recordings / 1e-4) / math.log(2.0)
    stands = (power > needed * around) & ~own
    stands[:3] = stands[-3:] = False
    top = int(np.argmax(np.where(stands, power, 0.0)))
    share = float(power[top - 2 : top + 3].sum() / power[1:].sum()) if stands[top] else 0.0
    if share < WORTH:
        return None
    # a parabola through the logarithms of a peak gives its place between the lines
    low, high, below = np.log(power[[top - 1, top, top + 1]] + 1e-300)
    top += 0.5 * (low - below) / (low - 2 * high + below)
    return top * body.rate / body.every / signal.size, share


def named(search: Search) -> list[Step]:
    """The mechanisms that the recordings ask for."""
    steps: list[Step] = []
    while len(steps) < MOST:
        step = search.next(steps)
        if step is None:
            break
        search.say(f"{step.variant.mechanism}: explains {100 * step.share:.0f} % of what was left")
        steps.append(step)
    return search.pruned(steps)
