"""Finding how a finger holds an object, and proving that it does."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

_MODULES = {
    "certificate.certificate": ("Certificate", "Check", "certify"),
    "result": ("Contact", "FingerPosture", "GraspResult", "Reason", "Status"),
    "solve": ("optimize_grasp",),
}
_NAMES = {name: room for room, names in _MODULES.items() for name in names}

__all__ = [
    "Certificate",
    "Check",
    "Contact",
    "FingerPosture",
    "GraspResult",
    "Reason",
    "Status",
    "certify",
    "optimize_grasp",
]

if TYPE_CHECKING:
    from continuum_grasp.grasp.certificate.certificate import Certificate, Check, certify
    from continuum_grasp.grasp.result import Contact, FingerPosture, GraspResult, Reason, Status
    from continuum_grasp.grasp.solve import optimize_grasp


def __getattr__(name: str) -> Any:
    room = _NAMES.get(name)
    if room is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"{__name__}.{room}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_NAMES})
