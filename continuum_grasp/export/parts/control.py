"""Parts ``estimator`` and ``mpc``: what observes a finger, and what drives it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from continuum_grasp.errors import InputError
from continuum_grasp.export.control.host import Host
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.control.replay import controller_vectors, estimator_vectors
from continuum_grasp.export.control.source import control_sources
from continuum_grasp.export.fields import Real, Struct
from continuum_grasp.export.part import SECONDS, Code, Method, Part, Stateful, Vectors
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.vectors import runner_head

_Maker = Callable[[Loop, Real, Host, str], Vectors]


def estimator(subject: Subject) -> Part:
    """The estimator of a subject's loop."""
    loop = _loop(subject, "estimator")
    if loop.estimation is None:
        raise InputError("this scene has no estimator: leave the part out", key="what")
    structs = [loop.measurement, loop.command, loop.estimate]
    function = Stateful(
        "estimator_step",
        "State and disturbances now, from a measurement and the command that was applied.",
        _estimator_runner(subject.prefix, loop),
        ("estimator", "estimator_work"),
        partial(estimator_vectors, loop, subject.real),
        ("measurement", "command"),
        "estimate",
        (
            Method(
                "start", "Begin anew at a state, with the command that was applied before.", ("estimate", "command")
            ),
            Method("variance", "Variance of each entry at the time of the last measurement.", (), "estimate"),
            Method("anomalies", "What was noticed in the last call, bits of ANOMALIES.", counts=True),
        ),
    )
    return _part(subject, loop, "estimator", structs, (Code.WARN_ESTIMATE_RESTARTED,), function)


def mpc(subject: Subject) -> Part:
    """The controller of a subject's loop."""
    loop = _loop(subject, "mpc")
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
        partial(controller_vectors, loop, subject.real),
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
        ),
    )
    return _part(subject, loop, "mpc", structs, codes, function)


def _loop(subject: Subject, name: str) -> Loop:
    if subject.loop is None:
        raise InputError(f"{name} needs a closed loop (finger, controller, ...)", key="what")
    return subject.loop


def _part(
    subject: Subject, loop: Loop, name: str, structs: list[Struct], codes: tuple[Code, ...], function: Stateful
) -> Part:
    files, declared = control_sources(loop, subject.prefix, subject.real)
    if loop.known is not None:
        structs.append(loop.known)
    kernels = loop.estimator_kernels if name == "estimator" else (*loop.problem_kernels, *loop.estimator_kernels)
    constants = {"PERIOD": f"{subject.real.literal(loop.period)} /* s, from one call to the next */"}
    if name == "mpc":
        constants["NODES"] = (
            f"{loop.stages.stages + 1} /* of a reference: from now on, one each {loop.stages.stage:g} s */"
        )
    return Part(
        name,
        {"estimator": "state and disturbances from measurements", "mpc": "predictive control"}[name],
        kernels,
        (),
        constants,
        declarations=declared[name],
        sources=files,
        further=tuple(structs),
        codes=codes,
        stateful=(function,),
    )


def _estimator_runner(prefix: str, loop: Loop) -> str:
    p, nz = prefix, loop.estimate.size
    at = 4
    known = ""
    if loop.known is not None:
        known = f"  memcpy(&memory->estimator.known, row + {at}, sizeof memory->estimator.known);\n"
        at += loop.known.size
    return f"""\
{runner_head("estimator_step", p)}
{{
  {p}_measurement measurement;
  {p}_command applied;
  {p}_estimate estimate, variance;
  int k, code = 0;
  if (row[0] > 0) {p}_estimator_init(&memory->estimator);
{known}  memcpy(&measurement, row + {at}, sizeof measurement);
  memcpy(&applied, row + {at + loop.measurement.size}, sizeof applied);
  memcpy(&estimate, out, sizeof estimate);
  memory->estimator.abi ^= other_abi;
  for (k = 0; k < repeat; ++k)
    code = {p}_estimator_step(null == 1 ? 0 : &memory->estimator, null == 2 ? 0 : &memory->estimator_work,
                              null == 3 ? 0 : &measurement, null == 4 ? 0 : &applied, null == 5 ? 0 : &estimate);
  memory->estimator.abi ^= other_abi;
  memcpy(out, &estimate, sizeof estimate);
  if (code < 0 || repeat == 0) return code;
  {p}_estimator_variance(&memory->estimator, &variance);
  memcpy(out + {nz}, &variance, sizeof variance);
  out[{2 * nz}] = ({p}_real){p}_estimator_anomalies(&memory->estimator);
  return code;
}}
"""


def _controller_runner(prefix: str, loop: Loop) -> str:
    p, nu, nr, nodes = prefix, loop.command.size, loop.stages.nr, loop.stages.stages + 1
    at = 4 + loop.settings.size
    known = ""
    if loop.known is not None:
        known = f"  memcpy(&memory->controller.known, row + {at}, sizeof memory->controller.known);\n"
        at += loop.known.size
    wanted = at + loop.measurement.size
    applied = wanted + 2 * nr + 1
    low = 4 + 2 * nr
    end = nu + loop.start.size
    return f"""\
{runner_head("mpc", p)}
{{
  {p}_measurement measurement;
  {p}_reference reference;
  {p}_command command, applied;
  {p}_{loop.start.name} estimate;
  {p}_diagnosis diagnosis;
  {p}_real nodes[{nr * nodes}];
  int j, k, code = 0;
  if (row[0] > 0) {p}_controller_init(&memory->controller);
  memcpy(&memory->controller.settings, row + 4, sizeof memory->controller.settings);
{known}  memcpy(&measurement, row + {at}, sizeof measurement);
  for (j = 0; j < {nr}; ++j)
    for (k = 0; k < {nodes}; ++k)
      nodes[j * {nodes} + k] = ({p}_real)k < row[{wanted + 2 * nr}] ? row[{wanted} + j] : row[{wanted + nr} + j];
  memcpy(&reference, nodes, sizeof reference);
  memcpy(&applied, row + {applied}, sizeof applied);
  if (row[1] > 0) {p}_controller_late(&memory->controller);
  if (row[2] > 0) {p}_controller_applied(&memory->controller, &applied);
  memcpy(&command, out, sizeof command);
  memory->controller.abi ^= other_abi;
  for (k = 0; k < repeat; ++k)
    code = {p}_mpc(null == 1 ? 0 : &memory->controller, null == 2 ? 0 : &memory->controller_work,
                   null == 3 ? 0 : &measurement, null == 4 ? 0 : &reference, null == 5 ? 0 : &command);
  memory->controller.abi ^= other_abi;
  memcpy(out, &command, sizeof command);
  if (code < 0 || repeat == 0) return code;
  for (j = 0; j < {nu}; ++j) /* beyond its settings only by its own warning; no code is -128 */
    if (code < {p.upper()}_WARN_PREVIOUS_PLAN && (out[j] < row[{low} + j] || out[j] > row[{low + nu} + j])) return -128;
  {p}_controller_estimate(&memory->controller, &estimate);
  {p}_controller_diagnosis(&memory->controller, &diagnosis);
  memcpy(out + {nu}, &estimate, sizeof estimate);
  out[{end}] = ({p}_real)diagnosis.anomalies;
  out[{end + 1}] = ({p}_real)diagnosis.iterations;
  out[{end + 2}] = diagnosis.violation;
  out[{end + 3}] = ({p}_real)diagnosis.health;
  out[{end + 4}] = diagnosis.mismatch;
  return code;
}}
"""
