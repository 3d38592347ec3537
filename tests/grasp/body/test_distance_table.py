"""Tables of distances; from inside: no door of grasps gives them.

Truths are exact distances, the order of convergence, finite differences, and images of a body.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from continuum_grasp.grasp.body.bodies import body_of
from continuum_grasp.grasp.body.table import DistanceTable
from tests.grasp.body.test_bodies import HOOK, PLANE, SOLIDS, around, facets, planar, solid

SMOOTH = {"ellipse": 5e-3, "ball": 4e-3, "egg": 4e-3}
"""Bodies without edges, and steps of coarse tables [m]."""


def described(name):
    return body_of(planar(name) if name in PLANE else solid(SOLIDS[name]))


def near_surface(body, away, count=200):
    """Points at a distance from a body."""
    points = around(body, count, least=0.0)
    found = body.near(points)
    return points + (away - found.distance[:, None]) * found.normal


def functions(d):
    """Distance, gradient and Hessian as CasADi has them, and the cell of a point."""
    names = ("point", "data", "cell", "coefficients")
    point, data, cell, coefficients = (
        ca.SX.sym(name, size) for name, size in zip(names, (d, 2 * d + 2, d, 4**d), strict=True)
    )
    distance = DistanceTable.distance(point, data, cell, coefficients)
    hessian, slope = ca.hessian(distance, point)
    return (
        ca.Function("distance", [point, data, cell, coefficients], [distance, slope, hessian]),
        ca.Function("cell", [point, data], [ca.floor(DistanceTable.cell(point, data))]),
    )


def as_solver(table, points, data=None, shift=0.0):
    """Distances, gradients and Hessians by CasADi; with cells that points have after a shift."""
    data = table.data if data is None else data
    d = table.body.dimensions
    distance, cell = functions(d)
    first, counts = int(data[d + 1]), data[d + 2 :].astype(int)
    grid = table.coefficients[first : first + counts.prod()].reshape(counts)
    found = []
    for point in points:
        own = np.array(cell(point + shift, data)).ravel().astype(int)
        near = grid[tuple(slice(k - 1, k + 3) for k in own)]
        found.append([np.array(part) for part in distance(point, data, own, near.ravel())])
    values, slopes, hessians = zip(*found, strict=True)
    return np.ravel(values), np.stack(slopes)[..., 0], np.stack(hessians)


@pytest.mark.parametrize("name", SMOOTH)
def test_errors_fall_with_the_fourth_power_of_the_step(name):
    body = described(name)
    points = near_surface(body, 5e-3)
    exact = body.near(points)
    off, leaning = [], []
    for step in (SMOOTH[name], 0.5 * SMOOTH[name]):
        distances, slopes = DistanceTable.around(body, 0.015, step).values(points)
        off.append(np.abs(distances - exact.distance).mean())
        leaning.append(np.abs(slopes - exact.normal).mean())
    assert off[1] < off[0] / 12.0
    assert leaning[1] < leaning[0] / 6.0
    assert off[1] < 1e-6


@pytest.mark.parametrize("name", ["hook", "can"])
def test_errors_near_edges_fall_with_the_step(name):
    """In the mean: in a notch the distance has a kink, where the greatest error falls as the step does."""
    body = described(name)
    points = near_surface(body, 5e-3)
    exact = body.distance(points)
    coarse, fine = (
        np.abs(DistanceTable.around(body, 0.01, step).values(points)[0] - exact).mean() for step in (4e-3, 2e-3)
    )
    assert fine < 0.25 * coarse < 2e-5


@pytest.mark.parametrize("name", ["hook", "can"])
def test_places_of_the_grid_have_exact_distances(name):
    body = described(name)
    low = body.box[0] - 0.01
    table = DistanceTable.of(body, low, low + 0.03, 5e-3)
    grid = np.stack(np.meshgrid(*[np.arange(7) * 5e-3] * body.dimensions, indexing="ij"), axis=-1)
    points = grid.reshape(-1, body.dimensions) + low
    # At its border, the grid ends 1e-9 cells before.
    assert table.values(points)[0] == pytest.approx(body.distance(points), abs=2e-11)
    inner = (grid > 1e-3).all(axis=-1).ravel() & (grid < 29e-3).all(axis=-1).ravel()
    assert table.values(points[inner])[0] == pytest.approx(body.distance(points[inner]), abs=1e-15)


@pytest.mark.parametrize("name", ["mug", "box", "pillow"])
def test_slopes_are_those_of_the_values_and_the_solver_has_the_same(name):
    body = described(name)
    table = DistanceTable.around(body, 0.01, 4e-3).scaled(body.size)
    low, high = body.box
    # Beyond the grid, too.
    points = np.random.default_rng(0).uniform(low - 0.02, high + 0.02, (60, body.dimensions)) / body.size
    distances, slopes = table.values(points)
    for k, h in enumerate(1e-6 * np.eye(body.dimensions)):
        ahead, back = (table.values(points + side * h)[0] for side in (1.0, -1.0))
        assert slopes[:, k] == pytest.approx((ahead - back) / 2e-6, abs=1e-8)
    values, gradients, _ = as_solver(table, points)
    assert values == pytest.approx(distances, abs=1e-13)
    assert gradients == pytest.approx(slopes, abs=1e-12)


@pytest.mark.parametrize("name", ["hook", "can"])
def test_cells_meet_with_two_continuous_derivatives_and_no_third(name):
    body = described(name)
    d = body.dimensions
    step = 4e-3
    table = DistanceTable.around(body, 0.01, step)
    rng = np.random.default_rng(3)
    cells = rng.integers(4, table.data[d + 2 :].min() - 4, (20, d)) + rng.uniform(0.1, 0.9, (20, d))
    for axis in range(d):
        at = cells.copy()
        at[:, axis] = np.floor(at[:, axis])
        points = table.data[:d] + at * step
        aside = 1e-6 * step * np.eye(d)[axis]
        before, after = (as_solver(table, points, shift=side * aside) for side in (-1.0, 1.0))
        for one, two, least in zip(before, after, (1e-3, 1.0, 1.0 / step), strict=True):
            assert one == pytest.approx(two, abs=1e-11 * least)
        # Beyond the common border both cells differ, by the third derivative.
        across = as_solver(table, points + 0.1 * step * np.eye(d)[axis], shift=-0.2 * step * np.eye(d)[axis])[2]
        own = as_solver(table, points + 0.1 * step * np.eye(d)[axis])[2]
        assert np.abs(across - own).max() > 1e-6 / step


@pytest.mark.parametrize("mirror", [False, True])
def test_images_of_a_body_have_images_of_its_table(mirror):
    """Mirrored, and turned by a right angle."""
    image = np.array([[0.0, -1.0], [1.0, 0.0]]) @ np.diag([-1.0 if mirror else 1.0, 1.0])
    body = described("hook")
    other = body_of(planar("hook", vertices=(np.array(HOOK) @ image.T).tolist()))
    one, two = (DistanceTable.around(each, 0.013, 2.3e-3) for each in (body, other))
    points = around(body, 400)
    distances, slopes = one.values(points)
    images, turned = two.values(points @ image.T)
    # Beyond its border, too, which is 1e-9 cells off.
    assert images == pytest.approx(distances, abs=5e-12)
    assert turned == pytest.approx(slopes @ image.T, abs=1e-9)


@pytest.mark.parametrize("name", SMOOTH)
def test_fine_tables_are_exact_at_contacts(name):
    """Of a finger 5 mm thick; the curvature of the body, too."""
    body = described(name)
    d = body.dimensions
    half = 5e-3
    table = DistanceTable.around(body, 0.012, 4e-3).scaled(body.size)
    places = dict(zip("abc", near_surface(body, half, 3), strict=True))
    fine = table.refined({name: place / body.size for name, place in places.items()}, 0.1 * half / body.size)
    assert len(fine.coefficients) == len(table.coefficients) + 3 * 15**d
    for name, place in places.items():
        # As far as a contact moves from where the first run ended.
        points = place + 0.3 * half * np.random.default_rng(0).uniform(-1.0, 1.0, (20, d))
        exact = body.near(points)
        distances, slopes = fine.values(points / body.size, name)
        assert np.abs(distances - exact.distance / body.size).max() < 1e-7
        assert np.abs(slopes - exact.normal).max() < 1e-5
        values, gradients, hessians = as_solver(fine, points / body.size, fine.data_at(name))
        assert values == pytest.approx(distances, abs=1e-13)
        assert gradients == pytest.approx(slopes, abs=1e-11)
        bent = exact.curvature.reshape(len(points), -1, 1)
        if d == 2:
            bent = bent * np.eye(2).reshape(1, 4, 1)
            across = np.eye(2) - exact.normal[:, :, None] * exact.normal[:, None, :]
            bent = np.einsum("nij,njk->nik", bent.reshape(-1, 2, 2), across)
        bent = bent.reshape(-1, d, d)
        level = np.linalg.solve(np.eye(d) + exact.distance[:, None, None] * bent, bent)
        assert np.abs(hessians - level * body.size).max() < 2e-3 * np.abs(level).max() * body.size
    # Elsewhere and without a name nothing changes; further contacts replace the former.
    points = around(body, 50) / body.size
    assert fine.values(points)[0] == pytest.approx(table.values(points)[0], abs=0.0)
    assert fine.data_at("none") is fine.data
    again = fine.refined({"d": places["a"] / body.size}, 0.1 * half / body.size)
    assert list(again.patches) == ["d"]
    assert len(again.coefficients) == len(table.coefficients) + 15**d


def test_tables_are_scaled_with_their_lengths():
    body = described("superellipse")
    table = DistanceTable.around(body, 0.01, 3e-3).refined({"tip": np.array([0.03, 0.0])}, 5e-4)
    points = np.array([[0.03, 0.001], [0.0, 0.05], [0.09, 0.0]])
    for name in ("", "tip"):
        distances, slopes = table.values(points, name)
        scaled, same = table.scaled(0.05).values(points / 0.05, name)
        assert 0.05 * scaled == pytest.approx(distances, abs=1e-16)
        assert same == pytest.approx(slopes, abs=1e-12)
    back = table.scaled(0.05).scaled(1.0)
    assert back.data == pytest.approx(table.data)
    assert back.coefficients == pytest.approx(table.coefficients)


@pytest.mark.parametrize("name", ["hook", "can"])
def test_beyond_the_grid_distances_grow_and_are_no_more_than_exact(name):
    body = described(name)
    table = DistanceTable.around(body, 0.01, 2e-3)
    away = np.linspace(0.0, 0.3, 40)[:, None] * np.array([0.6, 0.8, 0.2])[: body.dimensions]
    points = body.box[1] + 0.008 + away
    distances, _ = table.values(points)
    assert (np.diff(distances) > 0.0).all()
    assert (distances <= body.distance(points) + 1e-4).all()


def test_a_table_of_facets_is_smooth_and_within_their_deviation(tmp_path):
    """Of a ball, whose curvature between facets is zero, and infinite at their edges."""
    body = facets(tmp_path)
    table = DistanceTable.around(body, 0.015, 3e-3)
    points = np.random.default_rng(0).normal(size=(60, 3))
    points *= 0.035 / np.linalg.norm(points, axis=1)[:, None]
    outward = points / 0.035
    distances, slopes = table.values(points)
    assert np.abs(distances - 0.005).max() < 1.1 * body.deviation
    assert np.linalg.norm(slopes - outward, axis=1).max() < 0.02
    hessians = as_solver(table, points)[2]
    bent = (np.eye(3) - outward[:, :, None] * outward[:, None, :]) / 0.035
    assert np.abs(hessians - bent).max() < 0.25 / 0.035
    assert not table.refined({"tip": points[0]}, 5e-4).patches
