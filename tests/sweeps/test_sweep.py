"""Configurations of sweeps: which scenes they mean, and what is refused where."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from continuum_grasp.addons.sweeps import SweepPlan
from continuum_grasp.base import InputError
from continuum_grasp.scene import load
from tests.sweep_cases import MUG, ROOT

FINGER = ROOT / "configs" / "fingers" / "hand_finger.yaml"
HEAD = f"schema_version: 1\nscene: {MUG}\n"


def plan(**more):
    return SweepPlan.of({"scene": str(MUG), **more})


def sampled(count=500, method="random", seed=0, **keys):
    return plan(sample={"count": count, "seed": seed, "method": method, "keys": keys})


def column(found, key):
    k = found.keys.index(key)
    return np.array([point.labels[k] for point in found])


def test_a_grid_tries_all_combinations_the_last_key_fastest():
    found = plan(
        vary={
            "object.diameter": {"min": 0.06, "max": 0.10, "count": 3},
            "contacts.friction": {"values": [0.3, 0.5]},
        }
    )
    assert [point.values for point in found] == [
        (0.06, 0.3),
        (0.06, 0.5),
        (0.08, 0.3),
        (0.08, 0.5),
        (0.1, 0.3),
        (0.1, 0.5),
    ]
    assert [point.index for point in found] == list(range(6))
    assert found.units["object.diameter"] == "m"
    assert found.units["contacts.friction"] == ""


@pytest.mark.parametrize(
    ("given", "values"),
    [
        ({"min": 0.0, "max": 0.3, "count": 4}, (0.0, 0.1, 0.2, 0.3)),
        ({"min": 2.0, "max": 4.0, "count": 3}, (2, 3, 4)),
        ({"min": 1e-3, "max": 1.0, "count": 4, "spacing": "log"}, (0.001, 0.01, 0.1, 1.0)),
        ({"min": -3.0, "max": -1.5, "count": 2}, (-3.0, -1.5)),
    ],
)
def test_spaced_values(given, values):
    listed = tuple(point.labels[0] for point in plan(vary={"object.angle": given}))
    assert listed == values
    assert [type(value) for value in listed] == [type(value) for value in values]


def test_a_key_follows_another():
    found = plan(
        vary={"object.diameter": {"values": [0.06, 0.10]}},
        follow={"object.position[0]": {"key": "object.diameter", "times": 0.5, "plus": 0.001}},
    )
    assert [point.values for point in found] == [(0.06, 0.031), (0.1, 0.051)]


def test_draws_have_the_distributions_that_were_asked_for():
    found = sampled(
        4000,
        **{
            "object.diameter": {"uniform": [0.06, 0.10]},
            "object.mass": {"log_uniform": [0.01, 1.0]},
            "contacts.friction": {"normal": [0.5, 0.1]},
            "objective": {"choice": ["least_tension", "least_normal_force"]},
        },
    )
    limit = 1.95 / math.sqrt(4000)  # of the Kolmogorov-Smirnov distance, at a level of 0.001
    assert distance((column(found, "object.diameter") - 0.06) / 0.04) < limit
    assert distance(np.log(column(found, "object.mass") / 0.01) / math.log(100.0)) < limit
    assert distance([NormalDist(0.5, 0.1).cdf(v) for v in column(found, "contacts.friction")]) < limit
    words, counts = np.unique(column(found, "objective"), return_counts=True)
    assert list(words) == ["least_normal_force", "least_tension"]
    assert abs(counts[0] - 2000) < 4 * math.sqrt(1000)
    pairs = np.corrcoef(column(found, "object.diameter"), column(found, "object.mass"))
    assert abs(pairs[0, 1]) < 4 / math.sqrt(4000)


def distance(shares):
    """Greatest distance of an empirical distribution from the uniform one on 0 to 1."""
    shares = np.sort(shares)
    steps = np.arange(len(shares) + 1) / len(shares)
    return max(np.abs(shares - steps[:-1]).max(), np.abs(shares - steps[1:]).max())


def test_halton_points_are_radical_inverses_from_the_second_on_shifted_alike():
    """In bases 2 and 3; the first would be the corner 0."""
    keys = {"object.diameter": {"uniform": [0.25, 1.25]}, "contacts.friction": {"uniform": [0.0, 1.0]}}
    inverses = [1 / 2, 1 / 4, 3 / 4, 1 / 8, 5 / 8], [1 / 3, 2 / 3, 1 / 9, 4 / 9, 7 / 9]
    found = sampled(5, "halton", **keys)
    for key, inverse in zip(keys, inverses, strict=True):
        shift = column(found, key) - inverse
        turns = shift - shift[0]
        assert turns == pytest.approx(np.round(turns), abs=1e-12)


@pytest.mark.parametrize("method", ["random", "halton"])
def test_draws_are_the_same_again_and_begin_alike_for_a_greater_count(method):
    keys = {"object.diameter": {"uniform": [0.06, 0.10]}, "object.mass": {"normal": [0.3, 0.1]}}
    few, many, other = sampled(50, method, **keys), sampled(5000, method, **keys), sampled(50, method, seed=1, **keys)
    assert [p.values for p in few] == [many.point(k).values for k in range(50)]
    backwards = [few.point(k).values for k in reversed(range(50))]
    assert backwards[::-1] == [p.values for p in sampled(50, method, **keys)]
    assert column(few, "object.mass")[0] != column(other, "object.mass")[0]
    assert len(set(column(many, "object.mass"))) == 5000


def test_every_point_of_a_grid_meets_the_same_draws():
    found = plan(
        vary={"contacts.friction": {"values": [0.3, 0.5]}},
        sample={"count": 3, "keys": {"object.mass": {"uniform": [0.1, 0.2]}}},
    )
    drawn = column(found, "object.mass")
    assert len(found) == 6
    assert list(column(found, "contacts.friction")) == [0.3] * 3 + [0.5] * 3
    assert list(drawn[:3]) == list(drawn[3:])


def test_the_scene_of_a_point_is_what_the_file_with_overrides_is():
    more = {
        "set": {"solver.effort": "quick"},
        "vary": {
            "finger": {"values": [str(FINGER), {"extends": str(FINGER), "strain_limit": 0.03}]},
            "finger.base.position": {"values": [[0.0, -0.06]]},
            "object.mass": {"values": [0.4]},
        },
    }
    found = plan(**more)
    for index, extra in enumerate([{}, {"finger.strain_limit": 0.03}]):
        data = found.data_of(found.point(index))
        scene = type(load(MUG)).model_validate(data)
        same = {
            "finger": str(FINGER),
            "finger.base.position": [0.0, -0.06],
            "object.mass": 0.4,
            "solver.effort": "quick",
        }
        assert scene == load(MUG, {**same, **extra})
    assert found.point(0).labels[0] == str(FINGER)


WRONG = {
    "unknown key of the scene": ("vary:\n  object.diametre: {values: [1]}", "4:30: object.diametre: unknown key"),
    "out of range": ("vary:\n  object.mass: {min: -1, max: 1, count: 3}", "4:16: object.mass: out of range"),
    "no way": ("vary:\n  object.mass: {spacing: log}", "give either values, or min, max and count"),
    "reversed": ("vary:\n  object.mass: {min: 3, max: 1, count: 3}", "min = 3 is not below max = 1"),
    "log through zero": ("vary:\n  object.mass: {min: 0, max: 3, count: 3, spacing: log}", "of one sign"),
    "unknown key": ("vary:\n  object.mass: {value: [1]}", "4:17: vary.object.mass.value: unknown key; did you mean"),
    "nothing varied": ("", "give vary, sample, or both"),
    "twice": (
        "vary: {object.mass: {values: [1]}}\nsample: {count: 1, keys: {object.mass: {uniform: [1, 2]}}}",
        "'object.mass' is given twice",
    ),
    "index": ("vary:\n  object.position[2]: {values: [1]}", "no entry [2]: object.position has 2 entries"),
    "no path": ("vary:\n  object..mass: {values: [1]}", "expected a key path"),
    "follows nothing": (
        "vary: {object.mass: {values: [1]}}\nfollow: {object.angle: {key: object.diameter}}",
        "which is not varied",
    ),
    "map of nothing": (
        "vary: {object.mass: {values: [1]}}\nmaps: [{x: object.mass, y: tension, color: seconds}]",
        "maps[0].y: no such column: 'tension'; did you mean 'tension_",
    ),
    "recorded": ("vary: {object.mass: {values: [1]}}\nrecord: [status]", "must be quality., certificate. or"),
    "decreasing": ("sample: {count: 1, keys: {object.mass: {uniform: [2, 1]}}}", "uniform must increase"),
    "two draws": (
        "sample: {count: 1, keys: {object.mass: {uniform: [1, 2], normal: [1, 1]}}}",
        "give exactly one of uniform, log_uniform, normal and choice",
    ),
    "too many": (
        "vary: {object.mass: {min: 1, max: 2, count: 99999}, object.angle: {min: 1, max: 2, count: 99999}}",
        "scenes; the limit is 10000000",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_said_with_its_place(name, tmp_path):
    text, words = WRONG[name]
    file = tmp_path / "sweep.yaml"
    file.write_text(HEAD + text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load(file)
    assert words in str(caught.value)
    assert caught.value.file == str(file)


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ("nowhere.yaml", ":2:8: scene: no such file"),
        (ROOT / "configs/simulate/nitinol_release_020g.yaml", "expected a grasp"),
    ],
)
def test_the_scene_must_be_a_grasp(scene, words, tmp_path):
    file = tmp_path / "sweep.yaml"
    file.write_text(f"schema_version: 1\nscene: {scene}\nvary: {{object.mass: {{values: [1]}}}}\n", encoding="utf-8")
    with pytest.raises(InputError, match=words):
        load(file)


def test_paths_are_relative_to_the_file_of_the_sweep(tmp_path):
    (tmp_path / "scene.yaml").write_text(MUG.read_text().replace("../fingers/hand_finger.yaml", str(FINGER)))
    (tmp_path / "soft.yaml").write_text(FINGER.read_text().replace("6.11e-3", "5.0e-3"))
    text = "schema_version: 1\nscene: scene.yaml\nvary: {finger: {values: [{extends: soft.yaml}]}}\n"
    (tmp_path / "sweep.yaml").write_text(text)
    found = SweepPlan.of(tmp_path / "sweep.yaml", ["set={object.mass: 0.5}"])
    assert found.point(0).values[0]["rod"]["bending_stiffness"] == 5.0e-3
    assert found.variation.base["object"]["mass"] == 0.5
