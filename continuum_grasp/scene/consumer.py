"""Keys of a scene that a verb, an export or a plant does not take: declared by key, refused or listed in one place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from continuum_grasp.errors import InputError

CONSUMERS: dict[str, Consumer] = {}
"""All declarations by name, in the order of their import."""
LIMITS_OF_BENDING = {
    "fidelity.frequencies": "of fidelity.tolerance",
    "finger.strain_limit": "where fidelity.bending_range is not given it limits that",
    **dict.fromkeys(
        ("finger.rod.diameter", "finger.rod.thickness"),
        "beside stiffness and mass it says where the strain limit is reached",
    ),
    "supports.touch": "of grasps",
}
"""Keys that motions do not need, and why."""
LEAST_COMMANDS = dict.fromkeys(
    ("finger.tendons.min_tension", "finger.pressure.min_pressure"), "a limit of commands: from zero on all are taken"
)
LIMITS_OF_COMMANDS = {
    **LEAST_COMMANDS,
    **dict.fromkeys(("finger.tendons.max_tension", "finger.pressure.max_pressure"), "a limit of commands"),
}
"""Keys that limit commands alone, which a scene keeps to; those above are not needed by ranges from zero on."""


@dataclass(frozen=True)
class Consumer:
    """A declaration of the keys of a scene that something does not take as they are.

    A key is dotted, without indices: it stands for that of each entry of a list or mapping. ``key=word`` is the key
    with that value alone, or that word in a list. A key counts as given where it differs from its default. Arguments of
    functions and options of commands are declared in the same way, by their names.

    Attributes
    ----------
    name : str
        What it is, as the table in the documentation has it.
    refused : mapping of str to str
        By key, why it is an error.
    otherwise : mapping of str to str
        By key, what becomes of it instead: listed for the user.
    unneeded : mapping of str to str
        By key, or that of a whole part, why nothing is missing without it: in the documentation alone. ``*`` is any
        name.
    where : callable
        Whether it is about a scene: of what has no effect beside other keys.
    at : str
        Where the part stands in the scene that is checked, such as ``finger.tendons.drive``; keys are those of the
        scene.
    """

    name: str
    refused: Mapping[str, str] = field(default_factory=dict)
    otherwise: Mapping[str, str] = field(default_factory=dict)
    unneeded: Mapping[str, str] = field(default_factory=dict)
    where: Callable[[Any], Any] = lambda scene: True
    at: str = ""

    def __post_init__(self) -> None:
        CONSUMERS[self.name] = self

    def check(self, scene: Any, place: str = "", of: BaseModel | Mapping[str, Any] | None = None) -> tuple[str, ...]:
        """List what becomes of keys that are taken otherwise, of a scene or of the part of one that is ``at`` a key.

        ``of`` is what has the keys, where that is not the scene: a value, or arguments by name with whether they are
        given, or as what the error calls them. The key of an `InputError`, of the first that is refused, is seen from
        there, or begins with ``place``.
        """
        if not self.where(scene):
            return ()
        head = f"{self.at}." if self.at else ""
        of = scene if of is None else of
        for key, why in self.refused.items():
            if present := next(_given(of, key.removeprefix(head)), None):
                raise InputError(why, key=f"{place}.{present}" if place else present)
        return tuple(
            f"{key}: {text}" for key, text in self.otherwise.items() if any(_given(of, key.removeprefix(head)))
        )


def beside(name: str, where: Callable[[Any], Any], keys: str, why: str, at: str = "") -> Consumer:
    """Declare that keys, separated by spaces, have no place in some scenes, where giving them is an error.

    ``at`` is where the part stands that is checked; keys are seen from there. The first word of ``name`` says whose
    scenes these are.
    """
    head = f"{at}." if at else ""
    return Consumer(name, dict.fromkeys((f"{head}{key}" for key in keys.split()), why), where=where, at=at)


def needs(whose: str, keys: str, other: str, why: str = "", at: str = "") -> Consumer:
    """Declare that keys have no place without another one."""
    word = other.replace("=", ": ")
    return beside(f"{whose} without {word}", lambda s: not any(_given(s, other)), keys, why or f"needs {word}", at)


def excludes(whose: str, keys: str, other: str, why: str, at: str = "") -> Consumer:
    """Declare that keys have no place beside another one."""
    return beside(f"{whose} with {other.replace('=', ': ')}", lambda s: any(_given(s, other)), keys, why, at)


def _given(value: Any, key: str, where: str = "") -> Iterator[str]:
    """Places in a scene, or names among arguments, where a key is given."""
    if not where and isinstance(value, dict):
        if value.get(key):
            yield value[key] if isinstance(value[key], str) else key
        return
    path, _, word = key.partition("=")
    name, _, rest = path.partition(".")
    if isinstance(value, tuple | list):
        for k, child in enumerate(value):
            yield from _given(child, key, f"{where}[{k}]")
    elif isinstance(value, Mapping):
        for label, child in value.items():
            yield from _given(child, key, f"{where}.{label}")
    elif isinstance(value, BaseModel) and (field := type(value).model_fields.get(name)):
        child, here = getattr(value, name), f"{where}.{name}".removeprefix(".")
        default = field.get_default(call_default_factory=True, validated_data={})
        if rest:
            yield from _given(child, rest + (f"={word}" if word else ""), here)
        elif word and isinstance(child, tuple):
            yield from (f"{here}[{k}]" for k, each in enumerate(child) if each == word)
        elif child == word if word else bool(child) if default is PydanticUndefined else child not in (default, None):
            yield here


SECTION_LAWS = {
    "finger.stops": "stops",
    "finger.softening": "a material that softens",
    "finger.gyration_radius": "tendons that shorten the rod",
    "finger.damping.quadratic": "quadratic damping",
    "finger.damping.dry_friction": "dry friction in bending",
    "finger.damping.relaxation": "a material that relaxes",
}
FIT_MATCHED_TIP = ("finger.damping.quadratic", "finger.gyration_radius")
"""Laws under which the moment of the input alone gives the curvature at the tip."""


def unknown_to(who: str, *known: str) -> dict[str, str]:
    """Say, by key, why what has laws of its own refuses all but those that it knows."""
    others = {key: word for key, word in SECTION_LAWS.items() if key not in known}
    return {key: f"{who} does not know {word}: leave {key.rpartition('.')[2]} out" for key, word in others.items()}
