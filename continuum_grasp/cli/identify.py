"""``continuum-grasp identify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from continuum_grasp.cli.options import Config, Json, Out, Quiet, Set, Verbose
from continuum_grasp.cli.output import Output, run_folder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from continuum_grasp.identification import Error, Fit
    from continuum_grasp.scene.document import Document
    from continuum_grasp.scene.identify import IdentifyScene


def identify(
    config: Config,
    data: Annotated[
        list[Path],
        typer.Option("--data", metavar="FILE", help="CSV file of measurements, or a folder of them; repeatable."),
    ],
    out: Out = None,
    changes: Set = None,
    pictures: Annotated[bool, typer.Option("--pictures/--no-pictures", help="Draw pictures.")] = True,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Estimate parameters from measurements, with confidence intervals."""
    output = Output(as_json, quiet, verbose)
    scene, document = _scene(config, changes)
    folder = run_folder(out, config, "identify")

    from continuum_grasp.errors import InputError
    from continuum_grasp.identification import identify as run
    from continuum_grasp.scene.document import undotted

    try:
        with output.busy("identifying") as report:
            fit = run(scene, data, progress=report)
    except InputError as error:
        if error.file is not None or error.key is None:
            raise
        path = undotted(error.key)
        raise document.nearest(path).error(error.message, path) from None
    files = output.save(fit, folder, pictures)
    _report(fit, folder, files, output)


def _scene(config: Path, changes: Sequence[str] | None) -> tuple[IdentifyScene, Document]:
    from continuum_grasp.errors import InputError
    from continuum_grasp.scene.identify import IdentifyScene
    from continuum_grasp.scene.load import load_placed

    loaded, document = load_placed(config, changes or ())
    if isinstance(loaded, IdentifyScene):
        return loaded, document
    raise InputError("expected a scene with parameters to estimate: [{name: ...}] and data", file=str(config))


def _report(fit: Fit, folder: Path, files: list[Path], output: Output) -> None:
    if "fidelity" in fit.statistics:
        output.say(f"fidelity: {fit.statistics['fidelity']}")
    output.warn(fit.warnings)
    output.table(
        ("parameter", "value", "deviation", "95 % interval", "unit"),
        (
            (name, f"{value:.6g}", f"{deviation:.2g}", f"{low:.6g} to {high:.6g}", unit)
            for name, value, deviation, (low, high), unit in zip(
                fit.names, fit.values, fit.deviations, fit.intervals, fit.units, strict=True
            )
        ),
    )
    _errors("fitted", fit.errors, output)
    _errors("hold-out", fit.holdout_errors, output)
    output.pairs({"saved in": f"{folder}", "pictures": ", ".join(file.name for file in files) or "none"})
    output.statistics({"singular values": " ".join(f"{v:.3g}" for v in fit.singular_values), **fit.statistics})
    output.result(
        status=fit.status,
        folder=str(folder),
        files=[str(file) for file in files],
        warnings=list(fit.warnings),
        statistics=dict(fit.statistics),
        **fit.summary(),
    )


def _errors(name: str, errors: Sequence[Error], output: Output) -> None:
    for one in errors:
        output.say(
            f"{name}: {one.group}: {one.rms:.3g} {one.unit} r.m.s., {one.largest:.3g} {one.unit} at most, "
            f"{one.count} numbers"
        )
