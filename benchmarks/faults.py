"""One-line faults in all modules, read from ``faults.txt``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path


@dataclass(frozen=True)
class Fault:
    """A fault: what stands in a file just once, and what is put in its place."""

    file: str
    right: str
    wrong: str
    tests: tuple[str, ...]
    reason: str = ""
    """Why the program is as good with it, where no test can notice it."""

    @property
    def name(self) -> str:
        """File and what is put there."""
        return f"{self.file}: {self.right} -> {self.wrong}"

    def put_into(self, text: str) -> str:
        """Put the fault into the text of its file; a fault that fits nowhere, or twice, is an error."""
        if text.count(self.right) != 1:
            raise ValueError(f"{self.name}: stands {text.count(self.right)} times in the file, expected once")
        return text.replace(self.right, self.wrong)


def _read() -> tuple[Fault, ...]:
    """The faults, in their order; ``faults.txt`` says how they are written."""
    found: list[Fault] = []
    file, tests, right = "", (), ""
    for line in Path(__file__).with_suffix(".txt").read_text(encoding="utf-8").splitlines():
        mark, text = line[:2], line[2:]
        if mark == "- ":
            right = text
        elif mark == "+ ":
            found.append(Fault(file, right, text, tests))
        elif mark == "? ":
            found[-1] = replace(found[-1], reason=text)
        elif line and mark != "# ":
            file, _, paths = line.partition(": ")
            tests = tuple(f"tests/{path}" for path in paths.split())
    return tuple(found)


FAULTS = _read()
