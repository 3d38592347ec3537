"""Pictures of scenes before anything is solved: that all is in them, in its place."""

from __future__ import annotations

import math

import numpy as np
import pytest

from continuum_grasp.plotting import Z, plot_scene
from continuum_grasp.scene import load


def texts(ax):
    return [text.get_text() for text in ax.texts] + [ax.get_title(loc="left")]


def outlines(ax):
    """The filled outlines of an object."""
    return [patch.get_xy() for patch in ax.patches if patch.get_zorder() == Z.OBJECT_FILL]


def points(ax):
    """All of object, fingers and what is marked on them, as points (n, 2)."""
    bodies = [patch.get_xy() for patch in ax.patches if patch.get_zorder() == Z.BODY]
    marks = [line for line in ax.lines if line.get_transform() == ax.transData and line.get_zorder() > Z.FACE]
    lines = [line.get_xydata() for line in marks]
    return np.concatenate([*outlines(ax), *bodies, *lines])


SCENES = {
    "grasp/wrap": ["one", "two", "three", "circle, 0.2 kg", "into the plane"],
    "grasp/table_peg": ["table", "peg", "box, 0.15 kg", "gravity 9.81"],
    "grasp/free_base": ["palm", "position of finger: chosen"],
    "simulate/hanging": ["force 0.2 N", "20 g", "gravity 9.81"],
    "mission/turn_block": ["where it stands before", "palm"],
    "mpc/keep_out": ["keep out: post", "setpoint of the tip", "no gravity in the plane"],
    "plan/past_a_post": ["keep out: post", "goal of the tip"],
    "fingers/spirob": ["base"],
}


@pytest.mark.parametrize("name", SCENES)
def test_all_of_a_scene_is_named_and_within_the_picture(name):
    scene = load(f"configs/{name}.yaml")
    ax = plot_scene(scene)
    for wanted in SCENES[name]:
        assert any(wanted in text for text in texts(ax)), wanted
    (left, right), (low, high) = ax.get_xlim(), ax.get_ylim()
    x, y = points(ax).T
    assert left < x.min()
    assert x.max() < right
    assert low < y.min()
    assert y.max() < high


def test_fingers_are_drawn_unloaded_and_the_object_where_it_lies():
    scene = load("configs/grasp/preshaped.yaml")
    (line,) = [one.get_xydata() for one in plot_scene(scene).lines if one.get_zorder() == Z.CENTERLINE]
    finger = scene.finger
    curvature = finger.profile.rest_curvature.constant
    turn = curvature * finger.rod.length
    # An arc from the base, by its closed form.
    across, along = (math.cos(turn) - 1.0) / curvature, math.sin(turn) / curvature
    c, s = math.cos(finger.base.angle), math.sin(finger.base.angle)
    x, y = finger.base.position
    tip = (x + c * across - s * along, y + s * across + c * along)
    assert line[-1] == pytest.approx(tip, abs=1e-5)
    gear = load("configs/grasp/gear.yaml")
    assert np.concatenate(outlines(plot_scene(gear)))[:, 0].min() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("scale", [1e-2, 1.0, 10.0])
def test_labels_stay_within_pictures_of_any_size(scale):
    scene = load("configs/grasp/mug.yaml")
    rod = {"finger.rod.length": 0.18 * scale, "finger.half_thickness": 0.006 * scale, "finger.masses": []}
    sizes = {"object.diameter": 0.08 * scale, "object.against": "a_support_with_a_name_of_31_let"}
    place = {"finger.base.position": [0.0, -0.055 * scale], "finger.tendons.offset": 0.005 * scale}
    support = {"a_support_with_a_name_of_31_let": scene.supports["palm"]}
    ax = plot_scene(scene.changed({**rod, "supports": support, **sizes, **place, "name": "long " * 60}))
    ax.figure.draw_without_rendering()
    frame = ax.figure.bbox
    for text in ax.texts:
        box = text.get_window_extent()
        assert frame.x0 - 1 <= box.x0
        assert box.x1 <= frame.x1 + 1
    title = ax._left_title.get_window_extent()
    assert title.x1 <= frame.x1 + 1
    assert title.y1 <= frame.y1 + 1
