"""The finger as named CasADi functions."""

from __future__ import annotations

from functools import cached_property
from typing import Unpack

import casadi as ca

from continuum_grasp.model.chain import column
from continuum_grasp.model.choices import ModelOptions
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.functions import Functions, function_names, matrix
from continuum_grasp.model.structure import Structure
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.simulate import Scene


class FingerModel(Functions):
    """A planar continuum finger, written once as CasADi functions.

    The motion obeys ``M qdd + bias + gravity + elastic + damping = actuation + external_force``. All functions are SX
    functions with named inputs and outputs; inputs that a model does not need are empty. World vectors are in the
    scene's axes; positive bending turns counter-clockwise, towards the base's -X axis.

    Parameters
    ----------
    finger : Scene or Finger
        A scene supplies finger, contacts, gravity, fidelity, parameters and loads; a keyword overrides it.
    contacts : sequence of float, optional
        Positions along the finger where contact forces may act [m]; element boundaries.
    gravity : (2,) sequence, optional
        World gravity [m/s2]; (0, -9.81) for a bare finger; zero leaves the weight out.
    family : str, optional
        Curvature family: ``arc``, ``clothoid`` or ``matched_clothoid``. Default: ``matched_clothoid`` for a scene, and
        for a bare finger whose tendons have a time constant or whose ``input_rates`` are given; ``clothoid`` for other
        bare fingers, whose tip moment may vary, with tendon friction, where a moment of the scene on the tip varies in
        time, or where those at time zero do not fit the initial pose.
    elements : int or sequence of float, optional
        Number of elements, or their lengths [m]. Default: two, or one per segment between contacts and jumps of the
        rest curvature where that is more.
    bending_range : float, optional
        Greatest bend of an element [rad] (for clothoids: its length times its greatest curvature); 2 pi / 3, or less
        where the finger's strain limit allows less.
    accuracy : float, optional
        Relative accuracy of the evaluation over the bending range; sets Horner terms and quadrature nodes.
    parameters : sequence of str, optional
        Parameters that stay run-time arguments (``p``); all others are folded into the code. With run-time
        ``element_lengths`` masses and loads inside an element keep their share of its length.
    loads : sequence of ForceLoad and MomentLoad, optional
        Where loads act; their values are entries of ``w`` (of ``u`` for moments on the tip, where they act like the
        tip moment).
    tip_force : bool, optional
        Whether a force acts at the tip; for a scene, where it has contacts.
    input_rates : bool, optional
        Whether ``u`` is [values, rates, accelerations] of the inputs, for ``matched_clothoid`` alone. Its tip moves
        with the tip moment, so a moment that varies needs them. Default: True where an input of the scene varies, or a
        moment on its tip, and tendons have no time constant, which supplies the rates. Without rates the moment is
        taken to be constant throughout the motion: ``Core.rollout`` refuses one that varies, and no function can notice
        it from one call to the next. Dropping the rates of a ramp of 0.05 N m in 0.2 s costs 8.9 mm r.m.s. on a rod of
        0.6 m, where two elements with rates have 0.14 mm and free clothoids 0.09 mm.

    Attributes
    ----------
    family : str
    lengths : tuple of float
        Element lengths [m].
    ranges : tuple of float
        Declared bending range of each element [rad].
    n, nx, nu, nw, np : int
        Numbers of coordinates q, states x, inputs u, force components w and parameters p.
    q_names, x_names, u_names, w_names, p_names : list of str
        Name and unit of each entry.
    p_nominal : list of float
        Nominal values of ``p``.
    load_entries : list of (str, int)
        Per load, the vector ("u" or "w") and the index at which its value begins.

    Notes
    -----
    ====================  =======================  =========================================================
    function              inputs                   outputs
    ====================  =======================  =========================================================
    forward_dynamics      x, u, w, p               xd (nx) [x/s]
    inverse_dynamics      q, qd, qdd, u, w, p      Q (n) [Q], the generalized force that is missing
    mass_matrix           q, u, p                  M (n, n) [Q s2/q]
    bias                  q, qd, u, p              b (n) [Q], velocity products
    gravity               q, u, p                  G (n) [Q], gradient of the weight's potential
    elastic               q, u, p                  K (n) [Q], gradient of the elastic energy
    damping               q, qd, u, p              D (n) [Q]
    actuation             q, u, p                  Q (n) [Q]
    external_force        q, u, w, p               Q (n) [Q]
    position              q, u, s, p               r (2) [m], world, of the section at s [m]
    orientation           q, u, s, p               angle [rad] from the world's to the section's axes
    jacobian              q, u, s, p               J (2, n) [m/q], world
    jacobian_rate         q, qd, u, s, p           Jd (2, n) [m/(q s)], world
    tip                   q, u, p                  r (2) [m], world
    joints                q, u, p                  r (2, N) [m], world, angle (N) [rad], of the elements' end sections
    waypoints             q, u, p                  r (2, K) [m], world, at ``waypoint_fractions`` of the elements
    energy                x, u, p                  kinetic, potential [J]
    bending               q, u, p                  bend of each element [rad]
    range_use             q, u, p                  use of the declared bending range, per element [1]
    statics               q, u, w, p               Q (n) [Q], K (n, n) [Q/q]: what is missing for equilibrium, and dQ/dq
    linearization         x, u, w, p               A (nx, nx) [1/s x/x], B (nx, nu) [1/s x/u]
    ====================  =======================  =========================================================

    Units follow the coordinates. Arcs: q are bending angles [rad], so generalized forces [Q] are in N m, M in kg m2,
    J in m and tangent stiffness in N m. Clothoids: q are nodal curvatures [1/m], so [Q] is N m2, M in kg m4, J in m2
    and tangent stiffness in N m3; at a boundary where the rest curvature jumps, the curvature jumps with it and q is
    the mean of both sides. ``q_names``, ``x_names``, ``u_names``, ``w_names`` and ``p_names`` have the unit of every
    entry.

    x = [q, qd], and [q, qd, tip moment, its rate] where the tendons have a time constant; the functions of q then take
    the tip moment that u commands. w = world forces at the contacts, then at the tip (if any), then the loads.
    Positions s beyond the finger are taken as its ends; a compiled core refuses them.
    Axial and shear strains of the rod are not modeled.

    Raises
    ------
    InputError
        If the pieces do not fit together.

    Examples
    --------
    >>> from continuum_grasp import FingerModel
    >>> from continuum_grasp.scene import Finger, Rod
    >>> finger = Finger(rod=Rod(length=0.6, linear_density=0.02, bending_stiffness=0.05))
    >>> model = FingerModel(finger, family="arc", elements=2)
    >>> model.q_names
    ['theta_1 [rad]', 'theta_2 [rad]']
    >>> model.tip([0.5, 0.5], [0.0], [])
    DM([-0.275819, 0.504883])
    """

    def __init__(self, finger: Scene | Finger, **options: Unpack[ModelOptions]) -> None:
        made = Structure(finger, options)
        self.structure = made
        self.finger = made.finger
        self.family = made.family_name
        self.contacts = made.contacts
        self.loads = made.loads
        self.load_entries = made.load_entries
        self.lengths = made.lengths
        self.ranges = made.ranges
        self.q_names, self.x_names = made.q_names, made.x_names
        self.u_names, self.w_names = made.u_names, made.w_names
        self.p_names, self.p_nominal = made.parameters.labels, made.parameters.nominal
        self.n, self.nx = made.n, len(made.x_names)
        self.nu, self.nw, self.np = len(made.u_names), len(made.w_names), len(self.p_names)
        self._equations = Equations(made)

    @cached_property
    def inverse_dynamics(self) -> ca.Function:
        """Generalized force that a motion asks for beyond what acts; zero on a motion of the finger."""
        eq = self._equations
        inertia = ca.mtimes(matrix(eq.mass_matrix), eq.qdd)
        return self._function("inverse_dynamics", "q qd qdd u w p", Q=inertia - column(eq.net_force))

    @cached_property
    def mass_matrix(self) -> ca.Function:
        """Mass matrix, equation (37)."""
        return self._function("mass_matrix", "q u p", M=matrix(self._equations.mass_matrix))

    @cached_property
    def bias(self) -> ca.Function:
        """Coriolis and centrifugal forces, equation (38)."""
        return self._function("bias", "q qd u p", b=self._equations.bias)

    @cached_property
    def gravity(self) -> ca.Function:
        """Gradient of the weight's potential, equation (29)."""
        return self._function("gravity", "q u p", G=self._equations.gravity)

    @cached_property
    def elastic(self) -> ca.Function:
        """Gradient of the elastic energy, equation (32)."""
        return self._function("elastic", "q u p", K=self._equations.elastic[: self.n])

    @cached_property
    def damping(self) -> ca.Function:
        """Material damping and the paper's friction, equation (39)."""
        return self._function("damping", "q qd u p", D=self._equations.damping[: self.n])

    @cached_property
    def actuation(self) -> ca.Function:
        """Generalized forces of the tip moment or the tendons, equation (42)."""
        return self._function("actuation", "q u p", Q=self._equations.actuation[: self.n])

    @cached_property
    def external_force(self) -> ca.Function:
        """Generalized forces of the point loads, equation (41)."""
        return self._function("external_force", "q u w p", Q=self._equations.external_force)

    @cached_property
    def position(self) -> ca.Function:
        """World position of a section [m]."""
        return self._function("position", "q u s p", r=self._equations.section_position)

    @cached_property
    def orientation(self) -> ca.Function:
        """Angle from the world's axes to a section's [rad]; its tangent is (-sin, cos) of it."""
        return self._function("orientation", "q u s p", angle=self._equations.section_angle)

    @cached_property
    def jacobian(self) -> ca.Function:
        """Derivative of a section's world position with respect to q."""
        return self._function("jacobian", "q u s p", J=self._section_jacobian)

    @cached_property
    def jacobian_rate(self) -> ca.Function:
        """Time derivative of the Jacobian at constant input."""
        eq, jacobian = self._equations, self._section_jacobian
        rate = ca.jtimes(ca.vec(jacobian), eq.q, eq.qd)
        return self._function("jacobian_rate", "q qd u s p", Jd=ca.reshape(rate, 2, self.n))

    @cached_property
    def tip(self) -> ca.Function:
        """World position of the tip [m]."""
        return self._function("tip", "q u p", r=self._equations.tip_position)

    @cached_property
    def joints(self) -> ca.Function:
        """World position [m] and angle [rad] of the elements' end sections."""
        places = self._equations.joints
        r = ca.horzcat(*[at.column() for at, _ in places])
        return self._function("joints", "q u p", r=r, angle=[angle for _, angle in places])

    @property
    def waypoint_fractions(self) -> tuple[tuple[float, ...], ...]:
        """Per element, the fractions of its length where ``waypoints`` are."""
        return tuple(tuple(at for at, _ in link.link.waypoints) for link in self._equations.chain.links)

    @cached_property
    def waypoints(self) -> ca.Function:
        """World positions inside the elements, where they cost least [m]."""
        return self._function("waypoints", "q u p", r=ca.horzcat(*[at.column() for at in self._equations.waypoints]))

    def probes(self, count: int) -> ca.Function:
        """World positions (2, count * N) [m] at run-time fractions f (count, N) of the N elements' lengths.

        Parameters
        ----------
        count : int
            Places per element.

        Returns
        -------
        casadi.Function
            ``(q, u, f, p) -> r``.
        """
        eq = self._equations
        f = ca.SX.sym("f", count, len(self.lengths))
        r = ca.horzcat(*[at.column() for at in eq.inside(f)])
        return ca.Function("probes", [eq.q, eq.u, f, eq.p], self._at_command([r]), ["q", "u", "f", "p"], ["r"])

    def curvatures(self) -> ca.Function:
        """Curvature and bends of the elements.

        Returns
        -------
        casadi.Function
            ``(q, u, p) -> kappa, at, bend``: curvature (size) [1/m] that belongs to each coordinate of the family, the
            tip's included where it is none; curvature (degree + 1, N) [1/m] at the ``places`` of the N elements; the
            same times the elements' lengths [rad].
        """
        eq = self._equations
        at, bends = (matrix(list(zip(*rows, strict=True))) for rows in (eq.curvatures, eq.greatest_bends))
        return self._function("curvatures", "q u p", kappa=eq.curvature, at=at, bend=bends)

    @cached_property
    def energy(self) -> ca.Function:
        """Kinetic and potential energy [J]."""
        eq = self._equations
        return self._function("energy", "x u p", kinetic=eq.kinetic_energy, potential=eq.potential_energy)

    @cached_property
    def bending(self) -> ca.Function:
        """Bending angle of each element [rad]."""
        return self._function("bending", "q u p", bend=self._equations.bends)

    @cached_property
    def range_use(self) -> ca.Function:
        """Share of the declared bending range that each element uses; above 1 the series lose their accuracy."""
        return self._function("range_use", "q u p", use=self._equations.range_use)

    @cached_property
    def statics(self) -> ca.Function:
        """What is missing for equilibrium, and the tangent stiffness."""
        eq = self._equations
        missing = -column(eq.force_at_rest)
        return self._function("statics", "q u w p", Q=missing, K=ca.jacobian(missing, eq.q))

    @cached_property
    def _section_jacobian(self) -> ca.SX:
        return ca.horzcat(*[vector.column() for vector in self._equations.section_jacobian])


FUNCTIONS = function_names(FingerModel)
"""Names of a model's functions."""
