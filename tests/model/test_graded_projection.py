"""The model is the exact rod's equations projected onto its shapes: forces, stiffness, inertia and place of the tip."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.rod_shapes import ShapeRod
from continuum_grasp.model import FingerModel
from continuum_grasp.simulation import Signals
from tests.graded_rods import RODS, SPIRAL
from tests.marks import few
from tests.rods import force, rod_scene

SAMPLES = {
    "length": 1.0,
    "samples": {
        "at": [0.0, 0.2, 0.5, 1.0],
        "bending_stiffness": [1.0, 1.2, 0.3, 0.2],
        "linear_density": [1.0, 0.8, 0.4, 0.5],
        "rest_curvature": [0.0, 1.0, -1.0, 0.5],
    },
}
CASES = {
    "two tendons on a cone": {
        "rod": RODS["cone 0.25"],
        "finger": {
            "tendons": [
                {"offset": [0.008, 0.0044], "to": 0.6, "max_tension": 100.0},
                {"offset": [-0.008, -0.002], "max_tension": 100.0},
            ]
        },
        "actuation": {"tensions": [30.0, 9.0]},
    },
    "step with a couple inside": {
        "rod": RODS["step"],
        "finger": {"rest_curvature": {"breaks": [0.25], "values": [0.5, -1.5]}},
        "loads": [
            {"kind": "moment", "at": 0.5, "moment": 0.1, "input": True},
            force(1.0, (0.02, -0.05)),
            force(0.7, (0.02, -0.05), True),
        ],
    },
    "samples": {
        "rod": SAMPLES,
        "tip_mass": 0.1,
        "loads": [force(0.6, (0.1, 0.1))],
        "finger": {"tendons": {"offset": 0.01, "max_tension": 50.0}},
        "actuation": {"tensions": [20.0, 3.0]},
    },
    "spiral": {"rod": SPIRAL},
    "body at the tip": {
        "rod": RODS["wedge 0.25"],
        "finger": {"tip_body": {"mass": 0.05, "rotary_inertia": 0.01, "center_of_mass": [0.03, 0.08]}},
    },
    "tendon that ends inside": {
        "rod": RODS["uniform"],
        "finger": {"rest_curvature": 0.7, "tendons": [{"offset": 0.1, "to": 0.6, "max_tension": 100.0}]},
        "actuation": {"tensions": [5.0]},
    },
}


FAMILIES = ("arc", "clothoid", "matched_clothoid")
# A matched tip cannot carry a body that turns with it. Arcs at rest have the angles of the rest curvature: where it
# changes along an element beside the stiffness, that is not where the energy of a constant curvature is least.
REFUSED = {("samples", "arc"), ("body at the tip", "matched_clothoid")}
PROJECTED = [(case, family) for case in CASES for family in FAMILIES if (case, family) not in REFUSED]


@pytest.mark.parametrize(("case", "family"), few(PROJECTED, 8))
def test_the_model_is_a_projection_of_the_exact_rod(case, family):
    given = {"gravity": (0.3, -0.2), **CASES[case]}
    fidelity = {"accuracy": 1e-9, "bending_range": 1.5}
    scene = rod_scene(given.pop("rod"), family, [0.25, 0.35, 0.4], fidelity=fidelity, **given)
    model = FingerModel(scene, input_rates=False)
    kind = ("arc", "free") if family == "arc" else ("moment", "free" if family == "clothoid" else "known")
    rod = ShapeRod(scene, model.lengths, *kind)
    signals, rng = Signals(scene, model), np.random.default_rng(3)
    u, w = signals.u(0.0)[0], signals.w(0.0)[0]
    # Arcs have angles for coordinates, their shapes curvatures.
    scale = 1.0 / np.array(model.lengths) if family == "arc" else np.ones(model.n)
    basis, unit, weights = rod.shapes.basis * scale, rod.equations.problem.stiffness, rod.equations.mesh.weights
    q = rng.uniform(-1.0, 1.0, model.n) / scale
    curvature = rod.shapes.rest + rod.shapes.inputs + basis @ q
    balance = rod.equations.balance(curvature)
    expected = {
        "force": unit * (basis.T @ (weights * balance.missing)),
        "stiffness": unit * (basis.T @ (weights[:, None] * balance.slope) @ basis),
        "mass": np.outer(scale, scale) * rod.mass_matrix(curvature),
        "tip": rod.tip(curvature),
    }
    missing, stiffness = model.statics(q, u, w, [])
    found = {"force": missing, "stiffness": stiffness, "mass": model.mass_matrix(q, u, []), "tip": model.tip(q, u, [])}
    for name, value in expected.items():
        assert np.array(found[name]).reshape(value.shape) == pytest.approx(value, abs=1e-11 * np.abs(value).max()), name
