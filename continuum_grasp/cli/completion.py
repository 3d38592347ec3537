"""Completions of a shell: names of examples, and configurations that a verb takes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from itertools import islice

import typer

_ALSO = {"modes": {"simulate"}, "accuracy": {"simulate"}, "export": {"simulate", "mpc", "mission"}}
"""Kinds of configuration by verbs that are not the command of any kind."""
_DEPTH = 3
"""Folders below the one that is typed in which configurations are looked for: a project has configs/KIND."""
_MOST = 2000
"""Entries of folders that are looked at: 30 ms on a local disk; a home folder has more, and is not searched through."""
_HEAD = 16_384
"""Bytes of a file that are looked at: the longest shipped configuration has 3,000."""
_KEY = re.compile(r"^([a-z_]+)\s*:", re.MULTILINE)


def complete_example(incomplete: str) -> list[tuple[str, str]]:
    """Names of examples, each with its summary."""
    from continuum_grasp.examples import examples

    return [(one.name, one.summary) for one in examples().values() if one.name.startswith(incomplete)]


def complete_kind(incomplete: str) -> list[str]:
    """Kinds of configuration."""
    from continuum_grasp.scene.kinds import KINDS

    return [kind for kind in KINDS if kind.startswith(incomplete)]


def complete_config(ctx: typer.Context, incomplete: str) -> list[str]:
    """Configurations in and below the folder that is typed, of the kinds that the verb takes."""
    from continuum_grasp.scene.kinds import KINDS

    verb = ctx.info_name or ""
    wanted = _ALSO.get(verb) or {name for name, kind in KINDS.items() if kind.command == verb} or set(KINDS)
    folder, _, _ = incomplete.rpartition("/")
    at = "/" if incomplete.startswith("/") and not folder else folder
    found = (path for path in islice(_entries(at, _DEPTH), _MOST) if path.endswith((".yaml", ".yml")))
    return [path for path in found if path.startswith(incomplete) and _kind(path) in wanted]


def _entries(folder: str, depth: int) -> Iterator[str]:
    """Paths of files in and below a folder, as they are typed: relative where the folder is."""
    try:
        entries = sorted(os.scandir(os.path.expanduser(folder) or "."), key=lambda entry: (entry.is_dir(), entry.name))
    except OSError:
        return
    for entry in entries:
        path = os.path.join(folder, entry.name)
        if entry.name.startswith("."):
            continue
        if entry.is_dir(follow_symlinks=False) and depth > 0:
            yield from _entries(path, depth - 1)
        else:
            yield path


def _kind(path: str) -> str | None:
    """The kind of a configuration by its keys; None for other files."""
    from continuum_grasp.scene.assembly import kind_of

    try:
        with open(os.path.expanduser(path), encoding="utf-8") as file:
            keys = dict.fromkeys(_KEY.findall(file.read(_HEAD)))
    except (OSError, UnicodeDecodeError):
        return None
    return kind_of(keys) if "schema_version" in keys else None
