"""Laws chosen by what they predict of rows held out; from inside: the choice among problems that are posed here.

Laws that are chosen by what they predict of rows that were held out.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import continuum_grasp as cg
from continuum_grasp.addons.identification import IdentifyScene, Poses, Reading, TipPath
from continuum_grasp.addons.identification.fitting import posed
from continuum_grasp.addons.identification.problem import FitProblem
from continuum_grasp.addons.identification.searches import _differ, choose_law
from continuum_grasp.addons.identification.unknowns import Unknown
from continuum_grasp.base import InputError
from tests.identification.test_identification_doubts import Level
from tests.identification_cases import at_tip

LENGTH, STIFFNESS, SIGMA = 0.2, 0.005, 0.01
SOFT = {
    "name": "softens",
    "set": ["finger.softening={curvature: 1.0, stiffness_ratio: 0.8, rounding: 0.3}"],
    "estimate": [{"name": "softening_ratio"}, {"name": "softening_curvature", "min": 0.3, "max": 6.0}],
}
TURNED = {"name": "turned", "estimate": [{"name": "clamp_angle"}]}
PLAIN = {"name": "linear"}


def scene(*laws: dict, **keys) -> IdentifyScene:
    return IdentifyScene(
        finger={"rod": {"length": LENGTH, "linear_density": 0.03, "bending_stiffness": STIFFNESS}},
        gravity=(0.0, 0.0),
        fidelity={"family": "arc", "elements": 1},
        estimate=[{"name": "bending_stiffness"}],
        laws=laws,
        **keys,
    )


MOMENT = np.linspace(0.002, 0.02, 20)


def bends(*, soft: bool, seed: int, held: slice = slice(2, None, 4)) -> Poses:
    """Bends under moments, by the model of another rod: linear, or softer beyond half of the way; some are held out."""
    true = scene().changed({"finger.rod.bending_stiffness": 0.0055})
    if soft:
        true = true.changed({"finger.softening": {"curvature": 1.5, "stiffness_ratio": 0.6, "rounding": 0.3}})
    plain = Poses([Reading("angle", np.zeros(20))], {"tip_moment": MOMENT})
    exact = cg.compare(true, plain).predictions
    noisy = exact + SIGMA * np.random.default_rng(seed).standard_normal(20)
    fitted = np.ones(20, dtype=bool)
    fitted[held] = False
    return Poses([Reading("angle", noisy, sigma=SIGMA)], {"tip_moment": MOMENT}, fitted)


@pytest.mark.deep
def test_a_softer_rod_is_found_by_rows_that_are_held_out():
    fit = cg.identify(scene(PLAIN, SOFT), bends(soft=True, seed=0))
    linear, soft = fit.laws
    assert (linear.verdict, soft.verdict) == ("worse", "chosen")
    assert (linear.numbers, soft.numbers) == (1, 3)
    assert linear.held_out > 1.5 * soft.held_out
    assert "softening_ratio" in fit.names
    assert fit.apply().finger.softening.stiffness_ratio == fit["softening_ratio"]


@pytest.mark.deep
def test_a_law_that_fits_better_is_not_chosen_for_that():
    """A linear rod: further numbers lower the misfit, as they always do, but predict no better."""
    fit = cg.identify(scene(PLAIN, TURNED), bends(soft=False, seed=1))
    plain, turned = fit.laws
    assert turned.fitted < plain.fitted
    assert plain.verdict == "chosen"
    assert fit.names == ("bending_stiffness",)


@pytest.mark.deep
def test_rows_that_are_marked_decide():
    """The greatest moments, held out by the data: one fit per law, and their error in the table."""
    data = bends(soft=True, seed=2, held=slice(-6, None))
    fit = cg.identify(scene(PLAIN, SOFT), data)
    alone = cg.identify(scene().replaced(laws=()), data)
    left = alone.residuals[-6:] / SIGMA
    assert fit.laws[0].held_out == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-6)
    assert fit.laws[1].verdict == "chosen"


@pytest.mark.parametrize("moved", [0.0, 1.0])
def test_single_rows_of_many_sets_scatter_as_those_of_one(moved):
    """Student's t of the differences of both laws, a row from each of five sets."""
    rng, one = np.random.default_rng(2), Unknown("one", "1", "one")
    blocks = [Level(np.zeros(3), f"set {k}") for k in range(5)]
    for block in blocks:
        block.measured = replace(block.measured, fitted=np.array([True, False, True]))
    problem, surely = FitProblem(blocks, [one]), 0
    for _ in range(200):
        more = rng.standard_normal((5, 3)) + moved
        rows = more[:, 1]
        sure = rows.sum() > stats.t.isf(0.025, 4) * np.sqrt(len(rows)) * rows.std()
        assert _differ(problem, more.ravel()) == sure
        surely += sure
    assert (surely < 20) == (moved == 0.0)


class Line(Level):
    """Numbers that are predicted by a mean and a slope."""

    def predict(self, values, until=np.inf):
        slopes = np.column_stack([np.ones(40), np.linspace(-1.0, 1.0, 40)])
        return slopes @ values[:2], slopes


def test_of_laws_that_predict_alike_the_one_with_fewer_numbers_is_chosen():
    """A slope of half a deviation predicts what is held out a little better, as its error says, not surely."""
    noise = np.random.default_rng(0).standard_normal(40) + 0.5 * np.linspace(-1.0, 1.0, 40)
    unknowns = [Unknown("mean", "1", "mean"), Unknown("slope", "1", "slope")]
    problems = dict[str, FitProblem]()
    for name, block, count in (("line", Line, 2), ("level", Level, 1)):
        data = block(noise)
        data.measured = replace(data.measured, fitted=np.arange(40) % 4 != 0)
        problems[name] = FitProblem([data], unknowns[:count])
    chosen, _, (line, level) = choose_law(problems, lambda share: None)
    assert line.held_out < level.held_out
    assert (chosen, line.verdict, level.verdict) == ("level", "alike", "chosen")


@pytest.mark.deep
def test_what_cannot_be_chosen_is_refused():
    with pytest.raises(InputError, match="two or more"):
        scene(PLAIN)
    with pytest.raises(InputError, match="names of their own"):
        scene(PLAIN, PLAIN)
    t = np.linspace(0.01, 0.3, 30)
    alone = TipPath(t, at_tip(0.01 * t, 0.2 + 0.0 * t))
    with pytest.raises(InputError, match="hold out rows or a set"):
        cg.identify(scene(PLAIN, TURNED), alone)
    wrong = {"name": "wrong", "set": ["finger.softening.ratio=0.2"]}
    with pytest.raises(InputError) as error:
        cg.identify(scene(PLAIN, wrong), bends(soft=False, seed=0))
    assert error.value.key.startswith("laws[1].set.finger.softening")


@pytest.mark.deep
def test_noise_alone_rarely_chooses_more_numbers():
    """Of 24 linear rods; an honest 2.5 % to one side, and three standard deviations of so many trials."""
    trials = []
    for seed in range(24):
        data = bends(soft=False, seed=seed)
        ways = (["bending_stiffness"], ["bending_stiffness", "clamp_angle"])
        problems = {str(k): posed(scene(), data, one).problem for k, one in enumerate(ways)}
        trials.append(choose_law(problems, lambda share: None))
    assert sum(name == "1" for name, *_ in trials) <= 3
    assert np.mean([turned.fitted < plain.fitted for *_, (plain, turned) in trials]) > 0.9
