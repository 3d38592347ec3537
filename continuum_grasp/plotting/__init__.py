"""Pictures of results: what they share is in ``drawing``, the rest is by kind of result.

Every ``plot_x(result, *, ax=None)`` draws into the axes it is given, or into axes of a new figure, and returns the
axes; `continuum_grasp.results.save_picture` saves their figure. Nothing is shown, saved, or changed in matplotlib's
global style. matplotlib is imported when the first picture is drawn.

Further pictures are in ``plotting.control`` (closed loops and plans), ``plotting.mission`` and
``plotting.identification``.
"""

from __future__ import annotations

from continuum_grasp._lazy import TYPE_CHECKING, checked_imports, lazy_names

if TYPE_CHECKING:
    from continuum_grasp.plotting.accuracy import plot_accuracy as plot_accuracy
    from continuum_grasp.plotting.grasp.closing import plot_closing as plot_closing
    from continuum_grasp.plotting.grasp.friction import plot_friction as plot_friction
    from continuum_grasp.plotting.grasp.picture import plot_grasp as plot_grasp
    from continuum_grasp.plotting.grasp.resistance import plot_resistance as plot_resistance
    from continuum_grasp.plotting.grasp.robustness import plot_robustness as plot_robustness
    from continuum_grasp.plotting.motion import plot_contact_forces as plot_contact_forces
    from continuum_grasp.plotting.motion import plot_coordinates as plot_coordinates
    from continuum_grasp.plotting.motion import plot_energy as plot_energy
    from continuum_grasp.plotting.motion import plot_modes as plot_modes
    from continuum_grasp.plotting.motion import plot_shape as plot_shape
    from continuum_grasp.plotting.motion import plot_snapshots as plot_snapshots
    from continuum_grasp.plotting.motion import plot_tip_path as plot_tip_path
    from continuum_grasp.plotting.objects import plot_object as plot_object
    from continuum_grasp.plotting.sweep import plot_front as plot_front
    from continuum_grasp.plotting.sweep import plot_map as plot_map
    from continuum_grasp.plotting.tendons import plot_tension_loop as plot_tension_loop
    from continuum_grasp.plotting.tendons import plot_tensions as plot_tensions
    from continuum_grasp.plotting.tendons import plot_tensions_along as plot_tensions_along

_MODULES = checked_imports(__name__)
__all__ = [name for names in _MODULES.values() for name in names]
__getattr__, __dir__ = lazy_names(__name__, _MODULES)
