"""What the end of a plan must meet, as functions of the last state and input."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError
from continuum_grasp.planning.motion import Motion
from continuum_grasp.planning.shooting import Term, derived

Array = NDArray[np.float64]

_STILL_WHEN_RELAXED = 1e4
"""Weight of rest against the distance from a goal that cannot be reached."""


@dataclass(frozen=True)
class GoalPart:
    """One aim.

    Attributes
    ----------
    name, key, unit : str
    names : tuple of str
        Of its entries.
    target, scale : ndarray
        What is to be reached, and the physical amount of one unit of error.
    weight : float or None
        Weight of half the squared error [1/unit2]; None: exact.
    value : casadi.SX
        What is compared with the target, as an expression of the motion's symbols.
    """

    name: str
    key: str
    unit: str
    names: tuple[str, ...]
    target: Array
    scale: Array
    weight: float | None
    value: ca.SX

    def _error(self, motion: Motion) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Unknowns [s, last input], numbers, scaled error."""
        s, v, _, d = motion.symbols
        error = (self.value - ca.DM(self.target)) / ca.DM(self.scale)
        if not motion.linear:
            return ca.vertcat(s, v), d, error
        last = ca.SX.sym("last", motion.nu)
        return ca.vertcat(s, last), d, error

    def rows(self, motion: Motion) -> Term:
        """(z = [s, last input], d) -> scaled error."""
        z, d, error = self._error(motion)
        return derived("goal", z, d, error, exact=motion.exact)

    def cost(self, motion: Motion, relaxed: bool) -> Term:
        """(z, d) -> what the error costs."""
        z, d, error = self._error(motion)
        if relaxed:
            scaled = error * np.sqrt(_STILL_WHEN_RELAXED if self.name in ("still", "held") else 1.0)
        else:
            scaled = error * ca.DM(self.scale * np.sqrt((self.weight or 0.0) / motion.scales.objective))
        return derived("goal_cost", z, d, 0.5 * ca.dot(scaled, scaled), exact=motion.exact, squared=scaled)


def goal_parts(motion: Motion) -> list[GoalPart]:
    """The aims of a scene.

    Raises
    ------
    InputError
        If an aim has another number of entries than what it is for.
    """
    goal, model, length = motion.scene.goal, motion.prediction, motion.length
    x, u, _, p, _ = motion.physical
    found = []
    if goal.tip is not None:
        found.append(_part("tip", "m", ("x", "y"), goal.tip.value, 0.1 * length, goal.tip.weight, model.tip(x, u, p)))
    if goal.bending is not None:
        bend = model.bending(x, u, p)
        names = tuple(f"element {k + 1}" for k in range(bend.numel()))
        found.append(_part("bending", "rad", names, goal.bending.value, 0.5, goal.bending.weight, bend))
    if goal.shape is not None:
        where = ca.vec(model.sections(goal.shape.at)(x, u, p)[0])
        names = tuple(f"{axis} at {at:g} m" for at in goal.shape.at for axis in "xy")
        target = tuple(value for point in goal.shape.value for value in point)
        found.append(_part("shape", "m", names, target, 0.1 * length, goal.shape.weight, where))
    if goal.contact_force is not None:
        aim = goal.contact_force
        scale = max(1.0, *(abs(f) for f in aim.value))
        force = model.contact_force(x, u, p)
        found.append(_part("contact_force", "N", model.contact_names, aim.value, scale, aim.weight, force))
    if goal.input is not None:
        unit = "N m" if motion.nu == 1 else "N"
        names = tuple(name.split(" ")[0] for name in model.u_names)
        found.append(_part("input", unit, names, goal.input.value, float(motion.scales.u[0]), goal.input.weight, u))
    if goal.end != "moving":
        found.append(_rest(motion, goal.end))
    return found


def _rest(motion: Motion, end: str) -> GoalPart:
    """No rates, or no rates and accelerations."""
    x, u, _, p, _ = motion.physical
    model = motion.prediction
    names, scale = np.array(model.x_names), motion.scales.x
    if end == "still":
        chosen = [k for k, name in enumerate(names) if "_rate " in name]
        value = x[chosen]
    else:
        chosen, value = list(range(model.nx)), model.dynamics(x, u, p)
        scale = scale / motion.first_duration
    labels = tuple(names[chosen].tolist())
    return GoalPart(end, "goal.end", "state", labels, np.zeros(len(chosen)), scale[chosen], None, value)


def _part(
    name: str,
    unit: str,
    names: tuple[str, ...],
    target: tuple[float, ...],
    scale: float,
    weight: float | None,
    value: ca.SX,
) -> GoalPart:
    if len(target) != value.numel():
        raise InputError(
            f"expected {value.numel()} entries ({', '.join(names)}), got {len(target)}", key=f"goal.{name}"
        )
    size = len(target)
    return GoalPart(f"goal {name}", f"goal.{name}", unit, names, np.array(target), np.full(size, scale), weight, value)
