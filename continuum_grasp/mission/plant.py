"""The plant of a mission: a finger that differs from what the controller knows, and an object that can be dropped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.closed_loop.plant import Plant
from continuum_grasp.closed_loop.plant_model import PlantModel, plant_scene
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.mission.assignment import Assignment
from continuum_grasp.mission.timetable import Timetable
from continuum_grasp.scene.surroundings import Table

__all__ = ["Variation", "mission_plant", "mission_plant_model"]

_FINGER, _OBJECT = ("bending_stiffness", "material_damping"), ("object_mass", "friction_factor")


@dataclass(frozen=True)
class Variation:
    """How one plant differs from another.

    Attributes
    ----------
    stiffness, damping : float or None
        Per that of the controller's finger [1]; None: as the mission's ``plant`` says.
    mass, friction : float
        Of the object and of all its contacts, per those of the mission [1].
    shift : (float, float)
        Of where the object stands, world x, y [m].
    seed : int or None
        Of the measurement noise; None: as the mission's ``plant`` says.
    """

    stiffness: float | None = None
    damping: float | None = None
    mass: float = 1.0
    friction: float = 1.0
    shift: tuple[float, float] = (0.0, 0.0)
    seed: int | None = None


def mission_plant_model(assignment: Assignment) -> PlantModel:
    """Its equations; what varies is a run-time number, so that they are compiled once."""
    mission, control = assignment.mission, assignment.control
    if control.object is None:
        raise ValueError("a mission has an object")
    mass = mission.grasp.object.mass if mission.object_mass is None else mission.object_mass
    scene = plant_scene(control).replaced(
        contacts=tuple(sorted({*control.contacts, *mission.more_contacts})),
        object=control.object.replaced(mass=mass),
        object_moves=True,
        supports=mission.grasp.supports,
        contact_law=mission.contact_law,
        out_of_plane_gravity=mission.gravity,
        table=Table(friction=mission.table_friction),
    )
    return PlantModel(control, scene, _FINGER, _OBJECT)


def mission_plant(
    assignment: Assignment,
    timetable: Timetable,
    prediction: Prediction,
    variation: Variation | None = None,
    model: PlantModel | None = None,
) -> Plant:
    """A plant at the start of a mission.

    Parameters
    ----------
    assignment : Assignment
    timetable : Timetable
        When the table sinks, and what pulls when.
    prediction : Prediction
        The controller's model.
    variation : Variation, optional
        How it differs from the mission's own plant.
    model : PlantModel, optional
        Its equations, where they are made already.

    Returns
    -------
    Plant
    """
    asked = variation or Variation()
    equations = mission_plant_model(assignment) if model is None else model
    own, nominal = assignment.mission.plant, np.array(equations.system.p_nominal)
    stiffness = 1.0 if asked.stiffness is None else asked.stiffness / own.stiffness
    damping = 1.0 if asked.damping is None else asked.damping / own.damping
    equations.p = nominal * np.array([stiffness, damping, asked.mass, asked.friction])
    equations.outside = timetable.outside()
    plant = Plant(assignment.control, prediction, assignment.mission.controller.period, equations, asked.seed)
    plant.x = plant.x.copy()
    plant.x[equations.system.object_states] += np.array([*asked.shift, 0.0, 0.0])
    return plant
