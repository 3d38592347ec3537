"""Shared parts of steps with derivatives: sparsity of the derivatives, and elimination without pivoting."""

from __future__ import annotations

import casadi as ca
import numpy as np


def parts(jacobian: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Derivatives (n, n) of a slope by the state, and (n, n + m) by the inputs, which stand behind zeros."""
    n = jacobian.size1()
    return jacobian[:, :n], ca.horzcat(ca.SX(n, n), jacobian[:, n:])


def derivative_pattern(slope: ca.Function) -> ca.Sparsity:
    """Return the structural nonzeros (n, n + m) of the derivatives after any number of steps.

    In implicit steps, a slope enters through the inverse of the identity minus its Jacobian, with the same nonzeros.
    """
    sparsity = slope.sparsity_out(1)
    n, width = sparsity.shape
    jacobian = np.zeros((n, width), dtype=bool)
    jacobian[tuple(np.array(sparsity.get_triplet(), dtype=int))] = True
    pattern = np.eye(n, width, dtype=bool)
    # A path through n states has n links at most.
    for _ in range(n):
        pattern |= jacobian[:, :n] @ pattern
        pattern[:, n:] |= jacobian[:, n:]
    rows, columns = np.nonzero(pattern)
    return ca.Sparsity.triplet(n, width, rows.tolist(), columns.tolist())


def identity(pattern: ca.Sparsity) -> ca.SX:
    """Derivatives (n, n + m) before the first step."""
    n, width = pattern.shape
    return ca.horzcat(ca.SX.eye(n), ca.SX(n, width - n))


def solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solve by Gaussian elimination that skips zeros, without pivoting, since straight-line code cannot branch; the
    identity in I - h J keeps the pivots away from zero.
    """
    n, m = right.shape
    a = [[matrix[i, j] for j in range(n)] for i in range(n)]
    b = [[right[i, j] for j in range(m)] for i in range(n)]
    inverse = [ca.SX(1)] * n
    order = _elimination_order(matrix.sparsity())
    for at, k in enumerate(order):
        inverse[k] = 1.0 / a[k][k]
        for i in order[at + 1 :]:
            if a[i][k].is_zero():
                continue
            factor = a[i][k] * inverse[k]
            for j in order[at + 1 :]:
                if not a[k][j].is_zero():
                    a[i][j] = a[i][j] - factor * a[k][j]
            for j in range(m):
                if not b[k][j].is_zero():
                    b[i][j] = b[i][j] - factor * b[k][j]
    for at, k in reversed([*enumerate(order)]):
        for j in range(m):
            total = b[k][j]
            for i in order[at + 1 :]:
                if not a[k][i].is_zero() and not b[i][j].is_zero():
                    total = total - a[k][i] * b[i][j]
            b[k][j] = total * inverse[k] if not total.is_zero() else total
    return ca.vertcat(*[ca.horzcat(*row) for row in b])


def _elimination_order(sparsity: ca.Sparsity) -> list[int]:
    """Order the pivots on the diagonal: the next pivot has the least possible fill-in (H. M. Markowitz, Management Sci.
    3 (1957) 255, doi:10.1287/mnsc.3.3.255); of equal ones, the first.
    """
    n = sparsity.size1()
    filled = np.eye(n, dtype=bool)
    filled[tuple(np.array(sparsity.get_triplet(), dtype=int))] = True
    left = list(range(n))
    order = list[int]()
    while left:
        others = np.ix_(left, left)
        rows, columns = (filled[others].sum(axis=axis) - 1 for axis in (1, 0))
        k = left.pop(int(np.argmin(rows * columns)))
        order.append(k)
        filled |= np.outer(filled[:, k], filled[k])
    return order
