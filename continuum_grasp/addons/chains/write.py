"""Writing a scene's finger as a model of MuJoCo."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.addons.chains.controls import Control, cable_springs, controls_of
from continuum_grasp.addons.chains.hands import CLOSES, LINKS, HandChain, hand_chain
from continuum_grasp.addons.chains.links import Links, rounded_step
from continuum_grasp.addons.chains.text import LEAST_INERTIA, written
from continuum_grasp.base import Array, CheckedArgument, InputError, check_arguments
from continuum_grasp.core import Core
from continuum_grasp.export import check_file, title_of
from continuum_grasp.grasp import HandResult, optimize_grasp
from continuum_grasp.model import FingerModel
from continuum_grasp.results import Result, write_text
from continuum_grasp.scene import Consumer, HandScene, Scene, scene_of
from continuum_grasp.simulation import Signals, initial_state, resolve_fidelity

_HINGES = 40
"""Hinges of a finger in the plane where none are given: shapes are then within 1 % of the rod's."""
_CONTACT = "contacts are MuJoCo's own, as stiff as the step allows"
(_CARRIED,) = Consumer.refusals(
    "out_of_plane_gravity without table: the chain is planar: a weight out of the plane that friction carries is not "
    "exported; set table, or 0"
)
_CHAIN = Consumer(
    "export to mjcf",
    refused={
        "finger.tendons.drive.kind=motor": "the export has no motors: command lengths (kind: length) or tensions",
        **Consumer.unknown_laws("the chain", "finger.stops"),
        "finger.damping.dry_friction": "MuJoCo's friction is a steep damper, under which a bend that should stay "
        "creeps: leave dry_friction out",
        **dict.fromkeys(("object_load", "table_height"), "the chain's object has no motor: leave it out"),
        "support_motion": "supports of a chain stay: leave it out",
        "finger.tendons.friction": "MuJoCo's tendons have the same tension all along: their frictionloss resists the "
        "motion of a whole tendon, not by its tension at every guide, as the capstan law does; set friction to 0, or "
        "close loops on a plant with guides, which has that law",
    },
    otherwise={
        "finger.tendons.drive.rate_max": "the winches are as fast as their lag allows",
        "finger.damping.per_arc": "spread over the hinges of each element, which damps bends within it too",
        "object": f"{_CONTACT}, with the scene's friction; all links of the finger touch, not its stations",
        **{f"contact_law.{key}": f"unsupported; {_CONTACT}" for key in ("stiffness", "dissipation", "rounding")},
        **{f"contact_law.{key}": "unsupported; MuJoCo has its own creep" for key in ("presliding", "slip_speed")},
        "contact_law.viscous": "unsupported; MuJoCo's friction does not grow with the slip",
        **{f"contact_law.{key}": f"unsupported; {_CONTACT}" for key in ("law", "law_numbers")},
        "out_of_plane_gravity": "the table's friction acts along x, along y and against turning apart",
        "parameters": "they have their nominal values",
    },
    unneeded={
        **Consumer.LIMITS_OF_BENDING,
        "name": "the title of the file alone",
        "contacts": "all links of the finger touch",
        "fidelity": "the chain has hinges of its own; an initial pose and damping per arc belong to the model",
        "finger.damping.friction_cells": "of dry friction in bending",
        **{f"finger.tendons.{key}": "of tendon friction" for key in ("friction_cells", "presliding", "conduit_bend")},
        "loads.input": "for the chain every moment is an input",
        "table.stays": "the table does not move",
        "time": "MuJoCo integrates, in whole parts of the output step; controls are written for the duration",
    },
)


@dataclass(frozen=True)
class HingeChain:
    """A finger as a model of MuJoCo.

    Attributes
    ----------
    text : str
        The model as MJCF; ``mujoco.MjModel.from_xml_string`` takes it.
    hinges : int
    first_frequency : float
        Of the straight, unloaded chain [Hz].
    timestep : float
        Step that the model asks for [s]; half the longest stable one, or less.
    differences : tuple of str
        What the chain does otherwise than the scene, beside its error of second order in the number of hinges.
    links : Links
        Hinges, and the rigid links between them: masses [kg], centers [m], inertias [kg m2].
    files : tuple of pathlib.Path
        What was written: the model, and a table of its controls over time where they vary.
    """

    text: str
    hinges: int
    first_frequency: float
    timestep: float
    differences: tuple[str, ...]
    links: Links = field(repr=False, compare=False)
    _controls: tuple[Control, ...]
    files: tuple[Path, ...] = ()

    @property
    def control_names(self) -> list[str]:
        """Names of the actuators, in their order."""
        return [control.name for control in self._controls]

    @property
    def varies(self) -> bool:
        """Whether a control of the scene varies in time."""
        return any(control.varies for control in self._controls)

    @check_arguments
    def controls(self, t: ArrayLike) -> Array:
        """Controls (T, nu) of the scene at instants (T,) [s], for ``mjData.ctrl``: tensions [N], moments [N m], ..."""
        instants = np.atleast_1d(np.asarray(t, dtype=float))
        return np.stack([np.zeros(len(instants)), *(control(instants) for control in self._controls)], axis=1)[:, 1:]


@check_arguments
def export_mjcf(
    scene: Scene | HandScene | HandResult | str | os.PathLike[str],
    file: str | os.PathLike[str] | None = None,
    *,
    hinges: int | None = None,
) -> Any:
    """Write the finger of a scene, or a hand with its object, as chains of hinges for MuJoCo.

    Each of ``hinges`` elements of the rod becomes one hinge with the element's compliance, where it acts (the midpoint
    rule; see `continuum_grasp.addons.chains.links`), between links with the masses of the rod: shapes and frequencies
    are of second order in the number of hinges. Tendons and the scene's loads are actuators. The chain lies in MuJoCo's
    x-y plane. Tensions pull where they are positive. An object that moves slides along x and y and turns. Keyframe
    ``start`` has the scene's state and controls at time zero.

    Fingers of a hand have three hinges per element: in the plane, to the side, and of twist. The object is free;
    keyframe ``grasp`` has the certified posture and its tensions, ``open`` straight fingers, from which the hand closes
    by ``controls``, or by the table beside the file, while the equality ``holder`` holds the object.

    Parameters
    ----------
    scene : Scene, HandScene, HandResult or path-like
        The scene, or its YAML file; of a hand also its grasp, or the folder of one: without, it is found first. The
        ``fidelity`` of a scene matters to an initial pose that is not straight, and to damping per arc.
    file : path-like, optional
        File to write. Where controls vary in time, a table of them is written beside it, with suffix ``.csv``.
    hinges : int, optional
        From 1 to 1000; by default 40, in a hand 24 per finger.

    Returns
    -------
    HingeChain or HandChain

    Raises
    ------
    InputError
        If the scene has features that a chain lacks (tendon friction, a weight out of the plane), or there are too few
        hinges for the places where the bending moment jumps, or so many that their inertia is none to MuJoCo.
    SolverError
        If no grasp of a hand is found.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> chain = cg.export_mjcf("configs/simulate/tendon_step.yaml", hinges=20)
    >>> chain.control_names
    ['tendon_1', 'tendon_2']
    >>> chain.controls([0.0, 1.0])  # tensions [N]
    array([[ 2.,  2.],
           [12.,  2.]])
    """
    if file is not None:
        check_file(Path(file))
    if hinges is not None:
        # 1000: far beyond what MuJoCo steps in useful time: the cost of a step is linear in them, the stable step falls
        # with their square
        CheckedArgument("hinges", hinges).whole(1, 1000)
    given = scene if isinstance(scene, HandResult) else _stored_or_scene(scene)
    if isinstance(given, Scene):
        return _of_finger(given, file, _HINGES if hinges is None else hinges)
    if isinstance(given, HandScene):
        given = optimize_grasp(given)
    chain = hand_chain(given, LINKS if hinges is None else hinges)
    if file is None:
        return chain
    table = Path(file).with_suffix(".csv")
    check_file(table, _is_table)
    # 0.01: instants of the table [s], between which tensions are linear
    t = np.linspace(0.0, CLOSES, round(CLOSES / 0.01) + 1)
    return replace(chain, files=(write_text(chain.text, Path(file)), _write_table(t, chain, table)))


def _stored_or_scene(given: Any) -> Any:
    """The scene of a file, or the grasp in a folder."""
    if isinstance(given, str | os.PathLike) and Path(given).is_dir():
        return HandResult.of_run(given)
    return scene_of(given, (Scene, HandScene))


def _of_finger(scene: Scene, file: str | os.PathLike[str] | None, hinges: int) -> HingeChain:
    """The chain of a finger in the plane."""
    _CARRIED.check(scene)
    listed = _CHAIN.check(scene)
    per_arc = FingerModel(resolve_fidelity(scene)[0]).lengths if scene.finger.damping.per_arc else ()
    controls = controls_of(scene)
    if file is not None and scene.time is not None and any(control.varies for control in controls):
        check_file(Path(file).with_suffix(".csv"), _is_table)
    links = Links.of(scene.finger, hinges, [at for control in controls for at in control.jumps], per_arc=per_arc)
    if links.inertia.min() < LEAST_INERTIA:
        raise InputError(
            f"with {hinges} hinges a link has an inertia of {links.inertia.min():.2g} kg m2, below MuJoCo's minimum of "
            f"{LEAST_INERTIA:g}: use fewer",
            key="hinges",
        )
    pulsations, _ = links.pulsations()
    ratio = 1.0 if scene.finger.stops is None else scene.finger.stops.stiffness_ratio
    # 0.5: share of the longest stable step of the straight chain that is written: bends and tensions change its modes
    longest = 0.5 * links.longest_step(ratio, cable_springs(controls, links.at))
    # 1e-3: longest step of a scene without ``time`` [s]
    step = rounded_step(longest, scene.time.step) if scene.time else rounded_step(min(longest, 1e-3), None)
    frequency = float(pulsations[0]) / (2.0 * np.pi)
    differences = (*listed, *_differences(scene, controls))
    text = written(scene, links, controls, _start(scene, links), title_of(scene), step, frequency, differences)
    chain = HingeChain(text, hinges, frequency, step, differences, links, tuple(controls))
    return chain if file is None else _saved(chain, Path(file), scene)


def _is_table(file: Path) -> bool:
    """Whether a file begins like a table of controls, or has no content."""
    text = file.read_bytes()
    return not text or text.startswith(b"time,")


def _differences(scene: Scene, controls: list[Control]) -> list[str]:
    """Differences of the chain from the finger, in words."""
    differences = []
    if any(control.lag and control.channel and control.channel.order > 1 for control in controls):
        key = "tendons.drive.time_constant" if scene.finger.winches else "tendons.time_constant"
        differences.append(
            f"{key}: MuJoCo's filter is of first order; it has twice the time constant of the critically damped one of "
            "second order, which has the same mean delay"
        )
    if any(control.varies for control in controls):
        differences.append(
            "inputs that vary in time: MJCF has their values at time zero; the rest is in the table of controls"
        )
    return differences


def _start(scene: Scene, links: Links) -> tuple[Array, Array]:
    """Angles [rad] and rates [rad/s] of the hinges at time zero."""
    if scene.initial.pose in ("straight", "rest"):
        none = np.zeros(len(links.at))
        return (links.rest if scene.initial.pose == "rest" else none), none
    model = FingerModel(resolve_fidelity(scene)[0])
    core = Core(model, compiled=False)
    x = initial_state(scene, model)
    u = Signals(scene, model).u(0.0)[0]
    q = x[: model.n]
    qd = x[model.n : 2 * model.n]

    def bends(coordinates: Array) -> Array:
        return np.diff(np.asarray(core.batch("orientation", coordinates, u, links.edges[:, None], None)).ravel())

    # The angles depend on the coordinates linearly.
    return bends(q), bends(q + qd) - bends(q)


def _saved(chain: HingeChain, file: Path, scene: Scene) -> HingeChain:
    """Write the model and, where controls vary, their table."""
    files = [write_text(chain.text, file)]
    if chain.varies and scene.time is not None:
        t = np.arange(round(scene.time.duration / scene.time.step) + 1) * scene.time.step
        files.append(_write_table(t, chain, file.with_suffix(".csv")))
    return replace(chain, files=tuple(files))


def _write_table(t: ArrayLike, chain: HingeChain | HandChain, file: Path) -> Path:
    """Write the controls of a chain over time."""
    rows = [[f"{v:.9g}" for v in row] for row in np.column_stack([t, chain.controls(t)])]
    return write_text(Result.as_csv(["time", *chain.control_names], rows), file)
