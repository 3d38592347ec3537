"""Quadrature nodes of a clothoid element by the accuracy that is asked for, from a table of measured errors."""

from __future__ import annotations

from continuum_grasp.base import InputError
from continuum_grasp.model.quadrature import STRICT

RANGES = (0.3, 0.6, 1.0, 1.5, 2.1, 3.15, 4.5, 6.3)
"""Ranges of length times curvature [rad] of the columns of the table below, up to one turn."""
_ERRORS: dict[int, tuple[float, ...]] = {
    3: (5.0e-2, 5.0e-2, 5.1e-2, 5.3e-2, 5.8e-2, 7.0e-2, 9.4e-2, 4.0e-1),
    4: (9.9e-4, 9.9e-4, 9.9e-4, 1.0e-3, 2.0e-3, 5.6e-3, 1.4e-2, 4.1e-2),
    5: (9.2e-6, 1.2e-5, 2.0e-5, 3.5e-5, 6.4e-5, 3.1e-4, 1.4e-3, 4.7e-3),
    6: (2.7e-8, 1.1e-7, 3.2e-7, 7.6e-7, 1.7e-6, 1.2e-5, 1.2e-4, 8.5e-4),
    7: (3.1e-10, 1.4e-9, 6.8e-9, 3.6e-8, 1.5e-7, 9.2e-7, 5.6e-6, 8.4e-5),
    8: (1.1e-12, 1.8e-11, 1.4e-10, 7.2e-10, 2.9e-9, 1.7e-8, 1.9e-7, 5.8e-6),
    9: (1.6e-14, 2.6e-13, 2.1e-12, 1.1e-11, 5.0e-11, 5.1e-10, 6.5e-9, 2.9e-7),
    10: (1.0e-14, 1.0e-14, 1.7e-14, 2.0e-13, 1.7e-12, 2.4e-11, 3.0e-10, 1.1e-8),
    11: (1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 4.2e-14, 1.3e-12, 3.1e-11, 6.1e-10),
    12: (1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 3.1e-14, 7.3e-13, 1.4e-11),
    13: (1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 4.5e-14, 1.8e-12),
    14: (1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 5.3e-14),
    15: (1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14, 1.0e-14),
}
"""Largest error of mass matrix, bias, gravity and end point of one clothoid element, relative to the largest entry over
all shapes, per number of nodes, for elements whose length times curvature stays below each of ``RANGES`` (measured
against 24 nodes over random and extreme shapes; a test measures it again). The bias of curvatures that change sign is
the worst; the mass matrix is about ten times better."""


def node_count(angle_range: float, accuracy: float) -> int:
    """Return the number of nodes (3 to 16) of an element with a greatest length times curvature [rad] for an accuracy.

    ``accuracy`` is the error of mass matrix, bias, gravity and position, relative to their largest entries.
    """
    column = next((k for k, reach in enumerate(RANGES) if angle_range <= reach), None)
    if column is None:
        raise InputError(
            f"a clothoid element that bends by up to {angle_range:.3g} rad is beyond one turn: take more elements",
            key="bending_range",
        )
    wanted = accuracy if accuracy > STRICT else 0.1 * accuracy
    return next((count for count, errors in _ERRORS.items() if errors[column] <= wanted), 16)
