"""``continuum-grasp export --to mjcf``."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from continuum_grasp.base import ExportTarget

if TYPE_CHECKING:
    from continuum_grasp.addons.chains.hands import HandChain
    from continuum_grasp.addons.chains.write import HingeChain
    from continuum_grasp.cli import Output


class ChainTarget(ExportTarget):
    """Chains of hinges for MuJoCo, in a file."""

    suffix = ".xml"
    takes_loops = False
    takes_hands = True

    @property
    def write(self) -> Callable[..., Any]:
        from continuum_grasp.addons.chains.write import export_mjcf

        return export_mjcf

    def report(self, written: HingeChain | HandChain, output: Output) -> None:
        """Print where a chain of hinges is, its controls, and what differs from the scene."""
        output.warn(f"differs: {text}" for text in written.differences)
        output.pairs(
            {
                "written": ", ".join(map(str, written.files)),
                "hinges": written.hinges,
                "controls": ", ".join(written.control_names) or "none",
                "first frequency": f"{written.first_frequency:.6g} Hz, straight and unloaded",
                "timestep": f"{written.timestep:g} s",
            }
        )
        output.result(
            files=written.files,
            hinges=written.hinges,
            controls=written.control_names,
            first_frequency_hz=written.first_frequency,
            timestep_s=written.timestep,
            differences=written.differences,
        )
