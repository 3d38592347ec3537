"""C of estimator and controller: the templates of ``control/c`` around strict kernels, and the public functions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import casadi as ca
import numpy as np

from continuum_grasp import __version__
from continuum_grasp.control.compiled import Field as Member
from continuum_grasp.control.rti.source import dimensions, iteration_bodies, template
from continuum_grasp.export.control.loop import CHANGEABLE, DIAGNOSIS, Loop
from continuum_grasp.export.control.tokens import renamed, without, without_prototypes
from continuum_grasp.export.fields import Real, Struct
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.strict_math import c_source
from continuum_grasp.export.template import fill

_STUBS = ("stage_step", "stage_cost", "terminal_cost")
_OF_ESTIMATOR = ("estimator_step", "estimator_outputs", "estimator_flow", "estimated_parameters")
ANOMALIES = {
    "MISSING": "an entry of the measurement is not there",
    "ABSURD": "one is infinite or out of its range",
    "OUTLIER": "one is too far from what was expected: its sensor was rejected",
    "REOPENED": "one is too far too often: used with bounded influence",
    "BLIND": "nothing was measured for as long as a plan lasts",
    "ESTIMATE_LIMITED": "an estimated disturbance was moved into its range",
    "ESTIMATE_RESTARTED": "the estimate was not finite or out of its range; the estimator started again",
    "BAD_SETPOINTS": "a setpoint is not finite or out of its range",
    "BAD_KNOWN": "an entry of known is; the last good ones are used",
    "BAD_APPLIED": "what is said to have been applied is",
    "LATE": "the last command was late",
    "NOT_SOLVED": "the iteration failed",
    "COMMAND_LIMITED": "the planned command was out of its range",
    "RATE_LIMITED": "the planned command was further from the last one than its rate allows",
    "FROZEN": "a reading does not move: it counts as missing until it does",
    "BEYOND_LIMIT": "a limit was moved past the last command, which approaches it at its greatest rate",
}


class _Writer:
    """Texts of one package."""

    def __init__(self, loop: Loop, prefix: str, real: Real) -> None:
        self.loop, self.prefix, self.real = loop, prefix, real
        self.mpc, self.filter = "mpc" in loop.parts, loop.estimation is not None
        self.functions = (*_STUBS, *_OF_ESTIMATOR)

    def renamed(self, text: str) -> str:
        return renamed(text, self.prefix, self.real.name, self.functions)

    def literals(self, values: Iterable[float]) -> str:
        greatest = self.real.greatest
        return ", ".join(self.real.literal(min(max(float(v), -greatest), greatest)) for v in values)

    def array(self, name: str, values: Iterable[float]) -> str:
        return f"static const {self.prefix}_real {name}[] = {{{self.literals(values)}}};"

    def bounds(self, struct: Struct, name: str = "") -> str:
        low, high = zip(*struct.bounded, strict=True)
        name = name or struct.name
        return "\n".join([self.array(f"{name}_low", low), self.array(f"{name}_high", high)])

    # -- memory ------------------------------------------------------------------------------------------------------

    def macros(self) -> str:
        loop, s, e = self.loop, self.loop.stages, self.loop.estimation
        found = []
        if self.mpc:
            found += [line for line in dimensions(s, self.real.name).splitlines() if line.startswith("#define")]
            found.append("#define RTI_LANES 1")
            measured = len(loop.measurement_names)
            found += [f"#define CONTROLLER_ND {s.nd}", f"#define CONTROLLER_NM {measured}"]
            found.append(f"#define CONTROLLER_ESTIMATES {int(self.filter)}")
            found.append(f"#define CONTROLLER_NS {0 if e is None else len(e.sensor_names)}")
        if e is not None:
            sizes = {"NZ": e.nz, "NX": e.nx, "NU": s.nu, "NP": s.np, "NY": e.ny, "NM": e.nm, "DELAY": loop.periods}
            sizes["NS"] = len(e.sensor_names)
            found += [f"#define EKF_{name} {size}" for name, size in sizes.items()]
        if self.real.name == "float":
            found.append("#define CG_SINGLE")
        return self.renamed("\n".join(dict.fromkeys(found)))

    def headers(self) -> list[str]:
        found = ["rti.h"] if self.mpc else []
        found += ["ekf.h"] if self.filter else []
        return [*found, "supervisor.h", "controller.h"] if self.mpc else found

    def memory(self, words: dict[str, str]) -> str:
        types = [without_prototypes(template(name))[0] for name in self.headers()]
        memories = []
        if "estimator" in self.loop.parts:
            memories.append("typedef struct {\n  ekf_state state;\n  uint32_t anomalies;\n} estimator_memory;")
        if self.mpc:
            members = "  controller_state state;\n  controller_output last;\n  int late;\n  real elapsed;\n"
            memories.append(f"typedef struct {{\n{members}}} controller_memory;")
        text = self.renamed("\n".join(types + memories)).replace(
            f"{self.prefix}_loop_memory", f"{self.prefix}_controller_memory"
        )
        text = text.replace("} estimator_memory", f"}} {self.prefix}_estimator_memory")
        return fill("control/memory.h", {**words, "dimensions": self.macros(), "types": text})

    # -- the source ---------------------------------------------------------------------------------------------------

    def adapters(self) -> str:
        loop, s, e = self.loop, self.loop.stages, self.loop.estimation
        pairs: list[tuple[ca.Function, tuple[Kernel, ...]]] = []
        if self.mpc:
            pairs += [(f, loop.problem_kernels) for f in (s.step, s.cost, s.terminal)]
        if e is not None:
            own = (e.step, e.outputs, e.parameters) if self.mpc else (e.step, e.outputs)
            pairs += [(f, loop.estimator_kernels) for f in own]
            if loop.periods:
                pairs.append((e.flow, loop.estimator_kernels))
        return "\n".join(self.adapter(function, kernels) for function, kernels in pairs)

    def adapter(self, function: ca.Function, kernels: tuple[Kernel, ...]) -> str:
        p, name = self.prefix, function.name()
        kernel = next((k for k in kernels if k.name == name), None)
        further = "" if name in _STUBS else f", int *iw, {p}_real *w, int mem"
        call, unused = "", ["iw", "w", "mem"] if further else []
        if kernel is None:
            unused += ["arg", "res"]
        else:
            given = {n: f"arg[{function.name_in().index(n)}]" for n in kernel.inputs}
            given |= {n: f"res[{function.name_out().index(n)}]" for n in kernel.outputs}
            call = f"  {kernel.call(p, **given)}\n"
        voids = "".join(f"  (void){n};\n" for n in unused)
        head = f"static int {p}_call_{name}(const {p}_real **arg, {p}_real **res{further})"
        return f"{head}\n{{\n{voids}{call}  return 0;\n}}\n"

    def prototypes(self) -> str:
        return self.renamed("\n".join(without_prototypes(template(name))[1] for name in self.headers()))

    def bodies(self) -> str:
        texts = [template("checks.h")]
        if self.mpc:
            texts += iteration_bodies(self.loop.stages, lanes=False)
        texts += [template("ekf.c")] if self.filter else []
        texts += [template("supervisor.c"), template("controller.c")] if self.mpc else []
        return self.renamed(without("RTI_VECTOR", "\n".join(texts)))

    def numbers(self) -> str:
        loop, p = self.loop, self.prefix
        nominal = loop.stages.p_nominal
        texts = [self.bounds(loop.applied, "applied"), self.bounds(loop.start)]
        texts += [self.array("first_state", loop.first), self.array("first_command", loop.before)]
        if loop.known is not None:
            texts.append(self.array("known_nominal", nominal))
            texts += [self.bounds(loop.known)] if "estimator" in loop.parts else []
        if self.mpc:
            texts += [self.array("settings_nominal", loop.nominal_settings), self.bounds(loop.settings)]
            texts.append(self.array("first_setpoints", loop.wanted))
            texts.append(f"static const {p}_loop_settings loop_settings = {self.initializer(loop.members)};")
        else:
            own = [
                Member(m.member.removeprefix("ekf."), m.values, m.whole) for m in loop.members if m.member[:4] == "ekf."
            ]
            texts.append(f"static const {p}_ekf_settings ekf_settings = {self.initializer(own)};")
        if "estimator" in loop.parts:
            names = ("MISSING", "ABSURD", "OUTLIER", "REOPENED")
            bits = ", ".join(["0", *(f"{p.upper()}_ANOMALY_{name}" for name in names), "0"])
            texts.append(f"static const uint32_t anomaly_of_verdict[] = {{{bits}}};")
        return "\n".join(texts)

    def initializer(self, members: Sequence[Member]) -> str:
        lines = []
        for member in members:
            values = np.asarray(member.values)
            numbers = (
                [str(int(v)) for v in values.ravel()] if member.whole else [self.literals([v]) for v in values.ravel()]
            )
            if values.ndim == 2:
                width = values.shape[1]
                rows = [f"{{{', '.join(numbers[k : k + width])}}}" for k in range(0, len(numbers), width)]
                lines.append(f"  .{member.member} = {{{', '.join(rows)}}}")
            elif values.ndim == 1:
                lines.append(f"  .{member.member} = {{{', '.join(numbers) or self.real.literal(0.0)}}}")
            else:
                lines.append(f"  .{member.member} = {numbers[0]}")
        return "{\n" + ",\n".join(lines) + "}"

    def words(self, common: dict[str, str]) -> dict[str, str]:
        loop, p, big = self.loop, self.prefix, self.prefix.upper()
        known, start = loop.known, loop.start
        nz, nu, nm = start.size, loop.command.size, loop.measurement.size
        lines, at = [], 0
        for member in CHANGEABLE:
            count = np.size(getattr(loop.stages, member))
            if count:
                lines.append(f"  memcpy(to->rti.{member}, numbers + {at}, {count} * sizeof *numbers);")
            at += count
        reading = [
            f"    work->reference[k][{j}] = reference->{f.name}[k];" for j, f in enumerate(loop.reference.fields)
        ]
        nx = loop.prediction.nx
        estimated = [f"  memcpy(z, controller->memory.last.x, {nx} * sizeof *z);"]
        if nz > nx:
            estimated.append(f"  memcpy(z + {nx}, controller->memory.state.ekf.z + {nx}, {nz - nx} * sizeof *z);")
        found = {
            "period": f"{loop.period:g}",
            "n": str(loop.stages.stages),
            "stage": f"{loop.stages.stage:g}",
            "start": start.name,
            "nz": str(nz),
            "nu": str(nu),
            "nm": str(nm),
            "ns": str(loop.settings.size),
            "np_size": str(max(loop.stages.np, 1)),
            "take": "\n".join(lines),
            "read_reference": "\n".join(reading),
            "first_reference": "\n".join(
                f"    reference->{f.name}[k] = first_setpoints[{j}];" for j, f in enumerate(loop.reference.fields)
            ),
            "diagnosis": "\n".join(
                f"  {f'{p}_real' if kind == 'real' else kind} {name}; /* {text} */" for kind, name, text in DIAGNOSIS
            ),
            "applied_range": ", ".join(f"{f.name} {f.low:.6g} to {f.high:.6g} {f.unit}" for f in loop.applied.fields),
            "width": str(self.real.width),
            "missing": hex(self.real.exponent_mask | 1 << (self.real.mantissa_bits - 1)) + "u" + self.real.bits_suffix,
            "estimated": "\n".join(estimated),
            "what_is_measured": "a measurement" if self.filter else "the state",
            "safe": loop.safe,
            "sensors": ",\n".join(
                f"  {big}_SENSOR_{name.upper().replace(' ', '_')} = {k}" for k, name in enumerate(loop.watched)
            ),
            "indent_mpc": " " * len(f"int {p}_mpc("),
            "indent_step": " " * len(f"int {p}_estimator_step("),
            "estimator_settings": "loop_settings.ekf" if self.mpc else "ekf_settings",
            "known_member": f"\n  {p}_known known; /* may be changed between calls */" if known else "",
            "known_nominal": "known_nominal" if known else "0",
            "known_nominal_estimator": "\n  write_known(known_nominal, &estimator->known);" if known else "",
            "known_nominal_controller": "\n  write_known(known_nominal, &controller->known);" if known else "",
            "known_read_estimator": f"\n  read_known(&estimator->known, p);\n"
            f"  if ((code = check(p, known_low, known_high, {known.size})) < 0) return code;"
            if known
            else "",
            "known_array": f", p[{known.size}]" if known else "",
            "known_read_controller": "\n  read_known(&controller->known, p);" if known else "",
            "known_or_null": "p" if known else "0",
            **{
                f"{name}_bytes": f"<<{name}_bytes>>"
                for name in ("estimator", "estimator_work", "controller", "controller_work")
            },
            "anomalies": ",\n".join(
                f"  {big}_ANOMALY_{name} = {2**k} /* {text} */" for k, (name, text) in enumerate(ANOMALIES.items())
            ),
        }
        found["anomalies"] = _commas_before_comments(found["anomalies"])
        return {**common, **found}

    def source(self, words: dict[str, str]) -> str:
        loop, p = self.loop, self.prefix
        inputs = [loop.command, loop.measurement, loop.start]
        inputs += [loop.known] if loop.known else []
        outputs = [loop.start, loop.measurement, loop.command, *([loop.known] if loop.known else [])]
        if self.mpc:
            inputs.append(loop.settings)
            outputs.append(loop.settings)
        public = [fill("control/given.c", words)]
        public += [fill(f"control/{name}.c", words) for name in ("estimator", "controller") if self.has(name)]
        more = {
            "sqrt": c_source({"sqrt"}, self.real, p),
            "prototypes": self.prototypes(),
            "adapters": self.adapters(),
            "bodies": self.bodies(),
            "numbers": self.numbers(),
            "readers": "\n".join(s.reader(p) for s in _unique(inputs)),
            "writers": "\n".join(s.writer(p) for s in _unique(outputs)),
            "check": fill("check_numbers.c", words),
            "functions": "\n".join(public),
        }
        return fill("control/common.c", {**words, **more})

    def has(self, name: str) -> bool:
        return {"estimator": "estimator", "controller": "mpc"}[name] in self.loop.parts


def control_sources(loop: Loop, prefix: str, real: Real) -> tuple[dict[str, str], dict[str, str]]:
    """Files of estimator and controller by path, and the declarations of each part.

    The declarations leave places for the bytes of the memory, which are known once it was compiled.
    """
    writer = _Writer(loop, prefix, real)
    words = writer.words({"p": prefix, "P": prefix.upper(), "version": __version__})
    files = {f"include/{prefix}_memory.h": writer.memory(words), f"src/{prefix}_control.c": writer.source(words)}
    declared = {
        "estimator": fill("control/estimator.h", words),
        "mpc": fill("control/controller.h", words),
    }
    first = f'#include "{prefix}_memory.h"\n\n' + fill("control/anomalies.h", words) + fill("control/given.h", words)
    declared[loop.parts[0]] = f"{first}\n{declared[loop.parts[0]]}"
    return files, {name: declared[name] for name in loop.parts}


def _unique(structs: Sequence[Struct]) -> list[Struct]:
    return list({struct.name: struct for struct in structs}.values())


def _commas_before_comments(text: str) -> str:
    """Commas of an enumeration that stand behind comments, moved before them."""
    lines = [line.removesuffix(",").replace(" /*", ", /*", 1) for line in text.splitlines()]
    lines[-1] = lines[-1].replace(", /*", "  /*", 1)
    return "\n".join(lines)
