"""Plans against solutions of optimal control that are known; from inside: guesses, before the first iteration."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plan_cases import held, linearized, small, two_arcs
from scipy.integrate import solve_ivp
from scipy.optimize import root

import continuum_grasp as cg
from continuum_grasp.addons.planning import PlanScene, guess, plan
from continuum_grasp.addons.planning.fine import simulated
from continuum_grasp.addons.planning.guess import Posture, closing, final_postures, smooth_path
from continuum_grasp.addons.planning.search import PlanSearch
from continuum_grasp.addons.planning.shooting import amplification
from continuum_grasp.control import Prediction
from continuum_grasp.scene import load
from tests.marks import few
from tests.rods import ROOT, after

TINY = 1e-3
TIP, BY_SHOOTING = ROOT / "configs/plan/tip_to_point.yaml", ("method=single_shooting",)


def least_effort_of_linear(a, b, h, count, goal):
    """Held inputs of least squares that lead a linear system from rest to a state, by its discrete Gramian."""
    phi, gamma = held(a, b, h)
    columns = [np.linalg.matrix_power(phi, count - 1 - k) @ gamma for k in range(count)]
    reach = np.hstack(columns)
    return reach.T @ np.linalg.solve(reach @ reach.T, goal)


@pytest.mark.parametrize("method", ["single_shooting", "collocation"])
@pytest.mark.parametrize("arcs", [1, 2])
def test_least_effort_of_small_bends_is_that_of_the_linear_finger(arcs, method):
    goal = (TINY,) if arcs == 1 else (TINY, 0.6 * TINY)
    scene = (small if arcs == 1 else two_arcs)(
        goal={"bending": goal},
        gravity=(0.0, 0.0),
        method=method,
        intervals=40,
        solver={"degree": 5} if method == "collocation" else {"substeps": 40},
    )
    found = plan(scene)
    a, b = linearized(scene)
    u = least_effort_of_linear(a, b, scene.duration / 40, 40, np.array([*goal, *[0.0] * arcs]))
    assert found.u[:-1, 0] == pytest.approx(u, rel=1e-3, abs=1e-3 * np.abs(u).max())
    assert found.objective == pytest.approx(u @ u * scene.duration / 40, rel=1e-4)


def least_time_of_oscillator(frequency, reach, goal):
    """From rest to rest at a deflection, by a force that is switched once; ``reach`` is its static deflection."""
    switch = (goal**2 + 2 * reach * goal) / (4 * reach)
    first = np.arccos(1 - switch / reach) / frequency
    return first + np.arccos((switch + reach) / (goal + reach)) / frequency


@pytest.mark.parametrize("share", [0.3, 0.8, 1.5])
def test_least_time_of_one_mode_is_that_of_the_bang_bang_oscillator(share):
    """An undamped mode from rest to rest; ``share``: deflection per that of the steady greatest moment."""
    a, b = linearized(small(damping=0.0))
    frequency, most = np.sqrt(-a[1, 0]), 1e-3
    reach = -b[1, 0] * most / a[1, 0]
    scene = small(
        damping=0.0,
        goal={"bending": (share * reach,)},
        objective="least_time",
        input={"moment_max": most},
        duration={"least": 0.1 / frequency, "most": 6.0 / frequency},
        intervals=60,
        smoothing=1e-6,
    )
    found = plan(scene)
    assert found.objective == pytest.approx(least_time_of_oscillator(frequency, reach, share * reach), rel=1e-3)
    assert np.sum(np.abs(found.u[:-1, 0]) < 0.99 * most) <= 2  # one interval at the switch


def test_held_posture_is_that_of_the_moment_over_stiffness():
    """A weightless rod under a tip moment bends by M L / (E I)."""
    scene = small(goal={"bending": (0.8,), "end": "held"})
    found = plan(scene)
    assert found.u[-1, 0] == pytest.approx(0.8 * scene.finger.rod.stiffness / scene.finger.rod.length, rel=1e-6)


def test_tracking_follows_a_reference_that_the_finger_can_run():
    """The inputs of a plan reproduce its bending, whatever the weight of the input, if that is small."""
    made = plan(small(objective="least_effort", intervals=30))
    rows = tuple((float(v),) for v in made.bending[:, 0])
    scene = small(
        objective="tracking",
        cost={"bending": {"running": 1e6, "terminal": 1e4}, "effort": 1e-6},
        reference={"bending": {"times": tuple(made.t.tolist()), "values": rows, "interpolation": "linear"}},
        goal={"end": "moving"},
        intervals=30,
    )
    assert plan(scene).bending == pytest.approx(made.bending, abs=5e-3)  # its kinks cannot be run


def test_starts_with_an_object_differ_by_when_their_inputs_rest():
    """Bent to either side they would be one start: the finger goes where its inputs lead. All end on the object."""
    asked, near = closing(cg.load(ROOT / "configs/plan/close_on_mug.yaml", ["intervals=20"]))
    search = PlanSearch(asked, near=near)
    model, starts = search.motion.prediction, [path for _, path, _ in search._paths()]
    assert len(starts) == 3
    for path, rests in zip(starts, (14, 18, 20), strict=True):
        assert np.flatnonzero(np.all(path.u == path.u[-1], axis=1))[0] == rests
        assert np.max(model.contact_force(path.x[-1], path.u[-1], model.p_nominal)) > 1.0


DISC = {"shape": "circle", "diameter": 0.076}
SHAPES = {
    "disc": DISC,
    "hexagon": {
        "shape": "polygon",
        "corner_radius": 0.003,
        "vertices": [(0.038 * np.cos(k * np.pi / 3), 0.038 * np.sin(k * np.pi / 3)) for k in range(6)],
    },
    "union": {
        "shape": "union",
        "center_of_mass": (0.0, 0.0),
        "members": [{"shape": "circle", "diameter": 0.06}, {**DISC, "diameter": 0.04, "position": (0.0, -0.018)}],
    },
}
"""Objects about as large as the disc."""


def pressing(side, shape="disc", **goal):
    """A finger of 0.22 m whose tip is to press on an object beside it with 0.08 N."""
    rod = {"length": 0.22, "linear_density": 0.03, "bending_stiffness": 0.01}
    tendons = {"offset": 0.005, "max_tension": 22.7, "time_constant": 0.02}
    return PlanScene(
        finger={"rod": rod, "half_thickness": 0.006, "damping": {"material": 6e-5}, "tendons": tendons},
        gravity=(0.0, 0.0),
        object={**SHAPES[shape], "mass": 0.1, "position": (side * 0.1, 0.185)},
        contact_law={"stiffness": 2e3, "friction": 0.0, "dissipation": 1.0, "rounding": 5e-4},
        fidelity={"family": "clothoid", "elements": 2},
        goal={"contact_force": {"value": [0.08], "weight": 1e6, "tolerance": 0.016, **goal}},
        duration=0.4,
        intervals=20,
    )


@pytest.mark.parametrize(("shape", "side"), few([(shape, side) for shape in SHAPES for side in (1.0, -1.0)], 2))
def test_a_search_begins_where_its_inputs_press(shape, side):
    """Static least squares end short of balance: their inputs leave the finger beside the object, by an integrator of
    its own, and plans did not move.
    """
    search = PlanSearch(pressing(side, shape))
    model, static = search.motion.prediction, final_postures(search.motion, search.problem.goal, search.first)[0]
    for posture, presses in ((static, False), (search.last, True)):
        if posture is static and shape != "disc":
            continue  # of others least squares may be lucky
        path = smooth_path(search.motion, search.x0, search.first, posture, share=0.7)
        x = search.x0
        for u in path.u:
            x = solve_ivp(
                lambda t, x, u=u: np.array(model.dynamics(x, u, model.p_nominal)).ravel(),
                (0.0, 0.02),
                x,
                method="LSODA",
                rtol=1e-6,
                atol=1e-8,
            ).y[:, -1]
        force = float(model.contact_force(x, path.u[-1], model.p_nominal))
        assert (0.5 < force / 0.08 < 2.0) is presses


def test_a_scan_raises_each_input_to_its_limit_and_all_towards_a_posture():
    """Up to where the first input has no more to give; ways that end at the same inputs are one."""
    search = PlanSearch(pressing(1.0))
    towards = [Posture(search.first.q, np.array(u)) for u in ((2.0, 1.0), (4.0, 2.0), (0.0, 3.0), (0.0, 0.0))]
    ramps = list(search.pressing.ramps(towards))
    assert sorted(np.round(ramp.u[-1], 9).tolist() for ramp in ramps) == [[0.0, 22.7], [22.7, 0.0], [22.7, 11.35]]
    for ramp in ramps:
        assert ramp.u[0].tolist() == [0.0, 0.0]
        assert np.diff(ramp.u, axis=0) == pytest.approx(np.tile(ramp.u[-1] / (len(ramp.u) - 1), (len(ramp.u) - 1, 1)))


def test_all_that_was_tried_is_listed():
    """Distances from the goal too that were not found; with an object all paths come first."""
    asked = pressing(1.0).replaced(solver={"max_iterations": 2})
    tried = [line.split(": ")[0] for line in plan(asked, raise_on_failure=False).statistics["starts"]]
    paths = [f"at rest after {share}%, simulated" for share in (70, 90, 100)]
    assert tried == [*paths, *(f"{path}, distance from the goal" for path in paths)]


@pytest.mark.deep
def test_a_plan_presses_on_a_disc_beside_the_finger():
    found = plan(pressing(1.0))
    assert found.status in ("optimal", "feasible")
    assert found.deviation.contact_forces[0] == pytest.approx(0.08, rel=0.2)


@pytest.mark.deep
@pytest.mark.parametrize(("shape", "side"), few([(shape, side) for shape in SHAPES for side in (1.0, -1.0)], 2))
def test_a_press_counts_by_what_another_integrator_finds(shape, side):
    """LSODA, interval by interval: a plan that counts presses as it is to, without a tolerance of its own too."""
    found = plan(pressing(side, shape, tolerance=None), raise_on_failure=False)
    model, x = found.prediction, found.x[0]
    for u in found.u[:-1]:
        span = 0.0, found.duration / 20

        def rate(t, x, u=u):
            return np.array(model.dynamics(x, u, model.p_nominal)).ravel()

        x = solve_ivp(rate, span, x, "LSODA", rtol=1e-8, atol=1e-10).y[:, -1]
    force = float(model.contact_force(x, found.u[-1], model.p_nominal))
    assert np.hypot(*(found.tip[-1] - found.tip[0])) > 0.02
    assert (abs(force - 0.08) <= 0.008) is (found.status in ("optimal", "feasible"))


@pytest.mark.deep
def test_a_press_that_is_held_stays():
    """LSODA, after the end under the last input: the force is as it was asked for."""
    law = {"stiffness": 2e3, "friction": 0.4, "slip_speed": 0.01, "rounding": 3e-4}
    found = plan(
        pressing(1.0, "hexagon").replaced(
            contact_law=law, goal={"end": "held", "contact_force": {"value": [0.08], "weight": 1e6}}
        )
    )
    assert found.status in ("optimal", "feasible")
    model, u = found.prediction, found.u[-1]

    def rate(t, x):
        return np.array(model.dynamics(x, u, model.p_nominal)).ravel()

    x = solve_ivp(rate, (0.0, 0.3), found.x[-1], "LSODA", rtol=1e-8, atol=1e-10).y[:, -1]
    assert float(model.contact_force(x, u, model.p_nominal)) == pytest.approx(0.08, rel=0.1)


@pytest.mark.deep
def test_an_object_in_the_way_is_named():
    """A tip that is to go where the disc is, which no weight and no limit brings there."""
    through = {"tip": {"value": (0.1, 0.185), "weight": 1e5}, "end": "still"}
    found = plan(pressing(1.0).replaced(goal=through), raise_on_failure=False)
    assert found.status == "goal_missed"
    assert found.contact_forces[-1, 0] > 0.0
    assert np.hypot(*(found.tip[-1] - (0.1, 0.185))) == pytest.approx(0.038 + 0.006, abs=2e-3)
    assert found.advice.startswith("the object is in the way")


@pytest.mark.deep
@pytest.mark.parametrize("stiffness", [1e3, 1e4])
def test_a_disc_is_pushed_as_cheaply_as_one_that_stands_is_touched(stiffness):
    """A gap that is to be closed costs what the way there costs, whether the disc then moves or not."""
    disc = {"shape": "circle", "diameter": 0.04, "mass": 0.1, "position": (-0.07, 0.11)}
    rod = {"length": 0.15, "linear_density": 0.03, "bending_stiffness": 0.01}
    tendons = {"offset": 0.005, "max_tension": 40.0, "time_constant": 0.02}
    law = {"stiffness": stiffness, "friction": 0.4, "dissipation": 1.0, "rounding": 2e-4, "slip_speed": 0.01}
    stands = PlanScene(
        finger={"rod": rod, "half_thickness": 0.005, "damping": {"material": 5e-5}, "tendons": tendons},
        gravity=(0.0, 0.0),
        object=disc,
        contact_law=law,
        fidelity={"family": "clothoid", "elements": 2},
        input={"rate_max": 300.0},
        objective="tracking",
        cost={"gap": 1e4, "effort": 1e-3},
        reference={"gap": (0.0,)},
        goal={"end": "moving"},
        duration=0.4,
        intervals=20,
        check={"tolerance": 0.1},  # of one grid: finer ones follow another motion each
    )
    table = {"friction": 0.2, "friction_radius": 0.013}
    touched, pushed = plan(stands), plan(stands.replaced(object_moves=True, out_of_plane_gravity=9.81, table=table))
    for found in (touched, pushed):
        assert found.statistics["starts"][0].split(": ")[1].startswith("Solve_Succeeded")
    assert pushed.objective == pytest.approx(touched.objective, rel=1e-3)


@pytest.mark.deep
def test_a_plan_presses_as_near_to_its_grasp_as_one_moment_can():
    """Tensions that differ by 5 % hold the finger where its contacts press less as in the grasp."""
    found = plan(cg.load(ROOT / "configs/plan/close_on_mug.yaml"))
    assert found.status == "optimal"
    # More elements stand where the finger hits the mug alone.
    assert int(found.statistics["starts"][-1].split(" elements")[0]) < 2 * found.scene.intervals
    model, aim = found.prediction, np.array(found.scene.goal.contact_force.value)
    x, interval = found.x[0], found.t[1]
    for k, u in enumerate(found.u[:-1]):
        x = after(interval, lambda x, u=u: model.dynamics(x, u, model.p_nominal), x)
        off = np.array(model.tip(x, u, model.p_nominal)).ravel() - found.tip[k + 1]
        assert np.hypot(*off) < 1e-3 * found.length
    # With what the goal weighs; a plan of the grid alone takes 2540.
    goal = found.scene.goal.contact_force.weight / 2 * np.sum((found.contact_forces[-1] - aim) ** 2)
    assert found.objective + goal == pytest.approx(1892.0, rel=5e-3)

    def missed(share):
        u = found.u[-1] * [share, 1.0]
        rest = root(lambda x: np.array(model.dynamics(x, u, model.p_nominal)).ravel(), found.x[-1], tol=1e-10)
        assert rest.success
        return np.linalg.norm(np.array(model.contact_force(rest.x, u, model.p_nominal)).ravel() - aim)

    assert missed(1.0) < min(missed(0.95), missed(1.05))
    assert np.linalg.norm(found.contact_forces[-1] - aim) == pytest.approx(missed(1.0), rel=1e-3)


@pytest.mark.parametrize("faster", [1.0, 20.0])
def test_steps_follow_a_motion_that_is_faster_than_was_thought(faster):
    """Where a motion would make the steps grow they become finer, and unknowns keep their places."""
    search = PlanSearch(load(TIP, [*BY_SHOOTING, "intervals=20", "finger.damping.quadratic=1e-5"]))
    problem = search.problem
    path = smooth_path(search.motion, search.x0, search.first, search.last)
    w, size, before = problem.start(replace(path, x=faster * path.x)), problem.assembly.size, problem.steps
    # Damping forces per rate grow with the rate; the motion itself is the truth of how fast it decays.
    stiff = np.abs(problem.rates(w)[problem.rates(w).real < 0.0]).max()
    step = path.duration / (len(problem.grid.v) * before[0])
    assert problem.outpaced(w) == bool(abs(amplification(before[1], -stiff * step)) > 1.0) == (faster > 1.0)
    if faster > 1.0:
        problem.refine(w)
        assert problem.assembly.size == size
        assert np.prod(problem.steps) > np.prod(before)
        assert not problem.outpaced(w)


SPIROB = Path(__file__).parents[2] / "configs/mpc/spirob.yaml"


@pytest.mark.deep
def test_the_last_tensions_of_a_taper_hold_it_where_they_bend_it():
    """At rest and without weight the angle along the finger is int T e / EI ds, by a quadrature of its own here."""
    goal = {"end": "held", "tip": {"value": (-0.0371, 0.2389), "weight": 1e6}}
    found = plan(
        PlanScene(
            finger=load(SPIROB).finger,
            gravity=(0.0, 0.0),
            fidelity={"family": "matched_clothoid", "elements": 3, "bending_range": 6.0},
            goal=goal,
            duration=0.6,
            intervals=20,
        )
    )
    net = float(found.u[-1] @ [1.0, -1.0])
    s = np.linspace(0.0, 0.25, 20001)
    share = 1.0 - 0.875 * s / 0.25  # thickness, and the tendon's distance, per that at the base
    stiffness = 12e6 * 0.04 * (0.3 * 0.04) ** 3 / 12.0
    cosine = 1.0 / np.hypot(1.0, 0.014 / 0.25)
    curvature = net * cosine * 0.016 / stiffness * share**-3
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(s))])
    tip = [-np.trapezoid(np.sin(angle), s), np.trapezoid(np.cos(angle), s)]
    assert found.tip[-1] == pytest.approx(tip, abs=2e-5)
    assert net == pytest.approx(0.7, abs=2e-3)


def hand_finger(k):
    """The plan of a hand finger of the same materials, k times as large: lengths and times go with k, tensions with its
    square, masses with its cube.
    """
    rod = {"length": 1, "linear_density": 2, "bending_stiffness": 4, "rotary_inertia": 4, "diameter": 1}
    tendons = {"offset": 1, "min_tension": 2, "max_tension": 2, "time_constant": 1}
    powers = {
        **{f"finger.rod.{key}": power for key, power in rod.items()},
        **{f"finger.tendons.{key}": power for key, power in tendons.items()},
        "finger.damping.material": 5,
        "finger.half_thickness": 1,
        "finger.masses[0].at": 1,
        "finger.masses[0].mass": 3,
        "input.rate_max": 1,
        "goal.tip.value[0]": 1,
        "goal.tip.value[1]": 1,
        "duration.least": 1,
        "duration.most": 1,
    }
    scene, values = load(TIP), {}
    for key, power in powers.items():
        value = scene
        for part in re.findall(r"\w+", key):
            value = value[int(part)] if part.isdigit() else getattr(value, part)
        values[key] = value * k**power
    return load(TIP, values)


@pytest.mark.deep
def test_the_finer_model_of_a_small_finger_moves_as_that_of_a_large_one():
    """Motions of one dimensionless scene are one: what is stiff about a finger of 6 mm takes shorter steps."""
    tips, k = [], 1.0 / 32.0
    for size in (1.0, k):
        scene = hand_finger(size)
        fine = scene.model_copy(update={"fidelity": scene.check.finer})
        model, nodes = Prediction(fine), np.linspace(0.0, 1.0, 41)[:, None]
        inputs = size**2 * np.hstack([1.0 + 40.0 * np.minimum(1.0, 2.0 * nodes), 1.0 + 0.0 * nodes])
        path = guess.Path(np.zeros((41, 0)), inputs, 0.15 * size)
        states = simulated(fine, model, path, guess.first_state_of_plan(fine, model)[0], 1)
        ends = [np.array(model.tip(x, u, model.p_nominal)).ravel() for x, u in zip(states, inputs, strict=True)]
        tips.append(np.array(ends) / scene.finger.rod.length)
    assert np.hypot(*np.ptp(tips[0], axis=0)) > 0.5
    np.testing.assert_allclose(tips[1], tips[0], atol=1e-3)
