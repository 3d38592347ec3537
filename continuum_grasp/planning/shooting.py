"""An interval of multiple shooting: Runge-Kutta steps with first and second derivatives.

The second derivatives are those of the discrete adjoint: per stage the Hessian of the dynamics, weighted by the
adjoint of that stage and seen through the sensitivity of the stage's state (W. W. Hager, Runge-Kutta methods in optimal
control and the transformed adjoint system, Numer. Math. 87 (2000), doi:10.1007/s002110000178).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from continuum_grasp.core.cache import library_for
from continuum_grasp.core.compiler import CompileError, find_compiler
from continuum_grasp.core.source import externals_source

_WEIGHTS = (1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0)  # of the slopes of RK4
_AHEAD = (0.0, 0.5, 0.5, 1.0)  # share of the step at which each slope is taken


@dataclass(frozen=True)
class Term:
    """A function of unknowns and numbers with its derivatives.

    ``value`` is (z, d) -> o (no); ``jacobian`` (z, d) -> J (no, nz), dense; ``hessian`` (z, d, weights (no)) -> H
    (nz, nz), dense and symmetric: that of the weighted sum of the outputs, or what stands for it.
    """

    value: ca.Function
    jacobian: ca.Function
    hessian: ca.Function

    @property
    def size(self) -> int:
        """Number of outputs."""
        return int(self.value.numel_out(0))


def derived(name: str, z: ca.SX, d: ca.SX, o: ca.SX, *, exact: bool = True, squared: ca.SX | None = None) -> Term:
    """A term from its outputs o as expressions of unknowns z and numbers d.

    Where it is not ``exact``, the Hessian is that of Gauss and Newton, of the last output alone: half the sum of
    squares of ``squared``.
    """
    outputs = ca.densify(ca.SX(o))
    weights = ca.SX.sym("weights", outputs.numel())
    if exact:
        hessian = ca.hessian(ca.dot(weights, outputs), z)[0]
    elif squared is not None and squared.numel():
        slope = ca.jacobian(squared, z)
        hessian = weights[-1] * ca.mtimes(slope.T, slope)
    else:
        hessian = ca.SX(z.numel(), z.numel())
    # Dense, so that the assembly knows the place of every entry.
    return Term(
        ca.Function(name, [z, d], ca.cse([outputs]), ["z", "d"], ["o"]),
        ca.Function(f"{name}_jac", [z, d], ca.cse([ca.densify(ca.jacobian(outputs, z))]), ["z", "d"], ["J"]),
        ca.Function(f"{name}_hess", [z, d, weights], ca.cse([ca.densify(hessian)]), ["z", "d", "weights"], ["H"]),
    )


def compiled(term: Term) -> Term:
    """A term as compiled code, or the term itself where nothing can be compiled."""
    compiler = find_compiler()
    if compiler is None:
        return term
    functions = (term.value, term.jacobian, term.hessian)
    try:
        library = str(library_for(externals_source(functions), compiler, "the plan"))
    except (CompileError, OSError):
        return term
    return Term(*(ca.external(function.name(), library) for function in functions))


class _Stage(NamedTuple):
    """A stage of a step: its argument, the numbers it reads, the argument's sensitivities, and the flow's Jacobian."""

    z: ca.MX
    d: ca.MX
    by_z: ca.MX
    slope: ca.MX


def shooting_interval(flow: Term, ns: int, intervals: int, substeps: int, of_inputs: Term | None = None) -> Term:
    """The state at the end of an interval, and what the objective grows by.

    ``flow`` is (z = [s (ns), v, T], d) -> rates of s and of the objective, for time from 0 to 1. The term found is
    (z, D (nd, 2 substeps + 1): numbers at half steps) -> [s at the end, increment of the objective].

    Where Hessians are those of the objective alone, and it depends on no other states than the last ones, ``of_inputs``
    is the flow of these: of the time of an iteration, 70 % went into sensitivities of states that do not matter.
    """
    h = 1.0 / (intervals * substeps)
    z = ca.MX.sym("z", flow.value.numel_in(0))
    d = ca.MX.sym("D", flow.value.numel_in(1), 2 * substeps + 1)
    weights = ca.MX.sym("weights", ns + 1)
    value, slope, stages = _steps(flow, z, d, ns, h, substeps)
    if of_inputs is None:
        hessian = _second_order(flow, stages, weights, ns, h)
    else:
        first = flow.value.numel_in(0) - of_inputs.value.numel_in(0)
        own = shooting_interval(of_inputs, ns - first, intervals, substeps)
        hessian = ca.diagcat(ca.MX.zeros(first, first), own.hessian(z[first:], d, weights[first:]))
    inputs, names = [z, d], ["z", "d"]
    return Term(
        ca.Function("interval", inputs, [value], names, ["o"]),
        ca.Function("interval_jac", inputs, [slope], names, ["J"]),
        ca.Function("interval_hess", [*inputs, weights], [hessian], [*names, "weights"], ["H"]),
    )


def _steps(flow: Term, z: ca.MX, d: ca.MX, ns: int, h: float, substeps: int) -> tuple[ca.MX, ca.MX, list[_Stage]]:
    """End, its sensitivities, and all stages."""
    nz = z.numel()
    # The last entry is the objective: it is summed up, and no stage reads it.
    state, held = ca.vertcat(z[:ns], 0.0), z[ns:]
    by_z = ca.vertcat(ca.MX.eye(nz)[:ns, :], ca.MX.zeros(1, nz))
    held_by_z = ca.MX.eye(nz)[ns:, :]
    stages: list[_Stage] = []
    for i in range(substeps):
        k, k_by_z = ca.MX.zeros(ns + 1), ca.MX.zeros(ns + 1, nz)
        total, total_by_z = state, by_z
        for weight, ahead in zip(_WEIGHTS, _AHEAD, strict=True):
            at = ca.vertcat(state[:ns, :] + ahead * h * k[:ns, :], held)
            at_by_z = ca.vertcat(by_z[:ns, :] + ahead * h * k_by_z[:ns, :], held_by_z)
            numbers = d[:, 2 * i + int(2 * ahead)]
            k, slope = flow.value(at, numbers), flow.jacobian(at, numbers)
            k_by_z = ca.mtimes(slope, at_by_z)
            stages.append(_Stage(at, numbers, at_by_z, slope))
            total, total_by_z = total + weight * h * k, total_by_z + weight * h * k_by_z
        state, by_z = total, total_by_z
    return state, by_z, stages


def _second_order(flow: Term, stages: list[_Stage], weights: ca.MX, ns: int, h: float) -> ca.MX:
    """Hessian of the weighted outputs, backwards over the stages."""
    nz = stages[0].z.numel()
    hessian = ca.MX.zeros(nz, nz)
    after = weights  # adjoint of the state at the end of a step
    for first in range(len(stages) - 4, -1, -4):
        pulled = ca.MX.zeros(ns)
        before = after
        for j in (3, 2, 1, 0):
            stage = stages[first + j]
            # A slope acts on the end of the step by its weight, and on the next stage's argument.
            adjoint = _WEIGHTS[j] * h * after
            if j < 3:
                adjoint = adjoint + ca.vertcat(_AHEAD[j + 1] * h * pulled, 0.0)
            pulled = ca.mtimes(stage.slope[:, :ns].T, adjoint)
            before = before + ca.vertcat(pulled, 0.0)
            inner = flow.hessian(stage.z, stage.d, adjoint)
            hessian = hessian + ca.mtimes(stage.by_z.T, ca.mtimes(inner, stage.by_z))
        after = before
    return hessian
