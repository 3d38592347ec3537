"""The way into a grasp: fingers close quasi-statically from the open posture, meet the object and slide along it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from continuum_grasp import nlp
from continuum_grasp.arguments import check_arguments
from continuum_grasp.errors import InputError
from continuum_grasp.grasp.closing.energy import FOOT, Closing, Sight, Sliding, turned
from continuum_grasp.scene.grasp import GraspScene
from continuum_grasp.scene.grasp_options import OutOfPlaneGravity, PlanarGravity

Array = NDArray[Any]

NEAR = 0.03
"""Distance from the grasp, per length of the finger, up to which the end of the path counts as that grasp: two thirds
of the distance between places."""
PRESSES = 1e-3
"""Normal force, per E I / L^2, from which on a place counts as touching: far above what the solver leaves."""
MOVED = 0.02
"""Displacement of the object, per its size, up to which it stayed where it was."""
_STICKS = (1e-3, 1e-4)
"""Slip of a step up to which friction is not full, per length, in the solutions of a step, each with the normal forces
of the one before: a step moves places by some percent, and far sharper friction would lead the solver astray."""
_HALVINGS = 5
"""How often a step that the solver cannot take is halved."""
_OPENINGS = 10
"""Tensions of the opening tendons that are tried: tenths of their limits."""
_PENETRATES = 1e-4
"""Depth, per length, from which on unloaded fingers count as lying in something."""
_NAMED = 6
"""Touches that a message names."""
_ALONG = 0.1
"""Distance along the finger, per its length, within which a place stands for a contact of the grasp."""
_SNAPS = 0.15
"""Displacement of a place in one step, per length, from which on the finger is said to snap."""


class ClosingStatus(StrEnum):
    """How a path ended."""

    REACHED = "reached"
    """At the grasp."""
    ELSEWHERE = "elsewhere"
    """With all tension, but in another posture."""
    PUSHED = "pushed"
    """The object was moved away."""
    NOT_OPEN = "not_open"
    """The fingers cannot be opened enough to begin beside the object."""
    STOPPED = "stopped"
    """The solver found no next step: the fingers snap, or are jammed."""


@dataclass(frozen=True)
class Touch:
    """A place that begins or ceases to touch.

    Attributes
    ----------
    finger : str
    station : float
        Position along the finger [m].
    share : float
        Of the tensions of the grasp.
    on : bool
        False: it lifts off.
    """

    finger: str
    station: float
    share: float
    on: bool

    def __str__(self) -> str:
        return (
            f"{self.finger} {'touches' if self.on else 'lifts off'} at {1e3 * self.station:.0f} mm ({self.share:.0%})"
        )


@dataclass(frozen=True)
class ClosingPath:
    """How fingers close on an object.

    Attributes
    ----------
    status : ClosingStatus
    message : str
    shares : ndarray, shape (K,)
        Tensions of the steps, per those of the grasp; negative while the fingers are opened by the other tendons.
    tensions : dict of str to ndarray, shape (K, 2)
        Per finger [N].
    stations : dict of str to ndarray, shape (S,)
        Places that may touch [m].
    lines : dict of str to ndarray, shape (K, S + 1, 2)
        World positions of the base and of these places [m].
    normal_forces, friction_forces : dict of str to ndarray, shape (K, S)
        At these places [N]; friction along the object's normal turned by +90 degrees, on the finger.
    poses : ndarray, shape (K, 3)
        World pose of the object [m, rad].
    wrenches : ndarray, shape (K, 3)
        What the fingers do to the object: world force [N] and moment about its center of mass [N m].
    touches : tuple of Touch
        In order.
    distance : float
        Greatest distance of a place from the grasp at the end [m].
    """

    status: ClosingStatus
    message: str
    shares: Array
    tensions: Mapping[str, Array]
    stations: Mapping[str, Array]
    lines: Mapping[str, Array]
    normal_forces: Mapping[str, Array]
    friction_forces: Mapping[str, Array]
    poses: Array
    wrenches: Array
    touches: tuple[Touch, ...]
    distance: float

    @property
    def reached(self) -> bool:
        """Whether the path ends at the grasp."""
        return self.status is ClosingStatus.REACHED


@check_arguments
def closing_path(
    scene: GraspScene, arrays: Mapping[str, Any], *, steps: int = 40, table_friction: float | None = None
) -> ClosingPath:
    """Close the fingers of a grasp from their open posture, and see whether they end in it.

    All tensions grow together, from none to those of the grasp. Where unloaded fingers lie in the object they are first
    opened by the other tendons. Tendons have no friction here, and fingers do not touch each other or supports
    but where these are in the way of the object.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping of str to ndarray
        A grasp of it, as `GraspResult` stores it.
    steps : int, optional
        Steps from no tension to that of the grasp.
    table_friction : float, optional
        Friction coefficient of the table that the object stands on and may slide on, where gravity is out of the plane;
        None: the object is held, and the path says how rough the table would have to be.

    Returns
    -------
    ClosingPath

    Raises
    ------
    InputError
        The object cannot be free.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> from continuum_grasp.grasp import closing_path
    >>> grasp = cg.optimize_grasp("configs/grasp/mug.yaml")
    >>> path = closing_path(grasp.scene, grasp.arrays)
    >>> path.status.value, [f"{touch.station:.2f}" for touch in path.touches][:1]
    ('reached', ['0.06'])
    """
    if table_friction is not None and not isinstance(scene.gravity, OutOfPlaneGravity):
        raise InputError("table_friction: an object stands on a table only where gravity.mode is out_of_plane")
    return _Walk(Closing(scene, arrays, table_friction), arrays, steps).path()


@dataclass
class _Step:
    """A step that was taken."""

    share: float
    tensions: Array
    x: Array
    sight: Sight
    normal: Array
    friction: Array


class _Walk:
    """Goes from the open posture to the tensions of the grasp."""

    def __init__(self, closing: Closing, arrays: Mapping[str, Array], steps: int) -> None:
        self.closing, self.arrays, self.steps = closing, arrays, steps
        self.full = np.concatenate([np.asarray(arrays[f"{f.name}.tensions"], dtype=float) for f in closing.fingers])
        self.opening = np.zeros_like(self.full)  # tensions at share -1
        self.taken: list[_Step] = []

    def path(self) -> ClosingPath:
        """The whole path, as far as it goes."""
        begin = self._open()
        if begin is None:
            return self._ended(ClosingStatus.NOT_OPEN)
        shares = [*np.linspace(begin, 0.0, max(2, round(-begin * self.steps)) + 1)[1:-1]] if begin < 0.0 else []
        for share in [*shares, *np.linspace(0.0, 1.0, self.steps + 1)]:
            if share > begin and not self._advance(float(share)):
                return self._ended(ClosingStatus.STOPPED)
        return self._ended(None)

    def tensions(self, share: float) -> Array:
        """Tensions of all fingers in a row at a share."""
        return share * self.full if share >= 0.0 else -share * self.opening

    def _open(self) -> float | None:
        """Begin beside the object: unloaded, or with as little tension of the other tendons as that takes."""
        closing = self.closing
        for k, finger in enumerate(closing.fingers):
            used, limits = finger.setup.finger.tendons_used, finger.setup.finger.tension_limits[1]
            # The tendon that pulls less in the grasp is the one that opens.
            other = int(np.argmin(self.full[2 * k : 2 * k + 2]))
            if used in ("both", ("left", "right")[other]):
                self.opening[2 * k + other] = limits[other]
        x, m = np.zeros(closing.problem.x.numel()), len(closing.pairs)
        if closing.free:
            x[-3:] = closing.grasped / closing.scale
        none = Sliding(np.zeros(m), np.zeros((2, m)), np.zeros((2, m)), np.zeros(m), _STICKS[0])
        for share in np.linspace(0.0, -1.0, _OPENINGS + 1):
            held = closing.solve(self.tensions(share), none, closing.grasped, x, None, True)
            sight = closing.found(held.x, closing.grasped)
            self._deepest = float(sight.gaps.min(initial=0.0))
            if held.converged and self._deepest > -_PENETRATES * closing.length:
                self._keep(float(share), held, sight, none)
                return float(share)
        return None

    def _keep(self, share: float, attempt: nlp.Attempt, sight: Sight, sliding: Sliding) -> None:
        slid = self.closing.slip(sight, sliding.tangents, sliding.at) - sliding.past
        friction = -sliding.forces * slid / np.hypot(slid, sliding.stick * self.closing.length)
        # The first shape was found through everything: nothing presses there.
        first = not self.taken
        normal = np.zeros(len(slid)) if first else self.closing.pressed(attempt)
        self._multipliers = None if first else attempt.multipliers
        self.taken.append(_Step(share, self.tensions(share), attempt.x, sight, normal, friction))

    def _advance(self, share: float, halvings: int = 0) -> bool:
        """Take a step to a share, in halves where it cannot be taken at once."""
        closing, before = self.closing, self.taken[-1]
        pressed, start, near = before.normal, before.x, self._multipliers
        for stick in _STICKS:
            sliding = closing.sliding(before.sight, pressed, stick)
            attempt = closing.solve(self.tensions(share), sliding, before.sight.pose, start, near, False)
            if not attempt.converged:
                break
            pressed, start, near = closing.pressed(attempt), attempt.x, attempt.multipliers
        sight = closing.found(attempt.x, before.sight.pose)
        far = np.linalg.norm(sight.lines - before.sight.lines, axis=0).max() > _SNAPS * closing.length
        # A jump may be the solver's: a finger that snaps does so in steps of any size.
        if halvings < _HALVINGS and (far or not attempt.converged):
            middle = 0.5 * (before.share + share)
            return self._advance(middle, halvings + 1) and self._advance(share, halvings + 1)
        if attempt.converged:
            self._keep(share, attempt, sight, sliding)
        return attempt.converged

    # -- verdict

    def _ended(self, status: ClosingStatus | None) -> ClosingPath:
        """What the steps taken say; ``status`` where it stands already."""
        closing, taken = self.closing, self.taken
        fingers, count = closing.fingers, len(closing.fingers[0].stations)
        names = [finger.name for finger in fingers]
        # Pairs by finger, place and part; the forces of a place are those of all parts.
        here = [k for k, pair in enumerate(closing.pairs) if pair.on_object and pair.finger >= 0]
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
            on = normal[:, k] > PRESSES * self.closing.unit / self.closing.length
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

    def _wrench(self, step: _Step, here: list[int]) -> Array:
        """What the fingers do to the object: force, and moment about its center of mass."""
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
        scene, center = self.closing.scene, self.arrays["object.pose"][:2]
        size, columns = FOOT * 0.5 * scene.object.size, []
        if isinstance(scene.gravity, PlanarGravity):
            wrench = wrench + np.append(scene.object.mass * np.asarray(scene.gravity.vector), 0.0)
        names = [str(name) for name in self.arrays["contact_names"]]
        supports = [body.name for body in scene.places]
        for k, name in enumerate(names):
            if name.split(".")[0] not in supports:
                continue
            normal, point = self.arrays["contact_normals"][k], self.arrays["contact_positions"][k]
            across = np.array([-normal[1], normal[0]])
            for edge in (-1.0, 1.0):
                force = -(normal + edge * scene.friction(name) * across)
                arm = point - center
                columns.append([*force, (arm[0] * force[1] - arm[1] * force[0]) / size])
        target = -wrench / [1.0, 1.0, size]
        if not columns:
            return float(np.linalg.norm(target))
        return float(nnls(np.array(columns).T, target)[1])

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
                f"unloaded, a finger lies {-1e3 * self._deepest:.2g} mm deep in what surrounds it, and the other "
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
        closing, found = self.closing, []
        names = [str(name) for name in self.arrays["contact_names"]]
        for k, finger in enumerate(closing.fingers):
            on = finger.stations[normal[k] > PRESSES * closing.unit / closing.length]
            ends = np.cumsum(self.arrays[f"{finger.name}.lengths"])
            setup = finger.setup
            stations = {n: ends[c - 1] for n, c in zip(setup.middle_names, setup.before, strict=True)}
            stations[setup.tip_name] = finger.length
            forces = dict(zip(names, self.arrays["contact_forces"][:, 0], strict=True))
            for name, station in stations.items():
                presses = name in forces and forces[name] > PRESSES * closing.unit / closing.length
                # Sliding along the object moves a contact along the finger, by less than a tenth of it.
                if presses and not np.any(np.abs(on - station) < _ALONG * finger.length):
                    found.append(name)
        return found

    def _snaps(self) -> str:
        """Where a finger jumps from one step to the next, in words."""
        lines = np.array([t.sight.lines for t in self.taken])
        jumps = np.linalg.norm(np.diff(lines, axis=0), axis=1).max(axis=1, initial=0.0)
        k = int(jumps.argmax()) if len(jumps) else 0
        if not len(jumps) or jumps[k] < _SNAPS * self.closing.length:
            return ""
        return f"; a finger snaps by {1e3 * jumps[k]:.0f} mm at {self.taken[k + 1].share:.0%}"
