"""Hands that are turned while they hold an object, in MuJoCo, against what their certificates promise to first order.

Run ``python -m benchmarks.hand_turned`` (30 min). Random hands of three and four fingers, whose objects of
50 to 100 g are off the axis, are asked to hold them while the weight takes every direction (``gravity: {any: 9.81}``).
Those that do are held for 2 s, and then the weight turns to six directions, one after another, and stays 0.5 s in each.
With ``--stiff 6`` fingers are six times as stiff, and the object may move by 1 mm and 1 degree at most.
Rows are added to a file in the folder as they are found, with which the next run goes on; without that file it
begins anew.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

from benchmarks.report import begun
from continuum_grasp.addons.chains.trial import AXES, MOVES, TURNS, YIELDS, HandInMujoco
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import HandScene

SEARCH = {"effort": "quick", "max_total_iterations": 3000}
"""Scenes that are not solved soon are passed over."""
KINDS = ("sphere", "ellipsoid", "cylinder", "box")


def drawn(number: int, stiff: float = 0.0) -> tuple[str, HandScene]:
    """A random hand: shapes in turn, three and four fingers by turns of four; where its fingers are ``stiff`` times as
    stiff, it has to keep the object within `MOVES` and `TURNS`.
    """
    rng = np.random.default_rng(number)
    kind, count = KINDS[number % 4], 3 + number // 4 % 2
    x, y = rng.uniform(-3e-3, 3e-3, 2)
    size = rng.uniform(0.05, 0.065)
    body: dict[str, Any] = {"shape": kind, "mass": float(rng.uniform(0.05, 0.1))}
    # Fingers reach around what is round, and press with their tips on what is upright.
    round_one = kind in ("sphere", "ellipsoid")
    depth, beside = ((0.075, 0.09), (4e-3, 12e-3)) if round_one else ((0.09, 0.105), (14e-3, 22e-3))
    body |= {"position": [float(x), float(y), float(-rng.uniform(*depth))]}
    body |= {"rotation": rng.uniform(-0.15, 0.15, 3).tolist()} if kind != "sphere" else {}
    if kind == "sphere":
        body |= {"diameter": size}
    elif kind == "ellipsoid":
        body |= {"extents": (size * rng.uniform(0.9, 1.2, 3)).tolist()}
    elif kind == "cylinder":
        body |= {"diameter": size, "height": size * rng.uniform(0.9, 1.4), "edge_radius": 4e-3}
    else:
        body |= {"extents": (size * rng.uniform(0.9, 1.1, 3)).tolist(), "edge_radius": 6e-3}
    finger = {
        "rod": {
            "length": 0.12,
            "bending_stiffness": (stiff or 1.0) * float(rng.choice([6e-3, 12e-3])),
            "linear_density": 0.02,
        },
        "half_thickness": 6e-3,
        "section": {"shape": "rectangle", "thickness": 1e-3, "width": 2e-3 if round_one else 6e-3},
        "tendons": {"offset": 6e-3, "max_tension": 120.0 * (stiff or 1.0)},
    }
    limits = {"shift_max": MOVES, "turn_max": TURNS} if stiff else {}
    scene = HandScene.model_validate({
        "schema_version": 1,
        "name": f"{kind} between {count} fingers",
        "hand": {"finger": finger, "ring": {"count": count, "radius": float(0.5 * size + rng.uniform(*beside))}},
        "object": body,
        "contacts": {"friction": 0.8, "normal_force_max": 30.0, "reserve": 0.2},
        "gravity": {"any": 9.81} | limits,
        "solver": SEARCH,
    })  # fmt: skip
    return f"{number}: {kind}, {count} fingers, {1e3 * scene.object.weighed:.0f} g", scene


def outcome(number: int, stiff: float) -> dict[str, Any]:
    """What is found of a random hand, as plain data."""
    name, scene = drawn(number, stiff)
    grasp = optimize_grasp(scene, raise_on_failure=False)
    row: dict[str, Any] = {"number": number, "name": name, "status": grasp.status.value}
    if not grasp.solved:
        return row
    row |= {"push": grasp.certificate.push}
    row |= {"contacts": " ".join(contact.name.rpartition(".")[2] for contact in grasp.contacts)}
    hand = HandInMujoco(grasp)
    try:
        row["held"] = hand.hold()[0].tolist()
        row["turned"] = []
        for axis, away in hand.turn(scene.turned):
            linear = scene.turned * grasp.certificate.compliance[:, :3] @ (scene.object.weighed * AXES[axis])
            row["turned"].append([away.tolist(), sizes(linear), sizes(hand.moved - linear)])
    except FloatingPointError as error:
        row["status"] = str(error)
    return row


def sizes(motion: Any) -> list[float]:
    """Displacement [m] and turn [rad] of a motion (6,)."""
    return [float(np.linalg.norm(motion[:3])), float(np.linalg.norm(motion[3:]))]


def main() -> None:
    """Run as many hands that hold every direction as are asked for."""
    asked, report = begun(
        __doc__,
        lambda asked: "hand_turned_stiff" if asked.stiff else "hand_turned",
        count=(24, "hands that hold every direction"),
        stiff=(0.0, "stiffness of the fingers, per that of soft ones; 0: soft ones, without limits of motion"),
        seed=0,
    )
    asked.folder.mkdir(parents=True, exist_ok=True)
    record = asked.folder / f"{'hand_turned_stiff' if asked.stiff else 'hand_turned'}_rows.jsonl"
    lines = record.read_text(encoding="utf-8").splitlines() if record.exists() else []
    rows = {row["number"]: row for row in (json.loads(line) for line in lines if line.endswith("}"))}
    columns = ["hand", "contacts", "push in any direction [N]", "held: moved [mm]"]
    columns += ["turned [deg]", "weight turned: moved at most [mm]", "first order [mm]", "apart [mm]"]
    columns += ["turned at most [deg]", "first order [deg]", "apart [deg]"]
    note = "Of 2 s, then six directions of the weight. Apart: size of the difference between motion and first order."
    table = report.table("Held in every direction", columns, note=note)
    runs, passed, number = list[Any](), dict[str, int](), asked.seed
    while len(runs) < asked.count:
        if number not in rows:
            rows[number] = outcome(number, asked.stiff)
            with record.open("a", encoding="utf-8") as file:
                # A new line first: an interruption may have torn the last one.
                file.write("\n" + json.dumps(rows[number]))
        row, number = rows[number], number + 1
        if "push" not in row:
            passed[row["status"]] = passed.get(row["status"], 0) + 1
            print(row["name"], row["status"], flush=True)
            continue
        # (kind, moved and turned): greatest of six directions.
        worst = np.max(row.get("turned") or np.full((1, 3, 2), np.nan), axis=0)
        runs.append((np.array(row["held"]), worst))
        moved, turned = 1e3 * worst[:, 0], np.degrees(worst[:, 1])
        held = 1e3 * row["held"][0], math.degrees(row["held"][1])
        table.add(row["name"], row["contacts"], row["push"], *held, *moved, *turned)
    limits = np.array([MOVES, TURNS])
    still = np.mean([(held < limits).all() for held, _ in runs])
    report.claim("part held for 2 s within 1 mm and 1 degree [1]", float(still), ">=", 0.95)
    lost = np.mean([(worst[0] > YIELDS * worst[1] + limits).any() or np.isnan(worst).any() for _, worst in runs])
    report.claim(f"part lost: beyond {YIELDS:g} times first order, 1 mm and 1 degree [1]", float(lost), "<=", 0.05)
    near = np.mean([(worst[2] < limits).all() for _, worst in runs])
    report.claim("part within 1 mm and 1 degree of first order in six directions [1]", float(near), ">=", 0.95)
    within = sum(bool((worst[0] < limits).all()) for _, worst in runs)
    if asked.stiff:
        report.claim("part within 1 mm and 1 degree in six directions [1]", within / len(runs), ">=", 0.95)
    first = sum(bool((worst[1] < limits).all()) for _, worst in runs)
    table.note += (
        f" In six directions {within} of {len(runs)} stay within 1 mm and 1 degree of where they were at rest;"
    )
    table.note += f" to first order {first} would."
    others = ", ".join(f"{count} {status}" for status, count in sorted(passed.items()))
    table.note += f" Drawn besides: {others}." if others else ""
    report.finish()


if __name__ == "__main__":
    main()
