"""Motions: order, conservation, symmetry, the errors of the design's tables, moving inputs, and hard cases."""

from __future__ import annotations

import math
import sys
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from continuum_grasp.base import InputError, NumericalError
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import MomentLoad, Scene, Tendons, load
from continuum_grasp.simulation import equilibrium, initial_state, integrate
from tests.marks import but, few
from tests.rods import (  # noqa: F401
    HANGING,
    HORIZONTAL,
    NITINOL,
    ROOT,
    UNIT,
    UPRIGHT,
    force,
    integrated,
    order,
    rod_scene,
    without_compiler,
)

pytestmark = pytest.mark.usefixtures("without_compiler")

FAMILIES = ("arc", "clothoid", "matched_clothoid")
FREE = (0.0, 0.0)
SOON = {"duration": 2.0, "step": 0.01}
CONFIGS = sorted((ROOT / "configs/simulate").glob("*.yaml"))


def nitinol(family="matched_clothoid", elements=2, duration=1.0, step=1e-3, method="auto", tolerance=1e-4, **keys):
    """The paper's rod, horizontal, straight and at rest where nothing else is said."""
    time = {"duration": duration, "step": step, "method": method, "tolerance": tolerance}
    return rod_scene(NITINOL, family, elements, time=time, **keys)


def distance(a, b) -> float:
    """Root mean square distance of two tip paths [mm]."""
    return 1e3 * math.sqrt(np.mean(np.sum((a - b) ** 2, axis=1)))


def smoothstep(t, end):
    """Quintic from 0 to 1, its rate and acceleration; what two smooth samples describe."""
    z = np.clip(np.asarray(t) / end, 0.0, 1.0)
    return z**3 * (10 - 15 * z + 6 * z * z), 30 * (z * (1 - z)) ** 2 / end, 60 * z * (1 - z) * (1 - 2 * z) / end**2


# order, conservation, symmetry


def rich(side):
    """Everything that acts on a finger, on one side or mirrored."""
    return {
        "tip_mass": 0.02,
        "finger": {
            "rest_curvature": side * 0.7,
            "damping": {"material": 2e-4, "per_arc": 1e-4},
            "masses": [{"at": 0.23, "mass": 0.01}],
            "base": {"position": [side * 0.1, 0.2], "angle": -side * 1.2},
        },
        "gravity": (side * 1.5, -9.0),
        "actuation": {"tip_moment": side * 0.03},
        "contacts": [0.3],
        "loads": [
            force(0.6, (side * 0.05, 0.02), follows=True),
            force(0.4, {"times": [0.0, 0.1], "values": [[0.0, 0.0], [side * 0.1, 0.2]]}),
            {"kind": "moment", "at": 0.3, "moment": side * 0.01},
        ],
    }


@pytest.mark.parametrize("family", FAMILIES)
def test_a_mirrored_scene_moves_like_its_mirror_image(family):
    left, right = (integrate(nitinol(family, duration=0.2, **keys)) for keys in (rich(1.0), rich(-1.0)))
    assert np.abs(left.tip[-1] - left.tip[0]).max() > 0.05
    assert np.abs(left.x + right.x).max() <= 1e-11 * np.abs(left.x).max()
    assert left.tip == pytest.approx(right.tip * [-1.0, 1.0], abs=1e-12)
    assert left.kinetic == pytest.approx(right.kinetic, abs=1e-13)


# accuracy of the families: design.md, section 2.4

RELEASES = {
    ("arc", 2): (20.4, 29.2, 48.7),
    ("clothoid", 1): (2.3, 3.0, 15.4),
    ("matched_clothoid", 2): (0.84, 0.28, 1.9),
    ("arc", 3): (9.4, 12.8, 21.2),
    ("clothoid", 2): (0.46, 0.23, 1.8),
    ("matched_clothoid", 3): (0.36, 0.05, 0.36),
}
"""r.m.s. tip error of the release [mm] with tip masses of 0, 20 and 50 g."""


@cache
def fine_release(tip_mass: float):
    return integrate(nitinol("clothoid", 8, tip_mass=tip_mass, method="rk4"))


@pytest.mark.deep
@pytest.mark.parametrize(("family", "elements"), few(RELEASES, 2))
def test_release_has_the_errors_of_the_table(family, elements):
    for tip_mass, expected in zip((0.0, 0.02, 0.05), RELEASES[family, elements], strict=True):
        reach = {"bending_range": 6.0 if elements == 1 else 4.0}
        found = integrate(nitinol(family, elements, tip_mass=tip_mass, method="rk4", tolerance=1e-3, fidelity=reach))
        assert found.warnings == ()
        digit = 0.01 if expected < 1.0 else 0.1  # the last one of the table, which is cut, not rounded
        error = distance(found.tip, fine_release(tip_mass).tip)
        assert error == pytest.approx(expected, rel=0.02, abs=digit), tip_mass


def test_a_moment_that_varies_is_refused_where_the_model_takes_it_to_be_constant():
    """A bare finger does not say what its moment does, and has free clothoids; co-contraction is no moment."""
    finger = nitinol().finger
    tendons = finger.model_copy(update={"tendons": Tendons(offset=0.005, max_tension=40.0)})
    lagged = finger.model_copy(update={"tendons": Tendons(offset=0.005, max_tension=40.0, time_constant=0.02)})
    assert FingerModel(finger).family == "clothoid"
    assert FingerModel(lagged).family == "matched_clothoid"
    assert FingerModel(finger, input_rates=True).u_names[1:] == [
        "tip_moment_rate [N m/s]",
        "tip_moment_acceleration [N m/s2]",
    ]
    assert FingerModel(nitinol(None, 2)).family == "matched_clothoid"
    growing = np.linspace(0.0, 0.05, 21)[:, None]
    core = Core(FingerModel(finger, family="matched_clothoid"))
    x0 = np.zeros(core.model.nx)
    core.rollout(x0, 10, 1e-3, u=np.full((21, 1), 0.05))
    for start, u in ((x0, growing), (np.zeros((2, 4)), np.stack([0.0 * growing, growing]))):
        with pytest.raises(InputError, match="the tip moment varies"):
            core.rollout(start, 10, 1e-3, u=u)
    pair = Core(FingerModel(tendons, family="matched_clothoid"))
    pair.rollout(x0, 10, 1e-3, u=3.0 + growing @ [[1.0, 1.0]])
    with pytest.raises(InputError, match="the tip moment varies"):
        pair.rollout(x0, 10, 1e-3, u=3.0 + growing @ [[1.0, -1.0]])
    for at in (0.5, 1.0):  # a lag of the tendons gives no rates of a couple beside them
        load = MomentLoad(at=at * finger.rod.length, moment=0.0, input=True)
        beside = Core(FingerModel(lagged, family="matched_clothoid", loads=(load,), input_rates=False))
        rest = np.zeros(beside.model.nx)
        beside.rollout(rest, 10, 1e-3, u=3.0 + growing @ [[1.0, -1.0, 0.0]])
        with pytest.raises(InputError, match="the tip moment varies"):
            beside.rollout(rest, 10, 1e-3, u=growing @ [[0.0, 0.0, 1.0]])
    for model in (FingerModel(finger), FingerModel(lagged), FingerModel(finger, input_rates=True)):
        u = growing @ np.eye(1, model.nu)
        assert np.all(np.isfinite(Core(model).rollout(np.zeros(model.nx), 10, 1e-3, u=u)))


# inputs and loads that vary


@pytest.mark.deep
@pytest.mark.parametrize("family", FAMILIES)
def test_moving_inputs_and_forces_against_an_independent_integration(family):
    """Smooth samples are the quintic that they say they are, at order 4 too."""
    ramp, push = 0.1, (0.3, 0.2)

    def scene(step, method):
        return nitinol(
            family,
            duration=0.16,
            step=step,
            method=method,
            tip_mass=0.02,
            actuation={"tip_moment": {"times": [0.0, ramp], "values": [0.0, 0.05]}},
            loads=[
                force(0.6, {"times": [0.04, 0.12], "values": [[0.0, 0.0], push]}, follows=True),
                {"kind": "moment", "at": 0.3, "moment": {"times": [0.0, 0.16], "values": [0.01, -0.02]}},
            ],
        )

    def u(t):
        parts = [0.05 * part for part in smoothstep(t, ramp)]
        return np.array(parts if family == "matched_clothoid" else parts[:1])

    def w(t):
        rise = smoothstep(t - 0.04, 0.08)[0]
        return np.array([push[0] * rise, push[1] * rise, 0.01 - 0.03 * smoothstep(t, 0.16)[0]])

    truth = integrated(scene(2e-3, "rk4"), u, w)[::2]
    scale = np.abs(truth).max(axis=0)
    for method in ("rk4", "rodas"):
        errors = [
            np.abs((integrate(scene(step, method)).x[:: round(4e-3 / step)] - truth) / scale).max()
            for step in (2e-3, 1e-3, 5e-4)
        ]
        assert errors[-1] < 2e-4, method
        assert np.all(order(errors) > 3.3), (method, errors)
    reference = integrate(scene(1e-3, "reference")).x[::4]
    assert np.abs((reference - truth) / scale).max() < 1e-6


@pytest.mark.parametrize("family", FAMILIES)
def test_a_slow_force_is_followed_in_equilibrium(family):
    """Within 60 s, inertia out of play: material damping delays every shape by some eta / E I, 0.1 s here.

    The weight stiffens or softens the finger, which changes the delay by up to a quarter.
    """
    lifted = {"times": [0.0, 60.0], "values": [[0.0, 0.0], [0.0, 0.6]]}
    keys = {"finger": {"damping": {"material": 5e-3}}, "initial": {"pose": "equilibrium"}}
    found = integrate(nitinol(family, duration=60.0, step=0.1, loads=[force(0.6, lifted)], **keys))
    delay = 5e-3 / found.scene.finger.rod.stiffness
    for k in (0, 150, 300, 450, 600):
        value = 0.6 * float(smoothstep(max(found.t[k] - delay, 0.0), 60.0)[0])
        still = equilibrium(nitinol(family, loads=[force(0.6, (0.0, value))]))
        assert found.tip[k] == pytest.approx(still.tip, abs=5e-4)
    assert found.tip[-1, 1] - found.tip[0, 1] > 0.3


TENDONS = {"offset": 0.005, "max_tension": 60.0, "time_constant": 0.02}


@pytest.mark.deep
@pytest.mark.parametrize("family", few(sorted(FAMILIES, reverse=True), 2))
def test_a_tension_step_ends_in_equilibrium(family):
    """Within a microsecond; through the lag every family takes it."""
    finger = {"tendons": TENDONS, "damping": {"material": 3e-3}}
    step = {"times": [0.0, 1e-6], "values": [2.0, 12.0], "interpolation": "linear"}
    keys = {"finger": finger, "initial": {"pose": "equilibrium"}}
    found = integrate(nitinol(family, duration=3.0, actuation={"tensions": [step, 2.0]}, **keys))
    assert found.status == "finished"
    assert found.warnings == ()
    still = equilibrium(nitinol(family, finger=finger, actuation={"tensions": [12.0, 2.0]}))
    assert found.tip[-1] == pytest.approx(still.tip, abs=1e-5)
    t, lag = found.t, TENDONS["time_constant"]
    moment = 0.05 * (1.0 - (1.0 + t / lag) * np.exp(-t / lag))
    assert found.x[:, -2] == pytest.approx(moment, abs=0.05 * 0.03)


# hard cases


@pytest.mark.deep
@pytest.mark.parametrize("family", FAMILIES)
def test_a_very_short_element(family, monkeypatch):
    """1 % of the length, no damping: modes of tens of kilohertz, and a motion that is hardly disturbed by them."""
    monkeypatch.setenv("CC", "cc")
    found = {
        method: integrate(nitinol(family, (0.594, 0.006), duration=0.3, step=1e-3, method=method))
        for method in ("auto", "rk4")
    }
    assert found["rk4"].statistics["method"] == "rk4"
    if family != "matched_clothoid":  # which does without the stiffest mode
        assert found["auto"].statistics["method"] == "rodas"
        assert found["rk4"].statistics["substeps"] >= 128
    energy = found["rk4"].kinetic + found["rk4"].potential
    assert np.abs(energy - energy[0]).max() < 1e-5 * found["rk4"].kinetic.max()
    assert distance(found["auto"].tip, found["rk4"].tip) < 0.02
    assert all(one.warnings == () for one in found.values())


@pytest.mark.parametrize("family", FAMILIES)
def test_a_tip_mass_of_a_hundred_rods(family):
    """Drawn aside while hanging, 3 s: finite, no energy lost, and about the pendulum of the rod's length."""
    mass = 100 * NITINOL["length"] * NITINOL["density"] * math.pi * 1e-6
    initial = {"pose": "equilibrium", "held_by": [force(0.6, (1.0, 0.0))]}
    found = integrate(nitinol(family, duration=3.0, angle=HANGING, tip_mass=mass, initial=initial))
    assert found.warnings == ()
    energy = found.kinetic + found.potential
    assert np.abs(energy - energy[0]).max() < 1e-4 * found.kinetic.max()
    crossings = np.flatnonzero(np.diff(np.sign(found.tip[:, 0])))
    half_period = np.mean(np.diff(found.t[crossings]))
    assert half_period < math.pi * math.sqrt(0.6 / 9.81)
    assert half_period > 0.7 * math.pi * math.sqrt(0.6 / 9.81)


@pytest.mark.parametrize("family", FAMILIES)
def test_starting_exactly_straight_is_as_smooth_as_starting_nearly_straight(family):
    straight = integrate(nitinol(family, duration=0.2, tip_mass=0.02))
    n = straight.n
    for tiny in (1e-300, 1e-12, 1e-8):
        nearly = integrate(nitinol(family, duration=0.2, tip_mass=0.02, initial={"q": [tiny] * n}))
        assert np.abs(nearly.x - straight.x).max() <= 1e3 * tiny + 1e-11 * np.abs(straight.x).max()
    assert np.all(straight.x[0] == 0.0)
    assert np.all(np.isfinite(straight.x))
    # The first step is a parabola: M qdd + G = 0.
    model = straight.model
    q = np.zeros(n)
    first = -np.linalg.solve(np.array(model.mass_matrix(q, [0.0], [])), np.array(model.gravity(q, [0.0], [])).ravel())
    assert straight.x[1, :n] == pytest.approx(0.5 * first * 1e-6, rel=0.02)


@pytest.mark.parametrize("family", FAMILIES)
def test_above_its_buckling_load_the_straight_finger_stands_and_a_disturbed_one_falls(family):
    keys = {"angle": UPRIGHT, "tip_mass": 0.05}
    standing = integrate(nitinol(family, duration=1.0, **keys))
    assert np.all(standing.x == 0.0)
    still = equilibrium(nitinol(family, **keys), stable=False)
    growth = math.sqrt(-still.margin)
    mass = np.array(still.model.mass_matrix(still.q, still.u, []))
    stiffness = np.array(still.model.statics(still.q, still.u, [], [])[1])
    values, vectors = np.linalg.eig(np.linalg.solve(mass, stiffness))
    direction = vectors[:, np.argmin(values.real)].real
    direction *= np.sign(direction[0]) * 1e-6 / np.abs(direction).max()
    duration = round(3.0 / growth, 3)
    leaning = integrate(nitinol(family, duration=duration, initial={"q": direction.tolist()}, **keys))
    expected = direction * math.cosh(growth * leaning.t[-1])
    assert leaning.x[-1, : leaning.n] == pytest.approx(expected, rel=1e-5)
    falling = integrate(nitinol(family, duration=4.0, initial={"q": (1e3 * direction).tolist()}, **keys))
    assert falling.tip[:, 1].min() < equilibrium(nitinol(family, **keys)).tip[1]
    energy = falling.kinetic + falling.potential
    assert np.abs(energy - energy[0]).max() < 1e-4 * falling.kinetic.max()


@pytest.mark.parametrize("family", FAMILIES)
def test_a_motion_is_the_same_whatever_range_is_stated(family):
    free, narrow = (
        integrate(nitinol(family, duration=0.4, tip_mass=0.02, fidelity={"accuracy": 1e-13, **keys}))
        for keys in ({}, {"bending_range": 0.1})
    )
    assert narrow.warnings == free.warnings == ()
    assert max(narrow.model.ranges) > 0.4
    assert narrow.tip == pytest.approx(free.tip, abs=1e-7)


def test_exceeding_the_strain_limit_is_said():
    """The clamp of the falling rod is its most strained place: strain = curvature times the radius."""
    scene = nitinol("arc", duration=0.4, tip_mass=0.02)
    strain = np.abs(integrate(scene).q).max() / 0.3 * 0.001
    for limit, warned in ((1.01 * strain, False), (0.5 * strain, True)):
        limited = scene.model_copy(update={"finger": scene.finger.model_copy(update={"strain_limit": limit})})
        warnings = integrate(limited).warnings
        assert bool(warnings) == warned
        if warned:
            assert warnings[0].startswith("element 1 exceeds the strain limit at t = 0.")
            assert "(greatest: 2.00 times the limit" in warnings[0]


def test_a_motion_that_bends_further_than_elements_can_stops_and_keeps_what_it_has():
    """A step of the tip moment swings one arc to twice its bend at rest: 50 rad."""
    with pytest.raises(NumericalError, match=r"element 1 is about to bend beyond 40 rad") as caught:
        integrate(rod_scene(UNIT, "arc", 1, gravity=FREE, actuation={"tip_moment": 25.0}, time=SOON))
    error, partial = caught.value, caught.value.result
    assert "take more elements" in str(error)
    assert partial.status == "stopped"
    assert error.time == partial.t[-1]
    assert np.array_equal(error.state, partial.x[-1])
    assert 30.0 < np.abs(partial.q).max() <= 40.0


def test_a_start_beyond_what_elements_can_says_what_to_do():
    with pytest.raises(InputError, match=r"bends element 1 beyond 40 rad.*take more elements"):
        integrate(nitinol("arc", duration=0.01, initial={"q": (41.0, 0.0)}))


@pytest.mark.deep
@pytest.mark.parametrize("method", few(["auto", "rodas", "reference", "rk4"], 3))
def test_a_motion_that_blows_up_is_stopped_with_time_and_state(method):
    pushed = {"times": [0.0, 0.05, 0.06], "values": [[0.0, 0.0], [0.0, 0.0], [0.0, 1e12]]}
    with pytest.raises(NumericalError) as caught:
        integrate(nitinol("clothoid", duration=0.2, method=method, loads=[force(0.6, pushed)]))
    error = caught.value
    assert 0.04 <= error.time <= 0.1
    assert f"t = {error.time:g} s" in str(error)
    assert error.result.status == "stopped"
    assert np.all(np.isfinite(error.result.x))
    assert np.all(np.isfinite(error.state))
    assert error.result.t[-1] == pytest.approx(error.time)


def test_too_stiff_for_rk4_is_reported_with_its_result(monkeypatch):
    monkeypatch.setattr(sys.modules[integrate.__module__], "_MOST_SUBSTEPS", 100)
    keys = {"duration": 0.02, "step": 2e-3, "tip_mass": 0.02, "finger": {"damping": {"material": 8e-3}}}
    with pytest.raises(NumericalError, match=r"too stiff for rk4.*time\.method: rodas") as caught:
        integrate(nitinol("clothoid", 4, method="rk4", **keys))
    assert caught.value.result.status == "stopped"
    assert integrate(nitinol("clothoid", 4, **keys)).statistics["method"] == "rodas"


@pytest.mark.parametrize("family", FAMILIES)
def test_an_output_step_far_above_the_stability_limit_is_divided(family):
    fine = integrate(nitinol(family, duration=1.0, step=1e-3, method="rk4"))
    coarse = integrate(nitinol(family, duration=1.0, step=0.1, method="rk4"))
    substeps, radius = coarse.statistics["substeps"], coarse.statistics["spectral_radius"]
    assert substeps >= 3
    assert radius * 0.1 / substeps < 2.7
    assert len(coarse.t) == 11
    assert coarse.tip == pytest.approx(fine.tip[::100], abs=2e-3)


# starts that a matched tip cannot have

MOMENT = 0.02
GROWING = {"times": [0.0, 0.1], "values": [0.0, MOMENT]}


def circle(curvature: float) -> np.ndarray:
    """Tip of the bent rod of 0.6 m, in base axes."""
    angle = 0.6 * curvature
    return np.array([math.cos(angle) - 1.0, math.sin(angle)]) / curvature


@pytest.mark.parametrize(
    ("keys", "family"),
    [
        ({"initial": {"pose": "straight"}, "actuation": {"tip_moment": MOMENT}}, "clothoid"),
        ({"initial": {"pose": "rest"}, "actuation": {"tip_moment": MOMENT}}, "clothoid"),
        ({"initial": {"pose": "straight"}, "actuation": {"tip_moment": GROWING}}, "matched_clothoid"),
        ({"initial": {"pose": "equilibrium"}, "actuation": {"tip_moment": MOMENT}}, "matched_clothoid"),
        ({"initial": {"pose": "straight"}, "finger": {"rest_curvature": 1.0}}, "clothoid"),
        ({"initial": {"pose": "rest"}, "finger": {"rest_curvature": 1.0}}, "matched_clothoid"),
    ],
)
def test_the_default_family_can_have_the_initial_pose(keys, family):
    scene = nitinol(None, None, duration=0.01, gravity=FREE, angle=UPRIGHT, **keys)
    motion = integrate(scene)
    assert motion.model.family == family
    assert motion.warnings == ()
    rest = keys.get("finger", {}).get("rest_curvature", 0.0)
    bent = {"straight": 0.0, "rest": rest, "equilibrium": MOMENT / motion.model.finger.rod.stiffness}
    curvature = bent[keys["initial"]["pose"]]
    assert motion.tip[0] == pytest.approx(circle(curvature) if curvature else [0.0, 0.6], abs=1e-6)


@pytest.mark.parametrize("family", FAMILIES)
def test_a_model_of_other_elements_starts_in_its_own_equilibrium(family):
    """A model need not have the elements that its scene says."""
    scene = nitinol("arc", 2, tip_mass=0.02, initial={"pose": "equilibrium"})
    model = FingerModel(scene, family=family, elements=3)
    x0 = initial_state(scene, model)
    assert x0.shape == (model.nx,)
    rate = np.array(model.forward_dynamics(x0, np.zeros(model.nu), np.zeros(model.nw), model.p_nominal)).ravel()
    falling = np.array(model.forward_dynamics(0 * x0, np.zeros(model.nu), np.zeros(model.nw), model.p_nominal)).ravel()
    assert np.abs(rate).max() < 1e-8 * np.abs(falling).max()


def test_a_held_moment_is_in_the_initial_shape():
    held = {"pose": "equilibrium", "held_by": [{"kind": "moment", "at": 0.6, "moment": MOMENT}]}
    motion = integrate(nitinol(None, None, duration=0.01, gravity=FREE, angle=UPRIGHT, initial=held))
    curvature = MOMENT / motion.model.finger.rod.stiffness
    assert motion.tip[0] == pytest.approx(circle(curvature), abs=1e-6)


def test_an_impossible_start_of_matched_clothoids_that_were_asked_for_is_said():
    keys = {"duration": 0.01, "actuation": {"tip_moment": MOMENT}}
    for initial in ({"pose": "straight"}, {"q": [0.0, 0.0]}):
        (warning,) = integrate(nitinol("matched_clothoid", initial=initial, **keys)).warnings
        assert "fidelity.family: clothoid" in warning


# what is refused, and what is shipped


def test_a_kink_in_the_input_of_a_matched_tip_is_refused():
    kinked = {"tip_moment": {"times": [0.0, 0.1], "values": [0.0, 0.05], "interpolation": "linear"}}
    with pytest.raises(InputError, match=r"interpolation: smooth, tendons\.time_constant, or fidelity\.family"):
        integrate(nitinol("matched_clothoid", duration=0.1, actuation=kinked))
    assert integrate(nitinol("clothoid", duration=0.1, actuation=kinked)).status == "finished"


@pytest.mark.parametrize("at_once", ["couple", "tendon", "chamber"])
def test_a_matched_tip_moves_with_the_rates_of_what_bends_it_at_once_beside_a_lag(at_once):
    """By free clothoids of eight elements."""
    ramp = {"times": [0.0, 0.05, 0.1], "values": [0.0, 0.036, 0.036]}
    lagged = {"offset": 0.006, "max_tension": 50, "time_constant": 0.02}
    tendon, chamber = (
        {"offset": [0.006, 0.003], "max_tension": 50},
        {"area": 1e-4, "offset": -0.006, "max_pressure": 1e6},
    )
    finger = {"rod": {"length": 0.3, "bending_stiffness": 0.02, "linear_density": 0.05}, "damping": {"material": 2e-4}}
    finger |= {"tendons": [lagged, tendon] if at_once == "tendon" else [lagged]}
    finger |= {"pressure": chamber} if at_once == "chamber" else {}
    moved = {
        "couple": {"loads": [{"kind": "moment", "at": 0.3, "moment": ramp}], "actuation": {"tensions": [0.0]}},
        "tendon": {"actuation": {"tensions": [0.0, {**ramp, "values": [k / 0.006 for k in ramp["values"]]}]}},
        "chamber": {"actuation": {"tensions": [0.0], "pressures": [{**ramp, "values": [0.0, 6e4, 6e4]}]}},
    }[at_once]

    def run(family, elements):
        keys = {"gravity": [0.0, -9.81], "fidelity": {"family": family, "elements": elements}}
        return integrate(Scene.model_validate(
            {"schema_version": 1, "finger": finger, **keys, **moved, "time": {"duration": 0.15, "step": 0.005}}
        ))  # fmt: skip

    matched, fine = run("matched_clothoid", 4), run("clothoid", 8)
    assert np.linalg.norm(matched.tip - fine.tip, axis=1).max() < 1e-4


def test_a_scene_without_time_is_refused():
    with pytest.raises(InputError, match="time"):
        integrate(rod_scene(UNIT))


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("curvature", [0.7, 1.3, 2.1, 3.0])
def test_the_rest_pose_is_the_preshape(family, curvature):
    keys = {"finger": {"rest_curvature": curvature}, "initial": {"pose": "rest"}}
    found = integrate(nitinol(family, duration=2e-3, **keys))
    bends = found.model.bending(found.q[0], found.acting[0], found.model.p_nominal)
    assert np.array(bends).ravel() == pytest.approx([0.3 * curvature] * 2, rel=1e-12)


@pytest.mark.parametrize("family", ["arc", "matched_clothoid"])
def test_one_unknown_is_enough(family):
    """The period of small swings follows from mass and stiffness."""
    found = integrate(nitinol(family, 1, duration=0.1, gravity=FREE, initial={"q": [1e-4]}))
    model = found.model
    mass = float(model.mass_matrix([0.0], [0.0], []))
    stiffness = float(model.elastic([1.0], [0.0], [])) - float(model.elastic([0.0], [0.0], []))
    assert found.x[:, 0] == pytest.approx(1e-4 * np.cos(math.sqrt(stiffness / mass) * found.t), abs=1e-9)


COSTLY = [path for path in CONFIGS if path.stem in ("hold_mug", "spirob", "spirob_units", "swing_against_disc")]


@pytest.mark.parametrize("config", but(COSTLY, CONFIGS), ids=lambda path: path.stem)
def test_shipped_scenes_run_without_warnings(config):
    found = integrate(load(config, {"time.duration": 0.5, "time.step": 0.002}))
    assert found.status == "finished"
    assert found.warnings == ()
    assert np.all(np.isfinite(found.x))
    assert len(found.t) == 251
    # Without a changing input, what is lost is lost to damping.
    if "release" in config.stem or config.stem in ("hanging", "standing"):
        assert found.kinetic[-1] + found.potential[-1] < found.potential[0]
        assert found.kinetic.max() > 1e-3


@pytest.mark.parametrize(
    ("kind", "wide"), few([("linear", 2e-5), ("smooth", 2e-5), ("linear", 5e-3), ("smooth", 5e-3), ("linear", 1e-8)], 3)
)
def test_the_reference_starts_anew_at_every_knot_of_inputs_and_loads(kind, wide):
    """Ramps between two output steps, against another integrator from knot to knot."""
    knots = [0.0, 0.0103, 0.0103 + wide, 0.0221, 0.0221 + wide, 0.05]
    pull, push = [0.0, 0.0, 9.0, 9.0, 4.0, 4.0], [0.0, 0.0, 0.0, 0.1, -0.1, 0.0]
    pushed = {"times": knots, "values": [[value, 0.0] for value in push], "interpolation": kind}
    hand = {
        "rod": {"length": 0.18, "linear_density": 0.034, "bending_stiffness": 6.11e-3, "rotary_inertia": 2.6e-7},
        "damping": {"material": 3e-5},
        "masses": [{"at": 0.18, "mass": 0.002}],
        "tendons": {"offset": 0.005, "max_tension": 60.0},
    }
    given = Scene(
        finger=hand,
        gravity=FREE,
        fidelity={"family": "clothoid", "elements": 2},
        actuation={"tensions": [{"times": knots, "values": pull, "interpolation": kind}, 0.0]},
        loads=[{"kind": "force", "at": 0.18, "force": pushed}],
        time={"duration": 0.05, "step": 0.01, "method": "reference"},
    )
    found, model = integrate(given), FingerModel(given)

    def at(values, t):
        k = int(np.clip(np.searchsorted(knots, t) - 1, 0, len(knots) - 2))
        z = (t - knots[k]) / (knots[k + 1] - knots[k])
        return values[k] + (values[k + 1] - values[k]) * (z if kind == "linear" else float(smoothstep(z, 1.0)[0]))

    def rate(t, x):
        return np.array(model.forward_dynamics(x, [at(pull, t), 0.0], [at(push, t), 0.0], model.p_nominal)).ravel()

    x, states = found.x[0], [found.x[0]]
    for a, b in pairwise(sorted({*knots, *found.t.tolist()})):
        x = solve_ivp(rate, (a, b), x, method="DOP853", rtol=1e-10, atol=1e-11).y[:, -1]
        states += [x] * (b in found.t)
    off = np.abs(np.array(states) - found.x).max(axis=0) / np.abs(found.x).max(axis=0)
    assert off.max() < 1e-7
    assert found.warnings == ()
    assert np.ptp(found.tip[:, 0]) > 0.005


@pytest.mark.parametrize("method", ["rk4", "rodas", "reference"])
def test_what_holds_moves_as_from_jump_to_jump(method):
    """Steps that begin and end at jumps are of second order: half the step leaves a quarter of the error."""
    knots, pull, push = [0.0, 0.01, 0.03, 0.05], [3.0, 9.0, 2.0, 0.0], [0.05, -0.1, 0.0, 0.0]
    held = {"times": knots, "interpolation": "hold"}
    given = Scene(
        finger={
            "rod": {"length": 0.18, "linear_density": 0.034, "bending_stiffness": 6.11e-3},
            "damping": {"material": 3e-5},
            "tendons": {"offset": 0.005, "max_tension": 60.0},
        },
        gravity=FREE,
        fidelity={"family": "arc", "elements": 1},
        actuation={"tensions": [{**held, "values": pull}, 0.0]},
        loads=[{"kind": "force", "at": 0.18, "force": {**held, "values": [[value, 0.0] for value in push]}}],
    )
    runs = [integrate(given.replaced(time={"duration": 0.05, "step": step, "method": method})) for step in (1e-3, 5e-4)]
    model, x = FingerModel(given), runs[0].x[0]
    states = {0.0: x}
    for k, (a, b) in enumerate(pairwise(knots)):
        u, w = [pull[k], 0.0], [push[k], 0.0]

        def rate(t, x, u=u, w=w):
            return np.array(model.forward_dynamics(x, u, w, model.p_nominal)).ravel()

        x = states[b] = solve_ivp(rate, (a, b), x, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    off = [max(abs(run.x[np.abs(run.t - at).argmin(), 0] - x[0]) for at, x in states.items()) for run in runs]
    assert off[0] < 1e-3 * np.abs(runs[0].x[:, 0]).max()
    assert off[1] < off[0] / 3.5 or off[0] < 1e-8
