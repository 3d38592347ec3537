"""Members of a controller's C that Python, packages and units have too: each is listed here, and nowhere else."""

from __future__ import annotations

from typing import NamedTuple


class Changeable(NamedTuple):
    """An array of ``rti_settings`` of ``c/rti.h`` and of ``Stages`` that may change between calls."""

    name: str
    of: str
    """Entries that it has a number for: r, setpoints; u, inputs; c, rows."""
    exported: str
    """Name in the settings of a package: ``{}`` stands for the name of an entry."""
    text: str


CHANGEABLE = (
    Changeable("weights", "r", "weight_{}", "of half the squared error of {0}, per second"),
    Changeable("terminal_weights", "r", "terminal_weight_{}", "the same at the end of the horizon, once"),
    Changeable("u_min", "u", "least_{}", "least command"),
    Changeable("u_max", "u", "most_{}", "greatest command"),
    Changeable("c_min", "c", "least_{}", "least value of row {0}, in shares of its scale"),
    Changeable("c_max", "c", "most_{}", "greatest value"),
    Changeable("linear", "c", "penalty_{}", "penalty of leaving it, per share"),
    Changeable("quadratic", "c", "square_penalty_{}", "of half the squared share"),
)
"""All of them, in the order of ``rti_settings`` and of the settings of packages."""


class Reported(NamedTuple):
    """A number of ``controller_output`` of ``c/controller.h``."""

    name: str
    place: str
    """Place in the structure."""
    kind: str
    """Type in C."""
    exported: str = ""
    """Name in the diagnosis of a package; empty if it is not part of it."""
    text: str = ""


REPORTED = (
    Reported(
        "anomalies", "anomalies", "uint32_t", "anomalies", "what was noticed, bits of ..._ANOMALY_... in the header"
    ),
    Reported("missed", "missed", "real", "missed", "calls that were missed before this one, by the time between them"),
    Reported("iterations", "rti.iterations", "int", "iterations", "factorizations beyond the first"),
    Reported(
        "violation", "rti.violation", "real", "violation", "largest share by which a soft bound is left in the plan"
    ),
    Reported("residual", "rti.kkt", "real", "residual", "of the optimality conditions, relative"),
    Reported("cost", "rti.cost", "real", "cost", "of the plan"),
    Reported(
        "health",
        "supervisor.health",
        "int",
        "health",
        "..._HEALTH_...: 0 well, 1 mismatch, 2 detuned, 3 a reading is frozen, 4 tripped, 5 the tip stays off",
    ),
    Reported(
        "sensor",
        "supervisor.sensor",
        "int",
        "sensor",
        "number of the sensor, ..._SENSOR_..., that contradicts the model most",
    ),
    Reported(
        "entry",
        "supervisor.entry",
        "int",
        "frozen",
        "number of a reading that does not move, in the order of the measurement; -1: none",
    ),
    Reported("reason", "supervisor.reason", "int", "trip", "..._TRIP_...: why the controller is tripped; 0: it is not"),
    Reported("rung", "supervisor.rung", "int", "rung", "how often the weight of the command's rate is raised fourfold"),
    Reported("sight", "sight", "int"),
    Reported("ahead", "supervisor.ahead", "int"),
    Reported("cause", "supervisor.cause", "int", "cause", "..._OFFSET_...: why the tip stays away from its setpoint"),
    Reported(
        "offset",
        "supervisor.offset",
        "real",
        "offset",
        "distance [m] at which the measured tip stays from a setpoint that stands; 0 where it does not",
    ),
    Reported(
        "mismatch",
        "supervisor.mismatch",
        "real",
        "mismatch",
        "mean squared normalized innovation of that sensor; about 1 where all is well",
    ),
    Reported(
        "activity",
        "supervisor.activity",
        "real",
        "activity",
        "mean squared change of the command, per that at its rate limit",
    ),
)
"""Numbers of a command, in the order of the C and of packages."""
