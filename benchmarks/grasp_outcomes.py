"""What the grasp optimizer makes of a random scene, judged by what the oracles know of it.

Every grasp that the package calls verified is checked once more with the oracle's own equations. Times are processor
time, so that a busy machine changes them little: what the package measures by the clock, times the scene's share of a
core.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from typing import Any

from benchmarks.grasp_oracle.causes import PAIRS, tightened
from benchmarks.grasp_oracle.check import LIMITS, residuals
from benchmarks.grasp_oracle.numbers import numbers
from benchmarks.grasp_oracle.scenes import scene_of
from benchmarks.grasp_oracle.search import Search
from continuum_grasp.grasp import GraspResult, GraspStatus, optimize_grasp
from continuum_grasp.scene import GraspScene

LITTLE = 1e-4
"""Part of the greatest tensions that is added to both before they are compared."""
CLOSE = 5e-3
"""Part of the oracle's tension by which a grasp may be worse."""
THROUGH = 1e-6
"""Depth of a finger in the object, per its length, beyond which a grasp with less tension owes it to that."""
NUMBERS = 1e-2
"""Part by which a number of a reason may differ."""
MARGIN = 1e-3
"""By what part more than a number that the oracle did not find is granted to see whether it is enough."""
REASONS = {"bend": "bending range", "clearance": "clearance at the supports"}
"""Causes whose reasons go by another name."""


@dataclass
class Outcome:
    """What the optimizer made of one scene."""

    seed: int
    what: str
    status: str
    good: bool = False
    note: str = ""
    seconds: dict[str, float] = field(default_factory=dict)
    iterations: int = 0
    worst: dict[str, float] = field(default_factory=dict)
    tension: float = math.nan
    close: bool = False
    better: bool = False
    right: bool = False
    first: bool = False
    number: bool = False

    @property
    def false(self) -> bool:
        """Whether a grasp was called verified that does not hold."""
        return any(self.worst[name] > limit for name, limit in LIMITS.items() if name in self.worst)

    @property
    def refused(self) -> bool:
        """Whether the scene was called infeasible."""
        return self.status == GraspStatus.INFEASIBLE.value


def outcome(kind: str, row: dict[str, Any], effort: str = "") -> Outcome:
    """What becomes of the scene of an answer; ``effort`` is that of the search, where it is not the scene's own."""
    drawn = "one" if kind == "fresh" else kind
    scene = tightened(row) if kind in ("none", "both") else scene_of(drawn, row["seed"])
    if effort:
        scene = scene.changed({"solver.effort": effort})
    return {"none": _without, "both": _without_two}.get(kind, _held)(kind, row, scene)


def solved(scene: GraspScene) -> tuple[GraspResult | None, dict[str, float], str]:
    """The result of a scene, its processor times, and what was raised in place of a result."""
    began, used = time.perf_counter(), time.process_time()
    try:
        result = optimize_grasp(scene, raise_on_failure=False)
    except Exception as error:  # whatever it is, it is an outcome
        return None, {}, f"{type(error).__name__}: {error}".splitlines()[0][:200]
    everything, used = time.perf_counter() - began, time.process_time() - used
    taken = {k: used / everything * float(v) for k, v in result.statistics.items() if k.endswith("_seconds")}
    return result, taken | {"all_seconds": used}, ""


def _run(scene: GraspScene, what: str, seed: int) -> tuple[GraspResult | None, Outcome]:
    """The result, and an outcome with its status and times."""
    result, seconds, note = solved(scene)
    if result is None:
        return None, Outcome(seed, what, "error", note=note)
    seconds["after_build_seconds"] = seconds["total_seconds"] - seconds["build_seconds"]
    out = Outcome(seed, what, str(result.status), seconds=seconds, iterations=int(result.statistics["iterations"] or 0))
    if result.solved:
        out.worst, out.tension = residuals(result.scene, result.arrays), float(result.tension)
    return result, out


def _held(kind: str, row: dict[str, Any], scene: GraspScene) -> Outcome:
    """A scene that has a grasp."""
    setup = scene.setups[0]
    what = f"{scene.object.shape}, {setup.family}, gravity {list(scene.gravity)}"
    what += f", {'middle' if setup.middles[0] == 'on' else 'tip'}" if kind in ("one", "fresh") else ""
    what += ", palm" if kind == "three" and scene.supports else ""
    result, out = _run(scene, what, row["seed"])
    if result is None or not result.solved:
        out.note = out.note or (result.message if result else "")
        return out
    unit = LITTLE * sum(f.tendons.max_tension for f in scene.named_fingers.values() if f.tendons is not None)
    share = (result.tension + unit) / (row["tension"] + unit)  # the least may be none at all
    out.close, out.better = share <= 1.0 + CLOSE, share < 1.0 - CLOSE
    out.good = not out.false and out.close
    out.note = f"{result.tension:.5g} N, oracle {row['tension']:.5g} N ({100 * (share - 1):+.2f} %)"
    if out.better and out.worst["penetration"] > THROUGH:
        out.note += f", {out.worst['penetration']:.1e} of the length through the object"
    return out


def _without(kind: str, row: dict[str, Any], scene: GraspScene) -> Outcome:
    """A scene that has none, because of one limit."""
    result, out = _run(scene, row["cause"], row["seed"])
    if result is None or _found(result, out):
        return out
    name = REASONS.get(row["cause"], row["cause"])
    for k, reason in enumerate(result.reasons):
        if reason.name == name:
            number = abs(reason.needed - reason.limit) if name == "reach" else reason.needed
            out.right, out.first = True, k == 0
            out.number = abs(number / row["needed"] - 1.0) <= NUMBERS or _milder(row, number)
            out.note = f"{number:.5g}, oracle {row['needed']:.5g}"
    return out


def _without_two(kind: str, row: dict[str, Any], scene: GraspScene) -> Outcome:
    """A scene that has none, because of two limits; either of the forces' limits may be the second."""
    result, out = _run(scene, " and ".join(row["causes"]), row["seed"])
    if result is None or _found(result, out):
        return out
    shape, seconds = REASONS.get(row["causes"][0], row["causes"][0]), {second for _, second in PAIRS}
    for k, reason in enumerate(result.reasons):
        pair = {each.name: float(each.needed) for each in (reason, *getattr(reason, "also", ()))}
        second = next(iter(set(pair) & seconds), "")
        if set(pair) == {shape, second}:
            out.right, out.first = True, k == 0
            least = pair[shape], second, pair[second]
            out.number = _enough(row, *least, 1.0 + NUMBERS) and not _enough(row, *least, 1.0 - NUMBERS)
            out.note = "; ".join(f"{name} {needed:.5g}" for name, needed in pair.items())
            break
    return out


def _found(result: GraspResult, out: Outcome) -> bool:
    """Whether there is a grasp after all; notes what was said otherwise."""
    out.good = out.refused
    if result.solved:
        out.note = f"{result.tension:.5g} N: " + ("does not hold" if out.false else "holds, so the oracle missed it")
    else:
        out.note = "; ".join(f"{r.name} {r.needed:.4g}" for r in result.reasons) or result.message
    return result.solved


def _enough(row: dict[str, Any], shape: float, second: str, force: float, factor: float) -> bool:
    """Whether the oracle finds a grasp with a share of both numbers (less mass, where that is the second)."""
    causes, limits = [row["causes"][0]], [shape * factor]
    known = {row["causes"][1]: row["limits"][1]} | {second: force / factor if second == "mass" else force * factor}
    scene = tightened({**row, "causes": causes + list(known), "limits": limits + list(known.values())})
    return Search(numbers(scene)).best() is not None


def _milder(row: dict[str, Any], number: float) -> bool:
    """Whether a number asks for less than the oracle knows to be needed, and a checked grasp shows it is enough."""
    sign = -1.0 if row["cause"] == "mass" else 1.0
    if row["cause"] in ("reach", "clearance") or sign * (number - row["needed"]) > 0.0:
        return False
    scene = tightened({**row, "limit": number * (1.0 + sign * MARGIN)})
    result, out = _run(scene, "", 0)
    return result is not None and result.solved and not out.false
