"""Motions with tendon friction against a chain of many guides with the exact law, on which controllers can be tried."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from tests.tendon_cases import CABLE, LENGTH, OFFSET, PASSIVE, ROD, STIFFNESS
from tests.truth.tendon import HingedFinger
from tests.truth.tendon_motion import MovingFinger

IN = {"times": [0.0, 0.08, 0.16], "values": [0.0, 0.010, 0.004]}
OUT = {"times": [0.0, 0.08, 0.16], "values": [0.0, -0.010, -0.004]}


def test_the_chain_vibrates_as_a_cantilever_does():
    chain = MovingFinger(LENGTH, STIFFNESS, OFFSET, 0.0, sides=(1.0,), hinges=40, damping=0.0, tip_mass=0.0)
    at = 1.8751041 * (np.arange(40) + 0.5) / 40
    chain.bends = 1e-4 * (np.cosh(at) + np.cos(at) - 0.7340955 * (np.sinh(at) + np.sin(at)))
    chain._before = chain.bends, chain.rates
    angles = []
    while len(angles) < 800:
        chain.advance([("tension", 0.0)])
        angles.append(chain.angle)
    a = np.array(angles)
    crossed = np.flatnonzero((a[:-1] > 0.0) != (a[1:] > 0.0))
    instants = chain.time_step * (1 + crossed + a[crossed] / (a[crossed] - a[crossed + 1]))
    pulsation = math.pi * (len(instants) - 1) / (instants[-1] - instants[0])
    exact = 1.8751041**2 * math.sqrt(STIFFNESS / ROD["linear_density"]) / LENGTH**2
    assert pulsation == pytest.approx(exact, rel=2e-3)


def test_the_chain_stays_where_it_rests():
    chain = MovingFinger(LENGTH, STIFFNESS, OFFSET, 0.2, sides=(1.0,), hinges=24, time_step=1e-3)
    for tension in (*range(1, 13), *range(11, 6, -1)):
        chain.move([("tension", float(tension))])
    chain._before = chain.bends, chain.rates
    angle = chain.angle
    for _ in range(20):
        chain.advance([("tension", 7.0)])
    assert chain.angle == pytest.approx(angle, abs=1e-8)


@pytest.mark.parametrize(
    ("friction", "angle", "tip", "tension"), [(0.15, 0.007, 2.2e-3, 0.33), (0.3, 0.019, 3e-3, 0.66)]
)
def test_two_winches_move_a_finger_as_the_chain_moves(friction, angle, tip, tension):
    """Greatest differences of angle and tip, and those of the tensions in the mean."""
    drive = {"kind": "length", "time_constant": 0.01, "pretension": 2.0}
    finger = cg.Finger(**PASSIVE, tendons={**CABLE, "friction": friction, "drive": drive})
    scene = cg.Scene(
        finger=finger,
        gravity=[0.0, 0.0],
        actuation={"lengths": [IN, OUT]},
        time={"duration": 0.2, "step": 1e-3},
        fidelity={"family": "clothoid"},
    )
    motion = cg.simulate(scene)
    wound = motion.x[:, [2 * motion.n, 2 * motion.n + 2]] + motion.model.structure.winches[0].start
    chain = MovingFinger(LENGTH, STIFFNESS, OFFSET, friction, hinges=24, time_step=5e-4)
    chain.start([("length", wound[0, 0]), ("length", wound[0, 1])])
    found = []
    for k in range(len(wound) - 1):
        for y in (0.5 * (wound[k] + wound[k + 1]), wound[k + 1]):
            chain.advance([("length", y[0]), ("length", y[1])])
        found.append((chain.angle, *chain.tip, *chain.tensions))
    exact = np.array(found)
    bends = [float(np.array(motion.model.bending(q, [0.0, 0.0], [])).sum()) for q in motion.q[1:]]
    assert np.abs(bends - exact[:, 0]).max() <= angle
    assert np.linalg.norm(motion.tip[1:] - exact[:, 1:3], axis=1).max() <= tip
    assert np.sqrt(np.mean((motion.tensions[1:] - exact[:, 3:]) ** 2)) <= tension


def test_moved_slowly_the_chain_is_that_at_rest():
    """Two solvers of the same guides: one goes from rest to rest, the other steps in time with hardly any mass."""
    still = {"density": 1e-9, "damping": 1e-12, "tip_mass": 0.0, "time_step": 1.0}
    resting = HingedFinger(LENGTH, STIFFNESS, OFFSET, 0.1, sides=(1.0,), hinges=20)
    moving = MovingFinger(LENGTH, STIFFNESS, OFFSET, 0.1, sides=(1.0,), hinges=20, **still)
    loads = [(float(tension), 0.0) for tension in range(1, 13)]
    loads += [(12.0, force) for force in (0.03, 0.06, 0.03, 0.0, -0.03)]
    for tension, force in loads:
        resting.move([("tension", tension)], (force, 0.0))
        moving.advance([("tension", tension)], (force, 0.0))
        assert moving.angle == pytest.approx(resting.angle, abs=1e-6)
