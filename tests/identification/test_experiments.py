"""Experiments that are proposed, against closed forms of linear problems, brute force, and fits of what they give."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import continuum_grasp as cg
from continuum_grasp.addons.identification import IdentifyScene, Poses, Reading, design_experiments
from continuum_grasp.base import InputError
from continuum_grasp.cli import app
from continuum_grasp.results import yaml_text

LENGTH, STIFFNESS, SIGMA = 0.2, 0.005, 0.01
MOMENT = {"name": "tip_moment", "column": "moment [N m]", "choices": [0.0, 0.005, 0.01, 0.02]}
ANGLE = {"quantity": "angle", "column": "angle", "sigma": SIGMA}


def scene(estimate: list[dict], conditions=(MOMENT,), measured=(ANGLE,), propose=4, **keys) -> IdentifyScene:
    """A rod that a moment at its tip bends by M L / (E I)."""
    own = {"kind": "static", "propose": propose, "conditions": list(conditions), "measured": list(measured), **keys}
    return IdentifyScene(
        finger={"rod": {"length": LENGTH, "linear_density": 0.03, "bending_stiffness": STIFFNESS}},
        gravity=(0.0, 0.0),
        fidelity={"family": "arc", "elements": 1},
        estimate=estimate,
        data=[own],
    )


def moments(plan) -> list[float]:
    return sorted(float(row[plan.pose_headings.index("moment [N m]")]) for row in plan.pose_rows)


# -- the choice -------------------------------------------------------------------------------------------------------


# -- poses ------------------------------------------------------------------------------------------------------------


def test_a_stiffness_is_shown_by_the_greatest_moment():
    """Of n rows at the moment M the deviation is sigma (E I)^2 / (M L sqrt(n)); what is known beforehand adds up."""
    plan = design_experiments(scene([{"name": "bending_stiffness"}]))
    one = SIGMA * STIFFNESS**2 / (0.02 * LENGTH)
    assert moments(plan) == [0.02] * 4
    assert plan.deviations[0] == pytest.approx(one / 2.0, rel=1e-9)
    assert np.isinf(plan.before[0])
    assert plan.shares.tolist() == [[0.25] * 4]
    known = design_experiments(scene([{"name": "bending_stiffness", "sigma": one}]))
    assert known.before[0] == pytest.approx(one, rel=1e-9)
    assert known.deviations[0] == pytest.approx(one / np.sqrt(5.0), rel=1e-9)


@pytest.mark.parametrize("per", ["all", "set"])
def test_a_clamp_takes_rows_of_its_own(per):
    """Intercept and slope; what is of one set alone does not count, but has to be found all the same."""
    plan = design_experiments(scene([{"name": "bending_stiffness"}, {"name": "clamp_angle", "per": per}]))
    found = np.array(moments(plan))
    assert set(found) == {0.0, 0.02}
    slopes = np.stack([-found * LENGTH / STIFFNESS**2, np.ones(4)], axis=1) / SIGMA
    expected = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    assert plan.deviations == pytest.approx(expected[: len(plan.names)], rel=1e-6)
    assert plan.names == ("bending_stiffness", "clamp_angle")[: 2 if per == "all" else 1]


def test_what_is_measured_already_is_added():
    """The information of rows that were fitted, at the values that they gave, and their scatter."""
    given = scene([{"name": "bending_stiffness"}])
    moment, noise = np.array([0.005, 0.01, 0.02, 0.02]), 0.01 * np.array([1.0, -1.0, 0.5, -0.5])
    data = Poses([Reading("angle", moment * LENGTH / 0.006 + noise, sigma=SIGMA)], {"tip_moment": moment})
    fit = cg.identify(given, data, parameters=["bending_stiffness"])
    plan = design_experiments(given, data)
    slopes = np.array([*moment, *[0.02] * 4]) * LENGTH / fit["bending_stiffness"] ** 2 / SIGMA
    assert plan.values[0] == fit["bending_stiffness"]
    assert plan.before[0] == pytest.approx(1.0 / np.linalg.norm(slopes[:4]), rel=1e-6)
    assert plan.deviations[0] == pytest.approx(1.0 / np.linalg.norm(slopes), rel=1e-6)
    unstated = scene([{"name": "bending_stiffness"}], measured=[{"quantity": "angle", "column": "angle"}])
    scattered = design_experiments(unstated, Poses([Reading("angle", data.measured[0].values)], data.conditions))
    left = fit.residuals
    assert scattered.before[0] == pytest.approx(plan.before[0] * np.sqrt(left @ left / 3.0) / SIGMA, rel=1e-3)
    with pytest.raises(InputError, match=r"predicted deviations need .* \(--data\)") as error:
        design_experiments(unstated)
    assert error.value.key == "data[0].measured[0].sigma"


def test_what_no_experiment_shows_is_said():
    plan = design_experiments(scene([{"name": "bending_stiffness"}, {"name": "linear_density"}]))
    assert plan.status == "not shown"
    assert any("no possible experiment shows linear_density" in one for one in plan.warnings)
    assert plan.shown_by == ("pose 1", "none")
    assert np.isinf(plan.deviations[1])
    assert np.isfinite(plan.deviations[0])


def test_poses_beyond_the_bending_range_are_not_proposed():
    far = MOMENT | {"choices": [0.0, 0.02, 5.0]}
    plan = design_experiments(scene([{"name": "bending_stiffness"}], conditions=[far]))
    assert moments(plan) == [0.02] * 4
    assert plan.statistics["offered"] == 2
    with pytest.raises(InputError, match="no choice of the conditions has an equilibrium"):
        design_experiments(scene([{"name": "bending_stiffness"}], conditions=[MOMENT | {"choices": [5.0]}]))


def test_shapes_that_may_buckle_are_not_proposed():
    """Above Euler's load pi^2 E I / (4 L^2) a straight rod does not stand, nor close to it if it is 20 % softer."""
    euler = np.pi**2 * STIFFNESS / (4.0 * LENGTH**2)
    shares = [0.0, 0.7, 0.9, 1.1]
    push = {"name": "load_1_y", "column": "push", "scale": -euler, "choices": shares}
    given = scene(
        [{"name": "bending_stiffness"}], [push], [{"quantity": "y", "column": "y", "sigma": 1e-4}], propose=20
    )
    loaded = given.changed({"loads": [{"kind": "force", "at": LENGTH, "force": [0.0, 0.0]}], "fidelity.elements": 8})
    assert design_experiments(loaded).statistics["offered"] == 2


def test_the_table_reads_back(tmp_path):
    """Filled in with what a stiffer rod does, in units and rows of the set; identify then finds that rod."""
    where = [{"column": "remark", "equals": ["good"]}]
    conditions = [{"name": "tip_moment", "column": "moment [mN m]", "scale": -1.0, "choices": [0.0, -10.0, -20.0]}]
    measured = [{"quantity": "bend", "column": "bend [deg]", "sigma": SIGMA}]
    given = scene([{"name": "bending_stiffness"}], conditions, measured, propose=3, where=where, name="rod")
    plan = design_experiments(given)
    plan.save(tmp_path)
    table = (tmp_path / "poses.csv").read_text().splitlines()
    assert table == ["set,remark,moment [mN m],bend [deg]", *["rod,good,-20,"] * 3]
    with pytest.raises(InputError, match="the cell is empty"):
        cg.identify(tmp_path / "experiments.yaml")
    bend = np.degrees(0.02 * LENGTH / 0.006)
    (tmp_path / "poses.csv").write_text("\n".join([table[0], *(f"{row}{bend}" for row in table[1:])]))
    fit = cg.identify(tmp_path / "experiments.yaml")
    assert fit["bending_stiffness"] == pytest.approx(0.006, rel=1e-9)
    assert fit.blocks == (("rod, proposed", 3),)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"propose": None}, "conditions.*choices: needs propose"),
        ({"sequence": True}, "takes rows reached by themselves"),
    ],
)
def test_choices_have_their_place(changes, match):
    with pytest.raises(InputError, match=match):
        scene([{"name": "bending_stiffness"}], **changes)


def test_what_cannot_be_designed_is_refused():
    bare = {key: value for key, value in MOMENT.items() if key != "choices"}
    with pytest.raises(InputError, match="expected choices for tip_moment"):
        design_experiments(scene([{"name": "bending_stiffness"}], conditions=[bare]))
    with pytest.raises(InputError, match="there is nothing to design"):
        design_experiments(scene([{"name": "bending_stiffness"}], conditions=[bare], propose=None))
    many = MOMENT | {"choices": np.linspace(0.0, 0.02, 6000).tolist()}
    with pytest.raises(InputError, match="make 6000 rows"):
        design_experiments(scene([{"name": "bending_stiffness"}], conditions=[many]))


def test_the_command(tmp_path):
    config = tmp_path / "rod.yaml"
    unseen = scene([{"name": "bending_stiffness"}, {"name": "linear_density"}])
    config.write_text(yaml_text({"schema_version": 1, **unseen.model_dump(mode="json", exclude_unset=True)}))
    run = CliRunner().invoke(app, ["identify", str(config), "--design", "--out", str(tmp_path / "run")])
    assert run.exit_code == 1, run.output
    assert "pose 4" in run.output
    assert "no possible experiment shows linear_density" in run.output
    seen = [*("identify", str(config), "--design", "--out"), str(tmp_path / "run")]
    run = CliRunner().invoke(app, [*seen, "--set", "estimate=[{name: bending_stiffness}]"])
    assert run.exit_code == 0, run.output
    assert "+/- inf" in run.output
    assert CliRunner().invoke(app, [*seen, "--apply", str(config)]).exit_code == 2


@pytest.mark.deep
def test_promised_intervals_hold():
    """Of 200 rods that the design did not know, with noise: errors per promised deviation scatter by one."""
    estimate = [{"name": "bending_stiffness"}, {"name": "clamp_angle"}]
    given = scene(estimate, propose=6)
    plan = design_experiments(given)
    moment, rng, missed = np.array(moments(plan)), np.random.default_rng(0), []
    for _ in range(200):
        stiffness, clamp = STIFFNESS * rng.uniform(0.8, 1.25), rng.uniform(-0.1, 0.1)
        angle = clamp + moment * LENGTH / stiffness + SIGMA * rng.standard_normal(moment.size)
        fit = cg.identify(given, Poses([Reading("angle", angle, sigma=SIGMA)], {"tip_moment": moment}))
        scaled = plan.deviations * [(stiffness / STIFFNESS) ** 2, 1.0]
        missed.append((fit.values - [stiffness, clamp]) / scaled)
    assert np.sqrt(np.mean(np.square(missed), axis=0)) == pytest.approx([1.0, 1.0], abs=0.15)
