"""Tendons with friction: what their history makes of the same tensions, by closed forms and by a chain of guides."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.simulation import equilibrium_path, equilibrium_under
from tests.rods import ROOT
from tests.tendon_cases import LENGTH, OFFSET, PASSIVE, STIFFNESS, Loaded, bend, finger, model, way
from tests.truth.differences import differences
from tests.truth.tendon import HingedFinger

FORMS = {
    "one pulled": (0.1, [20.0, 0.0], "pulling", 2.58201009),
    "one released": (0.1, [10.0, 0.0], "releasing", -math.log(1 - 0.1 * OFFSET / STIFFNESS * 10.0 * LENGTH) / 0.1),
    "one pulled against the other": (0.1, [20.0, 6.0], "pulling", 1.72252137),
    "against much friction": (0.3, [20.0, 6.0], "pulling", 1.26368692),
    "the other way": (0.1, [6.0, 20.0], "pulling", -1.72252137),
}


@pytest.mark.parametrize("name", FORMS)
def test_shapes_at_rest_are_those_of_closed_forms(name):
    friction, tensions, reached_by, angle = FORMS[name]
    for elements, error in ((2, 5e-3), (12, 2e-4)):
        made = model(friction, elements=elements)
        found = equilibrium_under(made, tensions, np.zeros(made.nw), reached_by=reached_by)
        assert bend(made, found.q) == pytest.approx(angle, rel=error)
        assert found.friction_states == pytest.approx(np.sign(angle) * (1 if reached_by == "pulling" else -1))


def test_where_nothing_slid_friction_acts_neither_way():
    """Two tendons that pull alike leave the finger straight, whatever it is said to have come from."""
    made = model(0.2)
    for how in ("pulling", "releasing"):
        found = equilibrium_under(made, [8.0, 8.0], np.zeros(made.nw), reached_by=how)
        assert bend(made, found.q) == pytest.approx(0.0, abs=1e-9)
        assert found.friction_states == pytest.approx(0.0, abs=1e-6)


def plays(values, radius, first):
    """The play operator of a radius (or radii) along a way that starts by sliding: ``first`` is its sign then."""
    z = values[0] + first * radius
    for value in values[1:]:
        z = np.clip(z, value - radius, value + radius)
    return z


def bend_of_history(friction, tensions, sheath=0.0):
    """Closed form: ln T past a sheath of fixed bend, and 1/T along the finger, are plays of what is before."""
    after = [math.exp(plays(np.log(tensions[: k + 1]), friction * sheath, -1.0)) for k in range(len(tensions))]
    s = (np.arange(4000) + 0.5) / 4000 * LENGTH
    inverse = plays(1.0 / np.array(after), friction * OFFSET / STIFFNESS * s, 1.0)
    return OFFSET / STIFFNESS * LENGTH * float(np.mean(1.0 / inverse))


@pytest.mark.parametrize(
    ("points", "angle"), [([1.0, 20.0, 12.0], 1.94506789), ([1.0, 20.0, 0.3], 0.04428778), ([1, 20, 5, 14, 8], None)]
)
def test_any_history_ends_at_the_closed_form(points, angle):
    """In the square of the number of cells."""
    exact = bend_of_history(0.1, way(points, 1.0))
    assert angle is None or exact == pytest.approx(angle, abs=1e-7)
    errors = []
    for cells in (1, 2, 4) if points[-1] == 12.0 else (2,):
        loaded = Loaded(model(0.1, elements=4, friction_cells=cells, presliding=1e-6))
        errors.append(abs([loaded.move([tension, 0.0]) for tension in way(points, 1.0)][-1] - exact))
    assert errors[-1] < 1e-4
    assert np.divide(errors[:-1], errors[1:]) == pytest.approx(4.0, rel=0.05)


def test_a_sheath_plays_before_the_finger():
    """Released, the finger stays where it is until the tension has fallen by exp(-2 friction bend)."""
    made = model(0.1, elements=4, conduit_bend=1.5, presliding=1e-6)
    loaded, tensions = Loaded(made), way([0.5, 20.0, 6.0, 15.0, 9.0], 0.5)
    found = [loaded.move([tension, 0.0]) for tension in tensions]
    exact = [bend_of_history(0.1, tensions[: k + 1], 1.5) for k in range(len(tensions))]
    assert np.abs(np.subtract(found, exact)).max() < 3e-3 * max(exact)
    most = tensions.index(20.0)
    held = [k for k in range(most, most + 14) if tensions[k] > 20.0 * math.exp(-0.3)]
    assert len(held) > 5
    assert np.ptp(np.array(found)[held]) < 1e-3


def test_releasing_leaves_what_is_beyond_the_front_as_it_was():
    """1/T(s) is the play of 1/T at the base, of radius mu e s/EI: 20 N, then 12 N."""
    pulled = Loaded(model(0.1, elements=12, presliding=1e-6))
    for tension in way([0.5, 20.0, 12.0], 0.5):
        angle = pulled.move([tension, 0.0])
    assert angle == pytest.approx(1.94506789, rel=2e-3)
    front = (1 / 12.0 - 1 / 20.0) / (2 * 0.1 * OFFSET / STIFFNESS) / LENGTH
    middle = (np.arange(24) + 0.5) / 24
    assert np.all(pulled.states[middle < front - 0.05] < -0.99)
    assert np.all(pulled.states[middle > front + 0.05] > 0.5)


@pytest.mark.deep
def test_a_path_of_equilibria_remembers():
    """Pulled to 20 N in steps, let out to 12 and to 0.3 N; no step matters, as long as they go one way."""
    given = cg.Scene(
        finger=cg.Finger(
            **PASSIVE, tendons=[{"offset": OFFSET, "max_tension": 60.0, "friction": 0.1, "presliding": 1e-6}]
        ),
        gravity=(0.0, 0.0),
        actuation={"tensions": [20.0]},
        fidelity={"family": "clothoid", "elements": 12},
    )
    path = equilibrium_path(given, [0.2, 0.5, 0.8, 1.0, 0.8, 0.6, 0.3, 0.1, 0.015])
    bends = [bend(found.model, found.q) for found in path]
    assert bends[3] == pytest.approx(2.58201009, rel=2e-4)
    assert bends[5] == pytest.approx(1.94506789, rel=2e-4)
    assert bends[8] == pytest.approx(0.04428778, abs=1e-5)


@pytest.mark.deep
@pytest.mark.parametrize(("friction", "most"), [(0.1, (0.012, 0.006)), (0.3, (0.035, 0.026))])
def test_loops_are_those_of_a_chain_of_guides(friction, most):
    """With inner loops; the greatest difference of the bend per its range, at one and at two cells per element."""
    chain = HingedFinger(LENGTH, STIFFNESS, OFFSET, friction, sides=(1.0,), hinges=30)
    tensions = way([1.0, 20.0, 6.0, 14.0, 1.0, 20.0], 1.0)
    exact = []
    for tension in tensions:
        chain.move([("tension", tension)])
        exact.append(chain.angle)
    for cells, error in zip((1, 2), most, strict=True):
        own = Loaded(model(friction, friction_cells=cells))
        found = [own.move([tension, 0.0]) for tension in tensions]
        assert np.abs(np.subtract(found, exact)).max() <= error * np.ptp(exact)


def test_nested_loops_close():
    """Return-point memory: after an inner loop the outer one goes on as if there had been none."""
    loaded = Loaded(model(0.1))
    for tension in way([0.5, 20.0, 8.0], 0.5):
        before = loaded.move([tension, 0.0])
    states = loaded.states
    for tension in way([8.0, 13.0, 8.0], 0.5):
        after = loaded.move([tension, 0.0])
    assert after == pytest.approx(before, abs=1e-9)
    assert loaded.states == pytest.approx(states, abs=1e-6)


def test_small_cycles_shake_down():
    """They do not add up without end, as they do with Dahl's law."""
    loaded = Loaded(model(0.2, friction_cells=1))
    for tension in way([0.5, 12.0], 0.5):
        loaded.move([tension, 0.0])
    ends = []
    for _ in range(15):
        for force in (-0.035, -0.05, -0.065, -0.05):
            angle = loaded.move([12.0, 0.0], (force, 0.0))
        ends.append(angle)
    assert abs(ends[-1] - ends[-2]) < 1e-7


def test_cycles_of_a_force_creep_as_far_as_those_of_the_chain():
    """A force of 0.05 N against 12 N goes to and fro by 0.015 N: 1.459 rad grow to 1.511 in a chain of 100 guides."""
    loaded = Loaded(model(0.2))
    for tension in way([1.0, 12.0], 1.0):
        angle = loaded.move([tension, 0.0], (0.05, 0.0))
    assert angle == pytest.approx(1.4587, abs=1e-3)
    for _ in range(25):
        for force in way([0.05, 0.065, 0.035, 0.05], 0.0075)[1:]:
            angle = loaded.move([12.0, 0.0], (force, 0.0))
    assert angle == pytest.approx(1.5118, abs=5e-3)


SCENE = {"gravity": [0.0, 0.0], "fidelity": {"family": "clothoid"}}
RISING = {"times": [0.0, 0.3, 0.6], "values": [0.0, 22.0, 10.0]}


@pytest.mark.deep
@pytest.mark.parametrize("lag", [None, 0.02])
def test_a_motion_ends_where_its_history_says_and_does_not_creep(lag):
    scene = cg.Scene(
        finger=finger(0.1, time_constant=lag),
        actuation={"tensions": [RISING, 0.0]},
        time={"duration": 10.0, "step": 0.02},
        **SCENE,
    )
    motion = cg.simulate(scene)
    bends = [bend(motion.model, q) for q in motion.q]
    # between what pulling and releasing alone would leave, and there to stay
    assert 1.374 < bends[-1] < 1.5937
    assert np.ptp(bends[-250:]) < 1e-6
    states = motion.x[:, -len(motion.model.friction_names) :]
    assert np.abs(states[-1]).max() <= 1.0 + 1e-9
    assert states[-1] == pytest.approx(states[-250], abs=1e-5)


def test_what_starts_at_rest_stays_there_whatever_its_history():
    """Friction states between -1 and 1 too, for ten seconds."""
    start = {"pose": "equilibrium", "reached_by": "state", "friction_states": [0.9, -0.5, 0.3, 0.9]}
    time = {"duration": 10.0, "step": 0.05}
    motion = cg.simulate(
        cg.Scene(finger=finger(0.2), actuation={"tensions": [12.0, 1.0]}, initial=start, time=time, **SCENE)
    )
    assert motion.x == pytest.approx(np.tile(motion.x[0], (len(motion.t), 1)), abs=1e-8)
    y = np.clip(motion.x[0, -4:], -1.0, 1.0)
    assert 1.5 * y - 0.5 * y**3 == pytest.approx([0.9, -0.5, 0.3, 0.9])


@pytest.mark.deep
def test_wound_up_tendons_do_not_creep():
    to = [{"times": [0.0, 0.3, 0.6], "values": [0.0, s * 0.012, s * 0.007]} for s in (1.0, -1.0)]
    keys = {"axial_stiffness": 1e4, "series_stiffness": 1 / 3e-5}
    drive = {"kind": "length", "time_constant": 0.02, "pretension": 2.0}
    own, time = finger(0.2, **keys, drive=drive), {"duration": 15.0, "step": 0.02}
    motion = cg.simulate(cg.Scene(finger=own, actuation={"lengths": to}, time=time, **SCENE))
    still = motion.t >= 5.0  # it rings before
    assert np.ptp(motion.tensions[still, 0]) < 1e-4
    assert np.ptp(motion.x[still, -4:], axis=0) == pytest.approx(np.zeros(4), abs=1e-4)


@pytest.mark.parametrize("beyond", [0.0, 20e-6, -20e-6])
def test_derivatives_hold_where_the_law_bends(beyond):
    """Straight, at the ends of the range of friction states, and where a tendon goes slack."""
    keys = {"axial_stiffness": 1e4, "series_stiffness": 1 / 3e-5, "drive": {"kind": "length", "time_constant": 0.02}}
    made = cg.FingerModel(finger(0.3, **keys), family="clothoid", elements=2, gravity=(0, 0))
    n, x, u = made.n, np.zeros(made.nx), np.zeros(made.nu)
    x[[2 * n, 2 * n + 2]] = beyond, 1e-3
    x[-4:] = 1.0, -1.0, 1.0, -1.0
    slope = np.array(made.linearization(x, u, np.zeros(made.nw), [])[0])[n : 2 * n]

    size = np.where(np.arange(made.nx) < 2 * n, 1e-5, 1e-9)
    size[-4:] = 1e-5
    expected = differences(lambda x: made.forward_dynamics(x, u, np.zeros(made.nw), []), x, size)[n : 2 * n]
    assert slope == pytest.approx(expected, rel=1e-4, abs=1e-8 * np.abs(slope).max())


def test_friction_costs_what_it_is_worth():
    def cost(**tendons):
        own = cg.FingerModel(finger(**tendons), family="clothoid", elements=2)
        return own.instructions, own.nx

    free, lagged = cost(friction=0.0), cost(friction=0.0, time_constant=0.02)
    assert cost(friction=0.0, friction_cells=4, presliding=1e-5) == free
    one, two = (cost(friction=0.1, friction_cells=cells, time_constant=0.02) for cells in (1, 2))
    assert one[0] <= lagged[0] + 200
    assert two[0] <= lagged[0] + 340
    # tensions and rates of both tendons in place of a moment and its rate, and a state per cell
    assert (one[1], two[1]) == (lagged[1] + 2 + 2, lagged[1] + 2 + 4)


def test_a_sheath_is_one_more_cell():
    made = model(0.1, conduit_bend=1.5)
    plain = equilibrium_under(model(0.1), [20.0 * math.exp(-0.15), 0.0], [0.0, 0.0])
    found = equilibrium_under(made, [20.0, 0.0], [0.0, 0.0])
    assert found.q == pytest.approx(plain.q, abs=1e-8)
    assert made.friction_names[0] == "friction_1_conduit [1]"


def test_every_tendon_has_its_own_friction():
    """On one side without, on the other with: the same as a pair with and without."""
    tendons = [{"offset": OFFSET, "max_tension": 60.0, "friction": 0.2}, {"offset": -OFFSET, "max_tension": 60.0}]
    mixed = cg.FingerModel(cg.Finger(**PASSIVE, tendons=tendons), family="clothoid", elements=2, gravity=(0, 0))
    for pair, tensions in ((model(0.2), [9.0, 0.0]), (model(0.0), [0.0, 9.0])):
        one, other = (equilibrium_under(made, tensions, [0.0, 0.0]) for made in (mixed, pair))
        assert one.q == pytest.approx(other.q, abs=1e-8)


def test_an_equilibrium_names_its_history():
    scene = {"finger": finger(0.1), "actuation": {"tensions": [10.0, 0.0]}, **SCENE}
    with pytest.raises(InputError, match=r"initial.reached_by: tendons with friction hold a finger anywhere between"):
        cg.equilibrium(cg.Scene(**scene))

    def angle(**initial):
        found = cg.equilibrium(cg.Scene(**scene, initial=initial))
        return bend(found.model, found.q)

    assert angle(reached_by="pulling") == pytest.approx(1.374, abs=1e-3)
    assert angle(reached_by="releasing") == pytest.approx(1.593, abs=1e-3)
    free = 10.0 * OFFSET * LENGTH / STIFFNESS
    assert angle(reached_by="state", friction_states=[0.0] * 4) == pytest.approx(free)
    with pytest.raises(InputError, match=r"friction_states: expected 4 entries, one per friction cell"):
        angle(reached_by="state", friction_states=[0.0])
    with pytest.raises(InputError, match=r"friction_states and reached_by: state need each other"):
        angle(reached_by="state")
    with pytest.raises(InputError, match=r"initial.reached_by: has no effect: neither tendons nor bending"):
        cg.Scene(finger=finger(0.0), initial={"reached_by": "pulling"}, gravity=(0, 0))
    release = cg.load(ROOT / "configs/plan/release.yaml", {"initial": {"reached_by": "pulling"}})
    assert release.initial == cg.Initial(pose="rest", reached_by="pulling")


@pytest.mark.parametrize("parameters", [(), ("rest_curvature",)])
def test_a_tapered_tendon_slides_by_its_offset_from_rest_on(parameters):
    """Closed form: the curvature above rest times the integral of the offset beyond the middle of each cell."""
    rest, bent, tip, presliding = 7.0, 4.0, 0.003, 20e-6
    tendon = {"offset": [OFFSET, tip], "max_tension": 60.0, "friction": 0.1, "presliding": presliding}
    whole = cg.Finger(**PASSIVE, tendons=[tendon], rest_curvature=rest)
    made = cg.FingerModel(whole, family="clothoid", elements=2, parameters=parameters)
    beyond = 1.0 - made.tension_places()[0] / LENGTH
    drawn = bent * LENGTH * beyond * (OFFSET + (tip - OFFSET) * (1.0 - 0.5 * beyond))
    slid = np.array(made.sliding()(np.full(made.n, bent), [0.0], made.p_nominal)).ravel()
    assert slid == pytest.approx(drawn / math.hypot(1.0, (tip - OFFSET) / LENGTH) / presliding, rel=1e-12)
