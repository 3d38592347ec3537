"""Motions with contact: bouncing, sticking, slipping, pressing, and a grasp that holds."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize, root

from continuum_grasp.base import InputError
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.model import System
from continuum_grasp.scene import Finger, Scene, load
from continuum_grasp.simulation import ContactHistory, equilibrium, integrate, modes
from tests.rods import ROOT, without_compiler  # noqa: F401
from tests.truth.differences import differences

pytestmark = pytest.mark.usefixtures("without_compiler")

ROD = {"length": 0.2, "linear_density": 0.04, "bending_stiffness": 8e-3}
FAR = {"rod": ROD, "base": {"position": [5.0, 5.0], "angle": 0.0}}
"""A finger that is out of the way."""
G = 9.81


BALL = {"shape": "circle", "diameter": 0.04, "position": [0.0, 0.02]}


def body(shape=BALL, law=None, *, duration=1.0, step=1e-3, **keys):
    """An object alone, on a palm that points up, where nothing else is said."""
    data = {
        "finger": FAR,
        "gravity": [0.0, -G],
        "fidelity": {"family": "arc", "elements": 1},
        "object": {"mass": 0.1, **shape},
        "object_moves": True,
        "supports": {"floor": {"type": "palm", "point": [0.0, 0.0], "normal_angle": math.pi / 2}},
        "contact_law": {"stiffness": 5e3, "friction": 0.5, "dissipation": 20.0, **(law or {})},
        "time": {"duration": duration, "step": step},
        **keys,
    }
    return integrate(Scene.model_validate(data))


# an object and its supports


@pytest.mark.deep
@pytest.mark.parametrize("dissipation", [0.0, 0.2, 1.0])
def test_a_ball_bounces_as_the_law_says(dissipation):
    """Against an integration of the one equation that matters, at a tolerance of 1e-12."""
    law = {"dissipation": dissipation, "rounding": 1e-4}
    found = body({**BALL, "position": [0.0, 0.07]}, law, duration=0.6, step=5e-4)
    energy = found.kinetic + found.potential
    assert np.diff(energy).max() < 5e-5 * energy[0]

    def rate(t, x):
        d = -x[0] / 1e-4
        t = np.clip((d + 1) / 2, 0.0, 1.0)
        spring = 1e-4 * (2 * (t**3 - t**4 / 2) + max(d - 1.0, 0.0))
        return [x[1], 5e3 * spring * max(0.0, 1.0 - dissipation * x[1]) / 0.1 - G]

    true = solve_ivp(rate, (0.0, 0.6), [0.05, 0.0], "DOP853", found.t, rtol=1e-12, atol=1e-12, max_step=1e-4).y
    assert found.object_pose[:, 1] - 0.02 == pytest.approx(true[0], abs=2e-4)
    assert found.object_pose[:, [0, 2]] == pytest.approx(0.0, abs=1e-12)
    speed = math.sqrt(2 * G * 0.05)
    retained = math.sqrt(found.object_pose[(found.t > 0.12) & (found.t < 0.28), 1].max() - 0.02) / math.sqrt(0.05)
    assert retained == pytest.approx(1.0 - 2 / 3 * dissipation * speed, abs=0.35 * dissipation**2 + 1e-3)


@pytest.mark.parametrize(("slope", "sticks"), [(0.2, True), (0.4, True), (0.55, False), (0.9, False)])
def test_a_box_on_a_slope_sticks_or_slips(slope, sticks):
    """Friction 0.5 holds up to 0.4636 rad."""
    shape = {"shape": "box", "width": 0.06, "height": 0.03, "position": [0.0, 0.015]}
    gravity = [G * math.sin(slope), -G * math.cos(slope)]
    found = body(shape, step=2e-3, gravity=gravity)
    t, x = found.t, found.object_pose
    if sticks:
        assert np.ptp(x[t > 0.5, 0]) < 1e-7
        assert found.contacts.shear[-1].sum() == pytest.approx(0.1 * G * math.sin(slope), rel=1e-5)
        assert x[-1, 0] < 4e-4
        return
    speed = np.polyfit(t[t > 0.5], found.x[t > 0.5, 5], 1)[0]
    assert speed == pytest.approx(G * (math.sin(slope) - 0.5 * math.cos(slope)), rel=1e-3)
    assert found.contacts.shear[-1].sum() == pytest.approx(0.5 * found.contacts.normal_force[-1].sum(), rel=1e-6)


@pytest.mark.parametrize("law", [{}, {"friction": 0.0}], ids=["beside dry friction", "alone"])
def test_a_film_lets_a_box_slide_as_fast_as_it_bears_the_slope(law):
    """M v' = m g (sin - (mu + c v) cos): an exponential approach to v = (tan - mu) / c."""
    # So flat that friction does not tilt it on its soft corners: at a height of 30 mm that is 2.7e-3 of the pace.
    shape = {"shape": "box", "width": 0.06, "height": 0.003, "position": [0.0, 0.0015]}
    slope, film = 0.6, 4.0
    gravity = [G * math.sin(slope), -G * math.cos(slope)]
    found = body(shape, {"viscous": film, **law}, step=2e-3, gravity=gravity)
    steady = (math.tan(slope) - law.get("friction", 0.5)) / film
    pace = film * G * math.cos(slope)
    speed, some = found.x[:, 5], (found.t > 0.1) & (found.t < 0.25)
    assert speed[-1] == pytest.approx(steady, rel=1e-5)
    assert np.polyfit(found.t[some], np.log(steady - speed[some]), 1)[0] == pytest.approx(-pace, rel=5e-4)
    pressed = found.contacts.normal_force[-1].sum()
    assert found.contacts.shear[-1].sum() == pytest.approx(
        (law.get("friction", 0.5) + film * steady) * pressed, rel=1e-5
    )


@pytest.mark.parametrize(("across", "out"), [(0.0, 4.0), (3.0, 3.0), (3.0, 5.0), (0.0, 6.0)])
def test_the_friction_disc_is_shared_by_both_directions(across, out):
    """Pressed on by 0.1 * 9.81 N, the box bears 0.4905 N along the wall and out of the plane together."""
    shape = {"shape": "box", "width": 0.2, "height": 0.01, "position": [0.0, 0.005]}
    found = body(shape, step=2e-3, gravity=[across, -G], out_of_plane_gravity=out)
    pull, limit = math.hypot(across, out), 0.5 * G
    pose, t = found.object_pose, found.t
    contacts = found.contacts
    assert np.all(contacts.shear <= 0.5 * contacts.normal_force + 1e-9)
    if pull < limit:
        assert np.ptp(pose[t > 0.5][:, [0, 3]], axis=0) == pytest.approx([0.0, 0.0], abs=1e-7)
        assert contacts.lift[-1].sum() == pytest.approx(0.1 * out, rel=1e-4)
        return
    rates = found.x[t > 0.5][:, [6, 9]]
    slopes = [np.polyfit(t[t > 0.5], rate, 1)[0] for rate in rates.T]
    assert slopes == pytest.approx([(1 - limit / pull) * across, -(1 - limit / pull) * out], rel=2e-3, abs=1e-4)


@pytest.mark.parametrize(
    ("support", "expected"),
    [
        ({"type": "line", "start": [-0.1, 0.0], "end": [0.1, 0.0]}, {"seat": 1.0}),
        ({"type": "v_groove", "apex": [0.0, -0.008284271], "opening_angle": math.pi / 2, "axis_angle": math.pi / 2},
         {"seat.left": math.sqrt(0.5), "seat.right": math.sqrt(0.5)}),
        ({"type": "point", "position": [0.0, -0.01], "radius": 0.01}, {"seat": 1.0}),
    ],
)  # fmt: skip
def test_supports_bear_the_weight_that_statics_gives_them(support, expected):
    found = body(law={"friction": 0.0}, duration=0.4, supports={"seat": support})
    forces = dict(zip(found.contacts.names, found.contacts.normal_force[-1], strict=True))
    for name, share in expected.items():
        assert forces[name] == pytest.approx(0.1 * G * share, rel=2e-3)
    assert sum(forces.values()) == pytest.approx(0.1 * G * sum(expected.values()), rel=2e-3)


@pytest.mark.deep
def test_a_box_tips_over_the_end_of_an_edge():
    """Its center of mass is beside the edge: it turns, where over the edge it would rest."""
    shape = {"shape": "box", "width": 0.06, "height": 0.02}
    edge = {"edge": {"type": "line", "start": [-0.1, 0.0], "end": [0.0, 0.0]}}
    keys = {"supports": edge, "gravity": [0.0, -G]}
    rests, tips = (body({**shape, "position": [x, 0.01]}, step=2e-3, **keys) for x in (-0.02, 0.01))
    assert abs(rests.object_pose[-1, 2]) < 1e-3
    assert tips.object_pose[100, 2] < -0.3


# a finger against a fixed disc

BASE = {"position": [0.0, 0.0], "angle": -math.pi / 2}
DISC = {"shape": "circle", "diameter": 0.06, "mass": 1.0, "position": [0.16, 0.075]}


def pressing(stiffness, *, moment=0.06, friction=0.0, family="arc", duration=2.0, damping=5e-4, **keys):
    data = {
        "finger": {"rod": ROD, "half_thickness": 0.005, "damping": {"material": damping}, "base": BASE},
        "gravity": [0.0, 0.0],
        "fidelity": {"family": family, "elements": 2},
        "object": DISC,
        "contact_law": {"stiffness": stiffness, "friction": friction, "rounding": 1e-6},
        "actuation": {"tip_moment": {"times": [0.0, 0.3], "values": [0.0, moment]}},
        "time": {"duration": duration, "step": 2e-3},
        **keys,
    }
    return Scene.model_validate(data)


def arm(bend):
    """Tip of two arcs of 0.1 m that leave the origin along +X and bend towards +Y, and the angle there."""
    point, angle = 0j, 0.0
    for b in bend:
        point += np.exp(1j * angle) * 0.1 * (np.sinc(b / (2 * np.pi)) * np.exp(0.5j * b))
        angle += b
    return point


def depth(bend):
    """Of the tip in the disc [m]."""
    return 0.03 + 0.005 - abs(arm(bend) - (0.16 + 0.075j))


def truth(stiffness, moment=0.06):
    """Bends of least potential energy, and the contact force; infinite stiffness is a constraint."""

    def energy(bend):
        own = 0.5 * ROD["bending_stiffness"] / 0.1 * np.sum(np.square(bend)) - moment * np.sum(bend)
        return 1e3 * (own + (0.5 * stiffness * max(0.0, depth(bend)) ** 2 if math.isfinite(stiffness) else 0.0))

    start, options = [0.35, 0.35], {"maxiter": 2000}
    if math.isfinite(stiffness):
        found = minimize(energy, start, method="Nelder-Mead", options={**options, "xatol": 1e-12, "fatol": 1e-16})
        return found.x, stiffness * depth(found.x)
    rule = {"type": "ineq", "fun": lambda bend: -1e3 * depth(bend)}
    found = minimize(energy, start, method="SLSQP", constraints=[rule], options={**options, "ftol": 1e-15})
    (slope,) = differences(depth, found.x)
    missing = moment - ROD["bending_stiffness"] / 0.1 * found.x
    return found.x, float(missing @ slope / np.dot(slope, slope))


def test_a_finger_pressed_on_a_disc_comes_to_rest_where_the_energy_is_least():
    found = integrate(pressing(3e3))
    bend, force = truth(3e3)
    assert found.contacts.normal_force[-1] == pytest.approx([force], rel=1e-4)
    assert force > 0.1
    assert found.q[-1] == pytest.approx(bend, rel=1e-4)
    assert np.abs(found.x[-1, 2:4]).max() < 1e-6


def test_stiffer_contacts_come_to_the_rigid_answer_with_order_one():
    """The equilibrium itself, as the root of the accelerations."""
    rigid, errors = truth(math.inf)[1], []
    for stiffness in (1e4, 2e4, 4e4, 8e4):
        system = System(pressing(stiffness))
        u = [0.06, 0.0, 0.0][: system.nu]
        still = np.zeros(2)

        def missing(bend, system=system, u=u, still=still):
            return np.array(system.forward_dynamics([*bend, *still], u, [], [])).ravel()[2:4]

        bend = root(missing, truth(stiffness)[0], tol=1e-13).x
        forces = system.touch([*bend, *still], u, [], [])[1]
        errors.append(abs(float(forces) - rigid))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx(1.0, abs=0.05)


@pytest.mark.deep
@pytest.mark.parametrize("method", ["rodas", "reference"])
def test_methods_agree_where_the_finger_hits_and_slides(method):
    keys = {"friction": 0.3, "family": "matched_clothoid", "duration": 0.5}
    explicit, other = (
        integrate(pressing(3e3, **keys, time={"duration": 0.5, "step": 1e-3, "method": m})) for m in ("rk4", method)
    )
    assert explicit.contacts.normal_force.max() > 0.1
    assert other.tip == pytest.approx(explicit.tip, abs=3e-5)
    assert other.contacts.normal_force[-1] == pytest.approx(explicit.contacts.normal_force[-1], rel=0.02)


def test_a_stiffer_contact_is_given_more_steps():
    time = {"duration": 0.1, "step": 2e-3, "method": "rk4"}
    soft, hard = (integrate(pressing(k, time=time, damping=0.0)).statistics for k in (1e3, 1e6))
    assert hard["spectral_radius"] > 5 * soft["spectral_radius"]
    assert hard["substeps"] > soft["substeps"]


# a grasp


@pytest.mark.deep
def test_a_grasp_that_was_found_holds_in_motion():
    """Posture and tensions of the optimizer, let go with contacts that have yet to be pressed in."""
    grasp = optimize_grasp(ROOT / "configs/grasp/mug.yaml")
    planned, scene = grasp.fingers["finger"], grasp.scene
    length = scene.finger.rod.length
    lengths = [float(h) * length / planned.lengths.sum() for h in planned.lengths]
    data = {
        "finger": {name: getattr(scene.finger, name) for name in Finger.model_fields},
        "gravity": (0.0, 0.0),
        "contacts": (sum(lengths[:2]),),
        "fidelity": {"family": "clothoid", "elements": lengths},
        "object": scene.object,
        "supports": scene.supports,
        "object_moves": True,
        "out_of_plane_gravity": G,
        "contact_law": {"stiffness": 2e4, "friction": 0.5, "dissipation": 10.0},
        "actuation": {"tensions": planned.tensions.tolist()},
        "initial": {"q": [*planned.q.tolist(), planned.tip_curvature]},
        "time": {"duration": 0.4, "step": 1e-3},
    }
    found = integrate(Scene.model_validate(data))
    contacts, expected = found.contacts, [contact.normal_force for contact in grasp.contacts]
    assert contacts.names == ("finger.1", "finger.tip", "palm")
    assert contacts.normal_force[-1] == pytest.approx(expected, rel=0.1)
    assert contacts.lift[-1].sum() == pytest.approx(0.3 * G, rel=0.02)
    assert np.all(contacts.shear[-1] < 0.5 * contacts.normal_force[-1])
    moved = found.object_pose[-1] - found.object_pose[0]
    assert np.abs(moved[[0, 1, 3]]).max() < 1.5e-3
    assert np.ptp(found.object_pose[found.t > 0.35, 3]) < 2e-5


@pytest.mark.deep
def test_without_tension_the_same_mug_drops():
    found = integrate(
        load(ROOT / "configs/simulate/hold_mug.yaml", {"actuation.tensions": [1.0, 1.0], "time.duration": 0.3})
    )
    assert found.object_pose[-1, 3] < -0.1


# what is stored, and what is refused


def test_a_finger_that_passes_through_between_its_stations_is_reported():
    body_data = {"shape": "circle", "diameter": 0.08, "mass": 0.3, "position": [0.12, 0.06]}
    changed = {"object": body_data, "time.duration": 0.3, "time.step": 0.002}
    (warning,) = integrate(load(ROOT / "configs/simulate/swing_against_disc.yaml", changed)).warnings
    assert "overlaps the object by 1" in warning
    assert "mm" in warning


@pytest.mark.parametrize("verb", [equilibrium, modes])
def test_statics_with_an_object_are_refused(verb):
    with pytest.raises(InputError, match="do not support contact") as caught:
        verb(pressing(1e3))
    assert caught.value.key == "object"


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.5])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_friction_is_what_a_force_has_beside_its_normal_part(turn, side):
    """A wall that is turned, by 3 N with (0.6, 0.8) N across, and a table that bears 2.94 N with (0.3, 0.4) N."""
    normal = np.array([math.cos(turn), math.sin(turn)])
    across = np.array([-normal[1], normal[0]])
    forces = np.stack([3.0 * normal + side * 0.6 * across, [0.3, side * 0.4]], axis=1)[None]
    rows = ([[0.0, 0.0]], [[3.0, 2.94]], [[side * 0.6, 0.3]], [[side * -0.8, 2.94]])
    contacts = ContactHistory(("palm", "table"), *map(np.array, rows), forces, np.zeros((1, 2, 2)))
    assert contacts.shear[0] == pytest.approx([1.0, 0.5])


@pytest.mark.deep
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_no_contact_has_more_friction_than_its_cone(side):
    """The mug that is closed on, and its mirror image: normals by geometry, coefficients by the scene."""
    scene = load(ROOT / "configs" / "simulate" / "close_on_mug.yaml")
    pulled, slack = {"times": [0.0, 0.4], "values": [1.0, 45.0]}, 1.0
    base = {"position": [0.0, -0.055 * side], "angle": -math.pi / 2}
    tensions = [pulled, slack] if side > 0.0 else [slack, pulled]
    motion = integrate(scene.changed({"finger.base": base, "actuation.tensions": tensions, "time.duration": 0.5}))
    contacts = motion.contacts
    names, force = list(contacts.names), np.moveaxis(contacts.force, 1, 2)
    out = contacts.point - motion.object_pose[:, :2, None]
    normals = np.moveaxis(out / np.linalg.norm(out, axis=1, keepdims=True).clip(1e-9), 1, 2)  # of a circle
    normals[:, names.index("palm")] = [-1.0, 0.0]
    sideways = force - (force * normals).sum(axis=2, keepdims=True) * normals
    sideways[:, names.index("table")] = force[:, names.index("table")]
    lift = np.where(np.array(names) == "table", 0.0, contacts.lift)
    friction = np.hypot(np.linalg.norm(sideways, axis=2), lift)
    coefficients = np.where(np.array(names) == "table", 0.3, 0.5)
    assert (contacts.normal_force.max(axis=0) > 0.5).all()
    assert (friction <= coefficients * contacts.normal_force + 1e-6).all()
    assert contacts.shear == pytest.approx(friction, abs=1e-6)
