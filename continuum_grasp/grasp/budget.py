"""What a search may spend: iterations, so that a busy machine gives the same verdict; the clock is for emergencies."""

from __future__ import annotations

import time
from dataclasses import dataclass

from continuum_grasp.scene.grasp_options import GraspSolver
from continuum_grasp.scene.plan import PlanSolver

__all__ = ["Budget"]


@dataclass
class Budget:
    """Iterations that are left, shared by all that a search does.

    Attributes
    ----------
    left : int
        Iterations of IPOPT that may still be spent.
    until : float
        ``time.monotonic()`` of the emergency stop [s].
    stopped : bool
        Whether the emergency stop cut something short.
    """

    left: int
    until: float
    stopped: bool = False

    @classmethod
    def of(cls, solver: GraspSolver | PlanSolver) -> Budget:
        """The budget that a scene gives, from now on."""
        return cls(solver.max_total_iterations, time.monotonic() + solver.time_limit)

    @property
    def late(self) -> bool:
        """Whether it is time for the emergency stop; who asks acts on it, so that it counts as one."""
        self.stopped |= time.monotonic() > self.until
        return self.stopped

    @property
    def over(self) -> bool:
        """Whether there is nothing left to spend, or the emergency stop came."""
        return self.left <= 0 or self.late

    @property
    def cut(self) -> str:
        """What cut the search short: ``clock``, ``iterations``, or nothing."""
        return "clock" if self.stopped else "iterations" if self.left <= 0 else ""
