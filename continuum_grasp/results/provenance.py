"""What a result was made with."""

from __future__ import annotations

import functools
import platform
from datetime import UTC, datetime
from importlib import metadata

__all__ = ["created_now", "machine", "versions"]

_PACKAGES = {"continuum_grasp": "continuum-grasp", "casadi": "casadi", "numpy": "numpy"}


def versions() -> dict[str, str]:
    """Versions of Python, the package, CasADi and numpy; nothing is imported for it.

    Returns
    -------
    dict of str to str
        ``"not installed"`` where a package has no installed version, as in a plain checkout.
    """
    return dict(_versions())


@functools.cache
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name, distribution in _PACKAGES.items():
        try:
            found[name] = metadata.version(distribution)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine() -> dict[str, str]:
    """Operating system, its release, processor architecture and Python implementation.

    Returns
    -------
    dict of str to str
        No host or user name.
    """
    return {
        "system": platform.system(),
        "release": platform.release(),
        "architecture": platform.machine(),
        "implementation": platform.python_implementation(),
    }


def created_now() -> str:
    """Time of now in UTC as ISO 8601 to the second."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
