"""Add-ons: extensions that the core does not know, announced by entry points.

The entry point of an installed distribution in the group ``continuum_grasp.addons`` names an `Addon`, which adds kinds
of configurations, verbs of the command line and exports to the package. Texts ``module:name`` name all of them, so that
an add-on is only loaded when it is used.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

from continuum_grasp.base.errors import InputError

GROUP = "continuum_grasp.addons"
"""Group of the entry points of add-ons."""


@dataclass(frozen=True)
class ConfigurationKind:
    """A kind of configuration: how its files are recognized, their class, and the verb that runs them."""

    name: str
    model: str
    """Class of pydantic, as ``module:name``."""
    words: str
    """Words for it in messages, with an article."""
    keys: str
    """Keys that identify the kind, for messages."""
    command: str | None
    """Verb that runs it; None without a verb."""
    required: Collection[str] = ()
    """Keys that each of its files has."""
    marks: Collection[str] = ()
    """Keys; each of its files has one of them at least."""
    without: Collection[str] = ()
    """Keys that none of its files has."""
    names_files: bool = True
    """Whether ``finger`` and ``grasp`` may be paths of files."""
    reader: str = ""
    """Function `ConfigurationData` -> scene, where a file names more than its class checks, as ``module:name``."""
    loop: str = ""
    """Function (scene or its result, name of a finger) -> what an export takes as a closed loop, as ``module:name``."""
    results: Collection[str] = ()
    """Class names of the results that ``loop`` takes, too."""
    prepare: str = ""
    """Function (scene, name of a finger) -> the result that ``loop`` needs instead of them, if this takes long, as
    ``module:name``; it first refuses the scenes that ``loop`` refuses."""
    preparing: str = ""
    """Words for what ``prepare`` does."""

    @property
    def class_name(self) -> str:
        """Name of the class of its scenes."""
        return self.model.partition(":")[2]

    @property
    def scene_class(self) -> Any:
        """Class of its scenes, which is loaded when it is first asked for."""
        return named_value(self.model)

    @property
    def expected(self) -> str:
        """Expected kind of file, as errors name it."""
        return f"{self.words} ({self.keys}, ...)"

    def recognizes(self, keys: Collection[str]) -> bool:
        """Whether a file with these keys is of this kind."""
        there = set(keys)
        marked = not self.marks or bool(there & set(self.marks))
        return marked and there >= set(self.required) and not there & set(self.without)


@dataclass(frozen=True)
class Addon:
    """Parts that an add-on gives to the package.

    Parameters
    ----------
    kinds : tuple of ConfigurationKind
        Configurations that ``load`` then reads.
    verbs : mapping of str to str
        Functions of the command line by their verbs, as ``module:name``.
    exports : mapping of str to str
        Subclasses of `ExportTarget` by the word of ``export --to``, as ``module:name``.
    contact_laws : mapping of str to str
        Subclasses of ``continuum_grasp.model.TouchLaw`` by the value of ``contact_law.law``, as ``module:name``.
    plants : mapping of str to str
        Subclasses of ``continuum_grasp.closed_loop.PlantModel`` by the key of ``plant``, as ``module:name``.
    trials : mapping of str to str
        Functions (`continuum_grasp.grasp.HandResult`, progress) -> plain data with ``holds`` and ``words``, which try a
        grasp in another program, by the word of ``grasp --try-in``, as ``module:name``. The word names the Python
        package that it needs. With ``--hold-only`` the function gets ``hold_only=True``: it only holds the object, and
        its words say so.

    Examples
    --------
    >>> from continuum_grasp.base import Addon
    >>> Addon(verbs={"weigh": "my_addon:weigh"}).kinds
    ()
    """

    kinds: tuple[ConfigurationKind, ...] = ()
    verbs: Mapping[str, str] = field(default_factory=dict)
    exports: Mapping[str, str] = field(default_factory=dict)
    contact_laws: Mapping[str, str] = field(default_factory=dict)
    plants: Mapping[str, str] = field(default_factory=dict)
    trials: Mapping[str, str] = field(default_factory=dict)


@cache
def addons() -> dict[str, Addon]:
    """Add-ons that are installed, by the names of their entry points.

    Raises
    ------
    InputError
        If an entry point names no `Addon`, or if the package's own entry points are missing: its metadata are then of
        another version than its files.

    Warns
    -----
    UserWarning
        If an add-on cannot be loaded; the others are there.
    """
    from importlib.metadata import entry_points  # takes longer to import than all else here

    found = {}
    for entry in sorted(entry_points(group=GROUP)):
        named = f"add-on {entry.name!r} ({entry.value})"
        try:
            addon = entry.load()
        except Exception as error:  # of someone else's code: what does not need it works on
            warnings.warn(f"{named} cannot be loaded: {type(error).__name__}: {error}", stacklevel=2)
            continue
        if not isinstance(addon, Addon):
            raise InputError(f"{named}: expected an Addon, got {addon!r:.60}")
        found[entry.name] = addon
    if not any(kind.model.startswith("continuum_grasp.") for addon in found.values() for kind in addon.kinds):
        raise InputError(
            "continuum_grasp is not installed with its add-ons: install it once more, such as by pip install -e ."
        )
    return found


def named_value(text: str) -> Any:
    """The value that a text ``module:name`` names."""
    from pkgutil import resolve_name

    return resolve_name(text)
