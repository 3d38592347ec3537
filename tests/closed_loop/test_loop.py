"""Closed loops: the plant against the simulator and closed forms, metrics by hand, and whole runs."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize

import continuum_grasp as cg
from continuum_grasp.base import InputError, Interrupted, NumericalError
from continuum_grasp.closed_loop import (
    Plant,
    PlantModel,
    Readings,
    Sensors,
    SimulatedBench,
    missed_setpoints,
    run_closed_loop,
)
from continuum_grasp.control import Controller, Estimator, Prediction, stages_of
from continuum_grasp.scene import (
    ControlScene,
    Damping,
    Fidelity,
    Finger,
    ForceLoad,
    Reference,
    Rod,
    Scene,
    VectorSamples,
)
from tests.control_cases import ARCS_ESTIMATOR, ARCS_LOOP, rod_scene
from tests.declared import assert_declared
from tests.marks import few

FINGER, CONTROLLER = Finger.model_validate(ARCS_LOOP["finger"]), ARCS_LOOP["controller"]
ARCS = Fidelity(family="arc", elements=2)
ON_CURVE = (-0.18 * (1 - math.cos(0.5)) / 0.5, 0.18 * math.sin(0.5) / 0.5)


def make(**changes):
    """A closed loop of small models."""
    given = {
        **ARCS_LOOP,
        "reference": Reference(tip=ON_CURVE),
        "plant": {"fidelity": {"family": "clothoid", "elements": 3}, "stiffness": 1.1, "damping": 1.3},
        "duration": 0.4,
    }
    return ControlScene(**{**given, **changes})


@cache
def run(estimated=True, **changes):
    return run_closed_loop(make(estimator=ARCS_ESTIMATOR if estimated else None, **changes))


# -- the plant --------------------------------------------------------------------------------------------------------


def test_the_plant_moves_as_the_simulator_says():
    push = VectorSamples(times=(0.02, 0.05, 0.1), values=((0.0, 0.0), (0.1, -0.05), (0.0, 0.0)))
    plant = {"fidelity": {"family": "clothoid", "elements": 3}, "stiffness": 1.1, "tendon_friction": 0.05}
    scene, tension = make(plant=plant, loads=(ForceLoad(at=0.18, force=push),)), (20.0, 2.0)
    tried = Plant(scene)
    step, method = tried.period / tried.method.substeps, tried.method.name
    timing = cg.Timing(duration=0.12, step=step, method=method)
    held = {"actuation": cg.Actuation(tensions=tension), "time": timing}
    trajectory = cg.simulate(PlantModel.plant_scene(scene).model_copy(update=held))
    moving = slice(0, 2 * tried.model.system.n)
    tried.x[moving] = trajectory.x[0, moving]
    tried.x[tried.model.x_names.index("tension_1 [N]") :][:2] = tension  # the drive begins at the input that is held
    for _ in range(12):
        tried.advance(tension)
    x = trajectory.x[-1]
    assert np.abs(x[:4]).max() > 1.0
    assert tried.x[moving] == pytest.approx(x[moving], rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("kind", ["tensions", "moment"])
def test_commands_of_a_loop_are_simulated_on_the_finger_that_it_knows(kind):
    """Which moves as the plant, where that is the same finger."""
    push = ForceLoad(at=FINGER.rod.length, force=(0.02, 0.0))
    own = make(plant={"fidelity": ARCS}, fidelity=ARCS, loads=(push,), duration=0.2)
    if kind == "moment":
        limits = {"moment_max": 0.3, "rate_max": 3.0, "time_constant": 0.02}
        own = rod_scene(controller={**rod_scene().controller.stated(), "input": limits}, plant={"fidelity": ARCS})
        own = own.replaced(estimator=None, duration=0.2)
    found = run_closed_loop(own)
    moved, model = cg.simulate(found), cg.FingerModel(found.scene)
    assert (model.family, model.lengths) == (moved.model.family, moved.model.lengths)
    assert np.ptp(found.tip[:, 0]) > 0.01
    assert moved.t == pytest.approx(found.t)
    assert moved.tip == pytest.approx(found.tip, abs=1e-4 * found.length)


@pytest.mark.parametrize("quadratic", [1e-5, 1e-3])
def test_a_plant_of_quadratic_damping_pulled_from_rest_moves_as_by_cvodes(quadratic):
    """Eigenvalues at rest know nothing of it; steps chosen by them alone lost all numbers in the first periods."""
    finger = FINGER.replaced(damping=Damping(material=3e-5, quadratic=quadratic))
    scene, forth, back = make(finger=finger, gravity=(0.0, -9.81)), (40.0, 1.0), (1.0, 40.0)
    tried = Plant(scene)
    start, n = tried.x, tried.model.system.n
    p, w = tried.model.p, tried.model.forces(0.0)[0]
    x, u = ca.MX.sym("x", tried.model.nx), ca.MX.sym("u", tried.model.nu)
    problem = {"x": x, "p": u, "ode": tried.model.forward_dynamics(x, u, w, p)}
    exact = ca.integrator("exact", "cvodes", problem, 0.0, tried.period, {"abstol": 1e-10, "reltol": 1e-9})
    for command in [forth] * 5 + [back] * 5:
        start = np.array(exact(x0=start, p=command)["xf"]).ravel()
        tried.advance(command)
        assert tried.x[:n] == pytest.approx(start[:n], abs=1e-3)  # of up to 1.6 rad


@pytest.mark.parametrize("law", ["relaxation", "dry_friction"])
@pytest.mark.parametrize("elements", [1, 3])
def test_a_controller_without_estimator_is_given_states_of_sections_where_they_are(law, elements):
    """Of states that grow along the finger, those in the middle of each of its own four cells, by whatever cells."""
    branch = {"share": 0.3, "time": 0.1} if law == "relaxation" else {"stiffness": 2e-3, "moment": 0.01}
    finger, given = FINGER.replaced(damping={law: [branch]}), {"family": "clothoid", "elements": elements}
    scene = make(finger=finger, fidelity={"family": "clothoid", "elements": 2}, plant={"fidelity": given})
    tried, name = Plant(scene), "relaxing" if law == "relaxation" else "friction"
    cells = [k for k, each in enumerate(tried.model.x_names) if name in each]
    x, count = tried.model.start.copy(), len(cells)
    x[cells] = (np.arange(count) + 0.5) / count
    read = tried.sensors.value(x, tried.model.rest_input, tried.model.forces(0.0)[0])
    found = np.array(read).ravel()[[k for k, each in enumerate(tried.sensors.names) if name in each]]
    shares = np.clip(np.arange(1, 5)[:, None] / 4 - np.arange(count) / count, 0.0, 1 / count)
    expected = 4.0 * np.diff(shares @ x[cells], prepend=0.0)
    assert found == pytest.approx(expected, rel=1e-12)


def test_the_plant_differs_as_stated():
    plant = {"stiffness": 1.1, "damping": 1.3, "tip_mass": 0.001, "tendon_friction": 0.05, "time_constant": 0.03}
    finger = PlantModel.plant_scene(make(plant=plant)).finger
    assert finger.rod.stiffness == pytest.approx(1.1 * 6.11e-3)
    assert finger.damping.material == pytest.approx(1.3 * 3e-5)
    assert sum(m.mass for m in finger.masses) == pytest.approx(0.003)
    assert (finger.tendons.friction, finger.tendons.time_constant) == (0.05, 0.03)
    per_arc = FINGER.model_copy(update={"damping": Damping(per_arc=4e-4)})
    assert PlantModel.plant_scene(make(finger=per_arc)).finger.damping.material == pytest.approx(1.3 * 4e-4 * 0.09)


def lag(t, value, time):
    """Step response of a critically damped lag of second order."""
    return value * (1.0 - (1.0 + t / time) * np.exp(-t / time))


def first_order(t, value, time):
    """The same of a lag of first order."""
    return value * (1.0 - np.exp(-t / time))


@pytest.mark.parametrize(
    ("tendons", "family", "order"),
    [
        (True, "clothoid", 2),
        (True, "clothoid", 1),
        (False, "clothoid", 2),
        (False, "clothoid", 1),
        (False, "matched_clothoid", 2),
    ],
)
def test_tensions_and_moments_follow_through_the_lag(tendons, family, order):
    finger = FINGER if tendons else FINGER.model_copy(update={"tendons": None})
    controller = CONTROLLER if tendons else {**CONTROLLER, "input": {"moment_max": 0.3, "time_constant": 0.02}}
    plant = {"fidelity": {"family": family, "elements": 2}, "drive_order": order, "time_constant": 0.03}
    tried = Plant(make(finger=finger, controller=controller, plant=plant))
    drive = tried.model.function("drive", y=tried.model.drive)
    step, rest = (np.array([30.0, 5.0]), 1.0) if tendons else (np.array([0.05]), 0.0)
    for k in range(1, 6):
        tried.advance(rest + step)
        exerted = np.array(drive(tried.x, rest + step, tried.model.forces(0.0)[0])).ravel()
        assert exerted == pytest.approx(rest + (lag, first_order)[order == 1](0.01 * k, step, 0.03), rel=1e-5)


@pytest.mark.parametrize(
    "changes",
    [
        {"plant": {"fidelity": {"family": "matched_clothoid", "elements": 2}, "drive_order": 1}},
        {"plant": {"drive_order": 1}, "finger": FINGER.model_copy(update={"tendons": None}), "controller": None},
    ],
)
def test_a_drive_of_first_order_needs_a_lag_and_a_continuous_moment(changes):
    if changes.get("controller", True) is None:
        changes = {**changes, "controller": {**CONTROLLER, "input": {"moment_max": 0.3}}}
    with pytest.raises(InputError):
        Plant(make(**changes))


@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_a_drive_of_first_order_is_one_in_model_controller_and_plant(friction):
    """63 % of a step after its time constant, whatever moves; sensors see it, and the plant's order is the finger's."""
    tendons = FINGER.tendons.replaced(time_constant=0.02, drive_order=1, friction=friction)
    scene = make(finger=FINGER.replaced(tendons=tendons), estimator=ARCS_ESTIMATOR, plant={"fidelity": ARCS})
    prediction, tensions = Prediction(scene), {"tension_1 [N]", "tension_2 [N]"}
    assert not [name for name in prediction.x_names if "moment_rate" in name or "tension_1_rate" in name]
    assert tensions < set(Estimator(scene).measurement_names)
    pull = {"times": [0.0, 1e-9], "values": [1.0, 31.0], "interpolation": "linear"}
    moving = Scene(
        finger=scene.finger,
        gravity=(0.0, 0.0),
        fidelity=ARCS,
        actuation={"tensions": [pull, 1.0]},
        time={"duration": 0.05, "step": 0.01, "method": "reference"},
    )
    moved = cg.simulate(moving)
    states = dict(zip(moved.x_names, moved.x.T, strict=True))
    pulled = states["tension_1 [N]"] - 1.0 if friction else states["tip_moment [N m]"] / 0.005
    assert pulled == pytest.approx(first_order(moved.t, 30.0, 0.02), abs=1e-4)
    tried = Plant(scene)
    drive = tried.model.function("drive", y=tried.model.drive)
    for k in range(1, 4):
        tried.advance((31.0, 1.0))
        exerted = np.array(drive(tried.x, (31.0, 1.0), tried.model.forces(0.0)[0])).ravel()
        assert exerted[0] == pytest.approx(1.0 + first_order(0.01 * k, 30.0, 0.02), rel=1e-5)


def test_measurements_arrive_late():
    exact = {"fidelity": ARCS, "noise": 0.0, "delay": 0.025}
    tried, tips = Plant(make(estimator=ARCS_ESTIMATOR, plant=exact)), []
    tip = tried.model.function("tip", r=tried.model.tip)
    for k in range(10):
        states = tried.advance((20.0 + k, 2.0))
        tips += [np.array(tip(x, (20.0, 2.0), [])).ravel() for x in states[1:]]
        if k < 2:
            assert tried.measure()[:2] == pytest.approx([0.0, 0.18])
    late = round(0.025 / 0.01 * tried.method.substeps)
    assert tried.measure()[:2] == pytest.approx(tips[-1 - late], abs=1e-4)


@pytest.mark.parametrize(
    ("true", "shown", "believed"),
    [(None, (-0.02, -0.36), (0.0, 0.18)), ({}, (0.0, 0.18), (0.01, -0.09))],
)
def test_a_bench_is_mounted_as_the_controller_knows_unless_stated(true, shown, believed):
    """The tip at 180 mm, by a camera that shows twice the distance from a place beside the clamp, mirrored."""
    known = {"camera": {"position": (0.01, 0.0), "scale": 2.0, "mirrored": True}}
    scene = make(estimator=ARCS_ESTIMATOR, mounting=known, plant={"fidelity": ARCS, "noise": 0.0, "mounting": true})
    assert SimulatedBench(scene).read()[:2] == pytest.approx(shown, abs=1e-12)
    assert Plant(scene).measure()[:2] == pytest.approx(believed, abs=1e-12)


def test_tensions_that_lag_are_measured_beside_chambers_that_act_at_once():
    chamber = {"area": 6e-5, "offset": 0.005, "max_pressure": 2e4}
    arcs = {"family": "arc", "elements": 1}
    lag = {"finger.tendons.time_constant": 0.02, "plant.drive_order": 1}
    changes = {"finger.pressure": chamber, **lag, "plant.noise": 0.0}
    scene = cg.load("configs/mpc/steady_tip.yaml").changed({**changes, "fidelity": arcs, "plant.fidelity": arcs})
    model = PlantModel(scene)
    sensors = Sensors(scene, model, Prediction(scene), None)
    x = model.start + np.arange(len(model.start))
    read = dict(zip(sensors.names, sensors.read(x, np.zeros(model.nu), np.zeros(model.nw)), strict=True))
    states = dict(zip(model.x_names, x, strict=True))
    assert all(read[name] == states[name] for name in ("tension_1 [N]", "tension_2 [N]"))


def test_noise_is_as_large_as_said_and_repeats_with_its_seed():
    tried = {
        seed: Plant(make(estimator=ARCS_ESTIMATOR, plant={"fidelity": ARCS, "noise": 2.0, "seed": seed}))
        for seed in (1, 2)
    }
    again = Plant(make(estimator=ARCS_ESTIMATOR, plant={"fidelity": ARCS, "noise": 2.0, "seed": 1}))
    rows = {seed: np.array([plant.measure() for _ in range(2000)]) for seed, plant in tried.items()}
    assert np.array_equal(rows[1][:5], [again.measure() for _ in range(5)])
    assert not np.array_equal(rows[1], rows[2])
    assert rows[1].std(axis=0) == pytest.approx(2.0 * np.array([3e-4, 3e-4, 0.1, 0.1, 0.003, 0.003]), rel=0.06)
    assert rows[1].mean(axis=0) == pytest.approx([0.0, 0.18, 1.0, 1.0, 0.0, 0.0], abs=0.02)


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_without_an_estimator_the_state_is_measured(family):
    fidelity = Fidelity(family=family, elements=2)
    tried = Plant(make(fidelity=fidelity, plant={"fidelity": fidelity}))
    for _ in range(4):
        tried.advance((25.0, 3.0))
    moving, pulls = np.split(tried.x, [tried.model.system.nx])
    tension_1, tension_2 = pulls.reshape(2, 2).T  # each with its rate
    expected = [*moving, *FINGER.tendons.offset * (tension_1 - tension_2)]
    assert tried.measure() == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_a_motion_that_is_lost_is_reported():
    tried = Plant(make(plant={"fidelity": ARCS}, loads=(ForceLoad(at=0.18, force=(1e12, 0.0)),)))
    with pytest.raises(NumericalError, match="not finite"):
        tried.advance((1.0, 1.0))
    with pytest.raises(InputError, match="expected 2 finite entries"):
        tried.advance((math.nan, 1.0))
    prompt = FINGER.tendons.model_copy(update={"time_constant": None})
    matched = {"fidelity": {"family": "matched_clothoid"}}
    with pytest.raises(InputError, match="give the drive a lag"):
        make(finger=FINGER.model_copy(update={"tendons": prompt}), plant=matched)


# -- what is read off it ----------------------------------------------------------------------------------------------


def test_readings_of_a_circular_arc():
    zones = {
        "wall": {"type": "half_plane", "point": (0.1, 0.0), "normal_angle": 0.0},
        "post": {"type": "disc", "center": (0.05, 0.1), "radius": 0.02, "of": "backbone"},
    }
    cost = {**CONTROLLER["cost"], "bending": 1.0, "shape": {"at": (0.09, 0.18)}}
    controller = {**CONTROLLER, "cost": cost, "bounds": {"curvature": 5.0, "speed": 2.0, "keep_out": zones}}
    scene = make(
        controller=controller, reference=Reference(tip=ON_CURVE, shape=(0.0, 0.09, 0.0, 0.18)), plant={"fidelity": ARCS}
    )
    model, plant = Prediction(scene), PlantModel(scene)
    readings = Readings(scene, plant, stages_of(scene, model), model)
    bend, rate = 0.5, 3.0
    x = np.zeros((1, plant.nx))
    x[0, :4] = bend, bend, rate, rate
    u, held, w = np.array([[9.0, 2.0]]), np.array([[8.0, 2.5]]), np.zeros((1, plant.nw))
    radius = 0.18 / (2 * bend)
    arc = lambda angle: np.array([radius * (math.cos(angle) - 1.0), radius * math.sin(angle)])  # noqa: E731
    middle, tip = arc(bend), arc(2 * bend)
    expected = [*tip, bend, bend, *middle, *tip, rate, rate, 9.0, 2.0, 100.0, -50.0]
    assert readings.tracked(x, u, w, held)[0] == pytest.approx(expected, abs=1e-9)
    bounds = {b.name: b.excess[0] for b in readings.bounds(x, u, w, held, 0.01)}
    points = np.array([arc(2 * bend * k / 6400) for k in range(6401)])
    depth = 0.02 - np.linalg.norm(points - (0.05, 0.1), axis=1).min() + 0.0006
    assert bounds["wall"] == pytest.approx(0.1 - tip[0] + 0.0006)
    assert bounds["post"] == pytest.approx(depth, abs=1e-5)
    assert bounds["curvature"] == pytest.approx(1 / radius - 5.0)
    assert bounds["speed"] == pytest.approx(1.0)
    assert bounds["input rate"] == pytest.approx(100.0 - 600.0)
    assert bounds["input"] == pytest.approx(-1.0)
    assert readings.backbone(x, u, w, 3)[0] == pytest.approx(np.array([[0.0, 0.0], middle, tip]), abs=1e-12)


def bound(name, excess):
    """A limit of a distance, and by how much it is exceeded [m]."""
    return replace(run().bounds[0], name=name, unit="m", excess=excess, scale=FINGER.rod.length)


def test_metrics_by_hand():
    error = np.zeros((11, 4))
    error[2, :2], error[10, :2] = (3e-3, 4e-3), (0.0, 2e-3)
    error[:, 2] = 2.0
    u = np.array([[3.0, 1.0]] * 5 + [[3.0, 5.0]] * 5)
    by_hand = replace(
        run(),
        u=u,
        tracked=error,
        r=np.zeros_like(error),
        weights=np.array([2.0, 2.0, 0.5, 0.5]),
        r_names=("tip_x [m]", "tip_y [m]", "tension_1 [N]", "tension_2 [N]"),
        u_names=("tension_1 [N]", "tension_2 [N]"),
        u_min=np.array([1.0, 1.0]),
        bounds=(bound("wall", np.array([-1e-3] * 8 + [2e-3] * 2)),),
        phase_names=("estimate", "feedback"),
        phase_times=np.stack([np.full(10, 1e-5), [*np.linspace(1e-5, 9e-5, 9), 0.02]], axis=1),
        statistics={"controller_code": "optimized"},
        status=("solved",) * 9 + ("safe_ramp",),
        anomalies=((),) * 9 + (("late", "outlier"),),
        health=("ok",) * 8 + ("mismatch",) * 2,
        mismatch=np.array([1.0] * 8 + [3.5, 3.25]),
    )
    assert (by_hand.period, by_hand.deadline) == (0.01, 0.01)
    found = by_hand.metrics()
    (tip,) = found.tracking
    assert (tip.name, tip.unit) == ("tip", "m")
    assert (tip.rms, tip.max, tip.final) == pytest.approx((math.sqrt((25e-6 + 4e-6) / 11), 5e-3, 2e-3))
    assert found.cost == pytest.approx(0.5 * 0.01 * (2.0 * 25e-6 + 0.5 * 4.0 * 10))
    assert found.effort_rms == pytest.approx(2.0)
    assert found.rate_rms == pytest.approx(400.0 / math.sqrt(10))
    (wall,) = found.violations
    assert (wall.worst, wall.share) == pytest.approx((2e-3, 0.2))
    assert [(t.name, t.median, t.max) for t in found.times][1:] == [
        ("feedback", pytest.approx(5.5e-5), 0.02),
        ("step", pytest.approx(6.5e-5), pytest.approx(0.02001)),
    ]
    assert (found.late, found.statuses, found.anomalies) == (
        1,
        {"solved": 9, "safe_ramp": 1},
        {"late": 1, "outlier": 1},
    )


# -- whole loops ------------------------------------------------------------------------------------------------------


def test_the_tip_follows_its_setpoints():
    found = run()
    assert (found.ended, len(found.u)) == ("finished", 40)
    assert set(found.status) == {"solved"}
    assert np.linalg.norm(found.tip[-5:] - ON_CURVE, axis=1).max() < 4e-3
    assert np.all((found.u >= 1.0) & (found.u <= 60.0))
    assert np.abs(np.diff(found.u, axis=0)).max() <= 600.0 * 0.01 * (1 + 1e-9)
    assert found.warnings == ()
    assert found.statistics["plant_error_m"] < 1e-6


def test_a_run_repeats_with_its_seed():
    one, same = run(), run_closed_loop(make(estimator=ARCS_ESTIMATOR))
    assert_declared(one)
    for name in ("x", "u", "y", "estimate", "std", "plan_tip", "tracked"):
        assert np.array_equal(getattr(one, name), getattr(same, name)), name
    other = run_closed_loop(make(estimator=ARCS_ESTIMATOR, plant=make().plant.model_copy(update={"seed": 5})))
    assert not np.array_equal(one.u, other.u)


def test_the_plan_begins_at_the_estimate():
    found = run()
    model = Prediction(make(estimator=ARCS_ESTIMATOR))
    where = [
        np.array(model.tip(x, u, p)).ravel() for x, u, p in zip(found.estimate, found.u, found.parameters, strict=True)
    ]
    assert found.plan_tip[:, 0] == pytest.approx(np.array(where), abs=1e-9)


def converged(scene):
    """A controller that iterates every problem to convergence, given the state."""
    most = {"sqp_iterations": 20, "start_iterations": 100, "iterations": 100, "supervisor": False}
    return Controller(scene.changed({f"controller.{key}": value for key, value in most.items()}), deadline=math.inf)


@pytest.mark.deep
def test_real_time_iterations_lose_little_against_convergence():
    scene = make()
    cost, best = run(False).metrics().cost, run_closed_loop(scene, controller=converged(scene)).metrics().cost
    assert best * 0.999 < cost < best * 1.01


def test_convergence_is_that_of_an_independent_solver():
    """Single shooting and sequential quadratic programming with finite differences: no better cost is found."""
    scene = make(controller={**CONTROLLER, "horizon": {"stages": 4, "stage": 0.01}})
    control = converged(scene)
    s, x0 = control.stages, np.zeros(6)
    refs = np.tile([*ON_CURVE, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0], (5, 1))
    found = control.step(x0, refs)

    def cost(flat):
        x, total = ca.DM([*x0, 1.0, 1.0]), 0.0
        for u, r in zip(np.reshape(flat, (4, 2)), refs, strict=False):
            total += float(s.cost(x, u, s.p_nominal, r, s.weights)[0])
            for _ in range(s.substeps):
                x = s.step(x, u, s.p_nominal, s.stage / s.substeps)[0]
        return total + float(s.terminal(x, s.p_nominal, refs[4], s.terminal_weights)[0])

    rate = lambda flat: np.diff(np.vstack([[1.0, 1.0], np.reshape(flat, (4, 2))]), axis=0).ravel()  # noqa: E731
    rows = [{"type": "ineq", "fun": lambda flat, sign=sign: 6.0 + sign * rate(flat)} for sign in (1.0, -1.0)]
    start, within = np.full(8, 2.0), [(1.0, 60.0)] * 8
    best = minimize(cost, start, method="SLSQP", bounds=within, constraints=rows, options={"ftol": 1e-14})
    assert best.success
    assert cost(found.plan.u) == pytest.approx(best.fun, rel=1e-6)
    assert found.plan.u == pytest.approx(best.x.reshape(4, 2), abs=0.02)


def test_the_estimator_leaves_no_offset():
    """A finger that is a tenth stiffer, on the plant's own curve: less than 0.1 % of the length."""
    scene = make(
        estimator=ARCS_ESTIMATOR,
        plant={"fidelity": {"family": "arc", "elements": 4}, "stiffness": 1.1, "noise": 0.0},
        duration=1.2,
    )
    assert run_closed_loop(scene).metrics().tracking[0].final < 1e-3 * 0.18


def test_functions_of_time_are_followed():
    found = run_closed_loop(make(estimator=ARCS_ESTIMATOR, duration=0.3), functions={"tip": lambda t: (0.0, 0.18)})
    assert found.r[:, :2].tolist() == [[0.0, 0.18]] * 31
    assert np.linalg.norm(found.tip - (0.0, 0.18), axis=1).max() < 3e-3


def test_an_interrupted_run_keeps_what_it_has(tmp_path):
    def stop(share):
        if share >= 0.25:
            raise KeyboardInterrupt

    with pytest.raises(Interrupted) as caught:
        run_closed_loop(make(estimator=ARCS_ESTIMATOR), progress=stop)
    partial = caught.value.result
    assert (partial.ended, len(partial.u)) == ("stopped", 10)
    assert np.array_equal(partial.u, run().u[:10])
    partial.save(tmp_path)
    assert (tmp_path / "result.npz").is_file()


def test_a_lost_motion_keeps_what_it_has():
    blow = VectorSamples(times=(0.1, 0.11), values=((0.0, 0.0), (1e9, 0.0)))
    with pytest.raises(NumericalError, match="not finite") as caught:
        run_closed_loop(make(estimator=ARCS_ESTIMATOR, loads=(ForceLoad(at=0.18, force=blow),)))
    partial = caught.value.result
    assert 9 <= len(partial.u) <= 14
    assert np.all(np.isfinite(partial.x))


@pytest.mark.parametrize(("share", "warned"), [(0.999e-3, False), (1.001e-3, True)])
def test_a_bound_that_the_plant_leaves_is_said(share, warned):
    done = run()
    excess = np.full(len(done.t), -0.01)
    excess[7] = share * FINGER.rod.length
    found = replace(done, bounds=(*done.bounds, bound("post", excess)))
    assert any(word.startswith("post: exceeded by 0.18 mm at 0.07 s") for word in found.warnings) == warned


@pytest.mark.parametrize(
    ("share", "stood", "ended", "outcome"),
    [
        (0.0499, 0.6, "finished", "finished"),
        (0.0501, 0.6, "finished", "missed"),
        (0.0501, 0.6, "tripped", "tripped"),
        (0.0501, 0.5, "finished", "missed"),
        (0.0501, 0.48, "finished", "finished"),
    ],
)
def test_a_setpoint_that_stood_is_met_or_the_run_says_that_it_is_missed(share, stood, ended, outcome):
    """Other setpoints, of the input that costs nothing, move on."""
    done, period = run(), 0.02
    r = done.r[-1:].repeat(len(done.t), 0)
    r[:, 2:] = done.t[:, None]
    tracked = r.copy()
    tracked[:, :2] += share * FINGER.rod.length * np.array([0.6, 0.8])
    r[: len(done.u) - round(stood / period), :2] += 1e-3
    assert done.r_names[:2] == ("tip_x [m]", "tip_y [m]")
    found = replace(done, r=r, tracked=tracked, t=2.0 * done.t, period=period, ended=ended)
    assert found.outcome == outcome
    words = [word for word in found.warnings if word.startswith("tip: 9.02 mm off a setpoint that stood")]
    assert len(words) == len(found.missed)


HAND = Rod(length=0.18, bending_stiffness=0.2 * 0.18**2, linear_density=0.2 * 0.0764**2 / 0.18**2)
"""Rod by which errors are small: five times E I / L^2 is 1 N, and the natural time is 0.0764 s."""


@pytest.mark.parametrize(
    ("name", "setpoint", "error", "stated", "missed"),
    [
        ("tip_angle [rad]", 2.0, 0.0999, True, False),
        ("tip_angle [rad]", 2.0, 0.1001, True, True),
        ("contact_force_finger.1 [N]", 0.0, 0.0999, True, False),
        ("contact_force_finger.1 [N]", 0.0, 0.1001, True, True),
        ("contact_force_finger.1 [N]", 0.4, 0.0399, True, False),
        ("contact_force_finger.1 [N]", 0.4, 0.0401, True, True),
        ("contact_force_finger.1 [N]", 30.0, 2.999, True, False),
        ("contact_force_finger.1 [N]", 30.0, 3.001, True, True),
        ("bending_1 [rad]", 0.0, 9.0, False, False),
        ("bending_1 [rad]", 0.0, 9.0, True, True),
        ("bending_rate_1 [rad/s]", 0.0, 9.0, True, False),
        ("tension_1 [N]", 1.0, 9.0, True, False),
    ],
)
def test_angles_and_forces_are_missed_too_and_defaults_are_no_aims(name, setpoint, error, stated, missed):
    t, r = np.linspace(0.0, 1.0, 101), np.full((101, 1), setpoint)
    given = Reference(bending=(0.0,), tip_angle=2.0, contact_force=(setpoint,)) if stated else Reference()
    found = missed_setpoints((name,), r + error, r, t, given, HAND)
    assert ["off a setpoint that stood" in text for text in found] == [True] * missed


@pytest.mark.parametrize(("error", "missed"), [(0.039, False), (0.041, True)])
def test_a_force_that_is_let_go_is_judged_by_what_was_asked_for(error, missed):
    t = np.linspace(0.0, 1.0, 101)
    r = np.where(t < 0.3, 0.4, 0.0)[:, None]
    found = missed_setpoints(("contact_force_finger.1 [N]",), r + error, r, t, Reference(contact_force=(0.0,)), HAND)
    assert bool(found) == missed


def slack_scene(tip, arrangement):
    drive = {"kind": "length", "time_constant": 0.02, "arrangement": arrangement, "slack": 1e-3}
    tendons = {"offset": 0.005, "max_tension": 60.0, "axial_stiffness": 1e4, "series_stiffness": 3.3e4, "drive": drive}
    cost = {"tip": {"running": 2e4, "terminal": 2e3}, "speed": 0.02, "effort": 100.0, "input_rate": 1e4}
    controller = {**CONTROLLER, "cost": cost, "input": {"lengths": (-0.012, 0.012), "rate_max": 0.1}}
    plant = {"fidelity": ARCS}
    return make(
        finger=FINGER.replaced(tendons=tendons), controller=controller, plant=plant, reference=tip, duration=1.2
    )


@pytest.mark.parametrize("arrangement", few(["per_tendon", "one_pulley"], 1))
def test_slack_is_wound_up_on_either_side(arrangement):
    """Of tendons that are 1 mm slack and have no pretension, commands have no effect until it is wound up."""
    x, y = ON_CURVE
    sides = {"times": (0.0, 0.6), "values": ((x, y), (-x, y)), "interpolation": "hold"}
    found = run_closed_loop(slack_scene(Reference(tip=sides), arrangement))
    # The horizon of 0.1 s sees the second setpoint before it is there.
    for end, side in ((np.searchsorted(found.t, 0.5), 1.0), (-1, -1.0)):
        assert found.tracked[end, :2] == pytest.approx((side * x, y), abs=1e-3)


@pytest.mark.parametrize(("rate", "moves"), [(0.0, False), (0.2, False), (1.0, True), (2.0, True)])
def test_what_still_nears_its_setpoint_is_on_its_way(rate, moves):
    """An error of 2 exp(-k t) rad: in a tenth of the second it shrinks to exp(-k / 10), below 95 % from k = 0.51 on."""
    t = np.linspace(0.0, 1.0, 101)
    error, r = 2.0 * np.exp(-rate * t)[:, None], np.ones((101, 1))
    (found,) = missed_setpoints(("tip_angle [rad]",), r + error, r, t, Reference(tip_angle=1.0), HAND) or ("",)
    assert ("still on its way" in found) == moves
    assert ("no input within its bounds" in found) != moves


# -- pictures ---------------------------------------------------------------------------------------------------------


def lines(ax):
    """Data of the labeled lines by their labels."""
    return {line.get_label(): np.array(line.get_data()).T for line in ax.get_lines()}


def test_pictures_show_the_arrays():
    found = run()
    path = lines(found.plot(picture="path"))
    assert np.array_equal(path["tip"], found.tip)
    assert path["setpoint"] == pytest.approx(np.array([ON_CURVE] * 2))
    tracking = lines(found.plot(picture="tracking"))
    assert np.array_equal(tracking["tip y"][:, 1], found.tracked[:, 1])
    error = found.plot(picture="error").get_lines()[0].get_ydata()
    assert error == pytest.approx(np.linalg.norm(found.tip - ON_CURVE, axis=1))
    inputs = found.plot(picture="inputs")
    assert [np.array_equal(steps.get_data().values, found.u[:, k]) for k, steps in enumerate(inputs.patches)] == [
        True
    ] * 2
    disturbances = lines(found.plot(picture="disturbances"))
    assert np.array_equal(disturbances["missing tip moment"][:, 1], found.disturbance[:, 0])
    bounds = lines(found.plot(picture="bounds"))
    assert bounds["input rate (100 %: 600 N/s)"][:, 1] == pytest.approx(found.bounds[1].excess / 6.0)
