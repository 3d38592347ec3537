"""Functions of unknowns with derivatives, and the motion over an interval as one of them.

The motion follows the Runge-Kutta-Chebyshev method of order 2: explicit, and with s stages stable along 0.65 s^2 of
the negative real axis, where the fast modes of damped fingers lie; four elements on winches take an eighth of the
evaluations of the classical method (B. P. Sommeijer, L. F. Shampine, J. G. Verwer, RKC: an explicit solver for
parabolic PDEs, J. Comput. Appl. Math. 88 (1998), doi:10.1016/S0377-0427(97)00219-7).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.polynomial import Chebyshev
from numpy.typing import ArrayLike

from continuum_grasp.base import Array
from continuum_grasp.core import CSource

_MARGIN = np.array([1.0, 1.2, 1.5])[:, None]
"""Factors on the eigenvalues up to which steps must be stable [1], since only some shapes were sampled."""
_MOST_STAGES, MOST_STEPS = 40, 10_000
"""Most stages per step, beyond which rounding grows, and most steps per interval [1]."""


@dataclass(frozen=True)
class Term:
    """A function of unknowns and numbers with its derivatives.

    ``value`` is (z, d) -> o (no); ``jacobian`` (z, d) -> J (no, nz), dense; ``hessian`` (z, d, weights (no)) -> H
    (nz, nz), dense and symmetric: the Hessian of the weighted sum of the outputs, or its substitute.
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

    Where it is not ``exact``, it is the Hessian of Gauss and Newton, of the last output alone: half the sum of
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
    functions = CSource((term.value, term.jacobian, term.hessian)).loaded("the plan")
    return term if functions is None else Term(*functions)


def _polynomials(stages: int) -> tuple[float, float, Array, Array, Array]:
    """w0, w1 of the method with so many stages, and b, a, c (stages + 1) of each stage."""
    # 2.0 / 13.0: damping of the stability polynomial, as in the source: a third of what is fast is left after a step
    w0 = 1.0 + (2.0 / 13.0) / stages**2
    j = np.arange(stages + 1)
    angle = np.arccosh(w0)
    # Chebyshev's polynomials at w0 with two derivatives; the latter are zero up to the first.
    t = np.cosh(j * angle)
    slope = np.maximum(j * np.sinh(j * angle) / np.sinh(angle), 1.0)
    bend = np.where(j > 1, (j**2 * t - w0 * slope) / (w0**2 - 1.0), 0.0)
    w1 = slope[-1] / bend[-1]
    b = bend / slope**2
    c = slope[-1] / bend[-1] * bend / slope
    b[:2], c[1] = b[2], c[2] / (4.0 * w0)
    return w0, w1, b, 1.0 - b * t, c


def amplification(stages: int, z: ArrayLike) -> Array:
    """By how much a step multiplies a mode, of products z of step and eigenvalue."""
    w0, w1, b, a, _ = _polynomials(stages)
    return np.asarray(a[-1] + b[-1] * Chebyshev.basis(stages)(w0 + w1 * np.asarray(z)))


def fewest_evaluations(eigenvalues: Array, length: float, steps: int | None = None) -> tuple[int, int]:
    """Steps over a length [s] and stages per step that are stable and accurate with the fewest evaluations.

    ``steps`` gives their number, for which the fewest stages are found. Where none are stable, there are more steps
    than may be taken.
    """
    decaying = np.unique(eigenvalues[(eigenvalues.real < 0.0) & (eigenvalues.imag >= 0.0)]) * length * _MARGIN
    slow = decaying[0, np.abs(decaying[0]) <= 2.0 * np.pi] if steps is None else np.zeros(1)

    def stable(count: int, stages: int) -> bool:
        calm = bool((np.abs(amplification(stages, decaying / count)) <= 1.0).all())
        off = amplification(stages, slow / count) ** count - np.exp(slow)
        # 1e-3: error over an interval of modes that turn once in it at most; a finer simulation checks the plan
        return calm and bool(np.abs(off).max(initial=0.0) <= 1e-3)

    best = MOST_STEPS + 1, _MOST_STAGES
    for stages in range(2, _MOST_STAGES + 1):
        low = (steps or 1) - 1
        high = steps or min(best[0] * best[1] // stages, MOST_STEPS)
        if high <= low or not stable(high, stages):
            continue
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if stable(middle, stages) else (middle, high)
        if high * stages < best[0] * best[1]:
            best = high, stages
    return best


def shooting_interval(flow: Term, ns: int, intervals: int, steps: int, stages: int) -> Term:
    """The state at the end of an interval, and what the objective grows by.

    ``flow`` is (z = [s (ns), v, T], d) -> rates of s and of the objective, for time from 0 to 1. The term found is
    (z, D (nd, steps + 1): numbers at the ends of the steps) -> [s at the end, increment of the objective]. Its Hessian
    is the one of Gauss and Newton at the start of the interval, whose state is an unknown too.
    """
    nz = flow.value.numel_in(0)
    nd = flow.value.numel_in(1)
    z = ca.MX.sym("z", nz)
    d = ca.MX.sym("d", nd, steps + 1)
    weights = ca.MX.sym("weights", ns + 1)
    # The last entry is the objective: it is summed up, and no stage reads it.
    start = ca.vertcat(z[:ns], 0.0)
    moved = ca.horzcat(start, ca.vertcat(ca.MX.eye(nz)[:ns, :], ca.MX.zeros(1, nz)))
    value, both = (
        _step(flow, ns, 1.0 / (intervals * steps), stages, slopes).fold(steps)(
            first, ca.repmat(z[ns:], 1, steps), d[:, :-1], d[:, 1:]
        )
        for slopes, first in ((False, start), (True, moved))
    )
    hessian = flow.hessian(z, d[:, 0], weights) / intervals
    inputs = [z, d]
    names = ["z", "d"]
    return Term(
        ca.Function("interval", inputs, [value], names, ["o"]),
        ca.Function("interval_jac", inputs, [both[:, 1:]], names, ["J"]),
        ca.Function("interval_hess", [*inputs, weights], [hessian], [*names, "weights"], ["H"]),
    )


def _step(flow: Term, ns: int, h: float, stages: int, slopes: bool) -> ca.Function:
    """(y, held, numbers at both ends) -> y after a step; ``slopes``: beside it, columns of its derivatives by z."""
    nz = flow.value.numel_in(0)
    nd = flow.value.numel_in(1)
    w0, w1, b, a, c = _polynomials(stages)
    start = ca.MX.sym("start", ns + 1, 1 + nz if slopes else 1)
    held = ca.MX.sym("held", nz - ns)
    before = ca.MX.sym("before", nd)
    after = ca.MX.sym("after", nd)

    def rate(y: ca.MX, share: float) -> ca.MX:
        z = ca.vertcat(y[:ns, 0], held)
        numbers = before + share * (after - before)
        rates = flow.value(z, numbers)
        if not slopes:
            return rates
        of_z = ca.vertcat(y[:ns, 1:], ca.MX.eye(nz)[ns:, :])
        return ca.horzcat(rates, ca.mtimes(flow.jacobian(z, numbers), of_z))

    first = rate(start, 0.0)
    last = start
    now = start + b[1] * w1 * h * first
    for j in range(2, stages + 1):
        mu = 2.0 * b[j] * w0 / b[j - 1]
        nu = -b[j] / b[j - 2]
        ahead = 2.0 * b[j] * w1 / b[j - 1] * h
        slope = rate(now, float(c[j - 1])) - a[j - 1] * first
        last, now = now, (1.0 - mu - nu) * start + mu * now + nu * last + ahead * slope
    return ca.Function("step", [start, held, before, after], [now])
