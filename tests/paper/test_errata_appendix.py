"""docs/errata.md, the appendix: each row against Taylor coefficients and its effect, both by quadrature."""

from __future__ import annotations

from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from benchmarks.paper.appendix_inertia import BIAS, MASS
from benchmarks.paper.appendix_loads import GRAVITY_ACROSS, GRAVITY_ALONG, JACOBIAN
from tests.arc_quadrature import RANGE, christoffel, entries, relative, square, taylor, unrotated
from tests.errata_page import evaluate, formula, number, percent, spans, table

PRINTED = {**MASS, **BIAS, **JACOBIAN, **GRAVITY_ALONG}
TABLES = {**PRINTED, **GRAVITY_ACROSS}
GRID = square(41)
LENGTHS = [(0.5, 0.3), (0.2, 0.4), (0.9, 0.2)]
"""L1, L2 at which coefficients are compared."""


def internal(name: str) -> str:
    """Name in the tables of an entry of the page."""
    return name.split()[-1].replace("G_G", "GY").replace("G_X", "GX")


def monomial(text: str) -> tuple[int, int]:
    """Powers of theta1 and theta2 in a monomial of the page."""
    values = [evaluate(text, {"θ1": a, "θ2": b}, int) for a, b in ((2, 1), (1, 2))]
    return values[0].bit_length() - 1, values[1].bit_length() - 1


def lengths_only(text: str) -> list[float]:
    """Values of a coefficient of the page at ``LENGTHS``."""
    return [float(evaluate(text, {"L1": l1, "L2": l2}, Fraction)) for l1, l2 in LENGTHS]


def at_lengths(coefficient) -> list[float]:
    """Values of a coefficient of the package."""
    return [float(coefficient(*lengths)) for lengths in LENGTHS]


@cache
def derived(rotation: bool = True) -> list[dict[str, np.ndarray]]:
    """Taylor coefficients at each of ``LENGTHS``; without the rotation of M and V."""
    if rotation:
        return [taylor(entries, lengths) for lengths in LENGTHS]
    masses = [taylor(unrotated, lengths) for lengths in LENGTHS]
    return [{**m, **christoffel(m)} for m in masses]


def series(name: str, rotation: bool = True) -> dict[tuple[int, int], list[float]]:
    """Coefficients of an entry by the powers of theta1 and theta2, M and all else to degree 5 in the angles."""
    powers = [(i, j) for i in range(6) for j in range(6 - i)]
    every = {at: [float(one[name][at]) for one in derived(rotation)] for at in powers}
    return {at: values for at, values in every.items() if np.abs(values).max() > 1e-12}


def same(found: dict, wanted: dict) -> bool:
    """Whether the same powers have the same coefficients, to the rounding of doubles."""
    return found.keys() == wanted.keys() and all(found[at] == pytest.approx(wanted[at], rel=1e-8) for at in found)


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
    exact, wrong = series(name)[powers], lengths_only(formula(printed))
    assert lengths_only(formula(corrected)) == pytest.approx(exact, rel=1e-8)
    assert all(abs(a - b) > 1e-3 * abs(b) for a, b in zip(wrong, exact, strict=True))
    without = exact
    if why.startswith("R"):
        without = series(name, rotation=False)[powers]
        assert lengths_only(spans(why)[0] if spans(why) else formula(printed)) == pytest.approx(without, rel=1e-8)
    table_row = TABLES[name][powers]
    assert why.startswith(table_row.cause)
    for reading, wanted in (("printed", wrong), ("corrected", exact), ("unrotated", without)):
        assert at_lengths(getattr(table_row, reading)) == pytest.approx(wanted, rel=1e-8)
    share = {"L1": Fraction(3, 10), "L2": Fraction(3, 10)}
    error = abs(float(evaluate(f"{formula(printed)} - ({formula(corrected)})", share, Fraction)))
    found = 100 * error * RANGE ** sum(powers) / np.abs(entries(GRID)[name]).max()
    assert found == pytest.approx(percent(effect)[0], abs=1.02 * percent(effect)[1])


def test_all_other_coefficients_are_right():
    """144 monomials, none missing, 56 wrong; V22 and the second column of J_c vanish."""
    assert sum(len(p) for p in PRINTED.values()) == 144
    assert len(ROWS) == 56
    for name in derived()[0]:
        if name.startswith(("Jg", "Jh", "M21")):  # mass centers, and the lower half of M, are not in the appendix
            continue
        assert same(series(name), {p: at_lengths(m.corrected) for p, m in TABLES.get(name, {}).items()}), name
    wrong = {(name, powers) for name, p in TABLES.items() for powers, m in p.items() if m.printed != m.corrected}
    assert wrong == {(internal(row[0]), monomial(row[1])) for row in ROWS}
    causes = [TABLES[name][powers].cause for name, powers in wrong]
    assert (causes.count("R"), causes.count("T"), causes.count("R + T")) == (53, 2, 1)


def test_missing_rotation_explains_m_and_v():
    """All monomials of M and V without the rotation, and V as their Christoffel symbols, but for the misprints."""
    for name in derived(rotation=False)[0]:
        found, of_page = series(name, rotation=False), TABLES.get(name, {})
        assert same(found, {p: at_lengths(m.unrotated) for p, m in of_page.items()}), name
        printed = {p: at_lengths(m.printed) for p, m in of_page.items()}
        misprints = {p for p in found if found[p] != pytest.approx(printed[p], rel=1e-8)}
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
    for k, (l1, l2) in enumerate(LENGTHS):
        for t1, t2 in ((0.2, 0.7), (1.1, -0.3), (-0.5, 1.7)):
            wanted = sum(values[k] * t1**i * t2**j for (i, j), values in series(internal(row[0])).items())
            found = evaluate(formula(row[1]), {"θ1": t1, "θ2": t2, "L1": l1, "L2": l2})
            assert found == pytest.approx(wanted, rel=1e-8)


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
