"""The shipped examples: configurations that run, what each needs, and how it is run; and notebooks.

A checkout has them in its ``configs``, ``schema`` and ``notebooks``; a wheel has these folders inside the package.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from continuum_grasp.base import InputError, nearest

__all__ = ["Example", "copy_example", "copy_notebooks", "example", "examples", "shipped_folder"]

_SCHEMA_LINE = "# yaml-language-server: $schema="
_READ = re.compile(r'configs / \\"(\w+)\\" / \\"(\w+)\.yaml\\"')
"""A configuration that a notebook reads, within a string of JSON."""
_SENTENCE = re.compile(r".*?[.?!](?=\s|$)")


@dataclass(frozen=True)
class Example:
    """A shipped configuration: folder and name of its file such as ``grasp/mug``, the file, its kind as in
    ``continuum-grasp schema KIND``, and the first sentence of the comment at its head.
    """

    name: str
    path: Path
    kind: str
    summary: str

    @property
    def verb(self) -> str:
        """The command that runs it; a finger alone can only be checked."""
        from continuum_grasp.scene import kinds

        return kinds()[self.kind].command or "validate"

    @cached_property
    def files(self) -> tuple[Path, ...]:
        """Every file that it needs, its own first, then the fingers, grasps and data that it names, and schemas."""
        root = shipped_folder()
        files = dict.fromkeys([self.path, *(file for file in _named(self.path) if isinstance(file, Path))])
        schemas = [_schema_of(file, file.read_text(encoding="utf-8")) for file in files if file.suffix == ".yaml"]
        schemas.append(schemas[0].with_name("definitions.json"))  # what they share
        return tuple(file.relative_to(root) for file in dict.fromkeys([*files, *schemas]))

    @cached_property
    def missing(self) -> tuple[str, ...]:
        """Names of the data files that it needs and that are not shipped."""
        return tuple(dict.fromkeys(name for name in _named(self.path) if isinstance(name, str)))

    @property
    def arguments(self) -> tuple[str, ...]:
        """Arguments of ``continuum-grasp`` that run the example in a folder that has its files."""
        return (self.verb, self.files[0].as_posix())


def shipped_folder() -> Path:
    """The folder that has ``configs`` and ``schema``: the package of a wheel, or the root of a checkout."""
    package = Path(__file__).absolute().parent
    for folder in (package, package.parent):
        if (folder / "configs").is_dir():
            return folder
    raise InputError("this installation has no examples; install the package again", file=str(package / "configs"))


@cache
def examples() -> dict[str, Example]:
    """All shipped examples by name, in the order of the verbs that run them, fingers last."""
    from continuum_grasp.scene import kinds

    verbs = [kind.command for kind in kinds().values() if kind.command is not None]
    order = {name: verbs.index(kind.command) if kind.command else len(verbs) for name, kind in kinds().items()}
    shipped = [_example(path) for path in sorted((shipped_folder() / "configs").glob("*/*.yaml"))]
    return {entry.name: entry for entry in sorted(shipped, key=lambda entry: order[entry.kind])}


def example(name: str) -> Example:
    """The example of a name; where there is none, the InputError has names that are near."""
    if name not in examples():
        raise InputError(f"no example {name!r}{nearest(name, examples(), say_all=False)}")
    return examples()[name]


def copy_example(name: str, folder: Path) -> list[Path]:
    """Copy an example, with every file that it needs, into a folder, laid out as they are shipped.

    Files that are there already and say the same stay as they are, so that one folder takes several examples. Returns
    the files in the folder, the example's own first. Where there is no such example, data that it needs are not
    shipped, or the folder has another file where one would be written, nothing is written: InputError.
    """
    source = example(name)
    if source.missing:
        raise InputError(f"{name} needs measured data that are not shipped: {', '.join(source.missing)}")
    return _copy(source.files, folder)


def copy_notebooks(folder: Path) -> list[Path]:
    """Copy the notebooks that need nothing but the package, with the configurations that they read, as `copy_example`
    copies.
    """
    root = shipped_folder()
    texts = {file.relative_to(root): file.read_text(encoding="utf-8") for file in root.glob("notebooks/*.ipynb")}
    alone = [file for file, text in sorted(texts.items()) if "benchmarks." not in text]
    read = {name for file in alone for name in _READ.findall(texts[file])}
    needed = [file for name in sorted(read) for file in example("/".join(name)).files]
    return _copy(dict.fromkeys([*alone, *needed]), folder)


def _copy(files: Iterable[Path], folder: Path) -> list[Path]:
    """Copy shipped files into a folder; nothing is written where one is there with other content."""
    from continuum_grasp.results import replacing

    root = shipped_folder()
    contents = {folder / file: (root / file).read_bytes() for file in files}
    new = {file: content for file, content in contents.items() if not (file.is_file() and file.read_bytes() == content)}
    if there := [str(file) for file in new if file.exists() or file.is_symlink()]:
        raise InputError(f"these files exist with other content: {', '.join(there)}; nothing was overwritten")
    for file, content in new.items():
        with replacing(file) as temporary:
            temporary.write_bytes(content)
    return list(contents)


def _example(path: Path) -> Example:
    text = path.read_text(encoding="utf-8")
    return Example(f"{path.parent.name}/{path.stem}", path, _schema_of(path, text).stem, _summary(text))


def _schema_of(path: Path, text: str) -> Path:
    """The schema that a configuration names in its first line; it has the name of the kind."""
    return _beside(path, text.partition("\n")[0].removeprefix(_SCHEMA_LINE))


def _beside(path: Path, target: str) -> Path:
    """A file that another one names; links are not followed, as some installers link every file."""
    return Path(os.path.normpath(path.parent / target))


def _summary(text: str) -> str:
    """The first sentence of the comment at the head of a configuration, without its full stop."""
    lines = text.splitlines()[1:]
    count = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    comment = " ".join(line.lstrip("# ") for line in lines[:count])
    sentence = _SENTENCE.match(comment)
    return (sentence[0] if sentence else comment).removesuffix(".")


def _named(path: Path) -> Iterator[Path | str]:
    """Files that a configuration names, and those that they name; of data that are not there, the name."""
    from continuum_grasp.scene import read_yaml

    for text in _texts(read_yaml(path).value):
        if text.endswith(".yaml"):
            file = _beside(path, text)
            yield file
            yield from _named(file)
        elif text.endswith((".csv", ".svg", ".dxf", ".png", ".stl", ".obj", ".ply", ".3mf")):
            data: list[Path | str] = [*sorted(path.parent.glob(text))]
            yield from data or [text]


def _texts(value: Any) -> Iterator[str]:
    """All texts in plain data."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict | list):
        for child in value.values() if isinstance(value, dict) else value:
            yield from _texts(child)
