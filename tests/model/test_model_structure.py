"""What must hold for any finger: mechanics, symmetries, families among each other, cost, names and errors."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.errors import InputError
from continuum_grasp.model import FingerModel
from continuum_grasp.model.finger_model import FUNCTIONS
from continuum_grasp.scene import (
    BasePose,
    Damping,
    Fidelity,
    Finger,
    ForceLoad,
    Initial,
    MomentLoad,
    PiecewiseCurvature,
    PointMass,
    Scene,
    Tendons,
)
from continuum_grasp.scene import Rod as RodValue
from tests.finger_cases import (
    FAMILIES,
    FULL,
    LOADS,
    ROD,
    Case,
    State,
    evaluate,
    jacobian_rate_error,
    relative_error,
    state,
)
from tests.marks import few
from tests.truth import Rod, ctx, matched_tip, to_numpy

CURVED = ("clothoid", "matched_clothoid")
UNIT = Finger(rod=RodValue(length=1.0, linear_density=1.0, bending_stiffness=1.0))


def full(family: str, elements: int = 3, **options):
    case = Case(loads=LOADS, contacts=(0.1,))
    model = case.model(family, elements, **options)
    return case, model, state(model, 1.3, seed=3)


def derivative(function: ca.Function, arguments: list, which: int) -> np.ndarray:
    """Exact derivative of the first output (columns stacked) with respect to one argument."""
    symbol = ca.SX.sym("a", function.sparsity_in(which))
    inputs = [symbol if k == which else ca.DM(v) for k, v in enumerate(arguments)]
    out = function(*inputs)
    out = out[0] if isinstance(out, (tuple, list)) else out
    return np.array(ca.Function("d", [symbol], [ca.jacobian(ca.vec(out), symbol)])(ca.DM(arguments[which])))


# Mechanics.


@pytest.mark.parametrize("elements", [1, 2, 3])
@pytest.mark.parametrize("family", FAMILIES)
def test_bias_is_that_of_the_christoffel_symbols(family, elements):
    case = Case()
    model = case.model(family, elements)
    at, n = state(model, 1.3), model.n
    slopes = derivative(model.mass_matrix, [at.q, at.u, []], 0).reshape(n, n, n)  # the last index is the coordinate
    gamma = 0.5 * (slopes + slopes.transpose(0, 2, 1) - slopes.transpose(2, 0, 1))
    expected = np.einsum("ijk,j,k->i", gamma, at.qd, at.qd)
    assert relative_error(evaluate(model.bias, at.q, at.qd, at.u, []), expected) <= 1e-12


@pytest.mark.parametrize("family", FAMILIES)
def test_mass_rate_less_twice_coriolis_is_skew(family):
    """The matrix C with C a = B(qd, a) is read off the model's bias, a quadratic form, by polarization."""
    _, model, at = full(family)

    def bias(rates):
        return evaluate(model.bias, at.q, rates, at.u, [])

    coriolis = np.column_stack([(bias(at.qd + a) - bias(at.qd - a)) / 4 for a in np.eye(model.n)])
    slopes = derivative(model.mass_matrix, [at.q, at.u, []], 0) @ at.qd
    rate = slopes.reshape(model.n, model.n)
    residual = rate - 2 * coriolis
    assert np.abs(residual + residual.T).max() <= 1e-12 * np.abs(coriolis).max()
    assert relative_error(coriolis @ at.qd, bias(at.qd)) <= 1e-12


@pytest.mark.parametrize("s", [0.0, 0.04, 0.1, 0.41, 0.6])
@pytest.mark.parametrize("family", FAMILIES)
def test_jacobian_is_the_slope_of_position(family, s):
    _, model, at = full(family)
    step = 1e-6 * max(1.0, np.abs(at.q).max())
    jacobian = evaluate(model.jacobian, at.q, at.u, s, [])
    for k, unit in enumerate(np.eye(model.n)):
        sides = [evaluate(model.position, at.q + sign * step * unit, at.u, s, []) for sign in (1, -1)]
        assert jacobian[:, k] == pytest.approx((sides[0] - sides[1]) / (2 * step), abs=1e-8)


@pytest.mark.parametrize("s", [0.02, 0.1, 0.41, 0.6])
@pytest.mark.parametrize("family", FAMILIES)
def test_the_tangent_is_the_slope_of_position(family, s):
    _, model, at = full(family, accuracy=1e-13)
    angle, step = evaluate(model.orientation, at.q, at.u, s, [])[0], 1e-6
    ahead, behind = (evaluate(model.position, at.q, at.u, s + sign * step, []) for sign in (0, -1))
    middle = evaluate(model.orientation, at.q, at.u, s - 0.5 * step, [])[0]
    assert (ahead - behind) / step == pytest.approx([-math.sin(middle), math.cos(middle)], abs=1e-8)
    assert angle == pytest.approx(middle, abs=1e-4)


@pytest.mark.parametrize("family", FAMILIES)
def test_tip_is_the_position_at_the_end_and_the_base_that_at_the_start(family):
    case, model, at = full(family)
    assert evaluate(model.tip, at.q, at.u, []) == pytest.approx(
        evaluate(model.position, at.q, at.u, 0.6, []), abs=1e-15
    )
    assert evaluate(model.position, at.q, at.u, 0.0, []) == pytest.approx(case.finger.base.position, abs=0)
    assert evaluate(model.orientation, at.q, at.u, 0.0, [])[0] == case.finger.base.angle


@pytest.mark.parametrize("family", FAMILIES)
def test_external_forces_are_jacobian_transposed_times_force(family):
    """Exact for arcs; clothoids integrate a section and a whole element by the same rule."""
    _, model, at = full(family, accuracy=None if family == "arc" else 1e-13)
    expected = np.zeros(model.n)
    for s, pair in zip((0.1, 0.6, 0.13), np.reshape(at.w[:6], (3, 2)), strict=True):
        expected += evaluate(model.jacobian, at.q, at.u, s, []).T @ pair
    w = np.where(np.arange(model.nw) < 6, at.w, 0.0)
    assert model.w_names[4] == "load_1_x [N]"
    assert relative_error(evaluate(model.external_force, at.q, at.u, w, []), expected) <= 2e-13


@pytest.mark.parametrize("family", FAMILIES)
def test_weight_and_elasticity_are_the_gradient_of_the_potential(family):
    _, model, at = full(family)
    x, u, p = (ca.SX.sym(name, size) for name, size in (("x", model.nx), ("u", model.nu), ("p", 0)))
    slope = ca.Function("slope", [x, u, p], [ca.jacobian(model.energy(x, u, p)[1], x)])
    gradient = np.array(slope(at.x, at.u, []))[0, : model.n]
    forces = evaluate(model.gravity, at.q, at.u, []) + evaluate(model.elastic, at.q, at.u, [])
    assert relative_error(gradient, forces) <= 1e-13


@pytest.mark.parametrize("family", FAMILIES)
def test_kinetic_energy_is_half_qd_M_qd(family):
    _, model, at = full(family)
    mass = evaluate(model.mass_matrix, at.q, at.u, [])
    assert float(model.energy(at.x, at.u, [])[0]) == pytest.approx(0.5 * at.qd @ mass @ at.qd, rel=1e-13)


def energy_rate(model: FingerModel, at: State, u_rate: np.ndarray) -> float:
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    total = ca.Function("E", [x, u], [sum(model.energy(x, u, []))])
    xd = evaluate(model.forward_dynamics, at.x, at.u, at.w, [])
    by_state, by_input = (derivative(total, [at.x, at.u], k)[0] for k in (0, 1))
    return float(by_state @ xd + by_input @ u_rate)


@pytest.mark.parametrize("family", FAMILIES)
def test_energy_changes_by_the_power_that_is_put_in(family):
    _, model, at = full(family)
    forces = evaluate(model.external_force, at.q, at.u, at.w, []) + evaluate(model.actuation, at.q, at.u, [])
    power = at.qd @ (forces - evaluate(model.damping, at.q, at.qd, at.u, []))
    assert energy_rate(model, at, np.zeros(model.nu)) == pytest.approx(power, rel=1e-11)


def test_energy_balance_of_a_matched_tip_that_moves():
    """The matched tip is the free clothoid with a reaction on its last coordinate: that reaction's power too."""
    case = Case(loads=LOADS)
    free = case.model("clothoid", 3, accuracy=1e-13)
    matched = case.model("matched_clothoid", 3, accuracy=1e-13, input_rates=True)
    at = state(matched, 1.0)
    u = at.u * [1, 1, 10, 10, 100, 100]
    at = State(at.q, at.qd, u, at.w)
    xd = evaluate(matched.forward_dynamics, at.x, at.u, at.w, [])
    value, rate, acceleration = u.reshape(3, 2).sum(axis=1) / ROD.stiffness
    q = np.append(at.q, value)
    qd, qdd = np.append(at.qd, rate), np.append(xd[matched.n :], acceleration)
    residual = evaluate(free.inverse_dynamics, q, qd, qdd, u[:2], at.w, [])
    inertia = evaluate(free.mass_matrix, q, u[:2], []) @ qdd
    assert np.abs(residual[:-1]).max() <= 1e-12 * np.abs(inertia).max()
    energies = [[float(v) for v in m.energy(x, v, [])] for m, x, v in ((free, [*q, *qd], u[:2]), (matched, at.x, u))]
    assert energies[0] == pytest.approx(energies[1], rel=1e-12)
    forces = evaluate(free.external_force, q, u[:2], at.w, []) + evaluate(free.actuation, q, u[:2], [])
    power = qd @ (forces - evaluate(free.damping, q, qd, u[:2], [])) + residual[-1] * rate
    assert abs(residual[-1] * rate) > 1e-2 * abs(power)  # it matters here
    assert energy_rate(matched, at, np.append(u[2:], [0.0, 0.0])) == pytest.approx(power, rel=1e-10)


@pytest.mark.parametrize("elements", [1, 3])
@pytest.mark.parametrize("family", FAMILIES)
def test_inverse_dynamics_undoes_forward_dynamics(family, elements):
    case = Case(loads=LOADS)
    model = case.model(family, elements)
    at = state(model, 1.3)
    qdd = evaluate(model.forward_dynamics, at.x, at.u, at.w, [])[model.n :]
    inertia = evaluate(model.mass_matrix, at.q, at.u, []) @ qdd
    residual = evaluate(model.inverse_dynamics, at.q, at.qd, qdd, at.u, at.w, [])
    assert np.abs(residual).max() <= 1e-12 * np.abs(inertia).max()


@pytest.mark.parametrize("family", FAMILIES)
def test_the_equation_of_motion_is_the_sum_of_its_terms(family):
    _, model, at = full(family)
    qdd = np.arange(1.0, model.n + 1)
    terms = evaluate(model.mass_matrix, at.q, at.u, []) @ qdd
    terms += evaluate(model.bias, at.q, at.qd, at.u, []) + evaluate(model.gravity, at.q, at.u, [])
    terms += evaluate(model.elastic, at.q, at.u, []) + evaluate(model.damping, at.q, at.qd, at.u, [])
    terms -= evaluate(model.actuation, at.q, at.u, []) + evaluate(model.external_force, at.q, at.u, at.w, [])
    assert relative_error(evaluate(model.inverse_dynamics, at.q, at.qd, qdd, at.u, at.w, []), terms) <= 1e-12


# Symmetries.


@pytest.mark.parametrize("family", FAMILIES)
def test_the_mirror_image_moves_as_the_mirror_image(family):
    def mirrored(finger: Finger) -> Finger:
        rest, base = finger.rest_curvature, finger.base
        return finger.model_copy(
            update={
                "rest_curvature": PiecewiseCurvature(breaks=rest.breaks, values=tuple(-v for v in rest.values)),
                "base": BasePose(position=(-base.position[0], base.position[1]), angle=-base.angle),
            }
        )

    case = Case(loads=LOADS, contacts=(0.1,))
    image = Case(mirrored(FULL), gravity=(-case.gravity[0], case.gravity[1]), loads=LOADS, contacts=(0.1,))
    model, mirror = case.model(family, 3), image.model(family, 3)
    at = state(model, 1.3)
    flip = [-1.0 if "_x " in name or "across" in name or "moment" in name else 1.0 for name in model.w_names]
    assert sum(f < 0 for f in flip) == 6
    xd = evaluate(model.forward_dynamics, at.x, at.u, at.w, [])
    assert relative_error(evaluate(mirror.forward_dynamics, -at.x, -at.u, flip * at.w, []), -xd) <= 1e-13
    tip = evaluate(model.tip, at.q, at.u, [])
    assert evaluate(mirror.tip, -at.q, -at.u, []) == pytest.approx([-tip[0], tip[1]], rel=1e-14)


@pytest.mark.parametrize("family", FAMILIES)
def test_swapping_the_tendons_mirrors_the_motion(family):
    finger = Finger(rod=ROD, tendons=Tendons(offset=0.01, max_tension=10.0))
    model = FingerModel(finger, family=family, gravity=(0.0, -9.81))
    at = state(model, 1.3)
    xd = evaluate(model.forward_dynamics, at.x, [5.0, 2.0], [0.3, 0.1], [])
    swapped = evaluate(model.forward_dynamics, -at.x, [2.0, 5.0], [-0.3, 0.1], [])
    assert relative_error(swapped, -xd) <= 1e-13


@pytest.mark.parametrize("family", FAMILIES)
def test_without_damping_time_runs_both_ways(family):
    case = Case(loads=LOADS).with_finger(damping=Damping())
    model = case.model(family, 3)
    at = state(model, 1.3)
    back = State(at.q, -at.qd, at.u, at.w)
    ahead, behind = (evaluate(model.forward_dynamics, v.x, v.u, v.w, [])[model.n :] for v in (at, back))
    assert relative_error(behind, ahead) <= 1e-14


@pytest.mark.parametrize("family", FAMILIES)
def test_turning_base_gravity_and_forces_together_changes_nothing(family):
    turn = 0.9
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    case = Case()
    gravity = tuple(float(v) for v in matrix @ case.gravity)
    turned = Case(gravity=gravity).with_finger(base=BasePose(position=(5.0, 6.0), angle=FULL.base.angle + turn))
    model, other = case.model(family, 3), turned.model(family, 3)
    at = state(model, 1.3)
    xd = evaluate(model.forward_dynamics, at.x, at.u, at.w, [])
    assert relative_error(evaluate(other.forward_dynamics, at.x, at.u, matrix @ at.w, []), xd) <= 1e-12


# Families among each other.


def test_splitting_an_arc_in_two_changes_nothing():
    """Equal curvature on both parts: q = P theta; M, bias, weight and forces project by P."""
    case = Case(loads=LOADS[:4]).with_finger(masses=FULL.masses[1:], damping=Damping(material=0.01), rest_curvature=0.7)
    whole, parts = case.model("arc", (0.25, 0.35)), case.model("arc", (0.25, 0.14, 0.21), bending_range=2.1)
    pattern = np.array([[1.0, 0.0], [0.0, 0.4], [0.0, 0.6]])
    at = state(whole, 1.3)
    q, qd = pattern @ at.q, pattern @ at.qd
    for s in (0.1, 0.3, 0.39, 0.5, 0.6):
        assert evaluate(parts.position, q, at.u, s, []) == pytest.approx(
            evaluate(whole.position, at.q, at.u, s, []), abs=1e-15
        )
        jacobian = evaluate(parts.jacobian, q, at.u, s, []) @ pattern
        assert jacobian == pytest.approx(evaluate(whole.jacobian, at.q, at.u, s, []), abs=1e-14)
    mass = pattern.T @ evaluate(parts.mass_matrix, q, at.u, []) @ pattern
    assert relative_error(mass, evaluate(whole.mass_matrix, at.q, at.u, [])) <= 1e-14
    for name in ("gravity", "elastic", "actuation"):
        value = pattern.T @ evaluate(getattr(parts, name), q, at.u, [])
        assert relative_error(value, evaluate(getattr(whole, name), at.q, at.u, [])) <= 1e-13, name
    for name in ("bias", "damping"):
        value = pattern.T @ evaluate(getattr(parts, name), q, qd, at.u, [])
        assert relative_error(value, evaluate(getattr(whole, name), at.q, at.qd, at.u, [])) <= 1e-13, name
    value = pattern.T @ evaluate(parts.external_force, q, at.u, at.w, [])
    assert relative_error(value, evaluate(whole.external_force, at.q, at.u, at.w, [])) <= 1e-13


def test_a_clothoid_with_equal_nodal_curvatures_is_an_arc():
    """The uniform curvature is the one motion that both have: equal shapes, and equal projections on it."""
    case = Case(loads=LOADS).with_finger(damping=Damping(material=0.01), rest_curvature=0.7)
    arc, clothoid = case.model("arc", 3), case.model("clothoid", 3, accuracy=1e-13)
    h, ones = np.array(arc.lengths), np.ones(4)
    kappa, rate = 3.1, -4.0
    at = state(arc, 1.0)
    for s in (0.03, 0.3, 0.41, 0.6):
        for name in ("position", "orientation"):
            value, expected = (
                evaluate(getattr(m, name), kappa * v, at.u, s, []) for m, v in ((clothoid, ones), (arc, h))
            )
            assert value == pytest.approx(expected, abs=2e-15)
        slope = evaluate(clothoid.jacobian, kappa * ones, at.u, s, []) @ ones
        assert slope == pytest.approx(evaluate(arc.jacobian, kappa * h, at.u, s, []) @ h, abs=2e-14)

    def projected(model: FingerModel, v: np.ndarray) -> list[float]:
        mass = v @ evaluate(model.mass_matrix, kappa * v, at.u, []) @ v
        still = [v @ evaluate(getattr(model, k), kappa * v, at.u, []) for k in ("gravity", "elastic", "actuation")]
        moving = [v @ evaluate(getattr(model, k), kappa * v, rate * v, at.u, []) for k in ("bias", "damping")]
        return [mass, *still, *moving, v @ evaluate(model.external_force, kappa * v, at.u, at.w, [])]

    assert projected(clothoid, ones) == pytest.approx(projected(arc, h), rel=1e-13)


def test_rest_curvature_does_not_depend_on_the_mesh():
    """At its rest shape a finger is free of force, where its elements can take that shape."""
    finger = FULL.model_copy(update={"rest_curvature": PiecewiseCurvature(breaks=(0.25,), values=(2.0, -1.0))})
    for lengths in ((0.25, 0.35), (0.1, 0.15, 0.15, 0.2)):
        model = FingerModel(finger, family="arc", elements=lengths)
        rest = [h * (2.0 if sum(lengths[:k]) < 0.24 else -1.0) for k, h in enumerate(lengths)]
        zero = np.zeros(len(lengths))
        assert evaluate(model.bending, zero, [0.0], []) == pytest.approx(rest, abs=1e-15)
        assert evaluate(model.elastic, zero, [0.0], []) == pytest.approx(zero, abs=1e-15)
        weightless = FingerModel(finger, family="arc", elements=lengths, gravity=(0.0, 0.0))
        assert float(weightless.energy([*zero, *zero], [0.0], [])[1]) == pytest.approx(0.0, abs=1e-15)


EXACT_BEAM = np.array([1.8751040687119611, 4.694091132974174]) ** 2


def frequencies(family: str, elements: int) -> np.ndarray:
    """Circular natural frequencies of the straight unit rod, clamped and free."""
    model = FingerModel(UNIT, family=family, elements=elements, gravity=(0.0, 0.0), tip_force=False)
    q, u = np.zeros(model.n), np.zeros(1)
    stiffness = derivative(model.elastic, [q, u, []], 0)
    mass = evaluate(model.mass_matrix, q, u, []).reshape(model.n, model.n)
    return np.sort(np.sqrt(np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real))


# Family, elements, errors of the first two frequencies [%] and the decimals to which they are known.
TABLE = [
    ("arc", 2, (5.08, 70.6), (2, 1)),
    ("clothoid", 1, (0.475, 58.0), (3, 0)),
    ("matched_clothoid", 2, (0.170, 1.11), (3, 2)),
    ("arc", 3, (2.20, 18.2), (2, 1)),
    ("clothoid", 2, (0.062, 0.97), (3, 2)),
    ("matched_clothoid", 3, (0.028, 0.92), (3, 2)),
    ("arc", 8, (0.30, 2.2), (2, 1)),
]


@pytest.mark.parametrize(("family", "elements", "expected", "decimals"), TABLE)
def test_natural_frequencies_of_a_clamped_rod(family, elements, expected, decimals):
    found = 100 * (frequencies(family, elements)[:2] / EXACT_BEAM - 1)
    # The first of two arcs, 5.0854, stands as 5.08.
    for value, stated, digits in zip(found, expected, decimals, strict=True):
        assert value == pytest.approx(stated, abs=0.6 * 10.0**-digits)


def test_the_stiffest_mode_of_two_unknowns():
    assert frequencies("matched_clothoid", 2)[-1] == pytest.approx(22.3, abs=0.05)
    assert frequencies("arc", 2)[-1] == pytest.approx(37.6, abs=0.05)


# Matched clothoids come down to 4 slowly: 4.47 here, 4.37 from 6 to 12 elements.
@pytest.mark.parametrize(
    ("family", "least", "most"), [("arc", 1.9, 2.1), ("clothoid", 3.9, 4.2), ("matched_clothoid", 3.9, 4.5)]
)
def test_order_of_convergence(family, least, most):
    errors = [frequencies(family, n)[0] / EXACT_BEAM[0] - 1 for n in (3, 6)]
    assert least <= math.log2(errors[0] / errors[1]) <= most


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
    for name in (n for n in FUNCTIONS if n not in slow):
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
    for name in FUNCTIONS:
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
    "unknown parameter": (FULL, {"parameters": ("tip_mas",)}, "unknown parameter 'tip_mas'; did you mean tip_mass"),
    "parameter of no use here": (FULL, {"parameters": ("tendon_offset",)}, "unknown parameter 'tendon_offset'"),
    "repeated parameter": (FULL, {"parameters": ("gravity", "gravity")}, "repeated"),
    "piecewise rest at run time": (FULL, {"parameters": ("rest_curvature",)}, "unknown parameter 'rest_curvature'"),
    "contact beyond": (FULL, {"contacts": (0.7,)}, r"between 0 and the length 0.6 m, got \[0.7\]"),
    "contact at the tip": (FULL, {"contacts": (0.6,)}, "between 0 and the length"),
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
    "rates for arcs": (FULL, {"family": "arc", "input_rates": True}, "needs family matched_clothoid"),
    "rates and lag": (LAGGED, {"family": "matched_clothoid", "input_rates": True}, "exclude each other"),
    "load beyond": (
        FULL,
        {"loads": (ForceLoad(at=0.61, force=(0.0, 0.0)),)},
        r"loads\[0\].at: 0.61 m is beyond the finger",
    ),
    "moment beyond": (FULL, {"loads": (MomentLoad(at=0.7, moment=0.0),)}, r"loads\[0\].at: 0.7 m is beyond the finger"),
    "no elements": (FULL, {"elements": 0}, "element"),
    "no lengths": (FULL, {"elements": ()}, "add up"),
    "a text as finger": (
        "x.yaml",
        {},
        "finger: expected a Scene or a Finger, got 'x.yaml'",
    ),
    "a rod as finger": (ROD, {}, "finger: expected a Scene or a Finger, got Rod"),
    "half an element": (
        FULL,
        {"elements": 2.5},
        "elements: expected a whole number or a list of numbers or None, got 2.5",
    ),
    "elements as a text": (FULL, {"elements": "2"}, "elements: expected a whole number or a list of numbers"),
    "elements as a truth": (FULL, {"elements": True}, "elements: expected a whole number or a list of numbers"),
    "very many elements": (FULL, {"elements": 10**9}, "elements: expected a number of elements from 1 to 128"),
    "very many lengths": (FULL, {"elements": [0.6 / 129] * 129}, "elements: expected the lengths of up to 128"),
    "a length of no number": (
        FULL,
        {"elements": [0.3, math.nan]},
        r"elements: expected .* a list of numbers or None, got \[0.3, nan",
    ),
    "a length next to nothing": (FULL, {"elements": [0.6, 1e-300]}, "elements: element lengths must be positive"),
    "one contact": (FULL, {"contacts": 0.3}, "contacts: expected a list of numbers or None, got 0.3"),
    "contact as a text": (FULL, {"contacts": ["a"]}, r"contacts: expected a list of numbers or None, got \['a'"),
    "contact that is not a number": (
        FULL,
        {"contacts": [math.nan]},
        r"contacts: expected a list of numbers or None, got \[nan",
    ),
    "contact next to the base": (FULL, {"contacts": [1e-300]}, "contacts: contacts must be 1e-06 of the length"),
    "a table of contacts": (FULL, {"contacts": np.zeros((2, 2))}, "contacts: expected a list of numbers"),
    "one number of gravity": (FULL, {"gravity": 9.81}, "gravity: expected a list of numbers or None, got 9.81"),
    "three numbers of gravity": (FULL, {"gravity": (0, 0, -9.81)}, "gravity: expected a list of 2 numbers, got 3"),
    "a number too long": (FULL, {"gravity": (0, 10**400)}, r"gravity: expected an array of numbers, got \(0, 1000"),
    "accuracy next to nothing": (FULL, {"accuracy": 1e-300}, "accuracy: expected a number from 1e-16 to 0.01"),
    "endless gravity": (FULL, {"gravity": (0, math.inf)}, r"gravity: expected a list of finite numbers, got \(0, inf"),
    "a number as load": (FULL, {"loads": [5]}, r"loads: expected a list of ForceLoad or MomentLoad or None, got \[5"),
    "one load": (FULL, {"loads": LOADS[0]}, "loads: expected a list of ForceLoad or MomentLoad or None, got Force"),
    "one name": (
        FULL,
        {"parameters": "gravity"},
        "parameters: expected a list of names or None, got 'gravity'",
    ),
    "a number as parameter": (FULL, {"parameters": [5]}, r"parameters: expected a list of names or None, got \[5"),
    "family of no word": (FULL, {"family": ["arc"]}, r"family: expected a text or None, got \['arc'"),
    "accuracy as a text": (FULL, {"accuracy": "high"}, "accuracy: expected a number or None, got 'high'"),
    "range as a text": (FULL, {"bending_range": "2"}, "bending_range: expected a number or None"),
    "range in degrees": (FULL, {"family": "arc", "bending_range": 120}, "bending_range: expected .* up to 20, got 120"),
    "tip force as a text": (FULL, {"tip_force": "no"}, "tip_force: expected True or False or None, got 'no'"),
    "rates as a number": (FULL, {"input_rates": 1}, "input_rates: expected True or False or None, got 1"),
    "range zero": (FULL, {"bending_range": 0.0}, "bending_range"),
    "range NaN": (FULL, {"bending_range": math.nan}, "bending_range"),
    "accuracy zero": (FULL, {"accuracy": 0.0}, "accuracy"),
    "accuracy negative": (FULL, {"accuracy": -1e-3}, "accuracy"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input_is_explained(name):
    finger, options, message = WRONG[name]
    with pytest.raises(InputError, match=message):
        FingerModel(finger, **options)


SCENE = Scene(finger=FULL, gravity=(0.0, -9.81))
IN_SCENE = {
    "parameter": ({"parameters": ("gravity", "tip_mas")}, {}, "parameters[1]", "did you mean tip_mass"),
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


@pytest.mark.parametrize("family", CURVED)
def test_jacobian_rate_through_the_straight_shape(family):
    case, model, at = full(family, accuracy=1e-13)
    assert jacobian_rate_error(case, model, State(0 * at.q, at.qd, at.u, at.w)) <= 2e-13
