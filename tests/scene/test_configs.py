"""The shipped configurations and schemas."""

from __future__ import annotations

import json
import math
import re
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.scene import json_schema, kind_of_scene, kinds, load, read_yaml, schema_files

ROOT = Path(__file__).parents[2]
CONFIGS = sorted((ROOT / "configs").glob("*/*.yaml"))
ANYTHING: dict[str, object] = {}
FOLDER_OF = {**{kind: kind for kind in kinds()}, "finger": "fingers"}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_configuration_is_valid_and_names_its_schema(path):
    kind = kind_of_scene(load(path)).name
    assert path.parent.name == FOLDER_OF[kind]
    head, target = path.read_text(encoding="utf-8").splitlines()[0].split("=", 1)
    assert head == "# yaml-language-server: $schema"
    assert (path.parent / target).resolve() == ROOT / "schema" / f"{kind}.json"


def test_schema_files_are_current():
    shipped = {file.name: file.read_text(encoding="utf-8") for file in (ROOT / "schema").glob("*.json")}
    assert shipped == schema_files(), "run: continuum-grasp schema --out schema"


@pytest.mark.parametrize("kind", kinds())
def test_a_shared_definition_is_that_of_every_kind(kind):
    files, whole = schema_files(), json_schema(kind)
    defined = json.loads(files["definitions.json"])["$defs"]
    assert {name: defined[name] for name in whole["$defs"]} == whole.pop("$defs")
    assert json.loads(files[f"{kind}.json"].replace("definitions.json#", "#")) == whole


schema_of = lru_cache(json_schema)


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_schema_allows_every_key_of_the_configuration(path):
    data = read_yaml(path).value
    schema = schema_of(kind_of_scene(load(path)).name)
    check(data, schema, schema["$defs"])


def check(data, node, definitions):
    """What an editor checks: keys known, required keys there, nested mappings and lists likewise."""
    branches = node.get("anyOf") or node.get("oneOf")
    if not node:
        return
    if "$ref" in node:
        check(data, definitions[node["$ref"].rpartition("/")[2]], definitions)
    elif branches and "properties" not in node:
        assert any(fits(data, branch, definitions) for branch in branches), data
    elif isinstance(data, dict):
        assert node.get("type") == "object"
        known, other = node.get("properties", {}), node.get("additionalProperties", False)
        assert other is not False or set(data) <= set(known)
        assert set(node.get("required", [])) <= set(data)
        for key, value in data.items():
            check(value, known.get(key, ANYTHING if other is True else other), definitions)
    elif isinstance(data, list):
        assert node.get("type") == "array"
        for k, value in enumerate(data):
            inner = node["prefixItems"][k] if "prefixItems" in node else node["items"]
            check(value, inner, definitions)
    else:
        kinds = {
            str: {"string"},
            bool: {"boolean"},
            int: {"integer", "number"},
            float: {"number"},
            type(None): {"null"},
        }
        given = node.get("type", [])
        assert "const" in node or kinds[type(data)] & {*([given] if isinstance(given, str) else given)}
        if isinstance(data, str) and "pattern" in node:
            assert re.search(node["pattern"], data)


def fits(data, node, definitions):
    """Whether a branch of a union takes the data."""
    try:
        check(data, node, definitions)
    except AssertionError:
        return False
    return True


def test_the_papers_rod():
    finger = load(ROOT / "configs/fingers/nitinol_60cm.yaml")
    assert finger.rod.stiffness == pytest.approx(60e9 * math.pi * 0.002**4 / 64)
    assert finger.rod.mass_per_length * finger.rod.length == pytest.approx(12.16e-3, rel=1e-3)  # weighs 12 g
    assert finger.base.angle == -math.pi / 2


def test_the_hand_fingers_lumped_values_are_those_of_its_comments():
    rod = load(ROOT / "configs/fingers/hand_finger.yaml").rod
    area, second_moment = math.pi / 4 * 0.0012**2, math.pi / 64 * 0.0012**4
    disc, radius, thickness, pitch = 0.4e-3, 0.006, 0.003, 0.015
    assert rod.mass_per_length == pytest.approx(6450 * area + disc / pitch, rel=2e-3)
    assert rod.stiffness == pytest.approx(60e9 * second_moment, rel=2e-3)
    disc_inertia = disc * (3 * radius**2 + thickness**2) / 12
    assert rod.inertia_per_length == pytest.approx(6450 * second_moment + disc_inertia / pitch, rel=1e-2)


@pytest.mark.parametrize("grams", [0, 10, 20, 50])
def test_releases_start_alike(grams):
    """Held by the same net force at the tip, whatever the tip mass."""
    scene = load(ROOT / f"configs/simulate/nitinol_release_{grams:03d}g.yaml")
    weight = 9.81 * sum(mass.mass for mass in scene.finger.masses)
    assert sum(mass.mass for mass in scene.finger.masses) == pytest.approx(grams * 1e-3)
    (hold,) = scene.initial.held_by
    assert hold.at == scene.finger.rod.length
    assert hold.force == pytest.approx((0.0, 0.2 + weight))


def _as_booleans(value):
    """A value as YAML 1.1 reads and writes it, in which the words on and off are booleans."""
    if isinstance(value, dict):
        return {key: _as_booleans(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_as_booleans(one) for one in value]
    return {"on": True, "off": False}.get(value, value) if isinstance(value, str) else value


@pytest.mark.parametrize("kind", kinds())
def test_booleans_stand_for_on_and_off_wherever_these_are_choices(kind):
    def words_alone(node, beside=()):
        """Enumerations of on or off without a boolean beside them."""
        if isinstance(node, dict):
            if {"on", "off"} & {*node.get("enum", ()), node.get("const")} and {"type": "boolean"} not in beside:
                yield node
            for key, child in node.items():
                yield from words_alone(child, node.get("anyOf", ()) if key == "anyOf" else ())
        elif isinstance(node, list):
            for child in node:
                yield from words_alone(child, beside)

    assert not list(words_alone(json_schema(kind)))


@pytest.mark.parametrize("name", ["egg", "mug"])
def test_a_grasp_written_by_a_yaml_1_1_library_is_the_same(name):
    path = ROOT / "configs" / "grasp" / f"{name}.yaml"
    changes = {"contacts.middle": ["on", "auto"], "contacts.tip": "on", "fidelity.elements": 6}
    assert load(path, _as_booleans(changes)) == load(path, changes)


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("simulate/midpoint_contact.yaml", "fidelity"),
        ("mpc/wrap_post.yaml", "fidelity"),
        ("mpc/wrap_post.yaml", "plant.fidelity"),
        ("mission/mug.yaml", "plant.fidelity"),
        ("plan/past_a_post.yaml", "fidelity"),
    ],
)
def test_lengths_of_elements_are_those_of_the_finger(name, key):
    """They add up to its length, and an element ends at every contact; the file is not valid otherwise."""
    path = ROOT / "configs" / name
    scene = load(path)
    finger, contacts = (
        (scene.grasp.finger, ()) if name.startswith("mission") else (scene.finger, getattr(scene, "contacts", ()))
    )
    length = finger.rod.length
    fits = np.diff([0.0, *(contacts or (0.3 * length,)), length]).tolist()
    assert load(path, {f"{key}.elements": fits})
    wrong = [[length, length], [0.5 * length]] + ([[0.35 * length, 0.65 * length]] if contacts else [])
    for lengths in wrong:
        with pytest.raises(InputError) as caught:
            load(path, {f"{key}.elements": lengths})
        assert caught.value.key == f"{key}.elements"
