"""Hypotheses with one mechanism more, and where their fit begins."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from drillenv.diagnosis.candidates import FREED, own_parameters, parameter, usual
from drillenv.diagnosis.condition import Conditioned
from drillenv.diagnosis.fit import Fit, Hypothesis
from drillenv.diagnosis.screen import Score
from drillenv.diagnosis.shooting import Physics, joints, predict
from drillenv.dynamics.effects import REGISTRY

LINEAR = {
    "chi", "h", "soft", "s_r", "k3", "c2", "fc1", "fc2", "k_a", "m_c", "delay_e", "delay_f", "delay_a",
    "o_f", "o_a", "g",
}  # fmt: skip
"""Symbols whose strength grows from nothing in proportion to the probe."""
SQUARED = {"s"}
"""Symbols that act by their square."""
GROWING = LINEAR | SQUARED | {"n", "h2", "h3", "o_e", "b_f", "b_a", "b_e"}
"""Symbols that say how strong an effect is, 0 (or 1, of an exponent) where it is not there."""
SLIGHT = 0.25
"""Share of the least usual strength below which a mechanism is slight."""


def extended(now: Fit, score: Score, recordings: Sequence[Conditioned]) -> tuple[Hypothesis, np.ndarray]:
    """The fit's hypothesis with one mechanism more, and values to start from."""
    variant = score.variant
    mechanism, count = variant.mechanism, len(variant.probes)
    start = dict(variant.held)
    sizes = score.strengths.tolist()
    for i, probe in enumerate(() if variant.own else variant.probes):
        for symbol, value in probe:
            if symbol in LINEAR:
                start[symbol] = start.get(symbol, 0.0) + value * sizes[i]
            elif symbol in SQUARED:
                start[symbol] = value * math.sqrt(max(sizes[i], 0.0))
            elif symbol == "n":
                start[symbol] = 1.0 + (value - 1.0) * sizes[i]
            elif symbol not in start:
                start[symbol] = value
    if mechanism == "drive-harmonics":
        start = _polar(score.strengths)
    entries = {each.symbol: each for each in REGISTRY[mechanism].parameters}
    probed = () if variant.own else tuple(dict.fromkeys(name for probe in variant.probes for name, _ in probe))
    symbols = FREED.get(mechanism, probed)
    free = []
    for symbol in symbols:
        value = start[symbol]
        if symbol in LINEAR and entries[symbol].low >= 0.0:
            value = max(value, 0.5 * usual(mechanism, symbol)[0])
        free.append(parameter(mechanism, symbol, value))
    values = [each.value for each in free]
    held = tuple((name, value) for name, value in variant.held if name not in symbols)
    for i, data in enumerate(recordings):
        each = own_parameters(mechanism, data, score.strengths[count * i : count * (i + 1)] if variant.own else None)
        free += each
        values += [own.value for own in each]
    base = now.hypothesis
    count = len(base.constants)
    moved = now.values.copy()
    centre = np.array([each.value for each in base.constants])
    widths = np.array([each.width for each in base.constants])
    step = score.constants[:count] * widths
    moved[:count] = np.clip(now.values[:count] + step, centre - 4 * widths, centre + 4 * widths)
    hypothesis = Hypothesis(base.constants, (*base.effects, (mechanism, held, tuple(free))))
    return hypothesis, np.concatenate([moved, values])


def _polar(strengths: np.ndarray) -> dict[str, float]:
    """Amplitude and phase of two harmonics from their sine and cosine parts, in hundredths."""
    sine2, cosine2, sine3, cosine3 = (0.01 * strengths).tolist()
    return {
        "h2": math.hypot(sine2, cosine2),
        "phi2": math.atan2(cosine2, sine2),
        "h3": math.hypot(sine3, cosine3),
        "phi3": math.atan2(cosine3, sine3),
    }


def placed_at(
    hypothesis: Hypothesis, mechanism: str, place: Mapping[str, float], recordings: Sequence[Conditioned]
) -> tuple[Hypothesis, np.ndarray]:
    """A hypothesis with one mechanism more at given strengths, and values to start from."""
    own = tuple(each for data in recordings for each in own_parameters(mechanism, data))
    free = tuple(parameter(mechanism, symbol, value) for symbol, value in place.items()) + own
    extended = hypothesis._replace(effects=(*hypothesis.effects, (mechanism, (), free)))
    return extended, np.array([each.value for each in extended.parameters])


def opened(states: np.ndarray, physics: Physics, data: Conditioned, place: Mapping[str, float]) -> np.ndarray:
    """States in which a spring that has play carries the force that it carried without."""
    k, opened = physics.rig.stiffness, states.copy()
    beyond = (states[:, 0] - physics.rig.static_force(data.setting)) / k > place["y0"]
    opened[beyond, 0] += k * place["g"]
    return opened


def carried(states: np.ndarray, physics: Physics, data: Conditioned) -> np.ndarray:
    """States whose part of the shaker goes on, from window to window, where a model has it end.

    Raises:
        InputError: the motion could not be followed.
    """
    now, goes_on = states.copy(), joints(states)
    for _window in range(len(states)):
        # what changes in one window reaches the next; what the indenter does is left as measured
        ends = predict(data, now, physics).ends[:-1, goes_on]
        if np.array_equal(ends, now[1:, goes_on]):
            break
        now[1:, goes_on] = ends
    return now


def holding(hypothesis: Hypothesis, fixed: Mapping[str, float]) -> tuple[Hypothesis, np.ndarray]:
    """A hypothesis with some parameters of its effects held, by name, and which of the unknowns remain."""
    effects = []
    for name, held, free in hypothesis.effects:
        gone = tuple((each.symbol, fixed[each.name]) for each in free if each.name in fixed)
        effects.append((name, held + gone, tuple(each for each in free if each.name not in fixed)))
    kept = np.array([each.name not in fixed for each in hypothesis.parameters])
    return hypothesis._replace(effects=tuple(effects)), kept


def from_nothing(fitted: Fit, mechanism: str) -> list[float]:
    """By how many standard deviations a mechanism's strengths differ from nothing, those that grow from it.

    The rest of its parameters are held: near nothing they say little, and would make any strength uncertain.
    """
    strengths = _strengths(fitted, mechanism)
    shape = np.array([each.mechanism == mechanism for each in fitted.hypothesis.parameters])
    shape[list(strengths)] = False
    width = fitted.spread_beside(shape)
    return [far / float(width[i]) for i, (_symbol, _neutral, far) in strengths.items()]


def slight(fitted: Fit, mechanism: str) -> bool:
    """Whether all strengths of a mechanism are far below what is usual, however sure they seem."""
    return all(
        far < SLIGHT * min(abs(limit - neutral) for limit in usual(mechanism, symbol))
        for symbol, neutral, far in _strengths(fitted, mechanism).values()
    )


def _strengths(fitted: Fit, mechanism: str) -> dict[int, tuple[str, float, float]]:
    """Symbol, neutral value and distance from it of a mechanism's strengths, by their place among the parameters."""
    found = {}
    for i, each in enumerate(fitted.hypothesis.parameters):
        if each.mechanism == mechanism and each.symbol in GROWING:
            neutral = REGISTRY[mechanism].parameter(each.symbol).neutral
            found[i] = each.symbol, neutral, abs(float(fitted.values[i]) - neutral)
    return found


def leaving_out(hypothesis: Hypothesis, mechanism: str) -> tuple[Hypothesis, np.ndarray]:
    """A hypothesis without one of its mechanisms, and which of the unknowns remain."""
    effects = tuple(each for each in hypothesis.effects if each[0] != mechanism)
    kept = np.array([each.mechanism != mechanism for each in hypothesis.parameters])
    return hypothesis._replace(effects=effects), kept
