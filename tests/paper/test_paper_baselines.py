"""The baselines of the benchmarks against the high-precision twin; the paper's errata to their digits."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np
import pytest

from benchmarks.baselines import paper_appendix, paper_closed_forms, peers
from benchmarks.baselines.two_arcs import TwoArcs, forward_dynamics
from benchmarks.paper import Terms
from tests.truth import Rod, TruthFinger, to_numpy

FULL = TwoArcs(
    element_lengths=(0.25, 0.35),
    rest_angles=(0.1, -0.2),
    tip_mass=0.02,
    contact_mass=0.01,
    gravity=(1.0, -9.81),
    base_angle=-0.6,
    arc_damping=1e-4,
    material_damping=3e-5,
)
EQUAL = TwoArcs(element_lengths=(0.3, 0.3), mass_per_length=1.0, gravity=(0.0, -1.0))
RATE, U, W = (2.0, -3.0), (3.0, 1.0), (0.1, 0.2, -0.3, 0.4)


def twin(finger: TwoArcs, theta, rate=None, nodes=40) -> Rod:
    l1, l2 = finger.element_lengths
    pieces = ((0, l1, finger.rest_angles[0] / l1), (l1, l1 + l2, finger.rest_angles[1] / l2))
    rod = TruthFinger(
        [l1, l2],
        mass_per_length=finger.mass_per_length,
        rotary_inertia=finger.rotary_inertia,
        bending_stiffness=finger.bending_stiffness,
        rest_curvature=pieces,
        masses=((l1, finger.contact_mass), (l1 + l2, finger.tip_mass)),
        gravity=finger.gravity,
        base_angle=finger.base_angle,
        material_damping=finger.material_damping,
        element_damping=finger.arc_damping,
    )
    return Rod(rod, theta, rate, nodes=nodes)


def acceleration(finger: TwoArcs, theta) -> np.ndarray:
    l1, l2 = finger.element_lengths
    forces = [(l1, *W[:2]), (l1 + l2, *W[2:])]
    tau = (U[0] - U[1]) * finger.tendon_offset
    return to_numpy(twin(finger, theta, RATE).acceleration(forces, tau))


def relative(found, expected) -> float:
    return float(np.abs(np.asarray(found) - expected).max() / np.abs(expected).max())


def evaluate(module, finger: TwoArcs, theta, rate=(0.0, 0.0), **options) -> Terms:
    t, td = ca.SX.sym("t", 2), ca.SX.sym("td", 2)
    function = ca.Function("terms", [t, td], list(module.terms(finger, t, td, **options)))
    return Terms(*(np.array(value) for value in function(theta, rate)))


@pytest.mark.parametrize("bias", ["lagrange", "christoffel"])
@pytest.mark.parametrize("theta", [(0.9, -1.2), (0.4, 0.5), (-2.0, 1.7)])
def test_closed_forms_are_the_exact_model(theta, bias):
    finger = replace(FULL, rotary_inertia=1e-7)
    xd = paper_closed_forms.forward_dynamics(finger, bias=bias)([*theta, *RATE], U, W, []).full()[:, 0]
    assert relative(xd[2:], acceleration(finger, theta)) < 1e-11
    part = evaluate(paper_closed_forms, finger, theta, RATE, bias=bias)
    rod = twin(finger, theta, RATE)
    assert relative(part.mass, to_numpy(rod.mass)) < 1e-12
    assert relative(part.bias[:, 0], to_numpy(rod.bias)) < 1e-11
    assert relative(part.gravity[:, 0], to_numpy(rod.gravity)) < 1e-12


def test_closed_forms_lose_their_digits_near_a_straight_finger():
    """What the guard costs, and why the paper needs its appendix."""
    straight = acceleration(FULL, (0.0, 0.0))
    xd = paper_closed_forms.forward_dynamics(FULL)([0, 0, *RATE], U, W, []).full()[:, 0]
    assert 1e-5 < relative(xd[2:], straight) < 1e-2
    bare = evaluate(paper_closed_forms, EQUAL, (1e-4, 1e-4), guard=0)
    assert relative(bare.mass, to_numpy(twin(EQUAL, (1e-4, 1e-4)).mass)) > 1e-2


CORNER = 2 * np.pi / 3
# Documented truncation: largest angle, then M, V, G along Y, G along X, J_c, J_t. The rows called 0.3, 0.5
# and 1.0 in the errata hold for the largest multiple of pi / 30 below these: points of a grid of 41 over the
# whole range.
TRUNCATION = [
    (CORNER * 2 / 20, 4e-8, 3e-8, 1e-7, 5e-7, 3e-8, 1e-6),
    (CORNER * 4 / 20, 3e-6, 2e-6, 7e-6, 3e-5, 2e-6, 9e-5),
    (CORNER * 9 / 20, 3e-4, 3e-4, 1e-3, 4e-3, 2e-4, 1.1e-2),
    (CORNER, 3.7e-2, 5.4e-2, 0.20, 0.38, 2.8e-2, 1.13),
]
# The same at the named angles themselves.
NAMED = [
    (0.3, 3.6e-7, 2.9e-7, 9.6e-7, 3.9e-6, 2.5e-7, 1.2e-5),
    (0.5, 7.7e-6, 6.4e-6, 2.1e-5, 8.4e-5, 5.4e-6, 2.6e-4),
    (1.0, 4.8e-4, 4.5e-4, 1.6e-3, 5.2e-3, 3.4e-4, 1.6e-2),
]


@lru_cache
def exact(largest: float):
    """M, V coefficients, G_Y, G_X, J_c, J_t of the twin over the square, per mass per length and g."""
    # Each entry is even or odd in the pair of angles, so half the square is enough.
    points = 10 if largest == CORNER else 4
    rows = []
    for i in range(points + 1):
        for j in range(-points, points + 1):
            theta = (largest * i / points, largest * j / points)
            first = twin(EQUAL, theta, (1, 0), 14)
            second = twin(replace(EQUAL, gravity=(1.0, 0.0)), theta, (0, 1), 14)
            v1, v3, v = (to_numpy(r.bias) for r in (first, second, twin(EQUAL, theta, (1, 1), 14)))
            values = {
                "M": to_numpy(first.mass),
                "V": np.array([v1, v - v1 - v3, v3]),
                "GY": to_numpy(first.gravity),
                "GX": to_numpy(second.gravity),
                "Jc": to_numpy(first.jacobian(0.3)),
                "Jt": to_numpy(first.jacobian(0.6)),
            }
            rows.append((theta, values))
    return rows


@lru_cache
def appendix(largest: float, printed: bool):
    """The same by the appendix's polynomials."""
    t, td = ca.SX.sym("t", 2), ca.SX.sym("td", 2)
    along = paper_appendix.terms(EQUAL, t, td, printed=printed)
    across = paper_appendix.terms(replace(EQUAL, gravity=(1.0, 0.0)), t, td, printed=printed)
    f = ca.Function(
        "f",
        [t, td],
        [along.mass, along.bias, along.gravity, across.gravity, *along[3:]],
        {"allow_free": True},
    )
    rows = []
    for theta, _ in exact(largest):
        m, v1, gy, gx, jc, jt = (np.array(value) for value in f(theta, (1, 0)))
        v3, v = (np.array(f(theta, rate)[1]) for rate in ((0, 1), (1, 1)))
        bias = np.array([v1, v - v1 - v3, v3])[:, :, 0]
        rows.append({"M": m, "V": bias, "GY": gy[:, 0], "GX": gx[:, 0], "Jc": jc, "Jt": jt})
    return rows


def effect(largest: float, printed: bool, group: str, index=...) -> float:
    """Largest error over the square divided by the largest exact value, of a group or one of its entries."""
    wanted = np.array([values[group][index] for _, values in exact(largest)])
    found = np.array([values[group][index] for values in appendix(largest, printed)])
    return relative(found, wanted)


@pytest.mark.parametrize(("row", "tolerance"), [*((r, 0.45) for r in TRUNCATION), *((r, 0.03) for r in NAMED)])
def test_corrected_appendix_errs_by_its_documented_truncation(row, tolerance):
    for group, documented in zip(("M", "V", "GY", "GX", "Jc", "Jt"), row[1:], strict=True):
        assert effect(row[0], False, group) == pytest.approx(documented, rel=tolerance), group


@pytest.mark.parametrize(
    ("group", "index", "percent"),
    [
        ("M", (0, 0), 41),
        ("M", (0, 1), 78),
        ("V", (0, 0), 165),
        ("V", (1, 0), 127),
        ("V", (2, 0), 99),
        ("V", (0, 1), 202),
        ("GY", (0,), 204),
    ],
)
def test_printed_appendix_errs_as_the_errata_say(group, index, percent):
    assert 100 * effect(CORNER, True, group, index) == pytest.approx(percent, abs=0.6)


def test_printed_mass_matrix_is_indefinite_on_a_third_of_the_square():
    side = np.linspace(-2 * np.pi / 3, 2 * np.pi / 3, 101)
    t, td = ca.SX.sym("t", 2), ca.SX.sym("td", 2)
    mass = paper_appendix.terms(EQUAL, t, td, printed=True).mass
    determinant = ca.Function("d", [t], [mass[0, 0] * mass[1, 1] - mass[0, 1] ** 2]).map(side.size**2)
    points = np.array([(a, b) for a in side for b in side])
    values = np.array(determinant(points.T))[0]
    assert round(100 * float((values < 0).mean())) == pytest.approx(32, abs=1)
    assert np.abs(points[values < 0]).max(axis=1).min() == pytest.approx(1.17, abs=0.04)


@pytest.mark.parametrize(("theta", "tolerance"), [((0.0, 0.0), 1e-13), ((0.1, -0.1), 1e-7), ((0.4, -0.5), 5e-5)])
def test_corrected_appendix_moves_the_finger_with_masses_and_forces(theta, tolerance):
    xd = paper_appendix.forward_dynamics(FULL)([*theta, *RATE], U, W, []).full()[:, 0]
    assert xd[:2].tolist() == list(RATE)
    assert relative(xd[2:], acceleration(FULL, theta)) < tolerance


@pytest.mark.parametrize("module", [paper_appendix, paper_closed_forms])
def test_terms_and_forward_dynamics_agree(module):
    """The compact right-hand side of the benchmarked function is the one of the separate terms."""
    theta = (0.5, -0.8)
    part = evaluate(module, FULL, theta, RATE)

    def assembled(finger, t, rate, at_contact, at_tip):
        terms = module.terms(finger, t, rate)
        force = terms.contact_jacobian.T @ at_contact + terms.tip_jacobian.T @ at_tip
        return terms.mass, force - terms.bias - terms.gravity

    separate = forward_dynamics("separate", FULL, assembled)([*theta, *RATE], U, W, []).full()
    assert relative(module.forward_dynamics(FULL)([*theta, *RATE], U, W, []).full(), separate) < 1e-12
    assert part.contact_jacobian[:, 1].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("module", [paper_appendix, paper_closed_forms])
def test_run_time_parameters_are_the_folded_constants(module):
    names = (
        "mass_per_length",
        "bending_stiffness",
        "tip_mass",
        "element_lengths",
        "gravity",
        "tendon_offset",
    )
    values = []
    for name in names:
        values.extend(np.atleast_1d(getattr(FULL, name)))
    state = [0.5, -0.8, *RATE]
    folded = module.forward_dynamics(FULL)(state, U, W, []).full()
    assert relative(module.forward_dynamics(FULL, names)(state, U, W, values).full(), folded) < 1e-11
    with pytest.raises(ValueError, match="unknown parameter"):
        module.forward_dynamics(FULL, ("tip_weight",))


def test_absent_peers_are_reported_as_absent(monkeypatch):
    monkeypatch.delenv(peers.VARIABLE, raising=False)
    assert peers.measure("soromox")["status"] == "not installed"
    assert peers.measure("jsrm", "/nowhere/python")["status"] == "not installed"
    if "jsrm" not in sys.modules:
        assert peers.measure("jsrm", sys.executable)["status"] == "not installed"


@pytest.mark.skipif(not os.environ.get(peers.VARIABLE), reason="no interpreter with the peer libraries")
@pytest.mark.parametrize("forces", [False, True])
@pytest.mark.parametrize("library", peers.LIBRARIES)
def test_peers_compute_the_same_rod(library, forces):
    result = peers.measure(library, steps=10, repeats=1, forces=forces)
    assert result["status"] == "ok", result
    rod = peers.PeerRod()
    inertia = rod.density * np.pi * rod.diameter**4 / 64
    finger = TwoArcs(arc_damping=rod.arc_damping, base_angle=-np.pi / 2, rotary_inertia=inertia)
    applied = [(0.3, *rod.forces[0]), (0.6, *rod.forces[1])] if forces else []
    expected = to_numpy(twin(finger, rod.state[:2], rod.state[2:]).acceleration(applied, rod.tip_moment))
    # SoRoMoX integrates with five nodes per segment.
    assert relative(np.array(result["xd"][2:]), expected) < 1e-6
