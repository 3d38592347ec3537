"""The comparison of two records of behavior sees every change, and how large it is."""

from __future__ import annotations

import gzip
import json

import numpy as np
import pytest

from benchmarks.behavior import compared, difference, digest, flat

ARRAY = np.random.default_rng(0).normal(size=(40, 7))


@pytest.mark.parametrize("entry", [0, 1, 137, 279])
@pytest.mark.parametrize("part", [1e-3, 1e-6, 1e-9])
def test_a_change_of_any_entry_shows_with_its_size(entry, part):
    other = ARRAY.copy()
    other.flat[entry] += part * np.abs(ARRAY).max()
    assert difference(digest(ARRAY), digest(other)) == pytest.approx(part, rel=0.3)


def test_what_is_no_change():
    assert difference(digest(ARRAY), digest(ARRAY.copy())) == 0.0
    assert difference(digest(ARRAY), digest(ARRAY * (1.0 + 1e-15))) < 1e-13
    assert difference(3e-17, -8e-16) < 1e-9  # residuals of what is zero


@pytest.mark.parametrize("other", [ARRAY.T, ARRAY[:-1], np.where(ARRAY > 2.0, np.nan, ARRAY), ARRAY.astype(str)])
def test_arrays_of_another_kind_cannot_be_compared(other):
    assert difference(digest(ARRAY), digest(other)) == np.inf


def test_prose_hashes_and_times_are_left_out():
    said = {"status": "optimal", "message": "held with 3 N", "total_s": 0.1, "id": "0a1b2c3d4e5f", "tip": [0.1, 0.2]}
    assert dict(flat(said, "j")) == {"j.status": "optimal", "j.tip[]": 2, "j.tip[0]": 0.1, "j.tip[1]": 0.2}


def test_a_lost_value_a_changed_word_and_a_changed_number_fail_and_a_moved_ratio_does_not():
    values = json.loads(gzip.decompress(gzip.compress(json.dumps({"a": digest(ARRAY), "status": "ok"}).encode())))
    assert compared(values, values, 1e-9)[:2] == (True, "same")
    assert compared(values, {**values, "new": 1}, 1e-9)[0]
    assert not compared({**values, "gone": 1}, values, 1e-9)[0]
    assert not compared(values, {**values, "status": "failed"}, 1e-9)[0]
    assert not compared({**values, "n": 1.0}, {**values, "n": 1.0 + 1e-8}, 1e-9)[0]
    assert compared({**values, "ratio: a": 1.0}, {**values, "ratio: a": 2.0}, 1e-9)[0]
