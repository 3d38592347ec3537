"""The C package of a functional mock-up unit, and its manifest."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from continuum_grasp.export.manifest import FLAGS
from continuum_grasp.export.package import export_c

STRICT = (*FLAGS["strict"], *FLAGS["gcc"])
"""Flags of gcc with which results are the same bits everywhere."""


def library_of(given: Any, **options: Any) -> tuple[dict[str, str], dict[str, Any]]:
    """Headers and sources of a package in double precision by file name, and what its manifest holds."""
    with tempfile.TemporaryDirectory() as folder:
        package = export_c(given, folder, real="double", **options)
        paths = [p for name in ("include", "src") for p in sorted((Path(folder) / name).iterdir())]
        return {path.name: path.read_text(encoding="utf-8") for path in paths}, package.manifest
