"""Whatever a public function is given instead of what it takes: an `InputError`, never an error from within."""

from __future__ import annotations

import inspect
import math
from collections import abc
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp import grasp, model, rod, simulation
from continuum_grasp.addons import identification, sweeps
from continuum_grasp.base import CheckedArgument, ContinuumGraspError, InputError, check_arguments
from tests.test_docstrings import PUBLIC

WRONG = {
    "None": None,
    "NaN": math.nan,
    "negative": -1,
    "endless": 10**400,
    "infinite": math.inf,
    "text": "x",
    "no text": "",
    "bytes": b"\0",
    "empty": [],
    "ragged": [[1, [2]], 3],
    "mapping": {"a": 1},
    "object": object(),
    "complex": 1j,
    "matrix": np.zeros((2, 3)),
    "array of NaN": np.array([math.nan]),
    "words": np.array(["a"]),
    "another scene": cg.Rod(length=0.2, linear_density=0.03, bending_stiffness=0.006),
}
ROD = WRONG["another scene"]
SCENE = cg.Scene(finger=cg.Finger(rod=ROD), gravity=(0.0, -9.81), fidelity={"family": "arc", "elements": 1})
MODEL = cg.FingerModel(SCENE)
CONFIGS = Path(__file__).parents[1] / "configs"
GRASP, PLAN, MISSION, CONTROL = (
    cg.load(CONFIGS / name)
    for name in ("grasp/mug_arcs.yaml", "plan/tip_to_point.yaml", "mission/mug.yaml", "mpc/steady_tip.yaml")
)
ELASTICA = rod.solve_elastica(SCENE)
TABLE = sweeps.SweepTable(
    Path(), 1, ("a", "b"), {**dict.fromkeys("abc", np.ones(1)), **dict.fromkeys(("status", "reason"), np.array(["x"]))}
)
CALLS = {
    "load": (cg.load, {"path": CONFIGS / "simulate/hanging.yaml", "overrides": ()}),
    "equilibrium": (
        cg.equilibrium,
        {"scene": SCENE, "extra_loads": (), "guess": None, "stable": True, "side": 1, "model": None},
    ),
    "modes": (cg.modes, {"scene": SCENE, "about": None, "points": 5}),
    "equilibrium_path": (simulation.equilibrium_path, {"scene": SCENE, "factors": [1.0], "side": 1}),
    "equilibrium_under": (simulation.equilibrium_under, {"model": MODEL, "u": [0.0], "w": [], "guess": None}),
    "initial_state": (simulation.initial_state, {"scene": SCENE, "model": MODEL}),
    "accuracy_report": (cg.accuracy_report, {"scene": SCENE, "counts": (), "progress": None}),
    "optimize_grasp": (cg.optimize_grasp, {"scene": GRASP, "raise_on_failure": True}),
    "plan": (cg.plan, {"scene": PLAN, "warm": None, "grasp": None, "raise_on_failure": True}),
    "run_mission": (cg.run_mission, {"scene": MISSION, "grasp": None, "progress": None}),
    "run_closed_loop": (cg.run_closed_loop, {"scene": CONTROL, "controller": None, "plant": None, "functions": None}),
    "identify": (cg.identify, {"scene": SCENE, "data": (), "parameters": [], "progress": None}),
    "FingerModel": (cg.FingerModel, {"finger": SCENE, "family": "arc", "elements": 2, "gravity": (0, 0), "loads": ()}),
    "System": (cg.System, {"given": SCENE, "surroundings": None, "object_parameters": ()}),
    "compile": (cg.compile, {"model": MODEL, "functions": ("tip",)}),
    "Controller": (cg.Controller, {"scene": CONTROL, "precision": "double", "deadline": 1.0}),
    "Estimator": (cg.Estimator, {"scene": CONTROL, "precision": "double"}),
    "solve_elastica": (
        rod.solve_elastica,
        {"scene": SCENE, "tolerance": 1e-6, "guess": None, "stable": True, "side": 1, "extra_loads": ()},
    ),
    "natural_frequencies": (rod.natural_frequencies, {"finger": SCENE.finger, "about": ELASTICA, "count": 1}),
    "position": (ELASTICA.position, {"s": 0.1}),
    "certify": (grasp.certify, {"scene": GRASP, "arrays": {}}),
    "Quality": (grasp.Quality, {"scene": GRASP, "arrays": {}}),
    "stumpff": (partial(model.stumpff, 0.1), {"angle_range": 1.0, "accuracy": 1e-9, "top": 4}),
    "map": (TABLE.map, {"x": "a", "y": "b", "color": "c", "reduce": "median"}),
    "front": (TABLE.front, {"x": "a", "y": "b", "x_best": "least", "y_best": "least"}),
    "sweep": (cg.sweep, {"config": {}, "folder": None, "workers": 1, "keep": "none", "progress": None}),
    "TipPath": (identification.TipPath, {"t": [0.0, 1.0], "measured": (identification.Reading("x", [0.0, 1.0]),)}),
    "changed": (SCENE.changed, {"changes": {}}),
    "Scene": (cg.Scene, {"finger": SCENE.finger, "gravity": (0.0, 0.0), "loads": (), "time": None, "contacts": ()}),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("name", "argument"), [(name, key) for name, (_, given) in CALLS.items() for key in given])
def test_what_does_not_fit_is_an_input_error(name, argument):
    function, given = CALLS[name]
    for what, wrong in WRONG.items():
        if wrong is given[argument]:
            continue
        try:
            function(**{**given, argument: wrong})
        except ContinuumGraspError:
            continue
        except Exception as error:
            pytest.fail(f"{name}({argument}={what}) raised {type(error).__name__}: {error}")


def test_every_public_function_checks_its_arguments():
    """Or reads all of them by itself, as these do; pictures are drawn from results alone."""
    own = {"continuum_grasp.load"}
    functions = {
        name: inspect.unwrap(value, stop=lambda one: hasattr(one, "checks_arguments"))
        for name, value in PUBLIC.items()
        if inspect.isfunction(value) and name.split(".")[1] not in ("plotting", "results") and name not in own
    }
    assert len(functions) > 25
    assert [name for name, one in functions.items() if not hasattr(one, "checks_arguments")] == []


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: cg.modes(SCENE, points="x"), "points: expected a whole number, got 'x'"),
        (lambda: cg.equilibrium(SCENE, side=2), "side: expected one of 1, -1, got 2"),
        (lambda: cg.equilibrium(SCENE, stable=None), "stable: expected True or False, got None"),
        (
            lambda: cg.equilibrium(SCENE, extra_loads=[3]),
            "extra_loads: expected a list of ForceLoad or MomentLoad, got [3]",
        ),
        (lambda: cg.equilibrium(5), "scene: expected a Scene or a path, got 5"),
        (lambda: cg.accuracy_report(SCENE, counts=[1.5]), "counts: expected a list of whole numbers, got [1.5]"),
        (lambda: cg.accuracy_report(SCENE, progress=3), "progress: expected a function or None, got 3"),
        (lambda: model.stumpff(0.1, math.nan), "angle_range: expected a number, got nan"),
    ],
)
def test_the_argument_and_what_was_expected_are_named(call, message):
    with pytest.raises(InputError) as caught:
        call()
    assert str(caught.value) == message


def test_what_fits_is_taken():
    load = cg.ForceLoad(at=0.1, force=(0.0, 0.01))
    bent = cg.equilibrium(SCENE, extra_loads=[load], guess=np.array([0.1]), stable=np.bool_(True), side=np.int64(-1))
    assert bent.stable
    np.testing.assert_allclose(bent.q, cg.equilibrium(SCENE.changed({"loads": [load]})).q, atol=1e-9)


def test_wrong_signatures_are_still_those_of_python():
    with pytest.raises(TypeError, match="unexpected keyword argument 'sides'"):
        cg.equilibrium(SCENE, sides=1)


def test_arguments_are_checked_without_being_used_up():
    @check_arguments
    def total(values: list[int], names: abc.Iterable[str]) -> int:
        return sum(values) + len(list(names))

    assert total([1, 2], (name for name in "ab")) == 5


@pytest.mark.parametrize(("value", "taken"), [(5e-324, True), (0.0, False), (-5e-324, False), (1.7e308, True)])
def test_what_is_above_zero_begins_right_above_it(value, taken):
    if taken:
        assert CheckedArgument("step", value).number() == value
    else:
        with pytest.raises(InputError, match="above 0"):
            CheckedArgument("step", value).number()


@pytest.mark.parametrize("sign", [1, -1])
def test_whole_numbers_beyond_the_doubles_keep_their_sign(sign):
    assert CheckedArgument("speed", sign * 10**400).number(-math.inf, math.inf) == sign * math.inf
