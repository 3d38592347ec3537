"""The NiTi rod of the paper and a unit rod, for the tests of simulation, statics, modes and code generation."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import initial_state

ROOT = Path(__file__).parents[1]
HORIZONTAL, UPRIGHT, HANGING = -math.pi / 2, 0.0, math.pi
"""Base angles with which the undeformed rod points along world +X, +Y and -Y."""
NITINOL = {"length": 0.6, "diameter": 0.002, "density": 6450.0, "youngs_modulus": 60e9}
UNIT = {"length": 1.0, "linear_density": 1.0, "bending_stiffness": 1.0}
"""Rod with L = rho A = E I = 1, without rotary inertia."""
WEIGHT = 9.81


@pytest.fixture
def without_compiler(monkeypatch):
    """Run on CasADi's virtual machine, which starts at once and gives the same numbers."""
    monkeypatch.setenv("CC", "")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it is given once
        Core(FingerModel(rod_scene(UNIT, "arc", 1)))


def rod_scene(
    rod: dict[str, Any],
    family: str = "matched_clothoid",
    elements: Any = 2,
    *,
    angle: float = HORIZONTAL,
    tip_mass: float = 0.0,
    gravity: tuple[float, float] = (0.0, -WEIGHT),
    finger: dict[str, Any] | None = None,
    fidelity: dict[str, Any] | None = None,
    **keys: Any,
) -> Scene:
    """A scene around one rod; further keys as in a configuration."""
    masses = [{"at": rod["length"], "mass": tip_mass}] if tip_mass else []
    base = {"position": [0.0, 0.0], "angle": angle}
    data = {
        "finger": {"rod": rod, "masses": masses, "base": base, **(finger or {})},
        "gravity": gravity,
        "fidelity": {"family": family, "elements": elements, "bending_range": 4.0, **(fidelity or {})},
        **keys,
    }
    return Scene.model_validate(data)


def force(at: float, value: Any, follows: bool = False) -> dict[str, Any]:
    """A point force as in a configuration."""
    return {"kind": "force", "at": at, "force": value, "follows": follows}


def order(errors: Any, ratio: float = 2.0) -> np.ndarray:
    """Observed orders between successive refinements by a ratio."""
    values = np.asarray(errors, dtype=float)
    return np.log(values[:-1] / values[1:]) / math.log(ratio)


def after(span: float, rate: Callable[[np.ndarray], Any], x0: Any) -> np.ndarray:
    """Where a motion of a given rate is after a time, by DOP853 at a tolerance of 1e-12."""
    return solve_ivp(lambda t, x: np.array(rate(x)).ravel(), (0.0, span), x0, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]


def integrated(scene: Scene, u: Any = None, w: Any = None) -> np.ndarray:
    """States (T, nx) of a motion by DOP853 at a tolerance of 1e-12, with inputs given as functions of time."""
    model = FingerModel(scene)
    own, u, w = Core(model), u or (lambda t: np.zeros(model.nu)), w or (lambda t: np.zeros(model.nw))
    t = np.linspace(0.0, scene.time.duration, round(scene.time.duration / scene.time.step) + 1)
    x0 = initial_state(scene, model)
    found = solve_ivp(
        lambda t, x: own.forward_dynamics(x, u(t), w(t)), (0.0, t[-1]), x0, "DOP853", t, rtol=1e-12, atol=1e-13
    )
    return found.y.T
