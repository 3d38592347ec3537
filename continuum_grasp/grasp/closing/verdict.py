"""Verdict on a closing path: touches in order, ends of the fingers, forces that the object needs until then."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from continuum_grasp.arrays import Array
from continuum_grasp.grasp.closing.energy import FOOT, Closing, Sight, turned
from continuum_grasp.grasp.closing.result import ClosingPath, ClosingStatus, Touch
from continuum_grasp.grasp.quality.contact_set import ContactSet
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity, PlanarGravity

NEAR = 0.03
"""Distance from the grasp, per length of the finger, up to which the end of the path counts as that grasp: two thirds
of the distance between places."""
PRESSES = 1e-3
"""Normal force, per E I / L^2, from which on a place counts as touching: far above what the solver leaves."""
MOVED = 0.02
"""Displacement of the object, per its size, up to which it stayed where it was."""
_NAMED = 6
"""Touches that a message names."""
_ALONG = 0.1
"""Distance along the finger, per its length, within which a place stands for a contact of the grasp."""
SNAPS = 0.15
"""Displacement of a place in one step, per length, from which on the finger is said to snap."""


@dataclass
class Step:
    """A step that was taken."""

    share: float
    tensions: Array
    x: Array
    sight: Sight
    normal: Array
    friction: Array


class Ending:
    """The verdict on the steps that were taken."""

    def __init__(self, closing: Closing, arrays: Mapping[str, Array], taken: Sequence[Step], deepest: float) -> None:
        self.closing, self.arrays, self.taken, self.deepest = closing, arrays, taken, deepest

    @property
    def _presses(self) -> float:
        """Normal force from which on a place counts as touching [N]."""
        return PRESSES * self.closing.unit / self.closing.length

    def path(self, status: ClosingStatus | None) -> ClosingPath:
        """Verdict from the steps taken; ``status`` where it stands already."""
        closing, taken = self.closing, self.taken
        fingers, count = closing.fingers, len(closing.fingers[0].stations)
        names = [finger.name for finger in fingers]
        # Pairs by finger, place and part; the forces of a place are those of all parts.
        here = [k for k, pair in enumerate(closing.pairs) if pair.on_object and pair.disc.finger >= 0]
        shape = (len(taken), len(fingers), count, -1)
        normal, friction = (
            np.array([getattr(t, n)[here] for t in taken]).reshape(shape).sum(axis=3) for n in ("normal", "friction")
        )
        lines = np.array([t.sight.lines.T for t in taken]).reshape(len(taken), len(fingers), count, 2)
        bases = [np.tile(f.model.finger.base.position, (len(taken), 1, 1)) for f in fingers]
        poses = np.array([t.sight.pose for t in taken]).reshape(-1, 3)
        touches = self._touches(normal)
        wrenches = np.array([self._wrench(t, here) for t in taken]).reshape(-1, 3)
        distance = self._distance(lines[-1], poses[-1]) if taken else math.inf
        found, message = self._verdict(status, normal, poses, wrenches, distance, touches)
        return ClosingPath(
            found,
            message,
            np.array([t.share for t in taken]),
            {n: np.array([t.tensions[2 * k : 2 * k + 2] for t in taken]) for k, n in enumerate(names)},
            {f.name: f.stations for f in fingers},
            {n: np.concatenate([bases[k], lines[:, k]], axis=1) for k, n in enumerate(names)},
            {n: normal[:, k] for k, n in enumerate(names)},
            {n: friction[:, k] for k, n in enumerate(names)},
            poses,
            wrenches,
            touches,
            distance,
        )

    def _touches(self, normal: Array) -> tuple[Touch, ...]:
        """Places that begin or cease to touch; a neighbor that takes over is no touch of its own."""
        found = []
        for k, finger in enumerate(self.closing.fingers):
            on = normal[:, k] > self._presses
            # A run of places is one contact that slides along the finger.
            near = on | np.roll(on, 1, axis=1) | np.roll(on, -1, axis=1)
            for i in range(1, len(on)):
                for first, second, begins in ((i - 1, i, True), (i, i - 1, False)):
                    fresh = on[second] & ~near[first]
                    groups = np.split(np.flatnonzero(fresh), np.flatnonzero(np.diff(np.flatnonzero(fresh)) > 1) + 1)
                    for group in groups:
                        if len(group):
                            station = float(finger.stations[group].mean())
                            found.append(Touch(finger.name, station, self.taken[i].share, begins))
        return tuple(sorted(found, key=lambda touch: touch.share))

    def _wrench(self, step: Step, here: list[int]) -> Array:
        """Wrench of the fingers on the object: force, and moment about its center of mass."""
        sight = step.sight
        normals = sight.normals[:, here]
        forces = -(step.normal[here] * normals + step.friction[here] * np.stack([-normals[1], normals[0]]))
        center = sight.pose[:2] + turned(sight.pose[2]) @ np.asarray(self.closing.scene.object.com)
        arms = sight.points[:, here] - center[:, None]
        return np.array([*forces.sum(axis=1), float((arms[0] * forces[1] - arms[1] * forces[0]).sum())])

    def _distance(self, lines: Array, pose: Array) -> float:
        """Greatest distance of a place from where it is in the grasp, both seen from the object."""
        turn = turned(pose[2] - self.closing.grasped[2])
        found = 0.0
        for k, finger in enumerate(self.closing.fingers):
            line = np.asarray(self.arrays[f"{finger.name}.backbone"])
            wanted = np.stack([np.interp(finger.stations, line[:, 0], line[:, c]) for c in (1, 2)], axis=1)
            moved = pose[:2] + (wanted - self.closing.grasped[:2]) @ turn.T
            found = max(found, float(np.linalg.norm(lines[k] - moved, axis=1).max()))
        return found

    def _held(self, wrench: Array) -> float:
        """Force [N] beside the supports that keeps the object where it is: of the table, or of a hand."""
        scene = self.closing.scene
        size = np.array([1.0, 1.0, FOOT * 0.5 * scene.object.size])
        if isinstance(scene.gravity, PlanarGravity):
            wrench = wrench + np.append(scene.object.mass * np.asarray(scene.gravity.vector), 0.0)
        contacts = ContactSet(scene, self.arrays)
        supports = np.isnan(contacts.stations)
        normal, across = contacts.wrench_map()[:, supports].transpose(2, 0, 1) / size[:, None]
        edges = np.hstack([normal + side * contacts.friction[supports] * across for side in (-1.0, 1.0)])
        target = -wrench / size
        return float(nnls(edges, target)[1] if edges.size else np.linalg.norm(target))

    def _verdict(
        self,
        status: ClosingStatus | None,
        normal: Array,
        poses: Array,
        wrenches: Array,
        distance: float,
        touches: tuple[Touch, ...],
    ) -> tuple[ClosingStatus, str]:
        closing, scene = self.closing, self.closing.scene
        if status is ClosingStatus.NOT_OPEN:
            return status, (
                f"unloaded, a finger lies {-1e3 * self.deepest:.2g} mm deep in what surrounds it, and the other "
                "tendon does not bend it out: move the base, or give it a rest curvature away from the object"
            )
        words = ", ".join(str(touch) for touch in touches[:_NAMED]) or "nothing is touched"
        if status is ClosingStatus.STOPPED:
            return status, f"at {self.taken[-1].share:.0%} of the tensions no next posture was found; before: {words}"
        shift = poses[-1, :2] - closing.grasped[:2]
        moved, turn = float(np.hypot(*shift)), float(poses[-1, 2] - closing.grasped[2])
        size = scene.object.size
        if closing.free and max(moved, 0.5 * size * abs(turn)) > MOVED * size:
            return ClosingStatus.PUSHED, (
                f"the object is moved by {1e3 * moved:.1f} mm and turned by {math.degrees(turn):.1f} degrees: {words}"
            )
        missing = self._missing(normal[-1])
        words += self._snaps()
        if distance > NEAR * closing.length or missing:
            lacks = f", {' and '.join(missing)} without a touch" if missing else ""
            return ClosingStatus.ELSEWHERE, f"the fingers end {1e3 * distance:.1f} mm from the grasp{lacks}: {words}"
        if not closing.free:
            grip = max(self._held(wrench) for wrench in wrenches)
            if isinstance(scene.gravity, OutOfPlaneGravity):
                rough = grip / scene.weight
                words += f"; the object stays where it is on a table with a friction coefficient of {rough:.2g}"
            else:
                words += f"; until then the object must be held with up to {grip:.2g} N"
        return ClosingStatus.REACHED, f"the fingers end {1e3 * distance:.1f} mm from the grasp: {words}"

    def _missing(self, normal: Array) -> list[str]:
        """Contacts of the grasp near which no place presses at the end."""
        found, contacts = [], [self.arrays[f"contact_{key}"] for key in ("names", "stations", "forces")]
        for k, finger in enumerate(self.closing.fingers):
            on = finger.stations[normal[k] > self._presses]
            for name, station, (force, *_) in zip(*contacts, strict=True):
                own = str(name).startswith(f"{finger.name}.") and force > self._presses
                # Sliding along the object moves a contact along the finger, by less than a tenth of it.
                if own and not np.any(np.abs(on - station) < _ALONG * finger.length):
                    found.append(str(name))
        return found

    def _snaps(self) -> str:
        """Jumps of a finger from one step to the next, in words."""
        lines = np.array([t.sight.lines for t in self.taken])
        jumps = np.linalg.norm(np.diff(lines, axis=0), axis=1).max(axis=1, initial=0.0)
        k = int(jumps.argmax()) if len(jumps) else 0
        if not len(jumps) or jumps[k] < SNAPS * self.closing.length:
            return ""
        return f"; a finger snaps by {1e3 * jumps[k]:.0f} mm at {self.taken[k + 1].share:.0%}"
