"""Tiers of tests, and what they share, from inside: no door compiles the maps of fingers before the first test.

A test without a mark is quick. ``python3 start.py test`` runs all quick tests in two runs: ``--tier first`` takes a
few of each file, ``--tier rest`` takes the others. A quick test fails if it needs more CPU time than ``--cpu-limit``.
A test that costs more, or uses a costly fixture (``COSTLY_FIXTURES`` of its module), is ``deep``:
``-m deep --shard K/N`` runs one of N parts of these; cases of a function that share a fixture are in one part.
"""

from __future__ import annotations

import os
import resource
import time
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from zlib import crc32

import pytest

FIRST = 2
"""Test functions of each file in the first tier [1], each with its first case."""
REFERENCE = 0.03
"""CPU time of ``_reference`` [s] on a core of the AMD EPYC on which the budgets were measured."""


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("tiers")
    group.addoption(
        "--cpu-limit",
        type=float,
        metavar="SECONDS",
        help="CPU time, with compilers and other children, beyond which a quick test fails on a machine as fast as the "
        "reference (default: no limit)",
    )
    group.addoption("--tier", choices=("first", "rest"), help="run a few tests of each file, or all others")
    group.addoption("--shard", type=_shard, metavar="K/N", help="run part K (from 0) of N of the tests that -m selects")


def _shard(text: str) -> tuple[int, int]:
    part, count = (int(number) for number in text.split("/"))
    if not 0 <= part < count:
        raise ValueError(text)
    return part, count


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark a test deep that uses one of the fixtures which its module names in ``COSTLY_FIXTURES``."""
    costly = getattr(getattr(item, "module", None), "COSTLY_FIXTURES", ())
    if set(costly).intersection(getattr(item, "fixturenames", ())):
        item.add_marker("deep")


@pytest.hookimpl(trylast=True)  # what -m deselects is not dealt
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if (shard := config.getoption("shard")) is not None:
        part, count = shard
        # By name: another test elsewhere moves none to another part.
        _keep(config, items, [crc32(_dealt(item).encode()) % count == part for item in items])
    if (tier := config.getoption("tier")) is not None:
        first = _in_first_tier(items)
        config.stash[LEFT_OUT] = Counter(
            item.path.parent.relative_to(config.rootpath).as_posix()
            for item, early in zip(items, first, strict=True)
            if not early
        )
        _keep(config, items, [early == (tier == "first") for early in first])


def _keep(config: pytest.Config, items: list[pytest.Item], chosen: list[bool]) -> None:
    config.hook.pytest_deselected(items=[item for item, here in zip(items, chosen, strict=True) if not here])
    items[:] = [item for item, here in zip(items, chosen, strict=True) if here]


def _in_first_tier(items: list[pytest.Item]) -> list[bool]:
    """Choose the first case of the first functions of each file."""
    functions: dict[Path, set[str]] = {}
    chosen = []
    for item in items:
        known = functions.setdefault(item.path, set())
        function = item.nodeid.partition("[")[0]
        chosen.append(function not in known and len(known) < FIRST)
        known.add(function)
    return chosen


def _dealt(item: pytest.Item) -> str:
    """Name by which a test is dealt: that of its function, where its cases share what is set up for all of them."""
    definitions = getattr(getattr(item, "_fixtureinfo", None), "name2fixturedefs", {})
    own = [made[-1] for made in definitions.values() if made[-1].baseid]  # not those of pytest and its plugins
    shared = any(made.scope != "function" for made in own)
    return item.nodeid.partition("[")[0] if shared else item.nodeid


MANY = 1000
"""Tests from which on the maps of fingers are compiled before the first of them."""


def pytest_collection_finish(session: pytest.Session) -> None:
    """Compile the maps of fingers, which takes 10 s once: else the first of many tests is over its limit."""
    from continuum_grasp.core import Compiler
    from continuum_grasp.grasp.finger_map import rod

    if len(session.items) < MANY or Compiler.find() is None:
        return
    one_by_one = [(lanes, 1) for lanes in (0, 16, 24)]
    for lanes, wide in [*one_by_one, *((lanes, rod.WIDE) for lanes in (0, 8, 12))]:
        rod._library(lanes, wide, os.environ.get("CC"), os.environ.get("PATH"))


LEFT_OUT = pytest.StashKey[Counter[str]]()
STARTED = pytest.StashKey[float]()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Generator[None, None, None]:
    item.stash[STARTED] = cpu_time()
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> Generator[None, None, None]:
    result = yield
    used, limit = cpu_time() - item.stash[STARTED], item.config.getoption("cpu_limit")
    if limit is None or item.get_closest_marker("deep") is not None:
        return result
    if used > limit and used > (limit := limit * slowness()):
        message = f"{used:.1f} s of CPU time, {limit:.1f} s is the limit here: make it cheaper, or mark it deep"
        pytest.fail(message, pytrace=False)
    return result


def cpu_time() -> float:
    """CPU time of this process and of its ended children [s]."""
    usages = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)


def slowness() -> float:
    """Ratio of the CPU times of a fixed computation here and on the reference machine, at least 1."""
    started = time.process_time()
    _reference()
    return max(1.0, (time.process_time() - started) / REFERENCE)


def _reference() -> int:
    table: dict[int, str] = {}
    for k in range(200_000):
        table[k * 7919 % 4093] = str(k)
    return len(table)
