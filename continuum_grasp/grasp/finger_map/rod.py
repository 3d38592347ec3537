"""The exact rod of a finger in front of an object, integrated from its base by `rod.c`.

Units of a finger: its length L, E I / L^2, E I / L. An equilibrium is fixed by the curvature at the base, the internal
force there, the moment of the tendons at the base, and place, normal force and friction of each middle contact: an
initial value problem, which has every equilibrium and no roots to miss.
"""

from __future__ import annotations

import ctypes
import math
import os
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import pairwise
from typing import Any

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.core import Compiler
from continuum_grasp.grasp.finger_map.jets import Jet
from continuum_grasp.grasp.starts.scan.task import rough_distance
from continuum_grasp.grasp.starts.supports import object_outlines
from continuum_grasp.grasp.starts.values import Pose
from continuum_grasp.scene import FingerSetup, GraspScene

STEPS = 40
"""Steps along the finger: of shipped scenes the tensions of exact rods differ from those of 400 steps by 0.1 %."""
_NODES = 65
"""Rows of the table of what changes along a finger."""
_CELLS = 220
"""Cells of the table of distances from the object, each way."""


@cache
def _library(lanes: int, _named: str | None, _path: str | None) -> ctypes.CDLL:
    compiler = Compiler.find()
    if compiler is None:
        raise RuntimeError(Compiler.why_none())
    source = files(__package__).joinpath("rod.c").read_text(encoding="utf-8")
    fast = '#pragma GCC optimize("O3", "fast-math")\n'
    return ctypes.CDLL(str(compiler.library(f"#define LANES {lanes}\n{fast}{source}", "the map of fingers")))


class ObjectTable:
    """Signed distance of a scene's object on a grid in the object's frame [m]."""

    def __init__(self, scene: GraspScene) -> None:
        shapes = object_outlines(scene)
        grow = max(setup.finger.thickness_radius for setup in scene.setups)
        # 2.5: thicknesses around the object: what is farther away touches nothing
        reach = max(part.extent for part in scene.object.parts) + 2.5 * grow
        self.corner, self.cell = -reach, 2.0 * reach / (_CELLS - 1)
        along = np.linspace(-reach, reach, _CELLS)
        x, y = np.meshgrid(along, along)
        self.distance: Array = rough_distance(shapes, (x + 1j * y).ravel()).reshape(_CELLS, _CELLS)


class _Rod(ctypes.Structure):
    """The structure of `rod.c`."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("steps", "contacts", "tip")),
        *((name, ctypes.c_int) for name in ("nodes", "masses", "walls", "pegs", "width", "height")),
        ("base", ctypes.c_double * 3),
        ("gravity", ctypes.c_double * 2),
        ("tip_load", ctypes.c_double * 2),
        ("friction", ctypes.c_double),
        ("pose", ctypes.c_double * 3),
        ("corner", ctypes.c_double * 2),
        ("per_cell", ctypes.c_double),
        *((name, ctypes.c_void_p) for name in ("table", "mass", "wall", "peg", "distance")),
    )


class MapFinger:
    """A finger with so many middle contacts at one pose of its base and of the object, in units of its own."""

    def __init__(
        self,
        scene: GraspScene,
        setup: FingerSetup,
        table: ObjectTable,
        base: Pose,
        pose: Pose,
        on: Collection[str],
    ) -> None:
        self._given = scene, setup, table, base, pose
        self.names = tuple(name for name in setup.middle_names if name in on)
        self.tip = setup.tip_name in on
        finger, length = setup.finger, setup.finger.rod.length
        self.setup, self.name, self.base, self.middles = setup, setup.name, base, len(self.names)
        self.length, self.moment = length, setup.stiffness / length
        self.force = self.moment / length
        profile, (channel,) = finger.profile, finger.channels
        self.offset = channel.arms[0]
        at = length * (np.linspace(0.0, 1.0, _NODES) if setup.graded else np.zeros(1))
        gravity = np.array(scene.gravity_in_plane) / self.force
        columns = (
            profile.bending_stiffness(at) / setup.stiffness,
            profile.rest_curvature(at) * length,
            channel.shape(at),
            profile.half_thickness(at) / length,
            profile.linear_density(at) * length if np.any(gravity) else np.zeros(len(at)),
        )
        each = [np.broadcast_to(np.asarray(column, float), at.shape) for column in columns]
        self._table = np.ascontiguousarray(np.stack(each, axis=1))
        ends = [mass for mass in finger.masses if abs(mass.at - length) <= 1e-9 * length]
        inner = [mass for mass in finger.masses if mass not in ends]
        self._masses = np.array([[m.at / length, *(m.mass * gravity)] for m in inner] or [[0.0, 0.0, 0.0]])
        walls = [wall for wall in scene.walls if math.isinf(wall.half_length)]
        self._walls = np.array([[*w.normal, w.point[0] / length, w.point[1] / length] for w in walls] or [[0.0] * 4])
        self._pegs = np.array([[*p.position, p.radius] for p in scene.pegs] or [[0.0] * 3]) / length
        self._distance = np.ascontiguousarray(table.distance / length)
        self.numbers = 4 + 3 * self.middles
        arrays = self._table, self._masses, self._walls, self._pegs, self._distance
        self.struct = _Rod(
            steps=STEPS,
            contacts=self.middles,
            tip=int(self.tip),
            nodes=len(self._table),
            masses=len(inner),
            walls=len(walls),
            pegs=len(scene.pegs),
            width=_CELLS,
            height=_CELLS,
            base=(base[0] / length, base[1] / length, base[2]),
            gravity=tuple(gravity),
            tip_load=tuple(sum((mass.mass for mass in ends), 0.0) * gravity),
            friction=setup.tendons.friction,
            pose=(pose[0] / length, pose[1] / length, pose[2]),
            corner=(table.corner / length, table.corner / length),
            per_cell=length / table.cell,
        )
        for name, array in zip(("table", "mass", "wall", "peg", "distance"), arrays, strict=True):
            setattr(self.struct, name, array.ctypes.data)
        self.least_tension = least = setup.tendons.min_tension
        self.greatest_moment = (setup.max_tension - least) * self.offset / self.moment
        self.sides = tuple(finger.tendons_used in ("both", side) for side in ("left", "right"))
        self.friction, self.greatest_force = setup.held_friction, setup.normal_force_max / self.force
        self.place_bounds = tuple(bound / length for bound in setup.middle_bounds)
        self.bending_range = setup.bending_range
        before = [count for name, count in zip(setup.middle_names, setup.before, strict=True) if name in self.names]
        self.elements = tuple(b - a for a, b in pairwise((0, *before, setup.elements)))  # per segment
        self.strain = min(finger.curvature_limit * length, 1e6)

    def with_middles(self, middles: int) -> MapFinger:
        """The finger with so many of its middle contacts, the first ones."""
        if middles == self.middles:
            return self
        return MapFinger(*self._given, {*self.names[:middles], *([self.setup.tip_name] if self.tip else [])})

    def traced(self, z: Array, *, slopes: bool = True) -> Traced:
        """Integrate equilibria (B, 4 + 3 k)."""
        z = np.ascontiguousarray(z, dtype=float)
        lanes = 2 if not slopes else 8 if self.numbers <= 8 else 16
        out = np.empty((len(z), 9 * (self.middles + 1) + 5, 1 + lanes if slopes else 1))
        self._call(lanes, "trace", len(z), z, out)
        return Traced(self, z, out)

    def nearest(self, z: Array) -> Array:
        """Places of the first two minima of the gap beyond the last contact, and the gaps (B, 4)."""
        z = np.ascontiguousarray(z, dtype=float)
        out = np.empty((len(z), 4))
        self._call(2, "nearest", len(z), z, *map(ctypes.c_double, self.place_bounds), out)
        return out

    def curve(self, z: Array) -> Array:
        """Rows of place, curvature, x, y along one equilibrium."""
        z = np.ascontiguousarray(z, dtype=float)
        out = np.empty(((STEPS + 1) * (self.middles + 1), 4))
        return np.asarray(out[: self._call(2, "curve", z, out)])

    def _call(self, lanes: int, name: str, *given: Any) -> Any:
        """Call a function of `rod.c`."""
        # A process that had no compiler for a while, or another one, is not bound to what it had then.
        library = _library(lanes, os.environ.get("CC"), os.environ.get("PATH"))
        passed = (ctypes.c_void_p(each.ctypes.data) if isinstance(each, np.ndarray) else each for each in given)
        return getattr(library, name)(ctypes.byref(self.struct), *passed)


@dataclass(frozen=True)
class RodContact:
    """A contact of B equilibria, in units of the finger."""

    gap: Jet
    lean: Jet
    place: tuple[Jet, Jet]  # of the backbone
    normal: tuple[Jet, Jet]
    half: Jet
    force: tuple[Jet, Jet]  # normal and friction
    at: Jet  # along the finger
    is_tip: bool

    @property
    def skin(self) -> tuple[Jet, Jet]:
        """Points at which the surfaces meet."""
        return self.place[0] - self.half * self.normal[0], self.place[1] - self.half * self.normal[1]


@dataclass(frozen=True)
class Traced:
    """B equilibria of a finger, as integrated."""

    finger: MapFinger
    z: Array  # (B, n)
    out: Array  # (B, m, lanes)

    def __len__(self) -> int:
        return len(self.z)

    def take(self, rows: Any) -> Traced:
        return Traced(self.finger, self.z[rows], self.out[rows])

    def where(self, chosen: Array, other: Traced) -> Traced:
        """Rows of this where chosen (B,), those of the other elsewhere."""
        return Traced(
            self.finger,
            np.where(chosen[:, None], self.z, other.z),
            np.where(chosen[:, None, None], self.out, other.out),
        )

    @staticmethod
    def joined(parts: list[Traced]) -> Traced:
        return Traced(parts[0].finger, np.concatenate([p.z for p in parts]), np.concatenate([p.out for p in parts]))

    def _jet(self, k: int) -> Jet:
        return Jet(self.out[:, k, 0], self.out[:, k, 1 : 1 + self.finger.numbers])

    def unknown(self, k: int) -> Jet:
        """One of the numbers that fix them."""
        slope = np.zeros((len(self.z), self.out.shape[2] - 1))[:, : self.finger.numbers]
        if slope.shape[1]:
            slope[:, k] = 1.0
        return Jet(self.z[:, k], slope)

    def touches(self) -> Iterator[RodContact]:
        """The middle contacts, then the tip, whether it touches or not."""
        middles = self.finger.middles
        for c in range(middles + 1):
            gap, lean, x, y, nx, ny, half = (self._jet(7 * c + k) for k in range(7))
            if c < middles:
                force, at = (self.unknown(5 + 3 * c), self.unknown(6 + 3 * c)), self.unknown(4 + 3 * c)
            else:
                force, at = (self._end(0), self._end(1)), Jet(np.ones(len(self)), np.zeros(gap.slope.shape))
            yield RodContact(gap, lean, (x, y), (nx, ny), half, force, at, c == middles)

    def _end(self, k: int) -> Jet:
        return self._jet(7 * (self.finger.middles + 1) + k)

    @property
    def missing_moment(self) -> Jet:
        """Moment that is missing at the tip."""
        return self._end(2)

    @property
    def clear(self) -> list[Jet]:
        """Least clearance of the object beside the contacts, per segment."""
        segments = self.finger.middles + 1
        return [self._jet(8 * segments + 5 + k) for k in range(segments)]

    @property
    def clear_of_supports(self) -> Jet:
        return self._end(3)

    @property
    def strain(self) -> Jet:
        """Greatest change of curvature."""
        return self._end(4)

    @property
    def bends(self) -> list[Jet]:
        """Greatest bend of an element per segment, as far as elements may bend."""
        counts = self.finger.elements
        first = 7 * (self.finger.middles + 1) + 5
        return [self._jet(first + k) * (1.0 / (n * self.finger.bending_range)) for k, n in enumerate(counts)]

    @property
    def pull(self) -> Jet:
        """Moment of the tendons at the base, as a part of its greatest."""
        return self.unknown(3) * (1.0 / self.finger.greatest_moment)

    @property
    def tension(self) -> Array:
        """Sum of the tensions (B,) [N]."""
        finger = self.finger
        return np.abs(self.z[:, 3]) * finger.moment / finger.offset + 2.0 * finger.least_tension
