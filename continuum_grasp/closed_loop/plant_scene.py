"""The plant's finger in its surroundings, as a scene: the controller's, with the differences of ``plant``."""

from __future__ import annotations

import numpy as np

from continuum_grasp.model import element_lengths
from continuum_grasp.scene import ControlScene, PointMass, Rod, Scene


def plant_scene(scene: ControlScene) -> Scene:
    """Build the plant's finger in its surroundings, with the input at rest and the loads that the controller does
    not know.
    """
    finger, plant = scene.finger, scene.plant
    rod, damping, masses = finger.rod, finger.damping, finger.masses
    material = damping.material
    if damping.per_arc > 0.0:
        # Material damping that takes as much power from the controller's elements, bent by a moment that is the
        # same everywhere, so that the plant's damping does not depend on its number of elements.
        edges = np.cumsum([0.0, *element_lengths(finger.profile, scene.contacts, scene.fidelity.elements)])
        (bends,) = finger.profile.moments(lambda s: 1.0 / finger.profile.bending_stiffness(s), edges)
        material += damping.per_arc * rod.stiffness * float(bends @ bends / bends.sum())
    if plant.tip_mass > 0.0:
        masses = (*masses, PointMass(at=rod.length, mass=plant.tip_mass))
    initial = scene.initial
    if "tip_moment" not in finger.input_keys:
        finger = finger.with_tendons(**plant.tendon_changes(finger))
        if plant.time_constant is not None:
            finger = finger.with_lags(plant.time_constant)
        if not finger.has_tendon_friction:
            initial = initial.without_history
        elif not scene.finger.has_tendon_friction and initial.pose == "equilibrium":
            # Friction that the plant alone has: the scene states no history.
            initial = initial.replaced(reached_by="pulling")
    return scene.simulated.replaced(
        finger=finger.replaced(
            rod=_stiffer(rod, plant.stiffness),
            damping=damping.replaced(material=material * plant.damping, per_arc=0.0),
            masses=masses,
        ),
        contacts=scene.contacts if scene.object is not None else (),
        fidelity=plant.fidelity,
        initial=initial,
        parameters=(),
    )


def _stiffer(rod: Rod, factor: float) -> Rod:
    """A copy of a rod with a multiple of its stiffness."""
    if rod.graded:
        return rod.replaced(factors=rod.factors.replaced(bending_stiffness=rod.factors.bending_stiffness * factor))
    name = "youngs_modulus" if rod.bending_stiffness is None else "bending_stiffness"
    return rod.replaced(**{name: getattr(rod, name) * factor})
