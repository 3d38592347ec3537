"""Displacement of a finger out of its plane in the problem of a hand.

Sections turn by a small vector psi in the plane, the backbone is displaced by w along the plane's normal z. With the
tangent t, across = z x t, and loads of force f and couple c at the distance D in the plane, the moments of what is
beyond a section, in its turned axes, bend and twist it:

    along t        sum c . t + f_z D . across - (w_c - w) f . across - M_z psi . across  =  G J psi' . t
    along across   sum c . across - f_z D . t + (w_c - w) f . t + M_z psi . t            =  E I_l psi' . across
    about z        M_z = sum c_z + (D x f)_z

and w' = -psi . across, to first order in psi and w. On each element psi is the polynomial that obeys this at its Gauss
nodes (collocation); unknowns are the turns there and at the end of the element, and the shift there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from continuum_grasp.grasp.problem.blocks import Columns
from continuum_grasp.grasp.problem.unit_finger import UnitFinger

NODES = 3
"""Gauss nodes per element: with 2, seven of 40 random hands miss the certificate, which allows 1e-6 of the length."""
_AT, _WEIGHTS = np.polynomial.legendre.leggauss(NODES)
_AT, _WEIGHTS = 0.5 * (_AT + 1.0), 0.5 * _WEIGHTS
_POWERS = np.arange(NODES)
_RUNNING = (_AT[:, None] ** (_POWERS + 1) / (_POWERS + 1)) @ np.linalg.inv(_AT[:, None] ** _POWERS)
"""Integrals from the start of an element of length one to each node, by values at the nodes."""


@dataclass(frozen=True)
class EndLoad:
    """A force and a couple on a finger at the end of one of its elements, in the axes of its plane."""

    element: int
    force: ca.SX  # (3,) in E I / L^2
    couple: ca.SX  # (3,) in E I / L


class Lean:
    """Turns (rad) and shifts (per length) of a finger to the side: unknowns, and the rows that they obey."""

    def __init__(self, finger: UnitFinger, x: Columns) -> None:
        count, name = finger.spec.elements, finger.spec.name
        self._finger = finger
        self.turns = x(f"{name}.turns", 2 * NODES * count).reshape((2, NODES * count))
        self.ends = x(f"{name}.end turns", 2 * count).reshape((2, count))
        self.shifts = x(f"{name}.shifts", count)

    def shift(self, end: int) -> ca.SX:
        """Shift at the end of an element; zero at the base, whose index is -1."""
        return self.shifts[end] if end >= 0 else ca.SX(0)

    def slope(self, end: int) -> ca.SX:
        """Slope of the shift there."""
        if end < 0:
            return ca.SX(0)
        angle = self._finger.angles[end]
        return ca.cos(angle) * self.ends[0, end] + ca.sin(angle) * self.ends[1, end]

    def rows(self, loads: Sequence[EndLoad]) -> tuple[ca.SX, ca.SX]:
        """Rows of turns (rad) and of shifts (per length), which are zero under some loads and the finger's weight."""
        finger = self._finger
        at, tangents, lengths, beyond, integral = finger.shared.backbone.nodes(NODES)(finger.q, finger.u, finger.p)
        joints = finger.shared.backbone.joints(finger.q, finger.u, finger.p)[0]
        across = ca.vertcat(-tangents[1, :], tangents[0, :])  # z x t
        slopes, before = -ca.sum1(self.turns * across), ca.SX(2, 1)
        rates, shifts, sums, turned, shifted = (list[ca.SX]() for _ in range(5))
        for element, length in enumerate(finger.lengths):
            nodes = slice(NODES * element, NODES * (element + 1))
            rates.append((self.turns[:, nodes] - ca.repmat(before, 1, NODES)) @ ca.DM(np.linalg.inv(_RUNNING).T))
            turned.append(before + rates[-1] @ ca.DM(_WEIGHTS) - self.ends[:, element])
            shifts.append(self.shift(element - 1) + length * (slopes[nodes] @ ca.DM(_RUNNING.T)))
            shifted.append(self.shift(element - 1) + slopes[nodes] @ lengths[nodes] - self.shifts[element])
            sums.append(length * (shifts[-1] @ ca.DM(_RUNNING.T)))
            before = self.ends[:, element]
        moment, shift = ca.SX(3, lengths.numel()), ca.horzcat(*shifts)  # along t, across and z

        def add(upto: int, force: ca.SX, away: ca.SX, aside: ca.SX) -> None:
            """A force at distances (2, upto) in the plane and (1, upto) across it from the first nodes."""
            t, n = tangents[:, :upto], across[:, :upto]
            moment[0, :upto] += force[2] * ca.sum1(away * n) - aside * (force[:2].T @ n)
            moment[1, :upto] += aside * (force[:2].T @ t) - force[2] * ca.sum1(away * t)
            moment[2, :upto] += away[0, :] * force[1] - away[1, :] * force[0]

        for load in loads:
            upto = NODES * (load.element + 1)
            away = ca.repmat(joints[:, load.element], 1, upto) - at[:, :upto]
            add(upto, load.force, away, self.shifts[load.element] - shift[:upto])
            moment[0, :upto] += load.couple[:2].T @ tangents[:, :upto]
            moment[1, :upto] += load.couple[:2].T @ across[:, :upto]
            moment[2, :upto] += load.couple[2]
        if finger.spec.weighs:
            weight = ca.vertcat(finger.number("weight", 2), finger.number("side weight"))
            ahead = self._integrals(shift, lengths, sums) - beyond.T * shift
            add(lengths.numel(), weight, integral - ca.repmat(beyond.T, 2, 1) * at, ahead)
        twist = moment[0, :] + moment[2, :] * slopes
        bend = moment[1, :] + moment[2, :] * ca.sum1(self.turns * tangents)
        rate, spans = ca.horzcat(*rates), ca.horzcat(*(ca.repmat(length, 1, NODES) for length in finger.lengths))
        rows = [
            ca.sum1(rate * tangents) - spans * twist / finger.number("torsion"),
            ca.sum1(rate * across) - spans * bend / finger.number("lateral"),
        ]
        return ca.vertcat(*(ca.vec(row) for row in rows), *turned), ca.vertcat(*shifted)

    @staticmethod
    def _integrals(shift: ca.SX, lengths: ca.SX, sums: Sequence[ca.SX]) -> ca.SX:
        """Integrals of the shift beyond each node (1, M); ``sums`` are those from the start of the node's element."""
        found, behind = list[ca.SX](), ca.SX(0)
        for element in reversed(range(len(sums))):
            nodes = slice(NODES * element, NODES * (element + 1))
            behind += shift[nodes] @ lengths[nodes]
            found.insert(0, ca.repmat(behind, 1, NODES) - sums[element])
        return ca.horzcat(*found)
