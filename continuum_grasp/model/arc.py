"""A circular arc as a flexible link: one local coordinate, its bending angle.

With v running along the arc from 0 to 1 and t(v) = (cos v theta, sin v theta), every integral that the chain needs is a
combination of Stumpff functions; the table of the project's design (section 2.2) and its derivatives give

    moments     J_j = int v^j t dv,        G_j = int (1 - v) v^j t dv           (j = 0, 1, 2)
    products    int Y_i . Y_j dv and int Y_i x Y_j dv  with  Y_j(v) = int_0^v s^j t(s) ds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

from continuum_grasp.model.link import Bias, Inertia, Link, Section
from continuum_grasp.model.planar import Rotation, Scalar, Vec, combine, minus, plus, times
from continuum_grasp.model.stumpff import stumpff

__all__ = ["Arc"]

WAYPOINTS = 8
"""Parts of an arc between which its waypoints lie."""


class Arc(Link):
    """A circular arc.

    Parameters
    ----------
    theta : float or casadi.SX
        Bending angle [rad].
    length : float or casadi.SX
        Length [m].
    linear_density, rotary_inertia : float or casadi.SX
        rho A [kg/m] and rho I [kg m].
    angle_range, accuracy : float
        Range of the bending angle and truncation error over it.
    """

    def __init__(
        self,
        theta: Scalar,
        length: Scalar,
        linear_density: Scalar,
        rotary_inertia: Scalar,
        angle_range: float,
        accuracy: float,
    ) -> None:
        self._theta = theta
        self._length = length
        self._linear_density = linear_density
        self._rotary_inertia = rotary_inertia
        self._angle_range = angle_range
        self._accuracy = accuracy
        self._c = stumpff(theta, angle_range, accuracy)

    @cached_property
    def end(self) -> Section:
        return Section(
            position=self._moment(0, self._length),
            rotation=Rotation(self._c[0], self._theta * self._c[1]),
            arms=(self._moment(1, self._length),),
            angles=(1.0,),
        )

    def section(self, fraction: Scalar) -> Section:
        if isinstance(fraction, float) and fraction == 1.0:
            return self.end
        part = self._part(fraction)
        return Section(
            position=part.end.position,
            rotation=part.end.rotation,
            arms=(part.end.arms[0].scaled(fraction),),
            angles=(fraction,),
        )

    @property
    def waypoints(self) -> tuple[tuple[float, Vec], ...]:
        return tuple((k / WAYPOINTS, self.section(k / WAYPOINTS).position) for k in range(1, WAYPOINTS))

    def section_bias(self, fraction: Scalar, omega: Scalar, rates: Sequence[Scalar]) -> Vec:
        if isinstance(fraction, float) and fraction == 1.0:
            return self._weighted(self._length, omega, rates[0], self._moment)
        return self._part(fraction).section_bias(1.0, omega, [times(fraction, rates[0])])

    def _part(self, fraction: Scalar) -> Arc:
        """The arc up to a fraction of its length."""
        return Arc(
            times(fraction, self._theta),
            times(fraction, self._length),
            self._linear_density,
            self._rotary_inertia,
            self._angle_range,
            self._accuracy,
        )

    @cached_property
    def inertia(self) -> Inertia:
        c = self._c
        mass = times(self._linear_density, self._length)
        per_length = times(mass, self._length)
        per_square = times(per_length, self._length)
        rotary = times(self._rotary_inertia, self._length)
        return Inertia(
            mass=mass,
            first=self._mean(0, per_length),
            second=plus(combine(per_square, [(2.0, c[3])]), rotary),
            arms=(self._mean(1, per_length),),
            swing=(plus(combine(per_square, [(1.0, c[3]), (-1.0, c[4])]), times(0.5, rotary)),),
            matrix=((plus(combine(per_square, [(2.0, c[4]), (-4.0, c[5])]), times(1.0 / 3.0, rotary)),),),
        )

    def bias(self, omega: Scalar, rates: Sequence[Scalar]) -> Bias:
        c, theta, rate = self._c, self._theta, rates[0]
        per_length = times(times(self._linear_density, self._length), self._length)
        per_square = times(times(per_length, self._length), theta)
        square = rate * rate
        y0y1 = combine(1.0, [(1.0, c[4]), (-3.0, c[5])])
        y0y2 = combine(1.0, [(1.0, c[4]), (-4.0, c[5]), (4.0, c[6])])
        y1y2 = combine(1.0, [(1.0, c[5]), (-6.0, c[6]), (10.0, c[7])])
        whirl, mixed = times(omega, omega), times(2.0, times(omega, rate))
        return Bias(
            end=self._weighted(self._length, omega, rate, self._moment),
            force=self._weighted(per_length, omega, rate, self._mean),
            moment=times(per_square, plus(times(mixed, y0y1), times(square, y0y2))),
            generalized=(times(per_square, minus(times(square, y1y2), times(whirl, y0y1))),),
        )

    def _weighted(self, scale: Scalar, omega: Scalar, rate: Scalar, moment: Callable[[int, Scalar], Vec]) -> Vec:
        """Integral of (omega + v rate)^2 t with the weights of a family of moments."""
        total = moment(2, 1.0).scaled(rate * rate)
        if not (isinstance(omega, float) and omega == 0.0):
            total = total + moment(1, 1.0).scaled(2.0 * (omega * rate)) + moment(0, 1.0).scaled(omega * omega)
        return total.scaled(scale)

    def _moment(self, j: int, scale: Scalar) -> Vec:
        """J_j times a scale."""
        c = self._c
        cosine = ([(1.0, c[1])], [(1.0, c[1]), (-1.0, c[2])], [(1.0, c[1]), (-2.0, c[2]), (2.0, c[3])])[j]
        sine = ([(1.0, c[2])], [(1.0, c[2]), (-1.0, c[3])], [(1.0, c[2]), (-2.0, c[3]), (2.0, c[4])])[j]
        return self._pair(scale, cosine, sine)

    def _mean(self, j: int, scale: Scalar) -> Vec:
        """G_j times a scale."""
        c = self._c
        cosine = ([(1.0, c[2])], [(1.0, c[2]), (-2.0, c[3])], [(1.0, c[2]), (-4.0, c[3]), (6.0, c[4])])[j]
        sine = ([(1.0, c[3])], [(1.0, c[3]), (-2.0, c[4])], [(1.0, c[3]), (-4.0, c[4]), (6.0, c[5])])[j]
        return self._pair(scale, cosine, sine)

    def _pair(self, scale: Scalar, cosine: list[tuple[float, Scalar]], sine: list[tuple[float, Scalar]]) -> Vec:
        return Vec(combine(scale, cosine), times(self._theta, combine(scale, sine)))
