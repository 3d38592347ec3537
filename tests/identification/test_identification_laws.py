"""Wrong laws of stiffness and damping are reported; from inside: solutions made here are judged.

Wrong laws of stiffness and damping are reported, right ones are not: data of other equations than the package's.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.addons.identification import Poses, Reading, TipPath
from continuum_grasp.addons.identification.blocks import PosesBlock
from continuum_grasp.addons.identification.doubts import _of_law, _widths, doubts_of_laws
from continuum_grasp.addons.identification.path_block import PathBlock
from continuum_grasp.addons.identification.problem import FitProblem, Solution
from continuum_grasp.addons.identification.unknowns import read_unknowns
from continuum_grasp.scene import Scene
from tests.identification_cases import (
    LENGTH,
    ROD,
    STIFFNESS,
    at_tip,
    bare_scene,
    bent,
    built_once,
    elastica,
    loaded_scene,
    weighed,
)
from tests.marks import few
from tests.rods import rod_scene

PRINTED = rod_scene(
    {
        "length": 0.12,
        "youngs_modulus": 26.3e6,
        "density": 1200.0,
        "sections": [{"to": 0.12, "thickness": [0.012, 0.005], "width": 0.015}],
    },
    "clothoid",
    1,
    finger={"base": {"angle": -np.pi / 2}, "damping": {"material": 2e-4}},
    initial={"pose": "equilibrium", "held_by": [{"kind": "force", "at": 0.12, "force": [0.0, 1.0]}]},
    time={"duration": 0.5, "step": 0.002},
)
"""A tapered finger that hangs, is pulled aside and let go: it swings by 11 mm, three times beyond noise of 1 mm."""
SLENDER = rod_scene(
    ROD,
    "clothoid",
    1,
    gravity=(0.0, 0.0),
    finger={"damping": {"material": 4e-4}},
    initial={"pose": "equilibrium", "held_by": [{"kind": "force", "at": LENGTH, "force": [0.0, 0.05]}]},
    time={"duration": 1.5, "step": 0.01},
)
"""A rod that is let go from a bend of 40 mm."""
KNOWN = ["bending_stiffness", "material_damping"]


class Releases:
    """Noisy copies of one release, fitted with linear damping; the models are built once."""

    def __init__(self, scene: Scene, **damping: Any) -> None:
        damping = {f"finger.damping.{key}": value for key, value in damping.items()}
        if "finger.damping.dry_friction" in damping:
            damping["initial.reached_by"] = "pulling"
        run = cg.simulate(scene.changed({"fidelity.family": "clothoid", **damping}))
        self.t, self.tip, self.start = run.t[1:], run.tip[1:], run.tip[0]
        self.unknowns = read_unknowns(scene, KNOWN)
        self.problem = self.of(scene)

    def path(self, noise: float, seed: int = 0) -> TipPath:
        tip = self.tip + noise * np.random.default_rng(seed).standard_normal(self.tip.shape)
        return TipPath(self.t, at_tip(*tip.T))

    def of(self, scene: Scene) -> FitProblem:
        return FitProblem([built_once(PathBlock(scene, self.path(0.0), self.unknowns))], self.unknowns)

    def doubts(self, noise: float, seed: int) -> list[str]:
        measured = self.path(noise, seed).measured
        self.problem.measured = np.stack([one.values for one in measured], axis=1).ravel()
        return doubts_of_laws(self.problem, self.problem.solve(lambda share: None))


@pytest.mark.parametrize("noise", [1e-4, 1e-3])
@pytest.mark.parametrize("scene", [PRINTED, SLENDER], ids=["printed", "slender"])
@pytest.mark.parametrize("seeds", few([2, 300], 1))
def test_noise_alone_makes_no_law_wrong(scene, noise, seeds):
    """At most one false alarm in a hundred."""
    releases = Releases(scene)
    assert sum(bool(releases.doubts(noise, seed)) for seed in range(seeds)) <= 0.01 * seeds


@pytest.mark.parametrize(
    ("scene", "noise", "damping", "words"),
    few(
        [
            (PRINTED, 1e-4, {"quadratic": 1e-6}, "drag of the air"),
            (SLENDER, 1e-4, {"quadratic": 1e-4}, "drag of the air"),
            (SLENDER, 1e-4, {"dry_friction": [{"stiffness": 2e-3, "moment": 2e-4}]}, "dry friction"),
            (PRINTED, 1e-4, {"quadratic": 1e-5}, "drag of the air"),
            (PRINTED, 3e-4, {"quadratic": 1e-5}, "drag of the air"),
        ],
        3,
    ),
)
def test_other_laws_of_damping_are_named(scene, noise, damping, words):
    releases = Releases(scene, **damping)
    assert all(any(words in one for one in releases.doubts(noise, seed)) for seed in range(2))


@pytest.mark.parametrize("noise", few([3e-4, 1e-4], 1))
@pytest.mark.parametrize("scene", few([SLENDER, PRINTED], 1))
@pytest.mark.parametrize(
    ("rows", "shift", "words"),
    [
        (-1, 0.0, "rows of motions are late by 1"),
        (1, 0.0, "rows of motions are late by -1"),
        (0, 0.01, "positions are off along x by 0.01"),
    ],
)
def test_rows_that_are_late_and_an_origin_elsewhere_are_named(scene, noise, rows, shift, words):
    """Alone, and with their size, whatever the parameters took of it."""
    releases = Releases(scene)
    releases.tip = np.roll(releases.tip, -rows, axis=0) + np.array([shift, 0.0])
    if rows < 0:
        releases.tip[0] = releases.start
    releases.t, releases.tip = releases.t[:-1], releases.tip[:-1]
    releases.problem = releases.of(scene)
    for seed in range(2):
        (found,) = releases.doubts(noise, seed)
        said, step, deviation = re.match(r"(.*) by (\S+) \+/- (\S+) ", found).groups()
        meant, size = words.split(" by ")
        assert said == meant
        assert float(step) == pytest.approx(float(size), abs=max(4.0 * float(deviation), 0.1 * abs(float(size))))


@pytest.mark.parametrize("seeds", few([3, 300], 1))
@pytest.mark.parametrize("names", [KNOWN[:1], [KNOWN[0], "clamp_angle"]])
def test_rows_and_origins_of_shapes_at_rest(names, seeds):
    """Tips of the exact rod with noise of a millimeter: 1 % are doubted, and all of another row or origin."""
    loads = np.linspace(0.0, 0.2, 8)
    clean, scene = np.array([elastica(load)[:2] for load in loads]), loaded_scene(2)
    poses = weighed(clean, loads)
    unknowns = read_unknowns(scene, names)
    problem = FitProblem([built_once(PosesBlock(scene, poses, unknowns))], unknowns)

    def doubts(rows: np.ndarray, seed: int) -> list[str]:
        problem.measured = (rows + 1e-3 * np.random.default_rng(seed).standard_normal(clean.shape)).ravel()
        return doubts_of_laws(problem, problem.solve(lambda share: None))

    assert sum(bool(doubts(clean, seed)) for seed in range(seeds)) <= 0.01 * seeds
    late, early = np.vstack([clean[:1], clean[:-1]]), np.vstack([clean[1:], clean[-1:]])
    for seed in range(min(seeds, 20)):
        for rows, words in (
            (late, "belong to the row before"),
            (early, "belong to the row behind"),
            (clean + np.array([0.01, 0.0]), "off along x by 0.01"),
            (clean + np.array([0.0, 0.01]), "off along"),  # what the stiffness takes of it may leave an error of x
        ):
            found, (meant, _, size) = doubts(rows, seed)[0], words.partition(" by ")
            assert meant in found
            if words == "off along":
                continue
            assert float(re.search(r"by (\S+) ", found)[1]) == pytest.approx(
                float(size or 1.0), rel=0.35
            )  # one step leads near


@pytest.mark.parametrize(("share", "reported"), [(0.99, False), (1.01, True)])
def test_a_law_matters_from_a_thousandth_of_the_motion_on(share, reported):
    """Motions that are off by so much along the derivative by the law, and not at all beside it."""
    releases = Releases(SLENDER)
    problem = releases.problem
    values = np.array([one.start for one in releases.unknowns])
    predictions, jacobian = problem.predict(values)
    solution = Solution(values, predictions, jacobian, np.ones(predictions.size), 0, 0)
    laws = ("quadratic_damping", "softening_ratio")
    slope, other = (_of_law(name, problem, solution)[0][1] for name in laws)
    others = np.column_stack([jacobian, other])
    slope -= others @ np.linalg.lstsq(others, slope, rcond=None)[0]
    moved = predictions.reshape(-1, 2) - predictions.reshape(-1, 2).mean(axis=0)
    problem.measured = predictions + share * 1e-3 * np.linalg.norm(moved) / np.linalg.norm(slope) * slope
    assert bool(doubts_of_laws(problem, solution)) == reported


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda m: 8.0 * m, None),
        (lambda m: 8.0 * m + 20.0 * m**2, "softens where"),
        (lambda m: 8.0 * m - 20.0 * m**2, "stiffens where"),
        (lambda m: 8.0 * m + 0.05 * np.sign(np.gradient(m)), "the direction of loading, by 0.1"),
    ],
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stiffness_and_memory_of_shapes_at_rest(make, words, side):
    """Bends over moments, there and back, with noise of half a percent; of a mirrored finger the same is reported."""
    moments = 0.1 * np.concatenate([np.linspace(0.0, 1.0, 12), np.linspace(0.95, 0.0, 12)])
    bends = side * (make(moments) + 4e-3 * np.random.default_rng(1).standard_normal(moments.size))
    moments = side * moments
    scene = bare_scene(2, "arc")
    fit = cg.identify(scene, bent(moments, bends), parameters=["bending_stiffness"])
    warnings = [one for one in fit.warnings if "law" in one or "memory" in one]
    assert len(warnings) == (words is not None)
    assert all(words in one for one in warnings)


@pytest.mark.deep
@pytest.mark.parametrize("rows", [6, 12, 24])
def test_noise_alone_makes_no_law_of_shapes_at_rest_wrong(rows):
    """At most one false alarm in a hundred, there and back; the models are built once."""
    scene, half = bare_scene(2, "arc"), rows // 2
    moments = 0.1 * np.concatenate([np.linspace(0.0, 1.0, half), np.linspace(0.95, 0.0, rows - half)])
    poses = bent(moments, moments * LENGTH / STIFFNESS)
    unknowns, found = read_unknowns(scene, KNOWN[:1]), 0
    problem = FitProblem([built_once(PosesBlock(scene, poses, unknowns))], unknowns)
    clean = problem.measured
    for seed in range(300):
        problem.measured = clean + 4e-3 * np.random.default_rng(seed).standard_normal(rows)
        found += bool(doubts_of_laws(problem, problem.solve(lambda share: None)))
    assert found <= 3


@pytest.mark.parametrize(("back", "judged"), [(3, False), (4, True)])
def test_the_direction_of_loading_is_judged_from_four_rows_each_way_on(back, judged):
    bends = np.concatenate([np.linspace(0.0, 1.0, 8), np.linspace(0.9, 0.1, back)])
    scene = bare_scene(1, "arc")
    poses = bent(0.1 * bends, bends)
    unknowns = read_unknowns(scene, KNOWN[:1])
    problem = FitProblem([PosesBlock(scene, poses, unknowns)], unknowns)
    assert bool(_widths(problem, bends)) == judged


@pytest.mark.parametrize("softening", [None, {"curvature": 0.5, "stiffness_ratio": 0.5}])
def test_a_wrong_law_of_stiffness_is_the_one_in_use(softening):
    """Bends that grow more slowly than the moment: a finger that softens bends less than so, as a linear one does."""
    moments = np.linspace(0.0, 0.1, 14)
    bends = 8.0 * moments - 20.0 * moments**2
    scene = bare_scene(2, "arc", finger={"softening": softening})
    fit = cg.identify(scene, bent(moments, bends), parameters=["bending_stiffness"])
    (found,) = [one for one in fit.warnings if "law of stiffness" in one]
    assert "stiffens where" in found
    assert ("a linear law" in found) == (softening is None)
    assert ("with softening" in found) == (softening is not None)


def test_the_bend_of_one_joint():
    """Between two sections: moment times length over stiffness."""
    scene = bare_scene(4, "arc")
    moments = np.array([0.02, 0.05])
    bends = moments * 0.15 / STIFFNESS
    poses = bent(moments, bends, at=0.25, since=0.1)
    fit = cg.identify(scene, poses, parameters=["bending_stiffness"])
    assert fit["bending_stiffness"] == pytest.approx(STIFFNESS, rel=1e-8)


TENDONS = {"offset": 0.006, "max_tension": 20.0}
PULLS = np.array(
    [[0, 0], [1, 0], [2, 0], [4, 0], [6, 0], [0, 2], [0, 4], [0, 6], [3, 3], [6, 6], [5, 2], [2, 5]], float
)


def pulled(stiffness: float, radius: float, seed: int, noise: float = 3e-4) -> Poses:
    """Tip and middle of arcs that tensions bend by their difference and shorten by their sum, in closed form."""
    rng = np.random.default_rng(seed)
    bend = (PULLS[:, 0] - PULLS[:, 1]) * TENDONS["offset"] * LENGTH / stiffness
    remains = LENGTH / (1.0 + PULLS.sum(axis=1) * radius**2 / stiffness)
    readings = []
    for at in (None, 0.5 * LENGTH):
        share = 1.0 if at is None else 0.5
        along = remains * share * np.sinc(share * bend / np.pi)
        across = remains * share * np.sinc(0.5 * share * bend / np.pi) * np.sin(0.5 * share * bend)
        readings += [
            Reading(axis, values + noise * rng.standard_normal(len(PULLS)), at, sigma=noise)
            for axis, values in (("x", along), ("y", across))
        ]
    return Poses(readings, {f"tension_{k + 1}": PULLS[:, k] for k in (0, 1)})


@pytest.mark.parametrize(
    ("radius", "seed"),
    few([(0.003, 0), (0.0, 0), *((radius, k) for radius in (0.0, 0.003, 0.006) for k in range(1, 8))], 2),
)
def test_a_finger_that_shortens_with_the_sum_of_its_tensions_is_reported(radius, seed):
    """And not that its origin is elsewhere; of one that keeps its length neither is reported."""
    stiffness = 0.01 * np.exp(np.random.default_rng(seed).uniform(-0.3, 0.3))
    scene = bare_scene(2, "clothoid", finger={"rod": {**ROD, "bending_stiffness": 0.011}, "tendons": TENDONS})
    data = pulled(stiffness, radius, seed)
    fit = cg.identify(scene, data, parameters=["bending_stiffness"])
    named = [text for text in fit.warnings if "gyration_radius" in text]
    assert not [text for text in fit.warnings if "origin" in text]
    if not radius:
        assert fit.warnings == ()
        return
    assert float(re.search(r"gyration_radius, ([\d.]+) ", named[0])[1]) == pytest.approx(radius, rel=0.15)
    known = scene.changed({"finger.gyration_radius": radius})
    again = cg.identify(known, data, parameters=["bending_stiffness"])
    assert again["bending_stiffness"] == pytest.approx(stiffness, rel=0.01)
    assert not [text for text in again.warnings if "gyration_radius" in text or "origin" in text]


def test_the_table_of_numbers_to_estimate_is_that_of_the_model():
    """If not: ``python -m tests.estimates_page``. And each of them is one, of a finger that has it."""
    from tests import estimates_page

    assert estimates_page.text() in estimates_page.PAGE.read_text(encoding="utf-8")
    assert {"gyration_radius", "youngs_modulus", "softening_ratio", "drive_slack"} <= estimates_page.rows().keys()


def test_ranges_grow_with_the_shapes_of_rows():
    """Bends of up to 2.3 turns by moments at the tip: moment times length over stiffness."""
    moments = np.linspace(0.05, 1.2, 6)
    bends = moments * LENGTH / (1.3 * STIFFNESS)
    fit = cg.identify(bare_scene(2, "clothoid"), bent(moments, bends), parameters=["bending_stiffness"])
    assert fit["bending_stiffness"] == pytest.approx(1.3 * STIFFNESS, rel=1e-8)
    assert not [text for text in fit.warnings if "range" in text]
