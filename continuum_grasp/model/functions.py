"""Named CasADi functions of the expressions of a model, and objects with them, which are pickled by their arguments."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import cached_property, partial
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, Summarized
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.pattern import FEWEST_ELEMENTS
from continuum_grasp.model.planar import Scalar, Vec, column, matrix
from continuum_grasp.model.structure import Structure
from continuum_grasp.model.sweep import Kernels, sweep_function
from continuum_grasp.model.sweep_writer import SweepWriter


class Remade:
    """Pickles and copies by the arguments of its constructor.

    An object that arrives in another process, or is copied deeply, is constructed there as it was here; compiled code
    is found in the cache by its content.
    """

    _arguments: tuple[tuple[Any, ...], dict[str, Any]]

    def __new__(cls, *arguments: Any, **named: Any) -> Self:
        made = super().__new__(cls)
        made._arguments = tuple(map(_own, arguments)), {name: _own(value) for name, value in named.items()}
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        arguments, named_arguments = self._arguments
        return partial(type(self), *arguments, **named_arguments), (), self.__getstate__()

    def __getstate__(self) -> Any:
        """Changes since the object was made; for ``__setstate__`` of the copy, None for none."""
        return None


def _own(value: Any) -> Any:
    """Copy values that the caller may change later."""
    return copy.copy(value) if isinstance(value, list | dict) or hasattr(value, "__array__") else value


Output = ca.SX | Vec | Scalar | list[Scalar]


def named(inputs: str, *, history: bool = False, **outputs: Callable[[Any], Output]) -> cached_property[ca.Function]:
    """Define an attribute that is a function of space-separated inputs, with outputs from the model's equations.

    ``history``: the function also depends on the friction history, if any.
    """

    def build(model: Model) -> ca.Function:
        eq = model._equations
        names = f"{inputs} history" if history and eq.history.numel() else inputs
        # Those that methods give have a private name here.
        return model._function(
            str(attribute.attrname).lstrip("_"), names, **{name: of(eq) for name, of in outputs.items()}
        )

    # Built when it is first read: a model has some twenty functions, and most users need two.
    attribute: cached_property[ca.Function] = cached_property(build)
    attribute.__doc__ = f"({', '.join(inputs.split())}) -> {', '.join(outputs)}; the class describes them."
    return attribute


class Model(Remade, Summarized):
    """Base of a finger alone and a finger with an object: functions with named inputs and outputs."""

    MATRICES: ClassVar[frozenset[str]] = frozenset(
        (
            "mass_matrix.M",
            "internal.M",
            "internal.K",
            "internal.D",
            "statics.K",
            "jacobian.J",
            "jacobian_rate.Jd",
            "joints.r",
            "linearization.A",
            "linearization.B",
            "pressed_linearization.A",
            "touch.force",
            "touch.normal",
            "touch.point",
        )
    )
    """Outputs of finger models and systems that are matrices, whatever their size; all others are vectors."""

    x_names: list[str]
    u_names: list[str]
    w_names: list[str]
    p_names: list[str]

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        self._equations = Equations(structure)
        touched = self._equations.contacts
        self.x_names, self.w_names = structure.x_names + touched.names, structure.w_names + touched.w_names
        self.u_names = structure.u_names
        self.p_names, self.p_nominal = structure.parameters.labels, structure.parameters.nominal
        self.n, self.nx, self.nu = structure.n, len(self.x_names), len(self.u_names)
        self.nw, self.np = len(self.w_names), len(self.p_names)

    @classmethod
    def function_names(cls) -> tuple[str, ...]:
        """Names of the functions of a kind of model."""
        attributes = {name: value for base in reversed(cls.__mro__) for name, value in vars(base).items()}
        functions = (name for name, value in attributes.items() if isinstance(value, cached_property))
        return tuple(name for name in functions if not name.startswith("_"))

    def pairs(self) -> dict[str, str]:
        """Names of states, inputs, forces and parameters."""
        named = {"x": self.x_names, "u": self.u_names, "w": self.w_names, "p": self.p_names}
        return {key: f"{len(names)}: {', '.join(names)}" for key, names in named.items() if names}

    def rates_sprung_back(self, x: Array, u: Array, p: Array) -> Array:
        """Return the rates (n,) of a finger that springs back from a shape against inertia and quadratic damping.

        At these rates, both have absorbed the work of the stiffness. Zero without such damping, because no other fast
        effect of a finger depends on its rates.
        """
        n, state = self.n, np.asarray(x, dtype=float)
        q = state[:n]
        if not self.structure.has_law("damping") or not q.any():
            return np.zeros(n)
        states = [np.concatenate([q, rates, state[2 * n :]]) for rates in (np.zeros(n), q)]
        (mass, stiffness, still), (*_, moving) = (map(np.array, self.internal(at, u, p)) for at in states)
        # The moment of quadratic damping at rates q is half its slope times q.
        return q * math.sqrt(max(q @ stiffness @ q, 0.0) / (q @ (mass + 0.5 * (moving - still)) @ q))

    def _function(self, name: str, inputs: str, **outputs: Output) -> ca.Function:
        """A function of space-separated inputs, which are symbols of the equations."""
        names = inputs.split()
        arguments = [getattr(self._equations, key) for key in names]
        expressions = self._placed([dense(value) for value in outputs.values()])
        if "x" not in names:
            expressions = self._at_command(expressions)
        # The recursions write common factors (turns, arms, velocities) more than once: cse computes each once.
        return ca.Function(name, arguments, ca.cse(expressions), names, list(outputs))

    def _placed(self, expressions: list[ca.SX]) -> list[ca.SX]:
        """Return expressions in the model's own symbols, instead of the symbols of the equations."""
        return expressions

    def _at_command(self, expressions: list[ca.SX]) -> list[ca.SX]:
        """Return expressions with the moments that u commands, instead of the lagging moments, which are states."""
        eq = self._equations
        if not eq.lag.numel():
            return expressions
        commanded = ca.vertcat(*(ca.SX(state) for state in eq.lags_at_rest))
        # Winches have no commands at rest (``Equations.resting``), and these expressions do not depend on them.
        commanded = ca.vertcat(commanded, ca.SX.zeros(eq.lag.numel() - commanded.numel()))
        return list(ca.substitute(expressions, [eq.lag], [commanded]))

    @cached_property
    def forward_dynamics(self) -> ca.Function:
        """(x, u, w, p) -> xd; the class describes them."""
        if self.sweeps:
            return self._swept("forward_dynamics", "x u w p", "xd")
        return self._function("forward_dynamics", "x u w p", xd=self._equations.state_rate)

    def implicit(self) -> ca.Function:
        """``(x, u, w, p, part) -> k``: (1 - part A)^-1 xd, where A is the Jacobian of elasticity and damping alone.

        ``part`` [s] is a share of a step.
        """
        if self.sweeps:
            return self._swept("implicit", "x u w p part", "k")
        return self._function("implicit", "x u w p part", k=self._equations.implicit_rate)

    def _swept(self, name: str, inputs: str, output: str) -> ca.Function:
        """The derivative of the state by sweeps, implicit in a ``part`` if that is an input."""
        eq, n = self._equations, self._equations.q.numel()
        symbols = {key: ca.MX.sym(key, getattr(eq, key).numel()) for key in inputs.split()}
        x, u, p, part = symbols["x"], symbols["u"], symbols["p"], symbols.get("part")
        ahead = x[n : 2 * n]
        if part is None:
            rates, driven = sweep_function(self.kernels(), eq)(*symbols.values())
            driven = self.drive_rates(x, u, p) if eq.drives_feel_motion else driven
        else:
            rates, driven = sweep_function(SweepWriter(eq, implicit=True).kernels(), eq, implicit=True)(
                *symbols.values(), ahead
            )
            ahead += part * rates
            if eq.drives_feel_motion:
                drive_rates = self._function("drive_rates", "x u p part qdd", lagging=eq.implicit_drive_rates(eq.qdd))
                driven = drive_rates(x, u, p, part, rates)
        return ca.Function(name, [*symbols.values()], [ca.vertcat(ahead, rates, driven)], [*symbols], [output])

    @property
    def drive_rates(self) -> ca.Function:
        """(x, u, p) -> rates of the states of drives and of friction."""
        return self._function("drive_rates", "x u p", lagging=self._equations.drive_rates)

    @property
    def sweeps(self) -> bool:
        """Whether sweeps along the chain give the accelerations, at a cost that grows with the number of elements."""
        return self._equations.pattern is not None

    def kernels(self) -> Kernels:
        """Kernels of the sweeps that give the accelerations; of a model that ``sweeps``."""
        return SweepWriter(self._equations).kernels()

    @property
    def fewest_swept(self) -> int:
        """Least number of elements for sweeps."""
        return FEWEST_ELEMENTS

    @property
    def instructions(self) -> int:
        """Instructions of an evaluation of the forward dynamics."""
        f = self.forward_dynamics
        return self.kernels().instructions if self.sweeps else int(f.n_instructions())

    energy = named("x u p", kinetic=lambda eq: eq.kinetic_energy, potential=lambda eq: eq.potential_energy)
    internal = named(
        "x u p",
        M=lambda eq: matrix(eq.mass_matrix),
        # Slopes of elastic and damping forces, which are linear except for stops and quadratic damping.
        K=lambda eq: ca.jacobian(column(eq.elastic[: eq.q.numel()]), eq.q),
        D=lambda eq: ca.jacobian(column(eq.damping[: eq.q.numel()]), eq.qd),
    )
    linearization = named(
        "x u w p",
        A=lambda eq: ca.jacobian(column(eq.state_rate), eq.x),
        B=lambda eq: ca.jacobian(column(eq.state_rate), eq.u),
    )


def dense(value: Output) -> ca.SX:
    if isinstance(value, Vec):
        return value.column()
    return ca.densify(column(value) if isinstance(value, list) else ca.SX(value))
