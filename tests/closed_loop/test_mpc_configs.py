"""The shipped closed loops: a short run of each, with physical bounds on what the tip does."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from continuum_grasp.closed_loop import run_closed_loop
from continuum_grasp.scene import ControlScene, load
from tests.marks import few

FOLDER = Path(__file__).parents[2] / "configs/mpc"
FINE = 4  # clothoids of the plant, which are compiled in half the time of eight
ARCS = "fidelity.family=arc"  # a controller that is compiled in a quarter of the time


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def run(name, seconds, *changes):
    return run_closed_loop(
        load(FOLDER / f"{name}.yaml", [f"duration={seconds}", f"plant.fidelity.elements={FINE}", *changes])
    )


def checked(found):
    """Commands are the solver's, within all limits; the plant keeps out of what it must."""
    assert set(found.status) <= {"solved", "row_violated", "iteration_limit"}
    assert found.ended == "finished"
    for bound in found.bounds:
        assert bound.excess.max() <= 1e-9, bound.name
    return found


def test_every_configuration_is_run_here():
    text = Path(__file__).read_text(encoding="utf-8")
    assert all(f'"{path.stem}"' in text for path in FOLDER.glob("*.yaml"))


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_loops_have_margin_for_dead_time(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(path)


def test_pressures_take_a_stiffer_finger_to_its_setpoints():
    found = checked(run("chambers", 2.0, "plant.noise=0.0", ARCS))
    # Before it foresees the next setpoint, and at the end. The estimated moment makes up for the stiffness, by which
    # the tip would stay 4 mm short.
    off = np.linalg.norm(found.tracked[:, :2] - found.r[:, :2], axis=1)
    assert off[36] < 2e-3
    assert off[-1] < 2e-4


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["plant.tip_mass=1.8 g"], ""),
        (["plant.tip_mass=1.9 g"], r"plant.tip_mass = 1.9 g .* the loop bears 1.8 g"),
        (["plant.tip_mass=1.9 g", "parameters=[tip_mass]", "estimator.adapt={tip_mass: 3 g}"], ""),
        (["loads=[{at: 0.18, force: [0.03, 0.036]}]"], ""),
        (["loads=[{at: 0.18, force: [0.03, 0.037]}]"], r"loads are 0.0476 N at the tip, .* the loop bears 0.047 N"),
        (["loads=[{at: 0.09, force: [0.06, 0.072]}]"], ""),
        (["loads=[{at: 0.18, force: [0.3, 0.0]}]", "estimator.disturbances={tip_force: 0.1}"], ""),
    ],
)
def test_loads_that_no_unknown_stands_for_and_that_may_trip_are_doubted(changes, words):
    """The rod of the hand finger has 6.12 g and E I / L^2 = 0.1886 N: 0.3 of these are 1.84 g, a quarter 0.0471 N."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        load(FOLDER / "steady_tip.yaml", changes)
    texts = [str(one.message) for one in found if "the loop bears" in str(one.message)]
    assert len(texts) == bool(words)
    assert all(re.search(words, text) for text in texts)


def test_loops_say_which_loads_they_bear():
    """Of rods that taper to half by the closed forms of (1 - x)^2 / (1 - x / 2) and x^4 (1 - x / 2), integrated."""
    assert load(FOLDER / "steady_tip.yaml").borne_loads == "1.8 g or 0.047 N at the tip"
    assert load(FOLDER / "unknown_payload.yaml").borne_loads == "0.047 N at the tip, a mass is estimated"
    assert load(FOLDER / "nitinol_moment.yaml").borne_loads == "3.6 g at the tip, a force is estimated"
    tapered = ["finger.rod.bending_stiffness=[6.11e-3, 3.055e-3]", "finger.rod.linear_density=[0.034, 0.017]"]
    scene = load(FOLDER / "steady_tip.yaml", tapered)
    assert scene.borne_force == pytest.approx(6.11e-3 / 0.18**2 / 12 / (2 * math.log(2) - 1))
    assert scene.borne_mass == pytest.approx(1.5 * 0.034 * 0.18 * (1 / 5 - 1 / 12))


def test_loops_without_margin_for_dead_time_are_doubted():
    with pytest.warns(UserWarning, match=r"input_rate tolerates 60.9 N/s.* tenth .*0\.00028"):
        load(FOLDER / "steady_tip.yaml", ["controller.cost.input_rate=2.7e-4"])
    with pytest.warns(UserWarning, match="input_rate tolerates any rate"):
        load(FOLDER / "steady_tip.yaml", ["controller.cost.input_rate=null"])
    with pytest.warns(UserWarning, match=r"input_rate tolerates .* N m/s"):
        load(FOLDER / "nitinol_moment.yaml", ["controller.cost.input_rate=11.0"])
    given = load(FOLDER / "steady_tip.yaml").model_dump()
    del given["estimator"]["delay"]
    with pytest.warns(UserWarning, match="estimator.delay is not given"):
        ControlScene(**given)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a tenth, and a camera that is said to have no delay
        load(FOLDER / "steady_tip.yaml", ["controller.cost.input_rate=2.78e-4", "estimator.delay=0.0"])


@pytest.mark.deep
@pytest.mark.parametrize("stiffness", few([0.9, 1.1], 1))
def test_no_offset_stays(stiffness):
    found = checked(run("steady_tip", 1.5, f"plant.stiffness={stiffness}", "plant.noise=0.0"))
    assert found.metrics().tracking[0].final < 2e-4 * found.length
    noisy = checked(run("steady_tip", 1.5, f"plant.stiffness={stiffness}"))
    wander = np.linalg.norm(noisy.tip - noisy.tip_reference, axis=1)[75:]
    assert np.sqrt(np.mean(wander**2)) < 2e-3


def test_few_factorizations_give_the_commands_of_many():
    """The loop of docs/embedded.md, whose calls fit into its period on a small board."""
    board = (ARCS, "controller.horizon.stages=8", "controller.horizon.method=sdirk2", "controller.start_calls=5")
    short, full = (checked(run("steady_tip", 1.0, *board, f"controller.iterations={most}")) for most in (4, 40))
    assert set(short.status) == {"solved"}
    assert np.array_equal(short.u, full.u)
    assert np.linalg.norm(short.tip - short.tip_reference, axis=1)[-30:].max() < 3e-3


@pytest.mark.deep
def test_the_tip_runs_round_its_circle():
    """From half a second on, when it has come there, within a fifth of the radius, on all sides of the center."""
    found = checked(run("tip_circle", 2.5))
    beside = (found.tip - (-0.090, 0.130))[found.t > 0.5]
    assert np.hypot(*beside.T) == pytest.approx(0.015, abs=0.003)
    assert np.diff(np.unwrap(np.arctan2(*beside.T[::-1]))).sum() > 0.95 * 2.0 * np.pi
    assert np.linalg.norm(found.tip - found.tip_reference, axis=1)[found.t > 0.5].max() < 0.004


def off(found, last=None, first=None):
    """Greatest distance of the tip from its setpoint [m], over some of the periods."""
    return np.linalg.norm(found.tip - found.tip_reference, axis=1)[first:last].max()


def of(found, name):
    """Column of a tracked quantity."""
    return [each.startswith(name) for each in found.r_names].index(True)


FOLLOWED = [
    # Configuration, time [s], changes, what is followed and how well.
    (
        "tip_arc",
        0.5,
        (ARCS,),
        lambda f: f.metrics().tracking[0].max < 6e-3 and np.linalg.norm(f.tip[-1] - f.tip[0]) > 0.1,
    ),
    ("saturation", 0.8, (), lambda f: np.mean(f.u[30:, 0] > 14.0 - 1e-6) > 0.9 and off(f, first=-1) < 0.02),
    ("tip_steps", 0.5, (), lambda f: off(f, first=30) < 4e-3),
    ("three_tendons", 0.8, ("plant.noise=0.0",), lambda f: np.abs((f.tracked - f.r)[60:, :4]).max() < 4e-3),
    ("nitinol_moment", 1.2, (), lambda f: abs(f.tip[0, 1] + 0.28) < 0.02 and off(f, first=-10) < 0.015),
    # Friction of the plant's tendons is half as much again.
    ("winches", 1.0, (), lambda f: off(f) < 0.012 and "tripped" not in f.health),
    # A plan lets both cables go, and has to wind them up again.
    ("winches", 1.0, ("plant.damping=3.0",), lambda f: off(f) < 0.012 and "tripped" not in f.health),
    ("motor_servo", 1.0, (), lambda f: np.abs((f.tracked - f.r)[60:, of(f, "tip_angle")]).max() < 0.03),
]


@pytest.mark.parametrize(("name", "seconds", "changes", "followed"), few(FOLLOWED, 2))
def test_setpoints_are_followed(name, seconds, changes, followed):
    assert followed(checked(run(name, seconds, *changes)))


def test_a_knock_is_recovered_from():
    found = checked(run("pulse", 1.3, ARCS))
    error = np.linalg.norm(found.tip - found.tip_reference, axis=1)
    struck = (found.t > 0.8) & (found.t < 1.0)
    assert error[found.t < 0.8].max() < 3e-3
    assert error[struck].max() > 0.02
    assert error[-5:].max() < 4e-3


@pytest.mark.deep
def test_a_spirob_goes_where_its_tension_bends_it():
    """At rest the tip is where int T e / EI ds bends it: the setpoint is that of 0.7 N, by another quadrature."""
    found = checked(run("spirob", 1.1, "plant.noise=0.0", "reference.tip=[-0.0371, 0.2389]"))
    away = np.linalg.norm(found.tip - found.tip_reference, axis=1)
    assert away[40:].max() < 2e-3
    held = 1.1 * 0.7  # the plant is stiffer
    assert found.u[-1, 0] - found.u[-1, 1] == pytest.approx(held, rel=0.03)
    stiffer = found.disturbance_names.index("bending_stiffness_error [1]")
    assert found.disturbance[-1, stiffer] == pytest.approx(0.1, abs=0.05)


@pytest.mark.deep
def test_the_load_on_a_taper_is_found():
    """Across the straight finger; what pulls along it does not show."""
    same = ["plant.noise=0.0", "plant.stiffness=1.0", "plant.damping=1.0", "parameters=[]", "reference.tip=[0.0, 0.25]"]
    found = checked(
        run(
            "spirob",
            0.8,
            *same,
            "estimator.disturbances={tip_force: 0.05}",
            "loads=[{kind: force, at: 0.25, force: [0.02, 0.0]}]",
        )
    )
    assert found.disturbance_names[0] == "unknown_tip_x [N]"
    assert found.disturbance[-1, 0] == pytest.approx(0.02, rel=0.03)


@pytest.mark.deep
def test_zones_are_avoided():
    found = checked(run("keep_out", 1.5, ARCS, "controller.bounds.keep_out.wall.clearance=0.005"))  # arcs err by more
    assert found.tip[:, 0].min() > -0.10 + 0.006
    beside = found.u[(found.t[:-1] > 0.5) & (found.t[:-1] < 0.88)]  # the wall; before it foresees the next setpoint
    assert np.sqrt(np.mean(np.diff(beside, axis=0) ** 2)) < 0.6  # [N]; 2.1 with weights of 100
    assert np.linalg.norm(found.tip[100] - found.tip_reference[100]) > 0.03


def late_camera(*changes):
    """Errors of the tip at last, of a loop whose camera is later than stated."""
    found = checked(run("unknown_drive", 1.2, *changes))
    return np.linalg.norm(found.tip[-40:] - found.tip_reference[-40:], axis=1)


@pytest.mark.deep
def test_scenarios_hold_the_tip_with_a_camera_that_is_late():
    assert late_camera().max() < 0.004


@pytest.mark.deep
def test_without_scenarios_the_late_camera_makes_it_swing():
    assert _rms(late_camera("controller.scenarios=[]", "controller.supervisor=false")) > 0.008


@pytest.mark.deep
def test_a_payload_stiffness_and_lag_are_learned_from_the_motion():
    """The tip follows as if all were known, and no sensor contradicts the model any longer."""
    quick = (ARCS, "controller.horizon.stages=20")
    adapted = checked(run("unknown_payload", 1.5, *quick))
    plain = run("unknown_payload", 1.5, *quick, "estimator.adapt=null", "parameters=[]")
    errors = [np.linalg.norm(one.tracked[-50:, :2] - one.r[-50:, :2], axis=1) for one in (adapted, plain)]
    assert _rms(errors[0]) < 0.2 * _rms(errors[1])
    assert "mismatch" in plain.health
    assert (adapted.health[-1], adapted.mismatch[-1] < 1.5) == ("ok", True)
    truth = {"bending_stiffness": 1.3 * 6.11e-3, "drive_time_constant": 0.03, "tip_mass": 0.005}
    for name, value in truth.items():
        assert abs(adapted.adapted[name].value - value) < 3.0 * adapted.adapted[name].std
    assert plain.adapted == {}
    assert "only lag and delay together are observed" in adapted.report()
    assert adapted.details()["adapted"]["bending_stiffness"]["observability"] == "observed"


@pytest.mark.deep
def test_a_bar_is_turned_by_30_degrees_and_left_alone():
    found = checked(run("turn_bar", 5.5))
    angle = np.degrees(found.object_pose[:, 2])
    assert angle[-1] == pytest.approx(30.0, abs=2.0)
    assert angle.max() < 32.0
    # It lies still in the end, and the finger is away from it.
    assert np.ptp(angle[-20:]) < 0.1
    assert found.contacts.gap[-1, 0] > 0.01
    # The estimate is nearer than one look of the camera, 0.3 degrees.
    seen = found.estimate[:, list(found.estimated_names).index("object_angle [rad]")]
    errors = seen - found.object_pose[: len(seen), 2]
    assert np.degrees(np.sqrt(np.mean(errors[100:] ** 2))) < 0.3


def test_a_finger_presses_a_post_with_its_middle_and_lets_go():
    found = checked(run_closed_loop(load((FOLDER / "wrap_post").with_suffix(".yaml"))))
    during = slice(100, 135)  # 1 s to 1.35 s, of which the setpoint is 3 N
    middle = list(found.contacts.names).index("finger.1")
    assert found.contacts.normal_force[during, middle] == pytest.approx(3.0, rel=0.15)
    assert np.abs(found.contacts.gap[during, list(found.contacts.names).index("finger.tip")]).max() < 0.005
    assert found.contacts.normal_force[-5:].max() == 0.0


def test_a_trunk_of_two_meters_comes_to_its_setpoints():
    found = checked(run("trunk_2m", 7.5, "plant.noise=0.0", ARCS))
    off = np.linalg.norm(found.tracked[:, :2] - found.r[:, :2], axis=1)
    # Standing for 1.5 s or more, before it foresees the next setpoint: within a hundredth of the length.
    assert off[120:130].max() < 0.02
