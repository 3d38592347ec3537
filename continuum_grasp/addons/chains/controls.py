"""The inputs and loads of a scene as actuators of MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.scene import Channel, ForceLoad, LengthDrive, Pull, Samples, Scene, VectorSamples
from continuum_grasp.simulation import interpolate


@dataclass(frozen=True)
class Control:
    """An actuator: a tendon that pulls, or a component of a force or moment at a place of the finger."""

    name: str
    value: Any
    """Constant, or samples in time."""
    at: float
    """Place where the tendon ends, or the force acts [m]."""
    jumps: tuple[float, ...] = ()
    """Places where the bending moment jumps [m]."""
    component: int | None = None
    """Index of a force's component."""
    gear: tuple[float, ...] | None = None
    """Force and moment per control at a site there; None: it bends hinges by a channel."""
    follows: bool = True
    """Whether the force turns with the finger."""
    limits: tuple[float, float] | None = None
    lag: float | None = None
    """Time constant of a filter of first order for its drive [s]."""
    cable: float | None = None
    """Stiffness of a tendon that is wound up [N/m]; None: its tension is commanded."""
    sense: float = 1.0
    """Factor of the values: whether a pulley winds up or pays out."""
    start: float = 0.0
    """Offset of the values: cable that is wound up of the straight finger [m]."""
    channel: Channel | None = None
    """Bending moments of a tendon or a chamber; None: a force or moment at a site."""
    arm: float = 0.0
    """Amplitude of the channel per tension [m], or per pressure."""

    @classmethod
    def of(cls, name: str, value: Any, pull: Pull, **others: Any) -> Control:
        """A tendon or a chamber, by its channel and its arm there."""
        *_, channel, arm = pull
        # 1/(T s + 1)^2 and 1/(2 T s + 1) have the same mean delay 2 T.
        lag = channel.time_constant and channel.order * channel.time_constant
        arguments = {"lag": lag, **others}
        return cls(name, value, channel.to, tuple(channel.shape.breaks), channel=channel, arm=arm, **arguments)

    def levers(self, at: Array) -> Array:
        """Moments about hinges at places (N,) per control: of a tendon how far it is drawn in per angle [m]."""
        if self.channel is None:
            return np.zeros(len(at))
        return self.arm * self.channel.gain * self.channel.shape(at, tip_side=True)

    @property
    def site(self) -> str:
        """Site at which a force or moment acts."""
        return f"at_{self.at:.12g}"

    @property
    def varies(self) -> bool:
        """Whether it varies in time."""
        return isinstance(self.value, Samples | VectorSamples)

    def __call__(self, t: Array) -> Array:
        """Values at instants (T,) [s]."""
        values = interpolate(self.value, t)[0]
        return self.start + self.sense * (values if self.component is None else values[:, self.component])


def controls_of(scene: Scene) -> list[Control]:
    """All actuators of a scene: tendons, or the tip moment, then the components of its loads."""
    controls = _inputs(scene)
    tip = scene.finger.profile.length
    for k, load in enumerate(scene.loads):
        value = load.value
        if not isinstance(load, ForceLoad):
            name = f"load_{k + 1}_moment"
            jumps = (load.at,) if load.at < tip else ()
            controls.append(Control(name, value, load.at, jumps, gear=(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)))
            continue
        for component, axis in enumerate("xy"):
            gear = tuple(float(j == component) for j in range(6))
            name = f"load_{k + 1}_{axis}"
            controls.append(Control(name, value, load.at, (), component, gear, load.follows))
    return controls


def _inputs(scene: Scene) -> list[Control]:
    finger, actuation = scene.finger, scene.actuation
    if "tip_moment" in finger.input_keys:
        if actuation is None:
            return []
        gear = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        return [Control("tip_moment", actuation.tip_moment, finger.profile.length, gear=gear)]
    tendons = len(finger.tendon_list)
    commands = {} if actuation is None else actuation.given
    pressures = commands.get("pressures", (0.0,) * len(finger.chambers))
    controls = _tendons(scene)
    for k, (chamber, pressure) in enumerate(zip(finger.pulls[tendons:], pressures, strict=True)):
        controls.append(Control.of(f"chamber_{k + 1}", pressure, chamber, limits=(chamber.least, chamber.most)))
    return controls


def _tendons(scene: Scene) -> list[Control]:
    """Tendons with commanded tensions, or tendons of winches that follow lengths."""
    finger = scene.finger
    actuation = scene.actuation
    controls = list[Control]()
    pulley = len(finger.winches) < len(finger.tendon_list)
    lengths = (0.0,) * len(finger.winches) if actuation is None else actuation.values
    tensions = None if actuation is None else actuation.tensions
    for j, tendon in enumerate(finger.tendon_list):
        name = f"tendon_{j + 1}"
        pull = finger.pulls[j]
        drive = tendon.drive
        if not finger.winches:
            # Slack tendons, of a scene without input, have no tension at all.
            limits = (0.0 if tensions is None else tendon.min_tension, tendon.max_tension)
            controls.append(Control.of(name, 0.0 if tensions is None else tensions[j], pull, limits=limits))
            continue
        if not isinstance(drive, LengthDrive):
            raise TypeError("motors are refused")
        to = tendon.end(finger.profile.length)
        compliance = 1.0 / (tendon.series_stiffness or 1.0) + to / (tendon.axial_stiffness or 1.0)
        properties = {
            "lag": 2.0 * drive.time_constant,
            "cable": 1.0 / compliance,
            "sense": -1.0 if pulley and j == 1 else 1.0,
        }
        properties["start"] = drive.pretension * compliance - drive.slack
        controls.append(Control.of(name, lengths[0 if pulley else j], pull, **properties))
    return controls


def cable_springs(controls: Sequence[Control], at: Array) -> Array:
    """Stiffness (N, N) of all cables in tension, at hinges [N m/rad]."""
    stiffness = np.zeros((len(at), len(at)))
    for control in controls:
        if control.cable is not None:
            levers = control.levers(at)
            stiffness += control.cable * np.outer(levers, levers)
    return stiffness
