"""Writer of the kernels of a sweep from the equations of motion; see `continuum_grasp.model.sweep`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import casadi as ca
import numpy as np

from continuum_grasp.base import Array, InputError
from continuum_grasp.model.equations import Equations
from continuum_grasp.model.laws.ports import Port
from continuum_grasp.model.laws.section import STATEFUL, Bend, SectionLaw
from continuum_grasp.model.link import Attached
from continuum_grasp.model.planar import Rotation, Scalar, Vec, column
from continuum_grasp.model.sweep import SECTION, Kernels, digest


class SweepWriter:
    """Writes the kernels of a model.

    ``implicit``: the matrix is M + part D + part^2 K, with the stiffness K and damping D of the finger itself, and
    the elastic force is taken at the bends that the rates add in ``part`` [s].
    """

    def __init__(self, equations: Equations, *, implicit: bool = False) -> None:
        made = self._made = equations.structure
        self._par = made.parameters
        self.equations, self.implicit = equations, implicit
        self._family = family = made.family
        self._local = len(family.local(0))
        self._shared = len(set(family.local(0)) & set(family.local(1)))
        if equations.pattern is None:
            raise InputError("these equations of motion are solved densely")
        self._pattern = equations.pattern
        self._loads = equations.loads
        # Laws without states: what they give is an expression of the link alone.
        placed = [each for each in made.laws if each.law.kind not in STATEFUL]
        self._laws = [each.law for each in placed]
        self._ports = [_rows(each.ports, len(made.lengths)) for each in placed]
        self._row, self.rows = self._described()
        self._numbers = self._row[: self._pattern.rows.shape[1]]
        size, sources, links = self._local, len(made.sources), len(made.lengths)
        sizes = (size * (size + 1) // 2, size * sources, size, 1, sum(ports.size for ports in self._ports) // links)
        splits = [0, *np.cumsum(sizes).tolist()]
        self._own = dict(zip(_OWN, ca.vertsplit(self._row[self._numbers.numel() :], splits), strict=True))

    # -- what differs from link to link ---------------------------------------------------------------------------

    def _described(self) -> tuple[ca.SX, Array]:
        """The row of a link as expressions, and the rows of numbers of those entries that are not the same for all."""
        made, family, size = self._made, self._family, self._local
        masses = {place.link: name for name, place in made.masses() if place != made.tip}
        rows = []
        for k, h in enumerate(made.lengths):
            local, block = family.local(k), family.block(k, h)
            lower = [block[a][b] for a in range(size) for b in range(a + 1)]
            if family.nodal is None:
                driven = [family.work(k, made.lengths, source.shape)[a] for a in local for source in made.sources]
            else:
                driven = [*np.vstack([family.nodal, family.known[:1]])[list(local)].ravel()]
            bends = [family.work(k, made.lengths)[a] for a in local]
            mass = float(self._par[masses[k]]) if k in masses else 0.0
            ports = [value for port in self._ports for value in port[k].ravel()]
            rows.append([*self._pattern.rows[k], *lower, *driven, *bends, mass, *ports])
        numbers = np.array(rows, dtype=float)
        # 1e-15: difference per size up to which the numbers of two links are the same: rounding of their lengths
        varies = np.ptp(numbers, axis=0) > 1e-15 * np.abs(numbers).max(axis=0)
        symbol, at = ca.SX.sym("row", int(varies.sum())), np.cumsum(varies) - 1
        entries = [symbol[int(at[j])] if varied else ca.SX(float(numbers[0, j])) for j, varied in enumerate(varies)]
        self.row = symbol
        return ca.vertcat(*entries), numbers[:, varies]

    # -- kernels --------------------------------------------------------------------------------------------------

    def kernels(self) -> Kernels:
        return Kernels(
            self._head(),
            self._carry(),
            self._tip(),
            self._outward(),
            self._turn(),
            self._load_forces(),
            self._inward(),
            self._root(),
            self._onward(),
            self.rows,
            self._loaded,
            self._shared,
            self._made.n,
        )

    def _function(self, name: str, inputs: dict[str, ca.SX], outputs: dict[str, Sequence[Scalar]]) -> ca.Function:
        values = ca.cse([ca.densify(column(list(value))) for value in outputs.values()])
        arguments = list(inputs.values()), values, list(inputs), list(outputs)
        # One source may hold those of several models: they are named by their content.
        return ca.Function(f"{name}_{digest(ca.Function(name, *arguments).serialize().encode())}", *arguments)

    @property
    def _loaded(self) -> tuple[int, ...]:
        made = self._made
        every = range(len(made.lengths) if made.own_tendons or made.has_law(*STATEFUL) else 0)
        return (*(load.place.link for load in self._loads), *every)

    def _symbols(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Symbols carried to a link, its coordinates and their rates."""
        spin = ca.SX.sym("spin")
        return spin, ca.SX.sym("q", self._local), ca.SX.sym("qd", self._local)

    @property
    def _at_ports(self) -> Iterator[tuple[SectionLaw, ca.SX]]:
        """Ports of a link with their laws and numbers."""
        at = 0
        for law, ports in zip(self._laws, self._ports, strict=True):
            _, count, size = ports.shape
            for _ in range(count):
                yield law, self._own["ports"][at : at + size]
                at += size

    def _tip(self) -> ca.Function:
        """Inertia and force at the end of the last link: the load carried there."""
        eq, size = self.equations, SECTION + self._shared
        spin = self._symbols()[0]
        mass = sum((self._par[name] for name, place in self._made.masses() if place == self._made.tip), 0.0)
        body = next(iter(eq.tip_bodies), Attached(0.0))
        first = body.center.scaled(body.mass)
        second = body.rotary_inertia + first.dot(body.center)
        total = mass + body.mass
        rows: list[list[Scalar]] = [[total], [0.0, total], [first.x, first.y, second]]
        rows += [[0.0, 0.0, 0.0, 0.0] for _ in range(self._shared)]
        pull = first.scaled(spin[0] * spin[0])
        end = [entry for row in rows for entry in row] + [pull.y, -1.0 * pull.x, *[0.0] * (size - 2)]
        if self._made.matched:
            end += [0.0, eq.known_accelerations[0]]
        return self._function("tip", {"spin": spin, "lag": eq.lag, "u": eq.u, "p": eq.p}, {"end": end})

    def _carry(self) -> ca.Function:
        spin, q, qd = self._symbols()
        following: list[Scalar] = [spin[0] + ca.dot(self._own["bends"], qd)]
        return self._function("carry", {"spin": spin, "q": q, "qd": qd, "row": self.row}, {"spun": following})

    def _turn(self) -> ca.Function:
        turn, shape = ca.SX.sym("turn", 2 * bool(self._loaded)), ca.SX.sym("shape", 4 + 2 * self._local + 2)
        turned: list[Scalar] = []
        if self._loaded:
            after = Rotation(turn[0], turn[1]) @ Rotation(shape[0], shape[1])
            turned = [after.c, after.s]
        return self._function("turn", {"turn": turn, "shape": shape}, {"turned": turned})

    def _head(self) -> ca.Function:
        eq = self.equations
        held = self._made.matched
        if held:
            drive = [eq.per_stiffness([1.0], [each.total]) for each in eq.drives]
        else:
            sources = zip(self._made.sources, eq.drives, strict=True)
            drive = [each.couple if source.tendon is not None else each.total for source, each in sources]
        tip: list[Scalar] = [eq.full[-1]] if held else []
        tip_rate: list[Scalar] = [eq.full_rates[-1]] if held else []
        weight = eq.gravity_vector.perp()
        return self._function(
            "head",
            {"lag": eq.lag, "u": eq.u, "p": eq.p},
            {
                "drive": drive,
                "tip": tip,
                "tip_rate": tip_rate,
                "base": [weight.x, weight.y],
                # Friction states and winches depend on the motion of the finger: found elsewhere, with these.
                "lagging": [] if eq.drives_feel_motion else eq.drive_rates,
            },
        )

    def _outward(self) -> ca.Function:
        size, par, sources = self._local, self._par, len(self._made.sources)
        spin, q, qd = self._symbols()
        r, part = ca.SX.sym("r", size * self.implicit), ca.SX.sym("part", int(self.implicit))
        drive = ca.SX.sym("drive", sources)
        link = self._pattern.link(ca.vertsplit(q), self._numbers)
        end, inertia, bias = link.end, link.inertia, link.bias(spin[0], ca.vertsplit(qd))
        block, bends = _symmetric(self._own["stiffness"], size), self._own["bends"]
        driven = ca.reshape(self._own["driven"], sources, size).T
        stiffness, per_arc, damping = par["bending_stiffness"], par["per_arc_damping"], self.equations.viscosity
        # What the input bends is subtracted from the coordinates where it is known.
        above = q - ca.mtimes(driven, drive) if self._made.matched else q
        forces = column(list(bias.generalized)) - ca.mtimes(block, stiffness * above + damping * qd)
        forces -= bends * (per_arc * ca.dot(bends, qd))
        if not self._made.matched:
            forces += ca.mtimes(driven, drive)
        # Of laws a moment per port, and its slopes by the curvature and its rate, which a step is implicit in.
        steep, stiff = ca.SX(size, size), ca.SX(size, size)
        rest = par["rest_curvature"] if par.is_runtime("rest_curvature") else None
        memory = self._made.memory
        for law, numbers in self._at_ports:
            measure, shapes, (at_rest, *others) = numbers[0], numbers[1 : 1 + size], ca.vertsplit(numbers[1 + size :])
            there, square = ca.SX.sym("curvature"), ca.mtimes(shapes, shapes.T)
            bend = Bend(there, at_rest if rest is None else rest, ca.dot(shapes, qd), memory, others)
            slope = ca.jacobian(law.moment(bend), there) if law.kind == "elastic" else 0.0
            laws = [ca.SX(each) for each in (law.moment(bend), law.damping(bend), slope)]
            moment, damped, bent = ca.substitute(laws, [there], [ca.dot(shapes, q)])
            forces -= shapes * (measure * moment)
            steep += measure * damped * square
            stiff += measure * bent * square
        slowed = ca.SX(size, size)
        if self.implicit:
            slowed = part * (damping * block + per_arc * ca.mtimes(bends, bends.T))
            slowed += part * steep + part**2 * ((stiffness + self.equations.held_stiffness) * block + stiff)
            forces -= part * ca.mtimes(stiffness * block + stiff, r)
        spots = [end.rotation.c, end.rotation.s, *_flat([end.position, *end.arms, bias.end.perp()])]
        # What `_inward` reads: the link's own inertia, lower triangle by rows less that of its mass, then forces.
        body = [*_flat([inertia.first]), inertia.second]
        for k, (arm, swing, row) in enumerate(zip(inertia.arms, inertia.swing, inertia.matrix, strict=True)):
            body += [arm.x, arm.y, swing, *(m + slowed[k, j] for j, m in enumerate(row[: k + 1]))]
        body += [bias.force.y, -1.0 * bias.force.x, bias.moment, *ca.vertsplit(forces)]
        return self._function(
            "outward",
            {
                "spin": spin,
                "q": q,
                "qd": qd,
                "r": r,
                "row": self.row,
                "drive": drive,
                "p": self.equations.p,
                "part": part,
            },
            {"shape": spots, "body": body},
        )

    def _load_forces(self) -> ca.Function:
        """Generalized forces of point loads on the section and the coordinates of their links."""
        eq, turns = self.equations, ca.SX.sym("turns", 2 * len(self._loaded))
        forces: list[Scalar] = []
        for j, load in enumerate(self._loads):
            section = eq.chain.links[load.place.link].link.section(load.place.fraction)
            turn = Rotation(turns[2 * j], turns[2 * j + 1])
            force = (section.rotation if load.follows else turn.transposed()).apply(load.force)
            forces += [force.y, -force.x, section.position.cross(force) + load.couple]
            for arm, angle in zip(section.arms, section.angles, strict=True):
                forces.append(arm.cross(force) + angle * load.couple)
        for local in eq.moving.on_elements:
            forces += [0.0, 0.0, 0.0, *local]
        return self._function("loads", {"turns": turns, "x": eq.x, "u": eq.u, "w": eq.w, "p": eq.p}, {"force": forces})

    def _inward(self) -> ca.Function:
        size, state, matched = self._local, SECTION + self._shared, self._made.matched
        packed = state * (state + 1) // 2
        end = ca.SX.sym("end", packed + state + 2 * matched)
        total = SECTION + size
        shape, body = ca.SX.sym("shape", 4 + 2 * size + 2), ca.SX.sym("body", total * (total + 1) // 2 - 3 + total)
        force = ca.SX.sym("force", (SECTION + size) * bool(self._loaded))
        inertia = self._pattern.link([0.0] * size, self._numbers).inertia
        turn, to_end, beta = self._along(shape)
        # What is beyond, with the mass at the end of the link, in the axes of the link.
        beyond = _symmetric(end[:packed], state) + self._own["mass"] * ca.diagcat(
            ca.SX.eye(2), ca.SX(state - 2, state - 2)
        )
        beyond = _mirrored(turn @ beyond @ turn.T)
        felt = turn @ end[packed : packed + state] - beyond @ beta
        carried = ca.vertcat(inertia.mass, 0.0, inertia.mass, body[:-total])
        matrix = ca.densify(to_end @ beyond @ to_end.T) + _symmetric(carried, total)
        right = to_end @ felt + body[-total:] + (force if force.numel() else 0.0)
        gains: list[ca.SX] = []
        for b in range(total - 1, state - 1, -1):
            # A coordinate whose acceleration is given, that of a matched tip, moves whatever acts on it.
            last, row = matched and b == total - 1, matrix[b, :b]
            inverse = (end[packed + state] if last else 1.0) / matrix[b, b]
            constant = inverse * right[b] + (end[packed + state + 1] if last else 0.0)
            gains.insert(0, ca.horzcat(inverse * row, constant))
            matrix = matrix[:b, :b] - (inverse * row).T @ row
            right = right[:b] - row.T * constant
        handed: list[Scalar] = [
            *ca.vertsplit(ca.triu(matrix.T).nz[:]),
            *ca.vertsplit(right),
            *[1.0, 0.0][: 2 * matched],
        ]
        return self._function(
            "inward",
            {"end": end, "shape": shape, "body": body, "row": self.row, "p": self.equations.p, "force": force},
            {"handed": handed, "gain": ca.horzsplit(ca.horzcat(*gains))},
        )

    def _along(self, shape: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """From the axes of a link's end to the link's; the velocity of the end by the velocity of the start and by
        local coordinates, and what velocity products add, in the latter.
        """
        size, shared = self._local, self._shared
        c, s, *entries = ca.vertsplit(shape)
        span, *arms, beta = (ca.vertcat(*entries[k : k + 2]) for k in range(0, len(entries), 2))
        ways = [ca.horzcat(ca.SX.eye(2), ca.SX(2, 1 + shared)), ca.horzcat(span.T, 1.0, ca.SX(1, shared))]
        for a, (arm, angle) in enumerate(zip(arms, ca.vertsplit(self._own["bends"]), strict=True)):
            ways.append(ca.horzcat(arm.T, angle, *[float(a == size - shared + k) for k in range(shared)]))
        turn = ca.diagcat(ca.vertcat(ca.horzcat(c, -s), ca.horzcat(s, c)), ca.SX.eye(1 + shared))
        return turn, ca.vertcat(*ways), ca.vertcat(beta, ca.SX(1 + shared, 1))

    def _root(self) -> ca.Function:
        state = SECTION + self._shared
        packed = state * (state + 1) // 2
        end = ca.SX.sym("end", packed + state + 2 * self._made.matched)
        base = ca.SX.sym("base", 2)
        start: list[Scalar] = [base[0], base[1], 0.0]
        matrix = _symmetric(end[:packed], state)
        # One shared coordinate at most: what is left of the first link's.
        for k in range(SECTION, state):
            missing = end[packed + k] - sum(matrix[k, i] * start[i] for i in range(2))
            start.append(missing / matrix[k, k])
        return self._function("root", {"end": end, "base": base}, {"start": start})

    def _onward(self) -> ca.Function:
        size, state = self._local, SECTION + self._shared
        start, shape = ca.SX.sym("start", state), ca.SX.sym("shape", 4 + 2 * size + 2)
        gain = ca.SX.sym("gain", sum(b + 1 for b in range(state, SECTION + size)))
        rates, at = ca.vertsplit(start), 0
        for b in range(state, SECTION + size):
            rates.append(gain[at + b] - ca.dot(gain[at : at + b], ca.vertcat(*rates)))
            at += b + 1
        turn, to_end, beta = self._along(shape)
        following = turn.T @ (to_end.T @ ca.vertcat(*rates) + beta)
        return self._function(
            "onward",
            {"start": start, "shape": shape, "gain": gain, "row": self.row},
            {"following": ca.vertsplit(following), "rates": rates[state:]},
        )


_OWN = ("stiffness", "driven", "bends", "mass", "ports")
"""Entries of a row beside the numbers of the link: stiffness; what each source of moments exerts on the coordinates, or
where it is known the coordinates that it balances; bending angle per coordinate; mass at the end [kg]; per port of the
laws its measure, shapes, curvature at rest and the numbers of the law there."""


def _rows(ports: Sequence[Port], links: int) -> Array:
    """Numbers of the ports of a law, of all links alike (N, P, M)."""
    rows = [list(map(float, (port.measure, *port.shapes, port.rest, *port.own))) for port in ports]
    return np.reshape(rows, (links, len(ports) // links, -1))


def _flat(vectors: Sequence[Vec]) -> list[Scalar]:
    return [entry for v in vectors for entry in (v.x, v.y)]


def _symmetric(lower: ca.SX, size: int) -> ca.SX:
    """The whole of a matrix whose lower triangle is given by rows."""
    return _mirrored(ca.SX(ca.Sparsity.upper(size), lower).T)


def _mirrored(matrix: ca.SX) -> ca.SX:
    """The symmetric matrix of a lower triangle."""
    # CasADi's own function adds both triangles and subtracts the diagonal, which costs instructions.
    return ca.tril(matrix) + ca.tril(matrix, False).T
