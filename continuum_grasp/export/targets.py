"""What a package is made for: targets, and examples for bare metal, ROS 2 nodes, Simulink blocks, and a GPU."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.fields import Real
from continuum_grasp.export.part import Part
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.template import fill


@dataclass(frozen=True)
class Target:
    """A machine, with the real types that its hardware computes in."""

    name: str
    reals: tuple[str, ...]
    """The usual one first."""
    core: str | None = None
    """Argument of ``examples/baremetal/run.sh``."""

    def real(self, given: Any) -> str:
        """The type that is asked for, or the usual one."""
        if given is None:
            return self.reals[0]
        if given in ("float", "double") and given not in self.reals:
            raise InputError(
                f"{self.name} computes {given} in software, 22 to 35 times slower: expected {self.reals[0]}",
                key="real",
            )
        return str(given)


TARGETS = {
    target.name: target
    for target in (
        Target("host", ("double", "float")),
        Target("cortex-m4f", ("float",), "cortex-m4f"),
        Target("cortex-m7", ("double", "float"), "cortex-m7"),
        Target("wasm", ("double", "float")),
    )
}


def target_of(name: Any) -> Target:
    """The target of a name."""
    if not isinstance(name, str) or name not in TARGETS:
        raise InputError(f"expected one of {', '.join(TARGETS)}, got {name!r:.60}", key="target")
    return TARGETS[name]


TOOLS = ("arm-none-eabi-gcc", "qemu-system-arm")
"""Programs that measuring needs."""
_TIMEOUT = 600.0
"""After which an emulator is taken to hang [s]; it counts every instruction."""
_LINE = re.compile(r"^(\w+) (\d+) (\d+) (\d+) (\d+)$", re.MULTILINE)
_COUNTED = ("least_instructions", "mean_instructions", "most_instructions", "stack_bytes")
_SIZE = re.compile(r"^\s*(\d+)\s+(\d+)\s+(\d+)\s+\d+\s+\w+\s+(\w+)\.o$", re.MULTILINE)


def measure(files: Mapping[str, str], prefix: str, target: Target) -> dict[str, Any]:
    """Build a package for its board, run the vectors there, and read off what it says."""
    if target.core is None:
        raise InputError(f"{target.name} has no emulated board: take cortex-m4f or cortex-m7", key="target")
    missing = [tool for tool in TOOLS if shutil.which(tool) is None]
    if missing:
        raise InputError(f"measuring needs {', '.join(missing)} (Debian: gcc-arm-none-eabi, qemu-system-arm)")
    with tempfile.TemporaryDirectory() as work:
        for name, text in files.items():
            path = Path(work) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        line = ["sh", f"{work}/examples/baremetal/run.sh", target.core]
        done = subprocess.run(line, capture_output=True, text=True, timeout=_TIMEOUT, check=False)
    said = done.stdout + done.stderr
    if done.returncode != 0:
        raise SolverError(f"the package failed on {target.core}", status="failed", advice=said[-2000:])
    failures = re.search(r"^(\d+) failures$", said, re.MULTILINE)
    return {
        "core": target.core,
        "compiler": _version("arm-none-eabi-gcc"),
        "emulator": _version("qemu-system-arm"),
        "failures": int(failures[1]) if failures else -1,
        "functions": {
            name: dict(zip(_COUNTED, map(int, counts), strict=True)) for name, *counts in _LINE.findall(said)
        },
        "sizes": {
            f"{name}.o": {"text": int(text), "data": int(data), "bss": int(bss)}
            for text, data, bss, name in _SIZE.findall(said)
        },
    }


def _version(tool: str) -> str:
    done = subprocess.run([tool, "--version"], capture_output=True, text=True, timeout=60, check=False)
    return done.stdout.splitlines()[0] if done.stdout else tool


_BARE_METAL = ("start.c", "board.h", "board.ld", "main.c", "run.sh")
_TENTH = 0.1
"""Time within which the example's input sets in [s]."""
_SHARE = 0.25
"""Of the usual input, that the example takes."""


def example_files(subject: Subject, parts: Sequence[Part], target: Target, words: dict[str, str]) -> dict[str, str]:
    """Examples by path; those that step in time, and those that control, only where the package does."""
    words = {**words, "core": target.core or ("cortex-m4f" if subject.real.name == "float" else "cortex-m7")}
    found = {f"examples/baremetal/{name}": fill(f"examples/baremetal/{name}", words) for name in _BARE_METAL}
    names = {part.name for part in parts}
    if "step" in names:
        found |= _of_steps(subject, {**words, **_words(subject)})
    if "mpc" in names and subject.loop is not None:
        found |= control_examples(subject.loop, subject.prefix, subject.real, words)
    return found


def _of_steps(subject: Subject, words: dict[str, str]) -> dict[str, str]:
    found = {}
    found["examples/loop.c"] = fill("examples/loop.c", words)
    found["tests/batch.c"] = fill("tests/batch.c", words)
    found["examples/cuda/batch.cu"] = fill("examples/cuda/batch.cu", words)
    found[f"examples/simulink/sfun_{subject.prefix}.c"] = fill("examples/simulink/sfun.c", words)
    node = {**words, "node": f"{subject.prefix}_node"}
    for name in ("package.xml", "CMakeLists.txt", "src/node.cpp"):
        found[f"examples/ros2/{name}"] = fill(f"examples/ros2/{name}", node)
    return found


_SFUN_READS = """
  <{p}>_real numbers[PARAMETER_COUNT];
  size_t k;
  if (mxGetNumberOfElements(PARAMETERS(S)) == 0) return code;
  for (k = 0; k < PARAMETER_COUNT; ++k) numbers[k] = ({p}_real)mxGetPr(PARAMETERS(S))[k];
  memcpy(&model->parameters, numbers, sizeof model->parameters);""".replace("<{p}>", "{p}")


def _words(subject: Subject) -> dict[str, str]:
    prefix, real, forced = subject.prefix, subject.real, subject.forces is not None
    constant = subject.model.structure.moment_is_constant
    state, first = subject.state.fields, subject.input.fields[0]
    parameters = subject.parameters.fields if subject.parameters is not None else ()
    return {
        "h": real.literal(subject.accurate_step),
        "h_plain": repr(subject.accurate_step),
        "level": real.literal(_SHARE * first.scale),
        "what_input": "a constant input" if constant else "a constant input that sets in smoothly",
        "onset": "" if constant else f" * (t < {real.literal(_TENTH)} ? t / {real.literal(_TENTH)} : 1)",
        "first_input": first.name,
        "first_state": state[0].name,
        "reach": real.literal(0.5 * state[0].high),
        "forces_array": f"\n  static const {prefix}_forces forces[MOST];" if forced else "",
        "forces_heap": f"\n  {prefix}_forces *forces = calloc((size_t)count, sizeof *forces);" if forced else "",
        "forces_free": "\n  free(forces);" if forced else "",
        "forces_free_more": "\n    free(forces);" if forced else "",
        "forces_none": " || !forces" if forced else "",
        "forces_first": "forces, " if forced else "",
        "forces_each": "&forces[k], " if forced else "",
        "nx": str(subject.nx),
        "nu": str(subject.input.size),
        "ports": "2" if forced else "1",
        "most_port": str(max(subject.nx, subject.input.size, subject.model.nw)),
        "csv_head": "".join(f",{f.name} [{f.unit}]" for f in state),
        "csv_format": ",%.9g" * len(state),
        "csv_values": "".join(f",\n           (double)state.{f.name}" for f in state),
        "np": str(subject.model.np),
        "node_declares": declared_parameters([f.name for f in parameters], "model_.parameters"),
        "node_reads": read_parameters(prefix, [f.name for f in parameters], "model_.parameters"),
        "sfun_reads": _SFUN_READS.format(p=prefix) if parameters else "",
        "forces_declared": f"\n  {prefix}_forces forces;" if forced else "",
        "forces_zero": "\n  memset(&forces, 0, sizeof forces);" if forced else "",
        "forces_passed": ", &forces" if forced else "",
        "forces_member": ", &forces_" if forced else "",
        "forces_of_node": f"\n  {prefix}_forces forces_{{}};" if forced else "",
        "forces_port": f", forces ({subject.model.nw})" if forced else "",
        "forces_width": f"\n  ssSetInputPortWidth(S, 1, {prefix.upper()}_NW);" if forced else "",
        "forces_read": f"\n  read_port(S, 1, {prefix.upper()}_NW, numbers);\n  memcpy(&forces, numbers, sizeof forces);"
        if forced
        else "",
        "cuda_forces": f"\n  {prefix}_forces forces = {{}};" if forced else "",
    }


def declared_parameters(names: Sequence[str], struct: str) -> str:
    """C++ that declares members of a struct as parameters of a node, at their present values."""
    return "".join(f'\n    declare_parameter("{name}", static_cast<double>({struct}.{name}));' for name in names)


def read_parameters(prefix: str, names: Sequence[str], struct: str) -> str:
    """C++ that reads them again; the library checks their ranges."""
    if not names:
        return ""
    lines = [
        f'    if (get_parameter("{name}", value)) {struct}.{name} = static_cast<{prefix}_real>(value);'
        for name in names
    ]
    return "\n".join(["    double value = 0;", *lines, ""])


def _sfun_reads(prefix: str, loop: Loop) -> str:
    """C that takes settings, and what is known, from the block's parameters."""
    structs = [("settings", loop.settings)] + ([("known", loop.known)] if loop.known is not None else [])
    blocks = [
        f"""\
  {{
    {prefix}_real values[{struct.size}];
    memcpy(values, &controller->{name}, sizeof values);
    if (!read_parameter(S, {k}, {struct.size}, values)) {{
      ssSetErrorStatus(S, "{name}: {struct.size} numbers, or []");
      return;
    }}
    memcpy(&controller->{name}, values, sizeof values);
  }}
"""
        for k, (name, struct) in enumerate(structs)
    ]
    return "".join(blocks)


def control_examples(loop: Loop, prefix: str, real: Real, words: Mapping[str, str]) -> dict[str, str]:
    """Examples by path."""
    s = loop.stages
    known = [f.name for f in loop.known.fields] if loop.known is not None else []
    words = {
        **words,
        "node": f"{prefix}_control_node",
        "period": f"{loop.period:.12g}",
        "nm": str(loop.measurement.size),
        "nr": str(s.nr),
        "nu": str(s.nu),
        "nodes": str(s.stages + 1),
        "measured": ", ".join(loop.measurement_names),
        "wanted": ", ".join(real.literal(float(v)) for v in loop.wanted),
        "wanted_names": ", ".join(s.r_names),
        "ns": str(loop.settings.size),
        "known_parameter": f", known ({loop.known.size}, [] as well)" if loop.known is not None else "",
        "block_parameters": str(1 + (loop.known is not None)),
        "node_declares": declared_parameters([f.name for f in loop.settings.fields], "controller_.settings")
        + declared_parameters(known, "controller_.known"),
        "node_reads": read_parameters(prefix, [f.name for f in loop.settings.fields], "controller_.settings")
        + read_parameters(prefix, known, "controller_.known").replace("    double value = 0;\n", ""),
        "sfun_reads": _sfun_reads(prefix, loop),
        "command_head": ",".join(s.u_names),
        "mex_sources": "".join(f" ../../src/{name}.c" for name in words["sources"].split()),
    }
    found = {"examples/control_loop.c": fill("examples/control/loop.c", words)}
    found[f"examples/simulink/sfun_{prefix}_control.c"] = fill("examples/control/sfun.c", words)
    found["examples/ros2_control/src/node.cpp"] = fill("examples/control/node.cpp", words)
    for name in ("package.xml", "CMakeLists.txt"):
        found[f"examples/ros2_control/{name}"] = fill(f"examples/ros2/{name}", words)
    return found
