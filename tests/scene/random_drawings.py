"""Random drawings in SVG: shapes in groups, inner drawings, uses and symbols, with clip paths, masks and transforms."""

from __future__ import annotations

import random

from tests.scene.svg_corpus import SPACE

VIEW = 'width="120mm" height="90mm" viewBox="0 0 120 90"'


class RandomDrawing:
    """A drawing of one shape, whose numbers and features follow from a seed."""

    def __init__(self, seed):
        self.choice = random.Random(seed)
        self.definitions = []
        body = self.node(self.choice.randrange(1, 4))
        self.text = f"<svg {SPACE} {VIEW}><defs>{''.join(self.definitions)}</defs>{body}</svg>"

    def number(self, low, high):
        return f"{self.choice.uniform(low, high):.2f}"

    def shape(self):
        """A shape whose element is still open."""
        x, y = self.number(20, 45), self.number(15, 30)
        w, h = self.choice.uniform(35, 55), self.choice.uniform(25, 40)
        rule = self.choice.choice(('fill-rule="evenodd" clip-rule="evenodd"', ""))
        return self.choice.choice((
            f'<rect x="{x}" y="{y}" width="{w:.2f}" height="{h:.2f}" rx="{self.choice.choice((0, 3, 9))}"',
            f'<circle cx="60" cy="42" r="{h / 2:.2f}"',
            f'<ellipse cx="58" cy="44" rx="{w / 2:.2f}" ry="{h / 2:.2f}"',
            f'<path {rule} d="M{x} {y}h{w:.2f}v{h:.2f}h{-w:.2f}zm5 4h{w / 2:.2f}v{h / 2:.2f}h{-w / 2:.2f}z"',
            f'<polygon points="{x},{y} 85,20 70,70"',
            f'<path d="M{x} {y}q{w:.2f} {-h / 2:.2f} {w:.2f} {h:.2f}t{-w / 2:.2f} 4z"',
        ))  # fmt: skip

    def turn(self):
        return self.choice.choice((
            "",
            f'transform="translate({self.number(-8, 8)} {self.number(-5, 5)})"',
            f'transform="rotate({self.number(-40, 40)} 60 45)"',
            'transform="matrix(-1 0 0 1 120 0)"',
            f'transform="scale({self.number(0.7, 1.1)} {self.number(0.7, 1.1)})"',
            f'transform="skewX({self.number(-15, 15)})"',
        ))  # fmt: skip

    def defined(self, tag, keys, content):
        """Name of a new definition."""
        name = f"d{len(self.definitions)}"
        self.definitions.append(f'<{tag} id="{name}" {keys}>{content}</{tag}>')
        return name

    def clip(self):
        if self.choice.random() < 0.3:
            part = '<rect x=".1" y=".15" width=".7" height=".75"/>'
            return self.defined("clipPath", 'clipPathUnits="objectBoundingBox"', part)
        return self.defined("clipPath", self.turn(), f"{self.shape()} {self.turn()}/>")

    def mask(self):
        where = (
            "",
            'maskUnits="userSpaceOnUse" x="15" y="5" width="70" height="70"',
            'x="0.1" y="0" width=".8" height="1"',
        )
        if self.choice.random() < 0.3:
            return self.defined(
                "mask", f'style="mask-type:alpha" {self.choice.choice(where)}', f'{self.shape()} fill="#888"/>'
            )
        black = f'{self.shape()} fill="black" transform="translate(60 30)"/>' if self.choice.random() < 0.4 else ""
        return self.defined("mask", self.choice.choice(where), f'{self.shape()} fill="white"/>{black}')

    def effect(self):
        kind = self.choice.random()
        if kind < 0.2:
            return f'clip-path="url(#{self.clip()})"'
        if kind < 0.25:
            return f'style="clip-path:url(#{self.clip()});opacity:.6"'
        return f'mask="url(#{self.mask()})"' if kind < 0.4 else ""

    def node(self, depth):
        kind = self.choice.random()
        if depth == 0 or kind < 0.15:
            return f"{self.shape()} {self.turn()} {self.effect()}/>"
        if kind < 0.5:
            return f"<g {self.turn()} {self.effect()}>{self.node(depth - 1)}</g>"
        if kind < 0.65:
            view = self.choice.choice(("", f'viewBox="0 0 {self.number(90, 120)} {self.number(70, 90)}"'))
            aspect = self.choice.choice(("", 'preserveAspectRatio="none"', 'preserveAspectRatio="xMaxYMin slice"'))
            flow = self.choice.choice(("", "", 'overflow="visible"'))
            size = f'width="{self.number(60, 95)}" height="{self.number(50, 75)}"'
            place = f'x="{self.number(0, 12)}" y="{self.number(0, 9)}"'
            return f"<svg {place} {size} {view} {aspect} {flow}>{self.node(depth - 1)}</svg>"
        place = f'x="{self.number(-5, 5)}" y="{self.number(-5, 5)}"'
        if kind < 0.8:
            name = self.defined("g", self.effect(), self.node(depth - 1))
            return f'<use href="#{name}" {place} {self.turn()} {self.effect()}/>'
        if kind < 0.9:  # no effect on the use: resvg leaves x and y out of its user space, other than browsers
            name = self.defined("symbol", 'viewBox="0 0 120 90"', self.node(depth - 1))
            size = f'width="{self.number(80, 110)}" height="{self.number(60, 80)}"'
            return f'<use href="#{name}" {place} {size} {self.turn()}/>'
        return f'<g display="none">{self.node(depth - 1)}</g>{self.node(depth - 1)}'
