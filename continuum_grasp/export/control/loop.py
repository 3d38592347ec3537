"""Exported parts of a closed loop: problem, estimator, their numbers, and the structs of the header."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array
from continuum_grasp.control import (
    ControlParts,
    Outputs,
    Prediction,
    RtiSolver,
    Setpoints,
    Stages,
)
from continuum_grasp.core import CReal
from continuum_grasp.export.control.kernels import Adapter, adapters_of
from continuum_grasp.export.fields import Field, Struct, identifiers, unit_of
from continuum_grasp.scene import ControlScene


class ExportedPhases(NamedTuple):
    """Phases of a finger's mission.

    Dimensions and settings of ``control/c/mission.h``, names of the phases, when the last one is planned to begin [s],
    and what other fingers may tell this one by the names of functions, with the words for it; none where it is alone.
    """

    sizes: dict[str, int]
    members: Mapping[str, ArrayLike]
    names: tuple[str, ...]
    ends: float
    reported: tuple[tuple[str, str], ...]

    @property
    def leads(self) -> bool:
        """Whether the finger is one of several, and decides for all."""
        return "others_bear" in dict(self.reported)

    @property
    def watches(self) -> int:
        """Whether the mission watches the held object for slip."""
        return int(np.asarray(self.members["watches"]))


@dataclass(frozen=True, kw_only=True)
class Loop(ControlParts):
    """A closed loop as the parts of a package see it."""

    parts: tuple[str, ...]
    """Parts that the package has: estimator, mpc."""
    members: Mapping[str, ArrayLike]
    """Numbers of ``controller_settings``."""
    first: Array
    """State (nz) from which the controller starts."""
    setpoints: Setpoints
    """Setpoints over time, for as long as ``duration`` [s]."""
    duration: float
    kicks: Array
    """Size (nd) of pushes in test vectors, of each state."""
    safe: str
    """Command that is approached when there is no plan."""
    phases: ExportedPhases | None = None
    """Phases of a mission; None of a controller alone."""

    @staticmethod
    def of(
        scene: ControlScene, real: CReal, parts: Sequence[str], phases: Callable[[Stages], ExportedPhases] | None = None
    ) -> Loop:
        """A scene's loop for a package that computes in a type, with the ``phases`` of a mission."""
        model = Prediction(scene)
        control_parts = ControlParts.of_scene(scene, model)
        z = np.zeros(len(control_parts.estimated_names))
        z[: model.nx] = model.first_state()  # disturbances start at zero, as nothing is known of them
        n = model.system.finger_model.n
        kicks = np.zeros(model.nx)
        kicks[n : 2 * n] = 1.0  # rates of the coordinates
        return Loop(
            **vars(control_parts),
            parts=tuple(parts),
            members=control_parts.settings_in(real.name),
            first=z,
            setpoints=Setpoints.of(Outputs.of(scene.controller.cost, model), scene.reference),
            duration=scene.duration or 1.0,
            kicks=kicks,
            safe="the least tensions" if scene.finger.tendons is not None else "no moment",
            phases=phases(control_parts.stages) if phases is not None and "mission" in parts else None,
        )

    @staticmethod
    def of_solver(solver: RtiSolver, real: CReal) -> Loop:
        """The loop of a solver, whose measurement is the state and which takes any finite number."""
        nd = solver.stages.nd
        return Loop(
            **vars(solver.parts.unlimited()),
            parts=("mpc",),
            members=solver.parts.settings_in(real.name),
            first=np.zeros(nd),
            setpoints=solver.nominal_setpoints,
            duration=1.0,
            # 0.1: size of pushes of a solver's states in test vectors, in their units: what is usual is not known
            kicks=np.full(nd, 0.1),
            safe="the safe command",
        )

    @property
    def before(self) -> Array:
        """Input (nu) before."""
        return self.calls.safe

    @property
    def period(self) -> float:
        """Time from one call to the next [s]."""
        return self.calls.period

    @property
    def nodes(self) -> int:
        """Nodes of a reference: from now on, one each stage."""
        return self.stages.stages + 1

    # -- structs ------------------------------------------------------------------------------------------------------

    @cached_property
    def measurement(self) -> Struct:
        text = "What is measured, NaN where it was not." if self.estimation else "The state."
        return Struct("measurement", text, Field.named(self.measurement_names, self.ranges.measurement))

    @cached_property
    def estimate(self) -> Struct:
        """States and disturbances."""
        ranges = np.vstack([self.ranges.x, self.ranges.disturbances])
        text = "State of the finger and, behind it, what disturbs it."
        return Struct("estimate", text, Field.named(self.estimated_names, ranges))

    @property
    def start(self) -> Struct:
        return self.measurement if self.estimation is None else self.estimate

    @cached_property
    def command(self) -> Struct:
        """The input."""
        ranges = np.stack([self.stages.u_min, self.stages.u_max], axis=1)
        return Struct(
            "command", "What the drives are to do until the next one.", Field.named(self.stages.u_names, ranges)
        )

    @cached_property
    def applied(self) -> Struct:
        """Struct of the applied command, which may be off or beyond what can be commanded."""
        return Struct("applied", "", Field.named(self.stages.u_names, self.ranges.applied))

    @cached_property
    def wanted(self) -> Array:
        """Setpoints (nr) with which the scene begins."""
        wanted: Array = self.setpoints.rows(0.0)[0]
        return wanted

    @property
    def measured_at_start(self) -> Array:
        """Measurements of the first state under the command before (ny), without noise."""
        low, high = np.transpose(self.measurement.bounded)
        within: Array = np.clip(self.measured(self.first, self.before), low, high)
        return within

    def measured(self, z: Array, u: Array) -> Array:
        """Measurements of states, and disturbances, under a command (ny), without noise."""
        if self._measured is None:
            return z
        measurement: Array = np.array(self._measured(z, u, self.stages.p_nominal)).ravel()
        return measurement

    @cached_property
    def _measured(self) -> ca.Function | None:
        """Function of measurements, without the derivatives that the filter's function of them has."""
        if self.estimation is None:
            return None
        outputs, mixing = self.estimation.outputs, self.estimation.mixing
        at = [ca.SX.sym(name, *outputs.size_in(k)) for k, name in enumerate("zup")]
        # The filter compares mixing @ measurement with its outputs; the pseudo-inverse leads back.
        return ca.Function("measured", at, [ca.DM(np.linalg.pinv(mixing)) @ outputs(*at)[0]])

    @cached_property
    def known(self) -> Struct | None:
        """Parameters of the prediction, None where it has none."""
        fields = Field.named(self.stages.p_names, self.ranges.p)
        text = "What is known of the model: parameters, forces."
        return Struct("known", text, fields) if fields else None

    @cached_property
    def reference(self) -> Struct:
        """Setpoints of all nodes."""
        fields = Field.named(self.stages.r_names, self.ranges.r)
        text = f"Setpoints from now on, one each {self.stages.stage:g} s."
        return Struct("reference", text, tuple(replace(field, shape=(self.nodes,)) for field in fields))

    @cached_property
    def settings(self) -> Struct:
        """Settings that may be changed between calls, in the order of ``changeable``."""
        s = self.stages
        fields = list[Field]()
        for member in self.changeable:
            labels = getattr(s, f"{member.of}_names")
            for k, (name, label) in enumerate(zip(identifiers(labels), labels, strict=True)):
                unit = unit_of(label)
                low = 0.0
                high = np.inf
                if member.of == "u":
                    low = float(s.u_min[k])
                    high = float(s.u_max[k])
                elif member.of == "r":
                    # A weight times a squared error is a number per second, or a number.
                    unit = f"1/{unit}2" if unit.isalpha() else f"1/({unit})2"
                elif member.name in ("c_min", "c_max"):
                    low = -np.inf
                fields.append(Field(member.exported.format(name), unit, member.text.format(name), low, high))
        text = "Weights, limits and penalties of the controller, which may be changed between calls."
        unique = identifiers(field.name for field in fields)
        return Struct("settings", text, tuple(replace(f, name=n) for f, n in zip(fields, unique, strict=True)))

    @property
    def nominal_settings(self) -> Array:
        """Values of ``settings`` that the scene gives."""
        return np.concatenate([np.ravel(getattr(self.stages, member.name)) for member in self.changeable])

    @cached_property
    def adapters(self) -> list[Adapter]:
        """Kernels of ``functions`` and of those that they call, and how C calls them."""
        return adapters_of(self.functions)

    @cached_property
    def functions(self) -> tuple[ca.Function, ...]:
        """Functions of stages and estimator that the C of ``control/c`` calls."""
        s = self.stages
        e = self.estimation
        controls = "mpc" in self.parts
        functions = [s.step, s.cost, s.terminal] if controls else []
        if e is not None:
            functions += [
                e.step,
                e.outputs,
                *([e.parameters] if controls else []),
                *([e.flow] if self.ahead > self.shared else []),
            ]
        if e is not None and e.contact_forces is not None and self.phases is not None:
            symbols = [ca.SX.sym(name, e.contact_forces.size1_in(k)) for k, name in enumerate("zup")]
            functions.append(ca.Function("estimator_forces", symbols, [e.contact_forces(*symbols)[0]], [*"zup"], ["f"]))
        return tuple(functions)
