"""Objects that move in a controller's prediction: friction of the table in closed form, terms, sensors, a loop."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import Plant
from continuum_grasp.control import Prediction, stages_of
from continuum_grasp.model import System
from continuum_grasp.scene import Circle, ContactLaw, Surroundings, Table, load
from tests.truth.differences import differences

ROOT = Path(__file__).parents[2]
BAR = ROOT / "configs/mpc/turn_bar.yaml"
FINGER = load(ROOT / "configs/fingers/hand_finger.yaml")
MASS, RADIUS, FRICTION, ARM, GRAVITY = 0.2, 0.03, 0.3, 0.02, 9.81
SPEED = 1e-4
"""Of slip at which friction has 70 % of its limit [m/s]."""


def lying(**law) -> System:
    """A disc on a table, out of the finger's reach."""
    body = Circle(shape="circle", diameter=2 * RADIUS, mass=MASS, position=(1.0, 1.0), angle=0.3)
    around = Surroundings(
        object=body,
        object_moves=True,
        out_of_plane_gravity=GRAVITY,
        table=Table(friction=FRICTION, friction_radius=ARM, stays=True),
        contact_law=ContactLaw(stiffness=2000.0, friction=0.5, **law),
    )
    return System(FINGER, surroundings=around, family="arc", elements=1, parameters=[], gravity=(0.0, 0.0))


@pytest.mark.parametrize("turns", [False, True])
def test_an_object_that_slides_or_turns_stops_where_coulomb_has_it(turns):
    system = lying(slip_speed=SPEED)
    rest, pose = np.array(system.state()), system.object_states
    rates = slice(pose.stop, pose.stop + 3)
    moving = rest.copy()
    speed = np.array([0.0, 0.0, 20.0]) if turns else np.array([0.24, -0.32, 0.0])
    moving[rates] = speed
    none = np.zeros(system.nw)

    def rate(t, x):
        full = rest.copy()
        full[pose.start :] = x
        return np.array(system.forward_dynamics(full, [0.0] * system.nu, none, [])).ravel()[pose.start :]

    end = solve_ivp(rate, (0.0, 0.6), moving[pose.start :], method="LSODA", rtol=1e-8, atol=1e-10).y[:3, -1]
    moved = end - rest[pose]
    # v^2 / 2a: friction mu m g, or its moment about the middle.
    inertia = 0.5 * MASS * RADIUS**2
    slowing = FRICTION * MASS * GRAVITY * ARM / inertia if turns else FRICTION * GRAVITY
    size = np.linalg.norm(speed)
    assert moved == pytest.approx(speed / size * size**2 / (2.0 * slowing), rel=2e-3, abs=1e-6)


@pytest.mark.parametrize("lever", [0.0, 0.005, 0.02, 0.06])
def test_a_slow_push_turns_an_object_about_the_point_that_its_friction_sets(lever):
    """By the ellipsoid's normal it turns about a point at friction_radius^2 / lever beyond its middle."""
    system = lying(slip_speed=SPEED)
    push = 0.9 * FRICTION * MASS * GRAVITY / math.hypot(1.0, lever / ARM)
    w = np.zeros(system.nw)
    w[-3:] = push, 0.0, -lever * push
    rest, pose = np.array(system.state()), system.object_states
    rates = slice(pose.stop, pose.stop + 3)

    def unbalanced(v):
        full = rest.copy()
        full[rates] = 1e-3 * v
        return np.array(system.forward_dynamics(full, [0.0] * system.nu, w, [])).ravel()[rates]

    found = root(unbalanced, [0.1, 0.0, -0.1 * lever / ARM**2], tol=1e-12)
    assert found.success
    v, across, turning = found.x
    assert across == pytest.approx(0.0, abs=1e-9)
    assert turning == pytest.approx(-v * lever / ARM**2, rel=1e-6, abs=1e-9)
    # 90 % of the limit, of force and moment together.
    size = 1e-3 * math.hypot(v, ARM * turning)
    assert size / math.hypot(size, SPEED) == pytest.approx(0.9, rel=1e-6)


def pressing(stages, prediction, rng):
    """A state in which the tip of the straight finger is pressed into the side of the bar."""
    x = np.array([*prediction.at_rest(np.zeros(prediction.system.n), [5.0, 5.0]), 5.0, 5.0])
    x[: stages.nd] += 1e-3 * rng.normal(size=stages.nd)
    at = list(stages.x_names).index("object_x [m]")
    x[at] = 0.0153  # half of both thicknesses, less 0.7 mm
    x[at + 3 : at + 6] = (0.01, -0.02, 0.3)
    return x


def test_derivatives_of_a_step_that_pushes_are_differences():
    scene = load(BAR).changed({"controller.horizon.method": "sdirk2_contact"})
    prediction = Prediction(scene)
    stages = stages_of(scene, prediction)
    step = stages.step
    x = pressing(stages, prediction, np.random.default_rng(0))
    u, h = np.array([5.0, 5.0]), 1e-3
    force = np.array(prediction.contact_force(x[: stages.nd], u, stages.p_nominal)).item()
    assert force > 0.1
    a = np.array(step(x, u, stages.p_nominal, h)[1])
    end = lambda x: step(x, u, stages.p_nominal, h)[0]  # noqa: E731
    expected = differences(end, x, 1e-7 * np.maximum(1.0, np.abs(x)))
    assert np.all(np.abs(a - expected) <= 1e-4 * np.maximum(1.0, np.abs(expected).max(axis=0)))


@pytest.mark.parametrize(
    ("stiffness", "horizon", "expected"),
    [
        (2000.0, {}, ("sdirk2", 1)),
        (20000.0, {}, ("sdirk2_contact", 2)),
        (20000.0, {"method": "sdirk2"}, ("sdirk2", 2)),
        (2000.0, {"substeps": 2, "method": "rk4"}, ("rk4", 2)),
    ],
)
def test_steps_resolve_the_contact(stiffness, horizon, expected):
    scene = load(BAR, [f"contact_law.stiffness={stiffness}"])
    changed = scene.controller.horizon.model_copy(update=horizon)
    scene = scene.model_copy(update={"controller": scene.controller.model_copy(update={"horizon": changed})})
    stages = stages_of(scene)
    assert (stages.method, stages.substeps) == expected


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["object_moves=false", "table=null", "out_of_plane_gravity=0"], "object_angle: needs an object that moves"),
        (["estimator.measured.object=null"], "object_moves: needs estimator.measured.object"),
        (["controller.cost.gap.of=[finger.9]"], "controller.cost.gap.of: expected some of finger.tip"),
        (["reference.gap=null"], "controller.cost.gap: needs reference.gap"),
        (["reference.object_position=[0.0, 0.2]"], "reference.object_position: nothing tracks it"),
        (["table.point=[0.0, 0.0]", "table.normal_angle=0.0"], "stays: works only for a table parallel to the plane"),
    ],
)
def test_scenes_that_make_no_sense_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        load(BAR, changes)


@pytest.fixture(scope="module")
def controller():
    return cg.Controller(BAR, deadline=math.inf)


@pytest.mark.deep
def test_measurements_go_by_name(controller):
    plant = Plant(load(BAR), controller.prediction)
    assert plant.sensors.names == controller.measurement_names
    assert plant.sensors.names[-3:] == ("object_x [m]", "object_y [m]", "object_angle [rad]")


def test_setpoints_go_by_name(controller):
    controller.reset()
    controller.reference(object_angle=0.2, gap=0.01)
    assert controller.current_setpoints["object_angle"] == pytest.approx(0.2)
    assert np.all(np.isfinite(controller.step(np.array([0.0, 0.18, 1.0, 1.0, 0.035, 0.2, 0.0])).u))
    controller.reference(object_angle=None, gap=None)
    with pytest.raises(InputError, match=r"expected setpoints of weighted quantities .*object_angle"):
        controller.reference(object_position=(0.0, 0.2))
    follows = load(BAR, ["controller.cost.object_position=1.0e3", "reference.object_position=[0.05, 0.2]"])
    names = stages_of(follows, controller.prediction).r_names
    assert names[:4] == ("gap_finger.tip [m]", "object_x [m]", "object_y [m]", "object_angle [rad]")
