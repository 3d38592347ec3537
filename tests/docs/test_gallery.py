"""The gallery shows every shipped example, from what its script stored."""

from __future__ import annotations

import pytest
from PIL import Image

from continuum_grasp.examples import Example
from docs.gallery import FILMS, MOST_BYTES, PAGE, PICTURES, page, read_record, shown

RECORD = read_record()
MOST_BYTES_OF_FILMS = {"mission.gif": 1_200_000}
"""Others have half of that."""


def test_every_example_is_there_and_nothing_else():
    names = {one.name for one in shown()}
    assert names == set(RECORD["scenes"]), "run: python -m docs.gallery"
    timed = [name for times in RECORD["times"] for name in times["seconds"]]
    assert sorted(timed) == sorted(names), "run: python -m docs.gallery --times"
    assert set(FILMS) <= names
    drawn = {PICTURES / scene["picture"] for scene in RECORD["scenes"].values()}
    assert set((PICTURES / "gallery").iterdir()) <= drawn


@pytest.mark.parametrize("one", shown(), ids=lambda one: one.name)
def test_a_picture_is_wide_enough_and_loads_fast(one: Example):
    path = PICTURES / RECORD["scenes"][one.name]["picture"]
    with Image.open(path) as picture:
        assert 480 <= picture.width <= 640
        assert getattr(picture, "n_frames", 1) > 1 or one.name not in FILMS
    most = MOST_BYTES_OF_FILMS.get(path.name, 600_000) if one.name in FILMS else MOST_BYTES
    assert path.stat().st_size <= most


def test_the_page_is_that_of_the_record():
    assert PAGE.read_text(encoding="utf-8") == page(RECORD), "run: python -m docs.gallery --page"


def test_what_has_no_grasp_says_why():
    for name in ("grasp/heavy_bottle", "grasp/slippery_bottle"):
        status, _, reason = RECORD["scenes"][name]["status"].partition(": ")
        assert status == "infeasible"
        assert reason
        assert reason in PAGE.read_text(encoding="utf-8")
