"""Graded rods, tendons that end inside, stops and bodies at the tip, against integrals, energies and uniform rods."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from continuum_grasp import FingerModel
from continuum_grasp.base import InputError
from continuum_grasp.scene import Damping, Finger, MomentLoad, PointMass, Rod
from tests.finger_cases import energy_rate, evaluate, relative_error
from tests.marks import few

LENGTH = 0.25
SECTIONS = (
    {"to": 0.11, "diameter": 0.02, "rest_curvature": 3.0},
    {"to": 0.18, "diameter": [0.016, 0.01]},
    {"to": LENGTH, "diameter": [0.012, 0.006], "rest_curvature": [-2.0, 4.0]},
)
MATERIAL = {"length": LENGTH, "youngs_modulus": 2e6, "density": 1100.0}
TENDONS = (
    {"offset": 0.006, "to": 0.15, "max_tension": 20.0},
    {"offset": [-0.007, -0.002], "max_tension": 20.0},
    {"offset": 0.003, "max_tension": 20.0},
)
FAMILIES = ("arc", "clothoid", "matched_clothoid")


def graded(**changes) -> Finger:
    """A finger of three sections and tendons with three ends, on which two masses sit."""
    given = {
        "rod": {**MATERIAL, "sections": SECTIONS},
        "tendons": TENDONS,
        "masses": ({"at": 0.2, "mass": 0.01}, {"at": LENGTH, "mass": 0.02}),
        "damping": {"material": 1e-5},
        "base": {"position": (0.01, -0.02), "angle": 0.4},
    }
    return Finger(**{**given, **changes})


def point(model: FingerModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A bent and moving state, an input and forces."""
    rng = np.random.default_rng(1)
    size = 0.3 if model.family == "arc" else 6.0
    x = np.concatenate([size * rng.uniform(-1, 1, model.n), 5 * size * rng.uniform(-1, 1, model.n)])
    return x, 2.0 * rng.uniform(0.2, 1.0, model.nu), 0.01 * rng.uniform(-1, 1, model.nw)


@pytest.mark.parametrize("elements", few([(0.06, 0.12, 0.07), 1, 3], 1))
@pytest.mark.parametrize("family", FAMILIES)
def test_work_changes_the_energy(family, elements):
    """Kinetic, elastic and potential energy grow by the work of forces and tendons, less what damping takes."""
    stops = {"curvature": 14.0, "stiffness_ratio": 30.0, "side": "left"}
    body = {"mass": 0.03, "rotary_inertia": 2e-5, "center_of_mass": (0.004, 0.01)}
    changes = {} if family == "matched_clothoid" else {"stops": stops, "tip_body": body}
    model = FingerModel(graded(**changes), family=family, elements=elements, accuracy=1e-9, input_rates=False)
    x, u, w = point(model)
    xd = evaluate(model.forward_dynamics, x, u, w, [])
    q, qd = np.split(x, 2)
    forces = evaluate(model.external_force, q, u, w, []) - evaluate(model.damping, q, qd, u, [])
    work = qd @ (forces + evaluate(model.actuation, q, u, []))
    assert energy_rate(model, u)(x, xd) == pytest.approx(work, rel=1e-8)


@pytest.mark.parametrize("elements", [1, 2, 5])
def test_the_shape_is_the_integral_of_the_curvature(elements):
    """Position and angle at any section, by an integration of one's own of what the definition says."""
    model = FingerModel(graded(), family="matched_clothoid", elements=elements, accuracy=1e-12, input_rates=False)
    profile, channels, ends = model.finger.profile, model.finger.channels, np.cumsum([0.0, *model.lengths])
    q, u = np.random.default_rng(2).uniform(-6.0, 6.0, model.n), np.array([1.0, 0.4, 0.7])
    at_nodes = profile.bending_stiffness(ends)

    def curvature(s: float) -> float:
        moments = [(c.shape, float(np.dot(c.arms, u))) for c in channels]
        nodes = np.append(q * at_nodes[:-1], sum(amplitude * shape(LENGTH) for shape, amplitude in moments))
        moment = np.interp(s, ends, nodes)
        for shape, amplitude in moments:
            moment += amplitude * (shape(s) - np.interp(s, ends, shape(ends)))
        return float(profile.rest_curvature(s) + moment / profile.bending_stiffness(s))

    def slope(s: float, z: np.ndarray) -> list[float]:
        return [-np.sin(z[2]), np.cos(z[2]), curvature(s)]

    stops = [0.0, *sorted({0.11, 0.15, 0.18, *ends[1:-1].tolist()}), LENGTH]
    z = np.array([0.01, -0.02, 0.4])
    for a, b in pairwise(stops):
        middle = 0.5 * (a + b)
        inside = 1e-9 * LENGTH
        half = solve_ivp(slope, (a + inside, middle), z, rtol=1e-12, atol=1e-13).y[:, -1]
        z = solve_ivp(slope, (middle, b - inside), half, rtol=1e-12, atol=1e-13).y[:, -1]
        assert evaluate(model.position, q, u, middle, []) == pytest.approx(half[:2], abs=1e-8)
        assert evaluate(model.orientation, q, u, middle, [])[0] == pytest.approx(half[2], abs=2e-7)
    assert evaluate(model.tip, q, u, []) == pytest.approx(z[:2], abs=1e-8)


@pytest.mark.parametrize("family", FAMILIES)
def test_what_is_known_bends_as_elasticity_and_actuation_say(family):
    """The force that is missing for rest is elastic force less actuation, each by its own function."""
    model = FingerModel(graded(), family=family, elements=3, gravity=(0, 0), input_rates=False)
    x, u, _ = point(model)
    q = x[: model.n]
    missing, _ = model.statics(q, u, np.zeros(model.nw), [])
    elastic, actuation = (evaluate(getattr(model, name), q, u, []) for name in ("elastic", "actuation"))
    assert np.abs(np.array(missing)[:, 0] - (elastic - actuation)).max() < 1e-13 * np.abs(elastic).max()


@pytest.mark.parametrize("family", FAMILIES)
def test_equal_sections_are_the_uniform_rod(family):
    """Cut into three sections of one size, with tendons as a list: all functions as without."""
    rod = {**MATERIAL, "sections": [{"to": to, "diameter": 0.012} for to in (0.1, 0.13, LENGTH)]}
    pair = [{"offset": e, "max_tension": 9.0} for e in (0.005, -0.005)]
    cut = Finger(rod=rod, tendons=pair, damping=Damping(material=1e-5), masses=(PointMass(at=0.2, mass=0.1),))
    whole = Finger(
        rod=Rod(**MATERIAL, diameter=0.012),
        tendons={"offset": 0.005, "max_tension": 9.0},
        damping=Damping(material=1e-5),
        masses=(PointMass(at=0.2, mass=0.1),),
    )
    options = {"family": family, "elements": 3, "input_rates": False}
    first, second = FingerModel(whole, **options), FingerModel(cut, **options)
    x, u, w = point(first)
    q, qd = np.split(x, 2)
    assert first.lengths == second.lengths
    for name, given in (
        ("forward_dynamics", (x, u, w)),
        ("mass_matrix", (q, u)),
        ("bias", (q, qd, u)),
        ("damping", (q, qd, u)),
        ("jacobian", (q, u, 0.17)),
        ("energy", (x, u)),
        ("curvatures", None),
    ):
        values = [
            evaluate(getattr(m, name), *given, []) if given else evaluate(m.curvatures(), q, u, [])
            for m in (first, second)
        ]
        assert relative_error(values[1], values[0]) < 1e-12, name


def test_a_stiffness_at_run_time_is_a_factor():
    finger = graded()
    fixed = FingerModel(finger, elements=3, input_rates=False)
    model = FingerModel(finger, elements=3, input_rates=False, parameters=("bending_stiffness", "linear_density"))
    assert (model.p_names, model.p_nominal) == (["bending_stiffness [1]", "linear_density [1]"], [1.0, 1.0])
    x, u, w = point(model)
    expected = evaluate(fixed.forward_dynamics, x, u, w, [])
    assert relative_error(evaluate(model.forward_dynamics, x, u, w, [1.0, 1.0]), expected) < 1e-12
    stiffer = Finger(**{**dict(finger), "rod": {**MATERIAL, "youngs_modulus": 2.4e6, "sections": SECTIONS}})
    expected = evaluate(FingerModel(stiffer, elements=3, input_rates=False).forward_dynamics, x, u, w, [])
    # The material's damping stays that at the base.
    assert relative_error(evaluate(model.forward_dynamics, x, u, w, [1.2, 1.0]), expected) < 1e-11


def test_an_inner_couple_that_is_an_input_acts_as_the_load():
    """On elements that end at the couple and right behind it, both forms have the same equilibria to their order."""
    load = MomentLoad(at=0.1, moment=0.02, input=True)
    model = FingerModel(graded(tendons=None), loads=(load,), elements=2, input_rates=False, family="matched_clothoid")
    free = FingerModel(graded(tendons=None), loads=(load,), elements=2, family="clothoid")
    assert model.u_names == free.u_names == ["tip_moment [N m]", "load_1_moment [N m]"]
    q = np.zeros(free.n)
    plain = FingerModel(graded(tendons=None), loads=(load.replaced(input=False),), elements=2, family="clothoid")
    none = np.zeros(plain.nw)
    none[-1] = 0.02
    given = evaluate(plain.external_force, q, [0.0], none, [])
    assert evaluate(free.actuation, q, [0.0, 0.02], []) == pytest.approx(given, rel=1e-12)


REFUSED = {
    "lengths": ({"parameters": ("element_lengths",)}, {}, "piecewise rest curvature"),
    "matched and stops": (
        {"family": "matched_clothoid"},
        {"stops": {"curvature": 14.0, "stiffness_ratio": 3.0}},
        "cannot carry stops",
    ),
    "matched and a body": (
        {"family": "matched_clothoid"},
        {"tip_body": {"mass": 0.1, "rotary_inertia": 1e-4}},
        "body at the tip",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_model_has_is_refused(case):
    options, changes, message = REFUSED[case]
    with pytest.raises(InputError, match=message):
        FingerModel(graded(**changes), **options)


def test_a_taper_too_strong_for_one_element_says_so():
    rod = {**MATERIAL, "sections": [{"to": LENGTH, "diameter": [0.02, 0.0001]}]}
    with pytest.raises(InputError, match="take more elements"):
        FingerModel(Finger(rod=rod), elements=1, accuracy=1e-10).mass_matrix  # noqa: B018
