"""The error that the steps in time leave: estimated, within the tolerance, reported, against DOP853 at 1e-12."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from continuum_grasp.base import InputError, NumericalError
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene, Timing, load
from continuum_grasp.simulation import integrate
from tests.marks import few
from tests.rods import NITINOL, ROOT, force, integrated, order, rod_scene, without_compiler  # noqa: F401

PULLED_UP = {"pose": "equilibrium", "held_by": [force(0.6, (0.0, 0.8))]}
"""A force of 0.8 N at the tip lifts the finger, and lets go."""


def released(family, elements, step, duration=0.5, method="auto", tolerance=1e-4, **keys):
    """The paper's rod, let go from above, undamped."""
    time = {"duration": duration, "step": step, "method": method, "tolerance": tolerance}
    return rod_scene(NITINOL, family, elements, time=time, **{"initial": PULLED_UP, **keys})


def ends(trajectory, states):
    """Ends of the elements (T, 2, N) [m] of a motion without inputs."""
    q = states[:, : trajectory.n]
    return trajectory.core.batch("joints", q, np.zeros((len(q), trajectory.model.nu)), None)[0]


def true_error(trajectory, truth):
    """Greatest error of the elements' ends per length, against states of an independent integration."""
    difference = ends(trajectory, trajectory.x) - ends(trajectory, truth)
    return np.hypot(*difference.transpose(1, 0, 2)).max() / trajectory.length


CASES = {
    "4 arcs": ("arc", 4, 1e-3),
    "2 matched clothoids, far apart": ("matched_clothoid", 2, 1e-2),
    "2 matched clothoids, very far apart": ("matched_clothoid", 2, 0.1),
    "4 clothoids": ("clothoid", 4, 1e-3),
    "dense output": ("arc", 2, 2e-4),
}


@pytest.mark.deep
@pytest.mark.parametrize("case", few(CASES, 3))
def test_the_error_stays_within_the_tolerance_and_the_estimate_covers_it(case):
    family, elements, step = CASES[case]
    truth = None
    for tolerance in (1e-3, 1e-4, 1e-6):
        found = integrate(released(family, elements, step, tolerance=tolerance))
        truth = integrated(found.scene) if truth is None else truth
        error = true_error(found, truth)
        assert found.warnings == ()
        assert error <= found.time_error
        assert found.time_error <= tolerance


def test_ten_seconds_without_damping_keep_the_tolerance():
    found = integrate(released("matched_clothoid", 2, 1e-2, duration=10.0))
    assert true_error(found, integrated(found.scene)) <= found.time_error <= 1e-4


@pytest.mark.deep
@pytest.mark.parametrize(("method", "steps"), [("rk4", (2e-3, 1e-3, 5e-4)), ("rodas", (2e-3, 1e-3, 5e-4))])
def test_fixed_steps_report_an_error_of_order_4_and_warn(method, steps, without_compiler):  # noqa: F811
    """Between once and eight times the true one; the tolerance of the warning lies between the second and the third."""
    scene = released("arc", 2, steps[0], method=method)
    truth, reported, true = None, [], []
    for step in steps:
        found = integrate(released("arc", 2, step, method=method, tolerance=1e-10))
        truth = integrated(scene) if truth is None else truth
        every = round(steps[0] / step)
        reported.append(found.time_error)
        difference = (ends(found, found.x[::every]) - ends(found, truth)).transpose(1, 0, 2)
        true.append(np.hypot(*difference).max() / found.length)
    assert np.all(np.array(true) <= reported)
    assert np.all(np.array(reported) <= 8.0 * np.array(true))
    assert np.all(np.abs(order(reported) - 4.0) < 0.8)
    limit = float(np.sqrt(reported[1] * reported[2]))
    coarse, fine = (integrate(released("arc", 2, step, method=method, tolerance=limit)) for step in steps[1:])
    assert fine.warnings == ()
    (warning,) = coarse.warnings
    assert warning.startswith(
        f"steps of {steps[1]:g} s leave about {reported[1]:.2g} of the length (time.tolerance is "
    )
    assert "time.method: auto" in warning


@pytest.mark.deep
def test_a_stiff_scene_is_controlled_too():
    """Implicit steps, against the variable-step method."""
    keys = {"duration": 0.2, "tip_mass": 0.02, "finger": {"damping": {"material": 8e-3}}}
    exact = integrate(released("clothoid", 4, 1e-2, method="reference", **keys))
    for tolerance in (1e-4, 1e-7):
        found = integrate(released("clothoid", 4, 1e-2, tolerance=tolerance, **keys))
        assert found.statistics["method"] == "rodas"
        assert found.warnings == ()
        assert true_error(found, exact.x) <= 4.0 * found.time_error
        assert found.time_error <= tolerance
    assert exact.time_error < 1e-7


@pytest.mark.deep
@pytest.mark.parametrize("interpolation", few(["smooth", "linear"], 1))
def test_loads_and_inputs_that_vary_are_followed_within_the_tolerance(interpolation):
    """Kinks and jumps within a step too, with no order 4; truth in steps that end at them."""
    push = {"times": [0.013, 0.0517, 0.12], "values": [[0.0, 0.0], [0.3, 0.2], [0.0, 0.0]]}
    loads = [force(0.6, {**push, "interpolation": interpolation})]
    found = integrate(released("clothoid", 2, 1e-2, duration=0.2, loads=loads))
    exact = integrate(released("clothoid", 2, 1e-4, duration=0.2, loads=loads, method="reference"))
    assert found.warnings == ()
    assert true_error(found, exact.x[::100]) <= found.time_error <= 1e-4


@pytest.mark.deep
def test_contacts_are_followed_within_the_tolerance():
    changes = {"time.duration": 0.4, "time.step": 0.002}
    config = ROOT / "configs/simulate/swing_against_disc.yaml"
    found, finer = (integrate(load(config, {**changes, "time.tolerance": size})) for size in (1e-4, 2e-6))
    assert found.warnings == ()
    assert np.hypot(*(found.tip - finer.tip).T).max() / found.length <= found.time_error <= 1e-4
    assert finer.statistics["substeps"] > found.statistics["substeps"]


def test_a_tolerance_out_of_reach_is_reported(monkeypatch):
    monkeypatch.setattr(sys.modules[integrate.__module__], "_MOST_WORK", {"rk4": 600, "rodas": 60})
    found = integrate(released("arc", 4, 1e-2, tolerance=1e-9))
    (warning,) = found.warnings
    assert "the motion is too sensitive for more" in warning
    assert found.time_error > 1e-9
    assert len(found.t) == 51
    assert found.statistics["substeps"] == 12


def test_levels_are_rollouts_of_longer_steps(without_compiler):  # noqa: F811
    """On the virtual machine and in C, with inputs that vary and a remainder that no longer step shares."""
    model = FingerModel(released("clothoid", 2, 1e-3).finger)
    t = np.arange(2 * 7 * 2 + 1) / 28.0
    u, w = 0.02 * np.sin(5 * t)[:, None], 0.1 * np.cos(3 * t)[:, None] @ np.ones((1, model.nw))
    x0, p = np.full((2, model.nx), 0.1), np.array(model.p_nominal)
    for compiled in (False, True):
        core = Core(model, compiled=compiled)
        states, valid = core.prepare_rollout("rk4").levels(x0, (1, 4), 2, 7, 2, 5e-4, u, w, p)
        assert valid.tolist() == [7, 3]
        assert states[0] == pytest.approx(core.rollout(x0[0], 7, 1e-3, u=u, w=w, substeps=2), abs=1e-14)
        longer = core.rollout(x0[0], 3, 2e-3, u=u[::4][:7], w=w[::4][:7])
        assert states[1] == pytest.approx(longer, abs=1e-14)


def test_a_tolerance_may_be_in_per_cent_and_must_be_within_reach():
    assert released("arc", 2, 1e-2, tolerance="0.01 %").time.tolerance == pytest.approx(1e-4)
    for wrong in (0.0, 1e-12, 0.5, "much"):
        with pytest.raises(InputError, match="tolerance"):
            Timing(duration=1.0, step=0.1, tolerance=wrong)


@pytest.mark.parametrize("quadratic", [1e-6, 2e-3])
def test_quadratic_damping_at_rest_is_met(quadratic):
    """Let go by a moment that accelerates the tip at once, against the variable-step method."""
    finger = {"damping": {"quadratic": quadratic}}
    held = {"pose": "equilibrium", "held_by": [{"kind": "moment", "at": 0.6, "moment": 0.2}]}
    scene = released("arc", 2, 5e-3, duration=0.1, initial=held, finger=finger)
    found = integrate(scene)
    exact = integrate(released("arc", 2, 5e-3, 0.1, "reference", initial=held, finger=finger))
    assert found.warnings == ()
    assert true_error(found, exact.x) <= found.time_error <= 1e-4
    # It moves far faster at first than later.
    assert found.statistics["substeps"] <= 32
    assert found.statistics["steps_taken"] <= 4_000


@pytest.mark.parametrize("method", ["rodas", "rk4"])
def test_a_motion_that_is_not_finite_is_advised_another_method(method):
    held = {"pose": "equilibrium", "held_by": [{"kind": "moment", "at": 0.6, "moment": 0.2}]}
    scene = released("arc", 2, 0.05, 0.05, method, initial=held, finger={"damping": {"quadratic": 1.0}})
    with pytest.raises(NumericalError, match=r"time\.method: auto$"):
        integrate(scene)


def test_quadratic_damping_needs_no_shorter_steps_on_winches():
    """The cables set the length of implicit steps, whatever drags; the motion is that of the variable-step method."""
    length = 0.12
    offset, bend = 0.005, 1.5
    drive = {"kind": "length", "time_constant": 0.02, "pretension": 3.6}
    tendons = {
        "offset": offset,
        "min_tension": 0.0,
        "max_tension": 1e4,
        "axial_stiffness": 1e4,
        "series_stiffness": 3e4,
    }
    ramps = [{"times": [0.0, 0.05], "values": [0.0, side * bend * offset]} for side in (1.0, -1.0)]
    made = {
        "finger": {
            "rod": {"length": length, "linear_density": 0.05, "bending_stiffness": 2.88e-3},
            "base": {"angle": -0.5 * np.pi},
            "half_thickness": 0.006,
            "damping": {"quadratic": 7.4e-5},
            "tendons": {**tendons, "drive": drive},
        },
        "gravity": [0.0, -9.81],
        "actuation": {"lengths": ramps},
        "initial": {"pose": "straight"},
        "fidelity": {"family": "arc", "elements": 3},
    }
    time = {"duration": 0.06, "step": 2e-3}
    found, exact = (
        integrate(Scene.model_validate({**made, "time": {**time, "method": m}})) for m in ("auto", "reference")
    )
    assert true_error(found, exact.x) <= found.time_error <= 1e-4
    assert found.statistics["method"] == "extrapolated_euler"
    assert found.statistics["substeps"] <= 32
