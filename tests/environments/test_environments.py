"""Environments against simulation and controller; from inside: single steps of the plant, and how many are chosen.

Environments against the package's own simulation, closed loop and controller, and the checks of gymnasium.
"""

from __future__ import annotations

import subprocess
import sys
import warnings
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp import InputError, run_closed_loop
from continuum_grasp.base import shell
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.closed_loop.integration import Integration
from continuum_grasp.scene import Actuation, Timing
from tests.marks import few

gymnasium = pytest.importorskip("gymnasium")
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.vector import AutoresetMode  # noqa: E402

from continuum_grasp.addons.learning import TASKS, Ended, FingerEnv, FingerVectorEnv  # noqa: E402
from continuum_grasp.addons.learning.environments import substeps  # noqa: E402
from continuum_grasp.addons.learning.environments.plants import plants_of  # noqa: E402
from continuum_grasp.addons.learning.environments.sensing import single_precision, state_bounds  # noqa: E402

FAST = {"plant.fidelity": {"family": "matched_clothoid", "elements": 2}}
SWEEP = {
    "scene": "configs/mpc/steady_tip.yaml",
    "set": {**FAST, "duration": 0.2},
    "sample": {
        "count": 12,
        "keys": {
            "plant.stiffness": {"uniform": [0.8, 1.2]},
            "plant.damping": {"log_uniform": [0.7, 1.4]},
            "plant.tip_mass": {"uniform": ["0 g", "3 g"]},
            "plant.time_constant": {"uniform": ["15 ms", "30 ms"]},
            "finger.tendons.offset": {"normal": ["5 mm", "0.2 mm"]},
            "initial": {"choice": [{"q": [0.0, 0.0]}, {"q": [1.0, 0.5], "qd": [5.0, -3.0]}]},
            "reference.tip": {"choice": [[-0.08, 0.15], [0.07, 0.16]]},
        },
    },
}
"""Every kind of draw, of every part of a plant."""
TOUCHING = {
    **{name: TASKS["Wrap"][name] for name in ("scene",)},
    "sample": {"count": 8, "keys": TASKS["Wrap"]["sample"]["keys"]},
}


@cache
def envs(which: str = "free", sensors: str | None = "state", mode: str = "NextStep") -> FingerVectorEnv:
    """Compiled once for all tests, which begin with a reset."""
    scene = {"free": SWEEP, "touching": TOUCHING}[which]
    return FingerVectorEnv(scene, 12, sensors=sensors, autoreset_mode=AutoresetMode(mode))


def commands(env: FingerVectorEnv, steps: int, seed: int = 0, share: float = 0.15) -> np.ndarray:
    """Random commands (steps, count, nu) that hold for some periods."""
    low, high = env.single_action_space.low, env.single_action_space.high
    shape = (steps, env.num_envs, len(low))
    return np.repeat(np.random.default_rng(seed).uniform(low, low + share * (high - low), shape)[::5], 5, axis=0)


# -- physics ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("which", ["free", "touching"])
def test_a_plant_is_that_of_its_scene(which):
    """Plant k moves as RK4 steps of a plant that is built and compiled from scene k alone, to rounding."""
    env = envs(which)
    env.reset(seed=0, options={"scene": np.arange(12) % len(env.scenes)})
    start, period = env.x.copy(), env.scenes[0].controller.step
    chosen, moved = [0, 1, 5], []
    for u in commands(env, 15):
        env.step(u)
        moved.append((env.x.copy(), env._u.copy()))
    for k in chosen:
        plant = PlantModel(env.scenes[env.drawn[k]])
        run, x = Integration(plant, "rk4"), start[k]
        np.testing.assert_allclose(x, plant.start, atol=1e-12)
        for states, applied in moved:
            x = run.advance(x, applied[k], 0.0, period, env.substeps)[-1]
            np.testing.assert_allclose(states[k], x, rtol=1e-9, atol=1e-9 * np.abs(states[k]).max())


def test_a_motion_is_that_of_simulate():
    """A bent finger is let go under constant tensions: steps of variable length, to 1e-11, against 64 a period."""
    scene = cg.load(SWEEP["scene"], {**SWEEP["set"], "plant.stiffness": 1.0, "initial": {"q": [3.0, 6.0]}})
    env = FingerVectorEnv(scene, 1, sensors="state", substeps=64)
    env.reset(seed=0)
    # The drive of a simulation has reached what is commanded at time zero.
    env.x[:, 4:6] = env._u[:] = [5.0, 1.0]
    tips = [env.step([[5.0, 1.0]]) and env._readings[0, -2:].copy() for _ in range(15)]
    timing = Timing(duration=0.15, step=0.01, method="reference")
    moved = cg.simulate(PlantModel.plant_scene(scene).replaced(actuation=Actuation(tensions=(5.0, 1.0)), time=timing))
    assert np.linalg.norm(moved.tip[1:] - tips, axis=1).max() < 1e-8 * 0.18
    assert np.linalg.norm(np.ptp(moved.tip, axis=0)) > 0.01


def test_steps_are_compared_from_gentle_commands_to_the_whole_range(monkeypatch):
    low, high, rest, given = np.array([1.0, -2.0]), np.array([9.0, 5.0]), np.array([3.0, -1.0]), []
    monkeypatch.setattr(substeps, "_tips", lambda *asked: given.append(asked[4]) or np.zeros((100, 16, 2)))
    scene = SimpleNamespace(finger=SimpleNamespace(rod=SimpleNamespace(length=0.2)), input_limits=(low, high))
    model = SimpleNamespace(rest_input=rest)
    plants = SimpleNamespace(p=np.zeros((3, 1)), scenes=[scene], model=model, period=0.01)
    assert substeps.choose_substeps(plants, None, 0.0, 1.0) == (1, 0.0)
    away = given[0] - rest
    for share, lane in zip(np.linspace(0.1, 1.0, 16), np.moveaxis(away, 1, 0), strict=True):
        assert np.all((lane >= share * (low - rest)) & (lane <= share * (high - rest)))
    assert np.all(np.ptp(away[:, -1], axis=0) > 0.5 * (high - low))


# -- rewards ----------------------------------------------------------------------------------------------------------


def test_the_return_is_the_cost_of_a_closed_loop():
    """The same commands on the same plant: reward by reward the cost that the controller minimizes."""
    scene = cg.load(SWEEP["scene"], {**SWEEP["set"], "plant.stiffness": 1.05})
    run = run_closed_loop(scene)
    env = FingerEnv(scene, substeps=cg.closed_loop.Plant(scene).method.substeps)
    env.reset(seed=0)
    rewards = [env.step(u) for u in run.u]
    expected = 0.5 * run.period * (run.weights * (run.tracked - run.r)[:-1] ** 2).sum(axis=1)
    # The closed loop integrates with as many steps; its commands are within the limits but for rounding.
    np.testing.assert_allclose([-r for _, r, *_ in rewards], expected, rtol=1e-7)
    assert -sum(r for _, r, *_ in rewards) == pytest.approx(run.metrics().cost, rel=1e-7)
    assert rewards[-1][3]
    assert not rewards[-2][3]


# -- what plants may differ in ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "values", "message"),
    [
        ("plant.fidelity.elements", [1, 2], "same plant.fidelity"),
        ("controller.cost.effort", [1e-3, 1e-4], "same controller"),
        ("finger.tendons.max_tension", [50.0, 60.0], "same input_limits"),
        ("estimator.measured.tip", [1e-3, 1e-4], "same estimator"),
        ("plant.noise", [1.0, 2.0], "same plant.noise"),
        ("finger.half_thickness", [0.005, 0.006], None),
        ("finger.masses", [[{"at": 0.18, "mass": 0.002}], [{"at": 0.1, "mass": 0.001}]], "moves differently"),
        ("finger.stiffness", [1.0], "finger.stiffness"),
        ("contact_law.stiffness", [1000.0, 2000.0], "the same surroundings but for friction"),
        ("object.angle", [0.0, 0.1], "the same surroundings but for friction"),
    ],
)
def test_what_is_no_parameter_is_refused(key, values, message):
    touching = key.startswith(("contact_law", "object"))
    scene = {"scene": TOUCHING["scene"]} if touching else {"scene": SWEEP["scene"], "set": SWEEP["set"]}
    sweep = {**scene, "vary": {key: {"values": values}}}
    if message is None:  # of no effect where nothing is touched
        assert len(FingerVectorEnv(sweep, 2, substeps=1).scenes) == 2
        return
    with pytest.raises(InputError, match=message):
        FingerVectorEnv(sweep, 2, substeps=24 if touching else 1)


def test_what_acts_in_contact_alone_is_compared():
    """Each model is compared where it touches: half the thickness of the finger is no parameter."""
    sweep = {"scene": TOUCHING["scene"], "vary": {"finger.half_thickness": {"values": [0.006, 0.005]}}}
    with pytest.raises(InputError, match=r"scene 1 .* moves differently than the model of scene 0"):
        FingerVectorEnv(sweep, 2, substeps=24)


@pytest.mark.parametrize(
    ("scene", "values"), [(TOUCHING["scene"], [0.0, 0.6]), ("configs/mpc/turn_bar.yaml", [0.3, 0.6])]
)
def test_a_factor_of_all_friction_sets_no_coefficient_alone(scene, values):
    """One that is zero stays so, and that of the table would change too."""
    sweep = {"scene": scene, "vary": {"contact_law.friction": {"values": values}}}
    with pytest.raises(InputError, match="moves differently"):
        FingerVectorEnv(sweep, 2, substeps=24)


@pytest.mark.parametrize(
    ("scene", "message"),
    [
        ("configs/simulate/hanging.yaml", "expected a closed loop .* or a sweep"),
        ("configs/sweep/mug_uncertain.yaml", "an environment needs a closed loop"),
        ("configs/mpc/tip_steps.yaml", "more than 128 steps of RK4"),
        ("configs/mpc/pulse.yaml", "loads of an environment must be constant"),
    ],
)
def test_scenes_that_are_no_environment(scene, message):
    with pytest.raises(InputError, match=message):
        FingerVectorEnv(scene, 2)


def test_sweeps_of_closed_loops_are_for_environments(tmp_path):
    with pytest.raises(InputError, match=r"are for continuum_grasp\.addons\.learning"):
        cg.sweep(SWEEP, folder=tmp_path)


# -- the rules of gymnasium -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", few(TASKS, 2))
def test_an_id_passes_the_checks(name):
    """Of gymnasium; the one warning left is that commands are in N and not in -1 to 1."""
    task = {**TASKS[name], "sample": {**TASKS[name]["sample"], "count": 4}}
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        env = gymnasium.make(f"continuum_grasp/{name}-v0", scene=task, sensors="state")
        check_env(env.unwrapped)
        made = gymnasium.make_vec(f"continuum_grasp/{name}-v0", num_envs=3, scene=task)
    assert all("normalized" in str(one.message) for one in found)
    assert type(made) is FingerVectorEnv
    _check_vector(made)


def _check_vector(env: Any) -> None:
    """The vector counterpart: shapes, types, spaces, seeds, and data that no two calls share."""
    assert env.observation_space.shape == (env.num_envs, *env.single_observation_space.shape)
    assert env.action_space.shape == (env.num_envs, *env.single_action_space.shape)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert len(env.observation_names) == env.single_observation_space.shape[0]
    assert np.isfinite(env.single_observation_space.low).all()
    assert np.isfinite(env.single_observation_space.high).all()
    runs = []
    for _ in range(2):
        env.action_space.seed(1)
        found = [env.reset(seed=7)[0]]
        for _ in range(8):
            observation, reward, terminated, truncated, _ = env.step(env.action_space.sample())
            assert observation in env.observation_space
            assert reward.shape == terminated.shape == truncated.shape == (env.num_envs,)
            assert reward.dtype == np.float64
            assert terminated.dtype == truncated.dtype == np.bool_
            assert not any(np.shares_memory(observation, earlier) for earlier in found)
            found.append(observation)
        runs.append(np.array(found))
    np.testing.assert_array_equal(*runs)
    assert np.any(env.reset(seed=8)[0] != runs[0][0]) or not env._noisy


def test_next_step_autoreset():
    """As gymnasium's own vector environment of single ones does it, with the same commands."""
    env = envs()
    env.reset(seed=0, options={"scene": np.arange(12)})
    done = [env.step(u) for u in commands(env, 20)]
    assert all(not d[3].any() and not d[2].any() for d in done[:-1])
    last, reset = done[-1], env.step(np.full((12, 2), 30.0))
    assert last[3].all()
    assert last[4]["ended"].tolist() == [Ended.TIME.value] * 12
    # The command of the step that resets has no effect.
    np.testing.assert_array_equal(env.x, env._plants.start[env.drawn])
    assert not reset[1].any()
    assert not reset[2].any()
    assert not reset[3].any()
    assert reset[4]["_scene"].all()
    assert (env.step(np.full((12, 2), 1.0))[1] < 0.0).all()


def test_same_step_autoreset():
    env = envs(mode="SameStep")
    env.reset(seed=0, options={"scene": np.arange(12)})
    other = envs()
    other.reset(seed=0, options={"scene": np.arange(12)})
    for u in commands(env, 20):
        found, expected = env.step(u), other.step(u)
    np.testing.assert_array_equal(np.stack(found[4]["final_obs"]), expected[0])
    np.testing.assert_array_equal(found[1], expected[1])
    assert found[3].all()
    assert found[4]["final_info"]["ended"].tolist() == [Ended.TIME.value] * 12
    np.testing.assert_array_equal(env.x, env._plants.start[env.drawn])
    np.testing.assert_allclose(found[0][:, : env.x.shape[1]], env.x, rtol=1e-6)


def test_disabled_autoreset():
    env = envs(mode="Disabled")
    env.reset(seed=0)
    for u in commands(env, 20):
        env.step(u)
    with pytest.raises(InputError, match="episodes have ended"):
        env.step(np.ones((12, 2)))
    mask = np.ones(12, dtype=bool)
    env.reset(options={"reset_mask": mask})
    first, _ = env.reset(options={"reset_mask": np.arange(12) < 3, "scene": 5})
    assert (env.drawn[:3] == 5).all()
    assert first.shape == (12, 12)
    env.step(np.ones((12, 2)))


def test_one_is_the_first_of_many():
    """The same seed, commands and scenes: FingerEnv has the numbers of FingerVectorEnv."""
    many = FingerVectorEnv(SWEEP, 1)
    one = FingerEnv(SWEEP)
    (first, _), (other, _) = many.reset(seed=4), one.reset(seed=4)
    np.testing.assert_array_equal(first[0], other)
    for u in commands(many, 20):
        a, b = many.step(u), one.step(u[0])
        np.testing.assert_array_equal(a[0][0], b[0])
        assert (a[1][0], a[2][0], a[3][0]) == b[1:4]


# -- sensors ----------------------------------------------------------------------------------------------------------


def test_sensors_are_those_of_the_plant():
    """Noise and delay of the estimator's sensors; the readings behind them are those of the closed loop's plant, and
    the state beside them is that of now.
    """
    scene = cg.load(SWEEP["scene"], {**SWEEP["set"], "plant.noise": 0.0, "estimator.delay": 0.02})
    plant = cg.closed_loop.Plant(scene)
    steps = plant.method.substeps
    env, beside = FingerEnv(scene, substeps=steps), FingerEnv(scene, sensors=("tip", "state"), substeps=steps)
    assert env.lanes._sensing.names == ("tip_x [m]", "tip_y [m]", "tension_1 [N]", "tension_2 [N]")
    (observation, _), (both, _) = env.reset(seed=0), beside.reset(seed=0)
    for u in commands(env.lanes, 15)[:, 0]:
        np.testing.assert_allclose(observation[:4], plant.measure(), rtol=2e-6, atol=1e-7)
        np.testing.assert_allclose(both[:2], observation[:2])
        np.testing.assert_allclose(both[2 : 2 + len(plant.x)], plant.x, rtol=2e-6, atol=1e-6)
        observation, both = env.step(u)[0], beside.step(u)[0]
        plant.advance(env.lanes._u[0])


def test_noise_has_the_deviation_of_the_sensors():
    env = envs(sensors=None)
    env.reset(seed=0, options={"scene": 0})
    assert env._sensing.std.tolist() == [3e-4, 3e-4, 0.1, 0.1]
    many = np.array([env._observation()[:, :4] for _ in range(400)])
    # 4,800 draws each: a standard error of 1 %.
    np.testing.assert_allclose((many - many.mean(axis=0)).std(axis=(0, 1)), env._sensing.std, rtol=0.05)


def test_fewer_sensors():
    env = FingerVectorEnv(SWEEP, 3, sensors=("tension",), substeps=2)
    assert env.observation_names[:4] == ("tension_1 [N]", "tension_2 [N]", *(f"command_{n}" for n in env.action_names))
    for wrong in ("camera", ("tip", "tip")):
        with pytest.raises(InputError, match="sensors"):
            FingerVectorEnv(SWEEP, 3, sensors=wrong, substeps=2)


def test_setpoints_ahead():
    """Where they vary: now, half a horizon and a horizon later."""
    scene = cg.load("configs/mpc/tip_arc.yaml", {**FAST, "plant.tendon_friction": None})
    env = FingerEnv(scene, sensors="state", substeps=4)
    env.reset(seed=0)
    for _ in range(7):
        observation, *_ = env.step([1.0, 1.0])
    shown = observation[-6:].reshape(3, 2)
    rows = env.lanes._plants.setpoints[0, :, :2]
    np.testing.assert_allclose(shown, rows[[7, 22, 37]], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(rows[10], [-0.01201, 0.17946], atol=1e-12)  # of the file, at 0.1 s
    assert env.lanes.observation_names[-1] == "setpoint_tip_y [m] 0.3 s ahead"


# -- what ends an episode ---------------------------------------------------------------------------------------------


def test_a_plant_out_of_range_is_terminated_and_charged():
    scene = cg.load(SWEEP["scene"], {**SWEEP["set"], "duration": 1.0})
    env = FingerVectorEnv(scene, 4, sensors="state")
    env.reset(seed=0)
    pull = np.tile([60.0, 1.0], (4, 1))
    pull[1:] = [8.0, 1.0]
    left = 101
    while left:
        left -= 1
        x, held = env.x.copy(), env._u.copy()
        observation, reward, terminated, _, info = env.step(pull)
        assert observation in env.observation_space
        if terminated.any():
            break
    assert terminated.tolist() == [True, False, False, False]
    assert info["ended"][0] == Ended.RANGE.value
    alone = FingerVectorEnv(scene, 1, sensors="state", substeps=env.substeps)
    alone.reset(seed=0)
    alone.x[:], alone._u[:] = x[:1], held[:1]
    cost = -alone.step(pull[:1])[1][0] / 100.0  # of its own first step, with 99 to go
    assert reward[0] == pytest.approx(-cost * left, rel=1e-9)


def test_a_plant_that_diverges_is_terminated_with_its_last_observation():
    """Steps far too long for a stiff plant: no NaN reaches observations or rewards, and the plant begins anew."""
    stiff = {**SWEEP["set"], "plant.fidelity": {"family": "clothoid", "elements": 4}}
    env = FingerVectorEnv(cg.load(SWEEP["scene"], stiff), 8, sensors="state", substeps=1)
    env.reset(seed=0)
    reasons = []
    for u in commands(env, 20):
        observation, reward, terminated, _, info = env.step(u)
        assert observation in env.observation_space
        assert np.isfinite(reward).all()
        reasons += [info["ended"][k] for k in np.flatnonzero(terminated)]
    assert Ended.DIVERGED.value in reasons or Ended.RANGE.value in reasons
    env.reset(seed=0)
    env.x[3, 2] = np.nan  # whatever made it so
    observation, reward, terminated, _, info = env.step(np.ones((8, 2)))
    assert terminated[3]
    assert info["ended"][3] == Ended.DIVERGED.value
    assert np.isfinite(observation).all()


def test_contact_forces():
    """Those of the controller's contacts, by the normal force of the plant itself."""
    env = envs("touching")
    env.reset(seed=0)
    low = env.single_action_space.low
    pull = np.tile([30.0, low[1]], (12, 1))
    for _ in range(80):
        observation, _, terminated, _, info = env.step(pull)
        assert not terminated.any()
        assert observation in env.observation_space
    assert env.contact_names == ("finger.1", "finger.tip")
    force = info["contact_force"]
    assert (force[:, 0] > 1.0).all()
    plant = PlantModel(env.scenes[env.drawn[2]])
    function = plant.function("force", f=plant.touch["normal_force"])
    assert force[2] == pytest.approx(np.array(function(env.x[2], env._u[2], plant.forces(0.0)[0])).ravel(), rel=1e-9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda env: env.step(np.where(np.arange(24).reshape(12, 2) == 7, np.nan, 1.0)),
            "tension_2 .N. of plant 3 is nan",
        ),
        (lambda env: env.step(np.ones((12, 3))), "shape"),
        (lambda env: env.reset(options={"pose": 1}), "reset_mask or scene"),
        (lambda env: env.reset(options={"scene": 12}), "from 0 to 11"),
        (lambda env: env.reset(options={"reset_mask": np.zeros(12, dtype=bool)}), "at least one true entry"),
        (lambda env: FingerVectorEnv(SWEEP, 0), "num_envs"),
        (lambda env: FingerVectorEnv(SWEEP, 1, substeps=0), "substeps"),
        (lambda env: FingerVectorEnv({**SWEEP, "scene": "configs/mpc/none.yaml"}, 1), "no such file"),
    ],
)
def test_wrong_input_is_refused(call, message):
    env = envs()
    env.reset(seed=0)
    with pytest.raises(InputError, match=message):
        call(env)


def test_commands_saturate_at_the_limits_of_the_drive():
    env = envs()
    env.reset(seed=0, options={"scene": 0})
    env.step(np.full((12, 2), 1e6))
    np.testing.assert_allclose(env._u, 1.0 + 600.0 * 0.01)
    for _ in range(12):
        env.step(np.full((12, 2), 1e6))
    np.testing.assert_allclose(env._u, 60.0)


def test_objects_that_move():
    """A bar on a table, of another mass and friction in each scene, from another place."""
    keys = {
        "plant.object_mass": {"uniform": [0.8, 1.2]},
        "plant.object_friction": {"uniform": [0.8, 1.2]},
        "object.position[0]": {"uniform": [0.030, 0.035]},
        "object.angle": {"uniform": [-0.1, 0.1]},
    }
    sweep = {"scene": "configs/mpc/turn_bar.yaml", "set": FAST, "sample": {"count": 4, "keys": keys}}
    env = FingerVectorEnv(sweep, 4, substeps=100)
    env.reset(seed=0, options={"scene": np.arange(4)})
    start = env.x.copy()
    applied = []
    for _ in range(40):
        observation, *_ = env.step(np.tile([1.0, 14.0], (4, 1)))
        applied.append(env._u.copy())
        assert observation in env.observation_space
    at = env._plants.model.system.object_states
    assert (np.abs(env.x - start)[:, at].max(axis=1) > 1e-3).all()  # it was pushed
    plant = PlantModel(env.scenes[2])
    run, x = Integration(plant, "rk4"), start[2]
    for u in applied:
        x = run.advance(x, u[2], 0.0, 0.01, 100)[-1]
    np.testing.assert_allclose(env.x[2], x, rtol=1e-7, atol=1e-9)


def test_without_gymnasium():
    """The sweeps of the environments are there; an environment says what to install."""
    code = (
        "import sys; sys.modules['gymnasium'] = None\n"
        "import continuum_grasp as cg, continuum_grasp.addons.learning as own; print(len(own.TASKS))\n"
        "for name in ('FingerEnv', 'FingerVectorEnv'):\n"
        "    try: getattr(own, name)\n"
        "    except cg.InputError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    missing = f"environments need the extra 'gym': {shell.install_line('gym')}"
    assert done.stdout.splitlines() == [str(len(TASKS)), missing, missing]


def test_bounds_in_single_precision_are_the_nearest_outside():
    rng = np.random.default_rng(2)
    bounds = np.sort(rng.standard_normal((400, 2)) * 10.0 ** rng.uniform(-6.0, 6.0, (400, 1)), axis=1)
    low, high = single_precision(bounds)
    assert np.all(low <= bounds[:, 0])
    assert np.all(high >= bounds[:, 1])
    infinite = np.float32(np.inf)
    assert np.all(np.nextafter(low, infinite) > bounds[:, 0])
    assert np.all(np.nextafter(high, -infinite) < bounds[:, 1])


@pytest.mark.parametrize("sides", [[0.005], [0.005, -0.005]])
def test_tensions_that_lag_beside_chambers_start_at_rest_within_bounds_of_their_own(sides):
    """Pressures, which are commanded at once here, are no states: each state goes by its name."""
    chambers = [{"area": 6e-5, "offset": e, "min_pressure": 1e4, "max_pressure": 8e4} for e in sides]
    coarse = {"family": "clothoid", "elements": 1}
    changes = {"finger.pressure": chambers, "finger.tendons.time_constant": 0.02, "plant.fidelity": coarse}
    scene = cg.load("configs/mpc/steady_tip.yaml").changed({**changes, "fidelity": coarse, "estimator": None})
    plants = plants_of((scene,))
    model, tension = plants.model, plants.scenes[0].finger.tendons
    start, bounds = (dict(zip(model.x_names, of, strict=True)) for of in (plants.start[0], state_bounds(plants, 1e3)))
    most = (tension.max_tension - tension.min_tension) / (np.e * 0.02)
    for name in ("tension_1", "tension_2"):
        assert start[f"{name} [N]"] == tension.min_tension
        assert bounds[f"{name} [N]"].tolist() == [tension.min_tension, tension.max_tension]
        assert start[f"{name}_rate [N/s]"] == 0.0
        assert bounds[f"{name}_rate [N/s]"] == pytest.approx([-most, most], rel=1e-12)
