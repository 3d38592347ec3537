"""The other libraries' release of a rod, where an interpreter with them is named."""

from __future__ import annotations

import os

import numpy as np
import pytest

from benchmarks.baselines import VARIABLE, PeerError
from benchmarks.baselines.release_peers import ReleasePeers, describe_rod
from benchmarks.bench_peers import releases
from continuum_grasp.accuracy.truth import find_truth
from continuum_grasp.scene.simulate import Fidelity, Initial, Timing
from continuum_grasp.simulation.simulate import simulate
from tests.rods import NITINOL, rod_scene

FRAMES = Timing(duration=1.0, step=0.01)


def test_without_an_interpreter_it_says_which_variable_to_set(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    with pytest.raises(PeerError, match=VARIABLE):
        ReleasePeers()


needs_peers = pytest.mark.skipif(
    not os.environ.get(VARIABLE), reason=f"{VARIABLE} names no interpreter with the peer libraries"
)


@needs_peers
def test_hinge_chains_converge_to_our_motion_with_second_order():
    scene = rod_scene(
        NITINOL,
        elements=4,
        finger={"damping": {"material": 1e-4}},
        initial={"pose": "straight"},
        time={"duration": 1.0, "step": 0.01},
    )
    ours = simulate(scene).tip
    rod = describe_rod(scene, find_truth(scene))
    settings = {"layout": "middle", "integrator": "implicitfast", "steps": 4000, "staggered": True}
    errors = []
    with ReleasePeers() as peers:
        try:
            peers.version("mujoco")
        except PeerError as error:
            pytest.skip(f"no MuJoCo there: {error}")
        for hinges in (10, 20):
            tip = peers.make("chain", "mujoco", rod, {"hinges": hinges, **settings}, frames=100).tip
            errors.append(np.sqrt(np.mean(np.sum((tip - ours) ** 2, axis=1))))
    assert errors[0] < 1.2e-3
    assert 3.2 < errors[0] / errors[1] < 4.8


@needs_peers
@pytest.mark.parametrize(("name", "lengths"), [("stepped", (0.24, 0.36)), ("tendon", (0.36, 0.24))])
def test_constant_curvature_segments_move_like_arcs(name, lengths):
    """On parts that are uniform both are the same model, by other equations."""
    scene = releases()[name].scene
    fidelity = Fidelity(family="arc", elements=lengths)
    ours = simulate(scene.replaced(initial=Initial(pose="straight"), fidelity=fidelity, time=FRAMES)).tip
    with ReleasePeers() as peers:
        try:
            peers.version("soromox")
        except PeerError as error:
            pytest.skip(f"no SoRoMoX there: {error}")
        rod = describe_rod(scene, find_truth(scene))
        rod["bend"] = [0.0, 0.0]
        tip = peers.make("rod", "soromox", rod, {"segments": 2, "steps": 800}, frames=100).tip
    assert np.abs(tip - ours).max() < 2e-4
