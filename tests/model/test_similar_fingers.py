"""Units of keys and names: a finger in other units of length, mass and time moves alike, by powers of two exactly."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.model import System
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.scene.units import Unit
from continuum_grasp.scene.value import Value
from tests.features import FEATURES, Feature, scene_of

BASE = {"m": "L", "kg": "M", "s": "T", "N": "LM/TT", "Pa": "M/LTT", "rad": "", "1": ""}


def power(unit: str, sizes: Mapping[str, int]) -> int:
    """Power of two by which a value in a unit is larger."""
    total = 0
    above, *below = unit.split("/")
    for words, sign in ((above, 1), *((part, -1) for part in below)):
        for symbol, times in re.findall(r"(kg|Pa|rad|[msN1])([2-4]?)", words):
            over, _, under = BASE[symbol].partition("/")
            total += sign * int(times or 1) * (sum(map(sizes.get, over)) - sum(map(sizes.get, under)))
    return total


def _units(annotation: Any) -> Iterator[Unit]:
    for one in (*getattr(annotation, "__metadata__", ()), *get_args(annotation)):
        if isinstance(one, Unit):
            yield one
        else:
            yield from _units(one)


def larger(value: Any, sizes: Mapping[str, int], unit: str | None = None) -> Any:
    """A part of a scene in other units."""
    if isinstance(value, Value):
        fields = type(value).model_fields
        of = {key: [*fields[key].metadata, *_units(fields[key].annotation)] for key, _ in value}
        units = {key: next((one.si for one in found if isinstance(one, Unit)), None) for key, found in of.items()}
        changed = {key: larger(entry, sizes, units[key] or unit) for key, entry in value}
        return value.replaced(**{key: entry for key, entry in changed.items() if entry != getattr(value, key)})
    if isinstance(value, tuple):
        return tuple(larger(entry, sizes, unit) for entry in value)
    if isinstance(value, dict):
        return {key: larger(entry, sizes, unit) for key, entry in value.items()}
    return value * 2.0 ** power(unit, sizes) if isinstance(value, float) and unit else value


@pytest.mark.parametrize("feature", FEATURES, ids=lambda one: one.name)
def test_a_finger_in_other_units_moves_alike(feature: Feature):
    sizes = {"L": 2, "M": 6, "T": 4}
    scene = scene_of(
        Scene,
        feature,
        {"fidelity": {"family": "arc", "elements": 2}, "gravity": [1.0, -9.0], "parameters": ["gravity"]},
    )
    models = [System(each) if each.object else cg.FingerModel(each) for each in (scene, larger(scene, sizes))]
    rng, (model, _) = np.random.default_rng(0), models
    names = {"x": model.x_names, "u": model.u_names, "w": model.w_names, "p": model.p_names}
    values = {key: rng.uniform(0.1, 0.9, len(entries)) for key, entries in names.items()}
    values["u"] *= 10.0 if "tension" in str(model.u_names) else 1e-3
    factors = {
        key: np.array([2.0 ** power(n[n.index("[") :], sizes) for n in entries]) for key, entries in names.items()
    }
    values["p"] = np.array(model.p_nominal)
    assert models[1].p_nominal == pytest.approx(factors["p"] * values["p"], rel=1e-15)
    small = np.array(model.forward_dynamics(*values.values())).ravel()
    large = np.array(models[1].forward_dynamics(*(factors[key] * values[key] for key in values))).ravel()
    scale = np.abs(small).max()
    assert large * 2.0 ** sizes["T"] / factors["x"] == pytest.approx(small, rel=1e-9, abs=1e-12 * scale)
