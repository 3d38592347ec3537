"""What is exported of a closed loop: problem, estimator, their numbers, and the structs of the header."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.control.estimation.model import Estimation, estimation_of
from continuum_grasp.control.estimation.noise import Ranges, ranges_of
from continuum_grasp.control.field import Field as Member
from continuum_grasp.control.ocp.cost_terms import Outputs
from continuum_grasp.control.ocp.setpoints import setpoints
from continuum_grasp.control.ocp.stages import Stages, stages_of
from continuum_grasp.control.prediction import Prediction, first_state, rest_input
from continuum_grasp.control.settings import controller_fields, delay_periods
from continuum_grasp.control.status import CALL_RATE
from continuum_grasp.errors import InputError
from continuum_grasp.export.fields import Field, Real, Struct
from continuum_grasp.scene.control import ControlScene

Array = NDArray[np.float64]

CHANGEABLE = ("weights", "terminal_weights", "u_min", "u_max", "c_min", "c_max", "linear", "quadratic")
"""Members of ``rti_settings`` that the public settings have, in their order."""
DIAGNOSIS = (
    ("uint32_t", "anomalies", "what was noticed, bits of ..._ANOMALY_..."),
    ("int", "iterations", "factorizations beyond the first"),
    ("real", "violation", "largest share by which a soft bound is left in the plan"),
    ("real", "residual", "of the optimality conditions, relative"),
    ("real", "cost", "of the plan"),
    ("int", "health", "..._HEALTH_..."),
    ("int", "sensor", "..._SENSOR_... that contradicts the model most"),
    ("int", "frozen", "number of a reading that does not move, in the order of the measurement; -1: none"),
    ("int", "trip", "..._TRIP_..."),
    ("int", "rung", "how often the weight of the command's rate is raised fourfold"),
    ("real", "mismatch", "mean squared normalized innovation of that sensor; about 1 where all is well"),
    ("real", "activity", "mean squared change of the command, per that at its rate limit"),
)
"""C type, name and meaning of what is known of the last call of a controller."""
_WEIGHTS, _LIMITS, _ROWS = CHANGEABLE[:2], CHANGEABLE[2:4], CHANGEABLE[4:]
_NAMES = {
    "weights": ("weight_{}", "of half the squared error of {0}, per second"),
    "terminal_weights": ("terminal_weight_{}", "the same at the end of the horizon, once"),
    "u_min": ("least_{}", "least command"),
    "u_max": ("most_{}", "greatest command"),
    "c_min": ("least_{}", "least value of row {0}, in shares of its scale"),
    "c_max": ("most_{}", "greatest value"),
    "linear": ("penalty_{}", "penalty of leaving it, per share"),
    "quadratic": ("square_penalty_{}", "of half the squared share"),
}


@dataclass(frozen=True)
class Loop:
    """A closed loop as its parts see it."""

    scene: ControlScene
    parts: tuple[str, ...]
    """Those that the package has: estimator, mpc."""
    prediction: Prediction
    stages: Stages
    estimation: Estimation | None
    ranges: Ranges
    periods: int
    """Age of a measurement when it arrives, in periods."""
    members: tuple[Member, ...]
    """Numbers of ``controller_settings``."""
    first: Array
    """State (nz) from which the controller starts."""
    before: Array
    """Input (nu) before."""

    @staticmethod
    def of(scene: ControlScene, real: Real, parts: Sequence[str]) -> Loop:
        """A scene's loop for a package that computes in a type."""
        model = Prediction(scene)
        stages = stages_of(scene, model)
        # A plan is followed within its first stage; equal up to the rounding of a duration over a count.
        if scene.controller.step > stages.stage * (1.0 + 1e-9):
            raise InputError(
                f"{scene.controller.step:g} s is longer than a stage of {stages.stage:g} s", key="controller.period"
            )
        if scene.estimator is not None and scene.estimator.contact_detection is not None:
            raise InputError(
                "contact detection is not exported: its C is not yet of the strict kind; leave it out here",
                key="estimator.contact_detection",
            )
        estimation = None if scene.estimator is None else estimation_of(scene, model, stages.method)
        z = np.zeros(model.nx if estimation is None else estimation.nz)
        z[: model.nx] = first_state(scene, model)  # disturbances start at zero, as nothing is known of them
        return Loop(
            scene=scene,
            parts=tuple(parts),
            prediction=model,
            stages=stages,
            estimation=estimation,
            ranges=ranges_of(scene, model, stages, estimation),
            periods=delay_periods(scene),
            members=tuple(controller_fields(scene, model, stages, estimation, real.name)),
            first=z,
            before=rest_input(scene),
        )

    @property
    def period(self) -> float:
        """Time from one call to the next [s]."""
        return self.scene.controller.step

    @property
    def safe(self) -> str:
        """Where commands go when there is no plan."""
        return "the least tensions" if self.scene.finger.tendons is not None else "no moment"

    @property
    def measurement_names(self) -> tuple[str, ...]:
        """Names and units of what is measured; the state where there is no estimator."""
        return self.prediction.x_names if self.estimation is None else self.estimation.measurement_names

    @property
    def watched(self) -> tuple[str, ...]:
        """What the supervisor watches: the sensors, then the call rate."""
        return (*(() if self.estimation is None else self.estimation.sensor_names), CALL_RATE)

    # -- structs ------------------------------------------------------------------------------------------------------

    @cached_property
    def measurement(self) -> Struct:
        """What is measured."""
        text = "What is measured, NaN where it was not." if self.estimation else "The state of the finger."
        return Struct("measurement", text, named_fields(self.measurement_names, self.ranges.measurement))

    @cached_property
    def estimate(self) -> Struct:
        """States and disturbances."""
        names = self.prediction.x_names if self.estimation is None else self.estimation.z_names
        ranges = np.vstack([self.ranges.x, self.ranges.disturbances])
        return Struct("estimate", "State of the finger and, behind it, what disturbs it.", named_fields(names, ranges))

    @property
    def start(self) -> Struct:
        """From which the controller starts."""
        return self.measurement if self.estimation is None else self.estimate

    @cached_property
    def command(self) -> Struct:
        """The input."""
        ranges = np.stack([self.stages.u_min, self.stages.u_max], axis=1)
        return Struct(
            "command", "What the drives are to do until the next one.", named_fields(self.stages.u_names, ranges)
        )

    @cached_property
    def applied(self) -> Struct:
        """The same that was applied, which may be off or beyond what can be commanded."""
        return Struct("command", "", named_fields(self.stages.u_names, self.ranges.applied))

    @cached_property
    def wanted(self) -> Array:
        """Setpoints (nr) with which the scene begins."""
        outputs = Outputs.of(self.scene.controller.cost, self.prediction)
        found: Array = setpoints(outputs, self.scene.reference).rows(0.0)[0]
        return found

    @cached_property
    def known(self) -> Struct | None:
        """Parameters of the prediction, None where it has none."""
        fields = named_fields(self.stages.p_names, self.ranges.p)
        text = "What is known of the finger: parameters, forces."
        return Struct("known", text, fields) if fields else None

    @cached_property
    def reference(self) -> Struct:
        """Setpoints of all nodes."""
        nodes, fields = self.stages.stages + 1, named_fields(self.stages.r_names, self.ranges.r)
        text = f"Setpoints from now on, one each {self.stages.stage:g} s."
        return Struct("reference", text, tuple(replace(field, shape=(nodes,)) for field in fields))

    @cached_property
    def settings(self) -> Struct:
        """What may be changed between calls, in the order of ``CHANGEABLE``."""
        s = self.stages
        labels = {**dict.fromkeys(_WEIGHTS, s.r_names), **dict.fromkeys(_LIMITS, s.u_names)}
        labels |= dict.fromkeys(_ROWS, s.c_names)
        fields = []
        for member in CHANGEABLE:
            pattern, text = _NAMES[member]
            for k, (name, label) in enumerate(zip(identifiers(labels[member]), labels[member], strict=True)):
                unit = unit_of(label)
                low, high = 0.0, np.inf
                if member in _LIMITS:
                    low, high = float(s.u_min[k]), float(s.u_max[k])
                elif member in _WEIGHTS:
                    # A weight times a squared error is a number per second, or a number.
                    unit = f"1/{unit}2" if unit.isalpha() else f"1/({unit})2"
                elif member in ("c_min", "c_max"):
                    low = -np.inf
                fields.append(Field(pattern.format(name), unit, text.format(name), low, high))
        text = "Weights, limits and penalties of the controller, which may be changed between calls."
        unique = identifiers(field.name for field in fields)
        return Struct("settings", text, tuple(replace(f, name=n) for f, n in zip(fields, unique, strict=True)))

    @property
    def nominal_settings(self) -> Array:
        """Values of ``settings`` that the scene gives."""
        return np.concatenate([np.ravel(getattr(self.stages, member)) for member in CHANGEABLE])

    @cached_property
    def functions(self) -> tuple[ca.Function, ...]:
        """Functions of stages and estimator that the C of ``control/c`` calls."""
        s, e, controls = self.stages, self.estimation, "mpc" in self.parts
        found = [s.step, s.cost, s.terminal] if controls else []
        if e is not None:
            found += [e.step, e.outputs, *([e.parameters] if controls else []), *([e.flow] if self.periods else [])]
        return tuple(found)


def identifiers(labels: Iterable[str]) -> list[str]:
    """C identifiers of labels ``name [unit]``, each once."""
    found: list[str] = []
    for label in labels:
        name = re.sub(r"\W+", "_", label.split(" [")[0], flags=re.ASCII).strip("_")
        name = f"_{name}" if name[:1].isdigit() else name or "unnamed"
        further = (f"{name}_{count}" for count in itertools.count(2))
        found.append(name if name not in found else next(one for one in further if one not in found))
    return found


def unit_of(label: str) -> str:
    """Unit of a label; 1 where it has none, as names of a scene's zones do."""
    found = re.search(r" \[([\w ]+(?:/[\w ]+)*)\]$", label, re.ASCII)
    return found[1] if found else "1"


def named_fields(labels: Sequence[str], ranges: Array) -> tuple[Field, ...]:
    """Entries of a vector, with their ranges (size, 2)."""
    return tuple(
        Field(name, unit_of(label), "", float(low), float(high))
        for name, label, (low, high) in zip(identifiers(labels), labels, ranges, strict=True)
    )
