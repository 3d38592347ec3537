"""Arrays of a grasp of rods, as a result stores them, and the record of the grasp that follows from them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.certificate.surfaces import PlacedObject
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger, HeldRods, HeldSupport, in_plane
from continuum_grasp.grasp.judge.space_rod import SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage, support_of
from continuum_grasp.scene import GraspScene, HandScene

BACKBONE_POINTS = 201
"""Points of a stored backbone: 0.5 % of the length apart, for pictures."""


@dataclass(frozen=True, eq=False)
class TouchedPlace:
    """A contact of the object, in the world."""

    name: str
    position: Array  # (3,) on the object's surface [m]
    normal: Array  # (3,) outward normal of the object
    force: Array  # (3,) on what touches the object [N]
    station: float  # position along the finger [m]; NaN of a support
    shift: float  # of the finger's center line out of its plane [m]
    moment: float  # about the normal, on the finger [N m]


def touched_places(stage: GraspStage, held: HeldRods, rods: tuple[SpaceRod, ...]) -> list[TouchedPlace]:
    """Contacts of a grasp with the geometry of the exact object, contacts of fingers first."""
    body, found = stage.body(held), list[TouchedPlace]()
    for finger, rod in zip(held.fingers, rods, strict=True):
        for contact in finger.contacts:
            center = rod.at(np.array([contact.place])).points
            normal = body.near(center)[1][0]
            half = float(rod.profile.half_thickness(contact.place))
            shift = float((center[0] - finger.position) @ finger.axes[:, 2])
            at = center[0] - half * normal
            found.append(TouchedPlace(contact.name, at, normal, contact.force, contact.place, shift, contact.moment))
    obstacles = {obstacle.name: obstacle for obstacle in stage.obstacles}
    for support in held.supports:
        normal = obstacles[support_of(stage, support.name)].touched(support, body)[0]
        found.append(TouchedPlace(support.name, support.position, normal, support.force, np.nan, 0.0, 0.0))
    return found


class RodArrays(ABC):
    """Arrays of the grasps of a scene."""

    @staticmethod
    def of(scene: GraspScene | HandScene) -> RodArrays:
        """The arrays of a kind of scene."""
        return _PlaneArrays(scene) if isinstance(scene, GraspScene) else _HandArrays(scene)

    @abstractmethod
    def stored(self, held: HeldRods, rods: tuple[SpaceRod, ...]) -> dict[str, Array]:
        """Arrays of a grasp, whose fingers have these shapes, without arrays of elements."""

    @abstractmethod
    def held(self, arrays: Mapping[str, Any]) -> HeldRods:
        """The grasp that has been stored."""

    @staticmethod
    def _finger(finger: HeldFinger, rod: SpaceRod, base: Array) -> dict[str, Array]:
        """Arrays of a finger whose base (3,) has this pose in the plane in which it bends."""
        s = np.linspace(0.0, rod.length, BACKBONE_POINTS)
        places = rod.at(s)
        local = (places.points - finger.position) @ finger.axes
        along = places.axes[:, :, 1] @ finger.axes
        angles = np.unwrap(np.arctan2(-along[:, 0], along[:, 1])) + base[2]
        points = base[0] + 1j * base[1] + (local[:, 0] + 1j * local[:, 1]) * np.exp(1j * base[2])
        found = {
            "tensions": finger.tensions,
            "base": base,
            "base_moment": np.zeros(3) if finger.moment is None else finger.moment,
            "backbone": np.column_stack([s, points.real, points.imag, angles]),
        }
        return {f"{finger.name}.{key}": value for key, value in found.items()}


class _PlaneArrays(RodArrays):
    """Arrays of a planar scene."""

    def __init__(self, scene: GraspScene) -> None:
        self._scene, self._stage = scene, GraspStage.of(scene)

    def stored(self, held: HeldRods, rods: tuple[SpaceRod, ...]) -> dict[str, Array]:
        pose = _pose(held.position, held.axes, self._scene.object.angle)
        touched = touched_places(self._stage, held, rods)
        points = np.array([place.position[:2] for place in touched]).reshape(-1, 2)
        normals = np.array([place.normal[:2] for place in touched]).reshape(-1, 2)
        found: dict[str, Array] = {
            "object.pose": pose,
            "contact_names": np.array([place.name for place in touched], dtype=str),
            "contact_positions": points,
            "contact_normals": normals,
            "contact_forces": np.array([_parts(place) for place in touched]).reshape(-1, 3),
            "contact_stations": np.array([place.station for place in touched]),
            "contact_parts": np.abs(PlacedObject(self._scene.object, pose).distances(points)).argmin(axis=0),
        }
        for setup, finger, rod in zip(self._scene.setups, held.fingers, rods, strict=True):
            found |= self._finger(finger, rod, _pose(finger.position, finger.axes, setup.finger.base.angle))
        return found

    def held(self, arrays: Mapping[str, Any]) -> HeldRods:
        forces = {
            str(name): n * np.array([*normal, 0.0]) + f * np.array([-normal[1], normal[0], 0.0]) - [0.0, 0.0, lift]
            for name, normal, (n, f, lift) in zip(
                arrays["contact_names"], arrays["contact_normals"], arrays["contact_forces"], strict=True
            )
        }
        places = [np.array([*place, 0.0]) for place in arrays["contact_positions"]]
        bases = [in_plane(arrays[f"{setup.name}.base"]) for setup in self._scene.setups]
        return _held(self._scene, arrays, in_plane(arrays["object.pose"]), bases, forces, places)


class _HandArrays(RodArrays):
    """Arrays of a hand's scene. Its fingers bend in the planes of their bases, with small shifts out of them."""

    def __init__(self, scene: HandScene) -> None:
        self._scene, self._stage = scene, GraspStage.of(scene)

    def stored(self, held: HeldRods, rods: tuple[SpaceRod, ...]) -> dict[str, Array]:
        touched = touched_places(self._stage, held, rods)
        found: dict[str, Array] = {
            "contact_names": np.array([place.name for place in touched], dtype=str),
            "contact_positions": np.array([place.position for place in touched]).reshape(-1, 3),
            "contact_normals": np.array([place.normal for place in touched]).reshape(-1, 3),
            "contact_forces": np.array([place.force for place in touched]).reshape(-1, 3),
            "contact_stations": np.nan_to_num([place.station for place in touched]),
            "contact_deflections": np.array([place.shift for place in touched]),
        }
        if self._scene.contacts.torsional_friction:
            found["contact_moments"] = np.array([place.moment for place in touched])
        for finger, rod in zip(held.fingers, rods, strict=True):
            found |= self._finger(finger, rod, np.zeros(3))
        return found

    def held(self, arrays: Mapping[str, Any]) -> HeldRods:
        names = [str(name) for name in arrays["contact_names"]]
        forces = dict(zip(names, np.asarray(arrays["contact_forces"]), strict=True))
        body: Any = self._scene.object
        bases = [(frame.base, frame.axes) for frame in PlaneFrame.each(self._scene)]
        pose = np.array(body.position), np.asarray(body.axes)
        return _held(self._scene, arrays, pose, bases, forces, list(arrays["contact_positions"]))


def _held(
    scene: GraspScene | HandScene,
    arrays: Mapping[str, Any],
    pose: tuple[Array, Array],
    bases: list[tuple[Array, Array]],
    forces: Mapping[str, Array],
    places: list[Array],
) -> HeldRods:
    """The record of a grasp."""
    names = list(forces)
    moments = arrays.get("contact_moments", np.zeros(len(names)))
    stations = dict(zip(names, arrays["contact_stations"], strict=True))
    twists = dict(zip(names, moments, strict=True))
    fingers, owned = list[HeldFinger](), set[str]()
    for setup, (position, axes) in zip(scene.setups, bases, strict=True):
        own = [name for name in names if name in setup.switches]
        owned.update(own)
        contacts = [HeldContact(name, forces[name], float(stations[name]), float(twists[name])) for name in own]
        tensions, moment = (np.asarray(arrays[f"{setup.name}.{key}"]) for key in ("tensions", "base_moment"))
        fingers.append(HeldFinger(setup.name, position, axes, tensions, tuple(contacts), moment))
    rest = zip(names, places, strict=True)
    supports = tuple(HeldSupport(name, forces[name], np.asarray(at)) for name, at in rest if name not in owned)
    return HeldRods(*pose, tuple(fingers), supports)


def _parts(place: TouchedPlace) -> tuple[float, float, float]:
    """Normal force, friction along the surface on what touches the object, and lift on the object [N]."""
    across = np.array([-place.normal[1], place.normal[0], 0.0])
    return float(place.force @ place.normal), float(place.force @ across), -float(place.force[2])


def _pose(position: Array, axes: Array, near: float) -> Array:
    """World x, y [m] and angle [rad] of a frame, by the turn that is nearest to an angle."""
    angle = float(np.arctan2(axes[1, 0], axes[0, 0]))
    return np.array([position[0], position[1], near + np.remainder(angle - near + np.pi, 2.0 * np.pi) - np.pi])
