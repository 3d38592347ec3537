"""The same scenes get the same verdicts whoever does the work, and however busy the machine is."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest

from continuum_grasp import sweep
from tests.sweep_cases import ROOT

# Six scenes, some of which have no grasp: what is computed for those takes the longest.
SCENES = {
    "scene": str(ROOT / "configs" / "grasp" / "mug.yaml"),
    "vary": {
        "finger.tendons.offset": {"values": [0.003, 0.0055]},
        "object.mass": {"values": [0.2, 0.4, 0.8]},
    },
}
BUSY = 3
"""Processes that take what the machine has."""


def spin(until):
    while not until.is_set():
        pass


@contextmanager
def busy():
    context = multiprocessing.get_context("spawn")
    until = context.Event()
    processes = [context.Process(target=spin, args=(until,), daemon=True) for _ in range(BUSY)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        until.set()
        for process in processes:
            process.join()


def same(one, other):
    for name in set(one.columns) - {"seconds"}:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)


@pytest.mark.deep
def test_the_same_verdicts_alone_on_processes_and_on_a_busy_machine(tmp_path):
    with ThreadPoolExecutor(1) as executor:
        alone = sweep(SCENES, folder=tmp_path / "alone", executor=executor, keep="none")
    assert set(alone["status"]) == {"optimal", "not_solved"}
    same(alone, sweep(SCENES, folder=tmp_path / "two", workers=2, keep="none"))
    with busy():
        same(alone, sweep(SCENES, folder=tmp_path / "busy", workers=2, keep="none"))


@pytest.mark.deep
def test_the_same_verdicts_on_a_cluster(tmp_path):
    pytest.importorskip("distributed")
    from tests.sweeps.test_sweep_cluster import cluster

    with cluster(tmp_path, 2) as (address, _), busy():
        spread = sweep(SCENES, folder=tmp_path / "spread", scheduler=address, keep="none")
    same(spread, sweep(SCENES, folder=tmp_path / "two", workers=2, keep="none"))
