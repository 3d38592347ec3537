"""A grasp that was found, as a start: for other elements, or another aim."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.starts.values import ContactStart, FingerStart, Start
from continuum_grasp.rod.dense_rod import curvature_profile
from continuum_grasp.scene.grasp import GraspScene

__all__ = ["start_from"]

Array = NDArray[Any]


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
