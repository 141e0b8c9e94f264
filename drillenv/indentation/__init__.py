"""Indentation tests: from force over displacement to the rock that the drilling model takes.

test = fit_indentation("granite.csv", compliance=5e-9)
print(test.text())
test.write_rock("rock.json")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from drillenv.lazy import lazy

if TYPE_CHECKING:
    from drillenv.indentation.branches import Estimate as Estimate
    from drillenv.indentation.fitting import IndentationTest as IndentationTest
    from drillenv.indentation.fitting import fit_indentation as fit_indentation
    from drillenv.indentation.reading import Curve as Curve
    from drillenv.indentation.reading import read_curve as read_curve

__all__ = ["Curve", "Estimate", "IndentationTest", "fit_indentation", "read_curve"]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Curve": "reading",
        "Estimate": "branches",
        "IndentationTest": "fitting",
        "fit_indentation": "fitting",
        "read_curve": "reading",
    },
)
