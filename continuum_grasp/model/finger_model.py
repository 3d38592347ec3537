"""The finger as named CasADi functions."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from typing import Any, Unpack

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from continuum_grasp.base import Array, InputError, check_arguments
from continuum_grasp.model.functions import Model, named
from continuum_grasp.model.memory import Memory
from continuum_grasp.model.parameters import ModelOptions
from continuum_grasp.model.planar import column, matrix
from continuum_grasp.model.structure import Structure
from continuum_grasp.scene import Fidelity, Finger, FingerScene


class FingerModel(Model):
    """A planar continuum finger, written once as CasADi functions.

    The motion obeys ``M qdd + bias + gravity + elastic + damping = actuation + external_force``. All functions are SX
    functions with named inputs and outputs; inputs that a model does not need are empty. World vectors are in the
    scene's axes; positive bending turns counter-clockwise, towards the base's -X axis.

    Parameters
    ----------
    finger : FingerScene or Finger
        A scene of one finger (a `Scene`, the scene of a closed loop or of a plan) supplies finger, contacts, gravity,
        fidelity, parameters and loads; a keyword overrides it.
    contacts : sequence of float, optional
        Positions along the finger where contact forces may act [m]; element boundaries.
    gravity : (2,) sequence, optional
        World gravity [m/s2]; (0, -9.81) for a bare finger; zero leaves the weight out.
    family : str, optional
        Curvature family: ``arc``, ``clothoid`` or ``matched_clothoid``. Default: ``matched_clothoid`` for a scene, and
        for a bare finger whose tendons have a time constant or whose ``input_rates`` are given; ``clothoid`` for other
        bare fingers, whose tip moment may vary, with tendon friction or quadratic damping, if a moment of the scene on
        the tip varies in time, or if the moments at time zero do not fit the initial pose.
    elements : int or sequence of float, optional
        Number of elements, or their lengths [m]; a number is shared out by the length of bending waves, evenly on a
        uniform rod. Default: two, or one per segment between contacts and jumps of rest curvature, stiffness or density
        if that is more; with stops enough, up to 16, that each bends by at most one turn when links touch.
    bending_range : float, optional
        Greatest bend of an element [rad] (for clothoids: its length times its greatest curvature), including the bend
        at rest. Default: 2 pi / 3; less if more than four elements share 8 pi / 3, or if the strain limit allows less;
        with stops at least 1.5 times the bend at which links touch. At least half of this range remains beyond the
        shape at rest.
    reached : sequence of float, optional
        Bends [rad] that each element must cover at least; see ``reaching``.
    accuracy : float, optional
        Relative accuracy of the evaluation over the bending range; sets Horner terms and quadrature nodes.
    parameters : sequence of str, optional
        Parameters that stay run-time arguments (``p``); all others are folded into the code. For a graded rod
        stiffness, density and rotary inertia are factors, nominally 1. With run-time
        ``element_lengths`` masses and loads inside an element keep their share of its length.
    loads : sequence of ForceLoad and MomentLoad, optional
        Places of loads; their values are entries of ``w`` (of ``u`` for moments on the tip, which act like the tip
        moment).
    tip_force : bool, optional
        Whether a force acts at the tip; for a scene, where it has contacts.
    input_rates : bool, optional
        Whether ``u`` is [values, rates, accelerations] of the inputs, for ``matched_clothoid`` alone. Its tip moves
        with the tip moment, so a varying moment needs them. Default: True if a moment on the tip varies, or an input of
        the scene without a time constant, which would supply the rates. Without rates the moment counts as constant
        throughout the motion: ``Core.rollout`` refuses a varying moment, but no function can detect one between calls.
        Dropping the rates of a ramp of 0.05 N m in 0.2 s costs 8.9 mm r.m.s. on a rod of 0.6 m, where two elements with
        rates have 0.14 mm and free clothoids 0.09 mm.
    slack_stiffness : float, optional
        Share of their stiffness [1] that tendons of drives keep while they are slack, by default none: for solvers that
        use only derivatives, on which a slack tendon has no effect.

    Attributes
    ----------
    family : str
    lengths : tuple of float
        Element lengths [m].
    ranges : tuple of float
        Greatest bend [rad] that each element covers, including the bend at rest.
    n, nx, nu, nw, np : int
        Numbers of coordinates q, states x, inputs u, force components w and parameters p.
    q_names, x_names, u_names, w_names, p_names : list of str
        Name and unit of each entry.
    p_nominal : list of float
        Nominal values of ``p``.
    friction_names : list of str
        The last of ``x_names``: states of tendon friction, and of dry friction in bending.
    load_entries : list of (str, int)
        Per load, the vector ("u" or "w") and the index at which its value begins.

    Notes
    -----
    | function         | inputs              | outputs |
    |------------------|---------------------|---|
    | forward_dynamics | x, u, w, p          | xd (nx) [x/s] |
    | inverse_dynamics | q, qd, qdd, u, w, p (, history) | Q (n) [Q], the generalized force that is missing |
    | mass_matrix      | q, u, p             | M (n, n) [Q s2/q] |
    | bias             | q, qd, u, p         | b (n) [Q], velocity products |
    | gravity          | q, u, p             | G (n) [Q], gradient of the weight's potential |
    | elastic          | q, u, p             | K (n) [Q], gradient of the elastic energy |
    | damping          | q, qd, u, p         | D (n) [Q] |
    | actuation        | q, u, p (, history) | Q (n) [Q] |
    | external_force   | q, u, w, p          | Q (n) [Q] |
    | position         | q, u, s, p          | r (2) [m], world, of the section at s [m] |
    | orientation      | q, u, s, p          | angle [rad] from the world's to the section's axes |
    | jacobian         | q, u, s, p          | J (2, n) [m/q], world |
    | jacobian_rate    | q, qd, u, s, p      | Jd (2, n) [m/(q s)], world |
    | tip              | q, u, p             | r (2) [m], world |
    | joints           | q, u, p             | r (2, N) [m], world, angle (N) [rad], of the elements' end sections |
    | energy           | x, u, p             | kinetic, potential [J] |
    | bending          | q, u, p             | bend of each element [rad] |
    | range_use        | q, u, p             | use of the bending range, per element [1] |
    | internal         | x, u, p             | M, K, D (n, n): inertia, elasticity, damping [Q s2/q, Q/q, Q s/q] |
    | statics          | q, u, w, p (, history) | Q (n) [Q], K (n, n) [Q/q]: missing for equilibrium, and dQ/dq |
    | linearization    | x, u, w, p          | A (nx, nx) [1/s x/x], B (nx, nu) [1/s x/u] |

    Units follow the coordinates. Arcs: q are bending angles [rad], so generalized forces [Q] are in N m, M in kg m2,
    J in m and tangent stiffness in N m. Clothoids: q are curvatures at the nodes [1/m], so [Q] is N m2, M in kg m4, J
    in m2 and tangent stiffness in N m3. All count from the shape at rest; where the stiffness jumps at a node, q is the
    curvature of the base side. ``q_names``, ``x_names``, ``u_names``, ``w_names`` and ``p_names`` have the unit of
    every entry.

    x = [q, qd], and [q, qd, tip moment, its rate] where the tendons have a time constant (moment and rate per shape
    that tendons bend, tension and rate per tendon where they have friction); the functions of q then take what u
    commands. Friction states of the tendons follow, from base to tip, first the state of a conduit: +1 where the
    tendons on the -X side slide towards the base. Then the states of dry friction in bending, cell by cell with one
    per branch: +1 where it slides towards positive curvature. Functions of q then take a ``history``. [friction
    states, 1]: states become z = clip(state + slid), with ``slid`` from `sliding`, and friction acts as S = z (3 - z^2)
    / 2 for tendons, and as z in bending; zero states mean a finger that was bent from its unloaded shape. [directions,
    0]: friction is constant; all zero for no friction, S of the states of a motion, whose drives then rest under u. u =
    tensions, or the tip moment, then the moments of loads on the tip and of those with ``input``. w = world forces at
    the contacts, then at the tip (if any), then the loads.
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

    @check_arguments
    def __init__(self, finger: FingerScene | Finger, **options: Unpack[ModelOptions]) -> None:
        super().__init__(made := Structure(finger, options))
        self.finger = made.finger
        self.family = made.family_name
        self.contacts = made.contacts
        self.loads = made.loads
        self.load_entries = made.load_entries
        self.lengths = made.lengths
        self.ranges = made.ranges
        self.q_names, self.friction_names = made.q_names, made.friction_names

    def headline(self) -> str:
        """The model's elements."""
        return f"of {len(self.lengths)} x {self.family}, {self.finger.rod.length:g} m long"

    # Equation numbers are those of the paper, doi:10.1155/2014/308283.
    inverse_dynamics = named(
        "q qd qdd u w p",
        Q=lambda eq: ca.mtimes(matrix(eq.mass_matrix), eq.qdd) - column(eq.net_force(eq.at_rest(eq.full_rates))),
        history=True,
    )
    mass_matrix = named("q u p", M=lambda eq: matrix(eq.mass_matrix))  # (37)
    bias = named("q qd u p", b=lambda eq: eq.bias)  # (38)
    gravity = named("q u p", G=lambda eq: eq.gravity)  # (29)
    elastic = named("q u p", K=lambda eq: eq.elastic[: eq.q.numel()])  # (32)
    damping = named("q qd u p", D=lambda eq: eq.damping[: eq.q.numel()])  # (39), and of the material
    actuation = named("q u p", Q=lambda eq: eq.resting.actuation[: eq.q.numel()], history=True)  # (42)
    external_force = named("q u w p", Q=lambda eq: eq.external_force)  # (41)
    position = named("q u s p", r=lambda eq: eq.section_position)
    orientation = named("q u s p", angle=lambda eq: eq.section_angle)
    jacobian = named("q u s p", J=lambda eq: eq.section_jacobian)
    # At constant input: what a moving matched tip adds is not a product with qd.
    jacobian_rate = named(
        "q qd u s p",
        Jd=lambda eq: ca.reshape(ca.jtimes(ca.vec(eq.section_jacobian), eq.q, eq.qd), *eq.section_jacobian.shape),
    )
    tip = named("q u p", r=lambda eq: eq.tip_position)
    joints = named(
        "q u p",
        r=lambda eq: ca.horzcat(*[at.column() for at, _ in eq.joints]),
        angle=lambda eq: [angle for _, angle in eq.joints],
    )
    bending = named("q u p", bend=lambda eq: eq.bends)
    range_use = named("q u p", use=lambda eq: eq.range_use)
    _full_coordinates = named("q u p", full=lambda eq: eq.full)

    statics = named(
        "q u w p",
        Q=lambda eq: -column(eq.force_at_rest),
        K=lambda eq: ca.jacobian(-column(eq.force_at_rest), eq.q),
        history=True,
    )
    _drives_at_rest = named("q u p", lag=lambda eq: eq.drives_of(eq.resting), history=True)
    _drives_drawn = named("q u pulled p", lag=lambda eq: eq.drives_of(eq.at_rest(drawn=True)), history=True)
    _tensions = named(
        "x u p",
        tensions=lambda eq: list(eq.moving.tendons.tensions),
        along=lambda eq: [tension for tensions in eq.moving.tendons.along for tension in tensions],
    )
    _tensions_at_rest = named("q u p", tensions=lambda eq: list(eq.resting.tendons.tensions), history=True)
    _sliding = named("q u p", slid=lambda eq: eq.resting.travel)

    def drives_at(
        self,
        q: ArrayLike,
        u: ArrayLike,
        friction_states: ArrayLike = (),
        *,
        pulled: float | None = None,
        p: ArrayLike | None = None,
    ) -> list[float]:
        """States of lags, winches and motors of a finger at rest in a shape q (n,) under an input u (nu,).

        ``pulled``: winches not where u leaves them, but where (the first of) their tendons have this tension [N].
        Parameters p are nominal where not given.
        """
        states = np.zeros(len(self.friction_names))
        if np.size(friction_states):
            states[:] = np.ravel(friction_states)
        of, arguments = (self._drives_at_rest, [q, u]) if pulled is None else (self._drives_drawn, [q, u, pulled])
        arguments.append(self.p_nominal if p is None else p)
        if states.size:
            arguments.append(np.append(states, 0.0))
        return [float(v) for v in np.array(of(*[np.asarray(v, dtype=float) for v in arguments])).ravel()]

    def drives_at_rest(self) -> ca.Function:
        """``(q, u, p (, history)) -> lag``: states of lags, winches and motors, as `drives_at` gives them."""
        return self._drives_at_rest

    def stiffness_of_drives(self) -> ca.Function:
        """``(x, u, w, p) -> K, D, inertia, passive``: small motions of a finger with winches, at rest.

        K (n + m, n + m) belongs to the bending coordinates and the angles of motors, with friction as it acts; D (m, m)
        and inertia (m) [kg m2] belong to these angles, without dry friction. ``passive`` (n, n) is K of the bending
        coordinates without tendons.
        """
        eq = self._equations
        angles, rates, torques, inertias = ([motor[k] for motor in eq.moving.tendons.motors] for k in range(4))
        places, force = ca.vertcat(eq.q, *angles), column([*eq.net_force(eq.moving), *torques])
        return self._function(
            "stiffness_of_drives",
            "x u w p",
            K=-_slope(force, places),
            D=-_slope(column(torques), ca.vertcat(*rates)),
            inertia=inertias,
            passive=-_slope(column(eq.net_force(eq.moving, driven=False)), eq.q),
        )

    def acting_input(self, x: Any, u: Any, p: Any = None) -> Any:
        """Inputs that act on shapes, of states and commands as columns, numbers or expressions.

        Lagging inputs are states, which stand in for the commands in u. Parameters ``p`` are nominal where not given.
        """
        acting, made = copy(u), self.structure
        for source, place in made.lagging:
            # Any tensions with the lagged moment give the same shape: all of it in the first of the channel.
            pulling = np.flatnonzero(source.arms).tolist()
            acting[pulling] = 0.0
            arm: Any = 1.0 if source.tendon is not None else source.arms[pulling[0]]
            of_a_pair = source.tendon is None and not source.chamber
            if p is not None and of_a_pair and made.parameters.is_runtime("tendon_offset"):
                arm = p[self.p_names.index("tendon_offset [m]")]  # its first tendon has it
            acting[pulling[0]] = x[place] / arm
        return acting

    def sample_shapes(self, start: ArrayLike | None = None) -> Array:
        """Shapes (14, n) at which motions may be fastest: the start, or straight; straight; some over half the range.

        They are the same whenever they are asked for.
        """
        reach, straight = np.array(self.structure.coordinate_limits()), np.zeros(self.n)
        # Seeded: a scene always gets the same step.
        # 12: random shapes at which the spectral radius is taken, beside the start and the straight finger
        spread = np.random.default_rng(0).uniform(-0.5, 0.5, (12, self.n)) * reach
        return np.vstack([straight if start is None else start, straight, spread])

    def limit_warnings(self, use: Array, t: ArrayLike | None = None) -> tuple[str, ...]:
        """Warn of bends beyond the ranges and strains beyond the limit.

        ``use`` (T, elements) is the share of its bending range that each element uses, at instants (T,) [s] of a
        motion.
        """
        limit, warnings = self.finger.curvature_limit, []

        def first(beyond: NDArray[np.intp]) -> str:
            return "" if t is None else f" at t = {np.asarray(t)[beyond[0]]:g} s"

        for k, (reach, length) in enumerate(zip(self.ranges, self.lengths, strict=True)):
            curvature = use[:, k] * (reach / length)
            strained, beyond = np.flatnonzero(curvature > limit * (1 + 1e-9)), np.flatnonzero(use[:, k] > 1.0)
            if strained.size:
                warnings.append(
                    f"element {k + 1} exceeds the strain limit{first(strained)} "
                    f"(greatest: {curvature.max() / limit:.2f} times the limit; the model is accurate for less)"
                )
            if beyond.size and reach < limit * length * (1 - 1e-9):
                warnings.append(
                    f"element {k + 1} is bent beyond its range of {reach:.3g} rad{first(beyond)} (greatest: "
                    f"{use[:, k].max():.2f} times the range), where the model loses accuracy: use more elements"
                )
        return tuple(warnings)

    def tensions(self) -> ca.Function:
        """``(x, u, p) -> tensions, along``: of each tendon at its drive [N], and at its `tension_places`.

        Only for fingers with tendon friction or winches.

        Raises
        ------
        InputError
            For others, whose tensions are inputs.
        """
        if not self.structure.own_tendons:
            raise InputError("the tensions of this finger are its inputs: read them there", key="tensions")
        return self._tensions

    def tensions_at_rest(self) -> ca.Function:
        """``(q, u, p (, history)) -> tensions`` at the drives of a finger at rest [N]; of the fingers of `tensions`."""
        self.tensions()  # raises where they are inputs
        return self._tensions_at_rest

    def tension_places(self) -> list[NDArray[np.float64]]:
        """Places of the tensions along the finger, per tendon [m]: in the middle of friction cells, or where it
        ends.
        """
        ends = [self.structure.length if t.to is None else t.to for t in self.finger.tendon_list]
        places = [np.array([end]) for end in ends]
        for cells in self.structure.cell_sets:
            lengths = np.array([cell.length for cell in cells.cells])
            for tendon in cells.tendons:
                places[tendon] = np.cumsum(lengths) - 0.5 * lengths
        return places

    def sliding(self) -> ca.Function:
        """``(q, u, p) -> slid``: the sliding since the unloaded shape that moves friction states [1].

        An entry per state: how far tendons have slid, per presliding, positive towards the base on the -X
        side; of dry friction in bending the curvature above rest, per that at which the branch slides.
        """
        return self._sliding

    def with_accuracy(self, accuracy: float) -> FingerModel:
        """Model of the same finger, evaluated with another accuracy."""
        finger, options = self.structure.asked
        changed: ModelOptions = {**options, "accuracy": accuracy}
        return FingerModel(finger, **changed)

    def reaching(self, bends: ArrayLike) -> FingerModel:
        """Return a model of the same finger, with the same coordinates, for greater bends.

        Parameters
        ----------
        bends : (elements,) array_like
            Greatest bend of each element [rad], including the bend at rest; no range shrinks, and none exceeds 40 rad.

        Examples
        --------
        >>> import continuum_grasp as cg
        >>> finger = cg.Finger(rod=cg.Rod(length=0.18, linear_density=0.02, bending_stiffness=0.01))
        >>> model = cg.FingerModel(finger, family="arc", elements=2)
        >>> model.reaching([9.0, 0.0]).ranges == (9.0, model.ranges[1])
        True
        """
        # Round up to the next hundredth: elements with similar bends share code.
        rounded = np.minimum(np.ceil(100.0 * np.asarray(bends, dtype=float)) / 100.0, Fidelity.WIDEST)
        reached = np.where(np.asarray(bends) > self.ranges, rounded, self.ranges)
        finger, options = self.structure.asked
        changed: ModelOptions = {**options, "reached": reached.tolist()}
        return FingerModel(finger, **changed)

    def slid(self, q: Array, u: Array, p: Array) -> Array:
        """Values of `sliding` (states,) in a shape at rest."""
        return np.array(self.sliding()(q, u, p)).ravel()

    def friction_history(
        self,
        q: Array,
        u: Array,
        p: Array,
        reached_by: str | None = None,
        friction_states: ArrayLike | None = None,
        path: Sequence[object] = (),
    ) -> Array:
        """Return friction in a stated shape q (n,) from its history, as an argument of the model's functions: [states,
        h].

        The finger was bent there from its unloaded shape, or back from a greater bend. Empty without friction; without
        a stated history nothing has slid. InputError for a ``path`` of inputs, which ends in an equilibrium.
        """
        if path:
            raise InputError("a path of inputs ends in an equilibrium: state no coordinates", key="initial.path")
        count = len(self.friction_names)
        history = np.zeros(count + bool(count))
        if count and reached_by == "state":
            history[:count] = friction_states
        elif reached_by == "pulling":
            # From the unloaded shape: states equal the sliding and bending, mostly at an end of their range.
            history[count:] = 1.0
        elif count and reached_by == "releasing":
            # A stop that was at 1 far out is at -1 once it slid back by twice its range, however little is left of
            # what it slid. Where nothing slid at all, nothing says from which side.
            sliding = self.slid(q, u, p)
            # 1e-6: sliding per its range that is none: far above rounding
            history[:count] = np.where(np.abs(sliding) > 1e-6, -np.sign(sliding), 0.0)
        return history

    def friction_after(self, q: Array, u: Array, p: Array, history: Array) -> Array:
        """Direction of friction in a shape, per friction state, by its history (states + 1,) or none."""
        return self._directions(self.friction_states_after(q, u, p, history))

    def _directions(self, states: Array) -> Array:
        """Direction of friction, per friction state within its range."""
        count = self.structure.tendon_friction_states
        return np.concatenate([Memory.eased(states[:count]), states[count:]])

    def friction_states_after(self, q: Array, u: Array, p: Array, history: Array) -> Array:
        """Friction states in a shape, as in a motion and within their range, by its history (states + 1,) or none."""
        if not history.size:
            return np.zeros(0)
        *states, moved = self.history_of_states(history)
        return np.asarray(np.clip(states + moved * self.slid(q, u, p), -1.0, 1.0))

    def history_of_states(self, history: Array) -> Array:
        """Return a history (states + 1,) with the friction states of a motion in place of constant directions."""
        converted = history.copy()
        if history.size and history[-1] == 0.0:
            count = self.structure.tendon_friction_states
            converted[:count] = Memory.state_of(np.clip(history[:count], -1.0, 1.0))
        return converted

    def friction_in(self, x: Array) -> Array:
        """Return the direction of friction in a state x (nx,) of a motion, per friction state, from -1 to 1."""
        return self._directions(np.clip(x[self.nx - len(self.friction_names) :], -1.0, 1.0))

    def full_coordinates(self, q: ArrayLike, u: ArrayLike, p: ArrayLike | None = None) -> Array:
        """Return the coordinates of the family (size,) in a shape q (n,) under an input u (nu,), the known ones last.

        Parameters p are nominal by default.
        """
        arguments = (np.asarray(values, dtype=float) for values in (q, u, self.p_nominal if p is None else p))
        return np.array(self._full_coordinates(*arguments)).ravel()

    def curvatures(self) -> ca.Function:
        """``(q, u, p) -> kappa, at, bend``: curvature and bends of the N elements.

        kappa (size) [1/m] belongs to each coordinate of the family, the tip's included where it is none; at
        (degree + 1, N) [1/m] are curvatures at the ``places`` of the elements; bend is the same times lengths [rad].
        """
        eq = self._equations
        at, bends = (matrix(list(zip(*rows, strict=True))) for rows in (eq.curvatures, eq.greatest_bends))
        return self._function("curvatures", "q u p", kappa=eq.curvature, at=at, bend=bends)


def _slope(values: ca.SX, symbols: ca.SX) -> ca.SX:
    """Jacobian with respect to symbols."""
    return ca.SX(values.numel(), 0) if symbols.numel() == 0 else ca.jacobian(values, symbols)
