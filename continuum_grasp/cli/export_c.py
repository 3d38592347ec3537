"""``continuum-grasp export-c``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from continuum_grasp.cli.options import listed, out_option, simulation_scene, verb
from continuum_grasp.cli.output import Output
from continuum_grasp.errors import InputError

if TYPE_CHECKING:
    from continuum_grasp.export import Package

Ranges = Annotated[
    list[str] | None,
    typer.Option("--range", metavar="NAME=LEAST:MOST", help="Range of a run-time parameter; repeatable."),
]
What = Annotated[
    str | None,
    typer.Option(
        "--what",
        metavar="PART,...",
        help="Some of dynamics, step, implicit_step, kinematics, statics, linearization, shape, velocities, contact, "
        "metadata; of a closed loop also estimator and mpc, of a mission mpc and mission (default: of loops and "
        "missions those two, else dynamics, step, kinematics and statics).",
    ),
]
Substeps = Annotated[
    int | None,
    typer.Option("--substeps", metavar="N", help="Runge-Kutta steps within one (default: as stability asks for)."),
]


_OUT = out_option("Folder of the package (default: runs/export-c/NAME-OF-CONFIG).")


@verb("config", "out", "changes", "as_json", "quiet", out=_OUT)
def export_c(
    output: Output,
    real: Annotated[
        str | None, typer.Option("--real", metavar="float|double", help="What to compute in (default: the target's).")
    ] = None,
    what: What = None,
    prefix: Annotated[str, typer.Option("--prefix", metavar="NAME", help="Of all names in C.")] = "finger",
    target: Annotated[
        str, typer.Option("--target", metavar="NAME", help="host, cortex-m4f, cortex-m7 or wasm.")
    ] = "host",
    ranges: Ranges = None,
    step: Annotated[
        float | None, typer.Option("--step", metavar="SECONDS", help="Longest step (default: that of the scene).")
    ] = None,
    substeps: Substeps = None,
    sections: Annotated[
        int, typer.Option("--sections", metavar="N", help="Sections that shape and velocities give in one call.")
    ] = 25,
    error: Annotated[
        float | None, typer.Option("--error", metavar="NUMBER", help="Greatest relative error within the ranges.")
    ] = None,
    measure: Annotated[
        bool, typer.Option("--measure", help="Run the package on the emulated target; put sizes and counts into it.")
    ] = False,
    finger: Annotated[
        str | None, typer.Option("--finger", metavar="NAME", help="Finger of a mission of several: one package each.")
    ] = None,
    casadi: Annotated[str | None, typer.Option("--casadi", hidden=True)] = None,
) -> None:
    """Write a finger, its estimator or controller as a C package: for a microcontroller, a host, or a browser."""
    if casadi is not None:
        raise InputError("--casadi is gone: functions of models are CasADi's; in Python, model.tip.generate('tip.c')")
    from continuum_grasp.scene.control import ControlScene
    from continuum_grasp.scene.load import load
    from continuum_grasp.scene.mission import MissionScene

    loaded = load(output.config, output.changes or ())
    output.check_folder()
    scene = loaded if isinstance(loaded, (ControlScene, MissionScene)) else simulation_scene(output)[0]

    from continuum_grasp.export import export_c as write

    with output.busy("writing the package"):
        package = write(
            scene,
            output.folder,
            real=real,
            what=listed(what),
            prefix=prefix,
            target=target,
            ranges=ranges_of(ranges or ()),
            step=step,
            substeps=substeps,
            sections=sections,
            error=error,
            measured=measure,
            finger=finger,
        )
    _report(package, output)


def _report(package: Package, output: Output) -> None:
    """Print where a package is, its limits and errors, and what an emulated target counted."""
    made = package.manifest
    errors = [f["relative_error"] for f in made["functions"].values() if "relative_error" in f]
    output.pairs(
        {
            "package": f"{package.folder} ({len(package.files)} files; start with README.md)",
            "computes in": made["real"],
            "configuration": made["configuration_hash"],
            **_limits(made),
            "test cases": sum(f["test_cases"] for f in made["functions"].values()),
            **({"greatest relative error": f"{max(errors):g}"} if errors else {}),
        }
    )
    for name, found in ((made["measured"] or {}).get("functions", {})).items():
        output.say(f"{name}: {found['most_instructions']} instructions, {found['stack_bytes']} bytes of stack at most")
    output.result(folder=package.folder, files=package.files, manifest=made)


def _limits(made: Mapping[str, Any]) -> dict[str, str]:
    """Longest step, where the package steps; memory of estimator and controller."""
    found = {}
    if "step" in made["functions"]:
        found["longest step [s]"] = f"{made['stability']['longest_step_s']:g}"
    memory = {k: v for f in made["functions"].values() for k, v in f.get("memory_bytes", {}).items()}
    if memory:
        found["memory [bytes]"] = ", ".join(f"{name} {size}" for name, size in memory.items())
    return found


def ranges_of(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Ranges as NAME=LEAST:MOST."""
    found = {}
    for word in words:
        name, _, pair = word.partition("=")
        try:
            least, most = (float(part) for part in pair.split(":"))
        except ValueError:
            raise InputError(f"--range: expected NAME=LEAST:MOST, got {word!r:.60}") from None
        if name in found:
            raise InputError(f"--range: {name} is given twice")
        found[name] = (least, most)
    return found
