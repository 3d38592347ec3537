"""Results of the right form for shipped scenes, without a search: for tests of what is shown and saved."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from continuum_grasp.grasp import GraspResult, GraspStatus, Reason
from continuum_grasp.scene import load

ROOT = Path(__file__).parents[1]
REASON = Reason("mass", "object.mass", "kg", 1.5, 0.46, "the object is too heavy", "lower object.mass to 0.46 kg")


def scene_of(name, /, **changes):
    return load(ROOT / "configs" / "grasp" / f"{name}.yaml").model_copy(update=changes)


def bent(base, length, curvature):
    """A circular arc from its center (points, 4): no integration."""
    s = np.linspace(0.0, length, 60)
    angle = base[2] + curvature * s
    if abs(curvature) < 1e-12:
        path = s[:, None] * [-math.sin(base[2]), math.cos(base[2])]
    else:
        path = np.stack([np.cos(angle) - math.cos(base[2]), np.sin(angle) - math.sin(base[2])], axis=1) / curvature
    return np.column_stack([s, base[0] + path[:, 0], base[1] + path[:, 1], angle])


def made_up(scene, curvature=12.0):
    """Numbers of the right form: fingers that are arcs, contacts on the object's outline towards their tips."""
    arrays = {"object.pose": np.array(scene.object.pose)}
    outline = np.concatenate([np.array(part.outline()) for part in scene.object.parts])
    c, s = math.cos(scene.object.angle), math.sin(scene.object.angle)
    outline = outline @ np.array([[c, s], [-s, c]]) + scene.object.position
    middle = outline.mean(axis=0)
    places = {}
    for name, finger in scene.named_fingers.items():
        base = np.array([*finger.base.position, finger.base.angle])
        toward = middle - base[:2]
        left = -math.sin(base[2]) * toward[1] - math.cos(base[2]) * toward[0] > 0
        line = bent(base, finger.rod.length, curvature if left else -curvature)
        arrays |= {
            f"{name}.family": np.array("arc"),
            f"{name}.q": np.full(2, 0.5 * line[-1, 3]),
            f"{name}.lengths": np.full(2, 0.5 * finger.rod.length),
            f"{name}.curvature_shapes": np.diag([2.0 / finger.rod.length] * 2)[:, None],
            f"{name}.tip_curvature": np.array(curvature),
            f"{name}.tensions": np.array([12.25, 1.0]),
            f"{name}.base": base,
            f"{name}.base_moment": np.zeros(3),
            f"{name}.backbone": line,
        }
        places[f"{name}.middle"], places[f"{name}.tip"] = line[30, 1:3], line[-1, 1:3]
    for wall in scene.walls:
        places[wall.name] = np.array(wall.point)
    nearest = [outline[np.argmin(np.hypot(*(outline - p).T))] for p in places.values()]
    normals = [(p - middle) / math.dist(p, middle) for p in nearest]
    count = len(places)
    return arrays | {
        "contact_names": np.array(list(places)),
        "contact_positions": np.array(nearest),
        "contact_normals": np.array(normals),
        "contact_forces": np.tile([2.5, -0.75, 0.5], (count, 1)),
        "contact_stations": np.where(["." in name for name in places], 0.05, np.nan),
        "contact_parts": np.zeros(count, dtype=int),
    }


def held(name="mug", /, **changes):
    scene = scene_of(name, **changes)
    statistics = {"solver_seconds": 0.25, "interrupted": False, "attempts": [{"start": "a", "seconds": 0.1}]}
    return GraspResult(scene, GraspStatus.OPTIMAL, "held", made_up(scene), statistics=statistics)


def failed(name="heavy_bottle", /, arrays=True, **changes):
    scene = scene_of(name, **changes)
    numbers = made_up(scene) if arrays else {}
    violated = ("lift: 3.2 N",)
    return GraspResult(
        scene, GraspStatus.INFEASIBLE, "too heavy", numbers, None, (REASON,), "Use two.", violated=violated
    )
