"""Pressure chambers: closed forms at rest and of the lag, virtual work, mirror images, and beside tendons."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import continuum_grasp as cg
from continuum_grasp import FingerModel
from continuum_grasp.addons.identification import TipPath
from continuum_grasp.base import InputError
from continuum_grasp.control import Prediction
from continuum_grasp.rod import solve_elastica
from continuum_grasp.scene import FAMILIES, Scene
from continuum_grasp.simulation import Signals
from tests.export_cases import needs, shared_library
from tests.identification_cases import at_tip

LENGTH, STIFFNESS = 0.12, 1.5e-3
ROD = {"length": LENGTH, "bending_stiffness": STIFFNESS, "linear_density": 0.17}
CHAMBER = {"area": 4e-5, "offset": -0.005, "max_pressure": 6e4}
PER_PASCAL = 4e-5 * 0.005
"""Moment of the chamber [m3]."""
CABLE = {"max_tension": 30.0, "axial_stiffness": 1e4, "series_stiffness": 3e4}


def scene(*chambers, family="clothoid", **changes):
    base = {
        "finger": {"rod": ROD, "damping": {"material": 4e-5}, "pressure": chambers},
        "gravity": [0.0, 0.0],
        "fidelity": {"family": family, "elements": [0.03] * 4},
        "actuation": {"pressures": [2e4] * len(chambers)},
        "initial": {"pose": "straight"},
        "time": {"duration": 0.2, "step": 0.01},
    }
    return Scene.model_validate(base).changed(changes)


def turned(found):
    """Angle of the tip [rad]."""
    return float(np.sum(np.array(found.model.bending(found.q, found.u, found.model.p_nominal))))


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("share", [0.0, 0.3])
@pytest.mark.parametrize(("start", "to"), [(0.0, None), (0.0, 0.06), (0.03, 0.09), (0.09, 0.12)])
def test_at_rest_it_bends_where_it_is(family, share, start, to):
    whole = to is None
    if not whole and FAMILIES[family].matches_tip:
        pytest.skip("a matched tip has the moment of the tip alone")
    chamber = {**CHAMBER, "start": start, "to": to, "stiffness_share": share}
    found = cg.equilibrium(scene(chamber, family=family))
    along = (LENGTH if whole else to) - start
    # Curvature M / EI, with the wall's stiffness, where the chamber is, and none elsewhere.
    assert turned(found) == pytest.approx(2e4 * PER_PASCAL * along / (STIFFNESS * (1.0 + share)), rel=2e-9)


def test_walls_add_up_on_any_rod():
    # A taper: the angle is the integral of M / (EI (1 + share)), in closed form for a linear EI.
    graded = {"length": LENGTH, "sections": [{"to": LENGTH, "bending_stiffness": [2e-3, 1e-3], "linear_density": 0.17}]}
    one = {**CHAMBER, "stiffness_share": 0.2, "to": 0.06}
    other = {**CHAMBER, "stiffness_share": 0.1, "offset": -0.01}
    made = scene(one, other, **{"finger.rod": graded, "fidelity": {"family": "clothoid", "elements": 12}})
    moment, slope = 2e4 * 4e-5, -1e-3 / LENGTH
    stiffness = made.finger.profile.bending_stiffness
    assert float(stiffness(0.03)) == pytest.approx((2e-3 + slope * 0.03) * 1.3)
    assert float(stiffness(0.09)) == pytest.approx((2e-3 + slope * 0.09) * 1.1)

    def angle(a, b, factor):
        return factor * math.log((2e-3 + slope * b) / (2e-3 + slope * a)) / slope

    wanted = angle(0.0, 0.06, moment * 0.015 / 1.3) + angle(0.06, LENGTH, moment * 0.01 / 1.1)
    assert turned(cg.equilibrium(made)) == pytest.approx(wanted, rel=2e-4)


@pytest.mark.parametrize(("start", "to"), [(0.0, 0.06), (1e-6, 0.06), (0.0, None), (1e-6, None)])
def test_the_material_of_a_wall_damps_as_that_of_the_rod(start, to):
    """Damping is in proportion to the stiffness: of every mode by eta omega / 2 E I of the rod itself."""
    wall = {**CHAMBER, "start": start, "to": to, "stiffness_share": 1.0}
    still = {"actuation.pressures": [0.0], "finger.damping": {"material": 1e-5}, "fidelity.elements": 4}
    found = cg.modes(scene(wall, **still, gravity=[0.0, 0.0]))
    wanted = 1e-5 * 2.0 * math.pi * found.frequencies_hz / (2.0 * STIFFNESS)
    under = wanted[:2] < 1.0
    assert under[0]
    assert found.damping_ratios[:2][under] == pytest.approx(wanted[:2][under], rel=1e-6)


def test_a_muscle_and_a_chamber_on_the_other_side_do_the_same():
    one = cg.equilibrium(scene({**CHAMBER, "offset": 0.005, "contracts": True}))
    assert one.q == pytest.approx(cg.equilibrium(scene(CHAMBER)).q, rel=1e-12)
    assert one.q == pytest.approx(-cg.equilibrium(scene({**CHAMBER, "offset": 0.005})).q, rel=1e-12)


@pytest.mark.parametrize(
    "tendons",
    [
        {"offset": 0.004, "max_tension": 30.0},
        {"offset": 0.004, "max_tension": 30.0, "friction": 0.1},
        {"offset": 0.004, **CABLE, "drive": {"kind": "length", "time_constant": 0.02, "arrangement": "one_pulley"}},
        {"offset": 0.004, **CABLE, "friction": 0.1, "drive": {"kind": "length", "time_constant": 0.02}},
    ],
    ids=["tensions", "friction", "pulley", "winches"],
)
@pytest.mark.parametrize("lag", [None, 0.05])
def test_beside_tendons_forces_add_up(tendons, lag):
    # Virtual work: the pressure's is p A e of the angle that its part of the finger turns, whatever tendons do.
    chamber = {**CHAMBER, "time_constant": lag, "to": 0.06}
    finger = scene(chamber, actuation=None).finger.changed({"tendons": tendons})
    model = FingerModel(finger, elements=4, family="clothoid", gravity=(0.0, 0.0))
    alone = FingerModel(finger.replaced(pressure=None), elements=model.lengths, family="clothoid", gravity=(0.0, 0.0))
    assert model.u_names == [*alone.u_names, "pressure_1 [Pa]"]
    assert ("pressure_1 [Pa]" in model.x_names) == (lag is not None)
    rng, cells = np.random.default_rng(0), len(model.friction_names)
    for _ in range(3):
        q, pull = rng.uniform(-3.0, 3.0, model.n), rng.uniform(0.0, 1e-3, alone.nu)
        history = (np.append(rng.uniform(-1.0, 1.0, cells), 0.0),) if cells else ()
        both = np.array(model.actuation(q, np.append(pull, 2e4), model.p_nominal, *history)).ravel()
        pulled = np.array(alone.actuation(q, pull, alone.p_nominal, *history)).ravel()
        turn = [float(model.orientation(one, np.zeros(model.nu), 0.06, model.p_nominal)) for one in np.eye(model.n)]
        assert both - pulled == pytest.approx(2e4 * PER_PASCAL * np.array(turn), rel=1e-12, abs=1e-15)


def test_a_pressure_follows_its_command_by_a_lag_of_first_order():
    ramp = {"times": [0.0, 1.0], "values": [0.0, 5e4], "interpolation": "linear"}
    lagging = {**CHAMBER, "time_constant": 0.05}
    found = cg.simulate(scene(lagging, lagging, actuation={"pressures": [ramp, 1e4]}))
    place = found.model.x_names.index("pressure_1 [Pa]")
    assert found.acting == pytest.approx(found.x[:, place : place + 2])  # what bends it is the states, each its own
    late = 5e4 * (found.t - 0.05 * (1.0 - np.exp(-found.t / 0.05)))
    assert found.x[:, place] == pytest.approx(late, abs=1.0)


@pytest.mark.parametrize("family", ["matched_clothoid", "clothoid", "arc"])
def test_pressure_does_the_work_that_becomes_energy(family):
    # Without damping kinetic and elastic energy grow by p dV, V the moment per pressure times the turn.
    undamped = {"finger.damping": {}, "initial.pose": "rest", "time": {"duration": 0.1, "step": 1e-3}}
    swing = {"times": [0.0, 0.04], "values": [0.0, 2e4]}
    made = scene(CHAMBER, family=family, **undamped, actuation={"pressures": [swing]})
    found = cg.simulate(made)
    after = found.t >= 0.04
    turn = np.array(
        [
            np.sum(np.array(found.model.bending(q, u, found.model.p_nominal)))
            for q, u in zip(found.q, found.u, strict=True)
        ]
    )
    balance = (found.kinetic + found.potential - 2e4 * PER_PASCAL * turn)[after]
    assert np.ptp(balance) < 1e-6 * found.kinetic.max()


def test_the_exact_rod_agrees():
    # Three chambers under gravity, held against a force: the rod is integrated by a program of its own.
    load = {"kind": "force", "at": LENGTH, "force": [0.02, -0.01]}
    chambers = (
        {**CHAMBER, "stiffness_share": 0.2},
        {**CHAMBER, "start": 0.03, "to": 0.09},
        {**CHAMBER, "offset": 0.003},
    )
    made = scene(*chambers, gravity=[0.0, -9.81], loads=[load], **{"fidelity.elements": [0.015] * 8})
    found = cg.equilibrium(made)
    assert solve_elastica(made).tip == pytest.approx(found.tip, abs=5e-6 * LENGTH)


def test_area_and_lag_are_found_from_a_motion():
    # The data are those of one mode's equation of motion, integrated by scipy: a finger of one arc whose tip is light.
    made = scene(
        {**CHAMBER, "time_constant": 0.05},
        family="arc",
        **{"fidelity.elements": 1, "finger.masses": [], "time": {"duration": 0.6, "step": 0.01}},
        actuation={"pressures": [{"times": [0.0, 0.05, 0.3, 0.35], "values": [0.0, 4e4, 4e4, 1e4]}]},
    )
    model, signals = FingerModel(made), Signals(made, FingerModel(made))
    t = np.linspace(0.0, 0.6, 61)

    def rate(now, y):
        # 30 % more area and 40 % more lag than the scene has.
        bend, turning, pressure = y
        moment = 1.3 * PER_PASCAL * pressure - STIFFNESS / LENGTH * bend - 4e-5 / LENGTH * turning
        q, rest = np.array([bend]), (np.zeros(model.nu), model.p_nominal)
        bias = float(model.bias(q, np.array([turning]), *rest))
        pull = (float(signals.u(now)[0][0]) - pressure) / (1.4 * 0.05)
        return [turning, (moment - bias) / float(model.mass_matrix(q, *rest)), pull]

    bend = solve_ivp(rate, (0.0, 0.6), [0.0] * 3, t_eval=t, rtol=1e-9, atol=1e-9, max_step=0.01).y[0][1:]
    x, y = -LENGTH * (1.0 - np.cos(bend)) / bend, LENGTH * np.sin(bend) / bend
    found = cg.identify(made, TipPath(t[1:], at_tip(x, y)), parameters=["chamber_area", "drive_time_constant"])
    assert found.values == pytest.approx([1.3 * 4e-5, 1.4 * 0.05], rel=1e-4)


@pytest.mark.deep
def test_a_controller_reaches_the_tip_of_a_pressure():
    # Constant curvature: the tip is on the circle of that angle.
    angle = 0.8
    loop = cg.load(
        "configs/mpc/chambers.yaml", {"reference.tip": tip_of(angle), "plant.stiffness": 1.0, "duration": 1.2}
    )
    assert loop.lag == 0.06
    found = cg.run_closed_loop(loop)
    assert set(found.status) == {"solved"}
    assert np.linalg.norm(found.tip[-1] - tip_of(angle)) < 2e-4
    # Pressures that hold it: M = EI angle / L.
    stiffness = loop.finger.rod.stiffness
    held = found.u[-1] @ [-PER_PASCAL, PER_PASCAL]
    assert held == pytest.approx(stiffness * angle / LENGTH, rel=0.02)


def tip_of(angle):
    return [-LENGTH * (1.0 - math.cos(angle)) / angle, LENGTH * math.sin(angle) / angle]


@needs("cc")
def test_an_exported_step_is_the_motion_of_simulate(tmp_path):
    timing = {"duration": 0.2, "step": 0.002, "method": "reference"}
    first = {**CHAMBER, "time_constant": 0.05}
    made = scene(first, {**CHAMBER, "offset": 0.003}, family="arc", time=timing, **{"fidelity.elements": 2})
    held = made.changed(
        {"initial.pose": "rest", "actuation": {"pressures": [2e4, {"times": [0.0, 0.1], "values": [2e4, 5e4]}]}}
    )
    truth = cg.simulate(held)
    cg.export_c(held, tmp_path / "package", what=["step", "kinematics"], real="double")
    finger, library = shared_library(tmp_path / "package", tmp_path, "-O1")
    x = finger.State(*truth.x[0])
    for k in range(len(truth.t) - 1):
        for part in (np.arange(8) + 0.5) / 8:
            u = (1.0 - part) * truth.u[k] + part * truth.u[k + 1]
            x = library.step(x, finger.Input(*u), timing["step"] / 8)
            assert library.code == 0
    tip = library.tip(x, finger.Input(*truth.u[-1]))
    assert math.hypot(tip.x - truth.tip[-1, 0], tip.y - truth.tip[-1, 1]) < 2e-5 * LENGTH
    with pytest.raises(finger.Error, match="out of its range"):
        library.step(x, finger.Input(7e4, 0.0), timing["step"] / 8)


@pytest.mark.parametrize("name", ["winches", "motor_servo"])
def test_drives_and_sensors_beside_a_chamber_are_distinct(name):
    chamber = {**CHAMBER, "time_constant": 0.05}
    changes = {"finger.pressure": chamber, "fidelity.family": "clothoid", "plant": {}}
    made = cg.load(f"configs/mpc/{name}.yaml", {**changes, "estimator.measured.pressure": 200.0})
    model = Prediction(made)
    alone = Prediction(made.changed({"finger.pressure": None, "estimator.measured.pressure": None}))
    # A winch that holds a tension says nothing of the pressure, which is the commanded one.
    fingers = [one.system.finger_model for one in (model, alone)]
    commands = [[3e4 * name.startswith("pressure") for name in one.u_names] for one in fingers]
    q = np.zeros(model.system.n)
    held, same = (one.drives_at(q, u, pulled=5.0) for one, u in zip(fingers, commands, strict=True))
    assert held == pytest.approx([3e4, *same])
    # The states that drives follow are those of winches, then the pressure; servos are those of winches alone.
    names = [model.x_names[one.state] for one in model.driven]
    assert names == [*(alone.x_names[one.state] for one in alone.driven), "pressure_1 [Pa]"]
    assert [one.rate == () for one in model.driven] == [False] * len(alone.driven) + [True]
    assert model.servo_torques.shape == alone.servo_torques.shape
    assert cg.Controller(made).measurement_names.count("pressure_1 [Pa]") == 1


def test_what_is_wrong_is_said_with_its_key():
    for changes, text in (
        (
            {"actuation": {"tensions": [1.0]}},
            "tensions: is not what this finger takes: .*pressures of chambers",
        ),
        ({"actuation": {"pressures": [1.0, 2.0]}}, "expected 1 pressures, got 2 numbers"),
        ({"actuation": {"pressures": [7e4]}}, "outside min_pressure = 0 to max_pressure = 60000 Pa"),
        ({"finger.pressure[0].start": 0.2}, "start: 0.2 m is not before the tip"),
        ({"fidelity.family": "matched_clothoid", "finger.pressure[0].time_constant": 0.1}, "lag"),
    ):
        with pytest.raises(InputError, match=text):
            scene(CHAMBER).changed(changes)
