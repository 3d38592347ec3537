"""Figures of the README and of the page on other tools are those of the stored results, measured with this version."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from benchmarks.elastica import elastica_deflection
from continuum_grasp import __version__
from docs import peer_figures
from docs.peer_figures import PICTURE, RELEASES, ROOT, stored

PAGES = (*RELEASES, "mpc_race", "referee", "accuracy", "elements_few")
"""Stored results whose figures the README and the page show."""


def words(path):
    return " ".join((ROOT / path).read_text(encoding="utf-8").split())


@pytest.mark.parametrize("text", [*peer_figures.readme_words(), *peer_figures.model_rows()])
def test_the_readme_shows_what_was_measured(text):
    assert text in words("README.md")


@pytest.mark.parametrize("rows", [peer_figures.release_rows, peer_figures.mpc_rows, peer_figures.referee_rows])
def test_the_page_shows_what_was_measured(rows):
    page = (ROOT / "docs/peers.md").read_text(encoding="utf-8").splitlines()
    assert [row for row in rows() if row not in page] == []


def test_the_front_page_has_figures_of_one_version_of_this_major_one_and_names_it():
    (version,) = {stored(name)["machine"]["continuum_grasp"] for name in PAGES}
    assert version.split(".")[0] == __version__.split(".")[0]
    assert set(re.findall(r"(?<=version )\d+\.\d+\.\d+", words("README.md"))) == {version}


@pytest.mark.parametrize("name", RELEASES)
def test_ours_errs_no_more_than_the_peer_beside_it(name):
    for peer, (error, _, own, factor) in peer_figures.equal_errors(name).items():
        assert own <= error, peer
        assert factor > 0.0
    assert {peer_figures.library(peer) for peer in peer_figures.equal_errors(name)} <= set(peer_figures.points(name))
    assert PICTURE.exists()


def test_names_lose_their_settings_alone():
    known = {
        "MuJoCo 10 hinges (middle), implicitfast, 250/s, staggered": "MuJoCo 10 hinges",
        "2 matched clothoids, 0.0001, 40/s": "2 matched clothoids",
        "PyElastica 20 elements, section 2.5 times as thick": "PyElastica 20 elements, 2.5 times as thick",
        "SoRoMoX GVS, 2 segments of order 1, 400/s": "SoRoMoX GVS, 2 segments of order 1",
    }
    assert {name: peer_figures.short(name) for name in known} == known


@pytest.mark.parametrize("load", [0.06, 0.7, 3.0, 9.0])
def test_the_elastica_bends_as_its_differential_equation_says(load):
    """By shooting: the bend at the clamp is chosen so that there is none at the tip."""

    def shot(bend):
        def rate(_, y):
            return [y[1], -load * np.cos(y[0]), np.sin(y[0])]

        return solve_ivp(rate, (0.0, 1.0), [0.0, bend, 0.0], rtol=1e-11, atol=1e-13).y[:, -1]

    bend = brentq(lambda b: shot(b)[1], 0.0, load, xtol=1e-13)
    assert elastica_deflection(load) == pytest.approx(shot(bend)[2], rel=1e-9)
