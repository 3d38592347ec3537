"""Stiffness that fingers give the object, by the tangents of exact rods; whether small motions raise the energy.

Contacts stick: middle ones are pins of the skin, tips roll on the object's surface as it is curved there, at constant
tensions. Fingers in parallel add up: where the least eigenvalue of the sum is negative, on the motions that supports
leave, a motion lowers the energy. `continuum_grasp.grasp.certificate.stability` tests the bending of the fingers, too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.finger_map.rod import MapFinger, call
from continuum_grasp.scene import Peg

if TYPE_CHECKING:
    from continuum_grasp.grasp.finger_map.balance import ObjectBalance, Settled

CLEARLY = 0.01
"""Negative eigenvalue per the greatest from which on a combination is unstable."""
FLAT = 0.05
"""Curvature per size up to which an object may lie flat on a support, which holds its angle."""
NO_FORCE = 1e-3
"""Normal force, in units of the balance, up to which a contact may hold nothing."""


def finger_stiffness(finger: MapFinger, z: Array, center: complex, size: float) -> Array:
    """Stiffness (B, 3, 3) [N m] that equilibria (B, n) of a finger give an object: by shifts per ``size`` [m], and by
    the turn about its ``center`` [m].
    """
    slopes = wrench_slopes(finger, z, center, size)
    return np.asarray(0.5 * (slopes + slopes.transpose(0, 2, 1)))


def wrench_slopes(finger: MapFinger, z: Array, center: complex, size: float) -> Array:
    """Slopes of what resists motions of the object, which are symmetric but for errors of the integration."""
    count = len(z)
    k = finger.middles
    lanes = finger.lanes
    z = np.ascontiguousarray(z, dtype=float)
    out = np.empty((count, 6 * k + 10, 1 + lanes))
    call(lanes, "pinned", finger.struct, count, z, out)
    value, slope = out[..., 0], out[..., 1 : 4 + 2 * k]
    middle = center.real / finger.length, center.imag / finger.length
    known = np.zeros((count, 3 + 2 * k, 3))
    moved = np.empty((count, 3 + 2 * k, 3 + 2 * k))
    for j in range(k):
        point = slice(6 * j, 6 * j + 2)
        moved[:, 2 * j : 2 * j + 2], known[:, 2 * j : 2 * j + 2] = slope[:, point], _carried(value[:, point] - middle)
    place, force, (angle, moment) = value[:, 6 * k : 6 * k + 2], value[:, 6 * k + 3 : 6 * k + 5], (6 * k + 2, 6 * k + 5)
    normal = value[:, 6 * k + 6 : 6 * k + 8]
    half = value[:, 6 * k + 8]
    bend = value[:, 6 * k + 9]
    along = _turned(normal)
    of_force = slope[:, 6 * k + 3 : 6 * k + 5]
    turn = np.array([0.0, 0.0, 1.0])
    if finger.tip:
        # The contact's direction turns by the share of the tip's turn that its radius has of both.
        share = half * bend
        pressure = (force * normal).sum(axis=1)
        rolled = (half[:, None] * along)[..., None]
        moved[:, -3:-1] = slope[:, 6 * k : 6 * k + 2] - rolled * slope[:, angle, None]
        known[:, -3:-1] = _carried(place - middle) - rolled * turn
        lever = half[:, None] * normal
        moved[:, -1] = (
            slope[:, moment] + _crossed(lever, of_force) - (half * pressure * share)[:, None] * slope[:, angle]
        )
        known[:, -1] = (half * pressure * (1.0 - share))[:, None] * turn
    else:
        moved[:, -3:-1], moved[:, -1] = of_force, slope[:, moment]
    answer = np.linalg.solve(moved, known)
    total = np.zeros((count, 3, 3))
    for j in range(k):
        change = answer[:, 3 + 2 * j : 5 + 2 * j]
        arm = value[:, 6 * j : 6 * j + 2] - middle
        total[:, :2] += change
        total[:, 2] += _crossed(arm, change)
        total[:, 2, 2] -= (arm * value[:, 6 * j + 4 : 6 * j + 6]).sum(axis=1)
    if finger.tip:
        change = of_force @ answer
        turned = (slope[:, angle, None] @ answer)[:, 0]
        direction = share[:, None] * turned + (1.0 - share)[:, None] * turn
        arm_change = _carried(place - middle) - [[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]
        arm_change = arm_change + rolled * (turned - turn - direction)[:, None]
        total[:, :2] += change
        total[:, 2] += _crossed(place - half[:, None] * normal - middle, change)
        total[:, 2] += arm_change[:, 0] * force[:, 1:] - arm_change[:, 1] * force[:, :1]
    scale = np.array([size / finger.length, size / finger.length, 1.0])
    return np.asarray(total * np.outer(scale, scale) * finger.moment)


def not_unstable(balance: ObjectBalance, settled: Settled, rows: list[int]) -> list[int]:
    """Rows of settled combinations but for those that are clearly unstable, where the scene requires stability."""
    # It has the tangents of exact rods.
    unknown = not all(finger.is_exact for finger in balance.fingers)
    if balance.scene.stability == "ignore" or unknown or not rows:
        return rows
    least = least_eigenvalues(balance, settled.x[rows])
    return [row for row, each in zip(rows, least, strict=True) if each > -CLEARLY]


def least_eigenvalues(balance: ObjectBalance, x: Array) -> Array:
    """Least eigenvalues (B,) of the stiffness that combinations give the object, per the greatest; infinite where
    supports leave no motion, or where it does not tell: contacts may bear nothing, drives may hold more than tensions.
    """
    scene, size, center = balance.scene, balance.size, balance.center
    laws = (setup.finger.drive_law for setup in scene.setups)
    if len(balance.supports) > 1 or any(law is not None and law.locks for law in laws):
        return np.full(len(x), np.inf)
    spans = zip(balance.fingers, balance.at[:-1], balance.at[1:], strict=True)
    total = np.sum([finger_stiffness(f, x[:, a:b], center, size) for f, a, b in spans], axis=0)
    normal, _ = balance.forces(x, balance.traced(x, slopes=False))
    pressed = normal.min(axis=1) > NO_FORCE * balance.force
    if balance.supports:
        motion, more = _rolling(balance, x)
        rolling = np.einsum("i,bij,j->b", motion, total, motion) + more
        least, greatest = rolling, np.abs(total).max(axis=(1, 2))
    else:
        sizes = np.linalg.eigvalsh(total)
        least, greatest = sizes[:, 0], np.abs(sizes).max(axis=1)
    return np.where(pressed & np.isfinite(least), least / greatest, np.inf)


def _rolling(balance: ObjectBalance, x: Array) -> tuple[Array, Array]:
    """The motion that one support leaves the object, and the stiffness (B,) that the support gives it [N m]; infinite
    where it may lie flat.
    """
    ((name, (point, outward)),) = balance.places.items()
    arm = point - balance.center
    first = int(balance.at[-1])
    finger = balance.fingers[0]
    normal = balance.force * x[:, first]
    along = balance.force * x[:, first + 1]
    motion = np.array([arm.imag / balance.size, -arm.real / balance.size, 1.0])
    curved = np.empty(1)
    seen = point / finger.length
    call(finger.lanes, "bend_of_object", finger.struct, float(seen.real), float(seen.imag), curved)
    bend = max(float(curved[0]), 0.0) / finger.length
    support = balance.scene.support_of(name)
    if isinstance(support, Peg):
        bend += 1.0 / support.radius
    elif bend * balance.size < FLAT:
        return motion, np.full(len(x), np.inf)
    force = outward * (normal + 1j * along)
    # Bodies of radii r and R that roll on each other: r R / (r + R).
    return motion, normal / bend - (force * np.conj(arm)).real


def _turned(vector: Array) -> Array:
    """Vectors (B, 2) a quarter of a turn on."""
    return np.stack([-vector[:, 1], vector[:, 0]], axis=1)


def _carried(arm: Array) -> Array:
    """Shifts (B, 2, 3) of points at arms (B, 2) by a motion of the object."""
    shift = np.broadcast_to(np.eye(2), (len(arm), 2, 2))
    return np.concatenate([shift, _turned(arm)[..., None]], axis=2)


def _crossed(arm: Array, force: Array) -> Array:
    """Moments (B, n) of forces (B, 2, n) at arms (B, 2)."""
    return np.asarray(arm[:, :1] * force[:, 1] - arm[:, 1:] * force[:, 0])
