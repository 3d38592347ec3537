"""A term of a cost: half the weighted squared distance of an expression from its setpoint."""

from __future__ import annotations

from typing import Any, NamedTuple


class Residual(NamedTuple):
    """A term of the cost: half the weighted squares of an expression's distance from its setpoint.

    ``weight`` counts per second of the horizon, ``final`` once at its end; each is one number, or one per entry.
    ``names`` are those of the entries, by default numbered ones.
    """

    value: Any
    weight: Any
    final: Any = 0.0
    names: tuple[str, ...] = ()
