"""Run folders: what a run computed and how, written whole or not at all."""

from __future__ import annotations

from continuum_grasp.results.atomic import replacing
from continuum_grasp.results.record import begin_run, kind_of_run, note_part
from continuum_grasp.results.run_folder import Run, pack_run, read_run, write_run

__all__ = ["Run", "begin_run", "kind_of_run", "note_part", "pack_run", "read_run", "replacing", "write_run"]
