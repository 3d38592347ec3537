"""An L-stable step of order 2 for stiff models: two diagonally implicit stages, each by two Newton iterations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from continuum_grasp.core.calls import call, straight_function
from continuum_grasp.core.integrators.derivatives import derivative_pattern, identity, parts, solve


def differentiated_step(
    name: str,
    slope: ca.Function,
    start: ca.MX,
    others: tuple[ca.MX, ...],
    h: ca.MX,
    instants: int,
    *,
    between: int = 0,
) -> list[ca.MX]:
    """Write the step with its derivatives, exact up to the last Newton correction; see the package.

    Each stage takes two Newton iterations and as many as there are ``between`` them, a number that does not depend on
    data, so that the code is straight-line and its time is constant. With two, a contact of 20 kN/m that closes within
    a step leaves the stage equations unsolved; ``sdirk2_contact`` has one more. Half the step is a step of its own: an
    L-stable method has no continuous extension.
    """
    of_stages = Sdirk2Stages(slope)
    first_guess = of_stages.predict(f"{name}_predict")
    corrections = [
        of_stages.correct(f"{name}_{which}", is_first=which == "first", with_derivatives=instants > 0)
        for which in ("first", "last")
    ]
    again = [of_stages.refine(f"{name}_refine")] * between if between else []
    stages: list[list[ca.MX]] = []
    for share in (1.0, 0.5)[: max(1, instants)]:
        # Butcher's table: the first stage is at gamma, the second at 1 and equal to the step (stiffly accurate).
        arguments = [h, ca.MX(share)]
        base = start
        stage = list[ca.MX]()
        for stage_of in corrections:
            k, at = call(first_guess, *arguments, base, *call(slope, base, *others))
            for refine in again:
                k, at = call(refine, *arguments, base, *call(slope, at, *others), k)
            base, *stage = call(stage_of, *arguments, start, *call(slope, at, *others), k, *stage)
        stages.append([base, *stage])
    return [stages[0][0], *(derivatives for _, *following in stages for derivatives in following)]


@dataclass(frozen=True)
class Sdirk2Stages:
    """Newton iterations of the stages, of a slope: (state, ...) -> rate and its Jacobian."""

    slope: ca.Function
    gamma: ClassVar[float] = 1.0 - 1.0 / math.sqrt(2.0)
    """Diagonal coefficient [1] that makes two diagonally implicit stages L-stable and of order 2; R. Alexander, SIAM J.
    Numer. Anal. 14 (1977) 1006, doi:10.1137/0714068."""

    def predict(self, name: str) -> ca.Function:
        """First Newton iteration of a stage: its rate, and the state where the second one linearizes."""
        symbols, step, _ = self._given()
        start = symbols["start"]
        rate = symbols["rate"]
        n = self.slope.size1_out(0)
        k = solve(ca.SX.eye(n) - step * parts(symbols["jacobian"])[0], rate)
        return straight_function(name, symbols, {"k": k, "at": ca.vertcat(start[:n, :] + step * k, start[n:, :])})

    def refine(self, name: str) -> ca.Function:
        """A Newton iteration between the first and the last one of a stage."""
        symbols, step, _ = self._given()
        start = symbols["start"]
        n = self.slope.size1_out(0)
        k = ca.SX.sym("k", n)
        rates = k + solve(ca.SX.eye(n) - step * parts(symbols["jacobian"])[0], symbols["rate"] - k)
        results = {"next": rates, "at": ca.vertcat(start[:n, :] + step * rates, start[n:, :])}
        return straight_function(name, symbols | {"k": k}, results)

    def correct(self, name: str, *, is_first: bool, with_derivatives: bool) -> ca.Function:
        """Second Newton iteration: of the first stage where the second starts and the rate, of the second one the end
        of the step; with derivatives, the last one's.

        A stage ``y = base + step f(y, u)`` has derivatives Y with ``(I - step J) Y = Y_base + step J_u``.
        """
        symbols, step, ahead = self._given()
        n = self.slope.size1_out(0)
        pattern = derivative_pattern(self.slope)
        start = symbols["start"]
        k = ca.SX.sym("k", n)
        before = ca.SX.sym("before", n)
        reached = ca.SX.sym("reached", pattern)
        by_state, by_input = parts(symbols["jacobian"])
        unmoved = identity(pattern)
        # The base of the second stage continues with the rate of the first one, the source of its derivatives.
        base = unmoved if is_first else unmoved + (1.0 - self.gamma) / self.gamma * (reached - unmoved)
        columns = ca.horzcat(symbols["rate"] - k, *[base + step * by_input] * with_derivatives)
        solved = solve(ca.SX.eye(n) - step * by_state, columns)
        rates = k + solved[:, 0]
        symbols["k"] = k
        if is_first:
            results = {"next": ca.vertcat(start[:n, :] + ahead * rates, start[n:, :]), "rates": rates}
        else:
            symbols |= {"before": before} | ({"reached": reached} if with_derivatives else {})
            results = {"end": start[:n, :] + ahead * before + step * rates}
        if with_derivatives:
            results["by"] = ca.project(solved[:, 1:], pattern)
        return straight_function(name, symbols, results)

    def _given(self) -> tuple[dict[str, ca.SX], ca.SX, ca.SX]:
        """Inputs (the step, the share of it that is taken, a state, rate, Jacobian) and the lengths of both stages."""
        sizes = {"h": 1, "share": 1, "start": self.slope.size1_in(0), "rate": self.slope.size1_out(0)}
        symbols = {
            key: ca.SX.sym(key, size) for key, size in (sizes | {"jacobian": self.slope.sparsity_out(1)}).items()
        }
        length = symbols["share"] * symbols["h"]
        return symbols, self.gamma * length, (1.0 - self.gamma) * length
