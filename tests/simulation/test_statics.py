"""Equilibria against elliptic integrals and closed forms of buckling."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import integrate, optimize

from continuum_grasp.base import InputError, SolverError
from continuum_grasp.model import FingerModel
from continuum_grasp.rod import solve_elastica
from continuum_grasp.scene import ForceLoad
from continuum_grasp.simulation import Signals, equilibrium, equilibrium_path, equilibrium_under
from tests.closed_forms import rods as closed_forms
from tests.marks import few
from tests.rods import HANGING, HORIZONTAL, UNIT, UPRIGHT, force, order, rod_scene, without_compiler  # noqa: F401

pytestmark = pytest.mark.usefixtures("without_compiler")

NONE = (0.0, 0.0)
EULER, GREENHILL = math.pi**2 / 4, 7.8373474
BECK, BECK_SLIGHTLY_DAMPED = 20.0510, 10.94
"""Follower loads per EI / L^2; with vanishing internal damping: V. V. Bolotin, N. I. Zhinzher, 1969."""


def pushed(load: float, family: str = "matched_clothoid", elements: int = 2, **keys):
    """Unit rod along +X with a dead force across it at its tip."""
    return rod_scene(UNIT, family, elements, gravity=NONE, loads=[force(1.0, (0.0, load))], **keys)


def pressed(load: float, family: str, elements: int, follows: bool = False, **keys):
    """Unit rod along +Y with a force against its tip."""
    loads = [force(1.0, (0.0, -load), follows)]
    return rod_scene(UNIT, family, elements, angle=UPRIGHT, gravity=NONE, loads=loads, **keys)


def in_its_own_elements(scene):
    """The equilibrium that a search begins with, stable or not, without a look at more elements."""
    model = FingerModel(scene, input_rates=False)
    signals = Signals(scene, model)
    return equilibrium_under(model, signals.u(0.0)[0], signals.w(0.0)[0], stable=False)


def bent_by_force(alpha: float) -> np.ndarray:
    """Tip of the unit cantilever under a dead force alpha across it."""
    pose = closed_forms.bent_by_tip_force(alpha)
    return np.array([pose.along, pose.across])


def buckled(slope: float) -> tuple[float, np.ndarray]:
    """Load of the unit column whose tip has turned by ``slope``, and the tip (across, along)."""
    load, tip = closed_forms.buckled_column(slope)
    return load, np.array([tip.across, tip.along])


@pytest.mark.parametrize(
    ("family", "elements", "errors"),
    [
        ("arc", 2, (1.8e-2, 2.6e-2, 3.7e-2, 5.1e-2)),
        ("clothoid", 1, (9e-5, 9e-4, 7e-3, 2e-2)),
        ("matched_clothoid", 2, (6e-6, 6e-5, 5e-4, 2e-3)),
        ("matched_clothoid", 4, (3e-7, 3e-6, 3e-5, 9e-5)),
    ],
)
def test_tip_force_has_the_error_of_the_table(family, elements, errors):
    for alpha, expected in zip((1.0, 2.0, 5.0, 10.0), errors, strict=True):
        found = equilibrium(pushed(alpha, family, elements))
        assert found.stable
        error = np.linalg.norm(found.tip - bent_by_force(alpha))
        assert expected / 1.2 <= error <= 1.2 * expected, alpha


@pytest.mark.parametrize(("family", "expected", "counts"), [("arc", 2.0, (4, 8, 16)), ("clothoid", 4.0, (2, 4, 8))])
def test_static_error_falls_with_the_familys_order(family, expected, counts):
    errors = [np.linalg.norm(equilibrium(pushed(2.0, family, n)).tip - bent_by_force(2.0)) for n in counts]
    assert order(errors) == pytest.approx(expected, abs=0.35)


CIRCLES = {
    "moment": {"actuation": {"tip_moment": 1.7}},
    "couple": {"loads": [{"kind": "moment", "at": 1.0, "moment": 1.7}]},
    "preshape": {"finger": {"rest_curvature": 1.7}},
    "both": {"finger": {"rest_curvature": 2.0}, "actuation": {"tip_moment": -0.3}},
}
"""What gives the unit rod a curvature of 1.7: the input, a load on the tip, the unloaded shape, or two of them."""


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
@pytest.mark.parametrize("elements", [1, 2, (0.2, 0.7, 0.1)], ids=["1", "2", "unequal"])
@pytest.mark.parametrize("keys", CIRCLES.values(), ids=CIRCLES)
def test_an_end_moment_and_a_preshape_bend_a_circle(family, elements, keys):
    circle = np.array([math.sin(1.7), 1.0 - math.cos(1.7)]) / 1.7
    found = equilibrium(rod_scene(UNIT, family, elements, gravity=NONE, fidelity={"accuracy": 1e-13}, **keys))
    assert found.tip == pytest.approx(circle, abs=1e-12)
    assert found.stable
    assert found.margin > 0.0
    assert found.residual < 1e-10


REST = {"breaks": [0.3, 0.8], "values": [2.0, -1.0, 0.5]}


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
@pytest.mark.parametrize("elements", [None, (0.3, 0.5, 0.2)])
def test_piecewise_rest_curvature_is_met_exactly(family, elements):
    """Elements end at its jumps, unless elements are given; coordinates count from there."""
    finger, fidelity = {"rest_curvature": REST}, {"accuracy": 1e-13}
    found = equilibrium(rod_scene(UNIT, family, elements, gravity=NONE, finger=finger, fidelity=fidelity))
    assert found.q == pytest.approx(np.zeros(found.model.n), abs=1e-12)
    assert np.array(found.model.bending(found.q, found.u, found.p)).ravel() == pytest.approx([0.6, -0.5, 0.1])
    ends = [0.3, 0.55, 0.8, 1.0]
    angles = [float(found.model.orientation(found.q, found.u, at, found.p)) for at in ends]
    assert np.array(angles) - HORIZONTAL == pytest.approx([0.6, 0.35, 0.1, 0.2], abs=1e-12)
    energy = found.model.energy([*found.q, *np.zeros(found.model.n)], found.u, found.p)[1]
    assert float(energy) == pytest.approx(0.0, abs=1e-13)
    s = np.linspace(0.0, 1.0, 40001)
    slope = np.interp(s, [0.0, 0.3, 0.8, 1.0], [0.0, 0.6, 0.1, 0.2])
    assert found.tip == pytest.approx([integrate.simpson(f(slope), x=s) for f in (np.cos, np.sin)], abs=1e-8)
    assert found.backbone(11)[-1] == pytest.approx(found.tip, abs=1e-14)


@pytest.mark.parametrize(
    ("family", "elements", "euler", "greenhill"),
    few(
        [
            ("arc", 2, 5.3e-2, 7.6e-2),
            ("arc", 4, 1.3e-2, 1.95e-2),
            ("clothoid", 1, 7.6e-3, 6.6e-3),
            ("clothoid", 2, 5.8e-4, 4.4e-3),
            ("matched_clothoid", 2, 6.1e-4, 8.2e-3),
            ("matched_clothoid", 4, 3.5e-5, 3.3e-4),
        ],
        4,
    ),
)
def test_critical_loads_are_bounded_from_above(family, elements, euler, greenhill):
    """Euler's load, as a force and as a weight, and Greenhill's own weight: where the stiffness turns singular."""
    light = {**UNIT, "linear_density": 1e-9}
    columns = {
        "force": (lambda load: pressed(load, family, elements), EULER, euler),
        "weight": (
            lambda load: rod_scene(light, family, elements, angle=UPRIGHT, gravity=(0.0, -1.0), tip_mass=load),
            EULER,
            euler,
        ),
        "own weight": (
            lambda load: rod_scene(UNIT, family, elements, angle=UPRIGHT, gravity=(0.0, -load)),
            GREENHILL,
            greenhill,
        ),
    }
    for name, (column, exact, error) in columns.items():
        critical = optimize.brentq(
            lambda load, column=column: in_its_own_elements(column(load)).margin,
            0.8 * exact,
            1.2 * exact,
            xtol=1e-6,
        )
        assert -1e-6 <= critical / exact - 1.0 <= error, name
        below, above = (in_its_own_elements(column(critical * (1.0 + e))).stable for e in (-1e-4, 1e-4))
        assert below, name
        assert not above, name


def test_weight_input_and_loads_of_a_path_grow_together():
    """Each shape is that of the exact rod under all of them times the factor."""

    def loaded(factor: float):
        keys = {"gravity": (0.0, -0.8 * factor), "loads": [force(1.0, (0.0, 0.3 * factor))]}
        return rod_scene(UNIT, "matched_clothoid", 6, actuation={"tip_moment": 0.7 * factor}, **keys)

    factors = [0.4, 1.5, 0.0]
    for factor, found in zip(factors, equilibrium_path(loaded(1.0), factors), strict=True):
        assert found.tip == pytest.approx(solve_elastica(loaded(factor)).tip, abs=1e-5)


@pytest.mark.parametrize(
    ("family", "elements", "share", "near"),
    [
        ("matched_clothoid", 2, 0.97, False),
        ("matched_clothoid", 2, 0.995, True),
        ("matched_clothoid", 2, 1.005, True),
        ("matched_clothoid", 2, 1.2, False),
        # Two arcs buckle at 1.05 of Euler's load: what is left there is their own error, which they warn of.
        ("arc", 2, 0.95, False),
        ("arc", 2, 0.999, True),
    ],
)
def test_a_column_near_its_buckling_load_says_so(family, elements, share, near):
    """The stiffness that is left falls in proportion to the load, to zero at the critical one."""
    found = equilibrium(pressed(share * EULER, family, elements))
    assert found.stable
    said = [one for one in found.warnings if "near a buckling load" in one]
    assert len(said) == near


def test_the_path_leaves_the_straight_one_where_it_buckles():
    """The weight grows; before the critical one the rod stands, beyond it has the elastica's tip."""
    slopes = (1.0, 1.5, 2.0, 2.5)
    truth = [buckled(slope) for slope in slopes]
    factors = [0.5, 0.9, 0.99, *[load / EULER for load, _ in truth]]
    for side in (1, -1):
        scene = pressed(EULER, "matched_clothoid", 4)
        path = equilibrium_path(scene, factors, side=side)
        assert all(one.stable for one in path)
        for one in path[:3]:
            assert one.tip == pytest.approx([0.0, 1.0], abs=1e-12)
        for one, (_, (across, along)) in zip(path[3:], truth, strict=True):
            assert one.tip == pytest.approx([-side * across, along], abs=5e-4)


@pytest.mark.parametrize(
    ("family", "elements", "error"),
    [("arc", 2, 0.15), ("arc", 4, 0.035), ("clothoid", 2, 2.3e-3), ("matched_clothoid", 2, 2.7e-3)],
)
def test_after_buckling_two_mirrored_shapes_are_stable_and_the_straight_one_is_not(family, elements, error):
    for slope in (1.0, 2.0):
        load, tip = buckled(slope)
        scene = pressed(load, family, elements)
        left, right = equilibrium(scene), equilibrium(scene, side=-1)
        assert left.stable
        assert right.stable
        assert left.q == pytest.approx(-right.q, rel=1e-7)
        assert left.q[0] > 0.0
        assert np.linalg.norm(left.tip * [-1.0, 1.0] - tip) <= error
        straight = equilibrium(scene, stable=False)
        assert not straight.stable
        assert straight.margin < 0.0
        assert np.array_equal(straight.q, np.zeros(straight.model.n))


def test_a_guess_selects_the_shape_and_must_fit():
    load, _ = buckled(1.5)
    scene = pressed(load, "matched_clothoid", 2)
    left = equilibrium(scene)
    assert equilibrium(scene, guess=-left.q).q == pytest.approx(-left.q, rel=1e-7)
    with pytest.raises(InputError, match="guess: expected real numbers"):
        equilibrium(scene, guess=left.q + 0j)
    with pytest.raises(InputError, match="guess: expected 2 finite entries"):
        equilibrium(scene, guess=[1.0])


def test_extra_loads_act_besides_the_scenes():
    half = ForceLoad(at=1.0, force=(0.0, 1.0))
    assert equilibrium(pushed(1.0), extra_loads=(half,)).tip == pytest.approx(equilibrium(pushed(2.0)).tip, abs=1e-10)


@pytest.mark.parametrize("load", [1e-3, 1e-9, 1e-15])
@pytest.mark.parametrize("family", ["matched_clothoid", "clothoid"])
def test_a_slight_force_bends_as_the_linear_beam(family, load):
    """By a third of the load, whatever its size; what follows is of the cube of the load."""
    found = equilibrium(pushed(load, family))
    assert found.tip[1] == pytest.approx(load / 3.0, rel=max(1e-9, load**2))


def critical_follower(family: str, elements: int, damping: float, low: float, high: float) -> float:
    finger = {"damping": {"material": damping}}
    for _ in range(8):
        middle = 0.5 * (low + high)
        found = equilibrium(pressed(middle, family, elements, follows=True, finger=finger), stable=False)
        low, high = (middle, high) if found.stable else (low, middle)
    return low


@pytest.mark.deep
@pytest.mark.parametrize(
    ("family", "elements", "error", "error_damped"),
    [("arc", 8, 5e-2, 3e-2), ("clothoid", 2, 6e-3, 2e-2), ("matched_clothoid", 4, 2e-2, 5e-3)],
)
def test_a_following_load_flutters(family, elements, error, error_damped):
    """M. Beck, 1952: never singular stiffness, unstable all the same; a little internal damping halves the load."""
    assert critical_follower(family, elements, 0.0, 15.0, 25.0) == pytest.approx(BECK, rel=error)
    slight = critical_follower(family, elements, 1e-3, 9.0, 13.0)
    assert slight == pytest.approx(BECK_SLIGHTLY_DAMPED, rel=error_damped)
    for load in (5.0, 25.0):
        found = equilibrium(pressed(load, family, elements, follows=True), stable=False)
        assert found.stable == (load < BECK)
        assert np.array_equal(found.q, np.zeros(found.model.n))
        stiffness = np.array(found.model.statics(found.q, found.u, found.w, found.p)[1])
        assert np.linalg.det(stiffness) > 0.0


@pytest.mark.parametrize("family", ["clothoid", "matched_clothoid"])
def test_an_absurd_load_says_so(family):
    """A finger that follows its load to rounding, by a bend at the base that its elements do not resolve."""
    assert equilibrium(pushed(1e9, family)).space_error > 0.1


@pytest.mark.parametrize("family", ["clothoid", "matched_clothoid"])
def test_an_equilibrium_that_is_not_found_says_what_is_missing(family, monkeypatch):
    monkeypatch.setattr("continuum_grasp.simulation.rest._MAX_ITERATIONS", 1)
    with pytest.raises(SolverError, match="no equilibrium found") as caught:
        equilibrium(pushed(1e3, family))
    assert caught.value.status == "iteration limit"
    assert "generalized force missing" in caught.value.violated[0]
    assert "lower the loads" in caught.value.advice


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_a_stated_range_changes_no_equilibrium(family):
    free = equilibrium(pushed(5.0, family, fidelity={"accuracy": 1e-13}))
    for stated in (0.1, 0.5):
        found = equilibrium(pushed(5.0, family, fidelity={"accuracy": 1e-13, "bending_range": stated}))
        assert not any("range" in warning for warning in found.warnings)
        assert found.tip == pytest.approx(free.tip, abs=1e-10)


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
def test_one_element_that_bends_by_more_than_it_can_is_refused(family):
    with pytest.raises(SolverError, match="beyond the range of its model") as caught:
        equilibrium(rod_scene(UNIT, family, 1, angle=UPRIGHT, gravity=NONE, actuation={"tip_moment": 50.0}))
    assert caught.value.status == "beyond the bending range"
    assert "more elements" in caught.value.advice
    found = equilibrium(rod_scene(UNIT, family, 2, angle=UPRIGHT, gravity=NONE, actuation={"tip_moment": 50.0}))
    assert found.tip == pytest.approx([(math.cos(50.0) - 1.0) / 50.0, math.sin(50.0) / 50.0], abs=1e-6)


@pytest.mark.deep
@pytest.mark.parametrize("family", few(["matched_clothoid", "clothoid"], 1))
def test_a_loaded_preshape_with_jumps_converges_like_one_without(family):
    """Fourth order, as the curvature jumps where the rest curvature does; the truth is the elastica."""
    keys = {"gravity": (0.3, -1.0), "loads": [force(1.0, (1.0, 0.5))], "finger": {"rest_curvature": REST}}
    exact = solve_elastica(rod_scene(UNIT, "arc", 1, **keys)).tip
    errors = []
    for count in (2, 4, 8):
        lengths = [h / count for h in (0.3, 0.5, 0.2) for _ in range(count)]
        scene = rod_scene(UNIT, family, lengths, fidelity={"accuracy": 1e-13, "bending_range": 2.1}, **keys)
        errors.append(np.linalg.norm(equilibrium(scene).tip - exact))
    assert order(errors)[-1] == pytest.approx(4.0, abs=0.5)
    assert errors[-1] < 1e-7
