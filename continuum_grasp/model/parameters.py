"""Model parameters: constants that are folded into the expressions, or run-time arguments that the user names."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from copy import copy
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.errors import InputError
from continuum_grasp.model.laws import numbers_of
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene.finger import Finger, TipBody
from continuum_grasp.scene.tendons import Tendons


def _one(values: Iterable[float | None]) -> float | None:
    """The value of all; None where they differ, or where one has none."""
    found = set(values)
    return found.pop() if len(found) == 1 else None


def _of_rod(of: Callable[[Finger], float]) -> Callable[[Finger], float]:
    return lambda f: 1.0 if f.profile.graded else of(f)


def _of_tip_body(of: Callable[[TipBody], float]) -> Callable[[Finger], float | None]:
    return lambda f: None if f.tip_body is None else of(f.tip_body)


def _of_tendons(key: str) -> Callable[[Finger], float | None]:
    return lambda f: _one(getattr(tendon, key) for tendon in f.tendon_list)


def _of_drives(key: str) -> Callable[[Finger], float | None]:
    return lambda f: _one(getattr(tendon.drive, key, None) for tendon in f.tendon_list)


def _time_constants(f: Finger) -> Iterator[float | None]:
    """Of drives, of commanded tensions, and of pressures."""
    yield from (getattr(tendon.drive or tendon, "time_constant", None) for tendon in f.tendon_list)
    yield from (chamber.time_constant for chamber in f.chambers)


_KNOWN: dict[str, tuple[str, Callable[[Finger], Any]]] = {
    "base_position": ("m", lambda f: f.base.position),
    "base_angle": ("rad", lambda f: f.base.angle),
    "gravity": ("m/s2", lambda f: None),
    "element_lengths": ("m", lambda f: None),
    "linear_density": ("kg/m", _of_rod(lambda f: f.rod.mass_per_length)),
    "bending_stiffness": ("N m2", _of_rod(lambda f: float(f.profile.bending_stiffness(0.0)))),
    "rotary_inertia": ("kg m", _of_rod(lambda f: f.rod.inertia_per_length)),
    "material_damping": ("N m2 s", lambda f: f.damping.material),
    "per_arc_damping": ("N m s", lambda f: f.damping.per_arc),
    "rest_curvature": ("1/m", lambda f: f.profile.rest_curvature.constant),
    "tendon_offset": ("m", lambda f: f.tendons.offset if isinstance(f.tendons, Tendons) else None),
    "tendon_friction": ("1", _of_tendons("friction")),
    "tendon_presliding": ("m", lambda f: _one(t.presliding if t.friction else None for t in f.tendon_list)),
    "tendon_axial_stiffness": ("N", _of_tendons("axial_stiffness")),
    "tendon_series_stiffness": ("N/m", _of_tendons("series_stiffness")),
    "chamber_area": ("m2", lambda f: _one(chamber.area for chamber in f.chambers)),
    "drive_time_constant": ("s", lambda f: _one(_time_constants(f))),
    "drive_pretension": ("N", _of_drives("pretension")),
    "drive_slack": ("m", _of_drives("slack")),
    "drive_inertia": ("kg m2", _of_drives("inertia")),
    "drive_viscous_friction": ("N m s", _of_drives("viscous_friction")),
    "drive_coulomb_friction": ("N m", _of_drives("coulomb_friction")),
    "tip_mass": ("kg", lambda f: sum(mass.mass for mass in f.masses if at_tip(mass.at, f.rod.length))),
    "tip_body_mass": ("kg", _of_tip_body(lambda body: body.mass)),
    "tip_body_inertia": ("kg m2", _of_tip_body(lambda body: body.rotary_inertia)),
    "tip_body_across": ("m", _of_tip_body(lambda body: body.center_of_mass[0])),
    "tip_body_along": ("m", _of_tip_body(lambda body: body.center_of_mass[1])),
}
"""Unit and value of each parameter, or values; None where a finger has none, or where they are not of a finger."""
_VECTORS = ("base_position", "gravity")
"""Parameters with an entry for each axis of the world."""
_FACTORS = ("linear_density", "bending_stiffness", "rotary_inertia")
"""Parameters that are factors of the profile [1] where the rod is graded."""


class Parameters:
    """Nominal values and, of those with ``names``, symbols: they stay run-time arguments, in this order in ``p``."""

    def __init__(
        self, finger: Finger, gravity: tuple[float, float], lengths: Sequence[float], names: Sequence[str]
    ) -> None:
        self._graded = finger.profile.graded
        self._units = {name: unit for name, (unit, _) in _KNOWN.items()}
        self._units |= {name: number.unit for name, number in numbers_of(finger).items()}
        self._nominal = nominal_values(finger, gravity, lengths)
        for k, name in enumerate(names):
            if name not in self._nominal:
                near = difflib.get_close_matches(name, self._nominal, n=1)
                hint = f"; did you mean {near[0]}?" if near else ""
                message = f"unknown parameter {name!r:.60}{hint} (this finger has {', '.join(sorted(self._nominal))})"
                raise InputError(message, key=f"parameters[{k}]")
            if name in names[:k]:
                message = f"parameter {name!r} is repeated: expected each once, got {list(names)}"
                raise InputError(message, key=f"parameters[{k}]")
        self.names = tuple(names)
        self._symbols = {name: ca.SX.sym(name, len(self._nominal[name])) for name in names}

    def extended(self, more: Mapping[str, tuple[str, float]]) -> Parameters:
        """The same with further run-time arguments, of which units and nominal values are given by name."""
        made = copy(self)
        made.names = (*self.names, *more)
        made._units = self._units | {name: unit for name, (unit, _) in more.items()}
        made._nominal = self._nominal | {name: [value] for name, (_, value) in more.items()}
        made._symbols = self._symbols | {name: ca.SX.sym(name) for name in more}
        return made

    @property
    def symbol(self) -> ca.SX:
        """The argument ``p`` as a column."""
        return ca.vertcat(*self._symbols.values()) if self._symbols else ca.SX.sym("p", 0)

    @property
    def nominal(self) -> list[float]:
        """Nominal values of ``p``."""
        return [value for name in self.names for value in self._nominal[name]]

    @property
    def labels(self) -> list[str]:
        """Name and unit of each entry of ``p``."""
        labels = []
        for name in self.names:
            count = len(self._nominal[name])
            unit = "1" if self._graded and name in _FACTORS else self._units.get(name, "kg")
            ends = "xy" if name in _VECTORS else range(1, count + 1)
            tags = [name] if count == 1 else [f"{name}_{end}" for end in ends]
            labels += [f"{tag} [{unit}]" for tag in tags]
        return labels

    def is_runtime(self, name: str) -> bool:
        """Whether a parameter is a run-time argument."""
        return name in self._symbols

    def vector(self, name: str) -> list[Scalar]:
        """All entries of a parameter, floats or symbols."""
        if name in self._symbols:
            symbol = self._symbols[name]
            return [symbol[k] for k in range(symbol.numel())]
        return list(self._nominal[name])

    def __getitem__(self, name: str) -> Scalar:
        return self.vector(name)[0]


def nominal_values(finger: Finger, gravity: tuple[float, float], lengths: Sequence[float]) -> dict[str, list[float]]:
    """Values of all parameters that a finger has, by name."""
    values = {name: of(finger) for name, (_, of) in _KNOWN.items()}
    values |= {"gravity": gravity, "element_lengths": lengths}
    outside = ((k, mass) for k, mass in enumerate(finger.masses) if not at_tip(mass.at, finger.rod.length))
    values |= {f"mass_{k}": mass.mass for k, mass in outside}
    values |= {name: number.value for name, number in numbers_of(finger).items()}
    return {name: np.ravel(value).astype(float).tolist() for name, value in values.items() if value is not None}


def at_tip(at: float, length: float) -> bool:
    """Whether a position is the tip."""
    # The tolerance of ``layout``: above the rounding of sums of lengths.
    return abs(at - length) <= 1e-9 * length
