"""The wheel has the examples, and with nothing else the main job of the README runs in an empty folder."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest
import yaml

pytest.importorskip("hatchling", reason="builds wheels; in the extra 'test'")
pytestmark = pytest.mark.deep
ROOT = Path(__file__).parents[1]


def build(root, kind, to):
    """A distribution of the project in a folder, built without the network."""
    command = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(to)]
    subprocess.run(command, cwd=root, check=True, capture_output=True)
    (built,) = to.glob("*.whl" if kind == "wheel" else "*.tar.gz")
    return built


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    return build(ROOT, "wheel", tmp_path_factory.mktemp("wheel"))


def test_the_wheel_has_the_examples_and_nothing_beside_the_package(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    shipped = {f"continuum_grasp/{path.relative_to(ROOT)}" for path in ROOT.glob("configs/*/*")}
    shipped |= {f"continuum_grasp/{path.relative_to(ROOT)}" for path in ROOT.glob("schema/*.json")}
    shipped |= {f"continuum_grasp/{path.relative_to(ROOT)}" for path in ROOT.glob("notebooks/*.ipynb")}
    assert len(shipped) > 60
    assert shipped <= names
    assert {name.partition("/")[0].partition("-")[0] for name in names} == {"continuum_grasp"}


def test_the_source_distribution_builds_the_same_wheel(wheel, tmp_path):
    with tarfile.open(build(ROOT, "sdist", tmp_path)) as packed:
        packed.extractall(tmp_path, filter="data")
    (root,) = (path for path in tmp_path.iterdir() if path.is_dir())
    again = zipfile.ZipFile(build(root, "wheel", tmp_path / "again"))
    first = zipfile.ZipFile(wheel)
    assert again.namelist() == first.namelist()
    assert [one.CRC for one in again.infolist()] == [one.CRC for one in first.infolist()]


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """The command of the wheel, in an environment that borrows the packages that it depends on from this one."""
    environment = tmp_path_factory.mktemp("installed") / "venv"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    python = environment / ("Scripts" if os.name == "nt" else "bin") / "python"
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-index", "--no-deps", "-q"]
    subprocess.run([*pip, str(wheel)], check=True)
    # A folder that a .pth names is searched, but .pth files in it, as that of an editable installation, are not read.
    asked = "import sysconfig; print(sysconfig.get_path('purelib'))"
    own = subprocess.run([python, "-c", asked], check=True, capture_output=True, text=True).stdout.strip()
    Path(own, "borrowed.pth").write_text(f"{sysconfig.get_path('purelib')}\n", encoding="utf-8")
    return python.with_name("continuum-grasp")


@pytest.mark.parametrize("compiler", [None, ""], ids=["compiler", "no compiler"])
def test_an_empty_folder_holds_a_certified_grasp_after_two_commands(compiler, installed, tmp_path):
    inherited = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "CC")}
    active = f"{installed.parent}{os.pathsep}{os.environ['PATH']}"
    env = {**inherited, **({} if compiler is None else {"CC": compiler}), "MPLBACKEND": "Agg", "PATH": active}

    def run(*arguments, program=installed):
        line = [program, *arguments]
        return subprocess.run(line, cwd=tmp_path, env=env, check=True, capture_output=True, text=True).stdout

    where = run("-c", "import continuum_grasp; print(continuum_grasp.__file__)", program=installed.with_name("python"))
    assert Path(where).is_relative_to(installed.parents[1])
    command = shlex.split(run("new", ".").splitlines()[-1])
    assert command == ["continuum-grasp", "grasp", "configs/grasp/mug.yaml"]
    assert f"    python3 start.py {shlex.join(command[1:])}" in (ROOT / "start.py").read_text(encoding="utf-8")
    assert "Verified independently: all checks passed" in run(*command[1:])
    found = yaml.safe_load((tmp_path / "runs/grasp/mug/result.yaml").read_text(encoding="utf-8"))
    # Without one postures are sampled.
    assert found["status"] == ("optimal" if compiler is None else "feasible")
