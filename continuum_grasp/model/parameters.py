"""Options of a model, and its parameters: constants that are folded into the expressions, or run-time arguments that
the user names.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from operator import attrgetter
from typing import Any, TypedDict

import casadi as ca
import numpy as np

from continuum_grasp.base import CheckedArgument, InputError, nearest
from continuum_grasp.model.laws import numbers_of as numbers_of_laws
from continuum_grasp.model.laws.section import POSITIVE, Number, places_of
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene import FAMILIES, Finger, FingerScene, ForceLoad, MomentLoad

_ANY = -math.inf
_KNOWN: dict[str, tuple[str, str, float]] = {
    "base_position": ("m", "base.position", _ANY),
    "base_angle": ("rad", "base.angle", _ANY),
    "gravity": ("m/s2", "", _ANY),
    "element_lengths": ("m", "", POSITIVE),
    "linear_density": ("kg/m", "", POSITIVE),
    "bending_stiffness": ("N m2", "", POSITIVE),
    "rotary_inertia": ("kg m", "", 0.0),
    "material_damping": ("N m2 s", "damping.material", 0.0),
    "per_arc_damping": ("N m s", "damping.per_arc", 0.0),
    "rest_curvature": ("1/m", "rest_curvature", _ANY),
    "tendon_offset": ("m", "tendons.offset", POSITIVE),
    "tendon_friction": ("1", "tendons*.friction", 0.0),
    "tendon_presliding": ("m", "tendons*.presliding", POSITIVE),
    "tendon_axial_stiffness": ("N", "tendons*.axial_stiffness", POSITIVE),
    "tendon_series_stiffness": ("N/m", "tendons*.series_stiffness", POSITIVE),
    "chamber_area": ("m2", "pressure*.area", 0.0),
    "drive_time_constant": ("s", "tendons*.time_constant pressure*.time_constant", POSITIVE),
    "drive_pretension": ("N", "tendons*.drive.pretension", 0.0),
    "drive_slack": ("m", "tendons*.drive.slack", 0.0),
    "drive_inertia": ("kg m2", "tendons*.drive.inertia", POSITIVE),
    "drive_viscous_friction": ("N m s", "tendons*.drive.viscous_friction", 0.0),
    "drive_coulomb_friction": ("N m", "tendons*.drive.coulomb_friction", 0.0),
    "tip_mass": ("kg", "", 0.0),
    "tip_body_mass": ("kg", "tip_body.mass", 0.0),
    "tip_body_inertia": ("kg m2", "tip_body.rotary_inertia", 0.0),
    "tip_body_across": ("m", "tip_body.center_of_mass[0]", _ANY),
    "tip_body_along": ("m", "tip_body.center_of_mass[1]", _ANY),
}
"""Unit of each parameter, its keys in a finger, and its least value, as in ``Number``."""
_VECTORS = ("base_position", "gravity")
"""Parameters with an entry for each axis of the world."""
_FACTORS = ("linear_density", "bending_stiffness", "rotary_inertia")
"""Parameters that are factors of the profile [1] where the rod is graded."""


class Parameters:
    """Nominal values, and symbols of those with ``names``: these stay run-time arguments, in this order in ``p``."""

    def __init__(
        self, finger: Finger, gravity: tuple[float, float], lengths: Sequence[float], names: Sequence[str]
    ) -> None:
        self._graded = finger.profile.graded
        self._units = {name: number.unit for name, number in self.numbers_of(finger).items()}
        self._nominal = self.nominal_values(finger, gravity, lengths)
        for k, name in enumerate(names):
            if name not in self._nominal:
                hint = nearest(name, self._nominal, say_all=False)
                message = f"unknown parameter {name!r:.60}{hint} (this finger has {', '.join(sorted(self._nominal))})"
                raise InputError(message, key=f"parameters[{k}]")
            if name in names[:k]:
                message = f"parameter {name!r} is repeated: expected each once, got {list(names)}"
                raise InputError(message, key=f"parameters[{k}]")
        self.names = tuple(names)
        self._symbols = {name: ca.SX.sym(name, len(self._nominal[name])) for name in names}

    def extended(self, more: Mapping[str, tuple[str, float]]) -> Parameters:
        """A copy with further run-time arguments, whose units and nominal values are given by name."""
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

    def nominal_of(self, name: str) -> list[float]:
        """Nominal entries of one parameter."""
        return list(self._nominal[name])

    @property
    def labels(self) -> list[str]:
        """Name and unit of each entry of ``p``."""
        labels = []
        for name in self.names:
            count = len(self._nominal[name])
            unit = "1" if self._graded and name in _FACTORS else self._units[name]
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

    @staticmethod
    def numbers_of(finger: Finger) -> dict[str, Number]:
        """Numbers of a finger that may be run-time arguments, by name."""
        rod, profile, tendons = finger.rod, finger.profile, finger.tendon_list
        presliding = {tendon.presliding_length if tendon.friction else None for tendon in tendons}
        known = {
            "linear_density": 1.0 if profile.graded else rod.mass_per_length,
            "bending_stiffness": 1.0 if profile.graded else float(profile.bending_stiffness(0.0)),
            "rotary_inertia": 1.0 if profile.graded else rod.inertia_per_length,
            "rest_curvature": profile.rest_curvature.constant,
            "tip_mass": sum(mass.mass for mass in finger.masses if rod.is_tip(mass.at)),
            "tendon_presliding": presliding.pop() if len(presliding) == 1 and finger.has_tendon_friction else None,
        }
        numbers = numbers_of_laws(finger)
        for name, (unit, key, least) in _KNOWN.items():
            keys = key.replace("*.time", "*.drive.time", 1) if finger.winches else key
            # The common value of all; none if they differ.
            values = {finger.entry(place) for place in places_of(finger, keys)}
            numbers[name] = Number(unit, known.get(name, values.pop() if len(values) == 1 else None), keys, least)
        for k, mass in enumerate(finger.masses):
            if not rod.is_tip(mass.at):
                numbers[f"mass_{k}"] = Number("kg", mass.mass, f"masses[{k}].mass", 0.0)
        return numbers

    @staticmethod
    def nominal_values(
        finger: Finger, gravity: tuple[float, float], lengths: Sequence[float]
    ) -> dict[str, list[float]]:
        """Values of all parameters that a finger has, by name."""
        values = {name: number.value for name, number in Parameters.numbers_of(finger).items()}
        values |= {"gravity": gravity, "element_lengths": lengths}
        return {name: np.ravel(value).astype(float).tolist() for name, value in values.items() if value is not None}


class ModelOptions(TypedDict, total=False):
    """Keywords of ``FingerModel`` and ``System``, described there; None counts as absent."""

    contacts: Sequence[float] | None
    gravity: Sequence[float] | None
    family: str | None
    elements: int | Sequence[float] | None
    bending_range: float | None
    reached: Sequence[float] | None
    accuracy: float | None
    parameters: Sequence[str] | None
    loads: Sequence[ForceLoad | MomentLoad] | None
    tip_force: bool | None
    input_rates: bool | None
    slack_stiffness: float | None


_IN_SCENE = {
    **{name: name for name in ("contacts", "gravity", "parameters", "loads")},
    **{name: f"fidelity.{name}" for name in ("family", "elements", "bending_range", "accuracy")},
}
"""Path in a scene of a value that is also an option."""


class Choices:
    """Options of a model, completed from its scene."""

    def __init__(self, given: FingerScene | Finger, options: ModelOptions) -> None:
        if unknown := sorted(options.keys() - ModelOptions.__annotations__.keys()):
            known = ", ".join(ModelOptions.__annotations__)
            raise TypeError(f"unknown option {unknown[0]!r} of a model: expected some of {known}")
        self.scene = given.simulated if isinstance(given, FingerScene) else None
        self.finger: Finger = given.finger if isinstance(given, FingerScene) else given
        self._options = {name: tuple(v) if isinstance(v, Iterator) else v for name, v in options.items()}

    def __getitem__(self, name: str) -> Any:
        """The option, by default the scene's, or None."""
        value = self._options.get(name)
        if value is None and self.scene is not None and name in _IN_SCENE:
            value = attrgetter(_IN_SCENE[name])(self.scene)
        return value

    def given(self, *names: str) -> bool:
        """Whether one of the options was given."""
        return any(self._options.get(name) is not None for name in names)

    def located(self, error: InputError) -> InputError:
        """Return the error with the path in the scene instead of an option that was not given."""
        name = re.match(r"\w*", error.key or "")
        word = name.group() if name else ""
        if not error.key or self.scene is None or self._options.get(word) is not None:
            return error
        return InputError(error.message, key=_IN_SCENE.get(word, word) + error.key[len(word) :])

    def numbers(self, name: str) -> tuple[float, ...] | None:
        if self[name] is None:
            return None
        numbers = CheckedArgument(name, self[name]).array()
        if numbers.ndim != 1 or not np.all(np.isfinite(numbers)):
            raise CheckedArgument(name, self[name]).refused("expected a list of finite numbers")
        return tuple(numbers.tolist())

    @property
    def family(self) -> str | None:
        return None if self["family"] is None else str(CheckedArgument("family", self["family"]).choice(FAMILIES))
