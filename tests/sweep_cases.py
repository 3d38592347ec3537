"""Sweeps to run in tests, and what stands in for the optimizer there.

``python -m tests.sweep_cases FOLDER`` runs the slow sweep, to be killed.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from continuum_grasp.grasp import Reason
from continuum_grasp.scene import GraspScene

ROOT = Path(__file__).parents[1]
MUG = ROOT / "configs" / "grasp" / "mug.yaml"
DEADLY, BROKEN, STUCK = 0.66, 0.77, 0.88
"""Masses that end the process, raise, and give no grasp."""
LOG = "CONTINUUM_GRASP_TEST_LOG"


class Held:
    """A grasp whose numbers follow from the scene in a way that tests can write down."""

    def __init__(self, scene: GraspScene, status: str = "optimal", reasons: tuple[Any, ...] = ()) -> None:
        self.kind, self.scene, self.status, self.reasons = "grasp", scene, status, reasons
        self.message = "held" if status == "optimal" else "not held"
        self.fingers = {"finger": SimpleNamespace(tensions=(tension(scene), 0.01))}
        self.contacts = [SimpleNamespace(normal_force=n, friction_margin=n / 10) for n in (1.0, 3.0, 2.0)]
        self.statistics = {"iterations": 7, "starts": 2}
        self.quality = SimpleNamespace(epsilon=scene.object.mass / 2)

    def stored_arrays(self) -> dict[str, float]:
        """The mass."""
        return {"mass": self.scene.object.mass}

    def details(self, *, quality: bool) -> dict[str, str]:
        """Nothing that costs."""
        assert not quality
        return {"message": self.message}


def tension(scene: GraspScene) -> float:
    """What `Held` says of a scene [N]."""
    return scene.object.mass / scene.contacts.friction


def held(scene: GraspScene) -> Held:
    """A quick evaluation with all kinds of ends; notes each call where the environment says."""
    mass = scene.object.mass
    note(mass)
    if mass == DEADLY:
        os._exit(9)
    if mass == BROKEN:
        raise ZeroDivisionError("a bug")
    if mass == STUCK:
        return Held(scene, "infeasible", (Reason("too heavy", "object.mass", "kg", mass, 0.5, "", ""),))
    return Held(scene)


def slow(scene: GraspScene) -> Held:
    """As `held`, in 20 ms."""
    time.sleep(0.02)
    return held(scene)


def note(mass: float) -> None:
    """Write down that a scene is evaluated, and by whom."""
    if LOG in os.environ:
        with open(os.environ[LOG], "a", encoding="utf-8") as file:
            file.write(f"{os.getpid()} {mass!r}\n")


def masses(count: int, **more: Any) -> Mapping[str, Any]:
    """A sweep over so many masses from 1 kg on."""
    values = [1.0 + k for k in range(count)]
    return {"scene": str(MUG), "vary": {"object.mass": {"values": values}}, **more}


if __name__ == "__main__":
    from continuum_grasp.addons.sweeps import sweep

    sweep(masses(400), folder=sys.argv[1], workers=2, evaluate=slow)
    print("done")
