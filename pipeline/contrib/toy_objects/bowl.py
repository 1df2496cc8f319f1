"""Bowls (cereal, soup, mixing, footed, for pets), plates, cake moulds, mortars, pans and baskets. Millimetres, standing on z = 0."""

from math import inf

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GLAZES, GOLD, PLASTICS, STEELS, WOODS, Model, Rng, chance, pick
from pipeline.contrib.toy_objects.solids import Material, Rows, ball, bar, bow, column, rod, smooth, sweep, vessel


def dish(model: Model, rng: Rng, rows: Rows, *, wall: float = 4.0, floor: float = 8.0, edge: float = 0.0) -> Material:
    """Add a dish, its inside perhaps of another colour, its outside from the share `edge` of its height too; return the outside's."""
    outside, inside, rim, top = pick(rng, *GLAZES), pick(rng, *GLAZES), pick(rng, *GLAZES, GOLD), rows[-1][0]
    model.add(outside, vessel(rows, wall, floor, inside, [(edge * top, top + 1, rim)] if edge else []))
    return outside


def cereal(model: Model, rng: Rng) -> None:
    """Model a round bowl on a small ring; a spoon in some."""
    rim, high, belly = rng.uniform((62, 45, 0.75), (82, 72, 0.95))
    dish(model, rng, [(0, 0.45 * rim), (5, 0.48 * rim), (0.4 * high, belly * rim), (high, rim)], edge=rng.choice((0.0, 0.8)))
    if chance(rng, 0.35):
        lean = rng.uniform(-0.5, 0.5)
        spoon = sweep([(-0.3 * rim, 0, 14), (0.2 * rim, 0, 0.5 * high), (rim, 0, high + 8), (1.9 * rim, 0, high + 30)], 9, 4)
        model.add(pick(rng, *STEELS, *WOODS), *(solid.turned("z", lean) for solid in (spoon, ball((22, 15, 6)).moved(-0.3 * rim, z=14))))


def soup(model: Model, rng: Rng) -> None:
    """Model a soup plate: shallow, with a broad flat rim."""
    rim, well = rng.uniform((100, 0.55), (125, 0.72))
    dish(
        model, rng, [(0, 0.4 * rim), (3, 0.45 * rim), (28, well * rim), (33, 0.8 * rim), (38, rim)], floor=6.0, edge=rng.choice((0.0, 0.88))
    )


def mixing(model: Model, rng: Rng) -> None:
    """Model a deep bowl with a thick rim and a grip or a spout at its side."""
    rim, high, slope = rng.uniform((85, 80, 0.6), (125, 130, 0.8))
    rows = [
        (0, 0.55 * rim),
        (4, 0.6 * rim),
        (0.5 * high, (0.5 + 0.5 * slope) * rim),
        (high - 12, 0.95 * rim),
        (high - 10, rim),
        (high, rim),
    ]
    outside = dish(model, rng, rows, edge=1 - 11 / high)
    spout = sweep([(0.9 * rim, 0, high - 16), (rim + 4, 0, high - 6), (rim + 18, 0, high)], 34, 8, 2.2)
    grip = sweep([(0.95 * rim, 0, high - 6), (rim + 22, 0, high - 4), (rim + 28, 0, high - 16)], rng.uniform(30, 60), 7)
    model.add(outside, *([spout] if chance(rng, 0.4) else [grip, grip.turned("z", np.pi)]))


def fluted(model: Model, rng: Rng) -> None:
    """Model a solid jelly or cake mould, ripples around it, upside down."""
    rim, high, lobes = *rng.uniform((60, 45), (95, 95)), int(rng.integers(6, 15))
    depth = [0.09, 0.09, 0.08, 0.06, 0.03]
    rows = [(0, rim), (6, rim), (0.55 * high, 0.85 * rim), (0.9 * high, 0.6 * rim), (high, 0.4 * rim)]
    model.add(pick(rng, *GLAZES, *STEELS), column(rows, count=6 * lobes, lobes=lobes, depth=depth))
    model.add(pick(rng, *STEELS, *GLAZES), rod(-4, 1, 1.12 * rim, "z"), rod(high - 2, high + rng.uniform(2, 8), 0.25 * rim, "z"))


def footed(model: Model, rng: Rng) -> None:
    """Model a fruit bowl or ice cup on a stem; fruit in some."""
    rim, stem, deep = rng.uniform((50, 24, 35), (110, 90, 60))
    high = stem + 20 + deep
    rows = [(0, 0.55 * rim), (5, 0.5 * rim), (12, 9), (stem, 8), (stem + 8, 0.4 * rim), (stem + 20 + 0.4 * deep, 0.85 * rim), (high, rim)]
    dish(model, rng, rows, floor=stem + 14, wall=3.5)
    for number in range(int(rng.integers(0, 4))):
        size, angle = rng.uniform(0.25, 0.4) * rim, 2.1 * number
        fruit = ball((size, size, 0.95 * size)).moved(0.4 * rim * np.cos(angle), 0.4 * rim * np.sin(angle), high - 0.3 * size)
        model.add(pick(rng, (200, 50, 40), (230, 150, 40), (120, 160, 60)), fruit)


def pet(model: Model, rng: Rng) -> None:
    """Model a dog's bowl: wider at its foot, on a rubber ring."""
    foot, high, rim = rng.uniform((80, 45, 0.7), (115, 75, 0.85))
    dish(
        model,
        rng,
        [(0, foot), (5, 0.98 * foot), (high - 3, (rim + 0.04) * foot), (high, rim * foot)],
        wall=7.0,
        edge=rng.choice((0.0, 0.5)),
    )
    model.add(pick(rng, BLACK, *PLASTICS), rod(-4, 2, 0.97 * foot, "z"))


def plate(model: Model, rng: Rng) -> None:
    """Model a stack of dinner plates, or a single one."""
    rim, count = rng.uniform(85, 135), int(rng.integers(1, 5))
    for level in range(count):
        z = 11 * level
        rows = [(z, 0.55 * rim), (z + 2, 0.6 * rim), (z + 10, 0.75 * rim), (z + 20, rim)]
        dish(model, rng, rows, floor=z + 6, wall=3.5)


def mortar(model: Model, rng: Rng) -> None:
    """Model a heavy bowl of stone or wood with its pestle leaning in it."""
    rim, high, lean, turn = rng.uniform((48, 70, 0.3, -1.5), (62, 100, 0.6, 1.5))
    stone = pick(rng, (150, 150, 146), (90, 92, 96), *WOODS)
    model.add(stone, vessel([(0, 0.7 * rim), (10, 0.66 * rim), (22, 0.72 * rim), (0.6 * high, rim), (high, rim)], 11.0, 24.0))
    club = column(smooth([(26, 4), (30, 15), (48, 14), (90, 8), (0.9 * high + 90, 9), (0.9 * high + 98, 5)]), count=24)
    model.add(pick(rng, (170, 170, 164), *WOODS), club.turned("x", lean, (0, 0, 30)).turned("z", turn))


def pan(model: Model, rng: Rng) -> None:
    """Model a frying pan, wok or saucepan with one long handle."""
    rim, high, slope, long = rng.uniform((80, 38, 0.72, 120), (120, 95, 0.97, 190))
    metal, z = pick(rng, BLACK, *STEELS, (160, 82, 50)), 0.85 * high
    model.add(metal, vessel([(0, slope * rim - 3), (4, slope * rim), (high, rim)], 3.5, 6.0, pick(rng, BLACK, *STEELS)))
    rise = rng.uniform(0, 40)
    grip = bar(
        [
            (-5, z - 5, z + 5, 18),
            (20, z - 6, z + 5, 14),
            (50, z - 9 + 0.3 * rise, z + 7 + 0.3 * rise, 22),
            (long, z - 8 + rise, z + 7 + rise, 26),
        ]
    )
    model.add(pick(rng, BLACK, *WOODS), grip.moved(rim - 2), rod(-4, 4, 4, "y").moved(rim + 10, z=z))


def basket(model: Model, rng: Rng) -> None:
    """Model a square or oval tray or basket; with a bail over it in some."""
    u, v, high, square = rng.uniform((70, 50, 35, 2.0), (115, 85, 90, 7.0))
    flare = rng.uniform(1.02, 1.25)
    rows = [(0, u - 3, v - 3, square), (4, u, v, square), (high, flare * u, flare * v, square)]
    shade = pick(rng, *WOODS, *PLASTICS)
    model.add(shade, vessel(rows, 5.0, 7.0, pick(rng, *WOODS, *GLAZES), [(0.75 * high, high + 1, pick(rng, *WOODS, *PLASTICS))]))
    if chance(rng, 0.6):
        side, top = flare * u - 2, high + rng.uniform(60, 110)
        arch = bow([(side, high - 15), (0.85 * side, 0.6 * top + 0.4 * high), (0, top)], 13, 7)
        model.add(pick(rng, *WOODS, *PLASTICS), arch)


KINDS = (cereal, soup, mixing, fluted, footed, pet, plate, mortar, pan, basket)
PROPORTIONS = (("xy", -inf, inf, 0.88, 1.12), ("z", -inf, inf, 0.84, 1.2))
