"""Releases of a rod by other libraries, in an interpreter of their own that stays up while it is asked.

``pip install mujoco pyelastica soromox jsrm`` into it (tried: mujoco 4.0.0, pyelastica 1.0.0, soromox 0.5.0,
jsrm 0.0.18) and name it in the environment variable ``CONTINUUM_GRASP_PEERS_PYTHON``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from benchmarks.baselines import Peer
from benchmarks.baselines.release_ours import rms_error
from benchmarks.report import Table
from continuum_grasp.addons.chains.write import export_mjcf
from continuum_grasp.scene import Scene
from continuum_grasp.simulation.accuracy.motion import TipMotion
from continuum_grasp.simulation.accuracy.truth import Truth

_SHEAR_RATIO = 1.0 / 2.6
_PLACES = 2001
HINGES = (5, 10, 20, 40, 80)
"""Of the chains that are exported."""
LABELS = {"mujoco": "MuJoCo", "pyelastica": "PyElastica", "soromox": "SoRoMoX", "jsrm": "JSRM"}


@dataclass(frozen=True)
class PeerRun:
    """One second of motion by a peer."""

    steps: int
    """Per second."""
    cold: float
    """Time to build, compile and make the first step [s]."""
    tip: np.ndarray
    """(T, 2) at equally spaced instants of the second [m]; NaN from where it ran away; empty if not asked for."""


class ReleasePeers(Peer):
    """A process with the peer libraries."""

    def __init__(self) -> None:
        super().__init__("release_server.py")

    def version(self, package: str) -> str:
        """Version of a package, or raises ``PeerError`` where it is not installed."""
        return str(self.ask(version=package)["version"])

    def make(
        self, name: str, kind: str, rod: Mapping[str, Any], settings: Mapping[str, Any], frames: int = 200
    ) -> PeerRun:
        """Build a simulation under a name and, with frames, run it for a second.

        ``kind`` is mujoco, pyelastica, soromox or jsrm, whose class in ``mujoco_chain``, ``pyelastica_rod`` or
        ``segment_release`` takes the settings; ``rod`` is from ``describe_rod``. ``frames`` are instants in the second,
        or as many of them as are ends of steps; 0 for none.
        """
        reply = self.ask(make=name, kind=kind, rod=dict(rod), settings=dict(settings), frames=frames)
        tip = np.empty((0, 2)) if reply["tip"] is None else np.array(reply["tip"], dtype=float)
        return PeerRun(reply["steps"], reply["cold"], tip)

    def run(self, name: str, seconds: float) -> None:
        """Step one through a span of time."""
        self.ask(run=name, seconds=seconds)


def describe_rod(scene: Scene, truth: Truth) -> dict[str, Any]:
    """A release as the peers are given it: base at the origin, pointing along +x, at time zero in the exact shape.

    Stiffness and mass are those of cells of equal length; a tendon that pulls is a moment up to its end.
    """
    finger = scene.finger
    profile, length = finger.profile, finger.profile.length
    if not math.isclose(finger.base.angle, -math.pi / 2) or any(m.at < length for m in finger.masses):
        raise ValueError("the peers can take a horizontal rod with a mass at its tip only")
    if scene.initial.pose == "straight":
        bend = np.zeros(_PLACES)
    else:
        held = truth.cases[-1 if scene.initial.held_by else 0].rod
        bend = held.angle(np.linspace(0.0, length, _PLACES)) - finger.base.angle
    middles = (np.arange(_PLACES - 1) + 0.5) * length / (_PLACES - 1)
    stiffness, density = profile.bending_stiffness(middles), profile.linear_density(middles)
    tensions = () if scene.actuation is None else scene.actuation.tensions or ()  # constant ones [N]
    moments = [(channel.to, float(np.dot(channel.arms, tensions))) for channel in finger.channels if tensions]
    if any(channel.shape(0.5 * channel.to) != 1.0 for channel in finger.channels):
        raise ValueError("the peers can take tendons of constant offset only")
    return {
        "length": length,
        "uniform": profile.uniform and not moments,
        "diameter": math.sqrt(4.0 * density[0] / (math.pi * finger.rod.density)),  # of a solid round section
        "density": finger.rod.density,
        "youngs_modulus": finger.rod.youngs_modulus,
        "mass_per_length": float(density[0]),
        "bending_stiffness": float(stiffness[0]),
        "rotary_inertia": float(profile.rotary_inertia(0.0)),
        "stiffness_along": stiffness.tolist(),
        "density_along": density.tolist(),
        "shear_ratio": _SHEAR_RATIO,
        "damping": finger.damping.material,
        "tip_mass": sum(mass.mass for mass in finger.masses),
        "gravity": list(scene.gravity),
        "bend": bend.tolist(),
        "moments": moments,
        "marks": sorted({*profile.breaks, *(to for to, _ in moments if to < length)}),
        "chains": {str(hinges): export_mjcf(scene, hinges=hinges).text for hinges in HINGES},
    }


# MuJoCo: the settings of a hinge chain that are tried, and the best of them.

STEPS = (100, 200, 250, 300, 400, 500, 600, 800, 1000, 1200, 1400, 1600, 2000, 2800, 4000, 5600, 10000)
"""Per second; ``FRAME`` of ``bench_peers`` has a whole number of each."""
METHODS = (("implicitfast", False), ("implicitfast", True), ("Euler", False), ("Euler", True), ("discrete", False))
METHODS += (("RK4", False),)
"""Integrators, and whether the start is staggered."""
_EVALUATIONS = {"RK4": 4}
_AT_ITS_ERROR = 1.5


@dataclass
class ChainRun:
    """One setting and what came of it."""

    settings: dict[str, Any]
    error: float
    """R.m.s. against the reference [m]."""
    cold: float

    @property
    def cost(self) -> int:
        """Evaluations of forces per second of motion."""
        return self.settings["steps"] * _EVALUATIONS.get(self.settings["integrator"], 1)

    @property
    def name(self) -> str:
        """Short and unique."""
        s = self.settings
        text = f"MuJoCo {s['hinges']} hinges ({s['layout']}), {s['integrator']}, {s['steps']}/s"
        return text + (", staggered" if s["staggered"] else "")


def sweep(
    peers: ReleasePeers, rod: Mapping[str, Any], hinges: int, reference: TipMotion, thin: bool = False
) -> list[ChainRun]:
    """All settings that run through, for one number of hinges; every other time step where ``thin``."""
    found, layouts = [], ("middle", "clamp") if rod["uniform"] else ("middle",)
    for layout, (integrator, staggered), steps in product(layouts, METHODS, STEPS[::2] if thin else STEPS):
        settings = {"hinges": hinges, "layout": layout, "integrator": integrator, "staggered": staggered}
        settings |= {"steps": steps}
        motion = peers.make("swept", "mujoco", rod, settings)
        error = rms_error(motion.tip, reference)
        if error < 0.1 * rod["length"]:
            found.append(ChainRun(settings, error, motion.cold))
    return found


def best(runs: list[ChainRun]) -> dict[str, ChainRun]:
    """The settings that are compared, of one number of hinges.

    ``fastest``: the fewest evaluations with at most 1.5 times the error that the better layout has with the finest
    steps, whatever its start; ``plain``: the same without the staggered start. Equal ones by error.
    """
    fine = min((r.error for r in runs if r.settings["steps"] == STEPS[-1]), default=math.inf)
    near = [r for r in runs if r.error <= _AT_ITS_ERROR * fine]
    groups = {"fastest": near, "plain": [r for r in near if not r.settings["staggered"]]}
    return {key: min(group, key=lambda r: (r.cost, r.error)) for key, group in groups.items() if group}


# Segments: the fewest steps that reach what a model can.

SEGMENT_STEPS = (25, 50, 100, 200, 400, 800, 1600, 3200, 6400)
"""Per second."""


def segments(
    peers: ReleasePeers, rod: Mapping[str, Any], library: str, settings: Mapping[str, Any], reference: TipMotion
) -> tuple[str, float, PeerRun]:
    """Name, error [m] and motion of a rod of segments: of the fewest steps with the error that it has with many.

    With at most 1.5 times that error, as for MuJoCo; many are four times the fewest with which the motion runs through
    and changes by less than that.
    """
    name = f"{LABELS[library]} {describe_segments(**settings)}"
    tried: list[tuple[float, PeerRun]] = []
    for steps in SEGMENT_STEPS:
        motion = peers.make(f"{name}, {steps}/s", library, rod, {**settings, "steps": steps})
        tried.append((rms_error(motion.tip, reference), motion))
        errors = [error for error, _ in tried[-3:]]
        if len(errors) == 3 and math.isfinite(errors[0]) and max(errors) <= _AT_ITS_ERROR * min(errors):
            break
    fine = tried[-1][0]
    error, motion = next(one for one in tried if one[0] <= _AT_ITS_ERROR * fine)
    return f"{name}, {motion.steps}/s", error, motion


def describe_segments(segments: int, order: int | None = None) -> str:
    """Number and kind of segments."""
    text = f"{segments} segment{'s' * (segments > 1)}"
    return text if order is None else f"GVS, {text} of order {order}"


# PyElastica: against our reference, extrapolated to endless elements and no thickness.

ELEMENTS = (20, 40, 80)
THICKNESS = 5.0
SHOWN = ((10, 10.0), (10, 5.0), (20, 10.0), (20, 5.0), (20, 2.5), (40, 5.0))
"""Elements, and how many times as thick the section is, of the rods whose speed is measured."""
_SHORT = 1e-3
"""Span over which the true section's steps are timed [s]."""


def check(
    peers: ReleasePeers, rod: Mapping[str, Any], reference: TipMotion
) -> tuple[Table, list[tuple[str, float, PeerRun]]]:
    """Errors of PyElastica's rods, and what remains after extrapolation; name, error [m] and motion of those timed.

    A thicker section, fewer elements and longer steps are what its user can trade for speed. Its steps are the longest
    stable ones: shorter ones only take longer, since extension and shear limit them and not their own error.
    """
    rows: list[list[Any]] = []
    made: dict[tuple[int, float], tuple[str, float, PeerRun]] = {}

    def make(elements: int, thickness: float, shifted: bool = True) -> PeerRun:
        name = f"PyElastica {elements} elements, section {thickness:g} times as thick"
        name += "" if shifted else ", clamp as it is"
        run = peers.make(name, "pyelastica", rod, {"elements": elements, "thickness": thickness, "shifted": shifted})
        error = rms_error(run.tip, reference)
        rows.append([name, run.steps, 1e3 * error])
        if shifted:
            made[elements, thickness] = name, error, run
        return run

    def add(name: str, tip: np.ndarray) -> None:
        rows.append([name, None, 1e3 * rms_error(tip, reference)])

    few = ELEMENTS[0]
    if not rod["uniform"]:  # the reference is checked by the uniform rod
        make(few, THICKNESS)
        make(2 * few, THICKNESS)
        return _checked(rows), [made[few, THICKNESS]]
    raw = make(few, THICKNESS, shifted=False)
    for setting in dict.fromkeys([*SHOWN, *((n, THICKNESS) for n in ELEMENTS), (few, 0.5 * THICKNESS)]):
        make(*setting)
    tips = [made[n, THICKNESS][2].tip for n in ELEMENTS]
    limit = _to_zero([1.0 / (n - 0.5) ** 2 for n in ELEMENTS], tips)
    add(f"extrapolated over {', '.join(map(str, ELEMENTS))} elements", limit)
    add("and to no thickness", limit + (made[few, 0.5 * THICKNESS][2].tip - tips[0]) * 4.0 / 3.0)
    true = peers.make("true section", "pyelastica", rod, {"elements": few, "thickness": 1.0}, frames=0)
    times = []
    for _ in range(3):
        began = time.perf_counter()
        peers.run("true section", _SHORT)
        times.append(time.perf_counter() - began)
    note = (
        f"Clamp as it is: node 0 and element 0 are held, so that the first half element does not bend, which costs "
        f"{1e3 * rms_error(raw.tip, reference):.3g} mm with {few} elements; elsewhere the clamp is put half an "
        f"element behind the wall. With the true section the stable step is 1/{true.steps} s, and {few} elements "
        f"run at {_SHORT / min(times):.2g} times real time (timed over {1e3 * _SHORT:g} ms)."
    )
    return _checked(rows, note), [made[setting] for setting in SHOWN]


def _checked(rows: list[list[Any]], note: str = "") -> Table:
    return Table("PyElastica against our reference", ["", "steps per s", "r.m.s. error [mm]"], rows, note)


def _to_zero(at: list[float], values: list[np.ndarray]) -> np.ndarray:
    """Value at zero of the polynomial through some values."""
    total = np.zeros_like(values[0])
    for k, value in enumerate(values):
        weight = np.prod([other / (other - at[k]) for j, other in enumerate(at) if j != k])
        total = total + weight * value
    return total
