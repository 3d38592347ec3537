"""A controller with its estimator."""

from __future__ import annotations

from typing import Any

from continuum_grasp.export.fmu.variable import STRICT, Count, Group, Unit, Variable, library_of, variables_of
from continuum_grasp.export.source import names_of
from continuum_grasp.scene.control import ControlScene

_REALS = {
    "violation": "largest share by which a soft bound is left in the plan",
    "residual": "of the optimality conditions, relative",
    "cost": "of the plan",
    "mismatch": "mean squared normalized innovation of the sensor that contradicts the model most",
    "activity": "mean squared change of the command, per that at its rate limit",
}
_COUNTS = {
    "anomalies": "what was noticed, bits of ANOMALY in the header",
    "iterations": "factorizations beyond the first",
    "health": "0 well, 1 mismatch, 2 detuned, 3 a reading is frozen, 4 tripped",
    "sensor": "number of the sensor that contradicts the model most",
    "frozen": "number of a reading that does not move; -1: none",
    "trip": "why the controller is tripped; 0: it is not",
    "rung": "how often the weight of the command's rate is raised fourfold",
}


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
    groups = [
        Group("FMU_MEASUREMENT", measured),
        Group("FMU_REFERENCE", _reference(structs["reference"], wanted, nodes if preview else 0, loop["stage_s"])),
        Group("FMU_SETTINGS", variables_of("settings", "tunable", structs["settings"], settings)),
        Group("FMU_KNOWN", variables_of("known", "tunable", known, nominal)),
        Group("FMU_COMMAND", variables_of("command", "output", structs["command"])),
        Group("FMU_ESTIMATE", variables_of("estimate", "output", structs[start])),
        Group("FMU_DIAGNOSIS", tuple(Variable(f"diagnosis.{k}", "1", text, "output") for k, text in _REALS.items())),
    ]
    names = [entry["name"] for entry in structs["reference"]]
    lines = [
        f"    f->scratch.reference.{name}[k] = values[FMU_REFERENCE + {f'{j * nodes} + k' if preview else j}];"
        for j, name in enumerate(names)
    ]
    diagnosed = [f"  values[FMU_DIAGNOSIS + {k}] = diagnosis.{name};" for k, name in enumerate(_REALS)]
    diagnosed += [f"  f->data.counts[FMU_{name.upper()}] = (int)diagnosis.{name};" for name in _COUNTS]
    return Unit(
        identifier=identifier,
        title=names_of(scene)[0],
        what="its predictive controller",
        step=loop["period_s"],
        stop=scene.duration or 1.0,
        groups=tuple(groups),
        counts=(
            Count("code", "of the last call: 0 a new plan, above a warning, below what was refused"),
            *(Count(f"diagnosis.{name}", text) for name, text in _COUNTS.items()),
        ),
        continuous=False,
        linear=False,
        feedthrough=True,
        glue=("controller_types.c", "controller.c"),
        words={
            "start": start,
            "known": bool(known),
            "fill_reference": "\n".join([f"  for (k = 0; k < {nodes}; ++k) {{", *lines, "  }"]),
            "diagnosed": "\n".join(diagnosed),
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
