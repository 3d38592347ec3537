"""Ranges of the numbers that a package takes, and sizes of usual ones for its test vectors."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from continuum_grasp.base import InputError
from continuum_grasp.export.fields import Field, fill, identifiers
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.model import Equations, FingerModel, System
from continuum_grasp.scene import Pull

_USUAL_RATE = 10.0
"""Bending ranges per second of usual motions."""
_SPREAD = 2.0
"""Factor up and down from its nominal value that a parameter may take by default."""


_SIGNED = ("base_position", "object_", "base_angle", "gravity", "rest_curvature")
"""Parameters that may be below zero."""


@dataclass(frozen=True)
class ModelFields:
    """Entries of the vectors of a finger, or of one with its object: their ranges, and sizes of usual values."""

    moving: FingerModel | System

    @property
    def finger(self) -> FingerModel:
        """Model of the finger."""
        return self.moving.finger_model if isinstance(self.moving, System) else self.moving

    def parameters(self, given: Mapping[str, Sequence[float]] | None = None) -> tuple[Field, ...]:
        """Entries of the parameters, in ranges (least, greatest) that are given by name, or in usual ones.

        InputError if a range is none, goes below zero where the parameter cannot, leaves out the nominal value, is for
        no parameter, or is missing where the nominal value of zero gives no scale.
        """
        ranges = given or {}
        fields = []
        for field, nominal in zip(_fields(self.finger, self.moving.p_names), self.moving.p_nominal, strict=True):
            if field.name in ranges:
                low, high = _given(field.name, ranges[field.name])
            else:
                low, high = _usual(field.name, nominal, self.finger)
            if low < 0.0 and not field.name.startswith(_SIGNED):
                raise InputError(f"it cannot be negative, got a range from {low:g}", key=f"ranges.{field.name}")
            if not low <= nominal <= high:
                message = f"range {low:g} to {high:g} leaves out the nominal value {nominal:g} {field.unit}"
                raise InputError(message, key=f"ranges.{field.name}")
            fields.append(field.within(low, high, max(abs(low), abs(high))))
        unknown = sorted(set(ranges) - {field.name for field in fields})
        if unknown:
            names = ", ".join(field.name for field in fields) or "none"
            raise InputError(f"{unknown[0]!r} is not a run-time parameter of this model (it has {names})", key="ranges")
        return tuple(fields)

    def states(self, parameters: Sequence[Field] = ()) -> tuple[Field, ...]:
        """Entries of the state: bends within their ranges, rates, drives and friction states around usual ones.

        The ranges of ``parameters`` limit the bends.
        """
        model = self.finger
        lows, highs = _bounds(model, parameters)
        reach = [max(-low, high) for low, high in zip(lows, highs, strict=True)]
        states = identifiers(model.friction_names)
        stiffness = _greatest(parameters, "bending_stiffness", model.finger.rod.stiffness)
        # E I / L times an angle is the moment that bends the whole rod by it.
        usual_moment = stiffness * max(model.ranges) / model.finger.rod.length
        fields = []
        for k, field in enumerate(_fields(model, model.x_names)):
            if k < model.n:
                fields.append(field.within(lows[k], highs[k], reach[k]))
            elif k < 2 * model.n:
                fields.append(field.around(_USUAL_RATE * reach[k - model.n]))
            elif field.name in states:
                fields.append(field.around(model.structure.stiffest_friction[-1]))  # of a tendon that slides
            else:
                rate = field.name.endswith("_rate")
                size = _usual_drive(model, field.name.removesuffix("_rate")) or usual_moment
                fields.append(field.around(size * (_USUAL_RATE if rate else 1.0)))
        return (*fields, *_object_fields(model, self.moving.x_names[model.nx :], model.finger.rod.length))

    def inputs(self) -> tuple[Field, ...]:
        """Entries of the input: tensions from zero on, up to the greatest; pressures and torques in theirs."""
        model = self.finger
        usual_moment = model.finger.rod.stiffness * max(model.ranges) / model.finger.rod.length
        fields = []
        for field in _fields(model, model.u_names):
            size = _usual_drive(model, field.name)
            drive = re.fullmatch(_DRIVE, field.name)
            if size is None or drive is None:
                fields.append(field.around(usual_moment))
            elif drive[1] in ("tension", "pressure"):
                least, greatest, *_ = _pulled(model, drive)
                fields.append(field.within(min(least, 0.0), max(greatest, 0.0), size))
            else:
                high = model.structure.winches[int(drive[2]) - 1].drive.limit
                limited = math.isfinite(high)
                fields.append(field.within(-high, high, size) if limited else field.around(size))
        return tuple(fields)

    def forces(self) -> tuple[Field, ...]:
        """Entries of the forces, around those that bend the whole finger; then those on an object, and its table."""
        model = self.finger
        rod = model.finger.rod
        usual = {"N": rod.stiffness / rod.length**2, "N m": rod.stiffness / rod.length}
        finger_fields = tuple(field.around(usual[field.unit]) for field in _fields(model, model.w_names))
        return (*finger_fields, *_object_fields(model, self.moving.w_names[model.nw :], _HEIGHT))


_USUAL_OBJECT = {"rad": math.pi, "m/s": 0.1, "rad/s": 1.0, "1": 1.5, "N": 1.0, "N m": 0.01}
"""Sizes of usual values of an object and its contacts by unit."""
_HEIGHT = 1e-3
"""Range of heights over the table [m]."""


def _object_fields(model: FingerModel, labels: Sequence[str], reach: float) -> Iterator[Field]:
    """Entries of an object and its contacts around usual sizes; lengths are usually up to ``reach`` [m]."""
    for field in _fields(model, labels):
        usual = _USUAL_OBJECT.get(field.unit, reach)
        if field.name == "object_z":
            usual = _HEIGHT
        yield field.around(usual)


def _usual_drive(model: FingerModel, name: str) -> float | None:
    """Size of usual tensions, pressures, lengths, angles and torques; None of something else."""
    match = re.fullmatch(_DRIVE, name)
    if match is None:
        return None
    kind = match[1]
    number = int(match[2]) - 1
    if kind in ("tension", "pressure"):
        least, greatest, channel, arm = _pulled(model, match)
        usual_moment = model.finger.rod.stiffness * max(model.ranges) / model.finger.rod.length
        return min(max(-least, greatest), usual_moment / abs(channel.gain * arm))
    winch = model.structure.winches[number]
    if kind == "torque":
        return winch.drive.limit if math.isfinite(winch.drive.limit) else None
    tendon = model.finger.tendon_list[winch.tendons[0]]
    bend = tendon.greatest_offset * sum(model.ranges)
    return float((bend + tendon.max_tension / winch.stiffness) / winch.radius)


def _fields(model: FingerModel, labels: Sequence[str]) -> list[Field]:
    """Entries of a model's vector, from its labels ``name [unit]``."""
    return [replace(field, text=_description(model, field.name)) for field in Field.named(labels)]


def _bounds(model: FingerModel, parameters: Sequence[Field]) -> tuple[list[float], list[float]]:
    """Return the least and greatest value of each coordinate within the bending ranges."""
    lengths = [_greatest(parameters, f"element_lengths_{k + 1}", h) for k, h in enumerate(model.lengths)]
    if len(lengths) == 1:
        lengths = [_greatest(parameters, "element_lengths", lengths[0])]
    return model.structure.coordinate_bounds(lengths)


def _greatest(parameters: Sequence[Field], name: str, value: float) -> float:
    return next((field.high for field in parameters if field.name == name), value)


def _given(name: str, pair: Sequence[float]) -> tuple[float, float]:
    low, high = (float(v) for v in pair) if len(pair) == 2 else (math.nan, math.nan)
    if not -math.inf < low <= high < math.inf:
        raise InputError(f"expected a least and a greatest value, got {tuple(pair)!r:.60}", key=f"ranges.{name}")
    return low, high


def _usual(name: str, nominal: float, model: FingerModel) -> tuple[float, float]:
    if name.startswith(("base_position", "object_")):
        reach = 2.0 * model.finger.rod.length
        return nominal - reach, nominal + reach
    if name == "base_angle":
        return -2.0 * math.pi, 2.0 * math.pi
    if name.startswith("gravity"):  # twice the earth's, either way
        return -max(20.0, 2.0 * abs(nominal)), max(20.0, 2.0 * abs(nominal))
    if name == "tendon_friction":
        return 0.0, max(0.5, _SPREAD * nominal)
    if "mass" in name:
        return 0.0, max(_SPREAD * nominal, model.finger.rod.mass_per_length * model.finger.rod.length)
    if name == "rest_curvature":
        bound = max(_SPREAD * abs(nominal), 0.5 * min(model.ranges) / max(model.lengths))
        return -bound, bound
    if nominal <= 0.0:
        raise InputError("its nominal value is zero: give its least and greatest value", key=f"ranges.{name}")
    return nominal / _SPREAD, _SPREAD * nominal


CONTACT_FORCE = "contact_force"
"""Name under which a range of the forces of contacts is given [N]."""


def contact_depth(system: System, given: Sequence[float] | None) -> float:
    """Greatest depth that a contact is pressed in [m]: by a given greatest force, or by drives and weight.

    Steps are as short as contacts up to that depth ask for; friction of one that bears more is stiffer.
    """
    touch_law = system.touch_law
    if touch_law is None:
        return 0.0
    if given is not None:
        low, force = _given(CONTACT_FORCE, given)
        if low != 0.0 or force <= 0.0:
            raise InputError(f"expected 0 and a force above it, got {low:g}:{force:g}", key=f"ranges.{CONTACT_FORCE}")
    else:
        force = system.greatest_press
    return max(force / touch_law.law.stiffness, 2.0 * touch_law.rounding)


@dataclass(frozen=True)
class JointRange:
    """A range of several numbers together: of a matched tip's curvature, of tensions that winches and motors leave, and
    of the depth of contacts.

    Steps are as short as tensions up to ``max_tension`` and contacts up to their greatest force ask for. Beyond,
    friction is stiffer than what was looked at.
    """

    guard: Kernel | None = None
    """(x, u, p) -> use, the share of its range that it takes; None where a range of one number says the same."""
    limits: dict[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    """Joint range of a model, by the name of the number."""
    notes: dict[str, str] = dataclasses.field(default_factory=dict)
    """The condition as a sentence with the numbers of nominal parameters, by the struct (state, input) it is of."""

    @staticmethod
    def of(model: FingerModel, equations: Equations, pressed: float = 0.0) -> JointRange:
        """Joint range of a model; empty where the tip is not matched, tensions are commanded, and nothing is touched.

        ``pressed`` is the greatest depth of contacts [m].
        """
        limits: dict[str, tuple[float, float]] = {}
        use = None
        text = ""
        notes = dict[str, str]()
        if model.structure.winches:
            use, text, notes = _of_tensions(model, equations)
        elif model.structure.matched:
            use, text, notes, limits = _of_curvature(model, equations)
        # The height of a table, which a contact may depend on, is no number that every function takes.
        gaps = [
            p.gap for p in equations.contacts.pairs if p.load is None and not ca.depends_on(ca.SX(p.gap), equations.w)
        ]
        if gaps:
            depth = functools.reduce(ca.fmax, [(-1.0 / pressed) * gap for gap in gaps], ca.SX(0.0))
            use = depth if use is None else ca.fmax(ca.fabs(use), depth)
            text = "Share of its range that the deepest contact takes, or what else is limited jointly."
            note = f" Contacts must be in their range, up to a depth of {pressed:.3g} m."
            notes = {**notes, "state": notes.get("state", "") + note}
        if use is None:
            return JointRange(limits=limits)
        function = ca.Function("range_use", [equations.x, equations.u, equations.p], [use], ["x", "u", "p"], ["use"])
        return JointRange(Kernel("range_use", function, text), limits, notes)

    def bounded(self, fields: tuple[Field, ...]) -> tuple[Field, ...]:
        """Entries of a struct, with the range of the number that sets the curvature."""
        return tuple(
            replace(f, low=self.limits[f.name][0], high=self.limits[f.name][1]) if f.name in self.limits else f
            for f in fields
        )


def _of_tensions(model: FingerModel, equations: Equations) -> tuple[ca.SX, str, dict[str, str]]:
    """Share that the greatest tension takes of its greatest, what it is in words, and the condition."""
    tendons = model.finger.tendon_list
    use = ca.SX(0.0)
    for tension, tendon in zip(equations.moving.tendons.tensions, tendons, strict=True):
        use = ca.fmax(use, (1.0 / tendon.max_tension) * tension)
    limits = ", ".join(f"{tendon.max_tension:g} N" for tendon in tendons)
    note = f" Tensions that follow from it must be in their range, up to {limits} (max_tension)."
    return ca.cse(use), "Share of its greatest that the greatest tension takes.", {"state": note}


def _of_curvature(
    model: FingerModel, equations: Equations
) -> tuple[ca.SX | None, str, dict[str, str], dict[str, tuple[float, float]]]:
    """Share that the curvature of a matched tip takes of its range, or the range of the one number that sets it."""
    use = ca.SX(equations.full[-1]) * equations.lengths[-1] / model.ranges[-1]
    variables = ca.vertcat(equations.x, equations.u)
    slopes = ca.Function("slopes", [variables, equations.p], [ca.jacobian(use, variables), use])
    nominal = np.pad(model.p_nominal, (0, equations.p.numel() - model.np))
    slope, rest = (np.array(value).ravel() for value in slopes(np.zeros(variables.numel()), nominal))
    count = equations.x.numel()
    names = [*identifiers(model.x_names), *[""] * (count - model.nx), *identifiers(model.u_names)]
    # The curvature is linear in state and input: its range is that of one number, or a half-space condition.
    acting = np.flatnonzero(slope)
    if len(acting) == 1 and not ca.depends_on(use, equations.p):
        at = acting[0]  # -1 <= rest + slope x <= 1, solved for x
        low, high = sorted(((-1.0 - rest[0]) / slope[at], (1.0 - rest[0]) / slope[at]))
        return None, "", {}, {names[at]: (float(low), float(high))}
    terms = " ".join(f"{slope[at]:+.6g} {names[at]}" for at in acting)
    constant = f" {rest[0]:+.6g}" if rest[0] else ""
    at_nominal = " with nominal parameters" if ca.depends_on(use, equations.p) else ""
    note = f" The curvature of the tip must be in its range: -1 <= {terms.strip('+')}{constant} <= 1{at_nominal}."
    text = "Share of its bending range that the curvature of the tip takes."
    return use, text, {"state" if at < count else "input": note for at in acting}, {}


_DRIVE = r"(tension|pressure|length|motor_angle|torque|angle)_(\d+)"


def _pulled(model: FingerModel, drive: re.Match[str]) -> Pull:
    """By what the command of a tendon or a chamber bends the finger."""
    finger = model.finger
    place = int(drive[2]) - 1 + (len(finger.tendon_list) if drive[1] == "pressure" else 0)
    return finger.pulls[place]


def _description(model: FingerModel, name: str) -> str:
    """Description of a number; empty where its name says it."""
    contact = re.fullmatch(r"contact_(\d+)_[xy]", name)
    if contact:
        return f"world force at contact {contact[1]}, {model.contacts[int(contact[1]) - 1]:g} m along the finger"
    mass = re.fullmatch(r"mass_(\d+)", name)
    if mass:
        return f"at {model.finger.masses[int(mass[1])].at:g} m along the finger"
    drive = re.fullmatch(_DRIVE, name)
    if drive and drive[1] == "pressure":
        chamber = model.finger.chambers[int(drive[2]) - 1]
        to = model.finger.rod.length if chamber.to is None else chamber.to
        way = "positively" if chamber.arm > 0.0 else "negatively"
        return f"chamber from {chamber.start:g} to {to:g} m along the finger, which bends it {way}"
    if drive and drive[1] == "tension":
        *_, channel, arm = _pulled(model, drive)
        side = "base's -X side, which bends positively" if arm > 0.0 else "other side"
        end = f", up to {channel.to:g} m" if channel.to < model.finger.rod.length else ""
        return f"tendon on the {side}{end}"
    for line in fill("descriptions.txt", {}).splitlines():
        pattern, _, text = line.partition(": ")
        match = re.fullmatch(pattern, name)
        if match:
            return text.format(*(group or "" for group in match.groups()))
    return ""
