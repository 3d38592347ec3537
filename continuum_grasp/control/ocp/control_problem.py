"""An optimal control problem of any model: states, inputs, dynamics, cost and rows as CasADi expressions."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.arguments import check_arguments, choice, positive, shown, whole
from continuum_grasp.arrays import Array
from continuum_grasp.control.arguments import vector
from continuum_grasp.control.ocp.bounds import ABSENT, HARD, BoundedRows, Row
from continuum_grasp.control.ocp.cost_terms import Residual
from continuum_grasp.control.ocp.stages import Stages, cost_functions, step_function
from continuum_grasp.errors import InputError
from continuum_grasp.labels import Summarized, name_of, quoted
from continuum_grasp.scene.controller import Penalty
from continuum_grasp.scene.methods import CONTROL_METHODS


class ControlProblem(Summarized):
    """An optimal control problem over a receding horizon, of a model given as CasADi expressions.

    minimize  sum_k stage/2 sum_i weight_i (y_i(x_k, u_k, p) - r_ki)^2  +  1/2 sum_i final_i (y_i(x_N, p) - r_Ni)^2
    subject to  dx/dt = f(x, u, p) with the input constant over a stage, bounds and rows.

    Bounds of inputs hold always; those of states, and rows, are soft constraints with a penalty, so that every QP is
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
        Symbols of what may differ from call to call.
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
        Of the problem, for texts.

    Attributes
    ----------
    stages : Stages
        Functions and numbers of a stage.
    cost_names : tuple of (str, int)
        Name and number of entries of each term of the cost, in the order of the setpoints: those that the end has come
        first.

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
        x, u, p = _symbols("states", states), _symbols("inputs", inputs), _symbols("parameters", parameters)
        held = _symbols("previous", previous)
        if not x.numel() or not u.numel():
            raise InputError("expected at least one symbol", key="inputs" if x.numel() else "states")
        if held.numel() not in (0, u.numel()):
            raise InputError(f"expected {u.numel()} symbols, one per input, got {held.numel()}", key="previous")
        known = ca.vertcat(x, u, p, held)
        for key, symbols in (("states", x), ("inputs", u), ("parameters", p)):
            _once(key, [name_of(label) for label in _names(symbols)])
        hashes = [known[k].element_hash() for k in range(known.numel())]
        twice = [known[k].name() for k in range(len(hashes)) if hashes[k] in hashes[:k]]
        if twice:
            raise InputError(f"a symbol is given twice among states, inputs, parameters and previous: {twice[0]}")
        reader = _Reader(known, u, held)
        tracked = reader.cost(cost)
        limits = dict(bounds or {})
        u_min, u_max = _input_bounds(limits, [name_of(label) for label in _names(u)])
        of_states = _state_bounds(limits, x)
        _once("rows", [*of_states, *(rows or {})])
        bounded, ns = reader.rows(of_states | dict(rows or {}))
        if limits:
            raise InputError(f"expected names of states and inputs, got {', '.join(limits)}", key="bounds")
        arguments = {"x": ca.vertcat(x, held), "u": u, "p": p}
        targets = ca.vertcat(*[residual.value for residual in tracked.values()])
        functions = {
            name: ca.Function(name, [*arguments.values()], [ca.densify(ca.cse([value])[0])], [*arguments], [output])
            for name, output, value in (
                ("outputs", "y", targets),
                ("rows", "c", bounded.column),
                ("dynamics", "xd", reader.column("dynamics", dynamics, x.numel())),
            )
        }
        nt = sum(len(residual.names) for residual in tracked.values() if residual.final is not None)
        method, stage = choice("method", method, CONTROL_METHODS), positive("stage", stage)
        running, terminal = cost_functions(functions["outputs"], functions["rows"], stage, nt, ns)
        self.stages = Stages(
            step=step_function(functions["dynamics"], x.numel() + held.numel(), method),
            cost=running,
            terminal=terminal,
            **functions,
            scenarios=None,
            checks_gaps=False,
            stages=whole("stages", stages),
            stage=stage,
            substeps=whole("substeps", substeps),
            method=method,
            nd=x.numel(),
            ns=ns,
            nt=nt,
            x_names=(*_names(x), *_names(held)),
            u_names=tuple(_names(u)),
            p_names=tuple(_names(p)),
            r_names=tuple(label for residual in tracked.values() for label in residual.names),
            c_names=tuple(bounded.names),
            u_min=u_min,
            u_max=u_max,
            c_min=np.array(bounded.least),
            c_max=np.array(bounded.most),
            linear=bounded.linear,
            quadratic=bounded.quadratic,
            weights=np.concatenate([residual.weight for residual in tracked.values()]),
            terminal_weights=np.concatenate(
                [
                    np.zeros(len(residual.names)) if residual.final is None else residual.final
                    for residual in tracked.values()
                ]
            ),
            p_nominal=_nominal(nominal or {}, [name_of(label) for label in _names(p)]),
        )
        self.cost_names = tuple((key, len(residual.names)) for key, residual in tracked.items())

    def headline(self) -> str:
        """Sizes of the problem."""
        s = self.stages
        sizes = ((s.nd, "state"), (s.nu, "input"), (s.np, "parameter"), (s.nr, "setpoint"), (s.nc, "row"))
        counted = [f"{count} {word}{'' if count == 1 else 's'}" for count, word in sizes if count]
        return quoted(self.name or None, f"{s.stages} stages of {s.stage:g} s", *counted)

    def pairs(self) -> dict[str, str]:
        """Names of its vectors."""
        s = self.stages
        rows = {"states": s.x_names, "inputs": s.u_names, "parameters": s.p_names}
        rows |= {"setpoints": s.r_names, "rows": s.c_names}
        return {key: ", ".join(names) for key, names in rows.items() if names}


class _Reader:
    """Reads expressions of known symbols, of which some are not of the states alone."""

    def __init__(self, known: ca.SX, inputs: ca.SX, previous: ca.SX) -> None:
        self._known, self._inputs, self._previous = known, inputs, previous

    def column(self, key: str, given: Any, size: int | None = None) -> ca.SX:
        """A column of expressions, of a size."""
        try:
            value = ca.SX(ca.vertcat(*given)) if isinstance(given, Sequence) else ca.SX(given)
        except (NotImplementedError, TypeError, RuntimeError) as error:
            raise InputError(
                f"expected an SX expression, got {shown(given)}; an MX one becomes SX by calling its Function, made "
                "with expand(), on SX symbols",
                key=key,
            ) from error
        value = ca.densify(ca.vec(value))
        if size is not None and value.numel() != size:
            raise InputError(f"expected {size} expressions, got {value.numel()}", key=key)
        probe = ca.Function("own", [self._known], [value], {"allow_free": True})
        if probe.has_free():
            raise InputError(f"unknown symbols {', '.join(map(str, probe.free_sx()))}", key=key)
        return value

    def of_state(self, value: ca.SX) -> bool:
        """Whether an expression depends on states and parameters alone."""
        return not ca.depends_on(value, ca.vertcat(self._inputs, self._previous))

    def cost(self, given: Mapping[str, Any]) -> dict[str, Residual]:
        """Terms of the cost, first those that the end of the horizon has, which alone have a final weight; value,
        weights (size) and names of entries.
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
            held = residual.final is not None and self._previous.numel() and not ca.depends_on(value, self._previous)
            ends = held or self.of_state(value)
            if np.any(final) and not ends:
                raise InputError(
                    "a final weight needs an expression of the states alone, or of the inputs where previous is given",
                    key=f"cost.{key}",
                )
            names = residual.names or _numbered(key, size)
            residuals[key] = Residual(value, weight, final if ends else None, names)
        return dict(sorted(residuals.items(), key=lambda item: item[1].final is None))

    def rows(self, given: Mapping[str, Any]) -> tuple[BoundedRows, int]:
        """Rows relative to their bounds, those of the states alone first, and how many those are."""
        read = {}
        _words("rows", given)
        for key, entry in given.items():
            row = _tuple(Row, f"rows.{key}", entry, "(expression, least, most)")
            value = self.column(f"rows.{key}", row.value)
            read[key] = row._replace(value=value, names=row.names or _numbered(key, value.numel()))
        bounded = BoundedRows()
        order = sorted(read, key=lambda key: not self.of_state(read[key].value))
        for key in order:
            row = read[key]
            penalty = _penalty(f"rows.{key}", row.penalty)
            size = len(row.names)
            pairs = zip(*(_spread(f"rows.{key}", bound, size) for bound in (row.least, row.most)), strict=True)
            for k, (least, greatest) in enumerate(_bounds(f"rows.{key}", *pair) for pair in pairs):
                scale = max([abs(bound) for bound in (least, greatest) if abs(bound) < ABSENT] or [0.0]) or 1.0
                value = row.value[k] if scale == 1.0 else row.value[k] / scale
                low, high = (bound if abs(bound) >= ABSENT else bound / scale for bound in (least, greatest))
                bounded.add([row.names[k]], value, low, high, penalty)
        _once("rows", bounded.names)
        return bounded, sum(len(read[key].names) for key in order if self.of_state(read[key].value))


def _symbols(key: str, given: Any) -> ca.SX:
    """A column of symbols."""
    try:
        symbols = ca.SX(ca.vertcat(*given)) if isinstance(given, Sequence) else ca.SX(given)
    except (NotImplementedError, TypeError, RuntimeError) as error:
        raise InputError(f"expected SX symbols, got {shown(given)}", key=key) from error
    if not symbols.numel():
        return ca.SX(0, 1)
    if not (symbols.is_dense() and symbols.is_column() and symbols.is_valid_input()):
        raise InputError(f"expected a column of SX symbols, got {shown(given)}", key=key)
    return symbols


def _names(symbols: ca.SX) -> list[str]:
    return [symbols[k].name() for k in range(symbols.numel())]


def _words(key: str, names: Iterable[Any]) -> None:
    """Refuse names that are none."""
    odd = [name for name in names if not isinstance(name, str) or not name.strip()]
    if odd:
        raise InputError(f"expected words as names, got {shown(odd[0])}", key=key)


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
        raise InputError(f"expected {expected}, got {shown(given)}", key=key)
    return kind(*given)


def _spread(key: str, given: ArrayLike, size: int) -> list[float]:
    """Bounds per entry, from a number for all or from as many."""
    bounds = np.full(size, given) if np.ndim(given) == 0 else given
    return list(map(float, vector(key, bounds, size, check=False)))


def _weights(key: str, given: ArrayLike, size: int) -> Array:
    """One weight per entry."""
    weights = np.full(size, given) if np.ndim(given) == 0 else given
    values = vector(key, weights, size)
    if np.any(values < 0.0):
        raise InputError(f"expected no negative weight, got {values.tolist()}", key=key)
    return values


def _bounds(key: str, least: Any, greatest: Any) -> tuple[float, float]:
    """Two bounds in order; infinite ones are absent."""
    low, high = (float(np.clip(value, -ABSENT, ABSENT)) for value in (least, greatest))
    if not low <= high:  # NaN too
        raise InputError(f"expected a least value that is not above the greatest, got {least!r}, {greatest!r}", key=key)
    return low, high


def _pair(key: str, given: Any) -> tuple[float, float]:
    try:
        least, greatest = (float(value) for value in given)
    except (TypeError, ValueError) as error:
        raise InputError(f"expected (least, most), got {shown(given)}", key=key) from error
    return _bounds(key, least, greatest)


def _input_bounds(limits: dict[str, Any], names: Sequence[str]) -> tuple[Array, Array]:
    """Take the bounds of inputs from all; least and greatest."""
    free = (-math.inf, math.inf)
    pairs = np.array([_pair(f"bounds.{name}", limits.pop(name, free)) for name in names])
    return pairs[:, 0].copy(), pairs[:, 1].copy()


def _state_bounds(limits: dict[str, Any], x: ca.SX) -> dict[str, Row]:
    """Take the bounds of states from all, as rows."""
    rows = {}
    for k, label in enumerate(_names(x)):
        if (name := name_of(label)) in limits:
            rows[name] = Row(x[k], *_pair(f"bounds.{name}", limits.pop(name)))
    return rows


def _penalty(key: str, given: Any) -> Penalty:
    if given is None or isinstance(given, Penalty):
        return HARD if given is None else given
    linear, quadratic = vector(f"{key}.penalty", given, 2).tolist()
    if min(linear, quadratic) < 0.0:
        raise InputError(f"expected no negative penalty weight, got {given!r}", key=key)
    return Penalty(linear=linear, quadratic=quadratic)


def _nominal(given: Mapping[str, float], names: Sequence[str]) -> Array:
    """Nominal parameters in order."""
    unknown, missing = set(given) - set(names), [name for name in names if name not in given]
    if unknown or missing:
        raise InputError(
            f"expected a value of each parameter ({', '.join(names) or 'there are none'}), got {shown(dict(given))}",
            key="nominal",
        )
    return vector("nominal", [given[name] for name in names], len(names))
