"""``continuum-grasp export --to mjcf``."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from continuum_grasp.addons.chains.write import HingeChain
    from continuum_grasp.cli import Output


def report(chain: HingeChain, output: Output) -> None:
    """Print where a chain of hinges is, its controls, and what differs from the scene."""
    output.warn(f"differs: {text}" for text in chain.differences)
    output.pairs(
        {
            "written": ", ".join(map(str, chain.files)),
            "hinges": chain.hinges,
            "controls": ", ".join(chain.control_names) or "none",
            "first frequency": f"{chain.first_frequency:.6g} Hz, straight and unloaded",
            "timestep": f"{chain.timestep:g} s",
        }
    )
    output.result(
        files=chain.files,
        hinges=chain.hinges,
        controls=chain.control_names,
        first_frequency_hz=chain.first_frequency,
        timestep_s=chain.timestep,
        differences=chain.differences,
    )
