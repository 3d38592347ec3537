"""Postures of a grasp with other friction states, found from the certificate's own statics.

What drives hold stays, and so do bases, and an object that touches a support. Of all postures that balance, that is
sought whose friction cones are farthest from their edge. Each step solves the equations to first order and maximizes
the reserve in the directions that they leave, with cones as they are (`continuum_grasp.grasp.certificate.reserve`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.certificate.check import PENETRATION
from continuum_grasp.grasp.certificate.recomputed import (
    RecomputedFinger,
    RecomputedGrasp,
    across,
    gravity_vector,
    known_contacts,
)
from continuum_grasp.grasp.certificate.reserve import NEAR, Limits, Reserve, greatest_reserve
from continuum_grasp.grasp.certificate.surfaces import Nearest, PlacedObject
from continuum_grasp.scene.families import FAMILIES
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity

Array = NDArray[Any]
Arrays = Mapping[str, Array]

YIELDS = 0.1
"""How far an object that fingers alone hold may move as friction changes: part of its size, and rad."""
EXACT = 1e-8
"""Residual of the equations of a posture, per what its checks are relative to: a hundredth of their limits."""
_STEPS, _LAST = 30, 8
"""Steps to one posture, of which the last ones only balance: 3 to 8 are enough next to one that is known."""
_SHORTER, _NEARER, _NEAREST = 0.5, 10.0, 1.0
"""Length of a step, per the last one, above which the cost of its length rises by a factor, and its greatest one [1]:
slack winches need 0.1."""
_CLOSE_BY = 0.03
"""Step after which slopes are taken anew (scaled unknowns)."""
_FARTHEST = 0.3
"""Greatest change of an unknown in one step: bends of elements [rad], parts of the greatest tension and so on."""
_SETTLED = 2e-6
"""What a further step promises of the reserve [1] below which a posture is taken for the best one."""
_DIFFERENCE = 1e-6
"""Of the difference quotients of the equations (scaled unknowns): what it leaves out is 1e-6 of them."""
_RANK = 1e-9
"""Singular value, per the greatest, below which an equation follows from others [1]."""
_BESIDE = 4
"""Panels of a rod, of which there are 400, beside a contact at which a finger need not keep off the object: next to it
it does so because it is tangent there."""
_BETWEEN, _DEEP = 1e-5, 0.9
"""How deep a finger may be in the object between stations, per length, and at most, per what the check lets pass."""
_CLOSE, _GUARD_UNIT = 0.02, 1e-3
"""Distance from the object within which places are guarded, and the unit of what keeps off, per length."""


@dataclass(frozen=True)
class Posture:
    """A posture with friction states.

    Attributes
    ----------
    states : ndarray, shape (K,)
        Friction states of all fingers.
    arrays : mapping
        As a result holds those of a grasp.
    reserve : float
        By how much all friction cones could be narrower, per force scale [1].
    model : callable
        Gives what it is to first order.
    """

    states: Array
    arrays: Arrays
    reserve: float
    model: Callable[[], LinearModel]


@dataclass(frozen=True)
class LinearModel:
    """The equations and limits of a posture to first order in its unknowns and in the friction states (K,)."""

    states: Array
    limits: Limits
    shift: Array
    """What the least change of the unknowns that balances a change of the states does to slacks and cones."""
    cone_shift: Array

    def reserves(self, states: Array) -> Reserve:
        """Greatest reserve, to first order, with sets of states (B, K)."""
        off = states - self.states
        slacks = self.limits.slacks + off @ self.shift.T
        cones = self.limits.cones + np.einsum("bk,cik->bci", off, self.cone_shift)
        return greatest_reserve(replace(self.limits, slacks=slacks, cones=cones))

    def slopes(self, found: Reserve) -> Array:
        """Change of these reserves with each state (B, K)."""
        return np.asarray(
            found.slack_forces @ self.shift + np.einsum("bci,cik->bk", found.cone_forces, self.cone_shift)
        )


class Postures:
    """Postures of a grasp with friction states.

    Parameters
    ----------
    grasp : RecomputedGrasp
        As it is reached.
    """

    def __init__(self, grasp: RecomputedGrasp) -> None:
        self.grasp, self.scene = grasp, grasp.scene
        self.scale = grasp.force_scale
        self.frictional = [finger for finger in grasp.fingers if finger.setup.friction_states]
        ends = np.cumsum([0, *(finger.setup.friction_states for finger in self.frictional)]).tolist()
        self.columns = {f.name: slice(a, b) for f, (a, b) in zip(self.frictional, pairwise(ends), strict=True)}
        self.count = ends[-1]
        self.yields = all(contact.finger is not None for contact in grasp.contacts)

    def at(self, states: Array, near: Arrays, *, deep: bool = False) -> Posture | None:
        """The posture with states (K,), sought from that of other states with its contacts, None where none is found;
        ``deep``: fingers may be in the object as far as the check lets them.
        """
        return Equations(self, near, deep=deep).solved(np.asarray(states, dtype=float))


class Equations:
    """Unknowns and equations of postures with the contacts of one that is given."""

    def __init__(self, postures: Postures, near: Arrays, *, deep: bool) -> None:
        self.of, self.near, self.deep = postures, near, deep
        self.scene, self.scale = postures.scene, postures.scale
        self.names = [str(name) for name in near["contact_names"]]
        known = known_contacts(self.scene)
        self.known = [known[name] for name in self.names]
        self.parts = np.asarray(near["contact_parts"], dtype=int)
        self.lifted = isinstance(self.scene.gravity, OutOfPlaneGravity)
        self.fingers = [_Finger(self, k, finger) for k, finger in enumerate(postures.grasp.fingers)]
        size = 0
        for one in self.fingers:
            size = one.place(size)
        self.pose = slice(size, size + 3 * postures.yields)
        per = 3 if self.lifted else 2
        self.forces = np.arange(self.pose.stop, self.pose.stop + per * len(self.names)).reshape(-1, per)
        self.size = self.pose.stop + self.forces.size
        self.lengths = np.array([*[postures.grasp.size] * 2, 1.0])
        # Where tips landed on an object that yields, in its frame [m].
        self.start = self.begin()
        self.landed = {}
        for k in range(len(self.names)) if postures.yields else ():
            finger = self.known[k][1]
            if finger is not None and not self.fingers[finger].touching:
                local = PlacedObject(self.scene.object, postures.grasp.pose)
                tip = postures.grasp.fingers[finger].points[-1]
                self.landed[k] = _turned(tip - local.position, -float(postures.grasp.pose[2]))

    def begin(self) -> Array:
        """The unknowns of the posture that is given."""
        x = np.zeros(self.size)
        for finger in self.fingers:
            finger.begin(x, self.near)
        x[self.pose] = (np.asarray(self.near["object.pose"]) / self.lengths)[: 3 * self.of.yields]
        x[self.forces] = np.asarray(self.near["contact_forces"])[:, : self.forces.shape[1]] / self.scale
        return x

    def pose_of(self, x: Array) -> Array:
        """Of the object (3,) [m, rad]."""
        return x[self.pose] * self.lengths if self.of.yields else np.asarray(self.of.grasp.pose, dtype=float)

    # -- equations -----------------------------------------------------------------------------------------------------

    def together(self, x: Array, bodies: Sequence[_Bent]) -> tuple[Array, Array]:
        """The equations and limits of fingers that are bent as given."""
        grasp, pose = self.of.grasp, self.pose_of(x)
        body = PlacedObject(self.scene.object, pose)
        forces = np.zeros((len(self.names), 3))
        forces[:, : self.forces.shape[1]] = x[self.forces] * self.scale
        zero, spare = [], [x[self.forces[:, 0]]]
        most = np.array([self.scene.normal_force_max(name) for name in self.names])
        spare.append((most - forces[:, 0]) / self.scale)
        force, turn, lift, tilt = self.scene.object.mass * gravity_vector(self.scene.gravity), 0.0, 0.0, np.zeros(2)
        work = [one.work.copy() for one in bodies]
        for k, (_, owner, joint, _) in enumerate(self.known):
            n, f, up = forces[k]
            if owner is None:
                normal, point = self.near["contact_normals"][k], self.near["contact_positions"][k]
            else:
                one, finger = bodies[owner], self.fingers[owner]
                place = one.order[joint]
                center, angle, radius = one.centers[place], one.angles[place], one.radii[place]
                found = self._touched(body, k, center)
                normal = found.normal[0]
                point = center - radius * normal
                if k in self.landed:
                    off = body.world(self.landed[k][None])[0] - center
                    zero.append(off / finger.length)
                else:
                    zero.append([(found.distance[0] - radius) / finger.length])
                if joint != finger.elements:
                    tangent = np.array([-np.sin(angle), np.cos(angle)])
                    zero.append([tangent @ normal - one.leans[place]])
                load = n * normal + f * across(normal)
                work[owner] -= one.motions[place] @ [*load, -radius * f]
            load = n * normal + f * across(normal)
            arm = point - body.com
            force = force - load
            turn -= arm[0] * load[1] - arm[1] * load[0]
            lift, tilt = lift + up, tilt + up * arm
        zero.append(force / self.scale)
        zero.append([turn / (self.scale * grasp.size)])
        if isinstance(self.scene.gravity, OutOfPlaneGravity):
            zero.append([(lift - self.scene.object.mass * self.scene.gravity.magnitude) / self.scale])
            if self.scene.gravity.tilt == "balance":
                zero.append(tilt / (self.scale * grasp.size))
        for one, finger, own in zip(bodies, self.fingers, work, strict=True):
            zero += [own / finger.scale, one.rest]
            spare += [one.spare, finger.clear(one, body)]
        if self.of.yields:
            off = (pose - grasp.pose) / self.lengths
            spare += [YIELDS - off, YIELDS + off]
        return np.concatenate(zero), np.concatenate(spare)

    def _touched(self, body: PlacedObject, contact: int, center: Array) -> Nearest:
        """What of the object a contact at a center (2,) touches."""
        normal = self.near["contact_normals"][contact]
        return body.nearest_of(center[None], [body.touched(int(self.parts[contact]), center, normal)])

    def jacobians(self, x: Array, states: Array, bodies: Sequence[_Bent]) -> tuple[Array, Array]:
        """Derivatives of equations and limits by the unknowns."""
        here = self.together(x, bodies)
        first, second = np.zeros((here[0].size, self.size)), np.zeros((here[1].size, self.size))
        for finger in self.fingers:
            for column in range(finger.first, finger.last):
                moved, others = x.copy(), list(bodies)
                moved[column] += _DIFFERENCE
                tensions = finger.tension.start <= column < finger.tension.stop
                own = finger.pulled if tensions else finger.bent
                others[finger.index] = own(moved, states, bodies[finger.index])
                first[:, column], second[:, column] = self._slope(self.together(moved, others), here)
        for column in range(self.pose.start, self.size):
            moved = x.copy()
            moved[column] += _DIFFERENCE
            first[:, column], second[:, column] = self._slope(self.together(moved, bodies), here)
        return first, second

    def by_states(self, x: Array, states: Array, bodies: Sequence[_Bent]) -> tuple[Array, Array]:
        """Derivatives of equations and limits by the friction states."""
        here = self.together(x, bodies)
        first, second = np.zeros((here[0].size, states.size)), np.zeros((here[1].size, states.size))
        for finger in self.fingers:
            for column in range(*self.of.columns.get(finger.name, slice(0, 0)).indices(states.size)):
                moved, others = states.copy(), list(bodies)
                moved[column] += _DIFFERENCE
                others[finger.index] = finger.pulled(x, moved, bodies[finger.index])
                first[:, column], second[:, column] = self._slope(self.together(x, others), here)
        return first, second

    @staticmethod
    def _slope(moved: tuple[Array, Array], here: tuple[Array, Array]) -> tuple[Array, Array]:
        return (moved[0] - here[0]) / _DIFFERENCE, (moved[1] - here[1]) / _DIFFERENCE

    # -- solution ------------------------------------------------------------------------------------------------------

    def solved(self, states: Array) -> Posture | None:
        """The posture with states, and what it is to first order; None where no steps lead to one."""
        x, moved, slow, rho = self.start.copy(), np.inf, False, NEAR
        slopes: tuple[Array, Array] | None = None
        for step in range(_STEPS):
            bodies = [finger.bent(x, states) for finger in self.fingers]
            body = PlacedObject(self.scene.object, self.pose_of(x))
            news = [finger.guard(one, body) for finger, one in zip(self.fingers, bodies, strict=True)]
            zero, spare = self.together(x, bodies)
            if not (np.isfinite(zero).all() and np.isfinite(spare).all()):
                break
            # Close to the posture slopes hardly change; the last ones are its own.
            fresh = slopes is None or slow or any(news) or moved > _CLOSE_BY
            while True:
                if fresh or slopes is None:
                    slopes = self.jacobians(x, states, bodies)
                linear = _Linear(self, x, zero, spare, *slopes, rho)
                reserve = float(linear.found.reserve[0])
                # Along a flat ridge the reserve settles before the unknowns do.
                within = spare.min() > -EXACT / _GUARD_UNIT - 1.01 * float(linear.found.excess[0])
                # Where it does not settle, any posture that balances: its own reserve is a lower bound.
                best = within and (reserve - linear.reserve < _SETTLED or step > _STEPS - _LAST)
                settled = best and np.abs(zero).max() < EXACT
                if fresh or not settled:
                    break
                fresh = True
            if settled:
                return Posture(states, self.arrays(x, bodies), linear.reserve, partial(linear.model, states, bodies))
            along = linear.least if best else linear.along
            far = float(np.abs(along).max())
            # Steps that do not become shorter go to and fro across a curved ridge: they must stay nearer.
            slow = far > _SHORTER * moved
            rho = min(_NEARER * rho, _NEAREST) if slow else rho
            x, moved = x + min(1.0, _FARTHEST / max(far, 1e-12)) * along, far
        return None

    def arrays(self, x: Array, bodies: Sequence[_Bent]) -> dict[str, Array]:
        """The posture as a result stores it."""
        pose = self.pose_of(x)
        body = PlacedObject(self.scene.object, pose)
        found = {key: np.array(value) for key, value in self.near.items() if not key.startswith("held.")}
        found["object.pose"] = pose
        for one in bodies:
            found |= one.arrays
        found["contact_forces"][:, : self.forces.shape[1]] = x[self.forces] * self.scale
        for k, (_, owner, joint, _) in enumerate(self.known):
            if owner is not None:
                one = bodies[owner]
                place = one.order[joint]
                center = one.centers[place]
                normal = self._touched(body, k, center).normal[0]
                found["contact_normals"][k] = normal
                found["contact_positions"][k] = center - one.radii[place] * normal
                found["contact_stations"][k] = one.stations[place]
        return found


class _Linear:
    """Equations and limits about a point: the least change that balances, and the greatest reserve from there."""

    def __init__(
        self, equations: Equations, x: Array, zero: Array, spare: Array, first: Array, second: Array, rho: float
    ) -> None:
        self._equations, self._x, self._second = equations, x, second
        left, values, right = np.linalg.svd(first)
        rank = int((values > _RANK * values[0]).sum())
        self._inverse = right[:rank].T @ (left[:, :rank] / values[:rank]).T
        directions, least = right[rank:].T, -self._inverse @ zero
        names, forces = equations.names, equations.forces
        self._rows = np.zeros((len(names), 3, x.size))
        for k, places in enumerate(forces):
            self._rows[k, range(len(places)), places] = 1.0
        self._rows[:, 0] *= np.array([[equations.scene.friction(name)] for name in names])
        slacks, cones = spare + second @ least, self._rows @ (x + least)
        self.limits = Limits(slacks[None], second @ directions, cones[None], self._rows @ directions)
        self.found = greatest_reserve(self.limits, rho)
        self.least, self.along = least, least + directions @ self.found.w[0]
        here = self._rows @ x
        self.reserve = float((here[:, 0] - np.hypot(here[:, 1], here[:, 2])).min(initial=np.inf))

    def model(self, states: Array, bodies: Sequence[_Bent]) -> LinearModel:
        """The same as it depends on the friction states."""
        zero, spare = self._equations.by_states(self._x, states, bodies)
        moved = -self._inverse @ zero
        return LinearModel(states, self.limits, self._second @ moved + spare, self._rows @ moved)


@dataclass(frozen=True)
class _Bent:
    """A finger with friction states, bent."""

    finger: RecomputedFinger
    arrays: dict[str, Array]
    work: Array  # virtual work without contacts (n,) [N m]
    motions: Array  # (J, n, 3) of the joints that touch
    rest: Array  # what is zero of the drives
    spare: Array  # what is not negative
    order: dict[int, int]  # index in the following by joint
    centers: Array  # world positions [m]
    angles: Array  # [rad]
    radii: Array  # half the thickness there [m]
    leans: Array  # slope of the half thickness
    stations: Array  # positions along the finger [m]
    edges: Array  # index of the joints in the following


class _Finger:
    """The unknowns of one finger: coordinates, positions of contacts along it, tensions.

    Tips are not matched: that family has no friction.
    """

    def __init__(self, equations: Equations, index: int, reached: RecomputedFinger) -> None:
        self.index, self.name, self.setup, self._whole = index, reached.name, reached.setup, equations
        self.length, self.scale, self.elements = reached.length, reached.load_moment, reached.setup.elements
        own = [joint for _, owner, joint, _ in equations.known if owner == index]
        self.touching = sorted(joint for joint in own if joint != self.elements)
        self.joints = sorted(own)
        law = self.setup.drive
        self.held = None if reached.wound is None else reached.wound.held
        self.pulls = law is not None and (law.locks or law.pulley)
        self._tensions = reached.tensions
        stored = equations.near
        self.lengths = np.asarray(stored[f"{self.name}.lengths"], dtype=float)
        self.shapes = np.asarray(stored[f"{self.name}.curvature_shapes"], dtype=float)
        even = FAMILIES[self.setup.family].even
        self._even = even
        self.units = np.full(reached.q.size, 1.0 if even else self.elements / self.length)
        marks = np.concatenate([[0.0], np.cumsum(self.lengths)])
        self.guards: list[int] = []
        tolerance = max(equations.scene.solver.penetration_tolerance, _BETWEEN if self.setup.stations else 0.0)
        self._allowed = _DEEP * PENETRATION if equations.deep else tolerance
        self.marks = {joint: float(marks[joint]) for joint in (0, *self.setup.before, self.elements)}

    def place(self, start: int) -> int:
        """Places of its unknowns from a first one on; the first that is free."""
        self.first = start
        self.q = slice(start, start + self.units.size)
        self.at = slice(self.q.stop, self.q.stop + len(self.touching))
        self.tension = slice(self.at.stop, self.at.stop + 2 * self.pulls)
        self.last = self.tension.stop
        return self.last

    def begin(self, x: Array, arrays: Arrays) -> None:
        """Fill its unknowns in with those of a posture."""
        most = self.setup.tendons.max_tension
        x[self.q] = np.asarray(arrays[f"{self.name}.q"]) / self.units
        x[self.at] = [self.marks[joint] / self.length for joint in self.touching]
        x[self.tension] = (np.asarray(arrays[f"{self.name}.tensions"]) / most)[: 2 * self.pulls]

    def bent(self, x: Array, states: Array, like: _Bent | None = None) -> _Bent:
        """The finger at these unknowns and states of all fingers; ``like`` another one, of which is taken what is the
        same.
        """
        setup, name, most = self.setup, self.name, self.setup.tendons.max_tension
        marks = self.marks | dict(zip(self.touching, (x[self.at] * self.length).tolist(), strict=True))
        places = sorted(marks)
        evenly = [np.linspace(marks[a], marks[b], b - a + 1)[:-1] for a, b in pairwise(places)]
        edges = np.append(np.concatenate(evenly), self.length)
        lengths = np.diff(edges)
        shapes = self.shapes * (self.lengths / lengths)[:, None, None] if self._even else self.shapes
        tensions = x[self.tension] * most if self.pulls else self._tensions
        arrays: dict[str, Any] = {
            f"{name}.q": x[self.q] * self.units,
            f"{name}.lengths": lengths,
            f"{name}.curvature_shapes": shapes,
            f"{name}.tensions": tensions,
            f"{name}.base": self._whole.of.grasp.fingers[self.index].base,
            f"{name}.backbone": np.zeros((2, 4)),
            f"{name}.tip_curvature": 0.0,
        }
        if name in self._whole.of.columns:
            arrays[f"{name}.friction_states"] = states[self._whole.of.columns[name]]
        finger = RecomputedFinger(setup, self._whole.scene.gravity, arrays, None if like is None else like.finger)
        shape = finger.shape
        arrays[f"{name}.tip_curvature"] = float(shape.elastic(np.array(self.length)))
        arrays[f"{name}.backbone"] = np.column_stack([finger.rod.edges, finger.points, finger.angles])
        work, motions = finger.work_and_motions(self.joints)
        at = finger.joint_edges[self.joints]
        same = like if like is not None and np.array_equal(lengths, like.finger.lengths) else None
        return _Bent(
            finger,
            arrays,
            work,
            motions,
            self._rest(finger),
            self._spare(finger, x),
            {joint: k for k, joint in enumerate(self.joints)},
            finger.points[at],
            finger.angles[at],
            same.radii if same else np.array([float(finger.skin(edges[joint])) for joint in self.joints]),
            same.leans if same else np.array([finger.skin.slope(float(edges[joint])) for joint in self.joints]),
            edges[self.joints],
            at,
        )

    def pulled(self, x: Array, states: Array, like: _Bent) -> _Bent:
        """The finger in the shape that it has, at other tensions and states of all fingers."""
        own = self._whole.of.columns.get(self.name)
        tensions = x[self.tension] * self.setup.tendons.max_tension if self.pulls else self._tensions
        finger = like.finger.pulled_by(tensions, None if own is None else states[own])
        work, _ = finger.work_and_motions(self.joints)
        return replace(like, finger=finger, work=work, rest=self._rest(finger), spare=self._spare(finger, x))

    def _rest(self, finger: RecomputedFinger) -> Array:
        """What is zero where the drives hold."""
        if not self.pulls or finger.wound is None:
            return np.zeros(0)
        return finger.wound.misfits(self.held) / self.setup.tendons.max_tension

    def _spare(self, finger: RecomputedFinger, x: Array) -> Array:
        """What is not negative while the finger is within its limits."""
        setup = self.setup
        bends = (finger.lengths[:, None] * finger.shape.curvatures).ravel()
        spare = [setup.bending_range - bends, setup.bending_range + bends]
        if self.pulls:
            tensions, most, law = x[self.tension], setup.tendons.max_tension, setup.drive
            spare += [1.0 - tensions, tensions - setup.tendons.min_tension / most]
            if law is not None and np.isfinite(law.greatest):
                pulls = np.array([tensions[0] - tensions[1], tensions[1] - tensions[0]]) if law.pulley else tensions
                spare.append(law.greatest / most - pulls)
        bounds = dict(zip(setup.before, setup.contact_bounds, strict=True))
        for joint, at in zip(self.touching, x[self.at], strict=True):
            low, high = bounds[joint]
            spare.append(np.array([at - low / self.length, high / self.length - at]))
        allowed, depth = finger.finger.strain_limit, finger.profile.half_depth
        if allowed is not None and depth is not None:
            s = finger.rod.edges
            strain = float(np.abs(finger.shape.curvature(s) * depth(s)).max())
            spare.append(np.array([1.0 - strain / allowed]))
        return np.concatenate(spare)

    def guard(self, one: _Bent, body: PlacedObject) -> bool:
        """From now on keep off the object also where the finger is nearest to it; whether that is anywhere new."""
        off = body.distance(one.finger.points) - one.finger.thickness
        for edge in one.edges:
            # By panels, which move with the contacts.
            off[max(edge - _BESIDE, 0) : edge + _BESIDE + 1] = np.inf
        before, after = np.append(np.inf, off[:-1]), np.append(off[1:], np.inf)
        nearest = (off < _CLOSE * self.length) & (off <= before) & (off <= after)
        count = len(self.guards)
        self.guards = sorted({*self.guards, *np.flatnonzero(nearest).tolist()})
        return len(self.guards) > count

    def clear(self, one: _Bent, body: PlacedObject) -> Array:
        """How far it keeps off the object at its guarded places, beyond what is allowed."""
        if not self.guards:
            return np.zeros(0)
        off = body.distance(one.finger.points[self.guards]) - one.finger.thickness[self.guards]
        return np.asarray((off / self.length + self._allowed) / _GUARD_UNIT)


def _turned(point: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * point[0] - s * point[1], s * point[0] + c * point[1]])
