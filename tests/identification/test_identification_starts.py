"""Motions that start where samples show them; from inside: a problem on a plateau, and predictions of one path.

Motions that start where the first samples show them, drives that lag, and what each set has of its own.
"""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import Estimate, Poses, Reading, TipPath
from continuum_grasp.addons.identification.blocks import PosesBlock
from continuum_grasp.addons.identification.path_block import PathBlock
from continuum_grasp.addons.identification.problem import FitProblem, Solution
from continuum_grasp.addons.identification.searches import may_be_local, restarted
from continuum_grasp.addons.identification.unknowns import Unknown, read_unknowns
from continuum_grasp.base import InputError
from continuum_grasp.scene import Scene
from tests.identification_cases import (
    LENGTH,
    ROD,
    STIFFNESS,
    at_tip,
    elastica,
    loaded_scene,
    rung,
    slope_error,
    weighed,
)
from tests.rods import HANGING, rod_scene

PLACES = (0.15, 0.28, LENGTH)
BODY = {"mass": 0.02, "center_of_mass": [0.0, 0.03], "rotary_inertia": 1e-5}


def swinging(**keys) -> Scene:
    """A hanging rod with a body at its tip, two elements that are bent and move at time zero."""
    return rod_scene(
        ROD,
        "clothoid",
        2,
        angle=HANGING,
        finger={"tip_body": BODY, "damping": {"material": 2e-4}},
        initial={"q": [2.0, 3.0, 1.0], "qd": [5.0, -10.0, 0.0]},
        **keys,
    )


def points_of(motion: cg.Trajectory, scene: Scene, first: int, **keys) -> TipPath:
    """Three points of a motion from one of its instants on."""
    model = cg.FingerModel(scene)
    at = [np.array([model.position(q, [0.0], s, []) for q in motion.x[:, : model.n]]).reshape(-1, 2) for s in PLACES]
    readings = [
        Reading(axis, points[first:, k], s) for s, points in zip(PLACES, at, strict=True) for k, axis in enumerate("xy")
    ]
    return TipPath(motion.t[first:], measured=readings, **keys)


@pytest.fixture(scope="module")
def motion() -> cg.Trajectory:
    return cg.simulate(swinging(time={"duration": 0.5, "step": 0.002, "method": "reference"}))


@pytest.mark.deep
def test_an_estimated_start_begins_at_the_state_that_the_samples_show(motion):
    """The parabola through seven samples misses the rates by the third derivative, a percent of the fast mode's."""
    first, scene = 50, swinging()
    unknowns = read_unknowns(scene, ["bending_stiffness"])
    block = PathBlock(scene, points_of(motion, scene, first, start="estimated"), unknowns)
    n = motion.x.shape[1] // 2
    q, qd = (np.array([one.start for one in block.own[k * n : (k + 1) * n]]) for k in range(2))
    assert q == pytest.approx(motion.x[first, :n], abs=0.02 * np.abs(motion.x[:, :n]).max())
    assert qd == pytest.approx(motion.x[first, n : 2 * n], abs=0.05 * np.abs(motion.x[:, n : 2 * n]).max())


@pytest.mark.deep
def test_an_estimated_start_leaves_the_stiffness_to_the_motion(motion):
    """A hold-out has its start estimated too, and nothing else."""
    first, scene = 50, swinging()
    data = [points_of(motion, scene, k, start="estimated", fitted=k == first, name=str(k)) for k in (first, 120)]
    fit = cg.identify(scene, data, parameters=[Estimate(name="bending_stiffness", start=0.02), "tip_body_along"])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-4)
    assert fit["tip_body_along"] == pytest.approx(0.03, rel=1e-3)
    true = np.concatenate([motion.x[first], motion.x[120]])
    assert fit.set_values == pytest.approx(true, abs=1e-3 * np.abs(true).max())
    assert fit.holdout_errors[0].rms < 1e-5
    assert len(fit.names) == 2
    assert fit.errors[0].rms < 1e-5


@pytest.mark.deep
def test_derivatives_from_starts_that_are_read(motion):
    scene = swinging()
    unknowns = read_unknowns(scene, ["bending_stiffness", "clamp_angle", "tip_body_along", "tip_body_inertia"])
    data = points_of(motion, scene, 50, start="estimated")
    few = [Reading(one.quantity, one.values[:40], one.at) for one in data.measured]
    block = PathBlock(scene, TipPath(data.t[:40], measured=few, start="estimated"), unknowns)
    every = [*unknowns, *block.own]
    assert slope_error(block, np.array([u.start for u in every]), np.array([u.typical for u in every])).max() < 2e-6


# -- the drive -------------------------------------------------------------------------------------------------------

PULL = ([0.0, 0.1, 0.2, 0.3], [0.0, 1.0, 0.2, 0.8])


def pulled(family: str, late: float = 0.0, lag: float | None = 0.03, **keys) -> Scene:
    times, values = [at + late for at in PULL[0]], PULL[1]
    tendons = {"offset": 0.02, "max_tension": 9.0, **({} if lag is None else {"time_constant": lag})}
    return rod_scene(
        ROD,
        family,
        finger={"tendons": tendons},
        actuation={"tensions": [{"times": times, "values": values}, 0.1]},
        initial={"pose": "equilibrium"},
        **keys,
    )


@pytest.mark.deep
@pytest.mark.parametrize("family", ["clothoid", "matched_clothoid"])
def test_lag_and_delay_of_a_drive_from_one_pull(family):
    """The simulation lags by the model's own states; the delay is a shift of its command."""
    true = cg.simulate(pulled(family, late=0.012, time={"duration": 0.4, "step": 0.001, "method": "reference"}))
    data = TipPath(true.t[5::5], at_tip(*true.tip[5::5].T))
    scene = pulled(family, lag=None)
    names = [Estimate(name="drive_time_constant", start=0.015), "drive_delay", "bending_stiffness"]
    unknowns = read_unknowns(scene, names)
    block = PathBlock(scene, data, unknowns)
    at, sizes = np.array([0.02, 0.007, STIFFNESS]), np.array([u.typical for u in unknowns])
    assert slope_error(block, at, sizes).max() < 1e-5  # the delay by a difference of the command
    fit = cg.identify(scene, data, parameters=names)
    assert fit["drive_time_constant"] == pytest.approx(0.03, rel=2e-3)
    assert fit["drive_delay"] == pytest.approx(0.012, abs=3e-5)
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-4)
    assert fit.apply().finger.tendons.time_constant == fit["drive_time_constant"]


def test_a_delay_needs_commands_that_vary():
    scene = rod_scene(ROD, "clothoid", finger={"tendons": {"offset": 0.02, "max_tension": 9.0}})
    with pytest.raises(InputError, match="commands that vary"):
        cg.identify(scene, TipPath([0.0, 0.1], [Reading("x", [0.0, 0.0])]), parameters=["drive_delay"])
    with pytest.raises(InputError, match="needs a start value"):
        read_unknowns(scene, ["drive_time_constant"])


# -- a body at the tip, and what each set has of its own ---------------------------------------------------------------


def test_the_body_at_the_tip_from_two_frequencies():
    """A light rod: flexibility L/EI [[L^2/3, L/2], [L/2, 1]] against the mass matrix of a body on an arm."""
    mass, arm, inertia = 0.5, 0.05, 4e-4
    flexibility = LENGTH / STIFFNESS * np.array([[LENGTH**2 / 3, LENGTH / 2], [LENGTH / 2, 1.0]])
    body = np.array([[mass, mass * arm], [mass * arm, mass * arm**2 + inertia]])
    frequencies = np.sort(1.0 / np.sqrt(np.linalg.eigvals(flexibility @ body))) / (2 * np.pi)
    finger = {"tip_body": {"mass": mass, "center_of_mass": [0.0, 0.01], "rotary_inertia": 1e-3}}
    scene = rod_scene(ROD | {"linear_density": 1e-5}, "clothoid", 1, gravity=(0.0, 0.0), finger=finger)
    fit = cg.identify(scene, rung(*frequencies), parameters=["tip_body_along", "tip_body_inertia"])
    assert fit["tip_body_along"] == pytest.approx(arm, rel=1e-3)
    assert fit["tip_body_inertia"] == pytest.approx(inertia, rel=1e-2)
    applied = fit.apply().finger.tip_body
    assert applied.center_of_mass == (0.0, fit["tip_body_along"])
    assert applied.rotary_inertia == fit["tip_body_inertia"]


@pytest.mark.deep
def test_each_set_has_a_clamp_of_its_own():
    """Two weighings of the exact rod between which its clamp has turned: one stiffness, two angles."""
    loads, angles, sets = [0.0, 0.1, 0.2], [0.05, -0.08], []
    for k, angle in enumerate(angles):
        tips = np.array([elastica(load, clamp=angle) for load in loads])
        sets.append(weighed(tips, loads, name=f"day {k + 1}"))
    turned = Estimate(name="clamp_angle", per="set")
    fit = cg.identify(loaded_scene(), sets, parameters=["bending_stiffness", turned])
    assert fit.names == ("bending_stiffness",)
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-3)
    assert fit.set_names == ("clamp_angle of day 1 [rad]", "clamp_angle of day 2 [rad]")
    assert fit.set_values == pytest.approx(angles, abs=1e-3)
    assert fit.apply().finger.base.angle == loaded_scene().finger.base.angle


# -- starts far off --------------------------------------------------------------------------------------------------


class Plateau:
    """Stands in for a problem whose predictions change only where no parameter is more than a decade off its truth."""

    truth = np.array([2e-3, 40.0, 0.3])

    def __init__(self, factors: tuple[float, ...]) -> None:
        self.unknowns = [
            Unknown(f"p{k}", "1", f"p{k}", 1.0, False, start, 0.0, np.inf, start)
            for k, start in enumerate(self.truth * factors)
        ]
        self.followed = self.truth * factors

    def misfit(self, values: np.ndarray, *, early: bool = False) -> float:
        self.followed = values
        return float(np.sum(np.minimum(np.abs(np.log10(values / self.truth)).max(), 1.0)))

    def solve(self, progress, start: np.ndarray, below: float = np.inf) -> Solution:
        seen = self.misfit(start) < 1.0
        self.followed = self.truth if seen else start
        return Solution(self.truth if seen else start, np.zeros(0), np.zeros((0, 3)), np.zeros(0), 0, 0)


@pytest.mark.parametrize("factors", [(10.0, 10.0, 10.0), (0.1, 12.0, 0.1), (15.0, 1.0, 1.0)])
def test_searches_begin_elsewhere_where_no_single_change_is_seen(factors):
    problem = Plateau(factors)
    stuck = problem.solve(None, np.array([unknown.start for unknown in problem.unknowns]))
    assert problem.misfit(stuck.values) == 1.0
    assert restarted(problem, stuck).values == pytest.approx(Plateau.truth)
    assert problem.followed == pytest.approx(Plateau.truth)


def test_a_minimum_that_is_the_least_stays():
    problem = Plateau((1.0, 1.0, 1.0))
    first = problem.solve(None, Plateau.truth)
    assert restarted(problem, first) is first
    assert problem.followed is Plateau.truth  # wherever the scan has been


@pytest.mark.parametrize(
    ("share", "sigma", "local"), [(0.09, None, False), (0.11, None, True), (0.11, 0.02, False), (0.3, 0.02, True)]
)
def test_a_fit_is_another_minimum_only_where_it_misses_a_tenth_of_the_motion(share, sigma, local):
    """Readings that scatter by one, missed by a share of it to either side; less than what is stated says nothing."""
    turns = np.tile([1.0, -1.0], 4)
    readings = [Reading("x", 0.1 * turns, sigma=sigma), Reading("y", np.zeros(8), sigma=sigma)]
    poses = Poses(readings, {"load_1_y": np.zeros(8)})
    unknowns = read_unknowns(loaded_scene(), ["bending_stiffness"])
    problem = FitProblem([PosesBlock(loaded_scene(), poses, unknowns)], unknowns)
    predictions = problem.measured * (1.0 + share)
    assert may_be_local(problem, Solution(np.ones(1), predictions, np.ones((16, 1)), np.ones(16), 0, 0)) is local


@pytest.mark.parametrize("factor", [0.03, 30.0])
def test_starts_far_off_accuse_no_good_data(factor):
    scene = loaded_scene()
    forces = np.array([0.0, 0.1, 0.25, 0.4])
    tips = np.array([elastica(force) for force in forces])
    poses = weighed(tips, forces)
    fit = cg.identify(scene, poses, parameters=[Estimate(name="bending_stiffness", start=factor * STIFFNESS)])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-3)
    assert (fit.status, fit.causes) == ("converged", ())
