"""Cans and jars: drinks, food, fish, spray, paint, jar, tea caddy, battery, candle, watering can. Millimetres, standing on z = 0."""

from collections.abc import Sequence
from math import inf

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, RED, STEELS, WHITE, Model, Rng, chance, pick
from pipeline.contrib.toy_objects.pictures import label
from pipeline.contrib.toy_objects.solids import Rows, Solid, ball, bow, box, column, rod, smooth, sweep, vessel

TINS = (*STEELS, GOLD, (228, 226, 218))


def labelled(rng: Rng, rows: Rows, low: float, high: float, size: Sequence[float]) -> Solid:
    """Loft a can around z, with a label all around between two heights; `size` is its half width, half depth, and exponent there."""
    count, (u, v, square) = 48, size
    table = np.array(rows, float)
    solid = column(np.column_stack([table[:, 0], u * table[:, 1], v * table[:, 1], np.full(len(table), square)]), count=count)
    z = solid.vertices[:, 2]
    inside = (z > low - 1e-6) & (z < high + 1e-6)
    column_of = np.arange(len(z)) % count
    uv = np.column_stack([column_of / (count - 1), (z - low) / (high - low)]) * inside[:, None]
    is_seam = np.ptp(column_of[solid.faces], axis=1) > 1  # where the label's ends meet: all of it would be there once more, mirrored
    return solid.painted(label(rng, np.pi * (u + v) / (high - low)), np.all(inside[solid.faces], axis=1) & ~is_seam, uv)


def drink(model: Model, rng: Rng) -> None:
    """Model a drinks can: necks at both ends, a tab on its lid; a straw in some."""
    r, high = rng.uniform((26, 115), (34, 170))
    rows = [(0, 0.78), (3, 0.82), (9, 1), (12, 1), (high - 20, 1), (high - 10, 0.93), (high - 3, 0.83), (high, 0.83), (high, 0.78)]
    rows[-1] = (high + 0.8, 0.78)
    model.add(pick(rng, *STEELS, *PLASTICS), labelled(rng, rows, 12, high - 20, (r, r, 2.0)))
    model.add(pick(rng, *STEELS), box((12, 20, 1.8), 3, 0.5, "z", 20).moved(y=-4, z=high + 1.2))
    if chance(rng, 0.3):
        model.add(pick(rng, *PLASTICS), rod(-10, rng.uniform(30, 60), 3, "z").turned("y", rng.uniform(-0.4, 0.4)).moved(y=4, z=high))


def food(model: Model, rng: Rng) -> None:
    """Model a food tin: rims, ribs or a label; half open in some."""
    r, high, ribs = *rng.uniform((32, 48), (54, 125)), int(rng.integers(0, 7))
    waves = np.linspace(0.2, 0.8, 2 * ribs + 2) * high
    depth = np.resize([1.0, 0.97], len(waves)) if ribs else np.ones(2)
    ends = [(0, 1.02), (3, 1.02), (4, 1)], [(high - 4, 1), (high - 3, 1.02), (high, 1.02)]
    rows = [*ends[0], *zip(waves, depth, strict=True), *ends[1]]
    model.add(pick(rng, *TINS), labelled(rng, rows, waves[0], waves[-1], (r, r, 2.0)))
    if chance(rng, 0.3):
        lid = rod(-1.2, 1.2, 0.98 * r, "z").turned("y", rng.uniform(0.6, 1.3), (-r, 0, 0)).moved(z=high)
        model.add(pick(rng, *TINS), lid)
    else:
        model.add(pick(rng, *TINS), box((10, 22, 2.4), 2.4, 0.8, "z", 20).moved(y=-0.5 * r, z=high))


def fish(model: Model, rng: Rng) -> None:
    """Model a flat tin of sardines or shoe polish, oval, square or round, with a ring to pull."""
    u, v, high, square = rng.uniform((42, 30, 20, 2.0), (58, 44, 34, 6.0))
    rows = [(0, 1.02), (2.5, 1.02), (3.5, 1), (high - 4, 1), (high - 3, 1.02), (high, 1.02)]
    model.add(pick(rng, *TINS), labelled(rng, rows, 3.5, high - 4, (u, v, square)))
    ring = vessel([(0, 11), (3, 11)], 3.0, 1.0).moved(0.45 * u, z=high - 1)
    model.add(pick(rng, *TINS, *PLASTICS), ring, box((0.9 * u, 0.8 * v, 2), square, 0.6, "z").moved(-0.4 * u, z=high))


def spray(model: Model, rng: Rng) -> None:
    """Model an aerosol: domed shoulder under a cap or a nozzle."""
    r, high = rng.uniform((20, 120), (33, 190))
    rows = [(0, 0.95), (3, 1.03), (6, 1), (high - 6, 1), (high, 0.97), (high + 6, 0.8), (high + 12, 0.45)]
    model.add(pick(rng, *TINS), labelled(rng, rows, 6, high - 6, (r, r, 2.0)))
    cap = column(smooth([(high - 1, 1.0 * r), (high + 30, 0.97 * r), (high + 40, 0.9 * r), (high + 44, 0.6 * r)]))
    nozzle = [rod(high + 8, high + 22, 7, "z"), rod(-2, 9, 3, "x").moved(z=high + 18)]
    model.add(pick(rng, *PLASTICS, BLACK, WHITE), *([cap] if chance(rng, 0.5) else nozzle))


def paint(model: Model, rng: Rng) -> None:
    """Model a paint pot or bucket: lid with a rim, a wire bail."""
    r, high, drop = rng.uniform((48, 90, -0.8), (80, 170, 0.8))
    rows = [(0, 0.98), (4, 1), (0.1 * high, 1), (0.9 * high, 1), (high - 6, 1.03), (high, 1.03)]
    model.add(pick(rng, *TINS, WHITE), labelled(rng, rows, 0.1 * high, 0.9 * high, (r, r, 2.0)))
    model.add(pick(rng, *TINS, *PLASTICS), column([(high - 1, 0.9 * r), (high + 3, 0.88 * r), (high + 3.5, 0.7 * r)], count=40))
    arch = bow([(r + 3, 0.8 * high), (0.8 * r, high + 0.4 * r), (0, high + 0.8 * r)], 4, 4)
    bail = arch.turned("x", drop, (0, 0, 0.8 * high))
    model.add(pick(rng, *STEELS, BLACK), bail, rod(-r - 5, r + 5, 5, "x").moved(z=0.8 * high))


def jar(model: Model, rng: Rng) -> None:
    """Model a preserving jar: shoulder, wide lid; round or square."""
    r, high, neck, square = rng.uniform((28, 62, 0.72, 2.0), (48, 130, 0.92, 6.0))
    rows = [(0, 0.92), (5, 1), (0.15 * high, 1), (0.75 * high, 1), (0.88 * high, neck), (high, neck)]
    glass = pick(rng, (150, 60, 40), (196, 206, 206), (214, 160, 70), (90, 60, 40), (120, 150, 90))
    model.add(glass, labelled(rng, rows, 0.15 * high, 0.75 * high, (r, r, 2.0 if chance(rng, 0.6) else square)))
    lid = [(0.9 * high, 1.1 * neck * r), (high + 3, 1.1 * neck * r), (high + 5, neck * r)]
    model.add(pick(rng, *TINS, RED, *PLASTICS), column(lid, count=60, lobes=20, depth=[0.015, 0.015, 0.0]))


def caddy(model: Model, rng: Rng) -> None:
    """Model a tea or biscuit tin, square or round, its lid slipped over; a knob on some."""
    u, v, high, square = rng.uniform((35, 30, 60, 2.0), (75, 65, 150, 9.0))
    rows = [(0, 0.97), (3, 1), (0.08 * high, 1), (0.85 * high, 1), (high, 1)]
    model.add(pick(rng, *TINS, *PLASTICS), labelled(rng, rows, 0.08 * high, 0.85 * high, (u, v, square)))
    lid = [
        (0.9 * high, u + 2, v + 2, square),
        (high + 4, u + 2, v + 2, square),
        (high + 7, u - 1, v - 1, square),
        (high + 8, 0.6 * u, 0.6 * v, square),
    ]
    model.add(pick(rng, *TINS, *PLASTICS, BLACK), column(lid, count=48))
    if chance(rng, 0.4):
        model.add(pick(rng, GOLD, *STEELS, BLACK), rod(high + 6, high + 14, 4, "z"), ball((8, 8, 7)).moved(z=high + 18))


def battery(model: Model, rng: Rng) -> None:
    """Model a round cell with its pole, alone or up to four in a row."""
    r, high, count = *rng.uniform((13, 62), (24, 110)), int(rng.integers(1, 5))
    for number in range(count):
        rows = [(0, 0.94), (2, 1), (0.06 * high, 1), (0.94 * high, 1), (high - 2, 1), (high, 0.94)]
        x = 2 * r * (number - (count - 1) / 2)
        model.add(pick(rng, GOLD, BLACK, *PLASTICS), labelled(rng, rows, 0.06 * high, 0.94 * high, (r, r, 2.0)).moved(x))
        model.add(pick(rng, *STEELS), rod(high - 1, high + 4, 0.34 * r, "z").moved(x))


def candle(model: Model, rng: Rng) -> None:
    """Model a candle in a glass, or one to three pillars of wax on a dish."""
    r, high, level = rng.uniform((26, 50, 0.6), (48, 130, 0.9))
    wax, wick = pick(rng, *PLASTICS, (238, 226, 196), WHITE), rod(-2, 12, 1.6, "z").turned("x", 0.2)
    if chance(rng, 0.4):
        model.add(pick(rng, (200, 210, 210), (120, 60, 30)), vessel([(0, 0.96 * r), (3, r), (high, r)], 3.0, level * high, wax))
        model.add(pick(rng, BLACK), wick.moved(z=level * high))
        return
    for number in range(count := int(rng.integers(1, 4))):
        x, top = 1.9 * r * (number - (count - 1) / 2), high * rng.uniform(0.6, 1.0)
        rows = [(0, 0.96), (3, 1), (0.12 * top, 1), (0.8 * top, 1), (top, 0.94)]
        model.add(wax, labelled(rng, rows, 0.12 * top, 0.8 * top, (r, r, 2.0)).moved(x))
        model.add(pick(rng, BLACK), wick.moved(x, z=top))
    model.add(pick(rng, *TINS, *PLASTICS), column([(-4, count * r, r, 2.4), (3, (count + 0.3) * r, 1.3 * r, 2.4)], count=48))


def watering(model: Model, rng: Rng) -> None:
    """Model a watering or oil can: round body, long spout, handle behind and above."""
    r, high, out, rise = rng.uniform((50, 90, 60, 0.9), (75, 140, 130, 1.5))
    shade = pick(rng, *PLASTICS, *STEELS)
    rows = [(0, r), (4, r), (0.85 * high, 0.96 * r), (high, rng.uniform(0.5, 0.9) * r)]
    model.add(shade, vessel(rows, 4.0, 0.8 * high, pick(rng, BLACK, shade.color)))
    path = [(0.9 * r, 0, 0.25 * high), (r + 0.5 * out, 0, 0.55 * rise * high), (r + out, 0, rise * high)]
    model.add(shade, sweep(path, 16, 16, 2.0))
    model.add(
        pick(rng, *PLASTICS, *STEELS),
        column([(0, 8), (18, rng.uniform(9, 26))], "x", 20).turned("y", -0.6).moved(r + out - 4, z=rise * high - 2),
    )
    arch = [(0.4 * r, 0, high - 6), (0, 0, 1.45 * high), (-0.9 * r, 0, 1.3 * high), (-1.25 * r, 0, 0.8 * high), (-0.92 * r, 0, 0.4 * high)]
    model.add(shade, sweep(arch, 15, 9))


KINDS = (drink, drink, food, fish, spray, paint, jar, caddy, battery, candle, watering)
PROPORTIONS = (("xy", -inf, inf, 0.86, 1.16), ("z", -inf, inf, 0.86, 1.16))
