"""An optimal control problem of any model: states, inputs, dynamics, cost and rows as CasADi expressions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError, Summarized, check_arguments, split_unit
from continuum_grasp.control.arguments import named
from continuum_grasp.control.ocp.bounds import HARD, BoundedRows, Row
from continuum_grasp.control.ocp.cost_terms import Residual
from continuum_grasp.control.ocp.stages import Stages, cost_functions, step_function
from continuum_grasp.scene import INTEGRATORS, Penalty


class ControlProblem(Summarized):
    """An optimal control problem over a receding horizon, of a model given as CasADi expressions.

    minimize  sum_k stage/2 sum_i weight_i (y_i(x_k, u_k, p) - r_ki)^2  +  1/2 sum_i final_i (y_i(x_N, p) - r_Ni)^2
    subject to  dx/dt = f(x, u, p) with the input constant over a stage, bounds and rows.

    Bounds of inputs hold always; bounds of states, and rows, are soft constraints with a penalty, so that every QP is
    feasible. Rows of the states alone hold at the nodes 1 to N, others at 0 to N - 1.

    Parameters
    ----------
    states, inputs : casadi.SX or sequence of casadi.SX
        Symbols. Their names name everything that follows; one may end in its unit, ``"force [N]"``.
    dynamics : casadi.SX or sequence of casadi.SX
        Time derivative of each state.
    cost : mapping of str to tuple
        By name (expression, weight) or (expression, weight, final weight): ``Residual``. Setpoints go by these names,
        and are zero where not given. One with a final weight depends on the states, or, where ``previous`` is given, on
        the inputs too: at the end these are the last ones.
    stages : int
        Number of stages N.
    stage : float
        Length of a stage [s].
    parameters : casadi.SX or sequence of casadi.SX
        Symbols of values that may differ from call to call.
    nominal : mapping of str to float
        Nominal value of each parameter.
    previous : casadi.SX or sequence of casadi.SX
        Symbols of the inputs of the stage before, one per input, where cost or rows need their change, or the end of
        the horizon its input.
    rows : mapping of str to tuple
        By name (expression, least, most) or (expression, least, most, (linear, quadratic)): ``Row``. Bounds are one
        number, or one per entry.
    bounds : mapping of str to (float, float)
        Least and greatest value by name of an input, or of a state: a hard row. A name that both have is the input's.
    method : {"rk4", "sdirk2"}
        Integrator: explicit of order 4, or implicit (L-stable) of order 2 for stiff dynamics.
    substeps : int
        Its steps per stage.
    name : str
        Name of the problem, for texts.

    Attributes
    ----------
    stages : Stages
        Functions and numbers of a stage.
    cost_names : tuple of (str, int)
        Name and number of entries of each term of the cost, in the order of the setpoints; terms with a final weight
        come first.

    Raises
    ------
    InputError
        If sizes or names do not fit, an expression has other symbols than the given ones, or a number is out of range.

    Examples
    --------
    >>> import casadi as ca
    >>> import continuum_grasp as cg
    >>> angle, rate, torque = (ca.SX.sym(name) for name in ("angle", "rate", "torque"))
    >>> problem = cg.ControlProblem(
    ...     states=[angle, rate],
    ...     inputs=torque,
    ...     dynamics=[rate, torque - ca.sin(angle)],
    ...     cost={"angle": (angle, 10.0, 1.0), "rate": (rate, 0.1), "torque": (torque, 0.1)},
    ...     bounds={"torque": (-0.5, 0.5), "rate": (-1.0, 1.0)},
    ...     stages=20,
    ...     stage=0.1,
    ... )
    >>> problem
    ControlProblem 20 stages of 0.1 s, 2 states, 1 input, 3 setpoints, 1 row
      states     angle, rate
      inputs     torque
      setpoints  angle, rate, torque
      rows       rate
    """

    @check_arguments
    def __init__(
        self,
        *,
        states: Any,
        inputs: Any,
        dynamics: Any,
        cost: Mapping[str, Any],
        stages: int,
        stage: float,
        parameters: Any = (),
        nominal: Mapping[str, float] | None = None,
        previous: Any = (),
        rows: Mapping[str, Any] | None = None,
        bounds: Mapping[str, Any] | None = None,
        method: str = "rk4",
        substeps: int = 1,
        name: str = "",
    ) -> None:
        self.name = name
        read = _Reader(states, inputs, parameters, previous)
        tracked = read.cost(cost)
        u_min, u_max, bounded, ns = read.limits(dict(bounds or {}), dict(rows or {}))
        nx = read.held.numel() + read.x.numel()
        size = {key: len(term.names) for key, term in tracked.items()}
        nt = sum(size[key] for key, term in tracked.items() if term.final is not None)
        arguments = {"x": ca.vertcat(read.x, read.held), "u": read.u, "p": read.p}
        functions = {
            name: ca.Function(name, [*arguments.values()], [ca.densify(ca.cse([value])[0])], [*arguments], [output])
            for name, output, value in (
                ("outputs", "y", ca.vertcat(*[term.value for term in tracked.values()])),
                ("rows", "c", bounded.column),
                ("dynamics", "xd", read.column("dynamics", dynamics, read.x.numel())),
            )
        }
        known = [name for name, integrator in INTEGRATORS.items() if integrator.differentiates]
        method, stage = CheckedArgument("method", method).choice(known), CheckedArgument("stage", stage).number()
        running, terminal = cost_functions(functions["outputs"], functions["rows"], stage, nt, ns)
        p_names = _names(read.p)
        self.stages = Stages(
            step=step_function(functions["dynamics"], nx, method),
            cost=running,
            terminal=terminal,
            **functions,
            scenarios=None,
            checks_gaps=False,
            stages=CheckedArgument("stages", stages).whole(),
            stage=stage,
            substeps=CheckedArgument("substeps", substeps).whole(),
            method=method,
            nd=read.x.numel(),
            ns=ns,
            nt=nt,
            x_names=tuple(_names(arguments["x"])),
            u_names=tuple(_names(read.u)),
            p_names=tuple(p_names),
            r_names=tuple(label for term in tracked.values() for label in term.names),
            c_names=tuple(bounded.names),
            u_min=u_min,
            u_max=u_max,
            c_min=bounded.least,
            c_max=bounded.most,
            linear=bounded.linear,
            quadratic=bounded.quadratic,
            weights=np.concatenate([term.weight for term in tracked.values()]),
            terminal_weights=np.concatenate(
                [np.zeros(size[key]) if term.final is None else term.final for key, term in tracked.items()]
            ),
            p_nominal=CheckedArgument("nominal", named("nominal", nominal or {}, p_names)).vector(len(p_names)),
        )
        self.cost_names = tuple(size.items())

    def headline(self) -> str:
        """Sizes of the problem."""
        s = self.stages
        sizes = ((s.nd, "state"), (s.nu, "input"), (s.np, "parameter"), (s.nr, "setpoint"), (s.nc, "row"))
        counted = [f"{count} {word}{'' if count == 1 else 's'}" for count, word in sizes if count]
        return self.quoted(self.name or None, f"{s.stages} stages of {s.stage:g} s", *counted)

    def pairs(self) -> dict[str, str]:
        """Names of its vectors."""
        s = self.stages
        rows = {"states": s.x_names, "inputs": s.u_names, "parameters": s.p_names}
        rows |= {"setpoints": s.r_names, "rows": s.c_names}
        return {key: ", ".join(names) for key, names in rows.items() if names}


class _Reader:
    """Reads expressions of symbols; some of them depend on more than the states."""

    def __init__(self, states: Any, inputs: Any, parameters: Any, previous: Any) -> None:
        given = {"states": states, "inputs": inputs, "parameters": parameters, "previous": previous}
        self.x, self.u, self.p, self.held = (_symbols(key, symbols) for key, symbols in given.items())
        if not self.x.numel() or not self.u.numel():
            raise InputError("expected at least one symbol", key="inputs" if self.x.numel() else "states")
        if self.held.numel() not in (0, self.u.numel()):
            count = self.held.numel()
            raise InputError(f"expected {self.u.numel()} symbols, one per input, got {count}", key="previous")
        for key, symbols in (("states", self.x), ("inputs", self.u), ("parameters", self.p)):
            _once(key, [split_unit(label).name for label in _names(symbols)])
        self._known = ca.vertcat(self.x, self.u, self.p, self.held)
        hashes = [self._known[k].element_hash() for k in range(self._known.numel())]
        twice = [self._known[k].name() for k in range(len(hashes)) if hashes[k] in hashes[:k]]
        if twice:
            raise InputError(f"a symbol is given twice among states, inputs, parameters and previous: {twice[0]}")

    def column(self, key: str, given: Any, size: int | None = None) -> ca.SX:
        """A column of expressions, of a size."""
        hint = "; an MX one becomes SX by calling its Function, made with expand(), on SX symbols"
        value = ca.densify(ca.vec(_stacked(key, given, "an SX expression", hint)))
        if size is not None and value.numel() != size:
            raise InputError(f"expected {size} expressions, got {value.numel()}", key=key)
        probe = ca.Function("own", [self._known], [value], {"allow_free": True})
        if probe.has_free():
            raise InputError(f"unknown symbols {', '.join(map(str, probe.free_sx()))}", key=key)
        return value

    def of_state(self, value: ca.SX) -> bool:
        """Whether an expression depends on states and parameters alone."""
        return not ca.depends_on(value, ca.vertcat(self.u, self.held))

    def cost(self, given: Mapping[str, Any]) -> dict[str, Residual]:
        """Return the terms of the cost, first those with a final weight, at the end of the horizon: value, weights
        (size) and names of entries.
        """
        if not given:
            raise InputError("expected at least one term", key="cost")
        _words("cost", given)
        residuals = {}
        for key, term in given.items():
            residual = _tuple(Residual, f"cost.{key}", term, "(expression, weight) or (expression, weight, final)")
            value = self.column(f"cost.{key}", residual.value)
            size = value.numel()
            weight, final = (
                _weights(f"cost.{key}.{name}", 0.0 if cost_weight is None else cost_weight, size)
                for name, cost_weight in (("weight", residual.weight), ("final", residual.final))
            )
            # At the end the inputs are those held, which are states where the ones before are; they do not change.
            held = residual.final is not None and self.held.numel() and not ca.depends_on(value, self.held)
            ends = held or self.of_state(value)
            if np.any(final) and not ends:
                raise InputError(
                    "a final weight needs an expression of only the states, or of inputs where previous is given",
                    key=f"cost.{key}",
                )
            names = residual.names or _numbered(key, size)
            residuals[key] = Residual(value, weight, final if ends else None, names)
        return dict(sorted(residuals.items(), key=lambda item: item[1].final is None))

    def limits(self, bounds: dict[str, Any], given: dict[str, Any]) -> tuple[Array, Array, BoundedRows, int]:
        """Least and greatest inputs; bounds of states and rows, relative to these, bounds of states alone first, and
        how many those are.
        """
        names = [split_unit(label).name for label in _names(self.u)]
        free = (-math.inf, math.inf)
        inputs = np.array([_pair(f"bounds.{name}", bounds.pop(name, free)) for name in names])
        states = {}
        for k, label in enumerate(_names(self.x)):
            if (name := split_unit(label).name) in bounds:
                states[name] = Row(self.x[k], *_pair(f"bounds.{name}", bounds.pop(name)))
        if bounds:
            raise InputError(f"expected names of states and inputs, got {', '.join(bounds)}", key="bounds")
        _once("rows", [*states, *given])
        read = {}
        _words("rows", given)
        for key, entry in (states | given).items():
            row = _tuple(Row, f"rows.{key}", entry, "(expression, least, most)")
            value = self.column(f"rows.{key}", row.value)
            read[key] = row._replace(value=value, names=row.names or _numbered(key, value.numel()))
        entries = list[Row]()
        order = sorted(read, key=lambda key: not self.of_state(read[key].value))
        for key in order:
            row = read[key]
            penalty = _penalty(f"rows.{key}", row.penalty)
            size = len(row.names)
            ends = (_per_entry(f"rows.{key}", bound, size, check=False) for bound in (row.least, row.most))
            for k, pair in enumerate(zip(*map(list, ends), strict=True)):
                least, greatest = _bounds(f"rows.{key}", *map(float, pair))
                scale = max([abs(bound) for bound in (least, greatest) if abs(bound) < Stages.ABSENT] or [0.0]) or 1.0
                value = row.value[k] if scale == 1.0 else row.value[k] / scale
                low, high = (bound if abs(bound) >= Stages.ABSENT else bound / scale for bound in (least, greatest))
                entries.append(Row(value, low, high, penalty, (row.names[k],)))
        bounded = BoundedRows(entries)
        _once("rows", bounded.names)
        ns = sum(len(read[key].names) for key in order if self.of_state(read[key].value))
        return inputs[:, 0].copy(), inputs[:, 1].copy(), bounded, ns


def _stacked(key: str, given: Any, what: str, hint: str = "") -> ca.SX:
    try:
        return ca.SX(ca.vertcat(*given)) if isinstance(given, Sequence) else ca.SX(given)
    except (NotImplementedError, TypeError, RuntimeError) as error:
        raise InputError(f"expected {what}, got {CheckedArgument(key, given).shown()}{hint}", key=key) from error


def _symbols(key: str, given: Any) -> ca.SX:
    """A column of symbols."""
    symbols = _stacked(key, given, "SX symbols")
    if not symbols.numel():
        return ca.SX(0, 1)
    if not (symbols.is_dense() and symbols.is_column() and symbols.is_valid_input()):
        raise CheckedArgument(key, given).refused("expected a column of SX symbols")
    return symbols


def _names(symbols: ca.SX) -> list[str]:
    return [symbols[k].name() for k in range(symbols.numel())]


def _words(key: str, names: Iterable[Any]) -> None:
    """Refuse names that are none."""
    odd = [name for name in names if not isinstance(name, str) or not name.strip()]
    if odd:
        raise CheckedArgument(key, odd[0]).refused("expected words as names")


def _once(key: str, names: Iterable[str]) -> None:
    names = list(names)
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"names must differ; there is more than one {', '.join(twice)}", key=key)


def _numbered(key: str, size: int) -> tuple[str, ...]:
    return (key,) if size == 1 else tuple(f"{key}_{k + 1}" for k in range(size))


def _tuple(kind: Any, key: str, given: Any, expected: str) -> Any:
    """A named tuple from one of its kind or from a plain tuple."""
    if not isinstance(given, tuple | list) or not 2 <= len(given) <= len(kind._fields):
        raise CheckedArgument(key, given).refused(f"expected {expected}")
    return kind(*given)


def _per_entry(key: str, given: ArrayLike, size: int, *, check: bool = True) -> Array:
    """Numbers per entry, from one for all or from as many."""
    each = np.full(size, given) if np.ndim(given) == 0 else given
    return CheckedArgument(key, each).vector(size, check=check)


def _weights(key: str, given: ArrayLike, size: int) -> Array:
    values = _per_entry(key, given, size)
    if np.any(values < 0.0):
        raise InputError(f"expected no negative weight, got {values.tolist()}", key=key)
    return values


def _bounds(key: str, least: Any, greatest: Any) -> tuple[float, float]:
    """Two bounds in order; infinite ones are absent."""
    low, high = (float(np.clip(value, -Stages.ABSENT, Stages.ABSENT)) for value in (least, greatest))
    if not low <= high:  # NaN too
        raise InputError(f"expected a least value no greater than the greatest, got {least!r}, {greatest!r}", key=key)
    return low, high


def _pair(key: str, given: Any) -> tuple[float, float]:
    try:
        least, greatest = (float(value) for value in given)
    except (TypeError, ValueError) as error:
        raise CheckedArgument(key, given).refused("expected (least, most)") from error
    return _bounds(key, least, greatest)


def _penalty(key: str, given: Any) -> Penalty:
    if given is None or isinstance(given, Penalty):
        return HARD if given is None else given
    linear, quadratic = CheckedArgument(f"{key}.penalty", given).vector(2).tolist()
    if min(linear, quadratic) < 0.0:
        raise InputError(f"expected no negative penalty weight, got {given!r}", key=key)
    return Penalty(linear=linear, quadratic=quadratic)
