"""Style of elements of SVG: attributes, style sheets and what children inherit, by the cascade of CSS."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from typing import Any

_INHERITED = (
    "clip-rule", "color", "fill", "fill-opacity", "fill-rule", "marker-end", "marker-mid", "marker-start", "stroke",
    "stroke-dasharray", "stroke-opacity", "stroke-width", "visibility",
)  # fmt: skip
"""Inherited properties that change the visible shape."""
_SCREEN, _ELSEWHERE = ("", "all", "screen", "only screen"), ("print", "speech", "not screen", "not all")
"""Media of a style sheet that apply, and that do not apply, on every screen."""
_HARMLESS = ("charset", "font-face", "keyframes", "namespace", "page")
"""Rules of style sheets that do not change shapes by themselves."""
_NO_ATTRIBUTES = (
    "animation", "animation-name", "class", "id", "mask-image", "mix-blend-mode", "offset-path", "perspective",
    "rotate", "scale", "style", "translate", "zoom",
)  # fmt: skip
"""Attributes that are not properties, although some share the name of one."""
_LONG = {"marker": ("marker-start", "marker-mid", "marker-end")}
"""Properties that set several others."""
_VARIABLE = re.compile(r"var\(\s*(--[\w-]+)\s*(?:,((?:[^()]|\([^()]*\))*))?\)")
_DEEPEST = 10
"""Greatest depth of references between variables: a variable may refer to itself."""


class Styles:
    """Styles of a document, whose elements have no namespace.

    `ValueError` names a rule that this reader does not evaluate.
    """

    def __init__(self, root: Any) -> None:
        self._rules: dict[Any, list[tuple[tuple[Any, ...], str, str]]] = defaultdict(list)
        self._count = 0
        for instruction in root.itersiblings(preceding=True):
            if getattr(instruction, "target", "") == "xml-stylesheet":
                raise ValueError(f"a style sheet in another file is not read: {instruction.text[:60]}")
        for sheet in root.iter("style"):
            if sheet.get("type", "text/css") == "text/css" and _holds(sheet.get("media", "")):
                self._read(root, "".join(sheet.itertext()))

    def of(self, element: Any, around: dict[str, str]) -> dict[str, str]:
        """Return properties and attributes of an element inside one with known properties.

        They include geometry, since style sheets may set it, too.
        """
        style = {key: value for key, value in around.items() if key in _INHERITED or key.startswith("--")}
        rules = [*self._rules.get(element, ()), *_own(element)]
        attributes = {key: value for key, value in element.attrib.items() if key not in _NO_ATTRIBUTES}
        declared = attributes | {name: value for _, name, value in sorted(rules, key=lambda rule: rule[0])}
        variables = style | declared
        for name, value in declared.items():
            text = _substituted(value, variables)
            keyword = text.lower()
            if keyword == "inherit" and name in around:
                style[name] = around[name]
            elif keyword not in ("inherit", "initial", "unset", "revert", ""):
                style[name] = text
            elif keyword == "initial" or name not in _INHERITED:
                style.pop(name, None)
        return style

    def in_place(self, element: Any) -> dict[str, str]:
        """Return the properties of an element within the elements around it."""
        outer = element.getparent()
        return self.of(element, {} if outer is None else self.in_place(outer))

    def _read(self, root: Any, text: str) -> None:
        """Take over the rules of a sheet."""
        import tinycss2

        self._take(root, tinycss2.parse_stylesheet(text, skip_comments=True, skip_whitespace=True))

    def _take(self, root: Any, rules: list[Any]) -> None:
        import tinycss2

        for rule in rules:
            if rule.type == "qualified-rule":
                self._match(root, tinycss2.serialize(rule.prelude).strip(), rule.content)
            elif rule.type == "at-rule":
                prelude = tinycss2.serialize(rule.prelude).strip()
                if rule.lower_at_keyword == "media" and rule.content is not None:
                    if _holds(prelude):
                        self._take(root, tinycss2.parse_rule_list(rule.content, True, True))
                elif re.sub(r"^-[a-z]+-", "", rule.lower_at_keyword) not in _HARMLESS:
                    raise ValueError(f"style sheet: @{rule.at_keyword} {prelude[:60]} is not read")

    def _match(self, root: Any, text: str, content: list[Any]) -> None:
        """Give the declarations of a rule to the elements that it selects."""
        import cssselect
        from lxml import etree

        declarations = list(_declarations(content))
        translator = cssselect.GenericTranslator()
        try:
            selectors = [one for one in cssselect.parse(text) if not one.pseudo_element]
            chosen = [
                (one.specificity(), etree.XPath(translator.selector_to_xpath(one))(root.getroottree()))
                for one in selectors
            ]
        except (cssselect.SelectorError, etree.XPathError):
            raise ValueError(f"style sheet: the selector {text[:60]!r} is not read") from None
        for specificity, elements in chosen:
            for element in elements:
                for important, name, value in declarations:
                    self._count += 1
                    self._rules[element].append(((important, False, specificity, self._count), name, value))


def _own(element: Any) -> Iterator[tuple[tuple[Any, ...], str, str]]:
    """Return the declarations of the attribute ``style``, which override sheets of the same importance."""
    import tinycss2

    text = element.get("style", "")
    if text:
        content = tinycss2.parse_blocks_contents(text)
        for count, (important, name, value) in enumerate(_declarations(content, parsed=True)):
            yield (important, True, (0, 0, 0), count), name, value


def _declarations(content: list[Any], parsed: bool = False) -> Iterator[tuple[bool, str, str]]:
    """Importance, name and value of each declaration."""
    import tinycss2

    for node in content if parsed else tinycss2.parse_blocks_contents(content):
        if node.type == "declaration":
            name = node.name if node.name.startswith("--") else node.lower_name
            for single in _LONG.get(name, (name,)):
                yield node.important, single, tinycss2.serialize(node.value).strip()
        elif node.type not in ("comment", "whitespace", "error"):
            raise ValueError("style sheet: rules inside rules are not read")


def _substituted(value: str, variables: dict[str, str]) -> str:
    """Return a value with its CSS variables replaced; empty if one has no value."""
    for _ in range(_DEEPEST):
        match = _VARIABLE.search(value)
        if match is None:
            return value.strip()
        text = variables.get(match[1], match[2])
        if text is None:
            return ""
        value = value[: match.start()] + text + value[match.end() :]
    return ""


def _holds(media: str) -> bool:
    """Whether rules for some media apply; `ValueError` if that depends on the viewer."""
    kinds = [" ".join(kind.lower().split()) for kind in media.split(",")]
    if any(kind in _SCREEN for kind in kinds):
        return True
    unknown = [kind for kind in kinds if kind not in _ELSEWHERE]
    if unknown:
        raise ValueError(f"style sheet: @media {unknown[0][:60]} depends on the viewer, which is not read")
    return False
