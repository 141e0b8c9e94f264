"""Indentation tests: from force over displacement to the rock that the drilling model takes.

test = fit_indentation("granite.csv", compliance=5e-9)
print(test.text())
test.write_rock("rock.json")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from drillenv.indentation.branches import Estimate as Estimate
    from drillenv.indentation.fitting import IndentationTest as IndentationTest
    from drillenv.indentation.fitting import fit_indentation as fit_indentation
    from drillenv.indentation.reading import Curve as Curve
    from drillenv.indentation.reading import read_curve as read_curve

__all__ = ["Curve", "Estimate", "IndentationTest", "fit_indentation", "read_curve"]

_HOME = {
    "Curve": "reading",
    "Estimate": "branches",
    "IndentationTest": "fitting",
    "fit_indentation": "fitting",
    "read_curve": "reading",
}


def __getattr__(name: str) -> object:
    """Import a public name where it is first used (PEP 562), so that ``import drillenv`` stays light."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
