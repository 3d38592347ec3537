"""Dry friction in bending as unknowns: its states at a start come from the shapes before it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import Estimate, Reading, TipPath
from continuum_grasp.scene import Scene
from tests.identification_cases import block_for, slope_error

LENGTH, FIRST = 0.3, 12
PLACES = (0.1, 0.2, LENGTH)
BRANCHES = ({"stiffness": 0.2, "moment": 0.3}, {"stiffness": 1.0, "moment": 0.1})
NAMES = ("bending_stiffness", "material_damping", *(f"dry_friction_{k}_{key}" for k in (1, 2) for key in BRANCHES[0]))
TRUE = (0.15, 0.003, 0.2, 0.3, 1.0, 0.1)


def hanging(**keys) -> Scene:
    """Two arcs that hang with a body at the tip, bent and let go."""
    return Scene.model_validate(
        {
            "finger": {
                "rod": {"length": LENGTH, "linear_density": 0.2, "bending_stiffness": TRUE[0]},
                "damping": {"material": TRUE[1], "dry_friction": BRANCHES},
                "tip_body": {"mass": 0.2, "rotary_inertia": 1e-4},
                "base": {"angle": np.pi},
            },
            "gravity": (0.0, -9.81),
            "fidelity": {"family": "arc", "elements": 2},
            "initial": {"q": [0.9, 0.5], "reached_by": "pulling"},
            **keys,
        }
    )


@pytest.fixture(scope="module")
def path() -> TipPath:
    """Three points of it from the twelfth sample on; those before are what its friction went through."""
    motion = cg.simulate(hanging(time={"duration": 0.6, "step": 0.01, "method": "reference"}))
    model = motion.model
    readings = []
    for s in PLACES:
        points = np.array([np.ravel(model.position(q, [0.0], s, [])) for q in motion.q])
        readings += [Reading(axis, points[:, k], s) for k, axis in enumerate("xy")]

    def part(rows: slice) -> list[Reading]:
        return [replace(one, values=np.asarray(one.values)[rows]) for one in readings]

    return TipPath(
        motion.t[FIRST:], measured=part(slice(FIRST, None)), before=part(slice(FIRST)), start="estimated", name="let go"
    )


@pytest.mark.deep
def test_derivatives_of_motions_through_stops_are_those_of_differences(path):
    scene = hanging()
    unknowns, block = block_for(scene, path, NAMES)
    values = np.array([1.03 * one.start for one in [*unknowns, *block.own]])
    assert slope_error(block, values, np.maximum(np.abs(values), 0.1)).max() < 2e-3


@pytest.mark.deep
def test_friction_and_stiffness_are_found_from_a_release(path):
    starts = (0.1, 0.005, 0.3, 0.2, 0.7, 0.15)
    asked = [Estimate(name=name, start=start) for name, start in zip(NAMES, starts, strict=True)]
    fit = cg.identify(hanging(), path, parameters=asked)
    assert fit.values == pytest.approx(TRUE, rel=0.03)
    assert fit.apply().finger.damping.dry_friction[1].moment == fit["dry_friction_2_moment"]


def test_without_the_shapes_before_the_friction_of_the_start_is_wrong(path):
    """From straight to where the samples begin: what slid back since the turn is forgotten."""
    scene = hanging()
    found = {}
    for name, before in (("with", path.before), ("without", ())):
        unknowns, block = block_for(scene, replace(path, before=before), NAMES)
        values = np.array([one.start for one in [*unknowns, *block.own]])
        missed = block.predict(values)[0] - block.measured.values.ravel()
        found[name] = float(np.sqrt(np.mean(missed**2)))
    assert found["with"] < 0.2 * found["without"]
