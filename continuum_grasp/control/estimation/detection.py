"""Whether the sensors of a finger at rest tell its disturbances apart."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.scene import SAME, doubt

_SHAPES = 8
"""Number of shapes in the test [1]; one detectable shape suffices, since a straight finger shows no stiffness."""
_AT_REST = ("missing_tip_moment", "unknown_tip_", "bending_stiffness_error", "tip_offset_error")
"""Beginnings of the names of disturbances that a finger at rest, without contact, shows."""


def check_detectable(
    model: Prediction, names: Sequence[str], adapted: Collection[int], slope: ca.Function, outputs: ca.Function
) -> None:
    """Refuse a ``tip_offset`` that sensors do not tell from disturbances, and doubt others that they do not tell apart.

    A filter that ends without an offset needs disturbances d that are detectable: [A B; C D] of x' = A x + B d and
    y = C x + D d has full column rank (G. Pannocchia, J. B. Rawlings, doi:10.1002/aic.690490213, proposition 1; of
    nonlinear models U. Maeder, F. Borrelli, M. Morari, doi:10.1016/j.automatica.2009.05.007, at the setpoint). Here no
    vector of its null space may have a part in d, at one of some shapes.

    Parameters
    ----------
    model : Prediction
    names : sequence of str
        Disturbances with their units.
    adapted : collection of int
        Parameters of ``estimator.adapt``, which do not change at rest.
    slope : casadi.Function
        (z, u, p, p) -> x', [A B].
    outputs : casadi.Function
        (z, u, p) -> y, [C D].

    Raises
    ------
    InputError
        If at no shape they are detectable, and one is ``tip_offset``.
    """
    offset = any(name.startswith("tip_offset") for name in names)
    shown = [k for k, name in enumerate(names) if name.startswith(_AT_REST) and (offset or k not in adapted)]
    if len(shown) < 2 or _tells_at_one(model, len(names), shown, slope, outputs):
        return
    words = f"at rest, sensors cannot tell {', '.join(names[k].split(' ')[0] for k in shown)} apart"
    if offset:
        raise InputError(
            f"{words}: expected tip_offset with one disturbance that moves the tip along its path (tip_moment or "
            "bending_stiffness), or more sensors, such as bending",
            key="estimator.disturbances",
        )
    doubt(
        "estimator.disturbances",
        f"together: {words}: what they have in common is right, each wanders without a limit, and the "
        "loop swings; leave one out, or put bending_stiffness into estimator.adapt, which learns from motion alone",
    )


def _tells_at_one(
    model: Prediction, count: int, shown: Sequence[int], slope: ca.Function, outputs: ca.Function
) -> bool:
    """Return whether sensors can distinguish the disturbances ``shown`` at one of several shapes at rest.

    ``count`` is the number of all disturbances.
    """
    # Friction states stay within -1 and 1, so an error that they hide is bounded and does not drift.
    states = [k for k, name in enumerate(model.x_names) if "friction_" not in name]
    columns = [*states, *(model.nx + k for k in shown)]
    least, most = (np.array(limit) for limit in model.scene.input_limits)
    u = 0.7 * least + 0.3 * most
    p = np.array(model.p_nominal)
    for shape in model.shapes(_SHAPES):
        z = np.concatenate([model.at_rest(shape, u), np.zeros(count)])
        rows = np.vstack([np.array(slope(z, u, p, p)[1]), np.array(outputs(z, u, p)[1])])[:, columns]
        if np.all(np.isfinite(rows)) and _tells(rows, len(states)):
            return True
    return False


def _tells(rows: Array, nx: int) -> bool:
    """Whether the null space has no part beyond the first nx entries; rows and columns are brought to one size."""
    scaled = rows.copy()
    # 200: often enough for the same sizes whatever the units
    for axis in (0, 1) * 200:
        size = np.linalg.norm(scaled, axis=axis, keepdims=True)
        scaled = scaled / np.where(size > 0.0, size, 1.0)
    _, sizes, vectors = np.linalg.svd(scaled)
    sizes = np.concatenate([sizes, np.zeros(vectors.shape[0] - sizes.size)])
    # Rounding leaves 1e-16 instead of zero, and the least value of shipped loops is 7e-8 (configs/mpc/spirob.yaml).
    return bool(np.all(np.abs(vectors[sizes <= SAME * sizes[0], nx:]) <= SAME))
