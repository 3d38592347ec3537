"""What consumers do not take of a scene: every declared key exists, and is refused or listed where it is given."""

from __future__ import annotations

from importlib import import_module

import pytest

import continuum_grasp as cg
from continuum_grasp.errors import InputError
from continuum_grasp.scene.consumer import CONSUMERS, Consumer
from continuum_grasp.scene.schema import json_schema

for module in (
    "closed_loop.chain_system",
    "closed_loop.converged",
    "environments.plants",
    "export.fmu.loop_plant",
    "export.mjcf.write",
    "export.web.plant",
    "simulation.statics",
):
    import_module(f"continuum_grasp.{module}")


def known(key: str) -> bool:
    """Whether a dotted key is one of a simulation or of a closed loop, by their schemas."""
    for kind in ("simulate", "mpc"):
        schema = json_schema(kind)
        nodes = [schema]
        for name in key.partition("=")[0].split("."):
            found = []
            while nodes:
                node = nodes.pop()
                if "$ref" in node:
                    nodes.append(schema["$defs"][node["$ref"].rpartition("/")[2]])
                nodes += [one for word in ("anyOf", "oneOf", "allOf") for one in node.get(word, ())]
                nodes += [node["items"]] if isinstance(node.get("items"), dict) else []
                found += [node["properties"][name]] if name in node.get("properties", {}) else []
            nodes = found
        if nodes:
            return True
    return False


@pytest.mark.parametrize("name", CONSUMERS)
def test_every_declared_key_is_a_key_of_scenes(name):
    one = CONSUMERS[name]
    assert not [key for key in (*one.refused, *one.otherwise) if not known(key)]


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
