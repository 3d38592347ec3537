"""The high-precision reference against hand values, identities and itself: it judges all others."""

from __future__ import annotations

import pytest

from tests.truth import Rod, TruthFinger, christoffel_bias, ctx, matched_tip

DIGITS = ctx.mpf(10) ** -30


TWO_PI = 2 * ctx.pi

# Everything a finger can have, on elements of unequal lengths.
FULL = {
    "lengths": ("0.13", "0.21"),
    "mass_per_length": "0.02",
    "rotary_inertia": "3e-7",
    "bending_stiffness": "0.05",
    "rest_curvature": ((0, "0.1", 2), ("0.1", "0.34", "-1.5")),
    "masses": (("0.34", "0.01"), ("0.2", "0.03")),
    "gravity": ("1.2", "-9.7"),
    "base_position": ("0.3", "-0.2"),
    "base_angle": "-0.7",
    "material_damping": "1e-4",
    "element_damping": "2e-5",
}


def full(family: str, **changes) -> TruthFinger:
    return TruthFinger(family=family, **{**FULL, **changes})


def close(value, expected, tolerance=DIGITS) -> bool:
    difference, scale = value - expected, expected
    if hasattr(difference, "rows"):
        difference, scale = ctx.mnorm(difference, ctx.inf), ctx.mnorm(scale, ctx.inf)
    return abs(difference) <= tolerance * max(abs(scale), ctx.mpf(10) ** -40)


STATES = {
    "arc": (["0.9", "-1.7"], ["2.1", "-3.3"]),
    "clothoid": (["3", "-11", "6"], ["20", "-31", "7"]),
    "matched_clothoid": (["3", "-11"], ["20", "-31"]),
}
TIP = ("6", "7", "-13")
FAMILIES = tuple(STATES)


@pytest.mark.parametrize("bend", ["0", "1e-300", "1e-9", "1e-4", "0.1", "2.0943951", "6.2831853"])
def test_one_arc_lies_on_its_circle(bend):
    length, theta = ctx.mpf("0.3"), ctx.mpf(bend)
    rod = Rod(TruthFinger([length]), [theta])
    s = ctx.mpf("0.2")
    part = theta * s / length
    if theta == 0:
        expected = ctx.matrix([0, s])
    else:
        # 1 - cos x = 2 sin(x/2)^2 loses nothing near 0.
        radius = length / theta
        expected = ctx.matrix([-2 * radius * ctx.sin(part / 2) ** 2, radius * ctx.sin(part)])
    for k in (0, 1):
        assert close(rod.position(s)[k], expected[k])
    assert close(rod.orientation(s), part)


def test_straight_arc_has_the_inertia_known_by_hand():
    length = ctx.mpf("0.7")
    rod = Rod(TruthFinger([length], mass_per_length=3, rotary_inertia="0.2"), [0])
    assert close(rod.mass[0, 0], 3 * length**3 / 20 + ctx.mpf("0.2") * length / 3)


def test_two_straight_arcs_have_the_constant_terms_of_the_corrected_appendix():
    a, b = ctx.mpf("0.25"), ctx.mpf("0.4")
    mass = Rod(TruthFinger([a, b]), [0, 0]).mass
    assert close(mass[0, 0], (3 * a**3 + 15 * a**2 * b + 30 * a * b**2 + 20 * b**3) / 60)
    assert close(mass[0, 1], b**2 * (2 * a + 3 * b) / 24)
    assert close(mass[1, 1], b**3 / 20)


@pytest.mark.parametrize("angles", [("0.4", "-0.9"), ("-1.3", "2.0"), ("2.0943951", "2.0943951")])
def test_two_arcs_have_the_mass_matrix_of_the_corrected_equation_36(angles):
    t1, t2 = (ctx.mpf(v) for v in angles)
    l1, l2, rho, rho_i = ctx.mpf("0.2"), ctx.mpf("0.35"), ctx.mpf("0.02"), ctx.mpf("1e-5")
    c1, s1, c2, s2 = ctx.cos(t1), ctx.sin(t1), ctx.cos(t2), ctx.sin(t2)

    def alone(t):
        return 1 / (3 * t**2) + 2 * (1 + ctx.cos(t)) / t**4 - 4 * ctx.sin(t) / t**5

    base = l1 / t1**2 * ctx.matrix([1 - c1 - t1 * s1, t1 * c1 - s1])
    vx, vy = c1 * base[0] + s1 * base[1], -s1 * base[0] + c1 * base[1]
    cross = 2 * l2 * ((s2 - t2) * vy - (1 - c2) * vx) / t2**2
    m11 = rho * l2 * (vx**2 + vy**2 + cross + 2 * l2**2 * (t2 - s2) / t2**3) + rho_i * l2
    m11 += rho * l1**3 * alone(t1) + rho_i * l1 / 3
    m12 = rho * l2**2 * ((t2 * s2 + 2 * c2 - 2) * vy + (t2 * (c2 + 1) - 2 * s2) * vx) / t2**3
    m12 += rho * l2**3 * ((1 - c2) / t2**4 - s2 / t2**3 + 1 / (2 * t2**2)) + rho_i * l2 / 2
    m22 = rho * l2**3 * alone(t2) + rho_i * l2 / 3
    mass = Rod(TruthFinger([l1, l2], mass_per_length=rho, rotary_inertia=rho_i), [t1, t2]).mass
    assert close(mass, ctx.matrix([[m11, m12], [m12, m22]]))


@pytest.mark.parametrize("family", FAMILIES)
def test_bias_follows_from_the_mass_matrix(family):
    q, qd = STATES[family]
    tip = (TIP[0], 0, 0)
    bias = Rod(full(family), q, qd, tip).bias
    assert close(bias, christoffel_bias(full(family), q, qd, TIP[0]), ctx.mpf(10) ** -26)


@pytest.mark.parametrize("family", FAMILIES)
def test_conservative_forces_are_gradients_of_the_potential(family):
    q = [ctx.mpf(v) for v in STATES[family][0]]
    rod = Rod(full(family), q, tip=TIP)
    step = ctx.mpf(10) ** -16
    for i in range(len(q)):
        sides = [
            Rod(full(family), [v + sign * step * (i == j) for j, v in enumerate(q)], tip=TIP).potential
            for sign in (1, -1)
        ]
        assert close(rod.gravity[i] + rod.elastic[i], (sides[0] - sides[1]) / (2 * step), ctx.mpf(10) ** -26)


@pytest.mark.parametrize("family", FAMILIES)
def test_jacobian_and_its_rate_are_derivatives(family):
    q, qd = ([ctx.mpf(v) for v in part] for part in STATES[family])
    finger, step, s = full(family), ctx.mpf(10) ** -16, ctx.mpf("0.19")
    rod = Rod(finger, q, qd, TIP)
    loose = ctx.mpf(10) ** -26
    for i in range(len(q)):
        sides = [
            Rod(finger, [v + sign * step * (i == j) for j, v in enumerate(q)], tip=TIP).position(s) for sign in (1, -1)
        ]
        assert close(rod.jacobian(s)[:, i], (sides[0] - sides[1]) / (2 * step), loose)
    ahead, behind = (
        Rod(
            finger,
            [a + sign * step * b for a, b in zip(q, qd, strict=True)],
            tip=(ctx.mpf(TIP[0]) + sign * step * ctx.mpf(TIP[1]), 0, 0),
        )
        for sign in (1, -1)
    )
    assert close(rod.jacobian_rate(s), (ahead.jacobian(s) - behind.jacobian(s)) / (2 * step), loose)
    assert close(rod.velocity(s), (ahead.position(s) - behind.position(s)) / (2 * step), loose)


def test_prescribed_curvature_moves_like_a_free_one():
    """A matched clothoid with the last curvature imposed that the free one has moves as the free one does."""
    q, qd = STATES["clothoid"]
    free = Rod(full("clothoid"), q, qd)
    forces = [("0.2", "0.7", "-0.4")]
    qdd = free.acceleration(forces, "0.02")
    matched = Rod(full("matched_clothoid"), q[:2], qd[:2], (q[2], qd[2], qdd[2]))
    assert close(matched.acceleration(forces, "0.02"), qdd[:2, :])
    assert close(matched.kinetic, free.kinetic)
    assert close(matched.potential, free.potential)


def test_rest_curvature_does_not_depend_on_the_mesh():
    finger = full("arc")
    rest = [2 * ctx.mpf("0.1") - ctx.mpf("1.5") * ctx.mpf("0.03"), -ctx.mpf("1.5") * ctx.mpf("0.21")]
    rod = Rod(finger, [0, 0])
    assert max(abs(v) for v in rod.elastic) < DIGITS
    assert max(abs(bend - known) for bend, known in zip(rod.bends(), rest, strict=True)) < DIGITS
    assert matched_tip(finger, "0.01")[0] == ctx.mpf("0.01") / ctx.mpf("0.05")


@pytest.mark.parametrize(
    ("family", "q"),
    [
        ("arc", [TWO_PI, -TWO_PI]),
        ("clothoid", [2 * TWO_PI / ctx.mpf("0.13"), 0, 2 * TWO_PI / ctx.mpf("0.21")]),
        ("matched_clothoid", ["1e-300", "1e-9"]),
    ],
)
def test_quadrature_has_converged(family, q):
    qd = ["1.5"] * len(q)
    coarse, fine = (Rod(full(family), q, qd, TIP, nodes=nodes) for nodes in (40, 60))
    for name in ("mass", "bias", "gravity"):
        assert close(getattr(coarse, name), getattr(fine, name), ctx.mpf(10) ** -38)
    s = ctx.mpf("0.3")
    assert close(coarse.jacobian(s), fine.jacobian(s), ctx.mpf(10) ** -38)
