"""docs/errata.md, the appendix: each row against exact rational power series, its effect against quadrature."""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from benchmarks.paper.coefficients import BIAS, GRAVITY_ACROSS, GRAVITY_ALONG, JACOBIAN, MASS
from tests import arc_series
from tests.arc_quadrature import RANGE, entries, relative, square
from tests.errata_page import evaluate, formula, number, percent, spans, table
from tests.truth import Rod, TruthFinger, ctx, to_numpy

PRINTED = {**MASS, **BIAS, **JACOBIAN, **GRAVITY_ALONG}
TABLES = {**PRINTED, **GRAVITY_ACROSS}
GRID = square(41)
POINTS = [tuple(Fraction(n) for n in point) for point in ((2, 7, 5, 3), (11, -3, 1, 13), (-5, 17, 9, 2))]
"""theta1, theta2, L1, L2 at which polynomials are compared."""


def internal(name: str) -> str:
    """Name in the tables of an entry of the page."""
    return name.split()[-1].replace("G_G", "GY").replace("G_X", "GX")


def monomial(text: str) -> tuple[int, int]:
    """Powers of theta1 and theta2 in a monomial of the page."""
    values = [evaluate(text, {"θ1": a, "θ2": b}, int) for a, b in ((2, 1), (1, 2))]
    return values[0].bit_length() - 1, values[1].bit_length() - 1


def lengths_only(text: str) -> list[Fraction]:
    """Values of a coefficient of the page at the lengths of ``POINTS``."""
    return [evaluate(text, {"L1": l1, "L2": l2}, Fraction) for _, _, l1, l2 in POINTS]


def at_lengths(coefficient: dict[tuple[int, int], Fraction]) -> list[Fraction]:
    return [sum(c * l1**a * l2**b for (a, b), c in coefficient.items()) for _, _, l1, l2 in POINTS]


def polynomial(name: str, reading: str, theta: np.ndarray, lengths=(0.3, 0.3)) -> np.ndarray:
    """An entry of the package's tables."""
    values = (
        float(getattr(m, reading)(*lengths)) * theta[0] ** i * theta[1] ** j for (i, j), m in TABLES[name].items()
    )
    return sum(values) + 0 * theta[0]


ROWS = table("Appendix, coefficient by coefficient")


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row[0]} {row[1]}")
def test_coefficient_is_right_as_corrected_and_wrong_as_printed(row):
    entry, powers, printed, corrected, why, effect = row
    name, powers = internal(entry), monomial(powers)
    exact = at_lengths(arc_series.exact()[name].by_angles()[powers])
    assert lengths_only(formula(corrected)) == exact
    assert all(a != b for a, b in zip(lengths_only(formula(printed)), exact, strict=True))
    without = exact
    if why.startswith("R"):
        without = at_lengths(arc_series.unrotated()[name].by_angles()[powers])
        assert lengths_only(spans(why)[0] if spans(why) else formula(printed)) == without
    table_row = TABLES[name][powers]
    assert why.startswith(table_row.cause)
    for reading, wanted in (("printed", lengths_only(formula(printed))), ("corrected", exact), ("unrotated", without)):
        assert at_lengths(getattr(table_row, reading).fractions) == wanted
    share = {"L1": Fraction(3, 10), "L2": Fraction(3, 10)}
    error = abs(float(evaluate(f"{formula(printed)} - ({formula(corrected)})", share, Fraction)))
    found = 100 * error * RANGE ** sum(powers) / np.abs(entries(GRID)[name]).max()
    assert found == pytest.approx(percent(effect)[0], abs=1.02 * percent(effect)[1])


def test_all_other_coefficients_are_right():
    """144 monomials, none missing, 56 wrong; V22 and the second column of J_c vanish."""
    assert sum(len(p) for p in PRINTED.values()) == 144
    assert len(ROWS) == 56
    for name, series in arc_series.exact().items():
        derived = {powers: at_lengths(c) for powers, c in series.by_angles().items()}
        assert derived == {p: at_lengths(m.corrected.fractions) for p, m in TABLES.get(name, {}).items()}, name
    wrong = {(name, powers) for name, p in TABLES.items() for powers, m in p.items() if m.printed != m.corrected}
    assert wrong == {(internal(row[0]), monomial(row[1])) for row in ROWS}
    causes = [TABLES[name][powers].cause for name, powers in wrong]
    assert (causes.count("R"), causes.count("T"), causes.count("R + T")) == (53, 2, 1)


def test_missing_rotation_explains_m_and_v():
    """All monomials of M and V without the rotation, and V as their Christoffel symbols, but for the misprints."""
    for name, series in arc_series.unrotated().items():
        derived = {powers: at_lengths(c) for powers, c in series.by_angles().items()}
        found = {p: at_lengths(m.unrotated.fractions) for p, m in TABLES.get(name, {}).items()}
        assert derived == found, name
        printed = {p: at_lengths(m.printed.fractions) for p, m in TABLES.get(name, {}).items()}
        misprints = {p for p in derived if derived[p] != printed[p]}
        assert misprints == {"M12": {(2, 0)}, "V13": {(0, 1)}}.get(name, set())


@pytest.mark.parametrize("row", table("Appendix, entry by entry"), ids=lambda row: row[0])
def test_entry_errs_by_the_stated_effect(row):
    name = internal(row[0])
    for reading, cell in zip(("printed", "unrotated", "corrected"), row[1:], strict=True):
        found = 100 * relative(polynomial(name, reading, GRID), entries(GRID)[name])
        assert found == pytest.approx(percent(cell)[0], abs=1.02 * percent(cell)[1])


def test_printed_mass_matrix_is_indefinite_on_a_third_of_the_range():
    """Point 2 of the short list of the page."""
    theta = square(101)
    m11, m12, m22 = (polynomial(name, "printed", theta) for name in ("M11", "M12", "M22"))
    indefinite = m11 * m22 < m12**2
    assert 100 * indefinite.mean() == pytest.approx(32, abs=1)
    assert np.abs(theta[:, indefinite]).max(axis=0).min() == pytest.approx(1.17, abs=0.04)


@pytest.mark.parametrize("row", table("Corrected appendix"), ids=lambda row: row[0])
def test_corrected_polynomial_of_the_page_is_the_taylor_polynomial(row):
    series = arc_series.exact()[internal(row[0])]
    for t1, t2, l1, l2 in POINTS:
        wanted = sum(c * t1**i * t2**j * l1**a * l2**b for (i, j, _, a, b), c in series.items())
        assert evaluate(formula(row[1]), {"θ1": t1, "θ2": t2, "L1": l1, "L2": l2}, Fraction) == wanted


def test_corrected_page_is_complete():
    assert {internal(row[0]) for row in table("Corrected appendix")} == set(TABLES)


GROUPS = [tuple(MASS), tuple(BIAS), tuple(GRAVITY_ALONG), tuple(GRAVITY_ACROSS), ("Jc11", "Jc21")]
GROUPS.append(("Jt11", "Jt12", "Jt21", "Jt22"))


@cache
def truncation(largest: float) -> list[float]:
    theta = square(41, largest)
    exact = entries(theta)
    errors = []
    for group in GROUPS:
        worst = max(np.abs(polynomial(name, "corrected", theta) - exact[name]).max() for name in group)
        errors.append(worst / max(np.abs(exact[name]).max() for name in group))
    return errors


@pytest.mark.parametrize("row", table("Truncation rule"), ids=lambda row: row[0])
def test_truncation(row):
    largest = RANGE if row[0] == "2π/3" else float(row[0])
    for found, cell in zip(truncation(largest), row[1:], strict=True):
        assert found == pytest.approx(number(cell)[0], abs=1.02 * number(cell)[1])


@pytest.mark.parametrize(("name", "size"), [("Jt12", 2.5), ("Jt22", 1.4), ("GY2", 0.76), ("GX2", 1.5)])
def test_truncation_relative_to_the_entry_itself(name, size):
    assert relative(polynomial(name, "corrected", GRID), entries(GRID)[name]) == pytest.approx(size, rel=0.04)


def test_quadrature_agrees_with_50_digits():
    theta, rate = np.array([[1.9], [-0.7]]), (1.0, 1.0)
    found = entries(theta, (0.25, 0.35))
    rod = Rod(TruthFinger([0.25, 0.35], gravity=(0, -1)), theta[:, 0], rate)
    across = Rod(TruthFinger([0.25, 0.35], gravity=(1, 0)), theta[:, 0])
    pairs = [(f"M{i}{j}", rod.mass[i - 1, j - 1]) for i in (1, 2) for j in (1, 2)]
    pairs += [(f"G{a}{i}", r.gravity[i - 1]) for a, r in (("Y", rod), ("X", across)) for i in (1, 2)]
    for name, s in (("Jc", 0.25), ("Jt", 0.6)):
        pairs += [(f"{name}{i}{j}", rod.jacobian(s)[i - 1, j - 1]) for i in (1, 2) for j in (1, 2)]
    for name, value in pairs:
        assert found[name][0] == pytest.approx(float(value), rel=1e-13, abs=1e-15)
    for i in (1, 2):
        assert sum(found[f"V{i}{k}"][0] for k in (1, 2, 3)) == pytest.approx(float(rod.bias[i - 1]), rel=1e-12)


def test_eight_right_coefficients_do_not_follow_from_the_cut_curve():
    """Section 4.3 says they do; M to degree 4 is the same on both ways."""
    cut = {name: series.by_angles() for name, series in arc_series.from_cut_curves().items()}
    apart = {
        (name, powers)
        for name, p in PRINTED.items()
        for powers, m in p.items()
        if not m.cause and m.corrected.fractions != cut[name].get(powers, {})
    }
    wanted = {("Jc21", (5, 0)), ("Jt21", (5, 0)), ("GY1", (5, 0))}
    assert apart == wanted | {(name, (0, 5)) for name in ("Jt22", "V12", "V13", "V23", "GY2")}
    for name in MASS:
        assert arc_series.from_cut_curves()[name].cut(4) == arc_series.exact()[name].cut(4)


def test_v11_from_the_cut_curve_is_off_by_more_than_its_size():
    difference = (arc_series.from_cut_curves()["V11"] - arc_series.exact()["V11"]).by_angles()
    error = sum(
        float(sum(x * Fraction(3, 10) ** (a + b) for (a, b), x in c.items())) * GRID[0] ** i * GRID[1] ** j
        for (i, j), c in difference.items()
    )
    assert np.abs(error).max() / np.abs(entries(GRID)["V11"]).max() == pytest.approx(2.5, rel=0.02)


def test_velocity_products_need_degree_6_of_the_mass_matrix():
    """(A.3) is not what (38) makes of (A.1)."""
    short = {name: series.cut(4) for name, series in arc_series.unrotated().items() if name in MASS}
    assert arc_series.christoffel(short)["V11"].cut(5) != arc_series.unrotated()["V11"]
    assert arc_series.christoffel(short)["V11"].cut(3) == arc_series.unrotated()["V11"].cut(3)


def test_dropped_rotary_inertia():
    """Of a rod of 2 mm: rho I / (rho A) = d^2 / 16."""
    slender = ctx.mpf("0.002") ** 2 / 16
    masses = [to_numpy(Rod(TruthFinger([0.3, 0.3], rotary_inertia=i), [0, 0]).mass) for i in (0, slender)]
    share = masses[1] / masses[0] - 1
    assert [share[0, 0], share[0, 1], share[1, 1]] == pytest.approx([3.3e-6, 6.7e-6, 1.9e-5], rel=0.03)
    text = table("Appendix, other points")[0][1]
    assert all(size in text for size in ("3.3e-6", "6.7e-6", "1.9e-5"))


def test_gravity_of_the_appendix_pulls_down_on_a_finger_that_points_up():
    """(A.4): a standing finger falls away from the vertical, G theta < 0."""
    theta = np.array([[0.3], [0.2]])
    found = [polynomial(f"GY{i}", "corrected", theta)[0] for i in (1, 2)]
    assert found == pytest.approx(to_numpy(Rod(TruthFinger([0.3, 0.3], gravity=(0, -1)), (0.3, 0.2)).gravity), rel=1e-4)
    assert found[0] < 0
    assert found[1] < 0
