"""One finger grasping a disc, solved another way: geometry by roots, forces by linear programming.

Two elements, both contacts on, object and base fixed, finger on the left of its base. Nothing of the
package's own mechanics is used: the backbone is integrated here, its derivatives are differences.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog, minimize_scalar, root

GAUSS_X, GAUSS_W = np.polynomial.legendre.leggauss(40)


@dataclass
class Plant:
    """Numbers of the grasp, SI."""

    length: float
    stiffness: float
    offset: float
    tension_max: float
    half_thickness: float
    base: tuple[float, float]
    angle: float
    centre: tuple[float, float]
    radius: float
    mass: float
    friction: float
    normal_max: float
    palm_angle: float | None
    gravity: tuple[float, float] = (0.0, 0.0)
    lift: float = 0.0
    weight_per_length: float = 0.0
    tip_mass: float = 0.0

    @property
    def rho(self) -> float:
        return self.radius + self.half_thickness


def shape(plant: Plant, first: tuple[float, float], second: tuple[float, float], l1: float):
    """Joint, joint angle, tip, tip angle, mean point; curvature linear in each element (start, end)."""
    point, phi = np.array(plant.base, dtype=float), plant.angle
    joint, first_moment = [], np.zeros(2)
    for (a, b), length in ((first, l1), (second, plant.length - l1)):
        s = 0.5 * length * (GAUSS_X + 1)
        w = 0.5 * length * GAUSS_W
        angle = phi + a * s + (b - a) * s**2 / (2 * length)
        tangent = np.array([-np.sin(angle), np.cos(angle)])
        first_moment += point * length + (tangent * (length - s)) @ w
        point = point + tangent @ w
        phi = phi + 0.5 * (a + b) * length
        joint.append((point, phi))
    return joint[0][0], joint[0][1], joint[1][0], joint[1][1], first_moment


def clothoid_geometry(plant: Plant, l1: float, guess):
    """Curvatures at base, joint and tip for which the joint is tangent to the disc and the tip touches it."""

    def equations(k):
        rc, pc, rt, _, _ = shape(plant, (k[0], k[1]), (k[1], k[2]), l1)
        n = np.array([math.cos(pc), math.sin(pc)])
        gap = rc - np.array(plant.centre) - plant.rho * n
        return [gap[0], gap[1], np.linalg.norm(rt - plant.centre) - plant.rho]

    found = root(equations, guess, tol=1e-13)
    return found.x if found.success and np.abs(equations(found.x)).max() < 1e-10 else None


def arc_geometry(plant: Plant):
    """Length of the first arc and both curvatures: tangent at the joint, and wrapped from there on."""

    def equations(v):
        k1, l1 = v
        rc, pc, *_ = shape(plant, (k1, k1), (0.0, 0.0), l1)
        n = np.array([math.cos(pc), math.sin(pc)])
        return rc - np.array(plant.centre) - plant.rho * n

    found = root(equations, [1.0 / plant.rho / 3, 0.4 * plant.length], tol=1e-13)
    return found.x[0], found.x[1]


def depth(plant: Plant, first: tuple[float, float], second: tuple[float, float], l1: float) -> float:
    """Deepest penetration of the backbone into the disc, or behind the joint into the palm [m]."""
    worst = -np.inf
    point, phi = np.array(plant.base, dtype=float), plant.angle
    for behind, ((a, b), length) in enumerate(((first, l1), (second, plant.length - l1))):
        s = np.linspace(0, length, 801)
        angle = phi + a * s + (b - a) * s**2 / (2 * length)
        t = np.array([-np.sin(angle), np.cos(angle)])
        walked = np.cumsum(0.5 * (t[:, 1:] + t[:, :-1]), axis=1) * (s[1] - s[0])
        r = point[:, None] + np.concatenate([np.zeros((2, 1)), walked], axis=1)
        off = r - np.array(plant.centre)[:, None]
        worst = max(worst, (plant.rho - np.linalg.norm(off, axis=0)).max())
        if behind and plant.palm_angle is not None:
            height = plant.radius + np.array([math.cos(plant.palm_angle), math.sin(plant.palm_angle)]) @ off
            worst = max(worst, (plant.half_thickness - height[1:]).max())
        point, phi = r[:, -1], angle[-1]
    return worst


def forces(plant: Plant, curvatures, l1: float, family: str, sides: int = 96):
    """Least net tension at a posture, by linear programming; None where there is none.

    Unknowns: T, then N, f, f_z of joint, tip and palm. Cones out of the plane are outer polygons of so many
    sides.
    """
    arcs = family == "arc"
    n = 2

    def pose(q):
        if arcs:
            return shape(plant, (q[0], q[0]), (q[1], q[1]), l1)
        return shape(plant, (q[0], q[1]), (q[1], curvatures[2]), l1)

    q0 = np.array(curvatures[:n], dtype=float)
    _, pc, rt, _, _ = pose(q0)
    step = 1e-5
    derivative = [
        [(np.asarray(a) - np.asarray(b)) / (2 * step) for a, b in zip(pose(q0 + e), pose(q0 - e), strict=True)]
        for e in step * np.eye(n)
    ]
    lengths = (l1, plant.length - l1)

    def elastic(q):
        if arcs:
            return 0.5 * plant.stiffness * sum(length * k * k for length, k in zip(lengths, q, strict=True))
        nodes = [*q, curvatures[2]]
        return sum(
            plant.stiffness * length / 6 * (a * a + a * b + b * b)
            for length, a, b in zip(lengths, nodes, nodes[1:], strict=False)
        )

    centre = np.array(plant.centre)
    n_c = np.array([math.cos(pc), math.sin(pc)])
    n_t = (rt - centre) / np.linalg.norm(rt - centre)
    normals = [n_c, n_t]
    if plant.palm_angle is not None:
        normals.append(-np.array([math.cos(plant.palm_angle), math.sin(plant.palm_angle)]))
    count = len(normals)
    tangents = [np.array([-m[1], m[0]]) for m in normals]
    width = 1 + 3 * count
    rows, right = [], []
    for i in range(n):
        row = np.zeros(width)
        d = derivative[i]
        row[0] = plant.offset * d[3]
        for c, (dr, dphi) in enumerate(((d[0], d[1]), (d[2], d[3]))):
            row[1 + 3 * c] = dr @ normals[c]
            row[2 + 3 * c] = dr @ tangents[c] - plant.half_thickness * dphi
        rows.append(row)
        stiff = (elastic(q0 + step * np.eye(n)[i]) - elastic(q0 - step * np.eye(n)[i])) / (2 * step)
        weight = plant.weight_per_length * d[4] + plant.tip_mass * d[2]
        right.append(stiff - weight @ np.array(plant.gravity))
    if not arcs:
        row = np.zeros(width)
        row[0], row[5] = plant.offset, -plant.half_thickness
        rows.append(row)
        right.append(plant.stiffness * curvatures[2])
    force, moment, lift, tilt = np.zeros((2, width)), np.zeros(width), np.zeros(width), np.zeros((2, width))
    for c in range(count):
        force[:, 1 + 3 * c], force[:, 2 + 3 * c] = normals[c], tangents[c]
        moment[2 + 3 * c] = 1.0
        lift[3 + 3 * c] = 1.0
        tilt[:, 3 + 3 * c] = normals[c]
    rows += [*force, moment, lift]
    right += [*(plant.mass * np.array(plant.gravity)), 0.0, plant.mass * plant.lift]
    if plant.lift:
        rows += [*tilt]
        right += [0.0, 0.0]
    cone, zero = [], []
    angles = 2 * np.pi * np.arange(sides) / sides if plant.lift else np.array([0.0, np.pi])
    for c in range(count):
        for a in angles:  # outer polygon: mu N >= f cos a + f_z sin a
            row = np.zeros(width)
            row[1 + 3 * c], row[2 + 3 * c], row[3 + 3 * c] = -plant.friction, math.cos(a), math.sin(a)
            cone.append(row)
            zero.append(0.0)
    free = (None, None)
    bounds = [(0, plant.tension_max)] + [(0, plant.normal_max), free, free if plant.lift else (0, 0)] * count
    scale = np.abs(np.array(rows)).max(axis=1)
    found = linprog(
        np.eye(width)[0],
        A_ub=cone,
        b_ub=zero,
        A_eq=np.array(rows) / scale[:, None],
        b_eq=np.array(right) / scale,
        bounds=bounds,
        method="highs",
    )
    return found.x if found.status == 0 else None


def least_tension_arcs(plant: Plant):
    """(tension, curvatures, l1) of the arc grasp, tension None where no forces exist."""
    k1, l1 = arc_geometry(plant)
    k2 = 1 / plant.rho
    fits = depth(plant, (k1, k1), (k2, k2), l1) < 1e-6
    x = forces(plant, (k1, k2), l1, "arc") if fits else None
    return (None if x is None else x[0]), (k1, 1 / plant.rho), l1


def least_tension_clothoids(plant: Plant, count: int = 120, tolerance: float = 2e-7):
    """(tension, curvatures, l1) over the one-parameter geometry of two matched clothoids."""
    k1, _ = arc_geometry(plant)
    grid = np.linspace(0.2, 0.8, count) * plant.length

    def value(l1, guess):
        k = clothoid_geometry(plant, l1, guess)
        if k is None or depth(plant, (k[0], k[1]), (k[1], k[2]), l1) > tolerance:
            return np.inf, k
        x = forces(plant, k, l1, "matched_clothoid")
        return (np.inf if x is None else x[0]), k

    results = []
    for guess in ([k1, 0.7 / plant.rho, 1.5 / plant.rho], [k1, 1 / plant.rho, 1 / plant.rho]):
        k = np.array(guess)
        for l1 in grid:
            tension, found = value(l1, k)
            if found is not None:
                k = found
                results.append((tension, l1, found))
            else:
                k = np.array(guess)
    best = min(results, key=lambda r: r[0])
    if not np.isfinite(best[0]):
        return None, best[2], best[1]
    step = grid[1] - grid[0]
    fine = minimize_scalar(
        lambda l1: min(value(l1, best[2])[0], 1e6),
        bounds=(best[1] - step, best[1] + step),
        method="bounded",
        options={"xatol": 1e-7 * plant.length},
    )
    if fine.fun < best[0]:
        return fine.fun, value(fine.x, best[2])[1], fine.x
    return best[0], best[2], best[1]
