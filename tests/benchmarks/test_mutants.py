"""The list of one-line faults fits the code: each stands where it says, and has tests that mirror it."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.mutants import FAULTS

ROOT = Path(__file__).parents[2]


def test_there_are_as_many_faults_as_promised():
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) >= 60


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_every_fault_fits_its_file_and_has_tests(fault):
    text = (ROOT / fault.file).read_text(encoding="utf-8")
    assert fault.put_into(text) != text
    assert fault.tests
    assert all((ROOT / path).exists() for path in fault.tests)
