"""A finger, and its object if there is one, as one system of equations of motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property, partial
from typing import Unpack

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, InputError, check_arguments
from continuum_grasp.model.contact_law import TouchLaw, touch_law_of
from continuum_grasp.model.contacts import CONTACT_FRICTION, OBJECT_PARAMETERS, Contacts
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.finger_model import FingerModel
from continuum_grasp.model.functions import Model, named
from continuum_grasp.model.layout import place_at
from continuum_grasp.model.parameters import ModelOptions
from continuum_grasp.model.planar import Vec, column
from continuum_grasp.model.stations import touching_nothing
from continuum_grasp.scene import Consumer, Finger, FingerScene, Surroundings

_ANY = " ".join(f"object_parameters={name}" for name in (*OBJECT_PARAMETERS, CONTACT_FRICTION))
_SHARE = f"object_parameters={CONTACT_FRICTION}"
_OF_FRICTION, _STATE = "needs contact_law.friction, of whose limit it is a share", "is in x, since the object moves"
_OF_OBJECTS = (
    Consumer.beside(_ANY, lambda s: s is None, "needs an object"),
    Consumer.beside(_SHARE, lambda s: not (s.contact_law and s.contact_law.friction), _OF_FRICTION),
    Consumer.beside("object_parameters=object_x object_parameters=object_y", lambda s: s.object_moves, _STATE),
    *Consumer.refusals("object_parameters=object_mass without object_moves: needs an object that moves"),
)


class System(Model):
    """A finger and, if any, the object that it touches, as one system xd = f(x, u, w, p).

    All functions are SX functions of the whole state with named inputs and outputs; inputs that a system does not need
    are empty. Unlike functions of ``FingerModel``, they take the tip moment that acts, which is in x where the tendons
    have a time constant, rather than the one that is commanded. Without an object the system is the finger,
    instruction by instruction. Further keywords are as in ``FingerModel``.

    Parameters
    ----------
    given : FingerScene or Finger
        Finger, or scene of one, to make the system of. A scene has its surroundings.
    surroundings : Surroundings, optional
        Object, supports and contact law; by default the scene's.
    object_parameters : sequence of str, optional
        Object parameters that stay run-time arguments, after the finger's in ``p``: ``object_mass`` [kg] of one that
        moves, ``friction_factor`` [1] of all its friction coefficients, ``object_x`` and ``object_y`` [m] of one that
        is fixed; ``contact_friction_1`` and so on, ``contact_friction_tip``: friction at a station as a share of its
        limit [1], as of ``touch``, which then follows no law.

    Attributes
    ----------
    finger_model : FingerModel
    n, nx, nu, nw, np : int
        Numbers of bending coordinates, states, inputs, forces and parameters.
    x_names, u_names, w_names, p_names : list of str
        Name and unit of each entry.
    p_nominal : list of float
        Nominal values of ``p``.
    touch_names : list of str
        Contacts that may occur: ``finger.1`` and so on at the stations ``contacts``, ``finger.tip``, then the
        supports by name (``<support>.1`` and so on per corner of a polygon, ``<edge>.start`` and ``<edge>.end``), then
        ``table``.

    Notes
    -----
    | function              | inputs            | outputs |
    |-----------------------|-------------------|---|
    | forward_dynamics      | x, u, w, p        | xd (nx) [x/s] |
    | linearization         | x, u, w, p        | A (nx, nx) [1/s x/x], B (nx, nu) [1/s x/u] |
    | tip                   | x, u, p           | r (2) [m], world |
    | bending               | x, u, p           | bend of each element [rad] |
    | curvature             | x, u, p           | kappa [1/m]: at the nodes of clothoids, one per arc |
    | range_use             | x, u, p           | use of the bending range, per element [1] |
    | touch                 | x, u, w, p        | gap [m], normal_force, friction, lift [N], force, point, normal |
    | slip                  | x, u, w, p        | speed [m/s] at which surfaces move along each other, (K)        |
    | energy                | x, u, p           | kinetic, potential [J] |
    | internal              | x, u, p           | M [Q s2/q], K [Q/q], D [Q s/q] (n, n): inertia, elasticity, damping |
    | pressed_linearization | x, u, w, p, press | A (nx, nx) with every gap smaller by press (K) [m] |

    ``touch`` has an entry per contact, (K); ``force`` [N], ``point`` [m] and ``normal`` are world, (2, K).
    ``pressed_linearization`` is for the stiffness of contacts that are open. ``sections`` gives the function of places
    along the finger.

    x = [x of the finger, then of an object that moves its pose x, y [m] and angle [rad] (of its frame, world), its
    height z [m] where gravity acts out of the plane, and their rates, then the friction states of each contact: the
    elastic displacement along the surface, and out of the plane, as a share of that at which it slips]. w = [w of the
    finger, then world force [N] and moment about the center of mass [N m] on an object that moves, then the height of
    the table under it [m]].

    A station of the finger is a disc of the finger's half thickness round its center line. ``friction`` acts on what
    touches the object, along the object's outward normal turned by +90 degrees; ``lift`` and ``force`` act on the
    object. The force on the finger is the opposite one and acts at the same ``point`` on the finger's surface, so its
    couple about the center line bends the finger too. At the tip of ``matched_clothoid`` that couple is left out (the
    tip's curvature would depend on itself), and with it the turning of the tip in its velocity of slip, so that no
    power appears. Supports touch the object only, not the finger; elements touch at their stations only.

    Raises
    ------
    InputError
        If the pieces do not fit together.

    Examples
    --------
    >>> from continuum_grasp import System
    >>> from continuum_grasp.scene import Circle, ContactLaw, Finger, Rod, Surroundings
    >>> finger = Finger(rod=Rod(length=0.6, linear_density=0.02, bending_stiffness=0.05), half_thickness=0.002)
    >>> disc = Circle(shape="circle", diameter=0.06, mass=0.1, position=(0.04, 0.6))
    >>> around = Surroundings(object=disc, contact_law=ContactLaw(stiffness=900.0, friction=0.5))
    >>> system = System(finger, surroundings=around, family="arc", elements=2)
    >>> system.touch_names
    ['finger.tip']
    >>> gap, *_ = system.touch(system.state(), [0.0], [0.0, 0.0], [])
    >>> gap
    DM(0.008)
    """

    @check_arguments
    def __init__(
        self,
        given: FingerScene | Finger,
        *,
        surroundings: Surroundings | None = None,
        object_parameters: Sequence[str] = (),
        **options: Unpack[ModelOptions],
    ) -> None:
        self._asked = given, surroundings, object_parameters, options
        self.finger_model = model = FingerModel(given, **options)
        if surroundings is None and isinstance(given, Surroundings):
            surroundings = given
        self.surroundings = around = surroundings if surroundings is not None and surroundings.object else None
        self.object_parameters = self._checked(object_parameters)
        values = {"friction_factor": 1.0}
        if around is not None and around.object is not None:
            x, y = around.object.position
            values |= {"object_mass": around.object.mass, "object_x": x, "object_y": y}
        more = {name: (OBJECT_PARAMETERS.get(name, "1"), values.get(name, 0.0)) for name in self.object_parameters}
        touches = touching_nothing if around is None else partial(Contacts, around, rod=model.finger.rod)
        super().__init__(model.structure.beside(touches, more))
        self.touch_names = [pair.name for pair in self._equations.contacts.pairs]

    def reaching(self, bends: Sequence[float]) -> System:
        """Return a system of the same finger for greater bends (elements,) [rad]; see ``FingerModel.reaching``."""
        given, surroundings, object_parameters, options = self._asked
        reached = self.finger_model.reaching(bends).ranges
        changed: ModelOptions = {**options, "reached": reached}
        return System(given, surroundings=surroundings, object_parameters=object_parameters, **changed)

    @property
    def touch_law(self) -> TouchLaw | None:
        """Law of the contacts; None without contacts that follow a law."""
        law = None if self.surroundings is None else self.surroundings.contact_law
        return None if law is None else touch_law_of(law, self.finger_model.finger.rod)

    @property
    def greatest_press(self) -> float:
        """Return the greatest normal force of a contact [N]: twice the force of drives and weight at rest, as under a
        sudden load.
        """
        model, around = self.finger_model, self.surroundings
        rod, tendons = model.finger.rod, model.finger.tendon_list
        moments = [tendon.greatest_offset * tendon.max_tension for tendon in tendons]
        moment = max(moments, default=rod.stiffness * max(model.ranges) / rod.length)
        weight = 0.0
        if around is not None and around.object is not None and around.object_moves:
            weight = around.object.mass * math.hypot(
                *model.structure.parameters.nominal_of("gravity"), around.out_of_plane_gravity
            )
        return 2.0 * (moment / min((*model.contacts, rod.length)) + weight)

    def _checked(self, names: Sequence[str]) -> tuple[str, ...]:
        around = self.surroundings
        stations = [f"{k + 1}" for k in range(len(self.finger_model.contacts))]
        known = [*OBJECT_PARAMETERS, *map(Contacts.friction_parameter, (*stations, "tip"))]
        for k, name in enumerate(names):
            key = f"object_parameters[{k}]"
            if name not in known or name in names[:k]:
                raise InputError(f"expected each of {', '.join(known)} once at most, got {name!r:.60}", key=key)
            kind = CONTACT_FRICTION if name.startswith(CONTACT_FRICTION) else name
            for feature in _OF_OBJECTS:
                feature.check(around, of={f"object_parameters={kind}": key})
        return tuple(names)

    @property
    def object_states(self) -> slice:
        """Slice of x with the object's pose: x, y, angle, and z if it can slide out of the plane; empty if fixed."""
        return slice(self.finger_model.nx, self.finger_model.nx + len(self._equations.contacts.start))

    @property
    def friction_states(self) -> slice:
        """Slice of x with the friction states."""
        return slice(self.finger_model.nx + 2 * (self.object_states.stop - self.object_states.start), self.nx)

    def state(
        self,
        q: ArrayLike | None = None,
        qd: ArrayLike | None = None,
        u: ArrayLike | None = None,
        pose: ArrayLike | None = None,
        friction: ArrayLike | None = None,
        pulled: float | None = None,
    ) -> list[float]:
        """A state whose drives and object are at rest and whose contacts have no friction yet.

        Parameters
        ----------
        q, qd : (n,) array_like, optional
            Bending coordinates and their rates; by default zero.
        u : (nu,) array_like, optional
            Input that the drives have reached; by default zero.
        pose : array_like, optional
            Pose of a moving object: x, y [m], angle [rad] (and z [m]); by default, its pose in the surroundings.
        friction : array_like, optional
            Friction states of the tendons, one per cell; by default zero.
        pulled : float, optional
            Winches are not where u leaves them, but where (the first of) their tendons have this tension [N].

        Returns
        -------
        list of float
            (nx)

        Raises
        ------
        InputError
            If something has the wrong size.
        """
        bends, rates, inputs = (_vector(*v) for v in (("q", q, self.n), ("qd", qd, self.n), ("u", u, self.nu)))
        cells = _vector("friction", friction, self.finger_model.structure.friction_states)
        x = [*bends, *rates, *self.finger_model.drives_at(bends, inputs, cells, pulled=pulled), *cells]
        start = self._equations.contacts.start
        if pose is not None:
            coordinates = np.asarray(pose, dtype=float).ravel()
            start = _vector("pose", np.append(coordinates, start[coordinates.size :]), len(start))
        return [*x, *start, *[0.0] * (self.nx - len(x) - len(start))]

    def spring_frequency(self, closing: Array) -> float:
        """Return the fastest oscillation on the springs of contacts [rad/s]; infinite if numbers are not finite.

        ``closing`` is the Jacobian with closed contacts minus the one with open contacts; the finger's own stiffness
        cancels.
        """
        n, pose = self.n, self.object_states
        accelerations = np.r_[n : 2 * n, pose.stop : pose.stop + pose.stop - pose.start]
        slope = closing[np.ix_(accelerations, np.r_[0:n, pose])]
        if not np.all(np.isfinite(slope)):
            return math.inf
        return math.sqrt(max(0.0, float(np.abs(np.linalg.eigvals(slope)).max(initial=0.0))))

    @cached_property
    def pressed_linearization(self) -> ca.Function:
        """Jacobian A of the state derivative as if the gaps were smaller by ``press`` (K) [m]."""
        eq = Equations(self.structure, pressed=True)
        slope = ca.densify(ca.jacobian(column(eq.state_rate), eq.x))
        names = ["x", "u", "w", "p", "press"]
        return ca.Function("pressed_linearization", [getattr(eq, name) for name in names], [slope], names, ["A"])

    tip = named("x u p", r=lambda eq: eq.tip_position)
    bending = named("x u p", bend=lambda eq: eq.bends)
    curvature = named("x u p", kappa=lambda eq: eq.curvature)
    range_use = named("x u p", use=lambda eq: eq.range_use)

    def sections(self, stations: Sequence[float]) -> ca.Function:
        """``(x, u, p) -> r, angle``: world positions (2, K) [m] and angles (K) [rad] of sections.

        Stations are K positions from the base [m], which must be on the finger; with run-time element lengths they keep
        their share of an element. The tangent of a section is (-sin, cos) of its angle.
        """
        eq, lengths = self._equations, self.finger_model.lengths
        sections = [eq.section_at(place_at(at, lengths)) for at in stations]
        r, angles = Vec.columns(at for at, _ in sections), [angle for _, angle in sections]
        return self._function("sections", "x u p", r=r, angle=angles)

    def section_velocities(self, stations: Sequence[float]) -> ca.Function:
        """``(x, u, p) -> v, spin``: world velocities (2, K) [m/s] and turning rates (K) [rad/s] of sections.

        Stations are as in ``sections``. For a matched tip without rates of its input, the moment is constant.
        """
        eq, lengths = self._equations, self.finger_model.lengths
        velocities = [eq.section_velocity(place_at(at, lengths)) for at in stations]
        v, spin = Vec.columns(velocity for velocity, _ in velocities), [spin for _, spin in velocities]
        return self._function("section_velocities", "x u p", v=v, spin=spin)

    touch = named(
        "x u w p",
        gap=lambda eq: [pair.gap for pair in eq.contacts.pairs],
        normal_force=lambda eq: [pair.normal_force for pair in eq.contacts.pairs],
        friction=lambda eq: [pair.tangential for pair in eq.contacts.pairs],
        lift=lambda eq: [pair.lift for pair in eq.contacts.pairs],
        # The finger or support bears ``pair.force``, and the object bears the reaction.
        force=lambda eq: Vec.columns(pair.force.scaled(-1.0) for pair in eq.contacts.pairs),
        point=lambda eq: Vec.columns(pair.point for pair in eq.contacts.pairs),
        normal=lambda eq: Vec.columns(pair.normal for pair in eq.contacts.pairs),
    )
    slip = named("x u w p", speed=lambda eq: [pair.slip_speed for pair in eq.contacts.pairs])


def _vector(name: str, value: ArrayLike | None, size: int) -> list[float]:
    array = np.zeros(size) if value is None else np.asarray(value, dtype=float).ravel()
    if array.size != size or not np.all(np.isfinite(array)):
        raise InputError(f"{name}: expected {size} finite entries, got {array.tolist()}", key=name)
    return [float(v) for v in array]
