"""Contents of a package, its public header, and the checked layer: the C between public functions and kernels."""

from __future__ import annotations

import ctypes
import hashlib
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from continuum_grasp import __version__
from continuum_grasp.core import Template
from continuum_grasp.export.build import strict_library
from continuum_grasp.export.fields import LINE, Struct, each_once, fill
from continuum_grasp.export.kernel import Kernel
from continuum_grasp.export.part import Call, Code, PackagePart, Stateful
from continuum_grasp.export.subject import Subject

_OF_EVERY_FUNCTION = (
    Code.OK,
    Code.ERR_NULL,
    Code.ERR_NON_FINITE,
    Code.ERR_RANGE,
    Code.ERR_RESULT,
    Code.ERR_ABI,
    Code.ERR_CONFIGURATION,
)


@dataclass(frozen=True)
class Contents:
    """A subject, the parts of its package, and the words that all templates share.

    Words that follow from the C are added once it is written: its hash, the bytes of memory once it was compiled.
    """

    subject: Subject
    parts: Sequence[PackagePart]
    words: dict[str, str]

    @property
    def calls(self) -> list[Call]:
        """Public functions that take the model."""
        return [call for part in self.parts for call in part.calls]

    @property
    def stateful(self) -> list[Stateful]:
        """Public functions that keep something."""
        return [function for part in self.parts for function in part.stateful]

    @cached_property
    def structs(self) -> list[Struct]:
        """Structs of the header, each once, the model's first."""
        parameters = [self.subject.parameters] if self.subject.parameters and self.calls else []
        return each_once([*parameters, *(struct for part in self.parts for struct in part.structs)])

    @cached_property
    def codes(self) -> list[Code]:
        """Codes that some function may return: zero and warnings, then errors."""
        used = {*_OF_EVERY_FUNCTION, *(code for part in self.parts for code in part.codes)}
        used |= {code for call in self.calls for code in call.codes}
        return sorted(used, key=lambda code: (code < 0, abs(code)))

    @cached_property
    def kernels(self) -> list[Kernel]:
        return list({kernel.name: kernel for part in self.parts for kernel in part.kernels}.values())

    @property
    def sources(self) -> dict[str, str]:
        """Files that parts bring, by path."""
        return {path: text for part in self.parts for path, text in part.sources.items()}

    def fill(self, template: str, **words: object) -> str:
        """A template with the shared words, the words of this export, and further ones."""
        shared = {"contents": self, "subject": self.subject, "loop": self.subject.loop, "calls": self.calls}
        return fill(template, {**self.words, **shared, **words})


def _declared(call: Call, prefix: str) -> list[str]:
    """Model and inputs of a public function as C declares them."""
    return [
        f"const {prefix}_model *model",
        *(f"const {prefix}_{a.kind.name} *{a.name}" if a.is_struct else f"{prefix}_real {a.name}" for a in call.inputs),
    ]


def _prototype(call: Call, prefix: str) -> str:
    """C declaration of a public function, without the semicolon."""
    arguments = [*_declared(call, prefix), f"{prefix}_{call.output.kind.name} *{call.output.name}"]
    head = f"int {prefix}_{call.name}("
    lines = [""]
    mark = len(f"{prefix.upper()}_API ")
    for k, declared in enumerate(arguments):
        text = declared + (", " if k < len(arguments) - 1 else ")")
        if mark + len(head) + len(lines[-1]) + len(text) > LINE:
            lines.append("")
        lines[-1] += text
    return head + f"\n{' ' * (mark + len(head))}".join(line.rstrip() for line in lines)


def abi_of(contents: Contents) -> str:
    """Number of the interface as C; another one where anything of its headers differs but title, version and hash.

    Sizes of memory, which are known once it was compiled, follow from its types.
    """
    ignored = ["abi", "hash", "title", "version", *(name for name in contents.words if name.endswith("_bytes"))]
    texts = [_header(replace(contents, words={**contents.words, **dict.fromkeys(ignored, "")}))]
    sources = [item for part in contents.parts for item in part.sources.items()]
    texts += [text for path, text in sources if path.startswith("include/")]
    return "0x" + hashlib.sha256("\n".join(texts).replace(__version__, "").encode()).hexdigest()[:8] + "u"


DIMENSIONS = {
    "n": "bending coordinates",
    "nx": "states",
    "nu": "inputs",
    "nw": "force components",
    "np": "run-time parameters",
}
"""Dimensions of a model, and what they count."""


def _header(contents: Contents) -> str:
    subject, calls, codes = contents.subject, contents.calls, contents.codes
    prefix = subject.prefix
    sizes = DIMENSIONS if calls else {}
    constants = {name.upper(): f"{getattr(subject.moving, name)} /* {note} */" for name, note in sizes.items()}
    constants |= {name: value for part in contents.parts for name, value in part.constants.items()}
    width = max(len(code.name) for code in codes)
    commas = [","] * (len(codes) - 1) + [" "]  # C89 and C++98 take no comma behind the last entry of an enum
    last = contents.stateful[-1] if contents.stateful else None
    begun = [contents.fill("state.h")] if _begun(contents) else []
    documented = [*begun, *(_documented(call, prefix) for call in calls)]
    declared = [Template(part.declarations).filled(contents.words) for part in contents.parts if part.declarations]
    return contents.fill(
        "header.h",
        constants=constants.items(),
        codes=[(f"{code.name:<{width}}", code, comma) for code, comma in zip(codes, commas, strict=True)],
        structs="\n".join(struct.declaration(prefix) for struct in contents.structs),
        owner=last.types[0] if last else "",
        step=last.name if last else "",
        functions="\n".join(documented + declared),
    )


def _begun(contents: Contents) -> list[Struct]:
    """Structs of the model that do not begin with zeros: a state with an object."""
    return [contents.subject.state] if contents.calls and contents.subject.touching is not None else []


def _documented(call: Call, prefix: str) -> str:
    said = [f"{prefix.upper()}_{code.name}" for code in call.codes]
    codes = f" Beyond the codes of every function: {', '.join(said)}." if said else ""
    text = "\n".join(textwrap.wrap(call.text + codes, LINE - 6, initial_indent="/* ", subsequent_indent="   "))
    return f"{text} */\n{prefix.upper()}_API {_prototype(call, prefix)};\n"


def _internal_header(contents: Contents) -> str:
    """Header shared by kernels and checked layer."""
    prefix, real = contents.subject.prefix, contents.subject.real
    declared = "\n".join(f"{prefix.upper()}_API {kernel.prototype(prefix)};" for kernel in contents.kernels)
    return contents.fill(
        "internal.h", kernels=declared, width=real.width, exponent=real.bit_pattern(real.exponent_mask)
    )


def _kernels_source(contents: Contents) -> str:
    kernels = contents.kernels
    prefix = contents.subject.prefix
    real = contents.subject.real
    # Copies of sin and the like are static in each file that calls them: no further symbols, and the compiler inlines.
    body = Kernel.all_c_source(kernels, prefix, real)
    # The mark of the header, by which CUDA compiles the kernels for the device.
    return contents.fill("kernels.c", body=body.replace("\nvoid ", f"\n{prefix.upper()}_API void "))


def _layer_source(contents: Contents) -> str:
    """The public functions."""
    subject, calls = contents.subject, contents.calls
    prefix, parameters = subject.prefix, subject.parameters
    inputs = each_once(a.kind for call in calls for a in call.inputs if isinstance(a.kind, Struct))
    begun = _begun(contents)
    written = [*(call.output.kind for call in calls if isinstance(call.output.kind, Struct)), *begun]
    checked = inputs if parameters is None else [parameters, *inputs]
    nominal = zip(parameters.fields, subject.moving.p_nominal, strict=True) if parameters else ()
    functions = [contents.fill("guard.c")] if subject.guard else []
    start = ", ".join(map(subject.real.literal, subject.start)) if begun else ""
    functions += [contents.fill("state.c", start=start)] if begun else []
    functions += [_function(contents, call) for call in calls]
    return contents.fill(
        "layer.c",
        bounds="\n".join(struct.bounds(prefix, subject.real, f"{prefix.upper()}_API ") for struct in checked),
        structs=contents.fill("structs.c", read=checked, written=each_once(written)),
        check=contents.fill("check_numbers.c"),
        functions="\n".join(functions),
        nominal=[(field.name, subject.real.literal(value)) for field, value in nominal],
    )


def library_files(contents: Contents) -> dict[str, str]:
    """The library, and the header of its check program; adds the hash of what it computes to the words."""
    prefix = contents.subject.prefix
    sources = contents.sources
    kernels, layer = _kernels_source(contents), _layer_source(contents)
    computed = "".join([kernels, layer, *(text for path, text in sorted(sources.items()) if path.endswith(".c"))])
    counts = "".join(f"{name} {value}\n" for part in contents.parts for name, value in part.constants.items())
    hashed = f"{contents.subject.real.name}\n{counts}{computed}"
    contents.words["hash"] = hashlib.sha256(hashed.encode()).hexdigest()[:16]
    return {
        f"include/{prefix}.h": _header(contents),
        f"src/{prefix}_internal.h": _internal_header(contents),
        f"src/{prefix}.c": layer,
        f"src/{prefix}_kernels.c": kernels,
        "tests/check.h": contents.fill("tests/check.h"),
        **sources,
    }


def add_sizes(contents: Contents) -> None:
    """Add the bytes of what functions keep and work in to the words, by the headers alone."""
    types = [name for function in contents.stateful for name in function.types]
    headers = {path: text for path, text in contents.sources.items() if path.startswith("include/")}
    headers[f"include/{contents.subject.prefix}.h"] = _header(replace(contents, words={**contents.words, "hash": ""}))
    library = strict_library({**headers, "sizes.c": contents.fill("tests/sizes.c", types=types)})
    sizes = (ctypes.c_size_t * len(types)).in_dll(library, "sizes")
    contents.words.update((f"{name}_bytes", str(size)) for name, size in zip(types, sizes, strict=True))


def _function(contents: Contents, call: Call) -> str:
    """A public function behind one that reads and checks everything it is given."""
    subject = contents.subject
    prefix = contents.subject.prefix
    arrays = [a for a in subject.passed_to(call) if a.is_struct]
    numbers = [
        (a, *map(subject.real.literal, (a.fields[0].low, a.fields[0].high))) for a in call.inputs if not a.is_struct
    ]
    return contents.fill(
        "function.c",
        call=call,
        declared=", ".join([*_declared(call, prefix), *(f"{prefix}_real *{a.array}" for a in arrays)]),
        arrays=arrays,
        numbers=numbers,
        pointers=["model", *(a.name for a in call.inputs if a.is_struct)],
        checks=not all(a.drawn for a in arrays),
        prototype=_prototype(call, prefix),
        body=call.body.rstrip(),
    )
