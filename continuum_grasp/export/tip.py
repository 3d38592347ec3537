"""The curvature of a matched tip: no coordinate, yet within the bending range of its element."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from continuum_grasp.export.fields import Field
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.model import FingerModel
from continuum_grasp.model.equations import Equations

__all__ = ["TipRange"]


@dataclass(frozen=True)
class TipRange:
    """What keeps the tip's curvature in its range.

    Attributes
    ----------
    guard : Kernel or None
        (x, u, p) -> use, the share of its range that it takes; None where a range of one number says the same.
    limits : dict of str to tuple of float
        That range, by the name of the number.
    notes : dict of str to str
        The condition as a sentence with the numbers of nominal parameters, by the struct that it is of, state or input.
    """

    guard: Kernel | None = None
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)

    @staticmethod
    def of(model: FingerModel, equations: Equations) -> TipRange:
        """That of a model; nothing where the tip is not matched."""
        if not model.structure.matched:
            return TipRange()
        use = ca.SX(equations.full[-1]) * equations.lengths[-1] / model.ranges[-1]
        given = ca.vertcat(equations.x, equations.u)
        slopes = ca.Function("slopes", [given, equations.p], [ca.jacobian(use, given), use])
        zero = np.zeros(given.numel())
        slope, rest = (np.array(value).ravel() for value in slopes(zero, model.p_nominal))
        names = [label.split(" ")[0] for label in (*model.x_names, *model.u_names)]
        acting = np.flatnonzero(slope)
        if len(acting) == 1 and not ca.depends_on(use, equations.p):
            at = acting[0]
            low, high = sorted(((-1.0 - rest[0]) / slope[at], (1.0 - rest[0]) / slope[at]))
            return TipRange(limits={names[at]: (float(low), float(high))})
        function = ca.Function("tip_use", [equations.x, equations.u, equations.p], [use], ["x", "u", "p"], ["use"])
        guard = Kernel("tip_use", function, "Share of its bending range that the curvature of the tip takes.")
        terms = " ".join(f"{slope[at]:+.6g} {names[at]}" for at in acting)
        constant = f" {rest[0]:+.6g}" if rest[0] else ""
        nominal = " with nominal parameters" if ca.depends_on(use, equations.p) else ""
        note = f" The curvature of the tip must be in its range: -1 <= {terms.strip('+')}{constant} <= 1{nominal}."
        return TipRange(guard, notes={"state" if at < len(model.x_names) else "input": note for at in acting})

    def bounded(self, fields: tuple[Field, ...]) -> tuple[Field, ...]:
        """Entries of a struct, with the range of the number that sets the curvature."""
        limits = self.limits
        return tuple(
            replace(f, low=limits[f.name][0], high=limits[f.name][1]) if f.name in limits else f for f in fields
        )
