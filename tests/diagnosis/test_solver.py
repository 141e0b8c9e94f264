"""The solver on problems whose answers are known without it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
import pytest
from scipy.linalg import cho_solve

from drillenv.diagnosis.fitting import SHORT, fit_to, reinitialise_outliers
from drillenv.diagnosis.solver import Fit, Limits, Priors, Quadratic, factor, minimise, within_box

if TYPE_CHECKING:
    from drillenv.diagnosis.terms import ModelStructure


@dataclass
class Residuals:
    """A block from residuals and their derivatives by finite differences of a function that is smooth."""

    function: Callable[[np.ndarray, np.ndarray], np.ndarray]

    def cost(self, shared, own):
        """Half the sum of squares."""
        residual = self.function(shared, own)
        return 0.5 * float(residual @ residual) if np.all(np.isfinite(residual)) else np.inf

    def quadratic(self, shared, own):
        """The same with derivatives."""
        both = np.concatenate([own, shared])
        residual = self.function(shared, own)
        columns = []
        for i in range(both.size):
            step = 1e-6 * max(1.0, abs(both[i]))
            ahead, behind = both.copy(), both.copy()
            ahead[i] += step
            behind[i] -= step
            one, two = (self.function(each[own.size :], each[: own.size]) for each in (ahead, behind))
            columns.append((one - two) / (2.0 * step))
        a, b = np.array(columns[: own.size]).reshape(own.size, residual.size), np.array(columns[own.size :])
        return Quadratic(
            0.5 * float(residual @ residual),
            a @ residual,
            b @ residual,
            a @ a.T,
            a @ b.T,
            b @ b.T,
            np.sum(a**2, axis=1),
        )

    def try_step(self, shared, own, move, before):
        """The whole step."""
        return self.cost(shared, own + move), own + move

    def inner_steps(self, shared, tried, before):
        """As it is."""
        return tried


def free(size, centre=None, precision=None, low=None):
    """Priors that say nothing but what is given."""
    return Priors(
        np.zeros(size) if centre is None else centre,
        np.zeros(size) if precision is None else precision,
        np.full(size, -np.inf) if low is None else low,
        np.full(size, np.inf),
    )


def linear(rng, blocks=5, own=4, shared=3, rows=30):
    """Blocks of linear residuals, and the stacked matrix and right side."""
    parts = [
        (rng.normal(size=(rows, own)), rng.normal(size=(rows, shared)), rng.normal(size=rows)) for _ in range(blocks)
    ]
    made = [Residuals(lambda p, x, a=a, b=b, r=r: a @ x + b @ p - r) for a, b, r in parts]
    whole = np.zeros((blocks * rows, blocks * own + shared))
    for i, (a, b, _) in enumerate(parts):
        whole[i * rows : (i + 1) * rows, i * own : (i + 1) * own] = a
        whole[i * rows : (i + 1) * rows, blocks * own :] = b
    return made, whole, np.concatenate([r for _, _, r in parts])


def test_a_linear_problem_is_solved_as_by_dense_least_squares():
    made, whole, right = linear(np.random.default_rng(1))
    found = minimise(made, np.zeros(3), [np.zeros(4)] * 5, free(3), Limits(30, 1e-12))
    dense = np.linalg.lstsq(whole, right, rcond=None)[0]
    assert found.converged
    assert found.shared == pytest.approx(dense[-3:], abs=1e-6)
    assert np.concatenate(found.own) == pytest.approx(dense[:-3], abs=1e-6)
    assert found.cost == pytest.approx(0.5 * np.sum((whole @ dense - right) ** 2))
    assert found.covariance == pytest.approx(np.linalg.inv(whole.T @ whole)[-3:, -3:], rel=1e-6)


def test_priors_and_bounds():
    made, whole, right = linear(np.random.default_rng(2))
    precision, centre = np.array([3.0, 0.0, 5.0]), np.array([1.0, 0.0, -1.0])
    found = minimise(
        made, np.zeros(3), [np.zeros(4)] * 5, free(3, centre=centre, precision=precision), Limits(30, 1e-12)
    )
    extra = np.zeros((3, whole.shape[1]))
    extra[:, -3:] = np.diag(precision)
    dense = np.linalg.lstsq(np.vstack([whole, extra]), np.concatenate([right, precision * centre]), rcond=None)[0]
    assert found.shared == pytest.approx(dense[-3:], abs=1e-6)
    low = np.array([dense[-3] + 0.1, -np.inf, -np.inf])
    bound = minimise(made, np.zeros(3), [np.zeros(4)] * 5, free(3, low=low), Limits(60, 1e-12))
    assert bound.shared[0] == low[0]


def van_der_pol(mu, state, steps, h):
    """Positions over the steps, and the state behind them, by the classical Runge-Kutta method."""

    def rates(y):
        return np.array([y[1], mu * (1.0 - y[0] ** 2) * y[1] - y[0]])

    said = []
    for _ in range(steps):
        said.append(state[0])
        k1 = rates(state)
        k2 = rates(state + 0.5 * h * k1)
        k3 = rates(state + 0.5 * h * k2)
        state = state + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + rates(state + h * k3))
    return np.array(said), state


@pytest.mark.slow
def test_van_der_pol_by_multiple_shooting():
    h, steps, windows, noise = 0.05, 25, 8, 0.02
    pulls = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        state, measured = np.array([1.0, 0.0]), []
        for _ in range(windows):
            said, state = van_der_pol(1.3, state, steps, h)
            measured.append(said + rng.normal(0.0, noise, steps))

        def residual(p, x, measured=measured):
            begin, rows = x.reshape(windows, 2), []
            for i in range(windows):
                said, end = van_der_pol(p[0], begin[i], steps, h)
                rows.append((said - measured[i]) / noise)
                if i + 1 < windows:
                    rows.append((begin[i + 1] - end) / 1e-3)
            return np.concatenate(rows)

        begin = np.array([[each[0], (each[1] - each[0]) / h] for each in measured]).ravel()
        found = minimise([Residuals(residual)], np.array([2.6]), [begin], free(1), Limits(60, 1e-6))
        pulls.append((found.shared[0] - 1.3) / np.sqrt(found.covariance[0, 0]))
    assert np.max(np.abs(pulls)) < 3.5
    assert 0.3 < np.std(pulls) < 2.0


def test_a_bouncing_ball():
    rng, g, e, noise = np.random.default_rng(3), 9.81, 0.8, 1e-3
    speeds = 3.0 * e ** np.arange(6)
    times = [np.linspace(0.0, 2.0 * v / g, 40, endpoint=False) for v in speeds]
    heights = [v * t - 0.5 * g * t**2 + rng.normal(0.0, noise, t.size) for v, t in zip(speeds, times, strict=True)]

    def residual(p, x):
        rows = [(v * t - 0.5 * p[0] * t**2 - y) / noise for v, t, y in zip(x, times, heights, strict=True)]
        rows.append((x[1:] - p[1] * x[:-1]) / 1e-4)
        return np.concatenate(rows)

    found = minimise([Residuals(residual)], np.array([5.0, 0.5]), [np.full(6, 2.0)], free(2), Limits(60, 1e-9))
    spread = np.sqrt(np.diag(found.covariance))
    assert abs(found.shared[0] - g) < 4.0 * spread[0]
    assert abs(found.shared[1] - e) < 4.0 * spread[1]


def test_a_steep_unknown_does_not_hold_back_the_others():
    """As where a contact is grazed, and what comes after depends on the state before by many powers of ten."""
    curvature = np.array([1e26, 1.0, 1e-3])
    part = Quadratic(
        0.0, curvature.copy(), np.zeros(0), np.diag(curvature), np.zeros((3, 0)), np.zeros((0, 0)), curvature
    )
    assert np.allclose(cho_solve(factor(part, 0.0), part.by_own), 1.0, rtol=1e-6)


def test_what_data_do_not_tell_is_anywhere_within_its_bounds():
    """As the end of a play that no motion comes to: it is not known exactly."""
    noise = np.random.default_rng(5).normal(0.0, 1.0, 400)
    within = Priors(np.zeros(2), np.zeros(2), np.array([-np.inf, 1.0]), np.array([np.inf, 4.0]))
    found = minimise([Residuals(lambda p, x: p[0] - 3.0 + noise)], np.array([0.0, 2.0]), [np.zeros(0)], within)
    assert np.sqrt(np.diag(found.covariance)) == pytest.approx([0.05, 3.0 / math.sqrt(12.0)], rel=1e-6)


def test_over_dispersion_makes_priors_weightier():
    rng = np.random.default_rng(5)
    noise = rng.normal(0.0, 10.0, 400)
    data = Residuals(lambda p, x: p[0] - 3.0 + noise)
    plain = minimise([data], np.zeros(1), [np.zeros(0)], free(1, precision=np.ones(1)))
    scaled = minimise([data], np.zeros(1), [np.zeros(0)], free(1, precision=np.ones(1)), samples=400)
    assert abs(plain.shared[0] - 3.0 + noise.mean()) < 0.05
    assert abs(scaled.shared[0]) < abs(plain.shared[0])


def test_what_over_dispersed_data_do_not_tell_is_known_as_stated():
    """With over-dispersion, the standard deviation of a parameter that no residual depends on is that of its prior."""
    noise = np.random.default_rng(5).normal(0.0, 10.0, 400)
    data = Residuals(lambda p, x: p[0] - 3.0 + noise)
    found = minimise([data], np.zeros(2), [np.zeros(0)], free(2, precision=np.array([0.0, 0.5])), samples=400)
    over = found.priors.dispersion
    assert over == pytest.approx(100.0, rel=0.2)
    assert np.sqrt(over * np.diag(found.covariance)) == pytest.approx([np.sqrt(over / 400.0), 2.0])


def test_an_infinite_cost_is_no_end():
    def residual(p, x):
        return np.array([np.log(p[0]) * 5.0, p[0] - 2.0]) if p[0] > 0.0 else np.array([np.inf, 0.0])

    found = minimise([Residuals(residual)], np.array([0.05]), [np.zeros(0)], free(1), Limits(80, 1e-9))
    assert 1.0 < found.shared[0] < 1.2


@dataclass
class Restarted:
    """A block of one sample that notes each reinitialisation, none of which succeeds."""

    tries: list[bool]
    samples: int = 1

    def reinitialise_outliers(self, shared, own, outlying):
        """In vain."""
        self.tries.append(outlying)
        return own


def test_a_reinitialisation_that_failed_is_not_repeated():
    """Until the block's cost has changed by a tenth, or it has come to stand out among the others."""
    blocks = [Restarted([]), Restarted([]), Restarted([])]
    own = [np.zeros(1) for _ in blocks]
    failed = [None] * 3
    for costs in ([1.0, 1.0, 3.9], [1.0, 1.05, 3.8], [1.0, 1.5, 4.1]):
        fit = Fit(np.zeros(0), own, sum(costs), math.inf, costs, [], np.zeros((0, 0)), True, free(0))
        found, failed = reinitialise_outliers(blocks, fit, failed, None)
        assert all(one is other for one, other in zip(found, own, strict=True)) and None not in failed
    assert [each.tries for each in blocks] == [[False], [False, False], [False]]
    costs = [1.0, 1.0, 4.1]
    fit = Fit(np.zeros(0), own, sum(costs), math.inf, costs, [], np.zeros((0, 0)), True, free(0))
    reinitialise_outliers(blocks, fit, failed, None)
    assert blocks[2].tries == [False, True]


class Counted(Residuals):
    """A block whose reinitialisations are counted."""

    samples, slack, noise, tried = 10, 1.0, None, 0

    def under(self, structure, own, slack, noise):
        """As it is."""
        return self, own

    def reinitialise_outliers(self, shared, own, outlying):
        """In vain."""
        self.tried += 1
        return own


@pytest.mark.parametrize(("start", "tries"), [(0.0, 0), (3.0, 1)])
def test_states_are_not_reinitialised_where_a_fit_stayed_where_it_began(start, tries):
    """What stands out there did so in the fit before."""
    block = Counted(lambda p, x: np.append(1.0, p))
    only = SimpleNamespace(value=0.0, scale=1.0, std=np.inf, low=-9.0, high=9.0)
    structure = cast("ModelStructure", SimpleNamespace(unknowns=[only], scales=np.ones(1), start=np.zeros(1)))
    found = fit_to([block], [np.zeros(0)], structure, np.array([start]), None, SHORT)
    assert abs(found.fit.shared[0]) < 0.2
    assert block.tried == tries
    # nor twice in vain, though the next fit moves
    found.refit(start=np.array([0.5]), limits=Limits(20, 0.01))
    assert block.tried == 1


def test_a_step_that_fell_far_short_of_its_promise_is_no_convergence():
    """In the curved valley of H. H. Rosenbrock, Computer Journal 3 (1960) 175-184; a fit that ends there is at 5.8."""
    valley = Residuals(lambda p, x: np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0]]))
    found = minimise([valley], np.array([-3.0, 9.0]), [np.zeros(0)], free(2), Limits(80, 0.5))
    assert found.converged
    assert found.cost < 1.0


@pytest.mark.parametrize("seed", range(5))
def test_a_step_within_the_box_is_the_best_there_is(seed):
    rng = np.random.default_rng(seed)
    k = 6
    spread = rng.normal(size=(k, k)) * np.geomspace(1.0, 1e4, k)  # parameters of unlike sizes, correlated
    hessian, gradient = spread.T @ spread, spread.T @ rng.normal(size=k)
    newton = -np.linalg.solve(hessian, gradient)
    half = np.abs(newton) * rng.uniform(0.2, 3.0, k)
    box = Priors(np.zeros(k), np.zeros(k), -half, half)

    step = within_box(gradient, hessian, box, np.zeros(k))

    assert np.any(np.abs(newton) > half), "the case has to be one of a box that Newton's step leaves"
    assert np.all(np.abs(step) <= half * (1 + 1e-12))
    # what is left of the gradient presses outward where the box ends, and is none elsewhere
    left, size = gradient + hessian @ step, np.sqrt(np.diag(hessian))
    inside = np.abs(step) < half * (1 - 1e-9)
    assert np.allclose(left[inside] / size[inside], 0.0, atol=1e-6)
    assert np.all(left[~inside] * step[~inside] <= 0.0)


def test_bounds_on_one_of_two_parameters_that_are_correlated_are_no_end():
    # the sum is known much better than the difference: one that is cut off at its bound leaves the other wrong
    block = Residuals(lambda p, _x: np.array([10.0 * (p[0] + p[1] - 1.0), p[0] - p[1] - 9.0]))
    box = Priors(np.zeros(2), np.zeros(2), np.array([-0.5, -50.0]), np.array([0.5, 50.0]))

    fit = minimise([block], np.zeros(2), [np.zeros(0)], box, Limits(50, 1e-9))

    assert fit.converged
    assert fit.shared == pytest.approx([0.5, 41.5 / 101.0], abs=1e-6)
