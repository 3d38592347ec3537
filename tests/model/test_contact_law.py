"""Contact pressure and friction: closed forms, smoothness, the cone, and what neither creeps nor slips."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from continuum_grasp.base import InputError
from continuum_grasp.model import TouchLaw
from continuum_grasp.scene import ContactLaw, Rod

EDGE = 1e-4
ROD = Rod(length=0.18, linear_density=0.006 / 0.18, bending_stiffness=0.02)
LAW = ContactLaw(stiffness=2000.0, friction=0.4, dissipation=3.0, rounding=EDGE, presliding=2e-4)


def force_of(law: ContactLaw = LAW) -> ca.Function:
    gap, rate, touch = ca.SX.sym("gap"), ca.SX.sym("rate"), TouchLaw(law, ROD)
    return ca.Function("force", [gap, rate], [touch.normal_force(gap, rate), touch.stored_energy(gap)])


class Friction:
    """Share and rate of a law as numbers, in one direction or two."""

    def __init__(self, count: int, law: ContactLaw = LAW) -> None:
        z, v = ca.SX.sym("z", count), ca.SX.sym("v", count)
        gap, touch = ca.SX.sym("gap"), TouchLaw(law, ROD)
        states, slips = ca.vertsplit(z), ca.vertsplit(v)
        share = ca.vertcat(*touch.friction_share(states, slips))
        rate = ca.vertcat(*touch.friction_rate(gap, states, slips))
        self._function = ca.Function("friction", [gap, z, v], [share, rate])

    def __call__(self, z, v, gap: float = -1.0) -> tuple[np.ndarray, np.ndarray]:
        share, rate = self._function(gap, z, v)
        return np.array(share).ravel(), np.array(rate).ravel()


# normal force


@pytest.mark.parametrize("depth", [-3.0, -1.0, -0.5, 0.0, 0.5, 1.0, 5.0])
@pytest.mark.parametrize(("rate", "factor"), [(0.0, 1.0), (-0.2, 1.6), (0.2, 0.4), (1.0, 0.0)])
def test_the_normal_force_has_its_closed_form(depth, rate, factor):
    """Depths in units of the rounding; 2 (t^3 - t^4 / 2) with t = (d + 1) / 2 in between."""
    t = (depth + 1.0) / 2.0
    spring = 0.0 if t <= 0.0 else depth if t >= 1.0 else 2.0 * (t**3 - t**4 / 2.0)
    found = float(force_of()(-depth * EDGE, rate)[0])
    assert found == pytest.approx(2000.0 * EDGE * spring * factor, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("edge", [-1.0, 1.0])
def test_the_second_derivative_is_continuous(edge):
    """By central differences on both sides, ever nearer to where the pieces meet; the third one jumps."""
    force, step = force_of(), 1e-3

    def second(d: float) -> float:
        values = [float(force(-(d + k * step) * EDGE, 0.0)[0]) for k in (-1, 0, 1)]
        return (values[0] - 2.0 * values[1] + values[2]) / step**2

    jumps = [abs(second(edge + near) - second(edge - near)) for near in (8e-3, 4e-3, 2e-3)]
    assert jumps[0] / jumps[2] == pytest.approx(4.0, rel=0.05)
    assert jumps[2] < 0.02 * 2000.0 * EDGE


def test_the_stored_energy_is_the_work_of_the_spring():
    force = force_of()
    for depth in (-0.5 * EDGE, 0.3 * EDGE, EDGE, 7.0 * EDGE):
        work = quad(lambda d: float(force(-d, 0.0)[0]), -EDGE, depth, points=[min(EDGE, depth)], epsabs=1e-16)[0]
        assert float(force(-depth, 0.0)[1]) == pytest.approx(work, rel=1e-9)


# friction


@pytest.mark.parametrize("count", [1, 2])
def test_friction_stays_within_the_cone(count):
    """Shares for any state, velocity of slip and law; and no rate leads out of the disc."""
    rng = np.random.default_rng(count)
    friction, regular = Friction(count), Friction(count, ContactLaw(stiffness=1.0e3, friction=0.4, slip_speed=1e-3))
    for _ in range(300):
        z, v = rng.normal(size=count), rng.normal(size=count) * 10.0 ** rng.uniform(-6, 1)
        z *= min(1.0, 1.0 / np.linalg.norm(z)) * rng.choice([1.0, rng.uniform()])
        assert np.linalg.norm(friction(z, v)[0]) <= 1.0 + 1e-12
        assert np.linalg.norm(regular(np.zeros(count), v)[0]) < 1.0
        on_edge = z / np.linalg.norm(z)
        assert on_edge @ friction(on_edge, v)[1] <= 1e-9 * np.linalg.norm(v) / LAW.presliding


def test_a_wild_slip_keeps_the_state_in_the_unit_disc():
    friction = Friction(2)

    def slip(t):
        return np.array([0.3 * math.sin(40 * t) + 0.1 * math.sin(171 * t), 0.2 * math.cos(55 * t)])

    found = solve_ivp(lambda t, z: friction(z, slip(t))[1], (0.0, 0.3), [0.0, 0.0], rtol=1e-9, atol=1e-10)
    sizes = np.linalg.norm(found.y, axis=0)
    assert sizes.max() <= 1.0 + 1e-7
    assert sizes.max() > 0.99


@pytest.mark.parametrize("speed", [1e-5, 1e-2, 2.0])
def test_a_steady_slip_has_all_of_the_friction_along_it(speed):
    friction, way = Friction(2), np.array([0.6, -0.8])
    end = 30.0 * (LAW.presliding / speed + 1e-3)
    found = solve_ivp(lambda t, z: friction(z, speed * way)[1], (0.0, end), [-0.3, 0.2], "LSODA", rtol=1e-9, atol=1e-11)
    assert found.y[:, -1] == pytest.approx(way, abs=1e-6)
    assert friction(found.y[:, -1], speed * way)[0] == pytest.approx(way, abs=1e-6)


DAMPED = LAW.model_copy(update={"dissipation": 30.0})


def block(pull, mass=0.5, law=DAMPED, end=2.0):
    """Displacement of a block on a plane that presses it with its weight and pulls with a share of the limit."""
    friction, weight = Friction(1, law), mass * 9.81
    limit = law.friction * weight

    def rate(t, x):
        share, z_rate = friction(x[2:], x[1:2])
        return [x[1], (pull(t) - share[0]) * limit / mass, z_rate[0]]

    t = np.linspace(0.0, end, 401)
    return solve_ivp(rate, (0.0, end), [0.0, 0.0, 0.0], "LSODA", t, rtol=1e-9, atol=1e-13, max_step=2e-3).y


@pytest.mark.parametrize("share", [0.2, 0.45, 0.7, 0.9])
def test_a_steady_pull_below_the_cone_does_not_creep(share):
    """The pull grows within 0.2 s; where it has settled the block stays to a nanometre."""
    x = block(lambda t: share * min(1.0, t / 0.2))
    late = x[0, 200:]
    assert np.ptp(late) < 1e-9
    assert x[2, -1] == pytest.approx(share, abs=1e-3)
    if share < 0.5:
        assert late[-1] == pytest.approx(share * LAW.presliding, rel=1e-3)


def test_a_shaken_contact_below_half_the_cone_comes_back():
    """A Dahl model would walk by 2.7 times the amplitude with every period."""
    x = block(lambda t: (0.3 + 0.15 * math.sin(2 * math.pi * 5 * t)) * min(1.0, t / 0.2))
    once_a_period = x[0, 120::40]
    assert np.ptp(x[0, 120:]) > 0.25 * LAW.presliding
    assert np.ptp(once_a_period) < 1e-4 * LAW.presliding


@pytest.mark.parametrize("share", [1.2, 2.0])
def test_a_pull_above_the_cone_slips_with_what_is_left(share):
    x = block(lambda t: share, end=1.0)
    t = np.linspace(0.0, 1.0, 401)
    acceleration = np.polyfit(t[200:], x[1, 200:], 1)[0]
    assert acceleration == pytest.approx((share - 1.0) * LAW.friction * 9.81, rel=1e-4)


def test_an_open_contact_forgets_and_a_touching_one_does_not():
    friction, time = Friction(1), math.sqrt(ROD.mass / LAW.stiffness)
    for gap, rate in ((-EDGE, 0.0), (EDGE, 0.0), (3.0 * EDGE, -0.8 * 0.2 / time), (1.0, -0.8 * 0.2 / time)):
        assert friction([0.8], [0.0], gap)[1] == pytest.approx([rate], abs=1e-9)


@pytest.mark.parametrize(
    ("speed", "share"), [(1e-3, 1 / math.sqrt(2)), (-1e-3, -1 / math.sqrt(2)), (1.0, 1.0), (0.0, 0.0)]
)
def test_a_slip_speed_needs_no_state(speed, share):
    law = ContactLaw(stiffness=1.0e3, friction=0.4, slip_speed=1e-3)
    touch = TouchLaw(law, ROD)
    assert touch.displacement is None
    assert float(ca.DM(touch.friction_share([], [ca.DM(speed)])[0])) == pytest.approx(share, abs=1e-6)
    assert touch.friction_rate(0.0, [], [0.0]) == []


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"presliding": 1e-4, "slip_speed": 1e-3}, "no effect beside slip_speed"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"friction": -0.1}, "friction"),
        ({"rounding": 0.0}, "rounding"),
        ({"softness": 1.0}, "unknown key"),
    ],
)
def test_impossible_laws_are_refused(keys, words):
    with pytest.raises(InputError, match=words):
        ContactLaw(**{"stiffness": 1e3, "friction": 0.5, **keys})


@pytest.mark.parametrize("keys", [{"stiffness": 1.0}, {"stiffness": 1e8}, {"rounding": 0.01}, {"friction": 5.0}])
def test_unlikely_laws_are_doubted(keys):
    with pytest.warns(UserWarning, match=f"ContactLaw.{next(iter(keys))} = "):
        ContactLaw(**{"stiffness": 1e3, "friction": 0.5, **keys})


@pytest.mark.parametrize("length", [0.003, 0.18, 2.0])
def test_what_a_law_leaves_open_is_a_share_of_the_length(length):
    """A soft onset alone does not let an object slide further before it slips: a held mug would sink."""
    rod = Rod(length=length, linear_density=0.03, bending_stiffness=0.02)
    law = ContactLaw(stiffness=1.0e3, friction=0.4)
    touch = TouchLaw(law, rod)
    assert (touch.rounding, touch.displacement) == pytest.approx((length / 18000.0, length / 1800.0))
    soft = TouchLaw(law.replaced(rounding=0.002 * length), rod)
    assert soft.rounding == 0.002 * length
    assert soft.displacement == touch.displacement
