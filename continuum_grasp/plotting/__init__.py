"""Pictures of results: what they share is in ``drawing``, the rest is by kind of result.

Every result draws its pictures by ``plot``; behind each is a ``plot_x(result, *, ax=None)`` here, which draws into the
axes it is given, or into axes of a new figure, and returns the axes. Nothing is shown, saved, or changed globally in
matplotlib, which is imported when the first picture is drawn. Public are pictures of what is no result.
"""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.plotting.grasp.view import plot_object as plot_object
    from continuum_grasp.plotting.scene import plot_scene as plot_scene

_OF_RESULTS = (
    *("accuracy", "contact_forces", "coordinates", "energy", "front", "grasp", "map", "modes", "robustness"),
    *("shape", "snapshots", "tension_loop", "tensions", "tensions_along", "tip_path"),
)
_GONE = {
    f"plot_{name}": f"results draw it, write result.plot(picture={('pareto' if name == 'front' else name)!r})"
    for name in _OF_RESULTS
}
_GONE["plot_closing"] = "simulate the scene with its object, and write trajectory.plot()"
_GONE |= dict.fromkeys(("plot_friction", "plot_resistance"), "results draw it beside a grasp, write result.plot()")
_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES, _GONE)
