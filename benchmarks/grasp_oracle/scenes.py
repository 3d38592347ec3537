"""Random grasp scenes in a natural range of sizes; whether there is a grasp is not known beforehand.

Each is drawn as plain data, from which the digest of a kind is computed, and then made a scene.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.scene import GraspScene

G = 9.81


@dataclass(frozen=True)
class _View:
    """A turn and a mirror that place a scene anywhere."""

    turn: float
    flip: float
    """-1: mirrored at the x axis before it is turned."""

    def point(self, x: float, y: float) -> tuple[float, float]:
        c, s = math.cos(self.turn), math.sin(self.turn)
        y = self.flip * y
        return c * x - s * y, s * x + c * y

    def angle(self, angle: float) -> float:
        return math.remainder(self.turn + self.flip * angle, 2.0 * math.pi)

    def base(self, x: float, y: float, angle: float) -> dict[str, Any]:
        """The base of a finger that points along ``angle``, not along the y axis of its frame."""
        turned = math.remainder(self.angle(angle) - 0.5 * math.pi, 2.0 * math.pi)
        return {"position": self.point(x, y), "angle": turned}

    def palm(self, x: float) -> dict[str, Any]:
        return {"palm": {"type": "palm", "point": self.point(x, 0.0), "normal_angle": self.angle(0.0)}}


def scene_of(kind: str, seed: int) -> GraspScene:
    """The scene of a seed; what the oracles do not ask for is not asked of the package either.

    ``one``: a finger of two elements, a convex object, and mostly a palm; ``two`` and ``three``: fingers of two matched
    clothoids that pinch a convex object with their tips, a third of the latter on a palm.
    """
    return GraspScene.model_validate(DRAWN[kind](seed) | UNASKED)


def digest(kind: str, seeds: Iterable[int]) -> str:
    """What changes when the scenes of these seeds do."""
    text = json.dumps([DRAWN[kind](seed) for seed in seeds], sort_keys=True, default=float)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _one(seed: int) -> dict[str, Any]:
    random = np.random.default_rng([1, seed])
    view = _View(random.uniform(-math.pi, math.pi), random.choice([-1.0, 1.0]))
    length = 10 ** random.uniform(-1.0, -0.4)
    contacts = random.choice(["all", "no palm", "no middle"], p=[0.8, 0.04, 0.16])
    family = random.choice(["arc", "matched_clothoid", "clothoid"], p=[0.3, 0.6, 0.1])
    if contacts == "no middle":
        family = "arc"
    size = length * random.uniform(0.12, 0.3)
    body, reach, extent = _object(random, size, aligned=random.random() < 0.5)
    finger = _finger(random, length, size, sign=view.flip)
    half = finger["half_thickness"]
    ahead = half * random.uniform(1.0, 1.5) + random.choice([0.0, 1.0]) * random.uniform(0.0, 0.8) * reach
    aside = -(extent + half + length * random.uniform(0.005, 0.3))
    finger["base"] = view.base(ahead, aside, random.uniform(-0.6, 0.6))
    body["position"] = view.point(reach, 0.0)
    body["angle"] = view.angle(body.get("angle", 0.0))
    supports = view.palm(0.0) if contacts != "no palm" else {}
    return _scene(random, finger, body, size, supports, contacts, family)


def _two(seed: int) -> dict[str, Any]:
    random = np.random.default_rng([2, seed])
    view = _View(random.uniform(-math.pi, math.pi), random.choice([-1.0, 1.0]))
    length = 10 ** random.uniform(-1.0, -0.4)
    size = length * random.uniform(0.1, 0.3)
    body, _, extent = _object(random, size, aligned=random.random() < 0.7)
    ahead = length * random.uniform(0.55, 0.85)
    fingers = {}
    model = _finger(random, length, size, sign=view.flip)
    for name, side in (("upper", 1.0), ("lower", -1.0)):
        finger = _plain(dict(model) if random.random() < 0.5 else _finger(random, length, size, sign=view.flip))
        apart = max(extent + finger["half_thickness"] * 1.2, 0.0) + length * random.uniform(0.0, 0.25)
        finger["base"] = view.base(0.0, side * apart, random.uniform(-0.3, 0.3))
        fingers[name] = finger
    body["position"] = view.point(ahead, length * random.uniform(-0.03, 0.03))
    body["angle"] = view.angle(body.get("angle", 0.0))
    return _scene(random, fingers, body, size, {}, "no middle", "matched_clothoid")


def _three(seed: int) -> dict[str, Any]:
    random = np.random.default_rng([4, seed])
    view = _View(random.uniform(-math.pi, math.pi), random.choice([-1.0, 1.0]))
    length = 10 ** random.uniform(-1.0, -0.4)
    size = length * random.uniform(0.1, 0.3)
    body, reach, extent = _object(random, size, aligned=random.random() < 0.7)
    kind = random.choice(["around", "thumb", "palm"])
    # Where each finger comes from, seen from the object [rad], and on which side it passes.
    hand = random.choice([-1.0, 1.0])
    around = [(k * 2.0 * math.pi / 3.0 + random.uniform(-0.2, 0.2), hand) for k in range(3)]
    places = around if kind == "around" else [(0.0, 1.0), (0.0, -1.0), (math.pi, hand)]
    model = _finger(random, length, size, sign=view.flip)
    fingers = {}
    for name, (turn, side) in zip(("first", "second", "third"), places, strict=True):
        finger = _plain(dict(model) if random.random() < 0.5 else _finger(random, length, size, sign=view.flip))
        half = finger["half_thickness"]
        away = length * random.uniform(0.55, 0.85)
        if kind == "palm" and turn == 0.0:
            away = reach - half * random.uniform(1.0, 1.5)
        aside = side * (max(size, extent) + half * 1.2 + length * random.uniform(0.0, 0.25))
        c, s = math.cos(turn), math.sin(turn)
        lean = random.uniform(-0.3, 0.3)
        finger["base"] = view.base(-c * away - s * aside, -s * away + c * aside, turn + lean)
        fingers[name] = finger
    body["position"] = view.point(0.0, 0.0)
    body["angle"] = view.angle(body.get("angle", 0.0))
    supports = view.palm(-reach) if kind == "palm" else {}
    return _scene(random, fingers, body, size, supports, "no middle", "matched_clothoid")


def _plain(finger: dict[str, Any]) -> dict[str, Any]:
    """A straight finger with two tendons that may be slack."""
    finger["rest_curvature"] = 0.0
    finger["tendons"] = dict(finger["tendons"]) | {"min_tension": 0.0}
    finger["tendons_used"] = "both"
    finger.pop("strain_limit", None)
    return finger


def _object(random: np.random.Generator, size: float, aligned: bool) -> tuple[dict[str, Any], float, float]:
    """An object, how far it reaches towards -x, and towards -y, with its angle in the scene's own frame."""
    shape = random.choice(["circle", "ellipse", "superellipse", "box"])
    ratio = random.uniform(0.55, 1.0)
    wide, high = (size, ratio * size) if random.random() < 0.5 else (ratio * size, size)
    angle = random.choice([0.0, 0.5 * math.pi]) if aligned else random.uniform(-math.pi, math.pi)
    body: dict[str, Any] = {"shape": str(shape), "angle": float(angle)}
    if shape == "circle":
        return {"shape": "circle", "diameter": 2.0 * size}, size, size
    body |= {"width": 2.0 * wide, "height": 2.0 * high}
    power = 2.0
    if shape == "superellipse":
        power = body["exponent"] = random.uniform(2.0, 4.0)
    c, s = abs(math.cos(angle)), abs(math.sin(angle))
    if shape == "box":
        corner = body["corner_radius"] = random.choice([0.0, 0.0, random.uniform(0.05, 0.4) * min(wide, high)])
        w, h = wide - corner, high - corner
        return body, c * w + s * h + corner, s * w + c * h + corner
    dual = power / (power - 1.0)
    return (
        body,
        ((c * wide) ** dual + (s * high) ** dual) ** (1.0 / dual),
        ((s * wide) ** dual + (c * high) ** dual) ** (1.0 / dual),
    )


def _finger(random: np.random.Generator, length: float, size: float, sign: float) -> dict[str, Any]:
    """A finger whose bending by half a turn about the object takes 3 to 40 N."""
    half = length * random.uniform(0.015, 0.045)
    offset = half * random.uniform(0.5, 0.95)
    pull = 10 ** random.uniform(0.5, 1.6)
    stiffness = pull * offset * length / 3.0
    weight = stiffness / length**2 * 10 ** random.uniform(-2.5, -0.3)
    finger: dict[str, Any] = {
        "rod": {"length": length, "linear_density": weight / (G * length), "bending_stiffness": stiffness},
        "half_thickness": half,
        "tendons": {"offset": offset, "max_tension": pull * random.uniform(1.5, 8.0)},
    }
    if random.random() < 0.3:
        finger["masses"] = [{"at": length, "mass": 0.3 * random.random() * weight / G}]
    if random.random() < 0.3:
        finger["rest_curvature"] = sign * random.uniform(-0.5, 1.5) / length
    if random.random() < 0.3:
        finger["rod"]["diameter"] = half * random.uniform(0.1, 0.4)
        finger["strain_limit"] = 0.5 * finger["rod"]["diameter"] * random.uniform(1.2, 4.0) / size
    if random.random() < 0.3:
        finger["tendons"]["min_tension"] = random.uniform(0.0, 0.2) * pull
    elif random.random() < 0.5:
        finger["tendons_used"] = "left" if sign > 0 else "right"
    return finger


def _scene(
    random: np.random.Generator,
    fingers: dict[str, Any],
    body: dict[str, Any],
    size: float,
    supports: dict[str, Any],
    contacts: str,
    family: str,
) -> dict[str, Any]:
    some = fingers if "rod" in fingers else next(iter(fingers.values()))
    grip = some["tendons"]["max_tension"] * some["tendons"]["offset"] / size
    body["mass"] = grip / G * 10 ** random.uniform(-1.7, 0.3)
    mode = random.choice(["planar", "out_of_plane", "none"], p=[0.4, 0.45, 0.15])
    gravity, upright = (0.0, 0.0, 0.0), False
    if mode == "planar":
        down = random.uniform(-math.pi, math.pi)
        gravity = (G * math.cos(down), G * math.sin(down), 0.0)
    elif mode == "out_of_plane":
        gravity, upright = (0.0, 0.0, -G), not (contacts == "all" and random.random() < 0.7)
    return {
        ("finger" if "rod" in fingers else "fingers"): fingers,
        "object": body,
        "supports": supports,
        "contacts": {
            "friction": random.uniform(0.25, 1.2),
            "normal_force_max": random.uniform(10.0, 40.0) * max(body["mass"] * G, grip),
            "middle": "off" if contacts == "no middle" else "on",
            "tip": "on",
            "push": 0.0,  # of which the oracle knows nothing: without a weight a touch is enough
        },
        "gravity": gravity,
        "upright": upright,
        "fidelity": {"family": family, "elements": 2, "bending_range": 2.0 * math.pi},
    }


DRAWN = {"one": _one, "two": _two, "three": _three}
"""The plain data of a scene from its seed, by kind."""
UNASKED = {
    key: value for key, value in (("stability", "ignore"), ("overlap", "allow")) if key in GraspScene.model_fields
}
"""The oracles judge neither stability nor fingers that cross."""
