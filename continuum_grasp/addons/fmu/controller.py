"""A controller with its estimator, of a closed loop or of a finger's mission."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from continuum_grasp.addons.fmu.variable import UnitContents, Variable, count, variables_of
from continuum_grasp.addons.mission import AssignedMission, MissionRun
from continuum_grasp.control import ControlParts
from continuum_grasp.export import Field, Library
from continuum_grasp.scene import ControlScene

_COUNTS = [number.exported for number in ControlParts.diagnosis if number.kind != "real"]
_REALS = [number.exported for number in ControlParts.diagnosis if number.kind == "real"]
_TEXTS = {number.exported: number.text for number in ControlParts.diagnosis}
_EVENTS = {
    "release": "above 0.5: let the object go, lowered first where it was lifted",
    "abort": "above 0.5: open at once, wherever the object is",
    "others_bear": "above 0.5: all other fingers have forces 1",
    "others_lack": "above 0.5: one of the other fingers has forces 2",
    "others_doubt": "above 0.5: none of the other fingers has forces 2, and one has 3",
    "others_blind": "above 0.5: one of the other fingers has forces 4",
    "lift": "above 0.5: the finger that decides has decision 1",
    "squeeze": "above 0.5: squeeze harder, since slip was noticed elsewhere",
    "let_go": "above 0.5: the finger that decides has decision 2",
}
"""Commands and reports that a mission takes, by its function."""


def controller_unit(
    scene: ControlScene | AssignedMission | MissionRun,
    identifier: str,
    *,
    preview: bool = False,
    finger: str | None = None,
) -> UnitContents:
    """The controller of a closed loop; of setpoints over the horizon each is given where there is a ``preview``.

    The controller of a mission, of the ``finger`` by name where there are several, brings its setpoints and settings,
    and may be asked to let go.
    """
    alone = isinstance(scene, ControlScene)
    what = ["mpc" if alone else "mission"]
    library = Library.of(scene, what=what, prefix=identifier, finger=finger)
    structs = library.structs
    loop = library.manifest["loop"]
    start = "estimate" if "estimate" in structs else "measurement"
    seen, nominal = (list(loop[name].values()) for name in ("measurement_at_start", "nominal_known"))
    input_groups, states, words = _of_loop(structs, loop, preview) if alone else _of_mission(loop["mission"])
    groups = {
        "FMU_MEASUREMENT": variables_of("measurement", "input", structs["measurement"], seen, may_be_missing=True),
        **input_groups,
        "FMU_KNOWN": variables_of("known", "tunable", structs.get("known", ()), nominal),
        "FMU_COMMAND": variables_of("command", "output", structs["command"]),
        "FMU_ESTIMATE": variables_of("estimate", "output", structs[start]),
        "FMU_DIAGNOSIS": variables_of("diagnosis", "output", [Field(name, "1", _TEXTS[name]) for name in _REALS]),
    }
    return UnitContents(
        identifier=identifier,
        title=library.title,
        what="its predictive controller" if alone else "the controller of its mission",
        step=loop["period_s"],
        any_step=False,
        stop=(scene.duration or 1.0) if isinstance(scene, ControlScene) else loop["mission"]["planned_end_s"],
        groups=groups,
        counts=(
            count("code", "of the last call: 0 a new plan, above a warning, below what was refused"),
            *(count(name, text) for name, text in states.items()),
            *(count(f"diagnosis.{name}", _TEXTS[name]) for name in _COUNTS),
        ),
        continuous=False,
        linear=False,
        feedthrough=True,
        glue=("controller_types.c", "controller.c"),
        words={
            "alone": alone,
            "kind": "controller" if alone else "mission",
            "inner": "" if alone else ".controller",
            "start": start,
            "known": bool(nominal),
            "diagnosed": [*enumerate(_REALS)],
            "counted": [(name, name.upper()) for name in _COUNTS],
            "states": [(name, name.upper()) for name in states],
            **words,
        },
        sources=library.sources,
        flags=tuple(library.flags()),
        manifest=library.manifest,
    )


_Own = tuple[dict[str, tuple[Variable, ...]], dict[str, str], dict[str, Any]]
"""Groups of variables, whole numbers with their texts, and words of the templates that one of both has."""


def _of_loop(structs: Mapping[str, tuple[Field, ...]], loop: Mapping[str, Any], preview: bool) -> _Own:
    """Setpoints, each held over the horizon or, with a ``preview``, one each stage from now on; settings."""
    wanted = structs["reference"]
    nodes = loop["nodes"]
    settings = [*loop["nominal_settings"].values()]
    ahead = [(f"[{k}]", f"setpoint {k * loop['stage_s']:g} s from now") for k in range(nodes)]
    rows = ahead if preview else [("", "setpoint, held over the horizon")]
    entries = [replace(field, name=field.name + at, text=text, shape=()) for field in wanted for at, text in rows]
    first = [value for value in loop["first_setpoints"].values() for _ in rows]
    groups = {
        "FMU_REFERENCE": variables_of("reference", "input", entries, first),
        "FMU_SETTINGS": variables_of("settings", "tunable", structs["settings"], settings),
    }
    places = [(field.name, f"{j * nodes} + k" if preview else j) for j, field in enumerate(wanted)]
    return groups, {}, {"nodes": nodes, "reference": places, "watches": 0}


def _of_mission(mission: Mapping[str, Any]) -> _Own:
    """Commands and reports that it takes, and where it is."""
    watches = mission["watches"]
    events = ["release", "abort", *["squeeze"] * watches, *mission["reports"]]
    groups = {"FMU_EVENTS": tuple(Variable(n, "1", _EVENTS[n], kind="input", low=0.0, high=1.0) for n in events)}
    text = "of the object in the hand; NaN where it was not measured"
    height = Variable("height", "m", text, kind="input", start=math.nan, may_be_missing=True)
    groups["FMU_HEIGHT"] = (height,) * watches
    phases = ", ".join(f"{k} {name}" for k, name in enumerate(mission["phases"]))
    states = {
        "phase": f"number of the phase: {phases}",
        "decision": "before the lift: 0 none, 1 lift, 2 let go",
        "forces": "at the contacts: 0 unknown, 1 enough to lift, 2 too little, 3 enough by what sensors contradict, "
        "4 blind, so that it lets go",
    }
    states |= {"grip": "of the held object: 0 as planned, 1 squeezed, 2 set down"} if watches else {}
    return groups, states, {"events": [*enumerate(events)], "watches": watches}
