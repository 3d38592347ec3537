"""Releases of a rod by other libraries, in an interpreter of their own that stays up while it is asked.

``pip install mujoco pyelastica soromox jsrm`` into it (tried: mujoco 4.0.0, pyelastica 1.0.0, soromox 0.5.0,
jsrm 0.0.18) and name it in the environment variable ``CONTINUUM_GRASP_PEERS_PYTHON``.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from benchmarks.baselines import VARIABLE
from continuum_grasp.accuracy.truth import Truth
from continuum_grasp.export import export_mjcf
from continuum_grasp.scene.simulate import Scene

_SERVER = Path(__file__).with_name("release_server.py")
_SHEAR_RATIO = 1.0 / 2.6
_PLACES = 2001
HINGES = (5, 10, 20, 40, 80)
"""Of the chains that are exported."""


@dataclass(frozen=True)
class PeerRun:
    """One second of motion by a peer."""

    steps: int
    """Per second."""
    cold: float
    """Time to build, compile and make the first step [s]."""
    tip: np.ndarray
    """(T, 2) at equally spaced instants of the second [m]; NaN from where it ran away; empty if not asked for."""


class PeerError(RuntimeError):
    """A peer that is not there, or that failed."""


class ReleasePeers:
    """A process with the peer libraries."""

    def __init__(self, python: str | os.PathLike[str] | None = None) -> None:
        interpreter = os.fspath(python) if python is not None else os.environ.get(VARIABLE, "")
        if not interpreter:
            raise PeerError(f"no interpreter given: set {VARIABLE}")
        self._folder = tempfile.TemporaryDirectory(prefix="peers_")
        environment = {**os.environ, "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "OMP_NUM_THREADS": "1"}
        try:
            self._process = subprocess.Popen(
                [interpreter, os.fspath(_SERVER)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                cwd=self._folder.name,
                env=environment,
            )
        except OSError as error:
            raise PeerError(f"cannot run {interpreter}: {error}") from error

    def __enter__(self) -> ReleasePeers:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self._folder.cleanup()

    def _ask(self, **request: Any) -> dict[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            reply: dict[str, Any] = json.loads(self._process.stdout.readline())
        except (OSError, ValueError) as error:
            raise PeerError(f"the peers' process does not answer: {error}") from error
        if "error" in reply:
            raise PeerError(reply["error"])
        return reply

    def version(self, package: str) -> str:
        """Version of a package, or raises ``PeerError`` where it is not installed."""
        return str(self._ask(version=package)["version"])

    def make(
        self, name: str, kind: str, rod: Mapping[str, Any], settings: Mapping[str, Any], frames: int = 200
    ) -> PeerRun:
        """Build a simulation under a name and, with frames, run it for a second.

        Parameters
        ----------
        name : str
        kind : {"mujoco", "pyelastica", "soromox", "jsrm"}
        rod : mapping
            See ``describe_rod``.
        settings : mapping
            Arguments of the class in ``mujoco_chain``, ``pyelastica_rod`` or ``segment_release``.
        frames : int
            Instants in the second, or as many of them as are ends of steps; 0 for none.
        """
        reply = self._ask(make=name, kind=kind, rod=dict(rod), settings=dict(settings), frames=frames)
        tip = np.empty((0, 2)) if reply["tip"] is None else np.array(reply["tip"], dtype=float)
        return PeerRun(reply["steps"], reply["cold"], tip)

    def run(self, name: str, seconds: float) -> None:
        """Step one through a span of time."""
        self._ask(run=name, seconds=seconds)


def describe_rod(scene: Scene, truth: Truth) -> dict[str, Any]:
    """A release as the peers are given it: base at the origin, pointing along +x, at time zero in the exact shape.

    Stiffness and mass are those of cells of equal length; a tendon that pulls is a moment up to its end.
    """
    finger = scene.finger
    profile, length = finger.profile, finger.profile.length
    if not math.isclose(finger.base.angle, -math.pi / 2) or any(m.at < length for m in finger.masses):
        raise ValueError("the peers can take a horizontal rod with a mass at its tip only")
    if scene.initial.pose == "straight":
        bend = np.zeros(_PLACES)
    else:
        held = truth.cases[-1 if scene.initial.held_by else 0].rod
        bend = held.angle(np.linspace(0.0, length, _PLACES)) - finger.base.angle
    middles = (np.arange(_PLACES - 1) + 0.5) * length / (_PLACES - 1)
    stiffness, density = profile.bending_stiffness(middles), profile.linear_density(middles)
    moments = [
        (channel.to, float(np.dot(channel.arms, _tensions(scene)))) for channel in finger.channels if _tensions(scene)
    ]
    if any(channel.shape(0.5 * channel.to) != 1.0 for channel in finger.channels):
        raise ValueError("the peers can take tendons of constant offset only")
    return {
        "length": length,
        "uniform": profile.uniform and not moments,
        "diameter": math.sqrt(4.0 * density[0] / (math.pi * finger.rod.density)),  # of a solid round section
        "density": finger.rod.density,
        "youngs_modulus": finger.rod.youngs_modulus,
        "mass_per_length": float(density[0]),
        "bending_stiffness": float(stiffness[0]),
        "rotary_inertia": float(profile.rotary_inertia(0.0)),
        "stiffness_along": stiffness.tolist(),
        "density_along": density.tolist(),
        "shear_ratio": _SHEAR_RATIO,
        "damping": finger.damping.material,
        "tip_mass": sum(mass.mass for mass in finger.masses),
        "gravity": list(scene.gravity),
        "bend": bend.tolist(),
        "moments": moments,
        "marks": sorted({*profile.breaks, *(to for to, _ in moments if to < length)}),
        "chains": {str(hinges): export_mjcf(scene, hinges=hinges).text for hinges in HINGES},
    }


def _tensions(scene: Scene) -> list[float]:
    """Constant tensions of a scene [N]."""
    tensions = None if scene.actuation is None else scene.actuation.tensions
    return [float(one) for one in tensions or ()]  # type: ignore[arg-type]
