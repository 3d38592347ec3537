"""Whether ``space_error`` covers the true error of random scenes: motions, equilibria and modes."""

from __future__ import annotations

import argparse
import math
from time import perf_counter

import numpy as np

from benchmarks.report import Report, Table
from continuum_grasp import equilibrium, modes
from continuum_grasp.accuracy.space import motion_within
from continuum_grasp.errors import ContinuumGraspError
from continuum_grasp.rod import natural_frequencies, solve_elastica
from continuum_grasp.scene import Scene
from continuum_grasp.simulation import simulate

_FINE = 8
"""Free clothoids of the motions that are taken as true: their error is that of two over 4^4 where the order holds."""
_PLACES = 21


def scene(random: np.random.Generator) -> Scene:
    """One finger of random size, softness, taper, tendons, mass and damping, let go or pulled; or pushed at its tip."""
    length = float(random.uniform(0.05, 0.6))
    density, weight = float(random.uniform(0.01, 0.1)), float(10 ** random.uniform(-0.5, 1.5))
    stiffness = density * 9.81 * length**3 / weight
    taper = float(random.choice([1.0, 1.0, 0.5, 0.1]))
    rod: dict = {"length": length, "linear_density": density, "bending_stiffness": stiffness}
    if taper < 1.0:
        young = stiffness / (math.pi / 64 * 0.01**4)
        cone = {"to": length, "diameter": [0.01, 0.01 * taper], "youngs_modulus": young}
        cone["density"] = density / (math.pi / 4 * 0.01**2)
        rod = {"length": length, "sections": [cone]}
    period = 2 * math.pi * length**2 / 3.52 * math.sqrt(density / stiffness)
    family = str(random.choice(["arc", "clothoid", "matched_clothoid"]))
    finger = {"rod": rod, "base": {"angle": float(random.uniform(-math.pi, math.pi))}}
    finger["damping"] = {"material": float(random.choice([0.0, 0.02])) * stiffness * period}
    kind = str(random.choice(["drop", "release", "tendon", "friction"]))
    keys: dict = {"initial": {"pose": "straight"}}
    force = 0.5 * stiffness / length**2
    if kind == "release":
        held = {"kind": "force", "at": length, "force": [float(v) for v in random.uniform(-2, 2, 2) * force]}
        keys = {"initial": {"pose": "equilibrium", "held_by": [held]}}
    if kind in ("tendon", "friction"):
        offset = 0.05 * length
        finger["half_thickness"] = 2.0 * offset
        finger["tendons"] = {"offset": offset, "min_tension": 0.0, "max_tension": 1e6}
        pull = float(random.uniform(0.5, 3.0)) * stiffness / length / offset
        samples = {"times": [0.0, 0.5 * period], "values": [0.0, pull]}
        keys = {"actuation": {"tensions": [samples, 0.0]}}
    if kind == "friction":
        finger["tendons"]["friction"] = float(random.uniform(0.05, 0.3))
        family = "clothoid" if family == "matched_clothoid" else family
    fidelity = {"family": family, "elements": int(random.integers(1, 4)), "bending_range": 5.0}
    time = {"duration": period, "step": period / 200, "space_error": True}
    gravity = [0.0, -9.81]
    return Scene.model_validate({"finger": finger, "gravity": gravity, "fidelity": fidelity, "time": time, **keys})


def motion_errors(given: Scene) -> tuple[float, float]:
    """Estimate and true error of a motion, per length."""
    found = motion_within(given, None)
    print(*found.warnings, flush=True)
    exact = simulate(
        given.replaced(fidelity=given.fidelity.replaced(family="clothoid", elements=_FINE, bending_range=2.5))
    )
    some = np.unique(np.linspace(0, len(found.t) - 1, 100).astype(int))
    off = np.linalg.norm(found.backbone(some, _PLACES) - exact.backbone(some, _PLACES), axis=-1)
    return found.space_error, float(off.max() / found.length)


def rest_errors(given: Scene) -> tuple[tuple[float, float], tuple[float, float]]:
    """Estimate and true error of an equilibrium, per length, and of the first frequency, relative."""
    finger = given.finger.replaced(tendons=None)
    loads = given.initial.held_by
    at_rest = given.replaced(finger=finger, time=None, actuation=None, initial={"pose": "straight"}, loads=loads)
    found = equilibrium(at_rest)
    rod = solve_elastica(at_rest, tolerance=1e-9)
    s = np.linspace(0.0, found.model.finger.rod.length, _PLACES)
    off = np.linalg.norm(found.backbone(_PLACES) - rod.position(s), axis=1).max() / s[-1]
    vibrations = modes(at_rest, about=found)
    true = natural_frequencies(at_rest.finger, rod)
    return (found.space_error, float(off)), (
        float(vibrations.space_error[0]),
        float(abs(vibrations.frequencies_hz[0] / true[0] - 1.0)),
    )


def main() -> None:
    """Run every scene, and write the report."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=80)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    random, report = np.random.default_rng(given.seed), Report("space_error", given.seed)
    rows, pairs, began = [], {"motion": [], "equilibrium": [], "first frequency": []}, perf_counter()
    failed = 0
    for k in range(given.count):
        drawn = scene(random)
        what = f"{drawn.fidelity.elements} {drawn.fidelity.family}"
        cells = []
        for names, errors in ((("motion",), motion_errors), (("equilibrium", "first frequency"), rest_errors)):
            try:
                found = errors(drawn)
            except (ContinuumGraspError, np.linalg.LinAlgError) as reason:
                failed += 1
                print(k, what, names, str(reason).splitlines()[0][:150], flush=True)
                cells += ["-"] * len(names)
                continue
            for name, pair in zip(names, [found] if len(names) == 1 else found, strict=True):
                if all(map(math.isfinite, pair)):
                    pairs[name].append(pair)
                cells.append(f"{pair[0]:.1e} / {pair[1]:.1e}")
        rows.append([what, *cells])
        print(k, *rows[-1], round(perf_counter() - began), flush=True)
    for name, values in pairs.items():
        estimate, true = np.array(values).T
        ratio = estimate / np.maximum(true, 1e-6)
        beyond = true > 1e-4
        report.claim(f"{name}: scenes", len(values), ">=", 0.8 * given.count)
        report.claim(f"{name}: share covered of those off by more than 1e-4", np.mean(ratio[beyond] >= 1.0), ">=", 0.9)
        report.claim(f"{name}: least estimate / true error of these", ratio[beyond].min(), ">=", 0.5)
        report.claim(f"{name}: median", float(np.median(ratio[beyond])), "<=", 2.0)
    report.tables.append(
        Table("Estimate / true error", ["model", *pairs], rows, "Motions against 8 clothoids, the rest the exact rod.")
    )
    for file in report.write():
        print(file)
    print(report.status, "failed", failed)


if __name__ == "__main__":
    main()
