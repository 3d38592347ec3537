"""Figures of real_robots.md: python docs/real_rods.py [belendez|ring_downs|foam|tendons|releases] [COUNT]."""

from __future__ import annotations

import itertools
import math
import sys
import warnings
from pathlib import Path

import numpy as np

import continuum_grasp as cg
from continuum_grasp.addons.identification import Fit, Reading, TipPath, data_folder
from continuum_grasp.addons.identification.scene import Estimate
from continuum_grasp.scene import Fidelity, Timing

CONFIGS = Path(__file__).parents[1] / "configs"
FAMILIES = (("arc", 2), ("arc", 8), ("clothoid", 1), ("matched_clothoid", 2), ("matched_clothoid", 4), ("clothoid", 6))


def identify(name: str, data: str, *changes: str, **keys) -> Fit:
    """One fit, its warnings left out."""
    folder = data_folder()
    if folder is None:
        sys.exit("no measured data: set CONTINUUM_GRASP_DATA to their folder")
    return cg.identify(cg.load(CONFIGS / "identify" / f"{name}.yaml", changes), folder / data, **keys)


def estimates(fit: Fit) -> str:
    rows = zip(fit.names, fit.values, fit.deviations, fit.units, strict=True)
    return ", ".join(f"{name} {value:.5g} +- {deviation:.2g} {unit}" for name, value, deviation, unit in rows)


def errors(fit: Fit) -> str:
    kinds = (("fitted", fit.errors), ("hold-out", fit.holdout_errors))
    return "; ".join(f"{kind} {e.rms:.3g} r.m.s., {e.largest:.3g} {e.unit}" for kind, found in kinds for e in found)


def belendez() -> None:
    """Families, and every way to fit three or four of the seven drops."""

    def fit(rows: tuple[int, ...], *changes: str) -> Fit:
        held = [k for k in range(1, 8) if k not in rows]
        return identify(
            "belendez_strip", "belendez2003_cantilever/tip_drop.csv", f"data[0].holdout_rows={held}", *changes
        )

    for family, elements in FAMILIES:
        found = fit(tuple(range(1, 8)), f"fidelity.family={family}", f"fidelity.elements={elements}")
        print(family, elements, estimates(found), errors(found), np.round(1e3 * found.residuals, 1))
    for count in (3, 4, 6):
        misses = [fit(rows).holdout_errors[0] for rows in itertools.combinations(range(1, 8), count)]
        rms, largest = np.array([e.rms for e in misses]), np.array([e.largest for e in misses])
        print(
            f"{count} fitted: {len(misses)} ways; r.m.s. of the rest within 2 mm in {np.sum(rms <= 2e-3)}, all of the "
            f"rest in {np.sum(largest <= 2e-3)}; median r.m.s. {1e3 * np.median(rms):.2f} mm, worst point of all "
            f"{1e3 * largest.max():.1f} mm; r.m.s. over all ways {1e3 * np.sqrt(np.mean(rms**2)):.2f} mm"
        )


def ring_downs() -> None:
    """Frequencies from handbook values and from the horizontal strip, and damping by window."""
    handbook = identify("strip_ring_down", "beam_free_vibration", parameters=[Estimate(name="material_damping")])
    for title, found in (
        ("handbook", handbook),
        ("from horizontal", identify("strip_ring_down", "beam_free_vibration")),
    ):
        print(title, estimates(found), errors(found))
        at, worst = 0, []
        for name, count in found.blocks:
            measured, predicted = (v[at : at + count : 2] for v in (found.measured, found.predictions))
            decay = found.measured[at + 1 : at + count : 2]
            share = 100.0 * (predicted / measured - 1.0)
            worst += list(np.abs(share))
            print(
                f"  {name}: measured {measured.mean():.4f} Hz, predicted {predicted.mean():.4f} Hz, "
                f"{share.mean():+.2f} %; decay {decay.mean():.3f} 1/s, "
                f"damping ratio {np.mean(decay / (2 * math.pi * measured)):.4f}"
            )
            at += count
        print(f"  within 1 %: {np.sum(np.array(worst) < 1.0)} of {len(worst)}, worst {max(worst):.2f} %")
    early = [f"data[{k}].window=[1.0, 4.0]" for k in range(3)]
    print("1 to 4 s:", estimates(identify("strip_ring_down", "beam_free_vibration", *early)))


def foam() -> None:
    """Weight over stiffness and slope of the clamp."""
    for family, elements in (("arc", 2), ("matched_clothoid", 2), ("matched_clothoid", 4)):
        changes = f"fidelity.family={family}", f"fidelity.elements={elements}"
        found = identify("foam_rod", "pool_noodle_static/poses.csv", *changes)
        gamma, clamp = 1.895**3 / found.values[0], 16.25 + math.degrees(found.values[1])
        print(family, elements, f"gamma {gamma:.2f}, clamp {clamp:.2f} deg,", estimates(found), errors(found))
    more = identify(
        "foam_rod",
        "pool_noodle_static/poses.csv",
        parameters=["bending_stiffness", "clamp_angle", "rest_curvature"],
    )
    print("with a rest curvature:", estimates(more), errors(more))


def tendons() -> None:
    """Stiffness, dry friction in bending, and friction of the tendons."""
    for names in (None, ["bending_stiffness", "dry_friction_1_moment", "tendon_friction"]):
        found = identify("tendon_steps", "tdcr_tendon_steps/steps.csv", parameters=names)
        print(estimates(found), errors(found), *found.warnings, sep="\n  ")


def releases(repeats: int) -> None:
    """The paper's four releases, simulated with known parameters: bias of the families, coverage of the intervals."""
    names, truth = ["youngs_modulus", "material_damping", "clamp_angle"], np.array([55e9, 1.3e-4, 0.01])
    changes = ["finger.rod.youngs_modulus=55e9", "finger.damping.material=1.3e-4", "finger.base.angle=-1.5607963267949"]

    def scene(grams: int, family: str, elements: int, *more: str) -> cg.Scene:
        loaded = cg.load(CONFIGS / "simulate" / f"nitinol_release_{grams:03d}g.yaml", more)
        return loaded.model_copy(update={"fidelity": Fidelity(family=family, elements=elements, bending_range=2.5)})

    def moved(grams: int, family: str, elements: int) -> cg.Scene:
        timing = Timing(duration=1.0, step=0.02, method="reference")
        return scene(grams, family, elements, *changes).model_copy(update={"time": timing})

    def paths(noise: float, rng, motions, family: str, elements: int) -> list[TipPath]:
        found = []
        for grams, motion in motions.items():
            tip = motion.tip + noise * rng.standard_normal(motion.tip.shape)
            readings = [Reading(axis, tip[1:, k]) for k, axis in enumerate("xy")]
            found.append(TipPath(motion.t[1:], readings, scene=scene(grams, family, elements)))
        return found

    rng, masses = np.random.default_rng(0), (0, 10, 20, 50)
    fine = {grams: cg.simulate(moved(grams, "clothoid", 6)) for grams in masses}
    for family, elements in (("arc", 2), ("arc", 3), *(("matched_clothoid", n) for n in (2, 3, 4))):
        found = cg.identify(scene(0, family, elements), paths(0.0, rng, fine, family, elements), parameters=names)
        print(family, elements, np.round(100 * (found.values / truth - 1), 2), "% off;", errors(found))
    same = {grams: cg.simulate(moved(grams, "matched_clothoid", 2)) for grams in masses}
    hits = np.zeros(3)
    for _ in range(repeats):
        found = cg.identify(
            scene(0, "matched_clothoid", 2), paths(2e-3, rng, same, "matched_clothoid", 2), parameters=names
        )
        hits += (found.intervals[:, 0] <= truth) & (found.intervals[:, 1] >= truth)
    print(f"coverage of 95 % intervals in {repeats} repeats with 2 mm of noise:", 100 * hits / max(repeats, 1), "%")
    print(estimates(found))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    wanted = sys.argv[1:2] or ["belendez", "ring_downs", "foam", "tendons", "releases"]
    for section in wanted:
        print(f"== {section}")
        globals()[section](*([int(sys.argv[2]) if len(sys.argv) > 2 else 100] if section == "releases" else []))
