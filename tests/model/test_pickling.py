"""What the public functions give goes to a worker and back: another process, and deep copies, show the same numbers."""

from __future__ import annotations

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
from grasp_scenes import CONFIGS, make_scene
from identification_cases import bare_scene, frequency, rung
from plan_cases import two_arcs

import continuum_grasp as cg
from continuum_grasp.closed_loop import Plant
from continuum_grasp.core import Compiler, Core
from continuum_grasp.scene import load
from tests import control_cases
from tests.marks import few

ARCS = {"fidelity.family": "arc", "fidelity.elements": 2}
SWING = load(CONFIGS.parent / "simulate" / "swing_against_disc.yaml", {"time.duration": 0.01, **ARCS})
PLANT = {"fidelity": {"family": "arc", "elements": 2}, "noise": 1.0}
RELEASE = load(CONFIGS.parent / "simulate" / "nitinol_release_020g.yaml", {"time.duration": 0.05})


def trajectory():
    motion = cg.simulate(SWING)
    assert motion.tip.size
    assert motion.contacts is not None  # computed once, with compiled code that does not travel
    return motion


def grasp():
    return cg.optimize_grasp(make_scene("arc"))


def controller():
    """One that is not at its start, with other settings."""
    made = cg.Controller(control_cases.sensed_rod_scene(), deadline=float("inf"))
    made.change(u_max=[0.2], weights=2.0 * made.stages.weights)
    made.step(np.zeros(len(made.measurement_names)))
    return made


def estimator():
    made = cg.Estimator(control_cases.sensed_rod_scene(), precision="float")
    made.step(np.full(len(made.measurement_names), 0.1), [0.05])
    return made


def plant():
    made = Plant(control_cases.sensed_rod_scene(plant=PLANT))
    made.advance([0.1])
    return made


def error():
    return cg.SolverError("no grasp", status="infeasible", violated=("force: 2 N",), advice="Use two.", result={"n": 1})


MAKERS = {
    "model": lambda: cg.FingerModel(RELEASE, parameters=["tip_mass"]),
    "system": lambda: cg.System(SWING),
    "core": lambda: cg.compile(cg.System(SWING), ["forward_dynamics"]),
    "trajectory": trajectory,
    "equilibrium": lambda: cg.equilibrium(RELEASE),
    "modes": lambda: cg.modes(RELEASE),
    "choice": lambda: cg.choose_fidelity(bare_scene(), 0.1),
    "grasp": grasp,
    "plan": lambda: cg.plan(two_arcs()),
    "controller": controller,
    "command": lambda: controller().step(None),
    "estimator": estimator,
    "filtered": lambda: estimator().step(None, [0.0]),
    "closed loop": lambda: cg.run_closed_loop(control_cases.sensed_rod_scene(duration=0.05, plant=PLANT)),
    "plant": plant,
    "fit": lambda: cg.identify(bare_scene(2), rung(frequency(1), frequency(2)), parameters=["bending_stiffness"]),
    "error": error,
}


def shown(made):
    """All numbers and texts that an object shows, bit by bit, and what it does next."""
    found = {}
    for name in dir(made):
        value = None if name.startswith("_") or name in ("args", "times", "statistics") else getattr(made, name)
        if isinstance(value, np.ndarray) and value.dtype != object:
            found[name] = (value.shape, value.tobytes())
        elif isinstance(value, (str, int, float, tuple, list)):
            found[name] = repr(value)
    if isinstance(made, Core):
        x = np.linspace(0.05, 0.1, made.model.nx)
        found["next"] = [made.forward_dynamics(x).tobytes(), made.rollout(x, 5, 1e-4).tobytes()]
    elif isinstance(made, cg.Controller):
        found["next"] = made.step(np.zeros(len(made.measurement_names))).u.tobytes()
    elif isinstance(made, cg.Estimator):
        found["next"] = made.step(np.full(len(made.measurement_names), 0.1), [0.05]).z.tobytes()
    elif isinstance(made, Plant):
        found["next"] = [made.measure().tobytes(), made.advance([0.2]).tobytes()]
    return found


def start():
    """A worker that finds compiled code, but must not compile any."""

    def build(*_):
        raise AssertionError("compiled anew")

    Compiler.build = build


def unpickled(data):
    return pickle.dumps(pickle.loads(data)), shown(pickle.loads(data))


@pytest.fixture(scope="module")
def worker():
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, start) as pool:
        yield pool


@pytest.mark.parametrize("name", few(MAKERS, 5))
def test_a_fresh_process_and_a_copy_show_the_same(worker, name):
    made = MAKERS[name]()
    data, copied = pickle.dumps(made), copy.deepcopy(made)
    sent = [shown(pickle.loads(pickle.dumps(made)))]  # compiles what the worker is to find
    back, there = worker.submit(unpickled, data).result()
    here = shown(made)
    assert here
    for other in (*sent, there, shown(copied), shown(pickle.loads(back))):
        assert other.keys() == here.keys()
        assert [key for key in here if other[key] != here[key]] == []


def test_a_copy_of_a_controller_is_an_object_of_its_own():
    first = controller()
    before, second = first.save_state(), copy.copy(first)
    second.step(np.ones(len(first.measurement_names)))
    assert first.save_state() == before
    assert second.save_state() != before


def test_a_controller_from_a_file_does_not_read_it_again(tmp_path):
    file = tmp_path / "loop.yaml"
    file.write_text(control_cases.sensed_rod_scene().model_dump_json())
    made = cg.Controller(file)
    data = pickle.dumps(made)
    file.unlink()
    assert pickle.loads(data).scene == made.scene


def test_arguments_that_the_caller_changes_later_do_not_count():
    places = [0.3]
    model = cg.FingerModel(RELEASE.finger, contacts=places)
    places[0] = 0.1
    assert copy.deepcopy(model).contacts == model.contacts == (0.3,)


def test_a_worker_can_raise_any_error_of_the_package(worker):
    with pytest.raises(cg.SolverError, match="no grasp") as caught:
        worker.submit(raise_it).result()
    assert caught.value.status == "infeasible"
    assert caught.value.result == {"n": 1}


def raise_it():
    raise error()
