"""Examples of a package with a controller: a plain loop, a ROS 2 node, a Simulink block."""

from __future__ import annotations

from collections.abc import Mapping

from continuum_grasp.export.control.loop import Loop
from continuum_grasp.export.reals import Real
from continuum_grasp.export.template import fill
from continuum_grasp.mpc.setpoints import set_points

__all__ = ["control_examples"]


def control_examples(loop: Loop, prefix: str, real: Real, words: Mapping[str, str]) -> dict[str, str]:
    """Examples by path."""
    s = loop.stages
    wanted = set_points(loop.scene, s, loop.prediction).rows(0.0)[0]
    words = {
        **words,
        "node": f"{prefix}_control_node",
        "period": f"{loop.period:.12g}",
        "nm": str(loop.measurement.size),
        "nr": str(s.nr),
        "nu": str(s.nu),
        "nodes": str(s.stages + 1),
        "measured": ", ".join(loop.measurement_names),
        "wanted": ", ".join(real.literal(float(v)) for v in wanted),
        "wanted_names": ", ".join(s.r_names),
        "command_head": ",".join(s.u_names),
        "mex_sources": "".join(f" ../../src/{name}.c" for name in words["sources"].split()),
    }
    found = {"examples/control_loop.c": fill("examples/control/loop.c", words)}
    found[f"examples/simulink/sfun_{prefix}_control.c"] = fill("examples/control/sfun.c", words)
    found["examples/ros2_control/src/node.cpp"] = fill("examples/control/node.cpp", words)
    for name in ("package.xml", "CMakeLists.txt"):
        found[f"examples/ros2_control/{name}"] = fill(f"examples/ros2/{name}", words)
    return found
