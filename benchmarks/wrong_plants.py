"""Plants that differ from what a controller knows, in values, in their drive, and in how they are wired to it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array
from continuum_grasp.closed_loop import Plant, PlantModel
from continuum_grasp.control import Controller
from continuum_grasp.scene import ControlScene

FAULT = 1.0
"""When sensors fail [s]: after the first motion."""
_ELEMENTS = 4
"""Clothoids of the plants: half of what scenes have, compiled ten times sooner; the tip rests within 0.01 mm alike."""
_MATCHED = "matched_clothoid"
"""Family of a plant that stays as shipped, for tendons that end inside: it takes no friction and no first-order lag."""
_TIP_DRIFT = 0.055
"""Of a camera, in lengths of the finger per second: 10 mm/s on the hand finger."""
_TENSION_DRIFT = 0.05
"""Of a tension sensor, in ranges of the input per second: 3 N/s on the hand finger."""


@dataclass(frozen=True)
class Wrong:
    """One way in which a plant differs."""

    group: str
    name: str
    plant: Mapping[str, Any] = field(default_factory=dict)
    """Keys of the scene's ``plant``; ``lag`` and ``extra_delay`` are factors of the controller's time constant and
    periods beyond its delay, ``tip_masses`` a factor of the mass at the tip."""
    readings: tuple[str, ...] = ()
    """Entries of a measurement, by their names, that ``fault`` is about."""
    fault: str = ""
    """What becomes of them: swapped, stuck, drift, missing, outliers."""
    commands: str = ""
    """swapped: in reverse order, or the sign of the only one."""
    period: float = 1.0
    """Time between two calls of the controller, in periods."""
    clock: bool = False
    """Whether the controller is given the time."""
    mild: bool = False
    """Whether the loop has to stay as good as the ideal one."""


def wrongs(scene: ControlScene) -> list[Wrong]:
    """All of them that a scene's finger can have; the first is the plant as the scene has it."""
    measured = scene.estimator is not None and scene.estimator.measured
    matched = scene.plant.fidelity.family == _MATCHED
    drive = tuple(entry.name for entry in scene.finger.inputs)[:2]
    found = [Wrong("as shipped", "as shipped", mild=True)]
    if not scene.finger.winches:
        found += [Wrong("drive", f"lag x {k:g}", {"lag": k}, mild=0.5 <= k <= 2.0) for k in (0.25, 0.5, 2.0, 4.0)]
        order, factors = {"drive_order": 1}, () if matched else (0.5, 1.0, 2.0)
        found += [Wrong("drive", f"order 1, lag x {k:g}", {"lag": k, **order}, mild=True) for k in factors]
    found += [Wrong("delay", f"{k:+d} period(s)", {"extra_delay": k}) for k in (-1, 1, 2, 3)]
    found += [Wrong("stiffness", f"x {k:g}", {"stiffness": k}, mild=k <= 1.5) for k in (0.5, 0.75, 1.25, 1.5, 2.0)]
    found += [Wrong("damping", f"x {k:g}", {"damping": k}) for k in (0.1, 0.3, 3.0)]
    if scene.finger.tendons is not None and not matched:
        found += [Wrong("friction", f"{k:g}", {"tendon_friction": k}) for k in (0.0, 0.1, 0.2, 0.3)]
    found += [Wrong("tip mass", f"x {k:g}", {"tip_masses": k}) for k in (0.5, 1.5)]
    found += [Wrong("noise", f"x {k:g}", {"noise": k}) for k in (0.1, 3.0, 10.0)]
    several = {"stiffness": 1.5, "lag": 0.5, "extra_delay": 1}
    found.append(Wrong("several", "lag x 0.5, stiffness x 1.5, +1 period", several))
    found.append(Wrong("wiring", "tip x and y swapped", readings=("tip_x", "tip_y"), fault="swapped"))
    if len(drive) > 1:
        found.append(Wrong("wiring", "readings of the drives swapped", readings=drive, fault="swapped"))
    found.append(Wrong("wiring", "commands swapped or reversed", commands="swapped"))
    for one in dict.fromkeys((("tip_x",), ("tip_x", "tip_y"), drive[:1], drive)):
        found.append(Wrong("sensor", f"{', '.join(one)} stuck", readings=one, fault="stuck"))
    for one in (("tip_x",), drive[:1]):
        found.append(Wrong("sensor", f"{one[0]} drifts", readings=one, fault="drift"))
    found.append(Wrong("sensor", "camera away for 50 periods", readings=("tip_x", "tip_y"), fault="missing"))
    found.append(Wrong("sensor", "1 % outliers of each entry", readings=("tip_x", "tip_y", *drive), fault="outliers"))
    found += [Wrong("calls", f"period x 2{text}", period=2.0, clock=bool(text)) for text in ("", ", with time stamps")]
    return found if measured else []


class Bench:
    """A shipped loop with plants that differ; one of each structure is compiled."""

    def __init__(self, scene: ControlScene) -> None:
        self.scene = scene
        self.control = Controller(scene, deadline=math.inf)
        self._models: dict[tuple[int, float], PlantModel] = {}

    @cached_property
    def _names(self) -> tuple[str, ...]:
        friction = ("tendon_friction",) * any(wrong.group == "friction" for wrong in wrongs(self.scene))
        return ("bending_stiffness", "material_damping", "tip_mass", *friction)

    def plant(self, wrong: Wrong, seed: int) -> Plant:
        """A plant at its start."""
        scene = self._scene(wrong, seed)
        order, lag = scene.plant.drive_order, scene.plant.time_constant or 0.0
        if (order, lag) not in self._models:
            self._models[order, lag] = PlantModel(self._scene(wrong, 0), parameters=self._names)
        model, values = self._models[order, lag], PlantModel(scene, parameters=self._names)
        model.p[:], model.__dict__["start"] = values.p, values.start
        return _Wired(scene, self.control, wrong, model)

    def _scene(self, wrong: Wrong, seed: int) -> ControlScene:
        """The scene with the plant's values in absolute terms."""
        scene, asked = self.scene, dict(wrong.plant)
        # Winches have a lag of their own, which no key of the plant changes.
        lag = None if scene.finger.winches else scene.lag
        delay = 0.0 if scene.estimator is None else scene.estimator.delay
        changes: dict[str, Any] = {"seed": seed, "time_constant": scene.plant.time_constant or lag}
        length, share = scene.finger.rod.length, asked.pop("tip_masses", 1.0)
        masses = [m.model_copy(update={"mass": share * m.mass}) if m.at == length else m for m in scene.finger.masses]
        factor = asked.pop("lag", None)
        if lag is not None and factor is not None:
            changes["time_constant"] = factor * lag
        changes["delay"] = delay + asked.pop("extra_delay", 0) * scene.controller.step
        fewer = {} if scene.plant.fidelity.family == _MATCHED else {"elements": _ELEMENTS}
        changes["fidelity"] = scene.plant.fidelity.model_copy(update=fewer)
        finger, plant = scene.finger, scene.plant.model_copy(update={**changes, **asked})
        return scene.model_copy(update={"finger": finger.model_copy(update={"masses": tuple(masses)}), "plant": plant})


class _Wired(Plant):
    """A plant whose wires are where a fault puts them: what is measured and commanded passes through here."""

    def __init__(self, scene: ControlScene, control: Controller, wrong: Wrong, model: PlantModel) -> None:
        super().__init__(scene, control.prediction, wrong.period * control.period, model)
        self._wrong = wrong
        names = [name.split(" ")[0] for name in self.sensors.names]
        self._at = [names.index(name) for name in wrong.readings]
        self._rng = np.random.default_rng([scene.plant.seed, 1])
        self._held: Array | None = None
        tip = _TIP_DRIFT * scene.finger.rod.length
        drive = _TENSION_DRIFT * float((control.stages.u_max - control.stages.u_min).max())
        self._drift = np.array([tip if name.startswith("tip_") and "moment" not in name else drive for name in names])
        self._spread = 100.0 * self.sensors.std

    def measure(self) -> Array:
        y, at, fault = super().measure(), self._at, self._wrong.fault
        if fault == "swapped":
            y[at] = y[at[::-1]]
        elif fault == "outliers":
            hit = self._rng.random(len(at)) < 0.01
            y[at] += hit * self._rng.normal(size=len(at)) * self._spread[at]
        elif self.t >= FAULT - 1e-9 and fault:
            self._held = y.copy() if self._held is None else self._held
            if fault == "stuck":
                y[at] = self._held[at]
            elif fault == "drift":
                y[at] += (self.t - FAULT) * self._drift[at]
            elif fault == "missing" and self.t < FAULT + 50 * self.period - 1e-9:
                y[at] = np.nan
        return y

    def advance(self, u: ArrayLike) -> Array:
        command = np.asarray(u, dtype=float)
        if self._wrong.commands:
            command = command[::-1] if command.size > 1 else -command
        return super().advance(command)
