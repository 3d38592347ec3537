"""Random grasp scenes with fingers of several elements, and their images: mirrored, turned and shifted, or scaled, and
polygons that begin with another vertex. A scene and its images have the same grasps.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import shapely
from shapely.affinity import rotate, translate

from benchmarks.grasp_oracle.scenes import DRAWN, UNASKED, _finger, _object, _scene
from continuum_grasp.scene import GraspScene

Data = dict[str, Any]

LONGER, STRONGER = 8.0, 0.02
"""Lengths and forces of the scaled image, per those of the scene."""
_TURN, _SHIFT = cmath.exp(0.7j), 0.31 - 0.17j
"""Of the moved image."""
_MIDDLE, _TIP = ("on", "on", "auto", "auto", "auto"), ("on", "on", "on", "on", "auto")
"""Switches of the contacts of one finger, drawn together."""


def drawn(kind: str, seed: int) -> Data:
    """A scene with two elements per finger: "one" finger before one of seven kinds of objects; "union": before two
    parts; "two" and "three" fingers that touch with their tips; "wrap": two that may touch with their middles, too;
    "outline": one, which touches with middle and tip, before an object that is not convex; "tapered": one whose
    stiffness, density and tendon offsets fall towards the tip; "infeasible": one with a limit that is likely too tight.
    """
    if kind in ("two", "three"):
        return DRAWN[kind](seed) | UNASKED
    if kind == "wrap":
        data = DRAWN["two"](seed) | UNASKED
        return data | {"contacts": data["contacts"] | {"middle": "auto"}}
    random = np.random.default_rng([5, seed])
    length = 10 ** random.uniform(-1.0, -0.4)
    size = length * random.uniform(0.12, 0.3)
    body, reach, extent = _body(random, size, kind)
    finger = _finger(random, length, size, sign=1.0)
    half = finger["half_thickness"]
    along = half * random.uniform(1.0, 1.5) + random.choice([0.0, 1.0]) * random.uniform(0.0, 0.8) * reach
    finger["base"] = {
        "position": (along, -(extent + half + length * random.uniform(0.005, 0.3))),
        "angle": random.uniform(-0.6, 0.6) - 0.5 * math.pi,
    }
    body["position"] = (reach, 0.0)
    supports = {"palm": {"type": "palm", "point": (0.0, 0.0), "normal_angle": 0.0}}
    data = _scene(random, finger, body, size, supports, "all", "matched_clothoid")
    switch = 0 if kind == "outline" else random.integers(len(_MIDDLE))
    data |= UNASKED | {"contacts": data["contacts"] | {"middle": _MIDDLE[switch], "tip": _TIP[switch]}}
    if kind == "tapered":
        _taper(random, data["finger"])
    elif kind == "infeasible":
        where, key, low, high = _TIGHT[seed % len(_TIGHT)]
        tight = data[where[0]] if len(where) == 1 else data[where[0]][where[1]]
        tight[key] *= 10 ** random.uniform(low, high)
    return data


_TIGHT = (
    (("contacts",), "friction", -1.5, -0.3),
    (("finger", "tendons"), "max_tension", -1.0, -0.3),
    (("object",), "mass", 0.5, 2.0),
    (("contacts",), "normal_force_max", -2.5, -1.0),
    (("fidelity",), "bending_range", -0.9, -0.5),
)
"""Limits of infeasible scenes, taken in turn, and powers of ten by which they change."""


def _taper(random: np.random.Generator, finger: Data) -> None:
    """Let a finger become thinner from base to tip: stiffness by the fourth power, density by the square,
    tendon offsets by the first.
    """
    ratio, rod, pair = random.uniform(0.4, 0.9), finger["rod"], finger.pop("tendons")
    for key, power in (("bending_stiffness", 4), ("linear_density", 2)):
        rod[key] = [rod[key], ratio**power * rod[key]]
    ends = np.array([1.0, ratio]) * pair["offset"]
    finger["tendons"] = [pair | {"offset": (side * ends).tolist()} for side in (1.0, -1.0)]


def random_outline(random: np.random.Generator, size: float) -> list[tuple[float, float]]:
    """Corners [m] of a simple polygon that is not convex, from its centroid: a star, an object with notches, a comb, an
    L or U, or what rectangles that overlap cover. Its farthest corner is ``size`` away.
    """
    while True:
        solid = _SOLIDS[random.integers(len(_SOLIDS))](random)
        if not isinstance(solid, shapely.Polygon) or not solid.is_valid or solid.interiors:
            continue
        corners = np.array(solid.simplify(1e-4).exterior.coords[:-1]) - solid.centroid.coords[0]
        corners *= size / np.linalg.norm(corners, axis=1).max()
        solid = shapely.Polygon(np.round(corners, 9))
        if solid.is_valid and solid.area < 0.98 * solid.convex_hull.area and 4 <= len(corners) <= 200:
            return [(x, y) for x, y in solid.exterior.coords[:-1]]


def _star(random: np.random.Generator) -> Any:
    count = int(10 ** random.uniform(0.7, 2.3))
    turns = (np.arange(count) + random.uniform(-0.4, 0.4, count)) * math.tau / count
    waves = 0.3 * np.sin(random.integers(2, 7) * turns + random.uniform(0.0, math.tau))
    reach = 1.0 + waves + 10 ** random.uniform(-2.5, -0.3) * random.uniform(-1.0, 1.0, count)
    return shapely.Polygon(np.column_stack([reach * np.cos(turns), reach * np.sin(turns)]))


def _notched(random: np.random.Generator) -> Any:
    # 15: corners of more than 0.1 rad, so that the polygon is one: blunter ones would be points of a curve
    solid = shapely.Point(0.0, 0.0).buffer(1.0, quad_segs=min(int(random.integers(1, 20)), 15))
    for turn in random.uniform(-180.0, 180.0, random.integers(1, 6)):
        deep, wide, thin = random.uniform(0.1, 0.9), random.uniform(0.05, 0.5), random.uniform(0.0, 1.0)
        notch = shapely.Polygon([(1.1, -wide), (1.1, wide), (1.0 - deep, thin * wide), (1.0 - deep, -thin * wide)])
        solid = solid.difference(rotate(notch, turn, origin=(0.0, 0.0)))
    return solid


def _comb(random: np.random.Generator) -> Any:
    count, lean = int(random.integers(2, 26)), random.uniform(0.0, 0.8)
    back = shapely.box(0.0, -random.uniform(0.1, 1.0), count, 0.0)
    tooth = shapely.Polygon([(0.0, -0.1), (0.6, -0.1), (0.6 - 0.3 * lean, 1.0), (0.3 * lean, 1.0)])
    long = random.uniform(0.2, 1.0, count)
    teeth = [shapely.Polygon(np.array(tooth.exterior.coords) * (1.0, h)) for h in long]
    teeth = [translate(tooth, k + 0.2) for k, tooth in enumerate(teeth)]
    return shapely.Polygon(np.array(back.union(shapely.union_all(teeth)).exterior.coords) / (0.4 * count, 1.0))


def _hook(random: np.random.Generator) -> Any:
    wide, *long = random.uniform(0.2, 0.6), 1.0, random.uniform(0.5, 1.5), random.uniform(0.3, 1.0)
    solid = shapely.box(0.0, 0.0, long[0] + wide, wide).union(shapely.box(0.0, 0.0, wide, long[1]))
    return solid.union(shapely.box(long[0], 0.0, long[0] + wide, wide + long[2])) if random.random() < 0.5 else solid


def _pile(random: np.random.Generator) -> Any:
    boxes = [shapely.box(*-half, *half) for half in random.uniform(0.2, 1.0, (random.integers(2, 6), 2))]
    return shapely.union_all(
        [translate(rotate(box, random.uniform(0.0, 180.0)), *random.uniform(-0.5, 0.5, 2)) for box in boxes]
    )


_SOLIDS = (_star, _notched, _comb, _hook, _pile)


def _body(random: np.random.Generator, size: float, kind: str) -> tuple[Data, float, float]:
    """An object, and how far it reaches towards -x, and towards -y."""
    shape = kind if kind in ("union", "outline") else random.choice(["drawn"] * 4 + ["polygon", "rounded", "stadium"])
    if shape == "drawn":
        return _object(random, size, aligned=bool(random.random() < 0.5))
    angle = random.uniform(-math.pi, math.pi)
    turns = np.cumsum(random.dirichlet(np.full(random.integers(3, 8), 6.0))) * math.tau
    points, radius = size * np.exp(1j * turns), 0.0
    body: Data = {"shape": "polygon", "angle": angle, "vertices": [(z.real, z.imag) for z in points.tolist()]}
    if shape == "outline":
        body["vertices"] = random_outline(random, size)
        points = np.array(body["vertices"]) @ [1.0, 1j]
    elif shape == "rounded":
        body["corner_radius"] = 0.15 * size * random.random() + 0.02 * size
    elif shape == "stadium":
        radius, straight = size * random.uniform(0.5, 0.8), size * random.uniform(0.2, 0.8)
        body, points = {"shape": "stadium", "angle": angle, "length": straight, "radius": radius}, np.zeros(2, complex)
        points += 0.5 * straight * np.array([-1.0, 1.0])
    elif shape == "union":
        radius, points = 0.5 * size, np.array([0.0, size * random.uniform(0.5, 1.0)])
        discs = [{"shape": "circle", "diameter": 2.0 * radius, "position": (float(z), 0.0)} for z in points]
        discs[1]["diameter"] *= random.uniform(0.5, 1.0)
        body = {"shape": "union", "angle": angle, "members": discs, "center_of_mass": (0.3 * size, 0.0)}
        # The second disc is smaller, so that this may leave a gap at the palm, which then carries nothing.
    there = points * cmath.exp(1j * angle)
    reach, extent = float(radius - there.real.min()), float(radius - there.imag.min())
    return body, reach, extent


def scene_of(data: Data, elements: int) -> GraspScene:
    """The scene of data with so many elements."""
    return GraspScene.model_validate(data | {"fidelity": data["fidelity"] | {"elements": elements}})


def mirrored(data: Data) -> Data:
    """The image at the x axis."""

    def other(key: str, value: Any) -> Any:
        if key == "base":  # points along the y axis of its frame
            x, y = value["position"]
            return {"position": (x, -y), "angle": math.remainder(math.pi - value["angle"], math.tau)}
        if key in ("position", "point", "center_of_mass", "start", "end"):
            return value[0], -value[1]
        if key == "gravity":
            return value[0], -value[1], value[2]
        if key == "free":
            return {name: span if name == "x" else (-span[1], -span[0]) for name, span in value.items()}
        if key == "wrenches":
            return [(x, -y, -moment) for x, y, moment in value]
        if key == "vertices":
            return [(x, -y) for x, y in value]
        if key in ("angle", "normal_angle"):
            return -value
        if key == "tendons_used":
            return {"left": "right", "right": "left"}.get(value, value)
        return -value if key == "rest_curvature" else value

    image = _changed(data, other)
    for support in image["supports"].values():
        if "start" in support:  # what it supports is on a line's left
            support["start"], support["end"] = support["end"], support["start"]
    return image


def moved(data: Data) -> Data:
    """The scene turned and shifted."""

    def other(key: str, value: Any) -> Any:
        if key == "base":
            return {name: other(name, each) for name, each in value.items()}
        if key in ("position", "point", "start", "end"):
            z = complex(*value) * _TURN + _SHIFT
            return z.real, z.imag
        if key == "gravity":
            z = complex(*value[:2]) * _TURN
            return z.real, z.imag, value[2]
        return math.remainder(value + cmath.phase(_TURN), math.tau) if key in ("angle", "normal_angle") else value

    body = data["object"]
    data = _changed({**data, "object": {**body, "members": None}}, other)
    parts = {key: body[key] for key in ("members", "center_of_mass") if key in body}
    return {**data, "object": {key: value for key, value in (data["object"] | parts).items() if value is not None}}


def scaled(data: Data) -> Data:
    """The scene with other units of length and force."""
    units = dict.fromkeys(("length", "half_thickness", "offset", "diameter", "width", "height"), LONGER)
    units |= dict.fromkeys(("position", "point", "start", "end", "vertices", "center_of_mass"), LONGER)
    units |= dict.fromkeys(("corner_radius", "radius", "at"), LONGER)
    units |= dict.fromkeys(("mass", "max_tension", "min_tension", "normal_force_max"), STRONGER)
    units |= {"rest_curvature": 1.0 / LONGER, "linear_density": STRONGER / LONGER, "breaks": LONGER, "values": LONGER}
    units["bending_stiffness"] = STRONGER * LONGER**2

    def other(key: str, value: Any) -> Any:
        if key == "base":
            return {**value, "position": other("position", value["position"])}
        return value if key not in units else (np.asarray(value) * units[key]).tolist()

    return _changed(data, other)


def rolled(data: Data) -> Data:
    """The scene whose polygon begins with its second vertex."""
    body = data["object"]
    return {**data, "object": {**body, "vertices": [*body["vertices"][1:], body["vertices"][0]]}}


def _changed(data: Any, other: Callable[[str, Any], Any]) -> Any:
    """Data whose values are changed by their keys."""
    if isinstance(data, list):
        return [_changed(each, other) for each in data]
    return {key: _changed(v, other) if _nested(v) else other(key, v) for key, v in data.items()}


def _nested(value: Any) -> bool:
    some = value[0] if isinstance(value, list) and value else value
    return isinstance(some, dict) and not (some.keys() <= {"position", "angle"} or some.keys() <= {"x", "y", "angle"})


IMAGES: dict[str, Callable[[Data], Data]] = {
    "own": dict,
    "mirrored": mirrored,
    "moved": moved,
    "scaled": scaled,
    "rolled": rolled,
}
"""Images of a scene by name."""


def images(data: Data, names: list[str]) -> dict[str, Data]:
    """The images of a scene with these names, as far as it has them."""
    polygon = "vertices" in data["object"]
    return {name: IMAGES[name](data) for name in names if name != "rolled" or polygon}


def force_unit(name: str) -> float:
    """The unit of force of an image [N]."""
    return STRONGER if name == "scaled" else 1.0
