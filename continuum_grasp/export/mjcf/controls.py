"""The inputs and loads of a scene as actuators of MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

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

    @property
    def varies(self) -> bool:
        """Whether it varies in time."""
        return isinstance(self.value, Samples | VectorSamples)

    def __call__(self, t: Array) -> Array:
        """Values at instants (T,) [s]."""
        if not isinstance(self.value, Samples | VectorSamples):
            return np.full(len(t), float(self.value))
        values = interpolate(self.value, t)[0]
        return values if self.component is None else values[:, self.component]


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
    tensions = None if actuation is None else actuation.tensions
    found = []
    for j, tendon in enumerate(finger.tendon_list):
        to = tip if tendon.to is None else tendon.to
        # Slack tendons, of a scene without input, have no tension at all.
        limits = (0.0 if tensions is None else tendon.min_tension, tendon.max_tension)
        tension = 0.0 if tensions is None else tensions[j]
        found.append(Control(f"tendon_{j + 1}", tension, to, to < tip, limits=limits, lag=tendon.time_constant))
    return found
