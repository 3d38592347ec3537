"""The C package of a functional mock-up unit, and its manifest."""

from __future__ import annotations

from typing import Any

from continuum_grasp.export.manifest import FLAGS
from continuum_grasp.export.package import Asked, package_files

OF_LIBRARY = ("include/", "src/")
"""Folders of a package that its library is made of."""
STRICT = (*FLAGS["strict"], *FLAGS["gcc"])
"""Flags of gcc with which results are the same bits everywhere."""


def library_of(given: Any, **options: Any) -> tuple[dict[str, str], dict[str, Any]]:
    """Headers and sources of a package in double precision by file name, and what its manifest holds."""
    files, manifest = package_files(given, Asked("double", **options), tested=False)
    return {path.rpartition("/")[2]: text for path, text in files.items() if path.startswith(OF_LIBRARY)}, manifest
