"""Starting postures, by geometry of this file's own; from inside: starts are judged before any problem is solved.

Curves are traced finely, outlines sampled finely. Whether elements are in balance, the equations of the grasp problem
say, which know nothing of maps.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from grasp_scenes import SHAPES, make_scene

from continuum_grasp.grasp import GraspStatus, optimize_grasp
from continuum_grasp.grasp.finger_map import SceneMaps, places_of
from continuum_grasp.grasp.finger_map.fill import ENTERED, WITHIN
from continuum_grasp.grasp.finger_map.settled import _finger_start
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.problem.points import starting_point
from continuum_grasp.grasp.problem.solver_run import GraspSolverRun
from continuum_grasp.grasp.problem.values import contact_features, problem_values
from continuum_grasp.grasp.starts.supports import nearest_contact, support_contacts, touching_supports
from continuum_grasp.grasp.starts.values import GraspStart
from continuum_grasp.scene import GraspScene, OffsetPolygon
from tests.marks import few

pytestmark = pytest.mark.filterwarnings("ignore:tendons.offset")
LENGTH = 0.2
TOUCHES = {"both": ("on", "on"), "middle": ("on", "off"), "tip": ("off", "on")}


def scene_of(body, fingers, **changes):
    """A weightless scene; fingers as (x, y, angle) or with more keys."""
    values = {
        "fingers": fingers,
        "object": {"mass": 0.1, "position": (0.0, 0.0), **body},
        "contacts": {"friction": 0.5, "normal_force_max": 50.0},
        "gravity": [0.0, 0.0, 0.0],
        "fidelity": {"family": "matched_clothoid", "elements": 2, "bending_range": 6.0},
        **changes,
    }
    return GraspScene.model_validate(values)


def finger_at(x, y, angle, half=0.004, **more):
    return {
        "rod": {"length": LENGTH, "linear_density": 0.03, "bending_stiffness": 6e-3},
        "half_thickness": half,
        "tendons": {"offset": 0.005, "max_tension": 100.0},
        "base": {"position": (x, y), "angle": angle},
        **more,
    }


def trace(knots, curvatures, per=60):
    """Positions, points and angles of a curve, by Gauss-Legendre between fine steps."""
    s = np.unique(np.concatenate([np.linspace(a, b, per) for a, b in pairwise(knots)]))

    def angle(at):
        grid = np.unique(np.concatenate([knots, at]))
        bent = np.interp(grid, knots, curvatures)
        turned = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(grid) * (bent[1:] + bent[:-1]))])
        return turned[np.searchsorted(grid, at)]

    x, w = np.polynomial.legendre.leggauss(4)
    inner = s[:-1, None] + np.diff(s)[:, None] * 0.5 * (x + 1.0)
    phi = angle(inner.ravel()).reshape(inner.shape)
    step = (1j * np.exp(1j * phi) * w).sum(axis=1) * 0.5 * np.diff(s)
    return s, np.concatenate([[0.0], np.cumsum(step)]), angle(s)


def world_curve(finger):
    s, z, phi = trace(np.array(finger.knots), np.array(finger.curvatures))
    x, y, turn = finger.base
    return s, complex(x, y) + np.exp(1j * turn) * z, phi + turn


def outline(part, count=1200):
    """Fine points on the outline of a part."""
    if not isinstance(part, OffsetPolygon) or part.radius > 0.0:
        z = np.array([complex(*p) for p in part.outline(count)])
    else:
        z = np.array([complex(*p) for p in part.vertices])
    return np.concatenate([np.linspace(a, b, 12, endpoint=False) for a, b in zip(z, np.roll(z, -1), strict=True)])


def height_above(part, point, normal):
    """By how much a point lies beyond the part's line of support with this normal."""
    angle = float(np.angle(normal))
    return (point * np.conj(normal)).real - part.support(angle)


def depth(scene, pose, points):
    """Greatest depth of points in the object, from support lines all round: exact for convex parts but for their
    number.
    """
    turn, at = np.exp(1j * pose[2]), complex(pose[0], pose[1])
    local = (points - at) / turn
    angles = np.linspace(0.0, math.tau, 1440, endpoint=False)
    worst = -math.inf
    for part in scene.object.parts:
        supports = np.array([part.support(a) for a in angles])
        gaps = ((local[:, None] * np.exp(-1j * angles)).real - supports).max(axis=1)
        worst = max(worst, float(-gaps.min()))
    return worst


def check_touching(scene, start):
    """Every contact touches as it should, and nothing is deeper than a start may be."""
    ox, oy, turn = start.object_pose
    for setup in scene.setups:
        finger, half = start.fingers[setup.name], setup.finger.thickness_radius
        assert finger.knots[0] == 0.0
        assert finger.knots[-1] == pytest.approx(LENGTH, abs=1e-12)
        assert all(b > a for a, b in pairwise(finger.knots))
        s, z, phi = world_curve(finger)
        stations = dict(zip((*setup.middle_names, setup.tip_name), (*finger.joints, LENGTH), strict=True))
        for name, station in stations.items():
            if name not in start.contacts:
                continue
            contact = start.contacts[name]
            point = complex(ox, oy) + np.exp(1j * turn) * complex(*contact.point)
            normal = np.exp(1j * (contact.normal_angle + turn))
            k = int(np.argmin(np.abs(s - station)))
            # The curve is known at 24 places per segment, the object by a table of distances.
            assert abs(z[k] - point - half * normal) < 4e-3 * LENGTH
            part = scene.object.parts[contact.part]
            local = np.exp(1j * contact.normal_angle)
            assert abs(height_above(part, complex(*contact.point), local)) < 1e-9 * LENGTH
            if name != setup.tip_name:
                side = finger.sides[setup.middle_names.index(name)]
                assert abs(normal - side * np.exp(1j * phi[k])) < 0.05
        assert depth(scene, start.object_pose, z) < -half + (ENTERED + WITHIN + 5e-3) * LENGTH


def starts_of(scene, on=None, count=6):
    """Samples of the fingers' maps as starts, at each place of object and bases."""
    on = frozenset(on) if on is not None else contact_modes(scene)[0]
    maps, found = SceneMaps(scene), []
    for pose, bases in places_of(scene, on):
        each = [
            maps.map_of(setup.name, base, pose, on, exact=False)
            for setup, base in zip(scene.setups, bases, strict=True)
        ]
        for k in range(count if min(map(len, each)) else 0):
            rows = [one.samples.take([k * (len(one) - 1) // count]) for one in each]
            contacts = support_contacts(scene, pose, on)
            for at, setup in zip(rows, scene.setups, strict=True):
                names = [name for name in (*setup.middle_names, setup.tip_name) if name in on]
                for name, x, y in zip(names, *(part.value[0] for part in at.touches.place), strict=False):
                    contacts[name] = nearest_contact(scene, pose, LENGTH * complex(x, y))
            fingers = {at.finger.name: _finger_start(at) for at in rows}
            found.append(GraspStart("map", pose, fingers, contacts))
    return found


def touching(body, kind, half=0.004, base=(-0.05, -0.09, 0.1)):
    middle, tip = TOUCHES[kind]
    contacts = {"friction": 0.5, "normal_force_max": 50.0, "middle": middle, "tip": tip}
    return scene_of(body, {"f": finger_at(*base, half)}, contacts=contacts)


@pytest.mark.parametrize("half", [0.002, 0.004])
@pytest.mark.parametrize("kind", TOUCHES)
@pytest.mark.parametrize("shape", SHAPES)
def test_starts_touch_and_keep_clear(shape, kind, half):
    scene = touching(SHAPES[shape], kind, half)
    starts = starts_of(scene)
    assert len(starts) == 6
    for start in starts:
        check_touching(scene, start)


@pytest.mark.parametrize("shape", ["circle", "superellipse", "box"])
def test_several_fingers_touch(shape):
    scene = scene_of(
        SHAPES[shape],
        {
            "a": finger_at(-0.05, -0.12, 0.0),
            "b": finger_at(0.05, -0.12, 0.0),
            "c": finger_at(0.0, 0.16, math.pi, contacts={"middle": "off"}),
        },
        overlap="allow",
    )
    starts = starts_of(scene)
    assert len(starts) == 6
    for start in starts:
        assert set(start.contacts) == {"a.middle", "a.tip", "b.middle", "b.tip", "c.tip"}
        check_touching(scene, start)


def reachable(rng, shape, kind):
    """A scene made round a posture: a random curve, and the object put against it; None where it lies on it."""
    half = float(rng.choice([0.0, 0.02, 0.04]))
    knots = np.array([0.0, rng.uniform(0.2, 0.8), 1.0])
    bent = np.array([rng.uniform(-3.0, 5.0), rng.uniform(-2.0, 5.0), 0.0])
    part = scene_of(shape, {"f": finger_at(9.0, 9.0, 0.0)}).object.parts[0]
    ring = outline(part, 240) / LENGTH
    normal = np.exp(1j * rng.uniform(0.0, math.tau))
    place = ring[np.argmax((ring * np.conj(normal)).real)]

    def clear(z, turn, shift, last):
        edges = np.roll(ring, -1) - ring
        local = (z - shift) / turn
        rel = (local[:, None] - ring) * np.conj(edges) / np.abs(edges)
        near = np.abs(rel - np.clip(rel.real, 0.0, np.abs(edges))).min(axis=1)
        gap = np.where((rel.imag > 0.0).all(axis=1), -near, near) - half
        return gap[:-last].min() > -1e-4 if last else gap

    if kind == "tip":
        bent[1:] = bent[0] + (bent[1] - bent[0]) * knots[1], bent[1]
        _, z, phi = trace(knots, bent, 30)
        turn = -1j * np.exp(1j * (phi[-1] + rng.uniform(-1.2, 1.2))) / normal
        shift = z[-1] - half * turn * normal - turn * place
        return (bent, turn, shift, half) if clear(z, turn, shift, 1) else None
    bent[2] = bent[1]
    s, z, phi = trace(knots, bent, 30)
    k = int(np.argmin(np.abs(s - knots[1])))
    turn = np.exp(1j * phi[k]) / normal
    shift = z[k] - half * turn * normal - turn * place
    if kind == "middle":
        return (bent, turn, shift, half) if clear(z[::3], turn, shift, 1) else None
    tries = np.linspace(-12.0, 20.0, 60)
    curves = [trace(knots, np.array([bent[0], bent[1], t]), 20) for t in tries]
    gaps = clear(np.array([c[1][-1] for c in curves]), turn, shift, 0)
    for j in np.flatnonzero((gaps[:-1] > 0.0) & (gaps[1:] <= 0.0)):
        good = clear(curves[j][1][::3], turn, shift, 1)
        ahead = clear(curves[j][1][-1:] + 1e-3 * 1j * np.exp(1j * curves[j][2][-1]), turn, shift, 0)
        if good and ahead[0] < gaps[j] - 1e-4:
            return bent, turn, shift, half
    return None


@pytest.mark.parametrize("kind", TOUCHES)
@pytest.mark.parametrize(
    "shape", few(["rounded box", "circle", "polygon", "superellipse", "stadium", "ellipse", "box"], 3)
)
def test_postures_are_found_where_there_are_some(shape, kind):
    rng = np.random.default_rng(5)
    hits, made = 0, 0
    while made < 8:
        found = reachable(rng, SHAPES[shape], kind)
        if found is None:
            continue
        _, turn, shift, half = found
        made += 1
        place = {"position": (shift.real * LENGTH, shift.imag * LENGTH), "angle": float(np.angle(turn))}
        starts = starts_of(touching({**SHAPES[shape], **place}, kind, half * LENGTH, (0.0, 0.0, 0.0)), count=1)
        hits += bool(starts)
    assert hits >= 7


def test_box_on_a_floor_touches_at_both_ends_of_its_face():
    scene = scene_of(
        {**SHAPES["box"], "position": (0.0, 0.03)},
        {"f": finger_at(0.3, 0.3, 0.0)},
        supports={
            "floor": {"type": "palm", "point": (0.0, 0.0), "normal_angle": 0.5 * math.pi},
            "ledge": {"type": "line", "start": (0.02, 0.0), "end": (0.3, 0.0)},
        },
    )
    found = support_contacts(scene, scene.object.pose, {"floor", "ledge"})
    assert found["floor.1"].point == pytest.approx((0.04, -0.03))
    assert found["floor.2"].point == pytest.approx((-0.04, -0.03))
    assert found["floor.1"].normal_angle == pytest.approx(-0.5 * math.pi)
    assert sorted(found[f"ledge.{k}"].point[0] for k in (1, 2)) == pytest.approx([0.02, 0.04])
    assert touching_supports(scene, scene.object.pose) == {"floor", "ledge"}
    assert touching_supports(scene, (0.0, 0.03 + 1e-6, 0.0)) == frozenset()
    tipped = support_contacts(scene, (0.0, 0.05, 0.3), {"floor"})
    assert set(tipped) == {"floor"}
    assert tipped["floor"].point == pytest.approx((-0.04, -0.03))


def test_free_objects_are_moved_onto_their_supports():
    opening, radius = 1.4, 0.03
    scene = scene_of(
        {
            "shape": "circle",
            "diameter": 2 * radius,
            "position": (0.004, 0.07),
            "free": {"x": (-0.02, 0.02), "y": (0.0, 0.1)},
        },
        {"f": finger_at(0.0, 0.25, math.pi, contacts={"middle": "off"})},
        supports={"v": {"type": "v_groove", "apex": (0.0, 0.0), "opening_angle": opening, "axis_angle": 0.5 * math.pi}},
    )
    for start in starts_of(scene, on={"f.tip", "v.left", "v.right"}):
        assert start.object_pose[:2] == pytest.approx((0.0, radius / math.sin(0.5 * opening)), abs=1e-10)
        assert {"v.left", "v.right", "f.tip"} == set(start.contacts)


def test_free_polygons_come_to_lie_flat():
    scene = scene_of(
        {**SHAPES["box"], "position": (0.0, 0.045), "angle": 0.2, "free": {"y": (0.0, 0.1), "angle": (-0.5, 0.5)}},
        {"f": finger_at(0.0, 0.22, math.pi, contacts={"middle": "off"})},
        supports={"floor": {"type": "palm", "point": (0.0, 0.0), "normal_angle": 0.5 * math.pi}},
    )
    starts = starts_of(scene, on={"f.tip", "floor"})
    assert any("floor.1" in s.contacts and abs(s.object_pose[2]) < 1e-12 for s in starts)
    for start in starts:
        assert 0.0 <= start.object_pose[1] <= 0.1
        assert -0.5 <= start.object_pose[2] <= 0.5
        c, s = math.cos(start.object_pose[2]), math.sin(start.object_pose[2])
        low = min(start.object_pose[1] + s * x + c * y for x in (-0.04, 0.04) for y in (-0.03, 0.03))
        assert low == pytest.approx(0.0, abs=1e-12)


def test_what_cannot_be_reached_has_no_starts():
    body = {"shape": "circle", "diameter": 0.08, "position": (0.4, 0.0)}
    fixed = scene_of(body, {"f": finger_at(0.0, 0.0, 0.0)})
    assert starts_of(fixed) == []


@pytest.mark.parametrize("kind", ["both", "tip"])
@pytest.mark.parametrize(
    ("family", "elements"),
    [("arc", 2), ("arc", 4), ("clothoid", 2), ("clothoid", 4), ("matched_clothoid", 2), ("matched_clothoid", 4)],
)
def test_fingers_with_few_elements_start_in_their_own_balance(family, elements, kind):
    """By the equations of the problem: moments that are left, in units of E I / L. Exact rods leave more."""
    middle, tip = TOUCHES[kind]
    contacts = {"friction": 0.8, "normal_force_max": 200.0, "middle": middle, "tip": tip}
    scene = make_scene(family, elements=elements, max_tension=300.0, contacts=contacts, stability="ignore")
    maps, (mode, *_) = SceneMaps(scene), contact_modes(scene)
    place = places_of(scene, mode)[0]
    own, exact = (maps.settled(mode, place, exact=way)[0] for way in (False, True))

    def left(start):
        run, features = GraspSolverRun.of(scene, start.contacts, frozenset()), contact_features(scene, start.contacts)
        layout = run.problem
        numbers = layout.numbers.pack(problem_values(layout, scene, start, features), 0.0)
        x = starting_point(layout, scene, start, features)
        rows = np.array(run.nlp.functions["jac_g"](x, numbers)[0]).ravel()
        (block,) = (one for one in layout.rows.blocks if one.name == "finger equilibrium, finger")
        return np.abs(rows[block.rows]).max()

    assert own.imbalance < 1e-3
    assert left(own) < 0.05
    assert left(own) < 0.15 * left(exact)


def test_without_a_compiler_postures_that_nearly_touch_lead_to_the_same_grasp(monkeypatch):
    scene = make_scene(elements=4)
    mapped = optimize_grasp(scene)
    monkeypatch.setenv("CC", "")
    rough = optimize_grasp(scene)
    assert (mapped.status, rough.status) == (GraspStatus.OPTIMAL, GraspStatus.FEASIBLE)
    assert rough.tension == pytest.approx(mapped.tension, rel=1e-6)
