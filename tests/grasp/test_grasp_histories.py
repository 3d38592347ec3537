"""Grasps that hold whatever the friction of tendons and bending, in a fine chain of hinges with the exact laws.

The chain bears the contact forces that the grasp has for fingers which were pulled, or released, and must be at rest
where the grasp says: pulled from straight, or pulled further and let out again. Where no such path leads to it under
forces that keep their direction, as round a mug, it starts there, its tendons and hinges sliding as if they had come
that way.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.grasp_oracle.check import LIMITS, residuals
from benchmarks.grasp_oracle.scenes import scene_of
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load
from tests.grasp_scenes import CONFIGS
from tests.marks import few
from tests.truth.tendon import HingedFinger

HINGES, OVER = 48, 1.8
"""Hinges of the chain, and the tension from which tendons are let out, per that of the grasp."""


def at_rest(scene, arrays, name, released, led):
    """Where the finger of a posture touches [m], by the chain: world positions by contact; ``led`` by a history."""
    setup = next(setup for setup in scene.setups if setup.name == name)
    finger, tensions = setup.finger, arrays[f"{name}.tensions"]
    x, y, angle = arrays[f"{name}.base"]
    c, s = np.cos(angle), np.sin(angle)
    turn, length = np.array([[c, -s], [s, c]]), finger.rod.length
    touching = [k for k, contact in enumerate(arrays["contact_names"]) if str(contact).startswith(f"{name}.")]
    pushes = []
    for k in touching:
        normal, (n, f, _) = arrays["contact_normals"][k], arrays["contact_forces"][k]
        force = turn.T @ (n * normal + f * np.array([-normal[1], normal[0]]))
        pushes.append((float(arrays["contact_stations"][k]), *force, -finger.thickness_radius * f))
    branches = tuple((branch.stiffness, branch.moment) for branch in finger.damping.dry_friction)
    numbers = length, finger.rod.stiffness, setup.tendons.offset, setup.tendons.friction
    chain = HingedFinger(*numbers, hinges=HINGES, branches=branches)
    most = int(tensions[1] > tensions[0])
    ways = (1.0 - 2.0 * most) * np.outer([1.0, -1.0], np.ones(HINGES))

    def move(share, loaded):
        pulls = [("tension", t * (share if k == most else min(share, 1.0))) for k, t in enumerate(tensions)]
        chain.pushes = tuple((at, *(loaded * np.array(load))) for at, *load in pushes)
        chain.move(pulls)

    if led:
        chain._slides = ways.copy()
        for share in np.linspace(0.1, OVER if released else 1.0, 16 if released else 10):
            move(share, min(share, 1.0))
    else:
        line = arrays[f"{name}.backbone"]
        edges = np.interp(np.linspace(0.0, length, HINGES + 1), line[:, 0], line[:, 3])
        chain.bends = np.diff(edges)
    if released or not led:
        chain._slides = -ways if released else ways
        if not led:
            chain.losses = chain._slides * setup.tendons.friction * np.abs(chain.bends)
            # A millimeter before where it is, so that it slides on.
            chain.slid = chain._state(chain.bends, chain.losses, [("tension", t) for t in tensions])[2]
            chain.slid = chain.slid - 1e-3 * chain._slides
            # Bent a little less, or more, with all stops at their limit.
            way = -1.0 if released else 1.0
            chain.stops = way * np.sign(chain.bends) * np.array([[most] for _, most in branches] or np.zeros((0, 1)))
            chain.bends = (1.0 - 0.05 * way * bool(branches)) * chain.bends
        move(1.0, 1.0)
    # Which way the tendons slid last, all along.
    assert chain.friction == 0.0 or (np.sign(chain.losses[0]) == (-1.0 if released else 1.0) * ways[0]).all()
    points, hinges = chain._points(chain.bends), (np.arange(HINGES) + 0.5) * length / HINGES
    along = np.append(hinges, length)
    places = np.array([[np.interp(at, along, row) for row in points] for at, *_ in pushes])
    return touching, places @ turn.T + [x, y]


def sticks(stiffness, moment, *names, friction=0.0):
    """Changes that give fingers one branch of dry friction in bending, and friction to their tendons."""
    given = {"damping": {"dry_friction": [{"stiffness": stiffness, "moment": moment}]}, "tendons.friction": friction}
    fingers = [f"fingers.{name}" for name in names] or ["finger"]
    return {f"{finger}.{key}": value for finger in fingers for key, value in given.items()}


@pytest.mark.deep
@pytest.mark.parametrize(
    ("config", "changes", "led"),
    few(
        [
            ("mug.yaml", sticks(0.02, 0.02), False),
            ("mug.yaml", {"finger.tendons.friction": 0.1}, False),
            ("mug.yaml", {"finger.tendons.friction": 0.05, "object.mass": 0.2}, False),
            ("mug.yaml", {"finger.tendons.friction": 0.1, "object.mass": 0.1}, False),
            ("pinch_above.yaml", {f"fingers.{name}.tendons.friction": 0.15 for name in ("lower", "upper")}, True),
            ("pinch_above.yaml", sticks(0.02, 0.01, "lower", "upper"), True),
            ("mug.yaml", sticks(0.02, 0.01, friction=0.05), False),
        ],
        2,
    ),
)
def test_a_chain_of_guides_rests_where_the_grasp_says(config, changes, led):
    family = {"fidelity.family": "clothoid", "fidelity.elements": 8, "stability": "ignore", "contacts.reserve": 0.0}
    found = optimize_grasp(load(CONFIGS / config).changed({**family, **changes}))
    assert found.robustness.robust.holds
    # Let out again, hinges near where the finger is straight stop anywhere between.
    sticking = any(setup.bending_cells for setup in found.scene.setups)
    for k, released in enumerate((False,) if led and sticking else (False, True)):
        held = {key.removeprefix("held."): v[k] for key, v in found.arrays.items() if key.startswith("held.")}
        posture = found.arrays if led and not released else held
        for setup in found.scene.setups:
            touching, places = at_rest(found.scene, {**found.arrays, **posture}, setup.name, released, led)
            line = posture[f"{setup.name}.backbone"]
            for contact, place in zip(touching, places, strict=True):
                at = posture["contact_stations"][contact]
                there = [np.interp(at, line[:, 0], line[:, column]) for column in (1, 2)]
                assert np.linalg.norm(place - there) < 2e-3 * setup.finger.rod.length


RANDOM = [
    # Seed, friction of the tendons, moment of a branch of dry friction per stiffness and length.
    *((1001, 0.08, 0.0), (1007, 0.0, 0.03), (1004, 0.02, 0.0)),
    *((1000, 0.07, 0.0), (1007, 0.03, 0.0), (1004, 0.0, 0.05), (1000, 0.0, 0.1), (1016, 0.0, 0.1)),
]


@pytest.mark.deep
@pytest.mark.parametrize(("seed", "friction", "dry"), few(RANDOM, 3))
def test_random_grasps_hold_by_code_of_another_hand_where_pulled_and_released_would_not_do(seed, friction, dry):
    scene = scene_of("one", seed)
    rod = scene.finger.rod
    finger = scene.finger.with_tendons(friction=friction, max_tension=120.0).replaced(strain_limit=None)
    if dry:
        branch = {"stiffness": 3.0 * rod.stiffness, "moment": dry * rod.stiffness / rod.length}
        finger = finger.replaced(damping={"dry_friction": [branch], "friction_cells": 2})
    found = optimize_grasp(
        scene.replaced(
            finger=finger,
            contacts=scene.contacts.replaced(friction=0.8, normal_force_max=60.0),
            fidelity=scene.fidelity.replaced(family="arc" if scene.setups[0].family == "arc" else "clothoid"),
            solver=scene.solver.replaced(effort="quick"),
        )
    )
    assert found.robustness.robust.holds
    assert found.certificate.states >= 2
    for name, value in residuals(found.scene, found.arrays).items():
        assert value < LIMITS[name], name
    if friction and seed in (1001, 1004):
        # Of the grasp of least tension both extremes hold, and states between them do not.
        pulled, released, *further = found.robustness.nominal.corner_margins
        assert min(pulled, released) >= 0.0 > min(further)
