"""Boxes: carton, milk, shoes, tools, matches, book, toy brick, present, tissues, crate, camera.

Millimetres, standing on z = 0, the front faces -y.
"""

from collections.abc import Sequence
from math import inf

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, RED, STEELS, WHITE, WOODS, Model, Palette, Rng, chance, pick
from pipeline.contrib.toy_objects.pictures import label
from pipeline.contrib.toy_objects.solids import Array, Solid, ball, block, bow, box, column, rod, sweep, vessel

CARDBOARD: Palette = ((176, 136, 92), (198, 160, 112), (226, 222, 210), *PLASTICS)


def standing(rng: Rng, size: Sequence[float] | Array, exponent: float = 14.0, bevel: float = 1.0, *, printed: bool = True) -> Solid:
    """Make a box that stands on z = 0, with sides (x, y, z); a label covers its front if it is printed."""
    solid = box(size, exponent, bevel, "z", 40).moved(z=size[2] / 2)
    if not printed:
        return solid
    uv = solid.vertices[:, [0, 2]] / [size[0], size[2]] + [0.5, 0.0]
    front = solid.vertices[solid.faces, 1].max(axis=1) < -0.46 * size[1]
    return solid.painted(label(rng, size[0] / size[2]), front, uv)


def carton(model: Model, rng: Rng) -> None:
    """Model an upright packet of cereals, tea or medicine; a flap open in some."""
    size = rng.uniform((60, 25, 90), (190, 75, 280))
    model.add(pick(rng, *CARDBOARD), standing(rng, size))
    flap = box((0.9 * size[0], 2.4, rng.uniform(0.3, 0.7) * size[1]), 9, 0.6).moved(z=0.2 * size[1])
    if chance(rng, 0.5):
        model.add(pick(rng, *CARDBOARD), flap.turned("x", rng.uniform(-1.2, 1.2)).moved(y=0.44 * size[1], z=size[2]))
    else:
        model.add(pick(rng, *CARDBOARD), box((0.5 * size[0], 0.4 * size[1], 2.0), 9, 0.5, "z").moved(z=size[2]))


def milk(model: Model, rng: Rng) -> None:
    """Model a drink carton with a screw cap: a gable with a fold on top, or flat."""
    side, high, deep = rng.uniform((32, 95, 0.7), (48, 200, 1.0))
    model.add(pick(rng, WHITE, *PLASTICS), standing(rng, (2 * side, 2 * deep * side, high)))
    if chance(rng, 0.6):
        top = high + rng.uniform(0.6, 0.9) * side
        roof = [(high - 1, side, deep * side, 14), (top, side, 3, 8), (top + 14, side, 2.5, 8)]
        model.add(pick(rng, WHITE, *PLASTICS), column(roof, count=40))
    model.add(pick(rng, WHITE, *PLASTICS), rod(-7, 7, 12, "z").turned("x", 0.6).moved(y=-0.45 * deep * side, z=high + 0.3 * side))


def shoe_box(model: Model, rng: Rng) -> None:
    """Model a box with a lid over it, which is askew in some."""
    size = rng.uniform((140, 90, 60), (320, 200, 130))
    lid = box((size[0] + 6, size[1] + 6, 0.28 * size[2]), 16, 1.5, "z", 40).moved(z=size[2])
    model.add(pick(rng, *CARDBOARD), standing(rng, size))
    model.add(pick(rng, *CARDBOARD), lid.turned("z", rng.uniform(-0.3, 0.3)) if chance(rng, 0.3) else lid)


def toolbox(model: Model, rng: Rng) -> None:
    """Model a case with a handle and two latches in front."""
    size, metal = rng.uniform((160, 80, 80), (300, 150, 160)), pick(rng, *STEELS, BLACK, GOLD)
    top, reach = size[2], 0.28 * size[0]
    model.add(pick(rng, *PLASTICS, *WOODS, BLACK), standing(rng, size, rng.uniform(5, 12), 5.0, printed=False))
    model.add(metal, box((size[0] + 1.5, size[1] + 1.5, 5), 12, 1.0, "z").moved(z=0.62 * top))
    model.add(pick(rng, BLACK, *STEELS), bow([(reach, top - 4), (0.9 * reach, top + 26)], 18, 10))
    model.add(metal, *(box((16, 6, 30), 6, 1.5).moved(x * size[0], -size[1] / 2 - 1, 0.62 * top) for x in (-0.3, 0.3)))


def matches(model: Model, rng: Rng) -> None:
    """Model a match or pill box lying flat, its drawer pulled out."""
    x, y, z = rng.uniform((40, 60, 14), (70, 110, 32))
    pulled = rng.uniform(0.1, 0.7) * y
    model.add(pick(rng, *CARDBOARD), standing(rng, (x, y, z)))
    model.add(
        pick(rng, *WOODS, WHITE), vessel([(1, x / 2 - 3, y / 2 - 2, 14), (z - 2, x / 2 - 3, y / 2 - 2, 14)], 2.5, 4.0).moved(y=-pulled)
    )
    for number in range(int(rng.integers(1, 7))):
        model.add(pick(rng, RED, BLACK), rod(-0.4 * y, 0.4 * y, 1.8, "y").moved((number - 3) * 0.11 * x, -pulled, z / 2))


def book(model: Model, rng: Rng) -> None:
    """Model books, one or a stack: covers, pages, a rounded spine."""
    z = 0.0
    for _ in range(int(rng.integers(1, 4))):
        wide, long, thick = rng.uniform((100, 140, 14), (170, 240, 42))
        turn, cover = rng.uniform(-0.35, 0.35) * (z > 0), pick(rng, *PLASTICS, *WOODS, BLACK)
        slabs = [box((wide, long, 3), 14, 0.8, "z").moved(z=z + at) for at in (1.5, thick - 1.5)]
        pages = box((wide - 8, long - 8, thick - 3), 14, 0.8, "z").moved(-2, z=z + thick / 2)
        spine = (
            column([(-long / 2, 4, thick / 2, 4), (long / 2, 4, thick / 2, 4)], "y", 24)
            .turned("y", np.pi / 2)
            .moved(-wide / 2, z=z + thick / 2)
        )
        model.add(cover, *(solid.turned("z", turn) for solid in (*slabs, spine)))
        model.add(pick(rng, (236, 230, 214)), pages.turned("z", turn))
        z += thick - 0.4


def brick(model: Model, rng: Rng) -> None:
    """Model a toy brick with round studs, or a stack of two or three."""
    across, deep, levels = (int(rng.integers(low, high)) for low, high in ((2, 6), (1, 4), (1, 4)))
    for level in range(levels):
        shade, shift = pick(rng, *PLASTICS, RED), 16 * int(rng.integers(-1, 2)) * (level > 0)
        solid = box((16 * across, 16 * deep, 19.2), 24, 0.8, "z").moved(shift, z=19.2 * level + 9.6)
        studs = [(16 * (i - (across - 1) / 2) + shift, 16 * (j - (deep - 1) / 2)) for i in range(across) for j in range(deep)]
        model.add(shade, solid, *(rod(0, 4, 4.8, "z").moved(x, y, 19.2 * (level + 1) - 0.4) for x, y in studs))
    model.add(pick(rng, *PLASTICS), box((15 * across, 15 * deep, 2), 24, 0.5, "z"))


def present(model: Model, rng: Rng) -> None:
    """Model a gift box with a ribbon both ways and a bow."""
    size, ribbon = rng.uniform((70, 60, 40), (160, 150, 150)), pick(rng, *PLASTICS, RED, GOLD)
    x, y, z = size
    model.add(pick(rng, *CARDBOARD), standing(rng, size, printed=False))
    wide = rng.uniform(0.1, 0.2) * min(x, y)
    model.add(ribbon, box((wide, y + 2, z + 2), 14, 0.8, "z").moved(z=z / 2), box((x + 2, wide, z + 2), 14, 0.8, "z").moved(z=z / 2))
    loop = [(0, 0, z), (18, 0, z + 22), (38, 0, z + 20), (42, 0, z + 6), (16, 0, z + 2)]
    angle = rng.uniform(-0.7, 0.7)
    model.add(ribbon, *(sweep(loop, wide, 4).turned("z", angle + turn) for turn in (0, np.pi)), ball((7, 7, 6)).moved(z=z + 3))


def tissues(model: Model, rng: Rng) -> None:
    """Model a box of tissues, cubic or flat, a tissue sticking out."""
    size = rng.uniform((100, 90, 50), (240, 125, 130))
    model.add(pick(rng, *CARDBOARD), standing(rng, size))
    low, peak = size[2] - 2, size[2] + rng.uniform(40, 75)
    model.add(pick(rng, BLACK), column([(low, 0.3 * size[0], 0.2 * size[1], 2.0), (low + 3, 0.3 * size[0], 0.2 * size[1], 2.0)]))
    tissue = [(low, 0.22 * size[0], 6, 2.0), (0.4 * low + 0.6 * peak, 0.12 * size[0], 10, 2.0), (peak, 0.16 * size[0], 3, 2.0)]
    model.add(pick(rng, WHITE), column(tissue, count=48, lobes=8, depth=[0.05, 0.25, 0.3]).turned("z", rng.uniform(-0.5, 0.5)))


def crate(model: Model, rng: Rng) -> None:
    """Model an open crate of slats, or a plastic basket; something in it."""
    x, y, z = rng.uniform((110, 90, 60), (220, 150, 130))
    shade, rows = pick(rng, *WOODS, *PLASTICS), int(rng.integers(2, 4))
    model.add(shade, box((x, y, 8), 14, 1.0, "z").moved(z=4))
    for at in np.linspace(0.25, 1, rows) * z:
        tall = 0.55 * z / rows
        long = [box((x, 6, tall), 14, 1.0).moved(y=s * (y / 2 - 3), z=at - tall / 2) for s in (-1, 1)]
        model.add(shade, *long, *(box((6, y, tall), 14, 1.0, "x").moved(s * (x / 2 - 3), z=at - tall / 2) for s in (-1, 1)))
    posts = [box((10, 10, z), 8, 1.0, "z").moved(s * (x / 2 - 8), t * (y / 2 - 8), z / 2) for s in (-1, 1) for t in (-1, 1)]
    model.add(pick(rng, *WOODS, *STEELS), *posts)
    for number in range(int(rng.integers(0, 4))):
        r = rng.uniform(0.2, 0.3) * min(x, y)
        model.add(
            pick(rng, RED, (230, 150, 40), (120, 160, 60)), ball((r, r, r)).moved((number - 1) * 0.28 * x, 0.1 * y * (-1) ** number, 7 + r)
        )


def camera(model: Model, rng: Rng) -> None:
    """Model a camera or radio: body, lens, knobs on top."""
    x, y, z = rng.uniform((95, 34, 58), (150, 60, 95))
    body, lens = pick(rng, BLACK, *STEELS, *PLASTICS), rng.uniform(0.3, 0.42) * z
    model.add(body, standing(rng, (x, y, z), rng.uniform(5, 10), 3.0), block((-0.2 * x, 0.2 * x), (z - 4, z + rng.uniform(8, 22)), 0.6 * y))
    out = y / 2 + rng.uniform(12, 55)
    rings = column(
        [(-out, 0.9 * lens), (-out + 5, lens), (-0.5 * (out + y / 2), lens), (2 - 0.5 * (out + y / 2), 1.1 * lens), (0, 1.1 * lens)],
        "y",
        36,
    )
    model.add(pick(rng, BLACK, *STEELS), rings.moved(rng.uniform(-0.1, 0.2) * x, z=0.48 * z))
    model.add(pick(rng, *STEELS), *(rod(z - 1, z + rng.uniform(4, 11), 8, "z").moved(at * x) for at in (-0.38, 0.3, 0.42)))


KINDS = (carton, milk, shoe_box, toolbox, matches, book, brick, present, tissues, crate, camera)
PROPORTIONS = (("x", -inf, inf, 0.88, 1.14), ("y", -inf, inf, 0.88, 1.14), ("z", -inf, inf, 0.86, 1.16))
