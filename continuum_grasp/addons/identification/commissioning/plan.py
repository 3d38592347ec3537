"""Commands that show how a bench is mounted, and that are safe however it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import permutations, product
from os import PathLike

import numpy as np

from continuum_grasp.addons.identification.commissioning.bench import Bench, BenchBlock, Log
from continuum_grasp.addons.identification.experiment_plan import ExperimentPlan
from continuum_grasp.addons.identification.experiments import plan_of
from continuum_grasp.addons.identification.scene import Excitation
from continuum_grasp.addons.identification.segments import CommandDesign, patterns_of
from continuum_grasp.base import Array, CheckedArgument, InputError, NumericalError, check_arguments
from continuum_grasp.closed_loop import Plant, Readings, Wiring
from continuum_grasp.control import ControlLog
from continuum_grasp.scene import Consumer, ControlScene, Mounting, scene_of
from continuum_grasp.simulation import Trajectory

_TENSIONS = "commissioning needs drives that take tensions, or the tip moment"
_CONSUMER = Consumer(
    "commission",
    refused={
        "object": "measurements are of the finger alone: leave the object out",
        "finger.tendons.drive": f"{_TENSIONS}: identify finds the numbers of winches and motors",
        "finger.pressure": _TENSIONS,
    },
    unneeded={"loads": "commissioning needs a finger without loads", "reference": "drives follow a plan"},
)
_BLIND = Consumer.beside(
    "controller",
    lambda s: s.estimator is None or s.estimator.measured.tip is None,
    "commissioning needs estimator.measured.tip, a camera that sees the tip",
)


@check_arguments
def design_commissioning(
    scene: ControlScene | str | PathLike[str], *, duration: float = 10.0, reach: float = 0.6
) -> ExperimentPlan:
    """Plan commands that show how a bench is mounted, as a table for it to play: a row per period, held until the next.

    Whatever the order of the drives, and for a finger that is a fifth softer, commands, bends, curvature, speeds and
    zones of ``controller.bounds`` stay within their limits. Where a ``mounting`` is given, the commands are for
    this bench.

    Parameters
    ----------
    scene : ControlScene or path-like
    duration : float
        [s]
    reach : float
        Greatest share of bending range and tensions to use [1].

    Returns
    -------
    ExperimentPlan

    Raises
    ------
    InputError
        If the scene has no camera or other drives than tensions or the tip moment, or a limit allows no commands.

    Examples
    --------
    >>> from continuum_grasp.addons.identification import design_commissioning
    >>> plan = design_commissioning("configs/mpc/steady_tip.yaml", duration=4.0)
    >>> plan.command_names
    ('commanded_tension_1 [N]', 'commanded_tension_2 [N]')
    """
    known = checked(scene)
    bench = Bench(known)
    period = known.controller.step
    options = Excitation(duration=CheckedArgument("duration", duration).number(), sample=period, reach=reach)
    around = bench.model.scene
    design = CommandDesign(around, patterns_of(around), options)
    names = tuple(name for name in names_of(known) if name in (*Wiring.TIP, *bench.names))
    sigma = np.array([known.measurement_std(name) for name in names])
    limits = _limits(known, bench)
    exceeded = ""

    def block(t: Array, u: Array) -> BenchBlock:
        return BenchBlock(bench, Log(t, u, t[1:], np.zeros((len(t) - 1, len(names))), names), Mounting())

    def commands(motion: Trajectory) -> Array:
        return _limited(known, motion.u[:, : bench.model.nu])

    def allowed(motion: Trajectory) -> bool:
        nonlocal exceeded
        exceeded = next((name for name in limits(motion.t, commands(motion))), "")
        return not exceeded

    unknowns = block(np.zeros(1), np.zeros((1, 1))).unknowns
    motion = design.excited(allowed)
    if exceeded:
        raise InputError(f"no excitation is possible: it would exceed the limit of {exceeded}", key="controller.bounds")
    to_bench = Wiring.of(known.mounting, (), bench.model.u_names, "mounting").commands
    sent = np.array([to_bench(row) for row in commands(motion.rehearsal)])
    sent_names = tuple(ControlLog.COMMANDED + name for name in bench.model.u_names)
    at = np.array([unknown.start for unknown in unknowns])
    t = motion.rehearsal.t
    slopes = block(t, commands(motion.rehearsal)).predict(at)[1].reshape(len(t) - 1, len(names), -1)
    along = motion.by_segment(slopes / sigma[:, None])
    return plan_of(unknowns, motion, along, around, commands=sent, command_names=sent_names)


def checked(scene: ControlScene | str | PathLike[str]) -> ControlScene:
    """The scene, if it can be commissioned; InputError if not."""
    known = scene_of(scene, ControlScene)
    _CONSUMER.check(known)
    _BLIND.check(known)
    return known


def names_of(scene: ControlScene) -> tuple[str, ...]:
    """Names and units of what the estimator is given."""
    return Plant(scene.replaced(mounting=None, plant=scene.plant.replaced(mounting=None))).sensors.names


def _limited(scene: ControlScene, u: Array) -> Array:
    """Commands (K, nu) that change by no more than the rate limit allows."""
    greatest_change = (scene.controller.input.rate_max or math.inf) * scene.controller.step
    limited = u.copy()
    for k in range(1, len(u)):
        limited[k] = limited[k - 1] + np.clip(u[k] - limited[k - 1], -greatest_change, greatest_change)
    return limited


def _limits(scene: ControlScene, bench: Bench) -> Callable[[Array, Array], Iterator[str]]:
    """Names of the limits that commands (K, nu) at instants exceed, in any order of the drives."""
    model = bench.model
    readings = Readings.of_scene(scene, model)
    orders = list(permutations(range(model.nu)))

    def exceeded(t: Array, u: Array) -> Iterator[str]:
        # 0.8: stiffness of the softest finger that must stay within the limits, per the scene's
        for order, factor in product(orders, (1.0, 0.8)):
            ordered = u[:, order]
            p = bench.nominal.copy()
            p[0] *= factor
            try:
                at, x, held = bench.moved(t, ordered, p, float(t[-1]))
            except NumericalError:
                yield "bending range"
                continue
            w = np.repeat(model.forces(0.0), len(at), axis=0)
            if readings.range_use(x, held, w).max() > 1.0:
                yield "bending range"
            bounds = readings.bounds(x, held, w, held, scene.controller.step)
            yield from (bound.name for bound in bounds if bound.excess.max() > 1e-9 * bound.scale)

    return exceeded
