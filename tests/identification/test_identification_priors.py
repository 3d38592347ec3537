"""What is known beforehand of parameters and starts; from inside: linear measurements that no data have.

What is known beforehand of parameters and starts, and intervals of residuals that are correlated in time.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import stdtrit

import continuum_grasp as cg
from continuum_grasp.addons.identification import Estimate, IdentifyScene, Poses, Reading, TipPath, read_data
from continuum_grasp.addons.identification.blocks import MeasuredBlock
from continuum_grasp.addons.identification.inference import infer, middle
from continuum_grasp.addons.identification.path_block import PathBlock
from continuum_grasp.addons.identification.problem import FitProblem
from continuum_grasp.addons.identification.unknowns import Unknown, read_unknowns
from continuum_grasp.base import InputError
from tests.identification_cases import ROD, at_tip, level_set
from tests.rods import HANGING, rod_scene


class Linear(MeasuredBlock):
    """Predictions A x, of which entries of known deviation are measured; the last ``held`` unknowns are its own."""

    def __init__(self, matrix: np.ndarray, values: np.ndarray, sigma: float, own: tuple[Unknown, ...] = (), fit=True):
        self.own, self._matrix, fitted = own, matrix, np.full(len(values), fit)
        self.measured = level_set("linear" if fit else "held out", values, sigma, "rows", fitted=fitted)
        self.asked: list[np.ndarray] = []

    def predict(self, values, until=np.inf):
        self.asked.append(values)
        return self._matrix @ values, self._matrix


def unknown(start: float, sigma: float = np.inf, per: str = "all") -> Unknown:
    return Unknown("x", "m", "x", 1.0, False, start, -np.inf, np.inf, 1.0, per, sigma)


def test_what_is_known_beforehand_weighs_as_bayes_says():
    """Conjugate normal distributions: the posterior's mean and covariance; nothing is known of the second unknown."""
    rng = np.random.default_rng(3)
    a, y, sigma, known = rng.standard_normal((9, 3)), rng.standard_normal(9), 0.3, np.array([0.2, np.inf, 0.05])
    about = np.array([1.0, -2.0, 0.5])
    unknowns = [unknown(start, one) for start, one in zip(about, known, strict=True)]
    problem = FitProblem([Linear(a, y, sigma)], unknowns)
    found = problem.solve(lambda share: None)
    precision = a.T @ a / sigma**2 + np.diag(1.0 / known**2)
    mean = np.linalg.solve(precision, a.T @ y / sigma**2 + about / known**2)
    assert found.values == pytest.approx(mean, rel=1e-7)
    missed, slopes = problem.prior(found.values)
    assert missed == pytest.approx((mean - about)[[0, 2]] / known[[0, 2]], rel=1e-6)
    rows = np.vstack([a / sigma, slopes]), np.append((a @ mean - y) / sigma, missed)
    scale = rows[1] @ rows[1] / (11 - 3)
    expected = np.sqrt(scale * np.diag(np.linalg.inv(precision)))
    assert infer(unknowns, found.values, *rows).deviations == pytest.approx(expected, rel=1e-9)


def test_derivatives_by_a_vector_across_the_finger_are_differences():
    """Predictions are linear, so that a difference of any step is exact; two sets bend in planes of their own."""
    rng, sought = np.random.default_rng(1), [unknown(0.0, per="plane"), unknown(0.0), unknown(0.0, per="set")]
    blocks = [Linear(rng.standard_normal((4, 3)), rng.standard_normal(4), 0.1) for _ in range(2)]
    for block, plane in zip(blocks, (0.3, 2.0), strict=True):
        block.plane = plane
    problem = FitProblem(blocks, sought)
    at = rng.standard_normal(len(problem.unknowns))
    y, jacobian = problem.predict(at)
    assert jacobian.shape == (8, 6)  # two of all sets, two parts of the vector, one of each set
    for k, step in enumerate(np.eye(6)):
        assert jacobian[:, k] == pytest.approx(problem.predict(at + step)[0] - y, abs=1e-12)
    turned = np.array([np.cos(0.3), np.sin(0.3)])
    assert blocks[0].asked[0] == pytest.approx([at[0] + turned @ at[2:4], at[1], at[4]])


def test_the_start_of_a_hold_out_is_sought_with_what_is_known_of_it():
    """A set that is not fitted moves nothing that all sets have, nor does what is known of its start."""
    own = (unknown(2.0, 0.1, per="set"),)
    fitted, held = (
        Linear(np.ones((3, 1)), np.full(3, 4.0), 0.1),
        Linear(np.ones((2, 2)), np.full(2, 9.0), 0.1, own, False),
    )
    problem = FitProblem([fitted, held], [unknown(0.0)])
    found = problem.solve(lambda share: None)
    # Two readings of 9 - 4 = 5, and 2 beforehand, of equal deviations.
    assert found.values == pytest.approx([4.0, (5.0 + 5.0 + 2.0) / 3.0])
    assert problem.prior(found.values)[0].size == 0
    # The search for what all sets have does not see its start, and must not move it.
    assert held.asked[0] == pytest.approx([4.0, 2.0], rel=1e-12)


@pytest.mark.parametrize(("family", "sizes"), [("arc", (0.1, 0.1)), ("clothoid", (0.5, 0.5, 0.5))])
def test_deviations_of_a_start_are_bends_of_its_elements(family, sizes):
    """Arcs have bends [rad] as coordinates, clothoids curvatures [1/m]: here of elements of 0.2 m."""
    scene = rod_scene(ROD, family, 2, angle=HANGING)
    t = 0.01 * np.arange(20)
    points = [Reading(axis, np.full(20, at), at=s) for s in (0.2, 0.4) for axis, at in (("x", 0.0), ("y", -s))]
    path = TipPath(t, measured=points, start="estimated", start_sigma=(0.1, 3.0))
    block = PathBlock(scene, path, read_unknowns(scene, ["bending_stiffness"]))
    expected = [*sizes, *(30.0 * size for size in sizes)]
    assert [one.sigma for one in block.own] == pytest.approx(expected)


def test_a_weighed_mass_stays_where_it_was_weighed():
    """Bends under its own weight show mass over stiffness alone: what is known of the mass tells both."""
    scene = rod_scene(ROD, "arc", 2)
    pose = cg.equilibrium(scene).tip
    data = Poses([Reading("y", [pose[1]], sigma=1e-4)])
    asked = [Estimate(name="bending_stiffness", start=0.03), Estimate(name="linear_density", start=0.08, sigma=0.004)]
    fit = cg.identify(scene, data, parameters=asked)
    assert fit["linear_density"] == pytest.approx(0.08, rel=1e-4)
    assert fit["bending_stiffness"] == pytest.approx(ROD["bending_stiffness"], rel=1e-3)


@pytest.mark.parametrize("start_sigma", [(0.1, -1.0), (0.1,), (0.1, np.nan)])
def test_deviations_of_a_start_are_checked(start_sigma):
    t = 0.01 * np.arange(20)
    with pytest.raises(InputError, match=r"expected|positive"):
        TipPath(t, at_tip(t, t), start="estimated", start_sigma=start_sigma)
    with pytest.raises(InputError, match="estimated"):
        TipPath(t, at_tip(t, t), start_sigma=(0.1, 1.0))


# -- residuals that are correlated ------------------------------------------------------------------------------------


def test_the_covariance_of_sums_is_that_of_every_pair_of_instants():
    """By the definition: all pairs of instants and readings, one by one."""
    rng = np.random.default_rng(0)
    count, readings, n = 60, 2, 3
    left = lfilter([1.0], [1.0, -0.8], rng.standard_normal((count, readings)), axis=0)
    slopes = rng.standard_normal((count, readings, n))
    found, freedom = middle(slopes, left)
    length = 3.71 * count / freedom
    assert 6.0 < length < 40.0
    total = np.zeros((n, n))
    for t in range(count):
        for s in range(count):
            x = abs(t - s) / length
            weight = 1.0 - 6.0 * x**2 + 6.0 * x**3 if x <= 0.5 else 2.0 * max(1.0 - x, 0.0) ** 3
            for i in range(readings):
                for j in range(readings):
                    pairs = zip(left[max(t - s, 0) :, i], left[max(s - t, 0) :, j], strict=False)
                    own = sum(a * b for a, b in pairs) / count
                    total += weight * own * np.outer(slopes[t, i], slopes[s, j])
    assert found == pytest.approx(total, rel=1e-9, abs=1e-9 * np.abs(total).max())
    assert np.linalg.eigvalsh(found).min() > 0.0


COLORS = {
    "white": ([1.0], [1.0]),
    "correlated by 0.9": ([1.0], [1.0, -0.9]),
    "swinging": ([1.0], [1.0, -2.0 * 0.97 * np.cos(0.2), 0.97**2]),
    "smooth": (np.hanning(41), [1.0]),
}


@pytest.mark.parametrize("color", COLORS)
def test_intervals_cover_the_truth_whatever_the_color_of_the_noise(color):
    """90 % intervals of five parameters of a decaying vibration, in 200 repeats."""
    rng, count, repeats = np.random.default_rng(5), 400, 200
    t = np.linspace(0.0, 1.0, count)
    wave = np.exp(-3.0 * t) * np.stack([np.cos(40.0 * t), np.sin(40.0 * t)])
    a = np.stack([*wave, *(t * wave), np.ones(count)], axis=1)
    unknowns, series = [unknown(0.0)] * 5, [np.arange(count)[:, None]]
    hits = {"series": 0.0, "independent": 0.0}
    for _ in range(repeats):
        noise = lfilter(*COLORS[color], rng.standard_normal(count + 300))[300:]
        found, *_ = np.linalg.lstsq(a, noise, rcond=None)
        for name, own in (("series", series), ("independent", [])):
            found_by = infer(unknowns, found, a, a @ found - noise, series=own)
            inside = np.abs(found) <= stdtrit(found_by.freedom, 0.95) * found_by.deviations
            hits[name] += float(np.mean(inside)) / repeats
    # Two standard deviations of 200 repeats are 0.04; smooth noise leaves little to judge its own spectrum by.
    assert 0.8 < hits["series"] < 0.95
    assert (hits["independent"] < 0.6) == (color != "white")


@pytest.mark.deep
def test_intervals_of_a_release_cover_the_truth_where_noise_hangs_together():
    """90 % intervals of stiffness and damping, by fits of the whole motion to noise that is correlated by 0.9."""
    scene = rod_scene(ROD, "arc", 1, finger={"damping": {"material": 5e-4}}, initial={"q": [0.6]})
    t, rng, repeats = 0.01 * np.arange(1, 151), np.random.default_rng(8), 60
    unknowns = read_unknowns(scene, ["bending_stiffness", "material_damping"])
    problem = FitProblem([PathBlock(scene, TipPath(t, at_tip(0.0 * t, 0.0 * t)), unknowns)], unknowns)
    truth = np.array([one.start for one in unknowns])
    clean, hits = problem.predict(truth)[0], {"series": np.zeros(2), "independent": np.zeros(2)}
    for _ in range(repeats):
        noise = lfilter([1.0], [1.0, -0.9], rng.standard_normal((t.size + 100, 2)), axis=0)[100:]
        problem.measured = clean + 3e-4 * noise.ravel()
        solution = problem.solve(lambda share: None)
        rows = solution.jacobian / solution.sigma[:, None], (solution.predictions - problem.measured) / solution.sigma
        for name, series in (("series", problem.series), ("independent", [])):
            found_by = infer(unknowns, solution.values, *rows, series=series)
            hits[name] += np.abs(solution.values - truth) <= stdtrit(found_by.freedom, 0.95) * found_by.deviations
    # Two standard deviations of 60 repeats are 0.08.
    assert np.all(hits["series"] / repeats > 0.8)
    assert np.all(hits["series"] / repeats <= 0.98)
    assert np.any(hits["independent"] / repeats < 0.75)


def test_the_prior_of_a_start_is_read_from_a_configuration(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text("t,x,y\n" + "".join(f"{0.01 * k},0.0,0.4\n" for k in range(20)))
    keys = {
        "finger": {"rod": ROD},
        "gravity": [0.0, 0.0],
        "fidelity": {"family": "arc", "elements": 1},
        "estimate": [{"name": "bending_stiffness"}],
        "data": [{"kind": "trajectory", "start": "estimated", "start_prior": {"bend": "3 deg", "rate": "90 deg/s"}}],
    }
    (path,) = read_data(IdentifyScene(**keys), [file])
    assert path.start_sigma == pytest.approx((np.pi / 60.0, np.pi / 2.0))
    keys["data"][0]["start"] = "scene"
    with pytest.raises(InputError, match="start_prior: goes with start: estimated"):
        IdentifyScene(**keys)
