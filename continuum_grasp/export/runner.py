"""C of the check program that runs one function on a row of numbers."""

from __future__ import annotations

from continuum_grasp.export.part import Argument, Call
from continuum_grasp.export.subject import Subject

__all__ = ["arguments_of", "runner_head", "runner_of"]


def runner_head(name: str, prefix: str) -> str:
    """What all of them begin with: null is the number of the pointer that is null, repeat how often it is called."""
    return (
        f"static int run_{name}(check_memory *memory, const {prefix}_real *row, {prefix}_real *out, "
        "uint32_t other_abi, int null,\n"
        f"{' ' * len(f'static int run_{name}(')}int repeat)"
    )


def arguments_of(subject: Subject, call: Call) -> list[Argument]:
    """Parameters and inputs of a function, in the order of the rows."""
    if subject.parameters is None:
        return list(call.inputs)
    return [Argument("parameters", subject.parameters, "p"), *call.inputs]


def runner_of(subject: Subject, call: Call) -> str:
    """C that runs a function without memory on a row."""
    prefix = subject.prefix
    declared, copied, passed, at, pointer = [], [], [], 0, 0

    def address(expression: str) -> str:
        nonlocal pointer
        pointer += 1
        return f"null == {pointer} ? 0 : {expression}"

    passed.append(address("&model"))
    for argument in arguments_of(subject, call):
        if argument.name == "parameters":
            copied.append(f"  memcpy(&model.parameters, row + {at}, sizeof model.parameters);")
        elif argument.is_struct:
            declared.append(f"  {prefix}_{argument.kind.name} {argument.name};")
            copied.append(f"  memcpy(&{argument.name}, row + {at}, sizeof {argument.name});")
            passed.append(address(f"&{argument.name}"))
        else:
            passed.append(f"row[{at}]")
        at += argument.size
    output: Argument = call.output
    declared.append(f"  {prefix}_{output.kind.name} {output.name};")
    passed.append(address(f"&{output.name}"))
    newline = "\n"
    return f"""\
{runner_head(call.name, prefix)}
{{
  {prefix}_model model;
{newline.join(declared)}
  int k, code = {prefix}_init(&model);
  (void)memory;
{newline.join(copied)}
  memcpy(&{output.name}, out, sizeof {output.name});
  model.abi ^= other_abi;
  for (k = 0; k < repeat; ++k)
    code = {prefix}_{call.name}({", ".join(passed)});
  memcpy(out, &{output.name}, sizeof {output.name});
  return code;
}}
"""
