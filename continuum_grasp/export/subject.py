"""What is exported: a model with its structs, their ranges, and the steps that it may take."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.core.precision import check_solvable
from continuum_grasp.export.codes import Code
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import Field, Struct
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Rows
from continuum_grasp.export.ranges import force_fields, input_fields, parameter_fields, state_fields
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
        made = Subject(
            model=model,
            equations=equations,
            prefix=prefix,
            real=real,
            parameters=_struct("parameters", "Parameters of the finger that may be changed at run time.", parameters),
            state=Struct("state", "State of the finger.", states),
            input=Struct("input", "What drives the finger.", input_fields(model)),
            forces=_struct("forces", "Forces on the finger.", forces),
            radius=radius,
            substeps=substeps,
            guard=_guard(model, equations),
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

    def acting(self, *, forces: bool = True) -> tuple[Argument, ...]:
        """State, input and, where there are any and they are wanted, forces, as arguments of a public function."""
        found = [Argument("state", self.state, "x"), Argument("input", self.input, "u")]
        if forces and self.forces is not None:
            found.append(Argument("forces", self.forces, "w"))
        return tuple(found)

    def step_argument(self) -> Argument:
        """The step, in its range."""
        longest = self.longest_step
        step = Field("h", "s", "step", _LEAST_PART * longest, longest, longest)
        return Argument("h", step, "h", Code.ERR_STEP)

    @property
    def guard_source(self) -> str:
        """C that refuses a matched tip out of its range."""
        if self.guard is None:
            return ""
        return f"""\
  {{
    {self.prefix}_real use[1];
    {self.guard.call(self.prefix, x="x", u="u", p="p", use="use")}
    if (!{self.prefix}_is_finite(use) || use[0] < -1 || use[0] > 1) return {self.prefix.upper()}_ERR_RANGE;
  }}
"""

    def refused(self, rows: Rows) -> NDArray[np.bool_]:
        """Rows whose matched tip is out of its range."""
        count = len(rows["x"])
        if self.guard is None:
            return np.zeros(count, dtype=bool)
        use = self.guard.evaluate(self.real, **rows)["use"][:, 0]
        return ~(np.abs(use) <= 1.0)

    def out_of_range(self, x: NDArray[Any]) -> NDArray[np.bool_]:
        """Rows of states that the package would not take."""
        low, high = (np.array(side) for side in zip(*self.state.bounded, strict=True))
        return np.asarray(((x < low.astype(x.dtype)) | (x > high.astype(x.dtype))).any(axis=1))

    @property
    def kernels(self) -> tuple[Kernel, ...]:
        """Kernels that the checks need."""
        return () if self.guard is None else (self.guard,)


def _struct(name: str, text: str, fields: tuple[Field, ...]) -> Struct | None:
    return Struct(name, text, fields) if fields else None


def _guard(model: FingerModel, equations: Equations) -> Kernel | None:
    if not model.structure.matched:
        return None
    use = ca.SX(equations.full[-1]) * equations.lengths[-1] / model.ranges[-1]
    function = ca.Function("tip_use", [equations.x, equations.u, equations.p], [use], ["x", "u", "p"], ["use"])
    return Kernel("tip_use", function, "Share of its bending range that the curvature of the tip takes.")


def _floor(value: float) -> float:
    """Three digits, downwards."""
    digits = 2 - math.floor(math.log10(value))
    return math.floor(value * 10.0**digits) / 10.0**digits
