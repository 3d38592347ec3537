"""Scenes and oracles of the tests of plans."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

import continuum_grasp as cg
from continuum_grasp.addons.planning import PlanScene
from continuum_grasp.control import Prediction
from tests.truth.differences import differences

ROD = {"length": 0.3, "diameter": 0.002, "density": 6450.0, "youngs_modulus": 60e9}


def finger(damping: float = 1e-4) -> cg.Finger:
    """A rod without tendons, straight at rest."""
    return cg.Finger.model_validate({"rod": ROD, "damping": {"material": damping}})


def small(**changes) -> PlanScene:
    """A small plan of one arc, without weight."""
    damping = changes.pop("damping", 1e-4)
    keys = {
        "finger": finger(damping),
        "gravity": (0.0, 0.0),
        "fidelity": cg.Fidelity(family="arc", elements=1),
        "input": {"moment_max": 0.3},
        "bounds": {"curvature": None},
        "goal": {"bending": (0.5,)},
        "duration": 0.1,
        "intervals": 25,
    }
    return PlanScene(**(keys | changes))


def two_arcs(**changes) -> PlanScene:
    """The same of two arcs that hang."""
    keys = {"fidelity": cg.Fidelity(family="arc", elements=2), "gravity": (0.0, 9.81), "goal": {"bending": (0.4, 0.2)}}
    return small(**(keys | {"duration": 0.15, "intervals": 30} | changes))


def linearized(scene: PlanScene) -> tuple[np.ndarray, np.ndarray]:
    """A and B of the straight finger at rest, by central differences."""
    model = Prediction(scene)
    p, n = np.array(model.p_nominal), model.nx

    def rate(x, u):
        return np.array(model.dynamics(x, u, p)).ravel()

    straight, still = np.zeros(n), np.zeros(model.nu)
    return differences(lambda x: rate(x, still), straight), differences(lambda u: rate(straight, u), still)


def held(a: np.ndarray, b: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition over a time h under a constant input."""
    n, m = b.shape
    whole = expm(h * np.block([[a, b], [np.zeros((m, n + m))]]))
    return whole[:n, :n], whole[:n, n:]
