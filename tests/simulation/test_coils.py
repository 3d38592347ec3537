"""Fingers that are coils at rest or become coils: any number of turns, elements and families, with no range stated."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy import integrate, linalg, optimize

import continuum_grasp as cg
from continuum_grasp.base import SolverError
from continuum_grasp.model import FingerModel
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import bends_of
from tests.marks import few

FAMILIES = ("arc", "clothoid", "matched_clothoid")
LENGTH, STIFFNESS, DENSITY = 0.18, 4e-3, 0.03
TURN = 2.0 * math.pi


def coil(rest, turns=0.0, elements=4, family="clothoid", fidelity=None, finger=None, **keys) -> Scene:
    """A finger of a rest curvature [1/m], bent by a moment on its tip that would bend a straight one by some turns."""
    keys = {"actuation": {"tip_moment": turns * TURN * STIFFNESS / LENGTH}, **keys}
    rod = {"length": LENGTH, "bending_stiffness": STIFFNESS, "linear_density": DENSITY}
    return Scene.model_validate(
        {
            "schema_version": 1,
            "finger": {"rod": rod, "damping": {"material": 3e-4}, "rest_curvature": rest, **(finger or {})},
            "gravity": [0.0, 0.0],
            "fidelity": {"elements": elements, "family": family, **(fidelity or {})},
            **keys,
        }
    )


def circle(turns) -> np.ndarray:
    """Tip [m] of a circular arc of some turns, which leaves its base along +y."""
    angle = turns * TURN
    return LENGTH / angle * np.array([math.cos(angle) - 1.0, math.sin(angle)])


def end_of(curvature, places) -> np.ndarray:
    """Tip [m] of a curve of a curvature [1/m] that is smooth between places [m], by a library's integration."""
    state = np.zeros(3)
    for a, b in pairwise(places):
        inside = 1e-12 * LENGTH

        def rate(s, y, a=a, b=b, inside=inside):
            return [-math.sin(y[2]), math.cos(y[2]), curvature(min(max(s, a + inside), b - inside))]

        state = integrate.solve_ivp(rate, (a, b), state, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    return state[:2]


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(
    ("rest", "turns", "elements"),
    few(
        [
            (1.54, 0.0, 8),
            (0.0, 3.0, 4),
            (-3.0, 1.0, 1),
            (1.54, -3.0, 2),
            (3.0, 3.0, 1),
            (0.0, 3.0, 1),
            (0.0, -3.0, 3),
            (3.0, 3.0, 3),
            (0.0, 3.0, 16),
            (-1.54, 0.5, 32),
            (0.0, 3.0, 32),
        ],
        4,
    ),
)
def test_coils_under_moments_are_circles(family, rest, turns, elements):
    found = cg.equilibrium(coil(rest * TURN / LENGTH, turns, elements, family))
    assert found.stable
    assert found.warnings == ()
    # A single clothoid is evaluated to 3e-2 by default, as its shape is not better.
    assert found.tip == pytest.approx(circle(rest + turns), abs=(1e-3 if elements == 1 else 1e-5) * LENGTH)


def random_rest(rng):
    """A rest curvature [1/m] of up to three turns as in a scene, as a function, and the places of its jumps."""
    most = 3.0 * TURN / LENGTH
    values = rng.uniform(-most, most, rng.integers(1, 4)).tolist()
    breaks = sorted((rng.uniform(0.1, 0.9, len(values) - 1) * LENGTH).tolist())
    stated = {"breaks": breaks, "values": values} if breaks else values[0]
    return stated, lambda s: values[int(np.searchsorted(breaks, s))], [0.0, *breaks, LENGTH]


@pytest.mark.parametrize("seed", few(range(12), 1))
def test_random_coils_are_right_with_any_number_of_elements(seed):
    """Moments add to the curvature at rest, which clothoids follow wherever it jumps; none of the counts fails."""
    rng = np.random.default_rng(seed)
    rest, at_rest, places = random_rest(rng)
    turns = float(rng.uniform(-3.0, 3.0))
    truth = end_of(lambda s: at_rest(s) + turns * TURN / LENGTH, places)
    for elements, error in ((1, 1e-2), (2, 1e-3), (4, 1e-4)):
        found = cg.equilibrium(coil(rest, turns, elements, "clothoid"))
        assert found.stable, elements
        assert found.tip == pytest.approx(truth, abs=error * LENGTH), elements


def shot(rest, force, tip_angle) -> tuple[float, np.ndarray]:
    """Angle at the base and tip [m] of a coil that a force pulls at its free end, integrated from there."""

    def rate(s, y):
        angle, curvature = y[2:]
        # From tip to base: E I kappa' = F across the tangent, with its sign.
        across = -force[0] * math.cos(angle) - force[1] * math.sin(angle)
        return [math.sin(angle), -math.cos(angle), -curvature, across / STIFFNESS]

    start = [0.0, 0.0, tip_angle, rest]
    end = integrate.solve_ivp(rate, (0.0, LENGTH), start, method="DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    return float(end[2]), -end[:2]


@pytest.mark.parametrize(
    ("family", "elements", "error"),
    few([("clothoid", 8, 2e-4), ("clothoid", 16, 1e-5), ("matched_clothoid", 8, 1e-3), ("arc", 16, 1e-2)], 1),
)
@pytest.mark.parametrize("turns", few([1.54, -1.54, 2.5], 2))
def test_coils_that_a_force_pulls_out_are_elasticas(family, elements, error, turns):
    rest = turns * TURN / LENGTH
    force = [0.15, 0.6]
    found = cg.equilibrium(coil(rest, 0.0, elements, family, loads=[{"kind": "force", "at": LENGTH, "force": force}]))
    near = float(np.array(found.model.orientation(found.q, found.u, LENGTH, [])).item())
    angle = optimize.newton(lambda a: shot(rest, force, a)[0], near, x1=near + 1e-4, tol=1e-12)
    # The error of the elements goes with the fourth power of their number per turn.
    finer = (abs(turns) / 1.54) ** 4
    assert found.tip == pytest.approx(shot(rest, force, angle)[1], abs=error * finer * LENGTH)


LOADS = (
    {"kind": "force", "at": LENGTH, "force": [0.2, -0.8]},
    {"kind": "force", "at": 0.6 * LENGTH, "force": [-1.5, 0.4]},
    {"kind": "moment", "at": 0.5 * LENGTH, "moment": 0.05},
    {"kind": "force", "at": LENGTH, "force": [0.0, 0.5], "follows": True},
)


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(10))
def test_more_elements_never_fail_where_fewer_succeed(seed):
    rng = np.random.default_rng(100 + seed)
    rest, _, _ = random_rest(rng)
    family = FAMILIES[seed % 3]
    loads = [LOADS[k] for k in rng.choice(len(LOADS), 2, replace=False)]
    succeeded = False
    for elements in (1, 2, 4, 8, 16):
        try:
            cg.equilibrium(coil(rest, float(rng.uniform(-2.0, 2.0)), elements, family, loads=loads))
        except SolverError:
            assert not succeeded, elements
        succeeded = True


def inertia_of_two(rest, q) -> np.ndarray:
    """Mass matrix (3, 3) of two clothoids at curvatures above rest [1/m], by sums over many places."""
    count = 8001
    s = np.linspace(0.0, LENGTH, count)
    hats = np.array([np.interp(s, [0.0, 0.5 * LENGTH, LENGTH], row) for row in np.eye(3)])
    turned = integrate.cumulative_simpson(hats, x=s, initial=0.0)
    angle = rest * s + q @ turned
    across = np.array([-np.cos(angle), -np.sin(angle)])
    moved = integrate.cumulative_simpson(turned[:, None] * across[None], x=s, initial=0.0)
    return DENSITY * integrate.simpson(np.einsum("ack,bck->abk", moved, moved), x=s)


def stiffness_of_two() -> np.ndarray:
    """Integrals (3, 3) of E I times products of hat functions on two elements."""
    half = 0.5 * LENGTH
    return STIFFNESS * half / 6.0 * np.array([[2.0, 1.0, 0.0], [1.0, 4.0, 1.0], [0.0, 1.0, 2.0]])


@pytest.mark.parametrize("turns", [1.54, -3.0])
def test_modes_of_a_coil(turns):
    rest = turns * TURN / LENGTH
    found = cg.modes(coil(rest, 0.0, 2, fidelity={"accuracy": 1e-9}))
    squares = linalg.eigh(stiffness_of_two(), inertia_of_two(rest, np.zeros(3)), eigvals_only=True)
    assert found.frequencies_hz == pytest.approx(np.sqrt(squares) / TURN, rel=1e-6)


def test_compiled_code_of_a_coil():
    """Accelerations of a coil that is bent further and let go: M qdd = -K q."""
    rest = 1.54 * TURN / LENGTH
    model = FingerModel(coil(rest, 0.0, 2, fidelity={"accuracy": 1e-9}))
    q = np.array([8.0, -12.0, 5.0])
    rate = cg.compile(model).forward_dynamics([*q, 0.0, 0.0, 0.0], [0.0], [], [])
    assert rate[3:] == pytest.approx(-np.linalg.solve(inertia_of_two(rest, q), stiffness_of_two() @ q), rel=1e-6)


@pytest.mark.parametrize(("family", "elements"), few([("clothoid", 2), ("arc", 4), ("clothoid", 8)], 1))
@pytest.mark.parametrize(("pose", "rest", "turns"), few([("straight", 1.54, 0.0), ("rest", -1.54, 3.0)], 1))
def test_motions_end_at_coils(family, elements, pose, rest, turns):
    """A corkscrew that is let go while it is straight winds up; one that a moment turns over ends as a circle."""
    damping = {"damping": {"material": 3e-3}}
    keys = {"initial": {"pose": pose}, "time": {"duration": 6.0, "step": 0.02}, "finger": damping}
    motion = cg.simulate(coil(rest * TURN / LENGTH, turns, elements, family, **keys))
    assert motion.status == "finished"
    assert motion.warnings == ()
    assert motion.tip[-1] == pytest.approx(circle(rest + turns), abs=1e-3 * LENGTH)


@pytest.mark.deep
def test_a_coil_that_is_let_go_keeps_its_energy():
    keys = {"initial": {"pose": "straight"}, "time": {"duration": 0.05, "step": 1e-3, "tolerance": 1e-6}}
    motion = cg.simulate(coil(1.54 * TURN / LENGTH, finger={"damping": {"material": 0.0}}, **keys))
    energy = motion.kinetic + motion.potential
    # E I k^2 L / 2 of a straight corkscrew.
    assert energy[0] - motion.potential.min() <= 0.5 * STIFFNESS * (1.54 * TURN) ** 2 / LENGTH
    assert np.ptp(energy) < 1e-4 * np.ptp(motion.potential)


def test_code_is_written_for_the_shapes_of_its_scene():
    """1.25 times three turns on four elements; slight bends and an unknown history of friction change nothing."""
    scene = coil(0.0, 3.0)
    assert bends_of(scene, FingerModel(scene)) == pytest.approx([1.25 * 3.0 * TURN / 4.0] * 4, rel=1e-4)
    slight = coil(0.0, 0.2)
    assert bends_of(slight, FingerModel(slight)) == list(FingerModel(slight).ranges)
    with_friction = {"tendons": {"offset": 4e-3, "max_tension": 50.0, "friction": 0.3}}
    pulled = coil(0.0, finger=with_friction, actuation={"tensions": [30.0, 0.0]}, initial={"pose": "equilibrium"})
    assert bends_of(pulled, FingerModel(pulled)) == list(FingerModel(pulled).ranges)


@pytest.mark.deep
@pytest.mark.parametrize("turns", [1.54, -1.54])
def test_a_package_of_a_coil_takes_it_straight_and_wound_up(turns, tmp_path):
    """Limits of the curvature above rest: half of 120 degrees beyond the coil, and as far to the other side."""
    rest = turns * TURN / LENGTH
    model = cg.export_c(coil(rest, 0.0, 2), tmp_path, what=["kinematics"]).manifest
    most = (abs(turns) * TURN / 2.0 + TURN / 6.0) * 2.0 / LENGTH
    for field in model["structs"]["state"][:3]:
        assert (field["low"], field["high"]) == pytest.approx((-most - rest, most - rest), rel=1e-6)
