"""The error that the elements leave; from inside: a model made finer within a limit, postures moved onto it.

The error that the elements leave: estimates against the exact rod and far finer models, and tolerances in motion.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp import equilibrium, modes
from continuum_grasp.core import Core
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import integrate, refined
from continuum_grasp.simulation.accuracy.elements import translated
from continuum_grasp.simulation.accuracy.motion import pace, reference_motion
from continuum_grasp.simulation.accuracy.space import motion_within
from continuum_grasp.simulation.accuracy.truth import find_truth
from tests.simulation.accuracy.test_accuracy_report import release

PLACES = 21


def cone(**keys):
    """A cone of 1:10, of the weight of 3 E I / L^2 at the base, that points along world +X."""
    section = {"to": 0.2, "diameter": [0.02, 0.002], "youngs_modulus": 2.0e5, "density": 1100.0}
    finger = {"rod": {"length": 0.2, "sections": [section]}, "base": {"angle": -np.pi / 2}}
    return Scene.model_validate({"finger": finger, "gravity": [0.0, -9.81], **keys})


def soft(weight=10.0, finger=None, **keys):
    """A uniform finger along world +X, whose weight is so many E I / L^2."""
    rod = {"length": 0.2, "linear_density": 0.03, "bending_stiffness": 0.03 * 9.81 * 0.2**3 / weight}
    given = {"rod": rod, "base": {"angle": -np.pi / 2}, **(finger or {})}
    return Scene.model_validate({"finger": given, "gravity": [0.0, -9.81], **keys})


def model_of(family, elements, **keys):
    return {"fidelity": {"family": family, "elements": elements, "bending_range": 3.0}, **keys}


@pytest.mark.parametrize(("family", "elements"), [("arc", 2), ("clothoid", 2), ("matched_clothoid", 2), ("arc", 5)])
@pytest.mark.parametrize("make", [cone, soft])
def test_the_error_at_rest_and_of_frequencies_is_that_against_far_more_elements(make, family, elements):
    """Judged by the exact rod: twelve clothoids, whose own error is a thousandth of it, agree."""
    found, fine = modes(make(**model_of(family, elements))), modes(make(**model_of("clothoid", 12)))
    shapes = [each.equilibrium.backbone(PLACES) for each in (found, fine)]
    off = np.linalg.norm(shapes[0] - shapes[1], axis=1).max() / 0.2
    assert found.equilibrium.space_error == pytest.approx(off, rel=0.02, abs=1e-7)
    true = np.abs(found.frequencies_hz[:2] / fine.frequencies_hz[:2] - 1.0)
    assert found.space_error[:2] == pytest.approx(true, rel=0.03, abs=2e-5)


@pytest.mark.parametrize("weight", [3.0, 10.0])
def test_a_motion_states_the_error_of_its_shapes_at_rest(weight):
    """Of the first and the last, against twelve clothoids; stated elements that leave more than 1 % are warned of."""
    pulled = {"times": [0.0, 0.04], "values": [[0.0, 0.0], [0.1, 0.0]]}
    time = {"duration": 0.05, "step": 0.005}
    scene = soft(weight, **model_of("arc", 3, loads=[{"kind": "force", "at": 0.2, "force": pulled}], time=time))
    found, off = cg.simulate(scene), []
    for force in ((0.0, 0.0), (0.1, 0.0)):
        case = scene.replaced(loads=[{"kind": "force", "at": 0.2, "force": force}], time=None)
        fine = case.replaced(fidelity=model_of("clothoid", 12)["fidelity"])
        shapes = [equilibrium(each).backbone(PLACES) for each in (case, fine)]
        off.append(np.linalg.norm(shapes[0] - shapes[1], axis=1).max() / 0.2)
    assert found.static_error == pytest.approx(max(off), rel=0.02)
    assert "in motion, at rest about" in found.pairs()["space error"]
    assert found.details()["static_error"] == found.static_error
    assert found.status == "finished"
    said = [text for text in found.warnings if text.startswith("3 elements leave an error of")]
    assert bool(said) == (max(off) > 0.01)


def test_what_is_not_known_at_rest_is_not_stated():
    """The exact rod knows no dry friction in bending, and halves of more than four elements would take long."""
    time = {"duration": 0.01, "step": 0.005}
    dry = {"damping": {"dry_friction": [{"stiffness": 1e-4, "moment": 1e-4}]}}
    assert np.isnan(cg.simulate(soft(finger=dry, fidelity={"elements": 5}, time=time)).static_error)
    measured = cg.simulate(soft(time={**time, "space_error": True}))
    assert np.isnan(measured.static_error)
    assert "at rest" not in measured.pairs()["space error"]


@pytest.mark.deep
def test_the_error_of_a_motion_covers_that_against_four_clothoids():
    time = {"duration": 0.2, "step": 0.005, "space_error": True}
    found = motion_within(soft(**model_of("arc", 1, time=time)), None)
    exact = integrate(soft(**model_of("clothoid", 4, time=time)))
    at = np.arange(len(found.t))
    off = np.linalg.norm(found.backbone(at, PLACES) - exact.backbone(at, PLACES), axis=-1).max() / 0.2
    assert off <= found.space_error <= 2.5 * off
    assert found.details()["space_error"] == found.space_error
    assert np.isnan(exact.space_error)  # not asked for


def test_a_motion_gets_the_elements_that_keep_the_tolerance_or_a_warning(monkeypatch):
    time = {"duration": 0.1, "step": 0.005}
    scene = soft(**model_of("arc", 1, time=time))
    once = motion_within(scene.replaced(time={**time, "space_error": True}), None)
    limit = once.space_error
    assert len(motion_within(scene, 1.001 * limit).model.lengths) == 1
    finer = motion_within(scene, 0.999 * limit)
    assert len(finer.model.lengths) == 2
    assert finer.space_error <= 0.999 * limit
    assert finer.warnings == ()
    monkeypatch.setattr(sys.modules[motion_within.__module__], "MOST", 1)
    coarse = motion_within(scene, 0.999 * limit)
    assert coarse.status == "under_resolved"
    assert coarse.headline().startswith(f"not within {99.9 * limit:.2g} %: 1 element leaves an error of")
    assert coarse.warnings[-1].startswith(coarse.headline())


@pytest.mark.parametrize("family", ["arc", "clothoid", "matched_clothoid"])
@pytest.mark.parametrize("make", [cone, soft])
def test_a_refined_scene_starts_with_the_same_shape_and_damps_alike(make, family):
    """Halves of arcs and of uniform clothoids are such again; the dissipation per rate of bend does not change."""
    start = {"q": (3.0, -4.0, 5.0)[: 2 + (family == "clothoid")], "qd": (1.0, 2.0, 3.0)[: 2 + (family == "clothoid")]}
    scene = make(**model_of(family, 2, initial=start, time={"duration": 0.1, "step": 0.01}))
    scene = scene.replaced(finger=scene.finger.replaced(damping={"per_arc": 1e-4}))
    model, finer = FingerModel(scene), FingerModel(refined(scene, FingerModel(scene)))
    same = refined(scene, model).initial
    coarse, fine = Core(model, compiled=False), Core(finer, compiled=False)
    u, rates = np.zeros(model.nu), (np.array(start["qd"]), np.array(same.qd))
    s = np.linspace(0.0, 0.2, PLACES)[:, None]
    shapes = [c.batch("position", np.array(q), u, s, None) for c, q in ((coarse, start["q"]), (fine, same.q))]
    assert shapes[0] == pytest.approx(shapes[1], abs=1e-3 * 0.2 if make is cone else 1e-6 * 0.2)
    dissipated = [
        qd @ c.damping(np.array(q), qd, u) for c, q, qd in ((coarse, start["q"], rates[0]), (fine, same.q, rates[1]))
    ]
    # Halves have one bend each, whose squares add up to no less than that of their sum.
    assert dissipated[0] <= dissipated[1] * (1 + 1e-9)
    if family == "arc":
        assert dissipated[0] == pytest.approx(dissipated[1], rel=1e-9)
        assert translated(model, np.array(start["q"]), u, finer) == pytest.approx(np.repeat(start["q"], 2) / 2.0)


def test_short_elements_that_enclose_couples_are_not_halved():
    couple = {"kind": "moment", "at": 0.1, "moment": 1e-3}
    scene = soft(loads=[couple])
    model = FingerModel(scene)
    assert len(model.lengths) == 3
    lengths = refined(scene, model).fidelity.elements
    assert sorted(lengths)[0] == pytest.approx(min(model.lengths))
    assert len(lengths) == 5


def test_what_cannot_be_refined_is_not_known_and_says_so():
    dry = {"dry_friction": [{"stiffness": 1e-4, "moment": 1e-4}]}
    start = {"pose": "equilibrium", "reached_by": "state", "friction_states": [0.0] * 2}
    time = {"duration": 0.01, "step": 0.005, "space_error": True}
    scene = soft(finger={"damping": dry}, **model_of("arc", 2, initial=start, time=time))
    found = motion_within(scene, None)
    assert np.isnan(found.space_error)
    assert "initial.friction_states: belongs to these elements" in found.warnings[-1]
    assert found.pairs()["space error"] == "not measured"
    assert np.isnan(equilibrium(scene).space_error)


def test_the_pace_is_that_of_the_classical_method():
    """Error by the steps falls with their fourth power, so a tolerance 16 times tighter asks for twice the steps."""
    posed = release().changed({"fidelity.family": "arc", "fidelity.elements": 2})
    model = cg.FingerModel(posed)
    steps = [pace(posed, model, tolerance).steps_per_second for tolerance in (1e-7, 1e-7 / 16**2)]
    assert steps[1] / steps[0] == pytest.approx(4.0, rel=0.35)


@pytest.mark.deep
def test_the_reference_knows_its_error():
    reference = reference_motion(release(), find_truth(release()))
    assert 0.0 < reference.error < 1e-5


@pytest.mark.deep
def test_the_reference_is_found_for_stiff_drives_too():
    """The hand's finger on winches, with friction, against steps of variable length and order."""
    scene = cg.load("configs/simulate/winch_loop.yaml", ["time.duration=0.1"])
    reference = reference_motion(scene, find_truth(scene))
    fidelity = {"family": "clothoid", "elements": 12}
    timing = {"duration": 0.1, "step": 0.1 / (len(reference.t) - 1), "method": "reference"}
    fine = cg.simulate(scene.replaced(fidelity=fidelity, time=timing))
    assert np.abs(fine.tip - reference.tip).max() < 1e-5 * scene.finger.rod.length
