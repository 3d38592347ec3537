"""Runs inside the interpreter that has MuJoCo: a chain of hinges with an object that it grasps, commanded from outside.

One JSON object per line on standard input, one answer per line on standard output. The first has ``xml`` and ``table``
(weight [N], friction, friction_radius [m], stiffness [N/m]); each further one commands a period: ``u`` [N], ``period``
[s], ``height`` of the table and ``wrench`` on the object (x, y [N], moment [N m]), both at begin and end of the period.
An answer has what sensors read: ``tip``, ``angles`` of the hinges, ``pulls`` of the actuators [N], ``pads`` (normal
force on each [N]), and the object's ``pose`` (x, y, angle, height).
"""

from __future__ import annotations

import json
import sys

import mujoco
import numpy as np


class Plant:
    """A chain, an object that may slide out of the plane, and a table under it that moves."""

    def __init__(self, xml: str, table: dict) -> None:
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self.table = table
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.free = [self.model.joint(f"object_{name}") for name in ("x", "y", "angle", "z")]
        self.dofs = [int(joint.dofadr[0]) for joint in self.free]
        self.at = [int(joint.qposadr[0]) for joint in self.free]
        names = [self.model.joint(k).name for k in range(self.model.njnt)]
        self.hinges = [int(self.model.joint(name).qposadr[0]) for name in names if name.startswith("hinge_")]
        bodies = [self.model.body(self.model.geom_bodyid[k]).name for k in range(self.model.ngeom)]
        self.pads = {k: name[4:] for k, name in enumerate(bodies) if name.startswith("pad_")}
        self.data.qpos[self.at[3]] = -table["weight"] / table["stiffness"]  # at rest on the table
        mujoco.mj_forward(self.model, self.data)

    def advance(self, u: list, period: float, height: list, wrench: list) -> None:
        """One period, with table and pulls on straight lines over it."""
        data, model, (x, y, angle, z) = self.data, self.model, self.dofs
        steps = round(period / model.opt.timestep)
        data.ctrl[:] = u
        begin, end = np.array(wrench)
        mass, stiffness = self.table["weight"] / 9.81, self.table["stiffness"]
        damping = 2.0 * np.sqrt(mass * stiffness)
        for k in range(steps):
            share = (k + 0.5) / steps
            up = height[0] + share * (height[1] - height[0])
            depth = up - data.qpos[self.at[3]]
            press = max(stiffness * depth - damping * data.qvel[z], 0.0) if depth > 0.0 else 0.0
            pull = begin + share * (end - begin)
            data.qfrc_applied[[x, y, angle, z]] = [*pull, press]
            model.dof_frictionloss[[x, y]] = self.table["friction"] * press
            model.dof_frictionloss[angle] = self.table["friction"] * self.table["friction_radius"] * press
            mujoco.mj_step(model, data)

    def read(self) -> dict:
        """What sensors read."""
        data, force = self.data, np.zeros(6)
        pads = dict.fromkeys(self.pads.values(), 0.0)
        for k, contact in enumerate(data.contact):
            mujoco.mj_contactForce(self.model, data, k, force)
            for geom in contact.geom:
                if geom in self.pads:
                    pads[self.pads[geom]] += float(force[0])
        return {
            "tip": data.site("tip").xpos[:2].tolist(),
            "angles": data.qpos[self.hinges].tolist(),
            "pulls": (data.act if data.act.size else data.ctrl).tolist(),
            "pads": pads,
            "pose": data.qpos[self.at].tolist(),
            "finite": bool(np.isfinite(data.qpos).all()),
        }


def main() -> None:
    """Serve until the input ends."""
    plant = None
    for line in sys.stdin:
        request = json.loads(line)
        if "xml" in request:
            plant = Plant(request["xml"], request["table"])
        else:
            plant.advance(**request)
        print(json.dumps(plant.read()), flush=True)


if __name__ == "__main__":
    main()
