"""Every tuned number of the grasp search is found, changed wherever it is used, and put back."""

from __future__ import annotations

import math

from benchmarks.grasp_numbers import Number, compared, numbers, scaled

MODULES = {number.module.__name__.rpartition(".")[2]: number.module for number in numbers()}


def test_numbers_of_the_search_are_found():
    names = {number.name for number in numbers()}
    assert {"FLAT", "PICKED", "STARTS", "SAME_AIM", "NEARLY"} <= names
    # The kernels in C are compiled for these.
    assert not {"WIDE", "MOST_MIDDLES"} & {n.name for n in numbers() if n.module.__name__.endswith(".rod")}


def test_a_number_changes_wherever_it_is_imported_and_is_put_back():
    # FEW is a number of rods that settled fingers import.
    (few,) = (number for number in numbers() if number.name == "FEW")
    before, settled, fill = few.value, MODULES["settled"], MODULES["fill"]
    with few.times(2.0) as changed:
        assert changed == settled.FEW == few.module.FEW == 2 * before
    assert settled.FEW == few.module.FEW == before
    with Number(fill, "PLACE").times(0.5):
        assert math.isclose(fill.PLACE, 0.03)
    assert math.isclose(fill.PLACE, 0.06)


def test_counts_stay_counts_and_tables_are_changed_entry_by_entry():
    assert scaled(3, 0.5) == 2
    assert scaled(1, 0.5) == 1
    assert scaled((4, 0.5), 2.0) == (8, 1.0)
    picked = MODULES["balance"].PICKED
    assert scaled(picked, 0.5)[4] == picked[4] // 2


def test_outcomes_are_compared_by_what_holds():
    before = [("optimal", 10.0, 1.0), ("infeasible", 5.0, 1.0), ("feasible", 8.0, 1.0), ("optimal", 4.0, 1.0)]
    after = [("not_solved", 10.0, 2.0), ("optimal", 5.0, 2.0), ("feasible", 7.0, 2.0), ("optimal", 4.0, 2.0)]
    assert compared(before, after, [20.0] * 4) == "1 found, 1 lost, 1 less; 2.00"
    assert compared(before, before, [20.0] * 4) == "same; 1.00"
