"""Second-order test in space: does every small motion that the contacts allow raise the energy?

Fingers are chains, whose energy `chain` has. The object shifts by u and turns by exp(phi). To second order

    2 E = fingers + sum f . (phi x (phi x a))

with f the force on what it touches and a the arm from the center of mass to the point of contact, on the motions that
leave the points that touch together, where n is the object's normal and h the radius of the finger:

    int psi x t ds - psi x h n = u + phi x a
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.chain import ChainFinger, ChainTouch, FingerChain, skew, twice_turned
from continuum_grasp.grasp.certificate.check import EXACT

UNIT = 0.25
"""Shift of the object, per length of the first finger, that counts as much as a turn by 1 rad [1]."""
CREEPS = 0.2
"""Least eigenvalue in units of E I / L of the first finger above which a grasp is stable. Of 16 random grasps simulated
by MuJoCo, for which it is 0.01 N m, those between 0 and it crept by up to 1 mm and 1.7 degrees within 2 s, the 8 above
it moved by 0.14 mm at most, and those below 0 turned away."""
SWINGS = 0.1
"""Part of the least mode that is the object's, below which a finger moves and the object hardly does."""
ASIDE = 0.03
"""Greatest displacement of a contact out of its finger's plane, per length of the finger [1]. The theory is linear in
it: contacts lie off within the plane by about 8 times its square, per length, which is 0.8 mm of 120 mm there. Of 14
random hands one with 0.05 moved by 1.7 mm, the others by 0.07 mm at most (``benchmarks.hand_turned``)."""


@dataclass(frozen=True)
class SpatialStability:
    """Verdict of the second-order test in space."""

    # Least one of the reduced Hessian in units of E I / L of the first finger, and in N m with shifts of the object per
    # 30 mm and turns in radians; infinite where no motion is left.
    eigenvalue: float
    stiffness: float
    motion: str = ""  # how what is least stable moves, in words; empty where nothing can
    # Of the object in that motion: shift per quarter of the first finger, turn about the center of mass.
    mode: Array = field(default_factory=lambda: np.zeros(6), compare=False)
    assumptions: str = ""
    # Displacement of a planar scene's object out of the plane by the weight that friction carries, to first order [m].
    sinks: float = 0.0

    @property
    def stable(self) -> bool:
        """Whether the least eigenvalue is above the margin below which grasps creep."""
        return bool(self.eigenvalue > CREEPS)

    @property
    def word(self) -> str:
        """Verdict in one word."""
        return "stable" if self.stable else "creeps" if self.eigenvalue > 0.0 else "unstable"

    def data(self) -> dict[str, Any]:
        """The verdict as plain data."""
        names = "stable", "eigenvalue", "stiffness", "motion", "assumptions", "sinks"
        return {**{name: getattr(self, name) for name in names}, "mode": self.mode.tolist()}

    def __str__(self) -> str:
        least = f"{self.word} ({self.eigenvalue:.3g} E I / L; {CREEPS:g} needed)"
        return f"{least}: {self.motion}" if self.motion else least


def held_directions(rows: Array) -> Array:
    """Orthonormal directions (n, m) in which constraints hold motions; those that are dependent count once."""
    if not len(rows):
        return np.zeros((rows.shape[1], 0))
    _, singular, directions = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(directions[singular > EXACT * singular[0]].T)


def least_mode(hessian: Array, held: Array) -> tuple[float, Array]:
    """Least eigenvalue of a Hessian on the motions besides those that are held (n, m), and its mode (n,)."""
    # In the directions that are held, an eigenvalue that is not the least.
    reduced = hessian - held @ (held.T @ hessian)
    reduced -= (reduced @ held) @ held.T
    reduced += np.abs(reduced).sum(axis=1).max() * (held @ held.T)
    values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.T))
    return float(values[0]), np.asarray(vectors[:, 0])


class SpatialSystem:
    """Fingers and the object that they hold: turns of all fingers' links, shift and turn of the object.

    ``hessian`` (n, n) and ``rows`` (m, n), the constraints, are in coordinates per ``scale`` once they were taken.
    """

    def __init__(self, fingers: Sequence[ChainFinger], gravity: Array, com: Array, links: int) -> None:
        self.com = com
        self.chains = [FingerChain(finger, gravity, links) for finger in fingers]
        ends = np.cumsum([0, *(chain.size for chain in self.chains)])
        self.spans = [slice(int(a), int(b)) for a, b in pairwise(ends)]
        self.size = int(ends[-1]) + 6
        unit = [UNIT * fingers[0].length] * 3
        self.scale = np.concatenate([*(chain.scale for chain in self.chains), unit, [1.0] * 3])
        self.hessian = np.zeros((self.size, self.size))
        self.rows = np.zeros((0, self.size))
        for chain, span in zip(self.chains, self.spans, strict=True):
            self.hessian[span, span] = chain.hessian()

    def pinned(self, contact: ChainTouch, finger: int) -> Array:
        """Rows (3, n) of a finger's contact, whose points stay together."""
        row = self.supported(contact.point, contact.load)
        row[:, self.spans[finger]] = self.chains[finger].motion(contact)
        return row

    def twisted(self, contact: ChainTouch, finger: int) -> Array:
        """Row (n,) of a contact of a finger that turns about the normal with the object; to first order."""
        row = np.zeros(self.size)
        row[self.spans[finger]] = self.chains[finger].turn(contact, contact.normal)
        row[-3:] = -contact.normal
        return row

    def supported(self, point: Array, load: Array) -> Array:
        """Rows (3, n) of a point of the object that stays; the load there keeps its direction."""
        place = point - self.com
        row = np.zeros((3, self.size))
        row[:, -6:-3], row[:, -3:] = -np.eye(3), skew(place)
        self.hessian[-3:, -3:] += twice_turned(load, place)
        return row

    def take(self, rows: Sequence[Array]) -> None:
        """Take the constraints, and scale all coordinates."""
        self.rows = np.concatenate([self.rows, *rows]) * self.scale
        self.hessian = self.hessian * np.outer(self.scale, self.scale)

    def moving_finger(self, vector: Array) -> tuple[str, bool] | None:
        """Name of the finger that moves most, and whether to the side; None where the object moves."""
        if float(vector[-6:] @ vector[-6:]) >= SWINGS:
            return None
        shares = [float(vector[span] @ vector[span]) for span in self.spans]
        k = int(np.argmax(shares))
        chain = self.chains[k]
        part = vector[self.spans[k]]
        bends = (part.reshape(-1, 3) * chain.frames[:, :, 2]).sum(axis=1)
        return chain.finger.name, float(bends @ bends) < 0.5 * shares[k]
