"""Grasps of a disc by fingers that touch with their tips, solved as boundary value problems of the elastica.

Nothing of the package is used: scipy integrates the rods, the disc and the tips roll on each other by their arc
lengths, and the wall below the disc does not move.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_bvp, solve_ivp

from tests import certificate_cases as cases


@dataclass(frozen=True)
class Hand:
    """Fingers with rounded tips, a disc, perhaps a wall that the disc lies on (its normal is +y)."""

    radius: float = 0.04
    half: float = 0.006
    length: float = 0.18
    stiffness: float = 6.11e-3
    offset: float = 0.005
    density: float = 0.0  # kg/m, of the fingers
    gravity: tuple = (0.0, 0.0)
    weight: tuple = (0.0, 0.0)  # on the disc, N
    wall: bool = False

    def slopes(self, s, x, force):
        """Of x, y, angle and moment over stiffness along a finger; ``force`` acts on its tip."""
        hanging = self.density * (self.length - s)
        fx, fy = force[0] + hanging * self.gravity[0], force[1] + hanging * self.gravity[1]
        tx, ty = -np.sin(x[2]), np.cos(x[2])
        return np.array([tx, ty, x[3], -(tx * fy - ty * fx) / self.stiffness])

    def tip_curvature(self, difference, friction):
        return (difference * self.offset - self.half * friction) / self.stiffness


@dataclass(frozen=True)
class State:
    pose: np.ndarray  # x, y, angle of the disc
    bases: np.ndarray  # (F, 3)
    normals: np.ndarray  # (F,) angle of the disc's outward normal at the tips
    forces: np.ndarray  # (F, 2) N, f
    wall: np.ndarray  # (2,) N, f
    differences: np.ndarray  # (F,) tension 1 less tension 2
    s: np.ndarray
    shapes: np.ndarray  # (F, 4, S) x, y, angle, curvature

    @property
    def tips(self):
        return self.shapes[:, 2, -1]


def frame(angle):
    n = np.array([np.cos(angle), np.sin(angle)])
    return n, np.array([-n[1], n[0]])


def designed(hand, normal, push, tip_angles, differences, friction=0.0, nodes=241):
    """An equilibrium with the disc at the origin: the bases are where integration back from the tips leads.

    With the wall, one finger whose friction follows from the moments; without, two, the second of which balances the
    first.
    """
    n, t = frame(normal)
    weight = np.asarray(hand.weight, dtype=float)
    wall = np.zeros(2)
    if hand.wall:
        friction = (push * n[0] - weight[0]) / (1.0 - t[0])
        rest = weight - push * n - friction * t
        wall = np.array([-rest[1], rest[0]])
        normals, forces = [normal], [(push, friction)]
    else:
        rest = weight - push * n - friction * t
        other = np.sqrt(rest @ rest - friction**2)
        normals = [normal, np.arctan2(rest[1], rest[0]) - np.arctan2(-friction, other)]
        forces = [(push, friction), (other, -friction)]
    s = np.linspace(0.0, hand.length, nodes)
    shapes = []
    for alpha, (pressed, f), angle, difference in zip(normals, forces, tip_angles, differences, strict=True):
        n, t = frame(alpha)
        end = [*((hand.radius + hand.half) * n), angle, hand.tip_curvature(difference, f)]
        force = pressed * n + f * t
        found = solve_ivp(
            lambda at, x, force=force: hand.slopes(at, x, force),
            (hand.length, 0.0), end, t_eval=s[::-1], rtol=1e-12, atol=1e-13, method="DOP853",
        )  # fmt: skip
        shapes.append(found.y[:, ::-1])
    shapes = np.array(shapes)
    return State(
        np.zeros(3),
        shapes[:, :3, 0],
        np.array(normals),
        np.array(forces),
        wall,
        np.asarray(differences, float),
        s,
        shapes,
    )


def disturbed(hand, start, wrench=(0.0, 0.0, 0.0), *, differences=None, tips=None):
    """The equilibrium under a wrench on the disc, rolled to from ``start``; differences of tension, or the angles of
    the tips, are given.
    """
    count = len(start.normals)

    def unpack(p):
        p = list(p)
        parts = [np.array([p.pop(0) for _ in range(k)]) for k in (2 * count, 2 * hand.wall, count, 3, count)]
        return parts[0].reshape(count, 2), parts[1], *parts[2:]

    def rhs(s, y, p):
        forces, _, _, _, normals = unpack(p)
        out = []
        for k in range(count):
            n, t = frame(normals[k])
            out.append(hand.slopes(s, y[4 * k : 4 * k + 4], forces[k, 0] * n + forces[k, 1] * t))
        return np.concatenate(out)

    def ends(ya, yb, p):
        forces, wall, tension, pose, normals = unpack(p)
        off, total = [], np.array([*hand.weight, 0.0]) + np.asarray(wrench)
        for k in range(count):
            n, t = frame(normals[k])
            a, b = ya[4 * k : 4 * k + 4], yb[4 * k : 4 * k + 4]
            off += [*(a[:3] - start.bases[k]), b[3] - hand.tip_curvature(tension[k], forces[k, 1])]
            off += list((b[:2] - pose[:2] - (hand.radius + hand.half) * n) / hand.length)
            on_disc = hand.radius * ((normals[k] - start.normals[k]) - (pose[2] - start.pose[2]))
            on_tip = hand.half * ((b[2] - start.tips[k]) - (normals[k] - start.normals[k]))
            off.append((on_disc - on_tip) / hand.length)
            off.append(tension[k] - differences[k] if tips is None else b[2] - tips[k])
            total = total - np.array([*(forces[k, 0] * n + forces[k, 1] * t), hand.radius * forces[k, 1]])
        if hand.wall:  # outward normal of the disc (0, -1), across (1, 0); the disc rolls along it
            total = total - np.array([wall[1], -wall[0], hand.radius * wall[1]])
            off.append((pose[1] - start.pose[1]) / hand.length)
            off.append(((pose[0] - start.pose[0]) + hand.radius * (pose[2] - start.pose[2])) / hand.length)
        return np.array([*off, *(total / np.array([1.0, 1.0, hand.radius]))])

    walls = start.wall if hand.wall else []
    p = np.concatenate([start.forces.ravel(), walls, start.differences, start.pose, start.normals])
    found = solve_bvp(rhs, ends, start.s, start.shapes.reshape(4 * count, -1), p=p, tol=1e-8, max_nodes=5000)
    if not found.success:
        raise RuntimeError(found.message)
    forces, wall, tension, pose, normals = unpack(found.p)
    wall = wall if hand.wall else np.zeros(2)
    return State(pose, start.bases, normals, forces, wall, tension, found.x, found.y.reshape(count, 4, -1))


def stored(hand, state, names, nodes=61):
    """The arrays in which such a grasp is stored; the wall is called ``floor``."""
    arrays, contacts, lengths = {"object.pose": state.pose}, [], np.full(nodes - 1, hand.length / (nodes - 1))
    s = np.linspace(0.0, hand.length, nodes)
    for k, name in enumerate(names):
        curvature, difference = np.interp(s, state.s, state.shapes[k, 3]), state.differences[k]
        arrays |= {
            f"{name}.family": "clothoid",
            f"{name}.q": curvature,
            f"{name}.curvature_shapes": cases.shapes_of("clothoid", lengths),
            f"{name}.lengths": lengths,
            f"{name}.tip_curvature": curvature[-1],
            f"{name}.tensions": np.array([max(difference, 0.0), max(-difference, 0.0)]),
            f"{name}.base": state.bases[k],
            f"{name}.backbone": np.zeros((0, 4)),
        }
        contacts.append((f"{name}.tip", frame(state.normals[k])[0], [*state.forces[k], 0.0], hand.length))
    if hand.wall:
        contacts.append(("floor", np.array([0.0, -1.0]), [*state.wall, 0.0], np.nan))
    at = [state.pose[:2] + hand.radius * normal for _, normal, *_ in contacts]
    return arrays | cases.contact_arrays([(c[0], place, *c[1:], 0) for c, place in zip(contacts, at, strict=True)])
