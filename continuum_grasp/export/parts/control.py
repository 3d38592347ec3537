"""Parts ``estimator`` and ``mpc``: what observes a finger, and what drives it."""

from __future__ import annotations

import itertools
from typing import cast

from continuum_grasp.export.control.kernels import adapters_of
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.control.source import control_sources
from continuum_grasp.export.fields import Struct, fill
from continuum_grasp.export.part import NUMBER, ROW_FLAGS, Code, Method, Part, Stateful
from continuum_grasp.export.subject import Subject


def estimator(subject: Subject) -> Part:
    """State and disturbances from what is measured."""
    loop = cast(Loop, subject.loop)  # without it packages have none of these parts
    structs = [loop.measurement, loop.command, loop.estimate]
    function = Stateful(
        "estimator_step",
        "State and disturbances now, from a measurement and the command that was applied.",
        _runner(subject, loop, "estimator"),
        ("estimator", "estimator_work"),
        ("measurement", "command"),
        "estimate",
        (
            Method(
                "start", "Begin anew at a state, with the command that was applied before.", ("estimate", "command")
            ),
            Method("variance", "Variance of each entry at the time of the last measurement.", (), "estimate"),
            Method("anomalies", "What was noticed in the last call, bits of ANOMALIES.", counts=True),
            *_contact(loop),
        ),
    )
    return _part(subject, "estimator", structs, (Code.WARN_ESTIMATE_RESTARTED,), function)


def mpc(subject: Subject) -> Part:
    """Commands by predictive control."""
    loop = cast(Loop, subject.loop)  # without it packages have none of these parts
    structs = [loop.measurement, loop.reference, loop.command, loop.start, loop.settings]
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
        _runner(subject, loop, "controller", wanted=loop.stages.nr, later=loop.stages.nr, switch=1),
        ("controller", "controller_work"),
        ("measurement", "reference"),
        "command",
        (
            Method(
                "start",
                "Begin anew at a state, with the command that was applied before.",
                (loop.start.name, "command"),
            ),
            Method("applied", "Before the next call: what was really applied since the last one.", ("command",)),
            Method("late", "Before the next call: that the last command came late."),
            Method("elapsed", "Before the next call: time since the last one [s].", (NUMBER,)),
            Method("rearm", "Leave a trip: 1, or 0 where that is not allowed yet.", counts=True),
            Method("estimate", "State and disturbances from which the last plan starts.", (), loop.start.name),
            Method("diagnosis", "What is known of the last call.", (), "diagnosis"),
            *_contact(loop),
        ),
    )
    return _part(subject, "mpc", structs, codes, function)


def mission(subject: Subject) -> Part:
    """Commands from approach to release, by the phases of a mission."""
    loop = cast(Loop, subject.loop)  # without it packages have none of these parts
    reported, watches = ((), 0) if loop.phases is None else (loop.phases.reported, loop.phases.watches)
    function = Stateful(
        "mission_step",
        "The command for a measurement, by the phase of the mission.",
        _runner(subject, loop, "mission", reported_at=1, height=watches),
        ("mission", "mission_work"),
        ("measurement",),
        "command",
        (
            Method("start", "Begin the first phase at a state.", (loop.start.name, "command")),
            Method("release", "Before the next call: let the object go, lowered first where it was lifted."),
            Method("abort", "Before the next call: open at once, wherever the object is."),
            Method("phase", "Number of the phase.", counts=True),
            Method("decision", "Decision before the lift: 0 none, 1 lift, 2 let go.", counts=True),
            Method("forces", "Forces at the contacts: 0 unknown, 1 enough to lift, 2 too little.", counts=True),
            *(_WATCHING if watches else ()),
            *(Method(name, "Before the next call: what is known of other fingers.") for name, _ in reported),
        ),
    )
    return _part(subject, "mission", [loop.measurement, loop.command, loop.start], (), function)


_WATCHING = (
    Method("height", "Before the next call: height of the object in the hand [m].", (NUMBER,)),
    Method("squeeze", "Before the next call: squeeze harder, since slip was noticed elsewhere."),
    Method("grip", "How the object is held: 0 as planned, 1 squeezed, 2 set down.", counts=True),
)
"""Methods of a mission that watches for slip."""


def _contact(loop: Loop) -> list[Method]:
    """Method that gives the contact of the last call, where there is a detector."""
    return [] if loop.touch is None else [Method("contact", "What the drives felt in the last call.", (), "contact")]


def _part(subject: Subject, name: str, structs: list[Struct], codes: tuple[Code, ...], function: Stateful) -> Part:
    loop = cast(Loop, subject.loop)  # without it packages have none of these parts
    files, declared = control_sources(loop, subject.prefix, subject.real)
    constants = {"PERIOD": f"{subject.real.literal(loop.period)} /* s, from one call to the next */"}
    if name == "mpc":
        nodes = f"of a reference: from now on, one each {loop.stages.stage:g} s"
        constants["NODES"] = f"{loop.nodes} /* {nodes} */"
    return Part(
        name,
        [adapter.kernel for adapter in adapters_of(loop.functions) if adapter.kernel is not None],
        (),
        constants,
        declarations=declared[name],
        sources=files,
        further=(*structs, *(s for s in (loop.known, loop.touch) if s is not None)),
        codes=codes,
        stateful=(function,),
    )


def _runner(subject: Subject, loop: Loop, name: str, **between: int) -> str:
    """C that runs a row: flags, settings of a controller, what is known, the measurement, what is ``between`` by its
    sizes, what was applied.
    """
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
