"""The paper's published motions and figures, computed: what the model gives beside what was printed."""

from drillenv.paper.reproduce import reproduce

__all__ = ["reproduce"]
