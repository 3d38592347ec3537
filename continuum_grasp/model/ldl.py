"""Symbolic solution of a symmetric positive definite system."""

from __future__ import annotations

from collections.abc import Sequence

from continuum_grasp.model.planar import Scalar

__all__ = ["solve_ldl"]


def solve_ldl(matrix: Sequence[Sequence[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
    """Solve ``matrix x = right`` by an L D L' factorization without pivoting.

    Parameters
    ----------
    matrix : n x n scalars
        Symmetric positive definite; the lower triangle is read.
    right : n scalars

    Returns
    -------
    list of n scalars
    """
    # Written out in scalars, since CasADi's own linear solvers cannot be expanded to SX and generated as straight code;
    # no pivots are needed for a mass matrix, which is positive definite, and the code then has no branches.
    n = len(right)
    a = [list(row) for row in matrix]
    inverse: list[Scalar] = [0.0] * n
    factor: list[list[Scalar]] = [[0.0] * n for _ in range(n)]
    y = list(right)
    for j in range(n):
        inverse[j] = 1.0 / a[j][j]  # the only divisions of the dynamics: one per coordinate
        for i in range(j + 1, n):
            factor[i][j] = a[i][j] * inverse[j]
        for i in range(j + 1, n):
            for k in range(j + 1, i + 1):
                a[i][k] -= factor[i][j] * a[k][j]
            y[i] -= factor[i][j] * y[j]
    x: list[Scalar] = [0.0] * n
    for i in range(n - 1, -1, -1):
        x[i] = y[i] * inverse[i]
        for k in range(i + 1, n):
            x[i] -= factor[k][i] * x[k]
    return x
