"""Starts of a search: combinations of all fingers' equilibria that hold the object."""

from __future__ import annotations

from functools import cached_property, partial
from typing import Any

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.core import Compiler
from continuum_grasp.grasp.finger_map.balance import ObjectBalance, Settled
from continuum_grasp.grasp.finger_map.fill import FingerMap
from continuum_grasp.grasp.finger_map.rod import FEW, FULL, MapFinger, MapSampling, ObjectTable, Traced
from continuum_grasp.grasp.finger_map.stability import not_unstable
from continuum_grasp.grasp.starts.rough import rough_starts
from continuum_grasp.grasp.starts.supports import base_poses, nearest_contact, object_poses
from continuum_grasp.grasp.starts.values import ContactStart, FingerStart, GraspStart, Pose, all_joints
from continuum_grasp.scene import GraspScene

BEST = 16
"""Settled combinations per finger of a set of contacts that are brought to their optimum."""
ROUGH = 8
"""Starts of a set of contacts that nearly touch, where fingers have no maps, or empty ones."""
MISSES, SPARE = 3, 8
"""Combinations of a set of contacts that nearly hold the object, where none does; and of those that hold it, before
they are at their optimum, which the solver may not reach from itself where it is at the end of a narrow set."""


Place = tuple[Pose, tuple[Pose, ...]]
"""World pose of the object, and of each finger's base [m, rad]."""


def is_mapped() -> bool:
    """Whether fingers have maps: whether a C compiler is there."""
    return Compiler.find() is not None


def places_of(scene: GraspScene, on: frozenset[str]) -> list[Place]:
    """Places of object and bases that are sampled with the contacts ``on`` by name, the scene's own first, which is the
    only one where nothing may move.
    """
    places = list[Place]()
    for number, pose in enumerate(object_poses(scene, on)):
        bases = [base_poses(setup, number) for setup in scene.setups]
        for k in range(max(map(len, bases))):
            places.append((pose, tuple(of_finger[min(k, len(of_finger) - 1)] for of_finger in bases)))
    return places


class SceneMaps:
    """The maps of a scene's fingers, made when they are first needed; as parts of the maps of a ``wider`` scene, which
    has the same fingers with greater limits, where that is given. Fingers that are ``apart``, two by name, keep clear
    of each other, or one of itself; all others may cross, which few do. ``sampling`` is the effort of each map.
    """

    def __init__(
        self,
        scene: GraspScene,
        wider: SceneMaps | None = None,
        apart: frozenset[tuple[str, str]] = frozenset(),
        sampling: MapSampling = FULL,
    ) -> None:
        self.scene = scene
        self._sampling = sampling
        self.apart: frozenset[tuple[str, str]] = apart if wider is None else apart | wider.apart
        self._wider = wider
        self._maps: dict[tuple[str, Pose, Pose, frozenset[str], bool], FingerMap] = {}

    @cached_property
    def _table(self) -> ObjectTable:
        return ObjectTable(self.scene) if self._wider is None else self._wider._table

    def map_of(self, name: str, base: Pose, pose: Pose, on: frozenset[str], *, exact: bool = True) -> FingerMap:
        """The map of a finger by name with a set of contacts, its base and the object at their poses: as an ``exact``
        rod, or as it bends with few elements.
        """
        (setup,) = (setup for setup in self.scene.setups if setup.name == name)
        mine = frozenset(on & setup.switches.keys())
        key = name, base, pose, mine, exact or setup.elements > FEW
        if key not in self._maps:
            itself = (name, name) in self.apart
            given = self.scene, setup, self._table, base, pose, mine
            finger = MapFinger(*given, exact=exact, itself=itself, sampling=self._sampling)
            if self._wider is not None:
                wider = self._wider.map_of(name, base, pose, on, exact=exact)
                same = self._wider.scene is self.scene and wider.finger.itself == itself
                self._maps[key] = wider if same else wider.within(finger)
            elif finger.is_exact:
                self._maps[key] = FingerMap.of(finger)
            else:
                self._maps[key] = self.map_of(name, base, pose, on).followed_by(finger)
        return self._maps[key]

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        names = [setup.name for setup in self.scene.setups]
        return [(k, m) for k, m in self.scene.pairs if (names[k], names[m]) in self.apart]

    def settled(self, on: frozenset[str], place: Place, *, exact: bool = True) -> list[GraspStart]:
        """Starts with the contacts ``on`` by name that hold the object at a place, as ``exact`` rods or as fingers bend
        with few elements, of least tension first; where none does, those that come nearest to it. Without maps, those
        that nearly touch.
        """
        scene, (pose, bases) = self.scene, place
        if not is_mapped():
            return rough_starts(scene, on, pose, bases, ROUGH)
        pairs = zip(scene.setups, bases, strict=True)
        maps = [self.map_of(setup.name, base, pose, on, exact=exact) for setup, base in pairs]
        balance = ObjectBalance(scene, on, [one.finger for one in maps], pose, self._pairs)
        x = balance.candidates(maps)
        if not len(x):
            return []
        settled = balance.settle(x)
        size = scene.object.size
        rows = settled.holding(size)
        if not rows:
            return [_as_start(balance, settled, row) for row in settled.nearest(size)[:MISSES]]
        rows = (not_unstable(balance, settled, rows) or rows)[: BEST * len(maps)]
        spare = [_as_start(balance, settled, row, "spare") for row in rows[:SPARE]]
        settled = balance.refined(settled.x[rows])
        rows = settled.holding(size)
        # Where none is stable, the least shows it.
        rows = not_unstable(balance, settled, rows) or rows[:1]
        return [*(_as_start(balance, settled, row) for row in rows), *spare]


class _SettledStart(GraspStart):
    """A settled combination as a start of the fingers' own models, whose parts are computed when they are asked for:
    most starts are only put in order.
    """

    def __getattr__(self, name: str) -> Any:
        if "parts" not in self.__dict__ or name not in ("fingers", "contacts", "forces", "tensions"):
            raise AttributeError(name)
        self.__dict__.update(self.__dict__["parts"]())
        return self.__dict__[name]


def _as_start(balance: ObjectBalance, settled: Settled, row: int, label: str = "map") -> GraspStart:
    """A settled combination as a start of the fingers' own models."""
    start = object.__new__(_SettledStart)
    start.__dict__.update(
        label=label,
        object_pose=balance.pose,
        estimate=float(settled.tension[row]),
        imbalance=float(settled.off[row]),
        friction_states={},
        parts=partial(_parts, balance, settled.x[row]),
    )
    return start


def _parts(balance: ObjectBalance, x: Array) -> dict[str, Any]:
    """Fingers, contacts, forces and tensions of a combination."""
    scene = balance.scene
    traced = balance.traced(x[None], slopes=False)
    fingers = dict[str, FingerStart]()
    tensions = dict[str, tuple[float, float]]()
    for at in traced:
        fingers[at.finger.name] = _finger_start(at)
        pull = float(at.z[0, 3]) * at.finger.moment / at.finger.offset
        least = at.finger.least_tension
        tensions[at.finger.name] = max(pull, 0.0) + least, max(-pull, 0.0) + least
    # Of the backbone the nearest place is plain; on a corner every direction between its faces would be normal.
    backbones = {
        name: at.finger.length * complex(*place)
        for at, names in zip(traced, balance.names, strict=True)
        for name, *place in zip(names, *(part.value[0] for part in at.touches.place), strict=False)
    }
    names = [*backbones, *balance.supports]
    lifts = x[balance.first_lift :] * balance.force if balance.lift else np.zeros(len(names))
    normal, friction = (part[0] for part in balance.forces(x[None], traced))
    borne = dict(zip(names, zip(normal.tolist(), friction.tolist(), lifts.tolist(), strict=True), strict=True))
    # In one order, so that equal sets share one solver.
    middles = [name for setup in scene.setups for name in setup.middle_names if name in backbones]
    contacts = dict[str, ContactStart]()
    for name in (*middles, *(name for name in names if name not in middles)):
        contacts[name] = balance.supports.get(name) or nearest_contact(scene, balance.pose, backbones[name])
    forces = {name: borne[name] for name in contacts}
    return {"fingers": fingers, "contacts": contacts, "forces": forces, "tensions": tensions}


def _finger_start(at: Traced) -> FingerStart:
    finger = at.finger
    z = at.z[0]
    rows = finger.curve(z)
    place, bent = rows[:, 0] * finger.length, rows[:, 1] / finger.length
    # Curvature steps where a contact has friction: interpolation needs increasing places.
    at_joint = np.append(np.diff(place) <= 0.0, False)
    place = place - 1e-9 * finger.length * at_joint
    on = dict(zip(finger.names, (float(z[4 + 3 * k]) * finger.length for k in range(finger.middles)), strict=True))
    sides = []
    touches = at.touches
    for middle, *normal in zip(touches.at[0], *(part.value[0] for part in touches.normal), strict=True):
        k = int(np.argmin(np.abs(rows[:, 0] - middle)))
        step = rows[min(k + 1, len(rows) - 1), 2:] - rows[max(k - 1, 0), 2:]
        across = np.array([step[1], -step[0]])
        sides.append(1 if across @ normal >= 0.0 else -1)
    side_of = dict(zip(finger.names, sides, strict=False))
    joints = all_joints(finger.setup, on)
    all_sides = tuple(side_of.get(name, sides[0]) for name in finger.setup.middle_names)
    return FingerStart(finger.base, joints, all_sides, tuple(place.tolist()), tuple(bent.tolist()))
