"""A planar scene whose object is not quite where and what it should be."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from continuum_grasp.base import Array, InputError
from continuum_grasp.grasp.starts.supports import object_outlines, settle
from continuum_grasp.grasp.starts.values import Pose
from continuum_grasp.grasp.values import YIELDS
from continuum_grasp.scene import GraspScene, HandScene, Shape


class PlanarObjectError:
    """Scenes of a grasp with errors of its object.

    An error (6,) has offsets of the pose x [m], y [m] and angle [rad], and shares of size, friction and mass [1].

    Parameters
    ----------
    scene : GraspScene
    contacts : sequence of str
        Names of the contacts of the grasp.
    pose : sequence of float
        Pose of the object in the grasp [m, rad].
    """

    def __init__(self, scene: GraspScene, contacts: Sequence[str], pose: Sequence[float]) -> None:
        self.scene = scene.model_copy(update={"robust": None, "objective": "greatest_friction_margin"})
        x, y, angle = (float(value) for value in pose)
        self.pose: Pose = (x, y, angle)
        # Supports that the object touches; two contacts with one: a face lies on it and has no error of its angle.
        supports = [support.name for name in contacts if (support := scene.support_of(name)) is not None]
        self.on = frozenset(supports)
        self.flat = len(supports) > len(set(supports))
        self._poses: dict[bytes, Pose] = {}

    def pose_in_error(self, error: Array) -> Pose:
        """Pose of the object in error [m, rad]: moved back to the supports that it touches."""
        key = error.tobytes()
        if key not in self._poses:
            self._poses[key] = self._settled(error)
        return self._poses[key]

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

    def scene_with(self, error: Array) -> GraspScene:
        """The scene with an error; an object that touches no support may yield to the fingers."""
        friction = 1.0 + float(error[4])
        mass = 1.0 + float(error[5])
        x, y, angle = self.pose_in_error(error)
        scene = self._sized(error)
        reach = YIELDS * self.scene.object.size
        ranges = {"x": (x - reach, x + reach), "y": (y - reach, y + reach), "angle": (angle - YIELDS, angle + YIELDS)}
        # Where it does not yield, its pose is held.
        free = ranges if not self.on or self.scene.object.free is not None else None
        body = scene.object.standing((x, y, angle), free, mass=mass * scene.object.mass)
        return _with_friction(scene, friction).model_copy(update={"object": body})

    def _sized(self, error: Array) -> GraspScene:
        """The scene with an object of another size."""
        if not error[3]:
            return self.scene
        body = scaled(self.scene.object, 1.0 + float(error[3]))
        return self.scene.model_copy(update={"object": body})


def _with_friction(scene: GraspScene, factor: float) -> GraspScene:
    """The scene with friction coefficients times a factor, wherever it has them."""

    def changed(value: Any) -> Any:
        own = value.friction
        return value if own is None else value.model_copy(update={"friction": factor * own})

    fingers = {
        setup.name: setup.finger.model_copy(update={"contacts": changed(setup.finger.contacts)})
        for setup in scene.setups
    }
    supports = {name: changed(support) for name, support in scene.supports.items()}
    return scene.with_fingers(fingers).model_copy(update={"contacts": changed(scene.contacts), "supports": supports})


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
