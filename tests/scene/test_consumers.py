"""What consumers do not take of a scene: every declared key exists, and is refused or listed where it is given; every
key that is not declared changes what a consumer makes.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import zip_longest

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.closed_loop.chain_system import ChainSystem
from continuum_grasp.errors import InputError
from continuum_grasp.export.mjcf.write import export_mjcf
from continuum_grasp.scene.consumer import CONSUMERS, Consumer
from continuum_grasp.scene.schema import json_schema
from continuum_grasp.scene.simulate import Initial, Scene
from continuum_grasp.scene.surroundings import Surroundings
from tests.consumers_page import BEGIN, PAGE, tables
from tests.scene_keys import NOT_ALONE, Place, bases, is_part, keys, others, places

FROM_OUTSIDE = {"Freedom", "LearnedResidual", "ResidualTraining"}
"""Classes of values that scenes of simulation refuse, or that belong to one model."""


schema_of = cache(json_schema)


def known(key: str) -> bool:
    """Whether a dotted key is one of a simulation or of a closed loop, by their schemas."""
    for kind in ("simulate", "mpc"):
        schema = schema_of(kind)
        nodes = [schema]
        for name in key.partition("=")[0].split("."):
            found = []
            while nodes:
                node = nodes.pop()
                if "$ref" in node:
                    nodes.append(schema["$defs"][node["$ref"].rpartition("/")[2]])
                nodes += [one for word in ("anyOf", "oneOf", "allOf") for one in node.get(word, ())]
                nodes += [node[word] for word in ("items", "additionalProperties") if isinstance(node.get(word), dict)]
                found += [node["properties"][name]] if name in node.get("properties", {}) else []
            nodes = found
        if nodes:
            return True
    return False


@pytest.mark.parametrize("name", CONSUMERS)
def test_every_declared_key_is_a_key_of_scenes(name):
    one = CONSUMERS[name]
    assert not [key for key in (*one.refused, *one.otherwise, *one.unneeded) if not known(key)]


def test_keys_count_as_given_where_they_differ_from_their_default():
    scene = cg.load("configs/simulate/close_on_mug.yaml")
    law = Consumer(
        "test", otherwise={"contact_law.presliding": "own", "contact_law.friction": "own", "moment_of_inertia": "none"}
    )
    del CONSUMERS["test"]
    plain = scene.changed({"contact_law": {"stiffness": 2e3, "friction": 0.5}})
    assert law.check(plain) == ("contact_law.friction: own",)
    given = plain.changed({"contact_law.presliding": 5e-5})
    assert law.check(given) == ("contact_law.presliding: own", "contact_law.friction: own")


def test_the_key_of_what_is_refused_is_that_of_the_entry():
    tendon = {"offset": 0.005, "max_tension": 40.0}
    two = [tendon, {**tendon, "offset": -0.005, "friction": 0.1}]
    scene = cg.load("configs/simulate/tendon_step.yaml").changed({"finger.tendons": two})
    with pytest.raises(InputError) as caught:
        CONSUMERS["export-mjcf"].check(scene)
    assert caught.value.key == "finger.tendons[1].friction"
    assert CONSUMERS["export-mjcf"].check(scene.changed({"finger.tendons[1].friction": 0.0})) == ()


def test_the_tables_are_what_consumers_declare():
    """If not: ``python -m tests.consumers_page``."""
    assert PAGE.read_text(encoding="utf-8").split(BEGIN)[1] == f"\n{tables()}"


def chain_of_hinges(scene: Scene) -> Iterator[object]:
    """What export-mjcf makes."""
    made = export_mjcf(scene, hinges=3)
    yield made.text
    yield made.controls([0.0, 0.25, 0.85]).tolist()


REST = Initial(pose="straight")


def chain_of_guides(scene: Scene) -> Iterator[object]:
    """What a plant with guides makes of a finger and its surroundings."""
    chain = ChainSystem(scene, 3, 1e4)
    yield chain.numbers(np.array(chain.p_nominal)).tolist()
    yield from (
        repr(chain.chain.tendons),
        repr(chain.winches),
        chain.start(
            *np.zeros((2, 3)), np.zeros(sum(one.states for one in chain.winches)), np.zeros(chain.nu), REST
        ).tolist(),
    )
    yield from (one.serialize() for one in (chain.drums, chain.around, chain.tensions, chain.touch))


MAKERS = {
    "export-mjcf": (chain_of_hinges, tuple(Scene.model_fields)),
    "plant.guides": (chain_of_guides, ("finger", "gravity", "contacts", *Surroundings.model_fields)),
}
"""By consumer what makes something of a scene, and the keys that are its own."""
LONG = {"Actuation", "Initial", "MemberPlace", "ObjectBody", "Rod", "RodFactors", "RodSection", "Table", "_Tensions"}
"""Classes with keys of which many values are tried."""
BY_SCENE: dict[tuple[str, str], list[object] | None] = {}
"""What consumers make of the scenes; None where they refuse one."""


def ignored(name: str, found: list[Place]) -> str:
    """What is wrong with a key, of which the places are given: empty where its value counts, or is declared."""
    consumer, (make, own), key = CONSUMERS[name], MAKERS[name], found[0].key
    heads = [".".join(key.split(".")[: k + 1]) for k in range(key.count(".") + 1)]
    if heads[0] not in own or key in NOT_ALONE or key in {**consumer.refused, **consumer.otherwise}:
        return ""
    if set(heads) & set(consumer.unneeded):
        return ""
    tried, refused = 0, 0
    for place in found:
        for value in others(place, found):
            try:
                scene = bases()[place.base].changed({place.path: value})
            except InputError:
                continue
            if scene == bases()[place.base]:
                continue
            tried += 1
            if (name, place.base) not in BY_SCENE:
                try:
                    BY_SCENE[name, place.base] = list(make(bases()[place.base]))
                except InputError:
                    BY_SCENE[name, place.base] = None
            before = BY_SCENE[name, place.base]
            try:
                if before is not None and any(a != b for a, b in zip_longest(make(scene), before)):
                    return ""
            except InputError as error:
                if error.key and error.key.split("[")[0] in key:
                    return ""
            if before is None:
                refused += 1
                break
    if not tried:
        return "" if is_part(found[0].field) else f"{key}: no other value is known (tests/scene_keys.py)"
    return "" if refused == tried else f"{key}: ignored in silence; declare it in the consumer"


def test_the_scenes_have_every_key():
    missing = {kind: left for kind, names in keys().items() if (left := names - set(places().get(kind, ())))}
    assert set(missing) == FROM_OUTSIDE


@pytest.mark.parametrize(
    "kind",
    [pytest.param(one, marks=[pytest.mark.deep] * (one in LONG)) for one in sorted(set(keys()) - FROM_OUTSIDE)],
)
@pytest.mark.parametrize("name", MAKERS)
def test_no_key_is_ignored_in_silence(name, kind):
    wrong = [text for found in places()[kind].values() if (text := ignored(name, found))]
    assert not wrong
