"""Sweeps on a Dask cluster: a scheduler and two workers, each a process of its own, one of them killed half-way."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections import Counter
from contextlib import contextmanager

import numpy as np
import pytest

from continuum_grasp import sweep, sweep_table
from continuum_grasp.base import InputError
from tests.commands import environment
from tests.marks import optional
from tests.sweep_cases import DEADLY, LOG, ROOT, held, masses, slow

distributed = optional("distributed")


@contextmanager
def cluster(folder, workers):
    """Address of a scheduler, and the processes of its workers."""
    file = folder / "scheduler.json"
    quiet = {"cwd": ROOT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    variables = environment(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0")
    python = [sys.executable, "-m"]
    local = ["--host", "127.0.0.1", "--scheduler-file", str(file)]
    begin = [*python, "distributed.cli.dask_scheduler", *local, "--port", "0", "--no-dashboard"]
    work = [*python, "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-nanny"]
    running = [subprocess.Popen(begin, env=variables, **quiet)]
    try:
        until = time.monotonic() + 60
        while not file.exists() or not file.read_text():
            assert time.monotonic() < until, "no scheduler within a minute"
            time.sleep(0.05)
        running += [subprocess.Popen([*work, "--no-dashboard"], env=variables, **quiet) for _ in range(workers)]
        address = json.loads(file.read_text())["address"]
        with distributed.Client(address, timeout=30, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)
        yield address, running[1:]
    finally:
        for process in running:
            process.kill()
        for process in running:
            process.wait()


@pytest.mark.deep
def test_a_worker_is_killed_half_way(tmp_path, monkeypatch):
    monkeypatch.setenv(LOG, str(tmp_path / "log"))
    killed = []
    with cluster(tmp_path, 2) as (address, processes):

        def kill_one(share, text):
            if share >= 0.5 and not killed:
                killed.append(processes[0].pid)
                processes[0].kill()

        config = masses(300)
        table = sweep(config, folder=tmp_path / "out", scheduler=address, evaluate=slow, progress=kill_one)
    assert killed
    lines = (tmp_path / "out" / "table.jsonl").read_bytes().splitlines(keepends=True)
    assert sorted(json.loads(line)["index"] for line in lines) == list(range(300))
    assert sweep_table(tmp_path / "out")["index"].tolist() == list(range(300))  # each line has its checksum
    assert table.counts == {"optimal": 300}
    np.testing.assert_allclose(table["tension_max"], np.arange(1.0, 301.0) / 0.5, rtol=1e-15)
    who = [line.split() for line in (tmp_path / "log").read_text().splitlines()]
    assert {int(pid) for pid, _ in who} == {process.pid for process in processes}
    again = sum(count - 1 for count in Counter(mass for _, mass in who).values())
    assert again <= 3 * 25  # what the killed one had in hand
    assert all((table.run_folder(k) / "result.npz").exists() for k in range(300))


@pytest.mark.deep
def test_a_scene_that_ends_its_worker_is_a_row(tmp_path):
    values = [1.0, 2.0, DEADLY, 4.0]
    with cluster(tmp_path, 6) as (address, _):
        config = masses(1, vary={"object.mass": {"values": values}})
        table = sweep(config, folder=tmp_path / "out", scheduler=address, evaluate=held)
    assert list(table["status"]) == ["optimal", "optimal", "crashed", "optimal"]


@pytest.mark.parametrize("address", ["127.0.0.1:abc", "carrier-pigeon://here", ""])
def test_an_address_that_is_none(address, tmp_path):
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        sweep(masses(3), folder=tmp_path, scheduler=address)


def test_without_dask(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'continuum-grasp\[cluster\]'"):
        sweep(masses(3), folder=tmp_path, scheduler="tcp://127.0.0.1:9")
