"""Kinematics and dynamics of the finger by quadrature, from r(s) = integral of (-sin, cos) of the angle."""

from __future__ import annotations

from collections.abc import Sequence

from tests.truth.finger import TruthFinger, rest_of, shapes
from tests.truth.quadrature import NODES, ctx, gauss


class Rod:
    """One finger in one state.

    Parameters
    ----------
    finger : TruthFinger
    q, qd : sequences of ``finger.unknowns`` numbers
        ``qd`` may be left out (rest).
    tip : (curvature, its rate, its acceleration)
        The prescribed last nodal curvature of the "matched_clothoid" family [1/m, 1/(m s), 1/(m s2)].
    nodes : int
        Gauss nodes per element.

    Attributes (mpmath numbers; all generalized forces on the left of M qdd + bias + ... = forces)
    ----------
    mass : matrix (n, n); bias, gravity, elastic, damping : matrices (n, 1); kinetic, potential : numbers
        ``bias`` contains the prescribed curvature's rate and acceleration.
    """

    def __init__(
        self,
        finger: TruthFinger,
        q: Sequence,
        qd: Sequence | None = None,
        tip: Sequence = (0, 0, 0),
        nodes: int = NODES,
    ) -> None:
        n = finger.unknowns
        if len(q) != n or (qd is not None and len(qd) != n):
            raise ValueError(f"q and qd must have {n} entries")
        self.finger = finger
        self.rule = gauss(nodes)
        self.n = n
        self._q = [ctx.mpf(v) for v in q]
        self._qd = [ctx.mpf(v) for v in (qd if qd is not None else [0] * n)]
        self._tip_acceleration = ctx.mpf(0)
        if finger.family == "matched_clothoid":
            self._q.append(ctx.mpf(tip[0]))
            self._qd.append(ctx.mpf(tip[1]))
            self._tip_acceleration = ctx.mpf(tip[2])
        self._shapes = shapes(finger)
        self._edges = finger.edges
        self._rest = [rest_of(finger, e) for e in range(len(finger.lengths))]
        self._rest_starts = [ctx.mpf(0)]
        for parts in self._rest:
            self._rest_starts.append(self._rest_starts[-1] + ctx.fsum((b - a) * k for a, b, k in parts))
        # Elements in parts on which all is smooth: (element, start from that of the element, length).
        self._panels = [(e, a, b - a) for e, parts in enumerate(self._rest) for a, b, _ in parts]
        self._gravity = [ctx.mpf(v) for v in finger.gravity]
        self._sweep()
        self._internal()

    # kinematics

    def _integrands(self, e: int, x):
        """At x of element e: tangent, columns n phi_j of J, and -t (d angle/dt)^2, each as x and y."""
        row = self._shapes[e]
        phi = [shape.angle(x) for shape in row]
        bent = ctx.fsum((min(x, b) - a) * k for a, b, k in self._rest[e] if x > a)
        angle = ctx.mpf(self.finger.base_angle) + self._rest_starts[e] + bent + ctx.fdot(phi, self._q)
        rate = ctx.fdot(phi, self._qd)
        c, s = ctx.cos_sin(angle)
        columns = [(-c * f, -s * f) for f in phi]
        return angle, rate, phi, (-s, c), columns, (s * rate * rate, -c * rate * rate)

    def _sweep(self) -> None:
        """Integrate along the rod; gather mass matrix, bias, gravity on the full set of coordinates."""
        f, rule, m = self.finger, self.rule, self.finger.count
        zero = ctx.mpf(0)
        rho, rho_i = ctx.mpf(f.mass_per_length), ctx.mpf(f.rotary_inertia)
        state = [ctx.mpf(f.base_position[0]), ctx.mpf(f.base_position[1])] + [zero] * (2 * m + 2)
        self._starts = [state]
        mass = ctx.zeros(m, m)
        bias, gravity = [zero] * m, [zero] * m
        moment = [zero, zero]  # integral of rho r
        for e, offset, h in self._panels:
            samples = [self._integrands(e, offset + h * u) for u in rule.nodes]
            active = [j for j in range(m) if self._shapes[e][j].active]
            curves = [[p[3][0] for p in samples], [p[3][1] for p in samples]]
            for j in range(m):
                for axis in (0, 1):
                    curves.append([p[4][j][axis] for p in samples] if j in active else None)
            curves += [[p[5][0] for p in samples], [p[5][1] for p in samples]]
            along = []
            for start, curve in zip(state, curves, strict=True):
                if curve is None:
                    along.append([start] * len(samples))
                else:
                    along.append([start + h * ctx.fdot(row, curve) for row in rule.integrals])
            jx = [along[2 + 2 * j] for j in range(m)]
            jy = [along[3 + 2 * j] for j in range(m)]
            w = [rho * h * v for v in rule.weights]
            for axis in (0, 1):
                moment[axis] += ctx.fdot(w, along[axis])
            for i in active:
                wx = [a * b for a, b in zip(w, jx[i], strict=True)]
                wy = [a * b for a, b in zip(w, jy[i], strict=True)]
                bias[i] += ctx.fdot(wx, along[-2]) + ctx.fdot(wy, along[-1])
                gravity[i] -= sum(wx) * self._gravity[0] + sum(wy) * self._gravity[1]
                for j in active:
                    if j < i:
                        continue
                    value = ctx.fdot(wx, jx[j]) + ctx.fdot(wy, jy[j])
                    if rho_i:
                        turn = (p[2][i] * p[2][j] for p in samples)
                        value += rho_i * h * ctx.fdot(rule.weights, list(turn))
                    mass[i, j] += value
            state = [
                start if curve is None else start + h * ctx.fdot(rule.weights, curve)
                for start, curve in zip(state, curves, strict=True)
            ]
            self._starts.append(state)
        potential = -moment[0] * self._gravity[0] - moment[1] * self._gravity[1]
        for s, point in f.masses:
            point = ctx.mpf(point)
            at = self._at(s)
            potential -= point * (at[0] * self._gravity[0] + at[1] * self._gravity[1])
            for i in range(m):
                bias[i] += point * (at[2 + 2 * i] * at[-2] + at[3 + 2 * i] * at[-1])
                gravity[i] -= point * (at[2 + 2 * i] * self._gravity[0] + at[3 + 2 * i] * self._gravity[1])
                for j in range(i, m):
                    mass[i, j] += point * (at[2 + 2 * i] * at[2 + 2 * j] + at[3 + 2 * i] * at[3 + 2 * j])
        for i in range(m):
            for j in range(i):
                mass[i, j] = mass[j, i]
        n = self.n
        self.mass = mass[:n, :n]
        self.bias = ctx.matrix(bias[:n])
        for i in range(n):
            for j in range(n, m):
                self.bias[i] += mass[i, j] * self._tip_acceleration
        self.gravity = ctx.matrix(gravity[:n])
        self.kinetic = sum(self._qd[i] * mass[i, j] * self._qd[j] for i in range(m) for j in range(m)) / 2
        self.potential = potential

    def _panel(self, s):
        """Panel of s, its element and start there, and the distance from its start."""
        e, x = self._locate(s)
        k = max(
            k for k, (element, offset, _) in enumerate(self._panels) if element == e and (offset <= x or not offset)
        )
        return k, e, self._panels[k][1], x - self._panels[k][1]

    def _locate(self, s):
        s = ctx.mpf(s)
        e = len(self.finger.lengths) - 1
        while e > 0 and s < self._edges[e]:
            e -= 1
        return e, s - self._edges[e]

    def _at(self, s) -> list:
        """Position, Jacobian columns and velocity-product acceleration at s, as one list."""
        k, e, offset, x = self._panel(s)
        samples = [self._integrands(e, offset + x * u) for u in self.rule.nodes]
        w = [x * v for v in self.rule.weights]
        result = list(self._starts[k])
        m = self.finger.count
        for axis in (0, 1):
            result[axis] += ctx.fdot(w, [p[3][axis] for p in samples])
            result[2 * m + 2 + axis] += ctx.fdot(w, [p[5][axis] for p in samples])
            for j in range(m):
                result[2 + 2 * j + axis] += ctx.fdot(w, [p[4][j][axis] for p in samples])
        return result

    def position(self, s):
        """World position at s, matrix (2, 1) [m]."""
        return ctx.matrix(self._at(s)[:2])

    def orientation(self, s):
        """World angle of the section's X axis at s [rad]."""
        e, x = self._locate(s)
        return self._integrands(e, x)[0]

    def jacobian(self, s):
        """D position / d q at s, matrix (2, n)."""
        at = self._at(s)
        return ctx.matrix([[at[2 + 2 * j + axis] for j in range(self.n)] for axis in (0, 1)])

    def jacobian_rate(self, s):
        """Time derivative of the Jacobian at s, matrix (2, n)."""
        target, _, _, x_end = self._panel(s)
        rate = ctx.zeros(2, self.n)
        for k, (e, offset, length) in enumerate(self._panels[: target + 1]):
            h = x_end if k == target else length
            for u, v in zip(self.rule.nodes, self.rule.weights, strict=True):
                _, turning, phi, (tx, ty), _, _ = self._integrands(e, offset + h * u)
                for j in range(self.n):
                    factor = h * v * phi[j] * turning
                    rate[0, j] -= factor * tx
                    rate[1, j] -= factor * ty
        return rate

    def velocity(self, s):
        """World velocity at s, the prescribed curvature's share included, matrix (2, 1) [m/s]."""
        at = self._at(s)
        return ctx.matrix(
            [sum(at[2 + 2 * j + axis] * self._qd[j] for j in range(self.finger.count)) for axis in (0, 1)]
        )

    def bends(self) -> list:
        """Bending angle of each element [rad]."""
        return [
            sum((r.angle(ctx.mpf(h)) - r.c0) * v for r, v in zip(row, self._q, strict=True))
            + ctx.fsum((b - a) * k for a, b, k in rest)
            for row, h, rest in zip(self._shapes, self.finger.lengths, self._rest, strict=True)
        ]

    # internal forces

    def _internal(self) -> None:
        """Elastic and damping forces and the elastic energy; all is polynomial."""
        f, n, m = self.finger, self.n, self.finger.count
        rule = gauss(4)
        stiffness, eta = ctx.mpf(f.bending_stiffness), ctx.mpf(f.material_damping)
        self.elastic, self.damping = ctx.zeros(n, 1), ctx.zeros(n, 1)
        for e, row in enumerate(self._shapes):
            a, b = self._edges[e], self._edges[e + 1]
            for u, v in zip(rule.nodes, rule.weights, strict=True):
                x, w = (b - a) * u, (b - a) * v
                share = [shape.curvature(x) for shape in row]
                strain = sum(share[j] * self._q[j] for j in range(m))
                strain_rate = sum(share[j] * self._qd[j] for j in range(m))
                self.potential += w * stiffness * strain * strain / 2
                for i in range(n):
                    self.elastic[i] += w * stiffness * share[i] * strain
                    self.damping[i] += w * eta * share[i] * strain_rate
            h = b - a
            bend = [shape.angle(h) - shape.c0 for shape in row]
            rate = sum(bend[j] * self._qd[j] for j in range(m))
            for i in range(n):
                self.damping[i] += ctx.mpf(f.element_damping) * bend[i] * rate

    # applied forces and motion

    def applied(self, forces: Sequence = (), tip_moment=0, moments: Sequence = ()):
        """Generalized force (n, 1) of world forces (s, Fx, Fy), the tip moment and moments (s, value)."""
        total = ctx.zeros(self.n, 1)
        for s, fx, fy in forces:
            at = self._at(s)
            for i in range(self.n):
                total[i] += at[2 + 2 * i] * ctx.mpf(fx) + at[3 + 2 * i] * ctx.mpf(fy)
        for s, value in [(self._edges[-1], tip_moment), *moments]:
            e, x = self._locate(s)
            for i in range(self.n):
                total[i] += ctx.mpf(value) * self._shapes[e][i].angle(x)
        return total

    def acceleration(self, forces: Sequence = (), tip_moment=0, moments: Sequence = ()):
        """qdd, matrix (n, 1)."""
        rest = self.bias + self.gravity + self.elastic + self.damping
        return ctx.lu_solve(self.mass, self.applied(forces, tip_moment, moments) - rest)


def christoffel_bias(finger: TruthFinger, q: Sequence, qd: Sequence, tip=0):
    """Bias from central differences of the mass matrix, a prescribed curvature held still."""
    n = finger.unknowns
    step = ctx.mpf(10) ** -16
    slopes = []
    for k in range(n):
        sides = []
        for sign in (1, -1):
            moved = [ctx.mpf(v) for v in q]
            moved[k] += sign * step
            sides.append(Rod(finger, moved, tip=(tip, 0, 0)).mass)
        slopes.append((sides[0] - sides[1]) / (2 * step))
    rate = [ctx.mpf(v) for v in qd]
    bias = ctx.zeros(n, 1)
    for i in range(n):
        for j in range(n):
            for k in range(n):
                bias[i] += (slopes[k][i, j] - slopes[i][j, k] / 2) * rate[j] * rate[k]
    return bias
