"""Knives: six for the kitchen (chef, santoku, cleaver, bread, paring, fillet), hunting knife, dagger, pocket knife, table knife.

Millimetres, along x with the tip at +x, the edge down; blade and handle meet at x = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.toy_objects.model import Kind, Material, Model, Palette, Rng, chance, pick
from pipeline.toy_objects.solids import Rows, Solid, ball, bar, box, curve, loft, rod, smooth, sweep

STEELS: Palette = ((206, 210, 214), (184, 190, 196), (222, 222, 220), (150, 156, 162))
DARK_STEELS: Palette = ((62, 64, 68), (90, 92, 96))
WOODS: Palette = ((112, 66, 36), (146, 94, 52), (78, 46, 30), (176, 124, 76), (56, 38, 32))
PLASTICS: Palette = ((30, 30, 32), (44, 48, 54), (190, 36, 36), (240, 240, 236), (34, 84, 150), (226, 170, 40), (60, 120, 70))
BRASS, DARK = (190, 150, 70), (50, 52, 56)


@dataclass(frozen=True)
class Blade:
    """A blade of a silhouette, from x = 0 to its `length`.

    `outline` has rows (x / length, top / height, bottom / height). The blade is `thick` at the spine, its bevel takes the
    share `grind` of the height (0.5 and `double`: edges above and below), `teeth` of depth `bite` (of the height) run along
    the edge.
    """

    length: float
    height: float
    thick: float
    outline: Rows
    grind: float = 0.7
    teeth: int = 0
    bite: float = 0.0
    double: bool = False

    def solid(self) -> Solid:
        """Loft the blade; it reaches a little into the handle."""
        table = smooth(self.outline, 8)
        share = np.linspace(-0.04, 1.0, max(50, 8 * self.teeth))
        top, bottom = (np.interp(share, table[:, 0], table[:, i]) * self.height for i in (1, 2))
        if self.teeth:
            wave = np.abs(np.sin(np.pi * self.teeth * share)) * np.clip(20.0 * (0.97 - share), 0.0, 1.0)
            bottom = bottom + self.bite * self.height * (1.0 - wave) * (share > 0.04)
        half = np.minimum(self.thick / 2.0 * np.interp(share, [0.0, 0.6, 1.0], [1.0, 0.9, 0.4]), 0.35 * (top - bottom) + 0.1)
        edge, spine = 0.14 * half, (0.14 if self.double else 0.85) * half
        shoulder = bottom + self.grind * (top - bottom)
        corners = ((spine, top), (half, shoulder), (edge, bottom), (-edge, bottom), (-half, shoulder), (-spine, top))
        return loft(np.stack([np.stack([share * self.length, y, z], axis=-1) for y, z in corners], axis=1))


def steel(rng: Rng) -> Material:
    """Draw bright steel, seldom blackened."""
    return pick(rng, *(DARK_STEELS if chance(rng, 0.12) else STEELS), spread=8)


@dataclass(frozen=True)
class Handle:
    """The space of a handle: from x = -length to 0, from z = 0 to its height."""

    length: float
    height: float
    width: float

    def bar(self, rows: Rows, exponent: float, bands: Sequence[Sequence[float]] = ()) -> Solid:
        """Loft rows (x / length, bottom / height, top / height, width / width), with layers for bands (low, high) of x / length."""
        scale = np.array([self.length, self.height, self.height, self.width])
        spans = np.array(bands).reshape(-1, 2) * self.length
        return bar(smooth(np.array(rows) * scale, at=spans.ravel().tolist()), exponent).banded("x", spans)

    def rivets(self, shares: Sequence[float], z: float, size: float) -> list[Solid]:
        """Make rivets through the handle at shares of its length, at a share `z` of its height."""
        return [rod(-0.53 * self.width, 0.53 * self.width, size, "y", count=12).moved(-x * self.length, z=z * self.height) for x in shares]


def riveted(model: Model, rng: Rng, handle: Handle) -> None:
    """Slabs of wood or plastic held by rivets, a steel bolster in front; the butt drops in some."""
    drop, belly = rng.uniform(0.0, 0.35), rng.uniform(0.0, 0.16)
    rows = [(-1, -drop, 0.95 - drop, 0.9), (-0.85, -drop - belly, 1 - 0.8 * drop, 1), (-0.5, belly, 0.97, 1)]
    front = -rng.uniform(0.08, 0.14)
    solid = handle.bar([*rows, (-0.2, 0, 0.93, 1), (0, 0.04, 0.95, 0.8)], 3.0, [(front, 0)])
    model.add((pick(rng, *WOODS, *PLASTICS), pick(rng, *STEELS)), solid)
    model.add(pick(rng, *STEELS, BRASS), *handle.rivets(np.linspace(0.2, 0.8, int(rng.integers(2, 5))).tolist(), 0.45, 3.2))


def moulded(model: Model, rng: Rng, handle: Handle) -> None:
    """Plastic with waves for the fingers, in one colour or two."""
    share = np.linspace(-1, 0, 12)
    wave = rng.uniform(0.0, 0.09) * np.cos(rng.uniform(12, 20) * share)
    swell = 0.12 * np.sin(np.pi * share) ** 2
    rows = np.column_stack([share, wave + swell - 0.06, 0.96 + swell, 0.86 + swell])
    rows[0, 1:] = 0.2, 0.8, 0.5  # the rounded butt
    color = pick(rng, *PLASTICS)
    trim = pick(rng, *PLASTICS, *STEELS) if chance(rng, 0.6) else color
    low = -rng.uniform(0.8, 0.95)
    model.add((color, trim), handle.bar(rows, 2.7, [(low, low + 0.15)]))


def octagonal(model: Model, rng: Rng, handle: Handle) -> None:
    """Japanese handle: a long, slightly swelling octagon and a ferrule of another colour."""
    swell, collar = rng.uniform(1.05, 1.25), -rng.uniform(0.16, 0.28)
    rows = [(x, 0.5 - 0.42 * r, 0.5 + 0.42 * r, 0.95 * r) for x, r in ((-1, swell), (collar, 1.02), (0, 0.95))]
    solid = handle.bar(rows, 4.5, [(collar, 0)])
    model.add((pick(rng, *WOODS), pick(rng, (30, 28, 28), (220, 206, 176), (90, 50, 30))), solid)


def hollow_steel(model: Model, rng: Rng, handle: Handle) -> None:
    """All of steel, with a waist and dark rings."""
    waist, rings = rng.uniform(0.37, 0.48), np.linspace(-0.85, -0.2, int(rng.integers(4, 9)))
    rows = [(-1, 0.1, 0.8, 0.6), (-0.95, -0.06, 1, 1), (-0.5, 0.5 - waist, 0.5 + waist, 2 * waist), (-0.12, 0.02, 0.98, 1)]
    solid = handle.bar([*rows, (0, 0.05, 0.95, 0.6)], 2.3, [(x, x + 0.025) for x in rings])
    model.add((pick(rng, *STEELS), *[pick(rng, DARK)] * len(rings)), solid)


def stacked(model: Model, rng: Rng, handle: Handle) -> None:
    """Discs of leather or cord one behind the other, and a pommel."""
    count = int(rng.integers(5, 12))
    dark = pick(rng, (104, 62, 34), (60, 58, 40), (36, 34, 34))
    light = pick(rng, (150, 100, 58), (96, 92, 66), (60, 58, 58))
    edges = np.linspace(-1, 0, 2 * count + 1)
    half = 0.5 * (0.86 + 0.14 * np.sin(-np.pi * edges)) * np.where(np.arange(2 * count + 1) % 2, 1.0, 0.9)  # grooves between discs
    solid = handle.bar(np.column_stack([edges, 0.5 - half, 0.5 + half, 2 * half]), 2.4, list(zip(edges[:-2:4], edges[2::4], strict=False)))
    model.add((dark, *[light] * ((count + 1) // 2)), solid)
    pommel = ball((0.4 * handle.height, 0.6 * handle.width, rng.uniform(0.5, 0.62) * handle.height))
    model.add(pick(rng, *STEELS, BRASS), pommel.moved(x=-handle.length - 3, z=0.5 * handle.height))


Style = Callable[[Model, Rng, Handle], None]
STYLES: tuple[Style, ...] = (riveted, riveted, moulded, octagonal, hollow_steel)


def add_handle(model: Model, rng: Rng, style: Style, handle: Handle, z: float) -> None:
    """Add a handle that begins at height z."""
    part = Model()
    style(part, rng, handle)
    for materials, solid in part.parts:
        model.add(materials, solid.moved(z=z))


def kitchen(model: Model, rng: Rng, blade: Blade, styles: Sequence[Style] = STYLES) -> None:
    """Add a blade and a handle flush with its spine."""
    model.add(steel(rng), blade.solid())
    height = rng.uniform(21, 27)
    handle = Handle(rng.uniform(105, 130), height, rng.uniform(0.62, 0.85) * height)
    add_handle(model, rng, styles[int(rng.integers(len(styles)))], handle, blade.height - height + 1)


def chef(model: Model, rng: Rng) -> None:
    """Broad triangle with a curved belly, the heel below the handle."""
    drop = rng.uniform(0.0, 0.28)
    rows = [(0, 1, 0), (0.25, 1, -0.02), (0.6, 1 - 0.3 * drop, 0.04), (0.85, 1 - 0.7 * drop, 0.3)]
    rows += [(0.97, 1 - 1.1 * drop, 0.56), (1, 0.98 - 1.2 * drop, 0.64)]
    kitchen(model, rng, Blade(rng.uniform(170, 260), rng.uniform(40, 56), rng.uniform(4.5, 6.5), rows, rng.uniform(0.5, 1.0)))


def santoku(model: Model, rng: Rng) -> None:
    """Straight edge, the spine falling to the tip; hollows along the bevel in some."""
    rows = [(0, 1, 0), (0.55, 1, 0), (0.78, 0.96, 0.03), (0.92, 0.72, 0.09), (0.985, 0.42, 0.16), (1, 0.3, 0.2)]
    blade = Blade(rng.uniform(140, 190), rng.uniform(40, 52), rng.uniform(4, 6), rows, rng.uniform(0.3, 0.6))
    kitchen(model, rng, blade)
    if chance(rng, 0.6):
        hollow = ball((0.02 * blade.length, 0.55 * blade.thick, 0.17 * blade.height), 12).moved(z=0.42 * blade.height)
        at = np.linspace(0.1, 0.72, int(rng.integers(6, 11))) * blade.length
        model.add(pick(rng, (156, 162, 170), spread=4), *(hollow.moved(x) for x in at))


def cleaver(model: Model, rng: Rng) -> None:
    """Tall slab of a blade, square or rounded at the end, with a hole to hang it by."""
    nose, low = rng.uniform(0.0, 0.35), rng.uniform(-0.06, 0)
    rows = [(0, 1, 0), (0.5, rng.uniform(1.0, 1.06), low), (0.93, 1 - 0.2 * nose, 0.02), (1, 1 - nose, 0.1 * nose + 0.02)]
    blade = Blade(rng.uniform(150, 210), rng.uniform(76, 112), rng.uniform(5, 7.5), rows, rng.uniform(0.15, 0.4))
    kitchen(model, rng, blade, (riveted, moulded, octagonal))
    if chance(rng, 0.7):
        eye = rod(-0.55 * blade.thick, 0.55 * blade.thick, rng.uniform(6, 9), "y", 0.05)
        model.add(pick(rng, (40, 40, 42)), eye.moved(0.88 * blade.length, z=0.8 * blade.height))


def bread(model: Model, rng: Rng) -> None:
    """Long, even blade with scalloped teeth and a blunt end."""
    rows = [(0, 1, 0), (0.5, 1, rng.uniform(-0.15, 0)), (0.9, 0.98, 0.02), (0.97, 0.9, 0.16), (1, 0.7, 0.4)]
    size = rng.uniform(190, 260), rng.uniform(26, 34), rng.uniform(4.5, 6)
    kitchen(model, rng, Blade(*size, rows, 0.5, int(rng.integers(14, 28)), rng.uniform(0.12, 0.2)))


def paring(model: Model, rng: Rng) -> None:
    """Short pointed blade, shorter than its handle; straight, or curved like a beak."""
    straight = [(0, 1, 0), (0.4, 1, -0.02), (0.75, 0.94, 0.12), (0.95, 0.82, 0.5), (1, 0.76, 0.64)]
    beak = [(0, 1, 0.02), (0.4, 0.98, 0.06), (0.75, 0.72, -0.02), (0.95, 0.22, -0.22), (1, -0.06, -0.28)]
    rows = beak if chance(rng, 0.35) else straight
    kitchen(model, rng, Blade(rng.uniform(68, 100), rng.uniform(20, 27), rng.uniform(4, 5.5), rows, rng.uniform(0.5, 1.0)))


def fillet(model: Model, rng: Rng) -> None:
    """Slim flexible blade that sweeps up to the tip."""
    up = rng.uniform(0.2, 0.9)
    rows = [(0, 1, 0), (0.15, 0.96, 0.1), (0.55, 0.92, 0.1), (0.85, 0.95 + 0.4 * up, 0.3 + 0.4 * up), (1, 1.05 + up, 0.86 + up)]
    blade = Blade(rng.uniform(150, 250), rng.uniform(22, 30), rng.uniform(4.5, 6), rows, 0.8)
    kitchen(model, rng, blade, (riveted, moulded, hollow_steel))


def hunting(model: Model, rng: Rng) -> None:
    """Bowie: clip or drop point, guard; a riveted handle or stacked leather and a pommel."""
    clip = [(0, 1, 0), (0.55, 1, 0), (0.64, 0.97, 0.0), (0.8, 0.74, 0.1), (0.94, 0.66, 0.4), (1, 0.66, 0.6)]
    drop = [(0, 1, 0), (0.4, 1.04, -0.04), (0.75, 0.9, 0.06), (0.95, 0.56, 0.34), (1, 0.48, 0.42)]
    size = rng.uniform(120, 200), rng.uniform(32, 44), rng.uniform(6, 8)
    blade = Blade(*size, clip if chance(rng, 0.6) else drop, rng.uniform(0.4, 0.65))
    handle = Handle(rng.uniform(105, 125), 0.8 * blade.height, rng.uniform(20, 25))
    model.add(steel(rng), blade.solid())
    add_handle(model, rng, riveted if chance(rng, 0.4) else stacked, handle, 0.1 * blade.height)
    over, under = rng.uniform(2, 14), rng.uniform(6, 20)
    guard = box((9, handle.width + 3, blade.height + over + under), 4, 2.5, "x")
    model.add(pick(rng, *STEELS, BRASS), guard.moved(z=(blade.height + over - under) / 2))


def dagger(model: Model, rng: Rng) -> None:
    """Symmetric, double-edged, with a cross-guard, a grip of rings and a pommel."""
    leaf, r = rng.uniform(0.0, 0.12), rng.uniform(9.5, 12)
    rows = [(0, 0.5 - leaf, -0.5 + leaf), (0.35, 0.5, -0.5), (0.75, 0.4, -0.4), (0.95, 0.16, -0.16), (1, 0.06, -0.06)]
    model.add(steel(rng), Blade(rng.uniform(150, 280), rng.uniform(26, 42), rng.uniform(7, 10), rows, 0.5, double=True).solid())
    add_handle(model, rng, stacked, Handle(rng.uniform(85, 120), 2 * r, 1.8 * r), -r)
    trim, reach, lean = pick(rng, *STEELS, BRASS, (70, 72, 76)), rng.uniform(26, 52), rng.uniform(-16, 22)
    path = curve([(lean * z * z, 0, reach * z) for z in (-1, -0.5, 0, 0.5, 1)], 21)
    model.add(trim, sweep(path, np.interp(np.abs(path[:, 2]), [0, reach], [17, 9]), 10))
    if chance(rng, 0.5):
        model.add(trim, *(ball((7, 7, 7)).moved(lean, 0, side * reach) for side in (-1, 1)))


def folding(model: Model, rng: Rng) -> None:
    """Pocket knife opened, straight or at an angle: pivot, rivets, clip."""
    length, height = rng.uniform(95, 118), rng.uniform(21, 28)
    handle = Handle(length, height, rng.uniform(0.6, 0.75) * height)
    spear = [(0, 0.9, 0.1), (0.45, 0.98, 0), (0.8, 0.8, 0.12), (0.96, 0.56, 0.4), (1, 0.52, 0.46)]
    tanto = [(0, 0.9, 0.1), (0.1, 1, 0), (0.7, 0.98, 0), (0.76, 0.96, 0.06), (0.96, 0.88, 0.72), (1, 0.88, 0.8)]
    sheep = [(0, 0.9, 0.1), (0.5, 1, 0), (0.8, 0.94, 0), (0.95, 0.5, 0.02), (1, 0.2, 0.06)]
    outline = (spear, tanto, sheep)[rng.integers(3)]
    blade = Blade(rng.uniform(0.7, 0.9) * length, 0.85 * height, rng.uniform(4.5, 5.5), outline, rng.uniform(0.4, 0.7))
    angle, pivot = 0.0 if chance(rng, 0.6) else rng.uniform(-1.3, -0.5), 0.25 * height
    model.add(steel(rng), blade.solid().moved(-4, z=-0.42 * height).turned("y", angle, (-pivot, 0, 0)))
    butt, bend = rng.uniform(0.3, 0.42), rng.uniform(-0.06, 0.1)
    rows = [(-1, -butt + 0.1, butt - 0.1, 0.7), (-0.95, -butt, butt, 1), (-0.5, -0.42 - bend, 0.45 - bend, 1)]
    solid = handle.bar([*rows, (-0.1, -0.48, 0.48, 1), (0, -0.28, 0.28, 0.8)], 3.5, [(-0.2, 0)])
    color, bright = pick(rng, *WOODS, *PLASTICS), pick(rng, *STEELS, BRASS)
    model.add((color, pick(rng, *STEELS) if chance(rng, 0.5) else color), solid)
    model.add(bright, *handle.rivets([pivot / length], 0, 0.22 * height), *handle.rivets([0.6, 0.9], 0, 0.1 * height))
    if chance(rng, 0.6):
        clip = curve([(x * length, y * handle.width, 0) for x, y in ((-0.94, -0.4), (-0.9, -0.62), (-0.5, -0.5))], 10)
        model.add(bright, sweep(clip, 0.26 * height, 2.2, side="z"))


def table_knife(model: Model, rng: Rng) -> None:
    """Dinner or butter knife: round tip, handle swelling to the butt, a ring or two; steak teeth in some."""
    h, swell, grip = rng.uniform(17, 23), rng.uniform(0.0, 0.3), rng.uniform(90, 120)
    rows = [(0, 0.78, 0.2), (0.12, 0.86, 0.04), (0.6, 0.9 + 0.1 * swell, -0.04), (0.85, 0.92, 0), (0.96, 0.8, 0.16), (1, 0.64, 0.36)]
    metal, teeth = steel(rng), int(rng.integers(18, 34)) if chance(rng, 0.4) else 0
    model.add(metal, Blade(rng.uniform(95, 125), h, rng.uniform(4, 5), rows, 0.5, teeth, 0.09).solid())
    handle = Handle(grip, rng.uniform(0.95, 1.3) * h, 10 * rng.uniform(0.85, 1.1))
    profile = [(-1, -0.28, 0.1, 0.5), (-0.96, -0.48, 0.4, 0.95), (-0.8, -0.5, 0.48, 1), (-0.3, -0.36, 0.3, 0.75)]
    rings = [(x, x + 0.03) for x in np.linspace(-0.14, -0.05, int(rng.integers(1, 4)))]
    color = metal if chance(rng, 0.5) else pick(rng, *PLASTICS, *WOODS)
    dark = pick(rng, DARK, *STEELS)
    solid = handle.bar([*profile, (-0.08, -0.3, 0.22, 0.6), (0.04, -0.3, 0.26, 0.5)], 2.6, rings)
    model.add((color, *[dark] * len(rings)), solid.moved(z=0.5 * h))


KINDS: tuple[Kind, ...] = (chef, santoku, cleaver, bread, paring, fillet, hunting, dagger, folding, table_knife)
