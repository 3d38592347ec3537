"""Ways to an equilibrium of the rod: Newton's method, paths in the share of the loads, descent of the energy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from continuum_grasp.base import Array, SolverError
from continuum_grasp.rod.equations import Balance, RodEquations

_CLOSE = 1e-8
"""Turn [rad] of a Newton step after which the next one, being quadratic, is the last."""
_LEAST_STEP, _GREATEST_STEP = 1e-6, 1.5
"""Arclengths of a step along a path, in shares of the loads and r.m.s. curvature times length, weighted by EI [rad]:
below the least the path has a kink; beyond the greatest it may jump to another branch."""
_NEAR = 1e-3
"""Distance from the full loads [1] that is left to Newton's method."""


def newton(equations: RodEquations, start: Array, *, limit: int = 40) -> tuple[Array, float, int]:
    """Damped Newton's method for the full loads, from a curvature (N,) at the nodes.

    Returns the curvature, the turn [rad] of the last step, which is rounding, and the number of steps.
    """
    curvature = start
    balance = equations.balance(curvature)
    last = False
    for step in range(1, limit + 1):
        try:
            change: Array = np.asarray(np.linalg.solve(balance.slope, -balance.missing), dtype=float)
        except np.linalg.LinAlgError:
            break
        turn = equations.turn(change)
        if not np.isfinite(turn):
            break
        if last:
            return curvature + change, turn, step
        # No section turns by more than a radian at once, and the residual must fall: far away steps lead anywhere.
        share = min(1.0, 1.0 / max(turn, 1e-300))
        before = equations.norm(balance.missing)
        while True:
            trial = curvature + share * change
            after = equations.balance(trial)
            if turn < _CLOSE or equations.norm(after.missing) <= (1.0 - 1e-3 * share) * before or share < 1e-3:
                break
            share *= 0.5
        if share < 1e-3:
            break
        curvature = trial
        balance = after
        last = turn < _CLOSE
    size = equations.norm(balance.missing)
    raise SolverError(
        "no equilibrium of the rod found",
        status="newton stalled",
        violated=[f"bending moment missing: {size:.3g} EI / L"],
        advice="the rod may be at a critical load, or the guess far from any equilibrium: change a load a little, or "
        "give a guess nearer to the shape",
    )


def follow(equations: RodEquations, start: Array, *, loads: bool, folds: bool = True) -> tuple[Array, int]:
    """The path of equilibria by pseudo-arclength (H. B. Keller, 1977), from a share 0 to 1, round folds if wanted.

    ``loads``: a share of the loads acts, and the start is the unloaded shape. Otherwise all act, and what balances the
    start is taken away. Returns a curvature near the equilibrium under the full loads, and the number of steps.
    """
    offset = np.zeros_like(start) if loads else equations.balance(start).missing

    def at(x: Array, share: float) -> Balance:
        if loads:
            return equations.balance(x, share)
        full = equations.balance(x)
        return Balance(full.missing - (1.0 - share) * offset, full.slope, offset)

    weights = equations.metric
    x = start
    share = 0.0
    size = 0.3
    direction, rate = _tangent(at(x, share), weights, np.zeros_like(x), 1.0)
    # 600: steps of a path: three times those of a following force of 1,000 EI / L^2 at the tip
    for steps in range(1, 600 + 1):
        while True:
            corrected = _correct(at, weights, x, share, direction, rate, size)
            if corrected is not None:
                trial, reached, balance, corrections = corrected
                ahead, ahead_rate = _tangent(balance, weights, direction, rate)
                # A tangent that turns by more than 32 degrees (cosine 0.85) may be that of another branch.
                if size < 1e-3 or weights @ (ahead * direction) + ahead_rate * rate > 0.85:
                    break
            size *= 0.5
            if size < _LEAST_STEP:
                raise _lost(share, "path lost", "a load may pass a critical value: change it a little")
        if abs(reached - 1.0) <= _NEAR:
            return trial, steps
        if reached > 1.0:
            # Past the full loads: again from before, by the part of the step that is left, and Newton does the rest.
            size *= min(max((1.0 - share) / (reached - share), 0.1), 0.9)
            continue
        x, share, direction, rate = trial, reached, ahead, ahead_rate
        if rate <= 0.0 and not folds:
            raise _lost(share, "path turned back", "no equilibrium is connected to the start")
        # 10.0: negative share to which a path from a guess may go before it comes back
        if share < (-1e-6 if loads else -10.0):
            raise _lost(share, "path turned back", "no equilibrium is connected to the start")
        if corrections <= 3:
            size = min(1.6 * size, _GREATEST_STEP)
    cause = "the loads bend the rod very far: check their units" if loads else "the guess leads to no equilibrium"
    raise _lost(share, "iteration limit", cause)


def _lost(share: float, status: str, advice: str) -> SolverError:
    return SolverError(
        "the path to the equilibrium of the rod was lost",
        status=status,
        violated=[f"share of the loads reached: {share:.3g} of 1"],
        advice=f"{advice}; or give a guess near to the shape",
    )


def _bordered(balance: Balance, row: Array, corner: float, right: Array) -> Array:
    """Solve for a change of curvature and of the share; regular at folds too, where the slope alone is singular."""
    n = len(row)
    matrix = np.empty((n + 1, n + 1))
    matrix[:n, :n], matrix[:n, n] = balance.slope, balance.per_share
    matrix[n, :n], matrix[n, n] = row, corner
    return np.asarray(np.linalg.solve(matrix, right), dtype=float)


def _tangent(balance: Balance, weights: Array, direction: Array, rate: float) -> tuple[Array, float]:
    """Unit tangent of the path that goes on in a direction."""
    right = np.zeros(len(weights) + 1)
    right[-1] = 1.0
    tangent = _bordered(balance, weights * direction, rate, right)
    tangent = tangent / np.sqrt(weights @ tangent[:-1] ** 2 + tangent[-1] ** 2)
    return tangent[:-1], float(tangent[-1])


def _correct(
    at: Callable[[Array, float], Balance],
    weights: Array,
    x: Array,
    share: float,
    direction: Array,
    rate: float,
    size: float,
) -> tuple[Array, float, Balance, int] | None:
    """Newton's method across the tangent; None where it does not contract."""
    y, reached = x + size * direction, share + size * rate
    before = np.inf
    for k in range(6):
        balance = at(y, reached)
        try:
            change = _bordered(balance, weights * direction, rate, np.append(-balance.missing, 0.0))
        except np.linalg.LinAlgError:
            return None
        length = float(np.sqrt(weights @ change[:-1] ** 2 + change[-1] ** 2))
        if not np.isfinite(length) or length > 0.5 * size or length > 0.5 * before:
            # What is left may be rounding.
            return (y, reached, balance, k) if length < 1e-9 else None
        y = y + change[:-1]
        reached = reached + float(change[-1])
        before = length
        if length < 1e-6 * max(size, 1e-3):
            return y, reached, at(y, reached), k + 1
    return None


def weakest(equations: RodEquations, curvature: Array) -> float:
    """Least eigenvalue at an equilibrium of the second variation (its symmetric part without a potential), per EI."""
    return float(np.linalg.eigvalsh(equations.stiffness(equations.balance(curvature).slope))[0])


def descend(equations: RodEquations, start: Array, side: int) -> tuple[Array, int]:
    """Down the energy to a minimum, by Newton's method with eigenvalues of either sign taken as positive.

    ``side`` is that to which a saddle is left: the sense in which its weakest direction turns the tip. Returns a
    curvature near a minimum, and the number of steps.
    """
    curvature = start
    energy = equations.energy(start)
    root = np.sqrt(equations.metric)  # into the metric of ``stiffness``, and back
    kicked = False
    # 300: steps of a descent, each by 0.7 rad or less
    for step in range(1, 300 + 1):
        balance = equations.balance(curvature)
        values, vectors = np.linalg.eigh(equations.stiffness(balance.slope))
        force = vectors.T @ (equations.mesh.weights * balance.missing / root)
        change: Array = vectors @ (-force / np.maximum(np.abs(values), 1e-6)) / root
        turn = equations.turn(change)
        if turn < 1e-6:
            if values[0] > 0.0:
                return curvature, step
            # On a saddle the force vanishes: leave it along the weakest direction, by a turn of 0.1 rad.
            if not kicked or values[0] < -1e-6:
                kick = vectors[:, 0] / root
                tip = float(equations.mesh.weights @ kick)
                change = kick * (side if tip >= 0.0 else -side) * (0.1 / equations.turn(kick))
                turn, kicked = 0.1, True
        # The quadratic model of the energy holds for turns below a radian.
        share = min(1.0, 0.7 / max(turn, 1e-300))
        for _ in range(30):
            trial = curvature + share * change
            after = equations.energy(trial)
            if after <= energy + 1e-13 * (1.0 + abs(energy)):
                break
            share *= 0.5
        curvature, energy = trial, after
    raise SolverError(
        "no stable equilibrium of the rod found",
        status="iteration limit",
        violated=[f"least stiffness: {values[0]:.3g} EI"],
        advice="the rod may be at a critical load: change a load a little, or ask for stable=False",
    )
