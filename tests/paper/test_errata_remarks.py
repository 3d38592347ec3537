"""docs/errata.md, limits, labels and signs: each row shown by quadrature of the definitions."""

from __future__ import annotations

from fractions import Fraction
from math import factorial

import numpy as np
import pytest

from benchmarks.paper import appendix
from tests.arc_quadrature import RANGE, entries, square
from tests.errata_page import evaluate, formula, percent, table
from tests.truth import Rod, TruthFinger

ROWS = {row[0]: row for row in table("Limits, labels and signs")}


def test_kinetic_energy_up_to_l2_only_loses_the_second_arc():
    """(34): for L1 = L2."""
    first, both = (Rod(TruthFinger(lengths), [0] * len(lengths)).mass[0, 0] for lengths in ([0.3], [0.3, 0.3]))
    assert float(100 * first / both) == pytest.approx(percent(ROWS["(34)"][4])[0], abs=0.05)


def test_velocity_products_are_not_the_derivative_of_the_kinetic_energy():
    """(38): the coefficients of dT/dtheta_i against those of V_i."""
    theta, h = square(21), 1e-5
    wanted = entries(theta)
    slopes = []
    for axis in (0, 1):
        moved = [entries(theta + sign * h * np.eye(2)[:, [axis]]) for sign in (-1, 1)]
        slopes.append({key: (moved[1][key] - moved[0][key]) / (2 * h) for key in ("M11", "M12", "M22")})
    labeled, christoffel = {}, {}
    for i, (slope, name) in enumerate(zip(slopes, "12", strict=True)):
        labeled.update({f"V{name}1": slope["M11"] / 2, f"V{name}2": slope["M12"], f"V{name}3": slope["M22"] / 2})
        own, mixed = ("M11", "M12") if i == 0 else ("M12", "M22")
        christoffel[f"V{name}1"] = slopes[0][own] - slope["M11"] / 2
        christoffel[f"V{name}2"] = slopes[1][own] + slopes[0][mixed] - slope["M12"]
        christoffel[f"V{name}3"] = slopes[1][mixed] - slope["M22"] / 2
    largest = max(np.abs(wanted[key]).max() for key in labeled)
    assert max(np.abs(christoffel[key] - wanted[key]).max() for key in labeled) < 1e-8 * largest
    worst = max(np.abs(labeled[key] - wanted[key]).max() for key in labeled)
    assert 100 * worst / largest == pytest.approx(percent(ROWS["(38)"][4])[0], abs=0.5)


U, T = np.meshgrid(np.linspace(1e-3, 1, 200), np.linspace(1e-3, RANGE, 801))
EXACT = np.array([(np.cos(U * T) - 1) / T, np.sin(U * T) / T])


def cut(printed: bool) -> np.ndarray:
    """(45) over an arc of unit length, from the package's table."""
    x, y = (
        sum(float(both[printed]) * U * (U * T) ** n for n, both in powers.items())
        for powers in (appendix.POSITION["x"], appendix.POSITION["y"])
    )
    return np.array([x, y])


def test_series_of_45():
    """All coefficients by exact series, and the sixth power with the signs of the page."""
    for axis, first in (("x", 1), ("y", 0)):  # -sin and cos, integrated
        derived = {n: Fraction((-1) ** ((n + 1) // 2), factorial(n + 1)) for n in range(first, 6, 2)}
        assert derived == {n: right for n, (right, _) in appendix.POSITION[axis].items()}
        wrong = [n for n, (right, printed) in appendix.POSITION[axis].items() if right != printed]
        assert wrong == ([5] if axis == "x" else [])
    for which, column in ((0, 2), (1, 1)):
        found = evaluate(formula(ROWS["(45)"][column]), {"s": 1, "L1": 1, "θ1": 1}, Fraction)
        assert appendix.POSITION["x"][5][which] == found


def test_claim_of_section_4_3():
    error = np.abs(cut(False) - EXACT)
    size = np.hypot(*EXACT)
    found = [np.hypot(*error).max(), (np.hypot(*error) / size).max(), error[1].max(), (error[1] / EXACT[1]).max()]
    assert 100 * np.array(found) == pytest.approx([1.63, 1.97, 1.58, 3.8], abs=0.02)
    for text in ("1.63 % of L", "1.97 % of abs r", "1.58 % of L", "3.8 % of y"):
        assert text in ROWS["4.3, claim"][2]


def test_wrong_sign_of_45():
    error = np.abs(cut(True) - EXACT)
    found = [
        error[0].max() / np.abs(EXACT[0]).max(),
        np.hypot(*error).max(),
        (np.hypot(*error) / np.hypot(*EXACT)).max(),
    ]
    assert 100 * np.array(found) == pytest.approx([15, 10.9, 13.2], abs=0.06)
    assert ROWS["(45)"][4] == "x 15 % of its largest value; position 10.9 % of L, 13.2 % of abs r"
