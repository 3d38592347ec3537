"""What must hold for any finger, beside `test_model_truth`: mirror images, cost, names and errors."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Damping, Fidelity, Finger, ForceLoad, Initial, PointMass, Scene, Tendons
from continuum_grasp.scene import Rod as RodValue
from tests.finger_cases import (
    FAMILIES,
    FULL,
    LOADS,
    ROD,
    Case,
    evaluate,
    relative_error,
    state,
)
from tests.marks import few
from tests.truth import Rod, ctx, matched_tip, to_numpy

UNIT = Finger(rod=RodValue(length=1.0, linear_density=1.0, bending_stiffness=1.0))


# Mechanics.


@pytest.mark.parametrize("family", FAMILIES)
def test_the_equation_of_motion_is_the_sum_of_its_terms(family):
    model = Case(loads=LOADS, contacts=(0.1,)).model(family, 3)
    at, qdd = state(model, 1.3, seed=3), np.arange(1.0, model.n + 1)
    terms = evaluate(model.mass_matrix, at.q, at.u, []) @ qdd
    terms += evaluate(model.bias, at.q, at.qd, at.u, []) + evaluate(model.gravity, at.q, at.u, [])
    terms += evaluate(model.elastic, at.q, at.u, []) + evaluate(model.damping, at.q, at.qd, at.u, [])
    terms -= evaluate(model.actuation, at.q, at.u, []) + evaluate(model.external_force, at.q, at.u, at.w, [])
    assert relative_error(evaluate(model.inverse_dynamics, at.q, at.qd, qdd, at.u, at.w, []), terms) <= 1e-12


# Smoothness, and what the code is made of.


@pytest.mark.parametrize("family", FAMILIES)
def test_derivatives_are_smooth_through_zero(family):
    """First and second derivatives of the acceleration on a line of straight shapes, by the reference's differences."""
    case = Case(loads=LOADS).with_finger(rest_curvature=0.0)
    model = case.model(family, accuracy=None if family == "arc" else 1e-13)
    at = state(model, 1.0)
    line, h = ca.SX.sym("t"), ctx.mpf(10) ** -12
    way = at.q
    acceleration = model.forward_dynamics(ca.vertcat(line * way, at.qd), at.u, at.w, [])[model.n :]
    first = ca.jacobian(acceleration, line)
    values = ca.Function("d", [line], [ca.horzcat(acceleration, first, ca.jacobian(first, line))])
    finger = case.reference(model)
    tip = matched_tip(finger, *case.drive(model, at.u))

    def true(t):
        rod = Rod(finger, [t * ctx.mpf(v) for v in way], at.qd, tip, 24)
        forces, moments = case.forces(model, rod, at.w)
        return rod.acceleration(forces, case.drive(model, at.u)[0], moments)

    below, here, above = true(-h), true(0), true(h)
    expected = [here, (above - below) / (2 * h), (above - 2 * here + below) / h**2]
    found = np.array(values(0.0))
    for k, value in enumerate(expected):
        assert relative_error(found[:, k], to_numpy(value)) <= 1e-10, k
    assert np.isfinite(np.array(values(1e-300))).all()


ARITHMETIC = {ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_NEG, ca.OP_SQ, ca.OP_TWICE, ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT}
DIVISIONS = {ca.OP_DIV, ca.OP_INV}


@pytest.mark.parametrize("elements", [1, 2, 3, 5])
@pytest.mark.parametrize("family", FAMILIES)
def test_dynamics_are_arithmetic_only(family, elements):
    """No call, no branch, and no division but those of the factorization of the mass matrix."""
    function = Case(loads=LOADS).model(family, elements).forward_dynamics
    operations = [function.instruction_id(k) for k in range(function.n_instructions())]
    divisions = sum(op in DIVISIONS for op in operations)
    assert {op for op in operations if op not in DIVISIONS} <= ARITHMETIC
    n = function.size1_in(0) // 2
    assert divisions == n * (n + 1) // 2


def count(finger: Finger, family: str = "arc", **options) -> int:
    options = {"gravity": (0.5, -9.81), "contacts": (0.3,), "tip_force": True} | options
    return FingerModel(finger, family=family, elements=2, **options).forward_dynamics.n_instructions()


EVERYTHING = Finger(
    rod=ROD,
    damping=Damping(material=0.01, per_arc=0.02),
    rest_curvature=0.7,
    masses=(PointMass(at=0.6, mass=0.2), PointMass(at=0.5, mass=0.1)),
    tendons=Tendons(offset=0.01, max_tension=10.0),
)
DROPPED = {
    "tip mass": ({"masses": EVERYTHING.masses[1:]}, {}),
    "interior mass": ({"masses": EVERYTHING.masses[:1]}, {}),
    "gravity": ({}, {"gravity": (0.0, 0.0)}),
    "contact": ({}, {"contacts": ()}),
    "tip force": ({}, {"tip_force": False}),
    "damping": ({"damping": Damping()}, {}),
    "damping per arc": ({"damping": Damping(material=0.01)}, {}),
    "rest curvature": ({"rest_curvature": 0.0}, {}),
    "rotary inertia": ({"rod": ROD.model_copy(update={"rotary_inertia": 0.0})}, {}),
    "a load": ({}, {"loads": ()}),
}
# Constants that only change other constants cost nothing to begin with.
FREE = {
    "arc": {"damping per arc"},
    "clothoid": {"damping per arc", "tip mass", "rotary inertia"},
    "matched_clothoid": {"damping per arc", "tip mass", "rotary inertia"},
}


@pytest.mark.parametrize("name", DROPPED)
@pytest.mark.parametrize("family", FAMILIES)
def test_what_is_not_needed_is_not_in_the_code(family, name):
    finger, options = DROPPED[name]
    everything = {"loads": LOADS[:1]}
    before = count(EVERYTHING, family, **everything)
    after = count(EVERYTHING.model_copy(update=finger), family, **(everything | options))
    assert after < before or (name in FREE[family] and after == before)


def test_zeros_leave_no_trace():
    """Written out as zero or not written: the same code."""
    zeros = Finger(
        rod=ROD, masses=(PointMass(at=0.6, mass=0.0), PointMass(at=0.2, mass=0.0)), damping=Damping(material=0.0)
    )
    for family in FAMILIES:
        assert count(zeros, family) == count(Finger(rod=ROD), family)


def test_instruction_counts_of_two_arcs():
    """The bounds that speed rests on: everything in, and a bare finger; constants folded."""
    rod = RodValue(length=0.6, linear_density=0.02, bending_stiffness=0.05)
    tendons = Tendons(offset=0.01, max_tension=10.0)
    finger = Finger(rod=rod, damping=Damping(material=1e-4), masses=(PointMass(at=0.6, mass=0.02),), tendons=tendons)
    assert count(finger, gravity=(0.0, -9.81)) <= 650
    thick = finger.model_copy(update={"rod": rod.model_copy(update={"rotary_inertia": 1e-6}), "rest_curvature": 0.3})
    assert count(thick, gravity=(0.5, -9.81)) <= 650
    assert count(Finger(rod=rod), gravity=(0.0, 0.0), contacts=(), tip_force=False) <= 380


# Parameters and names.


def with_value(name: str, value: float, finger: Finger) -> Finger:
    """The finger with another value of a scalar parameter."""
    rod = {
        "linear_density": "linear_density",
        "bending_stiffness": "bending_stiffness",
        "rotary_inertia": "rotary_inertia",
    }
    if name in rod:
        return finger.model_copy(update={"rod": finger.rod.model_copy(update={name: value})})
    if name in ("material_damping", "per_arc_damping"):
        key = {"material_damping": "material", "per_arc_damping": "per_arc"}[name]
        return finger.model_copy(update={"damping": finger.damping.model_copy(update={key: value})})
    if name in ("tendon_offset", "tendon_friction"):
        return finger.model_copy(update={"tendons": finger.tendons.model_copy(update={name[7:]: value})})
    if name == "rest_curvature":
        return finger.model_copy(update={"rest_curvature": value})
    index = {"tip_mass": 0, "mass_1": 1}[name]
    masses = [m.model_copy(update={"mass": value}) if k == index else m for k, m in enumerate(finger.masses)]
    return finger.model_copy(update={"masses": tuple(masses)})


SCALARS = {
    "linear_density": 0.9,
    "bending_stiffness": 0.4,
    "rotary_inertia": 2e-3,
    "material_damping": 0.03,
    "per_arc_damping": 0.07,
    "rest_curvature": -1.1,
    "tendon_offset": 0.02,
    "tendon_friction": 0.2,
    "tip_mass": 0.5,
    "mass_1": 0.4,
}
NAMES = [*SCALARS, "gravity", "element_lengths"]


def same_everywhere(runtime: FingerModel, folded: FingerModel, p: list) -> None:
    at = state(folded, 0.9)
    arguments = {"x": at.x, "q": at.q, "qd": at.qd, "qdd": at.qd, "u": at.u, "w": at.w, "s": 0.41}
    slow = () if folded.family == "arc" else ("jacobian_rate", "linearization")
    states = len(runtime.friction_names)
    if states:  # where friction is a run-time argument alone, what does not have it has no states of it
        friction = [0.7, -1.2, 0.3, 1.1][:states]
        arguments |= {"x": [*at.x, *friction], "history": [*friction, 0.0]}
    for name in (n for n in FingerModel.function_names() if n not in slow):
        one, other = getattr(runtime, name), getattr(folded, name)
        found = one.call([{**arguments, "p": p}[key] for key in one.name_in()])
        known = {**arguments, "p": [], "x": at.x if len(folded.friction_names) < states else arguments["x"]}
        expect = other.call([known[key] for key in other.name_in()])
        for value, expected in zip(map(np.array, found), map(np.array, expect), strict=True):
            rows, columns = expected.shape
            assert relative_error(value[:rows, :columns], expected) <= 1e-11, name


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("family", few(sorted(FAMILIES, reverse=True), 1))
def test_a_parameter_at_run_time_is_the_folded_one(family, name):
    if family == "matched_clothoid" and name == "tendon_friction":
        pytest.skip("matched clothoids have no tendon friction")
    options = {"family": family, "contacts": (0.25,), "bending_range": 2.0, "loads": LOADS[:4]}
    lengths, gravity, finger = [0.25, 0.35], [1.0, -9.0], EVERYTHING
    if name == "element_lengths":
        finger = finger.model_copy(update={"masses": finger.masses[:1]})
        options["loads"] = LOADS[2:3]
    runtime = FingerModel(finger, parameters=(name,), elements=lengths, gravity=gravity, **options)
    assert len(runtime.p_names) == len(runtime.p_nominal) == runtime.np
    same_everywhere(runtime, FingerModel(finger, elements=lengths, gravity=gravity, **options), runtime.p_nominal)
    if name == "element_lengths":
        lengths = [0.2, 0.4]
        options["contacts"], value = (0.2,), lengths
    elif name == "gravity":
        gravity = value = [-3.0, 4.0]
    else:
        finger, value = with_value(name, SCALARS[name], finger), [SCALARS[name]]
    same_everywhere(runtime, FingerModel(finger, elements=lengths, gravity=gravity, **options), value)


@pytest.mark.parametrize("family", FAMILIES)
def test_all_parameters_at_once(family):
    names = tuple(n for n in NAMES if not (family == "matched_clothoid" and n == "tendon_friction"))
    runtime = FingerModel(EVERYTHING, family=family, elements=2, parameters=names)
    assert runtime.p_nominal == [
        v
        for n in names
        for v in {"gravity": [0.0, -9.81], "element_lengths": [0.3, 0.3]}.get(
            n, [dict(zip(SCALARS, (0.8, 0.5, 3e-4, 0.01, 0.02, 0.7, 0.01, 0.0, 0.2, 0.1), strict=True)).get(n)]
        )
    ]
    same_everywhere(runtime, FingerModel(EVERYTHING, family=family, elements=2), runtime.p_nominal)


MAKES = [
    (Finger(rod=ROD), {}),
    (EVERYTHING, {"contacts": (0.2, 0.4), "elements": 4}),
    (FULL, {"loads": LOADS, "contacts": (0.3,), "tip_force": False}),
    (EVERYTHING.model_copy(update={"tendons": Tendons(offset=0.01, max_tension=9.0, time_constant=0.02)}), {}),
    (EVERYTHING, {"loads": LOADS, "parameters": ("gravity", "element_lengths", "tip_mass")}),
]


@pytest.mark.parametrize("family", few(sorted(FAMILIES, reverse=True), 1))
@pytest.mark.parametrize("make", range(len(MAKES)))
def test_names_fit_sizes(family, make):
    finger, options = MAKES[make]
    model = FingerModel(finger, family=family, **options)
    function = model.forward_dynamics
    names = {"x": model.x_names, "u": model.u_names, "w": model.w_names, "p": model.p_names}
    for key, labels in names.items():
        assert len(labels) == function.size1_in(key) == getattr(model, f"n{key}")
        assert len(set(labels)) == len(labels)
        assert all(label.endswith("]") and " [" in label for label in labels)
    assert model.x_names[: model.n] == model.q_names
    assert model.n == len(model.lengths) + (family == "clothoid")
    assert model.nx == 2 * model.n + 2 * (finger.tendons is not None and finger.tendons.time_constant is not None)
    for name in FingerModel.function_names():
        assert getattr(model, name).name() == name
        assert getattr(model, name).is_a("SXFunction")


def test_names_of_a_full_model():
    model = FingerModel(FULL, family="matched_clothoid", loads=LOADS, contacts=(0.3,), input_rates=True)
    assert model.u_names == [
        "tip_moment [N m]",
        "tip_couple_1 [N m]",
        "tip_moment_rate [N m/s]",
        "tip_couple_1_rate [N m/s]",
        "tip_moment_acceleration [N m/s2]",
        "tip_couple_1_acceleration [N m/s2]",
    ]
    assert model.w_names[:4] == ["contact_1_x [N]", "contact_1_y [N]", "tip_x [N]", "tip_y [N]"]
    assert model.w_names[6:8] == ["load_2_across [N]", "load_2_along [N]"]
    assert model.x_names[0] == "kappa_0 above rest [1/m]"
    assert model.load_entries == [("w", 4), ("w", 6), ("w", 8), ("w", 10), ("u", 1)]


def test_defaults():
    model = FingerModel(UNIT)
    assert (model.family, model.lengths, model.nw) == ("clothoid", (0.5, 0.5), 2)
    assert model.ranges == pytest.approx((2 * math.pi / 3,) * 2)
    assert FingerModel(UNIT, contacts=(0.2, 0.7)).lengths == pytest.approx((0.2, 0.5, 0.3))
    assert FingerModel(UNIT, contacts=(0.2,), elements=3).lengths == pytest.approx((0.2, 0.4, 0.4))
    sticky = UNIT.model_copy(update={"tendons": Tendons(offset=0.01, max_tension=1.0, friction=0.1)})
    assert FingerModel(sticky).family == "clothoid"
    assert FingerModel(UNIT, input_rates=False).family == "matched_clothoid"
    bent = FingerModel(UNIT, family="matched_clothoid")
    assert float(bent.gravity([0.0, 0.0], [1.0], [])[0]) < 0.0  # it falls the way it is bent


def test_a_scene_supplies_and_keywords_override():
    scene = Scene(
        finger=FULL,
        gravity=(1.0, 2.0),
        contacts=(0.3,),
        fidelity={"family": "arc", "elements": 3, "bending_range": 1.5},
        parameters=("gravity",),
        loads=LOADS[:1],
    )
    model = FingerModel(scene)
    assert (model.family, len(model.lengths), model.ranges[0]) == ("arc", 3, 1.5)
    assert (model.p_nominal, model.nw) == ([1.0, 2.0], 2 + 2 + 2)
    other = FingerModel(scene, family="clothoid", contacts=(), elements=1, loads=(), parameters=(), tip_force=False)
    assert (other.family, other.n, other.nw, other.np) == ("clothoid", 2, 0, 0)


WITH_FRICTION = EVERYTHING.model_copy(update={"tendons": Tendons(offset=0.01, max_tension=9.0, friction=0.1)})
LAGGED = EVERYTHING.model_copy(update={"tendons": Tendons(offset=0.01, max_tension=9.0, time_constant=0.1)})
WRONG = {
    "unknown parameter": (FULL, {"parameters": ("tip_mas",)}, "unknown parameter 'tip_mas'; did you mean 'tip_mass'"),
    "parameter of no use here": (FULL, {"parameters": ("tendon_offset",)}, "unknown parameter 'tendon_offset'"),
    "piecewise rest at run time": (FULL, {"parameters": ("rest_curvature",)}, "unknown parameter 'rest_curvature'"),
    "contact at the tip": (FULL, {"contacts": (0.6,)}, r"between 0 and the length 0.6 m, got \[0.6\]"),
    "contact at the base": (FULL, {"contacts": (0.0,)}, "between 0 and the length"),
    "contacts out of order": (FULL, {"contacts": (0.4, 0.2)}, "contacts must increase"),
    "too few elements": (FULL, {"contacts": (0.2, 0.4), "elements": 2}, "2 contacts need at least 3 elements, got 2"),
    "lengths that do not add up": (FULL, {"elements": (0.2, 0.3)}, "add up to 0.6 m"),
    "a negative length": (FULL, {"elements": (0.8, -0.2)}, "must be positive"),
    "contact off a boundary": (
        FULL,
        {"elements": (0.3, 0.3), "contacts": (0.2,)},
        "contact at 0.2 m is not on an element",
    ),
    "unknown family": (
        FULL,
        {"family": "spline"},
        "family: expected one of arc, clothoid, matched_clothoid, got 'spline'",
    ),
    "matched with friction": (WITH_FRICTION, {"family": "matched_clothoid"}, "cannot carry tendon friction"),
    "matched with a lag of first order": (
        EVERYTHING.model_copy(
            update={"tendons": Tendons(offset=0.01, max_tension=9.0, time_constant=0.1, drive_order=1)}
        ),
        {"family": "matched_clothoid"},
        "cannot carry tensions that follow by a first-order lag .*: use clothoid or arc",
    ),
    "rates for arcs": (FULL, {"family": "arc", "input_rates": True}, "needs family matched_clothoid"),
    "rates and lag": (LAGGED, {"family": "matched_clothoid", "input_rates": True}, "exclude each other"),
    "load beyond": (
        FULL,
        {"loads": (ForceLoad(at=0.61, force=(0.0, 0.0)),)},
        r"loads\[0\].at: 0.61 m is beyond the finger",
    ),
    "no lengths": (FULL, {"elements": ()}, "add up"),
    "very many elements": (FULL, {"elements": 10**9}, "elements: expected a number of elements from 1 to 128"),
    "very many lengths": (FULL, {"elements": [0.6 / 129] * 129}, "elements: expected the lengths of up to 128"),
    "a length next to nothing": (FULL, {"elements": [0.6, 1e-300]}, "elements: element lengths must be positive"),
    "contact next to the base": (FULL, {"contacts": [1e-300]}, "contacts: contacts must be 1e-06 of the length"),
    "accuracy next to nothing": (FULL, {"accuracy": 1e-300}, "accuracy: expected a number from 1e-16 to 0.01"),
    "range in degrees": (FULL, {"family": "arc", "bending_range": 120}, "bending_range: expected .* up to 40, got 120"),
    "range zero": (FULL, {"bending_range": 0.0}, "bending_range"),
    "range NaN": (FULL, {"bending_range": math.nan}, "bending_range"),
    "accuracy zero": (FULL, {"accuracy": 0.0}, "accuracy"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input_is_explained(name):
    finger, options, message = WRONG[name]
    with pytest.raises(InputError, match=message):
        FingerModel(finger, **options)


SCENE = Scene(finger=FULL, gravity=(0.0, -9.81))
IN_SCENE = {
    "parameter": ({"parameters": ("gravity", "tip_mas")}, {}, "parameters[1]", "did you mean 'tip_mass'"),
    "repeated parameter": ({"parameters": ("gravity", "gravity")}, {}, "parameters[1]", "'gravity' is repeated"),
    "piecewise rest": ({"parameters": ("gravity", "element_lengths")}, {}, "parameters[1]", "piecewise rest curvature"),
    "initial angles": (
        {"initial": Initial(q=(0.0,)), "fidelity": Fidelity(family="arc", elements=2)},
        {},
        "initial.q",
        r"q has 1 entries, the arc model has 2: theta_1",
    ),
    "initial rates": (
        {"initial": Initial(q=(0.0, 0.0), qd=(1.0,)), "fidelity": Fidelity(elements=2)},
        {},
        "initial.qd",
        "qd has 1 entries, the matched_clothoid model has 2: kappa_0",
    ),
    "elements": (
        {"fidelity": Fidelity(elements=1), "contacts": (0.3,)},
        {},
        "fidelity.elements",
        "at least 2 elements",
    ),
    "boundaries": ({"fidelity": Fidelity(elements=(0.2, 0.4)), "contacts": (0.3,)}, {}, "contacts[0]", "boundary"),
    "a keyword": ({"fidelity": Fidelity(elements=3)}, {"elements": 0}, "elements", "from 1 to 128, got 0"),
}


@pytest.mark.parametrize("name", IN_SCENE)
def test_wrong_scenes_are_explained_with_the_key(name):
    change, options, key, message = IN_SCENE[name]
    with pytest.raises(InputError, match=message) as caught:
        FingerModel(SCENE.model_copy(update=change), **options)
    assert caught.value.key == key


def test_an_initial_state_is_for_the_scene_as_it_is():
    scene = SCENE.model_copy(update={"initial": Initial(q=(0.1, 0.2)), "fidelity": Fidelity(family="arc", elements=2)})
    assert FingerModel(scene).n == 2
    assert FingerModel(scene, elements=3).n == 3


def test_numbers_of_numpy_are_numbers():
    scalars = {
        "elements": np.int64(3),
        "accuracy": np.float32(1e-3),
        "bending_range": np.int64(2),
        "tip_force": np.True_,
    }
    model = FingerModel(FULL, contacts=np.array([0.2, 0.4]), gravity=np.array([0, -9]), **scalars)
    assert (len(model.lengths), model.nw, model.ranges[0]) == (3, 6, 2.0)
    assert FingerModel(FULL, elements=np.array([0.2, 0.4])).lengths == (0.2, 0.4)


def test_a_piecewise_rest_curvature_needs_fixed_lengths():
    with pytest.raises(InputError, match="piecewise rest curvature"):
        FingerModel(FULL, family="arc", parameters=("element_lengths",))
