"""Sweeps along the chain: the accelerations of the dense equations, whatever the finger has, at a linear cost."""

from __future__ import annotations

import re
from functools import lru_cache

import casadi as ca
import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.core import CSource
from continuum_grasp.model import MOST_ELEMENTS, FingerModel
from continuum_grasp.scene import (
    BasePose,
    Damping,
    Finger,
    ForceLoad,
    LengthDrive,
    MomentLoad,
    PiecewiseCurvature,
    PointMass,
    Rod,
    Stops,
    Tendon,
    Tendons,
    TipBody,
)
from tests.marks import every

LENGTH, COUNT = 0.6, 16
"""A length [m], and the fewest elements for which there are sweeps."""
ROD = Rod(length=LENGTH, linear_density=0.8, bending_stiffness=0.5, rotary_inertia=3e-4)
TAPER = Rod.model_validate(
    {
        "length": LENGTH,
        "youngs_modulus": 2e7,
        "density": 1100.0,
        "sections": [
            {"to": 0.25, "thickness": [0.02, 0.018], "width": 0.02},
            {"to": LENGTH, "thickness": [0.018, 0.008], "width": 0.015, "rest_curvature": 1.0},
        ],
    }
)
HALF = Rod.model_validate(
    {
        "length": LENGTH,
        "youngs_modulus": 2e7,
        "density": 1100.0,
        "sections": [
            {"to": LENGTH / 2, "thickness": 0.02, "width": 0.02},
            {"to": LENGTH, "thickness": [0.02, 0.01], "width": 0.02},
        ],
    }
)
FULL = {
    "rod": ROD,
    "damping": Damping(material=0.01, per_arc=0.02),
    "masses": (PointMass(at=LENGTH, mass=0.2), PointMass(at=LENGTH / 2, mass=0.3)),
    "base": BasePose(position=(0.3, -0.2), angle=-0.7),
}
STICKS = Damping.model_validate({"material": 0.01, "dry_friction": [{"stiffness": 0.4, "moment": 0.3}]})
SQUARES = Damping(material=0.01, quadratic=0.02)
RELAXES = Damping.model_validate({"relaxation": [{"share": 0.5, "time": 0.4}, {"share": 0.2, "time": 0.05}]})
LOADS = (
    ForceLoad(at=0.13, force=(0.0, 0.0)),
    ForceLoad(at=0.33, force=(0.0, 0.0), follows=True),
    MomentLoad(at=0.22, moment=0.0),
    MomentLoad(at=LENGTH, moment=0.0),
)
UNEVEN = tuple(LENGTH * w / 20.0 for w in (2, 1, 1, 1, 1, 2, 1, 1, 1, 1, 1, 1, 1, 1, 2, 1, 1))
RUNTIME = ("linear_density", "bending_stiffness", "rotary_inertia", "gravity", "base_angle", "tip_mass")
CASES = {
    "bare": ({"rod": ROD}, {"gravity": (0.0, 0.0), "tip_force": False}),
    "everything": (FULL, {"loads": LOADS, "contacts": (0.3,)}),
    "uneven": (FULL, {"elements": UNEVEN, "loads": LOADS}),
    "run time": (FULL, {"parameters": (*RUNTIME, "material_damping", "per_arc_damping", "rest_curvature")}),
    "curved at rest": ({**FULL, "rest_curvature": PiecewiseCurvature(breaks=(0.17,), values=(0.9, -1.4))}, {}),
    "graded": (
        {**FULL, "rod": TAPER, "masses": FULL["masses"][:1]},
        {"parameters": ("linear_density", "bending_stiffness")},
    ),
    "lag": ({**FULL, "tendons": Tendons(offset=0.004, max_tension=9.0, time_constant=0.05)}, {}),
}
REEL = LengthDrive(kind="length", time_constant=0.02, rate_max=0.1, pretension=1.0)
CABLE = Tendons(offset=0.004, max_tension=9.0, friction=0.2, axial_stiffness=9e3, series_stiffness=3e4, drive=REEL)
FREE = {
    "winches": ({**FULL, "tendons": CABLE}, {}),
    "friction": ({**FULL, "tendons": Tendons(offset=0.004, max_tension=9.0, friction=0.3)}, {"loads": LOADS}),
    "dry friction": ({**FULL, "damping": STICKS}, {"loads": LOADS}),
    "quadratic damping": ({**FULL, "damping": SQUARES}, {"loads": LOADS, "parameters": ("quadratic_damping",)}),
    "friction of both kinds": (
        {**FULL, "damping": STICKS, "tendons": Tendons(offset=0.004, max_tension=9.0, friction=0.3)},
        {},
    ),
    "tendons": (
        {**FULL, "tendons": (Tendon(offset=0.004, max_tension=9.0), Tendon(offset=-0.003, to=0.4, max_tension=9.0))},
        {},
    ),
    "softening": ({**FULL, "softening": {"curvature": 2.0, "stiffness_ratio": 0.3}}, {}),
    "relaxation": ({**FULL, "damping": RELAXES}, {}),
    "stops": ({**FULL, "rest_curvature": 1.0, "stops": Stops(curvature=2.0, stiffness_ratio=20.0)}, {}),
    "body": ({**FULL, "tip_body": TipBody(mass=0.1, rotary_inertia=1e-3, center_of_mass=(0.02, 0.05))}, {}),
}
FAMILIES = {name: ["arc", "matched_clothoid" if name in CASES else "clothoid"] for name in CASES | FREE}
IN_TURNS = [(family, name) for k, name in enumerate(FAMILIES) for family in FAMILIES[name][:: (-1) ** k]]
"""Every finger with both families, of which the one and the other comes first."""


@lru_cache
def model_of(family: str, name: str, **options) -> FingerModel:
    values, own = (CASES | FREE)[name]
    keywords = {"elements": COUNT, **own, **options}
    if family == "matched_clothoid" and name == "everything":
        keywords["input_rates"] = True
    return FingerModel(Finger(**values), family=family, **keywords)


def state_of(model: FingerModel, seed: int = 3) -> list[np.ndarray]:
    """Some x, u, w, p: the finger bent to and fro by about a turn in all."""
    rng = np.random.default_rng(seed)
    limits = np.array(model.structure.coordinate_limits())
    q, qd = 0.4 * limits * rng.uniform(-1, 1, model.n), 3.0 * limits * rng.uniform(-1, 1, model.n)
    lag = rng.uniform(-0.05, 0.05, model.nx - 2 * model.n) * (10.0 if model.friction_names else 1.0)
    lag[: 2 * len(model.structure.winches)] *= 0.02  # lengths, in meters
    lag[[name.startswith("relaxing") for name in model.x_names[2 * model.n :]]] = 0.0  # as in inverse dynamics
    u, w = rng.uniform(0.0, 0.3, model.nu), rng.uniform(-0.5, 0.5, model.nw)
    return [np.concatenate([q, qd, lag]), u, w, 1.1 * np.array(model.p_nominal)]


def dense(model: FingerModel, x, u, w, p) -> tuple[np.ndarray, float]:
    """Accelerations by numpy from the dense equations, which share no sweep, and their error by rounding."""
    q, qd = x[: model.n], x[model.n : 2 * model.n]
    if model.structure.lagged:
        model, u = without_lag(model, x, u)
    if model.structure.winches:
        u = x[2 * model.n :: 2][: len(u)]  # lengths where they are
    mass = np.array(model.mass_matrix(q, u, p))
    friction, of_tendons = x[len(x) - len(model.friction_names) :], model.structure.tendon_friction_states
    # the cubic of a motion's friction state of tendons, of which a history has the value
    ways = np.append(1.5 * friction[:of_tendons] - 0.5 * friction[:of_tendons] ** 3, friction[of_tendons:])
    history = [np.append(ways, 0.0)] if friction.size else []
    missing = np.array(model.inverse_dynamics(q, qd, np.zeros(model.n), u, w, p, *history)).ravel()
    scale = 1.0 / np.sqrt(np.diag(mass))
    condition = np.linalg.cond(scale[:, None] * mass * scale)
    return np.linalg.solve(mass, -missing), max(20 * condition * np.finfo(float).eps, 1e-12)


def without_lag(model: FingerModel, x, u) -> tuple[FingerModel, np.ndarray]:
    """The finger whose tension 1 is the moment that acts, with its rates where the tip moves with it."""
    tendons, (moment, rate) = model.finger.tendons, x[-2:]
    commanded, pole = tendons.offset * (u[0] - u[1]), 1.0 / tendons.time_constant
    finger = model.finger.model_copy(update={"tendons": tendons.model_copy(update={"time_constant": None})})
    values = np.array([moment, rate, pole**2 * (commanded - moment) - 2.0 * pole * rate]) / tendons.offset
    rates = True if model.structure.matched else None
    inputs = np.column_stack([values, np.zeros(3)])[: 3 if rates else 1].ravel()
    return FingerModel(finger, family=model.family, elements=model.lengths, input_rates=rates), inputs


@pytest.mark.parametrize(("family", "name"), every(2, IN_TURNS))
def test_accelerations_are_those_of_the_dense_equations(family, name):
    model = model_of(family, name)
    assert model.sweeps
    x, u, w, p = state_of(model)
    rates = np.array(model.forward_dynamics(x, u, w, p)).ravel()
    true, rounding = dense(model, x, u, w, p)
    assert rates[: model.n] == pytest.approx(x[model.n : 2 * model.n], abs=0)
    assert np.abs(rates[model.n : 2 * model.n] - true).max() <= rounding * np.abs(true).max()


@pytest.mark.parametrize(
    ("family", "name"),
    [
        ("arc", "bare"),
        ("arc", "everything"),
        ("matched_clothoid", "graded"),
        *(("clothoid", name) for name in ("tendons", "stops", "body")),
    ],
)
def test_the_loop_in_c_is_that_of_the_virtual_machine(family, name):
    model = model_of(family, name)
    arguments = state_of(model)
    expected = np.array(model.forward_dynamics(*arguments)).ravel()
    _, rounding = dense(model, *arguments)
    core = cg.compile(model)
    assert np.abs(core.forward_dynamics(*arguments) - expected).max() <= rounding * np.abs(expected).max()
    rows = np.array([arguments[0], 0.5 * arguments[0]])
    many = core.batch("forward_dynamics", rows, *arguments[1:])
    assert many[0] == pytest.approx(core.forward_dynamics(*arguments), abs=0)


def test_all_lags_are_in_the_loop():
    """Of tendons of two shapes and of three chambers: seven states."""
    tendons = [{"offset": 0.004, "max_tension": 9.0, "time_constant": 0.05}] * 2
    chambers = [{"area": 1e-4, "offset": 0.004 * k, "max_pressure": 1e5, "time_constant": 0.05 * k} for k in (1, 2, 3)]
    finger = Finger.model_validate(FULL | {"tendons": [tendons[0], {**tendons[1], "to": 0.4}], "pressure": chambers})
    model = FingerModel(finger, family="arc", elements=COUNT)
    assert model.sweeps
    assert model.nx == 2 * model.n + 7
    x, u, w, p = state_of(model)
    expected = np.array(model.forward_dynamics(x, u, w, p)).ravel()
    assert expected[-3:] == pytest.approx([(u[2 + k] - x[k - 3]) / (0.05 * (k + 1)) for k in range(3)])
    core = cg.compile(model)
    assert core.forward_dynamics(x, u, w, p) == pytest.approx(expected, rel=1e-9)
    assert core.batch("forward_dynamics", np.array([x]), u, w, p)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("why", ["few", "lengths", "mass", "moment", "kinds"])
def test_what_sweeps_do_not_have_is_solved_densely(why):
    options = {"elements": COUNT - 1 if why == "few" else COUNT, "family": "matched_clothoid"}
    values = dict(FULL)
    if why == "kinds":  # arcs of uniform and of graded density
        values |= {"rod": HALF, "masses": ()}
        options["family"] = "arc"
    if why == "lengths":
        options["parameters"] = ("element_lengths",)
    if why == "mass":
        values["masses"] = (PointMass(at=0.31, mass=0.1),)
    if why == "moment":
        options["loads"] = (MomentLoad(at=0.31, moment=0.0, input=True),)
    model = FingerModel(Finger(**values), **options)
    assert not model.sweeps
    assert model.forward_dynamics.is_a("SXFunction")


def test_code_does_not_grow_with_the_elements():
    def assignments(count: int) -> int:
        model = FingerModel(Finger(**FULL), family="arc", elements=count)
        source = CSource([model.forward_dynamics]).of_core("one")
        return len(re.findall(r"^ +(?:a\d+|const \w+ v\d+) ?=", source, re.MULTILINE))

    # Series are shorter where elements bend less.
    assert assignments(MOST_ELEMENTS) <= assignments(COUNT)


@pytest.mark.parametrize("family", ["arc", "matched_clothoid"])
def test_derivatives_go_through_the_sweeps(family):
    model = model_of(family, "run time")
    x, u, w, p = state_of(model)
    symbol = ca.MX.sym("x", model.nx)
    slope = ca.Function("slope", [symbol], [ca.jtimes(model.forward_dynamics(symbol, u, w, p), symbol, x)])
    step = 1e-6
    ahead, behind = (np.array(model.forward_dynamics((1 + s) * x, u, w, p)).ravel() for s in (step, -step))
    found = np.array(slope(x)).ravel()
    assert found == pytest.approx((ahead - behind) / (2 * step), rel=1e-6, abs=1e-6 * np.abs(found).max())


@pytest.mark.deep
def test_energy_of_thirty_two_elements_is_conserved():
    count = 2 * COUNT
    model = FingerModel(Finger(rod=ROD, masses=FULL["masses"][:1]), family="clothoid", elements=count)
    core = cg.compile(model)
    start = np.concatenate([np.linspace(3.0, 0.0, model.n), np.zeros(model.n)])
    # The fastest mode is four thousand times as fast as the first: its steps resolve a short swing.
    states = core.rollout(start, 200, 1e-4, substeps=20)
    kinetic, potential = core.batch("energy", states, None)
    assert kinetic.max() >= 0.01 * np.ptp(potential) > 0.0
    assert np.ptp(kinetic + potential) <= 1e-9 * np.ptp(potential)


@pytest.mark.parametrize(
    ("family", "count"), [("arc", 1), ("arc", 2), ("clothoid", 2), ("arc", 4), ("arc", 16), ("arc", 40)]
)
def test_elements_are_evaluated_beyond_where_their_links_touch(family, count):
    """1.5 times curvature times length where that is more than the share of the whole finger, up to 40 rad."""
    finger = Finger(
        rod=Rod(length=0.2, linear_density=0.02, bending_stiffness=0.01),
        stops=Stops(curvature=80.0, stiffness_ratio=9.0),
    )
    usual = min(2 * np.pi / 3, 8 * np.pi / 3 / count)
    wanted = max(usual, min(1.5 * 80.0 * 0.2 / count, 40.0))
    assert FingerModel(finger, family=family, elements=count).ranges == pytest.approx((wanted,) * count)


@pytest.mark.parametrize(("curvature", "count"), [(40.0, 2), (42.1, 3), (320.0, 16), (1000.0, 16)])
def test_elements_that_are_open_bend_by_one_turn_at_most_where_links_touch(curvature, count):
    """By 1.5 times curvature times length, up to 16 elements."""
    rod = Rod(length=0.2, linear_density=0.02, bending_stiffness=0.01)
    finger = Finger(rod=rod, stops=Stops(curvature=curvature, stiffness_ratio=9.0))
    assert len(FingerModel(finger).lengths) == count
