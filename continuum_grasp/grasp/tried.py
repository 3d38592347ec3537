"""Attempts of a search: their verification, the least of them, the starts that they make, and their record."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.certificate import Certificate, certify_reached
from continuum_grasp.grasp.finger_map import SETTLED
from continuum_grasp.grasp.problem.solver_run import GraspAttempt, GraspSolverRun
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.grasp.values import NEAR
from continuum_grasp.scene import GraspScene


@dataclass(frozen=True)
class Tried:
    """An attempt; its physical numbers and its verification when they are asked for."""

    attempt: GraspAttempt
    solver: GraspSolverRun
    scene: GraspScene

    @cached_property
    def arrays(self) -> dict[str, Array]:
        """The physical numbers; see `continuum_grasp.grasp.GraspResult`."""
        return self.solver.arrays(self.scene, self.attempt)

    @cached_property
    def certificate(self) -> Certificate:
        """The verification of the grasp as it is reached."""
        return certify_reached(self.scene, self.arrays)

    @cached_property
    def start(self) -> GraspStart:
        return GraspStart.of(self.scene, self.arrays)

    @property
    def verified(self) -> bool:
        """Whether the certificate confirms it, which is not computed where the solver's own constraints are violated by
        far more than it allows.
        """
        # 1e-2: scaled violation of the problem's constraints from which on no certificate is computed: it allows at
        # most 1e-4
        return self.attempt.badness < 1e-2 and self.certificate.passed

    @property
    def acceptable(self) -> bool:
        """Whether it is verified, and stable where the scene asks for that."""
        return self.certificate.acceptable


def least_of(tried: list[Tried]) -> Tried | None:
    """The one with the least objective; one that converged, where that costs next to nothing: an interrupted one has no
    sensitivities.
    """
    least = min((t.attempt.objective for t in tried), default=0.0)
    near = least + NEAR * max(1.0, abs(least))
    converged = [t for t in tried if t.attempt.optimal and t.attempt.objective <= near]
    return min(converged or tried, key=lambda t: round(t.attempt.objective, 9), default=None)


@dataclass
class Candidate:
    """A start, and whether it was tried."""

    start: GraspStart
    tried: bool = False

    @property
    def holds(self) -> bool:
        """Whether the object is held, but for what the solver brings to zero, at an optimum."""
        return self.start.imbalance <= SETTLED and not self.start.is_spare


@dataclass(frozen=True)
class Exploration:
    """Record of a search."""

    modes: int = 0  # sets of contacts
    sampled: int = 0  # those of whose postures samples were tried: of the others all were looked at
    starts_solved: int = 0  # starts of the solver that led to a verified grasp
    starts_failed: int = 0  # the other ones; a failure proves nothing
    settled: int = 0  # combinations of fingers that hold the object
    untried: int = 0  # of these, from which no grasp was sought though it may be better
    # Least sum of the tensions [N] with which one of them does, where it is clearly less than the result's; else NaN.
    exact_less: float = math.nan
    pruned: dict[str, int] = field(default_factory=dict)  # starts that were not tried, by the reason
