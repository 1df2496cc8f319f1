"""Knives by kind: kitchen knives of six sorts, hunting knife, dagger, pocket knife, table knife.

Along x, the tip at +x, the edge down, in millimetres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.toy_objects.blade import Blade
from pipeline.toy_objects.handles import (
    HANDLES,
    PLASTICS,
    STEELS,
    WOODS,
    bolster,
    hollow_steel,
    moulded,
    octagonal,
    scales,
    stacked,
)  # fmt: skip
from pipeline.toy_objects.paint import Color, Material, Model, chance, pick
from pipeline.toy_objects.shapes import (
    ball,
    bar,
    curve,
    revolve,
    rod,
    rounded_box,
    smooth,
    sweep,
)

Rng = np.random.Generator
DARK_STEELS: tuple[Color, ...] = ((62, 64, 68), (90, 92, 96))


def steel(rng: Rng) -> Material:
    """Bright steel, seldom blackened."""
    return pick(rng, *(DARK_STEELS if chance(rng, 0.12) else STEELS), spread=8)


def kitchen(model: Model, rng: Rng, blade: Blade, handles: Sequence[Callable[..., None]] = HANDLES) -> None:
    """A kitchen knife: blade, some handle as high as the blade's heel allows, bolster or none."""
    model.add(steel(rng), blade.solid())
    height = rng.uniform(21, 27)
    width, length = rng.uniform(0.62, 0.85) * height, rng.uniform(105, 130)
    top = float(np.array(blade.outline)[0, 1]) * blade.height
    part = Model()
    handle = handles[int(rng.integers(len(handles)))]
    handle(part, rng, length, height, width)
    if handle is not octagonal and chance(rng, 0.7):
        bolster(part, rng, height, 0.9 * width, min(rng.uniform(9, 17), 0.1 * blade.length))
    model.parts.extend((solid.moved(z=top - height + 1.0), material) for solid, material in part.parts)


def chef(model: Model, rng: Rng) -> None:
    """Broad triangle with a curved belly, the heel below the handle."""
    drop = rng.uniform(0.0, 0.28)
    rows = [
        (0, 1, 0),
        (0.25, 1, -0.02),
        (0.6, 1 - 0.3 * drop, 0.04),
        (0.85, 1 - 0.7 * drop, 0.3),
        (0.97, 1 - 1.1 * drop, 0.56),
        (1, 0.98 - 1.2 * drop, 0.64),
    ]
    kitchen(
        model,
        rng,
        Blade(rng.uniform(170, 260), rng.uniform(40, 56), rng.uniform(4.5, 6.5), rows, rng.uniform(0.5, 1.0)),
    )


def santoku(model: Model, rng: Rng) -> None:
    """Straight edge, the spine falling to the tip; hollows along the bevel in some."""
    rows = [(0, 1, 0), (0.55, 1, 0), (0.78, 0.96, 0.03), (0.92, 0.72, 0.09), (0.985, 0.42, 0.16), (1, 0.3, 0.2)]
    blade = Blade(rng.uniform(140, 190), rng.uniform(40, 52), rng.uniform(4, 6), rows, rng.uniform(0.3, 0.6))
    kitchen(model, rng, blade)
    if chance(rng, 0.6):
        for share in np.linspace(0.1, 0.72, int(rng.integers(6, 11))):
            dimple = ball((0.02 * blade.length, 0.55 * blade.thick, 0.17 * blade.height), 12)
            model.add(pick(rng, (176, 182, 188), spread=4), dimple.moved(share * blade.length, 0, 0.42 * blade.height))


def cleaver(model: Model, rng: Rng) -> None:
    """Tall slab of a blade, square or rounded at the end."""
    nose = rng.uniform(0.0, 0.35)
    rows = [
        (0, 1, 0),
        (0.5, rng.uniform(1.0, 1.06), rng.uniform(-0.06, 0)),
        (0.93, 1 - 0.2 * nose, 0.02),
        (1, 1 - nose, 0.1 * nose + 0.02),
    ]
    blade = Blade(rng.uniform(150, 210), rng.uniform(76, 112), rng.uniform(5, 7.5), rows, rng.uniform(0.15, 0.4))
    kitchen(model, rng, blade, (scales, moulded, octagonal))
    if chance(rng, 0.7):
        eye = rod(-0.55 * blade.thick, 0.55 * blade.thick, rng.uniform(6, 9), "y", 0.05)
        model.add(pick(rng, (40, 40, 42)), eye.moved(x=0.88 * blade.length, z=0.8 * blade.height))


def bread(model: Model, rng: Rng) -> None:
    """Long, even blade with scalloped teeth and a blunt end."""
    rows = [(0, 1, 0), (0.5, 1, rng.uniform(-0.15, 0)), (0.9, 0.98, 0.02), (0.97, 0.9, 0.16), (1, 0.7, 0.4)]
    teeth = int(rng.integers(14, 28))
    kitchen(
        model,
        rng,
        Blade(rng.uniform(190, 260), rng.uniform(26, 34), rng.uniform(4.5, 6), rows, 0.5, teeth, rng.uniform(0.12, 0.2)),
    )


def paring(model: Model, rng: Rng) -> None:
    """Short pointed blade, shorter than its handle; straight, or curved like a beak."""
    beak = chance(rng, 0.35)
    straight = [(0, 1, 0), (0.4, 1, -0.02), (0.75, 0.94, 0.12), (0.95, 0.82, 0.5), (1, 0.76, 0.64)]
    hooked = [(0, 1, 0.02), (0.4, 0.98, 0.06), (0.75, 0.72, -0.02), (0.95, 0.22, -0.22), (1, -0.06, -0.28)]
    kitchen(
        model,
        rng,
        Blade(
            rng.uniform(68, 100),
            rng.uniform(20, 27),
            rng.uniform(4, 5.5),
            hooked if beak else straight,
            rng.uniform(0.5, 1.0),
        ),
    )


def fillet(model: Model, rng: Rng) -> None:
    """Slim flexible blade that sweeps up to the tip; a boning or carving knife."""
    up = rng.uniform(0.2, 0.9)
    rows = [
        (0, 1, 0),
        (0.15, 0.96, 0.1),
        (0.55, 0.92, 0.1),
        (0.85, 0.95 + 0.4 * up, 0.3 + 0.4 * up),
        (1, 1.05 + up, 0.86 + up),
    ]
    kitchen(
        model,
        rng,
        Blade(rng.uniform(150, 250), rng.uniform(22, 30), rng.uniform(4.5, 6), rows, 0.8),
        (scales, moulded, hollow_steel),
    )


def hunting(model: Model, rng: Rng) -> None:
    """Bowie: clip or drop point, guard, saw teeth on the spine in none; scales or stacked leather and a pommel."""
    clip = chance(rng, 0.6)
    clipped = [(0, 1, 0), (0.55, 1, 0), (0.64, 0.97, 0.0), (0.8, 0.74, 0.1), (0.94, 0.66, 0.4), (1, 0.66, 0.6)]
    dropped = [(0, 1, 0), (0.4, 1.04, -0.04), (0.75, 0.9, 0.06), (0.95, 0.56, 0.34), (1, 0.48, 0.42)]
    blade = Blade(
        rng.uniform(120, 200),
        rng.uniform(32, 44),
        rng.uniform(6, 8),
        clipped if clip else dropped,
        rng.uniform(0.4, 0.65),
    )
    model.add(steel(rng), blade.solid())
    height, width, length = 0.8 * blade.height, rng.uniform(20, 25), rng.uniform(105, 125)
    part = Model()
    (scales if chance(rng, 0.4) else stacked)(part, rng, length, height, width)
    model.parts.extend((solid.moved(z=0.1 * blade.height), material) for solid, material in part.parts)
    over, under = rng.uniform(2, 14), rng.uniform(6, 20)
    guard = rounded_box((9, width + 3, blade.height + over + under), 4, 2.5, "x").moved(z=(blade.height + over - under) / 2)
    model.add(pick(rng, *STEELS, (190, 150, 70)), guard)


def dagger(model: Model, rng: Rng) -> None:
    """Symmetric, double-edged, with a cross-guard, a grip of rings and a pommel."""
    leaf = rng.uniform(0.0, 0.12)
    rows = [(0, 0.5 - leaf, -0.5 + leaf), (0.35, 0.5, -0.5), (0.75, 0.4, -0.4), (0.95, 0.16, -0.16), (1, 0.06, -0.06)]
    blade = Blade(rng.uniform(150, 280), rng.uniform(26, 42), rng.uniform(7, 10), rows, double=True)
    model.add(steel(rng), blade.solid().moved(x=2))
    trim = pick(rng, *STEELS, (196, 156, 66), (70, 72, 76))
    reach, lean = rng.uniform(26, 52), rng.uniform(-16, 22)
    path = curve(
        [(lean, 0, -reach), (0.2 * lean, 0, -0.5 * reach), (0, 0, 0), (0.2 * lean, 0, 0.5 * reach), (lean, 0, reach)],
        21,
    )
    model.add(trim, sweep(path, np.interp(np.abs(path[:, 2]), [0, reach], [17, 9]), 10, 3.0))
    if chance(rng, 0.5):
        model.add(trim, *(ball((7, 7, 7), 14).moved(lean, 0, s * reach) for s in (-1, 1)))
    length, r = rng.uniform(85, 120), rng.uniform(9.5, 12)
    part = Model()
    stacked(part, rng, length, 2 * r, 1.8 * r)
    model.parts.extend((solid.moved(z=-r), material) for solid, material in part.parts[:-1])
    pommel = (
        ball((13, 11, 14)),
        rod(-8, 8, 15, "y", 0.3).moved(x=-6),
        revolve([(-24, 6), (-18, 13), (-6, 12), (6, 8)], "x"),
    )
    model.add(trim, pommel[rng.integers(len(pommel))].moved(x=-length - 6))


def folding(model: Model, rng: Rng) -> None:
    """Pocket knife opened: two liners and scales, pivot, clip; the blade straight out or at an angle."""
    length, height = rng.uniform(95, 118), rng.uniform(21, 28)
    width = rng.uniform(0.5, 0.66) * height
    spear = [(0, 0.9, 0.1), (0.45, 0.98, 0), (0.8, 0.8, 0.12), (0.96, 0.56, 0.4), (1, 0.52, 0.46)]
    tanto = [(0, 0.9, 0.1), (0.1, 1, 0), (0.7, 0.98, 0), (0.76, 0.96, 0.06), (0.96, 0.88, 0.72), (1, 0.88, 0.8)]
    sheep = [(0, 0.9, 0.1), (0.5, 1, 0), (0.8, 0.94, 0), (0.95, 0.5, 0.02), (1, 0.2, 0.06)]
    outline = (spear, tanto, sheep)[rng.integers(3)]
    size = rng.uniform(0.7, 0.9) * length
    blade = Blade(size, 0.85 * height, rng.uniform(4.5, 5.5), outline, rng.uniform(0.4, 0.7)).solid().moved(x=-4, z=-0.42 * height)
    angle = 0.0 if chance(rng, 0.6) else rng.uniform(-1.3, -0.5)
    pivot = -0.3 * height
    model.add(steel(rng), blade.turned("y", angle, (pivot, 0, 0)))
    if chance(rng, 0.5):
        model.add(
            pick(rng, *STEELS),
            rod(-5.5, 5.5, 2.6, "y", 0.3, 12).moved(x=0.2 * size, z=0.15 * height).turned("y", angle, (pivot, 0, 0)),
        )
    bend, butt = rng.uniform(-0.2, 0.3) * height, rng.uniform(0.7, 1.0)
    rows = [
        (-length, -0.3 * butt, 0.3 * butt),
        (-0.96 * length, -0.45 * butt, 0.45 * butt),
        (-0.5 * length, -0.45, 0.5),
    ]
    rows += [(-0.2 * length, -0.5, 0.52), (-0.04 * length, -0.45, 0.45), (0, -0.28, 0.28)]
    table = smooth(np.array(rows) * [1, height, height])
    table[:, 1:] -= bend * (np.sin(np.pi * table[:, :1] / length) ** 2) * 0.3
    liner = bar(np.column_stack([table, np.full(len(table), 0.16 * width)]), 8)
    scale = bar(np.column_stack([table + np.array([0, 0.8, -0.8]), np.full(len(table), 0.3 * width)]), 3.5)
    model.add(pick(rng, *STEELS), liner.moved(y=0.3 * width), liner.moved(y=-0.3 * width))
    model.add(pick(rng, *WOODS, *PLASTICS), scale.moved(y=0.42 * width), scale.moved(y=-0.42 * width))
    bright = pick(rng, *STEELS, (190, 150, 70))
    model.add(
        pick(rng, (60, 62, 66)),
        rounded_box((0.8 * length, 0.44 * width, 0.35 * height), 3, 1).moved(x=-0.52 * length, z=0.1 * height),
    )
    for share, r in ((-pivot / length, 0.24), (0.6, 0.1), (0.9, 0.1)):
        model.add(bright, rod(-0.62 * width, 0.62 * width, r * height, "y", 0.2, 18).moved(x=-share * length))
    if chance(rng, 0.6):
        path = curve(
            [(-0.94 * length, -0.55 * width, 0), (-0.9 * length, -0.8 * width, 0), (-0.5 * length, -0.68 * width, 0)],
            12,
        )
        model.add(bright, sweep(path, 0.26 * height, 2.2, 3, (0, 0, 1)))


def table_knife(model: Model, rng: Rng) -> None:
    """Dinner or butter knife: all steel, round tip, handle swelling to the butt; steak teeth in some."""
    metal, length, grip = steel(rng), rng.uniform(95, 125), rng.uniform(90, 120)
    h, swell = rng.uniform(17, 23), rng.uniform(0.0, 0.3)
    rows = [
        (0, 0.78, 0.2),
        (0.12, 0.86, 0.04),
        (0.6, 0.9 + 0.1 * swell, -0.04),
        (0.85, 0.92, 0.0),
        (0.96, 0.8, 0.16),
        (1, 0.64, 0.36),
    ]
    teeth = int(rng.integers(18, 34)) if chance(rng, 0.4) else 0
    model.add(metal, Blade(length, h, rng.uniform(4, 5), rows, 0.5, teeth, 0.09).solid())
    wide = rng.uniform(0.95, 1.3)
    z = np.array(
        [
            (-1.0, 0.22, 0.6),
            (-0.96, 0.02, 0.9),
            (-0.8, 0.0, 0.98),
            (-0.3, 0.14, 0.8),
            (-0.08, 0.2, 0.72),
            (0.04, 0.2, 0.76),
        ]
    )
    thick = np.array([5, 9.5, 10, 7.5, 6, 5]) * rng.uniform(0.85, 1.1)
    handle = smooth(np.column_stack([z[:, 0] * grip, (0.5 + wide * (z[:, 1:] - 0.5)) * h, thick]))
    model.add(steel(rng) if chance(rng, 0.6) else pick(rng, *PLASTICS, *WOODS), bar(handle, 2.6))
    for share in np.linspace(0.05, 0.14, int(rng.integers(0, 4))):
        low, high, deep = (np.interp(-share * grip, handle[:, 0], handle[:, i]) for i in (1, 2, 3))
        model.add(metal, bar([(-share * grip + x, low - 1, high + 1, deep + 2) for x in (-1.3, 1.3)], 2.6))


KINDS: tuple[Callable[[Model, Rng], None], ...] = (
    chef, santoku, cleaver, bread, paring, fillet, hunting, dagger, folding, table_knife,
)  # fmt: skip
