"""How far the grasp is from a fine rod, against the elastica by shooting."""

from __future__ import annotations

import json

import numpy as np
import pytest
from grasp_scenes import CONFIGS, PLANAR, UPRIGHT, make_scene
from scipy.integrate import solve_ivp
from scipy.optimize import newton

from continuum_grasp.cli import app
from continuum_grasp.grasp import certify, optimize_grasp
from continuum_grasp.scene.finger import PointMass
from continuum_grasp.scene.grasp import GraspSolver

ONE = GraspSolver(seeds=1)


def elastica(result):
    """World positions of middle contact and tip of the exact rod under the forces of a grasp, by shooting.

    The states are angle, moment of the forces beyond, turned angle, x, y; the moment at the base is sought for
    which that at the tip is the couple there.
    """
    finger, gravity = result.scene.finger, result.scene.gravity
    stiffness, friction = finger.rod.stiffness, finger.tendons.friction
    pull = (result.tensions[0] - result.tensions[1]) * finger.tendons.offset
    joint, total = result.middle_position, finger.rod.length
    g = np.asarray(gravity.vector if gravity.mode == "planar" else (0.0, 0.0))
    loads = [(mass.at, mass.mass * g, 0.0) for mass in finger.masses]
    for contact in result.contacts:
        if contact.name != "palm":
            at = joint if contact.name == "middle" else total
            loads.append((at, contact.force, -finger.thickness_radius * contact.friction_force))

    def rates(s, y, force):
        fx, fy = force + finger.rod.mass_per_length * (total - s) * g
        kappa = (y[1] + pull * np.exp(-friction * y[2])) / stiffness + finger.rest_curvature
        return [kappa, fx * np.cos(y[0]) + fy * np.sin(y[0]), abs(kappa), -np.sin(y[0]), np.cos(y[0])]

    def walk(moment):
        y, at, places = [finger.base.angle, moment, 0.0, *finger.base.position], 0.0, {}
        for stop in sorted({joint, total, *(load[0] for load in loads)}):
            force = np.zeros(2) + sum(load[1] for load in loads if load[0] >= stop)
            y = solve_ivp(rates, (at, stop), y, args=(force,), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
            y[1] -= sum(load[2] for load in loads if load[0] == stop)
            at, places[stop] = stop, y[3:].copy()
        return y[1], {"middle": places[joint], "tip": places[total]}

    curvature = np.diff(result.backbone[:2, 3])[0] / np.diff(result.backbone[:2, 0])[0] - finger.rest_curvature
    moment = newton(lambda m: walk(m)[0], stiffness * curvature - pull, tol=1e-13)
    return walk(moment)[1]


CASES = {
    "two matched clothoids": {},
    "four matched clothoids": {"elements": 4},
    "two arcs": {"family": "arc"},
    "weight": {"gravity": PLANAR, "base_y": -0.048},
    "masses along it": {
        "gravity": PLANAR,
        "base_y": -0.048,
        "finger": {"masses": (PointMass(at=0.05, mass=0.01), PointMass(at=0.12, mass=0.02))},
    },
    "rubbing tendons": {"family": "clothoid", "tendon_friction": 0.05},
    "bent at rest": {"finger": {"rest_curvature": 3.0}},
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_fine_rod_is_the_elastica(case):
    result = optimize_grasp(make_scene(solver=ONE, **case))
    error, exact = result.certificate.model_error, elastica(result)
    length = result.scene.finger.rod.length
    stations = result.backbone[:, 0]
    for name, at in (("middle", result.middle_position), ("tip", length)):
        here = [np.interp(at, stations, column) for column in result.backbone[:, 1:3].T]
        off = np.linalg.norm(exact[name] - here)
        assert error.displacements[name] == pytest.approx(off, abs=5e-5 * length)


def test_model_error_of_arcs_falls_with_the_square_of_their_number():
    off = [
        optimize_grasp(make_scene("arc", elements=n, solver=ONE)).certificate.model_error.displacements["middle"]
        for n in (4, 8, 16)
    ]
    assert 3.0 < off[0] / off[1] < 6.0
    assert 3.0 < off[1] / off[2] < 6.0


@pytest.mark.parametrize("family", ["arc", "matched_clothoid"])
def test_more_elements_leave_less_moment_out(family):
    left = [
        optimize_grasp(make_scene(family, elements=n, solver=ONE)).certificate.model_error.moment for n in (2, 4, 8)
    ]
    assert left[0] > 1.5 * left[1] > 2.0 * left[2]


@pytest.mark.parametrize(("name", "small"), [("mug", True), ("mug_arcs", False), ("mug_lying", True)])
def test_shipped_scenes_warn_where_the_model_is_coarse(name, small):
    result = optimize_grasp(CONFIGS / f"{name}.yaml")
    error = result.certificate.model_error
    assert error.small is small
    assert error.small or "fidelity.elements" in result.warnings[0]
    assert bool(result.warnings) is not small
    assert str(error) in result.table()
    assert result.certificate.passed


def test_a_lost_equilibrium_is_said_to_be():
    """The contact forces reversed: the equilibrium that is followed ends on the way, and nothing fails."""
    result = optimize_grasp(make_scene(elements=4, solver=ONE))
    arrays = {name: np.array(value) for name, value in result.arrays.items()}
    arrays["contact_forces"][:, :2] *= -1.0
    error = certify(result.scene, arrays).model_error
    assert not error.found
    assert not error.small
    assert error.greatest == np.inf
    assert "no equilibrium near" in str(error)


def test_model_error_is_saved_and_warned_of(tmp_path):
    from typer.testing import CliRunner

    done = CliRunner().invoke(app, ["grasp", str(CONFIGS / "mug_arcs.yaml"), "--out", str(tmp_path), "--json"])
    assert done.exit_code == 0, done.output
    meta = json.loads((tmp_path / "meta.json").read_text(encoding="utf-8"))
    error = meta["certificate"]["model_error"]
    assert error["displacements"]["tip"] > error["limit"] == pytest.approx(0.005 * 0.18)
    assert not error["small"]
    assert meta["warnings"] == json.loads(done.stdout)["warnings"]
    assert f"warning: {meta['warnings'][0]}" in done.stderr


def test_no_numbers_no_verdict():
    result = optimize_grasp(make_scene("arc", UPRIGHT, solver=ONE))
    for name in ("lengths", "q", "backbone", "contact_normals"):
        arrays = {key: np.array(value) for key, value in result.arrays.items()}
        arrays[name].flat[0] = np.nan
        certificate = certify(result.scene, arrays)
        assert [check.name for check in certificate.failed] == ["numbers that are not finite"]
        assert not certificate.stability.stable
        assert not certificate.model_error.found
