"""Writing a page: WebAssembly of plant and controller, what the page must know of them, and its script, in one file."""

from __future__ import annotations

import base64
import gzip
import html
import json
import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from continuum_grasp import __version__
from continuum_grasp.addons.mission import AssignedMission, MissionRun, MissionScene
from continuum_grasp.addons.web.hand import hand_page
from continuum_grasp.addons.web.html_page import Page
from continuum_grasp.addons.web.plant import FRICTION, PUSHED, WebPlant, plant_of_loop, plant_of_scene
from continuum_grasp.addons.web.record import RecordedStates, loop_record, rounded, trajectory_record
from continuum_grasp.base import Array, InputError, check_arguments, interruptible, split_unit
from continuum_grasp.closed_loop import ControlRun, PlantModel, Sensors
from continuum_grasp.control import Stages
from continuum_grasp.export import ModelFields, WasmController, WebAssembly, check_file, fill
from continuum_grasp.grasp import HandResult, optimize_grasp
from continuum_grasp.model import System
from continuum_grasp.scene import ControlScene, Finger, HandScene, Scene, Tendon, scene_of
from continuum_grasp.simulation import Trajectory

_NEEDED = "a page needs {} to make WebAssembly, which no other C compiler replaces"
_DIGITS = 6
"""Digits of numbers that are only drawn."""
_TABLE = 0.005
"""Time between rows of a table of inputs and loads [s]."""
_MISSIONS = (MissionScene, AssignedMission, MissionRun)
"""Classes that have a mission; `AssignedMission.of` refuses those whose grasp is not found yet."""


@interruptible()
@check_arguments
def export_web(
    given: Scene
    | ControlScene
    | MissionScene
    | AssignedMission
    | MissionRun
    | HandScene
    | HandResult
    | str
    | os.PathLike[str],
    file: str | os.PathLike[str],
) -> Page:
    """Write a scene as a page, one file that needs no network, in which its own C runs as WebAssembly.

    A scene of ``simulate`` becomes a finger whose inputs and run-time parameters have sliders; until one is moved,
    inputs follow the scene. A closed loop has its plant, its estimator and its controller, whose target is dragged. A
    mission, as `assign_mission` gives it, has its phases too, and may be ended before its time.
    Fingers and objects are pushed with the mouse or a finger. The grasp of a hand is seen in space, and follows its
    linear response to tensions, without WebAssembly.

    Parameters
    ----------
    given : Scene, ControlScene, AssignedMission, MissionRun, HandScene, HandResult or path
        The path names a configuration, or the folder of the grasp of a hand.
    file : path-like
        Page to write; an earlier one is replaced, a file that no export wrote is not.

    Returns
    -------
    Page

    Raises
    ------
    InputError
        If the file cannot be written, or is there and of no export, the scene is of another kind, its plant is a chain
        of guides, its mission has several fingers, or clang or wasm-ld is missing.
    SolverError
        If no start or grasp is found, or the compiler failed.

    Examples
    --------
    >>> import shutil, tempfile
    >>> import continuum_grasp as cg
    >>> if shutil.which("clang") and shutil.which("wasm-ld"):
    ...     page = cg.export_web("configs/simulate/hanging.yaml", tempfile.mkdtemp() + "/page.html")
    ...     assert list(page.modules) == ["plant"]
    """
    check_file(Path(file))
    if isinstance(given, str | os.PathLike) and Path(given).is_dir():
        given = HandResult.of_run(given)
    if isinstance(given, HandResult):
        return hand_page(given).save(file)
    scene = scene_of(given, (Scene, ControlScene, HandScene, *_MISSIONS))
    if isinstance(scene, HandScene):
        return hand_page(optimize_grasp(scene)).save(file)
    return (page_of_mission(scene) if isinstance(scene, _MISSIONS) else page_of(scene)).save(file)


def page_of(
    scene: Scene | ControlScene,
    record: Callable[[WebPlant, Stages | None], RecordedStates] | None = None,
    plant_model: PlantModel | None = None,
    mission: AssignedMission | None = None,
) -> Page:
    """The page of a scene, which plays back a record before anything else, where there is one.

    ``plant_model`` is the plant of a closed loop where it is not the scene's, ``mission`` what the controller does.
    """
    modules: dict[str, Future[bytes]] = {}
    stages = None
    controller = None
    wrapper = ""
    with ThreadPoolExecutor() as pool:
        if isinstance(scene, ControlScene):
            wasm = WasmController(scene, None if mission is None else mission.exported().phases)
            # Compiled while the plant is written.
            modules["controller"] = pool.submit(wasm.module)
            stages = wasm.loop.stages
            plant, sensors = plant_of_loop(scene, stages, plant_model)
            # After the refusals of the scene: installing programs does not help a scene that cannot be a page.
            WebAssembly.check_tools(_NEEDED)
            wrapper = wasm.wrapper
            controller = _controller(scene, wasm, sensors) | {"mission": _mission(wasm, mission, plant)}
        else:
            plant = plant_of_scene(scene)
            WebAssembly.check_tools(_NEEDED)
        modules["plant"] = pool.submit(WebAssembly.module, {"plant.c": plant.source}, plant_exports(plant))
        played = None if record is None else record(plant, stages)
        if controller is not None and played is not None and played.reference is not None:
            controller["reference"] |= {"dt": played.dt, "rows": played.reference}
        known: dict[str, Any] = {
            "plant": _plant(plant, scene),
            "controller": controller,
            "record": None if played is None else played.frames(),
        }
        if played is not None:
            known["plant"]["table"] = played.table()
        if mission is not None:
            known["plant"]["table"] = _planned_table(mission, plant)
        binaries = {name: module.result() for name, module in modules.items()}
    words = {
        "title": html.escape(scene.name or "a continuum finger"),
        "about": html.escape(_about(plant, scene, played, mission)),
        "version": __version__,
        "known": _script(json.dumps(known)),
        "modules": json.dumps({name: _packed(binary) for name, binary in binaries.items()}),
        "style": fill("web/page.css", {}),
        "wrapper": wrapper,
        "script": fill("web/page.js", {}),
    }
    return Page(fill("web/page.html", words), {name: len(binary) for name, binary in binaries.items()})


def page_of_mission(given: MissionScene | AssignedMission | MissionRun) -> Page:
    """The page of a mission of one finger, which is carried out as one looks."""
    check_one_finger(given if isinstance(given, MissionScene) else given.assignments[0].mission)
    mission = AssignedMission.of(given)
    return page_of(mission.assignments[0].control, plant_model=mission.plant_models[0], mission=mission)


def check_one_finger(mission: MissionScene) -> None:
    """Refuse a mission of several fingers."""
    if (count := len(mission.grasp.setups)) > 1:
        raise InputError(f"a page shows one finger, not {count}: use run_mission and animate", key="grasp")


def page_of_motion(run: Trajectory) -> Page:
    """The page of a motion, see ``MotionResult.show``."""
    return page_of(run.scene, lambda plant, _: trajectory_record(run, plant))


def page_of_loop(run: ControlRun, changes: Callable[[Stages], Sequence[Any]] = lambda _: ()) -> Page:
    """The page of a closed loop, and what changed of its controller."""

    def record(plant: WebPlant, stages: Stages | None) -> RecordedStates:
        return loop_record(run, plant, () if stages is None else changes(stages))

    return page_of(run.scene, record, run.readings.plant)


def _packed(binary: bytes) -> str:
    """Compressed, as text; the same bytes every time."""
    return base64.b64encode(gzip.compress(binary, 9, mtime=0)).decode()


def _script(text: str) -> str:
    """JSON within a script, which no text of the scene may end."""
    return text.replace("</", "<\\/")


def plant_exports(plant: WebPlant) -> list[str]:
    """Functions of the plant's module."""
    return ["advance", "look", "sense", "foresee", "restart", *(f"at_{name}" for name in plant.arrays)]


def _controller(scene: ControlScene, wasm: WasmController, sensors: Sensors) -> dict[str, Any]:
    """Data of controller and sensors for the page."""
    c, loop = scene.controller, wasm.loop
    # Setpoints of the scene over time, by rows, of which the last one holds.
    rows = loop.setpoints.rows(np.arange(0.0, (scene.duration or 0.0) + c.step, c.step))
    if (rows == rows[0]).all():
        rows = rows[:1]
    names = [field.name for field in loop.reference.fields]
    reference = {"dt": c.step, "stage": c.horizon.stage, "names": names, "rows": rounded(rows)}
    return {
        "period": c.step,
        "starts": loop.start.name,
        "commands": [field.name for field in loop.command.fields],
        "reference": reference,
        "names": [split_unit(name).name for name in sensors.names],
        "std": sensors.std.tolist(),
        "low": loop.stages.u_min.tolist(),
        "high": loop.stages.u_max.tolist(),
        "delay": sensors.delay,
        "plan": wasm.plan,
    }


def _mission(wasm: WasmController, mission: AssignedMission | None, plant: WebPlant) -> dict[str, Any] | None:
    """Data of a mission for the page: when each phase is planned to begin [s], and the height in the hand that is
    measured, by numbers of the state and what they count.
    """
    phases = wasm.loop.phases
    if mission is None or phases is None:
        return None
    asked = mission.assignments[0].mission
    states = plant.system.object_states
    slip, shares = asked.slip, asked.object_height(np.eye(len(plant.start))[:, states])  # the height is linear
    up = {k: float(share) for k, share in enumerate(shares) if share}
    return {
        "phases": list(phases.names),
        "begin": np.ravel(phases.members["begin"]).tolist(),
        "height": None if slip is None or slip.height is None else {"of": up, "std": asked.plant.noise * slip.height},
    }


def _planned_table(mission: AssignedMission, plant: WebPlant) -> dict[str, Any]:
    """Table of the motion of the ground and of the pulls at the object, by instants of the plan."""
    (timetable,) = mission.timetables
    outside = timetable.outside()
    t = np.arange(0.0, timetable.duration + _TABLE, _TABLE)
    columns = [outside[name](t) if name in outside else 0.0 * t for name in plant.system.w_names]
    return {"dt": _TABLE, "u": [], "w": rounded(np.array(columns).T)}


def _plant(plant: WebPlant, scene: Scene | ControlScene) -> dict[str, Any]:
    """Data of the plant for the page."""
    system = plant.system
    finger = plant.system.finger_model.finger
    model = system.finger_model
    length = finger.rod.length
    timed = scene.duration if isinstance(scene, ControlScene) else scene.time and scene.time.duration
    # The last row holds for good, as samples do.
    instants = np.zeros(1) if plant.signals.constant else np.arange(0.0, (timed or 0.0) + _TABLE, _TABLE)
    nu = len(plant.rest)
    inputs = [] if isinstance(scene, ControlScene) else ModelFields(model).inputs()[:nu]
    forces = np.zeros((len(instants), plant.given["w"].numel()))
    rows = plant.signals.w(instants)
    forces[:, : rows.shape[1]] = rows
    fields = ModelFields(model).parameters()
    return {
        "arrays": plant.arrays,
        "step": plant.step,
        "start": {"x": plant.start.tolist(), "u": plant.rest.tolist(), "p": plant.p.tolist()},
        "table": {
            "dt": _TABLE,
            "u": plant.signals.u(instants)[:, :nu].tolist() if isinstance(scene, Scene) else [],
            "w": forces.tolist(),
        },
        "inputs": [_slider(f, value) for f, value in zip(inputs, plant.rest, strict=False)],
        "input_names": list(plant.u_names),
        "parameters": [_slider(f, value) for f, value in zip(fields, model.p_nominal, strict=True)],
        "half": [round(float(v), _DIGITS) for v in finger.profile.half_thickness(plant.at)],
        "length": length,
        "pushes": {
            "first": plant.pushes,
            "sections": plant.pushed,
            # 0.25: greatest force of a hand, per that which bends the straight finger to a right angle
            "most": 0.25 * 0.5 * math.pi * finger.rod.stiffness / length**2,
        },
        "tendons": [_tendon(tendon, plant.at, length) for tendon in finger.tendon_list],
        "discs": _discs(finger),
        "masses": [[mass.at / length, mass.mass] for mass in finger.masses],
        "touches": system.touch_names,
        **_touched(system),
        **(_zones(scene) if isinstance(scene, ControlScene) else {}),
    }


def _touched(system: System) -> dict[str, Any]:
    """Data of the object, of friction and of the supports; none where nothing is touched."""
    model, body = system.finger_model, system.surroundings
    if body is None or body.object is None or body.contact_law is None:
        return {}
    of_object = list(system.object_parameters)
    first = system.object_states.start
    moves = system.object_states.stop > first
    supports = {wall.name: wall.friction for wall in body.walls} | {peg.name: peg.friction for peg in body.pegs}
    law = body.contact_law.friction
    limits = [supports.get(name.partition(".")[0]) for name in system.touch_names]
    farthest = 10.0 * model.finger.rod.length
    return {
        "object": {
            "parts": [np.round(np.array(part.outline(96)), _DIGITS).tolist() for part in body.object.parts],
            "pose": [float(v) for v in body.object.pose],
            "state": first if moves else None,
            "wrench": model.nw if moves else None,
            "parameter": model.np + of_object.index("object_x") if "object_x" in of_object else None,
            "mass": body.object.mass,
            "height": first + 3 if moves and body.out_of_plane_gravity else None,
            "most": 10.0 * max(body.object.mass, 0.02),
        },
        "friction": {
            "parameter": model.np + of_object.index(FRICTION),
            "law": law,
            "of": [law if limit is None else limit for limit in limits],
        },
        "walls": [[*wall.point, *wall.normal, min(wall.half_length, farthest)] for wall in body.walls],
        "pegs": [[*peg.position, peg.radius] for peg in body.pegs],
    }


def _zones(scene: ControlScene) -> dict[str, Any]:
    """Data of what the controller keeps the finger out of."""
    zones = scene.controller.bounds.keep_out or {}
    drawn = [
        {"center": list(z.center), "radius": z.radius}
        if z.type == "disc"
        else {"point": list(z.point), "normal": [math.cos(z.normal_angle), math.sin(z.normal_angle)]}
        for z in zones.values()
    ]
    return {"zones": drawn}


def _tendon(tendon: Tendon, at: Array, length: float) -> dict[str, Any]:
    """Distances of a tendon from the backbone [m] at the sections up to its end, and its greatest tension [N]."""
    first, last = tendon.offsets
    end = tendon.end(length)
    sections = at[at <= end * (1.0 + 1e-9)]
    return {
        "offset": [round(float(v), _DIGITS) for v in first + (last - first) * sections / end],
        "most": tendon.max_tension,
    }


def _discs(finger: Finger) -> list[float]:
    """Shares of the length where units end, or where discs guide the tendons of a rod thinner than the finger."""
    rod = finger.rod
    length = finger.rod.length
    if rod.spirob is not None:
        return [round(edge / length, _DIGITS) for edge in rod.spirob.edges(length)]
    half = float(np.max(finger.profile.half_thickness(np.linspace(0.0, length, 5))))
    if not finger.tendon_list or rod.diameter is None or half < 1.5 * 0.5 * float(np.max(rod.diameter)):
        return []
    # 2.5: distance of drawn discs, per half thickness
    count = round(length / (2.5 * half))
    return [round(k / count, _DIGITS) for k in range(1, count + 1)]


def _slider(field: Any, value: float) -> dict[str, Any]:
    """A number that is changed by hand."""
    low, high = field.sampled
    return {"name": field.name, "unit": field.unit, "low": low, "high": high, "value": float(value)}


def _about(
    plant: WebPlant, scene: Scene | ControlScene, played: RecordedStates | None, mission: AssignedMission | None = None
) -> str:
    """Computed quantities, in a sentence or two."""
    model = plant.system.finger_model
    words: dict[str, object] = {
        "played": played is not None,
        "seconds": f"{played.t[-1]:g}" if played is not None else "",
        "elements": len(model.lengths),
        "family": model.family.replace("_", " "),
        "states": plant.given["x"].numel(),
        "step": f"{1e3 * plant.step:g}",
        "touches": ", ".join(plant.system.touch_names),
        "driven": isinstance(scene, ControlScene),
        "mission": mission is not None,
        "pushed": ", ".join(f"{share:g}" for share in PUSHED),
    }
    if isinstance(scene, ControlScene):
        c = scene.controller
        words |= {"observer": "a Kalman filter and " if scene.estimator is not None else "", "stages": c.horizon.stages}
        words |= {"period": f"{1e3 * c.step:g}", "stage": f"{1e3 * c.horizon.stage:g}"}
    return " ".join(fill("web/about.txt", words).split())
