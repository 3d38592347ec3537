"""The C of packages as add-ons wrap it: without what tests and describes it."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypedDict, Unpack

from continuum_grasp.base import InputError
from continuum_grasp.control import Stages
from continuum_grasp.core import CReal
from continuum_grasp.export.accuracy import Report
from continuum_grasp.export.bindings import wasm_exports, wasm_files
from continuum_grasp.export.build import WebAssembly, clang, strict_flags, write_files
from continuum_grasp.export.control.loop import ExportedPhases, Loop
from continuum_grasp.export.fields import Field
from continuum_grasp.export.layer import Contents, add_sizes, library_files
from continuum_grasp.export.manifest import manifest
from continuum_grasp.export.package import PackageOptions, contents_of, subject_of
from continuum_grasp.export.parts import PARTS
from continuum_grasp.export.source import Given, parts_of, source_of, title_of
from continuum_grasp.export.subject import Subject
from continuum_grasp.export.targets import target_of
from continuum_grasp.scene import ControlScene


class LibraryOptions(TypedDict, total=False):
    """Options of a package that add-ons set, see `PackageOptions`."""

    real: str | None
    what: Sequence[str] | None
    prefix: str
    ranges: Mapping[str, Sequence[float]] | None
    step: float | None
    substeps: int | None
    finger: str | None


@dataclass(frozen=True)
class Library:
    """The library of a package, with its manifest."""

    contents: Contents
    files: Mapping[str, str]
    """Headers and sources by path."""
    manifest: Mapping[str, Any]

    @staticmethod
    def of(given: Given, *, if_possible: Sequence[str] = (), **options: Unpack[LibraryOptions]) -> Library:
        """The library with the parts of the options, and with the possible ones among ``if_possible``."""
        chosen = PackageOptions(**options)
        _, computed_in = target_of(chosen.target, chosen.real)
        kind = CReal.KINDS[computed_in]
        source = source_of(given, kind, chosen.finger)
        asked = parts_of(chosen.what, source)
        subject = subject_of(source, asked, kind, chosen)
        further = [name for name in if_possible if _is_possible(name, subject)]
        contents = contents_of(subject, [name for name in PARTS if name in (*asked, *further)], source.title)
        if contents.stateful:
            add_sizes(contents)
        files = library_files(contents)
        values = manifest(
            contents, Report({}, {}, None), target=chosen.target, files=files, configuration=source.configuration
        )
        return Library(contents, files, values)

    @staticmethod
    def flags(version: str = "gcc") -> list[str]:
        """Flags of a compiler, by its version text, with which results are the same to the last bit."""
        return strict_flags(version)

    @property
    def subject(self) -> Subject:
        """Model and loop that it was made of."""
        return self.contents.subject

    @property
    def title(self) -> str:
        """Title of the scene."""
        return self.contents.words["title"]

    @property
    def parts(self) -> list[str]:
        """Names of its parts."""
        return [part.name for part in self.contents.parts]

    @property
    def sources(self) -> dict[str, str]:
        """Headers and sources by file name."""
        return {Path(path).name: text for path, text in self.files.items() if path.startswith(("include/", "src/"))}

    @property
    def structs(self) -> dict[str, tuple[Field, ...]]:
        """Fields of the structs of its header."""
        return {struct.name: struct.fields for struct in self.contents.structs}


def _is_possible(part: str, subject: Subject) -> bool:
    """Whether there is a part: ``contact`` with an object, ``linearization`` without, where it is not too large."""
    touches = subject.touching is not None
    if part == "contact" or touches:
        return touches and part == "contact"
    try:
        PARTS[part](subject)
    except InputError:
        return False
    return True


class WasmController:
    """The controller of a closed loop in double precision, as WebAssembly for a page.

    With the ``phases`` of a mission where it has one, by the problem of its controller.
    """

    def __init__(self, scene: ControlScene, phases: Callable[[Stages], ExportedPhases] | None = None) -> None:
        kind = CReal.KINDS["double"]
        names = ["mpc", *(["mission"] if phases is not None else [])]
        self.loop = Loop.of(scene, kind, names, phases)
        self._contents = contents_of(Subject("finger", kind, loop=self.loop), names, title_of(scene))
        files = library_files(self._contents)
        self._files = {Path(path).name: text for path, text in files.items() if not path.startswith("tests/")}

    def module(self) -> bytes:
        """Compile it."""
        return WebAssembly.module(self._files, ["__heap_base", *wasm_exports(self._contents)])

    @cached_property
    def plan(self) -> tuple[int, int]:
        """Place of the plan within the controller, or within its mission, [bytes] and the number of its nodes."""
        *_, place, nodes = self._sizes
        return place, nodes

    @property
    def wrapper(self) -> str:
        """Script that calls the module."""
        for name, size in zip(self._owned, self._sizes, strict=False):
            self._contents.words[f"{name}_bytes"] = str(size)
        return wasm_files(self._contents)["wasm/finger.mjs"]

    @property
    def _owned(self) -> list[str]:
        """Types of its memory."""
        return [name for function in self._contents.stateful for name in function.types]

    @cached_property
    def _sizes(self) -> list[int]:
        """Bytes of each type of its memory, the place of the plan [bytes], and the number of its nodes."""
        prefix = self._contents.subject.prefix
        owner, plan = ("mission", "controller.") if "mission" in self._owned else ("controller", "")
        states = f"(({prefix}_controller *)0)->memory.state.plan.x"
        counted = [
            *(f"sizeof({prefix}_{name})" for name in self._owned),
            f"__builtin_offsetof({prefix}_{owner}, {plan}memory.state.plan.x)",
            f"sizeof {states} / sizeof {states}[0]",
        ]
        source = f'#include "{prefix}.h"\nconst unsigned int sizes[] = {{{", ".join(counted)}}};\n'
        with tempfile.TemporaryDirectory() as folder:
            write_files(Path(folder), {**self._files, "sizes.c": source})
            assembly = clang(Path(folder), "-I.", "-S", "sizes.c", "-o", "-")
        return [int(number) for number in re.findall(r"^\s*\.int32\s+(\d+)", assembly, re.MULTILINE)]
