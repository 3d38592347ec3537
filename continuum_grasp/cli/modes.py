"""``continuum-grasp modes``."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import zip_longest

from continuum_grasp.cli.options import out_option, resolved_scene, verb
from continuum_grasp.cli.output import Output

_OUT = out_option("Save modes and their picture in this folder; an earlier run of modes is replaced.")


@verb("config", "out", "changes", "as_json", "quiet", out=_OUT)
def modes(output: Output) -> None:
    """Natural frequencies and shapes about the equilibrium."""
    scene, note = resolved_scene(output, vibrates=True)
    if output.out is not None:
        output.check_folder()

    from continuum_grasp.simulation import modes as find

    with output.busy("finding modes"):
        spectrum = find(scene)
    if note:
        spectrum = replace(spectrum, statistics={"fidelity": note})
    output.warn(spectrum.warnings)
    if not spectrum.stable:
        output.warn(["the equilibrium is unstable"])
    files = output.save(spectrum) if output.out is not None else []
    columns = {
        "frequency [Hz]": [f"{frequency:.5g}" for frequency in spectrum.frequencies_hz],
        "space error": [f"{error:.2g}" for error in spectrum.space_error],
        "damping ratio": ["-" if math.isnan(ratio) else f"{ratio:.3g}" for ratio in spectrum.damping_ratios],
    }
    others = {"all stuck [Hz]": spectrum.stuck_frequencies_hz, "motors free [Hz]": spectrum.free_frequencies_hz}
    columns |= {name: [f"{number:.5g}" for number in values] for name, values in others.items() if values is not None}
    rows = zip_longest(*columns.values(), fillvalue="-")
    output.table(("mode", *columns), *((str(k + 1), *row) for k, row in enumerate(rows)))
    if output.out is not None:
        output.say(f"saved in {output.out}")
    output.result(
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
