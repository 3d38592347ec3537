"""A finger of a simulated scene, as the steps of its C package move it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from continuum_grasp.arguments import positive
from continuum_grasp.export.fields import REALS
from continuum_grasp.export.fmu.variable import (
    STRICT,
    TIP,
    Kind,
    Unit,
    contact_variables,
    count,
    library_of,
    variables_of,
)
from continuum_grasp.export.parts.model import has_linearization
from continuum_grasp.export.source import source_of
from continuum_grasp.export.subject import Subject
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.simulation.initial import initial_state
from continuum_grasp.simulation.signals import Signals


def finger_unit(
    scene: Scene,
    identifier: str,
    *,
    step: float | None,
    substeps: int | None,
    ranges: Mapping[str, Sequence[float]] | None,
) -> Unit:
    """The finger of a scene, with its object where it has one."""
    source = source_of(scene, REALS["double"])
    subject = Subject.of(source.finger, identifier, REALS["double"], ranges or {}, source.surroundings)
    model, moving = subject.model, subject.moving
    touching = [] if subject.touching is None else subject.touching.touch_names
    # Forces of contacts have no derivatives here.
    linear = not touching and has_linearization(subject)
    what = ["dynamics", "step", "kinematics", *["linearization"] * linear, *["contact"] * bool(touching)]
    internal = source.step if step is None else positive("step", step)
    sources, manifest = library_of(scene, what=what, prefix=identifier, ranges=ranges, step=internal, substeps=substeps)
    structs: dict[str, Any] = manifest["structs"]
    internal = internal or manifest["steps"]["step"]["accurate_s"]
    # Of a model that takes the tip moment to be constant, the input is a number that is given once.
    acts: Kind = "fixed" if model.structure.moment_is_constant else "input"
    signals, state = Signals(scene, model, nw=moving.nw), np.asarray(initial_state(scene, moving), dtype=float)
    parameters = list(manifest["nominal_parameters"].values())
    rates = [{**entry, "text": f"rate of state.{entry['name']}"} for entry in structs["rate"]]
    groups = {
        "FMU_INPUTS": variables_of("input", acts, structs["input"], signals.u(0.0)[0][: model.nu]),
        "FMU_FORCES": variables_of("forces", "input", structs.get("forces", []), signals.w(0.0)[0]),
        "FMU_PARAMETERS": variables_of("parameters", "tunable", structs.get("parameters", []), parameters),
        "FMU_STATE": variables_of("state", "state", structs["state"], state),
        "FMU_TIP": TIP,
        **({"FMU_CONTACTS": contact_variables(touching)} if touching else {}),
        "FMU_RATES": variables_of("rate", "rate", rates if linear else ()),
    }
    words: dict[str, Any] = {"forces": bool(groups["FMU_FORCES"]), "parameters": bool(parameters)}
    words |= {"acting": ", &forces" if words["forces"] else "", "contacts": bool(touching)}
    words["touched"] = ", &forces" if "forces" in manifest["functions"].get("touch", {}).get("inputs", ()) else ""
    return Unit(
        identifier=identifier,
        title=source.title,
        what="a planar continuum finger" + " with the object that it touches" * (subject.touching is not None),
        step=internal,
        stop=scene.time.duration if scene.time is not None else 1.0,
        groups=groups,
        counts=(count("code", "of the last step: 0 done, above a warning, below what was refused"),),
        continuous=True,
        linear=linear,
        feedthrough=model.tip.jac_sparsity(0, model.tip.index_in("u")).nnz() > 0,
        glue=("plant_types.c", "plant.c", *(["plant_linear.c"] if linear else [])),
        words=words,
        sources=sources,
        flags=STRICT,
        manifest=manifest,
    )
