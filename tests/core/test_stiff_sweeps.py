"""Steps that are implicit in the elasticity and damping of many elements, by sweeps."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.core import step_function
from continuum_grasp.scene import BasePose, Damping, Finger, Rod, Stops
from tests.finger_cases import relative_error
from tests.rods import order

# A cone of 1:4 of soft rubber with damping of its material, as a reader may print it.
CONE = Rod.model_validate(
    {
        "length": 0.25,
        "youngs_modulus": 2e6,
        "density": 1100.0,
        "sections": [{"to": 0.25, "thickness": [0.02, 0.005], "width": [0.02, 0.005]}],
    }
)
SPAN = 0.15
"""About the first period [s]."""


@lru_cache
def core_of(elements: int) -> cg.Core:
    """The finger, compiled."""
    damping = 1e-3 * CONE.stiffness  # a time constant of 1 ms
    base = BasePose(angle=-np.pi / 2)  # along X, so that it falls
    finger = Finger(rod=CONE, damping=Damping(material=damping), base=base)
    return cg.compile(cg.FingerModel(finger, family="clothoid", elements=elements, tip_force=False))


def swing(elements: int, steps: int) -> np.ndarray:
    """Tip (2) [m] of the finger let go from straight."""
    core = core_of(elements)
    end = core.rollout(np.zeros(core.model.nx), steps, SPAN / steps, method="extrapolated_euler")[-1]
    return np.asarray(core.tip(end[: core.model.n]))


@pytest.mark.deep
@pytest.mark.parametrize("elements", [8, 16, 32])
def test_steps_do_not_shrink_with_the_elements_and_have_order_two(elements):
    true = swing(elements, 6400)
    errors = [np.linalg.norm(swing(elements, steps) - true) / 0.25 for steps in (100, 200, 400)]
    assert errors[0] < 3e-4
    assert order(errors) == pytest.approx(2.0, abs=0.3)


def test_explicit_steps_of_that_length_are_not_stable():
    core = core_of(32)
    with pytest.raises(cg.NumericalError):
        core.rollout(np.zeros(core.model.nx), 400, SPAN / 400, method="rk4")


LAWS = {
    "none": {},
    "drag": {"damping": Damping(material=1e-4, per_arc=1e-5, quadratic=1e-5)},
    "stops": {"stops": Stops(curvature=4.0, stiffness_ratio=100.0)},
    "softening": {"softening": {"curvature": 4.0, "stiffness_ratio": 0.3}},
}


@pytest.mark.parametrize(("family", "law"), [("arc", "none"), *(("clothoid", law) for law in LAWS)])
def test_a_step_by_sweeps_is_that_of_the_dense_matrices(family, law):
    damped = {"damping": Damping(material=1e-4, per_arc=1e-5)}
    finger = Finger(rod=CONE.model_copy(), **damped | LAWS[law])
    model = cg.FingerModel(finger, family=family, elements=16)
    assert model.sweeps
    n, rng, h = model.n, np.random.default_rng(1), 1e-3
    limits = np.array(model.structure.coordinate_limits())
    x = np.concatenate([0.3 * limits, 5.0 * limits]) * rng.uniform(-1.0, 1.0, 2 * n)
    u, w = [0.01], [0.02, -0.01]
    found = np.array(step_function(model, "extrapolated_euler")(x, u, u, u, w, w, w, [], h)).ravel()

    # Written out with numpy's matrices.
    def step(x: np.ndarray, h: float) -> np.ndarray:
        q, qd = x[:n], x[n:]
        missing = np.array(model.inverse_dynamics(q, qd, np.zeros(n), u, w, [])).ravel()
        mass, stiffness, damping = (np.array(m) for m in model.internal(x, u, []))
        rate = np.linalg.solve(mass + h * damping + h**2 * stiffness, -missing - h * stiffness @ qd)
        return np.concatenate([q + h * (qd + h * rate), qd + h * rate])

    assert relative_error(found, 2.0 * step(step(x, h / 2), h / 2) - step(x, h)) <= 1e-7
