"""Grasps of hands in another program's plant: chains of hinges around a free object, in MuJoCo.

Run ``python -m benchmarks.hand_mujoco`` (12 min). The model is that of ``export --to mjcf``, the trial that of
``grasp --try-in mujoco``: each finger is a chain of 24 links with three hinges each (bending, to the side, twist) under
the couples of its tendons, and starts as it was certified; the object is free, and is then pushed by 80 % of what the
certificate's linear response promises along six directions. Spheres and ellipsoids are those of MuJoCo; boxes and
cylinders lack the radius of their edges, which is added to the distance at which capsules, thinner by as much, touch:
surface, normal and point of contact are those of rounded edges. Where edges are as round as the finger is thick,
contacts lie 0.05 mm off the surface.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.report import begun
from continuum_grasp.addons.chains.hands import LINKS
from continuum_grasp.addons.chains.posture import HandFingerChain
from continuum_grasp.addons.chains.trial import HOLDS, SHARE, try_in_mujoco
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import HandScene, load

SHIPPED = ("ball", "box", "can", "egg", "lying_can")
SEARCH = {"effort": "quick", "max_total_iterations": 3000}
"""For random scenes, of which those that are not solved soon are passed over."""
CONFIGS = Path(__file__).parents[1] / "configs/hand"


def shift_error(grasp: Any) -> float:
    """Greatest difference of contacts' shifts to the side between chain and plan [m]."""
    worst = 0.0
    for k in range(len(grasp.scene.setups)):
        chain = HandFingerChain(grasp, k, LINKS)
        angles = chain.angles()
        for contact in chain.contacts:
            shift = float(chain.frame.axes[:, 2] @ (chain.at(angles, contact.station) - chain.frame.base))
            worst = max(worst, abs(shift - contact.deflection))
    return worst


def drawn(seed: int) -> Iterator[tuple[str, HandScene]]:
    """Random scenes without end: shapes in turn, three and four fingers in turn, off the axis, turned, 50 to 150 g."""
    rng = np.random.default_rng(seed)
    base = load(CONFIGS / "ball.yaml")
    kinds = ("sphere", "ellipsoid", "standing", "box", "lying")
    for number in itertools.count(1):
        kind = kinds[(number - 1) % len(kinds)]
        count = 4 if kind == "lying" else 3 + number % 2
        x, y = rng.uniform(-4e-3, 4e-3, 2)
        size, turn = rng.uniform(0.05, 0.065, 3), rng.uniform(-0.2, 0.2, 3)
        body: dict[str, Any] = {"mass": float(rng.uniform(0.05, 0.15))}
        body |= {"position": [float(x), float(y), float(-rng.uniform(0.085, 0.1))]}
        if kind == "sphere":
            body |= {"shape": "sphere", "diameter": float(size[0])}
        elif kind == "ellipsoid":
            body |= {"shape": "ellipsoid", "extents": size.tolist(), "rotation": turn.tolist()}
        elif kind == "box":
            extents = [float(size[0]), float(size[0]), 0.08]
            body |= {"shape": "box", "extents": extents, "edge_radius": 5e-3, "rotation": [0.0, 0.0, float(turn[0])]}
        else:
            body |= {"shape": "cylinder", "diameter": float(size[0]), "height": 0.1, "edge_radius": 4e-3}
            body |= {"rotation": [0.5 * math.pi, 0.0, 0.0] if kind == "lying" else [0.0, 0.0, 0.0]}
        ring = {"count": count, "radius": float(rng.uniform(0.042, 0.055))}
        changes = {"object": body, "hand.ring": ring, "name": f"{kind}, {count} fingers", "solver": SEARCH}
        scene = base.changed(changes)
        yield f"{number}: {kind}, {count} fingers", scene


def main() -> None:
    """Run the shipped hands, random ones, and a can between round fingers."""
    asked, report = begun(__doc__, "hand_mujoco", seeds=(11, "random grasps"), seed=0)
    columns = ["grasp", "contacts", "push in any direction [N]", "moved [mm]", "turned [deg]"]
    columns += ["normal forces planned [N]", "found [N]", "off [% of the greatest]", "shift to the side off [mm]"]
    columns += ["pushes held", "closed from straight: moved [mm]", "turned [deg] then"]
    note = (
        f"Of {HOLDS:g} s, then six pushes of {SHARE:.0%} of what is promised; of the last columns nothing is promised."
    )
    stable = report.table("Certified as stable", columns, note=note)
    print(*columns, sep=" | ")

    def add(table: Any, name: str, grasp: Any) -> dict[str, Any]:
        tried = try_in_mujoco(grasp)
        kinds = " ".join(contact.name.rpartition(".")[2] for contact in grasp.contacts)
        planned, found = [contact.normal_force for contact in grasp.contacts], tried["normal_forces"].values()
        forces = [" ".join(f"{force:.3f}" for force in forces) for forces in (planned, found)]
        moved = 1e3 * tried["moved"], math.degrees(tried["turned"])
        off = 100.0 * tried["normal_force_error"], 1e3 * shift_error(grasp)
        pushes = [push["held"] for push in tried.get("pushes", {}).values()]
        closed = tried.get("closed", {"moved": math.nan, "turned": math.nan})
        after = 1e3 * closed["moved"], math.degrees(closed["turned"])
        table.add(name, kinds, grasp.certificate.push, *moved, *forces, *off, f"{sum(pushes)} of {len(pushes)}", *after)
        return tried

    runs = [add(stable, name, optimize_grasp(CONFIGS / f"{name}.yaml")) for name in SHIPPED]
    passed: list[str] = []
    for name, scene in drawn(asked.seed):
        if len(runs) >= len(SHIPPED) + asked.seeds:
            break
        grasp = optimize_grasp(scene, raise_on_failure=False)
        if not grasp.solved:
            passed.append(f"{name} ({grasp.status.value})")
            print(passed[-1], flush=True)
            continue
        runs.append(add(stable, name, grasp))
    pushes = [push["held"] for tried in runs for push in tried.get("pushes", {}).values()]
    report.claim("stable grasps: greatest displacement [mm]", 1e3 * max(tried["moved"] for tried in runs), "<=", 1.0)
    report.claim("stable grasps: greatest turn [deg]", math.degrees(max(tried["turned"] for tried in runs)), "<=", 1.0)
    worst = max(tried["normal_force_error"] for tried in runs)
    report.claim("stable grasps: greatest error of a normal force [1]", worst, "<=", 0.05)
    report.claim(f"stable grasps: part of {6 * len(runs)} pushes held [1]", sum(pushes) / (6 * len(runs)), ">=", 0.95)
    if passed:
        stable.note += f" Drawn, and no stable grasp found: {', '.join(passed)}."
    loose = report.table("Round fingers, stability: ignore", columns)
    for name in ("can", "egg", "ball"):
        changes = {"hand.finger.section": {"shape": "round"}, "stability": "ignore"}
        grasp = optimize_grasp(load(CONFIGS / f"{name}.yaml").changed(changes), raise_on_failure=False)
        if not grasp.solved:
            report.missing.append(f"{name} with round fingers: {grasp.message}")
            continue
        tried = add(loose, f"{name}: {grasp.certificate.word}", grasp)
        if not grasp.certificate.stable:
            report.claim(f"{name} with round fingers, unstable: turn [deg]", math.degrees(tried["turned"]), ">=", 5.0)
    report.finish()


if __name__ == "__main__":
    main()
