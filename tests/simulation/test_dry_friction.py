"""Dry friction in bending: loops, memory, energy, motions, by closed forms and by a chain that shares no code."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.scene import Damping, Finger, Rod, Scene
from continuum_grasp.simulation import accuracy_report, equilibrium_path, equilibrium_under, initial_state
from tests.finger_cases import energy_rate
from tests.truth.bending_friction_chain import Chain, stop

LENGTH, STIFFNESS = 0.3, 0.15
BRANCHES = ((0.2, 0.3), (1.0, 0.1))  # N m2, N m
MODELS = (("arc", 1), ("arc", 3), ("clothoid", 2))


def finger(branches: Any = BRANCHES, **more: Any) -> Finger:
    """A uniform one."""
    given = [{"stiffness": k, "moment": m} for k, m in branches]
    damping = {"material": more.pop("material", 0.0), "dry_friction": given, **more.pop("damping", {})}
    rod = more.pop("rod", Rod(length=LENGTH, linear_density=0.2, bending_stiffness=STIFFNESS))
    return Finger(rod=rod, damping=Damping.model_validate(damping), **more)


def scene(**keys: Any) -> Scene:
    """Without gravity, by arcs, unless stated otherwise."""
    fidelity = {"family": keys.pop("family", "arc"), "elements": keys.pop("elements", 1)}
    return Scene.model_validate({"finger": finger(), "gravity": (0.0, 0.0), "fidelity": fidelity, **keys})


def curvatures(moments: Any) -> np.ndarray:
    """Of a uniform bend under a path of moments, by bisection of the law with stops."""
    found, z, last = [], np.zeros(len(BRANCHES)), 0.0
    stiffness, most = np.array(BRANCHES).T
    for wanted in moments:
        low, high = -100.0, 100.0
        for _ in range(80):
            kappa = 0.5 * (low + high)
            own = STIFFNESS * kappa + np.clip(z + stiffness * (kappa - last), -most, most).sum()
            low, high = (kappa, high) if own < wanted else (low, kappa)
        z, last = np.clip(z + stiffness * (kappa - last), -most, most), kappa
        found.append(kappa)
    return np.array(found)


def way(*turns: float, step: float = 0.05) -> np.ndarray:
    """Values from turn to turn."""
    parts = [np.linspace(a, b, max(2, round(abs(b - a) / step) + 1))[1:] for a, b in pairwise(turns)]
    return np.concatenate([[turns[0]], *parts])


def test_a_finger_without_it_pays_nothing():
    plain, sticks = (cg.FingerModel(finger(of), family="clothoid", elements=2) for of in ((), BRANCHES))
    assert (plain.nx, sticks.nx) == (2 * plain.n, 2 * plain.n + 8)

    def kinks(model):
        f = model.forward_dynamics
        return sum(f.instruction_id(k) in (ca.OP_FMIN, ca.OP_FMAX) for k in range(f.n_instructions()))

    assert (kinks(plain), kinks(sticks)) == (0, 16)
    given = cg.FingerModel(Finger(rod=plain.finger.rod), family="clothoid", elements=2)
    assert plain.instructions == given.instructions < sticks.instructions <= given.instructions + 17 * 8


@pytest.mark.deep
@pytest.mark.parametrize(("family", "elements"), MODELS)
def test_loops_of_a_moment_are_those_of_the_law(family, elements):
    moments = way(0.0, 1.0, -0.4, 0.6, -0.4, -0.8, 1.0)
    path = equilibrium_path(scene(family=family, elements=elements, actuation={"tip_moment": 1.0}), moments)
    found = np.array([at.model.bending(at.q, at.u, at.p).full().sum() / LENGTH for at in path])
    exact = curvatures(moments)
    assert found == pytest.approx(exact, abs=1e-8)
    # Work over closed loops is what friction takes, and Masing's rule: a branch is the first loading, doubled.
    assert (moments[48], moments[20]) == pytest.approx((moments[88], moments[-1]))
    assert (found[48], found[20]) == pytest.approx((found[88], found[-1]), abs=1e-8)
    unloading = exact[20] - found[20:49]
    assert unloading == pytest.approx(2.0 * curvatures(0.5 * (1.0 - moments[20:49])), abs=1e-8)
    work = np.trapezoid(moments[20:], found[20:])
    sliding = sum(np.trapezoid(stop(exact, *of)[20:], exact[20:]) for of in BRANCHES)
    assert work == pytest.approx(sliding, rel=1e-6)
    assert work > 0.0


@pytest.mark.deep
def test_nested_loops_close_and_small_cycles_do_not_ratchet():
    """Under a force across the tip, where every cell has another moment."""
    load = {"kind": "force", "at": LENGTH, "force": (1.0, 0.0)}
    forces = way(0.0, 5.0, 1.0, 4.0, 1.0, -2.0, step=0.25)
    path = equilibrium_path(scene(family="clothoid", elements=3, loads=[load]), forces)
    again = [k for k, force in enumerate(forces) if force == 1.0 and k > 20]
    first, last = (path[k] for k in again)
    assert first.q == pytest.approx(last.q, abs=1e-7)
    assert first.friction_states == pytest.approx(last.friction_states, abs=1e-7)
    cycles = np.concatenate([way(0.0, 4.0, step=0.25), np.tile([3.8, 4.0], 25)])
    path = equilibrium_path(scene(family="clothoid", elements=3, loads=[load]), cycles)
    tips = np.array([at.tip for at in path[-50:]])
    assert np.ptp(tips[3::2], axis=0) == pytest.approx(0.0, abs=1e-8)


@pytest.mark.parametrize(("family", "elements"), [*MODELS, ("clothoid", 16)])
def test_energy_falls_by_what_damping_and_sliding_take(family, elements):
    """d/dt of kinetic, bending and stored energy at random states, sliding ones among them."""
    rod = Rod(length=LENGTH, youngs_modulus=2e6, density=1100.0, sections=[{"to": LENGTH, "diameter": [0.03, 0.015]}])
    quadratic = {} if elements == 16 else {"damping": {"quadratic": 0.001}}
    for bent in (finger(material=0.003, **quadratic), finger(material=0.003, rod=rod)):
        model = cg.FingerModel(bent, family=family, elements=elements, tip_force=False)
        gained = energy_rate(model, [0.0])
        rng, n = np.random.default_rng(3), model.n
        own = bent.rod  # states return in a share of its natural time
        returning = np.sqrt(own.mass * LENGTH**3 / own.stiffness) / 64.0
        (placed,) = [placed for placed in model.structure.laws if placed.law.kind == "friction"]
        cells = np.array([port.measure for port in placed.ports])
        stored = (cells[:, None] * [m * m / k for k, m in BRANCHES]).ravel()
        for _ in range(20):
            z = rng.uniform(-2.0, 2.0, stored.size)
            scale = 0.5 if family == "arc" else 5.0
            state = np.concatenate([scale * rng.standard_normal(n), 3 * scale * rng.standard_normal(n), z])
            rate = model.forward_dynamics(state, [0.0], [], []).full().ravel()
            qd = state[n : 2 * n]
            damped = float(qd @ model.damping(state[:n], qd, [0.0], []).full().ravel())
            lost = damped + float(stored @ np.maximum(np.abs(z) - 1.0, 0.0)) / returning
            assert gained(state, rate) == pytest.approx(-lost, rel=1e-9)


@pytest.mark.deep
def test_a_swing_loses_what_coulomb_friction_takes():
    """One arc: potential energy EI k^2 L/2 falls by L M (k_1 + k_2 - 2 M/k) from turn to turn, whatever the inertia.

    A stiff branch takes 4 M/EI of the curvature a cycle.
    """
    for stiffness, moment in ((2.0, 0.1), (100.0, 0.05)):
        slack = moment / stiffness
        made = scene(
            finger=finger(((stiffness, moment),)),
            initial={"q": [6.0 * LENGTH], "reached_by": "state", "friction_states": [1.0]},
            time={"duration": 0.3, "step": 1e-4, "method": "reference"},
        )
        kappa = cg.simulate(made).q[:, 0] / LENGTH
        turns = kappa[[0, *(np.flatnonzero(np.diff(np.sign(np.diff(kappa)))) + 1)]]
        size = np.abs(turns[:5])
        assert np.all(size > 2 * slack)
        drop = 2.0 * moment / STIFFNESS * (1.0 - 2.0 * slack / (size[:-1] + size[1:]))
        assert size[:-1] - size[1:] == pytest.approx(drop, rel=2e-3)


@pytest.mark.deep
def test_quadratic_damping_takes_more_of_larger_swings():
    """Small swings of one arc, m x'' + c x'|x'| + k x = 0: (1 + a_1) exp(-a_1) = (1 - a_2) exp(a_2), a = 2 c/m size."""
    made = scene(
        finger=finger((), damping={"quadratic": 1e-4}),
        initial={"q": [0.1]},
        time={"duration": 0.6, "step": 2e-4, "method": "reference"},
    )
    found = cg.simulate(made)
    model = found.model
    mass = float(model.mass_matrix([0.0], [0.0], []))
    rate = 2.0 * float(model.damping([0.0], [1.0], [0.0], [])) / mass
    swing = found.q[:, 0]
    size = rate * np.abs(swing[[0, *(np.flatnonzero(np.diff(np.sign(np.diff(swing)))) + 1)]])
    assert size.size > 6
    assert (1.0 + size[:-1]) * np.exp(-size[:-1]) == pytest.approx((1.0 - size[1:]) * np.exp(size[1:]), rel=1e-4)
    assert size[1] / size[0] < size[6] / size[5] - 0.02
    assert cg.modes(made).damping_ratios == pytest.approx(0.0, abs=1e-12)


@pytest.mark.deep
def test_slow_motions_follow_the_loop_at_any_rate():
    """Rate independence: a force that goes to and fro in 4 s and in 8 s, against statics."""
    levels = [0.0, 5.0, 1.0, 4.0, 1.0]
    path = equilibrium_path(
        scene(family="clothoid", loads=[{"kind": "force", "at": LENGTH, "force": (1.0, 0.0)}]), way(*levels, step=0.25)
    )
    at_turns = [path[k].tip for k in np.cumsum([0, 20, 16, 12, 12])]
    for duration in (4.0, 8.0):
        times = np.linspace(0.0, duration, 5)
        force = {"times": times, "values": [(v, 0.0) for v in levels], "interpolation": "linear"}
        moving = scene(
            finger=finger(material=0.002),
            family="clothoid",
            loads=[{"kind": "force", "at": LENGTH, "force": force}],
            time={"duration": duration, "step": 0.01},
        )
        found = cg.simulate(moving)
        tips = found.tip[np.round(times / 0.01).astype(int)]
        assert tips == pytest.approx(np.array(at_turns), abs=0.005 * LENGTH * 4.0 / duration)


@pytest.mark.deep
@pytest.mark.parametrize("elements", [4, 16])
def test_releases_are_those_of_a_chain_of_hinges(elements):
    """Hanging, let go from an even bend with a body at the tip; sixteen elements by sweeps and implicit steps."""
    mass, inertia, dt = 0.2, 1e-4, 1e-3
    chain = Chain(LENGTH, 0.2, STIFFNESS, 0.003, BRANCHES, mass, hinges=24, inertia=inertia)
    chain.bend(5.0)
    body = {"mass": mass, "rotary_inertia": inertia}
    made = scene(
        finger=finger(material=0.003, tip_body=body, base={"angle": np.pi}),
        family="clothoid",
        elements=elements,
        gravity=(0.0, -9.81),
        initial={"q": [5.0] * (elements + 1), "reached_by": "pulling"},
        time={"duration": 0.5, "step": 0.01},
    )
    found = cg.simulate(made)
    exact = []
    for k in range(501):
        if k % 10 == 0:
            exact.append(chain.tip)
        chain.step(dt)
    missed = np.linalg.norm(found.tip - np.array(exact), axis=1)
    assert np.ptp(found.tip[:, 0]) > 0.5 * LENGTH
    assert missed.max() < 0.015 * LENGTH


def test_all_steps_agree_where_branches_are_stiff():
    """The spectral radius that explicit steps keep to has the branches while they stick, and their return."""
    keys = {"family": "clothoid", "initial": {"q": [4.0, 2.0], "reached_by": "pulling"}}
    stiff = finger(((3.0, 0.2),), material=1e-4)
    tips = {}
    for method in ("rk4", "rodas", "extrapolated_euler", "reference"):
        made = scene(finger=stiff, time={"duration": 0.2, "step": 0.001, "method": method}, **keys)
        tips[method] = cg.simulate(made).tip
    for method, tip in tips.items():
        assert tip == pytest.approx(tips["reference"], abs=4e-3 * LENGTH), method


def test_modes_that_stick_have_the_stiffness_of_the_branches():
    for family, elements in MODELS:
        made = scene(family=family, elements=elements, initial={"pose": "rest", "reached_by": "pulling"})
        found = cg.modes(made)
        stuck, sliding = found.stuck_frequencies_hz, found.frequencies_hz
        more = 1.0 + sum(k for k, _ in BRANCHES) / STIFFNESS
        assert stuck[0] / sliding[0] == pytest.approx(np.sqrt(more), rel=0.02 if family == "clothoid" else 1e-8)


def test_poses_name_how_they_were_reached():
    held = scene(loads=[{"kind": "force", "at": LENGTH, "force": (4.0, 0.0)}])
    with pytest.raises(InputError, match=r"initial.reached_by.*dry friction"):
        cg.equilibrium(held)
    pulled, released = (cg.equilibrium(held.changed({"initial.reached_by": how})) for how in ("pulling", "releasing"))
    assert pulled.friction_states.max() < -0.9
    assert released.friction_states.min() > 0.9
    assert abs(released.q[0]) > 1.2 * abs(pulled.q[0])
    model = pulled.model
    states = pulled.friction_states
    same = equilibrium_under(model, pulled.u, pulled.w, reached_by="state", friction_states=states)
    assert same.q == pytest.approx(pulled.q, rel=1e-6)


@pytest.mark.parametrize("moment", [0.01, 0.1, 1.0])
def test_released_shapes_are_where_the_loop_comes_back(moment):
    """Far out every stop is at its end; when it returns all turn, also those that end near the straight shape."""
    bent = curvatures(way(0.0, 12.0, moment, step=0.01))[-1]
    load = {"kind": "moment", "at": LENGTH, "moment": moment}
    released = cg.equilibrium(scene(loads=[load], initial={"pose": "equilibrium", "reached_by": "releasing"}))
    assert released.q[0] / LENGTH == pytest.approx(bent, rel=1e-9)
    posed = scene(initial={"q": [0.01], "reached_by": "releasing"})
    assert initial_state(posed, cg.FingerModel(posed))[-2:].tolist() == [-1.0, -1.0]


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="moment"):
        Damping.model_validate({"dry_friction": [{"stiffness": 1.0, "moment": 0.0}]})
    with pytest.raises(ValueError, match="matched_clothoid cannot carry dry friction"):
        scene(family="matched_clothoid")
    with pytest.raises(ValueError, match="reached_by: has no effect"):
        scene(finger=finger(()), initial={"pose": "rest", "reached_by": "pulling"})
    few = scene(initial={"pose": "rest", "reached_by": "state", "friction_states": [1.0]})
    with pytest.raises(InputError, match="expected 2 entries"):
        cg.equilibrium(few)
    moving = scene(initial={"pose": "rest", "reached_by": "pulling"}, time={"duration": 0.1, "step": 0.01})
    with pytest.raises(InputError, match="does not know dry friction in bending"):
        accuracy_report(moving)
