"""One finger of a grasp in units of its own: length, bending stiffness and linear density are 1.

Every number of the finger is then a run-time parameter of the same model, so that fingers of one structure share one
solver. Its base is at the origin, pointing along +Y.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.model import FingerModel
from continuum_grasp.scene.finger import Finger, PointMass, Rod, Tendons
from continuum_grasp.scene.grasp import FingerSetup
from continuum_grasp.scene.loads import MomentLoad

ACCURACY = 1e-7
"""Relative accuracy of the model's quadrature by default; its positions are some ten times better."""
_OFFSET = 0.5
"""Tendon offset of the unit finger; tensions are scaled so that any value does."""

Array = NDArray[Any]

APEX = 2e-4
"""Rounding of the apex of spatial friction cones, as a part of the weight; it lies inside the true one."""


@dataclass(frozen=True)
class FingerSpec:
    """Structure of a finger's equations; all else are numbers.

    Attributes
    ----------
    name : str
    family : str
    elements : int
    before : tuple of int
        Elements between base and each middle contact.
    touching : tuple of bool
        Which of the middle contacts are on.
    tip : bool
        Whether the tip touches.
    has_tendon_friction, weighs, preshaped, tip_heavy : bool
        Tendon friction; own weight; rest curvature; a mass on the tip.
    masses : int
        Point masses elsewhere, where the finger weighs.
    strained : bool
        Whether there is a strain limit.
    free : bool
        Whether the base may move.
    bending_range : float
        [rad]
    accuracy : float or None
    """

    name: str
    family: str
    elements: int
    before: tuple[int, ...]
    touching: tuple[bool, ...]
    tip: bool
    has_tendon_friction: bool
    weighs: bool
    preshaped: bool
    tip_heavy: bool
    masses: int
    strained: bool
    free: bool
    bending_range: float
    accuracy: float | None

    @staticmethod
    def of(setup: FingerSetup, on: frozenset[str], weighs: bool) -> FingerSpec:
        """The structure of a finger with some of its contacts on."""
        finger = setup.finger
        return FingerSpec(
            name=setup.name,
            family=setup.family,
            elements=setup.elements,
            before=setup.before,
            touching=tuple(name in on for name in setup.middle_names),
            tip=setup.tip_name in on,
            has_tendon_friction=setup.tendons.friction > 0.0,
            weighs=weighs,
            preshaped=finger.curvature_pieces[0][2] != 0.0,
            tip_heavy=weighs and any(_on_tip(m.at, finger.rod.length) for m in finger.masses),
            masses=len(inner_masses(finger)) if weighs else 0,
            strained=finger.strain_limit is not None,
            free=finger.base_free is not None,
            bending_range=_rounded_up(setup.bending_range),
            accuracy=setup.accuracy,
        )


class UnitFinger:
    """The finger's model and the run-time parameters of it.

    Parameters
    ----------
    spec : FingerSpec
    numbers : Numbers
        Where its numbers are put, under names that begin with the finger's.
    """

    def __init__(self, spec: FingerSpec, numbers: Numbers) -> None:
        self.spec = spec
        self._numbers = numbers
        lengths = (1.0 / spec.elements,) * spec.elements
        ends = [n / spec.elements for n in spec.before]
        parameters = ["element_lengths"]
        parameters += ["gravity"] * spec.weighs + ["rest_curvature"] * spec.preshaped
        parameters += ["tendon_friction"] * spec.has_tendon_friction + ["tip_mass"] * spec.tip_heavy
        self._parameters = tuple(parameters)
        self.model = FingerModel(
            _unit_finger(spec),
            contacts=tuple(ends),
            gravity=(0.0, 0.0),
            family=spec.family,
            elements=lengths,
            bending_range=spec.bending_range,
            accuracy=spec.accuracy or ACCURACY,
            parameters=self._parameters,
            loads=(*(MomentLoad(at=at, moment=0.0) for at in ends), MomentLoad(at=1.0, moment=0.0)),
            tip_force=True,
        )

    def number(self, name: str, size: int = 1) -> ca.SX:
        """A run-time number of this finger."""
        return self._numbers(f"{self.spec.name}.{name}", size)

    def element_lengths(self, joints: Sequence[Any]) -> tuple[Any, ...]:
        """Element lengths for positions of the middle contacts: equal between them."""
        marks, counts = [0.0, *joints, 1.0], [0, *self.spec.before, self.spec.elements]
        lengths: list[Any] = []
        for k in range(len(marks) - 1):
            count = counts[k + 1] - counts[k]
            lengths += [(marks[k + 1] - marks[k]) / count] * count
        return tuple(lengths)

    def parameters(self, lengths: ca.SX, turn: ca.SX) -> ca.SX:
        """The model's run-time argument for element lengths and the base's angle in the world."""
        values = {"element_lengths": lengths}
        if self.spec.weighs:
            values["gravity"] = rotation(-turn) @ self.number("weight", 2)
        for name in ("rest_curvature", "tendon_friction", "tip_mass"):
            if name in self._parameters:
                values[name] = self.number(name)
        return ca.vertcat(*(values[name] for name in self._parameters))

    def input(self, pulls: ca.SX, couple: ca.SX) -> ca.SX:
        """The model's input for tensions, as moments at the tip, and a couple on the tip."""
        return ca.vertcat(pulls / _OFFSET, couple)

    def hanging_masses(self, q: ca.SX, u: ca.SX, p: ca.SX, turn: ca.SX) -> ca.SX:
        """Generalized force of point masses that are not on the tip."""
        force = ca.SX.zeros(self.model.n)
        for k in range(self.spec.masses):
            arm = self.model.jacobian(q, u, self.number(f"mass_{k}.at"), p)
            force += self.number(f"mass_{k}") * arm.T @ rotation(-turn) @ self.number("weight", 2)
        return force

    @cached_property
    def _curvatures(self) -> ca.Function:
        return self.model.curvatures()

    def curvatures(self, q: ca.SX, u: ca.SX, p: ca.SX) -> ca.SX:
        """Curvature of each arc, or at each node of the clothoids."""
        return self._curvatures(q, u, p)[0]

    def curvatures_at_places(self, q: ca.SX, u: ca.SX, p: ca.SX) -> ca.SX:
        """Curvature (degree + 1, N) at the family's places on each element."""
        return self._curvatures(q, u, p)[1]

    def greatest_bends(self, q: ca.SX, u: ca.SX, p: ca.SX) -> ca.SX:
        """Lengths of the elements times the curvatures at the family's places on them."""
        return ca.vec(self._curvatures(q, u, p)[2].T)

    def tip_curvature(self, q: ca.SX, u: ca.SX, p: ca.SX) -> ca.SX:
        """Curvature at the tip; where it is matched, what the moment balance imposes."""
        return self.curvatures_at_places(q, u, p)[-1, -1]

    @property
    def probes(self) -> int:
        """Guarded places per element, where it is deepest: long elements can enter an object at two places."""
        return 2 if self.spec.elements < 4 else 1

    @cached_property
    def waypoint_shares(self) -> list[tuple[int, int]]:
        """Indices and elements of the guarded waypoints: a few of each element, spread evenly."""
        found, start = [], 0
        for element, inside in enumerate(self.model.waypoint_fractions):
            count = min(len(inside), 4 if self.spec.elements > 3 else 6)
            wanted = (np.arange(count) + 0.5) / count
            picks = {int(np.abs(np.array(inside) - at).argmin()) for at in wanted}
            found += [(start + k, element) for k in sorted(picks)]
            start += len(inside)
        return found


def finger_numbers(setup: FingerSetup, gravity: tuple[float, float]) -> dict[str, object]:
    """Values of a unit finger's run-time numbers that do not depend on the problem's scales."""
    finger, name = setup.finger, setup.name
    rod = finger.rod
    own = rod.mass_per_length * rod.length
    values: dict[str, object] = {
        f"{name}.weight": [g * rod.mass_per_length * rod.length**3 / rod.stiffness for g in gravity],
        f"{name}.rest_curvature": finger.curvature_pieces[0][2] * rod.length,
        f"{name}.tendon_friction": setup.tendons.friction,
        f"{name}.tip_mass": sum(m.mass for m in finger.masses if _on_tip(m.at, rod.length)) / own,
        f"{name}.curvature_limit": finger.curvature_limit * rod.length if finger.strain_limit is not None else 0.0,
        f"{name}.bending_range": setup.bending_range,
    }
    for k, mass in enumerate(inner_masses(finger)):
        values |= {f"{name}.mass_{k}": mass.mass / own, f"{name}.mass_{k}.at": mass.at / rod.length}
    return values


def inner_masses(finger: Finger) -> list[PointMass]:
    """Point masses that are not on the tip."""
    return [m for m in finger.masses if not _on_tip(m.at, finger.rod.length)]


def rotation(angle: ca.SX) -> ca.SX:
    """Rotation matrix (2, 2)."""
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(ca.horzcat(c, -s), ca.horzcat(s, c))


def _unit_finger(spec: FingerSpec) -> Finger:
    return Finger(
        rod=Rod(length=1.0, linear_density=1.0, bending_stiffness=1.0),
        rest_curvature=1.0 if spec.preshaped else 0.0,
        masses=(PointMass(at=1.0, mass=1.0),) if spec.tip_heavy else (),
        tendons=Tendons(offset=_OFFSET, max_tension=1.0, friction=0.1 if spec.has_tendon_friction else 0.0),
    )


def _on_tip(at: float, length: float) -> bool:
    return abs(at - length) <= 1e-9 * length


def _rounded_up(angle: float) -> float:
    """A range of the model's own that holds a bending range, one of a few so that scenes share solvers [rad]."""
    return next((r for r in (1.0, 2.1, 3.15, 4.5, 6.3) if angle <= r), angle)


class Numbers:
    """Symbols by name, in the order in which they were asked for."""

    def __init__(self) -> None:
        self._symbols: dict[str, ca.SX] = {}

    def __call__(self, name: str, size: int = 1) -> ca.SX:
        """The symbol of a name; created on the first call."""
        if name not in self._symbols:
            self._symbols[name] = ca.SX.sym(name, size)
        return self._symbols[name]

    @property
    def symbol(self) -> ca.SX:
        """All of them as a column."""
        return ca.vertcat(*self._symbols.values()) if self._symbols else ca.SX(0, 1)

    def pack(self, values: Mapping[str, ArrayLike], default: float | None = None) -> Array:
        """The column of numbers for these values; what is missing is the default, if there is one.

        Raises
        ------
        KeyError
            A number is missing.
        """
        parts = []
        for name, symbol in self._symbols.items():
            if default is not None and name not in values:
                parts.append(np.full(symbol.numel(), default))
                continue
            part = np.asarray(values[name], dtype=float).ravel()
            if part.size != symbol.numel():
                raise KeyError(f"{name}: expected {symbol.numel()} numbers, got {part.size}")
            parts.append(part)
        return np.concatenate(parts) if parts else np.empty(0)
