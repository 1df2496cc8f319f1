"""Mugs and cups (plain, tapered, barrel, tea, espresso, enamel, travel), beer steins and jugs.

Millimetres, standing on z = 0, the handle at +x, turned a little towards the front at -y.
"""

from collections.abc import Sequence
from math import inf

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GLAZES, GOLD, PLASTICS, STEELS, WHITE, Model, Rng, chance, pick
from pipeline.contrib.toy_objects.solids import Material, Rows, Solid, ball, column, rod, smooth, sweep, vessel

Bands = Sequence[tuple[float, float, Material]]


def handle(rng: Rng, rows: Rows, low: float, high: float, reach: float, thick: float = 11.0) -> Solid:
    """Bend a handle, round or angular, between two heights of a wall with these rows; turned about z."""
    below, above = np.interp([low, high], *np.array(rows, float).T)
    middle, out = (low + high) / 2, max(below, above) + reach
    curve = [
        (above - 4, high),
        (0.4 * above + 0.6 * out, high + 3),
        (out, middle + 4),
        (0.4 * below + 0.6 * out, low - 2),
        (below - 4, low),
    ]
    corners = [(above - 4, high), (out - 3, high - 1), (out, middle), (out - 5, low + 1), (below - 4, low)]
    path = [(x, 0, z) for x, z in (curve if chance(rng, 0.6) else corners)]
    return sweep(path, rng.uniform(0.9, 1.6) * thick, 0.75 * thick).turned("z", rng.uniform(-0.7, 0.2))


def cup(model: Model, rng: Rng, rows: Rows, reach: float, bands: Bands = (), *, low: float = 0.22, high: float = 0.8) -> Material:
    """Add a cup, its handle between two shares of its height, its inside perhaps of another colour; return the colour of its outside."""
    glaze, inside, top = pick(rng, *GLAZES), pick(rng, WHITE, *GLAZES), rows[-1][0]
    model.add(glaze, vessel(rows, rng.uniform(3.0, 5.0), 7.0, inside, bands))
    model.add(glaze if chance(rng, 0.8) else inside, handle(rng, rows, low * top, high * top, reach))
    return glaze


def plain(model: Model, rng: Rng) -> None:
    """Model a straight office mug, perhaps with a stripe."""
    high, low, wide = rng.uniform((88, 16, 6), (112, 40, 40))
    stripe = [(low, low + wide, pick(rng, *GLAZES, BLACK))] if chance(rng, 0.5) else []
    cup(model, rng, [(0, 37), (3, 40), (high - 2, 40), (high, 39)], rng.uniform(22, 32), stripe)


def tapered(model: Model, rng: Rng) -> None:
    """Model a latte mug, wider at the top, or at the foot; on a rubber ring in some."""
    foot, top, high = rng.uniform((26, 40, 95), (34, 52, 135))
    if chance(rng, 0.25):
        foot, top = top, foot + 4
    cup(model, rng, [(0, foot - 3), (3, foot), (high - 2, top), (high, top - 1)], rng.uniform(20, 32))
    if chance(rng, 0.4):
        model.add(pick(rng, BLACK, *PLASTICS), rod(-4, 3, foot - 1, "z"))


def barrel(model: Model, rng: Rng) -> None:
    """Model a pottery mug with a belly, a foot ring, and a rim dipped in another glaze."""
    belly, rim, high = rng.uniform((41, 33, 80), (52, 41, 105))
    rows = [(0, 0.72 * belly), (4, 0.78 * belly), (0.42 * high, belly), (0.85 * high, rim), (high, rim + rng.uniform(0, 5))]
    dip = (rng.uniform(0.6, 0.85) * high, high + 1, pick(rng, *GLAZES))
    model.add(cup(model, rng, rows, rng.uniform(18, 28), [dip]), rod(-3, 2, 0.6 * belly, "z"))


def tea(model: Model, rng: Rng) -> None:
    """Model a low, wide cup with a fine handle; on a saucer in some."""
    rim, high, wide = rng.uniform((44, 50, 1.35), (54, 66, 1.6))
    cup(model, rng, [(0, 22), (4, 24), (0.35 * high, 0.78 * rim), (0.85 * high, 0.96 * rim), (high, rim)], rng.uniform(14, 22), low=0.35)
    if chance(rng, 0.6):
        plate = np.multiply([(1, 0.45), (1, 0.5), (1, 0.85), (1, 1)], [1, wide * rim])
        plate[:, 0] = -9, -7, -1, 5
        model.add(pick(rng, *GLAZES), vessel(plate, 4.0, 1.0))


def espresso(model: Model, rng: Rng) -> None:
    """Model a small thick cup with a looped handle and a rim of gold or another colour."""
    rim, high = rng.uniform((27, 52), (33, 64))
    edge = (high - rng.uniform(3, 9), high + 1, pick(rng, GOLD, BLACK, *GLAZES))
    cup(model, rng, [(0, 19), (3, 21), (0.5 * high, 0.94 * rim), (high, rim)], rng.uniform(14, 22), [edge], low=0.35, high=0.85)


def enamel(model: Model, rng: Rng) -> None:
    """Model a camping mug of thin metal: straight wall, rolled rim of another colour."""
    (radius, high), coat = rng.uniform((38, 70), (47, 92)), pick(rng, WHITE, *PLASTICS, (36, 62, 110))
    rows = [(0, radius - 4), (4, radius), (high - 4, radius), (high - 2, radius + 2), (high, radius + 2)]
    rim = (high - 4, high + 1, pick(rng, BLACK, (36, 62, 110), *STEELS))
    model.add(coat, vessel(rows, 3.0, 5.0, pick(rng, WHITE), [rim]), handle(rng, rows, 0.2 * high, 0.82 * high, 30, 8))


def travel(model: Model, rng: Rng) -> None:
    """Model an insulated beaker with a grip and a lid; with a handle in some."""
    foot, top, high = rng.uniform((28, 38, 150), (34, 44, 205))
    rows, z = [(0, foot - 2), (4, foot), (0.45 * high, rng.uniform(foot, top)), (0.6 * high, top), (high, top)], 0.6 * high
    model.add(pick(rng, *STEELS, *PLASTICS, BLACK), column(smooth(rows), count=36))
    model.add(grip := pick(rng, BLACK, *PLASTICS), rod(z, z + rng.uniform(15, 40), top + 0.8, "z"))
    lid = column(smooth([(high - 4, top + 2), (high + 8, top + 2), (high + 13, top - 5), (high + 16, top - 9)]))
    model.add(pick(rng, BLACK, *PLASTICS), lid, ball((9, 5, 5)).moved(y=14 - top, z=high + 16))
    if chance(rng, 0.5):
        model.add(grip, handle(rng, rows, 0.35 * high, 0.85 * high, 32))


def stein(model: Model, rng: Rng) -> None:
    """Model a tall beer mug with a heavy handle and rings around it; a lid on some."""
    (radius, high), rings = rng.uniform((42, 130), (52, 190)), int(rng.integers(2, 6))
    glass, waves = pick(rng, (226, 190, 96), (190, 206, 208), (176, 170, 156)), np.linspace(0.1, 0.85, 2 * rings + 1) * high
    rows = [(0, radius + 3), (6, radius + 3), *zip(waves, radius + np.resize([0, 4], len(waves)), strict=True), (high, radius)]
    foam = pick(rng, WHITE, (238, 210, 130), *GLAZES)
    model.add(glass, vessel(rows, 6.0, 12.0, foam, [(0, 8, foam)]), handle(rng, rows, 0.2 * high, 0.86 * high, 38, 18))
    if chance(rng, 0.4):
        dome = [(high - 2, radius + 1), (high + 8, radius), (high + 20, 0.5 * radius), (high + 26, 6), (high + 38, 7), (high + 40, 4)]
        model.add(pick(rng, *STEELS), column(smooth(dome)))


def jug(model: Model, rng: Rng) -> None:
    """Model a pitcher: belly, narrow neck, wide handle, a lip to pour from."""
    belly, neck, high = rng.uniform((55, 30, 150), (72, 44, 230))
    rows = [(0, 0.66 * belly), (5, 0.72 * belly), (0.35 * high, belly), (0.75 * high, neck), (high, neck + rng.uniform(3, 12))]
    stripe = (0.3 * high, rng.uniform(0.33, 0.45) * high, pick(rng, *GLAZES, BLACK))
    glaze = cup(model, rng, rows, rng.uniform(24, 38), [stripe] if chance(rng, 0.5) else [], low=0.4, high=0.92)
    model.add(glaze, sweep([(-neck + 2, 0, high - 22), (-neck - 8, 0, high - 8), (-neck - 20, 0, high + 1)], 30, 9, 2.2))


KINDS = (plain, tapered, barrel, tea, espresso, enamel, travel, stein, jug)
PROPORTIONS = (("xy", -inf, inf, 0.86, 1.16), ("z", -inf, inf, 0.86, 1.14))
