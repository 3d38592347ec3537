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
        found = find(scene)
    if note:
        found = replace(found, statistics={"fidelity": note})
    output.warn(found.warnings)
    if not found.stable:
        output.warn(["the equilibrium is unstable"])
    files = output.save(found) if output.out is not None else []
    columns = {
        "frequency [Hz]": [f"{one:.5g}" for one in found.frequencies_hz],
        "space error": [f"{one:.2g}" for one in found.space_error],
        "damping ratio": ["-" if math.isnan(one) else f"{one:.3g}" for one in found.damping_ratios],
    }
    others = {"all stuck [Hz]": found.stuck_frequencies_hz, "motors free [Hz]": found.free_frequencies_hz}
    columns |= {name: [f"{one:.5g}" for one in values] for name, values in others.items() if values is not None}
    rows = zip_longest(*columns.values(), fillvalue="-")
    output.table(("mode", *columns), *((str(k + 1), *row) for k, row in enumerate(rows)))
    if output.out is not None:
        output.say(f"saved in {output.out}")
    output.result(
        stable=found.stable,
        fidelity=note or None,
        warnings=found.warnings,
        frequencies_hz=found.frequencies_hz,
        space_error=found.space_error,
        damping_ratios=found.damping_ratios,
        stuck_frequencies_hz=found.stuck_frequencies_hz,
        free_frequencies_hz=found.free_frequencies_hz,
        folder=output.out,
        files=files,
    )
