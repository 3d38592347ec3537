"""Goals of a plan as functions of the last state and input."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from continuum_grasp.addons.planning.motion import PlannedMotion
from continuum_grasp.addons.planning.shooting import Term, derived
from continuum_grasp.base import Array, InputError
from continuum_grasp.nlp import Violation

MET = 1e-5
"""Error of a goal, per its scale, with which it counts as reached where it has no weight, and excess of a bound, in
units of the problem, that counts as none [1]."""
PRESSES = 0.1
"""Share of a force from which on a contact presses [1]."""
_PLAYED = 10.0
"""Error with which a goal without a weight counts as reached in a fine simulation, per its size and per
``check.tolerance`` [1]: of points, whose size is a tenth of the finger's length, as far as the tip may depart."""
_REST = 100.0
"""Error with which rates count as zero in a fine simulation, per ``check.tolerance`` and per rate of an oscillation
over the reach whose period is the duration [1]."""
_SETTLED = 1e4
"""Weight of rest of a finger whose tendons have friction and may stick [units of the problem]: an exact demand on
friction that turns around leads to steps of micrometers. Only the drives are at rest exactly."""

_PRESSED = 1e-4
"""Weight of accelerations of a finger that presses and comes into balance by itself [units of the problem]: stiff
contacts change them within micrometers, so that none at all may be out of the solver's reach. How many presses are
found: ``python -m benchmarks.bench_plans --count 0``."""


@dataclass(frozen=True)
class GoalPart:
    """A part of a goal: its entries by name, the target, and the physical amount of one unit of error.

    ``weight`` belongs to half the squared error [1/unit2]; None: reached exactly. ``tolerance`` is the greatest error
    with which it counts as reached, per ``scale`` [1], and ``played`` the greatest one in a fine simulation. ``value``
    is compared with the target, as an expression of the motion's symbols.
    """

    name: str
    key: str
    unit: str
    names: tuple[str, ...]
    target: Array
    scale: Array
    weight: float | None
    value: ca.SX
    tolerance: float | Array = MET
    played: float | Array = math.inf

    @property
    def at_rest(self) -> bool:
        """Whether it asks for rest rather than for a posture."""
        return self.key == "goal.end"

    def _error(self, motion: PlannedMotion) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Unknowns [s, last input], numbers, scaled error."""
        z, d = motion.node
        return z, d, (self.value - ca.DM(self.target)) / ca.DM(self.scale)

    def rows(self, motion: PlannedMotion) -> Term:
        """(z = [s, last input], d) -> scaled error."""
        return derived("goal", *self._error(motion), exact=motion.exact)

    def missed(self, motion: PlannedMotion, z: Array, tolerance: float | Array) -> tuple[Violation | None, float]:
        """The worst entry at a node z = [s, last input] if that is off by more than a tolerance per ``scale``, and the
        largest error per scale.
        """
        error = np.abs(np.array(self.rows(motion).value(z, motion.numbers([1.0]).ravel())).ravel())
        if self.unit == "m":  # points are missed by their distance, anything else by its worst entry
            error = np.repeat(np.hypot(*error.reshape(-1, 2).T), 2)
        if np.all(error <= tolerance):
            return None, float(error.max())
        k = int((error / tolerance).argmax())
        unit = self.unit if self.unit != "state" else self.names[k]
        amount = float(error[k] * self.scale[k])
        return Violation(self.name, k, amount, unit, self.key, float(error[k])), float(error.max())

    def cost(self, motion: PlannedMotion, relaxed: bool) -> Term:
        """(z, d) -> what the error costs."""
        z, d, error = self._error(motion)
        if relaxed:
            # The nearest plan to a goal that cannot be reached ends at rest too.
            factor = ca.DM(np.sqrt(_SETTLED if self.at_rest else 1.0))
        else:
            factor = ca.DM(self.scale * np.sqrt((self.weight or 0.0) / motion.scales.objective))
        scaled = error * factor
        return derived("goal_cost", z, d, 0.5 * ca.dot(scaled, scaled), exact=motion.exact, squared=scaled)


def goal_parts(motion: PlannedMotion, settles: bool, presses: bool) -> list[GoalPart]:
    """The aims of a scene; ``settles``: the finger comes to rest by itself after its drives; ``presses``: one without
    rates that is held comes into balance by itself.

    One with a wrong number of entries raises an InputError.
    """
    goal = motion.scene.goal
    model = motion.prediction
    length = motion.length
    x, u, _, p, _ = motion.physical
    parts = []

    def add(
        name: str, unit: str, names: tuple[str, ...], target: tuple[float, ...], scale: float | Array, value: ca.SX
    ) -> None:
        key = f"goal.{name}"
        size = value.numel()
        if len(target) != size:
            raise InputError(f"expected {size} entries ({', '.join(names)}), got {len(target)}", key=key)
        aim = getattr(goal, name)
        scales = np.full(size, scale)
        # Forces scale as others do, but a tenth of what bends the finger is no force at all where less is asked.
        share = (np.abs(target).max() / scales.max() or 1.0) if name == "contact_force" else 1.0
        # 0.1: tolerance of a goal with a weight and no tolerance of its own: 1 % of the finger's length, 0.05 rad
        near = 0.1 * share if aim.tolerance is None else aim.tolerance / scales
        met, played = (MET, _PLAYED * motion.scene.check.tolerance * share) if aim.weight is None else (near, near)
        values = np.array(target), scales, aim.weight, value, met, played
        parts.append(GoalPart(f"goal {name}", key, unit, names, *values))

    motion.scene.check_reach("goal", goal.targets, lengths=model.system.finger_model.lengths)
    # Scales make errors of different kinds comparable: a tenth of the length, half a radian, the greatest force.
    if goal.tip is not None:
        add("tip", "m", ("x", "y"), goal.tip.value, 0.1 * length, model.tip(x, u, p))
    if goal.bending is not None:
        bend = model.bending(x, u, p)
        add("bending", "rad", tuple(f"element {k + 1}" for k in range(bend.numel())), goal.bending.value, 0.5, bend)
    if goal.shape is not None:
        where = ca.vec(model.sections(goal.shape.at)(x, u, p)[0])
        names = tuple(f"{axis} at {at:g} m" for at in goal.shape.at for axis in "xy")
        add("shape", "m", names, goal.targets["shape"], 0.1 * length, where)
    if goal.contact_force is not None:
        aim = goal.contact_force.value
        rod = motion.scene.finger.rod
        greatest = max(rod.least_force, *map(abs, aim))
        add("contact_force", "N", model.contact_names, aim, greatest, model.contact_force(x, u, p))
    if goal.input is not None:
        names = tuple(of.name for of in motion.scene.finger.inputs)
        add("input", motion.input_unit, names, goal.input.value, motion.scales.u, u)
    if goal.end != "moving":
        all_names = np.array(model.x_names)
        scale = motion.scales.x
        if goal.end == "still":
            chosen = [k for k, name in enumerate(all_names) if "_rate " in name]
            value = x[chosen]
        else:
            # Friction states beyond their range return to it, by which no force changes; a material goes on relaxing.
            chosen = [k for k, name in enumerate(all_names) if "friction_" not in name and "relaxing_" not in name]
            all_names = np.array([f"{name}/s" for name in all_names])
            value = model.dynamics(x, u, p)[chosen]
            scale = scale / motion.first_duration
            if motion.scene.transcription == "single_shooting":
                scale = scale * _stiffness(motion)
        n = model.system.n
        weighted = [k < 2 * n and (settles or (presses and k >= n)) for k in chosen]
        soft = _SETTLED if settles else _PRESSED
        for rows, weight in ((np.flatnonzero(~np.array(weighted)), None), (np.flatnonzero(weighted), soft)):
            if not rows.size:
                continue
            names = tuple(all_names[chosen][rows].tolist())
            zero = np.zeros(rows.size)
            selected = value[rows.tolist()]
            unit = scale[chosen][rows]
            if weight is None:
                # Accelerations follow from what contacts and cables have within micrometers: what is held is judged by
                # whether it stays.
                played = _REST * motion.scene.check.tolerance if goal.end == "still" else math.inf
                parts.append(GoalPart(goal.end, "goal.end", "state", names, zero, unit, None, selected, MET, played))
            else:
                name = f"{goal.end}, finger"
                ones = np.ones(rows.size)
                share = weight * motion.scales.objective
                parts.append(GoalPart(name, "goal.end", "1", names, zero, ones, share, selected / ca.DM(unit)))
    return parts


def _stiffness(motion: PlannedMotion) -> Array:
    """Greatest change (nx) of each rate of the straight finger, in its unit, by one unit of a state or input; or one.

    Accelerations that a micrometer of a stiff cable brings would count for more than all else.
    """
    model = motion.prediction
    of_x, of_u = motion.scales.x, motion.scales.u
    u = np.array(motion.scene.initial_input)
    point = model.at_rest(np.zeros(model.system.n), u), u, model.p_nominal
    rate = model.dynamics(model.x, model.u, model.p)
    slopes = ca.Function(
        "slopes", [model.x, model.u, model.p], [ca.jacobian(rate, model.x), ca.jacobian(rate, model.u)]
    )
    by_x, by_u = (np.abs(np.array(slope)) for slope in slopes(*point))
    unit = motion.first_duration / of_x
    greatest = np.maximum((by_x * of_x).max(axis=1), (by_u * of_u).max(axis=1, initial=0.0))
    # Its square root: an acceleration counts as the velocity that it has reached when the stiffness turns it around.
    return np.asarray(np.sqrt(np.maximum(1.0, unit * greatest)))
