"""The plant of a mission of one finger, at the other end of a pipe from the controller in C.

python -m benchmarks.mission_pipe PROGRAM [key=value ...]: the mission is configs/mission/mug.yaml, with the changes
that its package was exported with too.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from benchmarks.harness import CONFIGS
from continuum_grasp.addons.mission import PlantVariation
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.plant import MissionPlant, Timetable, mission_plant_model
from continuum_grasp.control import Prediction
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load

MUG = CONFIGS / "mission/mug.yaml"


def main(program: str, *changes: str) -> int:
    """Carry the mission out, and print each phase, and how far the object moved in the grasp while it was held."""
    mission = load(MUG, list(changes))
    (task,) = assign(mission, optimize_grasp(mission.grasp))
    table, model = Timetable(task), mission_plant_model(task)
    names = [span.name for span in table.phases()]
    plant = MissionPlant(task, table, Prediction(task.control), PlantVariation(), model)
    poses, before = {}, ""
    with subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1) as controller:
        while before != "end":
            controller.stdin.write(",".join(f"{value:.17g}" for value in plant.measure()) + "\n")
            controller.stdin.flush()
            *command, _, number = controller.stdout.readline().split(",")
            phase = names[int(number)]
            if phase != before:
                print(f"{plant.t:5.2f} s  {phase}")
                # The table sinks when the controller lifts, and stays where it lets go.
                if phase == "confirm":
                    table.resume(table.latest, "lift")
                elif phase == "lift" or (phase == "release" and "lift" not in poses):
                    table.resume(plant.t, phase)
                poses[phase] = np.array(plant.x[model.system.object_states][:4])
            before = phase
            plant.advance([float(value) for value in command])
        controller.stdin.close()
    if "lift" not in poses:
        print("not lifted")
        return 1
    sunk = float(poses["lift"][3] - poses["lower"][3])  # m, out of the plane
    print(f"while the table was away, the object sank by {1e3 * abs(sunk):.2f} mm")
    return 0 if abs(sunk) < 0.005 else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
