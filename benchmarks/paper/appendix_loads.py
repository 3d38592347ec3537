"""How weight and forces act by the appendix, (A.2) and (A.4): Jacobians and gravity.

The notation is that of ``appendix_inertia``.
"""

from __future__ import annotations

from benchmarks.paper.coefficients import Polynomial, misprint, over, right

__all__ = ["GRAVITY_ACROSS", "GRAVITY_ALONG", "JACOBIAN"]

JACOBIAN: dict[str, Polynomial] = {
    "Jc11": {
        (0, 0): right(2, -1, 0),
        (2, 0): right(8, 1, 0),
        (4, 0): right(144, -1, 0),
    },
    "Jc21": {
        (1, 0): right(3, -1, 0),
        (3, 0): right(30, 1, 0),
        (5, 0): right(840, -1, 0),
    },
    "Jt11": {
        (0, 0): right(2, -1, -2),
        (0, 2): right(6, 0, 1),
        (1, 1): right(2, 0, 1),
        (2, 0): right(8, 1, 4),
        (0, 4): right(120, 0, -1),
        (1, 3): right(24, 0, -1),
        (2, 2): right(12, 0, -1),
        (3, 1): right(12, 0, -1),
        (4, 0): right(144, -1, -6),
    },
    "Jt12": {
        (0, 0): right(2, 0, -1),
        (0, 2): right(8, 0, 1),
        (1, 1): right(3, 0, 1),
        (2, 0): right(4, 0, 1),
        (0, 4): right(144, 0, -1),
        (1, 3): right(30, 0, -1),
        (2, 2): right(16, 0, -1),
        (3, 1): right(18, 0, -1),
        (4, 0): right(48, 0, -1),
    },
    "Jt21": {
        (0, 1): right(2, 0, -1),
        (1, 0): right(3, -1, -3),
        (0, 3): right(24, 0, 1),
        (1, 2): right(6, 0, 1),
        (2, 1): right(4, 0, 1),
        (3, 0): right(30, 1, 5),
        (0, 5): right(720, 0, -1),
        (1, 4): right(120, 0, -1),
        (2, 3): right(48, 0, -1),
        (3, 2): right(36, 0, -1),
        (4, 1): right(48, 0, -1),
        (5, 0): right(840, -1, -7),
    },
    "Jt22": {
        (0, 1): right(3, 0, -1),
        (1, 0): right(2, 0, -1),
        (0, 3): right(30, 0, 1),
        (1, 2): right(8, 0, 1),
        (2, 1): right(6, 0, 1),
        (3, 0): right(12, 0, 1),
        (0, 5): right(840, 0, -1),
        (1, 4): right(144, 0, -1),
        (2, 3): right(60, 0, -1),
        (3, 2): right(48, 0, -1),
        (4, 1): right(72, 0, -1),
        (5, 0): right(240, 0, -1),
    },
}
"""(A.2): Jacobians of the contact (Jc) and the tip (Jt), row and column [m]; all of them are right."""

GRAVITY_ALONG: dict[str, Polynomial] = {
    "GY1": {
        (0, 1): right(6, 0, 0, -1),
        (1, 0): misprint(over(12, -1, -4, -6), printed=over(6, -1, -4, -6)),
        (0, 3): right(120, 0, 0, 1),
        (1, 2): right(24, 0, 0, 1),
        (2, 1): right(12, 0, 0, 1),
        (3, 0): right(180, 1, 6, 15),
        (0, 5): right(5040, 0, 0, -1),
        (1, 4): right(720, 0, 0, -1),
        (2, 3): right(240, 0, 0, -1),
        (3, 2): right(144, 0, 0, -1),
        (4, 1): right(144, 0, 0, -1),
        (5, 0): right(6720, -1, -8, -28),
    },
    "GY2": {
        (0, 1): right(12, 0, 0, -1),
        (1, 0): right(6, 0, 0, -1),
        (0, 3): right(180, 0, 0, 1),
        (1, 2): right(40, 0, 0, 1),
        (2, 1): right(24, 0, 0, 1),
        (3, 0): right(36, 0, 0, 1),
        (0, 5): right(6720, 0, 0, -1),
        (1, 4): right(1008, 0, 0, -1),
        (2, 3): right(360, 0, 0, -1),
        (3, 2): right(240, 0, 0, -1),
        (4, 1): right(288, 0, 0, -1),
        (5, 0): right(720, 0, 0, -1),
    },
}
"""(A.4): gravity along -Y of the base, per weight per length [m2]."""

GRAVITY_ACROSS: dict[str, Polynomial] = {
    "GX1": {
        (0, 0): right(6, 1, 3, 3),
        (0, 2): right(24, 0, 0, -1),
        (1, 1): right(6, 0, 0, -1),
        (2, 0): right(40, -1, -5, -10),
        (0, 4): right(720, 0, 0, 1),
        (1, 3): right(120, 0, 0, 1),
        (2, 2): right(48, 0, 0, 1),
        (3, 1): right(36, 0, 0, 1),
        (4, 0): right(1008, 1, 7, 21),
    },
    "GX2": {
        (0, 0): right(6, 0, 0, 1),
        (0, 2): right(40, 0, 0, -1),
        (1, 1): right(12, 0, 0, -1),
        (2, 0): right(12, 0, 0, -1),
        (0, 4): right(1008, 0, 0, 1),
        (1, 3): right(180, 0, 0, 1),
        (2, 2): right(80, 0, 0, 1),
        (3, 1): right(72, 0, 0, 1),
        (4, 0): right(144, 0, 0, 1),
    },
}
"""Gravity along +X of the base, per weight per length [m2]; the paper has no such formula."""
