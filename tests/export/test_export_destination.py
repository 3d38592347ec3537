"""Where exports write, and what of it stays; from inside: files made here are written as a package, marks are read.

Where exports write: looked at before any work; what no export wrote stays, what one was interrupted at does not.
"""

from __future__ import annotations

import zipfile
from hashlib import sha256

import pytest

from continuum_grasp.addons.chains import export_mjcf
from continuum_grasp.addons.fmu import export_fmu
from continuum_grasp.addons.fmu import write as units
from continuum_grasp.addons.web import export_web
from continuum_grasp.base import InputError
from continuum_grasp.export import export_c
from continuum_grasp.export.manifest import write_package
from continuum_grasp.export.marks import is_marked
from continuum_grasp.results import write_text
from tests.export_cases import TENDONS, scene

FILES = {export_web: "page.html", export_mjcf: "chain.xml"}
FOLDERS = (export_c, export_fmu)


@pytest.fixture(autouse=True)
def no_work(monkeypatch):
    """Nothing is read, simulated or built before the destination is known to be good."""
    for name in ("finger_unit", "loop_plant_unit", "controller_unit"):
        monkeypatch.setattr(units, name, lambda *given, **more: pytest.fail("began to work"))


def given_to(export):
    """A scene that does not exist; of units, whose files have its name, one that does."""
    return TENDONS if export is export_fmu else "nowhere.yaml"


@pytest.mark.parametrize("export", [*FILES, *FOLDERS], ids=lambda export: export.__name__)
def test_a_place_that_cannot_be_written_is_refused_first(export, tmp_path):
    (tmp_path / "file").write_text("mine")
    for place in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="expected a folder, got a file"):
            export(given_to(export), place / FILES[export] if export in FILES else place)
    if export in FILES:
        with pytest.raises(InputError, match="expected the name of a file, got a folder"):
            export(given_to(export), tmp_path)


@pytest.mark.parametrize("export", [*FILES, export_fmu], ids=lambda export: export.__name__)
def test_a_file_that_no_export_wrote_stays(export, tmp_path):
    path = tmp_path / FILES.get(export, "tendon_step_plant_fmi2.fmu")
    for write in (lambda: path.write_text("<p>mine</p>"), lambda: zipfile.ZipFile(path, "w").writestr("a", "mine")):
        write()
        before = path.read_bytes()
        with pytest.raises(InputError, match="no export wrote this file"):
            export(given_to(export), path if export in FILES else tmp_path)
        assert path.read_bytes() == before


def test_a_chain_replaces_its_own_files_and_no_foreign_table(tmp_path):
    for _ in range(2):
        chain = export_mjcf(scene("tendons"), tmp_path / "chain.xml", hinges=5)
    assert is_marked(chain.files[0])
    (tmp_path / "chain.csv").write_text("mine")
    with pytest.raises(InputError, match="no export wrote this file"):
        export_mjcf(scene("tendons"), tmp_path / "chain.xml", hinges=5)


def test_what_was_torn_or_interrupted_does_not_block_the_next_export(tmp_path, monkeypatch):
    def files(a, b):
        digests = {name: sha256(text.encode()).hexdigest() for name, text in (("src/a.c", a), ("b.c", b))}
        return {"src/a.c": a, "b.c": b}, {"configuration_hash": a, "sha256": digests}

    first = files("int a;\nint b;\n", "int c;\n")
    write_package(tmp_path, *first)
    (tmp_path / "src/a.c").write_text("int a;\nin")  # as a full disk leaves it
    write_package(tmp_path, *first)
    assert (tmp_path / "src/a.c").read_text() == first[0]["src/a.c"]
    second, third = files("2;\n", "-2;\n"), files("3;\n", "-3;\n")

    def stopped(text, path):
        if path.name == "b.c":
            raise KeyboardInterrupt
        return write_text(text, path)

    with monkeypatch.context() as patched:
        patched.setattr("continuum_grasp.export.manifest.write_text", stopped)
        with pytest.raises(KeyboardInterrupt):
            write_package(tmp_path, *second)
    assert ((tmp_path / "src/a.c").read_text(), (tmp_path / "b.c").read_text()) == ("2;\n", first[0]["b.c"])
    write_package(tmp_path, *third)
    assert (tmp_path / "b.c").read_text() == "-3;\n"
    (tmp_path / "b.c").write_text("-3; /* mine */\n")
    with pytest.raises(InputError, match="has changed since its export"):
        write_package(tmp_path, *second)
