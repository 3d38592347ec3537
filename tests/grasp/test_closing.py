"""The way into a grasp, against closed forms, balances and the laws of friction."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from grasp_hand_made import arrays_of, make_scene
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import continuum_grasp as cg
from continuum_grasp import nlp
from continuum_grasp.errors import InputError
from continuum_grasp.grasp import ClosingStatus, GraspResult, closing_path
from continuum_grasp.grasp.closing.energy import Closing, ClosingFinger, Sight
from continuum_grasp.grasp.closing.verdict import NEAR, Ending, Step
from continuum_grasp.scene.objects import Circle
from continuum_grasp.scene.supports import Palm


@cache
def grasp(name: str, *changes: str) -> GraspResult:
    return cg.optimize_grasp(cg.load(f"configs/grasp/{name}.yaml", list(changes)))


@pytest.mark.deep
def test_tips_touch_where_circles_do() -> None:
    result = grasp("pinch")
    path = closing_path(result.scene, result.arrays, steps=200)
    setup = result.scene.setups[0]
    finger, body = setup.finger, result.scene.object
    length, half = finger.rod.length, finger.thickness_radius
    start, turn = complex(*finger.base.position), np.exp(1j * finger.base.angle)

    def gap(curvature: float) -> float:
        # An unloaded finger under a moment is an arc from the base along +Y, its center at -1 / curvature.
        tip = start + turn * (np.exp(1j * curvature * length) - 1.0) / curvature
        return body.distance((tip.real, tip.imag)) - half

    left, right = path.tensions[setup.name][-1]
    moment = finger.tendons.offset * (left - right)
    curvature = brentq(gap, 1e-3 * moment / finger.rod.bending_stiffness, 1.2 * moment / finger.rod.bending_stiffness)
    touch = next(t for t in path.touches if t.finger == setup.name)
    assert touch.station == pytest.approx(length)
    # The first step at which it presses is the first one beyond.
    assert 0.0 <= touch.share - curvature * finger.rod.bending_stiffness / moment <= 1.5 / 200
    assert path.status is ClosingStatus.REACHED


def test_places_press_within_their_cones_and_slide_at_their_edge() -> None:
    """With one solution per step, or friction that is full at ten times the slip, the cones are not used up."""
    result = grasp("mug_arcs")
    path = closing_path(result.scene, result.arrays, steps=20)
    normal, friction = path.normal_forces["finger"], path.friction_forces["finger"]
    coefficient = result.scene.setups[0].friction
    # Neighbors share the force where the finger lies along the object: together they are one contact, which slides.
    loaded = normal.sum(axis=1) > 0.1 * normal.sum(axis=1).max()
    used = np.abs(friction).sum(axis=1)[loaded] / normal.sum(axis=1)[loaded]
    assert 0.93 * coefficient < used.max() <= 1.01 * coefficient
    assert path.distance < 0.01 * result.scene.setups[0].finger.rod.length


@pytest.mark.deep
def test_work_is_stored_or_lost_to_friction() -> None:
    """Over the path the tendons' work is elastic energy and friction, better so the finer the steps."""
    result = grasp("mug", "contacts.friction=0.4")
    finger = result.scene.setups[0].finger
    missing = []
    for steps in (40, 80):
        path = closing_path(result.scene, result.arrays, steps=steps)
        line, stations = path.lines["finger"], path.stations["finger"]
        # From positions alone: the angle of the tip and the elastic energy of a uniform rod by second differences.
        s = np.concatenate([[0.0], stations])
        chord = np.diff(line, axis=1)
        angle = np.unwrap(np.arctan2(chord[..., 1], chord[..., 0]), axis=1)
        middle = 0.5 * (s[1:] + s[:-1])
        curvature = np.diff(angle, axis=1) / np.diff(middle)
        inner = np.concatenate([curvature[:, :1], curvature, curvature[:, -1:]], axis=1)
        energy = 0.5 * finger.rod.bending_stiffness * np.trapezoid(inner**2, s, axis=1)
        end = angle[:, -1] + curvature[:, -1] * 0.5 * (s[-1] - s[-2])
        moment = finger.tendons.offset * (path.tensions["finger"] @ [1.0, -1.0])
        work = float(np.sum(0.5 * (moment[1:] + moment[:-1]) * np.diff(end)))
        missing.append((work - float(energy[-1] - energy[0])) / work)
    # What is missing went into friction: little, and not negative beyond the error of differences.
    assert all(-2e-3 < part < 0.1 for part in missing)


@pytest.mark.deep
def test_an_object_slides_on_a_table_under_its_friction() -> None:
    result = grasp("pinch_above")
    path = closing_path(result.scene, result.arrays, table_friction=0.2)
    force = np.hypot(*path.wrenches[:, :2].T)
    most = 0.2 * result.scene.weight
    moved = np.hypot(*np.diff(path.poses[:, :2], axis=0).T) > 1e-3 * result.scene.object.size
    assert moved.any()
    assert force[1:][moved] == pytest.approx(most, rel=0.05)  # rounded where slip is small
    assert force.max() <= 1.001 * most
    still = closing_path(result.scene, result.arrays, table_friction=5.0)
    assert np.abs(still.poses - still.poses[0]).max() < 1e-3


def test_a_finger_on_its_way_bends_like_a_rod_and_cuts_no_corners() -> None:
    """Under a force of 10 E I / L^2 across its tip it takes the shape of the elastica; between two of its places it
    enters the disc of the mug by less than a tenth of what tells postures apart.
    """
    scene = cg.load("configs/grasp/mug.yaml")
    setup, load = scene.setups[0], 10.0
    finger = ClosingFinger(scene, setup, np.zeros(3))
    length, scale = finger.length, setup.stiffness / finger.length
    energy = finger.potential / scale - load * finger.places[-1][0] / length
    free, none = np.full(finger.q.numel(), np.inf), np.zeros(0)
    problem = nlp.NLP("bent", finger.q, energy, ca.SX(0, 1), ca.SX(0, 1))
    start = nlp.Start(np.zeros(free.size), -free, free, none, none, none)
    bent = nlp.new_solver(nlp.Settings()).solve(problem, start, nlp.Budget())
    tip = np.array(ca.Function("tip", [finger.q], [finger.places[-1]])(bent.x)).ravel() / length

    def rod(curvature: float) -> Any:
        """Angle, curvature and place at the end of a rod that begins with a curvature along +Y."""
        slopes = lambda s, y: [y[1], load * np.cos(y[0]), -np.sin(y[0]), np.cos(y[0])]  # noqa: E731
        return solve_ivp(slopes, (0.0, 1.0), [0.0, curvature, 0.0, 0.0], rtol=1e-10, atol=1e-11).y[:, -1]

    assert tip == pytest.approx(rod(brentq(lambda k: rod(k)[1], -5.0, 0.0))[2:], abs=2e-5)
    radius = 0.5 * scene.object.size + setup.finger.thickness_radius
    sagitta = radius - np.sqrt(radius**2 - 0.25 * np.diff(finger.stations).max() ** 2)
    assert sagitta < 0.1 * NEAR * length


def test_a_round_foot_resists_turning_by_two_thirds_of_its_radius() -> None:
    """A disc that turns under even pressure takes the moment mu W 2 R / 3: integral of mu p r over its area."""
    result = grasp("pinch_above")
    scene = result.scene
    closing = Closing(scene, result.arrays, 0.3)
    energy = ca.Function("energy", [closing.problem.x, closing.problem.p], [closing.problem.f * closing.unit])
    x, p = np.zeros(closing.problem.x.numel()), np.zeros(closing.problem.p.numel())
    p[-4], p[-3:] = 1e-6, closing.grasped  # nearly sharp friction, from where the object was
    taken = []
    for turn in (0.2, 0.3):
        x[-3:] = closing.grasped / closing.scale + [0.0, 0.0, turn]
        taken.append(float(energy(x, p)))
    radius = 0.5 * scene.object.size
    assert (taken[1] - taken[0]) / 0.1 == pytest.approx(0.3 * scene.weight * 2.0 / 3.0 * radius, rel=1e-6)


def test_the_moment_on_the_object_is_about_its_center_of_mass() -> None:
    """On a disc normal forces run through the center and friction has the radius as its arm; moments about the center
    of mass follow from the shift of the point. A peg that presses is none of the fingers.
    """
    pose, com, radius = np.array([0.3, -0.2, 0.7]), (0.02, -0.01), 0.04
    rim = np.exp(1j * np.array([0.4, 2.0, 3.9]))
    normal, friction = np.array([2.0, 9.0, 3.0]), np.array([0.5, -4.0, 0.8])
    outward = np.stack([rim.real, rim.imag])
    sight = Sight(np.zeros(0), np.zeros(3), outward, pose[:2, None] + radius * outward, np.zeros((2, 0)), pose)
    closing: Any = SimpleNamespace(scene=SimpleNamespace(object=SimpleNamespace(com=com)))
    step, here = Step(1.0, np.zeros(2), np.zeros(0), sight, normal, friction), [0, 2]
    force = -((normal + 1j * friction) * rim)[here].sum()
    arm = complex(*com) * np.exp(1j * pose[2])
    moment = -radius * friction[here].sum() - (arm.conjugate() * force).imag
    found = Ending(closing, {}, [], 0.0)._wrench(step, here)
    np.testing.assert_allclose(found, [force.real, force.imag, moment], rtol=1e-12)


def test_a_support_that_bears_what_fingers_do_leaves_nothing_to_hold() -> None:
    """Of a wrench against the normal of a support all is borne where it acts through the point of contact, as it is
    about the center of mass; and none where it pulls away.
    """
    com, point, angle = (0.02, -0.01), (-0.04, 0.0), 0.7
    body = Circle(shape="circle", diameter=0.08, mass=0.3, position=(0.0, 0.0), angle=angle, center_of_mass=com)
    palm = Palm(type="palm", point=point, normal_angle=0.0)
    scene = make_scene(object=body, supports={"palm": palm})
    arrays = arrays_of([("palm", point, (-1.0, 0.0), (1.0, 0.0, 0.0), np.nan)], pose=(0.0, 0.0, angle))
    closing: Any = SimpleNamespace(scene=scene)
    ending, arm = Ending(closing, arrays, [], 0.0), complex(*point) - complex(*com) * np.exp(1j * angle)
    for force in (-3.0 + 0.0j, -3.0 + 1.4j):  # within the cone of 0.5
        wrench = np.array([force.real, force.imag, (arm.conjugate() * force).imag])
        assert ending._held(wrench) == pytest.approx(0.0, abs=1e-9)
        assert ending._held(-wrench) > 3.0


@pytest.mark.deep
def test_a_finger_that_meets_a_peg_lies_round_it() -> None:
    radius, center = 0.005, (0.130, 0.0)
    peg = f"{{type: point, position: [{center[0]}, {center[1]}], radius: {radius}, touch: off}}"
    result = grasp("mug", f"supports.peg={peg}")
    path = closing_path(result.scene, result.arrays)
    line = path.lines["finger"]
    away = np.linalg.norm(line - center, axis=2).min(axis=1)
    half = result.scene.setups[0].finger.thickness_radius
    assert path.status is ClosingStatus.ELSEWHERE
    assert away.min() == pytest.approx(radius + half, rel=1e-4)


@pytest.mark.deep
def test_a_finger_in_the_object_is_opened_by_the_other_tendon() -> None:
    result = grasp("preshaped")
    path = closing_path(result.scene, result.arrays)
    assert path.shares[0] < 0.0
    other = path.tensions["finger"][0]
    assert other.min() == 0.0 < other.max()


def test_what_cannot_be_closed() -> None:
    result = grasp("pinch")
    with pytest.raises(InputError, match="out_of_plane"):
        closing_path(result.scene, result.arrays, table_friction=0.3)
    assert result.closing is None
    failed = cg.optimize_grasp(cg.load("configs/grasp/heavy_bottle.yaml", ["closing={}"]), raise_on_failure=False)
    assert failed.closing is None


@pytest.mark.deep
def test_a_scene_that_asks_has_a_way_in(tmp_path: object) -> None:
    result = grasp("pinch", "closing={steps: 20}")
    assert result.closing is not None
    assert len(result.closing.shares) == 21
    assert [picture.name for picture in result.drawable()] == ["grasp", "closing"]
    assert "reached" in result.pairs()["closing"]
