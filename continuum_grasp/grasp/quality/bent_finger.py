"""Small motions of a bent finger about its stored shape, on a mesh of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene.finger import Finger

__all__ = ["BentFinger", "Section"]

Array = NDArray[Any]

CELLS = 32
"""Least number of cells along a finger."""
_X, _W = np.polynomial.legendre.leggauss(4)
_X, _W = 0.5 * (_X + 1.0), 0.5 * _W


@dataclass(frozen=True)
class Section:
    """A section of the finger and how it moves with the changes of curvature.

    Attributes
    ----------
    position : ndarray, shape (2,)
        World position of the backbone [m].
    angle : float
        World angle of the section's X axis [rad].
    curvature : float
        [1/m]
    shift : ndarray, shape (2, n)
        Change of position [m] per change of each unknown [1/m].
    turn : ndarray, shape (n,)
        Change of angle [rad].
    """

    position: Array
    angle: float
    curvature: float
    shift: Array
    turn: Array


class BentFinger:
    """A finger in its stored shape; the unknowns are changes of curvature, linear in each cell.

    They are continuous but at the middle contacts, where a couple of friction makes them jump.

    Parameters
    ----------
    finger : Finger
    arrays : mapping
        Of the finger: ``family``, ``q``, ``lengths``, ``tip_curvature``, ``base``.
    stations : sequence of float, optional
        Positions of contacts along the finger [m].

    Attributes
    ----------
    size : int
        Number n of unknowns.
    bending : ndarray, shape (n, n)
        Stiffness of the rod [N m2 m].
    tip_turn : ndarray, shape (n,)
        Change of the whole bend, by which a tendon's path changes, per offset [m].
    tendon_turn : ndarray, shape (n,)
        The same weighted with the share of the tension that gets past the friction of the guides.
    """

    def __init__(self, finger: Finger, arrays: Mapping[str, Any], stations: Sequence[float] = ()) -> None:
        self.finger = finger
        lengths = np.asarray(arrays["lengths"], dtype=float)
        self.joints = np.concatenate([[0.0], np.cumsum(lengths)])
        self.length = float(self.joints[-1])
        self._ends = _curvature_ends(arrays, lengths)
        inner = [s for s in stations if 1e-9 < s / self.length < 1.0 - 1e-9]
        self._mesh(inner)
        self.base = np.asarray(arrays["base"], dtype=float)
        self._shape()
        self._motions(inner)
        self._stiffness()

    def section(self, station: float) -> Section:
        """The section nearest to a position along the finger; contacts, joints and masses are met exactly."""
        edge = int(np.argmin(np.abs(self.edges - station)))
        return Section(self.points[edge], self.angles[edge], self._curvature(edge), self.shifts[edge], self.turns[edge])

    def load_stiffness(self, loads: Sequence[tuple[float, Array]], gravity: Array | None = None) -> Array:
        """Stiffness (n, n) that dead forces give the bent finger: pulled along, it stiffens; pushed, it softens.

        Parameters
        ----------
        loads : sequence of (float, ndarray)
            Position along the finger [m], world force [N].
        gravity : ndarray, shape (2,), optional
            World gravity [m/s2], which acts on rod and masses.
        """
        beyond = np.zeros((self.s.size, 2))
        forces = list(loads)
        if gravity is not None:
            beyond += self.finger.rod.mass_per_length * (self.length - self.s)[:, None] * gravity
            forces += [(mass.at, mass.mass * gravity) for mass in self.finger.masses]
        for at, force in forces:
            beyond[self.s < at] += force
        along = np.einsum("gi,gi->g", beyond, self._tangents) * self.weights
        return np.asarray(self._spins.T @ (along[:, None] * self._spins))

    def inertia(self) -> Array:
        """Mass matrix (n, n) of rod and point masses, in motions of the unknowns [kg m2 m2]."""
        share = np.zeros(self.edges.size)
        share[:-1] += 0.5 * np.diff(self.edges)
        share[1:] += 0.5 * np.diff(self.edges)
        share *= self.finger.rod.mass_per_length
        for mass in self.finger.masses:
            share[int(np.argmin(np.abs(self.edges - mass.at)))] += mass.mass
        return np.asarray(np.einsum("e,ein,eim->nm", share, self.shifts, self.shifts))

    # -- making ----------------------------------------------------------------------------------------------

    def _mesh(self, inner: Sequence[float]) -> None:
        marks = np.sort(np.concatenate([self.joints, inner, [m.at for m in self.finger.masses]]))
        marks = marks[np.concatenate([[True], np.diff(marks) > 1e-9 * self.length])]
        marks[-1] = self.length
        pieces = [
            np.linspace(a, b, max(1, int(np.ceil((b - a) * CELLS / self.length - 1e-9))) + 1)[:-1]
            for a, b in pairwise(marks)
        ]
        self.edges = np.concatenate([*pieces, [self.length]])
        self._h = np.diff(self.edges)
        self.s = (self.edges[:-1, None] + self._h[:, None] * _X).ravel()
        self.weights = (self._h[:, None] * _W).ravel()
        middles = 0.5 * (self.edges[1:] + self.edges[:-1])
        self._element = np.clip(np.searchsorted(self.joints, middles) - 1, 0, self._ends.shape[0] - 1)

    def _shape(self) -> None:
        length = np.diff(self.joints)[self._element]
        start = self.edges[:-1] - self.joints[self._element]
        first, last = self._ends[self._element].T
        slope = (last - first) / length
        left = first + slope * start
        bends = self._h * (left + 0.5 * slope * self._h)
        self._left, self._right = left, left + slope * self._h
        self.angles = self.base[2] + np.concatenate([[0.0], np.cumsum(bends)])
        u = self._h[:, None] * _X
        angle = (self.angles[:-1, None] + left[:, None] * u + 0.5 * slope[:, None] * u**2).ravel()
        self._tangents = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        steps = (self.weights[:, None] * self._tangents).reshape(-1, _X.size, 2).sum(axis=1)
        self.points = self.base[:2] + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
        tendons = self.finger.tendons
        turned = np.abs(bends)
        friction = 0.0 if tendons is None else tendons.friction
        self._shares = np.exp(-friction * (np.cumsum(turned) - 0.5 * turned))

    def _motions(self, inner: Sequence[float]) -> None:
        cells = self._h.size
        jumps = np.zeros(cells, dtype=int)
        for s in inner:
            jumps[int(np.argmin(np.abs(self.edges - s)))] = 1  # between the cell before and this one
        left = np.arange(cells) + np.cumsum(jumps)
        self.size = int(left[-1]) + 2
        per_cell = np.zeros((cells, self.size))
        rows = np.arange(cells)
        per_cell[rows, left] = per_cell[rows, left + 1] = 0.5 * self._h
        self.turns = np.concatenate([np.zeros((1, self.size)), np.cumsum(per_cell, axis=0)])
        spins = np.repeat(self.turns[:-1], _X.size, axis=0)
        points = np.arange(self.s.size)
        cell, u = np.repeat(rows, _X.size), np.tile(_X, cells)
        spins[points, left[cell]] += self._h[cell] * (u - 0.5 * u**2)
        spins[points, left[cell] + 1] += self._h[cell] * 0.5 * u**2
        self._spins = spins
        normals = np.stack([-self._tangents[:, 1], self._tangents[:, 0]], axis=1)
        steps = np.einsum("g,gi,gn->gin", self.weights, normals, spins)
        summed = steps.reshape(cells, _X.size, 2, self.size).sum(axis=1)
        self.shifts = np.concatenate([np.zeros((1, 2, self.size)), np.cumsum(summed, axis=0)])
        self.tip_turn = self.turns[-1]
        self.tendon_turn = self._shares @ per_cell
        self._cells = left

    def _stiffness(self) -> None:
        self.bending = np.zeros((self.size, self.size))
        stiff = self.finger.rod.stiffness * self._h
        for i, j, part in ((0, 0, 1 / 3), (0, 1, 1 / 6), (1, 0, 1 / 6), (1, 1, 1 / 3)):
            np.add.at(self.bending, (self._cells + i, self._cells + j), part * stiff)

    def _curvature(self, edge: int) -> float:
        before, after = max(edge - 1, 0), min(edge, self._h.size - 1)
        return float(0.5 * (self._right[before] + self._left[after])) if before != after else float(self._right[before])


def _curvature_ends(arrays: Mapping[str, Any], lengths: Array) -> Array:
    """Curvature at both ends of each element (N, 2) [1/m]."""
    q, family = np.asarray(arrays["q"], dtype=float), str(arrays["family"])
    if family == "arc":
        return np.repeat((q / lengths)[:, None], 2, axis=1)
    nodes = np.append(q, float(arrays["tip_curvature"])) if family == "matched_clothoid" else q
    return np.stack([nodes[:-1], nodes[1:]], axis=1)
