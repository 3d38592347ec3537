"""Maps and Pareto pictures of sweeps: what they show, worked out by hand, and that they are drawn."""

from __future__ import annotations

import itertools
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from PIL import Image

from continuum_grasp import sweep, sweep_table
from continuum_grasp.addons.sweeps import SweepTable
from continuum_grasp.base import InputError
from continuum_grasp.results import pareto
from tests.sweep_cases import MUG, STUCK, held

GRID = {
    "object.mass": {"values": [0.2, STUCK, 0.4]},
    "contacts.friction": {"min": 0.25, "max": 1.0, "count": 4},
    "objective": {"values": ["least_tension", "least_normal_force"]},
}


def swept(folder, evaluate=held, **more):
    with ThreadPoolExecutor(1) as executor:
        config = {"scene": str(MUG), **more}
        return sweep(config, folder=folder, executor=executor, evaluate=evaluate)


def heavier_word(scene):
    """As `held`, ten times the mass where the objective is the other."""
    factor = 1.0 if scene.objective == "least_tension" else 10.0
    return held(
        scene.model_copy(update={"object": scene.object.model_copy(update={"mass": factor * scene.object.mass})})
    )


def test_a_map_over_the_grid(tmp_path):
    table = swept(tmp_path, vary=GRID)
    names = "object.mass", "contacts.friction", "tension_max"
    x, y, color, kind = table.map(*names)
    assert list(x) == [0.2, 0.4, STUCK]
    assert list(y) == [0.25, 0.5, 0.75, 1.0]
    np.testing.assert_allclose(color[:, :2], [[m / f for m in (0.2, 0.4)] for f in y], rtol=1e-15)
    assert np.isnan(color[:, 2]).all()
    assert set(kind[:, 2]) == {"too heavy"}
    assert set(kind[:, :2].ravel()) == {""}
    labels = ["object.mass [kg]", "contacts.friction [1]", "greatest tension [N]", "objective"]
    assert [table.label(name) for name in (*names, "objective")] == labels


@pytest.mark.parametrize(("reduce", "factor"), [("least", 1.0), ("greatest", 10.0), ("mean", 5.5), ("median", 5.5)])
def test_places_that_several_grasps_share(reduce, factor, tmp_path):
    table = swept(tmp_path, heavier_word, vary={**GRID, "object.mass": {"values": [0.2, 0.4]}})
    x, _, color, _ = table.map("contacts.friction", "object.mass", "tension_max", reduce)
    np.testing.assert_allclose(color, factor * np.outer([0.2, 0.4], 1 / x), rtol=1e-14)


def test_words_keep_their_order_and_unfinished_places_stay_empty(tmp_path):
    table = swept(tmp_path, vary=GRID)
    names = "objective", "object.mass", "tension_max"
    assert list(table.map(*names, "least")[0]) == [
        "least_tension",
        "least_normal_force",
    ]  # not in the order of the alphabet
    lines = (tmp_path / "table.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "table.jsonl").write_text("".join(line for line in lines if '"object.mass":0.4' not in line))
    assert list(sweep_table(tmp_path).map(*names)[1]) == [0.2, STUCK]


def test_a_map_of_draws(tmp_path):
    sample = {
        "count": 60,
        "keys": {"object.mass": {"uniform": [0.1, 1.0]}, "contacts.friction": {"normal": [0.3, 0.2]}},
    }
    table = swept(tmp_path, sample=sample)
    x, y, color, kind = table.map("object.mass", "contacts.friction", "tension_max")
    assert color.shape == x.shape == (60,)
    bad = table["contacts.friction"] < 0
    assert 0 < bad.sum() < 30
    assert set(kind[bad]) == {"invalid"}
    np.testing.assert_allclose(color[~bad], (x / y)[~bad], rtol=1e-15)


@pytest.mark.parametrize(("x_greatest", "y_greatest"), [*itertools.product([False, True], repeat=2)])
def test_the_front_is_what_no_point_beats(x_greatest, y_greatest):
    random = np.random.default_rng(3)
    x, y = random.integers(0, 12, (2, 80)).astype(float)
    a, b = x * (-1 if x_greatest else 1), y * (-1 if y_greatest else 1)

    def dominated(k):
        return np.any((a <= a[k]) & (b <= b[k]) & ((a < a[k]) | (b < b[k])))

    expected = {(x[k], y[k]) for k in range(80) if not dominated(k)}
    found = pareto(x, y, x_greatest, y_greatest)
    assert {(x[k], y[k]) for k in found} == expected
    assert len(found) == len(expected)
    assert list(x[found]) == sorted(x[found])


def test_the_front_of_a_sweep(tmp_path):
    table = swept(tmp_path, vary={**GRID, "objective": {"values": ["least_tension"]}})
    assert np.isfinite(table.of_grasps("tension_max")).sum() == 8  # four of twelve have no grasp
    best = table.front("tension_max", "object.mass", y_best="greatest")
    assert [*zip(table["tension_max"][best], table["object.mass"][best], strict=True)] == [(0.2, 0.2), (0.4, 0.4)]
    assert list(table["contacts.friction"][best]) == [1.0, 1.0]


def test_pictures_are_drawn(tmp_path):
    table = swept(
        tmp_path,
        vary=GRID,
        maps=[
            {"x": "object.mass", "y": "contacts.friction", "color": "tension_max"},
            {"x": "objective", "y": "seconds", "color": "object.mass"},
        ],
        pareto=[{"x": "tension_max", "y": "friction_margin", "y_best": "greatest"}],
    )
    assert table.plot().get_xlabel() == "object.mass [kg]"
    drawn = table.plot(picture="pareto", x="tension_max", y="object.mass", y_best="greatest")
    assert (drawn.get_xlabel(), drawn.get_ylabel()) == ("greatest tension [N]", "object.mass [kg]")
    with pytest.raises(InputError, match="color: this picture needs it; map takes x, y, color, reduce"):
        table.plot(picture="map", x="object.mass", y="seconds")
    frame = table.to_pandas()
    assert frame["object.mass"].to_list() == table["object.mass"].tolist()
    assert (frame.index.name, frame.attrs["units"]["object.mass"]) == ("row", "kg")
    assert SweepTable.read(table.save(tmp_path / "other")).arrays["status"].tolist() == table["status"].tolist()
    with pytest.raises(InputError, match="stored in this folder already"):
        table.save(tmp_path)
    assert len(repr(table)) < 1000
    files = table.save_pictures()
    assert [file.name for file in files] == [
        "map_1_tension_max.png",
        "map_2_object_mass.png",
        "pareto_1_tension_max_friction_margin.png",
    ]
    for file in files:
        with Image.open(file) as picture:
            assert len(picture.convert("RGB").getcolors(1 << 24)) > 50


def test_what_is_in_the_pictures(tmp_path):
    table = swept(tmp_path, vary={**GRID, "contacts.friction": {"min": 0.1, "max": 1.0, "count": 5, "spacing": "log"}})
    ax = table.plot(picture="map", x="object.mass", y="contacts.friction", color="tension_max")
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["no grasp, too heavy: 5"]
    assert ax.get_yscale() == "log"
    assert ax.get_xlabel() == "object.mass [kg]"
    shown = ax.collections[0].get_array()
    assert shown.max() == pytest.approx(4.0)  # 0.4 kg at a friction of 0.1
    ax = table.plot(picture="pareto", x="tension_max", y="object.mass", y_best="greatest")
    assert ax.get_legend().get_texts()[1].get_text() == "front: 2 of 20; least x and greatest y are best"
