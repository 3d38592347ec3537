"""What consumers do not take of a scene: every declared key exists, and is refused or listed where it is given.

Every key that is not declared changes what a consumer makes.
"""

from __future__ import annotations

import fnmatch
import inspect
from collections.abc import Iterator
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import get_args

import pytest
import typer

import continuum_grasp as cg
from continuum_grasp.addons.fmu import export_fmu
from continuum_grasp.base import InputError, NumericalError, SolverError
from continuum_grasp.cli import app
from continuum_grasp.closed_loop import PlantModel
from continuum_grasp.model import ModelOptions, System
from continuum_grasp.rod import solve_elastica
from continuum_grasp.scene import Consumer, Scene, Value, json_schema, kinds
from continuum_grasp.simulation import equilibrium
from tests.consumers_page import BEGIN, PAGE, tables
from tests.features import FEATURES, VERBS, declared, scene_of
from tests.scene_keys import NOT_ALONE, Place, bases, is_part, keys, keys_below, others, places
from tests.scene_products import WALKS, Walk, parts

PACKAGE = Path(cg.__file__).parent
FROM_OUTSIDE = {"Freedom", "OutlineCurve", "OutlineFile", "PlaneCut"}
"""Classes of values that scenes of simulation refuse, that belong to one model, or of outlines, for which a polygon
stands from the load on."""


schema_of = cache(json_schema)


@cache
def arguments() -> set[str]:
    """Options of all commands, and arguments of functions that refuse some of them."""
    commands = typer.main.get_command(app).commands.values()
    options = {name for one in commands for each in one.params for name in each.opts}
    made = (cg.export_c, export_fmu, cg.sweep, equilibrium, System)
    return (
        options | {*ModelOptions.__annotations__} | {name for one in made for name in inspect.signature(one).parameters}
    )


def known(key: str) -> bool:
    """Whether a dotted key is one of a kind of scene or of a part of one, by the schemas, an argument or an option."""
    key = key.partition("=")[0]
    *above, last = key.split(".")
    parts = ({**one, "$defs": own["$defs"]} for own in map(schema_of, kinds()) for one in (own, *own["$defs"].values()))
    return key in arguments() or any(fnmatch.filter(keys_below(part, above), last) for part in parts)


@cache
def source_lines() -> frozenset[str]:
    """Lines of the package's code."""
    return frozenset(line for file in PACKAGE.rglob("*.py") for line in file.read_text(encoding="utf-8").splitlines())


@pytest.mark.parametrize("name", Consumer.DECLARED)
def test_the_rule_is_found_by_the_first_words_of_its_error(name):
    """In one line of the code, as an editor finds it; a rule without a reason by the last name of its key."""
    for key, why in Consumer.DECLARED[name].refused.items():
        first, second, *others = why.split()
        in_place = [f"{first} {second} {{"]
        words = [key.partition("=")[0].rpartition(".")[2]] if first == "needs" else in_place
        words += [" ".join([first, second, *others[:1]])]
        assert any(word in line for word in words for line in source_lines()), f"{key}: {why}"


@pytest.mark.parametrize("name", Consumer.DECLARED)
def test_every_declared_key_is_a_key_of_scenes(name):
    one = Consumer.DECLARED[name]
    assert not [key for key in (*one.refused, *one.otherwise, *one.unneeded) if not known(key)]


def subclasses(kind: type) -> Iterator[type]:
    for one in kind.__subclasses__():
        yield from (one, *subclasses(one))


def inside(annotation: object) -> set[type]:
    """Classes of values that an annotation allows."""
    if isinstance(annotation, type) and issubclass(annotation, Value):
        return {annotation}
    return {one for part in get_args(annotation) for one in inside(part)}


def is_there(classes: set[type], path: list[str]) -> bool:
    """Whether a value of one of some classes, or of a class that extends one, has a path of keys or properties."""
    all_kinds = {kind for one in classes for kind in (one, *subclasses(one))}
    found = [kind for kind in all_kinds if path[0] in kind.model_fields or hasattr(kind, path[0])]
    deeper = [kind.model_fields[path[0]].annotation for kind in found if path[0] in kind.model_fields]
    # What a property gives is not looked at.
    return bool(found) and (
        len(path) == 1 or not deeper or any(is_there(inside(annotation), path[1:]) for annotation in deeper)
    )


RULED = sorted((kind for kind in subclasses(Value) if "REFUSALS" in vars(kind)), key=lambda kind: kind.__qualname__)


@pytest.mark.parametrize("kind", RULED, ids=lambda kind: kind.__qualname__)
def test_every_rule_is_about_what_its_class_has(kind):
    for rule in vars(kind)["REFUSALS"]:
        others = getattr(rule.where, "others", [])
        keys = [*rule.refused, *(other for other in others if other.partition("(")[0] not in rule.where.functions)]
        assert not [key for key in keys if not is_there({kind}, key.partition("=")[0].split("."))]


def test_keys_count_as_given_where_they_differ_from_their_default():
    scene = cg.load("configs/simulate/close_on_mug.yaml")
    law = Consumer(
        "test", otherwise={"contact_law.presliding": "own", "contact_law.friction": "own", "moment_of_inertia": "none"}
    )
    del Consumer.DECLARED["test"]
    plain = scene.changed({"contact_law": {"stiffness": 2e3, "friction": 0.5}})
    assert law.check(plain) == ("contact_law.friction: own",)
    given = plain.changed({"contact_law.presliding": 5e-5})
    assert law.check(given) == ("contact_law.presliding: own", "contact_law.friction: own")


def test_the_key_of_what_is_refused_is_that_of_the_entry():
    tendon = {"offset": 0.005, "max_tension": 40.0}
    two = [tendon, {**tendon, "offset": -0.005, "friction": 0.1}]
    scene = cg.load("configs/simulate/tendon_step.yaml").changed({"finger.tendons": two})
    with pytest.raises(InputError) as caught:
        Consumer.DECLARED["export to mjcf"].check(scene)
    assert caught.value.key == "finger.tendons[1].friction"
    assert Consumer.DECLARED["export to mjcf"].check(scene.changed({"finger.tendons[1].friction": 0.0})) == ()


def test_the_tables_are_what_consumers_declare():
    """If not: ``python -m tests.consumers_page``."""
    assert PAGE.read_text(encoding="utf-8").split(BEGIN)[1] == f"\n{tables()}"


LONG = {
    *("Actuation", "Finger", "Initial", "MemberPlace", "ObjectBody"),
    *("Rod", "RodFactors", "RodSection", "Table", "_Tensions"),
}
"""Classes with keys of which many values are tried."""
QUICK = {"export to mjcf", "plant.guides", "operators", "sweep", "design", "identify: read_and_sought"}
"""Consumers of which most classes are tried in less than a second."""


@cache
def of_base(walk: Walk, base: str) -> tuple[object, ...] | None:
    """What a consumer makes of one of the scenes; None where it refuses that."""
    try:
        return tuple(parts(walk.make(bases(walk.root)[base])))
    except InputError:
        return None


def ignored(walk: Walk, found: list[Place]) -> str:
    """What is wrong with a key, of which the places are given: empty where its value counts, or is declared."""
    consumer, key = Consumer.DECLARED.get(walk.consumer), found[0].key
    heads = [".".join(key.split(".")[: k + 1]) for k in range(key.count(".") + 1)]
    declared = {**consumer.refused, **consumer.otherwise, **consumer.unneeded} if consumer else {}
    if {*heads} & {*walk.but} or key in NOT_ALONE or any(fnmatch.filter(heads, one) for one in declared):
        return ""
    taken = tried = False
    given = [place for place in found if place.value not in (None, ())]
    for place in found:
        base, before = bases(walk.root)[place.base], of_base(walk, place.base)
        if before is None:
            continue
        taken |= place in given or not given  # what is given in scenes alone that the consumer refuses cannot be tried
        for value in others(place, found):
            try:
                scene = place.changed(base, value)
            except InputError:
                continue
            if scene == base:
                continue
            tried = True
            try:
                if any(a != b for a, b in zip_longest(parts(walk.make(scene)), before)):
                    return ""
            except (NumericalError, SolverError):
                return ""
            except InputError as error:
                if error.key and error.key.split("[")[0] in key:
                    return ""
    if not (taken or tried) or is_part(found[0].field):  # the keys of a part are tried themselves
        return ""
    why = "ignored in silence; declare it in the consumer" if tried else "no other value is known (tests/scene_keys.py)"
    return f"{key}: {why}"


def test_the_scenes_have_every_key():
    for root in dict.fromkeys(walk.root for walk in WALKS):
        outside = FROM_OUTSIDE if root is Scene else set()
        missing = {kind for kind, names in keys(root).items() if names - set(places(root).get(kind, ()))}
        assert missing == outside


@pytest.mark.parametrize(
    ("walk", "kind"),
    [
        pytest.param(
            walk, kind, marks=() if {walk.consumer, str(walk)} & QUICK and kind not in LONG else pytest.mark.deep
        )
        for walk in WALKS
        for kind in sorted(set(keys(walk.root)) - FROM_OUTSIDE)
    ],
    ids=str,
)
def test_no_key_is_ignored_in_silence(walk, kind):
    found = places(walk.root)[kind]
    wrong = [text for field in keys(walk.root)[kind] if (text := ignored(walk, found[field]))]
    assert not wrong


@pytest.mark.parametrize(
    "verb",
    [one if one.name in QUICK else pytest.param(one, marks=pytest.mark.deep) for one in VERBS],
    ids=lambda one: one.name,
)
@pytest.mark.parametrize("feature", FEATURES, ids=lambda one: one.name)
def test_a_verb_takes_what_no_declaration_refuses(feature, verb):
    why = declared(feature, verb)

    def made():
        scene = scene_of(verb.kind, feature, verb.more)
        return scene is None or [*parts(verb.make(scene))]

    if not why:
        assert made()
        return
    with pytest.raises(InputError) as caught:
        made()
    assert why in caught.value.message


MUG, POST = "configs/simulate/close_on_mug.yaml", "configs/mpc/wrap_post.yaml"


@pytest.mark.parametrize(
    ("key", "refused"),
    [
        ("object", lambda: solve_elastica(cg.load(MUG))),
        ("object", lambda: cg.accuracy_report(cg.load(MUG))),
        ("finger.damping.friction_cells", lambda: cg.load(MUG, ["finger.damping.friction_cells=3"])),
        ("plant.noise", lambda: cg.load(POST, ["estimator=null", "plant.noise=2.0"])),
        ("plant.object_mass", lambda: PlantModel(cg.load(POST, ["plant.object_mass=1.1"]))),
    ],
)
def test_what_would_have_no_effect_is_refused(key, refused):
    with pytest.raises(InputError) as caught:
        refused()
    assert caught.value.key == key


def test_environments_list_what_they_do_not_keep():
    given = cg.load("configs/mpc/steady_tip.yaml", ["plant.seed=3", "controller.bounds.speed=20.0"])
    listed = [text.partition(":")[0] for text in Consumer.DECLARED["environments"].check(given)]
    assert listed == ["controller.bounds.speed", "plant.seed"]
