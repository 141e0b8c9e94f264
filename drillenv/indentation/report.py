"""What an indentation test says, for people and as a record."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from drillenv.indentation.branches import Estimate

if TYPE_CHECKING:
    from drillenv.indentation.fitting import Branch, IndentationTest, Measured

FORMAT = "drillenv-indentation/1"


def _estimate(estimate: Estimate) -> dict[str, float]:
    return {name: float(value) for name, value in estimate._asdict().items()}


def _branch(branch: Branch) -> dict[str, Any]:
    return {
        "stiffness": _estimate(branch.stiffness),
        "coefficient": _estimate(branch.coefficient),
        "exponent": _estimate(branch.exponent),
        "origin": _estimate(branch.origin),
    }


def _measured(one: Measured) -> dict[str, Any]:
    return {
        "phase": one.phase,
        "peak_force": one.peak_force,
        "loading": _branch(one.loading),
        "unloading": _branch(one.unloading),
        "loading_factor": _estimate(one.loading_factor),
        "unloading_factor": _estimate(one.unloading_factor),
        "hold": one.hold,
        "creep": None if one.creep is None else _estimate(one.creep),
    }


def record_of(test: IndentationTest) -> dict[str, Any]:
    """All of it in SI, for JSON."""
    per = "s" if test.curve.timed else "sample"
    return {
        "format": FORMAT,
        "source": {"file": test.curve.name, "sha256": test.curve.sha256},
        "compliance": test.compliance,
        "stable": {
            symbol: {**_estimate(common.mean), "scatter": common.scatter} for symbol, common in test.stable.items()
        },
        "early": test.phases.early,
        "p_values": list(test.phases.p_values),
        "indentations": [_measured(one) for one in test.measured],
        "force_zero": [
            {
                "drift": zero.rate if zero.seen else None,
                "drift_std": float(np.sqrt(zero.covariance[1, 1])) if zero.seen else None,
                "unit": f"N/{per}",
            }
            for zero in test.zeros
        ],
        "displacement_drift": {
            "drift": float(test.drift.rate) if test.drift.seen else None,
            "drift_std": test.drift.std if test.drift.seen else None,
            "unit": f"m/{per}",
        },
        "noise": {"force": test.noise.force._asdict(), "displacement": test.noise.displacement._asdict()},
        "warnings": list(test.warnings),
    }


def text_of(test: IndentationTest) -> str:
    """All of it in lines."""
    stable = len(test.measured) - test.phases.early
    lines = [f"{test.curve.name}: {len(test.measured)} indentations, {stable} stable"]
    lines += [f"{'':>3}  {'phase':<11}  {'k_l [kN/mm]':>18}  {'k_u [kN/mm]':>18}  {'n_l':>14}  {'n_u':>14}  factors"]
    for i, one in enumerate(test.measured, 1):
        factors = f"{one.loading_factor.value:.3f}, {one.unloading_factor.value:.3f}"
        cells = [_plus_minus(branch.stiffness, 1e-6) for branch in (one.loading, one.unloading)]
        cells += [_plus_minus(branch.exponent, 1.0) for branch in (one.loading, one.unloading)]
        line = f"{i:>3}  {one.phase:<11}  {cells[0]:>18}  {cells[1]:>18}  {cells[2]:>14}  {cells[3]:>14}  {factors}"
        if one.creep is not None:
            line += f"; creep {_plus_minus(one.creep, 1e6)} um in a hold of {one.hold:.3g}"
            line += " s" if test.curve.timed else " samples"
        lines.append(line)
    for symbol, common in test.stable.items():
        scale, unit = (1e-6, " kN/mm") if symbol.startswith("k") else (1.0, "")
        mean = common.mean
        lines.append(
            f"{symbol} = {_plus_minus(mean, scale)}{unit}, 95 % {scale * mean.low:.4g} to {scale * mean.high:.4g}, "
            f"from one indentation to another {scale * common.scatter:.2g}"
        )
    lines += _drift_lines(test)
    return "\n".join([*lines, *(f"note: {warning}" for warning in test.warnings)])


def _drift_lines(test: IndentationTest) -> list[str]:
    whole = float(test.curve.time[-1] - test.curve.time[0])
    lines = []
    if test.compliance is not None:
        lines.append(f"compliance of the machine taken out: {test.compliance:.3g} m/N")
    for i, zero in enumerate(test.zeros, 1):
        if zero.seen:
            where = f" in indentation {i}" if len(test.zeros) > 1 else ""
            std = float(np.sqrt(zero.covariance[1, 1]))
            shown = _plus_minus(Estimate(zero.rate, std, 0.0, 0.0), 1.0 if where else whole)
            lines.append(f"zero force drifts by {shown} N{'/s' if where else ' over the curve'}{where}: corrected")
    if test.drift.seen:
        shown = _plus_minus(Estimate(float(test.drift.rate), test.drift.std, 0.0, 0.0), 1e6 * whole)
        lines.append(f"displacement drifts by {shown} um over the curve: corrected")
    return lines


def _plus_minus(estimate: Estimate, scale: float) -> str:
    """Value and standard deviation, to two digits of the latter."""
    value, std = scale * estimate.value, scale * estimate.std
    digits = int(np.clip(1 - np.floor(np.log10(std)), 0, 9)) if std > 0.0 else 3
    return f"{value:.{digits}f} +- {std:.{digits}f}"
