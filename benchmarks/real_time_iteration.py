"""Single calls of the real-time iteration in C, and its QPs: what tests and benchmarks look at one by one.

Users have `continuum_grasp.rti`.
"""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Numbers as Array
from continuum_grasp.base import SolverError
from continuum_grasp.control import Stages
from continuum_grasp.control.iteration import source as rti
from continuum_grasp.control.members import CHANGEABLE
from continuum_grasp.core import Compiler

STATUS = {
    0: "solved",
    1: "iteration limit",
    2: "row violated",
    -1: "bad input",
    -2: "bad linearization",
    -3: "bad solution",
    -4: "not prepared",
}
"""Names of the statuses; those from 0 on give a usable plan, the others leave the plan as it was."""

_UNSETTLED, _VIOLATED = 1, 2

_ITERATIONS = 60
"""Default for the greatest number of factorizations of a QP [1], which bounds the time of a call; in the shipped closed
loops a QP takes at most 32 (configs/mpc/keep_out.yaml), in the shipped missions 35."""


_SETTLED = {"double": 1e-6, "float": 1e-3}
"""Change of an input by an iteration, relative to its bounds, that counts as none [1]: 100 and 10 times the tolerance
of the QP's solution."""


PROBLEM = ("x", "u", "M", "defect", "l", "g", "H", "c", "C")
"""Members of the workspace that define the QP."""


class Report(NamedTuple):
    """Outcome of an iteration: ``rti_report`` of ``c/rti.h``, its status a key of ``STATUS``.

    ``violated`` names the rows that are violated, in their order.
    """

    status: int
    iterations: int
    kkt: float
    violation: float
    cost: float
    violated: tuple[str, ...] = ()


class Settings:
    """Bounds, penalty weights and weights, which may be changed between iterations, in the memory layout of the C.

    Attributes are the members of ``rti_settings`` in ``c/rti.h``, at first those of the problem; they read as arrays or
    numbers and can be assigned, and so can entries of arrays.
    """

    def __init__(self, stages: Stages, real: Any) -> None:
        nominal = {name: getattr(stages, name) for name, *_ in CHANGEABLE}
        # An array without entries has one in C, which has no arrays of length zero.
        arrays = [(name, real, (max(len(value), 1),)) for name, value in nominal.items()]
        numbers: list[Any] = [("stage", real), ("substeps", np.intc), ("iterations", np.intc)]
        numbers += [("tolerance", real), ("regularization", real, stages.u_min.shape)]
        robust = rti.scenario_settings(stages)
        numbers += [(name, real, value.shape) for name, value in robust.items()]
        layout = np.dtype([*arrays, *numbers], align=True)
        memory = np.zeros((), layout)
        tolerance = rti.TOLERANCE["double" if np.dtype(real) == np.float64 else "float"]
        own = {"stage": stages.stage, "substeps": stages.substeps, "iterations": _ITERATIONS, "tolerance": tolerance}
        own |= {"regularization": rti.regularization(stages.u_min, stages.u_max)}
        fields = {name: memory[name] for name in layout.names or ()}
        fields |= {name: fields[name][: len(value)] for name, value in nominal.items()}
        self.__dict__.update(_memory=memory, _fields=fields, size=layout.itemsize)
        self.__dict__["address"] = ctypes.c_void_p(memory.ctypes.data)
        for name, value in {**nominal, **own, **robust}.items():
            setattr(self, name, value)

    def __getattr__(self, name: str) -> Any:
        fields = self.__dict__.get("_fields", {})
        if name not in fields:
            raise AttributeError(f"no setting {name!r}; there are {', '.join(fields)}")
        return fields[name] if fields[name].ndim else fields[name].item()

    def __setattr__(self, name: str, value: ArrayLike) -> None:
        self._fields[name][...] = value


class RealTimeIteration:
    """Real-time iterations of an optimal control problem (M. Diehl et al., doi:10.1016/S0959-1524(02)00023-1).

    An iteration linearizes the problem at the plan and replaces the plan by the solution of the resulting QP (full
    step). The states of the plan are variables (multiple shooting), so each iteration closes the gaps that the previous
    one left. It runs in C on memory of this object, by ``settings``; use one object per thread. What the C refuses is a
    SolverError with the status.

    ``precision`` is the floating-point type of the C, "double" or "float"; arguments may be doubles in either case.
    With ``lanes`` stages are linearized side by side in vector lanes.
    """

    def __init__(self, stages: Stages, *, precision: str = "double", lanes: bool = True) -> None:
        self.stages = stages
        self.precision = precision
        source = library_source(stages, real=self.precision, lanes=lanes)
        self._library = library = Compiler.load(source, "the real-time iteration")
        real: Any = np.float64 if self.precision == "double" else np.float32
        self._number = ctypes.c_double if self.precision == "double" else ctypes.c_float
        n, nx, nu = stages.stages, stages.nx, stages.nu
        self.settings = Settings(stages, real)
        self._x0, self._p = np.zeros(nx, real), np.array(stages.p_nominal, real)
        self._refs = np.zeros((n + 1, stages.nr), real)
        # The plan's members lie as in ``rti_plan``: x, u, then what the next QP starts from, zeroed by ``reset``.
        plan = np.zeros(-(-library.rti_sizeof(1) // np.dtype(real).itemsize), real)
        states, inputs = stages.plants * (n + 1) * nx, stages.plants * n * nu
        self._x, self._u = plan[:states].reshape(-1, nx), plan[states : states + inputs].reshape(-1, nu)
        self._warm_start = plan[states + inputs :]
        self._work = np.zeros(library.rti_sizeof(2), np.uint8)
        self._record = _record(self._number, stages.nc)
        # numpy and ctypes lay structures out as a C compiler does by default; one that packs them is refused.
        sizes = self.settings.size, plan.nbytes, self._work.nbytes, ctypes.sizeof(self._record)
        if sizes != tuple(library.rti_sizeof(k) for k in range(4)):
            raise RuntimeError(f"the C compiler has an unexpected layout of structures: {sizes}")
        # Arguments of all calls, built once: a call takes less time than wrapping its pointers.
        self._plan_at, self._settings_at = _address(plan), self.settings.address
        self._work_at, self._x0_at, self._p_at = _address(self._work), _address(self._x0), _address(self._p)
        head = self._work_at, self._plan_at, self._settings_at
        self._preparation = *head, self._p_at, _address(self._refs)
        self._answer = *head, self._x0_at, ctypes.byref(self._record)
        self._progress = *head, self._x0_at, self._p_at, _address(self._refs)
        self._prepare, self._feedback, self._continue = library.rti_prepare, library.rti_feedback, library.rti_continue
        library.rti_change.restype = ctypes.c_double

    @property
    def plan(self) -> tuple[Array, Array]:
        """States (N + 1, nx) and inputs (N, nu) of the plan: views, which the next iteration overwrites.

        With scenarios those of the first, and behind them those of the others.
        """
        return self._x, self._u

    def reset(self, x0: ArrayLike, u0: ArrayLike | None = None, *, rollout: bool = False) -> None:
        """Start a plan that stays at a state x0 (nx), or with ``rollout`` that the input u0 (nu) drives from there.

        By default the input is zero, or the nearest bound.
        """
        u = np.clip(np.zeros(self.stages.nu), self.settings.u_min, self.settings.u_max) if u0 is None else u0
        self._x0[...] = x0
        self._x[:] = self._x0
        self._warm_start[:] = 0
        self._u[...] = u
        if rollout:
            given = self._settings_at, self._x0_at, self._p_at
            self._must(self._library.rti_rollout(self._plan_at, self._work_at, *given))

    def step(self, x0: ArrayLike, refs: ArrayLike | None = None, p: ArrayLike | None = None) -> Report:
        """An iteration from a state x0 (nx); ``plan[1][0]`` is the input to apply.

        ``refs`` are the setpoints of the nodes (N + 1, nr), or one row for all; by default those of the last call (zero
        at first). ``p`` are parameters (np); by default those of the last call (nominal at first).
        """
        self.prepare(refs, p)
        return self.feedback(x0)

    def iterate(
        self, x0: ArrayLike, refs: ArrayLike | None = None, p: ArrayLike | None = None, *, iterations: int = 60
    ) -> Report:
        """Iterate from one state until the inputs settle, to the optimum of the nonlinear problem.

        Where full steps do not settle, or lead to where the model is not finite, a search for the step length along
        integrated trajectories takes over. The report is that of the last iteration, with all factorizations; its
        status is that of ``iteration limit`` where the inputs still changed by more than 1e-6 (single precision: 1e-3)
        of their bounds.
        """
        self._given(refs, p)
        self._x0[...] = x0
        self._library.rti_begin(self._work_at)
        settled, factorizations = _SETTLED[self.precision], 0
        for _ in range(iterations):
            status = self._prepare(*self._preparation)
            if status >= 0:
                status = self._feedback(*self._answer)
                factorizations += self._record.iterations
            status = self._continue(*self._progress, status)
            self._must(status)
            change = self._library.rti_change(self._work_at, self._settings_at)
            if change <= settled or self._library.rti_stuck(self._work_at):
                break
        report = self._report()
        return report._replace(iterations=factorizations, status=report.status if change <= settled else _UNSETTLED)

    def prepare(self, refs: ArrayLike | None = None, p: ArrayLike | None = None) -> None:
        """Linearize at the plan, before the state is known; see ``step``."""
        self._given(refs, p)
        self._must(self._prepare(*self._preparation))

    def _given(self, refs: ArrayLike | None, p: ArrayLike | None) -> None:
        if refs is not None:
            self._refs[...] = refs
        if p is not None:
            self._p[...] = p

    def feedback(self, x0: ArrayLike) -> Report:
        """Solve for a state, and replace the plan; see ``step``."""
        self._x0[...] = x0
        self._must(self._feedback(*self._answer))
        return self._report()

    def _report(self) -> Report:
        record = self._record
        names = zip(self.stages.c_names, record.violated, strict=False) if record.status == _VIOLATED else ()
        violated = tuple(name for name, excess in names if excess > 0.0)
        return Report(record.status, record.iterations, record.kkt, record.violation, record.cost, violated)

    def shift(self, stages: float = 1.0) -> None:
        """Shift the plan by a number of stages, whole or not.

        States are interpolated between the nodes and inputs averaged over the new stages; beyond the horizon the last
        ones are repeated.
        """
        self._library.rti_shift(self._plan_at, self._settings_at, self._number(stages))

    def qp(self) -> dict[str, Array]:
        """Copy the QP of the last preparation; ``control/c/rti.h`` defines it.

        x (N+1, nx) and u (N, nu), the plan; A (N, nx, nx), B (N, nx, nu), defect (N, nx); l (N+1), g (N+1, nz),
        H (N+1, nz, nz); c (N+1, nc), C (N+1, nc, nz). What a node does not have is zero. With scenarios those of all,
        one after the other.
        """
        s = self.stages
        nx, nu, nz, nc = s.nx, s.nu, s.nx + s.nu, s.nc
        n, nodes = s.plants * s.stages, s.plants * (s.stages + 1)
        width = self._library.rti_width()
        shapes = {"x": (nodes, nx), "u": (n, nu), "M": (n, nx, width), "defect": (n, nx), "l": (nodes,)}
        shapes |= {"g": (nodes, width), "H": (nodes, nz, width), "c": (nodes, max(nc, 1)), "C": (nodes, max(nc, 1), nz)}
        found = {}
        for k, name in enumerate(PROBLEM):
            where = self._library.rti_offset(k)
            count = int(np.prod(shapes[name])) * self._x.itemsize
            found[name] = self._work[where : where + count].view(self._x.dtype).reshape(shapes[name]).copy()
        m = found.pop("M")
        found |= {"A": m[..., :nx], "B": m[..., nx:nz], "g": found["g"][:, :nz], "H": found["H"][..., :nz]}
        return found | {"c": found["c"][:, :nc], "C": found["C"][:, :nc]}

    def _must(self, status: int) -> None:
        if status < 0:
            raise SolverError("real-time iteration", status=STATUS[status])


def library_source(stages: Stages, *, real: str = "double", lanes: bool = True) -> str:
    """Write the C of the iterations with the sizes and offsets that a caller from another language needs."""
    offsets = ", ".join(f"offsetof(rti_work, {name})" for name in PROBLEM)
    structures = ", ".join(f"sizeof(rti_{name})" for name in ("settings", "plan", "work", "report"))
    return f"""{rti.iteration_source(stages, real=real, lanes=lanes)}
int rti_sizeof(int which)
{{
  const size_t sizes[] = {{{structures}}};
  return (int)sizes[which];
}}
int rti_width(void) {{ return RTI_W; }}
double rti_change(const rti_work *o, const rti_settings *s) {{ return (double)rti_input_change(o, s); }}
int rti_stuck(const rti_work *work) {{ return work->search == RTI_STUCK; }}
int rti_offset(int which)
{{
  const size_t offsets[] = {{{offsets}}};
  return (int)offsets[which];
}}
"""


def _address(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _record(number: Any, rows: int) -> Any:
    """Memory for a report of the C code."""
    # Of the violated rows the C has the excess of each, in an array of one entry at least.
    kinds = (ctypes.c_int, ctypes.c_int, number, number, number, number * max(rows, 1))
    return type("_Record", (ctypes.Structure,), {"_fields_": list(zip(Report._fields, kinds, strict=True))})()
