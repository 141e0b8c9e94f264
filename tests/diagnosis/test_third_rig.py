"""A rig from elsewhere, a driven van der Pol oscillator, is diagnosed through the adapter alone."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from drillenv.diagnosis.adapter import Adapter, RecordingProblem
from drillenv.diagnosis.fitting import TIGHT, fit_to
from drillenv.diagnosis.laws import Curve, Family, bsplines
from drillenv.diagnosis.selection import forward
from drillenv.diagnosis.tables import GRID, PLACES, Axes, interpolate
from drillenv.diagnosis.terms import ModelStructure, Term, Unknown

POSITION, SPEED = 0, 1
"""What laws of this rig are over."""
NOISE, MU = 0.02, 1.5


@dataclass
class Run:
    """Position, speed, drive and acceleration (n,), as sensors read them."""

    name: str
    x: np.ndarray
    v: np.ndarray
    drive: np.ndarray
    a: np.ndarray


@dataclass
class Oscillator(RecordingProblem):
    """x'' = mu (1 - x^2) x' - k x + u: what is measured of x'' less what that and laws say."""

    data: Run
    structure: ModelStructure
    slack: float
    noise: float

    @property
    def name(self):
        return self.data.name

    @property
    def samples(self):
        return self.data.a.size

    @property
    def power(self):
        return float(np.sum((self.data.a / self.noise) ** 2))

    @cached_property
    def columns(self):
        run, axes = self.data, self.structure.axes
        rows = [(1.0 - run.x**2) * run.v, -run.x]
        for term in self.structure.terms[1:]:
            rows += [interpolate(row, axes, term.place, (run.x, run.v)[term.place]) for row in term.basis]
        return np.array(rows)

    def residual(self, values):
        return (self.data.a - self.data.drive - values @ self.columns) / self.noise

    def jacobian(self, values):
        return self.columns / self.noise


class VanDerPol(Adapter):
    """The adapter: free laws over position and speed, and no library."""

    axes = Axes(np.full(PLACES, 1e4), np.full(PLACES, -4e-4), np.full(PLACES, 8e-4 / (GRID - 1)))

    def axes_at(self, fitted):
        return self.axes

    def laws(self, fitted, axes, detail):
        def family(name, place):
            basis = bsplines(6 * detail + 3)
            unknowns = tuple(Unknown(f"{name} {i}", 0.0, 0.1, 30.0) for i in range(len(basis)))
            return Family(name, name, (Curve(name, unknowns, place, basis),))

        return [family("restoring force", POSITION), family("drag", SPEED)]


def runs(missing, seed):
    """Four runs from other states by other drives."""
    rng, found = np.random.default_rng(seed), []
    for i in range(4):
        size, turn = rng.uniform(0.3, 1.2), rng.uniform(0.7, 1.6)

        def rates(t, y, size=size, turn=turn):
            x, v = y
            return v, MU * (1 - x**2) * v - x + size * np.sin(turn * t) + missing(x, v)

        t = np.linspace(0.0, 30.0, 600)
        x, v = solve_ivp(rates, (0.0, 30.0), rng.normal(size=2), t_eval=t, rtol=1e-9, atol=1e-9).y
        drive = size * np.sin(turn * t)
        a = MU * (1 - x**2) * v - x + drive + missing(x, v) + NOISE * rng.normal(size=t.size)
        found.append(Run(f"r{i}", x, v, drive, a))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("missing", "named"),
    [
        (lambda x, v: 0.0 * x, []),
        (lambda x, v: -0.2 * x**3, ["restoring force"]),
        (lambda x, v: -0.1 * v * abs(v), ["drag"]),
    ],
)
def test_a_rig_from_elsewhere_is_diagnosed(missing, named):
    missing = np.vectorize(missing)
    data, rig = runs(missing, 5), VanDerPol()
    constants = Term("constants", tuple(Unknown(name, value, 0.02, 0.02) for name, value in (("mu", MU), ("k", 1.0))))
    structure = ModelStructure((constants,), rig.axes, rig)
    with ThreadPoolExecutor(1) as pool:
        blocks = [Oscillator(run, structure, TIGHT, NOISE) for run in data]
        plain = fit_to(blocks, [np.zeros(0)] * 4, structure, None, pool)
        final, steps, _ = forward(plain)
    assert [step.named.mechanism for step in steps] == named
    assert final.reduced_chi_square == pytest.approx(1.0, abs=0.06)
    if named:
        assert plain.reduced_chi_square > 1.5
        (term,) = steps[0].terms
        x = np.quantile(np.concatenate([(run.x, run.v)[term.place] for run in data]), np.linspace(0.05, 0.95, 40))
        found = interpolate(final.values_of(term.name) @ term.basis, rig.axes, term.place, x)
        true = missing(x, x)
        straight = np.column_stack([np.ones(40), x])
        off = (found - true) - straight @ np.linalg.lstsq(straight, found - true)[0]
        assert np.sqrt(np.mean(off**2)) < 0.1 * np.std(true)
