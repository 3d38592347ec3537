"""The high-precision reference against hand values, identities and itself: it judges all others."""

from __future__ import annotations

import pytest

from tests.truth import Rod, TruthFinger, christoffel_bias, ctx

DIGITS = ctx.mpf(10) ** -30

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
