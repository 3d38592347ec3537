"""Drives and friction with memory; from inside: predictions and slopes of one set, and one pattern of commands.

Drives and friction with memory: derivatives, known parameters from the chain of guides, commands that show them.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import Estimate, IdentifyScene, Poses, Reading, TipPath, design_experiments
from continuum_grasp.addons.identification.blocks import PosesBlock
from continuum_grasp.addons.identification.experiment_plan import commands_text, scene_text
from continuum_grasp.addons.identification.path_block import PathBlock
from continuum_grasp.addons.identification.segments import base_of, patterns_of
from continuum_grasp.addons.identification.unknowns import read_unknowns
from continuum_grasp.base import InputError
from continuum_grasp.simulation import initial_state
from tests.control_cases import DRIVES
from tests.identification_cases import at_tip, coverage, slope_error
from tests.tendon_cases import LENGTH, OFFSET, PASSIVE, STIFFNESS
from tests.truth.tendon_motion import MovingFinger

TENDONS = {"offset": OFFSET, "max_tension": 40.0, "axial_stiffness": 1e4, "series_stiffness": 3.3e4}
WINCHES = {"kind": "length", "time_constant": 0.02, "rate_max": 0.1, "pretension": 6.0}
MOTOR = DRIVES["servo"][0] | {"pretension": 3.0}
TIMES = [0.0, 0.1, 0.17, 0.25]


def driven(drive: dict, key: str, values: list, friction: float = 0.15, **keys) -> cg.Scene:
    actuation = {key: [{"times": TIMES, "values": one} for one in values] if values else [0.0, 0.0]}
    return cg.Scene(
        finger=PASSIVE | {"tendons": TENDONS | {"friction": friction, "drive": drive}},
        gravity=(0.0, 0.0),
        fidelity={"family": "arc", "elements": 2},
        actuation=actuation,
        **keys,
    )


def read(*readings: tuple[str, int], count: int) -> list[Reading]:
    return [Reading(quantity, np.zeros(count), of=of) for quantity, of in readings]


@pytest.mark.deep
@pytest.mark.parametrize(
    ("scene", "names", "readings"),
    [
        (
            driven(WINCHES, "lengths", [[0.0, 8e-3, 3e-3, 6e-3], [0.0, -8e-3, -3e-3, -6e-3]]),
            "bending_stiffness tendon_friction tendon_presliding tendon_axial_stiffness tendon_series_stiffness "
            "drive_pretension drive_time_constant drive_delay",
            [("tension", 1), ("tension", 2), ("length", 2)],
        ),
        (
            driven(MOTOR, "angles", [[0.0, 0.9, 0.3, 0.7]]),
            "tendon_friction drive_pretension drive_inertia drive_viscous_friction drive_coulomb_friction drive_delay",
            [("motor_angle", 1), ("torque", 1), ("tension", 2)],
        ),
    ],
)
def test_derivatives_of_motions_with_friction_states(scene, names, readings):
    """As exactly as differences tell across the instants at which friction turns."""
    t = np.linspace(0.0, 0.25, 26)[1:]
    none = np.zeros(t.size)
    unknowns = read_unknowns(scene, names.split())
    block = PathBlock(scene, TipPath(t, [*at_tip(none, none), *read(*readings, count=t.size)]), unknowns)
    at = np.array([0.01 if one.name == "drive_delay" else one.start for one in unknowns])
    errors = slope_error(block, at, np.array([one.typical for one in unknowns]))
    assert errors.max() < 2e-3
    assert errors.min() < 1e-6


@pytest.mark.parametrize(
    ("bend", "history"),
    [
        (0.4, {"reached_by": "pulling"}),
        (1e-3, {"reached_by": "releasing"}),  # within the presliding: all has slid back all the same
        (0.4, {"reached_by": "state", "friction_states": [0.4, -0.2, 1.0, 0.0]}),
        (0.4, {}),
    ],
)
def test_friction_at_a_start_is_that_of_a_simulation(bend, history):
    scene = driven(WINCHES, "lengths", [], initial={"q": [bend, 0.5 * bend], **history})
    own = PathBlock(scene, TipPath([0.01, 0.02], at_tip([0.0, 0.0], [0.0, 0.0])), ())
    found, _ = own._begin(np.zeros(0), 0.0, np.array(own.model.p_nominal))
    # 1e-7: at a flat end of the cubic a state is as inexact as the root of rounding.
    assert found == pytest.approx(initial_state(scene, own.model), rel=1e-7, abs=1e-7)
    if history.get("reached_by") == "releasing":
        assert found[-4:] == pytest.approx(-np.ones(4))


def test_derivatives_of_rows_that_follow_one_another():
    scene = driven(WINCHES, "lengths", [])
    wound = np.array([2e-3, 6e-3, 5.985e-3, 1e-3, 1.02e-3])  # partly within presliding
    none = np.zeros(wound.size)
    data = Poses(
        [Reading("x", none), *read(("tension", 1), ("tension", 2), count=wound.size)],
        {"length_1": wound, "length_2": -wound},
        sequence=True,
    )
    names = ["bending_stiffness", "tendon_friction", "tendon_presliding", "tendon_series_stiffness", "drive_pretension"]
    unknowns = read_unknowns(scene, names)
    block = PosesBlock(scene, data, unknowns)
    sizes = np.array([one.typical for one in unknowns])
    assert slope_error(block, np.array([one.start for one in unknowns]), sizes).max() < 1e-7


def guided(friction: float, **keys) -> MovingFinger:
    return MovingFinger(
        LENGTH, STIFFNESS, OFFSET, friction, axial_stiffness=1e4, series_compliance=1 / 3.3e4, hinges=24, **keys
    )


@pytest.mark.deep
def test_a_slow_loop_of_the_chain_of_guides_gives_its_friction_and_elasticity():
    chain = guided(0.15, density=1e-9, damping=1e-12, tip_mass=0.0, time_step=1.0)
    taut = 6.0 * (1 / 3.3e4 + LENGTH / 1e4)
    chain.start([("length", taut)] * 2)
    turns, wound, rows = [0.0, 6e-3, 1e-3, 5e-3, 0.0], [], []
    for start, end in pairwise(turns):
        for k, y in enumerate(np.linspace(start, end, 33)[1:]):
            chain.advance([("length", taut + y), ("length", taut - y)])
            if k % 4 == 3:
                wound.append(y)
                rows.append([*chain.tip, *chain.tensions])
    x, y, first, second = np.array(rows).T
    readings = [
        Reading("x", x, sigma=2e-4),
        Reading("y", y, sigma=2e-4),
        Reading("tension", first, sigma=0.05, of=1),
        Reading("tension", second, sigma=0.05, of=2),
    ]
    data = Poses(readings, {"length_1": wound, "length_2": [-y for y in wound]}, sequence=True)
    scene = driven(WINCHES, "lengths", []).changed({"fidelity.family": "clothoid"})
    starts = {"bending_stiffness": 9e-3, "tendon_friction": 0.05, "tendon_series_stiffness": 1e4, "drive_pretension": 1}
    fit = cg.identify(scene, data, parameters=[Estimate(name=name, start=start) for name, start in starts.items()])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=2e-3)
    assert fit["tendon_friction"] == pytest.approx(0.15, abs=0.004)
    assert fit["drive_pretension"] == pytest.approx(6.0, rel=2e-3)
    # At rest the sliding by elongation is left out.
    assert fit["tendon_series_stiffness"] == pytest.approx(3.3e4, rel=0.08)
    applied = fit.apply().finger.tendons
    assert (applied.friction, applied.series_stiffness) == (fit["tendon_friction"], fit["tendon_series_stiffness"])
    assert applied.drive.pretension == fit["drive_pretension"]
    # Rows by themselves, all of them pulled, do not close that loop.
    alone = Poses(readings, data.conditions)
    apart = cg.identify(scene, alone, parameters=["tendon_friction"])
    assert apart.errors[2].rms > 20.0 * fit.errors[2].rms


@pytest.mark.deep
def test_intervals_of_friction_and_pretension_cover_the_truth():
    scene = driven(WINCHES, "lengths", []).changed({"fidelity.elements": 1})
    wound = np.array([2e-3, 6e-3, 3e-3, 1e-3, 5e-3, 2e-3])
    conditions = {"length_1": wound, "length_2": -wound}
    data = Poses(read(("tension", 1), ("tension", 2), count=wound.size), conditions, sequence=True)
    unknowns = read_unknowns(scene, ["tendon_friction", "drive_pretension"])
    truth = [one.start for one in unknowns]
    values = PosesBlock(scene, data, unknowns).predict(np.array(truth))[0].reshape(-1, 2)
    exact = Poses(
        [Reading("tension", values[:, 0], of=1), Reading("tension", values[:, 1], of=2)],
        conditions,
        sequence=True,
    )
    hits = coverage([PosesBlock(scene, exact, unknowns)], unknowns, truth, 0.05, 60)
    # 95 %, three standard deviations of 60 repeats
    assert np.all(hits >= 52)


# -- commands that show the unknowns ----------------------------------------------------------------------------------


def loop(drive: dict, names: list[str], measured: list[dict], **keys) -> IdentifyScene:
    return IdentifyScene(
        finger=PASSIVE | {"tendons": TENDONS | {"friction": 0.15, "drive": drive}},
        gravity=(0.0, 0.0),
        fidelity={"family": "arc", "elements": 1},
        estimate=[{"name": name} for name in names],
        data=[{"kind": "trajectory", "measured": measured, **keys}],
        excitation={"duration": 3.0, "sample": 0.015, "reach": 0.5},
    )


@pytest.mark.parametrize("side", [0, 1])
def test_the_other_winch_pays_out_what_its_tendon_needs(side):
    """Without friction the tendon of the other side stays at its pretension, however far the finger is bent."""
    scene = driven(WINCHES, "lengths", [], friction=0.0)
    pattern = patterns_of(scene)[side]
    commands = base_of(scene) + 5e-3 * pattern.commands
    pulled = cg.equilibrium(scene.changed({"actuation": {"lengths": commands.tolist()}}))
    assert pulled.tensions[1 - side] == pytest.approx(WINCHES["pretension"], rel=1e-9)
    assert pulled.tensions[side] > 2.0 * WINCHES["pretension"]


@pytest.mark.deep
def test_commands_stay_within_limits_and_predict_what_a_fit_reports():
    """The deviations beforehand are those of a fit to readings with that noise, and hold for many repeats."""
    measured = [{"quantity": one, "column": one, "sigma": 3e-4} for one in "xy"]
    measured.append({"quantity": "tension", "column": "T", "sigma": 0.1})
    scene = loop(WINCHES, ["tendon_friction", "drive_time_constant"], measured)
    plan = design_experiments(scene)
    assert plan.rehearsal.tensions.max() < 40.0
    assert not any("bending range" in one or "cannot see" in one for one in plan.warnings)
    assert plan.segments[0].name == "hold"
    assert plan.segments[-1].end == pytest.approx(3.0)
    rng = np.random.default_rng(2)
    motion = plan.rehearsal
    noisy = [
        values + sigma * rng.standard_normal(values.size)
        for values, sigma in ((motion.tip[1:, 0], 3e-4), (motion.tip[1:, 1], 3e-4), (motion.tensions[1:, 0], 0.1))
    ]
    path = TipPath(motion.t[1:], [*at_tip(*noisy[:2], 3e-4), Reading("tension", noisy[2], sigma=0.1, of=1)])
    fit = cg.identify(plan.scene, path, parameters=list(plan.names))
    assert fit.deviations == pytest.approx(plan.deviations, rel=0.1)
    assert np.all(np.abs(fit.values - plan.values) < 4.0 * plan.deviations)


def test_commands_say_what_they_cannot_show():
    measured = [{"quantity": "length", "column": "y", "sigma": 1e-5}]
    plan = design_experiments(loop(WINCHES, ["tendon_friction", "drive_time_constant"], measured))
    assert any("these experiments cannot see tendon_friction" in one for one in plan.warnings)
    assert math.isinf(plan.deviations[0])
    assert plan.shown_by[0] == "none"
    rows = commands_text(plan).splitlines()
    assert rows[0] == "t [s],length_1 [m],length_2 [m]"
    assert len(rows) == 202
    assert scene_text(plan).startswith("# 0 to ")


def test_a_design_needs_readings_of_known_scatter():
    scene = loop(WINCHES, ["tendon_friction"], [{"quantity": "tension", "column": "T"}])
    with pytest.raises(InputError, match="predicted deviations need") as error:
        design_experiments(scene)
    assert error.value.key == "data[0].measured[0].sigma"


# -- what reads the result --------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_simulation_and_closed_loop_read_what_was_identified(tmp_path):
    """A pull of commanded tensions with delay: the finger of the fit in a simulation, its delay in the estimator."""
    tendons = {"offset": OFFSET, "max_tension": 40.0, "time_constant": 0.03}
    pull = {"times": TIMES, "values": [1.0, 6.0, 2.0, 5.0]}
    late = {"times": [at + 0.02 for at in TIMES], "values": pull["values"]}
    scene = cg.Scene(
        finger=PASSIVE | {"tendons": tendons},
        gravity=(0.0, 0.0),
        fidelity={"family": "clothoid", "elements": 1},
        actuation={"tensions": [pull, 1.0]},
        time={"duration": 0.3, "step": 0.005},
    )
    true = cg.simulate(scene.changed({"actuation.tensions": [late, 1.0]}))
    path = TipPath(true.t[1:], at_tip(*true.tip[1:].T))
    fit = cg.identify(scene, path, parameters=[Estimate(name="drive_time_constant", start=0.02), "drive_delay"])
    assert fit["drive_delay"] == pytest.approx(0.02, abs=1e-4)
    file = fit.save(tmp_path) / "identified_finger.yaml"
    own = scene.changed({"finger": cg.load(file)})
    assert own.finger.tendons.time_constant == fit["drive_time_constant"]
    assert cg.simulate(own).tip == pytest.approx(cg.simulate(fit.apply(scene)).tip, abs=1e-9)
    loop_scene = cg.load("configs/mpc/tip_arc.yaml")
    applied = fit.apply(loop_scene)
    assert applied.finger.tendons.time_constant == fit["drive_time_constant"]
    assert applied.estimator.delay == pytest.approx(0.02)
    assert cg.Controller(applied).step([0.0, 0.18, 1.0, 1.0]).status is not None
