"""How far the grasp is from exact rods, against the elastica by shooting."""

from __future__ import annotations

import json

import numpy as np
import pytest
from grasp_scenes import CONFIGS, make_scene
from scipy.integrate import solve_ivp
from scipy.optimize import newton

from continuum_grasp.grasp import certify, optimize_grasp
from continuum_grasp.scene import GraspSolver, PointMass, Rod
from tests import certificate_cases as cases
from tests.commands import run
from tests.marks import but

ONE = GraspSolver(effort="quick")


def optimized(family="matched_clothoid", gravity=cases.INTO_PLANE, **changes):
    """The grasp of the mug of the shipped scene."""
    return optimize_grasp(make_scene(family, gravity, solver=ONE, **changes))


def elastica(scene, arrays, name):
    """World positions of the contacts and the tip of the exact rod under the forces of a grasp, by shooting.

    The states are angle, moment of the forces beyond, turned angle, x, y; the moment at the base is sought for
    which that at the tip is the couple there.
    """
    finger = scene.named_fingers[name]
    stiffness, friction = finger.rod.stiffness, finger.tendons.friction
    left, right = arrays[f"{name}.tensions"] * finger.tendons.offset
    total = finger.rod.length
    g = np.asarray(scene.gravity[:2])
    loads = [(mass.at, mass.mass * g, 0.0) for mass in finger.masses]
    places = {f"{name}.tip": total}
    for k, contact in enumerate(arrays["contact_names"]):
        if str(contact).startswith(name + "."):
            at = total if str(contact).endswith(".tip") else float(arrays["contact_stations"][k])
            normal, (n, f, _) = arrays["contact_normals"][k], arrays["contact_forces"][k]
            force = n * normal + f * np.array([-normal[1], normal[0]])
            loads.append((at, force, -finger.thickness_radius * f))
            places[str(contact)] = at

    def rates(s, y, force):
        fx, fy = force + finger.rod.mass_per_length * (total - s) * g
        # The tendon that pulls loses tension towards the tip, the other one, which is paid out, gains it.
        pull = left * np.exp(-friction * y[2]) - right * np.exp(friction * y[2])
        kappa = (y[1] + pull) / stiffness + finger.rest_curvature
        return [kappa, fx * np.cos(y[0]) + fy * np.sin(y[0]), abs(kappa), -np.sin(y[0]), np.cos(y[0])]

    def walk(moment):
        x, y_base, angle = arrays[f"{name}.base"]
        y, at, found = [angle, moment, 0.0, x, y_base], 0.0, {}
        for stop in sorted({*places.values(), total, *(load[0] for load in loads)}):
            force = np.zeros(2) + sum(load[1] for load in loads if load[0] >= stop)
            y = solve_ivp(rates, (at, stop), y, args=(force,), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
            y[1] -= sum(load[2] for load in loads if load[0] == stop)
            at, found[stop] = stop, y[3:].copy()
        return y[1], {place: found[stop] for place, stop in places.items()}

    ends = arrays[f"{name}.backbone"][:2]
    curvature = np.diff(ends[:, 3])[0] / np.diff(ends[:, 0])[0] - finger.rest_curvature
    moment = newton(lambda m: walk(m)[0], stiffness * curvature - left + right, tol=1e-13)
    return places, walk(moment)[1]


def assert_like_elastica(scene, arrays):
    error = certify(scene, arrays).model_error
    for name, finger in scene.named_fingers.items():
        places, exact = elastica(scene, arrays, name)
        stations, *columns = arrays[f"{name}.backbone"].T[:3]
        for place, at in places.items():
            off = np.linalg.norm(exact[place] - [np.interp(at, stations, column) for column in columns])
            # Between stations the stored backbone is interpolated here; the tip is one.
            tolerance = 1e-6 if place.endswith(".tip") else 1e-4
            assert error.displacements[place] == pytest.approx(off, abs=tolerance * finger.rod.length)


CASES = {
    "two matched clothoids": {},
    "four matched clothoids": {"elements": 4},
    "two arcs": {"family": "arc"},
    "weight": {"gravity": cases.PLANAR, "base_y": -0.048},
    "masses along it": {
        "gravity": cases.PLANAR,
        "base_y": -0.048,
        "finger": {"masses": (PointMass(at=0.05, mass=0.01), PointMass(at=0.12, mass=0.02))},
    },
    "tendon friction": {"family": "clothoid", "tendon_friction": 0.05},
    "bent at rest": {"finger": {"rest_curvature": 3.0}},
}


@pytest.mark.parametrize("case", but([CASES["tendon friction"]], CASES.values()), ids=CASES)
def test_exact_rod_is_the_elastica(case):
    result = optimized(**case)
    assert_like_elastica(result.scene, result.arrays)


@pytest.mark.parametrize("gravity", [cases.INTO_PLANE, cases.PLANAR], ids=lambda g: "into_plane" if g[2] else "planar")
def test_exact_rod_of_a_grasp_made_by_hand_is_the_elastica(gravity):
    assert_like_elastica(*cases.wrapped_disc(gravity, mass=0.2))


@pytest.mark.deep
def test_each_of_several_fingers_is_compared():
    result = optimize_grasp(CONFIGS / "wrap.yaml")
    assert_like_elastica(result.scene, result.arrays)
    names = {f"{name}.{place}" for name in result.scene.named_fingers for place in ("middle", "tip")}
    assert set(result.certificate.model_error.displacements) == names


def test_straight_fingers_are_exact():
    error = certify(*cases.two_fingers_below(mass=0.05)).model_error
    assert set(error.displacements) == {"left.tip", "right.tip"}
    assert error.greatest < 1e-12
    assert error.moment < 1e-6


@pytest.mark.parametrize("share", [-1.0, 0.0, 0.9, 1.1, 3.0])
def test_the_moment_left_out_is_that_of_the_loads_less_that_of_the_shape(share):
    """An arc, bent by a share of what its tendon bends it; of the greatest moment, which is the tendon's."""
    tension, length, half = 3.0, cases.LENGTH, 0.5
    bend = share * cases.OFFSET * tension / cases.STIFFNESS * length
    longer = Rod(length=1.5 * length, linear_density=1e-12, bending_stiffness=cases.STIFFNESS)
    fingers = {"finger": cases.make_finger(), "longer": cases.make_finger((5.0, 0.0), rod=longer)}
    values = {"finger": {"q": np.full(2, half * bend), "tensions": (tension, 0.0)}}
    error = certify(*cases.apart(fingers, values, family="arc")).model_error
    assert error.moment == pytest.approx(abs(1.0 - share), rel=1e-9, abs=1e-12)
    assert error.length == length
    assert set(error.displacements) == {"finger.tip", "longer.tip"}


def test_the_moment_left_out_is_seen_close_to_the_ends_of_elements():
    """A force across the tip, and an arc bent, hardly at all, by half its moment: half is left out at the base."""
    force, length = 1e-6, cases.LENGTH
    contacts = [("finger.tip", (0, 0), cases.LEFT, (force, 0, 0), length, 0)]
    q = np.full(2, 0.5 * force * length / cases.STIFFNESS * 0.5 * length)
    error = certify(*cases.apart(values={"finger": {"q": q}}, contacts=contacts, family="arc")).model_error
    assert error.moment == pytest.approx(0.5, abs=2e-3)


def test_model_error_of_arcs_falls_with_the_square_of_their_number():
    off = [optimized("arc", elements=n).certificate.model_error.displacements["finger.middle"] for n in (4, 8, 16)]
    assert 3.0 < off[0] / off[1] < 6.0
    assert 3.0 < off[1] / off[2] < 6.0


@pytest.mark.parametrize("family", ["arc", "matched_clothoid"])
def test_more_elements_leave_less_moment_out(family):
    left = [optimize_grasp(make_scene(family, elements=n)).certificate.model_error.moment for n in (2, 4, 8)]
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
    """The contact forces reversed: the equilibrium that is followed ends before the end, and nothing fails."""
    result = optimized(elements=4)
    arrays = {name: np.array(value) for name, value in result.arrays.items()}
    arrays["contact_forces"][:, :2] *= -1.0
    error = certify(result.scene, arrays).model_error
    assert error.lost == ("finger",)
    assert not error.found
    assert not error.small
    assert error.greatest == np.inf
    assert "finger under these forces has no equilibrium near" in str(error)


def test_model_error_is_saved_and_warned_of(tmp_path):
    done = run("grasp", CONFIGS / "mug_arcs.yaml", "--out", tmp_path, "--json")
    assert done.exit_code == 0, done.output
    meta = json.loads((tmp_path / "meta.json").read_text(encoding="utf-8"))
    error = meta["certificate"]["model_error"]
    assert error["displacements"]["finger.tip"] > error["limit"] == pytest.approx(0.005 * 0.18)
    assert not error["small"]
    assert meta["warnings"] == json.loads(done.stdout)["warnings"]
    assert f"warning: {meta['warnings'][0]}" in done.stderr
