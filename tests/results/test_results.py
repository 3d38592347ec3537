"""Run folders: round trip, provenance, refusals, and what a run that dies in the middle leaves behind."""

from __future__ import annotations

import hashlib
import json
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.results import Run, plain, read_run, replacing, write_run
from tests.commands import python

ARRAYS = {"t": np.linspace(0.0, 1.0, 11), "x": np.arange(44.0).reshape(11, 4), "names": np.array(["a", "bc"])}
META = {"config": {"b": 1.0, "a": [1, 2]}, "seed": 7, "status": "done", "statistics": {"steps": np.int64(3)}}


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_round_trip(tmp_path: Path) -> None:
    folder = write_run(tmp_path / "deep" / "run", ARRAYS, META)
    assert names(folder) == [".run.json", "meta.json", "result.npz"]
    run = read_run(folder)
    assert run.arrays.keys() == ARRAYS.keys()
    for name, value in ARRAYS.items():
        np.testing.assert_array_equal(run.arrays[name], value)
        assert run.arrays[name].dtype == value.dtype
    assert (run.meta["seed"], run.meta["status"], run.meta["statistics"]) == (7, "done", {"steps": 3})
    assert run.meta["config"] == {"b": 1.0, "a": [1, 2]}
    assert run.meta == json.loads((folder / "meta.json").read_text(encoding="utf-8"))


def test_provenance(tmp_path: Path) -> None:
    meta = read_run(write_run(tmp_path, ARRAYS, {**META, "versions": {"compiler": "cc 1.2"}})).meta
    assert meta["versions"].keys() == {"python", "continuum_grasp", "casadi", "numpy", "compiler"}
    assert meta["versions"]["numpy"] == np.__version__
    assert meta["versions"]["python"] == ".".join(str(v) for v in sys.version_info[:3])
    assert meta["config_sha256"] == hashlib.sha256(b'{"a":[1,2],"b":1.0}').hexdigest()
    assert meta["created"].endswith("Z")
    assert len(meta["created"]) == 20
    assert meta["platform"]["system"]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.float64(0.5), 0.5),
        (np.array([[1, 2]]), [[1, 2]]),
        (np.bool_(True), True),
        ((1, 2.5), [1, 2.5]),
        (float("nan"), "NaN"),
        ([float("inf"), -np.inf], ["Infinity", "-Infinity"]),
        (Path("a") / "b", str(Path("a") / "b")),
        (None, None),
    ],
)
def test_plain_values(value: object, expected: object) -> None:
    assert plain({"k": value}) == {"k": expected}


def test_digest_ignores_order_and_nothing_else() -> None:
    assert Run.digest({"a": 1.0, "b": [1, 2]}) == Run.digest({"b": (1, 2), "a": 1.0})
    assert Run.digest({"a": 1.0}) != Run.digest({"a": np.nextafter(1.0, 2.0)})


@pytest.mark.parametrize(
    ("arrays", "meta", "key"),
    [
        ({"a": np.array([object()])}, {}, "a"),
        ({"a": [[1.0], [1.0, 2.0]]}, {}, "a"),
        ({"../a": np.ones(1)}, {}, "arrays"),
        ({"__meta__": np.ones(1)}, {}, "arrays"),
        ({}, {"statistics": {"solver": object()}}, "statistics.solver"),
        ({}, {"statistics": {1: 2}}, "statistics"),
        ({}, {"created": "today"}, "meta"),
    ],
)
def test_refused_before_anything_is_written(tmp_path: Path, arrays: dict, meta: dict, key: str) -> None:
    with pytest.raises(InputError) as caught:
        write_run(tmp_path / "run", arrays, meta)
    assert caught.value.key == key
    assert not (tmp_path / "run").exists()


def test_no_run_and_every_damaged_one_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        read_run(tmp_path)
    write_run(tmp_path, ARRAYS, META)
    whole = (tmp_path / "result.npz").read_bytes()
    for content in (b"not an archive", *(whole[:cut] for cut in range(0, len(whole), 97))):
        (tmp_path / "result.npz").write_bytes(content)
        with pytest.raises(InputError):
            read_run(tmp_path)


def test_later_format_is_refused(tmp_path: Path) -> None:
    [(key, stored)] = np.load(write_run(tmp_path, {}, {}) / "result.npz").items()
    meta = json.loads(stored.tobytes())
    later = meta["format_version"] = meta["format_version"] + 1
    np.savez(tmp_path / "result.npz", **{key: np.frombuffer(json.dumps(meta).encode(), np.uint8)})
    with pytest.raises(InputError, match=f"format {later}"):
        read_run(tmp_path)


def test_replacing_keeps_the_old_file_when_the_body_raises(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")

    def write_half() -> None:
        with replacing(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        write_half()
    assert path.read_text() == "old"
    assert names(tmp_path) == ["a.txt"]
    with replacing(path) as temporary:
        assert temporary.suffix == ".txt"
        assert temporary.parent == tmp_path
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"


def check_whole(folder: Path, old: bool) -> int | None:
    """The folder holds the old run or the new one or, if there was no old one, none; returns its seed."""
    if not (folder / "result.npz").exists():
        assert not old
        assert not (folder / "meta.json").exists()
        return None
    run = read_run(folder)
    seed: int = run.meta["seed"]
    np.testing.assert_array_equal(run.arrays["a"], np.full(run.arrays["a"].shape, float(seed % 2)))
    if (folder / "meta.json").exists():
        assert json.loads((folder / "meta.json").read_text(encoding="utf-8")) == run.meta
    return seed


KILLED = """
import os, signal, sys
import numpy as np
from continuum_grasp.results import write_run
name, call, folder = sys.argv[1], int(sys.argv[2]), sys.argv[3]
real, count = getattr(os, name), 0
def dying(*args, **kwargs):
    global count
    count += 1
    if count == call:
        os.kill(os.getpid(), signal.SIGKILL)
    return real(*args, **kwargs)
setattr(os, name, dying)
write_run(folder, {"a": np.ones(9)}, {"seed": 1})
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize(
    ("name", "call", "seed"),
    [("fsync", 1, 0), *(("replace", k, 0) for k in (1, 2, 3)), ("replace", 4, 1), ("replace", 5, 1)],
)
def test_killed_in_the_middle_leaves_one_whole_run(tmp_path: Path, name: str, call: int, seed: int) -> None:
    write_run(tmp_path, {"a": np.zeros(5)}, {"seed": 0})
    done = python("-c", KILLED, name, call, tmp_path)
    assert done.returncode == -signal.SIGKILL
    assert check_whole(tmp_path, old=True) == seed
    write_run(tmp_path, {"a": np.zeros(2)}, {"seed": 2})
    assert check_whole(tmp_path, old=True) == 2
