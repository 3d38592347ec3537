"""Results: what a run computed and how, declared once, written whole or not at all.

A result class is a `Result` that declares its arrays (`Stored`), its texts (`File`) and its pictures (`Picture`);
saving, reading, drawing, animating and conversion to tables are written here for all of them. Nothing here draws:
`continuum_grasp.plotting` does.
"""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.results.animation import save_picture as save_picture
    from continuum_grasp.results.declared import Dimension as Dimension
    from continuum_grasp.results.declared import File as File
    from continuum_grasp.results.declared import Picture as Picture
    from continuum_grasp.results.declared import Stored as Stored
    from continuum_grasp.results.motion import MotionResult as MotionResult
    from continuum_grasp.results.result import Result as Result
    from continuum_grasp.results.run_folder import Run as Run
    from continuum_grasp.results.run_folder import read_run as read_run
    from continuum_grasp.results.run_folder import write_run as write_run

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
_GONE = dict.fromkeys(
    ("begin_run", "kind_of_run", "note_part", "pack_run", "replacing", "write_text"),
    "of the package alone; write_run and result.save write whole files",
)
__getattr__, __dir__ = lazy_names(__name__, _MODULES, _GONE)
