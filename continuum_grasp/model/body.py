"""The object as a rigid body in the plane, fixed or moving, which may also slide out of the plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import casadi as ca

from continuum_grasp.model.planar import ZERO, Rotation, Scalar, Vec, rotated
from continuum_grasp.scene import GraspObject, Surroundings

_POSE = ("object_x [m]", "object_y [m]", "object_angle [rad]", "object_z [m]")
_WRENCH = ("object_force_x [N]", "object_force_y [N]", "object_moment [N m]", "table_height [m]")
_RATES = ("object_x_rate [m/s]", "object_y_rate [m/s]", "object_angle_rate [rad/s]", "object_z_rate [m/s]")


class RigidBody:
    """Pose, motion and inertia of the object.

    The pose describes the object's frame: the world position of its origin and its angle. A value ``given`` by name for
    ``object_mass`` [kg], ``friction_factor`` [1] of all coefficients and, where it is fixed, ``object_x`` and
    ``object_y`` [m] takes the place of the described one.
    """

    def __init__(self, described: GraspObject, around: Surroundings, given: Mapping[str, Scalar]) -> None:
        self.object, self._around = described, around
        self.grip: Scalar = given.get("friction_factor", 1.0)
        mass = given.get("object_mass")
        self.mass: Scalar = described.mass if mass is None else mass
        # The moment of inertia grows with the mass: same shape, other density.
        self.inertia: Scalar = around.inertia if mass is None else (around.inertia / described.mass) * mass
        self.moves = around.object_moves
        rests = around.table is not None and around.table.stays
        self.sinks = around.out_of_plane_gravity > 0.0 and not rests
        """Whether it can slide out of the plane."""
        count = (4 if self.sinks else 3) if self.moves else 0
        self.pose, self.rates = ca.SX.sym("pose", count), ca.SX.sym("rates", count)
        stands = around.table is not None and not rests
        self.wrench = ca.SX.sym("wrench", (4 if stands else 3) if self.moves else 0)
        """World force, moment about the center of mass, and the height of the table."""
        self.x_names = [*_POSE[:count], *_RATES[:count]]
        self.w_names = [*_WRENCH[: self.wrench.numel()]]
        self.start = list(around.start_pose)

        self.omega: Scalar = 0.0
        if self.moves:
            self.position = Vec(self.pose[0], self.pose[1])
            self.turn = Rotation(ca.cos(self.pose[2]), ca.sin(self.pose[2]))
            self.velocity, self.omega = Vec(self.rates[0], self.rates[1]), self.rates[2]
        else:
            x, y = described.position
            self.position = Vec(given.get("object_x", x), given.get("object_y", y))
            self.turn = rotated(described.angle)
            self.velocity = ZERO
        self.climb: Scalar = self.rates[3] if self.moves and self.sinks else 0.0
        """Rate of its height [m/s]."""
        self.arm = self.turn.apply(Vec(*described.com))
        """From the origin of its frame to its center of mass, world."""

    def local(self, at: Vec) -> Vec:
        """A world point in the object's frame."""
        return self.turn.transposed().apply(at - self.position)

    def velocity_at(self, at: Vec) -> Vec:
        """Velocity of the body at a world point."""
        if not self.moves:
            return ZERO
        return self.velocity + (at - self.position).perp().scaled(self.omega)

    @property
    def weight(self) -> Scalar:
        """Weight out of the plane [N]."""
        return self.mass * self._around.out_of_plane_gravity

    def state_rate(
        self, gravity: Vec, forces: Sequence[tuple[Vec, Vec]], moments: Sequence[Scalar], lifts: Sequence[Scalar]
    ) -> list[Scalar]:
        """Rates of pose and rates under gravity in the plane [m/s2], world forces [N] at points [m], moments [N m] and
        forces out of the plane [N].
        """
        if not self.moves:
            return []
        mass, center = self.mass, self.position + self.arm
        total = Vec(self.wrench[0], self.wrench[1])
        moment: Scalar = self.wrench[2]
        for point, force in forces:
            total += force
            moment += (point - center).cross(force)
        for couple in moments:
            moment += couple
        # Newton and Euler about the center of mass; the pose is that of the frame's origin, which its arm carries.
        spin = moment / self.inertia
        back = self.arm.perp().scaled(spin) - self.arm.scaled(self.omega * self.omega)
        acceleration = total.scaled(1.0 / mass) + gravity - back
        rates = [self.rates[k] for k in range(self.rates.numel())]
        derivatives = [*rates, acceleration.x, acceleration.y, spin]
        if self.sinks:
            derivatives.append(1.0 / mass * sum(lifts) - self._around.out_of_plane_gravity)
        return derivatives

    def energy(self, gravity: Vec) -> tuple[Scalar, Scalar]:
        """Kinetic energy, and potential of the weight above the world's origin [J]."""
        if not self.moves:
            return 0.0, 0.0
        mass, center = self.mass, self.velocity + self.arm.perp().scaled(self.omega)
        # Koenig: the motion of the center of mass, and the turning about it.
        square = center.dot(center) + self.climb * self.climb
        kinetic = 0.5 * mass * square + 0.5 * self.inertia * self.omega**2
        weight = mass * gravity.dot(self.position + self.arm)
        potential = -weight
        if self.sinks:
            potential += mass * self._around.out_of_plane_gravity * self.pose[3]
        return kinetic, potential
