"""Truths for the tests of identification; from inside: measurements made here enter problems without a file.

Truths for the tests of identification that no code of the package has produced.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_bvp

from continuum_grasp.addons.identification import Poses, Reading, TipPath
from continuum_grasp.addons.identification.blocks import MeasuredBlock
from continuum_grasp.addons.identification.inference import infer
from continuum_grasp.addons.identification.numbers import MeasuredColumn, MeasuredSet
from continuum_grasp.addons.identification.path_block import block_of
from continuum_grasp.addons.identification.problem import FitProblem
from continuum_grasp.addons.identification.unknowns import Unknown, read_unknowns
from continuum_grasp.scene import Scene
from tests.rods import HORIZONTAL, WEIGHT, rod_scene

LENGTH, DENSITY, STIFFNESS = 0.4, 0.08, 0.026
ROD = {"length": LENGTH, "linear_density": DENSITY, "bending_stiffness": STIFFNESS}
BETA = (1.875104068711961, 4.694091132974175)
"""Roots of cos x cosh x = -1: natural frequencies of a clamped rod."""


def loaded_scene(elements: int = 4, **keys) -> Scene:
    """The rod, horizontal under its weight, with a load at its tip."""
    loads = [{"kind": "force", "at": LENGTH, "force": [0.0, 0.0]}]
    return rod_scene(ROD, elements=elements, loads=loads, **keys)


def elastica(load: float, stiffness: float = STIFFNESS, clamp: float = 0.0, rest: float = 0.0) -> np.ndarray:
    """Tip x, y and bend of the horizontal rod under its weight and a load downwards, by collocation of the exact rod.

    EI theta'' = (P + rho g (L - s)) cos theta with theta(0) = clamp and theta'(L) = rest.
    """
    line = DENSITY * WEIGHT

    def rates(s, y):
        return np.vstack([y[1], (load + line * (LENGTH - s)) * np.cos(y[0]) / stiffness, np.cos(y[0]), np.sin(y[0])])

    def ends(a, b):
        return np.array([a[0] - clamp, b[1] - rest, a[2], a[3]])

    s = np.linspace(0.0, LENGTH, 80)
    start = np.vstack([-0.8 * s / LENGTH, 0 * s, s, 0 * s])
    found = solve_bvp(rates, ends, s, start, tol=1e-9, max_nodes=20_000)
    assert found.success
    return np.array([found.y[2, -1], found.y[3, -1], found.y[0, -1] - clamp])


def frequency(mode: int, stiffness: float = STIFFNESS, density: float = DENSITY) -> float:
    """Natural frequency of the clamped rod without gravity [Hz]."""
    return (BETA[mode - 1] / LENGTH) ** 2 * math.sqrt(stiffness / density) / (2.0 * math.pi)


def bare_scene(elements: int = 6, family: str = "matched_clothoid", **keys) -> Scene:
    """The rod without gravity."""
    return rod_scene(ROD, family, elements, gravity=(0.0, 0.0), **keys)


def release(scene: Scene, stiffer: float, damping: float, turned: float) -> Scene:
    """A scene with another Young's modulus and damping, and a clamp that is turned."""
    finger = scene.finger
    rod = finger.rod.model_copy(update={"youngs_modulus": stiffer})
    base = finger.base.model_copy(update={"angle": HORIZONTAL + turned})
    damped = finger.damping.model_copy(update={"material": damping})
    return scene.model_copy(update={"finger": finger.model_copy(update={"rod": rod, "base": base, "damping": damped})})


def at_tip(x, y, sigma: float | None = None) -> list[Reading]:
    """Readings of the tip."""
    return [Reading("x", x, sigma=sigma), Reading("y", y, sigma=sigma)]


def weighed(tips: np.ndarray, loads: np.ndarray, **keys) -> Poses:
    """Places of the tip under loads downwards."""
    return Poses(at_tip(tips[:, 0], tips[:, 1]), {"load_1_y": -np.asarray(loads)}, **keys)


def bent(moments: np.ndarray, bends: np.ndarray, **place) -> Poses:
    """Bends, of the whole rod or up to a place, under moments at its tip."""
    return Poses([Reading("bend", bends, **place)], {"tip_moment": moments})


def rung(*frequencies, decays=(), conditions=None) -> Poses:
    """Frequencies of the natural modes from the first on, and their decay rates, a row or several."""
    given = [("frequency", frequencies), ("decay_rate", decays)]
    by_mode = [Reading(one, np.atleast_1d(v), of=k + 1) for one, modes in given for k, v in enumerate(modes)]
    return Poses(by_mode, conditions or {})


def level_set(name: str, values: np.ndarray, sigma: float | None = None, group: str = "levels", **more) -> MeasuredSet:
    """A set of numbers of one kind, row by row; ``more`` is of the set."""
    known = {"fitted": np.ones(len(values), dtype=bool)} | more
    return MeasuredSet(
        name, (MeasuredColumn(name, group, "m", sigma),), np.arange(len(values)), values[:, None], **known
    )


def path_of(trajectory, scene: Scene, noise: float, rng: np.random.Generator) -> TipPath:
    """The path of the tip with noise, as measured on a scene."""
    tip = trajectory.tip + noise * rng.standard_normal(trajectory.tip.shape)
    return TipPath(trajectory.t[1:], at_tip(*tip[1:].T), scene=scene, name=str(scene.name))


def block_for(scene: Scene, data: Any, names: Sequence[str]) -> tuple[list[Unknown], MeasuredBlock]:
    """Unknowns by their names, and measurements as they enter the problem of a fit."""
    unknowns = read_unknowns(scene, names)
    return unknowns, block_of(scene, data, unknowns)


def built_once(block: MeasuredBlock) -> MeasuredBlock:
    """The block, whose models with other unknowns are built once, whatever is measured."""
    build, built = block.again, dict[tuple[str, ...], MeasuredBlock]()

    def again(unknowns, **other) -> MeasuredBlock:
        key = tuple(one.name for one in unknowns)
        if key not in built:
            built[key] = build(unknowns, **other)
        return built[key]

    block.again = again
    return block


def coverage(
    blocks: list[MeasuredBlock], unknowns: list[Unknown], truth: list[float], noise: float, repeats: int
) -> np.ndarray:
    """Per unknown, how many of so many fits to noisy copies of exact data have the truth in their intervals."""
    problem, rng = FitProblem(blocks, unknowns), np.random.default_rng(7)
    clean, hits = problem.measured.copy(), np.zeros(len(truth))
    for _ in range(repeats):
        problem.measured = clean + noise * rng.standard_normal(clean.size)
        solution = problem.solve(lambda share: None)
        weighted = (solution.predictions - problem.measured) / solution.sigma
        found = infer(unknowns, solution.values, solution.jacobian / solution.sigma[:, None], weighted)
        hits += (found.intervals[:, 0] <= truth) & (found.intervals[:, 1] >= truth)
    return hits


def slope_error(block: MeasuredBlock, values: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Per unknown, the largest deviation of the derivative from central differences, relative to its largest entry."""
    slopes, found = block.predict(values)[1], []
    for k, size in enumerate(sizes):
        h = 1e-4 * size * np.eye(len(sizes))[k]
        one = block.predict(values + h)[0] - block.predict(values - h)[0]
        two = block.predict(values + 2 * h)[0] - block.predict(values - 2 * h)[0]
        difference = (8.0 * one - two) / (12.0 * h[k])
        found.append(np.abs(difference - slopes[:, k]).max() / np.abs(slopes[:, k]).max())
    return np.array(found)
