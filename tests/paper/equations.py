"""The equations of the paper and the functions of two arcs that stand for them, with what they err by.

``python -m tests.paper.equations`` prints the table of docs/paper.md. Truth is the finger in 50 digits by quadrature,
over random shapes, rates, tensions and forces, and where a bend is zero.
"""

from __future__ import annotations

import numpy as np

import continuum_grasp as cg
from tests.truth import Rod, TruthFinger

L1, L2, E, REST = 0.25, 0.35, 0.005, 0.4
FORCES = (0.1, 0.2, -0.3, 0.4)
TENSIONS = (3.0, 1.0)
FINGER = cg.Finger(
    rod=cg.Rod(length=L1 + L2, linear_density=0.02, bending_stiffness=0.047, rotary_inertia=1e-6),
    rest_curvature=REST,
    damping={"per_arc": 1e-4, "material": 3e-5},
    masses=[{"at": L1, "mass": 0.01}, {"at": L1 + L2, "mass": 0.02}],
    tendons={"offset": E, "max_tension": 40.0},
    base={"angle": -0.6},
)
MODEL = cg.FingerModel(FINGER, family="arc", elements=2, contacts=(L1,), gravity=(1.0, -9.81))
SHAPES = 12
"""Random bends up to 2 pi / 3, the paper's range, with random rates; each once more with a first and a second bend of
zero, where printed closed forms are singular."""


def cases() -> list[tuple[np.ndarray, np.ndarray]]:
    """Bends and rates."""
    rng = np.random.default_rng(2014)
    drawn = []
    for _ in range(SHAPES):
        bends, rates = rng.uniform(-2.0 * np.pi / 3.0, 2.0 * np.pi / 3.0, 2), rng.uniform(-3.0, 3.0, 2)
        drawn += [(bends, rates), (bends * [0.0, 1.0], rates), (bends * [1.0, 0.0], rates)]
    return [*drawn, (np.zeros(2), np.array([2.0, -3.0]))]


def true(q: np.ndarray, rates: np.ndarray) -> Rod:
    """The same finger in 50 digits."""
    finger = TruthFinger(
        [L1, L2],
        mass_per_length=0.02,
        rotary_inertia=1e-6,
        bending_stiffness=0.047,
        rest_curvature=REST,
        masses=((L1, 0.01), (L1 + L2, 0.02)),
        gravity=(1.0, -9.81),
        base_angle=-0.6,
        material_damping=3e-5,
        element_damping=1e-4,
    )
    return Rod(finger, list(q), list(rates))


def _pairs(q: np.ndarray, qd: np.ndarray) -> dict[str, tuple[object, object]]:
    """What the model says and what is true, by equations."""
    rod, u, p = true(q, qd), TENSIONS, []
    x = [*q, *qd]
    applied = [(L1, *FORCES[:2]), (L1 + L2, *FORCES[2:])]
    moment = (TENSIONS[0] - TENSIONS[1]) * E
    places = (L1 / 2, L1, L1 + L2 / 2, L1 + L2)
    return {
        "(1)-(3)": ([MODEL.orientation(q, u, at, p) for at in places], [rod.orientation(at) for at in places]),
        "(4)-(9)": ([MODEL.position(q, u, at, p) for at in places], [rod.position(at) for at in places]),
        "(13)-(18)": ([MODEL.jacobian(q, u, at, p) @ qd for at in places], [rod.velocity(at) for at in places]),
        "(22)-(24)": ([MODEL.jacobian(q, u, at, p) for at in places], [rod.jacobian(at) for at in places]),
        "(10)-(12), (19), (20), (25)-(29)": (MODEL.gravity(q, u, p), rod.gravity),
        "(30)-(32)": (MODEL.elastic(q, u, p), rod.elastic),
        "(21), (33)-(37)": (MODEL.mass_matrix(q, u, p), rod.mass),
        "(38)": (MODEL.bias(q, qd, u, p), rod.bias),
        "(39), (40)": (MODEL.damping(q, qd, u, p), rod.damping),
        "(41)": (MODEL.external_force(q, u, FORCES, p), rod.applied(applied)),
        "(42)": (MODEL.actuation(q, u, p), rod.applied((), moment)),
        "(43)": (MODEL.forward_dynamics(x, u, FORCES, p)[2:], rod.acceleration(applied, moment)),
    }


def errors() -> dict[str, float]:
    """Greatest error of each equation over all cases, per its greatest size."""
    found: dict[str, list[tuple[float, float]]] = {}
    for bends, rates in cases():
        q = bends - REST * np.array([L1, L2])
        for name, pair in _pairs(q, rates).items():
            a, b = (np.array([_flat(one) for one in np.atleast_1d(np.array(v, dtype=object))]).ravel() for v in pair)
            found.setdefault(name, []).append((float(np.abs(a - b).max()), float(np.abs(b).max())))
    return {name: max(off for off, _ in rows) / max(size for _, size in rows) for name, rows in found.items()}


def _flat(value: object) -> np.ndarray:
    return np.ravel(np.array(value, dtype=float))


if __name__ == "__main__":
    for name, error in errors().items():
        print(f"| {name} | {error:.0e} |")
