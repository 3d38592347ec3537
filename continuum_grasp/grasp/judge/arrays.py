"""Arrays of a grasp of rods as a result stores them: written, read as a record of the grasp, and compared with it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.grasp.judge.certificate import support_of
from continuum_grasp.grasp.judge.check import EXACT, Check, Requirement, greatest
from continuum_grasp.grasp.judge.held import HeldContact, HeldFinger, HeldRods, HeldSupport, in_plane
from continuum_grasp.grasp.judge.space_rod import SpaceRod
from continuum_grasp.grasp.judge.stage import GraspStage
from continuum_grasp.grasp.judge.surfaces import PlacedObject
from continuum_grasp.scene import FAMILIES, FingerSetup, GraspScene, HandScene

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

    dimensions: int
    """Coordinates of a place."""
    contact_keys: tuple[str, ...]
    """Arrays with a number per contact, besides names, positions, normals and forces."""

    def __init__(self, scene: GraspScene | HandScene) -> None:
        self._setups: tuple[FingerSetup, ...] = tuple(scene.setups)
        self._stage = GraspStage.of(scene)

    @staticmethod
    def of(scene: GraspScene | HandScene) -> RodArrays:
        """The arrays of a kind of scene."""
        return _PlaneArrays(scene) if isinstance(scene, GraspScene) else _HandArrays(scene)

    # -- a grasp as arrays -------------------------------------------------------------------------------------

    def stored(self, held: HeldRods, rods: tuple[SpaceRod, ...]) -> dict[str, Array]:
        """Arrays of a grasp, whose fingers have these shapes, without arrays of elements."""
        found = self._of_object(held) | self._of_contacts(held, touched_places(self._stage, held, rods))
        for finger, rod in zip(held.fingers, rods, strict=True):
            base = self._base(finger)
            named = {
                "tensions": finger.tensions,
                "base": base,
                "base_moment": np.zeros(3) if finger.moment is None else finger.moment,
                "backbone": _backbone(finger, rod, base, np.linspace(0.0, rod.length, BACKBONE_POINTS)),
            }
            found |= {f"{finger.name}.{key}": value for key, value in named.items()}
        return found

    @abstractmethod
    def _of_object(self, held: HeldRods) -> dict[str, Array]:
        """Arrays of the object."""

    @abstractmethod
    def _of_contacts(self, held: HeldRods, touched: list[TouchedPlace]) -> dict[str, Array]:
        """Arrays of the contacts."""

    @abstractmethod
    def _base(self, finger: HeldFinger) -> Array:
        """Pose (3,) of the base of a finger in the plane in which its backbone is stored."""

    # -- arrays as a grasp -------------------------------------------------------------------------------------

    def held(self, arrays: Mapping[str, Any]) -> HeldRods:
        """The grasp that has been stored."""
        names = [str(name) for name in arrays["contact_names"]]
        forces, places = self._forces(arrays), self._places(arrays)
        moments = np.asarray(arrays.get("contact_moments", np.zeros(len(names))), dtype=float)
        stations = np.asarray(arrays["contact_stations"], dtype=float)
        fingers, rest = list[HeldFinger](), set(range(len(names)))
        for k, setup in enumerate(self._setups):
            own = [j for j, name in enumerate(names) if name in setup.switches]
            rest -= set(own)
            contacts = [HeldContact(names[j], forces[j], float(stations[j]), float(moments[j])) for j in own]
            tensions, moment = (
                np.asarray(arrays[f"{setup.name}.{key}"], dtype=float) for key in ("tensions", "base_moment")
            )
            fingers.append(HeldFinger(setup.name, *self._placed(arrays, k), tensions, tuple(contacts), moment))
        supports = tuple(HeldSupport(names[j], forces[j], places[j]) for j in sorted(rest))
        return HeldRods(*self._pose(arrays), tuple(fingers), supports)

    @abstractmethod
    def _forces(self, arrays: Mapping[str, Any]) -> Array:
        """Forces (contacts, 3) on what touches the object [N]."""

    @abstractmethod
    def _places(self, arrays: Mapping[str, Any]) -> Array:
        """Places (contacts, 3) [m]."""

    @abstractmethod
    def _pose(self, arrays: Mapping[str, Any]) -> tuple[Array, Array]:
        """Position (3,) [m] and axes (3, 3) of the object."""

    @abstractmethod
    def _placed(self, arrays: Mapping[str, Any], finger: int) -> tuple[Array, Array]:
        """Position (3,) [m] and axes (3, 3) of the base of a finger."""

    # -- what is amiss with arrays -----------------------------------------------------------------------------

    def misshapen(self, arrays: Mapping[str, Any]) -> int:
        """Count of arrays that are missing, misshapen or of another family than the scene's."""
        names = np.asarray(arrays.get("contact_names", 0.0))
        wrong = int("contact_names" not in arrays or names.ndim != 1)
        expected = self._shapes(names.size)
        for setup in self._setups:
            expected |= _shapes_of(setup)
            wrong += str(arrays.get(f"{setup.name}.family")) != setup.family
        wrong += sum(not _fits(arrays.get(name), shape) for name, shape in expected.items())
        return wrong or sum(not _spanned(arrays, setup) for setup in self._setups)

    def _shapes(self, contacts: int) -> dict[str, _Shape]:
        """Shapes of the arrays of object and contacts."""
        found: dict[str, _Shape] = {f"contact_{key}": (contacts,) for key in self.contact_keys}
        return found | {
            "contact_positions": (contacts, self.dimensions),
            "contact_normals": (contacts, self.dimensions),
            "contact_forces": (contacts, 3),
        }

    def not_finite(self, arrays: Mapping[str, Any]) -> int:
        """Count of numbers that are NaN or infinite; the stations of supports are NaN by right."""
        own = {name for setup in self._setups for name in setup.switches}
        stations = [
            station
            for name, station in zip(arrays["contact_names"], arrays["contact_stations"], strict=True)
            if str(name) in own
        ]
        known = self._shapes(0) | {name: shape for setup in self._setups for name, shape in _shapes_of(setup).items()}
        parts = [np.ravel(arrays[name]) for name in known if name != "contact_stations"]
        return int((~np.isfinite(np.concatenate([*parts, stations]).astype(float))).sum())

    def differences(self, held: HeldRods, rods: tuple[SpaceRod, ...], arrays: Mapping[str, Any]) -> Iterator[Check]:
        """Checks of stored numbers that follow from the grasp."""
        touched = touched_places(self._stage, held, rods)
        anew = self._of_contacts(held, touched)
        order = {place.name: k for k, place in enumerate(touched)}
        for k, name in enumerate(map(str, arrays["contact_names"])):
            off = list(self._off(arrays, anew, k, order[name]))
            yield Check(Requirement.STORED, name, greatest(off), EXACT)
        for finger, rod in zip(held.fingers, rods, strict=True):
            stored = np.asarray(arrays[f"{finger.name}.backbone"], dtype=float)
            s, length = stored[:, 0], rod.length
            off = [abs(s[0]) / length, abs(s[-1] / length - 1.0), -float(np.diff(s).min()) / length]
            shape = _backbone(finger, rod, self._base(finger), np.clip(s, 0.0, length))
            off += list(np.abs(stored[:, 1:] - shape[:, 1:]).max(axis=0) / [length, length, 1.0])
            lengths = np.asarray(arrays[f"{finger.name}.lengths"], dtype=float)
            off += [abs(lengths.sum() / length - 1.0), -float(lengths.min()) / length]
            yield Check(Requirement.STORED, finger.name, greatest(off), EXACT)

    def _off(self, arrays: Mapping[str, Any], anew: Mapping[str, Array], k: int, same: int) -> Iterator[float]:
        """Differences of a stored contact from the measured one, in sizes of the object and in radians."""
        for key, unit in (("positions", self._stage.size), ("normals", 1.0)):
            name = f"contact_{key}"
            yield float(np.abs(np.asarray(arrays[name][k], dtype=float) - anew[name][same]).max()) / unit


_Shape = tuple[int | None, ...]
"""Shape of an array, None where any length will do."""


def _shapes_of(setup: FingerSetup) -> dict[str, _Shape]:
    """Shapes of the arrays of a finger: of its rod, and of the elements that stand for it."""
    of_rod: dict[str, _Shape] = {"base": (3,), "base_moment": (3,), "backbone": (None, 4)}
    of_elements: dict[str, _Shape] = {
        "q": (None,),
        "lengths": (setup.elements,),
        "tip_curvature": (),
        "curvature_shapes": (setup.elements, None, None),
    }
    shapes = of_rod | of_elements | {"tensions": (len(setup.finger.tendon_list),)}
    return {f"{setup.name}.{key}": shape for key, shape in shapes.items()}


def _spanned(arrays: Mapping[str, Any], setup: FingerSetup) -> bool:
    """Whether there is a coordinate for each shape of elements, but for that of a tip which the moments set."""
    shapes, q = (np.shape(arrays[f"{setup.name}.{key}"]) for key in ("curvature_shapes", "q"))
    return bool(shapes[-1] == q[0] + FAMILIES[setup.family].matches_tip)


def _fits(value: Any, shape: _Shape) -> bool:
    """Whether a stored value has numbers and a shape, none of whose free lengths is zero."""
    try:
        found = np.asarray(value, dtype=float).shape
    except (TypeError, ValueError):
        return False
    if value is None or len(found) != len(shape):
        return False
    return all(n == wanted or (wanted is None and n > 0) for n, wanted in zip(found, shape, strict=True))


def _backbone(finger: HeldFinger, rod: SpaceRod, base: Array, s: Array) -> Array:
    """Sections (n, 4) at positions (n,) along a finger whose base (3,) has this pose in the plane in which it bends."""
    places = rod.at(s)
    local = (places.points - finger.position) @ finger.axes
    along = places.axes[:, :, 1] @ finger.axes
    angles = np.unwrap(np.arctan2(-along[:, 0], along[:, 1])) + base[2]
    points = base[0] + 1j * base[1] + (local[:, 0] + 1j * local[:, 1]) * np.exp(1j * base[2])
    return np.column_stack([s, points.real, points.imag, angles])


class _PlaneArrays(RodArrays):
    """Arrays of a planar scene."""

    dimensions = 2
    contact_keys = ("stations", "parts")

    def __init__(self, scene: GraspScene) -> None:
        super().__init__(scene)
        self._scene = scene

    def _of_object(self, held: HeldRods) -> dict[str, Array]:
        return {"object.pose": _pose(held.position, held.axes, self._scene.object.angle)}

    def _of_contacts(self, held: HeldRods, touched: list[TouchedPlace]) -> dict[str, Array]:
        points = np.array([place.position[:2] for place in touched]).reshape(-1, 2)
        body = PlacedObject(self._scene.object, self._of_object(held)["object.pose"])
        return {
            "contact_names": np.array([place.name for place in touched], dtype=str),
            "contact_positions": points,
            "contact_normals": np.array([place.normal[:2] for place in touched]).reshape(-1, 2),
            "contact_forces": np.array([_parts(place) for place in touched]).reshape(-1, 3),
            "contact_stations": np.array([place.station for place in touched]),
            "contact_parts": np.abs(body.distances(points)).argmin(axis=0),
        }

    def _base(self, finger: HeldFinger) -> Array:
        return _pose(finger.position, finger.axes, self._stage.setups[finger.name].finger.base.angle)

    def _forces(self, arrays: Mapping[str, Any]) -> Array:
        normal = np.asarray(arrays["contact_normals"], dtype=float).reshape(-1, 2)
        n, f, lift = np.asarray(arrays["contact_forces"], dtype=float).reshape(-1, 3).T
        flat = n[:, None] * normal + f[:, None] * np.column_stack([-normal[:, 1], normal[:, 0]])
        return np.column_stack([flat, -lift])

    def _places(self, arrays: Mapping[str, Any]) -> Array:
        flat = np.asarray(arrays["contact_positions"], dtype=float).reshape(-1, 2)
        return np.column_stack([flat, np.zeros(len(flat))])

    def _pose(self, arrays: Mapping[str, Any]) -> tuple[Array, Array]:
        return in_plane(arrays["object.pose"])

    def _placed(self, arrays: Mapping[str, Any], finger: int) -> tuple[Array, Array]:
        return in_plane(arrays[f"{self._setups[finger].name}.base"])

    def _shapes(self, contacts: int) -> dict[str, _Shape]:
        return super()._shapes(contacts) | {"object.pose": (3,)}

    def misshapen(self, arrays: Mapping[str, Any]) -> int:
        wrong = super().misshapen(arrays)
        parts = arrays.get("contact_parts", ())
        return wrong + (not np.isin(parts, np.arange(len(self._scene.object.parts))).all())

    def _off(self, arrays: Mapping[str, Any], anew: Mapping[str, Array], k: int, same: int) -> Iterator[float]:
        yield from super()._off(arrays, anew, k, same)
        body = PlacedObject(self._scene.object, np.asarray(arrays["object.pose"], dtype=float))
        away = body.distances(anew["contact_positions"][same][None])[:, 0]
        # Where two parts meet, either is touched.
        yield (abs(float(away[arrays["contact_parts"][k]])) - float(np.abs(away).min())) / self._stage.size


class _HandArrays(RodArrays):
    """Arrays of a hand's scene. Its fingers bend in the planes of their bases, with small shifts out of them."""

    dimensions = 3

    def __init__(self, scene: HandScene) -> None:
        super().__init__(scene)
        self._scene = scene
        self._soft = scene.contacts.torsional_friction > 0.0
        self.contact_keys = ("stations", "deflections", *["moments"] * self._soft)
        self._frames = PlaneFrame.each(scene)

    def _of_object(self, held: HeldRods) -> dict[str, Array]:
        return {}

    def _of_contacts(self, held: HeldRods, touched: list[TouchedPlace]) -> dict[str, Array]:
        found: dict[str, Array] = {
            "contact_names": np.array([place.name for place in touched], dtype=str),
            "contact_positions": np.array([place.position for place in touched]).reshape(-1, 3),
            "contact_normals": np.array([place.normal for place in touched]).reshape(-1, 3),
            "contact_forces": np.array([place.force for place in touched]).reshape(-1, 3),
            "contact_stations": np.nan_to_num([place.station for place in touched]),
            "contact_deflections": np.array([place.shift for place in touched]),
        }
        if self._soft:
            found["contact_moments"] = np.array([place.moment for place in touched])
        return found

    def _base(self, finger: HeldFinger) -> Array:
        return np.zeros(3)

    def _forces(self, arrays: Mapping[str, Any]) -> Array:
        return np.asarray(arrays["contact_forces"], dtype=float)

    def _places(self, arrays: Mapping[str, Any]) -> Array:
        return np.asarray(arrays["contact_positions"], dtype=float)

    def _pose(self, arrays: Mapping[str, Any]) -> tuple[Array, Array]:
        body: Any = self._scene.object
        return np.array(body.position), np.asarray(body.axes)

    def _placed(self, arrays: Mapping[str, Any], finger: int) -> tuple[Array, Array]:
        return self._frames[finger].base, self._frames[finger].axes

    def _off(self, arrays: Mapping[str, Any], anew: Mapping[str, Array], k: int, same: int) -> Iterator[float]:
        yield from super()._off(arrays, anew, k, same)
        yield abs(float(arrays["contact_deflections"][k]) - anew["contact_deflections"][same]) / self._stage.size


def _parts(place: TouchedPlace) -> tuple[float, float, float]:
    """Normal force, friction along the surface on what touches the object, and lift on the object [N]."""
    across = np.array([-place.normal[1], place.normal[0], 0.0])
    return float(place.force @ place.normal), float(place.force @ across), -float(place.force[2])


def _pose(position: Array, axes: Array, near: float) -> Array:
    """World x, y [m] and angle [rad] of a frame, by the turn that is nearest to an angle."""
    angle = float(np.arctan2(axes[1, 0], axes[0, 0]))
    return np.array([position[0], position[1], near + np.remainder(angle - near + np.pi, 2.0 * np.pi) - np.pi])
