"""Plants that are chains of guides: against chains of the tests, closed forms, balances and plants of elements."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

import continuum_grasp as cg
from continuum_grasp.closed_loop import Plant, PlantModel
from continuum_grasp.scene import ControlScene
from tests.tendon_cases import LENGTH, OFFSET, PASSIVE, ROD, STIFFNESS
from tests.truth.geared_chain import GearedChain
from tests.truth.tendon_motion import MovingFinger

STILL = {"rod": {**ROD, "linear_density": 1e-9}}
PAIR = {"offset": OFFSET, "max_tension": 60.0}


def scene(finger, plant, **further):
    given = {
        "finger": finger,
        "gravity": [0.0, 0.0],
        "controller": {"horizon": {"stages": 5}, "cost": {"tip": {"running": 1.0}, "effort": 1e-3}},
        "reference": {"tip": [0.1, 0.1]},
        "plant": plant,
        "initial": {"pose": "straight"},
        **further,
    }
    return ControlScene.model_validate(given)


class Chain:
    """A plant of guides, on which inputs act step by step."""

    def __init__(self, finger, guides, **further):
        self.model = PlantModel(scene(finger, {"guides": guides, "axial_stiffness": 1e4}, **further))
        self.steps, self.x, self.n = self.model.integration("guides"), self.model.start, guides

    def go(self, u, step=1.0, count=1):
        self.x = self.steps.advance(self.x, np.asarray(u, dtype=float), 0.0, step, count)[-1]
        return self.angle

    @property
    def angle(self):
        return float(self.x[: self.n].sum())


def at_rest(guides, friction, tendons):
    return Chain({**STILL, "damping": {"material": 1e-12}, "tendons": tendons(friction)}, guides)


def single(friction):
    return [PAIR | {"friction": friction}]


def pair(friction):
    return PAIR | {"friction": friction}


def of_closed_forms(guides):
    """Errors of bends by closed forms [rad]: pulled, let out to 12 N and to 0.3 N, and one of two tendons pulled."""
    one = at_rest(guides, 0.1, single)
    for tension in np.linspace(0.5, 20.0, 40):
        pulled = one.go([tension])
    for tension in np.linspace(19.5, 12.0, 16):
        let_out = one.go([tension])
    for tension in np.linspace(11.5, 0.3, 23):
        released = one.go([tension])
    two = at_rest(guides, 0.1, pair)
    for tension in np.linspace(6.0, 20.0, 30):
        both = two.go([tension, 6.0])
    found = np.array([pulled, let_out, released, both])
    return np.abs(found - [2.58201009, 1.94506789, 0.04428778, 1.72252137])


def test_bends_at_rest_are_those_of_closed_forms_with_the_square_of_the_number_of_guides():
    few, more = of_closed_forms(10), of_closed_forms(20)
    assert np.all(few < 3e-4)
    assert few[[0, 1, 3]] / more[[0, 1, 3]] == pytest.approx(4.0, rel=0.02)
    assert few[2] < 1e-8


@pytest.mark.parametrize("reached_by", ["pulling", "releasing"])
def test_it_starts_in_the_balance_that_its_history_says(reached_by):
    """A preshaped finger under 8 N: by the capstan law along it, and nothing moves."""
    rest, friction, steps = -12.0, 0.3, 4000
    tendon = PAIR | {"friction": friction, "min_tension": 8.0}
    finger = {**STILL, "damping": {"material": 1e-12}, "tendons": [tendon], "rest_curvature": rest}
    chain = Chain(finger, 40, initial={"pose": "equilibrium", "reached_by": reached_by})
    tension, bent = 8.0, 0.0
    for _ in range(steps):
        curvature = rest + OFFSET * tension / STIFFNESS
        bent += curvature * LENGTH / steps
        lost = friction * abs(curvature) * LENGTH / steps
        tension *= np.exp(-lost if reached_by == "pulling" else lost)
    assert chain.angle == pytest.approx(bent, rel=2e-3)
    before = chain.angle
    assert chain.go([8.0], count=3) == pytest.approx(before, abs=1e-4)


def test_it_moves_as_the_chain_of_the_tests_does_but_for_its_steps():
    chain = Chain({**PASSIVE, "tendons": pair(0.15)}, 16)
    pulls = [(1.0 + 9.0 * np.sin(0.04 * k) ** 2, 2.0) for k in range(80)]
    angles = np.array([chain.go(u, 1e-3, 8) for u in pulls])
    errors = []
    for parts in (2, 4):
        truth = MovingFinger(LENGTH, STIFFNESS, OFFSET, 0.15, hinges=16, time_step=1e-3 / parts)
        found = []
        for u in pulls:
            for _ in range(parts):
                truth.advance([("tension", u[0]), ("tension", u[1])])
            found.append(truth.angle)
        errors.append(np.abs(np.array(found) - angles).max())
    # What is left is of the truth's steps, which decide sliding by differences of first order.
    assert errors[1] < 4e-3 < np.ptp(angles) / 50.0
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.3)


def test_nothing_creeps_at_rest_and_a_slack_tendon_forgets():
    chain = Chain({**PASSIVE, "tendons": single(0.3)}, 16)
    for tension in (*np.linspace(0.0, 15.0, 30), *np.linspace(15.0, 9.0, 12)):
        chain.go([tension], 0.02, 20)
    angle = chain.go([9.0], 2.0, 400)
    assert chain.go([9.0], 10.0, 2000) == pytest.approx(angle, abs=1e-7)
    chain.go([0.0], 20.0, 4000)
    n = chain.n
    assert np.all(chain.x[2 * n : 3 * n + 1] == 0.0)
    assert abs(chain.angle) < 1e-6
    assert chain.go([5.0], 1.0, 1000) > 0.3


def test_it_sags_under_its_weight_as_a_beam_does():
    """Gravity across, so little that bends stay small: w L3/(6 EI) + m g L2/(2 EI) at the tip."""
    chain = Chain({**PASSIVE, "tendons": single(0.0)}, 40, gravity=[0.1, 0.0])
    angle = chain.go([0.0], 4.0, 800)
    weight, tip = 0.1 * 0.034, 0.1 * 0.002
    wanted = weight * LENGTH**3 / (6.0 * STIFFNESS) + tip * LENGTH**2 / (2.0 * STIFFNESS)
    assert angle == pytest.approx(-wanted, rel=2e-3)


def test_a_tapered_chain_has_the_integrals_of_its_rod():
    """A cone: its compliance in closed form, mass moments about the first hinge as integrals of polynomials."""
    length, wide, narrow, young, density, n = 0.2, 3e-3, 1.5e-3, 60e9, 6500.0, 10
    section = {"to": length, "diameter": [wide, narrow]}
    rod = {"length": length, "youngs_modulus": young, "density": density, "sections": [section]}
    finger = cg.Finger(rod=rod, half_thickness=6e-3, tendons={"offset": 5e-3, "max_tension": 60.0})
    links = PlantModel(scene(finger, {"guides": n, "axial_stiffness": 1e4})).chain.links
    slope = (wide - narrow) / length
    compliance = 64.0 / (np.pi * young) * (narrow**-3 - wide**-3) / (3.0 * slope)
    assert np.sum(1.0 / links.stiffness) == pytest.approx(compliance, rel=1e-10)
    diameter, lever = Polynomial([wide, -slope]), Polynomial([-links.at[0], 1.0])
    per_length, rotary = density * np.pi / 4.0 * diameter**2, density * np.pi / 64.0 * diameter**4
    integrals = ((per_length * lever**2 + rotary).integ(), (per_length * lever).integ())
    turning, weight = (one(length) - one(links.at[0]) for one in integrals)
    products, moments = links.turning
    assert np.sum(products) == pytest.approx(turning, rel=1e-10)
    assert np.sum(moments) == pytest.approx(weight, rel=1e-10)


@pytest.mark.parametrize("arrangement", ["one_pulley", "per_tendon"])
def test_a_motor_at_rest_holds_what_its_tendons_pull(arrangement):
    """The torque of its servo is radius times tension, on a pulley times the difference."""
    drive = {"kind": "motor", "arrangement": arrangement, "winch_radius": 0.008, "inertia": 2e-6, "pretension": 2.0}
    drive |= {"torque_max": 0.4, "position_gain": 0.8, "rate_gain": 2.5e-3}
    tendons = PAIR | {"friction": 0.1, "axial_stiffness": 1e4, "series_stiffness": 3e4, "drive": drive}
    control = {"horizon": {"stages": 5}, "cost": {"tip": {"running": 1.0}, "effort": 1e-3}}
    control["input"] = {"angles": [-1.5, 1.5]}
    chain = Chain({**PASSIVE, "tendons": tendons}, 12, controller=control)
    u = np.array([0.7, -0.2])[: 1 if arrangement == "one_pulley" else 2]
    chain.go(u, 4.0, 1600)
    system = chain.model.system
    pulls = np.array(system.tensions(chain.x, u, [])).ravel()
    at = [k for k, name in enumerate(system.x_names) if name.startswith("motor_angle") and "rate" not in name]
    turned = chain.x[at]
    wanted = [pulls[0] - pulls[1]] if arrangement == "one_pulley" else pulls
    assert 0.8 * (u - turned) == pytest.approx(0.008 * np.asarray(wanted), rel=1e-4)
    assert abs(wanted[0]) > 3.0


@pytest.mark.deep
@pytest.mark.parametrize(
    ("stiffness", "play", "start", "side"),
    [(20.0, 0.1, {"slack": 5e-4}, 1.0), (2000.0, 0.02, {"pretension": 1.0}, -1.0)],
)
def test_a_gear_with_play_moves_as_the_chain_of_the_tests_does(stiffness, play, start, side):
    """Driven to and fro through the play, without friction; the tests' drum is found by bracketing in every rate."""
    drive = {"kind": "motor", "arrangement": "one_pulley", "winch_radius": 0.008, "inertia": 2e-6, "torque_max": 0.4}
    drive |= {"viscous_friction": 2e-4, "backlash": play, "gear_stiffness": stiffness, **start}
    tendons = PAIR | {"axial_stiffness": 1e4, "series_stiffness": 1 / 3e-5, "drive": drive}
    chain = Chain({**PASSIVE, "tendons": tendons}, 8)
    bars = MovingFinger(LENGTH, STIFFNESS, OFFSET, 0.0, hinges=8)
    wound = start.get("pretension", 0.0) * (3e-5 + LENGTH / 1e4) - start.get("slack", 0.0)
    truth = GearedChain(bars, wound, play, stiffness)
    names = chain.model.system.x_names
    at = names.index("motor_angle_1 [rad]")
    for torque, duration in ((0.02, 0.03), (-0.02, 0.045)):
        angle = chain.go([side * torque], duration, 180)
        x = truth.go(side * torque, duration)
        assert angle == pytest.approx(x[:8].sum(), abs=3e-5)
        assert chain.x[at] == pytest.approx(x[-2], abs=3e-5)


def test_a_conduit_takes_its_share_before_the_finger():
    own = [PAIR | {"friction": 0.1, "conduit_bend": 3.0}]
    chain = Chain({**STILL, "damping": {"material": 1e-12}, "tendons": own}, 20)
    for tension in np.linspace(0.5, 20.0, 40):
        angle = chain.go([tension])
    arriving = 20.0 * np.exp(-0.3)
    assert angle == pytest.approx(np.log(1.0 + 0.1 * OFFSET / STIFFNESS * arriving * LENGTH) / 0.1, rel=1e-4)


def test_friction_acts_towards_the_base_while_it_is_pulled_and_turns_around_from_there():
    chain = at_rest(10, 0.1, single)
    near, far = (chain.model.friction_along(0, a * LENGTH, (a + 0.3) * LENGTH) for a in (0.0, 0.7))
    along = chain.model.function("along", near=near, far=far)
    found = []
    for tensions in (np.linspace(2.0, 20.0, 10), [17.0, 15.5], [13.0, 10.0]):
        for tension in tensions:
            chain.go([tension])
        found.append(np.array(along(chain.x, [tension], chain.model.forces(0.0)[0])).ravel())
    assert np.concatenate(found) == pytest.approx([1.0, 1.0, -1.0, 1.0, -1.0, -1.0], abs=1e-6)


def test_a_section_turns_as_fast_as_the_hinges_before_it_together():
    """Of ten hinges in the middle of equal parts, three are before 0.3 of the length."""
    model = at_rest(10, 0.1, pair).model
    x = np.linspace(-1.0, 1.0, model.nx) ** 3
    rates = model.function("rates", rate=model.angle_rates((0.3 * LENGTH, LENGTH)))
    found = np.array(rates(x, [2.0, 1.0], model.forces(0.0)[0])).ravel()
    assert found == pytest.approx([x[10:13].sum(), x[10:20].sum()])


@pytest.mark.deep
def test_it_presses_an_object_as_a_plant_of_elements_does():
    """Without friction of tendons, under gravity in the plane; both come to rest."""
    around = {
        "gravity": [0.0, -9.81],
        "contacts": [0.09],
        "object": {"shape": "circle", "diameter": 0.06, "mass": 0.05, "position": [-0.045, 0.09]},
        "contact_law": {"stiffness": 2000.0, "friction": 0.4, "dissipation": 0.2, "rounding": 2e-4},
    }
    finger = {**PASSIVE, "tendons": PAIR | {"time_constant": 0.02}, "half_thickness": 0.006}
    forces = []
    for plant in ({"guides": 60, "axial_stiffness": 1e5}, {"fidelity": {"family": "clothoid", "elements": 6}}):
        tried = Plant(scene(finger, plant, **around))
        for _ in range(60):
            tried.advance([20.0, 0.0])
        touch = tried.model.function("touch", force=tried.model.touch["force"], gap=tried.model.touch["gap"])
        force, gap = touch(tried.x, [20.0, 0.0], tried.model.forces(0.0)[0])
        assert np.array(gap).min() < 0.0
        forces.append(np.array(force))
    assert np.abs(forces[0]).max() > 0.5
    assert forces[0] == pytest.approx(forces[1], abs=0.02 * np.abs(forces[1]).max())


@pytest.mark.parametrize(
    ("changes", "key", "words"),
    [
        ({"stops": {"curvature": 30.0, "stiffness_ratio": 20.0}}, "finger.stops", "stops"),
        ({"damping": {"material": 1e-3, "quadratic": 1e-4}}, "finger.damping.quadratic", "quadratic damping"),
    ],
)
def test_what_a_chain_does_not_cover_is_refused(changes, key, words):
    with pytest.raises(cg.InputError, match=words) as error:
        PlantModel(scene({**PASSIVE, "tendons": PAIR, **changes}, {"guides": 20, "axial_stiffness": 1e4}))
    assert error.value.key == key


def test_guides_are_elastic_and_have_no_elements_nor_presliding():
    without = {"axial_stiffness": None}
    for other, words in (({"fidelity": {"elements": 4}}, "fidelity"), ({"presliding": 1e-5}, "pre"), (without, "elas")):
        with pytest.raises(ValueError, match=words):
            scene({**PASSIVE, "tendons": PAIR}, {"guides": 20, "axial_stiffness": 1e4, **other})


def wound(guides, friction, finger=STILL, tendons=single, **drive):
    """A plant of guides whose tendons are wound up by lengths."""
    own = {"kind": "length", "time_constant": 0.02, **drive}
    cable = {"axial_stiffness": 1e4, "series_stiffness": 1 / 3e-5, "drive": own}
    given = tendons(friction)
    given = [one | cable for one in given] if isinstance(given, list) else given | cable
    asked = {
        "horizon": {"stages": 5},
        "cost": {"tip": {"running": 1.0}, "effort": 1.0},
        "input": {"lengths": [-0.02, 0.02]},
    }
    damping = finger.get("damping", {"material": 1e-12})
    made = Chain.__new__(Chain)
    made.model = PlantModel(
        scene({**finger, "damping": damping, "tendons": given}, {"guides": guides}, controller=asked)
    )
    made.steps, made.x, made.n = made.model.integration("guides"), made.model.start, guides
    return made


def test_a_winch_has_the_tension_of_the_closed_form():
    chain = wound(40, 0.1)
    for length in np.linspace(0.0005, 13.8255721e-3, 28):
        chain.go([length], 20.0)  # the servo must not overshoot, which friction would remember
    read = chain.model.function("t", t=chain.model.tensions)
    tension = float(np.array(read(chain.x, [0.0], chain.model.forces(0.0)[0])).item())
    assert tension == pytest.approx(20.0, rel=1e-3)
