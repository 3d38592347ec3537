"""Stages of exact rods in the plane: closed forms, order of convergence, elements, and SciPy with sharp friction."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipk, ellipkinc

import continuum_grasp as cg
from tests.marks import few
from tests.rod_stages import LENGTH, OFFSET, PAIR, ROD, STIFFNESS, Stages, finger
from tests.rods import order, without_compiler  # noqa: F401

SLIDING = {**PAIR, "friction": 0.3, "presliding": 1e-6}


def test_a_moment_bends_a_rod_to_a_circle():
    """Tendons alone, and a moment at the tip alone."""
    tension, kappa = 20.0, 20.0 * OFFSET * LENGTH / STIFFNESS
    expected = [(np.cos(kappa) - 1.0) / kappa, np.sin(kappa) / kappa, kappa]
    rod = Stages(finger())
    assert rod.at_rest((tension, 0.0))[-1, :3] == pytest.approx(expected, abs=1e-9)
    assert rod.at_rest((0.0, tension))[-1, :3] == pytest.approx(expected * np.array([-1, 1, -1]), abs=1e-9)
    assert rod.at_rest((0.0, 0.0), moment=tension * OFFSET)[-1, :3] == pytest.approx(expected, abs=1e-9)


def test_a_force_bends_a_rod_to_the_elastica():
    """A force of 2 E I / L^2 across the tip: sqrt(2) = K(k) - F(phi, k) in elliptic integrals (Bisshopp, Drucker)."""
    load = 2.0

    def length(k):
        return ellipk(k * k) - ellipkinc(np.arcsin(1.0 / (np.sqrt(2.0) * k)), k * k)

    k = brentq(lambda k: length(k) - np.sqrt(load), 0.71, 0.999999)
    # The slope at the tip of a cantilever: sin = 2 k^2 - 1.
    angle = np.arcsin(2.0 * k * k - 1.0)
    # x = sqrt(2 sin(angle) E I / P): the moment at the base over the force.
    reach = np.sqrt(2.0 * np.sin(angle) / load)
    tip = Stages(finger()).at_rest((0.0, 0.0), (-load * STIFFNESS / LENGTH**2, 0.0))[-1]
    assert tip[2] == pytest.approx(angle, abs=1e-8)
    assert tip[1] == pytest.approx(reach, abs=1e-8)


def test_its_error_falls_with_the_fourth_power_of_the_length_of_a_stage():
    """On pieces of jumping stiffness, tendons that end inside, friction, weight, softening and a force."""
    bent = finger(
        rod={"length": LENGTH, "sections": STEPS}, tendons=ENDING, softening={"curvature": 12.0, "stiffness_ratio": 0.5}
    )
    tips = []
    for count in (20, 40, 80, 320):  # of the same share on each piece
        rod = Stages(bent, count, gravity=(3.0, -9.0), substeps=1, rounding=0.3)
        tips.append(rod.at_rest((12.0, 1.0), (-0.2, 0.3))[-1])
    errors = [np.abs(tip - tips[-1]).max() for tip in tips[:-1]]
    assert np.all(order(errors) > 3.6)


STEPS = [
    {"to": 0.08, "bending_stiffness": STIFFNESS, "linear_density": 0.1},
    {"to": 0.14, "bending_stiffness": 0.02, "linear_density": 0.3, "rest_curvature": 4.0},
    {"to": LENGTH, "bending_stiffness": 0.03, "linear_density": 0.05},
]
ENDING = [
    {"offset": OFFSET, "max_tension": 60.0, "friction": 0.2, "presliding": 4e-4},
    {"offset": [-0.008, -0.004], "max_tension": 60.0, "to": 0.15, "friction": 0.1, "presliding": 8e-4},
]


def test_jumps_at_the_ends_of_pieces_are_exact():
    """Arcs of constant curvature, one after the other, by complex numbers."""
    tendons = [{"offset": OFFSET, "max_tension": 60.0}, {"offset": -0.008, "max_tension": 60.0, "to": 0.11}]
    rod = Stages(finger(rod={"length": LENGTH, "sections": STEPS}, tendons=tendons), 24)
    assert np.array(rod.section.places) * LENGTH == pytest.approx([0.0, 0.08, 0.11, 0.14, LENGTH], abs=1e-12)
    place, angle = 0.0j, 0.0
    for a, b, stiffness, rest, moment in (
        (0.0, 0.08, STIFFNESS, 0.0, 30.0 * OFFSET - 10.0 * 0.008),
        (0.08, 0.11, 0.02, 4.0, 30.0 * OFFSET - 10.0 * 0.008),
        (0.11, 0.14, 0.02, 4.0, 30.0 * OFFSET),
        (0.14, LENGTH, 0.03, 0.0, 30.0 * OFFSET),
    ):
        kappa = rest + moment / stiffness
        place += 1j * np.exp(1j * angle) * (np.exp(1j * kappa * (b - a)) - 1.0) / (1j * kappa)
        angle += kappa * (b - a)
    tip = rod.at_rest((30.0, 10.0))[-1]
    assert tip[2] == pytest.approx(angle, rel=1e-13)
    assert tip[:2] * LENGTH == pytest.approx([place.real, place.imag], abs=1e-9)


@pytest.mark.parametrize("kappa", [2.0, -2.0])
def test_a_tendon_that_slides_all_along_obeys_the_capstan_law(kappa):
    """T = T0 exp(-mu bend) on a rod that it alone bends: exp(mu bend) = 1 + mu k0 s, from either side."""
    mu, side = 0.3, np.sign(kappa)
    rod = Stages(finger(tendons=SLIDING))
    tensions = [abs(kappa) * STIFFNESS / LENGTH / OFFSET, 0.0][:: int(side)]
    # A history in which friction is full in the direction in which the tendon slid.
    states = rod.at_rest(tensions, history=[0.0, side])
    s = np.append(0.0, [end for _, end, _ in rod.ends])
    bend = np.log(1.0 + mu * abs(kappa) * s) / mu
    assert states[:, 2] == pytest.approx(side * bend, abs=1e-6)
    assert states[:, 4] == pytest.approx(side * mu * bend, abs=1e-6)
    # Pulled: the same but for the last part, in which it has not slid by its presliding.
    assert rod.at_rest(tensions)[:, 2] == pytest.approx(side * bend, abs=1e-4)


def test_the_sheath_before_the_finger_takes_its_share():
    mu, bend, tension = 0.3, 2.0, 20.0
    free, held = (Stages(finger(tendons={**SLIDING, **more})) for more in ({}, {"conduit_bend": bend}))
    less = free.at_rest((tension * np.exp(-mu * bend), 0.0))
    states = held.at_rest((tension, 0.0))
    assert states[:, :3] == pytest.approx(less[:, :3], abs=1e-9)
    assert states[0, 4] == pytest.approx(mu * bend, abs=1e-12)


def test_weight_and_point_masses_are_in_balance():
    """The moment at the base is that of all weights about it; the tip, 40 mm lower, hangs by the linear theory."""
    masses = [{"at": 0.07, "mass": 0.03}, {"at": 0.12, "mass": 0.01}, {"at": LENGTH, "mass": 0.005}]
    rod = Stages(finger(masses=masses), 240, gravity=(-9.81, 2.0))
    states = rod.at_rest((8.0, 0.0))
    s = np.append(0.0, [end for _, end, _ in rod.ends]) * LENGTH
    x, y = states[:, :2].T * LENGTH
    weights = [(float(np.interp(m["at"], s, x)), float(np.interp(m["at"], s, y)), m["mass"]) for m in masses]
    spread = [0.5 * np.sum((v[1:] + v[:-1]) * np.diff(s)) * ROD["linear_density"] for v in (x, y)]
    mx = spread[0] + sum(a * m for a, _, m in weights)
    my = spread[1] + sum(b * m for _, b, m in weights)
    assert states[0, 3] * rod.section.moment == pytest.approx(mx * 2.0 + my * 9.81, rel=1e-4)
    assert rod.section.mass * rod.section.force == pytest.approx(ROD["linear_density"] * LENGTH + 0.045, rel=1e-12)


def test_a_slight_weight_bends_by_the_linear_theory():
    light = Stages(finger(), gravity=(1e-3, 0.0)).at_rest((0.0, 0.0))[-1]
    assert light[0] * LENGTH == pytest.approx(0.1 * 1e-3 * LENGTH**4 / (8.0 * STIFFNESS), rel=1e-6)


# -- elements ---------------------------------------------------------------------------------------------------------


def loaded(of, inputs, force, gravity, family, elements):
    """The tip [m] of a finger of elements at rest."""
    keys = of.input_keys
    scene = {
        "finger": of.model_dump(exclude_unset=True),
        "gravity": gravity,
        "fidelity": {"family": family, "elements": elements},
        "initial": {"pose": "equilibrium", **({"reached_by": "pulling"} if of.has_friction else {})},
        "actuation": {
            key: [float(v) for v, known in zip(inputs, keys, strict=True) if known == key]
            for key in dict.fromkeys(keys)
        },
        "loads": [{"kind": "force", "at": of.rod.length, "force": list(force)}],
    }
    return cg.equilibrium(cg.Scene.model_validate(scene)).tip


def shipped(path, **changes):
    of = cg.load(path)
    of = getattr(of, "finger", of)
    known = {name: value for name, value in of.model_dump(exclude_unset=True).items() if name in cg.Finger.model_fields}
    return cg.Finger.model_validate({**known, "base": {}, **changes})


FRICTION = {"offset": 0.005, "max_tension": 70.0, "friction": 0.1}
DRY = {"dry_friction": [{"stiffness": 0.02, "moment": 0.01}, {"stiffness": 0.01, "moment": 0.02}]}
STOPPED = {"stiffness_ratio": 20.0}
CHAMBERS = [
    {"area": 8e-5, "offset": -0.006, "max_pressure": 1e5, "start": 0.03, "stiffness_share": 0.2},
    {"area": 8e-5, "offset": 0.006, "max_pressure": 1e5, "to": 0.11},
]
AGREEING = {
    "hand": ("configs/fingers/hand_finger.yaml", {"masses": [{"at": 0.07, "mass": 0.01}]}, (15.0, 1.0), (-0.1, 0.05)),
    "dry": (
        "configs/fingers/hand_finger.yaml",
        {"masses": [], "tendons": FRICTION, "damping": DRY},
        (30.0, 0.0),
        (-0.5, 0.3),
    ),
    "preshaped": (
        "configs/fingers/hand_finger.yaml",
        {"masses": [], "tendons": FRICTION, "rest_curvature": {"breaks": [0.1], "values": [-6.0, 5.0]}},
        (12.0, 0.0),
        (-0.3, 0.2),
    ),
    "chambers": (
        "configs/fingers/hand_finger.yaml",
        {"masses": [], "tendons": {**FRICTION, "conduit_bend": 1.0}, "pressure": CHAMBERS},
        (10.0, 3.0, 4e4, 7e4),
        (-0.1, 0.1),
    ),
    "sets": (
        "configs/fingers/hand_finger.yaml",
        {"masses": [], "tendons": ENDING, "softening": {"curvature": 6.0, "stiffness_ratio": 0.4}},
        (14.0, 5.0),
        (-0.1, 0.1),
    ),
    "spirob": ("configs/grasp/spirob_cup.yaml", {}, (12.0, 0.0), (-0.3, 0.2)),
    "stops": ("configs/grasp/spirob_cup.yaml", {"stops": STOPPED}, (25.0, 0.0), (-0.3, 0.2)),
}


@pytest.mark.usefixtures("without_compiler")
@pytest.mark.parametrize("name", few(list(AGREEING), 2))
def test_they_agree_with_elements(name):
    """Sixteen clothoids, or arcs where a tendon ends inside."""
    path, changes, inputs, force = AGREEING[name]
    of = shipped(path, **changes)
    gravity = (0.0, 0.0) if of.rod.graded else (0.0, -9.81)
    tip = Stages(of, 48, gravity=gravity).at_rest(inputs, force)[-1, :2]
    # Where a tendon ends the curvature jumps, which clothoids do not.
    family, elements = ("arc", [0.005] * 36) if name == "sets" else ("clothoid", 16)
    fine = loaded(of, inputs, force, gravity, family, elements) / of.rod.length
    assert fine == pytest.approx(tip, abs=3e-5)


@pytest.mark.usefixtures("without_compiler")
def test_the_notched_wrist_agrees_with_arcs():
    """Ten pieces, softening, one-sided stops, and friction: jumps of stiffness and rest curvature."""
    wrist = cg.load("configs/identify/notched_wrist.yaml").finger
    tendons = {**wrist.tendons.model_dump(exclude_unset=True), "friction": 0.15}
    of = shipped("configs/identify/notched_wrist.yaml", tendons=tendons)
    rod = Stages(of, 20)
    assert len(rod.section.pieces) == 10
    inputs = (3.0, 0.0)
    tip = rod.at_rest(inputs, (0.1, -0.05))[-1, :2]
    lengths = [v / 2.0 for a, b in pairwise(rod.section.places) for v in [(b - a) * of.rod.length] * 2]
    assert loaded(of, inputs, (0.1, -0.05), (0.0, 0.0), "arc", lengths) / of.rod.length == pytest.approx(tip, abs=3e-5)


# -- SciPy -----------------------------------------------------------------------------------------------------------


def test_it_is_the_rod_of_scipy_with_sharp_friction():
    """Two sets of tendons, dry friction, softening, weight, a point mass: everything written again, from the base."""
    branches = [(0.02, 0.03), (0.01, 0.06)]
    of = finger(
        tendons=ENDING,
        masses=[{"at": 0.1, "mass": 0.02}],
        rest_curvature=2.0,
        softening={"curvature": 6.0, "stiffness_ratio": 0.4, "rounding": 0.2},
        damping={"dry_friction": [{"stiffness": k, "moment": m} for k, m in branches]},
    )
    gravity, force, tensions = (3.0, -9.81), (-0.3, 0.2), (25.0, 6.0)
    rod = Stages(of, 200, gravity=gravity)
    states = rod.at_rest(tensions, force)

    def resisting(k):
        moment = STIFFNESS * k
        for sign in (1.0, -1.0):
            y, e = sign * k - 6.0, 0.2 * 6.0
            root = np.hypot(y, e)
            moment += sign * STIFFNESS * (0.4 - 1.0) * (0.5 * (y + root)) ** 2 / root
        return moment + sum(m * np.clip(b / m * k, -1.0, 1.0) for b, m in branches)

    slope = 4e-3 / 0.15
    cosine = 1.0 / np.hypot(1.0, slope)

    def shapes(s):
        return np.array([OFFSET, cosine * (0.008 - slope * s) if s < 0.15 else 0.0])

    def rate(s, q):
        angle, moment, losses, slides = q[2], q[3], q[4:6], q[6:8]
        arms = shapes(s)
        load = moment + tensions[0] * arms[0] * np.exp(-losses[0]) - tensions[1] * arms[1] * np.exp(losses[1])
        bend = brentq(lambda k: resisting(k) - load, -1e4, 1e4, xtol=1e-13)
        kappa = bend + 2.0
        beyond = 0.1 * (LENGTH - s) + (0.02 if s < 0.1 else 0.0)
        fx, fy = force[0] + beyond * gravity[0], force[1] + beyond * gravity[1]
        ways = np.clip(slides / [4e-4, 8e-4], -1.0, 1.0)
        ways = 0.5 * ways * (3.0 - ways**2)
        return [
            -np.sin(angle),
            np.cos(angle),
            kappa,
            np.sin(angle) * fy + np.cos(angle) * fx,
            *(np.array([0.2, 0.1]) * ways * abs(kappa)),
            *(-arms * bend),
        ]

    # In meters and newtons; a slide is one of length.
    base = np.array([0.0, 0.0, 0.0, states[0, 3] * rod.section.moment, 0.0, 0.0])
    arms = shapes(0.0)
    slides = states[0, rod.slides] * arms
    q = np.append(base, slides)
    for a, b in ((0.0, 0.1), (0.1, 0.15), (0.15, LENGTH)):
        q = solve_ivp(rate, (a, b - 1e-12), q, rtol=1e-8, atol=1e-10, max_step=0.01).y[:, -1]
    assert q[:2] / LENGTH == pytest.approx(states[-1, :2], abs=3e-6)
    assert q[2] == pytest.approx(states[-1, 2], abs=1e-5)
    assert q[3] == pytest.approx(0.0, abs=1e-6)
    assert q[6:] == pytest.approx([0.0, 0.0], abs=1e-7)


def test_histories_may_change_along_the_finger():
    """Friction of tendons and of bending in given directions on quarters of it: there SciPy needs no history."""
    ways, branches, (k, m) = [1.0, -1.0, -1.0, 1.0], [-1.0, 1.0, -1.0, -1.0], (0.02, 0.05)
    mu, tension, force = 0.3, 30.0, (-1.2, 0.8)
    of = finger(tendons={**PAIR, "friction": mu}, damping={"dry_friction": [{"stiffness": k, "moment": m}]})
    rod = Stages(of, 40)
    quarters = [min(int(2.0 * (a + b)), 3) for a, b, _ in rod.ends]
    history = [[0.0, ways[quarter], branches[quarter]] for quarter in quarters]
    states = rod.at_rest((tension, 0.0), force, history=history)
    q = np.array([0.0, 0.0, 0.0, states[0, 3] * rod.section.moment, 0.0])
    for quarter in range(4):

        def rate(_, q, quarter=quarter):
            load = q[3] + tension * OFFSET * np.exp(-q[4])
            kappa = (load - m * branches[quarter]) / STIFFNESS
            bent = np.sin(q[2]) * force[1] + np.cos(q[2]) * force[0]
            return [-np.sin(q[2]), np.cos(q[2]), kappa, bent, mu * ways[quarter] * abs(kappa)]

        span = quarter * LENGTH / 4.0, (quarter + 1) * LENGTH / 4.0
        q = solve_ivp(rate, span, q, rtol=1e-9, atol=1e-11, max_step=0.002).y[:, -1]
    assert q[:2] / LENGTH == pytest.approx(states[-1, :2], abs=1e-6)
    assert q[3] == pytest.approx(0.0, abs=1e-7)


# -- symmetry, derivatives -------------------------------------------------------------------------------------------


def test_a_mirrored_finger_has_mirrored_states():
    keys = {
        "rod": {"length": LENGTH, "sections": STEPS},
        "stops": {"curvature": 15.0, "stiffness_ratio": 30.0, "side": "left"},
        "damping": DRY,
    }
    mirrored = {
        "rod": {
            "length": LENGTH,
            "sections": [{**step, "rest_curvature": -step.get("rest_curvature", 0.0)} for step in STEPS],
        },
        "stops": {**keys["stops"], "side": "right"},
        "damping": DRY,
    }
    others = [{**tendon, "offset": (-np.array(tendon["offset"])).tolist()} for tendon in ENDING]
    left = Stages(finger(tendons=ENDING, **keys), gravity=(2.0, -9.81)).at_rest((20.0, 3.0), (-0.2, 0.1))
    right = Stages(finger(tendons=others, **mirrored), gravity=(-2.0, -9.81)).at_rest((20.0, 3.0), (0.2, 0.1))
    signs = np.array([-1.0, 1.0, -1.0, -1.0, *[-1.0] * 4])
    assert right == pytest.approx(left * signs, abs=1e-9)


def test_its_derivatives_are_those_of_differences():
    """First and second ones of a stage with laws, whose Newton steps before the last two have none."""
    of = finger(
        tendons=ENDING,
        softening={"curvature": 6.0, "stiffness_ratio": 0.4},
        stops={"curvature": 9.0, "stiffness_ratio": 30.0},
        damping=DRY,
    )
    rod = Stages(of, rounding=0.05)
    z = ca.SX.sym("z", len(rod.names) + 6)
    n = len(rod.names)
    numbers = rod.section.numbers(0)
    given = [z[:n], z[n : n + 2], z[n + 2 : n + 4], z[n + 4], z[n + 5], [0.0, 0.0], [], rod.section.pulled, numbers]
    after = rod.stage(*[ca.SX(each) if not isinstance(each, ca.SX) else each for each in map(ca.SX, given)])
    weights = np.random.default_rng(1).standard_normal(n)
    scalar = ca.dot(ca.DM(weights), after)
    hessian, gradient = ca.hessian(scalar, z)
    value, slope, curved = (ca.Function("f", [z], [each]) for each in (scalar, gradient, hessian))
    rng = np.random.default_rng(2)
    for _ in range(4):
        at = np.concatenate([0.3 * rng.standard_normal(n), rng.standard_normal(2), rng.uniform(0, 3, 2), [0.1, 0.16]])
        step = 1e-5
        differences = np.array(
            [float(value(at + step * e) - value(at - step * e)) / (2 * step) for e in np.eye(len(at))]
        )
        assert np.array(slope(at)).ravel() == pytest.approx(differences, abs=1e-6 * np.abs(differences).max())
        seconds = np.array([np.array(slope(at + step * e) - slope(at - step * e)).ravel() for e in np.eye(len(at))])
        exact = np.array(curved(at))
        assert exact == pytest.approx(seconds / (2 * step), abs=1e-4 * np.abs(exact).max())


@pytest.mark.parametrize("rounding", few([0.05, 0.0], 1))
def test_stages_are_rows_of_a_nonlinear_problem(rounding):
    """IPOPT finds the least tensions that move the tip, from a straight finger, with all laws and friction at once."""
    laws = {
        "softening": {"curvature": 6.0, "stiffness_ratio": 0.4},
        "stops": {"curvature": 9.0, "stiffness_ratio": 30.0},
    }
    rod = Stages(finger(tendons=ENDING, damping=DRY, **laws), 8, rounding=rounding, gravity=(0.0, -9.81), substeps=2)
    section, size, count = rod.section, len(rod.names), len(rod.ends)
    states, pulls = ca.MX.sym("states", size, count + 1), ca.MX.sym("pulls", 2)
    force = np.array(rod.gravity) * section.mass
    given = [(a, b, rod.gravity, [], section.pulled, section.numbers(piece)) for a, b, piece in rod.ends]
    rows = [rod.stage(states[:, k], force, pulls, *each) - states[:, k + 1] for k, each in enumerate(given)]
    low, high = np.full((size, count + 1), -np.inf), np.full((size, count + 1), np.inf)
    ends = [(slice(3), 0, 0.0), (rod.losses, 0, 0.0), (3, -1, 0.0), (rod.slides, -1, 0.0), (0, -1, -0.5)]
    for row, column, value in ends:
        low[row, column] = high[row, column] = value
    problem = {"x": ca.vertcat(ca.vec(states), pulls), "f": ca.sumsqr(pulls), "g": ca.vertcat(*rows)}
    options = {"ipopt.print_level": 0, "print_time": False, "ipopt.sb": "yes", "ipopt.mu_init": 1e-5}
    solver = ca.nlpsol("least", "ipopt", problem, options)
    straight = np.zeros((size, count + 1))
    straight[1, 1:] = [end for _, end, _ in rod.ends]
    bounds = {"lbx": np.append(low.ravel("F"), [0.0, 0.0]), "ubx": np.append(high.ravel("F"), [50.0, 50.0])}
    found = np.array(solver(x0=np.append(straight.ravel("F"), [1.0, 1.0]), lbg=0.0, ubg=0.0, **bounds)["x"]).ravel()
    assert solver.stats()["success"]
    assert solver.stats()["iter_count"] < 20
    tensions = [pull.value(p) for pull, p in zip(section.pulls, found[-2:], strict=True)]
    assert rod.at_rest(tensions)[-1, 0] == pytest.approx(-0.5, abs=1e-6)
    assert tensions[1] == pytest.approx(0.0, abs=1e-3)
