"""Inertia of the rod by the appendix, (A.1) and (A.3): mass matrix and velocity products.

Coefficients of theta1^i theta2^j under the powers (i, j), homogeneous in the arc lengths: ``over(d, a, b, ...)`` is
(a L1^n + b L1^(n-1) L2 + ...) / d. Where the paper prints another value, it stands beside the corrected one.
"""

from __future__ import annotations

from benchmarks.paper.coefficients import Polynomial, misprint, over, right, wrong

__all__ = ["BIAS", "MASS"]

MASS: dict[str, Polynomial] = {
    "M11": {
        (0, 0): right(60, 3, 15, 30, 20),
        (0, 2): right(120, 0, 0, -5, -2),
        (1, 1): wrong(over(18, 0, 0, -1, 0), printed=over(9, 0, 0, 1, 0)),
        (2, 0): wrong(over(504, -1, -7, -21, 0), printed=over(504, -1, -7, -63, 0)),
        (0, 4): right(5040, 0, 0, 7, 2),
        (1, 3): wrong(over(360, 0, 0, 1, 0), printed=over(180, 0, 0, -1, 0)),
        (2, 2): wrong(over(288, 0, 0, 1, 0), printed=over(96, 0, 0, 1, 0)),
        (3, 1): wrong(over(360, 0, 0, 1, 0), printed=over(90, 0, 0, -1, 0)),
        (4, 0): wrong(over(25920, 1, 9, 36, 0), printed=over(25920, 1, 9, 180, 0)),
    },
    "M12": {
        (0, 0): right(24, 0, 0, 2, 3),
        (0, 2): right(720, 0, 0, -9, -5),
        (1, 1): wrong(over(72, 0, 0, -1, 0), printed=over(36, 0, 0, 1, 0)),
        (2, 0): wrong(over(144, 0, 0, -1, 0), printed=over(2880, 0, 0, -1, 0), unrotated=over(48, 0, 0, -1, 0)),
        (0, 4): right(40320, 0, 0, 20, 7),
        (1, 3): wrong(over(1080, 0, 0, 1, 0), printed=over(540, 0, 0, -1, 0)),
        (2, 2): wrong(over(960, 0, 0, 1, 0), printed=over(320, 0, 0, 1, 0)),
        (3, 1): wrong(over(1440, 0, 0, 1, 0), printed=over(360, 0, 0, -1, 0)),
        (4, 0): wrong(over(4320, 0, 0, 1, 0), printed=over(864, 0, 0, 1, 0)),
    },
    "M22": {
        (0, 0): right(20, 0, 0, 0, 1),
        (0, 2): right(504, 0, 0, 0, -1),
        (0, 4): right(25920, 0, 0, 0, 1),
    },
}
"""(A.1): mass matrix per mass per length [m3]; total degree 4."""

BIAS: dict[str, Polynomial] = {
    "V11": {
        (0, 1): wrong(over(36, 0, 0, -1, 0), printed=over(18, 0, 0, 1, 0)),
        (1, 0): wrong(over(504, -1, -7, -21, 0), printed=over(504, -1, -7, -63, 0)),
        (0, 3): wrong(over(720, 0, 0, 1, 0), printed=over(360, 0, 0, -1, 0)),
        (1, 2): wrong(over(288, 0, 0, 1, 0), printed=over(96, 0, 0, 1, 0)),
        (2, 1): wrong(over(240, 0, 0, 1, 0), printed=over(60, 0, 0, -1, 0)),
        (3, 0): wrong(over(12960, 1, 9, 36, 0), printed=over(12960, 1, 9, 180, 0)),
        (0, 5): wrong(over(30240, 0, 0, -1, 0), printed=over(15120, 0, 0, 1, 0)),
        (1, 4): wrong(over(8640, 0, 0, -1, 0), printed=over(2880, 0, 0, -1, 0)),
        (2, 3): wrong(over(4800, 0, 0, -1, 0), printed=over(1200, 0, 0, 1, 0)),
        (3, 2): wrong(over(4320, 0, 0, -1, 0), printed=over(864, 0, 0, -1, 0)),
        (4, 1): wrong(over(6048, 0, 0, -1, 0), printed=over(1008, 0, 0, 1, 0)),
        (5, 0): wrong(over(739200, -1, -11, -55, 0), printed=over(739200, -1, -11, -385, 0)),
    },
    "V12": {
        (0, 1): right(60, 0, 0, -5, -2),
        (1, 0): wrong(over(18, 0, 0, -1, 0), printed=over(9, 0, 0, 1, 0)),
        (0, 3): right(1260, 0, 0, 7, 2),
        (1, 2): wrong(over(120, 0, 0, 1, 0), printed=over(60, 0, 0, -1, 0)),
        (2, 1): wrong(over(144, 0, 0, 1, 0), printed=over(48, 0, 0, 1, 0)),
        (3, 0): wrong(over(360, 0, 0, 1, 0), printed=over(90, 0, 0, -1, 0)),
        (0, 5): right(60480, 0, 0, -9, -2),
        (1, 4): wrong(over(3024, 0, 0, -1, 0), printed=over(1512, 0, 0, 1, 0)),
        (2, 3): wrong(over(2160, 0, 0, -1, 0), printed=over(720, 0, 0, -1, 0)),
        (3, 2): wrong(over(2400, 0, 0, -1, 0), printed=over(600, 0, 0, 1, 0)),
        (4, 1): wrong(over(4320, 0, 0, -1, 0), printed=over(864, 0, 0, -1, 0)),
        (5, 0): wrong(over(15120, 0, 0, -1, 0), printed=over(2520, 0, 0, 1, 0)),
    },
    "V13": {
        (0, 1): misprint(over(360, 0, 0, -9, -5), printed=over(360, 0, 0, -9, -8)),
        (1, 0): wrong(over(72, 0, 0, -1, 0), printed=over(36, 0, 0, 1, 0)),
        (0, 3): right(10080, 0, 0, 20, 7),
        (1, 2): wrong(over(360, 0, 0, 1, 0), printed=over(180, 0, 0, -1, 0)),
        (2, 1): wrong(over(480, 0, 0, 1, 0), printed=over(160, 0, 0, 1, 0)),
        (3, 0): wrong(over(1440, 0, 0, 1, 0), printed=over(360, 0, 0, -1, 0)),
        (0, 5): right(604800, 0, 0, -35, -9),
        (1, 4): wrong(over(8064, 0, 0, -1, 0), printed=over(4032, 0, 0, 1, 0)),
        (2, 3): wrong(over(6048, 0, 0, -1, 0), printed=over(2016, 0, 0, -1, 0)),
        (3, 2): wrong(over(7200, 0, 0, -1, 0), printed=over(1800, 0, 0, 1, 0)),
        (4, 1): wrong(over(14400, 0, 0, -1, 0), printed=over(2880, 0, 0, -1, 0)),
        (5, 0): wrong(over(60480, 0, 0, -1, 0), printed=over(10080, 0, 0, 1, 0)),
    },
    "V21": {
        (0, 1): wrong(over(180, 0, 0, 5, 3), printed=over(360, 0, 0, 25, 6)),
        (1, 0): wrong(over(72, 0, 0, 1, 0), printed=over(72, 0, 0, -7, 0)),
        (0, 3): wrong(over(3780, 0, 0, -7, -3), printed=over(7560, 0, 0, -35, -6)),
        (1, 2): wrong(over(480, 0, 0, -1, 0), printed=over(480, 0, 0, 7, 0)),
        (2, 1): wrong(over(720, 0, 0, -1, 0), printed=over(160, 0, 0, -3, 0)),
        (3, 0): wrong(over(2160, 0, 0, -1, 0), printed=over(1080, 0, 0, 11, 0)),
        (0, 5): wrong(over(60480, 0, 0, 3, 1), printed=over(120960, 0, 0, 15, 2)),
        (1, 4): wrong(over(12096, 0, 0, 1, 0), printed=over(1728, 0, 0, -1, 0)),
        (2, 3): wrong(over(10800, 0, 0, 1, 0), printed=over(800, 0, 0, 1, 0)),
        (3, 2): wrong(over(14400, 0, 0, 1, 0), printed=over(7200, 0, 0, -11, 0)),
        (4, 1): wrong(over(30240, 0, 0, 1, 0), printed=over(12096, 0, 0, 13, 0)),
        (5, 0): wrong(over(120960, 0, 0, 1, 0), printed=over(2688, 0, 0, -1, 0)),
    },
    "V23": {
        (0, 1): right(504, 0, 0, 0, -1),
        (0, 3): right(12960, 0, 0, 0, 1),
        (0, 5): right(739200, 0, 0, 0, -1),
    },
}
"""(A.3): factors of rate1^2, rate1 rate2, rate2^2 (last digit 1, 2, 3) per mass per length [m3]; V22 is 0."""
