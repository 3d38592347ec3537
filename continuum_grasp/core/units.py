"""Translation units of a generated C source: its long functions apart from the rest."""

from __future__ import annotations

import re

__all__ = ["longest_function", "translation_units"]

_END = re.compile(r"(?<=\n\}\n)")
_HEAD = re.compile(r"^(static )?(?:inline )?(\w[\w ]*?[ *]\w+\([^;{}#]*\))\s*\{\n", re.MULTILINE)
_SHORT_EXPORTED = re.compile(r"^(?!static )(\w[\w ]*?[ *]\w+\([^;{}#\n]*\)) *\{.*\}$", re.MULTILINE)
_HIDDEN = '__attribute__((visibility("hidden"))) '
_VARIABLE = re.compile(r"\ba\d+\b")
_ASSIGNMENT = re.compile(r"  (a\d+)=(.*;)")
_DECLARATION = re.compile(r"  casadi_real a\d+(, a\d+)*;")
_RESULT = re.compile(r"  if \(res\[\d+\]!=0\) res\[\d+\]\[\d+\]=.*;|  return 0;")


def longest_function(source: str) -> int:
    """Lines of the longest function."""
    return max(function.count("\n") for function in _END.split(source))


def translation_units(source: str, limit: int) -> list[str]:
    """Split a source into units that are compiled separately and linked.

    Parameters
    ----------
    source : str
        One translation unit, as the generators of this package write it: a function ends with a brace in the first
        column, and variables outside of functions are constants.
    limit : int
        Functions of more lines than this get units of their own.

    Returns
    -------
    list of str
        The source with declarations in the place of its long functions; then a unit per long function, with what
        stands before it in the source. Only names that the source itself exports are exported.
    """
    units, whole, before = [], "", ""
    for piece in _END.split(source):
        heads = list(_HEAD.finditer(piece))
        if not heads:
            whole += piece
            continue
        head = heads[-1]
        lead, is_static, signature = piece[: head.start()], head[1], head[2]
        before += _SHORT_EXPORTED.sub(r"\1;", lead)
        if piece.count("\n") <= limit:
            whole += piece
            before += piece[head.start() :] if is_static else f"{signature};\n"
            continue
        declared = f"{_HIDDEN if is_static else ''}{signature}"
        units.append(f"{before}{declared}\n{{\n{_single_assignment(piece[head.end() :])}")
        whole += f"{lead}{declared};\n"
        before += f"{declared};\n"
    return [whole, *units]


def _single_assignment(body: str) -> str:
    """CasADi's straight-line code with a variable per assignment; other code as it is.

    CasADi uses variables again and again, for which clang's SROA needs time in the square of the length: more than a
    minute for 70,000 lines, instead of 4 s.
    """
    lines, names, count = [], dict[str, str](), 0
    for line in body.split("\n")[:-2]:
        used = _VARIABLE.sub(lambda found: names.get(found[0], found[0]), line)
        if assigned := _ASSIGNMENT.fullmatch(line):
            count += 1
            names[assigned[1]] = f"v{count}"
            used = f"  const casadi_real v{count}={used.partition('=')[2]}"
        elif _DECLARATION.fullmatch(line):
            continue
        elif not _RESULT.fullmatch(line):
            return body
        lines.append(used)
    return "\n".join([*lines, "}", ""])
