"""The words of a verdict on a grasp that holds: flaws come first, what the search left open comes last."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from continuum_grasp.grasp.result import GraspResult
from continuum_grasp.grasp.values import Status

UNSTABLE = "unstable"
REFUTED = "refuted by the fine model"
STEADIER = (
    "For a stable grasp: contacts nearer to the base, one more contact or support, or a stiffer finger. stability: "
    "ignore, where the drives hold their position or something else steadies the object."
)


def verdict(forces: str, stable: bool, required: bool, notes: Sequence[str]) -> tuple[Status, str]:
    """Status and message of a verified grasp.

    Parameters
    ----------
    forces : str
        With what it is held.
    stable, required : bool
        Whether small motions raise its energy, and whether they must.
    notes : sequence of str
        Why something better may have been missed.

    Returns
    -------
    Status
        ``optimal`` where it is what the scene asks for and there are no notes.
    str
        One sentence.
    """
    flaw = UNSTABLE if required else f"{UNSTABLE} (as the scene allows)"
    head = f"held with {forces}" if stable else f"held but {flaw}: {forces}"
    return Status.FEASIBLE if notes or (required and not stable) else Status.OPTIMAL, "; ".join([head, *notes])


def flawed(result: GraspResult, flaw: str) -> GraspResult:
    """A verified grasp with a flaw that was found afterwards."""
    message = result.message.replace("held with ", f"held but {flaw}: ", 1)
    if message == result.message:  # it has flaws already
        message = message.replace(": ", f" and {flaw}: ", 1)
    return replace(result, status=Status.FEASIBLE, message=message)
