"""Random scenes, right and wrong: the loader gives a scene or says what is wrong, and the model keeps to mechanics."""

from __future__ import annotations

import copy
import math
import string
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.core import Core
from continuum_grasp.scene import Scene

STEADY = {
    "derandomize": True,
    "deadline": None,
    "database": None,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
}
"""The same examples in every run, on however busy a machine."""


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_subnormal=False).map(lambda v: round(v, 9))


@st.composite
def rods(draw):
    """A rod by its section or by its line."""
    length = draw(number(0.05, 2.0))
    if draw(st.booleans()):
        diameter = round(length * draw(number(1e-3, 0.02)), 9)
        return {
            "length": length,
            "diameter": diameter,
            "density": draw(number(500.0, 2e4)),
            "youngs_modulus": draw(number(1e6, 2e11)),
        }
    rod = {"length": length, "linear_density": draw(number(0.01, 1.0)), "bending_stiffness": draw(number(0.01, 10.0))}
    return rod | draw(st.sampled_from([{}, {"rotary_inertia": 0.0}, {"rotary_inertia": 1e-5}]))


@st.composite
def loads(draw, length: float, constant: bool = False):
    """A force or a moment, dead or following, constant or sampled."""
    at = length if draw(st.booleans()) else round(length * draw(number(0.0, 1.0)), 9)
    vector, scalar = st.lists(number(-5.0, 5.0), min_size=2, max_size=2), number(-0.5, 0.5)
    kind = draw(st.sampled_from(["force", "moment"]))
    value = vector if kind == "force" else scalar
    given_value = draw(value)
    if not constant and draw(st.booleans()):
        given_value = {"times": [0.0, 0.1, 0.5], "values": draw(st.lists(value, min_size=3, max_size=3))}
    load = {"kind": kind, "at": min(at, length), kind: given_value}
    return load | ({"follows": draw(st.booleans())} if kind == "force" else {})


@st.composite
def fingers(draw):
    """A finger with any of its features."""
    rod = draw(rods())
    length = rod["length"]
    inside = number(0.1, 0.9).map(lambda share: round(share * length, 9))
    finger = {"rod": rod}
    if draw(st.booleans()):
        finger["damping"] = {"material": draw(number(0.0, 0.01)), "per_arc": draw(number(0.0, 0.01))}
    if draw(st.booleans()):
        places = st.one_of(inside, st.just(length))
        mass = st.fixed_dictionaries({"at": places, "mass": number(0.0, 0.5)})
        finger["masses"] = draw(st.lists(mass, max_size=3))
    curvature = number(-2.0, 2.0)
    breaks = sorted(draw(st.lists(inside, max_size=2, unique=True)))
    if breaks:
        values = draw(st.lists(curvature, min_size=len(breaks) + 1, max_size=len(breaks) + 1))
        finger["rest_curvature"] = {"breaks": breaks, "values": values}
    elif draw(st.booleans()):
        finger["rest_curvature"] = draw(curvature)
    if draw(st.booleans()):
        finger["tendons"] = {
            "offset": round(0.02 * length, 9),
            "max_tension": 20.0,
            "friction": draw(st.sampled_from([0.0, 0.0, 0.3])),
        } | draw(st.sampled_from([{}, {"time_constant": 0.02}]))
    if draw(st.booleans()):
        finger["base"] = {"position": draw(st.lists(number(-1.0, 1.0), min_size=2, max_size=2))}
        finger["base"]["angle"] = draw(number(-math.pi, math.pi))
    return finger


@st.composite
def scenes(draw):
    """A scene as plain data, right in every key."""
    finger = draw(fingers())
    length, tendons = finger["rod"]["length"], finger.get("tendons")
    data = {
        "schema_version": 1,
        "finger": finger,
        "gravity": draw(st.sampled_from([[0.0, 0.0], [0.0, -9.81], [3.0, -9.0]])),
        "loads": draw(st.lists(loads(length), max_size=3)),
    }
    if draw(st.booleans()):
        data["contacts"] = [round(0.4 * length, 9)]
    families = [None, "arc", "clothoid"] + ([] if tendons and tendons["friction"] else ["matched_clothoid"])
    data["fidelity"] = {"family": draw(st.sampled_from(families)), "elements": draw(st.sampled_from([None, 2, 3]))}
    signal = {"times": [0.0, 0.2], "values": [0.0, 1.0], "interpolation": "smooth"}
    if tendons is not None and draw(st.booleans()):
        data["actuation"] = {"tensions": [draw(st.one_of(number(0.0, 20.0), st.just(signal))), draw(number(0.0, 20.0))]}
    elif tendons is None and draw(st.booleans()):
        data["actuation"] = {"tip_moment": draw(st.one_of(number(-0.1, 0.1), st.just(signal)))}
    if draw(st.booleans()):
        data["time"] = {"duration": 0.1, "step": 0.001}
    if draw(st.booleans()):
        data["initial"] = {"pose": "equilibrium", "held_by": draw(st.lists(loads(length, constant=True), max_size=1))}
    return data


# The loader.


def loaded(text: str):
    """What the loader makes of a file: a scene, or the error; anything else gets out."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / "scene.yaml"
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        try:
            return cg.load(path)
        except InputError as error:
            return error


@pytest.mark.deep
@settings(max_examples=60, **STEADY)
@given(scenes())
def test_right_scenes_load_and_come_back(data):
    found = loaded(yaml.safe_dump(data))
    assert isinstance(found, Scene), found
    assert loaded(yaml.safe_dump(found.model_dump(mode="json"))) == found
    assert Scene(**copy.deepcopy(data)) == found


WRONG = [
    *(math.nan, math.inf, -math.inf, -1.0, 0, 0.0, 1e300, -1e300, 1e-300, 10**400, True, None, "", "1e3", "1,5", "nan"),
    *("0.6 m", [], [1.0], [[]], [None, {}], {}, {"a": 1}, {"times": [0.0]}, {"kind": "force"}, {1: 2}, "\u0000", "é"),
]


def paths(value, path=()) -> list[tuple]:
    """Paths of everything in plain data."""
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(deeper for key, child in children for deeper in paths(child, (*path, key)))]


@st.composite
def spoilt_scenes(draw):
    """A right scene with up to three entries changed."""
    data = copy.deepcopy(draw(scenes()))
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from(paths(data)))
        how = draw(st.sampled_from(["replace", "replace", "remove", "rename", "add"]))
        new = copy.deepcopy(draw(st.sampled_from(WRONG)))
        if not path:
            data = new if how == "replace" and draw(st.booleans()) else data
            continue
        parent = data
        for key in path[:-1]:
            parent = parent[key]
        if how == "replace":
            parent[path[-1]] = new
        elif how == "remove":
            del parent[path[-1]]
        elif isinstance(parent, dict):
            word = str(path[-1])[:-1] + draw(st.sampled_from(["", "x", "s_", "."]))
            parent[word] = parent.pop(path[-1]) if how == "rename" else new
        else:
            parent.append(new)
        if not isinstance(data, (dict, list)):
            break
    return data


@pytest.mark.deep
@settings(max_examples=300, **STEADY)
@given(spoilt_scenes())
def test_spoilt_scenes_load_or_say_why(data):
    found = loaded(yaml.dump(data, allow_unicode=True))
    assert type(found).__name__ in ("Scene", "GraspScene", "Finger", "InputError")
    if isinstance(found, InputError):
        assert str(found)
        assert found.file
    elif isinstance(found, Scene):
        assert loaded(yaml.safe_dump(found.model_dump(mode="json"))) == found


@pytest.mark.deep
@settings(max_examples=200, **STEADY)
@given(scenes(), st.data())
def test_noise_in_a_file_is_explained(data, drawn):
    """Characters put in, taken out or doubled, at places anywhere in the text."""
    text = yaml.safe_dump(data)
    for _ in range(drawn.draw(st.integers(1, 3))):
        at, many = drawn.draw(st.integers(0, len(text))), drawn.draw(st.integers(1, 9))
        how = drawn.draw(st.sampled_from(["in", "out", "twice"]))
        noise = "" if how == "out" else text[at : at + many]
        if how == "in":
            noise = drawn.draw(st.text(string.printable + "&*!|>%@`\u2028\ufeffé\ud800", min_size=1, max_size=6))
        text = text[:at] + noise + (text[at:] if how != "out" else text[at + many :])
    assert type(loaded(text)).__name__ in ("Scene", "GraspScene", "Finger", "InputError")


# The model.


def core_of(model) -> Core:
    return Core(model, compiled=False)


@st.composite
def moving(draw):
    """A model of a right scene, and a state and input that it may be in."""
    data = draw(scenes())
    data["initial"] = {"pose": "straight"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = cg.FingerModel(Scene(**data))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    scale = 1.0 if model.family == "arc" else 1.0 / max(model.lengths)
    q, qd = (scale * rng.uniform(-0.6, 0.6, model.n) for _ in range(2))
    drive = 0.1 * rng.uniform(-1.0, 1.0, model.nx - 2 * model.n) * model.finger.rod.stiffness
    # Tip moments that bend by a quarter at the most, three of them together: a matched tip bends with them.
    moment = 0.25 * model.finger.rod.stiffness / model.finger.rod.length
    tendons = model.finger.tendons
    per_entry = [moment / tendons.offset if tendons and "tension" in name else moment for name in model.u_names]
    u = rng.uniform(0.0, 1.0, model.nu) * per_entry
    assume(core_of(model).range_use(q, u).max() <= 1.0)
    return model, q, qd, np.concatenate([q, qd, drive]), u, rng.uniform(-1.0, 1.0, model.nw)


@pytest.mark.deep
@settings(max_examples=60, **STEADY)
@given(moving())
def test_energy_changes_by_the_power_of_what_has_no_potential(case):
    """d/dt (T + V) = qd . (actuation + external forces - damping), by a central difference along the motion.

    The tip of a matched finger is held still, since its curvature takes up power of its own when the input varies.
    """
    model, q, qd, x, u, w = case
    core, u = core_of(model), u.copy()
    if model.structure.inputs.rates:
        u[model.structure.inputs.count :] = 0.0
    friction, history = len(model.friction_names), ()
    if friction:
        # Which way it acts, by the cubic of theory.md; of a motion's states, which move no energy themselves.
        y = np.clip(x[-friction:], -1.0, 1.0)
        history = model.p_nominal, np.append(1.5 * y - 0.5 * y**3, 0.0)
    if model.structure.lagged:
        # What lags equals what is commanded, so that it stays: a moment, or with friction each tension.
        lag = (u[0], 0.0, u[1], 0.0) if friction else ((u[0] - u[1]) * model.finger.tendons.offset, 0.0)
        x[2 * model.n : model.nx - friction] = lag
    power = qd @ (core.actuation(q, u, *history) + core.external_force(q, u, w) - core.damping(q, qd, u))
    xd = core.forward_dynamics(x, u, w)

    def energy(step: float) -> tuple[float, float]:
        kinetic, potential = core.energy(x + step * xd, u)
        return float(kinetic[0]), float(potential[0])

    def change(step: float) -> float:
        before, after = energy(-step), energy(step)
        return (sum(after) - sum(before)) / (2.0 * step)

    # As far as rates and shape change by little; the parts whose changes cancel set the rounding.
    step = 1e-3 * min(1.0, float(np.abs(qd).max() / max(np.abs(xd[model.n : 2 * model.n]).max(), 1e-300)))
    rate = (4.0 * change(step / 2) - change(step)) / 3.0
    parts = abs(qd @ core.elastic(q, u)) + abs(qd @ core.gravity(q, u)) + abs(power) + np.abs(energy(0.0)).max()
    flow = abs(xd[model.n : 2 * model.n] @ core.mass_matrix(q, u) @ qd)
    rounding = 1e-14 * np.abs(energy(0.0)).sum() / step
    assert rate == pytest.approx(power, abs=1e-6 * (parts + flow) + rounding)
