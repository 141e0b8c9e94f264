"""How a diagnosis tries an effect's equation: with which of its parameters, and from where."""

from __future__ import annotations

from typing import NamedTuple


class Form(NamedTuple):
    """An equation that an effect may follow."""

    name: str
    """As reports call it."""
    symbols: tuple[str, ...]
    """The parameters that it has; others of the effect stay neutral."""
    starts: tuple[tuple[float, ...], ...]
    """Values of these from which a fit is tried, side by side."""
