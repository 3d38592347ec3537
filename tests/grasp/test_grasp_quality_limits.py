"""The numbers of grasp quality, on either side of each; from inside: the conic solver and parts of the indices, alone.

The numbers of grasp quality: each decides otherwise on either side of it, or keeps a promise.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import linprog, nnls
from scipy.spatial import ConvexHull

from continuum_grasp.base import InputError
from continuum_grasp.grasp.quality import conic
from continuum_grasp.grasp.quality.bent_finger import rolled
from continuum_grasp.grasp.quality.conic import Cones, solve_conic
from continuum_grasp.grasp.quality.contact_set import ContactSet, epsilon_l1
from continuum_grasp.grasp.quality.resistance import _Limits, difference_range
from continuum_grasp.scene import Box
from tests import certificate_cases as cases
from tests.grasp.test_grasp_response import axial_pinch


def believed(excess, monkeypatch):
    """Whether an optimum is believed that breaks a bound of one by a part of one and the number."""
    x = (1.0 + excess) / (1.0 - excess)
    found = SimpleNamespace(status="Solved", x=[x], obj_val_dual=-x)
    monkeypatch.setattr(conic.clarabel, "DefaultSolver", lambda *_: SimpleNamespace(solve=lambda: found))
    return solve_conic([-1.0], np.zeros((0, 1)), [], [], 0.0, 1.0).optimal


def test_points_that_break_a_limit_are_no_optima(monkeypatch):
    assert believed(0.99e-6, monkeypatch)
    assert not believed(1.01e-6, monkeypatch)


def shortfall_believed(gap, monkeypatch):
    """Whether the number 0.5 is believed to be the least one where the dual problem leaves a gap."""
    found = SimpleNamespace(status="AlmostSolved", x=[0.5], obj_val_dual=0.5 - gap)
    monkeypatch.setattr(conic.clarabel, "DefaultSolver", lambda *_: SimpleNamespace(solve=lambda: found))
    return solve_conic([1.0], np.zeros((0, 1)), [], [], 0.0, 1.0).optimal


def test_points_that_may_be_bettered_are_no_optima(monkeypatch):
    assert shortfall_believed(1.4e-6, monkeypatch)
    assert not shortfall_believed(1.6e-6, monkeypatch)


# -- limits of disturbances ----------------------------------------------------------------------------------------


def limits_of(**changes):
    """The limits of one contact that presses with a newton, and of one finger."""
    limits = object.__new__(_Limits)
    values = {
        "names": ("a.tip",),
        "setups": (SimpleNamespace(name="a"),),
        "scale": 1.0,
        "forces": np.array([[1.0, 0.0, 0.0]]),
        "friction": np.ones(1),
        "normal_max": np.ones(1),
        "low": np.zeros(1),
        "high": np.full(1, math.inf),
        "spare": np.zeros(1),
        "ranges": np.array([[-9.0, 9.0]]),
        "reach": np.full(4, math.inf),
    }
    vars(limits).update(values | changes)
    return limits


def names_a_limit(**changes):
    limits = limits_of(**changes)
    return bool(limits._reached(limits.forces, np.zeros(1), np.zeros(4)))


def is_limited(most):
    """Whether a disturbance counts as limited that changes a contact's force by this multiple of its greatest one."""
    one, no = np.ones((1, 1)), np.zeros((3, 1))
    unit = SimpleNamespace(forces=np.array([[[1.0], [0.0]]]), differences=one, pose=no, bends=0.0 * one)
    limits = limits_of(ranges=np.array([[-most, most]]), unit=unit, retensioned=unit, free=np.zeros(0, int))
    return math.isfinite(limits.greatest(np.ones(1))[0])


def is_no_corner(away):
    """Whether a contact so far from the corner of a box, per size of the box, is on a face."""
    box = Box(shape="box", width=0.06, height=0.08, mass=0.3, position=(0.0, 0.0))  # of size 0.05
    contact = ("a", (0.03, 0.04 - away * 0.05), (1.0, 0.0), (1.0, 0.0, 0.0), math.nan, 0)
    scene = cases.make_scene(cases.make_finger((0.5, 0.5)), box)
    return ContactSet(scene, {"object.pose": np.zeros(3), **cases.contact_arrays([contact])}).curvature(0) == 0.0


LIMITS = [
    ("force that is left before a contact parts", 1e-6,
     lambda x: not names_a_limit(forces=np.array([[1.0, 0.0, 0.0]]), low=np.array([1.0 - x]))),
    ("friction that is left before a contact slips", 1e-6,
     lambda x: not names_a_limit(forces=np.array([[1.0, 1.0 - x, 0.0]]))),
    ("force that is left before a contact is pressed too hard", 1e-6,
     lambda x: not names_a_limit(high=np.array([1.0 + x]))),
    ("tension that is left, per range", 1e-6,
     lambda x: not names_a_limit(ranges=np.array([[-1.0, x / (1.0 - x)]]))),
    ("multiple of a contact's force that counts as unlimited", 1e4, lambda x: not is_limited(x)),
    ("distance from a corner", 1e-6, is_no_corner),
]  # fmt: skip


@pytest.mark.parametrize(("limit", "decides"), [row[1:] for row in LIMITS], ids=[row[0] for row in LIMITS])
def test_quality_is_otherwise_on_either_side_of_a_limit(limit, decides):
    assert decides(1.001 * limit)
    assert not decides(0.999 * limit)


def test_locked_antagonists_share_until_one_is_at_its_least():
    scene, _ = axial_pinch(0.08, min_tension=1.0, max_tension=60.0)
    setup = scene.setups[0]
    assert difference_range(setup, np.array([11.0, 1.0]), "locked") == (-69.0, 49.0)
    assert difference_range(setup, np.array([55.0, 50.0]), "locked") == (-20.0, 10.0)
    assert difference_range(setup, np.array([11.0, 1.0]), "retensioned") == (-69.0, 49.0)


def test_rolling_of_two_discs_and_of_surfaces_that_fit():
    travel, _, object_share = rolled(1 / 0.04, 1 / 0.006, 0.04)
    assert travel == pytest.approx(0.04 * 0.006 / 0.046)
    assert object_share == pytest.approx(0.04 / 0.046)
    assert rolled(25.0, -25.0, 0.04)[0] == pytest.approx(40.0)  # as good as fast to each other
    assert rolled(math.inf, 3.0, 0.04) == (0.0, 1.0, 0.0)


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
