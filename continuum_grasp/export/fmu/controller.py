"""A controller with its estimator."""

from __future__ import annotations

from typing import Any

from continuum_grasp.export.control.loop import DIAGNOSIS
from continuum_grasp.export.fmu.variable import STRICT, Unit, Variable, count, library_of, variables_of
from continuum_grasp.export.source import names_of
from continuum_grasp.scene.control import ControlScene

_COUNTS = [name for kind, name, _ in DIAGNOSIS if kind != "real"]
_REALS = [name for kind, name, _ in DIAGNOSIS if kind == "real"]
_TEXTS = {name: text for _, name, text in DIAGNOSIS}


def controller_unit(scene: ControlScene, identifier: str, *, preview: bool) -> Unit:
    """The controller of a closed loop; of setpoints over the horizon each is given where there is a ``preview``."""
    sources, manifest = library_of(scene, what=["mpc"], prefix=identifier)
    structs: dict[str, Any] = manifest["structs"]
    loop: dict[str, Any] = manifest["loop"]
    nodes, wanted = loop["nodes"], list(loop["first_setpoints"].values())
    known = structs.get("known", [])
    settings = list(loop["nominal_settings"].values())
    start = "estimate" if "estimate" in structs else "measurement"
    measured = variables_of(
        "measurement", "input", structs["measurement"], list(loop["measurement_at_start"].values()), may_be_missing=True
    )
    nominal = list(loop["nominal_known"].values())
    groups = {
        "FMU_MEASUREMENT": measured,
        "FMU_REFERENCE": _reference(structs["reference"], wanted, nodes if preview else 0, loop["stage_s"]),
        "FMU_SETTINGS": variables_of("settings", "tunable", structs["settings"], settings),
        "FMU_KNOWN": variables_of("known", "tunable", known, nominal),
        "FMU_COMMAND": variables_of("command", "output", structs["command"]),
        "FMU_ESTIMATE": variables_of("estimate", "output", structs[start]),
        "FMU_DIAGNOSIS": tuple(Variable(f"diagnosis.{k}", "1", _TEXTS[k], "output") for k in _REALS),
    }
    return Unit(
        identifier=identifier,
        title=names_of(scene)[0],
        what="its predictive controller",
        step=loop["period_s"],
        stop=scene.duration or 1.0,
        groups=groups,
        counts=(
            count("code", "of the last call: 0 a new plan, above a warning, below what was refused"),
            *(count(f"diagnosis.{name}", _TEXTS[name]) for name in _COUNTS),
        ),
        continuous=False,
        linear=False,
        feedthrough=True,
        glue=("controller_types.c", "controller.c"),
        words={
            "start": start,
            "known": bool(known),
            "nodes": nodes,
            "reference": [
                (entry["name"], f"{j * nodes} + k" if preview else j) for j, entry in enumerate(structs["reference"])
            ],
            "diagnosed": [*enumerate(_REALS)],
            "counted": [(name, name.upper()) for name in _COUNTS],
        },
        sources=sources,
        flags=STRICT,
        manifest=manifest,
    )


def _reference(entries: list[dict[str, Any]], wanted: list[float], nodes: int, stage: float) -> tuple[Variable, ...]:
    """Setpoints, each held over the horizon, or one each stage from now on [s]."""
    if not nodes:
        held = [{**entry, "text": "setpoint, held over the horizon"} for entry in entries]
        return variables_of("reference", "input", held, wanted)
    return tuple(
        variable
        for entry, value in zip(entries, wanted, strict=True)
        for variable in variables_of(
            "reference",
            "input",
            [
                {**entry, "name": f"{entry['name']}[{k}]", "text": f"setpoint {k * stage:g} s from now"}
                for k in range(nodes)
            ],
            [value] * nodes,
        )
    )
