"""One verified property of a grasp, and the limits of all checks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["EQUILIBRIUM", "GAP", "LIMIT", "PENETRATION", "Check", "worst"]

EQUILIBRIUM = 1e-6
"""Limit of moment and force residuals, as a part of the greatest moment or force in play. Optima
of IPOPT, recomputed independently, stay below 2e-7 (400 random scenes)."""
GAP = 1e-6
"""Limit of contact gaps, stored positions and slopes, as a part of the finger's length (slopes: rad)."""
PENETRATION = 1e-4
"""Limit of the dense backbone's penetration, as a part of the finger's length: 10 um of 0.1 m. The optimizer guards
some eight places per element; between them a finger may touch."""
LIMIT = 1e-6
"""By what part of it a limit may be exceeded; IPOPT meets active limits to 1e-9 (scaled)."""


@dataclass(frozen=True)
class Check:
    """One verified property.

    Attributes
    ----------
    name : str
        What is checked.
    value, limit : float
        What was found and the most that passes; both in ``unit``.
    unit : str
        ``1`` where the value is relative to ``relative_to``.
    relative_to : str
        What the value was divided by.
    """

    name: str
    value: float
    limit: float
    unit: str = "1"
    relative_to: str = ""

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit; NaN is not."""
        return bool(self.value <= self.limit)


def worst(*values: float) -> float:
    """The greatest; NaN where one is."""
    return float(np.max(np.array(values, dtype=float)))
