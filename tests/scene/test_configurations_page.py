"""docs/configurations.md: tables, scenes and errors; from inside: the tables of units and of keys that it lists.

docs/configurations.md: its tables are those of the code, its scenes load, its errors are what one gets.
"""

from __future__ import annotations

import json
import re
import shlex
import shutil
import warnings
from pathlib import Path

import pytest

from continuum_grasp.base import InputError
from continuum_grasp.scene import Unit, Value, kinds, load
from continuum_grasp.scene.config_kinds import kind_of
from continuum_grasp.scene.objects.outline import OutlineFile
from continuum_grasp.scene.units import QUANTITIES
from continuum_grasp.scene.yaml_loader import parse_yaml
from tests.commands import run
from tests.errata_page import table

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docs" / "configurations.md"
PAGE = FILE.read_text(encoding="utf-8")
HANGING = ROOT / "configs" / "simulate" / "hanging.yaml"


def blocks(language: str) -> list[str]:
    """Code blocks of a language."""
    return re.findall(rf"\n```{language}\n(.*?)\n```\n", PAGE, re.DOTALL)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of scenes beside the shipped fingers."""
    shutil.copytree(ROOT / "configs" / "fingers", tmp_path / "fingers")
    (tmp_path / "simulate").mkdir()
    monkeypatch.chdir(tmp_path / "simulate")
    return tmp_path / "simulate"


def test_units_are_those_of_the_code():
    rows = [
        [quantity.words, si, ", ".join(unit for unit in Unit(si).factors if unit != si), quantity.example]
        for si, quantity in QUANTITIES.items()
    ]
    assert table("Units", FILE) == rows


def test_every_kind_is_in_the_table():
    rows = table("Kinds", FILE)
    assert [re.findall(r"\w+", row[3])[0] for row in rows] == list(kinds())
    for row, kind in zip(rows, kinds(), strict=True):
        keys = [re.findall(r"`(\w+)`", each)[0] for each in row[1].split(", ")]
        assert kind_of(dict.fromkeys(keys)).name == kind


def test_scenes_load(folder):
    bare, changed, sections, samples, spirob, wrong = blocks("yaml")
    for finger, length in ((bare, 0.6), (changed, 0.5), (sections, 0.25), (samples, 0.25), (spirob, 0.25)):
        Path("scene.yaml").write_text(f"schema_version: 1\ngravity: [0, 0]\n{finger}\n", encoding="utf-8")
        assert load("scene.yaml").finger.rod.length == length
    Path("scene.yaml").write_text(wrong, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load("scene.yaml")
    assert f"\nerror: {caught.value}\n" in PAGE


def test_python_runs(monkeypatch):
    monkeypatch.chdir(ROOT)
    (code,) = blocks("python")
    names: dict[str, object] = {}
    exec(code, names)
    assert names["scene"].finger.masses[0].mass == 0.05
    assert names["rod"].youngs_modulus == 60e9


def test_commands_are_there(monkeypatch):
    monkeypatch.chdir(ROOT)
    commands = re.findall(r"^    continuum-grasp (.*)$", PAGE, re.MULTILINE)
    assert len(commands) == 4
    for command in commands:
        verb, *rest = shlex.split(command, comments=True)
        # Computing is what other tests do: here, that the change is one.
        done = run(verb if verb == "schema" else "validate", *rest)
        assert done.exit_code == 0, done.output


def keys_of(value):
    """Names of the keys that a loaded or a parsed configuration states, at any depth."""
    if isinstance(value, Value):
        for name in value.model_fields_set:
            yield name
            yield from keys_of(getattr(value, name))
    elif isinstance(value, dict):
        for name, one in value.items():
            yield name
            yield from keys_of(one)
    elif isinstance(value, tuple | list):
        for one in value:
            yield from keys_of(one)


EXAMPLES = parse_yaml((Path(__file__).parent / "keys_by_example.yaml").read_text(encoding="utf-8")).value


@pytest.mark.parametrize("row", EXAMPLES, ids=lambda row: row["keys"][0])
def test_keys_by_example_are_taken(row):
    found = keys_of(load(ROOT / "configs" / f"{row['configuration']}.yaml", row["changes"]))
    # An outline, whose unknown keys are refused, becomes a polygon as it is loaded.
    assert {*row["keys"]} <= {*found, *OutlineFile.model_fields}


def test_every_key_is_in_a_shipped_configuration_or_has_an_example():
    shipped, known = set(), set()
    for path in [*ROOT.glob("configs/*/*.yaml"), *ROOT.glob("examples/*/*.yaml")]:
        shipped |= set(keys_of(parse_yaml(path.read_text(encoding="utf-8")).value))
    for path in (ROOT / "schema").glob("*.json"):
        schema = json.loads(path.read_text(encoding="utf-8"))
        for node in (schema, *schema.get("$defs", {}).values()):
            known |= node.get("properties", {}).keys()
    assert known - shipped == {key for row in EXAMPLES for key in row["keys"]}


_LENGTH = "finger.rod.length: wrong type: expected a length [m] such as 0.012 or 12 mm, got text"


CHANGES = {
    "finger.rod.length=600 MM": f"{_LENGTH} '600 MM' (units: m, cm, mm, um, in, ft, mil)",
    "finger.rod.length='1,200 mm'": (
        f"{_LENGTH} '1,200 mm' (write a decimal point, not a comma, and no separators of thousands)"
    ),
    "initial.pose=strait": (
        "initial.pose: not one of the choices: expected 'straight', 'rest' or 'equilibrium', got text 'strait'; "
        "did you mean 'straight'?"
    ),
    "finger.masses=[{at: 70 cm, mass: 20 g}]": "finger.masses[0].at: 0.7 m is beyond the finger's length of 0.6 m",
    "time={duration: 1 s, step: 300 ms}": (
        "time.duration: duration must be a whole number of steps, got 1.0 s in steps of 0.3 s"
    ),
}


@pytest.mark.parametrize("change", CHANGES)
def test_errors_say_key_expectation_and_remedy(change):
    with pytest.raises(InputError) as caught:
        load(HANGING, [change])
    assert str(caught.value) == f"--set {change}: {CHANGES[change]}"


def test_the_warning_is_what_one_gets():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        load(HANGING, ["finger.base.angle=-90"])
    assert f"`{caught[0].message}`" in PAGE.replace("\n", " ")


READ = {
    "60e9": 60e9,
    "1e-3": 1e-3,
    ".5": 0.5,
    "0o17": 15,
    "0x1F": 31,
    "010": 10,
    "true": True,
    "false": False,
    "null": None,
    "~": None,
    '"60e9"': "60e9",
}


def test_yaml_is_read_as_the_page_says():
    written = [word for row in table("YAML", FILE) for word in re.findall(r"`([^`]+)`", row[0])]
    assert set(READ) < set(written)
    for word in written:
        got = parse_yaml(f"key: {word}").value["key"]
        assert got == READ.get(word, word)
        assert type(got) is type(READ.get(word, word))
