"""``continuum-grasp identify``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from continuum_grasp.cli.options import Config, Json, Out, Pictures, Quiet, Set, Verbose
from continuum_grasp.cli.output import Output, run_folder, saved_in
from continuum_grasp.errors import InputError

_SHOWN = 12
"""Values of single sets that are printed [1]: the coordinates of many starts say little."""


def identify(
    config: Config,
    data: Annotated[
        list[Path],
        typer.Option("--data", metavar="FILE", help="CSV file of measurements, or a folder of them; repeatable."),
    ],
    out: Out = None,
    changes: Set = None,
    pictures: Pictures = True,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Estimate parameters from measurements, with confidence intervals."""
    from continuum_grasp.scene.identify import IdentifyScene
    from continuum_grasp.scene.load import load_placed

    output = Output(as_json, quiet, verbose)
    scene, document = load_placed(config, changes or ())
    if not isinstance(scene, IdentifyScene):
        raise InputError("expected a scene with parameters to estimate: [{name: ...}] and data", file=str(config))
    folder = run_folder(out, config, "identify")

    from continuum_grasp.identification import identify as run

    try:
        with output.busy("identifying") as report:
            fit = run(scene, data, progress=report)
    except InputError as error:
        if error.file is not None or error.key is None:
            raise
        raise document.placed_error(error) from None
    files = output.save(fit, folder, pictures)
    if "fidelity" in fit.statistics:
        output.say(f"fidelity: {fit.statistics['fidelity']}")
    output.warn(fit.warnings)
    output.table(
        ("parameter", "value", "deviation", "95 % interval", "unit"),
        *(
            (name, f"{value:.6g}", f"{deviation:.2g}", f"{low:.6g} to {high:.6g}", unit)
            for name, value, deviation, (low, high), unit in zip(
                fit.names, fit.values, fit.deviations, fit.intervals, fit.units, strict=True
            )
        ),
    )
    of_sets = zip(fit.set_names, fit.set_values, fit.set_deviations, strict=True)
    shown = [(name, f"{value:.6g}", f"{deviation:.2g}") for name, value, deviation in of_sets][:_SHOWN]
    if shown:
        more = len(fit.set_names) - len(shown)
        output.table(("of one set" + (f" ({more} more in the result)" if more else ""), "value", "deviation"), *shown)
    for name, errors in (("fitted", fit.errors), ("hold-out", fit.holdout_errors)):
        for one in errors:
            largest = f"{one.largest:.3g} {one.unit} at most"
            output.say(f"{name}: {one.group}: {one.rms:.3g} {one.unit} r.m.s., {largest}, {one.count} numbers")
    output.pairs(saved_in(folder, files))
    statistics = fit.statistics
    output.statistics({"singular values": " ".join(f"{v:.3g}" for v in fit.singular_values), **statistics})
    own = {"status": fit.status, "folder": folder, "files": files, "warnings": fit.warnings, "statistics": statistics}
    output.result(**own, **fit.summary())
