"""The finger of a plant in its surroundings: what differs from what the controller knows."""

from __future__ import annotations

from typing import Any

from continuum_grasp.errors import InputError
from continuum_grasp.model.layout import element_lengths
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.finger import Finger, PointMass, Rod
from continuum_grasp.scene.loads import Actuation
from continuum_grasp.scene.simulate import Scene
from continuum_grasp.scene.surroundings import Surroundings


def plant_scene(scene: ControlScene) -> Scene:
    """The finger of a plant in its surroundings, under the loads that the controller does not know.

    Parameters
    ----------
    scene : ControlScene
        The scene; ``plant`` says how the plant differs from the controller's finger.

    Returns
    -------
    Scene
        Its input is the one at rest: least tensions, or no tip moment. Damping per arc becomes material damping that
        does as much to the controller's elements, so that it does not depend on those of the plant.
    """
    tendons = scene.finger.tendons
    rest = None if tendons is None else Actuation(tensions=(tendons.min_tension, tendons.min_tension))
    around = {name: getattr(scene, name) for name in Surroundings.model_fields}
    return Scene(
        **around,
        schema_version=1,
        name=scene.name,
        finger=_plant_finger(scene),
        gravity=scene.gravity,
        contacts=scene.contacts if scene.object is not None else (),
        fidelity=scene.plant.fidelity,
        actuation=rest,
        initial=scene.initial,
        loads=scene.loads,
    )


def _plant_finger(scene: ControlScene) -> Finger:
    finger, plant = scene.finger, scene.plant
    rod, damping, tendons = finger.rod, finger.damping, finger.tendons
    elements = element_lengths(rod.length, scene.contacts, scene.fidelity.elements)
    material = damping.material + damping.per_arc * rod.length / len(elements)
    changes: dict[str, Any] = {
        "rod": Rod(
            length=rod.length,
            diameter=rod.diameter,
            linear_density=rod.mass_per_length,
            bending_stiffness=rod.stiffness * plant.stiffness,
            rotary_inertia=rod.inertia_per_length,
        ),
        "damping": damping.replaced(material=material * plant.damping, per_arc=0.0),
    }
    if plant.tip_mass > 0.0:
        changes["masses"] = (*finger.masses, PointMass(at=rod.length, mass=plant.tip_mass))
    if tendons is None and plant.tendon_friction is not None:
        raise InputError("is for a finger with tendons", key="plant.tendon_friction")
    if tendons is not None:
        own = {"friction": plant.tendon_friction, "time_constant": plant.time_constant}
        changes["tendons"] = tendons.replaced(**{k: v for k, v in own.items() if v is not None})
    return finger.replaced(**changes)
