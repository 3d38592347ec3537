"""Outlines of fingers and runs of tendons, by plane geometry; from inside: the curves before they are drawn.

Outlines of fingers and runs of tendons against areas and places of plane geometry.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.plotting import Z
from continuum_grasp.plotting.drawing.bodies import finger_outline, mass_positions, side_path
from continuum_grasp.plotting.drawing.forces import draw_arrow
from tests.rods import rod_scene, without_compiler  # noqa: F401

LENGTH = 0.25
MATERIAL = {"length": LENGTH, "youngs_modulus": 2e6, "density": 1100.0}
SPIRAL = {"base_thickness": 0.04, "tip_thickness": 0.005, "units": 24, "core": 0.12}
STRAIGHT = np.column_stack([np.zeros(101), np.linspace(0.0, LENGTH, 101)])
STEPS = [{"to": 0.1, "diameter": 0.02}, {"to": LENGTH, "diameter": [0.012, 0.006]}]


def finger(**keys):
    return cg.Finger(rod=cg.Rod(**MATERIAL, **keys))


def area(outline):
    x, y = outline.T
    return 0.5 * abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1)))


def test_the_area_of_a_stepped_taper():
    expected = 0.1 * 0.02 + 0.15 * 0.009 + math.pi * 0.003**2 / 2
    # the rounded end has 25 points: chords of a half circle
    assert area(finger_outline(STRAIGHT, finger(sections=STEPS))) == pytest.approx(expected, rel=1e-4)
    placed = np.column_stack([STRAIGHT[:, 1], STRAIGHT, 0.0 * STRAIGHT[:, 1]])
    assert area(finger_outline(placed, finger(sections=STEPS))) == pytest.approx(expected, rel=1e-4)


def test_a_step_is_upright():
    outline = finger_outline(STRAIGHT, finger(sections=STEPS))
    at_step = outline[np.abs(outline[:, 1] - 0.1) < 1e-12]
    assert sorted(np.round(np.abs(at_step[:, 0]), 12)) == pytest.approx([0.006] * 2 + [0.01] * 4)


def test_a_bent_outline_is_as_wide_as_the_finger():
    """Of an arc each point of the outline has its half thickness as distance from the arc."""
    angle = np.linspace(0.0, 2.0, 401)
    radius = LENGTH / 2.0
    arc = radius * np.column_stack([np.cos(angle) - 1.0, np.sin(angle)])
    outline = finger_outline(arc, finger(sections=[{"to": LENGTH, "diameter": [0.02, 0.01]}]))[:401]
    away = np.hypot(outline[:, 0] + radius, outline[:, 1]) - radius
    assert away == pytest.approx(0.01 - 0.005 * angle / 2.0, abs=1e-6)


def test_the_cuts_of_a_spirob_close_where_it_is_the_spiral():
    """Its line curved as its stops allow, corners of units meet on the inner side, and part on the outer one."""
    spirob = finger(spirob=SPIRAL)
    spirob = spirob.replaced(stops={"stiffness_ratio": 100.0})
    s = np.linspace(0.0, LENGTH, 4001)
    curvature = spirob.stop_curvature(s)
    angle = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(s))])
    tangent = np.exp(1j * (angle + math.pi / 2))
    line = np.concatenate([[0.0], np.cumsum(0.5 * (tangent[1:] + tangent[:-1]) * np.diff(s))])
    backbone = np.column_stack([line.real, line.imag])
    edges = np.array(spirob.rod.spirob.edges(LENGTH))
    drawn = np.column_stack([edges, *(np.interp(edges, s, along) for along in (*backbone.T, angle))])
    outline = finger_outline(drawn, spirob)
    # along each side: the base, per cut the corner before, the layer and the corner after, the tip; then the round end
    outer, inner = outline[:71], outline[::-1][:71]
    half, turn = spirob.profile.half_thickness(edges[1:-1]), spirob.rod.spirob.unit_angle(LENGTH)
    gaps = [np.hypot(*(side[3:-1:3] - side[1:-1:3]).T) / half for side in (inner, outer)]
    assert gaps[0].max() < 0.05  # corners nearer to the base are thicker, by 14 % of their distance
    assert gaps[1] == pytest.approx(2.0 * math.sin(turn) / math.cos(turn / 2), abs=0.03)


def test_tendons_run_at_their_offset_to_their_end():
    rod = cg.Rod(**MATERIAL, sections=STEPS)
    tendons = [{"offset": 0.005, "to": 0.15, "max_tension": 1.0}, {"offset": [-0.006, -0.002], "max_tension": 1.0}]
    first, second = cg.Finger(rod=rod, tendons=tendons).tendon_list
    path = side_path(first, STRAIGHT, cg.Finger(rod=rod))
    assert path[:, 0] == pytest.approx(np.full(len(path), -0.005))  # the -X side
    assert path[-1].tolist() == pytest.approx([-0.005, 0.15])
    path = side_path(second, STRAIGHT, cg.Finger(rod=rod))
    assert path[:, 0] == pytest.approx(0.006 - 0.004 * path[:, 1] / LENGTH)


def test_a_body_at_the_tip_is_drawn_at_its_center_of_mass():
    body = {"mass": 0.01, "center_of_mass": [0.001, 0.006]}
    bodied = finger(sections=STEPS).replaced(tip_body=body, masses=[{"at": 0.1, "mass": 0.002}])
    quarter = np.column_stack([np.cos(s := np.linspace(0, math.pi / 2, 200)) - 1.0, np.sin(s)]) * LENGTH / (math.pi / 2)
    tip = quarter[-1]
    # turned by a quarter: its X axis points up, its Y axis along -x
    assert mass_positions(quarter, bodied)[-1] == pytest.approx(tip + np.array([-0.006, 0.001]), abs=1e-4)


@pytest.mark.usefixtures("without_compiler")
def test_a_motion_shows_thickness_and_tendons():
    tendons = [{"offset": [0.006, 0.002], "max_tension": 1.0}]
    scene = rod_scene(
        {**MATERIAL, "sections": STEPS},
        family="arc",
        finger={"tendons": tendons, "damping": {"material": 1e-4}},
        initial={"pose": "straight"},
        time={"duration": 0.01, "step": 0.005},
    )
    from continuum_grasp.plotting.motion import plot_snapshots

    ax = plot_snapshots(cg.simulate(scene), times=[0.0, 0.01])
    assert sum(patch.get_zorder() == Z.BODY for patch in ax.patches) == 2
    assert sum(line.get_zorder() == Z.TENDON for line in ax.lines) == 2  # its run, and its end


@pytest.mark.parametrize("length", [0.05, 1.0, 4.0, 40.0])
@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_an_arrow_points_the_right_way_however_short(length: float, turn: float) -> None:
    """No pixel of it is before its start, and its end is where the force says, lengths in points."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(2.0, 2.0), dpi=144)
    canvas = FigureCanvasAgg(figure)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set(xlim=(-72.0, 72.0), ylim=(-72.0, 72.0))
    ax.set_axis_off()
    way = np.array([np.cos(turn), np.sin(turn)])
    draw_arrow(ax, np.zeros(2), length * way, "black")
    canvas.draw()
    dark = np.asarray(canvas.buffer_rgba())[::-1, :, 0] < 128
    rows, columns = np.nonzero(dark)
    along = (np.stack([columns, rows], axis=1) + 0.5 - 144.0) / 2.0 @ way
    assert along.min() > -1.5  # half of the line's width, and a pixel
    assert along.max() == pytest.approx(max(length, 1.0), abs=1.5)
