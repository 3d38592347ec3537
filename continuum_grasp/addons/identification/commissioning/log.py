"""From a log of a bench's commands and readings to how it is mounted and connected."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations, product
from os import PathLike
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from continuum_grasp.addons.identification.commissioning.bench import FRICTION, Bench, BenchBlock, Log, camera_through
from continuum_grasp.addons.identification.commissioning.plan import checked, design_commissioning, names_of
from continuum_grasp.addons.identification.commissioning.result import Alternative, Commissioning
from continuum_grasp.addons.identification.doubts import doubts, doubts_of_elements
from continuum_grasp.addons.identification.experiment_plan import ExperimentPlan
from continuum_grasp.addons.identification.fit import estimates
from continuum_grasp.addons.identification.path_block import MOST_STEPS
from continuum_grasp.addons.identification.periods import columns_of
from continuum_grasp.addons.identification.plausibility import PART
from continuum_grasp.addons.identification.problem import FitProblem, Solution
from continuum_grasp.addons.identification.unknowns import DELAY, LAG, Unknown
from continuum_grasp.base import Array, InputError, NumericalError, SolverError, check_arguments, split_unit
from continuum_grasp.closed_loop import Plant, Wiring
from continuum_grasp.control import ControlLog
from continuum_grasp.scene import ControlScene, Mounting

Fitted = tuple[float, BenchBlock, FitProblem, Solution]
"""A fit of one way in which the bench may be connected, and how far it misses the tip (r.m.s.) [m]."""

_FOLLOWS = 0.5
"""Correlation from which a reading follows a command [1]: of noise alone, over 500 samples, it is below 0.2."""
_NEAR = 3.0
"""Connections that miss the tip by so many times the best are not fitted [1]: before the fit, a finger that is a fifth
stiffer than its model misses by 10 % of its length, twisted lines by 50 %."""
_INSTANTS = 500
"""Most instants of a log that are fitted [1], evenly spread."""


@check_arguments
def commission(
    scene: ControlScene | str | PathLike[str],
    log: ControlLog | str | PathLike[str] | None = None,
    *,
    duration: float = 10.0,
    reach: float = 0.6,
    plant: Callable[[ControlScene], Plant] = Plant,
    progress: Callable[[float], None] | None = None,
) -> Commissioning:
    """Find how a bench is mounted and connected, from a log of commands and readings as the bench counts them.

    It finds position, angle, scale and handedness of the camera; order and signs of drives and load cells, and zeros
    of both; lag and delay; and stiffness and damping beside them. Connections are tried one by one, all numbers by
    least squares. ``undetermined`` names facts that the log does not show, and an unknown configuration is not
    written.

    Parameters
    ----------
    scene : ControlScene or path-like
        The closed loop, whose estimator measures the tip. Only ``camera.mirrored`` of its ``mounting`` counts, if it
        is stated.
    log : ControlLog or path-like, optional
        The bench's numbers while the plan of `design_commissioning` was played, or any others that move all drives.
        None: the plan is played on the scene's simulated ``plant``.
    duration, reach : float
        Duration [s] and reach of the plan that is played.
    plant : callable
        Returns the plant of a scene, on which the plan is played.
    progress : callable, optional
        Called with the share done so far, 0 to 1.

    Returns
    -------
    Commissioning

    Raises
    ------
    InputError
        If the log lacks commands or the tip, or the scene cannot be commissioned.
    SolverError
        If no connection fits.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> turned = {"plant.mounting": {"camera": {"position": [0.004, -0.006], "angle": 0.1}}}
    >>> scene = cg.load("configs/mpc/steady_tip.yaml", {**turned, "mounting": {"camera": {"mirrored": False}}})
    >>> found = cg.commission(scene, duration=4.0)
    >>> found.status, round(found["camera_angle"], 1)
    ('identified', 0.1)
    """
    known = checked(scene)
    played = None
    if log is None:
        log = played = _played(known, design_commissioning(known, duration=duration, reach=reach), plant)
    commissioned = _commissioned(known, log, progress or (lambda share: None))
    idle = [line for line in commissioned.mounting.drives if line.sign < 0]
    turned_before = known.mounting is not None and bool(known.mounting.drives)
    if played is None or commissioned.status != "undecided" or not idle or turned_before:
        return replace(commissioned, log=played)
    # A drive that turns the other way shows nothing until it is commanded so.
    lines = commissioned.mounting.drives
    turned = Mounting.lines(range(1, len(lines) + 1), [line.sign for line in lines])
    again = known.replaced(mounting=(known.mounting or Mounting()).replaced(drives=turned))
    log = _played(known, design_commissioning(again, duration=duration, reach=reach), plant)
    return replace(_commissioned(known, log, progress or (lambda share: None)), log=log)


def _played(scene: ControlScene, plan: ExperimentPlan, plant: Callable[[ControlScene], Plant]) -> ControlLog:
    """Log of the simulated plant, as its bench counts, while it follows a plan."""
    simulated = plant(scene.replaced(mounting=None))
    readings = []
    # 3.0: time in which a simulated plant comes to rest before a plan is played [s]
    for _ in range(math.ceil(3.0 / simulated.period)):  # its drives and its model do not begin alike
        simulated.advance(plan.commands[0])
    for u in plan.commands:
        readings.append(simulated.measure())
        simulated.advance(u)
    names = simulated.model.u_names, simulated.sensors.names
    return ControlLog(plan.t, plan.commands, np.array(readings), *names, name="simulated plant")


def _log_of(scene: ControlScene, bench: Bench, given: ControlLog | str | PathLike[str]) -> tuple[Log, list[str]]:
    """The log's commands and readings, at instants that have them all, and what it lacks."""
    names = [name for name in names_of(scene) if name in bench.names]
    commands = [ControlLog.COMMANDED + name for name in bench.model.u_names]
    read = columns_of(given, (*names, *commands), scene.controller.step, scene)
    columns = read.channels
    file = None if isinstance(given, ControlLog) else str(given)
    absent = [split_unit(name).name for name in (*Wiring.TIP, *commands) if not columns[name][0].size]
    if absent:
        raise InputError(f"the log has no {', '.join(absent)}", file=file)
    t = np.unique(np.concatenate([columns[name][0] for name in commands]))
    if (t[-1] - t[0]) / bench.step > MOST_STEPS:
        message = f"the log lasts {t[-1] - t[0]:g} s, more than {MOST_STEPS} steps of the motion: check the unit of t"
        raise InputError(f"{message}, or give a part of it", file=file)
    # a command that has no cell at an instant stays as it was
    held = [np.clip(np.searchsorted(columns[name][0], t, side="right") - 1, 0, None) for name in commands]
    u = np.column_stack([columns[name][1][at] for name, at in zip(commands, held, strict=True)])
    present = [name for name in names if columns[name][0].size]
    at = columns[present[0]][0]
    if scene.log.max_age is not None:
        columns |= {name: _last(*columns[name], at, scene.log.max_age) for name in present[1:]}
    for name in present:
        at = at[np.isin(at, columns[name][0])]
    at = at[(at >= t[0]) & (at <= t[-1])]
    if at.size < 50:
        raise InputError(f"the log has {at.size} instants with all readings; expected at least 50", file=file)
    at = at[:: math.ceil(at.size / _INSTANTS)]
    rows = np.column_stack([columns[name][1][np.isin(columns[name][0], at)] for name in present])
    log = Log(t, u, at, rows, tuple(present), read.notes, read.unread)
    return log, [split_unit(name).name for name in names if name not in present]


def _last(t: Array, values: Array, at: Array, max_age: float) -> tuple[Array, Array]:
    """Last samples (K,) at instants, those that are no older than that, and their instants."""
    k = np.searchsorted(t, at, side="right") - 1
    recent = (k >= 0) & (at - t[k] <= max_age)
    return at[recent], values[k[recent]]


def _commissioned(scene: ControlScene, given: Any, progress: Callable[[float], None]) -> Commissioning:
    bench = Bench(scene)
    log, missing = _log_of(scene, bench, given)
    start = np.array([unknown.start for unknown in bench.unknowns])
    nu = bench.model.nu
    cells = _followed(bench, log, start)
    mute = [name for name in log.names if name not in Wiring.TIP and name not in cells]
    used = [k for k, name in enumerate(log.names) if name not in mute]
    log = log._replace(readings=log.readings[:, used], names=tuple(log.names[k] for k in used))
    ends = permutations(range(1, nu + 1))
    ways = [
        Mounting(drives=Mounting.lines(order, signs)) for order, signs in product(ends, product((1, -1), repeat=nu))
    ]
    stated = scene.mounting is not None and "mirrored" in scene.mounting.camera.model_fields_set
    sides = [scene.mounting.camera.mirrored] if stated and scene.mounting is not None else [False, True]
    rough = sorted(_rough(bench, log, ways, sides, start), key=lambda trial: trial[0])
    chosen = [trial for trial in rough if trial[0] <= _NEAR * rough[0][0]]
    fits = list[Fitted]()
    for k, (_, way) in enumerate(chosen):
        block = BenchBlock(bench, log, _with_cells(bench, way, cells))
        problem = FitProblem([block], block.unknowns)
        try:
            solution = problem.solve(lambda share: None)
        except (SolverError, NumericalError):
            continue
        tip = problem.groups["tip"]
        missed = (solution.predictions - problem.measured)[tip] / solution.values[len(start) + 3]
        fits.append((float(np.sqrt(2.0 * np.mean(missed**2))), block, problem, solution))
        progress((k + 1.0) / len(chosen))
    if not fits:
        raise SolverError("no connection of the drives fits the log", status="no fit", advice="check log and finger")
    fits.sort(key=lambda fit: fit[0])
    # 1.5: connections whose fits miss the tip by so many times the best one or less are not distinguished
    alike = [fit for fit in fits if fit[0] <= 1.5 * fits[0][0]]
    return _result(scene, bench, log, cells, alike, [*missing, *(split_unit(name).name for name in mute)])


def _followed(bench: Bench, log: Log, start: Array) -> dict[str, tuple[int, int]]:
    """Command, from 0, and sign that each measured tension follows, by its name; none of those that follow none."""
    names = [name for name in log.names if name not in Wiring.TIP]
    if not names:
        return {}
    lag = dict(zip((unknown.name for unknown in bench.unknowns), start, strict=True))
    late = lag[DELAY] + bench.scene.finger.drive_order * lag.get(LAG, 0.0)
    last = np.clip(np.searchsorted(log.t, log.at - late, side="right") - 1, 0, None)
    commands = log.u[last]
    seen = log.readings[:, [log.names.index(name) for name in names]]
    together = np.corrcoef(np.hstack([seen, commands]).T)[: len(names), len(names) :]
    together = np.nan_to_num(together)
    rows, columns = linear_sum_assignment(-np.abs(together))
    return {
        names[r]: (int(c), 1 if together[r, c] > 0.0 else -1)
        for r, c in zip(rows, columns, strict=True)
        if abs(together[r, c]) > _FOLLOWS
    }


def _with_cells(bench: Bench, way: Mounting, cells: Mapping[str, tuple[int, int]]) -> Mounting:
    """A mounting with lines of all load cells, from commands and signs that some follow; a drive may turn the other
    way.
    """
    drives = {name: way.drives[c] for name, (c, _) in cells.items()}
    free = iter(sorted({*range(1, bench.model.nu + 1)} - {drive.of for drive in drives.values()}))
    ends = list[int]()
    signs = list[int]()
    for name in bench.model.u_names:
        if name in cells:
            ends.append(drives[name].of)
            signs.append(cells[name][1] * drives[name].sign)
        else:
            ends.append(next(free))
            signs.append(1)
    return way.replaced(tensions=Mounting.lines(ends, signs))


def _rough(
    bench: Bench, log: Log, ways: Sequence[Mounting], sides: Sequence[bool], start: Array
) -> Iterator[tuple[float, Mounting]]:
    """Distance [m] that the nearest camera leaves of the nominal finger, for lines of the drives and each handedness,
    and the mounting with that camera.
    """
    seen = log.readings[:, [log.names.index(name) for name in Wiring.TIP]]
    then = log.at - start[[unknown.name for unknown in bench.unknowns].index(DELAY)]
    for way in ways:
        t, base = bench.shown(log, way, start)
        tip = np.column_stack([np.interp(then, t, base[:, c]) for c in (0, 1)])
        for mirrored in sides if np.ptp(tip, axis=0).max() > 1e-6 else ():
            found, left = camera_through(tip, seen, way.replaced(camera={"mirrored": mirrored}))
            yield left / found.camera.scale, found


def _result(
    scene: ControlScene,
    bench: Bench,
    log: Log,
    cells: Mapping[str, tuple[int, int]],
    alike: Sequence[Fitted],
    missing: Sequence[str],
) -> Commissioning:
    missed, block, problem, solution = alike[0]
    way = block.way
    # friction that is left out shifts the camera by more than the noise
    friction = [block.by_friction(solution.values)] if scene.finger.tendons else []
    found = problem.inferred(solution, *((Unknown(FRICTION, "1", FRICTION, typical=0.01), slope) for slope in friction))
    step = found.values - np.pad(solution.values, (0, len(friction)))
    predictions = solution.predictions + np.column_stack([solution.jacobian, *friction]) @ step
    doubted = doubts(problem, solution._replace(predictions=predictions), found.inference, laws=False)
    doubted += doubts_of_elements(problem, solution, found)
    mounting = block.mounting(found.values[: len(block.unknowns)])
    if len(cells) < bench.model.nu:
        mounting = mounting.model_copy(update={"tensions": ()})
    moved = np.ptp(bench.commanded(log.u, mounting), axis=0)
    # 0.2: share of its command's range in which a tendon is pulled, below which the drive moves nothing
    idle = [c for c, line in enumerate(way.drives) if moved[line.of - 1] < 0.2 * np.ptp(log.u[:, c])]
    undetermined = [
        f"the log has no {name}, or it follows no command: its line is not known; leave it out of estimator.measured, "
        "or log it while its tendon is pulled"
        for name in missing
    ]
    undetermined += [
        f"drive {c + 1} moves nothing: it turns the other way (sign: {way.drives[c].sign:+d} in mounting.drives), or "
        "is dead"
        for c in idle
    ]
    if len(alike) > 1:
        undetermined.append("; or ".join(_words(of.way) for _, of, *_ in alike))
    if len(bench.zeros) < bench.model.nu and cells:
        undetermined.append(
            "a zero shared by both drives cannot be distinguished from one shared by both load cells: it counts as "
            "a zero of the load cells"
        )
    status = "identified" if len(alike) == 1 and not idle and not missing else "undecided"
    status = status if missed <= PART * scene.finger.rod.length else "mismatch"
    return Commissioning(
        **estimates(found.unknowns, found.values, found.inference),
        sigma=solution.sigma,
        **problem.predicted(solution.values, predictions),
        scene=scene,
        status=status,
        warnings=(*log.notes, *found.inference.warnings, *doubted),
        statistics={
            "ways": len(alike),
            "evaluations": solution.evaluations,
            **({"unread": log.unread} if log.unread else {}),
        },
        mounting=mounting,
        alternatives=tuple(Alternative(_words(of.way), missed) for missed, of, *_ in alike),
        undetermined=tuple(undetermined),
    )


def _words(way: Mounting) -> str:
    lines = ", ".join(f"drive {c} on {'-' if of.sign < 0 else ''}{of.of}" for c, of in enumerate(way.drives, 1))
    return f"{lines}, camera {'mirrored' if way.camera.mirrored else 'not mirrored'}"
