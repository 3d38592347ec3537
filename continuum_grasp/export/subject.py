"""What is exported: a model with its structs, their ranges, and the steps that it may take."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core.precision import check_solvable
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import Field, Struct, outside
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Code, Rows
from continuum_grasp.export.ranges import TipRange, force_fields, input_fields, parameter_fields, state_fields
from continuum_grasp.export.reals import Real
from continuum_grasp.export.stability import ACCURATE, STABLE, check_step, greatest_radius
from continuum_grasp.model import FingerModel
from continuum_grasp.model.equations import Equations

__all__ = ["Subject"]

_LEAST_PART = 1e-6
"""Shortest step, per the longest."""


@dataclass(frozen=True)
class Subject:
    """A model as the parts of a package see it.

    Attributes
    ----------
    equations : Equations
        Expressions of the model, for kernels of the whole state.
    parameters, forces : Struct or None
        None where the model has none.
    radius : float
        Greatest spectral radius [1/s].
    guard : Kernel or None
        (x, u, p) -> use: share of its range that the curvature of a matched tip takes, which is no coordinate.
    loop : Loop or None
        The closed loop that it is part of.
    """

    model: FingerModel
    equations: Equations
    prefix: str
    real: Real
    parameters: Struct | None
    state: Struct
    input: Struct
    forces: Struct | None
    radius: float
    substeps: int
    guard: Kernel | None
    loop: Loop | None = None

    @staticmethod
    def of(
        model: FingerModel,
        prefix: str,
        real: Real,
        ranges: Mapping[str, Sequence[float]],
        step: float | None,
        substeps: int,
    ) -> Subject:
        """Everything that the parts need to know of a model.

        Raises
        ------
        InputError
            If single precision cannot carry the model, a range is wrong, or the step is too long for the sub-steps.
        """
        if real.name == "float":
            check_solvable(model)
        parameters, forces = parameter_fields(model, ranges), force_fields(model)
        states = state_fields(model, parameters)
        radius = greatest_radius(model, states, parameters)
        if step is not None:
            check_step(step, substeps, radius)
        equations = Equations(model.structure)
        tip = TipRange.of(model, equations)
        made = Subject(
            model=model,
            equations=equations,
            prefix=prefix,
            real=real,
            parameters=_struct("parameters", "Parameters of the finger that may be changed at run time.", parameters),
            state=Struct("state", "State of the finger." + tip.notes.get("state", ""), tip.bounded(states)),
            input=Struct(
                "input", "What drives the finger." + tip.notes.get("input", ""), tip.bounded(input_fields(model))
            ),
            forces=_struct("forces", "Forces on the finger.", forces),
            radius=radius,
            substeps=substeps,
            guard=tip.guard,
        )
        return made

    @property
    def longest_step(self) -> float:
        """Longest step that is stable [s]."""
        return self.real.rounded(_floor(STABLE * self.substeps / self.radius))

    @property
    def accurate_step(self) -> float:
        """Longest step without a warning [s]."""
        return self.real.rounded(_floor(ACCURATE * self.substeps / self.radius))

    @property
    def nx(self) -> int:
        """Count of states."""
        return self.model.nx

    @property
    def n(self) -> int:
        """Count of bending coordinates."""
        return self.model.n

    def function(self, name: str, inputs: str, **outputs: ca.SX) -> ca.Function:
        """A function of space-separated inputs of the equations: x, u, w, s, p."""
        names = inputs.split()
        arguments = [getattr(self.equations, key) for key in names]
        return ca.Function(name, arguments, ca.cse(list(outputs.values())), names, list(outputs))

    def acting(self, *, forces: bool = True, drawn: bool = False) -> tuple[Argument, ...]:
        """State, input and, where there are any and they are wanted, forces, as arguments of a public function.

        Those that are ``drawn`` may be out of their ranges.
        """
        found = [Argument("state", self.state, "x", drawn=drawn), Argument("input", self.input, "u", drawn=drawn)]
        if forces and self.forces is not None:
            found.append(Argument("forces", self.forces, "w"))
        return tuple(found)

    def step_argument(self) -> Argument:
        """The step, in its range."""
        longest = self.longest_step
        step = Field("h", "s", "step", _LEAST_PART * longest, longest, longest)
        return Argument("h", step, "h", Code.ERR_STEP)

    @property
    def guard_function(self) -> str:
        """C of the function that tells a matched tip out of its range."""
        if self.guard is None:
            return ""
        p, inputs = self.prefix, list(self.guard.inputs)
        return f"""\
/* Whether the curvature of the matched tip, which is no coordinate, is out of its range. */
{p.upper()}_API static int tip_left_range({", ".join(f"const {p}_real *{name}" for name in inputs)})
{{
  {p}_real use[1];
  {self.guard.call(p, **{name: name for name in inputs}, use="use")}
  return !{p}_is_finite(use) || use[0] < -1 || use[0] > 1;
}}
"""

    @property
    def guard_source(self) -> str:
        """C that refuses a matched tip out of its range."""
        if self.guard is None:
            return ""
        return f"  if ({self._tip_left_range('x')}) return {self.prefix.upper()}_ERR_RANGE;\n"

    def left_range(self, x: str) -> str:
        """C expression for whether the numbers ``x`` are a state that no step would take under the same input."""
        p = self.prefix.upper()
        box = f"check({x}, state_low, state_high, {p}_NX) < 0"
        return box if self.guard is None else f"{box} || {self._tip_left_range(x)}"

    def _tip_left_range(self, x: str) -> str:
        names = () if self.guard is None else self.guard.inputs
        return f"tip_left_range({', '.join(x if name == 'x' else name for name in names)})"

    def refused(self, rows: Rows) -> NDArray[np.bool_]:
        """Rows whose matched tip is out of its range."""
        count = len(rows["x"])
        if self.guard is None:
            return np.zeros(count, dtype=bool)
        use = self.guard.evaluate(self.real, **rows)["use"][:, 0]
        return ~(np.abs(use) <= 1.0)

    def out_of_range(self, rows: Rows) -> NDArray[np.bool_]:
        """Rows whose state no step would take under the input of the row."""
        return np.asarray(outside(self.state, rows["x"]) | self.refused(rows))

    @property
    def kernels(self) -> tuple[Kernel, ...]:
        """Kernels that the checks need."""
        return () if self.guard is None else (self.guard,)


def _struct(name: str, text: str, fields: tuple[Field, ...]) -> Struct | None:
    return Struct(name, text, fields) if fields else None


def _floor(value: float) -> float:
    """Three digits, downwards."""
    digits = 2 - math.floor(math.log10(value))
    return math.floor(value * 10.0**digits) / 10.0**digits
