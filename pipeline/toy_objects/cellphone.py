"""Cellphones: smartphone, bar, brick, flip (open and closed), slider, keyboard phone, organiser. Millimetres, the front faces -y."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from pipeline.toy_objects.model import Color, Kind, Material, Model, Palette, Rng, chance, pick
from pipeline.toy_objects.pictures import home_screen, liquid_crystal, textured, write
from pipeline.toy_objects.solids import Solid, box, column, rod

SHELLS: Palette = ((34, 36, 40), (60, 66, 78), (178, 182, 188), (36, 62, 116), (150, 34, 44), (226, 226, 222), (92, 112, 96))
BRIGHT: Palette = ((214, 60, 120), (70, 150, 210), (120, 180, 70), (232, 140, 40), (196, 168, 110))
CHROME: Palette = ((196, 200, 206), (160, 164, 172))
KEYS: Palette = ((40, 42, 48), (206, 208, 210), (232, 230, 224), (88, 96, 110))
BLACK: Color = (22, 22, 24)
GREEN, RED = (50, 160, 70), (196, 44, 44)
DIAL = ("123", "456", "789", "*0#")
QWERTY = ("QWERTYUIOP", "ASDFGHJKL.", "ZXCVBNM,-/")
SCALE = 2.5
"""Pixels per millimetre of a front's picture."""


class Leaf:
    """A slab of a phone, standing on z = 0, with a picture on its front and keys that stand out of it.

    Positions on the front are millimetres: x from the middle, z from the foot.
    """

    def __init__(self, rng: Rng, size: Sequence[float], shade: Material, *, exponent: float = 6.0, bevel: float = 2.5) -> None:
        self.rng, self.shade = rng, shade
        self.width, self.thick, self.height = size
        self.exponent, self.bevel = exponent, bevel
        self.image = Image.new("RGB", (round(SCALE * self.width), round(SCALE * self.height)), shade.color)
        self.keys: list[Solid] = []

    def rectangle(self, x: float, z: float, width: float, height: float, color: Color, round_by: float = 1.0) -> None:
        """Draw a rectangle about (x, z), its corners rounded by a radius."""
        left, top = SCALE * (self.width / 2 + x - width / 2), SCALE * (self.height - z - height / 2)
        corners = (left, top, left + SCALE * width, top + SCALE * height)
        ImageDraw.Draw(self.image).rounded_rectangle(corners, SCALE * round_by, color)

    def screen(self, z: float, width: float, height: float, lit: float = 0.3, rim: float = 2.0) -> None:
        """Draw a screen in a dark rim: a home screen in a share `lit` of the draws, else a display of the old kind."""
        self.rectangle(0, z, width + 2 * rim, height + 2 * rim, BLACK, 3.0)
        draw = home_screen if chance(self.rng, lit) else liquid_crystal
        picture = draw(self.rng, round(SCALE * width), round(SCALE * height))
        self.image.paste(picture, (round(SCALE * (self.width - width) / 2), round(SCALE * (self.height - z - height / 2))))

    def earpiece(self, z: float) -> None:
        """Draw a slot, or a row of holes."""
        for x, width in ((0, 12),) if chance(self.rng, 0.5) else ((-5, 2), (0, 2), (5, 2)):
            self.rectangle(x, z, width, 2.2, BLACK)

    def key(self, x: float, z: float, size: Sequence[float], color: Color, legend: str = "", *, oval: bool = False) -> None:
        """Raise a key of `size` (width, height), of one colour, with a legend."""
        width, height = size
        self.rectangle(x, z, width + 0.5, height + 0.5, color, 0.4 * min(size) if oval else 0.6)
        ink = (245, 245, 240) if sum(color) < 380 else (24, 28, 40)
        middle = SCALE * (self.width / 2 + x), SCALE * (self.height - z)
        write(self.image, middle, int(0.85 * SCALE * min(size)), legend, ink)
        self.keys.append(box((width, 1.6, height), 2.2 if oval else 5.0, 0.6, count=16).moved(x, -self.thick / 2 - 0.5, z))

    def keypad(self, width: float, low: float, high: float, legends: Sequence[str] = DIAL) -> None:
        """Raise rows of keys from z `low` to `high`, one letter of the legends each."""
        color, oval = KEYS[self.rng.integers(len(KEYS))], chance(self.rng, 0.35)
        pitch, tall = width / len(legends[0]), (high - low) / len(legends)
        fill = self.rng.uniform(0.74, 0.88)
        for row, line in enumerate(legends):
            for index, letter in enumerate(line):
                x, z = (index + 0.5) * pitch - width / 2, high - (row + 0.5) * tall
                self.key(x, z, (fill * pitch, fill * tall), color, letter, oval=oval)

    def navigation(self, z: float, width: float) -> None:
        """Raise a pad between two soft keys, a green and a red one."""
        r, dark = self.rng.uniform(0.12, 0.16) * width, pick(self.rng, BLACK, *SHELLS)
        self.key(0, z, (2.5 * r, 2 * r), pick(self.rng, *CHROME, *SHELLS).color, oval=True)
        self.rectangle(0, z, 1.1 * r, r, dark.color, 0.4 * r)
        for side, color in ((-1, GREEN), (1, RED)):
            self.key(side * 0.34 * width, z + 0.55 * r, (0.2 * width, 0.62 * r), dark.color)
            self.key(side * 0.34 * width, z - 0.5 * r, (0.2 * width, 0.62 * r), color)

    def build(self, slab: Solid | None = None) -> tuple[tuple[Material, Material], *tuple[Solid, ...]]:
        """Return materials and solids: the slab (a rounded box, unless one about the origin is given) with its picture, the keys."""
        slab = slab or box((self.width, self.thick, self.height), self.exponent, self.bevel, count=40)
        parts = []
        for solid in (slab.moved(z=self.height / 2), *self.keys):
            x, y, z = solid.vertices.T
            uv = np.column_stack([x / self.width + 0.5, z / self.height])
            parts.append(solid.painted(y < 0.9 - self.thick / 2, uv))
        return (self.shade, textured(self.image)), *parts


def antenna(model: Model, rng: Rng, x: float, y: float, z: float, tall: float) -> None:
    """Add a stub or whip that rises by `tall` from the top edge at height z."""
    r = rng.uniform(3.2, 4.4)
    rows = [(z - 5, 1.1 * r), (z + 4, 1.1 * r), (z + 5, 0.9 * r), (z + tall - 2, 0.8 * r), (z + tall, 0.5 * r)]
    model.add(pick(rng, BLACK, *SHELLS), column(rows, count=16).moved(x, y))
    if chance(rng, 0.4):
        model.add(pick(rng, *CHROME), rod(z + tall - 2, z + tall + 12, 2.2, "z", count=12).moved(x, y))


def smartphone(model: Model, rng: Rng) -> None:
    """Slab of glass with icons; home key and earpiece, notch or punch hole; camera bump behind."""
    w, t, h = rng.uniform(58, 80), rng.uniform(7.5, 11), rng.uniform(115, 166)
    leaf = Leaf(rng, (w, t, h), pick(rng, *SHELLS, *BRIGHT), exponent=rng.uniform(6, 16), bevel=rng.uniform(1, 2.5))
    pane = pick(rng, BLACK, (240, 240, 240), spread=6).color
    leaf.rectangle(0, h / 2, w - 1.5, h - 1.5, pane, 6)
    old = chance(rng, 0.5)
    chin = rng.uniform(12, 19) if old else rng.uniform(3.5, 6)
    leaf.screen(h / 2, w - (8 if old else 7), h - 2 * chin, lit=1.0, rim=0.0)
    if old:
        size = (18.0, 7.0) if chance(rng, 0.4) else (0.6 * chin, 0.6 * chin)
        leaf.key(0, chin / 2, size, pick(rng, *CHROME).color, oval=True)
        leaf.earpiece(h - chin / 2)
    else:
        wide = rng.uniform(16, 30) if chance(rng, 0.5) else 5
        leaf.rectangle(0 if wide > 5 else rng.uniform(-0.3, 0.3) * w, h - chin - 4, wide, 5, BLACK, 2.4)
    model.add(*leaf.build())
    camera = box((15, 4, rng.uniform(17, 40)), 5, 1.2).moved(rng.uniform(0.18, 0.3) * w, t / 2 + 1.2, h - 27)
    model.add(pick(rng, *SHELLS), camera, box((2.4, 3, 14), 4, 0.5).moved(w / 2, 0, 0.75 * h))


def bar_phone(model: Model, rng: Rng) -> None:
    """Candy bar: display, pad, twelve keys; a faceplate of another colour and a stub antenna on some."""
    w, t, h = rng.uniform(42, 52), rng.uniform(14, 23), rng.uniform(98, 136)
    leaf = Leaf(rng, (w, t, h), pick(rng, *SHELLS, *BRIGHT), exponent=rng.uniform(3.5, 7), bevel=rng.uniform(2, 5))
    if chance(rng, 0.6):
        leaf.rectangle(0, 0.5 * h, 0.84 * w, 0.9 * h, pick(rng, *SHELLS, *CHROME, *BRIGHT).color, rng.uniform(5, 16))
    split, tall = rng.uniform(0.5, 0.56) * h, rng.uniform(0.2, 0.26) * h
    leaf.screen(0.88 * h - 0.5 * tall, 0.66 * w, tall)
    leaf.earpiece(0.935 * h)
    leaf.navigation(split + 0.01 * h, 0.9 * w)
    leaf.keypad(0.78 * w, 0.08 * h, split - 0.09 * h)
    model.add(*leaf.build())
    if chance(rng, 0.45):
        antenna(model, rng, rng.choice([0.28, -0.28]) * w, 0, h, rng.uniform(14, 34))


def brick(model: Model, rng: Rng) -> None:
    """Early phone: deep body, battery behind, narrow display, big keys, long antenna."""
    w, t, h = rng.uniform(48, 62), rng.uniform(30, 48), rng.uniform(160, 210)
    shade = pick(rng, (60, 60, 62), (206, 200, 184), (90, 92, 88), (32, 34, 38))
    leaf = Leaf(rng, (w, t, h), shade, exponent=rng.uniform(8, 14), bevel=rng.uniform(3, 6))
    high, slots = rng.uniform(0.5, 0.6) * h, int(rng.integers(3, 6))
    leaf.screen(high + 0.13 * h, 0.64 * w, 0.09 * h, lit=0)
    leaf.keypad(0.76 * w, 0.12 * h, high)
    for slot in range(slots):
        leaf.rectangle(0, high + (0.25 + 0.03 * slot) * h, 0.5 * w, 2.6, BLACK)
    model.add(*leaf.build())
    deep = rng.uniform(12, 22)
    model.add(pick(rng, (40, 40, 42), (120, 116, 106)), box((0.86 * w, deep, 0.62 * h), 10, 3).moved(0, t / 2 + 0.4 * deep, 0.42 * h))
    antenna(model, rng, 0.3 * w, 0.1 * t, h, rng.uniform(40, 90))


def flip(model: Model, rng: Rng) -> None:
    """Clamshell open at an angle: keys below, hinge, leaf with the screen leaning forward."""
    w, t, h = rng.uniform(42, 54), rng.uniform(10, 15), rng.uniform(76, 98)
    shade, inner = pick(rng, *SHELLS, *BRIGHT), pick(rng, *SHELLS, *CHROME).color
    exponent, bevel = rng.uniform(5, 10), rng.uniform(2, 3.5)
    lower = Leaf(rng, (w, t, h), shade, exponent=exponent, bevel=bevel)
    lower.rectangle(0, 0.47 * h, 0.86 * w, 0.84 * h, inner, 6)
    lower.navigation(0.74 * h, 0.9 * w)
    lower.keypad(0.78 * w, 0.09 * h, 0.57 * h)
    model.add(*lower.build())
    tall, hinge = h * rng.uniform(0.92, 1.04), h + 1.5
    upper = Leaf(rng, (w, rng.uniform(0.68, 0.9) * t, tall), shade, exponent=exponent, bevel=bevel)
    upper.rectangle(0, 0.5 * tall, 0.86 * w, 0.88 * tall, inner, 6)
    upper.screen(0.5 * tall, 0.66 * w, rng.uniform(0.5, 0.66) * tall)
    upper.earpiece(0.9 * tall)
    materials, *solids = upper.build()
    lean = rng.uniform(0.15, 0.6)
    model.add(materials, *(solid.moved(z=hinge + 2).turned("x", lean, (0, 0, hinge)) for solid in solids))
    model.add(pick(rng, *CHROME, *SHELLS), rod(-0.45 * w, 0.45 * w, 0.48 * t).moved(y=-0.1 * t, z=hinge))
    if chance(rng, 0.5):
        antenna(model, rng, 0.36 * w, 0.5 * t, h - 2, rng.uniform(14, 24))


def folded(model: Model, rng: Rng) -> None:
    """Clamshell closed: two leaves with a gap around, hinge on top, small outer display, camera."""
    w, t, h = rng.uniform(44, 54), rng.uniform(20, 27), rng.uniform(82, 104)
    leaf = Leaf(rng, (w, t, h), pick(rng, *SHELLS, *BRIGHT))
    z, exponent, gap = rng.uniform(0.5, 0.62) * h, rng.uniform(3.5, 8), rng.uniform(-0.08, 0.1) * t
    if chance(rng, 0.5):
        leaf.rectangle(0, z, 0.72 * w, 0.72 * w, pick(rng, *CHROME).color, 0.36 * w)
    leaf.screen(z, 0.44 * w, rng.uniform(0.28, 0.4) * w)
    for bar in range(int(rng.integers(1, 5))):
        leaf.rectangle(0, (0.12 + 0.04 * bar) * h, 0.4 * w, 2.2, BLACK)
    leaf.key(0, z + 0.31 * h, (12, 12), pick(rng, *CHROME).color, oval=True)
    leaf.rectangle(0, z + 0.31 * h, 7, 7, (16, 20, 34), 3.5)
    edge = [(-0.5, 3), (-0.47, 1), (-0.4, 0)]  # (share of the thickness, inset)
    profile = [*edge, (gap / t - 0.06, 0), (gap / t - 0.03, 2), (gap / t + 0.03, 2), (gap / t + 0.06, 0)]
    rows = [(y * t, h / 2 - inset, w / 2 - inset, exponent) for y, inset in [*profile, *((-y, inset) for y, inset in edge[::-1])]]
    model.add(*leaf.build(column(rows, "y", 40)))
    model.add(pick(rng, *CHROME, *SHELLS), rod(-0.3 * w, 0.3 * w, 0.4 * t).moved(z=h - 0.12 * t))
    if chance(rng, 0.55):
        antenna(model, rng, 0.32 * w, 0.18 * t, h - 3, rng.uniform(12, 26))


def slider(model: Model, rng: Rng) -> None:
    """Two leaves pushed apart: screen and pad on the front one, keys on the rear one."""
    w, t, h = rng.uniform(44, 53), rng.uniform(7.5, 9.5), rng.uniform(88, 106)
    travel, exponent, tall = rng.uniform(0.38, 0.52) * h, rng.uniform(5, 10), rng.uniform(0.48, 0.58) * h
    rear = Leaf(rng, (w, t, h), pick(rng, *SHELLS), exponent=exponent)
    rear.keypad(0.84 * w, 0.05 * h, 0.97 * travel)
    front = Leaf(rng, (w, t, h), pick(rng, *SHELLS, *BRIGHT), exponent=exponent)
    front.screen(0.9 * h - tall / 2, 0.74 * w, tall)
    front.earpiece(0.955 * h)
    front.navigation(0.17 * h, 0.92 * w)
    for leaf, up in ((rear, 0.0), (front, 1.0)):
        materials, *solids = leaf.build()
        model.add(materials, *(solid.moved(y=-up * (t - 0.2), z=up * travel) for solid in solids))


def keyboard_phone(model: Model, rng: Rng) -> None:
    """Broad phone with a small letter keyboard under a landscape screen."""
    w, t, h = rng.uniform(58, 74), rng.uniform(11, 16), rng.uniform(104, 124)
    leaf = Leaf(rng, (w, t, h), pick(rng, *SHELLS, *BRIGHT), exponent=rng.uniform(4, 9), bevel=rng.uniform(2, 4))
    split = rng.uniform(0.4, 0.47) * h
    leaf.rectangle(0, 0.5 * h, 0.92 * w, 0.94 * h, pick(rng, *SHELLS, *CHROME).color, 8)
    leaf.screen(0.76 * h, 0.74 * w, 0.26 * h, lit=0.9)
    leaf.earpiece(0.935 * h)
    leaf.navigation(split + 0.055 * h, 0.84 * w)
    leaf.keypad(0.88 * w, 0.06 * h, split - 0.045 * h, QWERTY)
    model.add(*leaf.build())


def organiser(model: Model, rng: Rng) -> None:
    """Pocket computer with a phone in it: large pane, row of hard keys, pen in a slot, thick antenna on some."""
    w, t, h = rng.uniform(66, 82), rng.uniform(15, 22), rng.uniform(112, 138)
    leaf = Leaf(rng, (w, t, h), pick(rng, *SHELLS), exponent=rng.uniform(4, 8), bevel=rng.uniform(3, 5))
    leaf.rectangle(0, 0.5 * h, 0.86 * w, 0.88 * h, pick(rng, *CHROME, *SHELLS).color, rng.uniform(4, 12))
    leaf.screen(0.58 * h, 0.7 * w, rng.uniform(0.52, 0.6) * h, lit=0.6)
    leaf.key(0, 0.16 * h, (0.22 * w, 0.18 * w), pick(rng, *CHROME).color, oval=True)
    color = pick(rng, *SHELLS, BLACK).color
    for x in (-0.33, -0.2, 0.2, 0.33):
        leaf.key(x * w, 0.16 * h, (0.1 * w, 0.09 * h), color, oval=True)
    model.add(*leaf.build())
    model.add(pick(rng, BLACK, *CHROME), rod(h - 8, h + 5, 2.6, "z", count=14).moved(0.34 * w, 0.2 * t))
    if chance(rng, 0.6):
        antenna(model, rng, -0.32 * w, 0, h, rng.uniform(16, 26))


KINDS: tuple[Kind, ...] = (smartphone, smartphone, bar_phone, brick, flip, folded, slider, keyboard_phone, organiser)
