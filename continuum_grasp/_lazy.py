"""Names of a package that are loaded when they are first used."""

from __future__ import annotations

import sys

TYPE_CHECKING = False  # typing takes longer to import than everything here
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from typing import Any


def lazy_names(
    package: str, modules: Mapping[str, Sequence[str]], gone: Mapping[str, str] | None = None
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """The ``__getattr__`` and ``__dir__`` of a package whose public names, by module, lie in other modules.

    ``gone`` has names that left, and what there is in their place.
    """
    module_of = {name: module for module, names in modules.items() for name in names}

    def load_name(name: str) -> Any:
        module = module_of.get(name)
        if module is None:
            instead = f": {gone[name]}" if gone and name in gone else ""
            raise AttributeError(f"module {package!r} has no attribute {name!r}{instead}")
        from importlib import import_module

        value = getattr(import_module(module), name)
        # The next access finds the name in the module and does not come here.
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *module_of})

    return load_name, names


def checked_imports(package: str) -> dict[str, list[str]]:
    """Names by module, from the lines ``from MODULE import NAME as NAME`` that a package has for the type checker.

    One list then serves type checkers, which read no tables, and the interpreter, which skips these lines.
    """
    module: Any = sys.modules[package]
    # get_data, as get_source imports tokenize, which takes longer than all else here.
    source = module.__spec__.loader.get_data(module.__file__).decode("utf-8")
    names: dict[str, list[str]] = {}
    for line in source.splitlines():
        words = line.split()
        if line.startswith("    from ") and words[4:] == ["as", words[3]]:
            names.setdefault(words[1], []).append(words[3])
    return names
