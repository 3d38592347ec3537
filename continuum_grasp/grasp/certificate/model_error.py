"""How far the true rods would be from a grasp's shape: the same fingers in many short cells, under the forces found.

The angle phi at the ends of the cells is unknown. Under tensions, weight and contact forces that keep their
world directions, with the cells' mean angles taken in their sines and cosines, the moments balance at each end:

    m_before - m_behind = half the cells on both sides * (forces beyond them) . n(phi) + couple
    m = E I (bend / h - rest curvature) - moment of the tendons there

The equilibrium is followed from the grasp's own shape, which is one under some additional couples, by taking
these away; stable or not.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.dense_rod import DenseRod
from continuum_grasp.grasp.certificate.recomputed import RecomputedGrasp
from continuum_grasp.grasp.certificate.recomputed_finger import RecomputedFinger

__all__ = ["ModelError", "model_error"]

Array = NDArray[Any]

CELLS = 200
"""Cells of the fine rod, about: their own error is some 1e-5 of its length."""
SMALL = 0.005
"""Greatest displacement, as a part of the finger's length, that is passed over in silence."""
FAR = 0.2
"""Greatest change of an angle in one step of Newton's method; farther away may be another equilibrium [rad]."""


@dataclass(frozen=True)
class ModelError:
    """What the fingers' curvature families leave out; it falls with the number of elements.

    Attributes
    ----------
    displacements : dict of str to float
        How far the fine rods are from the grasp's shape [m], at the contacts by name and at the tips as
        ``<finger>.tip``; those of a finger are missing where no equilibrium of its fine rod was found near the
        grasp.
    length : float
        Of the shortest finger [m].
    moment : float
        Greatest difference between the bending moment of a finger's shape and that of the forces beyond each
        section, as a part of the greatest moment.
    lost : tuple of str
        Fingers whose fine rods have no equilibrium near the grasp.
    """

    displacements: dict[str, float]
    length: float
    moment: float
    lost: tuple[str, ...] = ()

    @property
    def found(self) -> bool:
        """Whether every fine rod has an equilibrium near the grasp."""
        return bool(self.displacements) and not self.lost

    @property
    def greatest(self) -> float:
        """Greatest displacement [m]; infinite where one was not found."""
        return max(self.displacements.values()) if self.found else float("inf")

    @property
    def limit(self) -> float:
        """Greatest displacement that is passed over in silence: 0.5 % of the shortest finger's length [m]."""
        return SMALL * self.length

    @property
    def small(self) -> bool:
        """Whether the displacements are within the limit."""
        return self.greatest <= self.limit

    def __str__(self) -> str:
        if not self.found:
            of = f" of {', '.join(self.lost)}" if self.lost else ""
            return f"a fine rod{of} under these forces has no equilibrium near this shape"
        parts = [f"{1e3 * off:.2g} mm at {name}" for name, off in self.displacements.items()]
        return f"a fine rod under these forces differs by {' and '.join(parts)}"


def model_error(grasp: RecomputedGrasp) -> ModelError:
    """Compare the fingers of a grasp with the equilibria of fine rods under their forces.

    Parameters
    ----------
    grasp : RecomputedGrasp

    Returns
    -------
    ModelError
    """
    displacements: dict[str, float] = {}
    lost, moment = [], 0.0
    for finger in grasp.fingers:
        rod = _FineRod(finger)
        phi = rod.equilibrium()
        moment = float(np.maximum(moment, rod.moment_left_out()))
        if phi is None:
            lost.append(finger.name)
            continue
        off = np.linalg.norm(rod.points(phi) - rod.points(rod.start), axis=1)
        displacements |= {name: float(off[edge]) for name, edge in rod.places.items()}
    return ModelError(displacements, min(f.length for f in grasp.fingers), moment, tuple(lost))


class _FineRod:
    """The cells' stiffness and loads; the angles at their ends are unknown but for that at the base."""

    def __init__(self, bent: RecomputedFinger) -> None:
        finger = bent.finger
        rod = DenseRod(finger, bent.lengths, 1 / CELLS, bent.base)
        self.h = np.diff(rod.edges)
        self.stiffness = finger.rod.stiffness / self.h
        rest = rod.rest.reshape(self.h.size, -1)
        self.rest_bend = self.h * rest[:, rest.shape[1] // 2]
        self.pull = bent.tip_moment
        self.friction = 0.0 if finger.tendons is None else finger.tendons.friction
        self.start = rod.edge_angle(bent.ends)
        self.least_moment = 1e-6 * bent.moment_scale(0.0)
        joints = {load.name: load.joint for load in bent.loads} | {bent.setup.tip_name: bent.lengths.size}
        self.places = {name: rod.edge_index(rod.joints[joint]) for name, joint in joints.items()}
        ends = np.zeros((self.h.size, 2))
        self.couple = np.zeros(self.h.size)
        """On the cells' far ends [N m]."""
        for load in bent.loads:
            edge = self.places[load.name]
            ends[edge - 1] += load.force
            self.couple[edge - 1] += load.couple
        weight = finger.rod.mass_per_length * self.h[:, None] * bent.gravity
        for mass in finger.masses:
            if (edge := rod.edge_index(mass.at)) > 0:
                ends[edge - 1] += mass.mass * bent.gravity
        self.beyond = np.cumsum((weight + ends)[::-1], axis=0)[::-1] - 0.5 * weight
        """Force beyond the cells' middles [N]."""

    def equilibrium(self) -> Array | None:
        """Angles at the cells' ends, the base's first; None where the way there ends or is lost."""
        phi, left = self.start, self.missing(self.start)
        done, step = 0.0, 1.0
        while done < 1.0:
            after = self._newton(phi, left * max(0.0, 1.0 - done - step))
            if after is None:
                step *= 0.5
                if step < 1 / 64:
                    return None
            else:
                phi, done, step = after, done + step, 2.0 * step
        return phi

    def points(self, phi: Array) -> Array:
        """Positions of the cells' ends from the base [m]."""
        middle = 0.5 * (phi[1:] + phi[:-1])
        steps = self.h[:, None] * np.stack([-np.sin(middle), np.cos(middle)], axis=1)
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    def moment_left_out(self) -> float:
        """Moment of the shape against that of everything beyond a section, greatest relative difference."""
        _, shape = self._moments(self.start)
        gap = np.cumsum(self.missing(self.start)[::-1])[::-1]
        return float(np.abs(gap).max() / max(np.abs(shape - gap).max(), self.least_moment))

    def missing(self, phi: Array) -> Array:
        """Couple that the balance lacks at each end but the base [N m]."""
        middle = 0.5 * (phi[1:] + phi[:-1])
        across = -np.stack([np.cos(middle), np.sin(middle)], axis=1)
        turning = 0.5 * self.h * (self.beyond * across).sum(axis=1)
        moment = self._moments(phi)[0]
        return np.asarray(moment - _next(moment) - turning - _next(turning) - self.couple)

    def _moments(self, phi: Array) -> tuple[Array, Array]:
        """Of the cells [N m]: shape less tendons, and of the shape alone."""
        shape = self.stiffness * (np.diff(phi) - self.rest_bend)
        return shape - self.pull * self._share(phi), shape

    def _share(self, phi: Array) -> Array:
        """Share of the tendons' moment that gets past the friction of the guides to the cells' middles."""
        turned = np.abs(np.diff(phi))
        return np.asarray(np.exp(-self.friction * (np.cumsum(turned) - 0.5 * turned)))

    def _slope(self, phi: Array) -> Array:
        """Derivative of `missing` by the angles but the base's; nothing beyond the first superdiagonal."""
        bend = np.eye(self.h.size) - np.eye(self.h.size, k=-1)
        moment = self.stiffness[:, None] * bend
        if self.friction > 0.0:
            turned = np.sign(np.diff(phi))[:, None] * bend
            passed = np.cumsum(turned, axis=0) - 0.5 * turned
            moment += self.pull * self.friction * self._share(phi)[:, None] * passed
        middle = 0.5 * (phi[1:] + phi[:-1])
        along = np.stack([-np.sin(middle), np.cos(middle)], axis=1)
        turning = (-0.25 * self.h * (self.beyond * along).sum(axis=1))[:, None] * np.abs(bend)
        return np.asarray(moment - _next(moment) - turning - _next(turning))

    def _newton(self, phi: Array, left: Array) -> Array | None:
        """Angles at which the balance lacks ``left``; None where they are not near."""
        for _ in range(8):
            change = _solve(self._slope(phi), left - self.missing(phi))
            size = float(np.abs(change).max())
            if not size <= FAR:
                return None
            phi = phi + np.concatenate([[0.0], change])
            if size < 1e-9:
                return phi
        return None


def _solve(matrix: Array, right: Array) -> Array:
    """Solution of linear equations whose matrix has nothing beyond its first superdiagonal."""
    a, x = matrix.copy(), right.copy()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for k in range(x.size - 1, 0, -1):
            share = a[k - 1, k] / a[k, k]
            a[k - 1] -= share * a[k]
            x[k - 1] -= share * x[k]
        for k in range(x.size):
            x[k] = (x[k] - a[k, :k] @ x[:k]) / a[k, k]
    return x


def _next(of_cells: Array) -> Array:
    """What the cells behind have; the last has none."""
    return np.concatenate([of_cells[1:], np.zeros_like(of_cells[:1])])
