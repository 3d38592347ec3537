"""from inside: no shape is known whose path needs more halvings than there are, so the test lowers their number."""

from __future__ import annotations

import pytest

from continuum_grasp.simulation import equilibrium_path, friction_path
from tests.simulation.test_friction_path import scene


@pytest.mark.parametrize("halvings", [1, 8])
def test_a_path_that_stays_rough_is_reported(monkeypatch, halvings):
    monkeypatch.setattr(friction_path, "_HALVINGS", halvings)
    pulled, released = equilibrium_path(scene(-3.0, [20.0, 0.0], elements=2), [1.0, 0.6])
    rough = [text for text in released.warnings if text.startswith("friction is rough")]
    assert not pulled.warnings
    assert bool(rough) == (halvings == 1)
