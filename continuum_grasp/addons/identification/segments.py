"""Segments of an excitation: what drives are commanded in each, and how far they may go."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from continuum_grasp.addons.identification.scene import Excitation
from continuum_grasp.base import Array, SolverError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import Signals, Trajectory, equilibrium_under, integrate, modes

_BASE = 0.03
"""Tension at which tendons stay in tension, per greatest tension [1]."""
_LOOP = ((0.0, 0.0), (0.3, 1.0), (0.5, 0.35), (0.65, 0.8), (1.0, 0.0))
"""A loop with an inner one: shares of time and of the greatest command [1]."""
_STEPS = ((0.0, 0.0), (0.05, 0.3), (0.3, 0.6), (0.5, 0.45), (0.7, 0.6), (0.85, 0.0))
"""Shares of time at which the command changes, and to which share of the greatest one [1]."""
_MIDDLE, _SWING = 0.4, 0.15
"""Command about which a sweep swings, and by how much, per greatest one [1]."""
_BAND = 0.5, 1.5
"""Frequencies from which and up to which it goes, per first natural frequency [1]."""
_LESS, _TRIES = 0.85, 24
"""Factor on the commands where the motion that they cause goes beyond a limit [1], and how often at most."""


class Segment(NamedTuple):
    """A part of the commands: its name, what it shows, start and end [s]."""

    name: str
    shows: str
    start: float
    end: float


class DrivePattern(NamedTuple):
    """Pattern of drives that move together: name, commands per unit, and the greatest factor to try."""

    name: str
    commands: Array
    most: float


class Excited(NamedTuple):
    """Commands as they are designed: segments, the motion, scale [1]."""

    segments: tuple[Segment, ...]
    rehearsal: Trajectory
    scale: float

    def by_segment(self, slopes: Array) -> dict[str, Array]:
        """Derivatives (readings, n) of the readings in each segment, by its name, from (T, readings, n) in all."""
        t = self.rehearsal.t[1:]
        width = slopes.shape[-1]
        return {of.name: slopes[(t > of.start) & (t <= of.end)].reshape(-1, width) for of in self.segments}


_SHOWS = {
    "hold": "noise of the sensors",
    "loop": "slow: stiffness (slope), tendon friction (width), presliding and elasticity (where it turns)",
    "steps": "lag, delay and inertia of the drives; damping",
    "sweep": "masses and damping, viscous friction of the drives",
}


def base_of(scene: Scene) -> Array:
    """Commands at which the tendons are just in tension."""
    finger = scene.finger
    tendons = finger.tendon_list
    key = finger.input_keys[0]
    base = np.zeros(len(finger.input_keys))
    if key == "tensions":
        base[: len(tendons)] = [max(tendon.min_tension, _BASE * tendon.max_tension) for tendon in tendons]
    if key == "torques" and finger.winches[0].arrangement == "per_tendon":
        for k, drive in enumerate(finger.winches):
            if drive.kind == "motor":
                base[k] = _BASE * tendons[k].max_tension * drive.winch_radius
    return base


def patterns_of(scene: Scene) -> list[DrivePattern]:
    """To one side, to the other, and both sides together; chambers beside tendons stay as they are."""
    finger = scene.finger
    tendons = finger.tendon_list
    rod = finger.rod
    key = finger.input_keys[0]
    arms = [tendon.arm(rod.length) for tendon in tendons] or [chamber.arm for chamber in finger.chambers]
    model = FingerModel(scene, input_rates=False)
    both_ways = key == "tip_moment"
    paid = 0.0
    bend = float(sum(model.ranges))
    strong = max((tendon.max_tension for tendon in tendons), default=0.0)
    if key == "pressures":
        greatest = max(chamber.max_pressure for chamber in finger.chambers)
    elif key == "tip_moment":
        greatest = bend * rod.stiffness / rod.length
    elif key == "tensions":
        greatest = strong
    else:
        drive = finger.winches[0]
        stiffness = float(model.structure.winches[0].stiffness)
        # Cable for the whole bending range, and for the elongation by the greatest tension.
        offset = max(tendon.greatest_offset for tendon in tendons)
        greatest = bend * offset + strong / stiffness
        if drive.kind == "motor":
            greatest = greatest / drive.winch_radius if key == "angles" else drive.limit
        both_ways = drive.arrangement == "one_pulley"
        # Those on the other side pay out what their path takes: they stay in the tension that they have.
        bent = rod.stiffness / (rod.length * offset)
        paid = 0.0 if key == "torques" else offset / (offset + bent / stiffness)
    patterns = list[DrivePattern]()
    for name, side in (("to the left", 1.0), ("to the right", -1.0)):
        sides = np.array([side]) if both_ways else np.where(np.sign(arms) == side, 1.0, -paid)
        if both_ways or side in np.sign(arms):
            patterns.append(DrivePattern(name, sides, greatest))
    if len(patterns) > 1 and not both_ways:
        patterns.append(DrivePattern("together", np.ones(len(arms)), greatest))
    still = np.zeros(len(finger.chambers) if finger.tendons else 0)
    return [of._replace(commands=np.append(of.commands, still)) for of in patterns]


class CommandDesign:
    """Commands of a scene's drives, in ``segments`` that are equally long.

    Each is as large as ``reach`` of the bending range, of the tensions and of what the drives take allows at rest.
    """

    def __init__(self, scene: Scene, patterns: Sequence[DrivePattern], options: Excitation) -> None:
        self._scene = scene
        self.options = options
        self._base = base_of(scene)
        tightened = self._commanded([(0.0, self._base), (1.0, self._base)])
        self._model = FingerModel(tightened, input_rates=False)
        self._forces = Signals(tightened, self._model).w(0.0)[0]
        self._patterns = patterns
        self._greatest = [self._reach(pattern) for pattern in patterns]
        parts = [("hold", "hold", 0)]
        for form in ("loop", "steps", "sweep"):
            for k, pattern in enumerate(patterns):
                if not (pattern.name == "together" and form == "sweep"):
                    parts.append((f"{form} {pattern.name}", form, k))
        self._parts = [(form, k) for _, form, k in parts]
        times = pairwise(np.linspace(0.0, options.duration, len(parts) + 1).tolist())
        self.segments = tuple(Segment(name, _SHOWS[form], *next(times)) for name, form, _ in parts)
        self._frequency = self._first_frequency()

    def _reach(self, pattern: DrivePattern) -> float:
        """Greatest factor of a pattern at rest."""
        low = 0.0
        high = pattern.most
        # 12: bisections of the greatest command: to a part in 4000
        for _ in range(12):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._allowed(self._base + middle * pattern.commands) else (low, middle)
        return low

    def _allowed(self, u: Array) -> bool:
        model = self._model
        reach = self.options.reach
        tendons = self._model.finger.tendon_list
        limits = [finger_input.most for finger_input in model.finger.inputs if finger_input.key != "pressures"]
        if any(abs(command) > reach * limit for command, limit in zip(u, limits, strict=False)):
            return False
        w = self._forces
        padded = np.concatenate([u, np.zeros(model.nu - u.size)])
        try:
            equilibrium = equilibrium_under(model, padded, w)
        except SolverError:
            return False
        use = np.array(model.range_use(equilibrium.q, padded, model.p_nominal)).max()
        history = (equilibrium.history,) if equilibrium.history.size else ()
        if not model.finger.winches:
            return bool(use <= reach)
        tensions = np.array(model.tensions_at_rest()(equilibrium.q, padded, model.p_nominal, *history)).ravel()
        greatest = np.array([tendon.max_tension for tendon in tendons])
        return bool(use <= reach and np.all(tensions <= reach * greatest))

    def excited(self, allowed: Callable[[Trajectory], bool] | None = None) -> Excited:
        """Commands as large as the motion that they cause is allowed to be."""
        scale = 1.0
        tries = _TRIES
        rehearsal = integrate(self.scene(1.0))
        while tries and not (allowed or self.within)(rehearsal):
            scale = _LESS * scale
            tries = tries - 1
            rehearsal = integrate(self.scene(scale))
        return Excited(self.segments, rehearsal, scale)

    def within(self, motion: Trajectory) -> bool:
        """Whether a motion stays within the bending range and the greatest tensions."""
        use: Array = np.asarray(motion.core.batch("range_use", motion.q, motion.acting, None))
        tensions = motion.tensions
        tendons = motion.model.finger.tendon_list
        if use.max() > 1.0:
            return False
        return tensions is None or bool(np.all(tensions.max(axis=0) <= [tendon.max_tension for tendon in tendons]))

    def _first_frequency(self) -> float:
        """First natural frequency of the finger alone [Hz]: where drives hold it, it is higher, and the sweep stays
        below.
        """
        finger = self._scene.finger.model_copy(update={"tendons": None, "pressure": None})
        alone = self._scene.model_copy(update={"finger": finger, "actuation": None, "loads": ()})
        spectrum = modes(alone.model_copy(update={"initial": alone.initial.without_history}))
        return float(spectrum.frequencies_hz[0])

    def scene(self, scale: float) -> Scene:
        """The scene under the commands."""
        points: list[tuple[float, Array]] = []
        for (form, k), segment in zip(self._parts, self.segments, strict=True):
            greatest = scale * self._greatest[k]
            commands = self._patterns[k].commands
            for at, level in self._form(form, segment.end - segment.start):
                points.append((segment.start + at, self._base + (greatest * level) * commands))
        return self._commanded(points)

    def _form(self, form: str, duration: float) -> list[tuple[float, float]]:
        """Instants [s] and shares of the greatest command."""
        if form == "hold":
            return [(0.0, 0.0), (duration, 0.0)]
        if form == "loop":
            return [(share * duration, level) for share, level in _LOOP]
        # 2.0: samples in which a step rises
        rise = 2.0 * self.options.sample
        if form == "steps":
            points = list[tuple[float, float]]()
            before = 0.0
            for share, level in _STEPS:
                points += [(share * duration, before), (share * duration + rise, level)]
                before = level
            return [*points, (duration, 0.0)]
        # 0.1: greatest frequency times the time between samples
        low, high = (min(part * self._frequency, 0.1 / self.options.sample) for part in _BAND)
        ramp = 0.1 * duration
        points = [(0.0, 0.0), (ramp, _MIDDLE)]
        t = ramp
        k = 0
        while True:
            share = (t - ramp) / (0.8 * duration)
            t += 0.5 / (low + (high - low) * share)
            if t > 0.9 * duration:
                break
            k += 1
            points.append((t, _MIDDLE + _SWING * (1.0 if k % 2 else -1.0)))
        return [*points, (duration, 0.0)]

    def _commanded(self, points: Sequence[tuple[float, Array]]) -> Scene:
        """The scene under commands at some instants, smooth between them."""
        least = 1e-3 * self.options.sample
        times = [points[0][0]]
        rows = [points[0][1]]
        for at, row in points[1:]:
            if at > times[-1] + least:
                times.append(at)
                rows.append(row)
            else:
                rows[-1] = row
        columns = np.array(rows).T
        signals = [{"times": [round(t, 9) for t in times], "values": column.tolist()} for column in columns]
        actuation = self._scene.finger.actuated(signals)
        options = self.options
        duration = round(options.duration / options.sample) * options.sample
        return self._scene.changed({"actuation": actuation, "time": {"duration": duration, "step": options.sample}})
