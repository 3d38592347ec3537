"""An L-stable step of order 2 for stiff models: two diagonally implicit stages, each by two Newton iterations."""

from __future__ import annotations

import math

import casadi as ca

_GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
"""Diagonal coefficient [1] that makes two diagonally implicit stages L-stable and of order 2; R. Alexander, SIAM J.
Numer. Anal. 14 (1977) 1006, doi:10.1137/0714068."""


def differentiated_step(
    slope: ca.Function, x: ca.SX, others: tuple[ca.SX, ...], h: ca.SX, held: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Write the step with its derivatives, exact up to the last Newton correction; see the package.

    Each stage takes two Newton iterations, a number that does not depend on data, so that the code is straight-line and
    its time is constant. A contact of 20 kN/m that closes within a step of 10 ms leaves the stage equations unsolved;
    such models need shorter steps.
    """
    n = x.numel()
    # Butcher's table: the first stage at gamma, the second at 1, where it is the step itself (stiffly accurate).
    step, ahead = _GAMMA * h, (1.0 - _GAMMA) * h
    start, by_x, by_u = x, ca.SX.eye(n), ca.SX(n, slope.size2_out(2))
    rates: list[tuple[ca.SX, ca.SX, ca.SX]] = []
    for _ in range(2):
        f, f_x, _ = slope(ca.vertcat(start, held), *others)
        k = _solve(ca.SX.eye(n) - step * f_x, f)
        f, f_x, f_u = slope(ca.vertcat(start + step * k, held), *others)
        columns = ca.horzcat(f - k, ca.mtimes(f_x, by_x), ca.mtimes(f_x, by_u) + f_u)
        solved = _solve(ca.SX.eye(n) - step * f_x, columns)
        k, k_x, k_u = k + solved[:, 0], solved[:, 1 : n + 1], solved[:, n + 1 :]
        rates.append((k, k_x, k_u))
        start, by_x, by_u = x + ahead * k, ca.SX.eye(n) + ahead * k_x, ahead * k_u
    (a, a_x, a_u), (b, b_x, b_u) = rates
    by_x, by_u = ca.SX.eye(n) + ahead * a_x + step * b_x, ahead * a_u + step * b_u
    return x + ahead * a + step * b, by_x, by_u


def _solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solve by Gaussian elimination that skips zeros, without pivoting, since straight-line code cannot branch; the
    identity in I - h J keeps the pivots away from zero.
    """
    n, m = right.shape
    a = [[matrix[i, j] for j in range(n)] for i in range(n)]
    b = [[right[i, j] for j in range(m)] for i in range(n)]
    inverse = [ca.SX(1)] * n
    for k in range(n):
        inverse[k] = 1.0 / a[k][k]
        for i in range(k + 1, n):
            if a[i][k].is_zero():
                continue
            factor = a[i][k] * inverse[k]
            for j in range(k + 1, n):
                if not a[k][j].is_zero():
                    a[i][j] = a[i][j] - factor * a[k][j]
            for j in range(m):
                if not b[k][j].is_zero():
                    b[i][j] = b[i][j] - factor * b[k][j]
    for k in range(n - 1, -1, -1):
        for j in range(m):
            total = b[k][j]
            for i in range(k + 1, n):
                if not a[k][i].is_zero() and not b[i][j].is_zero():
                    total = total - a[k][i] * b[i][j]
            b[k][j] = total * inverse[k] if not total.is_zero() else total
    return ca.vertcat(*[ca.horzcat(*row) for row in b])
