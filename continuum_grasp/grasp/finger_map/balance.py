"""Fingers and supports in one balance of the object: combinations of samples, settled to the least tension.

Unknowns of a combination are the numbers of each finger's equilibrium, normal force and friction of each support, and
the lift of each contact where friction carries a weight out of the plane.
"""

from __future__ import annotations

import cmath
import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.finger_map.fill import FingerMap
from continuum_grasp.grasp.finger_map.rod import MapFinger, Traced, call, slopes_beside
from continuum_grasp.grasp.object_supports import Pose, support_contacts
from continuum_grasp.scene import GraspScene

CANDIDATES, APART = 120, 0.12
"""Most combinations per finger that are settled, and how far they differ: places in a third of the length."""
MANY = 20_000
"""Combinations of the best score among which those that differ are looked for."""
WEIGHTS = (3.0, 0.3)
"""Weights of forces out of balance, per weight of the object, beside the tensions per their greatest, by which
combinations are chosen: of either half of them."""
PICKED = {1: 100_000, 2: 100_000, 3: 300, 4: 90}
"""Most samples of each finger but the last that are combined with others, by the number of fingers."""
SUPPORTED = {1: 100_000, 2: 330, 3: 48, 4: 18}
"""Most samples of each finger beside supports, where all combinations are tried."""
ROUNDS = 30
"""Steps in which combinations are settled."""
SETTLED = 4e-3
"""Residual beyond which a settled combination is none."""


class _BalanceStruct(ctypes.Structure):
    """The structure of `balance.c`."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("fingers", "supports", "contacts", "lifted", "tilts")),
        *((name, ctypes.c_int) for name in ("numbers", "equal", "rows")),
        ("center", ctypes.c_double * 2),
        ("size", ctypes.c_double),
        ("weight", ctypes.c_double * 2),
        ("lift", ctypes.c_double),
        ("force", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("rod", "finger", "support", "cone", "step")),
    )


@dataclass(frozen=True)
class Settled:
    """B combinations that were settled."""

    x: Array  # (B, n)
    off: Array  # (B,) greatest residuals
    tension: Array  # (B,) sums of the tensions [N]
    places: Array  # (B, 2 C) of the contacts of fingers [m]

    @staticmethod
    def of(balance: ObjectBalance, x: Array, off: Array) -> Settled:
        traced = balance.traced(x, slopes=False)
        parts = [part.value * at.finger.length for at in traced for part in at.touches.place]
        places = np.concatenate(parts, axis=1)
        tension = np.sum([at.tension for at in traced], axis=0)
        return Settled(x, off, tension, places)

    def holding(self, size: float) -> list[int]:
        """Rows within the limits that differ, before an object of a size [m], in order of tension."""
        order = np.argsort(self.tension, kind="stable")
        return self._different(size, order[self.off[order] <= SETTLED])

    def nearest(self, size: float) -> list[int]:
        """Rows that differ, in order of their residuals."""
        return self._different(size, np.argsort(self.off, kind="stable"))

    def _different(self, size: float, order: Array) -> list[int]:
        rows: list[int] = []
        for row in order.tolist():
            # 0.03 of the size, 1 % of the tension
            near = np.linalg.norm(self.places[rows] - self.places[row], axis=1) < 0.03 * size
            tensions = self.tension[rows]
            if not np.any(near & (np.abs(tensions - self.tension[row]) < 0.01 * tensions + 1e-6)):
                rows.append(row)
        return rows


class ObjectBalance:
    """The balance of a scene's object with a set of contacts, and its fingers as they are in their maps."""

    def __init__(self, scene: GraspScene, on: frozenset[str], fingers: Sequence[MapFinger], pose: Pose) -> None:
        self.scene = scene
        self.on = on
        self.fingers = fingers
        self.pose = pose
        turn = cmath.exp(1j * pose[2])
        origin = complex(*pose[:2])
        self.center = origin + turn * complex(*scene.object.com)
        self.size = scene.object.size
        self.weight = scene.object.mass * np.array(scene.gravity[:2])
        self.lift = -scene.object.mass * scene.gravity[2]
        self.supports = support_contacts(scene, pose, {name for name in on if scene.support_of(name) is not None})
        self.places = {
            name: (origin + turn * complex(*start.point), turn * cmath.exp(1j * start.normal_angle))
            for name, start in self.supports.items()
        }
        self.names = [[*f.names, *([f.setup.tip_name] if f.tip else [])] for f in fingers]
        contacts = sum(map(len, self.names)) + len(self.supports)
        self.at = np.cumsum([0, *(f.numbers for f in fingers)])
        self.first_lift = int(self.at[-1]) + 2 * len(self.supports)
        self.numbers = self.first_lift + (contacts if scene.spatial else 0)
        self.greatest = sum(f.setup.max_tension for f in fingers)
        frictions = [[f.friction] * len(names) for f, names in zip(fingers, self.names, strict=True)]
        forces = [[f.setup.normal_force_max] * len(names) for f, names in zip(fingers, self.names, strict=True)]
        frictions.append(list(map(scene.held_friction, self.places)))
        forces.append(list(map(scene.normal_force_max, self.places)))
        bends = [0.02 * f.greatest_moment * f.moment / self.size for f in fingers]
        self.force = max(float(np.abs(self.weight).max()), abs(self.lift), sum(bends))
        shares = [(f.setup.max_tension - f.least_tension) / self.greatest for f in fingers]
        self._arrays = {
            "rod": np.array([ctypes.addressof(f.struct) for f in fingers], np.uintp),
            "finger": np.array([[f.length, f.force, share] for f, share in zip(fingers, shares, strict=True)]),
            "support": np.array([[p.real, p.imag, n.real, n.imag] for p, n in self.places.values()] or [[0.0] * 4]),
            "cone": np.column_stack([list(chain(*frictions)), list(chain(*forces))]),
            "step": self._steps(),
        }
        equal = sum(f.conditions for f in fingers) + len(scene.balances)
        self.struct = _BalanceStruct(
            fingers=len(fingers),
            supports=len(self.supports),
            contacts=contacts,
            lifted=2 in scene.balances,
            tilts=3 in scene.balances,
            numbers=self.numbers,
            equal=equal,
            rows=equal + sum(f.shape_limits for f in fingers) + 3 * contacts,
            center=(self.center.real, self.center.imag),
            size=self.size,
            weight=tuple(self.weight),
            lift=self.lift,
            force=self.force,
        )
        for name, array in self._arrays.items():
            setattr(self.struct, name, array.ctypes.data)

    # -- settling ----------------------------------------------------------------------------------------------

    def forces(self, x: Array, traced: Sequence[Traced]) -> tuple[Array, Array]:
        """Normal forces and friction (B, C) of all contacts that are on, those with supports last [N]."""
        borne = self.force * x[:, self.at[-1] : self.first_lift]
        parts = [
            [part.value[:, : f.middles + f.tip] * f.force for part in at.touches.force]
            for f, at in zip(self.fingers, traced, strict=True)
        ]
        normal, friction = zip(*parts, (borne[:, ::2], borne[:, 1::2]), strict=True)
        return np.concatenate(normal, axis=1), np.concatenate(friction, axis=1)

    def traced(self, x: Array, *, slopes: bool = True) -> list[Traced]:
        """The fingers of combinations (B, n)."""
        return [
            f.traced(x[:, a:b], slopes=slopes) for f, a, b in zip(self.fingers, self.at[:-1], self.at[1:], strict=True)
        ]

    def settle(self, x: Array) -> Settled:
        """Combinations (B, n) brought to the least tension under all constraints."""
        x, off = np.array(x, dtype=float, order="C"), np.empty(len(x))
        lanes, wide = slopes_beside(max(finger.numbers for finger in self.fingers))
        if not call(lanes, "settle", self.struct, len(x), ROUNDS, x, off, wide=wide):
            raise MemoryError
        return Settled.of(self, x, off)

    def _steps(self) -> Array:
        """Steps of the numbers that change a combination alike (n,)."""
        steps = np.ones(self.numbers)
        for a, finger in zip(self.at[:-1], self.fingers, strict=True):
            steps[a + 1 : a + 4] = 5.0
            for c in range(finger.middles):
                steps[a + 4 + 3 * c : a + 7 + 3 * c] = 0.2, 5.0, 5.0
        return steps

    # -- combining ---------------------------------------------------------------------------------------------

    def candidates(self, maps: Sequence[FingerMap]) -> Array:
        """Combinations (B, n) of samples that balance the object best for their tension, and differ."""
        wrenches = [self.wrench(k, one.samples) for k, one in enumerate(maps)]
        if any(len(wrench) == 0 for wrench in wrenches):
            return np.zeros((0, self.numbers))
        index = self._combined(wrenches)
        total = self.loads + sum(w[index[:, k]] for k, w in enumerate(wrenches))
        forces, left = self._supported(-total)
        tension = sum(one.samples.tension[index[:, k]] for k, one in enumerate(maps))
        short = self._unlifted(maps, index, forces)
        chosen = np.unique(
            [
                row
                for weight in WEIGHTS
                for row in self._differing(maps, index, tension / self.greatest + weight * (left + short) / self.force)
            ]
        ).astype(int)
        x = np.zeros((len(chosen), self.numbers))
        for k, one in enumerate(maps):
            x[:, self.at[k] : self.at[k + 1]] = one.samples.z[index[chosen, k]]
        x[:, self.at[-1] : self.first_lift] = forces[chosen] / self.force
        if self.scene.spatial:
            # Shared alike at first.
            x[:, self.first_lift :] = self.lift / (self.numbers - self.first_lift) / self.force
        return x

    @property
    def loads(self) -> Array:
        """Force [N] of the weight of the object, and its moment per size (3,)."""
        return np.array([*self.weight, 0.0])

    def wrench(self, k: int, at: Traced) -> Array:
        """Wrench of a finger on the object (B, 3): force, moment per size [N]."""
        finger = self.fingers[k]
        touches = at.touches
        on = finger.middles + finger.tip
        nx, ny = (part.value[:, :on] for part in touches.normal)
        normal, along = (part.value[:, :on] * finger.force for part in touches.force)
        fx, fy = normal * nx - along * ny, normal * ny + along * nx
        centers = self.center.real, self.center.imag
        rx, ry = (
            (part.value[:, :on] * finger.length - center) / self.size
            for part, center in zip(touches.skin, centers, strict=True)
        )
        return np.asarray(-np.stack([fx, fy, rx * fy - ry * fx], axis=2).sum(axis=1))

    def _combined(self, wrenches: Sequence[Array]) -> Array:
        """Indices (B, fingers) of samples that may balance each other."""
        count = len(wrenches)
        most = (SUPPORTED if self.supports else PICKED)[count]
        picks = [np.unique(np.linspace(0, len(w) - 1, min(len(w), most)).astype(int)) for w in wrenches]
        if count == 1 or self.supports:
            return np.stack(np.meshgrid(*picks, indexing="ij"), axis=-1).reshape(-1, count)
        others = picks[:-1]
        last = np.arange(len(wrenches[-1]))
        index = np.stack(np.meshgrid(*others, indexing="ij"), axis=-1).reshape(-1, count - 1)
        need = -(self.loads + sum(wrenches[k][index[:, k]] for k in range(count - 1)))
        # 3: samples of the last finger per combination of the others
        nearest = min(3, len(last))
        found = _nearest(wrenches[-1] / self.force, need / self.force, nearest)
        return np.concatenate([np.column_stack([index, last[found[:, k]]]) for k in range(nearest)])

    def _supported(self, need: Array) -> tuple[Array, Array]:
        """Forces of supports (B, 2 S) within their cones that come nearest to wrenches (B, 3) [N], and the
        remainder.
        """
        size = 2 * len(self.places)
        best = _sizes(need)
        forces = np.zeros((len(need), size))
        edges, effects = [], []
        for j, (name, (point, normal)) in enumerate(self.places.items()):
            arm = (point - self.center) / self.size
            for use in (1.0, -1.0):
                mu = use * self.scene.held_friction(name)
                force = normal * (1.0 + 1j * mu)
                edge = np.zeros(size)
                edge[2 * j], edge[2 * j + 1] = 1.0, mu
                edges.append(edge)
                effects.append(-np.array([force.real, force.imag, (arm.conjugate() * force).imag]))
        # Every face of the cone that the edges span.
        for count in range(1, min(3, len(edges)) + 1):
            for face in combinations(range(len(edges)), count):
                effect = np.stack([effects[k] for k in face], axis=1)
                if np.linalg.matrix_rank(effect) < count:
                    continue
                share = need @ np.linalg.pinv(effect).T
                left = _sizes(need - share @ effect.T)
                better = (share >= -1e-12).all(axis=1) & (left < best - 1e-12)
                best = np.where(better, left, best)
                forces[better] = share[better] @ np.stack([edges[k] for k in face])
        return forces, best

    def _unlifted(self, maps: Sequence[FingerMap], index: Array, forces: Array) -> Array:
        """Weight (B,) that the friction left over does not lift [N]."""
        carried = np.zeros(len(index))
        for k, (finger, one) in enumerate(zip(self.fingers, maps, strict=True)):
            on = finger.middles + finger.tip
            normal, along = (part.value[:, :on] * finger.force for part in one.samples.touches.force)
            spare = np.sqrt(np.maximum((finger.friction * normal) ** 2 - along**2, 0.0)).sum(axis=1)
            carried += spare[index[:, k]]
        for j, name in enumerate(self.places):
            normal = forces[:, 2 * j]
            along = forces[:, 2 * j + 1]
            carried += np.sqrt(np.maximum((self.scene.held_friction(name) * normal) ** 2 - along**2, 0.0))
        return np.maximum(abs(self.lift) - carried, 0.0)

    def _differing(self, maps: Sequence[FingerMap], index: Array, score: Array) -> Array:
        """The best that differ: by places of contacts, direction of tips, forces."""
        most = CANDIDATES * len(self.fingers) // len(WEIGHTS)
        order = np.argsort(score, kind="stable") if len(score) <= MANY else _least(score, MANY)
        columns = []
        for k, one in enumerate(maps):
            touches = one.samples.touches
            nx, ny = (part.value[:, -1:] for part in touches.normal)
            turn = 0.7 * np.concatenate([nx, ny], axis=1) / np.hypot(nx, ny)
            force = 0.3 * np.arcsinh(0.3 * touches.force[0].value)
            features = np.concatenate([*(3.0 * part.value for part in touches.place), force, turn], axis=1)
            columns.append(features[index[order, k]])
        place = np.concatenate(columns, axis=1)
        chosen = np.empty(most, np.int32)
        return order[chosen[: call(0, "differing", *place.shape, most, APART, place, chosen)]]


def _sizes(vectors: Array) -> Array:
    """Lengths (B,) of vectors (B, 3)."""
    return np.asarray(np.sqrt(np.einsum("bi,bi->b", vectors, vectors)))


def _least(score: Array, count: int) -> Array:
    """Indices (count,) of the least scores, in order."""
    some = np.sort(np.argpartition(score, count)[:count])
    return np.asarray(some[np.argsort(score[some], kind="stable")])


def _nearest(points: Array, places: Array, count: int) -> Array:
    """Indices (B, count) of the points (P, 3) that are nearest to places (B, 3), the nearest first."""
    # 10,000,000: distances, of which 0.03 s find the nearest; to load scipy.spatial takes 150 ms
    if len(points) * len(places) > 10_000_000:
        from scipy.spatial import cKDTree

        return np.asarray(cKDTree(points).query(places, k=count)[1]).reshape(len(places), count)
    found = np.empty((len(places), count), np.int32)
    points, places = (np.ascontiguousarray(each, dtype=float) for each in (points, places))
    if not call(0, "closest", len(points), len(places), count, points, places, found):
        raise MemoryError
    return found
