"""What a package is made for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from continuum_grasp.errors import InputError

__all__ = ["TARGETS", "Target", "target_of"]


@dataclass(frozen=True)
class Target:
    """A machine, with the real types that its hardware computes in."""

    name: str
    reals: tuple[str, ...]
    """The usual one first."""
    core: str | None = None
    """Argument of ``examples/baremetal/run.sh``."""

    def real(self, given: Any) -> str:
        """The type that is asked for, or the usual one.

        Raises
        ------
        InputError
            If the hardware does not compute in it.
        """
        if given is None:
            return self.reals[0]
        if given in ("float", "double") and given not in self.reals:
            raise InputError(
                f"{self.name} computes {given} in software, 22 to 35 times slower: expected {self.reals[0]}",
                key="real",
            )
        return str(given)


TARGETS = {
    target.name: target
    for target in (
        Target("host", ("double", "float")),
        Target("cortex-m4f", ("float",), "cortex-m4f"),
        Target("cortex-m7", ("double", "float"), "cortex-m7"),
        Target("wasm", ("double", "float")),
    )
}


def target_of(name: Any) -> Target:
    """The target of a name.

    Raises
    ------
    InputError
        If there is none.
    """
    if not isinstance(name, str) or name not in TARGETS:
        raise InputError(f"expected one of {', '.join(TARGETS)}, got {name!r:.60}", key="target")
    return TARGETS[name]
