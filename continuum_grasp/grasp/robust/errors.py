"""Scenes whose object is not quite where and as it should be.

Errors are rows (x [m], y [m], angle [rad], size, friction, mass [1]): offsets of the pose, and shares of the lengths of
the shape, of the friction coefficients and of the mass.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

from continuum_grasp.base import Array, InputError
from continuum_grasp.grasp.judge.check import YIELDS
from continuum_grasp.grasp.object_supports import Pose, object_outlines, settle
from continuum_grasp.scene import GraspScene, HandScene, Shape, Value

_V = TypeVar("_V", bound=Value)


class InError:
    """A planar scene with errors of its object, which lies at a pose [m, rad] and touches ``supports`` by name; one
    that is named twice touches a face of the object, which has no error of its angle then.
    """

    def __init__(self, scene: GraspScene, pose: Array, supports: Iterable[str]) -> None:
        self.scene = scene.model_copy(update={"robust": None, "objective": "greatest_friction_margin"})
        self._pose: Pose = (float(pose[0]), float(pose[1]), float(pose[2]))
        names = list(supports)
        self._on = frozenset(names)
        self._flat = len(names) > len(self._on)
        self._settled: dict[bytes, Pose] = {}

    def pose(self, error: Array) -> Pose:
        """Pose of the object in error [m, rad]: moved back to the supports that it touches."""
        key = error.tobytes()
        if key not in self._settled:
            self._settled[key] = self._settle(error)
        return self._settled[key]

    def _settle(self, error: Array) -> Pose:
        x, y, angle = (p + float(e) for p, e in zip(self._pose, error[:3], strict=True))
        if not self._on:
            return x, y, angle
        angle = self._pose[2] if self._flat else angle
        scene, size = self._sized(error), self.scene.object.size
        within = [(x - size, x + size), (y - size, y + size), (angle, angle)]
        pose = settle(scene, object_outlines(scene), self._on, (x, y, angle), within)
        if pose is None:
            raise InputError(
                "robust: an object of another size or angle cannot touch all of "
                f"{', '.join(sorted(self._on))} at once; expected bounds that preserve these contacts: omit radius or "
                "angle",
                key="robust",
            )
        return pose

    def scene_with(self, error: Array) -> GraspScene:
        """The scene with an error (6,); an object that touches no support may yield to the fingers."""
        friction, mass = 1.0 + float(error[4]), 1.0 + float(error[5])
        x, y, angle = self.pose(error)
        scene = self._sized(error)
        reach = YIELDS * self.scene.object.size
        ranges = {"x": (x - reach, x + reach), "y": (y - reach, y + reach), "angle": (angle - YIELDS, angle + YIELDS)}
        free = ranges if not self._on or self.scene.object.free is not None else None
        body = scene.object.standing((x, y, angle), free, mass=mass * scene.object.mass)
        return _with_friction(scene, friction).model_copy(update={"object": body})

    def _sized(self, error: Array) -> GraspScene:
        """The scene with an object of another size."""
        if not error[3]:
            return self.scene
        body = scaled(self.scene.object, 1.0 + float(error[3]))
        return self.scene.model_copy(update={"object": body})


def _with_friction(scene: GraspScene, factor: float) -> GraspScene:
    """The scene with all friction coefficients a factor higher."""

    def changed(value: _V) -> _V:
        friction = getattr(value, "friction", None)
        return value if friction is None else value.model_copy(update={"friction": factor * friction})

    def of_finger(name: str) -> Any:
        finger = scene.named_fingers[name]
        return finger.model_copy(update={"contacts": changed(finger.contacts)})

    fingers = scene.with_fingers({name: of_finger(name) for name in scene.named_fingers})
    supports = {name: changed(support) for name, support in scene.supports.items()}
    return fingers.model_copy(update={"contacts": changed(scene.contacts), "supports": supports})


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
