"""C of estimator and controller: the templates of ``control/c`` around strict kernels, with the names of a package, and
the public functions.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Collection, Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp import __version__
from continuum_grasp.control import (
    Anomaly,
    ControlParts,
    template,
)
from continuum_grasp.core import CReal, CSource
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import each_once, fill, identifiers
from continuum_grasp.export.strict_math import c_source

_MODULES = {
    "rti": "rti",
    "ekf": "ekf",
    "controller": "loop",
    "supervisor": "supervisor",
    "mission": "phases",
    "cg": "checks",
}
"""Beginnings of names in ``control/c``, and behind the prefix of a package."""
_NAME = re.compile(rf"\b(?:{'|'.join(_MODULES)})_\w+|\b(?:{'|'.join(module.upper() for module in _MODULES)})_\w+")
_HEADER = re.compile(r"\b(?:rti|ekf|supervisor|controller|mission|checks)\.h\b")
_INCLUDE = re.compile(r'^#include "\w+\.h"\n', re.MULTILINE)
_PROTOTYPE = re.compile(
    r"^(?:/\*(?:(?!\*/).)*\*/\n)?(?:int|void) \w+\([^;{}]*\);\n",
    re.MULTILINE | re.DOTALL,
)


def renamed(source: str, prefix: str, real: str, functions: Collection[str] = ()) -> str:
    """C of ``control/c`` with the names, in comments too, the type and the literals of a package, and without includes.

    ``functions`` are the names of what calls the kernels, which get ``call_`` behind the prefix.
    """

    def of_package(match: re.Match[str]) -> str:
        if match[0].startswith(f"{prefix}_kernel_"):  # of the package already, whose prefix may be a module's
            return match[0]
        module, rest = match[0].split("_", 1)
        if module.isupper():
            return f"{prefix.upper()}_{_MODULES[module.lower()].upper()}_{rest}"
        return f"{prefix}_{_MODULES[module]}_{rest}"

    def changed(match: re.Match[str]) -> str:
        if match["comment"]:
            text = _NAME.sub(of_package, match[0]).replace("`real`", f"`{prefix}_real`")
            return _HEADER.sub(f"{prefix}_memory.h", text)
        if match["number"]:
            return CReal.KINDS[real].written(float(match["number"]), match["number"])
        if not match["name"]:
            return match[0]
        if match[0] == "real":
            return f"{prefix}_real"
        if match[0] in functions:
            return f"{prefix}_call_{match[0]}"
        return _NAME.sub(of_package, match[0])

    return CReal.TOKEN.sub(changed, _INCLUDE.sub("", source))


def without_prototypes(header: str) -> tuple[str, str]:
    """Macros and types of a header, and the functions that it declares."""
    return _PROTOTYPE.sub("", header), "".join(match[0] for match in _PROTOTYPE.finditer(header))


def without(macro: str, source: str) -> str:
    """C in which the branches ``#ifdef macro`` and ``#ifndef macro`` are settled as if it were not defined."""
    lines: list[str] = []
    inside: list[bool | None] = []  # of each open condition: whether it is the macro's, and its branch is read
    for line in source.splitlines(keepends=True):
        word = line.split()
        directive = word[0] if word else ""
        if directive in ("#if", "#ifdef", "#ifndef"):
            inside.append(directive == "#ifndef" if directive != "#if" and word[1] == macro else None)
            settled = inside[-1] is not None
        elif directive == "#else" and inside and inside[-1] is not None:
            inside[-1], settled = not inside[-1], True
        elif directive == "#endif":
            settled = inside.pop() is not None
        else:
            settled = False
        if not settled and False not in inside:
            lines.append(line)
    return "".join(lines)


SIZES = (
    "estimator_bytes",
    "estimator_work_bytes",
    "controller_bytes",
    "controller_work_bytes",
    "mission_bytes",
    "mission_work_bytes",
)
"""Places of the header for facts that are known once it was compiled."""
UNKNOWN = "0x7fffffff"
"""Placeholder of a size: more than any memory, so that the checks of the sizes in the C hold."""
_RENAMED = {"BAD_PARAMETERS": "BAD_KNOWN", "INPUT_LIMITED": "COMMAND_LIMITED"}
"""Anomalies of what has another name in a package."""
ANOMALIES = {_RENAMED.get(str(anomaly.name), str(anomaly.name)): anomaly.description for anomaly in Anomaly}
"""Meaning of each bit of anomalies, by its name, from the lowest one on."""


class _Writer:
    """Texts of one package."""

    def __init__(self, loop: Loop, prefix: str, real: CReal) -> None:
        self.loop = loop
        self.prefix = prefix
        self.real = real
        self.mpc = mpc = "mpc" in loop.parts
        needed: dict[str, object] = {"rti": mpc, "ekf": loop.estimation}
        needed |= {"supervisor": mpc, "controller": mpc, "mission": loop.phases}
        self.modules = [name for name, reason in needed.items() if reason]
        """Modules of ``control/c`` that the package has, each after those that it needs."""

    def renamed(self, text: str) -> str:
        names = {f.name() for f in (*self.loop.functions, *CSource(self.loop.functions).straight)}
        return renamed(text, self.prefix, self.real.name, names)

    def array(self, name: str, values: Iterable[float]) -> str:
        numbers = ", ".join(map(self.real.finite_literal, values))
        return f"static const {self.prefix}_real {name}[] = {{{numbers}}};"

    # -- memory ------------------------------------------------------------------------------------------------------

    def macros(self) -> str:
        loop = self.loop
        lines = []
        if self.mpc:
            lines.append("#define RTI_LANES 1")  # plain C has no vectors: one lane
        lines += loop.macros(controls=self.mpc, iterations=self.real.name if self.mpc else "")
        if loop.phases is not None:
            lines += [f"#define MISSION_{name} {size}" for name, size in loop.phases.sizes.items()]
        if self.real.name == "float":
            lines.append("#define CG_SINGLE")
        return self.renamed("\n".join(dict.fromkeys(lines)))

    def settled(self, text: str) -> str:
        """Without what only scenarios or contacts need, where there are none."""
        absent = {"RTI_ROBUST": self.loop.stages.scenarios is None, "RTI_CHECKS_GAPS": not self.loop.stages.checks_gaps}
        for macro in [macro for macro, missing in absent.items() if missing]:
            text = without(macro, text)
        return text

    def headers(self) -> tuple[str, str]:
        """Types of the modules, and prototypes of their functions."""
        parts = [without_prototypes(self.settled(template(f"{module}.h"))) for module in self.modules]
        types, prototypes = (self.renamed("\n".join(texts)) for texts in zip(*parts, strict=True))
        return types, prototypes

    def memory(self, words: dict[str, object]) -> str:
        return fill("control/memory.h", {**words, "dimensions": self.macros(), "types": self.headers()[0]})

    # -- the source ---------------------------------------------------------------------------------------------------

    def adapters(self) -> str:
        texts = [adapter.c_source(self.prefix) for adapter in self.loop.adapters]
        texts += CSource(self.loop.functions).calls("real")
        return self.renamed("\n".join(texts))

    def bodies(self) -> str:
        iterations = self.loop.iteration_bodies if self.mpc else []
        others = [template(f"{module}.c") for module in self.modules if module != "rti"]
        text = "\n".join([template("checks.h"), *iterations, *others])
        return self.renamed(without("EKF_VECTOR", without("RTI_VECTOR", self.settled(text))))

    def numbers(self) -> str:
        loop, p = self.loop, self.prefix
        nominal = loop.stages.p_nominal
        texts = [*(s.bounds(p, self.real) for s in (loop.applied, loop.start))]
        texts += [self.array("first_state", loop.first), self.array("command_first", loop.before)]
        if loop.known is not None:
            texts.append(self.array("known_nominal", nominal))
            texts += [loop.known.bounds(p, self.real)] if "estimator" in loop.parts else []
        if self.mpc:
            texts += [self.array("settings_nominal", loop.nominal_settings), loop.settings.bounds(p, self.real)]
            texts.append(self.array("first_setpoints", loop.wanted))
            texts.append(f"static const {p}_loop_settings settings_exported = {self.initializer(loop.members)};")
        else:
            texts.append(self.own_settings("ekf"))
        if loop.phases is not None:
            phase_settings = self.initializer(loop.phases.members)
            texts.append(f"static const {p}_phases_settings settings_of_phases = {phase_settings};")
        if "estimator" in loop.parts:
            names = ("MISSING", "ABSURD", "OUTLIER", "REOPENED")
            bits = ", ".join(["0", *(f"{p.upper()}_ANOMALY_{name}" for name in names), "0"])
            texts.append(f"static const uint32_t anomaly_of_verdict[] = {{{bits}}};")
        return "\n".join(texts)

    def own_settings(self, module: str) -> str:
        """Settings of a module, where there are none of a controller around them."""
        start = f"{module}."
        members = self.loop.members.items()
        settings = {name.removeprefix(start): values for name, values in members if name.startswith(start)}
        return f"static const {self.prefix}_{module}_settings settings_exported = {self.initializer(settings)};"

    def initializer(self, members: Mapping[str, ArrayLike]) -> str:
        lines = (f"  .{name} = {self.braced(np.asarray(v))}" for name, v in members.items())
        return "{\n" + ",\n".join(lines) + "}"

    def braced(self, values: np.ndarray) -> str:
        if values.ndim == 0:
            return str(int(values)) if values.dtype.kind in "biu" else self.real.finite_literal(float(values))
        inside = ", ".join(self.braced(entry) for entry in values)
        return f"{{{inside or self.real.literal(0.0)}}}"  # C99 takes no empty braces

    def words(self, common: dict[str, object]) -> dict[str, object]:
        loop, p = self.loop, self.prefix
        known = loop.known.size if loop.known is not None else 0
        names = [member.name for member in loop.changeable]
        counts = [np.size(getattr(loop.stages, name)) for name in names]
        taken = zip(names, itertools.accumulate(counts, initial=0), counts, strict=False)
        last = len(ANOMALIES) - 1
        quiet_nan = self.real.exponent_mask | 1 << (self.real.mantissa_bits - 1)
        return {
            **common,
            "loop": loop,
            "np_size": max(loop.stages.np, 1),
            "taken": [row for row in taken if row[2]],
            "setpoints": [*enumerate(loop.reference.fields)],
            "disturbances": loop.start.size - loop.stages.nd,
            "diagnosis": [
                (f"{p}_real" if n.kind == "real" else n.kind, n.exported, n.text, n.place)
                for n in ControlParts.diagnosis
            ],
            "width": self.real.width,
            "missing": self.real.bit_pattern(quiet_nan),
            "sensors": [(name.upper().replace(" ", "_"), k) for k, name in enumerate(loop.watched)],
            "indent_mpc": " " * len(f"int {p}_mpc("),
            "indent_step": " " * len(f"int {p}_estimator_step("),
            "indent_mission": " " * len(f"int {p}_mission_step("),
            "estimator_settings": "settings_exported.ekf" if self.mpc else "settings_exported",
            "known": known,
            "mpc": self.mpc,
            "estimator": "estimator" in loop.parts,
            "phases": [*enumerate(identifiers(map(str.upper, loop.phases.names if loop.phases else ())))],
            "u_min": 2 * loop.stages.nr,  # behind the weights; see ``changeable``
            "u_max": 2 * loop.stages.nr + loop.stages.nu,
            **{name: f"<<{name}>>" for name in SIZES},
            "anomalies": [(n, 2**k, "," if k < last else " ", text) for k, (n, text) in enumerate(ANOMALIES.items())],
        }

    def source(self, words: dict[str, object]) -> str:
        loop, p = self.loop, self.prefix
        settings = [loop.settings] if self.mpc else []
        known = [loop.known] if loop.known else []
        inputs = [loop.command, loop.measurement, loop.start, *known, *settings]
        outputs = [loop.start, loop.measurement, loop.command, *known, *settings]
        files = {"given": True, "estimator": words["estimator"], "controller": self.mpc}
        files |= {"mission": loop.phases}
        more = {
            "sqrt": c_source({"sqrt"}, self.real, p),
            "prototypes": self.headers()[1],
            "adapters": self.adapters(),
            "bodies": self.bodies(),
            "numbers": self.numbers(),
            "structs": fill("structs.c", {"p": p, "read": each_once(inputs), "written": each_once(outputs)}),
            "check": fill("check_numbers.c", words),
            "functions": "\n".join(fill(f"control/{name}.c", words) for name, has in files.items() if has),
        }
        return fill("control/common.c", {**words, **more})


def control_sources(loop: Loop, prefix: str, real: CReal) -> tuple[dict[str, str], dict[str, str]]:
    """Files of estimator and controller by path, and the declarations of each part.

    The declarations leave places for the bytes of the memory, which are known once it was compiled.
    """
    writer = _Writer(loop, prefix, real)
    words = writer.words({"p": prefix, "version": __version__})
    files = {f"include/{prefix}_memory.h": writer.memory(words), f"src/{prefix}_control.c": writer.source(words)}
    headers = {"estimator": "estimator", "mpc": "controller", "mission": "mission"}
    declared = {name: fill(f"control/{headers[name]}.h", words) for name in loop.parts}
    # The first part declares what both take.
    first = f'#include "{prefix}_memory.h"\n\n' + fill("control/anomalies.h", words) + fill("control/given.h", words)
    return files, declared | {loop.parts[0]: f"{first}\n{declared[loop.parts[0]]}"}
