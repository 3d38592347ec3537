"""Runs inside the interpreter that has MuJoCo: a rod as a chain of hinges, released; see ``release_server``.

Two ways to lump the bending stiffness: ``middle`` has a hinge in the middle of each of n equal elements, ``clamp`` has
one at the clamp, which carries half an element (twice the stiffness), and one at the end of each element but the last.
Both are of second order; which is better depends on the scene, so both are tried. Bodies carry the mass and the
rotary inertia of their piece of rod and no geometry; contacts and constraints are off; a whole run is one call of
``mj_step``.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

INTEGRATORS = ("implicitfast", "Euler", "discrete", "RK4")
LAYOUTS = ("middle", "clamp")


class Chain:
    """One chain with one integrator and one time step.

    Parameters
    ----------
    rod : dict
        length, mass_per_length, bending_stiffness, rotary_inertia (per length), damping [N m2 s], tip_mass, gravity
        (x, y) and bend: angles at equally spaced places at time zero; the clamped rod points along +x.
    hinges : int
    layout : {"middle", "clamp"}
    integrator : str
        As MuJoCo calls it.
    steps : int
        Per second.
    staggered : bool
        Start with the velocity of half a step before, which makes the semi-implicit methods a leapfrog: of second
        order in the positions where forces do not depend on velocities.
    """

    def __init__(
        self, rod: dict, hinges: int, layout: str, integrator: str, steps: int, staggered: bool = False
    ) -> None:
        import mujoco

        self._mujoco = mujoco
        self.steps = steps
        h = rod["length"] / hinges
        places = (np.arange(hinges) + (0.5 if layout == "middle" else 0.0)) * h
        self._ends = np.append(places, rod["length"])
        xml = _xml(rod, self._ends, layout, integrator, 1.0 / steps)
        self._model = mujoco.MjModel.from_xml_string(xml)
        self._data = mujoco.MjData(self._model)
        bend = np.asarray(rod["bend"])
        middles = 0.5 * (self._ends[:-1] + self._ends[1:])
        angles = np.interp(middles, np.linspace(0.0, rod["length"], len(bend)), bend)
        self._q0 = np.diff(angles, prepend=0.0)
        self._v0 = np.zeros(hinges)
        if staggered:
            self._reset()
            mujoco.mj_forward(self._model, self._data)
            self._v0 = -0.5 / steps * self._data.qacc

    def _reset(self) -> None:
        self._mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:], self._data.qvel[:] = self._q0, self._v0

    def run(self, seconds: float) -> None:
        """Step through a span of time."""
        self._reset()
        self._mujoco.mj_step(self._model, self._data, nstep=round(seconds * self.steps))

    def tips(self, frames: int) -> np.ndarray:
        """Tip (frames + 1, 2) at equally spaced instants in one second [m]; NaN from where it runs away."""
        self._reset()
        q = np.full((frames + 1, len(self._q0)), np.nan)
        q[0] = self._q0
        for k in range(frames):
            self._mujoco.mj_step(self._model, self._data, nstep=self.steps // frames)
            if not np.all(np.abs(self._data.qpos) < 100.0):
                break
            q[k + 1] = self._data.qpos
        directions = np.exp(1j * np.cumsum(q, axis=1))
        tip = self._ends[0] + directions @ np.diff(self._ends)
        return np.stack([tip.real, tip.imag], axis=1)


def _xml(rod: dict, ends: np.ndarray, layout: str, integrator: str, step: float) -> str:
    h = rod["length"] / (len(ends) - 1)
    bodies, at = "", 0.0
    for k, (start, end) in enumerate(itertools.pairwise(ends.tolist())):
        share = 0.5 * h if layout == "clamp" and k == 0 else h
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
    bodies += "</body>" * (len(ends) - 1)
    gx, gy = rod["gravity"]
    return (
        f'<mujoco><option timestep="{step!r}" integrator="{integrator}" gravity="{gx!r} {gy!r} 0">'
        '<flag contact="disable" constraint="disable" autoreset="disable"/></option>'
        f"<worldbody>{bodies}</worldbody></mujoco>"
    )
