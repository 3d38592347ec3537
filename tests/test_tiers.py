"""A quick test over the CPU limit fails; each deep test is in one shard, each quick test in one tier."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TESTS = """
import subprocess, sys, time
import pytest

BURN = "import time\\nwhile time.process_time() < 0.4: pass"

def test_cheap(): pass
def test_sleeps(): time.sleep(0.4)
def test_own_process(): exec(BURN.replace("0.4", str(time.process_time() + 0.4)))
def test_child(): subprocess.run([sys.executable, "-c", BURN], check=True)
@pytest.mark.deep
def test_deep(): subprocess.run([sys.executable, "-c", BURN], check=True)
@pytest.mark.deep
@pytest.mark.parametrize("case", range(9))
def test_cases(case): pass
@pytest.fixture(scope="module")
def set_up(): pass
@pytest.mark.deep
@pytest.mark.parametrize("case", range(9))
def test_together(case, set_up): pass
"""


def run(folder, *options):
    (folder / "test_it.py").write_text(TESTS)
    (folder / "pytest.ini").write_text("[pytest]\nmarkers = deep: costs more\n")
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-p",
        "tests.tiers",
        "-p",
        "tests.remaining",
        "-p",
        "no:cacheprovider",
        "-v",
    ]
    return subprocess.run(
        [*command, str(folder), *options], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout


def test_a_quick_test_beyond_its_cpu_time_fails(tmp_path):
    said = run(tmp_path, "--cpu-limit", "0.05")  # 0.4 s are beyond it on a machine that is eight times slower, too
    over = set(re.findall(r"(test_\w+) ERROR", said))
    assert over == {"test_own_process", "test_child"}, said
    assert "make it cheaper, or mark it deep" in said


def test_users_have_no_limit(tmp_path):
    assert "3 passed" in run(tmp_path, "-k", "cheap or own_process or child")


def test_each_deep_test_is_in_one_shard(tmp_path):
    shards = [re.findall(r"::(\S+) PASSED", run(tmp_path, "-m", "deep", "--shard", f"{k}/2")) for k in range(2)]
    cases = [f"test_{name}[{k}]" for name in ("cases", "together") for k in range(9)]
    assert sorted(shards[0] + shards[1]) == sorted(["test_deep", *cases])
    assert all("cases" in str(shard) for shard in shards)  # dealt one by one
    assert sum("together" in str(shard) for shard in shards) == 1  # set up once


@pytest.mark.parametrize("workers", [(), ("-n", "2")])
def test_each_test_is_in_one_tier_and_the_first_names_what_it_leaves_out(tmp_path, workers):
    first = run(tmp_path, "-k", "cheap or sleeps or cases", "--tier", "first", *workers)
    rest = run(tmp_path, "-k", "cheap or sleeps or cases", "--tier", "rest", *workers)
    assert "2 passed" in first
    assert "9 passed" in rest
    assert "9 quick tests (" in first
    assert "quick tests (" not in rest
