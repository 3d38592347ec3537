"""The shipped examples: all of them are there, and each is whole where it is copied to."""

from __future__ import annotations

import json
import re
import shlex
import shutil

import pytest

from continuum_grasp import examples
from continuum_grasp.base import InputError
from continuum_grasp.scene import load
from tests.commands import ROOT, run

NAMES = list(examples.examples())
WHOLE = [name for name in NAMES if not examples.example(name).missing]
VERB_OF = {"mission": "mpc", "hand": "grasp", "fingers": "validate"}
"""Of folders of configurations; the others are named after their verb."""


def test_every_configuration_is_an_example():
    files = {path.relative_to(ROOT / "configs").with_suffix("").as_posix() for path in ROOT.glob("configs/**/*.yaml")}
    assert set(NAMES) == files
    for name, one in examples.examples().items():
        folder = name.partition("/")[0]
        assert one.verb == VERB_OF.get(folder, folder)
        assert 20 < len(one.summary) < 260, name
        assert one.summary[0].isupper()
        assert not one.summary.endswith(".")


@pytest.mark.parametrize("name", WHOLE)
def test_an_example_is_whole_where_it_is_copied_to(name, tmp_path):
    files = examples.copy_example(name, tmp_path)
    assert {path for path in tmp_path.rglob("*") if path.is_file()} == set(files)
    load(files[0])
    for file in files:
        assert file.read_bytes() == (ROOT / file.relative_to(tmp_path)).read_bytes()
        if file.suffix == ".yaml":
            schema = file.read_text(encoding="utf-8").splitlines()[0].partition("$schema=")[2]
            assert "properties" in json.loads((file.parent / schema).read_text(encoding="utf-8"))
    assert (tmp_path / examples.example(name).arguments[1]) == files[0]


@pytest.mark.parametrize("name", sorted(set(NAMES) - set(WHOLE)))
def test_an_example_without_its_data_is_not_copied(name, tmp_path):
    with pytest.raises(InputError, match=r"measured data that are not shipped: \w+"):
        examples.copy_example(name, tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_example_with_data_comes_with_them(tmp_path, monkeypatch):
    shipped = tmp_path / "shipped"
    for file in examples.example("identify/belendez_strip").files:
        (shipped / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / file, shipped / file)
    data = shipped / "configs/identify/tip_drop.csv"
    data.write_text("tip_load_N,measured_tip_drop_m\n0.0,0.089\n")
    monkeypatch.setattr(examples, "shipped_folder", lambda: shipped)
    one = examples._example(shipped / "configs/identify/belendez_strip.yaml")
    assert one.missing == ()
    assert data.relative_to(shipped) in one.files
    assert one.arguments == ("identify", "configs/identify/belendez_strip.yaml")


def test_new_prints_a_command_that_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = run("new", "my fingers", "--example", "fingers/hand_finger").output.splitlines()
    assert [shlex.split(line) for line in said[-2:]] == [
        ["cd", "my fingers"],
        ["continuum-grasp", "validate", "configs/fingers/hand_finger.yaml"],
    ]
    monkeypatch.chdir(tmp_path / "my fingers")
    assert run(*shlex.split(said[-1])[1:]).exit_code == 0
    assert json.loads(run("new", ".", "--json").output)["command"][1:] == ["grasp", "configs/grasp/mug.yaml"]


def test_notebooks_come_with_what_they_read(tmp_path):
    """Of those in the checkout all that name no benchmark; what their code reads is there and is valid."""
    said = json.loads(run("new", str(tmp_path), "--notebooks", "--json").output)
    copied = {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in tmp_path.glob("notebooks/*")}
    codes = {
        name: "".join(line for cell in book["cells"] if cell["cell_type"] == "code" for line in cell["source"])
        for name, book in copied.items()
    }
    assert {"own_models", "casadi", "design_by_gradient"} <= codes.keys()
    assert not any("benchmarks" in code for code in codes.values())
    read = {name for code in codes.values() for name in re.findall(r"[\w/]+\.yaml", code.replace('" / "', "/"))}
    assert len(read) > 2
    for name in read:
        assert load(tmp_path / "configs" / name)
    assert len(said["files"]) == len({file for file in tmp_path.rglob("*") if file.is_file()})
    assert run("new", str(tmp_path), "--notebooks").exit_code == 0  # again


def test_new_overwrites_nothing(tmp_path):
    assert run("new", str(tmp_path)).exit_code == 0
    assert run("new", str(tmp_path), "--example", "grasp/mug_arcs").exit_code == 0  # the same finger is there
    finger = tmp_path / "configs/fingers/hand_finger.yaml"
    finger.write_text("mine", encoding="utf-8")
    before = sorted(tmp_path.rglob("*"))
    for name in ("grasp/mug", "mpc/pulse"):
        refused = run("new", str(tmp_path), "--example", name)
        assert refused.exit_code == 2
        assert refused.stderr == f"error: these files exist with other content: {finger}; nothing was overwritten\n"
    assert finger.read_text(encoding="utf-8") == "mine"
    assert sorted(tmp_path.rglob("*")) == before


def test_new_refuses_what_it_cannot_do(tmp_path):
    file = tmp_path / "file"
    file.touch()
    for arguments, words in (
        (["new"], "--list"),
        (["new", str(file)], "expected a folder, got a file"),
        (["new", str(tmp_path / "a"), "--example", "grasp/mugg"], "did you mean 'grasp/mug'?"),
        (
            ["new", str(tmp_path / "a"), "--notebooks", "--list"],
            "--notebooks: cannot be combined with --example or --list",
        ),
        (["new", str(tmp_path / "a"), "--example", "nothing of the kind"], "no example 'nothing of the kind'"),
    ):
        refused = run(*arguments)
        assert refused.exit_code == 2
        assert words in refused.stderr
    assert list(tmp_path.iterdir()) == [file]


def test_new_lists_every_example_in_one_line():
    lines = run("new", "--list").output.splitlines()
    named = [line.split()[0] for line in lines if line.startswith("  ")]
    assert named == NAMES
    assert len([line for line in lines if line]) == len(NAMES) + len({one.verb for one in examples.examples().values()})
    found = json.loads(run("new", "--list", "--json").output)["examples"]
    assert {one["name"]: tuple(one["missing"]) for one in found if one["missing"]} == {
        name: examples.example(name).missing for name in NAMES if name not in WHOLE
    }
