"""Winches and motors of drawn fingers against a chain of guides: bend, tension and place of the tip through loops."""

from __future__ import annotations

import numpy as np
import pytest

import continuum_grasp as cg
from tests.tendon_cases import Loaded, bend, way
from tests.truth.tendon import HingedFinger

HINGES, ELEMENTS = 24, 4


class Drawn:
    """A finger of drawn length, stiffness, friction, cables and drums, and the chain of guides of the same numbers."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.two = bool(rng.random() < 0.6)
        self.kind = str(rng.choice(["length", "pulley", "torque"] if self.two else ["length", "torque"]))
        length, stiffness, offset = rng.uniform(0.1, 0.5), 10 ** rng.uniform(-2.7, -1.3), rng.uniform(0.003, 0.009)
        friction, self.most = float(rng.uniform(0.01, 0.3)), rng.uniform(0.6, 1.8)
        self.tension = self.most * stiffness / (offset * length)
        axial, series = 10 ** rng.uniform(3.7, 4.7), 10 ** rng.uniform(-5.0, -4.3)
        compliance = series + length / axial
        if self.two:  # both stay in tension
            pretension, slack = self.tension * rng.uniform(*((0.1, 1.0) if self.kind == "torque" else (0.8, 1.5))), 0.0
        else:
            pretension = self.tension * rng.uniform(0.0, 0.2) * (rng.random() < 0.5)
            slack = 0.0 if pretension else rng.uniform(0.0, 0.1) * offset * self.most
        self.radius, self.slack, self.pretension = rng.uniform(0.004, 0.02), slack, pretension
        drive = {"kind": "length", "time_constant": 0.02}
        if self.kind != "length":
            arrangement = "one_pulley" if self.kind == "pulley" else "per_tendon"
            drive = {"kind": "motor", "arrangement": arrangement, "winch_radius": self.radius, "inertia": 2e-6}
            drive["torque_max"] = 1e3
        tendon = {
            "offset": offset,
            "max_tension": 1e4,
            "friction": friction,
            "presliding": 2e-6,  # guides of the chain stick without giving way
            "axial_stiffness": axial,
            "series_stiffness": 1.0 / series,
            "drive": {**drive, "pretension": pretension, "slack": slack},
        }
        rod = {"length": length, "linear_density": 0.03, "bending_stiffness": stiffness}
        finger = cg.Finger(rod=rod, tendons=tendon if self.two else [tendon])
        self.model = cg.FingerModel(
            finger, family="clothoid", elements=ELEMENTS, gravity=(0, 0), bending_range=4.0 / ELEMENTS
        )
        sides = (1.0, -1.0) if self.two else (1.0,)
        keys = {"axial_stiffness": axial, "series_compliance": series, "sides": sides, "hinges": HINGES}
        self.chain = HingedFinger(length, stiffness, offset, friction, **keys)
        self.loaded, self.length = Loaded(self.model), length
        self.start, self.path, self.wound = (
            pretension * compliance - slack,
            offset * self.most,
            compliance * self.tension,
        )
        self.push = 0.15 * stiffness / length**2
        self._at: np.ndarray | None = None

    def step(self, share: float, push: float) -> tuple[list[float], list[float]]:
        """Bend, tensions and tip of model and chain at a share of the greatest command, and a force across the tip."""
        torque = share * self.tension * self.radius
        u = {
            "length": [share * (self.path + self.wound) + self.slack, -share * self.path],
            "pulley": [torque],
            # A little at least: where nothing pulls, a chain has no friction to find.
            "torque": [v + self.radius * self.pretension for v in (torque + 0.02 * self.tension * self.radius, 0.0)],
        }[self.kind][: self.model.nu]
        model, loaded = self.model, self.loaded
        loaded.move(u, (push, 0.0))
        tensions = np.array(model.tensions_at_rest()(loaded.q, u, [], np.append(loaded.states, 0.0))).ravel()
        at = model.drives_at(loaded.q, u, loaded.states)
        if self.kind == "torque":
            drums = [("tension", tension) for tension in tensions]
        elif self.kind == "pulley":
            drums = [("length", self.start + side * self.radius * at[0]) for side in (1.0, -1.0)]
        else:
            drums = [("length", self.start + y) for y in at[::2]]
        self._follow([value for _, value in drums], push, drums[0][0])
        tip = np.array(model.tip(loaded.q, u, [])).ravel()
        found = [bend(model, loaded.q), *tensions, *tip]
        return found, [self.chain.angle, *self.chain.tensions, *self.chain.tip]

    def _follow(self, drums: list[float], push: float, kind: str, parts: int = 1) -> None:
        """Move the chain, in smaller steps where all at once finds no state of the guides."""
        end = np.array([*drums, push])
        start = end if self._at is None else self._at
        try:
            for share in np.linspace(0.0, 1.0, parts + 1)[1:]:
                at = start + share * (end - start)
                self.chain.move([(kind, value) for value in at[:-1]], (at[-1], 0.0))
                self._at = at
        except (RuntimeError, np.linalg.LinAlgError):
            if parts > 64:
                raise
            self._follow(drums, push, kind, 4 * parts)


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore:.*encountered in:RuntimeWarning")
@pytest.mark.parametrize("seed", [0, 1, 3, 5])
def test_drawn_drives_go_through_loops_as_a_chain_of_guides(seed):
    """To and fro with inner loops, then a force on the tip: bend and tensions per their range, the tip per length."""
    one = Drawn(seed)
    shares = way([0.2 if one.slack else 0.0, 1.0, 0.4, 0.8, 0.4, 1.0, 0.3, 0.7], 0.1)
    pushes = way([0.0, 1.0, -1.0, 0.5, -0.5, 1.0], 0.2)
    steps = [(share, 0.0) for share in shares] + [(shares[-1], one.push * part) for part in pushes]
    found, exact = np.array([one.step(*each) for each in steps]).transpose(1, 0, 2)
    off, ranges = np.abs(found - exact), np.ptp(exact, axis=0)
    assert off[:, 0].max() < 0.015 * ranges[0]
    assert off[:, 1:-2].max() < 0.03 * ranges[1:-2].max()
    assert np.linalg.norm(off[:, -2:], axis=1).max() < 0.01 * one.length
