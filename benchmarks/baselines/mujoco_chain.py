"""Runs inside the interpreter that has MuJoCo: a rod as a chain of hinges, released; see ``release_server``.

Two ways to lump the bending stiffness: ``middle`` has a hinge in the middle of each of n elements, as
``export --to mjcf`` writes it for rods of any kind; ``clamp``, for uniform rods, has one at the clamp, which
carries half an element (twice the stiffness), and one at the end of each element but the last. Both are of second
order; which is better depends on the scene, so both are tried. Bodies carry the mass and the rotary inertia of their
piece of rod and no geometry; contacts and constraints are off; a whole run is one call of ``mj_step``.
"""

from __future__ import annotations

import itertools
import math
from xml.etree import ElementTree

import numpy as np


class Chain:
    """One chain with one integrator and one time step.

    ``rod`` has length, mass_per_length, bending_stiffness, rotary_inertia (per length), damping [N m2 s], tip_mass,
    gravity (x, y) and bend: angles at equally spaced places at time zero; the clamped rod points along +x. Of the
    layout ``middle`` all that counts is chains: the exported texts by number of hinges. Integrators are as MuJoCo
    calls them, ``steps`` per second. ``staggered``: start with the velocity of half a step before, which makes the
    semi-implicit methods a leapfrog: of second order in the positions where forces do not depend on velocities.
    """

    def __init__(
        self, rod: dict, hinges: int, layout: str, integrator: str, steps: int, staggered: bool = False
    ) -> None:
        import mujoco

        self._mujoco = mujoco
        self.steps = steps
        if layout == "middle":
            self._model = mujoco.MjModel.from_xml_string(_without_looks(rod["chains"][str(hinges)]))
            self._model.opt.timestep = 1.0 / steps
            self._model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
            self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
            self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
            self._q0, self._control = self._model.key_qpos[0].copy(), self._model.key_ctrl[0].copy()
        else:
            ends = np.linspace(0.0, rod["length"], hinges + 1)
            self._model = mujoco.MjModel.from_xml_string(_clamped(rod, ends, integrator, 1.0 / steps))
            bend = np.asarray(rod["bend"])
            middles = 0.5 * (ends[:-1] + ends[1:])
            angles = np.interp(middles, np.linspace(0.0, rod["length"], len(bend)), bend)
            self._q0, self._control = np.diff(angles, prepend=0.0), np.empty(0)
        self._data = mujoco.MjData(self._model)
        self._v0 = np.zeros(hinges)
        if staggered:
            self._reset()
            mujoco.mj_forward(self._model, self._data)
            self._v0 = -0.5 / steps * self._data.qacc

    def _reset(self) -> None:
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:], self._data.qvel[:], self._data.ctrl[:] = self._q0, self._v0, self._control

    def run(self, seconds: float) -> None:
        """Step through a span of time."""
        self._reset()
        self._mujoco.mj_step(self._model, self._data, nstep=round(seconds * self.steps))

    def tips(self, frames: int) -> np.ndarray:
        """Tip (frames + 1, 2) at equally spaced instants in one second [m]; NaN from where it runs away."""
        self._reset()
        tips = np.full((frames + 1, 2), np.nan)
        for k in range(frames + 1):
            if k:
                self._mujoco.mj_step(self._model, self._data, nstep=self.steps // frames)
            if not np.all(np.abs(self._data.qpos) < 100.0):
                break
            self._mujoco.mj_kinematics(self._model, self._data)
            tips[k] = self._data.site("tip").xpos[:2]
        return tips


def _without_looks(text: str) -> str:
    """A model without what takes time and moves nothing: geometry, sensors."""
    root = ElementTree.fromstring(text)
    for parent in list(root.iter()):
        for child in [one for one in parent if one.tag in ("geom", "sensor", "light", "camera")]:
            parent.remove(child)
    return ElementTree.tostring(root, encoding="unicode")


def _clamped(rod: dict, ends: np.ndarray, integrator: str, step: float) -> str:
    h = rod["length"] / (len(ends) - 1)
    bodies, at = "", 0.0
    for k, (start, end) in enumerate(itertools.pairwise(ends.tolist())):
        share = 0.5 * h if k == 0 else h
        piece = end - start
        turning = rod["rotary_inertia"] * piece
        across = rod["mass_per_length"] * piece**3 / 12.0
        bodies += (
            f'<body pos="{start - at!r} 0 0">'
            f'<inertial pos="{piece / 2!r} 0 0" mass="{rod["mass_per_length"] * piece!r}"'
            f' diaginertia="{2.0 * turning!r} {across + turning!r} {across + turning!r}"/>'
            f'<joint type="hinge" axis="0 0 1" stiffness="{rod["bending_stiffness"] / share!r}"'
            f' damping="{rod["damping"] / share!r}"/>'
        )
        at = start
    if rod["tip_mass"] > 0.0:
        # Not a point: MuJoCo wants a little inertia.
        little = 1e-9 * rod["tip_mass"] * math.pow(h, 2)
        bodies += (
            f'<body pos="{float(ends[-1]) - at!r} 0 0"><inertial pos="0 0 0" mass="{rod["tip_mass"]!r}"'
            f' diaginertia="{little!r} {little!r} {little!r}"/></body>'
        )
    bodies += f'<site name="tip" pos="{float(ends[-1]) - at!r} 0 0"/>' + "</body>" * (len(ends) - 1)
    gx, gy = rod["gravity"]
    return (
        f'<mujoco><option timestep="{step!r}" integrator="{integrator}" gravity="{gx!r} {gy!r} 0">'
        '<flag contact="disable" constraint="disable" autoreset="disable"/></option>'
        f"<worldbody>{bodies}</worldbody></mujoco>"
    )
