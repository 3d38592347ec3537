"""Rods of found grasps against the elastica by shooting."""

from __future__ import annotations

import numpy as np
import pytest
from grasp_scenes import CONFIGS, make_scene
from scipy.integrate import solve_ivp
from scipy.optimize import newton

from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import GraspSolver, PointMass
from tests import certificate_cases as cases
from tests.marks import but

ONE = GraspSolver(effort="quick")


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

    moment = newton(lambda m: walk(m)[0], float(arrays[f"{name}.base_moment"][2]), tol=1e-13)
    return places, walk(moment)[1]


def assert_like_elastica(result):
    for name, finger in result.scene.named_fingers.items():
        places, exact = elastica(result.scene, result.arrays, name)
        for place, at in places.items():
            off = np.linalg.norm(exact[place] - result.rods[name].at(np.array([at])).points[0, :2])
            assert off < 2e-5 * finger.rod.length
        # The stored backbone is the rod; elements stand for it as closely as their error says.
        stations, *columns = result.arrays[f"{name}.backbone"].T[:3]
        end = [np.interp(stations[-1], stations, column) for column in columns]
        assert np.linalg.norm(exact[f"{name}.tip"] - end) < 2e-5 * finger.rod.length


SCENES = {
    "mug": {},
    "weight": {"gravity": cases.PLANAR, "base_y": -0.048},
    "masses along it": {
        "gravity": cases.PLANAR,
        "base_y": -0.048,
        "finger": {"masses": (PointMass(at=0.05, mass=0.01), PointMass(at=0.12, mass=0.02))},
    },
    "tendon friction": {"family": "clothoid", "tendon_friction": 0.05, "friction_states": "pulled"},
    "bent at rest": {"finger": {"rest_curvature": 3.0}},
}


@pytest.mark.parametrize("case", but(["tendon friction"], SCENES))
def test_a_found_finger_is_the_elastica(case):
    own = {"family": "matched_clothoid", "gravity": cases.INTO_PLANE, "solver": ONE, **SCENES[case]}
    result = optimize_grasp(make_scene(own.pop("family"), own.pop("gravity"), **own), raise_on_failure=False)
    assert result.certificate.passed
    assert_like_elastica(result)


@pytest.mark.deep
def test_each_of_several_fingers_is_the_elastica():
    assert_like_elastica(optimize_grasp(CONFIGS / "wrap.yaml"))


def test_elements_of_arcs_come_closer_to_the_rod_with_the_square_of_their_number():
    off = []
    for count in (4, 8, 16):
        scene = make_scene("arc", cases.INTO_PLANE, solver=ONE, elements=count)
        off.append(optimize_grasp(scene, raise_on_failure=False).element_errors["finger"].displacement)
    assert 3.0 < off[0] / off[1] < 6.0
    assert 3.0 < off[1] / off[2] < 6.0
