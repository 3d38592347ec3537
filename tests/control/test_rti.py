"""Real-time iterations: what they converge to and refuse; from inside: their C, compiled loosely, of stages made here.

Real-time iterations: what they converge to, what they refuse, and what their C is made of.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import threading
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize

from benchmarks.real_time_iteration import STATUS, RealTimeIteration
from continuum_grasp.base import InputError, SolverError
from continuum_grasp.control import Stages, stages_of
from continuum_grasp.control.iteration.source import iteration_source
from continuum_grasp.control.ocp.stages import cost_functions, step_function
from continuum_grasp.core import Compiler
from continuum_grasp.core import compiler as compilers
from continuum_grasp.scene import Fidelity
from tests.control_cases import driven_scene, hand_scene, rod_scene
from tests.export_cases import loop_scene
from tests.marks import few
from tests.rti_cases import LOOSE, SIZES, by_ipopt, disturb, random_stages

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")

START = np.array([2.5, 0.0, 0.0])
STRICT = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Werror"]


@lru_cache
def pendulum() -> Stages:
    """Swing-up with little torque, bounded speed and bounded change of the torque, which is a state."""
    x, u, p = ca.SX.sym("x", 3), ca.SX.sym("u"), ca.SX.sym("p", 1)
    given = ([x, u, p], ["x", "u", "p"])

    def function(name: str, output: str, value: ca.SX) -> ca.Function:
        return ca.Function(name, given[0], [ca.densify(value)], given[1], [output])

    dynamics = function("dynamics", "xd", ca.vertcat(x[1], -p * ca.sin(x[0]) - 0.1 * x[1] + u))
    outputs = function("outputs", "y", ca.vertcat(ca.sin(x[0]), ca.cos(x[0]), x[1], u))
    rows = function("rows", "c", ca.vertcat(x[1] / 1.5, (u - x[2]) / 0.4))
    cost, terminal = cost_functions(outputs, rows, 0.1, 3, 1)
    return Stages(
        step=step_function(dynamics, 3),
        cost=cost,
        terminal=terminal,
        outputs=outputs,
        dynamics=dynamics,
        rows=rows,
        stages=20,
        stage=0.1,
        substeps=2,
        method="rk4",
        nd=2,
        ns=1,
        nt=3,
        x_names=("angle", "rate", "held"),
        u_names=("torque",),
        p_names=("gravity",),
        r_names=("sine", "cosine", "rate", "torque"),
        c_names=("rate", "change"),
        u_min=np.array([-0.8]),
        u_max=np.array([0.8]),
        c_min=np.array([-1.0, -1.0]),
        c_max=np.array([1.0, 1.0]),
        linear=np.array([10.0, 100.0]),
        quadratic=np.array([1.0, 1.0]),
        weights=np.array([4.0, 4.0, 0.1, 0.1]),
        terminal_weights=np.array([4.0, 4.0, 1.0, 0.0]),
        p_nominal=np.array([1.0]),
    )


REFS = np.array([0.0, 1.0, 0.0, 0.0])


@lru_cache
def shared(precision: str = "double", lanes: bool = True) -> RealTimeIteration:
    return RealTimeIteration(pendulum(), precision=precision, lanes=lanes)


def converged(rti: RealTimeIteration, x0: np.ndarray, refs: np.ndarray, steps: int = 60):
    rti.reset(x0, rollout=True)
    for _ in range(steps):
        report = rti.step(x0, refs)
    return report


@pytest.mark.parametrize("lanes", [False, True])
def test_iterations_from_one_state_end_at_the_optimum(lanes):
    """Torque, its rate and the pendulum's rate at their bounds, some rows beyond them."""
    s, rti = pendulum(), shared(lanes=lanes)
    report = converged(rti, START, REFS)
    x, u = rti.plan
    found = by_ipopt(s, START, REFS, (x, u))
    np.testing.assert_allclose(x, found[0], atol=1e-6)
    np.testing.assert_allclose(u, found[1], atol=1e-6)
    c = np.array([s.rows(x[k + 1], u[k], 1.0) for k in range(s.stages)]).squeeze()
    assert np.isclose(np.abs(c[:, 0]), 1.0, atol=1e-6).any()
    assert np.isclose(np.abs(u), 0.8).any()
    assert report.status in (0, 2)


@pytest.mark.parametrize(("method", "close"), [("rk4", 1e-6), ("sdirk2", 5e-5)])
def test_iterations_of_a_finger_end_at_the_optimum(method, close):
    """Two arcs with bounded moment and rate of moment, far from their setpoint.

    Derivatives of implicit steps leave out that of the last Newton correction, which moves where iterations end.
    """
    s = stages_of(rod_scene().changed({"controller.horizon.method": method}))
    rti = RealTimeIteration(s)
    x0, refs = np.zeros(s.nx), np.zeros(s.nr)
    refs[:2] = 0.45, 0.2
    converged(rti, x0, refs, 40)
    x, u = rti.plan
    found = by_ipopt(s, x0, refs, (x, u))
    np.testing.assert_allclose(u, found[1], atol=close * np.abs(found[1]).max())
    np.testing.assert_allclose(x, found[0], atol=close * np.abs(found[0]).max())


@pytest.mark.deep
@pytest.mark.parametrize("name", ["winches", "servo"])
def test_iterations_with_drives_and_tendon_friction_end_at_the_optimum(name):
    """No better cost is found by single shooting and the search of J. A. Nelder and R. Mead, without derivatives."""
    cost = {"tip": 2e4, "speed": 0.02, "effort": 50.0, "input_rate": 0.01}
    s = stages_of(driven_scene(name, controller={"horizon": {"stages": 3, "stage": 0.01}, "cost": cost}))
    rti = RealTimeIteration(s)
    x0, refs = np.zeros(s.nx), np.zeros(s.nr)
    refs[:2] = -0.004, 0.1795
    converged(rti, x0, refs, 40)

    def total(flat):
        x, found = ca.DM(x0), 0.0
        for u in np.reshape(flat, (s.stages, s.nu)):
            found += float(s.cost(x, u, s.p_nominal, refs, s.weights)[0])
            x = s.step(x, u, s.p_nominal, s.stage)[0]
        return found

    ours = rti.plan[1].ravel()
    assert s.substeps == 1
    assert np.abs(ours).max() > 1e-4
    start = 0.8 * ours
    best = minimize(total, start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-14, "maxiter": 3000})
    assert total(ours) <= best.fun * (1 + 1e-6)
    np.testing.assert_allclose(ours, best.x, atol=2e-3 * np.abs(ours).max())


@lru_cache
def swinging() -> RealTimeIteration:
    """A rod with a bounded speed, whose full steps cycle where it swings."""
    asked = {
        "horizon": {"stages": 15, "stage": 0.02, "substeps": 4},
        "cost": {"tip": {"running": 2e3, "terminal": 200.0}, "effort": 0.1},
        "input": {"moment_max": 0.3, "rate_max": 3.0},
        "bounds": {"speed": 8.0},
    }
    return RealTimeIteration(stages_of(rod_scene(controller=asked)))


CYCLING = np.array(
    [
        [1.405, 2.629, 15.39, -5.69, -0.1425],
        [-0.3339, -2.066, 8.655, -11.48, 0.1187],
        [0.7632, 3.674, -17.85, -48.65, 0.0537],
        [0.6275, -1.777, -7.559, -4.35, -0.0711],
    ]
)
"""Bends, rates and moments from which full steps, all or most of them, end in cycles."""


@pytest.mark.deep
@pytest.mark.parametrize("k", few(range(len(CYCLING)), 1))
def test_a_search_settles_where_full_steps_cycle(k):
    """At a minimum, where IPOPT stays."""
    rti, x0 = swinging(), CYCLING[k]
    s, refs = rti.stages, np.zeros(rti.stages.nr)
    refs[:2] = 0.3, 0.4
    rti.reset(x0, x0[4:], rollout=True)
    for _ in range(60):
        before = rti.plan[1].copy()
        rti.step(x0, refs)
    assert np.abs(rti.plan[1] - before).max() > 0.01 * 0.3
    rti.reset(x0, x0[4:], rollout=True)
    assert rti.iterate(x0, refs).status in (0, 2)
    x, u = (part.copy() for part in rti.plan)
    found = by_ipopt(s, x0, refs, (x, u))
    np.testing.assert_allclose(u, found[1], atol=1e-5 * 0.3)


def test_the_first_preparation_takes_the_derivatives_of_a_rollout():
    """They are those of a preparation that computes them again, which other parameters, inputs or steps ask for."""
    rti = RealTimeIteration(pendulum())
    found = []
    for touched in (False, True):
        rti.reset(START, [0.3], rollout=True)
        if touched:
            rti.plan[1][3] = 0.2
            rti.prepare(REFS)
            rti.plan[1][3] = 0.3
        rti.prepare(REFS)
        found.append(rti.qp())
    for name in found[0]:
        np.testing.assert_array_equal(found[0][name], found[1][name], err_msg=name)
    for p, stage, limit in (([1.1], 0.1, 0.8), ([1.0], 0.11, 0.8), ([1.0], 0.1, 0.25)):
        plans = []
        for again in (False, True):
            rti.settings.stage, rti.settings.u_max = 0.1, 0.8
            rti.prepare(p=[1.0])
            rti.reset(START, [0.3], rollout=True)
            if again:
                rti.prepare()
            rti.settings.stage, rti.settings.u_max = stage, limit
            rti.prepare(p=p)
            plans.append(rti.qp())
        for name in plans[0]:
            np.testing.assert_array_equal(plans[0][name], plans[1][name], err_msg=name)


@pytest.mark.parametrize("precision", ["double", "float"])
def test_iterations_that_settle_are_full_steps(precision):
    rti, plans = shared(precision), []
    for iterate in (False, True):
        rti.reset(START, rollout=True)
        if iterate:
            count = rti.iterate(START, REFS).iterations
        else:
            count, change = 0, 1.0
            while change > {"double": 1e-6, "float": 1e-3}[precision] * 0.8:
                before = rti.plan[1].copy()
                count += rti.step(START, REFS).iterations
                change = np.abs(rti.plan[1] - before).max()
        plans.append((count, rti.plan[1].copy()))
    assert plans[0][0] == plans[1][0]
    np.testing.assert_array_equal(plans[0][1], plans[1][1])


def test_iterations_that_do_not_settle_say_so():
    rti = swinging()
    rti.reset(CYCLING[0], CYCLING[0][4:], rollout=True)
    assert STATUS[rti.iterate(CYCLING[0], iterations=3).status] == "iteration limit"
    with pytest.raises(SolverError, match="bad input"):
        rti.iterate([np.nan] * 5)


def test_a_search_returns_from_where_the_model_is_not_finite():
    """The plan of the second iteration is sent to where the model overflows; iterations go on from the first one's.

    Along trajectories that are integrated, until full steps shrink to less than a fifth.
    """
    s, rti = pendulum(), shared()
    library, given = rti._library, (rti._progress, rti._preparation, rti._answer)
    rti.reset(START, rollout=True)
    rti.step(START, REFS)
    rti.reset(START, rollout=True)
    library.rti_begin(rti._work_at)
    assert library.rti_prepare(*given[1]) == 0
    status = library.rti_feedback(*given[2])
    assert library.rti_continue(*given[0], status) == status
    rti.plan[0][7, 1] = 1e308
    failed = library.rti_prepare(*given[1])
    assert STATUS[failed] == "bad linearization"
    assert STATUS[library.rti_continue(*given[0], failed)] == "iteration limit"

    def gap():
        """Greatest difference of the plan's states and those that its inputs drive."""
        state, most = START, 0.0
        for k in range(s.stages):
            for _ in range(s.substeps):
                state = np.array(s.step(state, rti.plan[1][k], 1.0, s.stage / s.substeps)[0]).ravel()
            most = max(most, np.abs(rti.plan[0][k + 1] - state).max())
        return most

    assert gap() < 1e-12
    changes, gaps = [], []
    for _ in range(3):
        before = rti.plan[1].copy()
        library.rti_prepare(*given[1])
        library.rti_continue(*given[0], library.rti_feedback(*given[2]))
        changes.append(np.abs(rti.plan[1] - before).max())
        gaps.append(gap())
    assert changes[1] > 0.2 * changes[0]
    assert changes[2] < 0.2 * changes[1]
    assert max(gaps[:2]) < 1e-12
    assert gaps[2] > 1e-10
    assert rti.iterate(START).status in (0, 2)


def test_lanes_change_nothing_but_rounding():
    plans = []
    for lanes in (False, True):
        rti = shared(lanes=lanes)
        rti.reset(START, rollout=True)
        rti.step(START, REFS)
        plans.append(np.r_[rti.plan[0].ravel(), rti.plan[1].ravel()])
    np.testing.assert_allclose(*plans, atol=1e-9)


@pytest.mark.parametrize("substeps", [1, 3])
def test_products_over_what_differs_from_zero_are_those_of_loops(substeps, monkeypatch):
    """Drives with lag and limited rates: many entries of the Jacobian are zero, some states are read by none."""
    problem = replace(stages_of(hand_scene(fidelity=Fidelity(family="arc", elements=2))), substeps=substeps)
    plans = []
    for lanes, loops in ((False, False), (True, False), (True, True)):
        if loops:
            monkeypatch.setattr("continuum_grasp.control.iteration.source.row_products", lambda stages: "")
        rti = RealTimeIteration(problem, lanes=lanes)
        assert ("RTI_UNROLLED_CONGRUENCE 1" in iteration_source(problem, lanes=lanes)) is not loops
        rti.reset(np.zeros(problem.nx), problem.u_min)
        for _ in range(4):
            rti.step(np.full(problem.nx, 0.1), np.full(problem.nr, 0.05))
        plans.append(np.concatenate([part.ravel() for part in (*rti.plan, *(rti.qp()[name] for name in "AB"))]))
    for plan in plans[:2]:
        np.testing.assert_allclose(plan, plans[2], rtol=1e-6, atol=1e-8 * np.abs(plans[2]).max())


# ---- the plan ----


def test_a_rollout_is_the_integration_of_the_inputs():
    s, rti = pendulum(), shared()
    rti.reset(START, [0.3], rollout=True)
    state = START
    for k in range(s.stages):
        for _ in range(s.substeps):
            state = np.array(s.step(state, 0.3, 1.0, s.stage / s.substeps)[0]).ravel()
        np.testing.assert_allclose(rti.plan[0][k + 1], state, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("stages", [0.0, 0.25, 1.0, 2.5, 19.75, 20.0, 35.0])
def test_a_shifted_plan_stays_on_its_line(stages):
    """States that are linear in time stay so; inputs are those means of a staircase; the ends stay."""
    s, rti = pendulum(), shared()
    nodes = np.arange(s.stages + 1.0)
    rti.plan[0][:] = nodes[:, None] * [1.0, -2.0, 0.5]
    rti.plan[1][:] = nodes[:-1, None]
    rti.shift(stages)
    expected = np.minimum(nodes + stages, s.stages)
    np.testing.assert_allclose(rti.plan[0], expected[:, None] * [1.0, -2.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(rti.plan[1][:, 0], np.minimum(nodes[:-1] + stages, s.stages - 1.0), atol=1e-12)


# ---- what is not finite ----


@pytest.fixture(params=["exact", "loose"])
def rti(request, monkeypatch):
    """The pendulum, also by a compiler that takes NaN for impossible."""
    if request.param == "loose":
        monkeypatch.setattr(compilers, "_COMMON", (*compilers._COMMON, *LOOSE))
    made = RealTimeIteration(pendulum())
    converged(made, START, REFS, 3)
    return made


BAD = {
    "x0": (lambda r, bad: r.step([0.0, bad, 0.0]), "bad input"),
    "refs": (lambda r, bad: r.step(START, np.r_[REFS[:3], bad]), "bad input"),
    "p": (lambda r, bad: r.step(START, REFS, [bad]), "bad input"),
    "weights": (lambda r, bad: (setattr(r.settings, "weights", bad), r.step(START)), "bad input"),
    "u_min": (lambda r, bad: (setattr(r.settings, "u_min", bad), r.step(START)), "bad input"),
    "c_max": (lambda r, bad: (setattr(r.settings, "c_max", bad), r.step(START)), "bad input"),
    "stage": (lambda r, bad: (setattr(r.settings, "stage", bad), r.step(START)), "bad input"),
    "tolerance": (lambda r, bad: (setattr(r.settings, "tolerance", bad), r.step(START)), "bad input"),
    "plan": (lambda r, bad: (r.plan[0].__setitem__((7, 1), bad), r.step(START)), "bad input"),
    "model": (lambda r, bad: (r.plan[0].__setitem__((7, 1), 1e308), r.step(START)), "bad linearization"),
    "overflow": (lambda r, bad: r.step([1e200, 0.0, 0.0]), "bad solution"),
    "negative penalty": (lambda r, bad: (setattr(r.settings, "linear", -1.0), r.step(START)), "bad input"),
    "crossed bounds": (lambda r, bad: (setattr(r.settings, "u_min", 1.0), r.step(START)), "bad input"),
    "no sub-steps": (lambda r, bad: (setattr(r.settings, "substeps", 0), r.step(START)), "bad input"),
}


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("what", BAD)
def test_what_is_not_finite_leaves_the_plan_alone(rti, what, bad):
    do, status = BAD[what]
    before = [part.copy() for part in rti.plan]
    with pytest.raises(SolverError) as caught:
        do(rti, bad)
    assert caught.value.status == status
    for part, old in zip(rti.plan, before, strict=True):
        assert np.count_nonzero(part != old) <= (what in ("plan", "model"))
    assert status in STATUS.values()


def test_after_a_failure_it_goes_on(rti):
    with pytest.raises(SolverError):
        rti.step([np.nan, 0.0, 0.0])
    with pytest.raises(SolverError):
        rti.prepare(np.full(4, np.nan))
    with pytest.raises(SolverError, match="not prepared"):
        rti.feedback(START)
    assert rti.step(START, REFS).status in (0, 2)


# ---- the C ----


@pytest.mark.parametrize("real", ["double", "float"])
@pytest.mark.parametrize("stages", few([pendulum, *[lambda k=k: random_stages(k, SIZES[k]) for k in (4, 1, 2, 3)]], 2))
def test_the_c_has_no_warning_no_memory_of_its_own_and_no_allocation(stages, real, tmp_path):
    source, built = tmp_path / "rti.c", tmp_path / "rti.o"
    source.write_text(iteration_source(stages(), real=real, lanes=False))
    compiler = list(Compiler.find().command)
    done = subprocess.run([*compiler, *STRICT, "-O2", "-c", source, "-o", built], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[:2000]
    assert done.stderr == ""
    if shutil.which("nm"):
        lines = subprocess.run(["nm", built], capture_output=True, text=True, check=True).stdout.splitlines()
        symbols = [line.split()[-2:] for line in lines]
        assert {kind for kind, _ in symbols} <= {"T", "t", "r", "R", "U"}
        mathematics = {"sin", "cos", "sqrt"} if real == "double" else {"sinf", "cosf", "sqrtf", "sincosf"}
        assert {name for kind, name in symbols if kind == "U"} <= {"memcpy", "memset", "sincos", *mathematics}
        exported = {name for kind, name in symbols if kind == "T"}
        assert exported == {
            f"rti_{n}" for n in ("start", "rollout", "prepare", "feedback", "begin", "continue", "shift")
        }


def test_two_threads_with_memory_of_their_own_do_not_meet():
    """Each gives bit for bit what it gives alone."""
    stages = random_stages(0, SIZES[0])
    alone, together = ([RealTimeIteration(stages) for _ in range(2)] for _ in range(2))

    def run(rti: RealTimeIteration, seed: int, into: list) -> None:
        rng = np.random.default_rng(seed)
        for _ in range(200):
            x0 = disturb(rti, rng)
            into.append((rti.feedback(x0), rti.plan[0].copy(), rti.plan[1].copy()))

    expected, found = ([[], []] for _ in range(2))
    for seed, rti in enumerate(alone):
        run(rti, seed, expected[seed])
    threads = [threading.Thread(target=run, args=(r, seed, found[seed])) for seed, r in enumerate(together)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for one, other in zip(expected[0] + expected[1], found[0] + found[1], strict=True):
        assert one[0] == other[0]
        assert one[1].tobytes() == other[1].tobytes()
        assert one[2].tobytes() == other[2].tobytes()


def test_memory_that_was_not_cleared_is_no_harm():
    """The C reads nothing from its workspace that it has not written."""
    for k in (0, 4):
        rti = RealTimeIteration(random_stages(k, SIZES[k]))
        plans = []
        for fill in (0, 255):
            ctypes.memset(rti._work.ctypes.data, fill, rti._work.nbytes)
            rng = np.random.default_rng(4)
            x0 = disturb(rti, rng)
            rti.feedback(x0)
            plans.append(np.r_[rti.plan[0].ravel(), rti.plan[1].ravel()])
        np.testing.assert_array_equal(*plans)


# ---- what is refused ----


def test_without_a_compiler_it_says_so(monkeypatch):
    monkeypatch.setenv("CC", "")
    with pytest.raises(InputError, match="needs a C compiler"):
        RealTimeIteration(pendulum())


def test_functions_of_other_sizes_are_refused():
    s = pendulum()
    x, u, p, h = (ca.SX.sym(name, k) for name, k in (("x", 3), ("u", 1), ("p", 1), ("h", 1)))
    wrong = ca.Function("stage_step", [x, u, p, h], [x, ca.SX(3, 3), ca.densify(ca.SX(3, 1))])
    with pytest.raises(InputError, match="stage_step: expected dense outputs"):
        RealTimeIteration(replace(s, step=wrong))
    given = s.cost.mx_in()
    called = ca.Function("stage_cost", given, [2.0 * value for value in s.cost.call(given)])
    with pytest.raises(InputError, match="straight-line"):
        RealTimeIteration(replace(s, cost=called))


def test_settings_act_at_the_next_iteration():
    """A narrower bound is satisfied at once; without it the answer is the first one again."""
    rti = RealTimeIteration(pendulum())
    rti.reset(START)
    rti.settings.u_max = 0.2
    rti.step(START, REFS)
    assert rti.plan[1].max() == 0.2
    rti.reset(START)
    rti.settings.u_max = Stages.ABSENT
    rti.step(START, REFS)
    assert rti.plan[1].max() > 0.2


@pytest.mark.parametrize(("stages", "precision"), [(8, "double"), (20, "float")])
def test_a_bound_that_holds_on_is_not_searched_for_again(stages, precision):
    """A bend beyond the bound of the curvature, which then holds over the whole horizon in every QP."""
    problem = stages_of(loop_scene(stages, observed=False))
    iteration = RealTimeIteration(problem, precision=precision)
    x, refs = np.zeros(problem.nx), np.array([-1.2, -0.6, 1.0, 1.0])
    iteration.reset(x, problem.u_min)
    for k in range(40):
        report = iteration.step(x, refs)
        assert report.iterations <= (12 if k == 0 else 2 if precision == "double" and k > 9 else 6)
        x = np.array(problem.step(x, iteration.plan[1][0], problem.p_nominal, problem.stage / 2)[0]).ravel()
        x = np.array(problem.step(x, iteration.plan[1][0], problem.p_nominal, problem.stage / 2)[0]).ravel()
        iteration.shift()
    assert x[0] == pytest.approx(-9.0 * 0.09, abs=1e-3)  # greatest curvature [1/m] times an element's length
