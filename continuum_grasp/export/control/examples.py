"""Examples of a package with a controller: a plain loop, a ROS 2 node, a Simulink block."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.reals import Real
from continuum_grasp.export.template import fill

__all__ = ["control_examples"]


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
