"""Fingers of a hand's size, of 11 and of 3 mm against chains of hinges with Coulomb friction, written apart.

Lengths and times go with the size, masses with its cube, as of fingers of the same materials. The chains decide at each
hinge and guide whether it sticks.
"""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from tests.tendon_cases import CABLE, LENGTH, OFFSET, PASSIVE, ROD, STIFFNESS
from tests.truth import tendon_motion
from tests.truth.bending_friction_chain import Chain
from tests.truth.tendon_motion import MovingFinger

SIZES = [0.18, 0.011, 0.003]


@pytest.mark.deep
@pytest.mark.parametrize("length", SIZES)
def test_dry_friction_holds_a_released_finger_as_the_chain(length):
    """Let go from an even bend, with a body at the tip: all the way to where friction holds it."""
    r = length / 0.18
    stiffness, viscosity, density, mass = 6e-3 * r**4, 1e-5 * r**5, 0.034 * r**2, 0.002 * r**3
    branches = [(2e-3 * r**4, 6e-3 * r**3), (8e-3 * r**4, 3e-3 * r**3)]
    duration, steps = 0.5 * r, 50
    chain = Chain(length, density, stiffness, viscosity, branches, mass, hinges=24, gravity=0.0)
    chain.bend(1.2 / length)
    exact = [chain.tip]
    for k in range(40 * steps):
        chain.step(duration / (40 * steps))
        if k % 40 == 39:
            exact.append(chain.tip)
    finger = cg.Finger(
        rod={"length": length, "linear_density": density, "bending_stiffness": stiffness},
        damping={"material": viscosity, "dry_friction": [{"stiffness": k, "moment": m} for k, m in branches]},
        masses=[{"at": length, "mass": mass}],
        base={"angle": np.pi},
    )
    scene = cg.Scene(
        finger=finger,
        gravity=(0.0, 0.0),
        fidelity={"family": "clothoid", "elements": 4},
        initial={"q": [1.2 / length] * 5, "reached_by": "pulling"},
        time={"duration": duration, "step": duration / steps},
    )
    off = np.linalg.norm(cg.simulate(scene).tip - np.array(exact), axis=1)
    assert np.ptp(np.array(exact)[:, 0]) > 0.2 * length
    assert off.max() < 0.015 * length  # of it, most is what the chain of Euler steps damps
    assert off[-1] < 0.003 * length


@pytest.mark.parametrize("length", SIZES)
def test_winches_move_a_finger_with_tendon_friction_as_the_chain(length, monkeypatch):
    r = length / LENGTH
    monkeypatch.setattr(tendon_motion, "PRESSED", tendon_motion.PRESSED * r)
    turn = {"times": [0.0, 0.08 * r, 0.16 * r], "values": [0.0, 0.010 * r, 0.004 * r]}
    back = {**turn, "values": [-value for value in turn["values"]]}
    drive = {"kind": "length", "time_constant": 0.01 * r, "pretension": 2.0 * r**2}
    most, axial, series = CABLE["max_tension"] * r**2, CABLE["axial_stiffness"] * r**2, CABLE["series_stiffness"] * r
    cable = {"axial_stiffness": axial, "series_stiffness": series}
    finger = cg.Finger(
        rod={"length": length, "linear_density": ROD["linear_density"] * r**2, "bending_stiffness": STIFFNESS * r**4},
        damping={"material": PASSIVE["damping"]["material"] * r**5},
        masses=[{"at": length, "mass": 0.002 * r**3}],
        tendons={"offset": OFFSET * r, "max_tension": most, "friction": 0.15, "drive": drive, **cable},
    )
    scene = cg.Scene(
        finger=finger,
        gravity=[0.0, 0.0],
        actuation={"lengths": [turn, back]},
        time={"duration": 0.2 * r, "step": 1e-3 * r},
        fidelity={"family": "clothoid"},
    )
    motion = cg.simulate(scene)
    wound = motion.x[:, [2 * motion.n, 2 * motion.n + 2]] + motion.model.structure.winches[0].start
    chain = MovingFinger(
        length,
        STIFFNESS * r**4,
        OFFSET * r,
        0.15,
        hinges=24,
        time_step=5e-4 * r,
        density=0.034 * r**2,
        damping=3e-5 * r**5,
        tip_mass=0.002 * r**3,
        axial_stiffness=axial,
        series_compliance=1.0 / series,
    )
    chain.start([("length", wound[0, 0]), ("length", wound[0, 1])])
    exact = []
    for k in range(len(wound) - 1):
        for y in (0.5 * (wound[k] + wound[k + 1]), wound[k + 1]):
            chain.advance([("length", y[0]), ("length", y[1])])
        exact.append(chain.tip.copy())
    # As of the hand's size: what 24 guides and two clothoids leave.
    assert np.linalg.norm(motion.tip[1:] - np.array(exact), axis=1).max() < 0.013 * length
