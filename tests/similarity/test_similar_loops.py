"""Shipped loops in other units: a controller, its estimator and its plant have no times, lengths or forces of their own.

Exponents of time are even: densities of noise have roots of seconds.
"""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.control.controller import Controller
from continuum_grasp.closed_loop import run_mpc
from continuum_grasp.scene.load import load
from tests.rods import ROOT
from tests.similarity.similar import larger, power

SMALL, LARGE = {"L": -6, "M": -17, "T": -4}, {"L": 4, "M": 12, "T": 2}
CALLS = 40
"""Of a loop [1]: with the first jump of a setpoint, and the answer."""
pytestmark = pytest.mark.filterwarnings("ignore:.*is in (milli)?meters:UserWarning")


