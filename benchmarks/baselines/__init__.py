"""What continuum_grasp is measured against: other libraries, in an interpreter of their own."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any

VARIABLE = "CONTINUUM_GRASP_PEERS_PYTHON"
"""Names the interpreter that has the other libraries; see ``release_peers``."""


class PeerError(RuntimeError):
    """A peer that is not there, or that failed."""


class Peer:
    """A process of that interpreter, which runs a file of this folder and stays up while it is asked."""

    def __init__(self, server: str) -> None:
        interpreter = os.environ.get(VARIABLE, "")
        if not interpreter:
            raise PeerError(f"no interpreter given: set {VARIABLE}")
        self._folder = tempfile.TemporaryDirectory(prefix="peers_")
        environment = {**os.environ, "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "OMP_NUM_THREADS": "1"}
        try:
            self._process = subprocess.Popen(
                [interpreter, os.fspath(Path(__file__).with_name(server))],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                cwd=self._folder.name,
                env=environment,
            )
        except OSError as error:
            raise PeerError(f"cannot run {interpreter}: {error}") from error

    def ask(self, **request: Any) -> dict[str, Any]:
        """One request, a line of JSON, and its answer."""
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            reply: dict[str, Any] = json.loads(self._process.stdout.readline())
        except (OSError, ValueError) as error:
            raise PeerError(f"the peers' process does not answer; see its error stream: {error}") from error
        if "error" in reply:
            raise PeerError(reply["error"])
        return reply

    def close(self) -> None:
        """End the process."""
        self._process.stdin.close()
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self._folder.cleanup()
