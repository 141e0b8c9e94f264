"""How often the 95 % intervals of an indentation test hold the truth: made curves of known laws.

    python -m benchmarks.indentation --curves 200 --seed 3000

Laws, scatter, noise, drift, holds, compliance and the number of indentations are drawn anew for each curve
(``tests/indentation/made.py``).
"""

from __future__ import annotations

import argparse
from collections import defaultdict

import numpy as np

from drillenv import fit_indentation
from drillenv.indentation import Curve
from tests.indentation.made import drawn


def main() -> None:
    """Print the coverage of each quantity."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--curves", type=int, default=200)
    parser.add_argument("--seed", type=int, default=3000)
    given = parser.parse_args()
    inside, deviations = defaultdict(list), defaultdict(list)
    wrong = 0
    for seed in range(given.seed, given.seed + given.curves):
        rng = np.random.default_rng(seed)
        made = drawn(rng)
        time, displacement, force, _ = made.make(rng)
        test = fit_indentation(Curve(time, displacement, force), made.compliance)
        wrong += len(test.measured) != len(made.loading)
        wrong += any((one.hold is not None) != (made.hold > 0) for one in test.measured)
        for name, estimate, truth in _quantities(made, test):
            inside[name].append(estimate.low <= truth <= estimate.high)
            deviations[name].append((estimate.value - truth) / estimate.std)
    print(f"{given.curves} curves, {wrong} with another number of indentations or another hold")
    for name, found in inside.items():
        z = np.array(deviations[name])
        print(f"{name:<12} {len(found):5} inside {np.mean(found):.3f}  deviation {z.mean():+.2f} +- {z.std():.2f}")


def _quantities(made, test):
    """Name, estimate and truth of all that was estimated."""
    early = test.phases.early
    for j, one in enumerate(test.measured):
        truth = made.truth(j)
        for way, branch in enumerate((one.loading, one.unloading)):
            letter = "lu"[way]
            yield f"k_{letter}", branch.stiffness, truth[f"k_{letter}"]
            yield f"n_{letter}", branch.exponent, truth[f"n_{letter}"]
            yield f"k N/m^n _{letter}", branch.coefficient, made.coefficient(j, way)
            yield f"origin_{letter}", branch.origin, made.origins[j][way]
        if one.creep is not None:
            yield "creep", one.creep, made.creep
        if j < early:
            for letter, factor in (("l", one.loading_factor), ("u", one.unloading_factor)):
                stable = np.mean([made.truth(i)[f"k_{letter}"] for i in range(early, len(test.measured))])
                yield f"factor_{letter}", factor, truth[f"k_{letter}"] / stable
    for symbol in test.stable:
        stable = np.mean([made.truth(j)[symbol] for j in range(early, len(test.measured))])
        yield f"stable {symbol}", test.stable[symbol].mean, stable


if __name__ == "__main__":
    main()
