"""Model parameters: constants that are folded into the expressions, or run-time arguments that the user names."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from copy import copy

import casadi as ca

from continuum_grasp.errors import InputError
from continuum_grasp.model.laws import numbers_of
from continuum_grasp.model.planar import Scalar
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.tendons import Tendon, Tendons

_UNITS = {
    "base_position": "m",
    "base_angle": "rad",
    "gravity": "m/s2",
    "element_lengths": "m",
    "linear_density": "kg/m",
    "bending_stiffness": "N m2",
    "rotary_inertia": "kg m",
    "material_damping": "N m2 s",
    "per_arc_damping": "N m s",
    "rest_curvature": "1/m",
    "tendon_offset": "m",
    "tendon_friction": "1",
    "tendon_presliding": "m",
    "tendon_axial_stiffness": "N",
    "tendon_series_stiffness": "N/m",
    "chamber_area": "m2",
    "drive_time_constant": "s",
    "drive_pretension": "N",
    "drive_slack": "m",
    "drive_inertia": "kg m2",
    "drive_viscous_friction": "N m s",
    "drive_coulomb_friction": "N m",
    "tip_mass": "kg",
    "tip_body_mass": "kg",
    "tip_body_inertia": "kg m2",
    "tip_body_across": "m",
    "tip_body_along": "m",
}
_VECTORS = ("base_position", "gravity")
"""Parameters with an entry for each axis of the world."""
FACTORS = ("linear_density", "bending_stiffness", "rotary_inertia")
"""Parameters that are factors of the profile [1] where the rod is graded."""
OF_TENDONS = tuple(name for name in _UNITS if name.startswith(("tendon_", "drive_")) and name != "tendon_offset")
"""Parameters of every tendon, or of its drive, by the key there after the prefix."""


class Parameters:
    """Nominal values and, of those with ``names``, symbols: they stay run-time arguments, in this order in ``p``."""

    def __init__(
        self, finger: Finger, gravity: tuple[float, float], lengths: Sequence[float], names: Sequence[str]
    ) -> None:
        self._graded = finger.profile.graded
        self._units = _UNITS | {name: number.unit for name, number in numbers_of(finger).items()}
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
            unit = "1" if self._graded and name in FACTORS else self._units.get(name, "kg")
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
    rod, length, graded = finger.rod, finger.rod.length, finger.profile.graded
    values = {
        "base_position": list(finger.base.position),
        "base_angle": [finger.base.angle],
        "gravity": [float(g) for g in gravity],
        "element_lengths": [float(h) for h in lengths],
        "linear_density": [1.0 if graded else rod.mass_per_length],
        "bending_stiffness": [1.0 if graded else float(finger.profile.bending_stiffness(0.0))],
        "rotary_inertia": [1.0 if graded else rod.inertia_per_length],
        "material_damping": [finger.damping.material],
        "per_arc_damping": [finger.damping.per_arc],
        "tip_mass": [sum(m.mass for m in finger.masses if at_tip(m.at, length))],
    }
    if finger.tip_body is not None:
        across, along = finger.tip_body.center_of_mass
        values["tip_body_mass"], values["tip_body_inertia"] = [finger.tip_body.mass], [finger.tip_body.rotary_inertia]
        values["tip_body_across"], values["tip_body_along"] = [across], [along]
    for k, mass in enumerate(finger.masses):
        if not at_tip(mass.at, length):
            values[f"mass_{k}"] = [mass.mass]
    if isinstance(finger.tendons, Tendons):
        values["tendon_offset"] = [finger.tendons.offset]
    values |= {name: [number.value] for name, number in numbers_of(finger).items()}
    for name in OF_TENDONS:
        own = {_of_tendon(tendon, name) for tendon in finger.tendon_list}
        if name == "drive_time_constant":
            own |= {chamber.time_constant for chamber in finger.chambers}
        if len(own) == 1 and own != {None}:
            values[name] = [value for value in own if value is not None]
    areas = {chamber.area for chamber in finger.chambers}
    if len(areas) == 1:
        values["chamber_area"] = [*areas]
    if finger.profile.rest_curvature.constant is not None:
        values["rest_curvature"] = [finger.profile.rest_curvature.constant]
    return {name: [float(v) for v in value] for name, value in values.items()}


def _of_tendon(tendon: Tendon, name: str) -> float | None:
    """Value behind a name of ``OF_TENDONS``; None where the tendon has none."""
    owner, _, key = name.partition("_")
    if name == "drive_time_constant" and tendon.drive is None:
        return tendon.time_constant
    if key == "presliding" and tendon.friction == 0.0:
        return None
    value = getattr(tendon if owner == "tendon" else tendon.drive, key, None)
    return None if value is None else float(value)


def at_tip(at: float, length: float) -> bool:
    """Whether a position is the tip."""
    # The tolerance of ``layout``: above the rounding of sums of lengths.
    return abs(at - length) <= 1e-9 * length
