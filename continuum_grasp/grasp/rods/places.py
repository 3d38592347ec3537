"""Places along fingers: of the unknowns of a problem, and of its rows."""

from __future__ import annotations

from dataclasses import dataclass

from continuum_grasp.base import Indices


@dataclass(frozen=True)
class StagePlace:
    """A place of a finger between two nodes, as a share of the stage before a node."""

    finger: int
    node: int
    share: float
    obstacle: int | None = None
    """Index of the finger's obstacle that is to be clear of it; None: the object."""


@dataclass(frozen=True)
class NearPair:
    """A node of one finger, and a nearby chord of another: the chord that starts at a node of it."""

    finger: int
    node: int
    other: int
    chord: int


@dataclass(frozen=True)
class StageSpan:
    """Stages between two places at which a finger may touch or its section jumps."""

    first: int  # node at its begin
    stages: int
    piece: int
    ends: Indices  # places of its ends
    force: Indices  # beyond its begin

    def shares(self, node: int) -> tuple[float, float]:
        """Begin and end of the stage before a node, as shares of the span."""
        j = node - self.first
        return (j - 1) / self.stages, j / self.stages


@dataclass(frozen=True)
class FingerPlaces:
    """Places of a finger's unknowns."""

    nodes: list[Indices]
    spans: list[StageSpan]
    touching: list[int]  # node of each contact
    turns: list[Indices]  # moments beyond each middle contact
    pulls: Indices
    own: int  # states of the rod itself, which come before those of its tendons

    def sliding(self, node: int) -> Indices:
        """States of the tendons at a node."""
        return self.nodes[node][self.own :]

    def along(self, node: int) -> float:
        """Share of all stages that come before the stage that ends at a node; zero for the base."""
        return max(node - 1, 0) / (len(self.nodes) - 1)

    def span_of(self, node: int) -> StageSpan:
        """StageSpan of the stage before a node; the first one for the base."""
        return next(span for span in reversed(self.spans) if span.first < max(node, 1))
