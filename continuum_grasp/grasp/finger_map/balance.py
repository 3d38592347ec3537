"""Fingers and supports in one balance of the object: combinations of samples, settled to the least tension.

Unknowns of a combination are the numbers of each finger's equilibrium, normal force and friction of each support, and
the lift of each contact where friction carries a weight out of the plane.
"""

from __future__ import annotations

import cmath
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, combinations

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.finger_map.fill import FingerMap
from continuum_grasp.grasp.finger_map.jets import Jet
from continuum_grasp.grasp.finger_map.rod import MapFinger, Traced
from continuum_grasp.grasp.starts.supports import support_contacts
from continuum_grasp.grasp.starts.values import Pose
from continuum_grasp.scene import GraspScene

CANDIDATES, APART = 120, 0.12
"""Most combinations per finger that are settled, and how far they differ: places in a third of the length."""
WEIGHTS = (3.0, 0.3)
"""Weights of what is out of balance, per weight of the object, beside the tensions per their greatest, by which
combinations are chosen: of either half of them."""
PICKED = {1: 100_000, 2: 100_000, 3: 300, 4: 90}
"""Most samples of each finger but the last that are combined with others, by the number of fingers."""
SUPPORTED = {1: 100_000, 2: 330, 3: 48, 4: 18}
"""Most samples of each finger beside supports, where all combinations are tried."""
ROUNDS = 30
"""Steps in which combinations are settled."""
REFINED, STIFF = 15, 1e6
"""Steps in which the best of them are brought to their optimum, and the penalty of a residual of one there."""
SETTLED = 4e-3
"""Residual beyond which a settled combination is none."""


@dataclass(frozen=True)
class _Reached:
    """B combinations with the values of their constraints."""

    x: Array  # (B, n)
    value: Array  # (B, m) of constraints, those that vanish first
    slope: Array  # (B, m, n)
    tension: Jet  # per the greatest
    equal: Array  # (m,) which constraints vanish; the others are not above zero

    @property
    def active(self) -> Array:
        """Constraints that act (B, m)."""
        return np.asarray((self.value > 0.0) | self.equal)

    @property
    def wrong(self) -> Array:
        """Residuals (B, m)."""
        return np.where(self.active, self.value, 0.0)

    def merit(self, stiff: float) -> Array:
        """Tensions and penalties (B,)."""
        return np.asarray(self.tension.value + 0.5 * stiff * (self.wrong**2).sum(axis=1))

    def where(self, chosen: Array, other: _Reached) -> _Reached:
        """Rows of this where chosen (B,), those of the other elsewhere."""
        wide = chosen[:, None]
        tension = Jet(
            np.where(chosen, self.tension.value, other.tension.value),
            np.where(wide, self.tension.slope, other.tension.slope),
        )
        slope = np.where(wide[..., None], self.slope, other.slope)
        return _Reached(
            np.where(wide, self.x, other.x), np.where(wide, self.value, other.value), slope, tension, self.equal
        )


@dataclass(frozen=True)
class Settled:
    """B combinations that were settled."""

    x: Array  # (B, n)
    off: Array  # (B,) greatest residuals
    tension: Array  # (B,) sums of the tensions [N]
    places: Array  # (B, 2 C) of the contacts of fingers [m]

    @staticmethod
    def of(balance: ObjectBalance, reached: _Reached) -> Settled:
        traced = balance.traced(reached.x, slopes=False)
        parts = [part.value * at.finger.length for at in traced for part in at.touches.place]
        places = np.concatenate(parts, axis=1)
        tension = np.sum([at.tension for at in traced], axis=0)
        return Settled(reached.x, np.abs(reached.wrong).max(axis=1), tension, places)

    def different(self, size: float) -> list[int]:
        """Rows within the limits that differ, before an object of a size [m], those of least tension first."""
        rows: list[int] = []
        for row in np.argsort(self.tension, kind="stable").tolist():
            # 0.03 of the size, 1 % of the tension
            alike = (
                np.linalg.norm(self.places[row] - self.places[other]) < 0.03 * size
                and abs(self.tension[row] - self.tension[other]) < 0.01 * self.tension[other] + 1e-6
                for other in rows
            )
            if self.off[row] <= SETTLED and not any(alike):
                rows.append(row)
        return rows


@dataclass(frozen=True)
class ObjectContacts:
    """C contacts of B combinations, in SI units and world axes: those of fingers, then those with supports."""

    point: tuple[Jet, Jet]
    normal: tuple[Jet, Jet]
    force: tuple[Jet, Jet]  # on the finger or support


class ObjectBalance:
    """The balance of a scene's object with a set of contacts, its fingers as they are in their maps."""

    def __init__(self, scene: GraspScene, on: frozenset[str], fingers: Sequence[MapFinger], pose: Pose) -> None:
        self.scene, self.on, self.fingers, self.pose = scene, on, fingers, pose
        turn, origin = cmath.exp(1j * pose[2]), complex(*pose[:2])
        self.center = origin + turn * complex(*scene.object.com)
        self.size = scene.object.size
        self.weight = scene.object.mass * np.array(scene.gravity_in_plane)
        self.lift = scene.weight if scene.lifted else 0.0
        self.supports = support_contacts(scene, pose, {name for name in on if scene.support_of(name) is not None})
        self._places = {
            name: (origin + turn * complex(*start.point), turn * cmath.exp(1j * start.normal_angle))
            for name, start in self.supports.items()
        }
        self.names = [[*f.names, *([f.setup.tip_name] if f.tip else [])] for f in fingers]
        contacts = sum(map(len, self.names)) + len(self.supports)
        self.at = np.cumsum([0, *(f.numbers for f in fingers)])
        self.first_lift = int(self.at[-1]) + 2 * len(self.supports)
        self.numbers = self.first_lift + (contacts if self.lift else 0)
        self.greatest = sum(f.setup.max_tension for f in fingers)
        frictions = [[f.friction] * len(names) for f, names in zip(fingers, self.names, strict=True)]
        forces = [[f.setup.normal_force_max] * len(names) for f, names in zip(fingers, self.names, strict=True)]
        self._frictions = np.array([*chain(*frictions), *map(scene.held_friction, self._places)])
        self._greatest_forces = np.array([*chain(*forces), *map(scene.normal_force_max, self._places)])
        bends = [0.02 * f.greatest_moment * f.moment / self.size for f in fingers]
        self.force = max(float(np.abs(self.weight).max()), self.lift, sum(bends))

    # -- settling ----------------------------------------------------------------------------------------------

    def traced(self, x: Array, *, slopes: bool = True) -> list[Traced]:
        """The fingers of combinations (B, n)."""
        return [
            f.traced(x[:, a:b], slopes=slopes) for f, a, b in zip(self.fingers, self.at[:-1], self.at[1:], strict=True)
        ]

    def _wide(self, k: int, jet: Jet, unit: float = 1.0) -> Jet:
        """A jet of a finger's numbers as one of all."""
        return (jet * unit).among(int(self.at[k]), self.numbers)

    def _numbers(self, x: Array, places: slice) -> Jet:
        """Forces among the unknowns (B, C)."""
        slope = np.broadcast_to(
            self.force * np.eye(self.numbers)[places], (len(x), *np.eye(self.numbers)[places].shape)
        )
        return Jet(self.force * x[:, places], slope)

    def contacts(self, x: Array, traced: list[Traced]) -> ObjectContacts:
        """All contacts that are on."""
        parts = list[tuple[Jet, ...]]()
        for k, (finger, at) in enumerate(zip(self.fingers, traced, strict=True)):
            on, touches = finger.middles + finger.tip, at.touches
            units = (finger.length, finger.length, 1.0, 1.0, finger.force, finger.force)
            pairs = (*touches.skin, *touches.normal, *touches.force)
            parts.append(
                tuple(
                    self._wide(k, Jet(jet.value[:, :on], jet.slope[:, :on]), unit)
                    for jet, unit in zip(pairs, units, strict=True)
                )
            )
        if self._places:
            point, normal = (np.array([place[k] for place in self._places.values()]) for k in (0, 1))
            still = np.zeros((len(x), len(point), self.numbers))
            fixed = (
                np.broadcast_to(part, still.shape[:2]) for part in (point.real, point.imag, normal.real, normal.imag)
            )
            first, end = int(self.at[-1]), self.first_lift
            forces = self._numbers(x, slice(first, end, 2)), self._numbers(x, slice(first + 1, end, 2))
            parts.append((*(Jet(part, still) for part in fixed), *forces))
        px, py, nx, ny, normal_force, friction = (first.followed_by(*rest) for first, *rest in zip(*parts, strict=True))
        return ObjectContacts((px, py), (nx, ny), (normal_force, friction))

    def residual(self, x: Array, traced: list[Traced]) -> tuple[Jet, Jet, Jet]:
        """Constraints that vanish, those that are not above zero, scaled, and the tensions per their greatest."""
        tension = Jet(np.zeros(len(x)), np.zeros(x.shape))
        for k, (finger, at) in enumerate(zip(self.fingers, traced, strict=True)):
            # 1e-3: rounding of the greatest moment, else straight fingers stall
            share = (finger.setup.max_tension - finger.least_tension) / self.greatest
            tension += self._wide(k, at.pull.size(1e-3), share)
        contacts = self.contacts(x, traced)
        (px, py), (nx, ny), (normal, along) = contacts.point, contacts.normal, contacts.force
        fx, fy = normal * nx - along * ny, normal * ny + along * nx
        rx, ry = (px - self.center.real) * (1 / self.size), (py - self.center.imag) * (1 / self.size)
        # What the fingers bear acts on the object with the other sign.
        balance = [-fx.summed() + self.weight[0], -fy.summed() + self.weight[1], (ry * fx - rx * fy).summed()]
        shear = [along]
        if self.lift:
            up = self._numbers(x, slice(self.first_lift, self.numbers))
            shear.append(up)
            balance += [up.summed() - self.lift]
            if self.scene.balances_tilt:
                balance += [(rx * up).summed(), (ry * up).summed()]
        # 0.3: a force of the object's weight counts as much as so many lengths
        unit = 0.3 / self.force
        cone = (Jet.norm(shear, 1e-8 * self.force) - self._frictions * normal) * unit
        below = [cone, -normal * unit, normal * (1.0 / self._greatest_forces) - 1.0]
        equal = [self._wide(k, at.conditions) for k, at in enumerate(traced)]
        equal += [row.beside() * unit for row in balance]
        shapes = [self._wide(k, at.shape_limits) for k, at in enumerate(traced)]
        return equal[0].followed_by(*equal[1:]), shapes[0].followed_by(*shapes[1:], *below), tension

    def settle(self, x: Array) -> Settled:
        """Combinations (B, n) of least tension under all constraints, all at once: a penalty that grows, and damped
        steps of Gauss and Newton.
        """
        here, scale, damping = self._reached(x), self._steps(), np.full(len(x), 1e-2)
        for round_ in range(ROUNDS):
            stiff = 30.0 * 1000.0 ** min(1.0, round_ / (0.6 * ROUNDS))
            merit, slope = here.merit(stiff), here.slope * scale
            across = slope.transpose(0, 2, 1)
            gradient = stiff * (across @ here.wrong[..., None])[..., 0] + here.tension.slope * scale
            square = stiff * (across * here.active[:, None]) @ slope
            going = np.ones(len(x), bool)
            # 4: dampings that are tried
            for _ in range(4):
                matrix = square + damping[:, None, None] * np.eye(self.numbers)
                move = -np.linalg.solve(matrix, gradient[..., None])[..., 0]
                move *= np.minimum(1.0, 0.5 / np.maximum(np.abs(move).max(axis=1), 1e-12))[:, None]
                there = self._reached(here.x + np.where(going[:, None], move * scale, 0.0))
                better = going & (there.merit(stiff) < merit)
                here = there.where(better, here)
                damping = np.where(better, 0.3 * damping, np.where(going, 5.0 * damping, damping)).clip(1e-7, 1e6)
                going &= ~better
                if not going.any():
                    break
        return Settled.of(self, here)

    def refined(self, x: Array) -> Settled:
        """Settled combinations brought to the optimum next to them.

        Each step is the minimum of the tension and a stiff penalty of all constraints, to first order, within a radius
        that grows and shrinks as the step keeps what it promises.
        """
        here, scale, radius = self._reached(x), self._steps(), np.full(len(x), 0.1)
        for _ in range(REFINED):
            slope = here.slope * scale
            move = _first_order(here.tension.slope * scale, slope, here.value, here.equal)
            move *= np.minimum(1.0, radius / np.maximum(np.abs(move).max(axis=1), 1e-12))[:, None]
            plain = self._reached(here.x + move * scale)
            # What curved constraints left over, by the same slopes: else steps along them are short.
            back = _first_order(0.0 * move, slope, plain.value, here.equal)
            there = self._reached(plain.x + back * scale)
            there = there.where(there.merit(STIFF) < plain.merit(STIFF), plain)
            better = there.merit(STIFF) < here.merit(STIFF)
            here, step = there.where(better, here), np.abs(move).max(axis=1)
            radius = np.where(better, np.maximum(radius, 2.0 * step), 0.25 * np.minimum(radius, step))
            if radius.max() < 1e-9 or (better.any() and step[better].max() < 1e-9):
                break
        return Settled.of(self, here)

    def _steps(self) -> Array:
        """Steps of the numbers that change a combination alike (n,)."""
        steps = np.ones(self.numbers)
        for a, finger in zip(self.at[:-1], self.fingers, strict=True):
            steps[a + 1 : a + 4] = 5.0
            for c in range(finger.middles):
                steps[a + 4 + 3 * c : a + 7 + 3 * c] = 0.2, 5.0, 5.0
        return steps

    def _reached(self, x: Array) -> _Reached:
        equal, below, tension = self.residual(x, self.traced(x))
        rows = equal.followed_by(below)
        # 1e6: of a rod that makes a few turns slopes are below 1e4; what coils up without end is as wrong as can be
        lost = ~(np.abs(rows.slope) < 1e6).all(axis=(1, 2))
        rows.value[lost], rows.slope[lost] = 1e3, 0.0
        return _Reached(x, rows.value, rows.slope, tension, np.arange(rows.value.shape[1]) < equal.value.shape[1])

    # -- combining ---------------------------------------------------------------------------------------------

    def candidates(self, maps: Sequence[FingerMap]) -> Array:
        """Combinations (B, n) of samples that balance the object best for their tension, and differ."""
        wrenches = [self._wrench(k, one.samples) for k, one in enumerate(maps)]
        if any(len(wrench) == 0 for wrench in wrenches):
            return np.zeros((0, self.numbers))
        index = self._combined(wrenches)
        total = self._loads + sum(w[index[:, k]] for k, w in enumerate(wrenches))
        forces, left = self._supported(-total)
        tension = sum(one.samples.tension[index[:, k]] for k, one in enumerate(maps))
        short = self._unlifted(maps, index, forces) if self.lift else 0.0
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
        if self.lift:
            # Shared alike at first.
            x[:, self.first_lift :] = self.lift / (self.numbers - self.first_lift) / self.force
        return x

    @property
    def _loads(self) -> Array:
        return np.array([*self.weight, 0.0])

    def _wrench(self, k: int, at: Traced) -> Array:
        """Wrench of a finger on the object (B, 3): force, moment per size [N]."""
        finger, touches = self.fingers[k], at.touches
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
        others, last = picks[:-1], np.arange(len(wrenches[-1]))
        index = np.stack(np.meshgrid(*others, indexing="ij"), axis=-1).reshape(-1, count - 1)
        need = -(self._loads + sum(wrenches[k][index[:, k]] for k in range(count - 1)))
        from scipy.spatial import cKDTree

        tree = cKDTree(wrenches[-1][last] / self.force)
        # 3: samples of the last finger per combination of the others
        nearest = min(3, len(last))
        _, found = tree.query(need / self.force, k=nearest)
        found = found.reshape(len(need), nearest)
        return np.concatenate([np.column_stack([index, last[found[:, k]]]) for k in range(nearest)])

    def _supported(self, need: Array) -> tuple[Array, Array]:
        """Forces of supports (B, 2 S) within their cones that come nearest to wrenches (B, 3) [N], and what is left."""
        size = 2 * len(self._places)
        best = np.linalg.norm(need, axis=1)
        forces = np.zeros((len(need), size))
        edges, effects = [], []
        for j, (name, (point, normal)) in enumerate(self._places.items()):
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
                left = np.linalg.norm(need - share @ effect.T, axis=1)
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
        for j, name in enumerate(self._places):
            normal, along = forces[:, 2 * j], forces[:, 2 * j + 1]
            carried += np.sqrt(np.maximum((self.scene.held_friction(name) * normal) ** 2 - along**2, 0.0))
        return np.maximum(self.lift - carried, 0.0)

    def _differing(self, maps: Sequence[FingerMap], index: Array, score: Array) -> Array:
        """The best that differ: by places of contacts, direction of tips, forces."""
        columns = []
        for k, one in enumerate(maps):
            touches = one.samples.touches
            nx, ny = (part.value[:, -1:] for part in touches.normal)
            turn = 0.7 * np.concatenate([nx, ny], axis=1) / np.hypot(nx, ny)
            force = 0.3 * np.arcsinh(0.3 * touches.force[0].value)
            columns.append(
                np.concatenate([*(3.0 * part.value for part in touches.place), force, turn], axis=1)[index[:, k]]
            )
        order = np.argsort(score, kind="stable")[:20_000]
        place, chosen = np.concatenate(columns, axis=1), list[int]()
        while len(order) and len(chosen) < CANDIDATES * len(self.fingers) // len(WEIGHTS):
            chosen.append(order[0])
            order = order[np.linalg.norm(place[order] - place[order[0]], axis=1) > APART]
        return np.array(chosen, int)


def _first_order(gradient: Array, slope: Array, value: Array, equal: Array) -> Array:
    """Steps (B, n) to the least of the tension and the penalties, both of first order: Newton's method on the active
    ones, of which there are finitely many sets.
    """
    count, _, size = slope.shape
    across, move = slope.transpose(0, 2, 1), np.zeros((count, size))
    here = value
    for _ in range(20):
        active = (here > 0.0) | equal
        wrong = np.where(active, here, 0.0)
        force = gradient + STIFF * (across @ wrong[..., None])[..., 0] + 1e-4 * move
        square = STIFF * (across * active[:, None]) @ slope + 1e-4 * np.eye(size)
        step = -np.linalg.solve(square, force[..., None])[..., 0]
        change = (slope @ step[..., None])[..., 0]
        best, share = np.full(count, np.inf), np.ones(count)
        for part in (1.0, 0.5, 0.25, 0.1, 0.03):
            there = np.where(equal, here + part * change, np.maximum(here + part * change, 0.0))
            to = move + part * step
            cost = (gradient * to).sum(axis=1) + 0.5 * STIFF * (there**2).sum(axis=1) + 0.5e-4 * (to**2).sum(axis=1)
            share = np.where(cost < best, part, share)
            best = np.minimum(cost, best)
        move = move + share[:, None] * step
        here = here + share[:, None] * change
        settled = (share == 1.0) & (((here > 0.0) | equal) == active).all(axis=1)
        if (settled | (np.abs(step).max(axis=1) < 1e-10)).all():
            break
    return move
