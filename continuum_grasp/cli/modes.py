"""``continuum-grasp modes``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from continuum_grasp.cli.options import Config, Json, Quiet, Set, out_option
from continuum_grasp.cli.output import Output, run_folder

if TYPE_CHECKING:
    from continuum_grasp.scene.simulate import Scene
    from continuum_grasp.simulation import Modes

__all__ = ["modes"]


def modes(
    config: Config,
    out: Annotated[
        Path | None, out_option("Save modes and their picture in this folder; an earlier run of modes is replaced.")
    ] = None,
    changes: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Natural frequencies and shapes about the equilibrium."""
    from continuum_grasp.cli.scenes import simulation_scene

    output = Output(as_json, quiet)
    scene, note = simulation_scene(config, changes, output, vibrates=True)

    folder = None if out is None else run_folder(out, config, "modes")

    from continuum_grasp.simulation import modes as find

    with output.busy("finding modes"):
        found = find(scene)
    output.warn(found.warnings)
    if not found.stable:
        output.warn(["the equilibrium is unstable"])
    files = _save(found, scene, note, folder, output) if folder is not None else []
    output.table(
        ("mode", "frequency [Hz]", "damping ratio"),
        (
            (str(k + 1), f"{frequency:.5g}", "-" if math.isnan(ratio) else f"{ratio:.3g}")
            for k, (frequency, ratio) in enumerate(zip(found.frequencies_hz, found.damping_ratios, strict=True))
        ),
    )
    if out is not None:
        output.say(f"saved in {out}")
    output.result(
        stable=found.stable,
        fidelity=note or None,
        warnings=list(found.warnings),
        frequencies_hz=found.frequencies_hz,
        damping_ratios=found.damping_ratios,
        folder=None if out is None else str(out),
        files=[str(file) for file in files],
    )


def _save(found: Modes, scene: Scene, note: str, folder: Path, output: Output) -> list[Path]:
    from continuum_grasp.plotting import plot_modes, save_picture
    from continuum_grasp.results import write_run

    names = ("frequencies_hz", "damping_ratios", "backbone", "shapes")
    meta: dict[str, Any] = {"kind": "modes", "config": scene.model_dump(mode="json")}
    meta["status"] = "stable" if found.stable else "unstable"
    if note:
        meta["statistics"] = {"fidelity": note}
    with output.saving(folder):
        write_run(folder, {name: getattr(found, name) for name in names}, meta)
    with output.drawing(folder):
        return [save_picture(plot_modes(found), folder / "modes.png")]
