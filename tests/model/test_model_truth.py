"""The model against its 50-digit reference; from inside: single links and rotations, and quadrature errors.

The model against its 50-digit reference: everything exact, for every bend, load and structure.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise

import casadi as ca
import mpmath
import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.model import RANGES, Vec, column, stumpff
from continuum_grasp.model.chain import Chain, ChainPlace
from continuum_grasp.model.link import LoadedLink
from continuum_grasp.model.moment_linear import Clothoid
from continuum_grasp.model.node_counts import _ERRORS, node_count
from continuum_grasp.model.planar import ZERO
from continuum_grasp.model.quadrature import STRICT, collocation
from continuum_grasp.model.stumpff_functions import ROUNDING, rotation
from continuum_grasp.model.tendon_friction import shares
from continuum_grasp.scene import Damping, PointMass, Tendons
from tests.finger_cases import (
    EXACT,
    FAMILIES,
    LENGTHS,
    LOADS,
    NODES,
    PATTERNS,
    ROD,
    Case,
    State,
    errors,
    evaluate,
    jacobian_rate_error,
    relative_error,
    shared_model,
    state,
    true_values,
    worst,
)
from tests.marks import few
from tests.truth import Rod, TruthFinger, ctx, matched_tip, to_numpy

BOUND = {"arc": 1e-13, "clothoid": 2e-13, "matched_clothoid": 2e-13}
RANGE = 2 * math.pi / 3
CURVED = ("clothoid", "matched_clothoid")


@pytest.mark.parametrize("bend", few([0.0, RANGE, 1e-9, 1e-300, 1e-4, 0.1, math.pi, 2 * math.pi], 2))
@pytest.mark.parametrize("elements", few(sorted(LENGTHS, key=[2, 5, 1, 3].index), 2))
@pytest.mark.parametrize("family", FAMILIES)
def test_the_full_finger_is_exact(family, elements, bend):
    # Angles of 1e-300 drown in the 50 digits of a turned base.
    reach = RANGE if bend <= RANGE else 2 * math.pi
    case, model = shared_model(family, elements, reach, upright=bend < 1e-30)
    for pattern in range(len(PATTERNS) if elements < 5 else 1):
        name, error = worst(errors(case, model, state(model, bend, pattern)))
        assert error <= BOUND[family], name


@pytest.mark.parametrize("bend", [0.0, 1e-9, 0.1, RANGE])
@pytest.mark.parametrize("elements", [1, 3])
@pytest.mark.parametrize("family", FAMILIES)
def test_the_jacobian_rate_is_exact(family, elements, bend):
    case, model = shared_model(family, elements, RANGE)
    for pattern in range(len(PATTERNS)):
        assert jacobian_rate_error(case, model, state(model, bend, pattern)) <= BOUND[family]


@pytest.mark.parametrize("reach", [0.01, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("family", FAMILIES)
def test_a_small_declared_range_costs_no_digits(family, reach):
    """The series are cut for the range that is declared: all that they make must stay exact there."""
    case = Case().with_finger(rest_curvature=0.0)
    model = case.model(family, bending_range=reach, accuracy=EXACT[family])
    at = state(model, reach)
    at = State(at.q, at.qd, 0.1 * reach * at.u, at.w)
    name, error = worst(errors(case, model, at))
    assert error <= BOUND[family], name
    assert jacobian_rate_error(case, model, at) <= BOUND[family]


@pytest.mark.parametrize("family", FAMILIES)
def test_each_load_alone(family):
    case, model = shared_model(family, 3, RANGE)
    at, finger = state(model, 1.3), case.reference(model)
    rod = Rod(finger, at.q, at.qd, matched_tip(finger, *case.drive(model, at.u)), NODES)
    assert model.nw == 2 * 2 + 3 * 2 + 1
    for w, label in zip(np.eye(model.nw), model.w_names, strict=True):
        forces, moments = case.forces(model, rod, w)
        truth = to_numpy(rod.applied(forces, moments=moments))
        value = evaluate(model.external_force, at.q, at.u, w, model.p_nominal)
        assert relative_error(value, truth) <= BOUND[family], label


MAKE_UPS = {
    "bare": {"rest_curvature": 0.0, "masses": (), "damping": Damping()},
    "tip mass": {"masses": (PointMass(at=0.6, mass=0.5),), "rest_curvature": 0.0},
    "joint mass": {"masses": (PointMass(at=0.25, mass=0.5),)},
    "interior mass": {"masses": (PointMass(at=0.11, mass=0.5),)},
    "two masses on one element": {"masses": (PointMass(at=0.3, mass=0.5), PointMass(at=0.4, mass=0.2))},
    "heavy tip": {"masses": (PointMass(at=0.6, mass=48.0),)},
    "no rotary inertia": {"rod": ROD.model_copy(update={"rotary_inertia": 0.0})},
    "much rotary inertia": {"rod": ROD.model_copy(update={"rotary_inertia": 0.1}), "masses": ()},
    "uniform rest curvature": {"rest_curvature": 2.5},
    "material damping": {"damping": Damping(material=0.03)},
    "damping per arc": {"damping": Damping(per_arc=0.03)},
}
PARTS = [({}, lengths) for lengths in ((0.006, 0.594), (0.594, 0.006), (0.2, 0.2, 0.2), (0.01, 0.5, 0.01, 0.08))]
PARTS += [(finger, 2) for finger in MAKE_UPS.values()]


@pytest.mark.parametrize("family", few(sorted(FAMILIES, reverse=True), 1))
@pytest.mark.parametrize(("finger", "elements"), PARTS, ids=[*(str(lengths) for _, lengths in PARTS[:4]), *MAKE_UPS])
def test_each_part_and_very_unequal_elements_alone(finger, elements, family):
    case = Case().with_finger(**finger)
    model = case.model(family, elements, accuracy=EXACT[family])
    name, error = worst(errors(case, model, state(model, 1.7 if finger else 0.9)))
    assert error <= BOUND[family], name


TENDONS = Tendons(offset=0.0123, max_tension=40.0)


@pytest.mark.parametrize("family", FAMILIES)
def test_tendons(family):
    case = Case(loads=LOADS).with_finger(tendons=TENDONS)
    model = case.model(family, accuracy=EXACT[family])
    at = state(model, 1.2)
    at = State(at.q, at.qd, at.u * [30, 30, 1], at.w)
    name, error = worst(errors(case, model, at))
    assert error <= BOUND[family], name


@pytest.mark.parametrize("tendons", [None, TENDONS])
@pytest.mark.parametrize("elements", few([2, 1, 3], 1))
def test_rates_of_the_input_move_a_matched_tip(elements, tendons):
    case = Case(loads=LOADS, options={"input_rates": True}).with_finger(tendons=tendons)
    model = case.model("matched_clothoid", elements, accuracy=1e-13)
    at = state(model, 1.2)
    count = model.nu // 3
    u = at.u * np.repeat([1.0, 10.0, 100.0], count)
    if tendons:
        u *= np.tile([30.0, 30.0, 1.0], 3)
    still = State(at.q, at.qd, np.concatenate([u[:count], np.zeros(2 * count)]), at.w)
    at = State(at.q, at.qd, u, at.w)
    name, error = worst(errors(case, model, at))
    assert error <= BOUND["matched_clothoid"], name
    moved = true_values(case, model, at)["acceleration"] - true_values(case, model, still)["acceleration"]
    assert np.abs(moved).max() > 1.0  # the rates matter here


@pytest.mark.parametrize("family", FAMILIES)
def test_the_tendons_time_constant_is_a_critically_damped_lag(family):
    tendons = TENDONS.model_copy(update={"time_constant": 0.03})
    case = Case(loads=LOADS).with_finger(tendons=tendons)
    model = case.model(family, accuracy=EXACT[family])
    at = state(model, 1.2)
    moment, rate, couple = 0.11, 2.3, at.u[2]
    u = np.array([17.0, 4.0, couple])
    xd = evaluate(model.forward_dynamics, [*at.x, moment, rate], u, at.w, model.p_nominal)
    commanded = ctx.mpf(tendons.offset) * 13
    pole = 1 / ctx.mpf(tendons.time_constant)
    acceleration = pole**2 * (commanded - moment) - 2 * pole * rate
    total = ctx.mpf(moment) + couple
    finger = case.reference(model)
    rod = Rod(finger, at.q, at.qd, matched_tip(finger, total, rate, acceleration))
    forces, moments = case.forces(model, rod, at.w)
    qdd = to_numpy(rod.acceleration(forces, total, moments))
    condition = np.linalg.cond(to_numpy(rod.mass))
    assert relative_error(xd[model.n : -2], qdd) <= BOUND[family] * condition
    assert relative_error(xd[-2:], to_numpy([rate, acceleration])) <= 1e-15
    assert xd[: model.n] == pytest.approx(at.qd, rel=0, abs=0)


@pytest.mark.parametrize("family", ["arc", "clothoid"])
def test_tendon_friction_follows_the_capstan_law(family):
    """The work of two tensions in a shape, by quadrature of T(s) = T exp(-side mu b(s)) with states at their ends."""
    friction, count = 0.3, 16
    case = Case().with_finger(tendons=TENDONS.model_copy(update={"friction": friction, "friction_cells": count}))
    model = case.model(family, 3)
    rng = np.random.default_rng(4)
    at = state(model, 1.2)
    # cells that slide in, and others out
    ways = np.sign(rng.uniform(-1.0, 1.0, len(model.friction_names)))
    u = np.array([8.0, 3.0])
    found = evaluate(model.actuation, at.q, u, [], [*ways, 0.0])
    nodes, weights = np.polynomial.legendre.leggauss(5)
    expected, lost, tip = np.zeros(model.n), 0.0, model.finger.rod.length
    edges = np.concatenate([np.linspace(a, b, count + 1)[:-1] for a, b in pairwise(np.cumsum([0.0, *model.lengths]))])
    angles = ca.SX.sym("q", model.n)
    for way, a, b in zip(ways, edges, [*edges[1:], tip], strict=True):
        s = 0.5 * (a + b) + 0.5 * (b - a) * nodes
        turns = [ca.jacobian(model.orientation(angles, u, x, []), angles) for x in (a, b)]
        turn = float(model.orientation(at.q, u, b, [])[0] - model.orientation(at.q, u, a, [])[0])
        slope = ca.Function("slope", [angles], [turns[1] - turns[0]])
        gradient = np.array(slope(at.q)).ravel()
        loss = way * friction * abs(turn)
        shares = [np.exp(-side * (lost + loss * (s - a) / (b - a))) @ weights / 2.0 for side in (1.0, -1.0)]
        expected += TENDONS.offset * (u[0] * shares[0] - u[1] * shares[1]) * gradient
        lost += loss
    assert relative_error(found, expected) <= 1e-4


# What is cut off on purpose.


@pytest.mark.parametrize("bend", few([RANGE, 0.3], 1))
@pytest.mark.parametrize("elements", few(sorted(LENGTHS, key=[2, 5, 1, 3].index), 2))
@pytest.mark.parametrize("family", CURVED)
def test_default_accuracy_of_clothoids(family, elements, bend):
    case = Case(loads=LOADS)
    model = case.model(family, elements)
    found = [errors(case, model, state(model, bend, pattern)) for pattern in range(len(PATTERNS))]
    stated = 2e-3 * (2 / elements) ** 4
    name, error = max((worst(part) for part in found), key=lambda pair: pair[1])
    assert error <= stated, name


@pytest.mark.parametrize("accuracy", [1e-4, 1e-7, 1e-10])
@pytest.mark.parametrize("reach", [1.0, RANGE, math.pi])
def test_arcs_as_accurate_as_asked_for(accuracy, reach):
    case = Case(loads=LOADS)
    model, exact = (case.model("arc", bending_range=reach, accuracy=a) for a in (accuracy, None))
    found = errors(case, model, state(model, reach))
    for name in ("mass_matrix", "gravity", "bias", "tip"):
        assert found[name] <= 5 * accuracy, name
    assert model.forward_dynamics.n_instructions() < exact.forward_dynamics.n_instructions()


def element(reach: float, nodes: int) -> ca.Function:
    """Mass matrix, bias, gravity and end point of one clothoid of length and density 1 along X."""
    q, qd, g = ca.SX.sym("q", 2), ca.SX.sym("qd", 2), ca.SX.sym("g", 2)
    link = LoadedLink(Clothoid([q[0], q[1]], 1.0, 1.0, 0.0, reach, collocation(nodes)), ())
    chain = Chain([link], [(0, 1)], 2)
    mass = ca.vertcat(*[ca.horzcat(*row) for row in chain.mass_matrix])
    bias = -column(chain.motion_forces([qd[0], qd[1]], ZERO))
    weight = -column(chain.motion_forces(None, Vec(g[0], g[1])))
    return ca.Function("element", [q, qd, g], [mass, bias, weight, chain.position(ChainPlace(0)).column()])


RATES = ((1, 0), (0, 1), (1, 1))
WEIGHTS = ((1, 0), (0, 1))


@lru_cache
def element_truth(reach: float) -> tuple[np.ndarray, list[dict]]:
    """Shapes of that element and what the reference says of them; its Y is the element's X."""
    rng = np.random.default_rng(5)
    extreme = [(1, 1), (1, -1), (1, 0), (0, 1), (1, -0.7), (-0.5, 1)]
    shapes = reach * np.array([*extreme, *rng.uniform(-1, 1, (4, 2))])
    truth = []
    for q in shapes:
        moving = [Rod(TruthFinger((1,), "clothoid"), q, qd, nodes=NODES) for qd in RATES]
        heavy = [Rod(TruthFinger((1,), "clothoid", gravity=(-y, x)), q, nodes=NODES) for x, y in WEIGHTS]
        x, y = to_numpy(heavy[0].position(1))
        truth.append(
            {
                "mass": to_numpy(heavy[0].mass),
                "bias": np.array([to_numpy(rod.bias) for rod in moving]),
                "gravity": np.array([to_numpy(rod.gravity) for rod in heavy]),
                "end": np.array([y, -x]),
            }
        )
    return shapes, truth


def element_values(function: ca.Function, q: np.ndarray) -> dict:
    out = function(q, RATES[0], WEIGHTS[0])
    return {
        "mass": np.array(out[0]),
        "bias": np.array([np.array(function(q, qd, (0, 0))[1])[:, 0] for qd in RATES]),
        "gravity": np.array([np.array(function(q, (0, 0), g)[2])[:, 0] for g in WEIGHTS]),
        "end": np.array(out[3])[:, 0],
    }


@pytest.mark.deep
@pytest.mark.parametrize("what", ["mass", "gravity", "end", "bias"])
@pytest.mark.parametrize("reach", [0.6, 2.1, 3.15, 6.3])
def test_the_table_of_node_counts_is_an_upper_bound(reach, what):
    """Relative to the largest entry (end point: to the length); bias: to the largest one of the shapes tried."""
    shapes, truth = element_truth(reach)
    largest = max(np.abs(t["bias"]).max() for t in truth)
    exceeded = []
    for nodes, stated in _ERRORS.items():
        function = element(reach, nodes)
        for q, true in zip(shapes, truth, strict=True):
            value = element_values(function, q)
            scale = {"end": 1.0, "bias": largest}.get(what, np.abs(true[what]).max())
            error = np.abs(value[what] - true[what]).max() / scale
            bound = stated[RANGES.index(reach)]
            if error > 1.05 * bound:
                exceeded.append(f"{nodes} nodes, shape {q}: {error:.1e} > {bound:.1e}")
    assert not exceeded, "\n".join(exceeded)


def stumpff_errors(reach: float, accuracy: float):
    """k, theta, error of c_k(theta^2) and what rounding c_6 and c_7 may become in it."""
    theta = ca.SX.sym("theta")
    function = ca.Function("c", [theta], [ca.vertcat(*stumpff(theta, reach, accuracy))])
    for angle in (*np.linspace(-reach, reach, 7), 1e-300):
        values, x = np.array(function(angle))[:, 0], ctx.mpf(float(angle)) ** 2
        for k, value in enumerate(values):
            true = ctx.fsum((-x) ** n / ctx.factorial(2 * n + k) for n in range(60))
            rounding = 1e-15 * sum(float(x**j) / math.factorial(k + 2 * j) for j in range(5))
            yield k, abs(float(angle)), abs(float(value - true)), rounding


@pytest.mark.parametrize("accuracy", [ROUNDING, 1e-9, 1e-5])
@pytest.mark.parametrize("reach", [0.05, 0.5, RANGE, math.pi, 2 * math.pi])
def test_stumpff_functions_are_as_accurate_as_asked_for(reach, accuracy):
    for k, angle, error, rounding in stumpff_errors(reach, accuracy):
        if k < 2:
            assert angle**k * error <= accuracy + rounding, (k, angle)


@pytest.mark.parametrize("reach", [0.05, 0.5, RANGE, math.pi, 2 * math.pi])
def test_stumpff_functions_are_exact_relative_to_their_size(reach):
    for k, angle, error, rounding in stumpff_errors(reach, ROUNDING):
        assert error <= 1e-14 / math.factorial(k) + rounding, (k, angle)


@pytest.mark.parametrize("reach", [0.1, 1.0, math.pi])
def test_economised_rotation(reach):
    theta = ca.SX.sym("theta")
    turn = rotation(theta, reach)
    function = ca.Function("r", [theta], [ca.vertcat(turn.c, turn.s)])
    for angle in (*np.linspace(-reach, reach, 41), 1e-300):
        cosine, sine = np.array(function(angle))[:, 0]
        assert cosine == pytest.approx(float(mpmath.cos(float(angle))), abs=3e-15)
        assert sine == pytest.approx(float(mpmath.sin(float(angle))), abs=3e-15, rel=3e-15)


def test_leaving_the_range_is_reported():
    case = Case().with_finger(rest_curvature=0.0)
    model = case.model("arc", bending_range=0.5)
    assert evaluate(model.range_use, [0.25, -1.0], [0.0], []) == pytest.approx([0.5, 2.0])
    model = case.model("clothoid", (0.2, 0.4), bending_range=0.5)
    assert evaluate(model.range_use, [2.5, -1.0, 0.0], [0.0], []) == pytest.approx([1.0, 0.8])


@pytest.mark.parametrize("accuracy", [1e-6, 1e-10])
@pytest.mark.parametrize("column", range(len(RANGES)))
def test_nodes_are_those_of_the_least_range_that_covers_a_bend(column, accuracy):
    wanted = accuracy if accuracy > STRICT else 0.1 * accuracy

    def enough(at):
        return next(count for count, errors in _ERRORS.items() if errors[at] <= wanted)

    assert node_count(0.999 * RANGES[column], accuracy) == node_count(RANGES[column], accuracy) == enough(column)
    if column + 1 < len(RANGES):
        assert node_count(1.001 * RANGES[column], accuracy) == enough(column + 1)
    else:
        with pytest.raises(InputError, match="beyond one turn"):
            node_count(1.001 * RANGES[column], accuracy)


@pytest.mark.parametrize("loss", [0.1, 0.4])
def test_a_cell_pulls_as_hard_as_its_tension_does_on_average(loss):
    """The mean of exp(-t) over the cell, and of a second one behind it; on the other side tension rises."""
    found = shares([0.5 * loss, 0.5 * loss], None, (1.0, -1.0))
    for side, means in zip((1.0, -1.0), found.mean, strict=True):
        first = (1.0 - math.exp(-side * loss)) / (side * loss)
        exact = [first, first * math.exp(-side * loss)]
        assert [float(mean) for mean in means] == pytest.approx(exact, rel=2e-5)
