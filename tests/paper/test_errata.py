"""docs/errata.md, the closed forms: each row derived anew by quadrature, to 30 digits where it matters."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from benchmarks.paper import TwoArcs, closed_forms
from benchmarks.paper.kinematics import Bent
from benchmarks.paper.slips import ALL, SLIPS, AsPrinted
from tests.arc_quadrature import RANGE, entries, relative, square
from tests.errata_page import evaluate, formula, percent, table
from tests.truth import Rod, TruthFinger, ctx, to_numpy

LENGTHS = (0.25, 0.35)
ANGLES = np.random.default_rng(5).uniform(0.4, RANGE, (2, 12)) * np.random.default_rng(6).choice([-1, 1], (2, 12))
GRID = square(40)
"""Without zero, where the closed forms divide by it."""


def names(theta, lengths, number=np) -> dict:
    """Values of the symbols of the page's formulas."""
    t1, t2 = theta
    c1, s1, c2, s2 = number.cos(t1), number.sin(t1), number.cos(t2), number.sin(t2)
    l1, l2 = lengths
    return {"θ1": t1, "θ2": t2, "C1": c1, "S1": s1, "C2": c2, "S2": s2, "L1": l1, "L2": l2, "θ1_rate": 1}


def with_velocity(values: dict, printed: bool, exact=float) -> dict:
    """The same with vcx and vcy by their own rows of the page."""
    rows = {row[0]: row for row in table("Closed forms, entry by entry")}
    found = {
        f"vc{axis}": evaluate(formula(rows[f"(36) vc{axis}"][1 if printed else 2]), values, exact) for axis in "xy"
    }
    return {**values, **found}


def truth(theta, lengths) -> dict[str, np.ndarray]:
    """What the entries of the page's first table should be, by quadrature."""
    e, c1, s1 = entries(theta, lengths), np.cos(theta[0]), np.sin(theta[0])
    found = {"(19) y": e["Jg21"], "(20) y": c1 * e["Jh22"] - s1 * e["Jh12"]}
    for i, j in ((1, 2), (2, 1), (2, 2)):
        found[f"(24) J{i}{j}"] = e[f"Jt{i}{j}"]
        found[f"(25) J_G1_{i}{j}"] = e[f"Jg{i}{j}"]
        found[f"(26) J_G2_{i}{j}"] = e[f"Jh{i}{j}"]
    found["(36) vcx"], found["(36) vcy"] = c1 * e["Jc11"] + s1 * e["Jc21"], c1 * e["Jc21"] - s1 * e["Jc11"]
    return {**found, **{f"(36) M{ij}": e[f"M{ij}"] for ij in ("11", "12", "22")}}


def package(theta, lengths, slips=()) -> dict[str, np.ndarray]:
    """All entries by the package's closed forms; (19) and (20) for a unit rate of their angle."""
    t, rate = ca.SX.sym("t", 2), ca.SX.sym("rate", 2)
    bent = Bent(TwoArcs(tuple(map(float, lengths)), 1.0), t, AsPrinted(slips))
    matrices = {"Jt": bent.tip_jacobian, "Jg": bent.center1_jacobian, "Jh": bent.center2_jacobian}
    matrices["M"] = closed_forms.rod_mass_matrix(bent)
    velocity = ca.horzcat(bent.center1_velocity(rate), bent.center2_velocity(rate))
    f = ca.Function("f", [t, rate], [*matrices.values(), velocity])
    count = theta.shape[1]
    *values, velocities = [
        np.array(v).reshape(2, count, 2) for v in f.map(count)(theta, np.tile([[0.0], [1.0]], count))
    ]
    found = {
        f"{name}{i}{j}": value[i - 1, :, j - 1]
        for name, value in zip(matrices, values, strict=True)
        for i in (1, 2)
        for j in (1, 2)
    }
    first = np.array(f.map(count)(theta, np.tile([[1.0], [0.0]], count))[-1]).reshape(2, count, 2)
    c1, s1 = np.cos(theta[0]), np.sin(theta[0])
    return {**found, "(19) y": first[1, :, 0], "(20) y": c1 * velocities[1, :, 1] - s1 * velocities[0, :, 1]}


PACKAGE = {"24": "Jt", "25": "Jg", "26": "Jh", "36": "M"}
ENTRIES = table("Closed forms, entry by entry")


def entry_key(row) -> str:
    return row[0].split(",")[0]


def in_package(key: str) -> str | None:
    """Name of an entry of the page in the results of ``package``."""
    if key in ("(19) y", "(20) y"):
        return key
    return None if "vc" in key else PACKAGE[key[1:3]] + key[-2:]


def group_scale(key: str, wanted: dict, theta, lengths) -> float:
    """Largest entry of the matrix that an entry belongs to."""
    if "vc" in key:
        return max(np.abs(wanted[k]).max() for k in ("(36) vcx", "(36) vcy"))
    prefix = PACKAGE[key[1:3]]
    found = entries(theta, lengths)
    return max(np.abs(found[f"{prefix}{ij}"]).max() for ij in ("11", "12", "21", "22"))


@pytest.mark.parametrize("row", ENTRIES, ids=entry_key)
def test_closed_form_is_right_as_corrected_and_wrong_as_printed(row):
    key, wanted = entry_key(row), truth(ANGLES, LENGTHS)[entry_key(row)]
    plain = names(ANGLES, LENGTHS)
    printed = evaluate(formula(row[1]), with_velocity(plain, True)) + 0 * ANGLES[0]
    corrected = evaluate(formula(row[2]), with_velocity(plain, False)) + 0 * ANGLES[0]
    scale = np.abs(wanted).max() or 1.0
    assert np.abs(corrected - wanted).max() < 1e-12 * scale
    assert np.abs(printed - wanted).max() > 1e-2 * scale
    name = in_package(key)
    if name is not None:
        assert np.abs(package(ANGLES, LENGTHS)[name] - wanted).max() < 1e-12 * scale
        assert package(ANGLES, LENGTHS, ALL)[name] == pytest.approx(printed, rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("row", [r for r in ENTRIES if "unbounded" not in r[3]], ids=entry_key)
def test_closed_form_errs_by_the_stated_effect(row):
    wanted, (effect, half) = truth(GRID, (0.3, 0.3)), percent(row[3])
    printed = evaluate(formula(row[1]), with_velocity(names(GRID, (0.3, 0.3)), True))
    error = np.abs(printed - wanted[entry_key(row)]).max() / group_scale(entry_key(row), wanted, GRID, (0.3, 0.3))
    assert 100 * error == pytest.approx(effect, abs=1.2 * half)


@pytest.mark.parametrize("row", [r for r in ENTRIES if "unbounded" in r[3]], ids=entry_key)
def test_closed_form_grows_beyond_bounds_as_stated(row):
    small, other = ctx.mpf("1e-4"), ctx.mpf("0.7")
    theta = (small, other) if "/θ1" in formula(row[3]) else (other, small)
    values = names(theta, (ctx.mpf("0.25"), ctx.mpf("0.35")), ctx)
    as_printed, as_corrected = (with_velocity(values, printed, ctx.mpf) for printed in (True, False))
    error = evaluate(formula(row[1]), as_printed, ctx.mpf) - evaluate(formula(row[2]), as_corrected, ctx.mpf)
    assert float(error / evaluate(formula(row[3]), as_printed, ctx.mpf)) == pytest.approx(1, abs=1e-3)


SLIP_ROWS = {row[0]: row for row in table("Closed forms, slip by slip")}


def second_arc_error(theta, lengths, slips) -> float:
    """Error of (16) over the second arc, relative to the largest velocity for a unit rate of theta2."""
    t, s, (l1, l2) = ca.SX.sym("t", 2), ca.SX.sym("s"), lengths
    arcs = TwoArcs(tuple(lengths), 1.0)
    printed, right = (Bent(arcs, t, AsPrinted(k)).second_velocity(s, ca.SX([0, 1])) for k in (slips, ()))
    f = ca.Function("f", [t, s], [printed, right])
    at = [np.array(f.map(theta.shape[1])(theta, l1 + u * l2)) for u in (0.25, 0.5, 0.75, 1.0)]
    end = entries(theta, lengths)
    assert np.abs(at[-1][1] - [end["Jt12"], end["Jt22"]]).max() < 1e-12
    largest = max(np.hypot(*right).max() for _, right in at)
    return max(np.hypot(*(printed - right)).max() for printed, right in at) / largest


@pytest.mark.parametrize("key", SLIPS)
def test_slip_alone_has_the_stated_effect(key):
    slip, (_, printed, corrected, read, effect) = SLIPS[key], SLIP_ROWS[key]
    assert (printed, corrected) == (slip.printed, slip.corrected)
    assert read == (slip.read or "as it stands")
    if key == "(16) s":
        assert 100 * second_arc_error(GRID, (0.3, 0.3), [key]) == pytest.approx(percent(effect)[0], abs=1)
    elif effect == "unbounded":
        errors = []
        for small in (0.04, 0.02):
            theta = np.full((2, 1), small)
            right, wrong = package(theta, (0.3, 0.3)), package(theta, (0.3, 0.3), [key])
            errors.append(max(np.abs(wrong[name] - right[name]).max() for name in right))
        assert errors[1] > 3.5 * errors[0] > 0
    elif key == "(19) rate":
        still = package(GRID, (0.3, 0.3), [key])["(19) y"] - entries(GRID)["Jg21"]
        assert np.abs(still).max() < 1e-9  # right for a unit rate only: it has no rate at all
        t, rate = ca.SX.sym("t", 2), ca.SX.sym("rate", 2)
        assert not ca.depends_on(Bent(TwoArcs((0.3, 0.3), 1.0), t, AsPrinted([key])).center1_velocity(rate), rate)
    else:
        prefix = PACKAGE[key[1:3]]
        found, wanted = package(GRID, (0.3, 0.3), [key]), entries(GRID)
        pairs = [f"{prefix}{ij}" for ij in ("11", "12", "21", "22")]
        worst = max(np.abs(found[n] - wanted[n]).max() for n in pairs)
        scale = max(np.abs(wanted[n]).max() for n in pairs)
        assert 100 * worst / scale == pytest.approx(percent(effect)[0], abs=1.2 * percent(effect)[1])


def test_every_slip_of_the_closed_forms_is_on_the_page():
    assert list(SLIP_ROWS) == list(SLIPS)


def test_the_rotary_terms_of_36():
    l1, l2, theta = 0.25, 0.35, (0.7, -0.4)
    rods = [Rod(TruthFinger([l1, l2], rotary_inertia=i), theta) for i in (1, 0)]
    gain = to_numpy(rods[0].mass) - to_numpy(rods[1].mass)
    assert gain == pytest.approx(np.array([[l2 + l1 / 3, l2 / 2], [l2 / 2, l2 / 3]]), rel=1e-13)
    t = ca.SX.sym("t", 2)
    masses = [closed_forms.rod_mass_matrix(Bent(TwoArcs((l1, l2), 1.0, i), t)) for i in (1.0, 0.0)]
    assert np.array(ca.Function("f", [t], [masses[0] - masses[1]])(theta)) == pytest.approx(gain, rel=1e-9)


@pytest.mark.parametrize(("theta", "digits"), [(1.0, 14), (0.3, 12), (0.1, 10), (0.01, 6), (1e-4, 0)])
def test_digits_that_the_closed_form_of_m22_keeps(theta, digits):
    text = formula(next(row for row in ENTRIES if row[0] == "(36) M22")[2])
    around = theta * (1 + np.linspace(-1e-3, 1e-3, 201))
    found = evaluate(text, names((1.0, around), (1.0, 1.0)))
    exact = [evaluate(text, names((1, ctx.mpf(v)), (1, 1), ctx), ctx.mpf) for v in around]
    error = relative(found, to_numpy(exact))
    assert error > 1 if digits == 0 else 10.0 ** (-digits - 1) < error < 10.0 ** (1.2 - digits)
