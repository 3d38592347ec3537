"""The figures of real_robots.md: python docs/real_robots.py [wrist|joints|probe|trunk]."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np

import continuum_grasp as cg
from continuum_grasp.identification import Fit, Poses, Reading, data_folder, read_table

CONFIGS = Path(__file__).parents[1] / "configs" / "identify"


def folder() -> Path:
    found = data_folder()
    if found is None:
        sys.exit("no measured data: set CONTINUUM_GRASP_DATA to their folder")
    return found


def show(title: str, fit: Fit) -> None:
    rows = [*zip(fit.names, fit.values, fit.deviations, strict=True)]
    rows += [*zip(fit.set_names, fit.set_values, fit.set_deviations, strict=True)]
    print(title, *(f"{name} {value:.4g} +- {deviation:.2g}" for name, value, deviation in rows[:8]), sep="\n  ")
    for kind, errors in (("fitted", fit.errors), ("hold-out", fit.holdout_errors)):
        for one in errors:
            factor, unit = (180.0 / np.pi, "deg") if one.unit == "rad" else (1e3, "mm")
            print(f"  {kind}: {factor * one.rms:.2f} {unit} r.m.s., {factor * one.largest:.1f} at most, {one.count}")
    print(*fit.warnings, sep="\n  ! ")


def sections(widths: list[float], gap: float, moments: list[float]) -> list[dict[str, float]]:
    """Notches of these second moments [m4] at 10 GPa, each followed by a ring that hardly bends."""
    at, found = 0.0, []
    for width, moment in zip(widths, moments, strict=True):
        for length, stiffness in ((width, 1e10 * moment), (gap, 1e-3)):
            at += length
            found.append({"to": round(at, 7), "bending_stiffness": stiffness, "linear_density": 0.005})
    return found


def wrist() -> None:
    """Wrist A as shipped and below 0.9 N; wrist C by itself, and predicted from A."""
    where = folder() / "niti_notched_wrist"
    scene = cg.load(CONFIGS / "notched_wrist.yaml")
    show("wrist A, all tensions", cg.identify(scene, where / "wrist_A.csv"))

    def poses(name: str, notches: int, pitch: float, most: float, own: cg.Scene | None = None, **keys) -> Poses:
        table = read_table(where / f"{name}.csv")
        pull = table.in_si("tension_N", "N")
        there = pull <= most
        readings = [
            Reading("bend", table.in_si(f"notch{k + 1}_deg", "rad", "deg")[there], (k + 1) * pitch, None, k * pitch)
            for k in range(notches)
        ]
        return Poses(readings, {"tension_1": pull[there]}, name=name, scene=own, **keys)

    def scene_c() -> cg.Scene:
        plain = cg.Scene(**{name: getattr(scene, name) for name in cg.Scene.model_fields})
        rod = {"length": 0.008, "sections": sections([1e-3] * 4, 1e-3, [8.40e-16, 6.40e-16, 4.76e-16, 3.44e-16])}
        changes = {"finger.rod": rod, "finger.tendons.offset": 1.388e-3, "fidelity.elements": [1e-3] * 8}
        return plain.changed(changes)

    a = poses("wrist_A", 5, 0.002, 0.9)
    show("wrist A below 0.9 N", cg.identify(scene, a, parameters=scene.estimate))
    c = poses("wrist_C", 4, 0.002, 0.9, scene_c())
    show("wrist C below 0.9 N", cg.identify(c.scene, c, parameters=scene.estimate))
    held = poses("wrist_C", 4, 0.002, 0.9, scene_c(), fitted=np.zeros(c.rows, bool))
    show("wrist C predicted from A", cg.identify(scene, [a, held], parameters=scene.estimate))


def joints() -> None:
    """Stiffness of each joint."""
    show("joints", cg.identify(CONFIGS / "spirob_joints.yaml", folder() / "spirob_joint_static/static_load.csv"))


def probe() -> None:
    """The loop of each motor, and the tip's place over its angle."""
    where = folder() / "tee_probe_hysteresis"
    files = [where / f"motor1_loop{k}.csv" for k in (1, 2)]
    show("motor 1", cg.identify(CONFIGS / "probe_loop.yaml", files))
    other = cg.load(CONFIGS / "probe_loop.yaml", ["data[0].file=motor2_loop1.csv", "data[0].conditions[0].zero=1900"])
    only = other.model_copy(update={"data": other.data[:1]})
    show("motor 2", cg.identify(only, where / "motor2_loop1.csv"))


def trunk() -> None:
    """Releases with 200 g fitted, with 400 g predicted."""
    show("trunk", cg.identify(CONFIGS / "trunk_releases.yaml", folder() / "hose_trunk_release"))


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for section in sys.argv[1:2] or ["wrist", "joints", "probe", "trunk"]:
        globals()[section]()
