"""A scene whose object is not quite where and what it should be.

Errors are rows (x [m], y [m], angle [rad], size, friction, mass [1]): offsets of the pose, and parts of the lengths of
the shape, of the friction coefficients and of the mass. Where friction states must not matter, these follow.

At given tensions at the base, what a tendon with friction exerts depends on its history. By the capstan law the tension
may change across each friction cell by anything between exp(-friction turn) and exp(friction turn): a state z in
[-1, 1] per cell, +1 where the tendon on the -X side was pulled last. Dry friction in bending resists in each cell by
anything between -M and M per branch: a state z in [-1, 1] again, which is +1 where the cell was bent towards the left
last. The bending moment at every section falls with every z of the tendons before it and with z of its own cell, so
that fingers pulled all along and released all along give the least and the greatest moment everywhere. Forces of
contacts are no such sums: contacts at several places, or weight, make them grow with some z and fall with others. To
first order, in a posture that stays, the greatest reserve of the cones is the optimum of a linear problem with z on its
right-hand side, so concave: least at a vertex of the box, which need be neither of the two.

So a grasp is tried with both, of several fingers also with some pulled and others released, which push the object
aside; then with the vertex that the slope of its reserve points to, from there again; from the worst of these by
turning one cell at a time; and last with states drawn at random from the whole box.
"""

from __future__ import annotations

import cmath
from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.grasp.certificate.friction import extreme_states
from continuum_grasp.grasp.certificate.held import YIELDS
from continuum_grasp.grasp.problem.relaxations import with_contacts_changed
from continuum_grasp.grasp.problem.solver_run import GraspSolverRun, solver_for
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.values import Units
from continuum_grasp.grasp.robust.result import ERRORS
from continuum_grasp.grasp.shape import FingerShape
from continuum_grasp.grasp.starts.supports import object_outlines, pinned_by, settle, support_contacts
from continuum_grasp.grasp.starts.values import ContactStart, GraspStart, Pose
from continuum_grasp.scene import GraspScene, HandScene, Robust, Shape

OBJECT = len(ERRORS)
"""Columns of errors of the object, before the friction states."""
BOUNDS = ("position", *(name for name in ERRORS if name not in ("x", "y")))
"""Keys of the bounds of these errors."""


def corners(bounds: Robust) -> Array:
    """All corners (K, 6) of the bounds, with the least friction: more only widens the cones."""
    sides = [(-b, b) if b else (0.0,) for b in bounds.bounds]
    sides[4] = (-bounds.friction,)
    return np.array(list(product(*sides)))


def alone(bounds: Robust) -> dict[str, Array]:
    """Per bound, its two ends (or four, of the position) with no other error (K, 6)."""
    ends = {}
    for name in BOUNDS:
        bound = getattr(bounds, name)
        if bound:
            columns = (0, 1) if name == "position" else (ERRORS.index(name),)
            ends[name] = np.array([sign * bound * np.eye(6)[k] for k in columns for sign in (1.0, -1.0)])
    return ends


def drawn(bounds: Robust, seed: int) -> Array:
    """Errors drawn evenly within the bounds (draws, 6)."""
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (bounds.draws, 6)) * bounds.bounds


def extremes(scene: GraspScene, arrays: Mapping[str, Any]) -> Array:
    """States (S, K) of fingers that were pulled all along, and released, then of some pulled and others released;
    (1, 0) where none matter.
    """
    setups = [setup for setup in scene.setups if setup.name in scene.state_columns]
    return extreme_states((s, FingerShape(s, arrays)) for s in setups) if setups else np.zeros((1, 0))


def with_states(errors: Array, states: Array) -> Array:
    """Each error (E, 6) of the object with each of the states (S, K): (E S, 6 + K)."""
    return np.concatenate([np.repeat(errors, len(states), axis=0), np.tile(states, (len(errors), 1))], axis=1)


def with_drawn_states(scene: GraspScene, errors: Array) -> Array:
    """Each error (E, 6) with states drawn at random (E, 6 + K): a half of all, evenly, at the bounds."""
    size = max((columns.stop for columns in scene.state_columns.values()), default=0)
    states = np.random.default_rng(scene.solver.random_seed).uniform(-2.0, 2.0, (len(errors), size))
    return np.concatenate([errors, np.clip(states, -1.0, 1.0)], axis=1)


class InError:
    """Scenes of a grasp with errors; ``arrays`` describe the grasp, as a result holds them."""

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any]) -> None:
        names = [str(name) for name in arrays["contact_names"]]
        self.scene = scene.model_copy(update={"robust": None, "objective": "greatest_friction_margin"})
        x, y, angle = (float(value) for value in arrays["object.pose"])
        self.pose: Pose = (x, y, angle)
        # Supports that the object touches; two contacts with one: a face lies on it and has no error of its angle.
        supports = [support.name for name in names if (support := scene.support_of(name)) is not None]
        self.on = frozenset(supports)
        self.flat = len(supports) > len(set(supports))
        self._lies: dict[bytes, Pose] = {}
        # Coordinates of its pose that the supports leave.
        self.left = tuple({0, 1, 2} - set(pinned_by(self.scene, self.on, self.pose, flat=self.flat)))

    def pose_in_error(self, error: Array) -> Pose:
        """Pose of the object in error [m, rad]: moved back to the supports that it touches."""
        key = error.tobytes()
        if key not in self._lies:
            self._lies[key] = self._settled(error)
        return self._lies[key]

    def _settled(self, error: Array) -> Pose:
        x, y, angle = (p + float(e) for p, e in zip(self.pose, error[:3], strict=True))
        if not self.on:
            return x, y, angle
        angle = self.pose[2] if self.flat else angle
        scene = self._sized(error)
        size = self.scene.object.size
        within = [(x - size, x + size), (y - size, y + size), (angle, angle)]
        pose = settle(scene, object_outlines(scene), self.on, (x, y, angle), within)
        if pose is None:
            raise InputError(
                "robust: an object of another size or angle cannot touch all of "
                f"{', '.join(sorted(self.on))} at once; expected bounds that preserve these contacts: omit radius or "
                "angle",
                key="robust",
            )
        return pose

    def distinct(self, errors: Array) -> Array:
        """Errors (K, 6) without those that the supports make equal to another, such as offsets across a palm."""
        lies = np.array([self.pose_in_error(error) for error in errors]).reshape(-1, 3)
        rows = np.concatenate([lies / [*[self.scene.object.size] * 2, 1.0], errors[:, 3:]], axis=1)
        _, first = np.unique(np.round(rows, 9), axis=0, return_index=True)
        return errors[np.sort(first)]

    @property
    def yields(self) -> bool:
        """Whether the object yields to the fingers; where it touches a support, it stays where it lies."""
        return not self.on

    def plant(self, start: GraspStart, error: Array) -> tuple[GraspScene, GraspStart]:
        """The scene with an error (6,), or with friction states (6 + S,), and the start of a grasp in it, whose object
        has another size and lies elsewhere.
        """
        scene = self.scene_with(error)
        size = 1.0 + float(error[3])
        contacts = {
            name: replace(contact, point=(size * contact.point[0], size * contact.point[1]))
            for name, contact in start.contacts.items()
        }
        contacts |= support_contacts(scene, scene.object.pose, self.on)
        contacts = {name: contacts[name] for name in start.contacts}
        states = dict(start.friction_states)
        if error.size > OBJECT:
            columns = scene.state_columns.items()
            states = {name: tuple(error[OBJECT:][part].tolist()) for name, part in columns}
        return scene, replace(start, object_pose=scene.object.pose, contacts=contacts, friction_states=states)

    def solver(self, contacts: Mapping[str, ContactStart]) -> GraspSolverRun:
        spec = ProblemSpec.of(self.scene, dict(contacts)).in_error(yielding=self.yields)
        solver: GraspSolverRun = solver_for(spec)
        return solver

    def landings(self, spec: ProblemSpec, start: GraspStart, error: Array) -> dict[str, Array]:
        """Places where the tips of the grasp at a start land on an object that yields (2,), in its frame and in units
        of the problem, by the names of the unknowns.
        """
        x, y, turn = (np.array(self.pose_in_error(error)) - self.pose).tolist()
        moved = complex(x, y) * cmath.exp(-1j * self.pose[2])
        landings = {}
        for contact in spec.contacts:
            if spec.lands(contact) and contact.name in start.contacts:
                place = cmath.exp(-1j * turn) * (complex(*start.contacts[contact.name].point) - moved)
                landings[f"landing, {contact.name}"] = np.array(Units.of(self.scene).point((place.real, place.imag)))
        return landings

    def scene_with(self, error: Array) -> GraspScene:
        friction = 1.0 + float(error[4])
        mass = 1.0 + float(error[5])
        x, y, angle = self.pose_in_error(error)
        scene = self._sized(error)
        reach = YIELDS * self.scene.object.size
        ranges = {"x": (x - reach, x + reach), "y": (y - reach, y + reach), "angle": (angle - YIELDS, angle + YIELDS)}
        # Where it does not yield, the response pins its pose.
        free = ranges if self.yields or self.scene.object.free is not None else None
        body = scene.object.standing((x, y, angle), free, mass=mass * scene.object.mass)
        changed = with_contacts_changed(scene, "friction", lambda nominal: friction * nominal)
        return changed.model_copy(update={"object": body})

    def _sized(self, error: Array) -> GraspScene:
        """The scene with an object of another size."""
        if not error[3]:
            return self.scene
        body = scaled(self.scene.object, 1.0 + float(error[3]))
        return self.scene.model_copy(update={"object": body})


def scaled(body: Any, factor: float, scene: type[GraspScene | HandScene] = GraspScene) -> Any:
    """An object of a kind of scene all lengths of whose shape are a factor longer; its pose stays."""
    shape = Shape(scene)
    data = {"object": body.model_dump()}

    def grown(path: tuple[str | int, ...], value: Any) -> Any:
        if isinstance(value, dict):
            return {key: grown((*path, key), entry) for key, entry in value.items()}
        if isinstance(value, list | tuple):
            return tuple(grown((*path, k), entry) for k, entry in enumerate(value))
        is_length = isinstance(value, float) and shape.unit(path, data) == "m"
        return factor * value if is_length else value

    placed = ("position", "free", "rotation")
    new = {key: value if key in placed else grown(("object", key), value) for key, value in data["object"].items()}
    return type(body)(**new)
