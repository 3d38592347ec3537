"""Whether a grasp holds, from its stored numbers: the equations of fingers and object, evaluated once more."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.grasp_oracle.forces import basis, bending_work, weight_work
from benchmarks.grasp_oracle.outline import Outline
from benchmarks.grasp_oracle.rod import Array, Section, section, trace
from continuum_grasp.scene import GraspScene

LIMITS = {
    "equilibrium": 1e-6,
    "cone": 1e-6,
    "contact": 1e-6,
    "penetration": 1e-4,
    "limit": 1e-6,
}
"""Greatest residuals: parts of the greatest moment or force, of the finger's length, of the limit."""
POINTS = 1000
"""Per element, at which penetration is looked for."""
ABOVE = 0.1
"""How far above a contact its normal is looked at, per half thickness of the finger."""


def residuals(scene: GraspScene, arrays: Mapping[str, Any]) -> dict[str, float]:
    """Residuals of a grasp, from ``GraspResult.arrays``.

    ``equilibrium``: of fingers and object, as parts of the greatest moment and force; ``cone``: friction and normal
    forces beyond theirs, as a part of the greatest force; ``contact``: gaps, slopes and stored places, as parts of the
    finger's length; ``penetration``: greatest depth of a finger in object or walls, as a part of its length;
    ``limit``: tension, strain, bend, lengths and pose beyond their limits.
    """
    own = {key: value for key, value in arrays.items() if not key.startswith("held.")}
    worst = _Check(scene, own).worst
    # With other friction states of the tendons, the tensions being the same: where the object lies is theirs.
    held = {key.removeprefix("held."): np.asarray(value) for key, value in arrays.items() if key.startswith("held.")}
    for k in range(len(held.get("object.pose", ()))):
        there = {**own, **{key: value[k] for key, value in held.items()}}
        # Contacts without a name are clear.
        on = there["contact_names"] != ""
        there |= {key: value[on] for key, value in there.items() if key.startswith("contact_")}
        for setup in scene.setups:
            worst["limit"] = max(worst["limit"], _let_out(setup, own, there))
        pose = tuple(float(v) for v in there["object.pose"])
        lies = scene.object.model_copy(update={"position": pose[:2], "angle": pose[2], "free": None})
        for key, value in _Check(scene.model_copy(update={"object": lies}), there).worst.items():
            # The reserve of cones is known to 1e-4 there.
            worst[key] = max(worst[key], 1e-2 * value if key == "cone" else value)
    return worst


class _Check:
    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any]) -> None:
        self.scene = scene
        self.worst = dict.fromkeys(LIMITS, 0.0)
        self.names = [str(n) for n in arrays["contact_names"]]
        self.forces = np.asarray(arrays["contact_forces"], dtype=float).reshape(-1, 3)
        self.positions = np.asarray(arrays["contact_positions"], dtype=float).reshape(-1, 2)
        self.normals = np.asarray(arrays["contact_normals"], dtype=float).reshape(-1, 2)
        self.stations = np.asarray(arrays["contact_stations"], dtype=float)
        self.pose = tuple(float(v) for v in arrays["object.pose"])
        self.parts = scene.object.parts
        self.loads = [n * v + f * _across(v) for (n, f, _), v in zip(self.forces, self.normals, strict=True)]
        greatest = float(np.abs(self.forces).max(initial=0.0))
        setups = scene.setups
        bending = min(s.finger.rod.stiffness / s.finger.rod.length**2 for s in setups)
        self.force_scale = max(greatest, scene.weight, bending)
        self.length = max(s.finger.rod.length for s in setups)
        self._object()
        self._cones()
        for setup in setups:
            self._finger(_Finger(setup, arrays), arrays)
        self._supports()
        if any(not np.isfinite(np.asarray(v, dtype=float)).all() for k, v in arrays.items() if _numeric(k, v)):
            self._note("limit", math.inf)

    def _note(self, name: str, value: float) -> None:
        value = float(value)
        self.worst[name] = max(self.worst[name], math.inf if math.isnan(value) else value)

    def _outlines(self, grown: float) -> list[Outline]:
        return [Outline(part, self.pose, grown) for part in self.parts]  # type: ignore[arg-type]

    def _gravity(self) -> Array:
        return np.array(self.scene.gravity[:2])

    # -- object ------------------------------------------------------------------------------------------------

    def _object(self) -> None:
        body, scale = self.scene.object, self.force_scale
        x, y, turn = self.pose
        c, s = math.cos(turn), math.sin(turn)
        com = np.array([x + c * body.com[0] - s * body.com[1], y + s * body.com[0] + c * body.com[1]])
        arms = (self.positions - com) / body.size
        force = body.mass * self._gravity() - sum(self.loads, np.zeros(2))
        self._note("equilibrium", np.abs(force).max() / scale)
        moment = sum(a[0] * p[1] - a[1] * p[0] for a, p in zip(arms, self.loads, strict=True))
        self._note("equilibrium", abs(moment) / scale)
        lift = self.forces[:, 2]
        self._note("equilibrium", abs(lift.sum() + body.mass * self.scene.gravity[2]) / scale)
        if 3 in self.scene.balances:
            self._note("equilibrium", np.abs(lift @ arms).max() / scale)
        self._between(body.free, body.pose, self.pose)

    def _cones(self) -> None:
        for name, (n, f, lift) in zip(self.names, self.forces, strict=True):
            over = math.hypot(f, lift) - self.scene.friction(name) * n
            most = self.scene.normal_force_max(name)
            self._note("cone", over / self.force_scale)
            self._note("cone", -n / self.force_scale)
            self._note("limit", (n - most) / most)

    # -- fingers -----------------------------------------------------------------------------------------------

    def _finger(self, finger: _Finger, arrays: Mapping[str, Any]) -> None:
        length, half = finger.length, finger.scene.thickness_radius
        self._note("limit", abs(finger.lengths.sum() / length - 1.0))
        self._note("limit", -finger.lengths.min() / length)
        self._limits(finger)
        spots = [(k, n) for k, n in enumerate(self.names) if n.startswith(f"{finger.name}.")]
        there = {k: section(*finger.at, float(self.stations[k])) for k, _ in spots}
        self._touches(finger, spots, there)
        self._equilibrium(finger, spots, there)
        points, _ = trace(*finger.at, POINTS)
        flat = points.reshape(-1, 2)
        depth = max(float(-o.gap(flat).min()) for o in self._outlines(half))
        self._note("penetration", depth / length)
        for wall in self.scene.walls:
            if math.isinf(wall.half_length):
                height = (flat - np.array(wall.point)) @ np.array(wall.normal)
                needed = min(half, float(height[0]))
                self._note("penetration", float(needed - height.min()) / length)
        stored = np.asarray(arrays[f"{finger.name}.backbone"], dtype=float)
        at = [section(*finger.at, float(min(s, finger.lengths.sum()))).point for s in stored[:, 0]]
        self._note("contact", float(np.abs(np.array(at) - stored[:, 1:3]).max()) / length * 0.1)

    def _limits(self, finger: _Finger) -> None:
        scene, ends = finger.scene, finger.ends
        tendons = scene.tendons
        used = (scene.tendons_used != "right", scene.tendons_used != "left")
        for tension, use in zip(finger.tensions, used, strict=True):
            most, least = (tendons.max_tension, tendons.min_tension) if use else (0.0, 0.0)
            self._note("limit", (tension - most) / tendons.max_tension)
            self._note("limit", (least - tension) / tendons.max_tension)
        limit = scene.curvature_limit
        if math.isfinite(limit):
            self._note("limit", np.abs(ends).max() / limit - 1.0)
        bends = np.abs(ends * finger.lengths[:, None]).max()
        self._note("limit", bends / finger.setup.bending_range - 1.0)
        self._between(scene.base_free, (*scene.base.position, scene.base.angle), finger.base)

    def _between(self, free: Any, given: tuple[float, ...], pose: Any) -> None:
        """A pose is as given, or within what is free."""
        for k, name in enumerate(("x", "y", "angle")):
            bounds = None if free is None else getattr(free, name)
            low, high = (given[k], given[k]) if bounds is None else bounds
            self._note("limit", max(low - pose[k], pose[k] - high))

    def _touches(self, finger: _Finger, spots: list[tuple[int, str]], there: dict[int, Section]) -> None:
        half, length = finger.scene.thickness_radius, finger.length
        marks = np.cumsum(finger.lengths)
        for k, name in spots:
            where = there[k]
            # A little above the place of the contact: where a tip lies in a notch it is as near to another face.
            place = where.point - half * self.normals[k]
            gaps = [o.nearest(place + ABOVE * half * self.normals[k]) for o in self._outlines(0.0)]
            gap, normal = min(gaps, key=lambda g: float(g[0]))
            self._note("contact", abs(float(gap) - ABOVE * half) / length)
            self._note("contact", np.abs(normal - self.normals[k]).max() * half / length)
            self._note("contact", np.abs(place - self.positions[k]).max() / length)
            if name.endswith(".tip"):
                self._note("contact", abs(self.stations[k] / length - 1.0))
                continue
            across = np.array([math.cos(where.angle), math.sin(where.angle)])
            self._note("contact", abs(across @ _across(self.normals[k])) * 0.1)
            self._note("contact", np.abs(marks - self.stations[k]).min() / length)
            low, high = finger.setup.middle_bounds
            self._note("limit", max(low - self.stations[k], self.stations[k] - high) / length)

    def _equilibrium(self, finger: _Finger, spots: list[tuple[int, str]], there: dict[int, Section]) -> None:
        scene, lengths, tensions = finger.scene, finger.lengths, finger.tensions
        rod, tendons, half = scene.rod, scene.tendons, scene.thickness_radius
        lean = finger.ends - finger.rest
        net = (tensions[0] - tensions[1]) * tendons.offset
        pulled = _tendon_work(tendons, tensions, finger.ends, lengths, finger.states)
        pulled -= _dry_work(finger.setup, lean, lengths, finger.states)
        slope = bending_work(rod.stiffness, lean, lengths) - pulled.ravel()
        slope -= weight_work(finger.at, rod.mass_per_length, [(m.at, m.mass) for m in scene.masses], self._gravity())
        couple = 0.0
        for k, name in spots:
            turn = -half * self.forces[k, 1]
            slope -= there[k].moves @ self.loads[k] + there[k].turns * turn
            if name.endswith(".tip"):
                couple = turn
        free = basis(finger.family, len(lengths))
        scale = max(abs(net), rod.stiffness * float(np.abs(lean).max()))
        reach = np.abs(free @ section(*finger.at, float(lengths.sum())).turns)
        self._note("equilibrium", (np.abs(free @ slope) / reach).max() / scale)
        if finger.family == "matched_clothoid":
            self._note("equilibrium", abs(rod.stiffness * (finger.tip - finger.rest) - net - couple) / scale)

    # -- supports ----------------------------------------------------------------------------------------------

    def _supports(self) -> None:
        bare = self._outlines(0.0)
        for k, (name, place) in enumerate(zip(self.names, self.positions, strict=True)):
            off = [math.dist(place, peg.position) - peg.radius for peg in self.scene.pegs if name == peg.name]
            for wall in self.scene.walls:
                if name == wall.name or name.startswith(wall.name + "."):
                    off.append(float((place - np.array(wall.point)) @ np.array(wall.normal)))
                    self._note("contact", np.abs(self.normals[k] + np.array(wall.normal)).max())
            for apart in (*off, *(min(float(o.gap(place)) for o in bare) for _ in off)):
                self._note("contact", abs(apart) / self.length)


class _Finger:
    """A finger as it is stored; coordinates and the tip's curvature are above the rest curvature there, not here."""

    def __init__(self, setup: Any, arrays: Mapping[str, Any]) -> None:
        self.setup, self.scene, self.name, self.length = setup, setup.finger, setup.name, setup.finger.rod.length
        own = {key.removeprefix(f"{self.name}."): value for key, value in arrays.items()}
        self.family, self.states = str(own["family"]), own.get("friction_states")
        q, self.lengths, self.base, self.tensions = (
            np.asarray(own[key], dtype=float) for key in ("q", "lengths", "base", "tensions")
        )
        self.rest = float(setup.finger.profile.rest_curvature(self.length))
        tip = float(own["tip_curvature"])
        if self.family == "arc":
            ends = np.repeat((q / self.lengths)[:, None], 2, axis=1)
        else:
            nodes = np.append(q, tip) if self.family == "matched_clothoid" else q
            ends = np.stack([nodes[:-1], nodes[1:]], axis=1)
        self.ends, self.tip = ends + self.rest, tip + self.rest
        self.at = self.base[:2], float(self.base[2]), self.ends, self.lengths


def _tendon_work(tendons: Any, tensions: Array, ends: Array, lengths: Array, states: Array | None) -> Array:
    """Work of the tendons' moment with the curvatures at both ends of each element, past guides with friction.

    As in the scene's contract: along a cell of an element the tension is linear, and friction acts as ``states`` say,
    per cell from the base; None: the tendons slid from the straight finger on.
    """
    count, mu = tendons.friction_cells, tendons.friction
    found, loss = np.zeros((len(lengths), 2)), {1: 0.0, -1: 0.0}
    if mu == 0.0:
        net = (tensions[0] - tensions[1]) * tendons.offset
        return np.repeat(0.5 * net * lengths[:, None], 2, axis=1)
    for k, (h, (a, b)) in enumerate(zip(lengths, ends, strict=True)):
        for c in range(count):
            u = (c + 0.5) / count
            turned = (a + (b - a) * u) * h / count
            # The turn beyond the middle of the cell: of the rest of this element, and of those after it.
            rest = h * (1.0 - u) * (a + (b - a) * 0.5 * (1.0 + u))
            beyond = rest + float((ends[k + 1 :].mean(axis=1) * lengths[k + 1 :]).sum())
            rounding = 1e-3 * h / count / float(lengths.sum())
            way = min(max(beyond / 1e-3, -1.0), 1.0) if states is None else float(states[k * count + c])
            for side, tension in zip((1, -1), tensions, strict=True):
                x = side * way * mu * turned**2 / math.hypot(turned, rounding)
                middle = tension * math.exp(-loss[side] - 0.5 * x)
                moment = side * tendons.offset * h / count * middle
                loss[side] += x
                # The hats 1 - v and v of the element over the cell, and their slopes.
                mean, lean = 1.0 + x * x / 24.0, x / (12.0 * count)
                found[k] += moment * mean * np.array([1.0 - u + lean, u - lean])
    return found


def _dry_work(setup: Any, lean: Array, lengths: Array, states: Array | None) -> Array:
    """Work of dry friction in bending with the curvatures at both ends of each element.

    In each cell of an element the moment of a branch is a part of its greatest, as ``states`` say after those of the
    tendons, cell by cell; None: stretched like a spring by the curvature above rest in the middle of the cell.
    """
    damping, tendons = setup.finger.damping, setup.finger.tendons
    count = 1 if setup.family == "arc" else damping.friction_cells
    at = tendons.friction_cells * len(lengths) if tendons.friction else 0
    found = np.zeros((len(lengths), 2))
    for k, (h, (a, b)) in enumerate(zip(lengths, lean, strict=True)):
        for c in range(count):
            u = (c + 0.5) / count
            for branch in damping.dry_friction:
                sprung = branch.stiffness * (a + (b - a) * u)
                moment = min(max(sprung, -branch.moment), branch.moment)
                if states is not None:
                    moment, at = branch.moment * float(states[at]), at + 1
                found[k] += moment * h / count * np.array([1.0 - u, u])
    return found


def _let_out(setup: Any, own: Mapping[str, Any], there: Mapping[str, Any]) -> float:
    """By how much what the drives hold differs between two postures, as a part of the tensions or of the length."""
    tensions, others = own[f"{setup.name}.tensions"], there[f"{setup.name}.tensions"]
    tendon = setup.finger.tendon_list[0]
    drive = tendon.drive
    gain = getattr(drive, "position_gain", None)
    if drive is None or (drive.kind == "motor" and gain is None):
        off = tensions - others
        if drive is not None and drive.arrangement == "one_pulley":
            off = np.diff(off)
        return float(np.abs(off).max() / np.abs(tensions).max())
    servo = 0.0 if gain is None else drive.winch_radius**2 / gain
    wound, moved = _wound(setup, own), _wound(setup, there)
    if drive.arrangement == "per_tendon":
        wound, moved = wound + servo * tensions, moved + servo * others
    else:
        wound, moved = (w - servo * np.diff(t) * [1.0, -1.0] for w, t in ((wound, tensions), (moved, others)))
    taut = (tensions > 1.0) & (others > 1.0)
    return float(np.abs(wound - moved)[taut].max(initial=0.0) / setup.finger.rod.length)


def _wound(setup: Any, arrays: Mapping[str, Any]) -> Array:
    """Cable wound up of each tendon: its path, and its elongation by the tension that friction leaves [m]."""
    finger, tendons, found = _Finger(setup, arrays), setup.tendons, []
    tendon, states, count = finger.scene.tendon_list[0], finger.states, tendons.friction_cells
    turned = float(finger.ends.mean(axis=1) @ finger.lengths)
    for side, tension in zip((1.0, -1.0), finger.tensions, strict=True):
        share, mean = 1.0, 0.0
        for k, (h, (a, b)) in enumerate(zip(finger.lengths, finger.ends, strict=True)):
            for c in range(count):
                z = math.copysign(1.0, turned) if states is None else float(states[k * count + c])
                x = side * z * tendons.friction * abs(a + (b - a) * (c + 0.5) / count) * h / count
                # Mean of an exponential along the cell.
                mean += share * (1.0 if x == 0.0 else -math.expm1(-x) / x) * h / count
                share *= math.exp(-x)
        given = 1.0 / tendon.series_stiffness + mean / tendon.axial_stiffness
        found.append(side * tendons.offset * turned + given * tension)
    return np.array(found)


def _across(normal: Array) -> Array:
    return np.array([-normal[1], normal[0]])


def _numeric(name: str, value: Any) -> bool:
    return name != "contact_stations" and np.asarray(value).dtype.kind in "fiub"
