"""A finger in front of an object as an exact rod, integrated from its base by `rod.c`.

Units of a finger: its length L, E I / L^2, E I / L. An equilibrium is fixed by the curvature at the base, the internal
force there, the moment of the tendons at the base, and place, normal force and friction of each middle contact: an
initial value problem, which has every equilibrium and no roots to miss.
"""

from __future__ import annotations

import ctypes
import math
import os
from collections.abc import Collection
from copy import copy
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.resources import files
from typing import Any

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.core import Compiler
from continuum_grasp.grasp.finger_map.jets import Jet
from continuum_grasp.grasp.object_supports import Pose, object_outlines
from continuum_grasp.model import PartOutline
from continuum_grasp.scene import FingerSetup, GraspScene

_NODES = 65
"""Rows of the table of what changes along a finger."""
FORCE = 0.1
"""Residual of a missing moment per moment, as in `touching.c`."""
MOST_MIDDLES = 4
"""Most middle contacts of a finger, as in `rod.c`."""
BEYOND = 0.2
"""Part of the length beyond the bounds of places in which rods that nearly touch are sought: a finger that may touch
from a third of its length on is held there."""
_CELLS = 220
"""Cells of the table of distances from the object, each way."""


WIDE = 8
"""Rods that are integrated side by side: each step waits for the one before it, but not for those of other rods."""
_BESIDE = (8, 12)
"""Slopes of rods side by side; more of them leave the registers."""
_OPTIONS = (
    "O2",
    "tree-loop-vectorize",
    "vect-cost-model=dynamic",
    "no-tree-slp-vectorize",
    "fast-math",
    "no-finite-math-only",  # what coils up without end must remain no number
)
"""Options of gcc: -O3 takes half as long again to compile, and the code is no faster (gcc 12)."""


def call(lanes: int, name: str, *given: Any, wide: int = 1) -> Any:
    """Call a function of `rod.c` and what follows it, with so many slopes, of so many rods side by side."""

    def passed(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return ctypes.c_void_p(value.ctypes.data)
        if isinstance(value, ctypes.Structure):
            return ctypes.byref(value)
        return ctypes.c_double(value) if isinstance(value, float) else value

    # A process that had no compiler for a while, or another one, is not bound to what it had then.
    return getattr(_library(lanes, wide, os.environ.get("CC"), os.environ.get("PATH")), name)(*map(passed, given))


@cache
def _library(lanes: int, wide: int, _named: str | None, _path: str | None) -> ctypes.CDLL:
    compiler = Compiler.find()
    if compiler is None:
        raise RuntimeError(Compiler.why_none())
    folder = files(__package__)
    source = "".join(
        folder.joinpath(name).read_text(encoding="utf-8")
        for name in ("rod.c", "touching.c", "balance.c", "distances.c")
    )
    sizes = f"#define LANES {lanes}\n#define WIDE {wide}\n"
    options = ", ".join(f'"{option}"' for option in _OPTIONS)
    return ctypes.CDLL(str(compiler.library(f"{sizes}#pragma GCC optimize({options})\n{source}", "the map of fingers")))


def rough_distance(shapes: tuple[PartOutline, ...], points: Array) -> Array:
    """Signed distance of complex points from the nearest of some outlines, to within 1e-5 of its size; compiled if
    there is a compiler: a gear of 98,000 numbers takes 0.01 s, and 0.5 s by numpy.
    """
    if Compiler.find() is None:
        return np.asarray(np.min([shape.rough_distance(points) for shape in shapes], axis=0))
    numbers = np.array([len(shapes), *(each for shape in shapes for each in shape.rough_numbers)])
    points, out = np.ascontiguousarray(points, dtype=complex), np.empty(points.shape)
    call(0, "distances", points.size, numbers, points, out)
    return out


@dataclass(frozen=True)
class MapSampling:
    """Effort of a map.

    Attributes
    ----------
    steps
        Steps along the finger.
    lows
        Most rods with a middle contact that are given forces.
    seeds
        Seeds that are brought onto the set at first.
    enough
        Seeds that arrive after which no more are tried: of a thin set the nearest may all miss it.
    grid, of_tips
        Curvatures at the base, directions and sizes of the force there of the rods between which seeds are sought: with
        a middle contact, and without one.
    """

    steps: int = 40
    lows: int = 2500
    seeds: int = 600
    enough: int = 30
    grid: tuple[int, int, int] = (25, 36, 10)
    of_tips: tuple[int, int, int] = (25, 36, 10)


FULL = MapSampling()
"""For fingers whose equilibria are starts as they are: of shipped scenes the tensions of exact rods differ from those
with 400 steps by 0.1 %."""
FOR_STARTS = MapSampling(steps=28, lows=1500, seeds=600, enough=10, of_tips=(37, 54, 15))
"""For starts of a solver that brings them onto exact rods: with 20 steps or 200 seeds, 4 of 95 random scenes were held
with more tension than with `FULL`; with the other grid of tips a part of a map was missed, and three fingers were held
with 10.25 for 9.27 N (``python -m benchmarks.bench_rods three 0 20``)."""


class ObjectTable:
    """Signed distance of a scene's object on a grid in the object's frame [m]."""

    def __init__(self, scene: GraspScene) -> None:
        shapes = object_outlines(scene)
        grow = max(setup.finger.thickness_radius for setup in scene.setups)
        # 2.5: thicknesses around the object: anything farther away touches nothing
        reach = max(part.extent for part in scene.object.parts) + 2.5 * grow
        self.corner = -reach
        self.cell = 2.0 * reach / (_CELLS - 1)
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
        ("tendon_friction", ctypes.c_double),
        ("pose", ctypes.c_double * 4),
        ("corner", ctypes.c_double * 2),
        ("per_cell", ctypes.c_double),
        ("pulls", ctypes.c_double * 2),
        ("moment", ctypes.c_double),
        ("strain", ctypes.c_double),
        ("places", ctypes.c_double * 2),
        ("friction", ctypes.c_double),
        ("force", ctypes.c_double),
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
        sampling: MapSampling = FULL,
    ) -> None:
        self._given = scene, setup, table, base, pose
        self.sampling = sampling
        self.names = tuple(name for name in setup.middle_names if name in on)
        self.tip = setup.tip_name in on
        finger = setup.finger
        length = setup.finger.rod.length
        self.setup, self.name, self.base, self.middles = setup, setup.name, base, len(self.names)
        self.length = length
        self.moment = setup.stiffness / length
        self.force = self.moment / length
        profile, (channel,) = finger.profile, finger.channels
        self.offset = channel.arms[0]
        at = length * (np.linspace(0.0, 1.0, _NODES) if setup.graded else np.zeros(1))
        gravity = np.array(scene.gravity[:2]) / self.force
        columns = (
            profile.bending_stiffness(at) / setup.stiffness,
            profile.rest_curvature(at) * length,
            channel.shape(at),
            profile.half_thickness(at) / length,
            profile.linear_density(at) * length if np.any(gravity) else np.zeros(len(at)),
            np.ones(len(at)) if profile.half_depth is None else profile.half_depth(at) / profile.half_depth.most(),
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
        self.least_tension = least = setup.tendons.min_tension
        self.greatest_moment = (setup.max_tension - least) * self.offset / self.moment
        self.sides = tuple(finger.tendons_used in ("both", side) for side in ("left", "right"))
        self.friction, self.greatest_force = setup.held_friction, setup.normal_force_max / self.force
        self.place_bounds: tuple[float, float] = setup.middle_bounds[0] / length, setup.middle_bounds[1] / length
        self.numbers: int = 4 + 3 * self.middles
        arrays = self._table, self._masses, self._walls, self._pegs, self._distance
        self.struct = _Rod(
            steps=sampling.steps,
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
            tendon_friction=setup.tendons.friction,
            pose=(pose[0] / length, pose[1] / length, math.cos(pose[2]), math.sin(pose[2])),
            corner=(table.corner / length, table.corner / length),
            per_cell=length / table.cell,
            pulls=tuple(map(float, self.sides)),
            moment=self.greatest_moment,
            strain=min(finger.curvature_limit * length, 1e6),
            places=self.place_bounds,
            friction=self.friction,
            force=self.greatest_force,
        )
        for name, array in zip(("table", "mass", "wall", "peg", "distance"), arrays, strict=True):
            setattr(self.struct, name, array.ctypes.data)

    def with_middles(self, count: int) -> MapFinger:
        """The finger with so many of its middle contacts, the first ones."""
        on = {*self.names[:count], *([self.setup.tip_name] if self.tip else [])}
        return MapFinger(*self._given, on, self.sampling)

    def stepped(self, steps: int) -> MapFinger:
        """The finger with so many steps along it."""
        made = copy(self)
        made.struct = _Rod.from_buffer_copy(self.struct)
        made.struct.steps = steps
        return made

    @property
    def conditions(self) -> int:
        """Number of conditions under which it touches as it should."""
        return 1 + 2 * self.middles + (1 if self.tip else 2)

    @property
    def shape_limits(self) -> int:
        """Number of limits of tension and shape."""
        return 6 + 4 * self.middles + self.tip

    def traced(self, z: Array, *, slopes: bool = True, entered: float = 0.0) -> Traced:
        """Integrate equilibria (B, 4 + 3 k), which may be so deep in obstacles [L]."""
        z = np.ascontiguousarray(z, dtype=float)
        lanes, wide = slopes_beside(self.numbers) if slopes else (0, WIDE)
        numbers = 7 * (self.middles + 1) + 2
        shape = self.shape_limits
        rows = numbers + self.conditions + shape + 3 * (self.middles + self.tip)
        out = np.empty((len(z), rows, 1 + lanes))
        call(lanes, "trace", self.struct, len(z), z, entered, out, wide=wide)
        return Traced(self, z, out, numbers, numbers + self.conditions)

    def touches(self, z: Array) -> Traced:
        """Contacts and conditions of equilibria (B, 4 + 3 k), without slopes and limits."""
        z = np.ascontiguousarray(z, dtype=float)
        numbers = 7 * (self.middles + 1) + 2
        out = np.empty((len(z), numbers + self.conditions, 1))
        call(0, "touches", self.struct, len(z), z, out, wide=WIDE)
        return Traced(self, z, out, numbers, numbers + self.conditions)

    def scales(self, z: Array) -> Array:
        """Steps (B, n) of the numbers of equilibria that change them alike."""
        z = np.ascontiguousarray(z, dtype=float)
        out = np.empty(z.shape)
        call(0, "scales", self.struct, len(z), z, out)
        return out

    def onto(self, z: Array, rounds: int, entered: float, close: float) -> Array:
        """Bring equilibria (B, n) onto the set within the limits by so many damped steps; the ones that arrive."""
        z, landed = np.array(z, dtype=float, order="C"), np.empty(len(z), np.int32)
        lanes, wide = slopes_beside(self.numbers)
        call(lanes, "onto", self.struct, len(z), rounds, entered, close, z, landed, wide=wide)
        return z[landed > 0]

    def corrected(self, z: Array, rounds: int, back: Array, step: Array) -> Array:
        """Equilibria (B, n) moved back to the conditions by inverses (B, n, m) of slopes per ``step`` (B, n)."""
        z = np.array(z, dtype=float, order="C")
        call(
            0,
            "corrected",
            self.struct,
            len(z),
            rounds,
            np.ascontiguousarray(back),
            np.ascontiguousarray(step),
            z,
            wide=WIDE,
        )
        return z

    def nearest(self, z: Array) -> Array:
        """Places of the first two minima of the gap beyond the last contact, and the gaps (B, 4); also somewhat beyond
        the bounds of places, at which contacts often are.
        """
        z = np.ascontiguousarray(z, dtype=float)
        out = np.empty((len(z), 4))
        low, high = self.place_bounds
        bounds = max(low - BEYOND, 0.0), min(high + BEYOND, 1.0)
        # Where they touch is where each is in a step of its own.
        call(0, "nearest", self.struct, len(z), z, *bounds, out, wide=1 if self.middles else WIDE)
        return out


def slopes_beside(numbers: int) -> tuple[int, int]:
    """Slopes that are computed at a time, by so many numbers of each rod, and of how many rods side by side."""
    # 16: numbers of a rod with the most middle contacts
    return next(((lanes, WIDE) for lanes in _BESIDE if numbers <= lanes), (16, 1))


@dataclass(frozen=True)
class Touches:
    """C contacts of B equilibria, in units of the finger: the middle ones, then the tip, whether it touches or not."""

    gap: Jet
    lean: Jet
    place: tuple[Jet, Jet]  # of the backbone
    normal: tuple[Jet, Jet]
    half: Jet
    force: tuple[Jet, Jet]  # normal and friction
    at: Array  # along the finger (B, C)

    @property
    def skin(self) -> tuple[Jet, Jet]:
        """Points at which the surfaces meet."""
        return self.place[0] - self.half * self.normal[0], self.place[1] - self.half * self.normal[1]


@dataclass(frozen=True)
class Traced:
    """B equilibria of a finger, as integrated: numbers of the contacts, then residuals."""

    finger: MapFinger
    z: Array  # (B, n)
    out: Array  # (B, m, 1 + lanes)
    # Rows from which on there are conditions, and limits.
    first: int
    limits: int

    def __len__(self) -> int:
        return len(self.z)

    def take(self, rows: Any) -> Traced:
        return replace(self, z=self.z[rows], out=self.out[rows])

    @staticmethod
    def joined(parts: list[Traced]) -> Traced:
        z, out = (np.concatenate([getattr(part, name) for part in parts]) for name in ("z", "out"))
        return replace(parts[0], z=z, out=out)

    def _jet(self, rows: Any) -> Jet:
        return Jet(self.out[:, rows, 0], self.out[:, rows, 1 : 1 + self.finger.numbers])

    def unknown(self, k: Any) -> Jet:
        """Some of the numbers that fix them (B, C)."""
        value = self.z[:, k]
        slope = np.zeros((*value.shape, self.out.shape[2] - 1))[..., : self.finger.numbers]
        if slope.shape[-1]:
            slope[:, :] = np.eye(self.finger.numbers)[k]
        return Jet(value, slope)

    @cached_property
    def touches(self) -> Touches:
        """The contacts."""
        count = self.finger.middles + 1
        fields = self._jet(slice(0, 7 * count)).grouped(count)
        gap, lean, x, y, nx, ny, half = (fields.taken(k) for k in range(7))
        numbers = self.finger.numbers
        normal = self.unknown(np.arange(5, numbers, 3)).followed_by(self._jet([7 * count]))
        friction = self.unknown(np.arange(6, numbers, 3)).followed_by(self._jet([7 * count + 1]))
        at = np.concatenate([self.z[:, 4:numbers:3], np.ones((len(self), 1))], axis=1)
        return Touches(gap, lean, (x, y), (nx, ny), half, (normal, friction), at)

    @property
    def conditions(self) -> Jet:
        """Residuals (B, m) that vanish where the finger touches as it should."""
        return self._jet(slice(self.first, self.limits))

    @property
    def excess(self) -> Array:
        """The greatest excess over any limit of the finger alone (B,)."""
        return np.asarray(self.out[:, self.limits :, 0].max(axis=1))

    @property
    def pull(self) -> Jet:
        """Moment of the tendons at the base, as a part of its greatest (B,)."""
        return self.unknown([3]).taken(0) * (1.0 / self.finger.greatest_moment)

    @property
    def tension(self) -> Array:
        """Sum of the tensions (B,) [N]."""
        finger = self.finger
        return np.abs(self.z[:, 3]) * finger.moment / finger.offset + 2.0 * finger.least_tension
