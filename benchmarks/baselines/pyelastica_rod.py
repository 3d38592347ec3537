"""Runs inside the interpreter that has PyElastica: a Cosserat rod, released; see ``release_server``.

Its clamp holds the first node and the direction of the first element, so that the first half of that element never
bends: the free rod is half an element too short, an error of first order. ``shifted`` puts the clamp half an element
behind the wall, which takes that error away. Extension, shear and rotary inertia of a thin rod make its explicit
steps tiny: ``thickness`` makes the section so many times thicker at equal mass and bending stiffness, which allows
steps longer by its square, and brings errors that grow with its square. There is no material damping.
"""

from __future__ import annotations

import math

import numpy as np

STABLE = 1.8
"""Step times the estimated highest frequency; the limit of the method is 2."""


def _couple(ea):
    """A forcing by a constant moment about z, along the first director."""

    class Couple(ea.NoForces):
        def __init__(self, element: int, moment: float) -> None:
            super().__init__()
            self._element, self._moment = element, moment

        def apply_torques(self, system, time: float = 0.0) -> None:
            system.external_torques[0, self._element] += self._moment

    return Couple


class Rod:
    """One rod with position Verlet steps; ``rod`` as for ``mujoco_chain.Chain``, with diameter and shear_ratio G/E."""

    def __init__(self, rod: dict, elements: int, thickness: float = 1.0, shifted: bool = True) -> None:
        self._rod, self._elements, self._thickness, self._shifted = rod, elements, thickness, shifted
        self._h = rod["length"] / (elements - 0.5 if shifted else elements)
        # One material for all elements, each as thick as its mass asks for; stiffness follows, as in any round rod.
        edges = np.clip(np.arange(elements + 1) * self._h - (0.5 * self._h if shifted else 0.0), 0.0, rod["length"])
        along = np.concatenate([[0.0], np.cumsum(rod["density_along"])]) / len(rod["density_along"]) * rod["length"]
        masses = np.diff(np.interp(edges, np.linspace(0.0, rod["length"], len(along)), along)) / np.diff(edges)
        radius = 0.5 * thickness * rod["diameter"] * np.sqrt(masses / rod["mass_per_length"])
        self._radius = radius
        self._density = rod["density"] / thickness**2
        self._modulus = rod["youngs_modulus"] / thickness**4
        shear_speed = math.sqrt(rod["shear_ratio"] * self._modulus / self._density)
        least = float(radius.min())
        frequency = math.hypot(2.0 * shear_speed / least, 2.0 * math.sqrt(self._modulus / self._density) / self._h)
        self.steps = 200 * math.ceil(frequency / STABLE / 200)
        self._build()

    def _build(self) -> None:
        import elastica as ea

        class System(ea.BaseSystemCollection, ea.Constraints, ea.Forcing):
            """What PyElastica needs of this scene."""

        rod, n, h = self._rod, self._elements, self._h
        behind = 0.5 * h if self._shifted else 0.0
        bend = np.asarray(rod["bend"])
        middles = np.clip((np.arange(n) + 0.5) * h - behind, 0.0, rod["length"])
        angles = np.interp(middles, np.linspace(0.0, rod["length"], len(bend)), bend)
        tangents = np.stack([np.cos(angles), np.sin(angles), np.zeros(n)])
        x, z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
        self._system = System()
        self.body = ea.CosseratRod.straight_rod(
            *(n, -behind * x, x, z, n * h, self._radius, self._density),
            youngs_modulus=self._modulus,
            shear_modulus=rod["shear_ratio"] * self._modulus,
        )
        self._system.append(self.body)
        self._system.constrain(self.body).using(
            ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
        )
        gravity = np.array([*rod["gravity"], 0.0])
        self._system.add_forcing_to(self.body).using(ea.GravityForces, acc_gravity=gravity)
        for end, moment in rod["moments"]:
            # Shared by two elements so that the bend below it is that of a moment up to its end.
            at = min((end + behind) / h - 0.5, n - 1.0)
            for element, share in ((int(at), 1.0 - at % 1.0), (int(at) + 1, at % 1.0)):
                if share > 0.0:
                    self._system.add_forcing_to(self.body).using(_couple(ea), element=element, moment=share * moment)
        self.body.mass[-1] += rod["tip_mass"]
        self._system.finalize()
        self.body.position_collection[:, 1:] = self.body.position_collection[:, :1] + h * np.cumsum(tangents, axis=1)
        normals = np.repeat(z[:, None], n, axis=1)
        self.body.director_collection[0] = normals
        self.body.director_collection[1] = np.cross(tangents, normals, axis=0)
        self.body.director_collection[2] = tangents
        self._stepper, self._time = ea.PositionVerlet(), 0.0

    def run(self, seconds: float) -> None:
        """Step through a span of time, on from where the last ended."""
        step = 1.0 / self.steps
        for _ in range(round(seconds * self.steps)):
            self._time = self._stepper.step(self._system, self._time, step)

    def tips(self, frames: int) -> np.ndarray:
        """Tip (frames + 1, 2) at equally spaced instants in one second [m]."""
        self._build()
        found = [self.body.position_collection[:2, -1].copy()]
        for _ in range(frames):
            self.run(1.0 / frames)
            found.append(self.body.position_collection[:2, -1].copy())
        return np.array(found)
