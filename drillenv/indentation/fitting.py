"""The rock of a quasi-static indentation test: each indentation's laws, what the stable ones share, and the drifts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from drillenv.checks import InputError, number
from drillenv.indentation import parts
from drillenv.indentation.branches import (
    Estimate,
    Fit,
    Floats,
    Law,
    Samples,
    block_means,
    first_law,
    fit_law,
    positive,
    residual_of,
    symmetric,
)
from drillenv.indentation.drifts import Drift, Zero, find_drift, find_standing, find_zero, free_residuals
from drillenv.indentation.noise import Channel, Noise, estimate_noise
from drillenv.indentation.parts import Indentation, Window
from drillenv.indentation.phases import Common, Phases, combine, find_phases
from drillenv.indentation.reading import UNITS, Curve, read_curve
from drillenv.rocks import STIFFNESS_LIMITS, Indentations, Rock

COMPLIANCE_LIMITS = (0.0, 1e-5)
"""m/N"""
ROUNDS = 3
"""Of fitting laws and noise in turns."""
MOST_FOR_NOISE = 6
"""Indentations from which the noise, common to all, is estimated."""
RELAXED = 0.97
"""Share of the peak force below which the end of a hold counts as relaxed."""
UNCERTAIN = 0.5
"""Relative standard deviation above which a stiffness is none."""


class Branch(NamedTuple):
    """Loading or unloading of one indentation."""

    law: Law
    stiffness: Estimate
    """N/m, of the line nearest to the law between 20 and 100 % of the peak force: what the drilling model takes."""
    coefficient: Estimate
    """k of F = k (d - d_0)^n in N/m^n."""
    exponent: Estimate
    origin: Estimate
    """d_0 in m as the file counts displacement, less the machine's: first contact, or residual depth."""
    shared: dict[str, Floats]
    """(errors,) by how much errors of zero and drift, which the indentations share, move stiffness and exponent."""

    def own_std(self, quantity: str) -> float:
        """Standard deviation of ``stiffness`` or ``exponent`` without what all indentations share."""
        total = getattr(self, quantity).std
        return float(np.sqrt(max(total**2 - self.shared[quantity] @ self.shared[quantity], 1e-6 * total**2)))


class Measured(NamedTuple):
    """One indentation."""

    phase: str
    """impact, compression or stable."""
    loading: Branch
    unloading: Branch
    loading_factor: Estimate
    """k_l over that of the stable indentations."""
    unloading_factor: Estimate
    peak_force: float
    """N"""
    hold: float | None
    """Seconds (samples, without a time) at the peak, None where the load was not held."""
    creep: Estimate | None
    """m by which the indenter went on there."""
    place: Indentation
    window: Window


@dataclass(frozen=True, slots=True)
class IndentationTest:
    """What an indentation test says of a rock."""

    curve: Curve
    compliance: float | None
    """Of the machine in m/N, None where none was given."""
    measured: tuple[Measured, ...]
    phases: Phases
    stable: dict[str, Common]
    """What the stable indentations share: k_l and k_u in N/m, n_l and n_u."""
    zeros: tuple[Zero, ...]
    """The force out of contact; of each indentation its own where the file numbers them."""
    drift: Drift
    """Of the displacement."""
    noise: Noise
    depth: Floats
    """(samples,) m: the displacement without drift and compliance."""
    force: Floats
    """(samples,) N, without its zero."""
    warnings: tuple[str, ...]

    def rock(self, name: str | None = None) -> Rock:
        """The rock, of the stable indentations. The spreads are the scatter between them.

        Raises:
            InputError: k_u is below k_l, or a stiffness is outside 1e5 to 1e9 N/m.
        """
        loading, unloading = self.stable["k_l"], self.stable["k_u"]
        each = Indentations(
            tuple(one.loading.stiffness.value for one in self.measured),
            tuple(one.unloading.stiffness.value for one in self.measured),
            self.phases.early,
        )
        return Rock(
            loading.mean.value,
            unloading.mean.value,
            Path(self.curve.name).stem if name is None else name,
            _spread(loading),
            _spread(unloading),
            indentations=each,
        )

    def record(self) -> dict[str, Any]:
        """All of it, for JSON."""
        from drillenv.indentation.report import record_of

        return record_of(self)

    def text(self) -> str:
        """All of it, for people."""
        from drillenv.indentation.report import text_of

        return text_of(self)

    def plot(self, path: str | Path) -> None:
        """Draw the curve with its fits to a .png, .pdf or .svg.

        Raises:
            InputError: another ending, or the file cannot be written.
        """
        from drillenv.indentation.drawing import draw

        draw(self, path)

    def write_rock(self, path: str | Path, name: str | None = None) -> None:
        """Write a rock file, which --rock and :func:`drillenv.read_rock` take.

        Raises:
            InputError: these stiffnesses make no rock, or the file cannot be written.
        """
        from drillenv.rock_file import write_rock

        write_rock(path, self.rock(name), self.stable_record(), self.curve.name, self.curve.sha256)

    def stable_record(self) -> dict[str, Estimate]:
        """The means over the stable indentations, by the names of a rock file."""
        names = {
            "k_l": "loading_stiffness",
            "k_u": "unloading_stiffness",
            "n_l": "loading_exponent",
            "n_u": "unloading_exponent",
        }
        return {names[symbol]: common.mean for symbol, common in self.stable.items()}


def _spread(common: Common) -> float:
    """The scatter between indentations, 0 where it is less than a rock may have."""
    return common.scatter if common.scatter >= 1.1e-4 * common.mean.value else 0.0


class _Prepared(NamedTuple):
    """A curve in its parts, before anything is fitted."""

    found: list[Indentation]
    groups: list[list[int]]
    """Indentations that share a line of zero force."""
    free: list[list[slice]]
    """Of each group, parts out of contact."""
    windows: list[Window]
    standing: list[slice]
    """Where the machine stands still out of contact."""
    speed: float
    """Of loading in m/s."""


class _Fitted(NamedTuple):
    zeros: list[Zero]
    drift: Drift
    displacement: Floats
    """(samples,) m, without drift."""
    force: Floats
    """(samples,) N, without its zero."""
    fits: list[tuple[Fit, Fit]]
    noise: Noise


def fit_indentation(curve: str | Path | Curve, compliance: float | None = None) -> IndentationTest:
    """Fit the indentations of a curve.

    Args:
        curve: A csv file, as :mod:`drillenv.indentation.reading` describes it, or what was read from one.
        compliance: Of machine, load cell and indenter in m/N: what the displacement grows by per force beside the rock.
            Without it the stiffnesses are those of rock and machine in series.

    Raises:
        InputError: the curve cannot be read; it lacks a branch, a part out of contact or samples; its stiffness lies
            outside 1e5 to 1e9 N/m; the compliance is larger than that of the whole; or no power law fits a branch.
    """
    given = curve if isinstance(curve, Curve) else read_curve(curve)
    if compliance is not None:
        slips = [(1e-6, "mm/kN or um/N"), (1e-3, "mm/N")]
        compliance = number("compliance", compliance, *COMPLIANCE_LIMITS, "m/N", slips)
    prepared = _prepare(given)
    _check_stiffness(given, prepared, compliance or 0.0)
    fitted = _fit(given, prepared, compliance or 0.0)
    return _result(given, prepared, fitted, compliance)


def _prepare(curve: Curve) -> _Prepared:
    found = parts.find_indentations(curve)
    groups = [[i] for i in range(len(found))] if curve.number is not None else [list(range(len(found)))]
    free, zeros = [], []
    first_noise = Channel(parts.white_noise(curve.force) + 1e-9 * float(np.ptp(curve.force)), 0.0, 0.0)
    for group in groups:
        stretches = parts.out_of_contact(curve.force, [found[i] for i in group])
        if not any(part.stop - part.start >= parts.FEWEST_FREE for part in stretches):
            where = f" of indentation {group[0] + 1}" if len(groups) > 1 else ""
            raise InputError(
                f"no part{where} is free of contact: record {parts.FEWEST_FREE} samples or more before the indenter "
                "touches the rock and after it has left, which tell zero force and drift"
            )
        free.append(stretches)
        zeros.append(find_zero(curve.time, curve.force, stretches, first_noise))
    force = _without_zero(curve, found, groups, zeros)
    windows = [parts.find_window(i + 1, curve.displacement, force, each) for i, each in enumerate(found)]
    first = windows[0].loading
    speed = float(np.ptp(curve.displacement[first]) / np.ptp(curve.time[first]))
    standing = []
    if curve.number is None:
        standing = find_standing(curve.time, curve.displacement, free[0][0], free[-1][-1], speed)
    return _Prepared(found, groups, free, windows, standing, speed)


def _without_zero(curve: Curve, found: list[Indentation], groups: list[list[int]], zeros: Sequence[Zero]) -> Floats:
    force = curve.force.copy()
    for group, zero in zip(groups, zeros, strict=True):
        part = slice(found[group[0]].begin, found[group[-1]].end)
        force[part] -= zero.at(curve.time[part])
    return force


def _check_stiffness(curve: Curve, prepared: _Prepared, compliance: float) -> None:
    """Refuse a unit that makes no rock of it, and a compliance that leaves none."""
    branches = [part for window in prepared.windows for part in (window.loading, window.unloading)]
    stiffness = np.array([1.0 / _compliance_of(curve.displacement[p], curve.force[p]) for p in branches])
    low, high = STIFFNESS_LIMITS
    wrong = ~((stiffness >= low) & (stiffness <= high))
    if wrong.any():
        value = float(stiffness[np.argmax(wrong)])
        meant = []
        for kind, unit, power in (("displacement", curve.units[0], -1), ("force", curve.units[1], 1)):
            for other, factor in UNITS[kind].items():
                changed = value * (factor / UNITS[kind][unit]) ** power
                if other != unit and low <= changed <= high:
                    meant.append(f"with the {kind} in {other}, in place of {unit}, it would be {changed:.3g} N/m")
        advice = f" ({'; '.join(meant)})" if meant else ""
        raise InputError(
            f"the stiffness of {curve.name} reads {value:.3g} N/m, outside {low:g} to {high:g} N/m: "
            f"check the units of displacement and force{advice}"
        )
    stiffest = float(stiffness.max())
    if compliance * stiffest >= 0.95:
        raise InputError(
            f"compliance is {compliance:g} m/N, but rock and machine together have {1.0 / stiffest:.3g} m/N: "
            "give that of the machine alone, which is less"
        )


def _compliance_of(displacement: Floats, force: Floats) -> float:
    """Displacement by force of a branch in m/N; the noise of the displacement, the larger as a rule, bends it not."""
    return float(np.polyfit(force, displacement, 1)[0]) or 1e-30


# --- Fitting laws and noise in turns


def _fit(curve: Curve, prepared: _Prepared, compliance: float) -> _Fitted:
    count = len(prepared.found)
    noise, laws = _first_noise(curve, prepared), None
    fits: list[tuple[Fit, Fit]] = []
    zeros, force = [], curve.force
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_FOR_NOISE)).astype(int))
    drift, displacement = Drift(), curve.displacement
    for round_ in range(ROUNDS):
        zeros = [find_zero(curve.time, curve.force, free, noise.force) for free in prepared.free]
        force = _without_zero(curve, prepared.found, prepared.groups, zeros)
        drift, left = find_drift(curve.time, curve.displacement, prepared.standing, noise.displacement, prepared.speed)
        displacement = curve.displacement - drift.rate * (curve.time - curve.time[0])
        samples = [_samples(curve, prepared, zeros, drift, force, displacement, i) for i in range(count)]
        if laws is None:
            laws = [tuple(first_law(branch, compliance) for branch in pair) for pair in samples]
        fits = []
        for i, (pair, starts) in enumerate(zip(samples, laws, strict=True)):
            fits.append(_fit_pair(i, pair, compliance, noise, starts))
        laws = [(loading.law, unloading.law) for loading, unloading in fits]
        if round_ < ROUNDS - 1:
            for free, zero in zip(prepared.free, zeros, strict=True):
                left += free_residuals(curve.time, curve.force, free, zero)[: 2 * MOST_FOR_NOISE]
            for i in chosen:
                left += [residual_of(law, s, compliance) for law, s in zip(laws[i], samples[i], strict=True)]
            noise = estimate_noise(left, noise)
    return _Fitted(zeros, drift, displacement, force, fits, noise)


def _first_noise(curve: Curve, prepared: _Prepared) -> Noise:
    """White noise as seen from sample to sample, and some of it with a memory, to begin with."""
    channels = []
    for values, part in ((curve.force, None), (curve.displacement, prepared.windows[0].loading)):
        white = parts.white_noise(values if part is None else values[part])
        least = max(white, 1e-6 * float(np.ptp(values)))
        channels.append(Channel(least, 0.5 * least, 0.6))
    return Noise(*channels)


def _samples(
    curve: Curve,
    prepared: _Prepared,
    zeros: Sequence[Zero],
    drift: Drift,
    force: Floats,
    displacement: Floats,
    i: int,
) -> tuple[Samples, Samples]:
    """Loading and unloading of an indentation."""
    zero = zeros[next(k for k, group in enumerate(prepared.groups) if i in group)]
    pair = []
    for part in (prepared.windows[i].loading, prepared.windows[i].unloading):
        when, samples = block_means(curve.time, part)
        load, depth = block_means(force, part)[0], block_means(displacement, part)[0]
        # its mean only moves the origin
        drifted = drift.std * (when - when.mean())
        pair.append(Samples(samples, load, depth, zero.error(when), drifted))
    return pair[0], pair[1]


def _fit_pair(
    i: int, pair: tuple[Samples, Samples], compliance: float, noise: Noise, starts: Sequence[Law]
) -> tuple[Fit, Fit]:
    found = []
    for name, branch, start in zip(("loading", "unloading"), pair, starts, strict=True):
        try:
            found.append(fit_law(branch, compliance, noise, start))
        except InputError as error:
            raise InputError(f"the {name} branch of indentation {i + 1}: {error}; leave this indentation out") from None
    return found[0], found[1]


# --- What comes out


def _result(curve: Curve, prepared: _Prepared, fitted: _Fitted, compliance: float | None) -> IndentationTest:
    depth = fitted.displacement - (compliance or 0.0) * fitted.force
    peaks = [
        _peak(fits[0].law, fitted, curve.time, depth, place, window)
        for fits, place, window in zip(fitted.fits, prepared.found, prepared.windows, strict=True)
    ]
    branches = [
        _pair(curve, fits, peak, window, fitted.drift)
        for fits, peak, window in zip(fitted.fits, peaks, prepared.windows, strict=True)
    ]
    _check_certain(branches)
    loadings = [loading for loading, _ in branches]
    phases = find_phases([each.stiffness.value for each in loadings], [each.own_std("stiffness") for each in loadings])
    stable = _stable(branches[phases.early :])
    measured = []
    for i, ((loading, unloading), peak) in enumerate(zip(branches, peaks, strict=True)):
        window = prepared.windows[i]
        held = None if window.hold is None else _held(curve, window.hold, window)
        measured.append(
            Measured(
                "stable" if i >= phases.early else "impact" if i == 0 else "compression",
                loading,
                unloading,
                _factor(loading, stable["k_l"]),
                _factor(unloading, stable["k_u"]),
                peak.loading,
                held,
                None if held is None else _creep(fitted.fits[i], peak, fitted.drift.std * _apart(curve, window)),
                prepared.found[i],
                window,
            )
        )
    warnings = (*curve.notes, *_warnings(curve, prepared, fitted, compliance, phases))
    return IndentationTest(
        curve,
        compliance,
        tuple(measured),
        phases,
        stable,
        tuple(fitted.zeros),
        fitted.drift,
        fitted.noise,
        depth,
        fitted.force,
        warnings,
    )


def _pair(curve: Curve, fits: tuple[Fit, Fit], peak: _Peak, window: Window, drift: Drift) -> tuple[Branch, Branch]:
    """Loading and unloading, with what the drift may have moved their origins by until contact begins or ends."""
    begins, ends = curve.time[window.loading.start], curve.time[window.unloading.stop - 1]
    moved = [drift.std * float(when - curve.time[0]) for when in (begins, ends)]
    loading = _branch(fits[0], peak.loading, peak.std, moved[0])
    return loading, _branch(fits[1], peak.unloading, peak.std, moved[1])


def _branch(fit: Fit, peak: float, peak_std: float, drift_std: float) -> Branch:
    """What a fit says, with the force of its peak and what the drift may have moved it by in m."""
    law = fit.law
    # the line ends at the peak, which is known only so well
    by_peak = (np.log(law.stiffness(1.01 * peak)) - np.log(law.stiffness(peak))) / np.log(1.01) * peak_std / peak

    def estimate(quantity: Callable[[Law], float], more: float = 0.0) -> Estimate:
        value = quantity(law)
        return positive(value, float(np.hypot(fit.std(lambda each: np.log(quantity(each))), more)))

    quantities = {"stiffness": lambda each: each.stiffness(peak), "exponent": lambda each: each.exponent}
    return Branch(
        law,
        estimate(quantities["stiffness"], by_peak),
        estimate(lambda each: each.coefficient),
        estimate(quantities["exponent"]),
        symmetric(law.origin, float(np.hypot(fit.std_without_drift(lambda each: each.origin), drift_std))),
        {name: fit.gradient(quantity) @ fit.shared for name, quantity in quantities.items()},
    )


class _Peak(NamedTuple):
    """Force in N at which loading ends and unloading begins: less where it relaxed while the displacement was held."""

    loading: float
    unloading: float
    std: float


def _peak(law: Law, fitted: _Fitted, time: Floats, depth: Floats, place: Indentation, window: Window) -> _Peak:
    """The usual force of a hold, or the loading law where the lines of depth over time around the peak meet."""
    width = max(1, (place.end - place.begin) // 150)
    smooth = parts.smoothed(fitted.force[place.begin : place.end], width)
    highest = float(smooth.max())
    std = float(np.sqrt(fitted.noise.force.covariance(width, 1)[0, 0]))
    if window.hold is not None:
        held = fitted.force[window.hold]
        usual, last = float(np.median(held)), float(np.median(held[-max(3, held.size // 10) :]))
        if last < RELAXED * highest:
            return _relaxed(law, fitted, depth, place.begin + int(np.argmax(smooth)), width, last)
        return _Peak(usual, usual, float(np.sqrt(fitted.noise.force.covariance(held.size, 1)[0, 0])))
    loading, unloading = window.loading, window.unloading
    rise = slice(loading.stop - max(6, (loading.stop - loading.start) // 4), loading.stop)
    fall = slice(unloading.start, unloading.start + max(6, (unloading.stop - unloading.start) // 4))
    begin = time[rise.stop - 1]
    up, down = (np.polyfit(time[part] - begin, depth[part], 1) for part in (rise, fall))
    if up[0] > 0.0 > down[0]:
        at = (up[1] - down[1]) / (down[0] - up[0])
        deepest = float(np.polyval(up, at))
        force = float(law.at(np.array(deepest)))
        if -1.0 <= at / (time[fall.start] - begin) <= 2.0 and abs(force / highest - 1.0) < 0.05:
            shortest = min(rise.stop - rise.start, fall.stop - fall.start)
            depth_std = 2.0 * float(np.sqrt(fitted.noise.displacement.covariance(shortest, 1)[0, 0]))
            return _Peak(force, force, depth_std * float(law.slope(np.array(deepest))))
    return _Peak(highest, highest, std)


def _relaxed(law: Law, fitted: _Fitted, depth: Floats, top: int, width: int, last: float) -> _Peak:
    """The peak of a hold in which the force fell to ``last``: the loading law at the depth from ``top`` on."""
    reached = float(depth[top : top + width].mean())
    std = float(np.sqrt(fitted.noise.displacement.covariance(width, 1)[0, 0])) * float(law.slope(np.array(reached)))
    return _Peak(float(law.at(np.array(reached))), last, std)


def _held(curve: Curve, hold: slice, window: Window) -> float:
    """Seconds of a hold, without those that loading and unloading take near the peak."""
    step = float(np.ptp(curve.time[hold])) / (hold.stop - hold.start - 1)
    return float(np.ptp(curve.time[hold])) - step * parts.usual_stay(window.loading, window.unloading)


def _apart(curve: Curve, window: Window) -> float:
    """Seconds from the end of loading to the beginning of unloading."""
    return float(curve.time[window.unloading.start] - curve.time[window.loading.stop - 1])


def _creep(fits: tuple[Fit, Fit], peak: _Peak, drift_std: float) -> Estimate:
    """From where loading came to the peak to where unloading left it."""
    loading, unloading = fits
    value = unloading.law.depth(peak.unloading) - loading.law.depth(peak.loading)
    ends = (
        loading.std_without_drift(lambda law: law.depth(peak.loading)),
        unloading.std_without_drift(lambda law: law.depth(peak.unloading)),
    )
    # a force held is the same for both
    moved = peak.std / float(loading.law.slope(np.array(loading.law.depth(peak.loading))))
    relaxed = moved if peak.loading != peak.unloading else 0.0
    return symmetric(value, float(np.linalg.norm([*ends, drift_std, relaxed])))


def _factor(one: Branch, stable: Common) -> Estimate:
    """Over the stable stiffness; what both have in common cancels."""
    value, mean = one.stiffness.value, stable.mean.value
    return positive(value / mean, float(np.hypot(one.own_std("stiffness") / value, stable.own_std / mean)))


def _stable(branches: Sequence[tuple[Branch, Branch]]) -> dict[str, Common]:
    found = {}
    for way, letter in enumerate("lu"):
        for symbol, quantity in (("k", "stiffness"), ("n", "exponent")):
            found[f"{symbol}_{letter}"] = combine(
                [getattr(pair[way], quantity).value for pair in branches],
                [pair[way].own_std(quantity) for pair in branches],
                np.array([pair[way].shared[quantity] for pair in branches]),
            )
    return {symbol: found[symbol] for symbol in ("k_l", "k_u", "n_l", "n_u")}


def _check_certain(branches: Sequence[tuple[Branch, Branch]]) -> None:
    for i, pair in enumerate(branches, 1):
        for name, branch in zip(("loading", "unloading"), pair, strict=True):
            value, std = branch.stiffness.value, branch.stiffness.std
            if not std < UNCERTAIN * value:
                raise InputError(
                    f"the {name} stiffness of indentation {i} is {value:.3g} N/m with a standard deviation of "
                    f"{std:.3g} N/m: it cannot be told from this noise; sample more or load higher"
                )


def _warnings(
    curve: Curve, prepared: _Prepared, fitted: _Fitted, compliance: float | None, phases: Phases
) -> list[str]:
    found = []
    if compliance is None:
        found.append(
            "no compliance of the machine is given: the stiffnesses are those of rock and machine in series; "
            "give --compliance"
        )
    if not all(zero.seen for zero in fitted.zeros):
        found.append(
            "the force is out of contact once only: a drift of its zero is not corrected and not in the intervals"
        )
    if not fitted.drift.seen:
        found.append(
            "the machine does not stand still long enough out of contact: a drift of the displacement is not "
            "corrected and not in the intervals"
        )
    if not phases.tested:
        found.append(
            "fewer than 4 indentations: whether they are stable cannot be tested, all are taken to be; make ten or so"
        )
    elif len(prepared.found) - phases.early < 4:
        left = len(prepared.found) - phases.early
        found.append(f"the last {left} indentations are too few to test whether they are stable: make more")
    return found
