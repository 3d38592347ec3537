"""Subject of an export: a model with its structs, their ranges, and the steps that it may take."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import TypeVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.base import Array, InputError, NumericalError
from continuum_grasp.core import CReal
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.control.source import control_sources
from continuum_grasp.export.fields import Field, Struct, outside, to_digits
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Argument, Call, Rows
from continuum_grasp.export.ranges import (
    CONTACT_FORCE,
    JointRange,
    ModelFields,
    contact_depth,
)
from continuum_grasp.model import Equations, FingerModel, System
from continuum_grasp.scene import INTEGRATORS, Surroundings

T = TypeVar("T")
_NO_STATE, _NO_INPUT = Struct("state", "", ()), Struct("input", "", ())
"""Empty structs in place of a solver's state and input."""


@dataclass(frozen=True)
class Subject:
    """A model as the parts of a package see it."""

    prefix: str
    real: CReal
    finger: FingerModel | None = None
    """None for a solver of a problem, whose package has ``mpc`` alone."""
    touching: System | None = None
    """The finger with the object of its scene, whose states follow the finger's states."""
    finger_equations: Equations | None = None
    """Expressions of all that moves, for kernels of the whole state."""
    parameters: Struct | None = None
    state: Struct = _NO_STATE
    input: Struct = _NO_INPUT
    forces: Struct | None = None
    guard: Kernel | None = None
    """(x, u, p) -> use: share of its range that the curvature of a matched tip takes, which is no coordinate."""
    find_rates: Callable[[], tuple[float, float]] = lambda: (math.nan, math.nan)
    """The greatest spectral radius, and the rate that an accurate step resolves [1/s], which take long to find."""
    pressed: float = 0.0
    """Greatest depth of contacts [m]."""
    longest: float | None = None
    """Longest step that is asked for [s]."""
    count: int | None = None
    """Runge-Kutta steps within one that are asked for."""
    loop: Loop | None = None
    """The closed loop that it is part of."""
    sections: int = 25
    """Number of sections that are seen at once, evenly spaced from base to tip."""

    @staticmethod
    def of(
        model: FingerModel,
        prefix: str,
        real: CReal,
        ranges: Mapping[str, Sequence[float]],
        surroundings: Surroundings | None = None,
        *,
        longest: float | None = None,
        count: int | None = None,
    ) -> Subject:
        """Everything that the parts need to know of a model and of what it may touch."""
        touching = _touching(model, surroundings)
        model = model if touching is None else touching.finger_model
        if real.name == "float":
            _check_solvable(model)
        moving = touching or model
        model_ranges = {name: pair for name, pair in ranges.items() if name != CONTACT_FORCE or touching is None}
        fields = ModelFields(moving)
        parameters = fields.parameters(model_ranges)
        forces = fields.forces()
        states = fields.states(parameters)
        equations = Equations(moving.structure)
        pressed = 0.0 if touching is None else contact_depth(touching, ranges.get(CONTACT_FORCE))
        joint = JointRange.of(model, equations, pressed)
        return Subject(
            finger=model,
            touching=touching,
            finger_equations=equations,
            prefix=prefix,
            real=real,
            parameters=_struct("parameters", "Parameters of the finger that may be changed at run time.", parameters),
            state=Struct("state", "State of the finger." + joint.notes.get("state", ""), joint.bounded(states)),
            input=Struct(
                "input", "What drives the finger." + joint.notes.get("input", ""), joint.bounded(fields.inputs())
            ),
            forces=_struct("forces", "Forces on the finger.", forces),
            guard=joint.guard,
            find_rates=cache(partial(_greatest_rates, model, touching, pressed, states, parameters)),
            pressed=pressed,
            longest=longest,
            count=count,
        )

    @property
    def model(self) -> FingerModel:
        """The model of the finger; InputError where there is none."""
        return _known(self.finger)

    @property
    def equations(self) -> Equations:
        """Expressions of the model; InputError where there is none."""
        return _known(self.finger_equations)

    @property
    def stations(self) -> list[float]:
        """Positions of the sections that are seen at once [m]."""
        return [float(at) for at in np.linspace(0.0, sum(self.model.lengths), self.sections)]

    @property
    def moving(self) -> FingerModel | System:
        """Model that the state belongs to: the finger, with the object where there is one."""
        return self.model if self.touching is None else self.touching

    @cached_property
    def system(self) -> System:
        finger, options = self.model.structure.asked
        return self.touching or System(finger, **options)

    @cached_property
    def control_files(self) -> tuple[dict[str, str], dict[str, str]]:
        """Files of estimator and controller by path, and the declarations of each part; none without a loop."""
        return ({}, {}) if self.loop is None else control_sources(self.loop, self.prefix, self.real)

    @property
    def start(self) -> list[float]:
        """A straight finger at rest, beside an object that is where the scene has it."""
        return [0.0] * self.model.nx if self.touching is None else self.touching.state()

    @property
    def radius(self) -> float:
        """Greatest spectral radius [1/s]."""
        return self.find_rates()[0]

    @cached_property
    def substeps(self) -> int:
        """Runge-Kutta steps within one; InputError if the longest step that is asked for is not stable with them."""
        if self.longest is None:
            return self.count or 1
        needed = max(1, math.ceil(self.longest * self.radius / STABLE))
        while self.longest_of(needed) < self.longest and needed <= MOST_SUBSTEPS:
            needed += 1
        if needed <= (self.count or MOST_SUBSTEPS):
            resolved = needed if self.touching is None else math.ceil(self.longest * self.find_rates()[1] / _ACCURATE)
            return self.count or min(max(needed, resolved), MOST_SUBSTEPS)
        # Advice that can be followed: the sub-steps that would do, or, where those are too many, the longest step.
        if needed <= MOST_SUBSTEPS:
            advice = f"needs {needed} sub-steps (substeps), or a model with fewer or longer elements"
        else:
            advice = (
                f"would need {needed:.3g} sub-steps: with {MOST_SUBSTEPS} (substeps) steps up to "
                f"{STABLE * MOST_SUBSTEPS / self.radius:.2g} s would do; take those, or a model with fewer or longer "
                "elements"
            )
        raise InputError(
            f"steps of {self.longest:g} s are too long: the fastest motion of this model changes at "
            f"{self.radius:.4g} 1/s, so the Runge-Kutta method {advice}",
            key="step",
        )

    def longest_of(self, substeps: int) -> float:
        """Longest step of so many sub-steps that is stable [s]."""
        return self.real.rounded(to_digits(STABLE * substeps / self.radius, 3, math.floor))

    @property
    def longest_step(self) -> float:
        """Longest step that is stable [s]."""
        return self.longest_of(self.substeps)

    @property
    def accurate_step(self) -> float:
        """Longest step without a warning [s]."""
        return self.real.rounded(to_digits(_ACCURATE * self.substeps / self.find_rates()[1], 3, math.floor))

    def kernel(self, name: str, inputs: str, text: str, **outputs: ca.SX) -> Kernel:
        """A kernel of space-separated inputs of the equations: x, u, w, s, p."""
        return Kernel.of(name, {key: getattr(self.equations, key) for key in inputs.split()}, outputs, text)

    def acting(self, *, forces: bool = True, drawn: bool = False) -> tuple[Argument, ...]:
        """State, input and, where there are any and they are wanted, forces, as arguments of a public function.

        Those that are ``drawn`` may be out of their ranges.
        """
        arguments = [Argument("state", self.state, "x", drawn=drawn), Argument("input", self.input, "u", drawn=drawn)]
        if forces and self.forces is not None:
            arguments.append(Argument("forces", self.forces, "w"))
        return tuple(arguments)

    def passed_to(self, call: Call) -> list[Argument]:
        """Parameters and inputs of a function, in the order of the rows of its vectors."""
        parameters = [] if self.parameters is None else [Argument("parameters", self.parameters, "p")]
        return [*parameters, *call.inputs]

    @property
    def guard_source(self) -> str:
        """C that refuses a matched tip or a tension out of its range."""
        if self.guard is None:
            return ""
        return f"  if ({self._jointly_left('x')}) return {self.prefix.upper()}_ERR_RANGE;\n"

    def left_range(self, x: str) -> str:
        """C expression for whether the numbers ``x`` are a state that no step would take under the same input."""
        p = self.prefix.upper()
        box = f"check({x}, state_low, state_high, {p}_NX) < 0"
        return box if self.guard is None else f"{box} || {self._jointly_left(x)}"

    def _jointly_left(self, x: str) -> str:
        names = () if self.guard is None else self.guard.inputs
        return f"left_range({', '.join(x if name == 'x' else name for name in names)})"

    def refused(self, rows: Rows) -> NDArray[np.bool_]:
        """Rows whose matched tip or tension is out of its range."""
        count = len(rows["x"])
        if self.guard is None:
            return np.zeros(count, dtype=bool)
        use = self.guard.evaluate(self.real, **rows)["use"][:, 0]
        return ~(np.abs(use) <= 1.0)  # not "> 1": NaN is refused too

    def out_of_range(self, rows: Rows) -> NDArray[np.bool_]:
        """Rows whose state no step would take under the input of the row."""
        return np.asarray(outside(self.state, rows["x"]) | self.refused(rows))

    @property
    def kernels(self) -> tuple[Kernel, ...]:
        """Kernels that the checks need."""
        return () if self.guard is None else (self.guard,)


def _known(part: T | None) -> T:
    if part is None:
        raise InputError("this needs the model of a finger; a solver of a problem has only mpc", key="what")
    return part


def _check_solvable(model: FingerModel) -> None:
    """Refuse a model of whose accelerations single precision leaves no digit, at the straight finger.

    That is where rounding times the condition of the mass matrix, its diagonal scaled to ones, exceeds one. Scaling
    leaves a factorization without pivoting as it is, and this one is within a factor n of the best (A. van der Sluis,
    doi:10.1007/BF02165096).
    """
    rounding = 0.5 * CReal.KINDS["float"].epsilon
    mass = np.array(model.mass_matrix(np.zeros(model.n), np.zeros(model.nu), model.p_nominal))
    scale = 1.0 / np.sqrt(np.diag(mass))
    condition = float(np.linalg.cond(scale[:, None] * mass * scale))
    if not condition * rounding <= 1.0:
        raise InputError(
            f"single precision may lose all digits of this model's accelerations (condition of the mass matrix "
            f"{condition:.1g}, expected up to {1.0 / rounding:.1g}): take double precision, or fewer elements"
        )


def _touching(model: FingerModel, around: Surroundings | None) -> System | None:
    """The finger with the object beside it, whose place stays a run-time number where it is fixed; None without one."""
    if around is None or around.object is None or not (around.object_moves or around.contact_law):
        return None
    finger, options = model.structure.asked
    object_parameters = () if around.object_moves else ("object_x", "object_y")
    return System(finger, surroundings=around, object_parameters=object_parameters, **options)


def _struct(name: str, text: str, fields: tuple[Field, ...]) -> Struct | None:
    return Struct(name, text, fields) if fields else None


STABLE = 2.5
"""Greatest product of step and spectral radius that is taken; the method is stable up to about 2.7, and the radius of
shapes between those that are looked at may be some percent greater."""
_ACCURATE = INTEGRATORS["rk4"].target
"""Product of step and spectral radius up to which the motion is followed as well as it is resolved."""
MOST_SUBSTEPS = 1000
"""Most sub-steps within one step [1]."""
_CORNERS = 32
"""Corners of the box of parameters, all of them for up to five parameters."""


def _greatest_rates(
    model: FingerModel,
    touching: System | None,
    pressed: float,
    states: Sequence[Field],
    parameters: Sequence[Field],
) -> tuple[float, float]:
    """Greatest spectral radius of the linearized motion, and the rate that an accurate step resolves [1/s].

    Taken at rest, with quadratic damping as the finger springs back, without forces, over shapes within the bending
    range and the corners of the ranges of the parameters (some of them where they are many); without input, but with
    tendons that have friction or are wound up as tense as they may be, and contacts open, and pressed in as far as they
    may be [m]. Friction of contacts is stiff, and need not be resolved: what lands on their springs must be.
    NumericalError where it is not finite.
    """
    rng = np.random.default_rng(0)  # a package must come out the same every time
    low, high = np.array([(field.low, field.high) for field in states[: model.n]]).T
    radius = 0.0
    resolved = 0.0
    moving = model if touching is None else touching
    for p in _corners(moving, parameters, rng):
        for shape in _shapes(low, high, rng):
            for rest, u in _driven(model, shape, p[: model.np]):
                x = np.concatenate([shape, np.zeros(model.n), rest])
                x[model.n : 2 * model.n] = model.rates_sprung_back(x, u, p[: model.np])
                slopes = _slopes(moving, x, u, p, pressed)
                if not np.isfinite(slopes).all():
                    raise NumericalError(
                        "the linearized motion is not finite at a corner of the parameters' ranges", state=x
                    )
                radii = [float(np.abs(np.linalg.eigvals(slope)).max()) for slope in slopes]
                radius = max(radius, *radii)
                resolved = max(resolved, radii[0])
                if touching is not None:
                    # 0.125: product of a sub-step and the fastest oscillation on a contact's spring up to which what
                    # lands on it is followed: the tip of a finger of 0.18 m that swings against a disc is then off by
                    # 8e-6 m
                    resolved = max(resolved, touching.spring_frequency(slopes[1] - slopes[0]) / 0.125)
    return radius, resolved


def _slopes(moving: FingerModel | System, x: Array, u: Array, p: Array, pressed: float) -> list[Array]:
    """Jacobians of the motion by its state, of a finger's state: alone, or with open, then with closed contacts."""
    w = np.zeros(moving.nw)
    if isinstance(moving, FingerModel):
        return [np.array(moving.linearization(x, u, w, p)[0])]
    x = np.concatenate([x, moving.state()[len(x) :]])
    gap = np.array(moving.touch(x, u, w, p)[0]).ravel()
    # 1.0: gap of contacts that are open [m]
    return [np.array(moving.pressed_linearization(x, u, w, p, gap - wanted)) for wanted in (1.0, -pressed)]


def _driven(model: FingerModel, shape: Array, p: Array) -> list[tuple[Array, Array]]:
    """States of drives and of friction, and inputs, among which the stiffest are, in a shape."""
    tendons = model.finger.tendon_list
    structure = model.structure
    u = np.zeros(model.nu)
    count = len(model.friction_names)
    drives = [[0.0] * (model.nx - 2 * model.n - count)]
    if structure.own_tendons:
        greatest = [tendon.max_tension for tendon in tendons]
        if structure.winches:
            # Both tendons of a pulley have their pretension; what is stiff about friction grows with tension.
            # 1.0: tension of a tendon that is in tension [N]
            least = max(1.0, *(winch.drive.pretension for winch in structure.winches))
            drives = [model.drives_at(shape, u, pulled=tension, p=p) for tension in (least, max(greatest))]
        else:
            u[: len(greatest)] = greatest
            drives = [model.drives_at(shape, u, p=p)]
    # What sticks is stiff, and states of what slides return to their range.
    return [(np.array([*drive, *[z] * count]), u) for drive in drives for z in structure.stiffest_friction]


def _shapes(low: Array, high: Array, rng: np.random.Generator) -> Array:
    """At rest, with every bend at a limit (half of them if the others mirror them), and in between."""
    count = len(low)
    # 32: shapes within the bending range, as many again: the radius is not monotonic in the shape
    between = rng.uniform(-1.0, 1.0, (32, count))
    if 2 ** (count - 1) <= _CORNERS:
        signs = np.array([(1.0, *rest) for rest in itertools.product((-1.0, 1.0), repeat=count - 1)])
    else:
        signs = np.where(rng.integers(0, 2, (_CORNERS, count)) == 1, 1.0, -1.0)
    mirrored = np.zeros((0, count)) if np.array_equal(-low, high) else -signs
    shares = np.vstack([np.zeros(count), signs, mirrored, between])
    return np.where(shares > 0.0, shares * high, -shares * low)


def _corners(model: FingerModel | System, parameters: Sequence[Field], rng: np.random.Generator) -> list[Array]:
    """Nominal values and those at the ends of the ranges."""
    pairs = np.array([(field.low, field.high) for field in parameters]).reshape(-1, 2)
    if 2 ** len(pairs) <= _CORNERS:
        corners = [np.array(corner) for corner in itertools.product(*pairs)]
    else:
        picked = rng.integers(0, 2, (_CORNERS, len(pairs)))
        corners = [pairs[:, 0], pairs[:, 1], *(np.where(row == 1, pairs[:, 1], pairs[:, 0]) for row in picked)]
    return [np.array(model.p_nominal), *corners]
