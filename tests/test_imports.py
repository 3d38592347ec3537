"""Which module may import which, and who prints: read off the source."""

from __future__ import annotations

import ast
import tomllib
from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest

PACKAGE = Path(__file__).parents[1] / "continuum_grasp"
FILES = sorted(PACKAGE.rglob("*.py"))
TESTS = Path(__file__).parent
TASKS = ("continuum_grasp.addons.learning.environments.tasks",)
"""What registers environments with gymnasium, where that is installed."""
COMMON = {"base", "lazy_loader", ""}
"""What all may import; the empty name is the package itself."""
ALLOWED = {
    module: set(imported.split())
    for module, imported in {
        "base": "base",
        "scene": "scene",
        "rod": "rod scene",
        "model": "model scene",
        "core": "core model scene results",
        "nlp": "nlp core model scene",
        "simulation": "simulation rod core model scene results plotting",
        "grasp": "grasp nlp rod core model scene results plotting",
        "control": "control nlp simulation core model scene",
        "closed_loop": "closed_loop nlp control simulation core model scene results",
        "export": "export closed_loop control simulation core model scene results",
        "examples": "scene results",
        "results": "results",
        "plotting": "plotting scene",
    }.items()
}
ADDONS = [
    f"addons.{folder.name}" for folder in sorted((PACKAGE / "addons").iterdir()) if (folder / "__init__.py").exists()
]
"""These may import all of the core, and each other."""
ALLOWED |= {addon: {*ALLOWED, *ADDONS, "cli"} for addon in ADDONS}
"""Modules by who imports them; ``cli`` and the package itself may import everything."""
DRAWING = {"matplotlib", "typer", "rich"}
_OF_MODELS = frozenset({"yaml", *DRAWING})
OUTSIDE = {
    "scene": {"casadi", *DRAWING},
    "rod": {"casadi", "yaml", *DRAWING},
    **dict.fromkeys(("model", "core", "nlp", "simulation", "grasp", "control"), _OF_MODELS),
    **dict.fromkeys(("closed_loop", "addons.planning", "addons.mission", "addons.learning"), _OF_MODELS),
    "export": DRAWING,
    "addons.sweeps": {"casadi", "yaml"},
    "addons.design": {"yaml"},
    "results": {"casadi", *DRAWING},
    "examples": {"casadi", "numpy", "scipy", "yaml", *DRAWING},
    "plotting": {"casadi", "typer", "rich", "yaml"},
}
"""Packages that a module does without."""


@cache
def tree(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


class Announced(NamedTuple):
    module: str
    name: str


ENTRIES = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]
ANNOUNCED = [Announced(*entry.split(":")) for entry in ENTRIES["continuum_grasp.addons"].values()]
"""Add-ons of the package, as its metadata name them."""


def door(package: str) -> dict[str, str]:
    """Names that a package lets through, each with the module that defines it: its ``__init__.pyi``."""
    stub = PACKAGE / package.replace(".", "/") / "__init__.pyi"
    lines = tree(stub).body if stub.exists() else []
    return {
        alias.name: f"continuum_grasp.{package}.{line.module}"
        for line in lines
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }


def module_of(file: Path) -> str:
    """The first folder or file below the package, or below its add-ons."""
    first, *rest = (part.removesuffix(".py").removeprefix("__init__") for part in file.relative_to(PACKAGE).parts)
    return f"{first}.{rest[0]}".removesuffix(".") if first == "addons" else first


STUBS = [*PACKAGE.glob("*/__init__.pyi"), *PACKAGE.glob("addons/*/__init__.pyi")]
DOORS = {package: door(package) for package in map(module_of, STUBS)}


@cache
def imports(file: Path) -> list[tuple[str, int, bool]]:
    """Modules that a file imports, with the line and whether that happens when the file is loaded.

    A name that comes through a door counts as the module that defines it;
    what is only for the type checker is left out.
    """
    found: list[tuple[str, int, bool]] = []

    def walk(node: ast.AST, at_load: bool) -> None:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
            return
        if isinstance(node, ast.Import):
            found.extend((alias.name, node.lineno, at_load) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}:{node.lineno}: relative import"
            package = inside(node.module or "")
            behind = DOORS.get(package or "", {}) if node.module == f"continuum_grasp.{package}" else {}
            found.extend((behind.get(alias.name, node.module or ""), node.lineno, at_load) for alias in node.names)
        for child in ast.iter_child_nodes(node):
            walk(child, at_load and not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda))

    walk(tree(file), True)
    return found


def inside(module: str) -> str | None:
    """The module of the package, of a dotted name."""
    first, *parts = module.split(".")
    return ".".join(parts[: 2 if parts[:1] == ["addons"] else 1]) if first == "continuum_grasp" else None


def broken(of: Iterable[str], rule: Callable[[Path, str, bool], bool]) -> list[str]:
    """Imports in some modules that break a rule, which is given the file, what it imports, and whether at load."""
    return [
        f"{file.relative_to(PACKAGE)}:{line}: {module}"
        for file in FILES
        if module_of(file) in of
        for module, line, at_load in imports(file)
        if rule(file, module, at_load)
    ]


def test_every_module_is_known():
    assert {module_of(file) for file in FILES} <= {*ALLOWED, "addons", "cli", "__main__", ""}


@pytest.mark.parametrize("importer", ALLOWED)
def test_a_module_imports_earlier_ones_only(importer):
    known = {None, *COMMON, *ALLOWED[importer]}
    assert not broken([importer], lambda file, module, at_load: inside(module) not in known)


@pytest.mark.parametrize("importer", OUTSIDE)
def test_a_module_does_without(importer):
    def needless(file: Path, module: str, at_load: bool) -> bool:
        return module.split(".")[0] in OUTSIDE[importer] and file.stem != "pictures"

    assert not broken([importer], needless)


def test_drawing_is_imported_when_needed():
    others = {*ALLOWED} - {"plotting"}

    def early(file: Path, module: str, at_load: bool) -> bool:
        return at_load and inside(module) == "plotting" and file.stem != "pictures"

    assert not broken(others, early)


def test_what_few_grasps_ask_for_is_imported_when_needed():
    """Errors and friction states. No door leads to rods yet, which take both."""

    def rare(file: Path, module: str, at_load: bool) -> bool:
        is_needed = not {"robust", "rods"} & set(file.parts)
        return at_load and module.startswith("continuum_grasp.grasp.robust") and is_needed

    assert not broken(["grasp"], rare)


def test_scenes_are_read_without_numpy():
    """Which loads with the curves of a finger, with tables and measured outlines, when these are asked for."""
    measured = set((PACKAGE / "scene" / "objects" / "measured").glob("*.py")) - set(PACKAGE.rglob("__init__.py"))
    curves = {PACKAGE / "scene" / name for name in ("profile.py", "table.py")} | measured
    names = (".".join(file.relative_to(PACKAGE).with_suffix("").parts) for file in curves)
    heavy = {"numpy", "scipy", *(f"continuum_grasp.{name}" for name in names)}

    def loads(file: Path, module: str, at_load: bool) -> bool:
        return at_load and file not in curves and bool({module, module.split(".")[0]} & heavy)

    assert not broken(["scene"], loads)


def test_a_door_loads_nothing():
    for file in [PACKAGE / "__init__.py", *(stub.with_suffix(".py") for stub in STUBS)]:
        loaded = {module for module, _, at_load in imports(file) if at_load}
        allowed = {"lazy_loader"} if file.parent.name != "learning" else {"lazy_loader", "importlib.util", *TASKS}
        assert loaded <= allowed, file


def test_packages_are_entered_through_their_doors():
    """By names that the door lists, in texts of ``import_module`` too."""
    wrong = []
    for file in FILES:
        here = module_of(file)
        for node in ast.walk(tree(file)):
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
                given = node.args[0]
                text = given.values[0] if isinstance(given, ast.JoinedStr) else given
                there = inside(str(text.value).rstrip(".")) if isinstance(text, ast.Constant) else None
                fine = there in (None, here)
            elif isinstance(node, ast.ImportFrom) and (there := inside(node.module or "")) not in (None, "", here):
                single = (PACKAGE / f"{there}.py").exists()
                names = {alias.name for alias in node.names}
                at_door = node.module == f"continuum_grasp.{there}"
                fine = single or (at_door and names <= DOORS.get(str(there), {}).keys())
            elif isinstance(node, ast.ImportFrom) and node.module == "continuum_grasp":
                fine = all(not (PACKAGE / alias.name).exists() for alias in node.names)
            elif isinstance(node, ast.Import):
                fine = all(inside(alias.name) in (None, "") for alias in node.names)
            else:
                continue
            if not fine:
                wrong.append(f"{file.relative_to(PACKAGE)}:{node.lineno}: {ast.unparse(node)}")
    assert not wrong


@cache
def named_in(file: Path) -> dict[str, set[str]]:
    """Names that a file takes from each package: by imports, and in texts ``module:name``."""
    found: dict[str, set[str]] = {}
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.ImportFrom) and node.module:
            package = inside(node.module) if node.level == 0 else node.module
            found.setdefault(package or "", set()).update(alias.name for alias in node.names)
        elif isinstance(node, ast.Constant) and str(node.value).startswith("continuum_grasp."):
            module, _, name = str(node.value).partition(":")
            found.setdefault(inside(module) or "", set()).add(name)
    return found


@pytest.mark.parametrize("package", DOORS)
def test_every_name_of_a_door_is_taken(package):
    """By another package, or by users, whose names are in ``__all__``."""
    taken = set(getattr(import_module(f"continuum_grasp.{package}"), "__all__", ()))
    taken |= {entry.name for entry in ANNOUNCED if entry.module == f"continuum_grasp.{package}"}
    assert taken <= DOORS[package].keys()
    for file in [PACKAGE / "__init__.pyi", *FILES]:
        taken |= named_in(file).get(package, set()) if module_of(file) != package or file.stem == "addon" else set()
    assert not DOORS[package].keys() - taken


def test_no_name_of_a_door_is_that_of_a_module():
    """Importing the module would replace the name."""
    for package, names in DOORS.items():
        folder = PACKAGE / package.replace(".", "/")
        modules = {file.stem if file.is_file() else file.name for file in folder.iterdir()}
        assert not modules & names.keys(), package


def test_a_class_name_exists_once():
    homes: dict[str, set[str]] = {}
    for file in FILES:
        for node in ast.walk(tree(file)):
            if isinstance(node, ast.ClassDef):
                homes.setdefault(node.name, set()).add(str(file.relative_to(PACKAGE)))
    assert not {name: files for name, files in homes.items() if len(files) > 1}


def test_nothing_but_the_command_line_prints():
    wrong = []
    for file in FILES:
        if module_of(file) == "cli":
            continue
        for node in ast.walk(tree(file)):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("print", "input"):
                wrong.append(f"{file.relative_to(PACKAGE)}:{node.lineno}")
            if isinstance(node, ast.Attribute) and ast.unparse(node) in ("sys.stdout", "sys.stderr"):
                wrong.append(f"{file.relative_to(PACKAGE)}:{node.lineno}")
    assert not wrong


def test_input_is_not_checked_by_assert():
    wrong = [
        f"{file.relative_to(PACKAGE)}:{node.lineno}"
        for file in FILES
        for node in ast.walk(tree(file))
        if isinstance(node, ast.Assert)
    ]
    assert not wrong


def reaches_inside(file: Path) -> list[str]:
    """Modules inside of packages that a file imports from, not through a door."""
    found = []
    for node in ast.walk(tree(file)):
        if isinstance(node, ast.ImportFrom):
            base = node.module or ""
            inner = [f"{base}.{alias.name}" for alias in node.names]
            modules = [name if is_module(name) else base for name in inner]
        elif isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            modules = [str(value.value) for value in node.args[:1] if isinstance(value, ast.Constant)]
        else:
            continue
        found += [name for name in modules if is_module(name) and name != f"continuum_grasp.{inside(name)}".rstrip(".")]
    return found


def is_module(name: str) -> bool:
    path = PACKAGE.parent.joinpath(*name.split("."))
    return inside(name) is not None and (path.with_suffix(".py").exists() or (path / "__init__.py").exists())


def test_tests_that_reach_inside_say_why():
    """In the first line of the file, after ``from inside:``; the others go through doors, as users do."""
    silent = [
        f"{file.relative_to(TESTS)}: {', '.join(modules)}"
        for file in sorted(TESTS.rglob("*.py"))
        if (modules := reaches_inside(file))
        and "from inside: " not in (ast.get_docstring(tree(file)) or "").partition("\n")[0]
    ]
    assert not silent


def test_no_public_name_is_that_of_a_module():
    """Importing the module would replace the name."""
    import continuum_grasp

    assert not set(continuum_grasp.__all__) & {file.relative_to(PACKAGE).parts[0].removesuffix(".py") for file in FILES}


def test_there_are_no_circles():
    """Of files, imports for the type checker included; ``continuum_grasp`` itself aside."""
    dotted = {file: ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts) for file in FILES}
    by_name = {name.removesuffix(".__init__"): file for file, name in dotted.items()}
    del by_name["continuum_grasp"]

    def targets(file: Path) -> set[str]:
        found = set()
        for node in ast.walk(tree(file)):
            if isinstance(node, ast.ImportFrom) and node.module:
                package = inside(node.module)
                behind = DOORS.get(package or "", {}) if node.module == f"continuum_grasp.{package}" else {}
                for alias in node.names:
                    inner = f"{node.module}.{alias.name}"
                    found.add(behind.get(alias.name) or (inner if inner in by_name else node.module))
        return found & by_name.keys()

    left = {name: targets(file) - {name} for name, file in by_name.items()}
    while ends := [name for name, wanted in left.items() if not wanted & left.keys()]:
        for name in ends:
            del left[name]
    while starts := [name for name in left if not any(name in wanted for wanted in left.values())]:
        for name in starts:
            del left[name]
    assert not left, sorted(left)
