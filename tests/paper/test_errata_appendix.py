"""docs/errata.md, the appendix: each row against exact rational power series, its effect against quadrature."""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from benchmarks.paper.appendix_inertia import BIAS, MASS
from benchmarks.paper.appendix_loads import GRAVITY_ACROSS, GRAVITY_ALONG, JACOBIAN
from tests import arc_series
from tests.arc_quadrature import RANGE, entries, relative, square
from tests.errata_page import evaluate, formula, number, percent, spans, table

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
