"""Laws of the sections: run-time lengths, relaxation by closed forms, and energy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import continuum_grasp as cg
from continuum_grasp.addons.identification import TipPath
from continuum_grasp.scene import Stops
from tests.finger_cases import energy_rate
from tests.identification_cases import at_tip
from tests.marks import few

LENGTH, STIFFNESS = 0.2, 8e-3
BRANCHES = [{"share": 0.5, "time": 0.4}, {"share": 0.2, "time": 0.05}]
LAWS = {
    "softening": {"softening": {"curvature": 10.0, "stiffness_ratio": 0.3}},
    "stops": {"stops": Stops(curvature=10.0, stiffness_ratio=20.0)},
    "drag": {"damping": cg.Damping(quadratic=2e-5)},
    "dry friction": {"damping": {"dry_friction": [{"stiffness": 1e-3, "moment": 2e-3}]}},
    "relaxation": {"damping": {"relaxation": BRANCHES}},
}


def even_bends(times, moments, viscosity, branches):
    """Bend [rad] of a light finger under a moment on its tip, linear between the times: one linear system all along.

    eta kappa' = M - E I (kappa + sum g e), e' = kappa' - e / T.
    """
    count, poles = len(branches), np.array([1.0 / branch["time"] for branch in branches])
    driven = -STIFFNESS / viscosity * np.array([1.0, *(branch["share"] for branch in branches)])
    whole = np.zeros((count + 3, count + 3))  # with the moment and its slope
    whole[: count + 1, : count + 1] = driven
    whole[1 : count + 1, 1 : count + 1] -= np.diag(poles)
    whole[: count + 1, -2], whole[-2, -1] = 1.0 / viscosity, 1.0
    state, found = np.zeros(count + 3), [0.0]
    for k, h in enumerate(np.diff(times)):
        state[-2:] = moments[k], (moments[k + 1] - moments[k]) / h
        state = expm(h * whole) @ state
        found.append(state[0] * LENGTH)
    return np.array(found)


def finger(**laws):
    rod = cg.Rod(length=LENGTH, diameter=0.006, bending_stiffness=STIFFNESS, linear_density=0.02)
    return cg.Finger.model_validate({"rod": rod, **laws})


@pytest.mark.parametrize("family", ["arc", "clothoid"])
@pytest.mark.parametrize("law", LAWS)
def test_lengths_at_run_time_are_those_of_a_model_that_was_built_with_them(law, family):
    lengths = LENGTH * np.array([0.3, 0.45, 0.25])
    free = cg.FingerModel(finger(**LAWS[law]), family=family, elements=3, parameters=["element_lengths"])
    built = cg.FingerModel(finger(**LAWS[law]), family=family, elements=tuple(lengths))
    rng, n = np.random.default_rng(2), free.n
    x = np.concatenate([3.0 * rng.standard_normal(n), rng.standard_normal(n), rng.standard_normal(free.nx - 2 * n)])
    w = np.zeros(free.nw)
    rates = [model.forward_dynamics(x, [0.0], w, p).full() for model, p in ((free, lengths), (built, []))]
    assert rates[0] == pytest.approx(rates[1], rel=1e-9, abs=1e-9 * np.abs(rates[1]).max())


STIFF, SOFT = ({"bending_stiffness": b, "linear_density": m} for b, m in ((0.1, 0.02), (4e-4, 0.004)))
NOTCHED = {
    "length": 0.08,
    "sections": [{"to": 0.016 * k, **part} for k, part in enumerate([STIFF, SOFT] * 2 + [STIFF], 1)],
}
CONE = {"length": LENGTH, "youngs_modulus": 1e9, "density": 1100.0, "diameter": [0.012, 0.004]}


@pytest.mark.parametrize("rod", [NOTCHED, CONE], ids=["notched", "cone"])
@pytest.mark.parametrize(("family", "elements"), [("arc", 2), ("arc", 3), ("clothoid", 2), ("clothoid", 17)])
def test_ports_see_all_of_a_rod_whose_stiffness_jumps_or_tapers(family, elements, rod):
    """By dense integrals along it of squares and third powers of the curvature, of moments that are even along it."""
    kinds = {"relaxation": BRANCHES[:1], "dry_friction": [{"stiffness": 1e-3, "moment": 2e-3}], "quadratic": 1e-5}
    made = cg.FingerModel(cg.Finger.model_validate({"rod": rod, "damping": kinds}), family=family, elements=elements)
    family, laws = made.structure.family, {placed.law.kind: placed for placed in made.structure.laws}
    mesh = family.mesh
    bent = 1.0 / mesh.stiffness(np.array(mesh.ends)) if family.degree else np.array(mesh.lengths)
    bent = bent / np.abs(bent).max()

    def along(power):
        total = 0.0
        for k in range(elements):
            for a, b in mesh.panels(k, mesh.stiffness):
                s = a + (b - a) * (np.arange(4000) + 0.5) / 4000
                curvature = bent[list(family.local(k))] @ family.shapes_at(k, s)[:-1]
                total += (mesh.stiffness(s) * np.abs(curvature) ** power).mean() * (b - a)
        return total / float(mesh.stiffness(0.0))

    def seen(kind, power):
        return sum(
            p.measure * abs(np.dot(p.shapes, bent[list(family.local(p.element))])) ** power for p in laws[kind].ports
        )

    assert seen("relaxation", 2) == pytest.approx(along(2), rel=1e-6)
    assert seen("damping", 3) == pytest.approx(along(3), rel=1e-6 if rod is NOTCHED else 0.03)
    assert seen("friction", 2) == pytest.approx(along(2), rel=1e-6)


def test_a_tip_that_quadratic_damping_holds_back_is_free_unless_it_is_asked_for():
    """Its moment bends it late: with 1e-4 N m3 s2 two matched elements of a pulled finger were 10 mm off."""
    scene = cg.Scene(finger=finger(**LAWS["drag"]), gravity=(0.0, 0.0))
    asked = {"input_rates": True}, {"family": "matched_clothoid"}
    assert [cg.FingerModel(scene, **options).family for options in ({}, *asked)] == [
        "clothoid",
        *["matched_clothoid"] * 2,
    ]


@pytest.mark.parametrize(("family", "elements"), few([("clothoid", 2), ("arc", 3), ("clothoid", 8)], 2))
def test_a_held_moment_creeps_and_comes_back_by_the_closed_form(family, elements):
    """Bent evenly, every section is the same linear system of its curvature and branches."""
    held, end, viscosity, moment = 0.6, 1.2, 2e-4, 0.02
    times = [0.0, held, held + 0.02, end]
    scene = cg.Scene.model_validate(
        {
            "finger": {
                **finger(damping={"material": viscosity, "relaxation": BRANCHES}).model_dump(exclude_defaults=True),
                # Light, so that inertia is over in a millisecond.
                "rod": {"length": LENGTH, "diameter": 0.006, "bending_stiffness": STIFFNESS, "linear_density": 1e-3},
            },
            "gravity": (0.0, 0.0),
            "fidelity": {"family": family, "elements": elements},
            "initial": {"pose": "rest"},
            "actuation": {"tip_moment": {"times": times, "values": [moment, moment, 0.0, 0.0]}},
            "time": {"duration": end, "step": 0.02},
        }
    )
    run = cg.simulate(scene)
    bends = even_bends(run.t, np.interp(run.t, times, [moment, moment, 0.0, 0.0]), viscosity, BRANCHES)
    tip = np.array([run.model.orientation(q, [0.0], LENGTH, []).full().item() for q in run.q])
    assert bends[30] > 1.2 * bends[3]
    settled = np.abs(run.t - held - 0.03) > 0.05  # moments between samples are not quite straight
    assert tip[settled] == pytest.approx(bends[settled], abs=2e-3 * max(bends))


@pytest.mark.parametrize(("family", "elements"), [("arc", 3), ("clothoid", 2)])
def test_what_relaxes_loses_the_energy_of_its_dashpots(family, elements):
    model = cg.FingerModel(finger(damping={"relaxation": BRANCHES}), family=family, elements=elements, tip_force=False)
    gained = energy_rate(model, [0.0])
    nodes = model.structure.laws[0].ports
    rng, n = np.random.default_rng(4), model.n
    for _ in range(5):
        stretched = rng.standard_normal((len(nodes), len(BRANCHES)))
        state = np.concatenate([rng.standard_normal(2 * n), stretched.ravel()])
        rate = model.forward_dynamics(state, [0.0], [], []).full().ravel()
        lost = sum(
            port.measure * STIFFNESS * branch["share"] * own[j] ** 2 / branch["time"]
            for port, own in zip(nodes, stretched, strict=True)
            for j, branch in enumerate(BRANCHES)
        )
        assert gained(state, rate) == pytest.approx(-lost, rel=1e-9)


def test_a_swing_is_that_of_the_sudden_stiffness_and_rest_that_of_the_slow_one():
    stiffer = cg.Rod(length=LENGTH, diameter=0.006, bending_stiffness=1.7 * STIFFNESS, linear_density=0.02)
    fingers = finger(), finger(damping={"relaxation": BRANCHES}), finger().replaced(rod=stiffer)
    rest = {"gravity": (0.0, -9.81), "fidelity": {"family": "clothoid", "elements": 3}}
    slow, relaxing, stiff = (cg.Scene.model_validate({"finger": one, **rest}) for one in fingers)
    assert cg.equilibrium(relaxing).q == pytest.approx(cg.equilibrium(slow).q, rel=1e-12)
    # Without weight, whose share in the stiffness is the same in all.
    slow, relaxing, stiff = (one.changed({"gravity": (0.0, 0.0)}) for one in (slow, relaxing, stiff))
    found = cg.modes(relaxing)
    assert found.frequencies_hz == pytest.approx(cg.modes(slow).frequencies_hz, rel=1e-9)
    assert found.stuck_frequencies_hz == pytest.approx(cg.modes(stiff).frequencies_hz, rel=1e-9)


def test_a_matched_tip_cannot_carry_it():
    with pytest.raises(cg.InputError, match="matched_clothoid cannot carry a material that relaxes"):
        cg.FingerModel(finger(damping={"relaxation": BRANCHES}), family="matched_clothoid")


def test_identify_finds_what_relaxes_from_a_path_of_the_closed_form():
    """The tip of a circular arc whose bend creeps; the search starts with half the share and three times the time."""
    viscosity, moment, true = 2e-4, 0.02, {"share": 0.5, "time": 0.4}
    t = np.linspace(0.0, 1.5, 76)
    bend = even_bends(t, np.full_like(t, moment), viscosity, [true])
    with np.errstate(invalid="ignore"):
        along, across = (
            np.where(bend > 0.0, value / bend, rest) for value, rest in ((np.sin(bend), 1.0), (1.0 - np.cos(bend), 0.0))
        )
    noise = 1e-5 * np.random.default_rng(1).standard_normal((2, t.size))
    start = {"share": 0.25, "time": 1.2}
    rod = {"length": LENGTH, "diameter": 0.006, "bending_stiffness": STIFFNESS, "linear_density": 1e-3}
    scene = cg.Scene.model_validate(
        {
            "finger": {"rod": rod, "damping": {"material": viscosity, "relaxation": [start]}},
            "gravity": (0.0, 0.0),
            "fidelity": {"family": "arc", "elements": 1},
            "initial": {"pose": "rest"},
            "actuation": {"tip_moment": moment},
            "time": {"duration": 1.5, "step": 0.02},
        }
    )
    data = [TipPath(t, at_tip(noise[0] - LENGTH * across, noise[1] + LENGTH * along, 1e-5))]
    fit = cg.identify(scene, data, parameters=["relaxation_1_share", "relaxation_1_time"])
    assert fit.values == pytest.approx([true["share"], true["time"]], rel=5e-3)
    assert fit.apply().finger.damping.relaxation[0].time == fit["relaxation_1_time"]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_links_touch_at_a_curvature_of_the_finger_itself(side):
    """Curved at rest by k0, bent evenly to k: E I (k - k0) + (ratio - 1) E I (k - c), c where links touch."""
    at_rest, touch, ratio, bent = 5.0, 10.0, 20.0, 11.0
    made = finger(rest_curvature=side * at_rest, stops=Stops(curvature=touch, stiffness_ratio=ratio))
    model = cg.FingerModel(made, family="arc", elements=2, tip_force=False, gravity=(0.0, 0.0))
    moment = side * STIFFNESS * (bent - at_rest + (ratio - 1.0) * (bent - touch))
    q = [side * (bent - at_rest) * LENGTH / 2.0] * 2
    missing = model.statics(q, [moment], [], [])[0].full().ravel()
    assert missing == pytest.approx(0.0, abs=1e-3 * abs(moment))
