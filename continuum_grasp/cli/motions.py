"""Verbs of one finger in motion: ``simulate``, ``modes``, ``accuracy``."""

from __future__ import annotations

import math
from itertools import zip_longest

from continuum_grasp.base import InputError
from continuum_grasp.cli.options import option, run_verb, verb
from continuum_grasp.cli.output import Output


@run_verb("animation")
def simulate(output: Output) -> None:
    """Move a finger in time."""
    from continuum_grasp.scene import Scene

    scene: Scene = output.scene(Scene)
    if scene.time is None:
        raise InputError("a simulation needs time: {duration: ..., step: ...}", file=str(output.config), key="time")

    from continuum_grasp.simulation import simulate as run

    trajectory, files = output.run("simulating", lambda report: run(scene, progress=report))
    energy = (trajectory.kinetic + trajectory.potential)[[0, -1]]
    values = {
        "duration": trajectory.t[-1],
        "steps": len(trajectory.t) - 1,
        "tip": tuple(trajectory.tip[-1]),
        "energy": energy,
    }
    values |= {name: getattr(trajectory, name) for name in ("time_error", "space_error", "static_error")}
    output.report(trajectory, files, **values)


_FOLDER = "Save modes and their picture in this folder; an earlier run of modes is replaced."


@verb("config", "out", "changes", "as_json", "quiet", out=_FOLDER)
def modes(output: Output) -> None:
    """Natural frequencies and shapes about the equilibrium."""
    from continuum_grasp.scene import Scene

    scene = output.scene(Scene)

    from continuum_grasp.simulation import modes as find

    if output.out is not None:
        output.check_folder()  # by the files of its results
    with output.busy("finding modes"):
        spectrum = find(scene)
    output.warn(spectrum.warnings)
    if not spectrum.stable:
        output.warn(["the equilibrium is unstable"])
    if spectrum.outcome != spectrum.status:
        output.say(f"{spectrum.status}: {spectrum.outcome}")
    note = spectrum.statistics.get("fidelity")
    if note:
        output.say(f"fidelity: {note}")
    files = output.save(spectrum) if output.out is not None else []
    columns = {
        "frequency [Hz]": [f"{frequency:.5g}" for frequency in spectrum.frequencies_hz],
        "space error": [f"{error:.2g}" for error in spectrum.space_error],
        "damping ratio": ["-" if math.isnan(ratio) else f"{ratio:.3g}" for ratio in spectrum.damping_ratios],
    }
    others = {"all stuck [Hz]": spectrum.stuck_frequencies_hz, "motors free [Hz]": spectrum.free_frequencies_hz}
    for name, values in others.items():
        if values is not None:
            columns[name] = [f"{number:.5g}" for number in values]
    rows = zip_longest(*columns.values(), fillvalue="-")
    output.table(("mode", *columns), *((str(k + 1), *row) for k, row in enumerate(rows)))
    if output.out is not None:
        output.say(f"saved in {output.out}")
    output.result(
        status=spectrum.status,
        stable=spectrum.stable,
        fidelity=note or None,
        warnings=spectrum.warnings,
        frequencies_hz=spectrum.frequencies_hz,
        space_error=spectrum.space_error,
        damping_ratios=spectrum.damping_ratios,
        stuck_frequencies_hz=spectrum.stuck_frequencies_hz,
        free_frequencies_hz=spectrum.free_frequencies_hz,
        folder=output.out,
        files=files,
    )


@verb("config", "out", "changes", "as_json", "quiet")
def accuracy(
    output: Output,
    most: int = option("Greatest number of elements.", "--elements", default=16, metavar="N", min=1, max=32),
) -> None:
    """Compare speed and error of every choice of model. A tolerance is answered with its choice."""
    from continuum_grasp.scene import Scene

    scene = output.scene(Scene)

    from continuum_grasp.simulation import COUNTS, accuracy_report

    counts = [count for count in COUNTS if count <= most]
    comparison, files = output.run("measuring", lambda report: accuracy_report(scene, counts=counts, progress=report))
    output.say(comparison.markdown())
    output.conclude(comparison, files, choices=comparison.choices.as_dict())
