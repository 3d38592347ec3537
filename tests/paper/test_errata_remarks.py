"""docs/errata.md, limits, labels and signs: each row shown by quadrature of the definitions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from benchmarks.paper import appendix
from tests.arc_quadrature import RANGE, entries, square
from tests.arc_series import FIRST
from tests.errata_page import evaluate, formula, percent, table
from tests.truth import Rod, TruthFinger, ctx, to_numpy

L1, L2, THETA = 0.25, 0.35, (0.7, -0.4)
ROWS = {row[0]: row for row in table("Limits, labels and signs")}


def rod(theta=THETA, rate=None, **settings) -> Rod:
    return Rod(TruthFinger([L1, L2], **settings), theta, rate)


def test_positions_have_two_entries():
    """(4), (5), (7)."""
    found = to_numpy(rod().position(L1))
    assert found == pytest.approx(L1 / THETA[0] * np.array([np.cos(THETA[0]) - 1, np.sin(THETA[0])]), rel=1e-14)


def test_mass_center_of_the_second_arc_is_the_mean_from_the_contact_to_the_tip():
    """(11): its right-hand side."""
    bent, t2 = rod(), THETA[1]
    nodes, weights = np.polynomial.legendre.leggauss(12)
    at = L1 + L2 * (nodes + 1) / 2
    relative = [to_numpy(bent.position(s) - bent.position(L1)) for s in at]
    c, s = np.cos(THETA[0]), np.sin(THETA[0])
    mean = np.array([[c, s], [-s, c]]) @ (weights / 2 @ np.array(relative))
    assert mean == pytest.approx(L2 / t2**2 * np.array([np.sin(t2) - t2, 1 - np.cos(t2)]), rel=1e-13)


def test_sections_of_the_second_arc_turn_at_the_rate_of_21_up_to_the_tip():
    """(21): the printed limit L2 would leave out a part, for L1 = L2 everything."""
    for s in np.linspace(L1 + 1e-6, L1 + L2, 5):
        turned = [
            rod((THETA[0] + h * 2.0, THETA[1] - h * 3.0)).orientation(s) for h in (-ctx.mpf("1e-9"), ctx.mpf("1e-9"))
        ]
        assert float((turned[1] - turned[0]) / ctx.mpf("2e-9")) == pytest.approx(2.0 - 3.0 * (s - L1) / L2, rel=1e-9)
    assert L2 < L1 + L2


def test_the_bending_moment_pulls_back_to_the_rest_shape():
    """(30)-(32): -(EI/L)(theta - theta*)."""
    stiffness, rest = 0.05, 0.8
    above = [t - rest * length for t, length in zip(THETA, (L1, L2), strict=True)]
    bent = rod(above, bending_stiffness=stiffness, rest_curvature=rest)
    moment = [-stiffness / length * (t - rest * length) for t, length in zip(THETA, (L1, L2), strict=True)]
    assert -to_numpy(bent.elastic) == pytest.approx(moment, rel=1e-13)


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


def test_material_damping_differs_from_one_coefficient_unless_the_arcs_are_equal():
    """(39), (43)."""
    for lengths in ((L1, L2), (0.3, 0.3)):
        rate, eta = (2.0, -3.0), 3e-5
        damping = to_numpy(Rod(TruthFinger(lengths, material_damping=eta), THETA, rate).damping)
        assert damping == pytest.approx([eta / length * r for length, r in zip(lengths, rate, strict=True)], rel=1e-13)
    shared = to_numpy(Rod(TruthFinger([L1, L2], element_damping=1e-4), THETA, (2.0, -3.0)).damping)
    assert shared == pytest.approx([2e-4, -3e-4], rel=1e-13)


def test_friction_takes_energy_with_the_sign_of_the_last_line():
    """(40): with (39) the middle line as printed would add c times the rates squared."""
    rate, c = np.array([2.0, -3.0]), 1e-4
    moment = -c * rate
    assert moment @ rate < 0 < -(moment @ rate)
    assert moment == pytest.approx(-to_numpy(rod(rate=rate, element_damping=c).damping), rel=1e-13)


def test_tendon_1_runs_on_the_minus_x_side():
    """(42): a positive bend shortens a curve at an offset to -X by offset times angle, so that F1 does work."""
    length, bend, offset = 0.6, 0.7, 0.005
    arc = Rod(TruthFinger([length]), [bend])
    assert float(arc.position(length)[0]) < 0
    at = np.linspace(0, length, 21)
    angle = bend * at / length
    side = np.array([to_numpy(arc.position(s)) for s in at]) - offset * np.array([np.cos(angle), np.sin(angle)]).T
    # A chord that spans the angle a on a circle of radius r is 2 r sin(a / 2) long.
    span = bend / 20
    found = np.linalg.norm(np.diff(side, axis=0), axis=1).sum() * (span / 2) / np.sin(span / 2)
    assert found == pytest.approx(length - offset * bend, rel=1e-13)


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
    for axis, curve in zip("xy", FIRST, strict=True):
        derived = {key[0]: value for key, value in curve.cut(5).items()}
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
