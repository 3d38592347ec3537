"""Small motions of a grasp: rows that stay zero while the object is pushed, and the unknowns that change.

Tensions and bases stay. Contacts that press stick and roll: the gap stays closed, and the finger's material does not
shift past the object's; where a contact bears a moment, it does not turn about the normal either. All other rows are
those of the grasp, to first order.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np

from continuum_grasp.base import Array, Indices
from continuum_grasp.grasp.rods import kinds
from continuum_grasp.grasp.rods.numbers import FingerNumbers
from continuum_grasp.grasp.rods.places import FingerPlaces
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.supports import SupportNumbers
from continuum_grasp.nlp import BlockKind

COMPLIANCE = 1e-8
"""Give of each contact, per L^3 / (E I) of the stiffest finger: it shares out forces that rigid contacts would leave
open, between two ends of a face on a wall for instance; 1e-7 and 1e-9 change pushes of shipped grasps by less than
1e-6 (`tests/grasp/rods/test_grasp_tangent.py`)."""
LEAST_CURVED = 1e-3
"""Least relative curvature of the object and a support, per size: flatter ones would roll without end."""
_CHANGING = ("node ", "force ", "force, ", "moment ", "place, ")
_STAYING = ("rod, ", "tendons, ", "force, ", "tip, ")


class TendonBehavior(Enum):
    """Behavior of tendons while a grasp moves; the value is the word of ``disturbances.tendons``."""

    CONSTANT = "constant"
    """Tensions stay."""
    RETENSIONED = "retensioned"
    """Tensions are chosen anew: there are more changes than rows."""
    LOCKED = "locked"
    """Lengths stay: antagonists share a change of tension."""


@dataclass(frozen=True, eq=False)
class ContactMotion:
    """Rows of a contact in a small motion: a block of unknowns and changes of the grasp."""

    kind: BlockKind
    unknowns: Indices
    changes: Indices
    """Unknowns of the grasp whose changes the block takes, after its unknowns."""
    data: Array
    rows: list[int]
    """Rows of the block that stay zero."""
    balance: list[int]
    """Rows of the block that are moments on the object."""
    forces: Indices
    """Unknowns of the forces and the moment against which these rows hold."""
    give: float
    """Change of a row per force, if the contact gives a little."""


class GraspMotion:
    """Unknowns that change and rows that stay zero.

    Parameters
    ----------
    problem : GraspRods
    idle : collection of str
        Names of contacts that bear nothing: they part, and move with their finger.
    tendons : TendonBehavior
        What tendons do.

    Attributes
    ----------
    changing : ndarray of int
        Unknowns that change.
    rows : ndarray of int
        Rows of the problem that stay.
    """

    def __init__(
        self, problem: GraspRods, idle: Collection[str] = (), *, tendons: TendonBehavior = TendonBehavior.CONSTANT
    ) -> None:
        self.problem, self.idle = problem, frozenset(idle)
        self.tendons = tendons
        self._planar = problem.geometry.dimensions == 2
        self.balance = problem.balance[[0, 1, 5]] if self._planar else problem.balance
        self.changing = self._changing()
        self.rows = np.concatenate([self._staying(), self.balance])

    @property
    def directions(self) -> int:
        """Number of directions in which the object is pushed."""
        return self.problem.geometry.dimensions

    @property
    def contacts(self) -> list[str]:
        """Names of the contacts that press."""
        return [name for name in self.problem.contacts if name not in self.idle]

    def held(self, name: str) -> Indices:
        """Unknowns of a contact's force and moment that change."""
        return np.intersect1d(self.problem.contacts[name], self.changing)

    def _changing(self) -> Indices:
        problem = self.problem
        low, high = problem.limits
        names = [
            name for name in problem.at if name.startswith(_CHANGING) and not name.endswith(tuple(self._idle_ends))
        ]
        found = np.concatenate(
            [problem.pose, *self._pulled, *(problem.at[name][(low < high)[problem.at[name]]] for name in names)]
        )
        # A planar grasp moves in its plane; bases that the search chooses stay.
        lifts = [at[2] for at in problem.contacts.values()] if self._planar else []
        bases = [part.nodes[0][: problem.geometry.oriented] for part in problem.parts]
        return np.setdiff1d(found, np.concatenate([lifts, *bases]))

    @property
    def _pulled(self) -> list[Indices]:
        """Pulls of each finger that change."""
        low, high = self.problem.limits
        changes = self.tendons is not TendonBehavior.CONSTANT
        return [part.pulls[(low < high)[part.pulls]] for part in self.problem.parts] if changes else []

    @property
    def locks(self) -> Iterator[list[int]]:
        """Unknowns whose changes add up to zero where tendons are locked: the slide at the base of each set, and its
        pulls, of which one gains what the other loses.
        """
        if self.tendons is not TendonBehavior.LOCKED:
            return
        low, high = self.problem.limits
        for finger, part in zip(self.problem.numbers.fingers, self.problem.parts, strict=True):
            form = finger.section.form
            slides = [k for k, name in enumerate(form.sliding_names) if name.startswith("slide")]
            for tendons, slide in enumerate(slides):
                pairs = zip(part.pulls.tolist(), finger.section.pulls, strict=True)
                pulls = [at for at, pull in pairs if pull.tendons == tendons and low[at] < high[at]]
                if pulls:
                    yield [int(part.nodes[0][self.problem.geometry.state + slide])]
                if len(pulls) > 1:
                    yield pulls

    @property
    def _idle_ends(self) -> Iterator[str]:
        """Ends of the names of unknowns and rows of contacts that bear nothing."""
        return (f", {name}" for name in self.idle)

    def _staying(self) -> Indices:
        problem, found = self.problem, list[Indices]()
        middles = {name for finger in problem.numbers.fingers for name in finger.middles}
        for block in problem.blocks:
            kind, _, name = block.name.partition(", ")
            touching = name not in self.idle and (kind == "contact" or (kind == "direction" and name in middles))
            if touching or block.name.startswith(_STAYING):
                found.append(block.rows.ravel())
        return np.concatenate(found)

    @property
    def of_contacts(self) -> Iterator[ContactMotion]:
        """Rows of all contacts that press."""
        numbers = self.problem.numbers
        for finger, part in zip(numbers.fingers, self.problem.parts, strict=True):
            for k, name in enumerate(finger.contacts):
                if name not in self.idle:
                    yield self._of_finger(finger, part, k)
        for support in numbers.supports:
            if support.touches and support.name not in self.idle:
                yield self._of_support(support)

    def _of_finger(self, finger: FingerNumbers, part: FingerPlaces, k: int) -> ContactMotion:
        problem, geometry, node = self.problem, self.problem.geometry, part.touching[k]
        numbers, name, span = problem.numbers, finger.contacts[k], part.span_of(part.touching[k])
        is_tip, end = name == finger.tip, span.ends[1]
        kind = kinds.slip_kind(geometry, finger.section.form, tip=is_tip)
        turns = list[int]() if is_tip else part.turns[k].tolist()
        unknowns = [*part.nodes[node], *turns, *span.force, *part.pulls, end, *problem.pose]
        changes = [*part.nodes[node][: geometry.oriented], end, *problem.pose]
        data = [*finger.acting(span.piece), finger.length / numbers.size, *finger.across]
        data += [*finger.thickness(span.piece), *numbers.axes, *numbers.table.data_at(name)]
        # The gap is a row of the grasp.
        rows = [1] if self._planar else [1, 2, *([3] if finger.arm > 0.0 else [])]
        give = self._give * finger.force / finger.length
        held = problem.contacts[name][rows]
        return ContactMotion(kind, np.array(unknowns), np.array(changes), np.array(data), rows, [], held, give)

    @property
    def _give(self) -> float:
        """Give of a contact [m/N]."""
        return COMPLIANCE * min(finger.length / finger.force for finger in self.problem.numbers.fingers)

    @property
    def gaps(self) -> Iterator[tuple[int, int, float]]:
        """Row of the gap of each contact of a finger that presses, its normal force, and what the gap gives."""
        rows = {block.name: block.rows.ravel() for block in self.problem.blocks}
        for finger in self.problem.numbers.fingers:
            for name in set(finger.contacts) - self.idle:
                row, force = rows[f"contact, {name}"][0], self.problem.contacts[name][0]
                yield int(row), int(force), self._give * finger.force / finger.length

    def _of_support(self, support: SupportNumbers) -> ContactMotion:
        problem = self.problem
        numbers = problem.numbers
        unknowns = [*problem.contacts[support.name], *problem.pose]
        arm, normal = self._lever(support)
        data = [*arm, *normal, *support.across, *numbers.center, *self._rolls(support).ravel()]
        rows, moments = ([0, 1], [5]) if self._planar else ([0, 1, 2], [3, 4, 5])
        kind, held = kinds.support_slip_kind(problem.geometry), problem.contacts[support.name][rows]
        # The object pushes the support, which pushes back.
        give, data = -self._give * numbers.force / numbers.size, [*data, *numbers.axes]
        return ContactMotion(kind, np.array(unknowns), problem.pose, np.array(data), rows, moments, held, give)

    @property
    def _axes(self) -> Array:
        """Axes of the object as columns (3, 3)."""
        numbers = self.problem.numbers
        return np.array(self.problem.geometry.turn(numbers.pose, numbers.axes), dtype=float)

    def _lever(self, support: SupportNumbers) -> tuple[Array, Array]:
        """Place of a support's contact from the center of mass (3,) [object size], and outward normal (3,)."""
        numbers = self.problem.numbers
        place, normal = support.touched(numbers, numbers.pose)
        return place - np.array(self.problem.geometry.place(numbers.pose)) - self._axes @ numbers.center, normal

    def _rolls(self, support: SupportNumbers) -> Array:
        """Way of a support's contact per turn of the object (3, 3) [object size]."""
        numbers, d = self.problem.numbers, self.problem.geometry.dimensions
        if self._shared(support):
            return np.zeros((3, 3))
        axes, (arm, normal) = self._axes, self._lever(support)
        local = numbers.center + axes.T @ arm + 1e-3 * axes.T @ normal
        near = numbers.table.body.near(local[None, :d] * numbers.size)
        beside = np.eye(3) - np.outer(normal, normal)
        if self._planar:
            beside = beside - np.diag([0.0, 0.0, 1.0])
            curved = float(near.curvature[0]) * numbers.size * beside
        else:
            curved = numbers.size * axes @ near.curvature[0] @ axes.T
        values, vectors = np.linalg.eigh(beside @ (curved + support.curvature * beside) @ beside)
        within = np.einsum("ik,ij,jk->k", vectors, beside, vectors) > 0.5
        radii = np.where(within, 1.0 / np.maximum(values, LEAST_CURVED), 0.0)
        return np.asarray(vectors @ np.diag(radii) @ vectors.T)

    def _shared(self, support: SupportNumbers) -> bool:
        """Whether a face lies on the support by two points, which keep it from rolling."""
        surface = support.name.rpartition(".")[0]
        return bool(surface) and sum(s.name.startswith(f"{surface}.") for s in self.problem.numbers.supports) > 1
