"""Implicit steps of exported packages: their order, and long steps of stiff cables."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.export import export_c
from tests.export_cases import needs, shared_library, values
from tests.simulation.test_winches import SERVO, model
from tests.tendon_cases import PASSIVE

STIFF = {"axial_stiffness": 1e5, "series_stiffness": 1e5}


@needs("cc")
def test_steps_have_order_two_and_long_ones_stay(tmp_path):
    """Against integration of variable order, of cables of 1e5 N/m; explicit steps of 1 ms run away."""
    made, u = model(SERVO, **STIFF), [0.004, -0.0045]
    rate = made.forward_dynamics
    exact = solve_ivp(
        lambda t, x: np.array(rate(x, u, np.zeros(made.nw), [])).ravel(),
        (0.0, 0.05),
        np.zeros(made.nx),
        method="Radau",
        rtol=1e-9,
        atol=1e-9,
    ).y[: made.n, -1]
    export_c(made, tmp_path / "package", real="double", what=["implicit_step"])
    package, library = shared_library(tmp_path / "package", tmp_path)

    def after(step):
        state = package.State()
        for _ in range(round(0.05 / step)):
            state = library.implicit_step(state, package.Input(*u), package.Forces(), step)
        return np.array(values(state))[: made.n]

    off = [np.abs(after(step) - exact).max() for step in (1e-3, 5e-4, 2.5e-4)]
    assert off[0] / off[1] == pytest.approx(4.0, rel=0.25)
    assert off[1] / off[2] == pytest.approx(4.0, rel=0.25)
    assert np.abs(after(5e-3) - exact).max() < 2e-2 * np.abs(exact).max()
    with pytest.raises(package.Error):
        library.implicit_step(package.State(), package.Input(*u), package.Forces(), 5.1e-3)


@pytest.mark.parametrize(
    ("family", "elements", "parts"),
    [
        ("arc", 40, ["step", "implicit_step"]),
        ("arc", 40, ["step", "linearization"]),
        ("clothoid", 12, ["implicit_step", "shape"]),
        ("matched_clothoid", 12, ["linearization"]),
    ],
)
def test_what_compilers_take_minutes_for_is_refused_first(family, elements, parts, tmp_path):
    given = cg.FingerModel(cg.Finger(**PASSIVE), family=family, elements=elements)
    with pytest.raises(InputError, match=r"has about \d{5,} instructions.*use fewer elements"):
        export_c(given, tmp_path, what=parts)
    assert not list(tmp_path.iterdir())
