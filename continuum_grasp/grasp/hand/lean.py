"""Displacement of a finger out of its plane in the problem of a hand.

Sections turn by a small vector psi in the plane, the backbone is displaced by w along the plane's normal z. With the
tangent t, across = z x t, and loads of force f and couple c at the distance D in the plane, the moments of all
loads beyond a section, in its turned axes, bend and twist it:

    along t        sum c . t + f_z D . across - (w_c - w) f . across - M_z psi . across  =  G J psi' . t
    along across   sum c . across - f_z D . t + (w_c - w) f . t + M_z psi . t            =  E I_l psi' . across
    about z        M_z = sum c_z + (D x f)_z

and w' = -psi . across, to first order in psi and w. On each panel, an element or a part of it along which the stiffness
is smooth, psi is the polynomial that obeys this at its Gauss nodes (collocation); unknowns are the turns there and at
the end of the panel, and the shift there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from continuum_grasp.grasp.problem.blocks import Columns
from continuum_grasp.grasp.problem.unit_finger import UnitFinger

NODES = 3
"""Gauss nodes per panel: with 2, seven of 40 random hands miss the certificate, which allows 1e-6 of the length."""
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
        self._finger = finger
        self._parts = finger.shared.backbone.panels  # per element
        count = finger.spec.elements * self._parts
        name = finger.spec.name
        self.turns = x(f"{name}.turns", 2 * NODES * count).reshape((2, NODES * count))
        self.ends = x(f"{name}.end turns", 2 * count).reshape((2, count))
        self.shifts = x(f"{name}.shifts", count)

    def shift(self, end: int) -> ca.SX:
        """Shift at the end of an element; zero at the base, whose index is -1."""
        return self._shift(self._parts * (end + 1) - 1)

    def _shift(self, panel: int) -> ca.SX:
        return self.shifts[panel] if panel >= 0 else ca.SX(0)

    def slope(self, end: int) -> ca.SX:
        """Slope of the shift there."""
        if end < 0:
            return ca.SX(0)
        angle = self._finger.angles[end]
        turn = self.ends[:, self._parts * (end + 1) - 1]
        return ca.cos(angle) * turn[0] + ca.sin(angle) * turn[1]

    def rows(self, loads: Sequence[EndLoad]) -> tuple[ca.SX, ca.SX]:
        """Rows of turns (rad) and of shifts (per length), which are zero under some loads and the finger's weight."""
        finger = self._finger
        state = finger.q, finger.u, finger.p
        spans, at, tangents, density, stiffness, beyond, integral = finger.shared.backbone.nodes(NODES)(*state)
        joints = finger.shared.backbone.joints(*state)[0]
        across = ca.vertcat(-tangents[1, :], tangents[0, :])  # z x t
        lengths = ca.vertcat(*(span * ca.DM(_WEIGHTS) for span in ca.vertsplit(spans)))  # that nodes stand for
        slopes = -ca.sum1(self.turns * across)
        before = ca.SX(2, 1)
        rates, shifts, sums, turned, shifted = (list[ca.SX]() for _ in range(5))
        for panel, length in enumerate(ca.vertsplit(spans)):
            nodes = slice(NODES * panel, NODES * (panel + 1))
            rates.append((self.turns[:, nodes] - ca.repmat(before, 1, NODES)) @ ca.DM(np.linalg.inv(_RUNNING).T))
            turned.append(before + rates[-1] @ ca.DM(_WEIGHTS) - self.ends[:, panel])
            shifts.append(self._shift(panel - 1) + length * (slopes[nodes] @ ca.DM(_RUNNING.T)))
            shifted.append(self._shift(panel - 1) + slopes[nodes] @ lengths[nodes] - self.shifts[panel])
            sums.append(length * ((shifts[-1] * density[nodes].T) @ ca.DM(_RUNNING.T)))
            before = self.ends[:, panel]
        moment, shift = ca.SX(3, lengths.numel()), ca.horzcat(*shifts)  # along t, across and z

        def add(upto: int, force: ca.SX, away: ca.SX, aside: ca.SX) -> None:
            """A force at distances (2, upto) in the plane and (1, upto) across it from the first nodes."""
            t, n = tangents[:, :upto], across[:, :upto]
            moment[0, :upto] += force[2] * ca.sum1(away * n) - aside * (force[:2].T @ n)
            moment[1, :upto] += aside * (force[:2].T @ t) - force[2] * ca.sum1(away * t)
            moment[2, :upto] += away[0, :] * force[1] - away[1, :] * force[0]

        for load in [*loads, *self._tip_mass()]:
            upto = NODES * self._parts * (load.element + 1)
            away = ca.repmat(joints[:, load.element], 1, upto) - at[:, :upto]
            add(upto, load.force, away, self.shift(load.element) - shift[:upto])
            moment[0, :upto] += load.couple[:2].T @ tangents[:, :upto]
            moment[1, :upto] += load.couple[:2].T @ across[:, :upto]
            moment[2, :upto] += load.couple[2]
        if finger.spec.weighs:
            ahead = self._integrals(shift * density.T, lengths, sums) - beyond.T * shift
            add(lengths.numel(), self._weight, integral - ca.repmat(beyond.T, 2, 1) * at, ahead)
        twist = moment[0, :] + moment[2, :] * slopes
        bend = moment[1, :] + moment[2, :] * ca.sum1(self.turns * tangents)
        rate = ca.horzcat(*rates)
        share = ca.vertcat(*(ca.repmat(span, NODES, 1) for span in ca.vertsplit(spans)))
        gives = (share / stiffness).T
        rows = [
            ca.sum1(rate * tangents) - gives * twist / finger.number("torsion"),
            ca.sum1(rate * across) - gives * bend / finger.number("lateral"),
        ]
        return ca.vertcat(*(ca.vec(row) for row in rows), *turned), ca.vertcat(*shifted)

    @property
    def _weight(self) -> ca.SX:
        """Weight per mass (3,), in the axes of the plane."""
        return ca.vertcat(self._finger.number("weight", 2), self._finger.number("side weight"))

    def _tip_mass(self) -> list[EndLoad]:
        """Weight of what the tip carries."""
        finger = self._finger
        if not finger.spec.tip_heavy:
            return []
        return [EndLoad(finger.spec.elements - 1, finger.number("tip_mass") * self._weight, ca.SX(3, 1))]

    @staticmethod
    def _integrals(value: ca.SX, lengths: ca.SX, sums: Sequence[ca.SX]) -> ca.SX:
        """Integrals beyond each node (1, M) by values there; ``sums`` are those from the start of the node's panel."""
        found = list[ca.SX]()
        behind = ca.SX(0)
        for panel in reversed(range(len(sums))):
            nodes = slice(NODES * panel, NODES * (panel + 1))
            behind += value[nodes] @ lengths[nodes]
            found.insert(0, ca.repmat(behind, 1, NODES) - sums[panel])
        return ca.horzcat(*found)
