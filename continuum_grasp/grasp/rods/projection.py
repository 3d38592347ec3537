"""A grasp of rods on elements: equilibria of the fingers' own models, at the same tensions and contacts.

Elements end at the contacts, whose places along the finger stay. Unknown are the bending coordinates q of the model and
the normal forces N, with which the gaps stay closed; friction stays as it is:

    Q(q, u, F(N)) = 0,    d(r_k(q)) = h(s_k)

Q is the generalized force that is missing at rest (`FingerModel.statics`), r_k the place of a contact, d the distance
of the exact object, and h the half thickness. Fingers of hands bend in the planes of their bases. The rods supply
places and forces out of these planes.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger, HeldRods
from continuum_grasp.grasp.judge.obstacles import ExactObject
from continuum_grasp.grasp.judge.space_rod import SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.grasp.values import CLOSE, ElementError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import FAMILIES, ONE_TURN, Fidelity, FingerSetup, GraspScene, HandScene, MomentLoad

Asked = TypeVar("Asked", GraspScene, HandScene)
"""A scene in the plane, or of a hand."""
MOST_ELEMENTS = 64
"""Most elements of a finger, as many as a scene may state."""
_NEWTON = 40
"""Most steps of Newton's method; shipped grasps on 4 to 16 elements take 3 to 9."""
_LEFT = 1e-9
"""Share of the greatest moment, and of the length for gaps, that counts as zero."""
_STEP = 1e-6
"""Step of the differences of normals, per length of the finger: normals are exact to rounding."""
_NEAR = 0.1
"""Greatest displacement, per length, of an equilibrium that stands for the rod: one that snaps over is farther off."""
_FINE = 400
"""Parts of a segment over which bending waves are counted."""
_REACH = 1.25
"""Bending range of the model, per greatest bend of the rod on an element: elements of few bend further."""


class ElementFinger:
    """Elements of a finger under the tensions and contacts of its rod, in the plane of its base.

    Parameters
    ----------
    setup : FingerSetup
        The finger, with its family and number of elements.
    held : HeldFinger
        Tensions and contacts.
    rod : SpaceRod
        Shape of the rod.
    body : ExactObject
        The object.
    """

    def __init__(self, setup: FingerSetup, held: HeldFinger, rod: SpaceRod, body: ExactObject, gravity: Array) -> None:
        self.setup, self.held, self.rod, self._body = setup, held, rod, body
        self.length = setup.finger.rod.length
        self.contacts = sorted(held.contacts, key=lambda contact: contact.place)
        self._half = np.array([float(setup.finger.profile.half_thickness(c.place)) for c in self.contacts])
        self._gravity = held.axes.T @ gravity
        self.lengths = element_lengths_of(setup, held)
        self._model = self._made()
        self._rods = rod.at(np.array([contact.place for contact in self.contacts]))
        normals = self._near(self._rods.points)[1]
        self._normals = normals
        whole = np.array([contact.force for contact in self.contacts]).reshape(normals.shape)
        self.normal_forces = (whole * normals).sum(axis=1)
        self._friction = whole - self.normal_forces[:, None] * normals
        twists = np.array([contact.moment for contact in self.contacts])
        couples = twists[:, None] * normals - self._half[:, None] * np.cross(normals, self._friction)
        self._couples = couples @ held.axes[:, 2]
        self.q, self.forces, self.balanced = self._solved()
        if not self.balanced or self.displacement > _NEAR:
            self.q, self.balanced = self._first(), False

    def _made(self) -> FingerModel:
        """The model of the finger at the origin of its plane, with commanded tensions."""
        finger = self.setup.finger.with_tendons(
            time_constant=None, drive_order=2, drive=None, axial_stiffness=None, series_stiffness=None
        )
        finger = finger.replaced(base={"position": (0.0, 0.0), "angle": 0.0}, base_free=None)
        inner = tuple(c.place for c in self.contacts if not finger.rod.is_tip(c.place))
        edges = np.concatenate([[0.0], np.cumsum(self.lengths)])
        bends = np.abs(np.diff(self._angles(edges))).max()
        return FingerModel(
            finger,
            contacts=inner,
            gravity=tuple(self._gravity[:2].tolist()),
            family=self.setup.family,
            elements=tuple(self.lengths.tolist()),
            bending_range=min(max(self.setup.bending_range, _REACH * bends), 3.0 * ONE_TURN),
            accuracy=self.setup.accuracy,
            loads=tuple(MomentLoad(at=at, moment=0.0) for at in (*inner, self.length)),
            tip_force=True,
        )

    # -- the rod in the plane of the base ----------------------------------------------------------------------

    def _angles(self, s: Array) -> Array:
        """Angles (n,) of the rod's sections in the plane [rad]."""
        along = self.rod.at(s).axes[:, :, 1] @ self.held.axes
        return np.unwrap(np.arctan2(-along[:, 0], along[:, 1]))

    def _local(self, points: Array) -> Array:
        """Points (n, 3) in the frame of the base [m]."""
        return np.asarray((points - self.held.position) @ self.held.axes)

    def _near(self, points: Array) -> tuple[Array, Array]:
        """Distances (n,) and normals (n, 3) of the object."""
        return self._body.near(points) if len(points) else (np.zeros(0), np.zeros((0, 3)))

    # -- equilibrium -------------------------------------------------------------------------------------------

    def _first(self) -> Array:
        """Coordinates near the rod."""
        model, family = self._model, self._model.structure.family
        edges = np.concatenate([[0.0], np.cumsum(self.lengths)])
        places = edges[:-1, None] + self.lengths[:, None] * family.places
        # Inside of the elements: the curvature jumps at contacts.
        inside = np.clip(places, edges[:-1, None] + 1e-9 * self.length, edges[1:, None] - 1e-9 * self.length)
        curvatures = self.rod.curvature(inside.ravel()).reshape(places.shape)
        rest = model.finger.profile.rest_curvature(places).mean(axis=1)
        bends = np.diff(self._angles(edges)) - rest * self.lengths
        return np.asarray(family.coordinates(bends, curvatures)[: model.n])

    @property
    def _history(self) -> list[Array]:
        """History of friction of a finger that was pulled."""
        states = len(self._model.friction_names)
        return [np.append(np.zeros(states), 1.0)] if states else []

    def _points(self, q: Array) -> tuple[Array, Array]:
        """World places (n, 3) of the contacts [m], and their derivatives (n, 3, coordinates)."""
        u, p, flat = self._input, self._model.p_nominal, self.held.axes[:, :2]
        out = self._local(self._rods.points)[:, 2:] * self.held.axes[:, 2]
        places, slopes = [], []
        for contact in self.contacts:
            places.append(flat @ np.array(self._model.position(q, u, contact.place, p)).ravel())
            slopes.append(flat @ np.array(self._model.jacobian(q, u, contact.place, p)))
        shape = (len(self.contacts), 3)
        return self.held.position + np.reshape(places, shape) + out, np.reshape(slopes, (*shape, len(q)))

    @cached_property
    def _input(self) -> Array:
        """Input of the model: tensions and the couple at the tip."""
        at_tip = [m for m, contact in zip(self._couples, self.contacts, strict=True) if self._is_tip(contact)]
        return np.array([*self.held.tensions, sum(at_tip)])

    def _is_tip(self, contact: HeldContact) -> bool:
        return self.setup.finger.rod.is_tip(contact.place)

    def _loads(self, forces: Array, couples: Array) -> Array:
        """Loads of the model by forces (n, 3) and couples (n,) of the contacts."""
        flat = forces @ self.held.axes[:, :2]
        inner = [k for k, contact in enumerate(self.contacts) if not self._is_tip(contact)]
        tip = [flat[k] for k, contact in enumerate(self.contacts) if self._is_tip(contact)] or [np.zeros(2)]
        return np.concatenate([flat[inner].ravel(), tip[0], couples[inner]])

    def _solved(self) -> tuple[Array, Array, bool]:
        """Coordinates, normal forces [N], and whether they are an equilibrium: by Newton's method with short steps."""
        q, forces = self._first(), self.normal_forces.copy()
        left, slopes = self._left(q, forces)
        for _ in range(_NEWTON):
            size = np.abs(left).max()
            if not np.isfinite(size) or size < _LEFT:
                break
            step = np.linalg.lstsq(slopes, -left, rcond=None)[0]
            for part in 0.5 ** np.arange(6):
                trial = q + part * step[: len(q)], forces + part * self._unit * step[len(q) :]
                after = self._left(*trial)
                if np.abs(after[0]).max() < (1.0 - 0.1 * part) * size:
                    break
            (q, forces), (left, slopes) = trial, after
        return q, forces, bool(np.abs(left).max() < 1e3 * _LEFT)

    @property
    def _unit(self) -> float:
        """Unit of forces: E I / L^2 [N]."""
        return self.setup.stiffness / self.length**2

    def _left(self, q: Array, pressing: Array) -> tuple[Array, Array]:
        """Missing forces and gaps (m,) of an equilibrium, and their slopes (m, m), without units."""
        model = self._model
        points, moves = self._points(q)
        distance, normals = self._near(points)
        friction = self._turned(normals)
        loads = self._loads(pressing[:, None] * normals + friction, self._couples)
        u, p = self._input, model.p_nominal
        missing, stiffness = (np.array(part) for part in model.statics(q, u, loads, p, *self._history))
        unit = self._unit * self.length * self._turns_by
        rows = np.concatenate([missing.ravel() / unit, (distance - self._half) / self.length])
        by_force, turns = self._by_force(q), self._turns(points)
        by_normal, by_place = np.zeros((len(q), len(normals))), np.zeros((len(q), len(q)))
        for k, (n, slope) in enumerate(zip(normals, moves, strict=True)):
            by_normal[:, k] = -(n @ by_force[k])
            # The normal turns where the place moves, and friction with it.
            turned = pressing[k] * np.eye(3) - np.outer(n, friction[k])
            by_place -= by_force[k].T @ turned @ turns[k] @ slope
        gaps = np.einsum("ki,kij->kj", normals, moves) / self.length
        top = np.hstack([(stiffness + by_place) / unit[:, None], by_normal * self._unit / unit[:, None]])
        bottom = np.hstack([gaps, np.zeros((len(normals), len(normals)))])
        return rows, np.vstack([top, bottom])

    def _by_force(self, q: Array) -> Array:
        """Generalized forces (n, 3, coordinates) per component of the contacts' forces."""
        size = len(self.contacts)
        units, still = np.eye(3 * size).reshape(3 * size, size, 3), np.zeros(size)
        each = [
            np.array(self._model.external_force(q, self._input, self._loads(units[k], still), self._model.p_nominal))
            for k in range(3 * size)
        ]
        return np.reshape(each, (size, 3, len(q)))

    def _turned(self, normals: Array) -> Array:
        """Friction (n, 3) of the rod's contacts, turned as far as their normals (n, 3) are."""
        both = self._normals + normals
        share = (self._friction * normals).sum(axis=1) / (1.0 + (self._normals * normals).sum(axis=1))
        return np.asarray(self._friction - share[:, None] * both)

    def _turns(self, points: Array) -> Array:
        """Derivatives (n, 3, 3) of the normals by the places [1/m]."""
        step = _STEP * self.length
        shifts = step * np.eye(3)
        each = [(self._near(points + shift)[1] - self._near(points - shift)[1]) / (2.0 * step) for shift in shifts]
        return np.asarray(np.stack(each, axis=-1)) if len(points) else np.zeros((0, 3, 3))

    @cached_property
    def _turns_by(self) -> Array:
        """Turn of the finger per coordinate (coordinates,)."""
        family = self._model.structure.family
        each = [family.work(element, self.lengths.tolist()) for element in range(family.elements)]
        turns: Array = np.abs(np.sum(np.array(each, dtype=float), axis=0))
        return turns[: self._model.n]

    # -- result ------------------------------------------------------------------------------------------------

    def arrays(self) -> dict[str, Array]:
        """Coordinates above rest, their shapes, curvature at the tip and lengths, as a result stores them, by name."""
        setup, family = self.setup, self._model.structure.family
        matched = FAMILIES[setup.family].matches_tip
        shapes = family.curvature_shapes(self.lengths.tolist())[:, :, : len(self.q) + matched]
        found = {"q": self.q, "lengths": self.lengths, "curvature_shapes": shapes, "tensions": self.held.tensions}
        tip = self._tip_curvature if matched else 0.0
        named = {f"{setup.name}.{key}": value for key, value in {**found, "tip_curvature": np.array(tip)}.items()}
        if not matched:
            tip = float(FingerShape(setup, named).elastic(np.array(self.length)))
        return {**named, f"{setup.name}.tip_curvature": np.array(tip), f"{setup.name}.family": np.array(setup.family)}

    @property
    def _tip_curvature(self) -> float:
        """Curvature above rest that the moments at the tip leave there [1/m]."""
        profile = self.setup.finger.profile
        pulled = sum(
            channel.gain * np.dot(channel.arms, self.held.tensions) * float(channel.shape(self.length))
            for channel in self.setup.finger.channels
        )
        return float((pulled + self._input[-1]) / profile.bending_stiffness(self.length))

    @property
    def displacement(self) -> float:
        """Greatest distance from the rod, per length [1]."""
        s = np.linspace(0.0, self.length, 101)
        u, p = self._input, self._model.p_nominal
        flat = self._local(self.rod.at(s).points)[:, :2]
        places = np.array([np.array(self._model.position(self.q, u, at, p)).ravel() for at in s.tolist()])
        return float(np.hypot(*(places - flat).T).max()) / self.length

    def error(self, greatest: float) -> ElementError:
        """The difference from the rod, by the greatest normal force of the grasp [N]."""
        change = float(np.abs(self.forces - self.normal_forces).max(initial=0.0)) / max(greatest, 1e-12)
        return ElementError(len(self.lengths), change if self.balanced else np.nan, self.displacement)


def element_lengths_of(setup: FingerSetup, held: HeldFinger) -> Array:
    """Lengths of the elements [m]: between contacts as many as the setup has, even shares of the bending waves.

    Middle contacts that are off are spread evenly between those that are on.
    """
    length = setup.finger.rod.length
    on = {contact.name: contact.place for contact in held.contacts}
    known = [(0.0, 0.0), *((k + 1.0, on[n]) for k, n in enumerate(setup.middle_names) if n in on)]
    known.append((len(setup.middle_names) + 1.0, length))
    joints = np.interp(np.arange(len(setup.middle_names) + 2), *np.array(known).T)
    edges = [
        _parted(setup, a, b, after - before)
        for (a, b), (before, after) in zip(
            itertools.pairwise(joints.tolist()), itertools.pairwise((0, *setup.before, setup.elements)), strict=True
        )
    ]
    return np.diff(np.concatenate([*(each[:-1] for each in edges), [length]]))


def _parted(setup: FingerSetup, start: float, end: float, count: int) -> Array:
    """Ends (count + 1,) of elements between two places [m]."""
    s = np.linspace(start, end, _FINE + 1)
    waves = setup.finger.profile.waves(s)
    return np.interp(np.linspace(0.0, waves[-1], count + 1), waves, s)


@dataclass(frozen=True, eq=False)
class Projection:
    """All fingers of a grasp on elements."""

    arrays: Mapping[str, Array]
    errors: Mapping[str, ElementError]
    """Difference from the rod by finger."""
    normal_forces: Mapping[str, float]
    """Normal forces [N] with which the elements are in equilibrium, by contact of a finger."""

    @property
    def error(self) -> ElementError:
        """Greatest differences of all fingers, and most elements."""
        each = list(self.errors.values())
        counts, changes, shifts = zip(*((e.elements, e.normal_force, e.displacement) for e in each), strict=True)
        return ElementError(max(counts), float(np.max(changes)), float(np.max(shifts)))


def projected(
    scene: GraspScene | HandScene, held: HeldRods, rods: Sequence[SpaceRod], setups: Sequence[FingerSetup] = ()
) -> Projection:
    """Project a grasp whose fingers have these shapes onto the elements of a scene, or of other setups of fingers."""
    stage = GraspStage.of(scene)
    body = stage.body(held)
    fingers = [
        ElementFinger(setup, finger, rod, body, stage.finger_gravity)
        for setup, finger, rod in zip(setups or scene.setups, held.fingers, rods, strict=True)
    ]
    greatest = max((abs(float(force)) for finger in fingers for force in finger.normal_forces), default=0.0)
    arrays = dict(itertools.chain(*(finger.arrays().items() for finger in fingers)))
    errors = {finger.setup.name: finger.error(greatest) for finger in fingers}
    named = itertools.chain(*(zip(finger.contacts, finger.forces.tolist(), strict=True) for finger in fingers))
    return Projection(arrays, errors, {contact.name: force for contact, force in named})


def on_elements(
    scene: Asked, held: HeldRods, rods: Sequence[SpaceRod], most: int = MOST_ELEMENTS
) -> tuple[Asked, Projection]:
    """Project a grasp onto as many elements as it needs, or as the scene states; the scene with these elements.

    Elements are doubled, up to a number ``most``, until no normal force changes by more than `CLOSE`. A scene with
    ``fidelity.tolerance`` has as few as keep it.
    """
    tolerance = _tolerance(scene)
    stated = tolerance is None and _states_elements(scene)
    if tolerance is not None:
        scene = _with_elements(scene, _fewest)
    while True:
        found = projected(scene, held, rods)
        error = found.error
        close = error.normal_force <= CLOSE and (tolerance is None or error.displacement <= tolerance)
        if close or 2 * error.elements > most or stated:
            return scene, found
        scene = _with_elements(scene, _doubled)


def _tolerance(scene: GraspScene | HandScene) -> float | None:
    """The least tolerance that a scene or one of its fingers asks for."""
    asked = (_fidelity(scene, setup).tolerance for setup in scene.setups)
    return min((tolerance for tolerance in asked if tolerance is not None), default=None)


def _states_elements(scene: GraspScene | HandScene) -> bool:
    """Whether the user gave a number of elements."""
    return any(_fidelity(scene, setup).elements is not None for setup in scene.setups)


def _fidelity(scene: GraspScene | HandScene, setup: FingerSetup) -> Fidelity:
    return setup.finger.fidelity or scene.fidelity


def _with_elements(scene: Asked, count: Callable[[FingerSetup], int]) -> Asked:
    """The scene with other numbers of elements of its fingers, whose families stay."""
    counted = {
        setup.name: _fidelity(scene, setup).replaced(tolerance=None, elements=count(setup), family=setup.family)
        for setup in scene.setups
    }
    if isinstance(scene, HandScene):
        # Fingers of a hand have the fidelity of the scene.
        most = counted[max(scene.setups, key=count).name]
        return scene.model_copy(update={"fidelity": most})
    fingers = {setup.name: setup.finger.replaced(fidelity=counted[setup.name]) for setup in scene.setups}
    return scene.with_fingers(fingers)


def _doubled(setup: FingerSetup) -> int:
    return 2 * setup.elements


def _fewest(setup: FingerSetup) -> int:
    """One element between base, middle contacts and tip each."""
    return len(setup.middles) + 1
