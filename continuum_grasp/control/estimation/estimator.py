"""An extended Kalman filter of a finger and its disturbances, in C."""

from __future__ import annotations

from os import PathLike

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError, Summarized, check_arguments
from continuum_grasp.control.compiled import Compiled, estimator_source
from continuum_grasp.control.estimation.adaptation import AdaptedState
from continuum_grasp.control.ocp.cost_terms import UNLIMITED
from continuum_grasp.control.parts import ControlParts
from continuum_grasp.control.prediction import Prediction
from continuum_grasp.control.status import Anomaly, MeasurementVerdict, texts
from continuum_grasp.core import CReal
from continuum_grasp.model import Remade
from continuum_grasp.scene import ControlScene, scene_of

_RESTARTED = 1
"""``EKF_RESTARTED`` of ``c/ekf.h``."""


class Filtered(Summarized):
    """Estimate after a measurement.

    Attributes
    ----------
    z, then : (nz,) ndarray
        State and disturbances now, and at the time of the measurement; the same without delay.
    p : (np,) ndarray
        Parameters with the disturbances.
    covariance : (nz, nz) ndarray
        Of ``then``.
    innovation, innovation_variance : (ny,) ndarray
        Measured minus expected of each compared quantity, taken one by one, and its variance (0: not compared).
    verdict : tuple of Verdict
        Verdict on each measurement.
    adapted : dict of str to Adapted
        Parameters of ``estimator.adapt`` by name: value, standard deviation, and whether measurements tell it.
    """

    def __init__(
        self,
        names: tuple[str, ...],
        parts: dict[str, Array],
        restarted: bool,
        adapted: tuple[AdaptedState, ...] = (),
    ) -> None:
        self._names = names
        self.z = parts["z"]
        self.p = parts["p"]
        self.then = parts["then"]
        self.covariance = parts["covariance"].reshape(self.z.size, -1)
        self.innovation = parts["innovation"]
        self.innovation_variance = parts["innovation_variance"]
        self.verdict = tuple(MeasurementVerdict(int(v)) for v in parts["verdict"])
        self.adapted = {each.name: each.read(self.p, self.z, self.std) for each in adapted}
        self.anomaly = Anomaly.ESTIMATE_RESTARTED if restarted else Anomaly(0)
        self.anomaly |= Anomaly.ESTIMATE_LIMITED if parts["limited"][0] else Anomaly(0)
        self.anomaly |= Anomaly.OLD if parts["old"][0] else Anomaly(0)
        for verdict in self.verdict:
            # USED and ALONE are no anomalies.
            self.anomaly |= Anomaly.__members__.get(verdict.name, Anomaly(0))

    def pairs(self) -> dict[str, str]:
        """Estimate, its standard deviations, verdicts and anomalies."""
        rows = {
            "z": ", ".join(f"{value:.4g}" for value in self.z),
            "std": ", ".join(f"{value:.2g}" for value in self.std),
            "verdicts": ", ".join(flag.name.lower() for flag in self.verdict),
        }
        rows |= {name: str(value) for name, value in self.adapted.items()}
        return {**rows, **({"anomalies": "; ".join(self.anomalies)} if self.anomaly else {})}

    @property
    def std(self) -> Array:
        """Standard deviations of ``then`` (nz)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def anomalies(self) -> tuple[str, ...]:
        """Anomalies as text; an anomaly of a measurement starts with the measurement's name."""
        return texts(self.anomaly, [float(v) for v in self.verdict], self._names)


class Estimator(Remade, Summarized):
    """The estimator of a control scene alone; the same C as in ``Controller``.

    Parameters
    ----------
    scene : ControlScene or path-like
        The scene, with an estimator, or its YAML file.
    precision : {"double", "float"}
        Floating-point type of the C.

    Attributes
    ----------
    scene, prediction, estimation
        The scene, its model (``Prediction``) and the functions of the filter (``Estimation``).
    period : float
        Time from one measurement to the next [s].
    delay : int
        Age of a measurement when it arrives, in periods.
    names : tuple of str
        Name and unit of each entry of ``Filtered.z``: the states of the prediction, then the disturbances.
    measurement_names : tuple of str
        Name and unit of each entry of a measurement.
    settings : dict
        Numbers of the filter, by the names in ``c/ekf.h``.
    first : (nx,) ndarray
        State of the scene's initial pose.

    Raises
    ------
    InputError
        If the scene has no estimator, its pieces do not fit together, or there is no C compiler.

    Notes
    -----
    Unknown forces and moments add to the forces in ``p``; the bending stiffness is multiplied by one plus its error.

    Examples
    --------
    >>> import continuum_grasp as cg
    >>> estimator = cg.Estimator("configs/mpc/steady_tip.yaml")
    >>> found = estimator.step([0.0, 0.18, 1.0, 1.0], [1.0, 1.0])
    >>> [verdict.name for verdict in found.verdict]
    ['USED', 'USED', 'USED', 'USED']
    >>> found.z.shape == found.std.shape == (len(estimator.names),)
    True
    """

    @check_arguments
    def __init__(self, scene: ControlScene | str | PathLike[str], *, precision: str = "double") -> None:
        self.scene = scene_of(scene, ControlScene)
        self._arguments = (self.scene,), {"precision": precision}  # no path, whose file may change
        self.prediction = Prediction(self.scene)
        self.precision = CReal.named(precision).name
        parts = ControlParts.of_scene(self.scene, self.prediction)
        self.estimation = e = parts.observed
        self.period = parts.calls.period
        self.delay = parts.periods
        self.settings = parts.filter
        self.names = parts.estimated_names
        self.measurement_names = parts.measurement_names
        nu = parts.stages.nu
        np_ = parts.stages.np
        nz = e.nz
        ny = e.ny
        nm = e.nm
        sizes = {"limited": 1, "old": 1, "z": nz, "p": np_, "verdict": nm, "innovation": ny, "innovation_variance": ny}
        sizes |= {"then": nz, "covariance": nz * nz}
        inputs = {"measurement": nm, "u": nu, "p": np_, "passed": 1, "age": 1}
        self._c = Compiled(estimator_source(parts, self.precision), parts.filter, inputs, sizes, "the estimator")
        self._measurement, self._u, self._p, self._passed, self._age = self._c.given
        self._nominal = np.array(self.prediction.p_nominal, dtype=float)
        self.first = self.prediction.first_state()
        self.reset()

    def headline(self) -> str:
        """Scene and period of the estimator."""
        return self.quoted(self.scene.name, f"{1e3 * self.period:g} ms")

    def pairs(self) -> dict[str, str]:
        """Measured and estimated quantities."""
        return {"measures": ", ".join(self.measurement_names), "estimates": ", ".join(self.names)}

    def reset(self, state: ArrayLike | None = None, u: ArrayLike | None = None) -> None:
        """Start again.

        Parameters
        ----------
        state : (nx,) array_like, optional
            Start state; by default the scene's initial pose.
        u : (nu,) array_like, optional
            Input applied before; by default least tensions or no moment.

        Raises
        ------
        InputError
            If something has another size or is not finite.
        """
        z = np.zeros(len(self.names))
        given = self.first if state is None else state
        z[: self.prediction.nx] = CheckedArgument("state", given).vector(self.prediction.nx)
        before = CheckedArgument("u", self.scene.rest_input if u is None else u).vector(self.prediction.nu)
        self._c.give("cg_start", z, before)

    @check_arguments
    def step(
        self,
        measurement: ArrayLike | None,
        u: ArrayLike,
        *,
        p: ArrayLike | None = None,
        elapsed: float | None = None,
        age: float | None = None,
    ) -> Filtered:
        """Predict over a period and update with a measurement; call it once per period.

        Parameters
        ----------
        measurement : (ny,) array_like or None
            Measurement in the order of ``measurement_names``, NaN or masked where a sensor has none; None: no sensor
            has one.
        u : (nu,) array_like
            Input applied since the last step; without effect in the first.
        p : (np,) array_like, optional
            Parameters; nominal by default.
        elapsed : float, optional
            Time since the last step, while u acted [s]; a period by default.
        age : float, optional
            Age of the measurement when it arrived [s]; ``estimator.delay`` by default. One that is no younger than the
            one before is not used.

        Returns
        -------
        Filtered

        Raises
        ------
        InputError
            If something has the wrong shape, or u, p, elapsed or age is not finite or negative.
        """
        if measurement is None:
            self._measurement[:] = np.nan
        else:
            size = self._measurement.size
            self._measurement[:] = CheckedArgument("measurement", measurement).vector(size, check=False)
        self._u[:] = CheckedArgument("u", u).vector(self._u.size)
        self._p[:] = self._nominal if p is None else CheckedArgument("p", p).vector(self._p.size)
        self._passed[0] = (
            1.0 if elapsed is None else CheckedArgument("elapsed", elapsed).number(0.0, UNLIMITED) / self.period
        )
        self._age[0] = self.delay if age is None else CheckedArgument("age", age).number(0.0, UNLIMITED) / self.period
        status, found = self._c.step()
        if status < 0:
            raise InputError("u or p is beyond what the precision can hold")
        return Filtered(self.measurement_names, found, status == _RESTARTED, self.estimation.adapted)

    def save_state(self) -> bytes:
        """Return all that the next estimate depends on."""
        return self._c.save(0)

    def restore(self, saved: bytes) -> None:
        """Continue from a saved state, which must be of the same problem, version and precision."""
        self._c.restore(saved)

    __getstate__ = save_state
    __setstate__ = restore
