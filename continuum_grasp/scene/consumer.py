"""Keys of a scene that a verb, an export or a plant does not take: declared by key, refused or listed in one place."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, ClassVar, cast

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from continuum_grasp.base import InputError


@dataclass(frozen=True)
class Consumer:
    """Declaration of the keys of a scene, or of a part of a scene, that a consumer refuses or changes.

    A key is dotted, without indices: it means the key of each entry of a list or mapping. ``key=word`` means the key
    with exactly this value, or with this word in a list. A key counts as given if it differs from its default.
    Arguments of functions and options of commands are declared in the same way, by their names.

    Attributes
    ----------
    name : str
        Name of the consumer in the table of the documentation; empty for keys that exclude each other.
    refused : mapping of str to str
        By key, why it is an error.
    otherwise : mapping of str to str
        By key, what becomes of it instead: listed for the user.
    unneeded : mapping of str to str
        By key, or by a whole part, why nothing is missing without it: in the documentation alone. ``*`` is any
        name.
    where : callable
        Whether the declaration applies to a scene: for keys without effect next to others.
    """

    name: str = ""
    refused: Mapping[str, str] = field(default_factory=dict)
    otherwise: Mapping[str, str] = field(default_factory=dict)
    unneeded: Mapping[str, str] = field(default_factory=dict)
    where: Callable[[Any], Any] = lambda scene: True

    DECLARED: ClassVar[dict[str, Consumer]] = {}
    """All declarations by name, in the order of their import."""
    LIMITS_OF_BENDING: ClassVar[Mapping[str, str]] = {
        "fidelity.frequencies": "of fidelity.tolerance",
        "finger.strain_limit": "where fidelity.bending_range is not given it limits that",
        **dict.fromkeys(
            ("finger.rod.diameter", "finger.rod.thickness"),
            "beside stiffness and mass it says where the strain limit is reached",
        ),
        "supports.touch": "of grasps",
    }
    """Keys that motions do not need, and why."""
    LEAST_COMMANDS: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("finger.tendons.min_tension", "finger.pressure.min_pressure"),
        "a limit of commands: from zero on all are taken",
    )
    LIMITS_OF_COMMANDS: ClassVar[Mapping[str, str]] = {
        **LEAST_COMMANDS,
        **dict.fromkeys(("finger.tendons.max_tension", "finger.pressure.max_pressure"), "a limit of commands"),
    }
    """Keys that limit commands alone, which a scene keeps to; those above are not needed by ranges from zero on."""

    def __post_init__(self) -> None:
        self.DECLARED[self.name or str(dict(self.refused))] = self

    @classmethod
    def beside(cls, keys: str, where: Callable[[Any], Any], why: str) -> Consumer:
        """Declare that keys, separated by spaces, have no place in some scenes, where giving them is an error."""
        return cls(refused=dict.fromkeys(keys.split(), why), where=where)

    @staticmethod
    def refusals(rules: str, **functions: Callable[..., Any]) -> tuple[Consumer, ...]:
        """Declare keys that exclude or need others: one rule per line; indented lines continue a rule.

        ``KEYS with OTHERS: WHY`` refuses keys if one of the others is given, ``KEYS without OTHERS: WHY`` if none is
        given, and ``KEYS: WHY`` always. ``table.{point,stays}`` means two keys, and NAME is the last name of each.
        Others are keys, properties, or ``functions`` of the scene, also with a word as in ``differs(NAME)``. Rules for
        needed keys may omit the reason.
        """
        declared = []
        for line in re.sub(r"\n\s+", " ", inspect.cleandoc(rules)).splitlines():
            rule = cast(re.Match[str], _RULE.fullmatch(line))
            for key in _spelled_out(rule["keys"]):
                name = re.split(r"[.=]", key)[-1]
                other, why = ((rule[part] or "").replace("NAME", name) for part in ("other", "why"))
                where = KeyCondition(_spelled_out(other), rule["how"] != "with", functions)
                declared.append(Consumer.beside(key, where, why or f"needs {other.replace('=', ': ')}"))
        return tuple(declared)

    @staticmethod
    def unknown_laws(who: str, *known: str) -> dict[str, str]:
        """Return, by key, why a consumer with its own laws of the sections refuses all laws that it does not know."""
        others = {key: word for key, word in SECTION_LAWS.items() if key not in known}
        return {key: f"{who} does not know {word}: leave {key.rpartition('.')[2]} out" for key, word in others.items()}

    def check(self, scene: Any, place: str = "", of: BaseModel | Mapping[str, Any] | None = None) -> tuple[str, ...]:
        """List how the consumer changes keys of a scene, or of a part of it.

        ``of`` has the keys if it is not the scene: a value, or a mapping from the names of arguments to whether they
        are given, or to their names in errors. The `InputError` for the first refused key counts the key from there, or
        begins it with ``place``.
        """
        of = scene if of is None else of
        for key, why in self.refused.items():
            if (present := next(_given(of, key), None)) and self.where(scene):
                raise InputError(why, key=f"{place}.{present}" if place else present)
        otherwise = ((key, text) for key, text in self.otherwise.items() if any(_given(of, key)))
        return tuple(f"{key}: {text}" for key, text in otherwise if self.where(scene))


@dataclass(frozen=True)
class KeyCondition:
    """Whether one of some keys, properties or functions of a scene is something, or ``absent`` none of them is."""

    others: Sequence[str]
    absent: bool
    functions: Mapping[str, Callable[..., Any]]

    def __call__(self, scene: Any) -> bool:
        return any(self._holds(scene, other) for other in self.others) is not self.absent

    def _holds(self, scene: Any, other: str) -> bool:
        name, *words = other.rstrip(")").split("(")
        return bool(self.functions[name](scene, *words)) if name in self.functions else any(_given(scene, other))


_RULE = re.compile(r"(?P<keys>[^:]+?)(?: (?P<how>with|without) (?P<other>[^:]+))?(?:: (?P<why>.+))?")


def _spelled_out(keys: str) -> list[str]:
    """Keys that are separated by spaces, with all alternatives that are in braces."""
    if "{" not in keys:
        return keys.split()
    parts = (re.split(r"\{(.*?)\}", word) for word in keys.split())
    return ["".join(key) for each in parts for key in product(*(part.split(",") for part in each))]


def _given(value: Any, key: str, where: str = "") -> Iterator[str]:
    """Places in a scene, or names among arguments, where a key is given, or a property is something."""
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
    elif hasattr(value, name):
        child, here = getattr(value, name), f"{where}.{name}".removeprefix(".")
        known = getattr(type(value), "model_fields", {}).get(name)
        default = (
            PydanticUndefined if known is None else known.get_default(call_default_factory=True, validated_data={})
        )
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
"""Laws under which the moment of the input alone determines the curvature at the tip; with quadratic damping, at
rest."""
