"""The inputs and loads of a scene as actuators of MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.scene.drives import LengthDrive
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.loads import ForceLoad, Samples, VectorSamples
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.signals import interpolate, value_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Control:
    """One actuator: a tendon that pulls, or a component of a force or moment at a place of the finger."""

    name: str
    value: Any
    """Constant, or samples in time."""
    at: float
    """Where it ends, or acts [m]."""
    jumps: bool
    """Whether the bending moment jumps there."""
    component: int | None = None
    """Of samples of vectors."""
    gear: tuple[float, ...] | None = None
    """Force and moment per control at a site there; None: a tendon."""
    follows: bool = True
    """Whether the force turns with the finger."""
    limits: tuple[float, float] | None = None
    lag: float | None = None
    """Time constant of its drive [s]."""
    cable: float | None = None
    """Stiffness of a tendon that is wound up [N/m]; None: its tension is commanded."""
    sense: float = 1.0
    """Factor of the values: whether a pulley winds up or pays out."""
    start: float = 0.0
    """What is added to them: cable that is wound up of the straight finger [m]."""

    @property
    def varies(self) -> bool:
        """Whether it varies in time."""
        return isinstance(self.value, Samples | VectorSamples)

    def __call__(self, t: Array) -> Array:
        """Values at instants (T,) [s]."""
        if not isinstance(self.value, Samples | VectorSamples):
            return np.full(len(t), self.start + self.sense * float(self.value))
        values = interpolate(self.value, t)[0]
        return self.start + self.sense * (values if self.component is None else values[:, self.component])


def controls_of(scene: Scene) -> list[Control]:
    """All actuators of a scene: tendons, or the tip moment, then the components of its loads."""
    found = _inputs(scene)
    tip = scene.finger.profile.length
    for k, load in enumerate(scene.loads):
        value = value_of(load)
        if not isinstance(load, ForceLoad):
            name = f"load_{k + 1}_moment"
            found.append(Control(name, value, load.at, load.at < tip, gear=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)))
            continue
        for component, axis in enumerate("xy"):
            gear = tuple(float(j == component) for j in range(6))
            one = value if isinstance(value, VectorSamples) else value[component]  # type: ignore[index]
            name = f"load_{k + 1}_{axis}"
            found.append(Control(name, one, load.at, False, component, gear, load.follows))
    return found


def _inputs(scene: Scene) -> list[Control]:
    finger, actuation = scene.finger, scene.actuation
    tip = finger.profile.length
    if not finger.tendon_list:
        if actuation is None:
            return []
        return [Control("tip_moment", actuation.tip_moment, tip, False, gear=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0))]
    if finger.winches:
        return _wound(scene)
    tensions = None if actuation is None else actuation.tensions
    found = []
    for j, tendon in enumerate(finger.tendon_list):
        to = tendon.end(tip)
        # Slack tendons, of a scene without input, have no tension at all.
        limits = (0.0 if tensions is None else tendon.min_tension, tendon.max_tension)
        tension = 0.0 if tensions is None else tensions[j]
        found.append(Control(f"tendon_{j + 1}", tension, to, to < tip, limits=limits, lag=tendon.time_constant))
    return found


def _wound(scene: Scene) -> list[Control]:
    """Tendons of winches that follow lengths."""
    finger, found = scene.finger, list[Control]()
    given = (0.0,) * len(finger.winches) if scene.actuation is None else scene.actuation.given[1]
    for j, tendon in enumerate(finger.tendon_list):
        drive, pulley = tendon.drive, len(finger.winches) < len(finger.tendon_list)
        if not isinstance(drive, LengthDrive):
            raise TypeError("motors are refused")
        to = tendon.end(finger.profile.length)
        compliance = 1.0 / (tendon.series_stiffness or 1.0) + to / (tendon.axial_stiffness or 1.0)
        found.append(
            Control(
                f"tendon_{j + 1}",
                given[0 if pulley else j],
                to,
                to < finger.profile.length,
                lag=drive.time_constant,
                cable=1.0 / compliance,
                sense=-1.0 if pulley and j == 1 else 1.0,
                start=drive.pretension * compliance - drive.slack,
            )
        )
    return found


def drawn_in(finger: Finger, tendon: int, at: Array) -> Array:
    """How far a tendon is drawn in per angle of hinges at places (N,) [m]: none beyond its end."""
    one, length = finger.tendon_list[tendon], finger.profile.length
    return one.arm(length) * one.shape(length)(at, tip_side=True)


def cable_springs(finger: Finger, controls: Sequence[Control], at: Array) -> Array:
    """Stiffness (N, N) of all cables, taut, at hinges [N m/rad]."""
    found = np.zeros((len(at), len(at)))
    for j, control in enumerate(one for one in controls if one.cable is not None):
        arms = drawn_in(finger, j, at)
        found += (control.cable or 0.0) * np.outer(arms, arms)
    return found
