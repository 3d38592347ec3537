"""Parts ``estimator`` and ``mpc``: what observes a finger, and what drives it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

from continuum_grasp.export.control.kernels import adapters_of
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.control.source import control_sources
from continuum_grasp.export.fields import Struct
from continuum_grasp.export.part import ROW_FLAGS, SECONDS, Code, Method, Part, Stateful
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill


def estimator(subject: Subject) -> Part:
    """State and disturbances from what is measured."""
    loop = cast(Loop, subject.loop)  # without it packages have none of these parts
    structs = [loop.measurement, loop.command, loop.estimate]
    function = Stateful(
        "estimator_step",
        "State and disturbances now, from a measurement and the command that was applied.",
        _estimator_runner(subject.prefix, loop),
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
        _controller_runner(subject.prefix, loop),
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
            Method("elapsed", "Before the next call: time since the last one [s].", (SECONDS,)),
            Method("rearm", "Leave a trip: 1, or 0 where that is not allowed yet.", counts=True),
            Method("estimate", "State and disturbances from which the last plan starts.", (), loop.start.name),
            Method("diagnosis", "What is known of the last call.", (), "diagnosis"),
            *_contact(loop),
        ),
    )
    return _part(subject, "mpc", structs, codes, function)


def _contact(loop: Loop) -> list[Method]:
    """What asks for the contact of the last call, where there is a detector."""
    return [] if loop.touch is None else [Method("contact", "What the drives felt in the last call.", (), "contact")]


def _part(subject: Subject, name: str, structs: list[Struct], codes: tuple[Code, ...], function: Stateful) -> Part:
    loop = cast(Loop, subject.loop)  # without it packages have none of these parts
    files, declared = control_sources(loop, subject.prefix, subject.real)
    constants = {"PERIOD": f"{subject.real.literal(loop.period)} /* s, from one call to the next */"}
    if name == "mpc":
        nodes = f"of a reference: from now on, one each {loop.stages.stage:g} s"
        constants["NODES"] = f"{loop.stages.stages + 1} /* {nodes} */"
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


def _take_known(loop: Loop, owner: str, at: int) -> tuple[str, int]:
    """C that takes what is known of the finger from a row, where there is any, and where the row goes on."""
    if loop.known is None:
        return "", at
    place = f"memory->{owner}.known"
    return f"  memcpy(&{place}, row + {at}, sizeof {place});\n", at + loop.known.size


def _runner(name: str, prefix: str, words: Mapping[str, object]) -> str:
    return fill(f"tests/run_{name}.c", {"p": prefix, "P": prefix.upper(), **words})


def _estimator_runner(prefix: str, loop: Loop) -> str:
    """C that runs a row: flags, what is known, the measurement, what was applied."""
    nz = loop.estimate.size
    known, measurement = _take_known(loop, "estimator", ROW_FLAGS)
    applied = measurement + loop.measurement.size
    words = {"take_known": known, "measurement": measurement, "applied": applied, "nz": nz, "anomalies": 2 * nz}
    words |= {"touch": loop.touch, "contact": 2 * nz + 1}
    return _runner("estimator", prefix, words)


def _controller_runner(prefix: str, loop: Loop) -> str:
    """C that runs a row: flags, settings, what is known, the measurement, setpoints now and later, the node from which
    the later ones hold, what was applied.
    """
    nu, nr, nodes = loop.command.size, loop.stages.nr, loop.stages.stages + 1
    known, measurement = _take_known(loop, "controller", ROW_FLAGS + loop.settings.size)
    wanted = measurement + loop.measurement.size
    low = ROW_FLAGS + 2 * nr  # settings begin with the weights of the setpoints, running and terminal; see CHANGEABLE
    end = nu + loop.start.size
    words = {
        "take_known": known,
        "measurement": measurement,
        "start": loop.start.name,
        "nu": nu,
        "nr": nr,
        "nodes": nodes,
        "nodes_size": nr * nodes,
        "wanted": wanted,
        "later": wanted + nr,
        "switch": wanted + 2 * nr,
        "applied": wanted + 2 * nr + 1,
        "low": low,
        "high": low + nu,
        "end": end,
        **{f"end{k}": end + k for k in range(1, 6)},
        "touch": loop.touch,
    }
    return _runner("controller", prefix, words)
