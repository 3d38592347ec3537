"""Parts ``estimator`` and ``mpc``: what observes a finger, and what drives it."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import Struct, fill
from continuum_grasp.export.part import NUMBER, ROW_FLAGS, Code, PackagePart, PartMethod, Stateful
from continuum_grasp.export.subject import Subject


def estimator(subject: Subject) -> PackagePart:
    """State and disturbances from the measurement."""
    loop = _loop(subject)
    text = "State and disturbances now, from a measurement and the command that was applied."
    function = Stateful(
        "estimator_step",
        text,
        _runner(subject, "estimator"),
        ("estimator", "estimator_work"),
        ("measurement", "command"),
        "estimate",
    )
    structs = loop.measurement, loop.command, loop.estimate
    return _part(subject, "estimator", structs, (Code.WARN_ESTIMATE_RESTARTED,), function)


def mpc(subject: Subject) -> PackagePart:
    """Commands by predictive control."""
    loop = _loop(subject)
    codes = (
        Code.WARN_ITERATION_LIMIT,
        Code.WARN_BOUND_LEFT,
        Code.WARN_PREVIOUS_PLAN,
        Code.WARN_SAFE_RAMP,
        Code.WARN_BEYOND_LIMIT,
    )
    measured = "a measurement" if loop.estimation is not None else "the state"
    function = Stateful(
        "mpc",
        f"The command for {measured} and setpoints, by one real-time iteration.",
        _runner(subject, "controller", wanted=loop.stages.nr, later=loop.stages.nr, switch=1),
        ("controller", "controller_work"),
        ("measurement", "reference"),
        "command",
    )
    structs = loop.measurement, loop.reference, loop.command, loop.start, loop.settings
    return _part(subject, "mpc", structs, codes, function)


def mission(subject: Subject) -> PackagePart:
    """Commands from approach to release, by the phases of a mission."""
    loop = _loop(subject)
    function = Stateful(
        "mission_step",
        "The command for a measurement, by the phase of the mission.",
        _runner(subject, "mission", reported_at=1, height=0 if loop.phases is None else loop.phases.watches),
        ("mission", "mission_work"),
        ("measurement",),
        "command",
    )
    return _part(subject, "mission", (loop.measurement, loop.command, loop.start), (), function)


def _loop(subject: Subject) -> Loop:
    return cast(Loop, subject.loop)  # without it packages have none of these parts


_METHOD = re.compile(r"/\* ((?:(?!\*/).)+) \*/\n\w+ (\w+)\(([^)]*)\);", re.DOTALL)
"""Comment, name and arguments of a function in a header."""


def _methods(header: str, prefix: str, owner: str, step: str) -> tuple[PartMethod, ...]:
    """Functions of an owner beside the one of the step, as a header declares them."""
    methods = []
    first = f"{prefix}_{owner}_"
    for text, name, arguments in _METHOD.findall(header):
        if not name.startswith(first) or name == f"{prefix}_{step}":
            continue
        inputs = list[str]()
        output = None
        for argument in arguments.split(",")[1:]:  # behind the owner
            kind = argument.rpartition(" ")[0].strip()
            struct = kind.removeprefix("const ").removeprefix(f"{prefix}_")
            if struct == "real":
                inputs.append(NUMBER)
            elif kind.startswith("const "):
                inputs.append(struct)
            else:
                output = struct
        methods.append(PartMethod(name.removeprefix(first), " ".join(text.split()), inputs, output))
    return tuple(methods)


def _part(
    subject: Subject, name: str, structs: Sequence[Struct], codes: tuple[Code, ...], function: Stateful
) -> PackagePart:
    loop = _loop(subject)
    files, declared = subject.control_files
    methods = _methods(declared[name], subject.prefix, function.types[0], function.name)
    constants = {"PERIOD": f"{subject.real.literal(loop.period)} /* s, from one call to the next */"}
    if name == "mpc":
        nodes = f"of a reference: from now on, one each {loop.stages.stage:g} s"
        constants["NODES"] = f"{loop.nodes} /* {nodes} */"
    return PackagePart(
        name,
        [adapter.kernel for adapter in loop.adapters if adapter.kernel is not None],
        (),
        constants,
        declarations=declared[name],
        sources=files,
        further=(*structs, *([] if loop.known is None else [loop.known])),
        codes=codes,
        stateful=(replace(function, methods=methods),),
    )


def _runner(subject: Subject, name: str, **between: int) -> str:
    """C that runs a row: flags, settings of a controller, known parameters, the measurement, the part ``between`` by
    its sizes, the applied input.
    """
    loop = _loop(subject)
    settings = loop.settings.size if name == "controller" else 0
    sizes = {"settings": settings, "known": loop.known.size if loop.known is not None and name != "mission" else 0}
    sizes |= {"measurement": loop.measurement.size, **between, "applied": loop.command.size}
    places = dict(zip(sizes, itertools.accumulate(sizes.values(), initial=ROW_FLAGS), strict=False))
    # Settings begin with the weights of the setpoints, running and terminal; see CHANGEABLE.
    words = {"loop": loop, "low": ROW_FLAGS + 2 * loop.stages.nr, "behind": loop.command.size + loop.start.size}
    reported = () if loop.phases is None else loop.phases.reported
    words["watches"] = between.get("height", 0)
    words["reported"] = [(k + 1, entry) for k, (entry, _) in enumerate(reported)]
    return fill(f"tests/run_{name}.c", {"p": subject.prefix, **places, **words})
