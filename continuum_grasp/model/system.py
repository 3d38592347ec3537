"""A finger, and where there is one the object that it touches, as one system of equations of motion."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.errors import InputError
from continuum_grasp.model.chain import column
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.finger_model import FingerModel
from continuum_grasp.model.layout import place_at
from continuum_grasp.model.planar import Scalar, Vec
from continuum_grasp.scene.finger import Finger
from continuum_grasp.scene.simulate import Scene

__all__ = ["System"]


class System:
    """A finger as one system of equations of motion xd = f(x, u, w, p).

    All functions are SX functions of the whole state with named inputs and outputs; inputs that a system does not need
    are empty. Unlike those of ``FingerModel``, they take the tip moment that acts, which is in x where the tendons have
    a time constant, rather than the one that is commanded.

    Parameters
    ----------
    given : Scene or Finger
        What the system is made of.
    **keywords
        As of ``FingerModel``.

    Attributes
    ----------
    finger_model : FingerModel
    n, nx, nu, nw, np : int
        Numbers of bending coordinates, states, inputs, forces and parameters.
    x_names, u_names, w_names, p_names : list of str
        Name and unit of each entry.
    p_nominal : list of float
        Nominal values of ``p``.

    Notes
    -----
    ====================  =============  ================================================================
    function              inputs         outputs
    ====================  =============  ================================================================
    forward_dynamics      x, u, w, p     xd (nx) [x/s]
    linearization         x, u, w, p     A (nx, nx) [1/s x/x], B (nx, nu) [1/s x/u]
    tip                   x, u, p        r (2) [m], world
    bending               x, u, p        bend of each element [rad]
    curvature             x, u, p        kappa [1/m]: at the nodes of clothoids, one per arc
    range_use             x, u, p        use of the declared bending range, per element [1]
    energy                x, u, p        kinetic, potential [J]
    ====================  =============  ================================================================

    ``sections`` gives the function of places along the finger.

    Raises
    ------
    InputError
        If the pieces do not fit together.
    """

    def __init__(self, given: Scene | Finger, **keywords: Any) -> None:
        self.finger_model = FingerModel(given, **keywords)
        model, made = self.finger_model, self.finger_model.structure
        self._equations = Equations(made)
        self.n, self.nu, self.np = model.n, model.nu, model.np
        self.x_names = list(model.x_names)
        self.w_names = list(model.w_names)
        self.u_names, self.p_names, self.p_nominal = model.u_names, model.p_names, model.p_nominal
        self.nx, self.nw = len(self.x_names), len(self.w_names)

    def state(self, q: ArrayLike | None = None, qd: ArrayLike | None = None, u: ArrayLike | None = None) -> list[float]:
        """A state whose tendon lag is at rest.

        Parameters
        ----------
        q, qd : (n,) array_like, optional
            Bending coordinates and their rates; zero where not given.
        u : (nu,) array_like, optional
            Input that the lag has reached; zero where not given.

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
        x = [*bends, *rates]
        tendons = self.finger_model.finger.tendons
        if self.finger_model.structure.lagged and tendons is not None:
            x += [(inputs[0] - inputs[1]) * tendons.offset, 0.0]
        return x

    # -- functions -----------------------------------------------------------------------------------------------

    def _function(self, name: str, inputs: str, **outputs: Any) -> ca.Function:
        """A named function of space-separated inputs."""
        names = inputs.split()
        arguments = [getattr(self._equations, key) for key in names]
        return ca.Function(name, arguments, ca.cse([_dense(v) for v in outputs.values()]), names, list(outputs))

    @cached_property
    def forward_dynamics(self) -> ca.Function:
        """State derivative."""
        return self._function("forward_dynamics", "x u w p", xd=self._equations.state_rate)

    @cached_property
    def linearization(self) -> ca.Function:
        """Jacobians of the state derivative with respect to state and input."""
        eq = self._equations
        rate = column(eq.state_rate)
        return self._function("linearization", "x u w p", A=ca.jacobian(rate, eq.x), B=ca.jacobian(rate, eq.u))

    @cached_property
    def tip(self) -> ca.Function:
        """World position of the tip [m]."""
        return self._function("tip", "x u p", r=self._equations.tip_position)

    def sections(self, stations: Sequence[float]) -> ca.Function:
        """World positions r (2, K) [m] and angles (K) [rad] of the sections at positions along the finger [m].

        Parameters
        ----------
        stations : sequence of float
            K positions from the base [m]; with run-time element lengths they keep their share of an element.

        Returns
        -------
        casadi.Function
            ``(x, u, p) -> r, angle``; the tangent of a section is (-sin, cos) of its angle.

        Raises
        ------
        InputError
            If one is not on the finger.
        """
        eq, lengths = self._equations, self.finger_model.lengths
        found = [eq.section_at(place_at(at, lengths)) for at in stations]
        r = ca.horzcat(ca.SX(2, 0), *[at.column() for at, _ in found])
        return self._function("sections", "x u p", r=r, angle=[angle for _, angle in found])

    @cached_property
    def bending(self) -> ca.Function:
        """Bending angle of each element [rad]."""
        return self._function("bending", "x u p", bend=self._equations.bends)

    @cached_property
    def curvature(self) -> ca.Function:
        """Curvature [1/m]: at the nodes of clothoids from base to tip, or of each arc."""
        eq = self._equations
        arcs = self.finger_model.family == "arc"
        values = [q / h for q, h in zip(eq.full, eq.lengths, strict=True)] if arcs else eq.full
        return self._function("curvature", "x u p", kappa=values)

    @cached_property
    def range_use(self) -> ca.Function:
        """Share of the declared bending range that each element uses; above 1 the series lose their accuracy."""
        return self._function("range_use", "x u p", use=self._equations.range_use)

    @cached_property
    def energy(self) -> ca.Function:
        """Kinetic and potential energy [J]."""
        eq = self._equations
        return self._function("energy", "x u p", kinetic=eq.kinetic_energy, potential=eq.potential_energy)

    @cached_property
    def touch(self) -> ca.Function:
        """Contacts: none without an object."""
        names = ("gap", "normal_force", "friction", "lift")
        return self._function("touch", "x u w p", **{key: [] for key in names}, force=ca.SX(2, 0), point=ca.SX(2, 0))

    @property
    def touch_names(self) -> list[str]:
        """Names of the contacts."""
        return []


def _vector(name: str, value: ArrayLike | None, size: int) -> list[float]:
    array = np.zeros(size) if value is None else np.asarray(value, dtype=float).ravel()
    if array.size != size or not np.all(np.isfinite(array)):
        raise InputError(f"{name}: expected {size} finite entries, got {array.tolist()}", key=name)
    return [float(v) for v in array]


def _dense(value: ca.SX | Vec | Scalar | list[Scalar]) -> ca.SX:
    if isinstance(value, Vec):
        return value.column()
    if isinstance(value, list):
        return ca.densify(column(value))
    return ca.densify(ca.SX(value))
