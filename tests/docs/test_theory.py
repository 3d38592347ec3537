"""The numbered formulas of theory.md, by numpy, against the functions of the finger model."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.model import stumpff

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/theory.md").read_text(encoding="utf-8")

HERE = {
    5: "test_stumpff_functions_obey_their_recursion_and_derivative",
    6: "test_the_table_of_an_arc",
    7: "test_the_table_of_an_arc",
    8: "test_the_table_of_an_arc",
    9: "test_the_table_of_an_arc",
    10: "test_the_table_of_an_arc",
    16: "test_one_arc_in_closed_form",
    17: "test_kinetic_energy_is_a_double_sum_over_the_nodes",
}
"""Test of each formula in this file."""
ELSEWHERE = {
    1: "tests/model/test_model_truth.py::test_the_full_finger_is_exact",
    2: "tests/model/test_model_truth.py::test_the_full_finger_is_exact",
    3: "tests/model/test_model_truth.py::test_rates_of_the_input_move_a_matched_tip",
    4: "tests/model/test_model_truth.py::test_stumpff_functions_are_exact_relative_to_their_size",
    11: "tests/model/test_model_truth.py::test_the_full_finger_is_exact",
    12: "tests/model/test_model_truth.py::test_the_full_finger_is_exact",
    13: "tests/model/test_model_structure.py::test_the_equation_of_motion_is_the_sum_of_its_terms",
    14: "tests/model/test_model_truth.py::test_the_full_finger_is_exact",
    15: "tests/model/test_model_truth.py::test_the_full_finger_is_exact",
    18: "tests/model/test_model_truth.py::test_tendons",
    19: "tests/model/test_model_truth.py::test_the_tendons_time_constant_is_a_critically_damped_lag",
    20: "tests/model/test_model_truth.py::test_tendon_friction_follows_the_capstan_law",
    21: "tests/model/test_model_truth.py::test_rates_of_the_input_move_a_matched_tip",
    22: "tests/model/test_model_truth.py::test_rates_of_the_input_move_a_matched_tip",
    23: "tests/model/test_contact_law.py::test_the_normal_force_has_its_closed_form",
    24: "tests/model/test_contact_law.py::test_friction_stays_within_the_cone",
    25: "tests/simulation/test_statics.py::test_the_path_leaves_the_straight_one_where_it_buckles",
    26: "tests/simulation/test_statics.py::test_critical_loads_are_bounded_from_above",
    27: "tests/simulation/test_modes.py::test_material_damping_gives_its_ratio",
    28: "tests/core/test_core.py::test_methods_have_the_order_of_their_table",
    29: "tests/core/test_implicit_midpoint.py",
}
"""Test of each formula in another file."""

ROD = {"length": 0.6, "linear_density": 0.8, "bending_stiffness": 0.5}
ETA = 0.01
NODES, WEIGHTS = (0.5 * (a + b) for a, b in zip(np.polynomial.legendre.leggauss(40), (1.0, 0.0), strict=True))


def finger(family: str, elements: int, **keys) -> cg.FingerModel:
    made = cg.Finger.model_validate({"rod": ROD, "damping": {"material": ETA}})
    given = {"gravity": (0.0, 0.0), "tip_force": False, "bending_range": 4.0, "accuracy": 1e-13, **keys}
    return cg.FingerModel(made, family=family, elements=elements, **given)


def values(function, *inputs) -> np.ndarray:
    return np.array(function(*inputs)).squeeze()


def end_of_arc(theta: float, v: np.ndarray) -> np.ndarray:
    """Points (2, n) of an arc of length one, by quadrature of its tangents."""
    at = v[:, None] * NODES * theta
    return np.stack([-np.sin(at) @ WEIGHTS, np.cos(at) @ WEIGHTS]) * v


def test_every_formula_has_a_test():
    numbers = [int(n) for n in re.findall(r"\\qquad \((\d+)\) \$\$$|\$ \| \((\d+)\) \|$", PAGE, re.M) for n in n if n]
    assert numbers == list(range(1, len(numbers) + 1))
    assert set(HERE) | set(ELSEWHERE) == set(numbers)
    assert all(name in globals() for name in HERE.values())
    for place in ELSEWHERE.values():
        file, _, name = place.partition("::")
        assert f"def {name}" in (ROOT / file).read_text(encoding="utf-8"), place


@pytest.mark.parametrize("theta", [0.0, 1e-7, 0.6, 2.0])
def test_stumpff_functions_obey_their_recursion_and_derivative(theta):
    c = [float(value) for value in stumpff(theta, 2.1, top=9)]
    assert c[:2] == pytest.approx([math.cos(theta), np.sinc(theta / math.pi)], abs=1e-15)
    step = 1e-5
    late, early = (np.array([float(v) for v in stumpff(theta + d, 2.1, top=9)]) for d in (step, -step))
    for k in range(8):
        assert c[k] == pytest.approx(1.0 / math.factorial(k) - theta**2 * c[k + 2], abs=1e-15)
        slope = (late[k] - early[k]) / (2.0 * step)
        assert slope == pytest.approx(theta * (k * c[k + 2] - c[k + 1]), abs=1e-9)


@pytest.mark.parametrize("theta", [0.0, 1e-7, 0.6, -2.0])
def test_the_table_of_an_arc(theta):
    c = [float(value) for value in stumpff(theta, 2.1)]
    r = end_of_arc(theta, NODES)
    # of the integral of t by the angle: n = dt/dtheta times the share of the angle
    at = NODES[:, None] * NODES * theta
    arm = np.stack([-np.cos(at) @ (WEIGHTS * NODES), -np.sin(at) @ (WEIGHTS * NODES)]) * NODES**2
    assert [-theta * c[2], c[1]] == pytest.approx(end_of_arc(theta, np.ones(1))[:, 0], abs=1e-15)
    assert [-theta * c[3], c[2]] == pytest.approx(r @ WEIGHTS, abs=1e-15)
    assert 2 * c[3] == pytest.approx((r**2).sum(axis=0) @ WEIGHTS, abs=1e-15)
    assert c[3] - c[4] == pytest.approx((r[0] * arm[1] - r[1] * arm[0]) @ WEIGHTS, abs=1e-15)
    assert 2 * c[4] - 4 * c[5] == pytest.approx((arm**2).sum(axis=0) @ WEIGHTS, abs=1e-15)


@pytest.mark.parametrize("theta", [0.0, 1e-7, 0.6, -2.0])
def test_one_arc_in_closed_form(theta):
    c = [float(value) for value in stumpff(theta, 2.1)]
    x, rate, h, mass, g = theta**2, 3.0, ROD["length"], ROD["linear_density"], 9.81
    model = finger("arc", 1, gravity=(-g, 0.0))
    # (5) differentiates (10): the derivative of 2 c_4 - 4 c_5
    c8 = sum((-x) ** n / math.factorial(2 * n + 8) for n in range(20))
    c6, c7 = c[6], 1.0 / math.factorial(7) - x * sum((-x) ** n / math.factorial(2 * n + 9) for n in range(20))
    assert c6 == pytest.approx(1.0 / math.factorial(6) - x * c8, abs=1e-16)
    slope = theta * (2 * (4 * c6 - c[5]) - 4 * (5 * c7 - c6))
    assert values(model.mass_matrix, [theta], [0.0], []) == pytest.approx(mass * h**3 * (2 * c[4] - 4 * c[5]))
    bias = 0.5 * mass * h**3 * slope * rate**2
    assert values(model.bias, [theta], [rate], [0.0], []) == pytest.approx(bias, rel=1e-12, abs=1e-16)
    weight = -mass * h**2 * g * (c[3] + x * (3 * c[5] - c[4]))
    assert values(model.gravity, [theta], [0.0], []) == pytest.approx(weight)


def test_kinetic_energy_is_a_double_sum_over_the_nodes():
    count, h = 4, ROD["length"]
    model = finger("clothoid", 1, accuracy=2e-3, bending_range=1.5)
    u = 0.5 * (np.polynomial.legendre.leggauss(count)[0] + 1.0)

    def rising(at: np.ndarray) -> np.ndarray:
        """Integrals (count, n) of the Lagrange polynomials of the nodes from 0."""
        found = []
        for j in range(count):
            others = np.delete(u, j)
            found.append(np.polyval(np.polyint(np.poly(others) / np.prod(u[j] - others)), at))
        return np.array(found)

    kernel = rising(NODES) * WEIGHTS @ rising(NODES).T
    shape = h * np.array([u - u**2 / 2, u**2 / 2])
    for q, qd in (([2.0, -1.5], [1.0, 3.0]), ([-0.4, 2.4], [-5.0, 2.0])):
        angle, rate = q @ shape, qd @ shape
        energy = 0.5 * ROD["linear_density"] * h**3 * rate @ (kernel * np.cos(angle[:, None] - angle)) @ rate
        assert values(model.energy, [*q, *qd], [0.0], [])[0] == pytest.approx(energy, rel=1e-12)
