"""What a starting point of the search is, and a grasp that was found as one: for other elements, or another aim."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.rod.dense_rod import curvature_profile
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]


@dataclass(frozen=True)
class FingerStart:
    """One finger of a start.

    Attributes
    ----------
    base : (float, float, float)
        World x, y [m] and angle [rad] of the base.
    joints : tuple of float
        Positions along the finger of all middle contacts, on or off, increasing [m].
    sides : tuple of int
        Per middle contact: the object's outward normal there is side * (cos, sin) of the section's angle; +1: the
        object is on the finger's left (-X).
    knots : tuple of float
        Positions along the finger, from 0 to its length [m].
    curvatures : tuple of float
        At the knots, linear between them [1/m].
    """

    base: tuple[float, float, float]
    joints: tuple[float, ...]
    sides: tuple[int, ...]
    knots: tuple[float, ...]
    curvatures: tuple[float, ...]

    def bends(self, ends: Array) -> Array:
        """Bending angles (N,) of the elements between positions ``ends`` (N + 1,) [m, rad]."""
        knots, bent = np.asarray(self.knots), np.asarray(self.curvatures)
        turned = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(knots) * (bent[1:] + bent[:-1]))])
        k = np.clip(np.searchsorted(knots, ends, side="right") - 1, 0, len(knots) - 2)
        u = ends - knots[k]
        slope = (bent[k + 1] - bent[k]) / (knots[k + 1] - knots[k])
        return np.asarray(np.diff(turned[k] + u * (bent[k] + 0.5 * slope * u)))


@dataclass(frozen=True)
class ContactStart:
    """One contact of a start.

    Attributes
    ----------
    part : int
        Index of the object's part that is touched.
    point : (float, float)
        On its surface, in the object's frame [m].
    normal_angle : float
        Of the outward normal, in the object's frame [rad].
    """

    part: int
    point: tuple[float, float]
    normal_angle: float


@dataclass(frozen=True)
class Start:
    """One start.

    Attributes
    ----------
    label : str
        Where it comes from: "scan" (touches as it should), "near" (the closest there is) or "random".
    object_pose : (float, float, float)
        World x, y [m] and angle [rad] of the object.
    fingers : dict of str to FingerStart
    contacts : dict of str to ContactStart
        All contacts that are on, those with supports included.
    forces : dict of str to (float, float, float)
        Normal, friction and lift at the contacts that balance the object as nearly as they can [N]; signs as in a
        result's ``contact_forces``; may be empty.
    tensions : dict of str to (float, float)
        Of the fingers' tendons that go with them [N]; may be empty.
    """

    label: str
    object_pose: tuple[float, float, float]
    fingers: dict[str, FingerStart]
    contacts: dict[str, ContactStart]
    forces: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    tensions: dict[str, tuple[float, float]] = field(default_factory=dict)


def start_from(scene: GraspScene, arrays: dict[str, Array]) -> Start:
    """A grasp as a start for the same scene with other elements.

    Parameters
    ----------
    scene : GraspScene
        The scene that the grasp was found for.
    arrays : dict
        Its numbers, as `continuum_grasp.grasp.GraspResult` holds them.
    """
    names = [str(name) for name in arrays["contact_names"]]
    stations = dict(zip(names, arrays["contact_stations"], strict=True))
    normals = dict(zip(names, arrays["contact_normals"], strict=True))
    x, y, turn = (float(v) for v in arrays["object.pose"])
    back = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    fingers = {}
    for setup in scene.setups:
        lengths = arrays[f"{setup.name}.lengths"]
        ends = np.concatenate([[0.0], np.cumsum(lengths)])
        joints = tuple(float(ends[count]) for count in setup.before)
        tip = float(arrays[f"{setup.name}.tip_curvature"])
        shapes = arrays[f"{setup.name}.curvature_shapes"]
        knots, curvatures = _knots(curvature_profile(shapes, arrays[f"{setup.name}.q"], tip), ends)
        line, sides = arrays[f"{setup.name}.backbone"], []
        for name, joint in zip(setup.middle_names, joints, strict=True):
            angle = float(np.interp(joint, line[:, 0], line[:, 3]))
            across = np.array([np.cos(angle), np.sin(angle)])
            sides.append(1 if name not in stations or across @ normals[name] >= 0.0 else -1)
        base = arrays[f"{setup.name}.base"]
        fingers[setup.name] = FingerStart(
            (float(base[0]), float(base[1]), float(base[2])), joints, tuple(sides), knots, curvatures
        )
    contacts = {}
    for k, name in enumerate(names):
        point = back @ (arrays["contact_positions"][k] - [x, y])
        normal = back @ arrays["contact_normals"][k]
        angle = float(np.arctan2(normal[1], normal[0]))
        contacts[name] = ContactStart(int(arrays["contact_parts"][k]), (float(point[0]), float(point[1])), angle)
    return Start("found", (x, y, turn), fingers, contacts)


def _knots(profile: Array, ends: Array) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Knots and curvatures of a continuous profile near that of a finger, whose elements have D curvatures each."""
    first, last = ends[:-1, None], ends[1:, None]
    if profile.shape[1] == 1:
        knots = np.concatenate([ends[:1], 0.5 * (ends[1:] + ends[:-1]), ends[-1:]])
        values = np.concatenate([profile[0], profile[:, 0], profile[-1]])
    else:
        inner = first + (last - first) * np.linspace(0.0, 1.0, profile.shape[1])[1:-1]
        joints = np.concatenate([profile[:1, 0], 0.5 * (profile[:-1, -1] + profile[1:, 0]), profile[-1:, -1]])
        knots = np.append(np.concatenate([first, inner], axis=1), ends[-1])
        values = np.append(np.concatenate([joints[:-1, None], profile[:, 1:-1]], axis=1), joints[-1])
    return tuple(knots.tolist()), tuple(values.tolist())
