"""The baselines of the benchmarks against the model in 50 digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.paper.dynamics import RacedFinger, by_appendix, by_closed_forms
from tests.truth import Rod, TruthFinger, to_numpy

FULL = RacedFinger(
    element_lengths=(0.25, 0.35),
    rest_angles=(0.1, -0.2),
    tip_mass=0.02,
    contact_mass=0.01,
    gravity=(1.0, -9.81),
    base_angle=-0.6,
    arc_damping=1e-4,
    material_damping=3e-5,
)
RATE, U, W = (2.0, -3.0), (3.0, 1.0), (0.1, 0.2, -0.3, 0.4)


def exact(finger: RacedFinger, theta, rate=None) -> Rod:
    l1, l2 = finger.element_lengths
    pieces = ((0, l1, finger.rest_angles[0] / l1), (l1, l1 + l2, finger.rest_angles[1] / l2))
    rod = TruthFinger(
        [l1, l2],
        mass_per_length=finger.mass_per_length,
        rotary_inertia=finger.rotary_inertia,
        bending_stiffness=finger.bending_stiffness,
        rest_curvature=pieces,
        masses=((l1, finger.contact_mass), (l1 + l2, finger.tip_mass)),
        gravity=finger.gravity,
        base_angle=finger.base_angle,
        material_damping=finger.material_damping,
        element_damping=finger.arc_damping,
    )
    return Rod(rod, [bend - rest for bend, rest in zip(theta, finger.rest_angles, strict=True)], rate)


def acceleration(finger: RacedFinger, theta) -> np.ndarray:
    l1, l2 = finger.element_lengths
    forces = [(l1, *W[:2]), (l1 + l2, *W[2:])]
    tau = (U[0] - U[1]) * finger.tendon_offset
    return to_numpy(exact(finger, theta, RATE).acceleration(forces, tau))


def relative(found, expected) -> float:
    return float(np.abs(np.asarray(found) - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize("bias", ["lagrange", "christoffel"])
@pytest.mark.parametrize("theta", [(0.9, -1.2), (0.4, 0.5), (-2.0, 1.7)])
def test_closed_forms_are_the_exact_model(theta, bias):
    finger = replace(FULL, rotary_inertia=1e-7)
    xd = by_closed_forms(finger, bias=bias)([*theta, *RATE], U, W, []).full()[:, 0]
    assert relative(xd[2:], acceleration(finger, theta)) < 1e-11


@pytest.mark.parametrize(("theta", "tolerance"), [((0.0, 0.0), 1e-13), ((0.1, -0.1), 1e-7), ((0.4, -0.5), 5e-5)])
def test_corrected_appendix_moves_the_finger_with_masses_and_forces(theta, tolerance):
    xd = by_appendix(FULL)([*theta, *RATE], U, W, []).full()[:, 0]
    assert xd[:2].tolist() == list(RATE)
    assert relative(xd[2:], acceleration(FULL, theta)) < tolerance
