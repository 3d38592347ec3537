"""Every shipped loop of a tip on plants that differ in values, drive, wiring, sensors and call rate.

A loop has to stay near the ideal one, which is the loop on the plant that its scene describes, or to reach a safe state
that has a name; and its command must not swing. A loop that does neither without a word is silent, the worst of all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

import continuum_grasp as cg
from benchmarks.harness import CONFIGS
from benchmarks.report import Report, begun
from benchmarks.wrong_plants import FAULT, Bench, Wrong, wrongs
from continuum_grasp.base import Array, NumericalError
from continuum_grasp.closed_loop import ControlRun, run_closed_loop
from continuum_grasp.control import Command, Controller, Outputs, Setpoints

LOOPS = tuple(path.stem for path in sorted((CONFIGS / "mpc").glob("*.yaml")) if cg.load(path).reference.tip is not None)
"""Those whose tip has a setpoint, by which they are judged."""
DURATION = {"nitinol_moment": 12.0, "trunk_2m": 14.0}
"""Of a run [s]; rods whose first mode is six times slower have eight and six seconds after their last step."""
OTHERS, DRIFTING = 5.0, 5.0
"""The same of other loops, and how much longer where a sensor drifts, slowly, until it contradicts the others."""
REPEATED = {"tip_arc": 1.0}
"""Period of setpoints that would stand still before the end of the run [s]."""
LAST = 1.0
"""Time at the end over which errors and commands are judged [s]."""
NEAR = 0.1
"""Error beyond the ideal loop's that still counts as near, in lengths: where the supervisor has the tip away."""
SWINGS = 0.15
"""Root mean square change of the command per period, in shares of its rate limit, beyond which a command swings: a
sine at the first mode's frequency with that rate moves the tip by a fifth of the length; ideal loops have 0.06."""
MILD_LOOPS = ("steady_tip", "keep_out")
"""Loops that mild differences may cost 2 mm beyond the ideal loop's error."""
_KNOCK = 0.2
"""By how much earlier or later than the ideal loop another one may report a knock: the supervisor's window [s]."""


@dataclass
class Outcome:
    """What came of one run."""

    loop: str
    wrong: Wrong
    seed: int
    error: float
    """Root mean square distance of the tip from its setpoint in the last second [m]."""
    ideal: float
    """The same of the ideal loop."""
    length: float
    swing: float
    """Root mean square change of the command per period in the last second, as a share of its rate limit."""
    worst_swing: float
    """Greatest of all seconds."""
    reported: float
    """When a health other than ok was first reported that the ideal loop has not [s]; NaN never."""
    tripped: float
    """When it went to the safe state for good [s]; NaN: it did not."""
    text: str
    """What the first report said."""
    lost: bool
    """Whether the plant's motion did not stay finite."""

    @property
    def safe(self) -> bool:
        """Whether it ended in a named safe state."""
        return not math.isnan(self.tripped) and not self.lost

    @property
    def swings(self) -> bool:
        """Whether its command swings at the end."""
        return self.lost or self.swing > SWINGS

    @property
    def near(self) -> bool:
        """Whether it ended near the ideal loop."""
        return not self.lost and not self.swings and self.error <= self.ideal + NEAR * self.length

    @property
    def silent(self) -> bool:
        """Whether it is bad and nothing was said."""
        return not self.near and not self.safe and math.isnan(self.reported)

    @property
    def verdict(self) -> str:
        """In a word."""
        if self.safe:
            return "safe state"
        if self.near:
            return "near" if math.isnan(self.reported) else "near, reported"
        return "SILENT" if self.silent else "swings, reported" if self.swings else "far, reported"


class _Clocked:
    """A controller that is given the time of each call by its plant."""

    def __init__(self, control: Controller, plant: Any) -> None:
        self._control, self._plant = control, plant

    def __getattr__(self, name: str) -> Any:
        return getattr(self._control, name)

    def step(self, *given: Any, **named: Any) -> Command:
        return self._control.step(*given, time=self._plant.t, **named)


def run_of(bench: Bench, loop: str, wrong: Wrong, seed: int) -> tuple[ControlRun, bool]:
    """A closed loop, and whether the plant's motion was lost in it."""
    scene, control = bench.scene, bench.control
    plant = bench.plant(wrong, seed)
    points = Setpoints.of(Outputs.of(scene.controller.cost, control.prediction), scene.reference)
    again = REPEATED.get(loop, math.inf)
    duration = DURATION.get(loop, OTHERS) + DRIFTING * (wrong.fault == "drift")
    # Repeated ones are functions of time.
    functions = {
        name: lambda t, part=part: points.rows(np.atleast_1d(t % again))[0, part] for name, part in points.parts.items()
    }
    driven_by = functions if math.isfinite(again) else None
    driven = _Clocked(control, plant) if wrong.clock else control
    asked = scene.model_copy(update={"duration": duration})
    try:
        return run_closed_loop(asked, controller=driven, plant=plant, functions=driven_by), False
    except NumericalError as error:
        return error.result, True


def outcome(
    loop: str, wrong: Wrong, seed: int, run: ControlRun, lost: bool, ideal: float, usual: tuple[float, float]
) -> Outcome:
    """Judge a run; ``usual``: between which times the ideal loop reports too, of a knock [s]."""
    error = np.linalg.norm(run.tip[:-1] - run.r[:-1, :2], axis=1)
    last = max(1, round(LAST / run.period))
    change = np.diff(run.u, axis=0)
    limit = (run.scene.controller.input.rate_max or math.inf) * run.scene.controller.step
    seconds = [_rms(change[k : k + last]) for k in range(0, max(1, len(change) - last + 1), last)]
    odd = [k for k, health in enumerate(run.health) if health != "ok" and not usual[0] <= run.t[k] <= usual[1]]
    safe = run.health[-1:] == ("tripped",) or run.status[-1:] == ("safe_ramp",)
    since = next((k + 1 for k in range(len(run.health) - 1, -1, -1) if run.health[k] != "tripped"), 0)
    mean = _rms(error[-last:])
    return Outcome(
        loop=loop,
        wrong=wrong,
        seed=seed,
        error=mean,
        ideal=mean if math.isnan(ideal) else ideal,
        length=run.length,
        swing=_rms(change[-last:]) / limit,
        worst_swing=max(seconds) / limit,
        reported=float(run.t[odd[0]]) if odd else math.nan,
        tripped=float(run.t[since]) if safe else math.nan,
        text=run.health_texts[odd[0]] if odd else "",
        lost=lost,
    )


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0


def outcomes(loop: str, seeds: Sequence[int], only: Sequence[str] = ()) -> list[Outcome]:
    """All runs of a loop; the ideal one first."""
    bench = Bench(cg.load(CONFIGS / "mpc" / f"{loop}.yaml"))
    found: list[Outcome] = []
    for seed in seeds:
        ideal, usual = math.nan, (math.inf, -math.inf)
        for wrong in wrongs(bench.scene):
            if only and found and wrong.group not in only and wrong.group != "as shipped":
                continue
            run, lost = run_of(bench, loop, wrong, seed)
            one = outcome(loop, wrong, seed, run, lost, ideal, usual)
            if math.isnan(ideal):
                ideal, said = one.error, run.t[:-1][np.array(run.health) != "ok"]
                usual = (said[0] - _KNOCK, said[-1] + _KNOCK) if len(said) else usual
            found.append(one)
            print(
                f"{loop:15s} {wrong.group:10s} {wrong.name:42s} {seed} {1e3 * one.error:7.2f} mm (ideal "
                f"{1e3 * one.ideal:.2f}) swing {one.swing:.3f} {one.worst_swing:.3f} said {one.reported:.2f} trip "
                f"{one.tripped:.2f} {one.verdict} {one.text[:60]}",
                flush=True,
            )
    return found


def add(report: Report, found: Sequence[Outcome]) -> None:
    """Claims and tables."""
    report.claim("cases", len(found), ">=", 500)
    report.claim("silent: bad and no word of it", sum(one.silent for one in found), "<=", 0)
    report.claim("command swings at the end", sum(one.swings for one in found), "<=", 0)
    lost = sum(not (one.near or one.safe) for one in found)
    report.claim("neither near the ideal loop nor in a safe state", lost, "<=", 0)
    for loop in MILD_LOOPS:
        more = [1e3 * (one.error - one.ideal) for one in found if one.loop == loop and one.wrong.mild]
        what = f"{loop}: error of mild differences beyond the ideal loop's [mm]"
        report.claim(what, max(more, default=math.nan), "<=", 2)
    ideal = [one for one in found if one.wrong.group == "as shipped"]
    false = sum(not math.isnan(one.reported) for one in ideal if one.loop != "pulse")
    report.claim("reports on plants as shipped, but for the knock of pulse", false, "<=", 0)
    loops = sorted({one.loop for one in found})
    longer = ", ".join(f"{loop}: {duration:g} s" for loop, duration in DURATION.items())
    note = (
        f"Root mean square distance of the tip from its setpoint over the last {LAST:g} s of {OTHERS:g} s "
        f"({longer}; {DRIFTING:g} s more where a sensor drifts), of the seeds "
        "the worst [mm]; r: reported, T: tripped into the safe state (t: of some seeds), F: more than "
        f"{NEAR:g} L from the ideal loop and not tripped, S: the command swings, !: silent. Swing: r.m.s. change of "
        f"the command per period as a share of the rate limit, bound {SWINGS:g}. Sensors fail after {FAULT:g} s; all "
        "else is wrong from the start."
    )
    table = report.table("Last second", ["", "plant", *loops, "greatest swing"], note=note)
    for group, name in dict.fromkeys((one.wrong.group, one.wrong.name) for one in found):
        same = [one for one in found if (one.wrong.group, one.wrong.name) == (group, name)]
        cells = [_cell([one for one in same if one.loop == loop]) for loop in loops]
        table.add(group, name, *cells, max(one.swing for one in same))
    table = report.table("Verdicts", ["", *_VERDICTS])
    for loop in [*loops, "all"]:
        some = [one for one in found if loop in (one.loop, "all")]
        table.add(loop, *(sum(one.verdict == verdict for one in some) for verdict in _VERDICTS))


_VERDICTS = ("near", "near, reported", "safe state", "far, reported", "swings, reported", "SILENT")


def _cell(same: Sequence[Outcome]) -> str:
    if not same:
        return "–"
    marks = "r" * any(not math.isnan(one.reported) for one in same)
    safe = [one.safe for one in same]
    marks = "T" if all(safe) else marks + "t" * any(safe)
    marks += "F" * any(not one.near and not one.safe and not one.swings for one in same)
    marks += "S" * any(one.swings for one in same) + "!" * any(one.silent for one in same)
    return f"{1e3 * max(one.error for one in same):.1f} {marks}".strip()


def main() -> None:
    """Run the loops asked for and write the report."""
    asked, report = begun(
        __doc__,
        "robustness",
        loops=(LOOPS, ""),
        groups=([str], "of wrong plants; all where not given"),
        seeds=(2, "how many noises of each"),
        seed=(0, "the first"),
        jobs=1,
    )
    seeds = range(asked.seed, asked.seed + asked.seeds)
    with ProcessPoolExecutor(asked.jobs) as pool:
        tasks = [pool.submit(outcomes, loop, seeds, asked.groups) for loop in asked.loops]
        add(report, [one for task in tasks for one in task.result()])
    report.finish()


if __name__ == "__main__":
    main()
