"""Other libraries' planar constant-curvature rods, each run in an interpreter of its own.

Both are on PyPI (soromox 0.5.0, jsrm 0.0.18): ``python -m venv peers && peers/bin/pip install soromox jsrm``;
they bring JAX for the CPU. Name that interpreter in the environment variable
``CONTINUUM_GRASP_PEERS_PYTHON``, or pass it.
"""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

VARIABLE = "CONTINUUM_GRASP_PEERS_PYTHON"
LIBRARIES = ("soromox", "jsrm")
_RUNNER = Path(__file__).with_name("peer_runner.py")


@dataclass(frozen=True)
class PeerRod:
    """A clamped round rod along world +X in segments; SI units, state = bending angles and their rates."""

    lengths: Sequence[float] = (0.3, 0.3)
    density: float = 6450.0
    diameter: float = 0.002
    youngs_modulus: float = 60e9
    arc_damping: float = 1e-4
    gravity: Sequence[float] = (0.0, -9.81)
    tip_moment: float = 0.05
    forces: Sequence[Sequence[float]] = ((0.1, 0.2), (-0.3, 0.15))
    """World forces at the segments' ends; used with ``forces=True``."""
    state: Sequence[float] = (0.4, -0.7, 1.0, 2.0)


def measure(
    library: str,
    python: str | os.PathLike[str] | None = None,
    *,
    rod: PeerRod | None = None,
    forces: bool = False,
    steps: int = 2000,
    repeats: int = 7,
    timeout: float = 300.0,
) -> dict[str, Any]:
    """Time one forward dynamics of a peer library inside a compiled loop.

    Parameters
    ----------
    library : {"soromox", "jsrm"}
    python : path, optional
        Interpreter with the library; by default the one named in ``CONTINUUM_GRASP_PEERS_PYTHON``.
    forces : bool
        Apply the world forces of ``rod`` too.

    Returns
    -------
    dict
        ``status`` is "ok", with ``ns`` per evaluation (median), ``ns_all``, ``xd``, ``compile_seconds`` and
        versions; or "not installed" or "failed", with ``reason``.
    """
    if library not in LIBRARIES:
        raise ValueError(f"library must be one of {LIBRARIES}, got {library!r}")
    interpreter = os.fspath(python) if python is not None else os.environ.get(VARIABLE, "")
    if not interpreter:
        return _missing(library, f"no interpreter given: set {VARIABLE}")
    try:
        probe = subprocess.run(
            [interpreter, "-c", f"import importlib.util as u; print(bool(u.find_spec({library!r})))"],
            capture_output=True,
            text=True,
            timeout=60,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return _missing(library, f"cannot run {interpreter}: {error}")
    if probe.returncode != 0 or probe.stdout.strip() != "True":
        return _missing(library, f"{interpreter} does not find {library}")
    command = [interpreter, os.fspath(_RUNNER), library, "--rod", json.dumps(asdict(rod or PeerRod()))]
    command += ["--steps", str(steps), "--repeats", str(repeats), *(["--forces"] if forces else [])]
    try:
        run = subprocess.run(command, capture_output=True, text=True, timeout=timeout)
        if run.returncode != 0:
            return {"library": library, "status": "failed", "reason": run.stderr.strip()[-2000:]}
        return {**json.loads(run.stdout.strip().splitlines()[-1]), "status": "ok"}
    except (subprocess.TimeoutExpired, ValueError, IndexError) as error:
        return {"library": library, "status": "failed", "reason": str(error)}


def _missing(library: str, reason: str) -> dict[str, Any]:
    return {"library": library, "status": "not installed", "reason": reason}
