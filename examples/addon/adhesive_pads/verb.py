"""The verb ``pull-off``: compare a motion with and without the pull of the pads."""

from __future__ import annotations

from continuum_grasp import InputError
from continuum_grasp.cli import Output, verb


@verb("config", "changes", "as_json", "quiet")
def pull_off(output: Output) -> None:
    """Compare the last tip of a motion with that of the same pads without adhesion."""
    from continuum_grasp import simulate
    from continuum_grasp.scene import Scene

    scene = output.scene(Scene)
    if scene.contact_law is None or scene.contact_law.law != "adhesive":
        raise InputError("needs contact_law.law: adhesive", file=str(output.config), key="contact_law")
    dry = scene.replaced(contact_law=scene.contact_law.replaced(law=None, law_numbers=()))
    with output.busy("moving"):
        tips = {name: tuple(simulate(one).tip[-1]) for name, one in (("adhesive", scene), ("dry", dry))}
    output.pairs({f"{name} [m]": f"{x:.6f}, {y:.6f}" for name, (x, y) in tips.items()})
    output.result(**tips)
