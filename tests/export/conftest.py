"""Packages of C that tests of export share."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import pytest

from continuum_grasp.export import export_c
from tests.export_cases import OPTIONS, scene


@pytest.fixture(scope="session")
def packages(tmp_path_factory):
    """Folders of packages by scene and type, made once."""
    folder = tmp_path_factory.mktemp("packages")

    @lru_cache
    def made(name: str, real: str, target: str = "host") -> Path:
        path = folder / f"{name}_{real}_{target}"
        export_c(scene(name), path, real=real, target=target, **OPTIONS.get(name, {}))
        return path

    return made
