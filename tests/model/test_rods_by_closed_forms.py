"""Rods that are not uniform, by the exact rod and by the model: Bessel functions, transfer matrices, quadrature."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy import integrate

from continuum_grasp.rod import natural_frequencies, solve_elastica
from continuum_grasp.simulation import equilibrium, modes
from tests.closed_forms.graded import pointed_frequencies, tapered_frequencies
from tests.graded_rods import CLOSED, FREQUENCIES, RODS, taper
from tests.marks import few
from tests.rods import HORIZONTAL, order, rod_scene

NONE = (0.0, 0.0)


def exact(scene, count=2):
    """Frequencies of the exact rod [rad/s]."""
    return 2.0 * math.pi * natural_frequencies(scene.finger, solve_elastica(scene), count)


def modeled(scene):
    """First two frequencies of the model [rad/s]."""
    return 2.0 * math.pi * modes(scene).frequencies_hz[:2]


def test_the_closed_forms_are_the_published_ones():
    assert pointed_frequencies(1) == pytest.approx([5.31509942, 15.20716796, 30.01980915], rel=1e-8)
    assert pointed_frequencies(2) == pytest.approx([8.71925886, 21.14566239, 38.45377123], rel=1e-8)
    # Mabie and Rogers 1972 measure by thickness and stiffness of the tip.
    assert 4.0 * tapered_frequencies(2, 0.25, 3) == pytest.approx([23.29, 73.9, 165.0], rel=2e-3)
    assert tapered_frequencies(1, 1e-6, 3) == pytest.approx(pointed_frequencies(1), rel=3e-6)


@pytest.mark.parametrize("name", CLOSED)
def test_a_straight_rod_has_the_frequencies_of_beam_theory(name):
    assert exact(rod_scene(CLOSED[name], gravity=NONE)) == pytest.approx(FREQUENCIES[name], rel=1e-9)


def test_a_thin_tip_is_resolved():
    thin = rod_scene(taper(0.01, cone=True), gravity=NONE)
    assert exact(thin) == pytest.approx(tapered_frequencies(2, 0.01), rel=1e-8)


STEPPED = "step", "arc"


@pytest.mark.parametrize("family", ["matched_clothoid", "clothoid", "arc"])
@pytest.mark.parametrize("name", few(["step", "cone 0.1", "wedge 0.5", "wedge 0.25", "cone 0.25", "spiral"], 2))
def test_the_models_frequencies_converge_at_the_familys_order(name, family):
    fidelity, errors = {"accuracy": 1e-6, "bending_range": 0.5}, []
    for count in (4, 8):
        # Arcs alone need an element to end where the stiffness jumps.
        elements = ([0.8 / count] * (count // 2) + [1.2 / count] * (count // 2)) if (name, family) == STEPPED else count
        scene = rod_scene(CLOSED[name], family, elements, gravity=NONE, fidelity=fidelity)
        errors.append(np.abs(modeled(scene) / FREQUENCIES[name] - 1.0))
    assert np.all(errors[-1] < ([1e-2, 3e-2] if family == "arc" else [1e-4, 5e-4]))
    assert order(np.array(errors)[:, 0])[-1] > (1.8 if family == "arc" else 4.0)


def bent(curvature, s):
    """Tip of a rod along +X by adaptive quadrature of angle and tangent; breaks of the curvature in ``s``."""

    def rate(at, state):
        return [curvature(at), math.cos(state[0]), math.sin(state[0])]

    state = [0.0, 0.0, 0.0]
    for a, b in itertools.pairwise(s):
        inside = integrate.solve_ivp(rate, (a, b), state, "DOP853", rtol=1e-13, atol=1e-14, max_step=0.02)
        state = inside.y[:, -1]
    return state


def rests_at(scene):
    """Turn and position of the tip of the exact rod, and of one element of the model."""
    rod, model = solve_elastica(scene), equilibrium(scene)
    assert model.model.n == 1
    angle = float(model.model.orientation(model.q, model.u, 1.0, model.p))
    return [[float(turn) - HORIZONTAL, *tip] for turn, tip in ((rod.angle(1.0), rod.tip), (angle, model.tip))]


ONE = {"elements": 1, "gravity": NONE, "fidelity": {"accuracy": 1e-5, "bending_range": 3.0}}


@pytest.mark.parametrize("end", [1.0, 0.6])
def test_a_tendon_alone_bends_by_its_moment_over_the_stiffness(end):
    slope = 0.75 if end == 1.0 else 0.5
    offset, lean = 0.006, 0.006 * slope
    tendon = {"offset": [offset, offset * (1.0 - slope * end)], "to": end, "max_tension": 100.0}
    other = {**tendon, "offset": [-one for one in tendon["offset"]]}
    pull = 0.04 / offset * math.sqrt(1.0 + lean**2)  # along the backbone
    keys = {"finger": {"tendons": [tendon, other]}, "actuation": {"tensions": [pull + 1.0, 1.0]}}
    turn, x, y = bent(lambda s: 0.04 * (1.0 - slope * s) / (1.0 - 0.75 * s) ** 4 * (s < end), [0.0, end])
    x, y = x + (1.0 - end) * math.cos(turn), y + (1.0 - end) * math.sin(turn)
    if end == 1.0:
        # The integral of 0.04 / (1 - 0.75 s)^3 from base to tip.
        assert turn == pytest.approx(0.4, rel=1e-12)
    for found in rests_at(rod_scene(RODS["cone 0.25"], **ONE, **keys)):
        assert found == pytest.approx([turn, x, y], abs=2e-8)


def test_a_couple_inside_bends_up_to_its_place():
    couple = {"kind": "moment", "at": 0.7, "moment": 0.2, "input": True}
    turn, x, y = bent(lambda s: 0.2 if s < 0.4 else 2.0, [0.0, 0.4, 0.7])
    for found in rests_at(rod_scene(RODS["step"], **ONE, loads=[couple])):
        assert found == pytest.approx([turn, x + 0.3 * math.cos(turn), y + 0.3 * math.sin(turn)], abs=1e-9)


def test_elements_with_stops_approach_the_exact_rod():
    """The kink moves with the load: elements cannot follow it, and the order is low."""
    finger = {
        "tendons": [{"offset": [0.01, 0.0025], "max_tension": 100.0}],
        "stops": {"curvature": [1.0, 4.0], "stiffness_ratio": 50.0},
    }
    keys = {"gravity": NONE, "finger": finger, "actuation": {"tensions": [40.0]}}
    errors = []
    for count in (3, 8):
        fidelity = {"accuracy": 1e-4, "bending_range": 4.0}
        scene = rod_scene(RODS["cone 0.25"], "clothoid", count, fidelity=fidelity, **keys)
        rod, found = solve_elastica(scene), equilibrium(scene)
        errors.append(np.linalg.norm(found.tip - rod.tip))
    touching = np.abs(rod.curvature(np.linspace(0.0, 1.0, 101))) > np.linspace(1.0, 4.0, 101)
    assert 0.2 < touching.mean() < 0.9
    assert errors[1] < 2e-3
    assert errors[1] < errors[0]
