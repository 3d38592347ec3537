"""Wrench spaces and indices; from inside: the linear and conic problems below them, with data made here.

Wrench spaces, the indices and the linear problems below them.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.optimize import linprog, nnls
from scipy.spatial import ConvexHull

from continuum_grasp.base import InputError
from continuum_grasp.grasp import Quality
from continuum_grasp.grasp.quality.conic import Cones, solve_conic
from continuum_grasp.grasp.quality.contact_set import epsilon_l1
from continuum_grasp.results import plain
from continuum_grasp.scene import Circle
from tests import certificate_cases as cases

THIRDS = (0.0, 2 * math.pi / 3, 4 * math.pi / 3)


DISC = Circle(shape="circle", diameter=0.08, mass=0.3, position=(0.0, 0.0))


def space_of(angles, friction):
    """The wrenches of contacts on the disc, seen from its center at these angles [rad]."""
    scene = cases.make_scene(cases.make_finger((0.5, 0.5)), DISC, {"friction": friction})
    normals = [(math.cos(angle), math.sin(angle)) for angle in angles]
    contacts = [(f"finger.middle_{k}", 0.04 * np.array(n), n, (1, 0, 0), cases.NONE, 0) for k, n in enumerate(normals)]
    return Quality(scene, {"object.pose": np.zeros(3), **cases.contact_arrays(contacts)})


# -- linear and conic problems -------------------------------------------------------------------------------------


def test_linear_problems_end_as_those_of_scipy():
    rng = np.random.default_rng(3)
    ends = set()
    for k in range(150):
        n, m, equal = rng.integers(2, 10), rng.integers(3, 25), rng.integers(0, 3)
        rows, high = rng.normal(size=(m, n)), rng.normal(size=m) + rng.uniform(-0.5, 2.0)
        low = np.where(np.arange(m) < equal, high, -np.inf)
        cost, least = rng.normal(size=n), (0.0 if k % 2 else -np.inf)
        ours = solve_conic(cost, rows, low, high, least)
        theirs = linprog(
            cost, rows[equal:], high[equal:], rows[:equal], high[:equal], bounds=[(None if k % 2 == 0 else 0.0, None)]
        )
        assert ours.status == {0: "optimal", 2: "infeasible", 3: "unbounded"}[theirs.status]
        ends.add(ours.status)
        if ours.optimal:
            assert ours.objective == pytest.approx(theirs.fun, rel=1e-8, abs=1e-8)
            assert ours.residual < 1e-9
    assert ends == {"optimal", "infeasible", "unbounded"}


@pytest.mark.parametrize(("cost", "rows"), [([math.nan, 1.0], [[1.0, 1.0]]), ([1.0, 1.0], [[math.nan, 1.0]])])
def test_a_number_that_is_none_is_refused(cost, rows):
    with pytest.raises(InputError):
        solve_conic(cost, rows, 0.0, 1.0, 0.0, 1.0)
    with pytest.raises(InputError):
        solve_conic([1.0, 1.0], [[1.0, 1.0]], math.nan, 1.0)


def test_crossed_bounds_are_infeasible_and_rows_of_rounding_do_no_harm():
    assert solve_conic([1.0], [[1.0]], 0.0, 1.0, 2.0, 1.0).status == "infeasible"
    found = solve_conic([-1.0, 0.0], [[1.0, -1.0], [0.0, 1e-16]], 0.0, 0.0, 0.0, 5.0)
    assert found.objective == pytest.approx(-5.0)


def test_nothing_is_printed(capfd):
    solve_conic([1.0, -1.0], [[1.0, 2.0]], 0.0, 1.0, 0.0, 3.0)
    solve_conic([1.0, -1.0], [[1.0, 2.0]], 7.0, 9.0, 0.0, 1.0)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("cost", [1.0, 1e-6])
def test_of_a_disc_the_point_farthest_in_one_direction_is_found(cost):
    disc = Cones(np.eye(2)[None], np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1))
    found = solve_conic([-0.6 * cost, -0.8 * cost], np.zeros((0, 2)), [], [], -9.0, 9.0, disc)
    assert found.x == pytest.approx([0.6, 0.8], abs=2e-4)
    assert math.isclose(found.objective, -cost, rel_tol=1e-6, abs_tol=1e-9)


def test_rounding_beside_great_numbers_is_not_scaled_up():
    """A held mug whose cone is a strip, under a moment; numbers of 1e-11 are rounding of what is zero."""
    rows = np.array(
        [
            [-3.8e-12, 1.8e-11, -1.8e-11],
            [-47.3672, 9.0643, -9.0643],
            [-11.2529, 21.0855, -21.0855],
            [-54.941, 9.974, -9.974],
            [-6.932, 33.5597, -33.5597],
            [0.0, 1.0, -1.0],
        ]
    )
    most, upper = np.array([9.194, 1.0, 1.0, 1.0, 1.0, 0.5579]), [1.0194e5, 0.5579, 1.0]
    cost, strip = np.array([-1.0, 1e-7, 1e-7]), np.array([1.0, -4.6915, 4.6915])
    matrix = np.array([[strip, np.zeros(3)]])
    cones = Cones(matrix, np.array([[3.8e-12, 0.0]]), np.array([[-1.9e-12, 9.0e-12, -9.0e-12]]), np.array([0.5]))
    found = solve_conic(cost, rows, -1.0, most, 0.0, upper, cones)
    straight = np.concatenate([rows, -rows, [strip, -strip]])
    exact = linprog(cost, straight, np.concatenate([most, np.ones(6), [0.5, 0.5]]), bounds=[(0.0, u) for u in upper])
    assert found.objective == pytest.approx(exact.fun, abs=1e-8)


def test_optima_within_cones_obey_the_optimality_conditions():
    """The cost is a sum of the normals of what is active with factors above zero (Karush, Kuhn and Tucker)."""
    rng = np.random.default_rng(0)
    for _ in range(40):
        size, count = int(rng.integers(3, 8)), int(rng.integers(1, 5))
        offset = 0.3 * rng.normal(size=(count, 2))
        spare = np.linalg.norm(offset, axis=1) + rng.uniform(0.1, 1.0, count)
        matrix, width = rng.normal(size=(count, 2, size)), 0.3 * np.abs(rng.normal(size=(count, size)))
        cost = rng.normal(size=size)
        found = solve_conic(cost, np.zeros((0, size)), [], [], -5.0, 5.0, Cones(matrix, offset, width, spare))
        vectors, offsets = matrix @ found.x + offset, width @ found.x + spare
        lengths = np.hypot(*vectors.T)
        assert (lengths <= offsets + 1e-8).all()
        on = lengths > offsets - 1e-6
        # At the tip of a cone all of its tangent planes touch.
        around = np.exp(2j * np.pi * np.arange(360) / 360)
        normals = [
            direction @ matrix[k] - width[k]
            for k in np.flatnonzero(on)
            for direction in (
                [vectors[k] / lengths[k]] if lengths[k] > 1e-6 else np.column_stack([around.real, around.imag])
            )
        ]
        faces = np.concatenate([np.eye(size)[found.x > 5.0 - 1e-6], -np.eye(size)[found.x < -5.0 + 1e-6]])
        _, left = nnls(np.concatenate([np.reshape(normals, (-1, size)), faces]).T, -cost)
        assert left < 1e-4


# -- wrench space --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.05, 0.3, 0.5, 1.0, 1.6])
def test_two_antipodal_contacts_on_a_disc(friction):
    space = space_of((0.3, 0.3 + math.pi), friction)
    assert space.epsilon_l1 == pytest.approx(friction / math.sqrt(2 + friction**2), abs=1e-12)


@pytest.mark.parametrize("friction", [0.05, 0.5, 0.8, 1.0, 1.3])
def test_three_contacts_at_120_degrees(friction):
    """The hull is an antiprism: its lids at the moment mu, its sides at a distance that the cone's angle gives."""
    space = space_of(THIRDS, friction)
    side = 1.0 / math.sqrt(1.0 + 2.0 * math.tan(math.pi / 3 - math.atan(friction)) ** 2)
    assert space.epsilon_l1 == pytest.approx(min(friction, side), abs=1e-12)


def test_random_wrench_spaces_as_hulls_of_scipy():
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(40):
        count = int(rng.integers(2, 5))
        edges = rng.normal(size=(2 * count, 3))
        closure = epsilon_l1(edges)
        hull = ConvexHull(edges)
        depth = -hull.equations[:, 3].max()
        if depth > 0.0:
            inside += 1
            assert closure == pytest.approx(depth, abs=1e-12)
        else:
            assert closure == pytest.approx(-distance_to_hull(edges), abs=1e-7)
    assert 5 < inside < 35


def distance_to_hull(points, steps=20000):
    """By Frank and Wolfe's method with away steps, of the origin."""
    weights = np.zeros(len(points))
    weights[0] = 1.0
    for _ in range(steps):
        x = weights @ points
        slopes = points @ x
        near, far = int(np.argmin(slopes)), int(np.argmax(np.where(weights > 0.0, slopes, -np.inf)))
        way = points[near] - points[far]
        if x @ way > -1e-15:
            break
        step = min(weights[far], -(x @ way) / (way @ way))
        weights[near] += step
        weights[far] -= step
    return float(np.linalg.norm(weights @ points))


# -- all indices in one place --------------------------------------------------------------------------------------


def bent_pinch():
    """Two bent fingers that hold a disc from both sides."""
    fingers = {"a": cases.make_finger((-0.15, -0.1), -0.4), "b": cases.make_finger((0.15, -0.1), 0.4)}
    scene = cases.make_scene(fingers, DISC, family="clothoid")
    values = {
        "a": {"q": (4.0, 3.0, 2.0), "tensions": (3.0, 0.0)},
        "b": {"q": (-4.0, -3.0, -2.0), "tensions": (0.0, 6.0)},
    }
    contacts = [
        ("a.tip", (-0.04, 0.0), cases.LEFT, (2.0, 0.5, 0.0), cases.LENGTH, 0),
        ("b.tip", (0.04, 0.0), cases.RIGHT, (3.0, -0.5, 0.0), cases.LENGTH, 0),
    ]
    return scene, cases.stored(scene, values, contacts)


def test_quality_gathers_the_indices():
    quality = Quality(*bent_pinch())
    assert quality.friction_margin == pytest.approx(1.0 - 0.5 / (0.5 * 2.0))
    assert quality.friction_margins["b.tip"] == pytest.approx(1.0 - 0.5 / (0.5 * 3.0))
    assert quality.tension_margin == pytest.approx(1.0 - 6.0 / 60.0)
    assert quality.normal_force_spread == pytest.approx(1.0 / 3.0)
    assert quality.torque_scale == pytest.approx(0.04)
    assert quality.epsilon_l1 == pytest.approx(0.5 / math.sqrt(2.25))
    names = [row[0] for row in quality.rows()]
    assert names[0] == "disturbance_margin"
    assert len(set(names)) == len(names) == 5
    assert all(getattr(quality, name) == value for name, value, _ in quality.rows())
    data = json.loads(json.dumps(plain(quality.data()), allow_nan=False))
    assert data["epsilon_l1"] == quality.epsilon_l1
    assert len(data["resistance"]["factors"]) == 6
    assert quality.resistance_polygon.shape == (36, 2)
