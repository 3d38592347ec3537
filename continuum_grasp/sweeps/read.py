"""From a configuration to the plan of a sweep."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from continuum_grasp.errors import InputError
from continuum_grasp.scene.assembly import Overrides, apply_override, placed, read_overrides, validated
from continuum_grasp.scene.document import Place
from continuum_grasp.scene.load import load_placed
from continuum_grasp.scene.sweep import Sweep
from continuum_grasp.scene.variation import variation_of
from continuum_grasp.sweeps.plan import Plan

__all__ = ["plan_of"]


def plan_of(config: str | os.PathLike[str] | Mapping[str, Any], overrides: Overrides = ()) -> Plan:
    """The scenes of a configuration.

    Raises
    ------
    InputError
        It is no sweep, or something in it is wrong.
    """
    if isinstance(config, Mapping):
        document, file = placed(config, Place("sweep")), Path("sweep")
        for path, new in read_overrides(overrides):
            apply_override(document, path, new)
        sweep: Any = validated(document, Sweep)
    elif isinstance(config, (str, os.PathLike)):
        file = Path(config)
        sweep, document = load_placed(file, overrides)
    else:
        raise InputError(f"expected the path of a sweep's file, or a mapping, got {config!r:.80}")
    if not isinstance(sweep, Sweep):
        raise InputError("expected a sweep (scene, vary, sample, ...)", file=str(file))
    return Plan(sweep, variation_of(sweep, document, file))
