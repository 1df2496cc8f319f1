"""Screwdrivers (common, stubby, precision, T-handled) and other tools with a shank: awl, chisel, file, gimlet, spanner, trowel.

Millimetres, along x with the tip at +x; the shank begins at x = 0.
"""

from math import inf

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, RED, STEELS, WOODS, Model, Rng, chance, pick
from pipeline.contrib.toy_objects.solids import Solid, ball, bar, coil, column, rod, smooth, sweep


def grip(model: Model, rng: Rng, length: float, radius: float) -> None:
    """Add a handle from x = -length to 0: fluted plastic with a cap and a collar, or turned, with a ferrule."""
    trim, lobes = pick(rng, *PLASTICS, BLACK, *STEELS, GOLD), int(rng.integers(5, 9))
    fluted = [
        (-length, 0.7 * radius),
        (-0.96 * length, 0.95 * radius),
        (-0.8 * length, radius),
        (-0.3 * length, radius),
        (-0.18 * length, 0.7 * radius),
        (0, 0.55 * radius),
    ]
    turned = [
        (-length, 0.6 * radius),
        (-0.93 * length, radius),
        (-0.6 * length, 1.15 * radius),
        (-0.25 * length, 0.75 * radius),
        (0, 0.6 * radius),
    ]
    if chance(rng, 0.6):
        depth = np.array([0.0, 0.06, 0.09, 0.09, 0.0, 0.0]) * rng.uniform(0.5, 1.0)
        model.add(pick(rng, *PLASTICS, RED), column(fluted, "x", 6 * lobes, lobes=lobes, depth=depth))
        model.add(trim, rod(-length - rng.uniform(0, 6), -0.9 * length, 0.66 * radius), rod(-0.2 * length, 2, 0.62 * radius))
    else:
        model.add(pick(rng, *WOODS, BLACK, *PLASTICS), column(smooth(turned), "x", 30))
        model.add(trim, rod(-0.12 * length, 4, 0.68 * radius))


def shank(length: float, radius: float, tip: str) -> list[Solid]:
    """Make a round bar and its tip: slotted, crossed, or pointed."""
    x = length
    if tip == "slotted":
        end = column(
            [(x - 1, radius, radius, 2), (x + 12, 0.45 * radius, 1.5 * radius, 4), (x + 18, 0.3 * radius, 1.4 * radius, 6)], "x", 24
        )
    elif tip == "crossed":
        profile = [(x - 1, radius), (x + 6, 0.7 * radius), (x + 10, 0.25 * radius)]
        return [rod(-2, x, radius), column(profile, "x", 32, lobes=4, depth=[0.0, 0.3, 0.2])]
    else:
        end = column([(x - 1, radius), (x + 14, 0.45 * radius), (x + 24, 0.12 * radius)], "x", 24)
    return [rod(-2, x, radius), end]


def slotted(model: Model, rng: Rng) -> None:
    """Model a screwdriver with a flat or a crossed tip, long or short."""
    grip(model, rng, rng.uniform(85, 115), rng.uniform(13, 18))
    model.add(pick(rng, *STEELS), *shank(rng.uniform(70, 190), rng.uniform(2.8, 5.0), "slotted" if chance(rng, 0.5) else "crossed"))


def stubby(model: Model, rng: Rng) -> None:
    """Model a screwdriver with a short thick handle and a short shank."""
    grip(model, rng, rng.uniform(52, 66), rng.uniform(16, 21))
    model.add(pick(rng, *STEELS), *shank(rng.uniform(20, 38), rng.uniform(3.5, 5.0), "crossed" if chance(rng, 0.5) else "slotted"))


def precision(model: Model, rng: Rng) -> None:
    """Model a watchmaker's screwdriver: a slim rod with knurls and a turning cap."""
    radius, length = rng.uniform((4.5, 80), (6.5, 110))
    rings = np.linspace(-0.9, -0.1, 2 * int(rng.integers(6, 12))) * length
    rows = [(-length, 0.9 * radius), *zip(rings, np.resize([radius, 0.86 * radius], len(rings)), strict=True), (0, 0.5 * radius)]
    model.add(pick(rng, *STEELS, *PLASTICS, GOLD), column(rows, "x", 28))
    model.add(pick(rng, *PLASTICS, *STEELS, BLACK), rod(-length - 9, -length + 1, 1.3 * radius))
    model.add(pick(rng, *STEELS), *shank(rng.uniform(30, 60), 1.9, "slotted"))


def t_handle(model: Model, rng: Rng) -> None:
    """Model a hexagon key or nut driver with a bar across its end."""
    half, radius, length, socket = rng.uniform((38, 9, 120, 7), (60, 14, 210, 14))
    cross = [(-half, 0.8 * radius), (6 - half, radius), (0, 1.15 * radius), (half - 6, radius), (half, 0.8 * radius)]
    model.add(pick(rng, *PLASTICS, BLACK, RED), column(smooth(cross), "z", 28), rod(-radius, 22, 0.9 * radius))
    end = rod(length - 24, length, socket) if chance(rng, 0.5) else rod(length - 2, length + 4, 3.4)
    model.add(pick(rng, *STEELS), rod(0, length, 4.5), end)


def awl(model: Model, rng: Rng) -> None:
    """Model an awl or ice pick: pear-shaped handle, a point."""
    pear, steel = rng.uniform(17, 24), pick(rng, *STEELS)
    rows = [(-78, 0.5 * pear), (-72, 0.9 * pear), (-56, pear), (-26, 0.6 * pear), (0, 0.4 * pear)]
    model.add(pick(rng, *WOODS, *PLASTICS), column(smooth(rows), "x", 32))
    model.add(steel, *shank(rng.uniform(45, 110), rng.uniform(2.4, 4.0), "pointed"), rod(-8, 6, 0.46 * pear))


def chisel(model: Model, rng: Rng) -> None:
    """Model a wood chisel or putty knife: flat blade, bevelled at its end."""
    grip(model, rng, rng.uniform(100, 135), rng.uniform(13, 17))
    long, wide, broad = rng.uniform((95, 6, 1.0), (150, 18, 2.4))
    rows = [(-4, 4, 4, 3), (14, 4, 4, 3), (24, 3, wide, 8), (long - 14, 2.2, broad * wide, 10), (long, 0.5, broad * wide, 10)]
    model.add(pick(rng, *STEELS), column(smooth(rows), "x", 28))


def file(model: Model, rng: Rng) -> None:
    """Model a file or rasp, flat to nearly round, on a handle."""
    grip(model, rng, rng.uniform(95, 125), rng.uniform(13, 17))
    long, u, v, square = rng.uniform((150, 3, 8, 2.0), (230, 9, 16, 9.0))
    table = [(-3, 3, 4, 3), (14, 0.9 * u, 0.9 * v, square), (0.6 * long, u, v, square), (long, 0.6 * u, rng.uniform(0.3, 0.9) * v, square)]
    model.add(pick(rng, *STEELS, (70, 74, 80)), column(smooth(table, 10), "x", 32))


def gimlet(model: Model, rng: Rng) -> None:
    """Model a gimlet or corkscrew: a cross handle and a screw."""
    half, turns, thread, long = rng.uniform((34, 3.5, 3.0, 70), (52, 7.0, 6.5, 130))
    cross = [(-half, 7), (6 - half, 9), (0, 12), (half - 6, 9), (half, 7)]
    model.add(pick(rng, *WOODS, *PLASTICS), column(smooth(cross), "z", 26))
    screw = [(6, 0.3, 2.4), *((6 + share * long, thread, 2.4) for share in (0.2, 0.4, 0.6, 0.8)), (6 + long, 0.3 * thread, 0.8)]
    model.add(pick(rng, *STEELS), coil(screw, turns, "x"), rod(-4, 14, 4))


def spanner(model: Model, rng: Rng) -> None:
    """Model a spanner: jaws at one end or both, a thicker end opposite."""
    length, size, thick = rng.uniform((110, 11, 7), (200, 19, 11))
    metal = pick(rng, *STEELS, (70, 74, 80))
    waist = [
        (-0.5 * length, -0.55 * size, 0.55 * size, thick),
        (0, -0.4 * size, 0.4 * size, 0.7 * thick),
        (0.5 * length, -0.55 * size, 0.55 * size, thick),
    ]
    model.add(metal, bar(waist, 3.0, pick(rng, BLACK, *PLASTICS), [(-0.1 * length, 0.1 * length)]))
    for end in (-1, 1) if chance(rng, 0.5) else (1,):
        x, lean = 0.5 * length, rng.uniform(-0.3, 0.3)
        jaws = [[(x - 4, 0, 0.3 * s * size), (x + 0.5 * size, 0, 1.05 * s * size), (x + 1.9 * size, 0, 0.75 * s * size)] for s in (-1, 1)]
        model.add(
            metal, *(sweep(jaw, thick, 0.75 * size).turned("y", lean, (x, 0, 0)).turned("y", 0.0 if end > 0 else np.pi) for jaw in jaws)
        )
    model.add(metal, ball((1.3 * size, 0.5 * thick, 1.1 * size)).moved(-0.5 * length))


def trowel(model: Model, rng: Rng) -> None:
    """Model a trowel, spatula or palette knife: a cranked neck and a broad leaf."""
    grip(model, rng, rng.uniform(90, 120), rng.uniform(12, 17))
    long, wide, drop, nose = rng.uniform((80, 22, -36, 0.1), (150, 48, -6, 0.9))
    leaf = [(50, 1.6, 8, 4), (64, 1.6, wide, 4), (50 + 0.5 * long, 1.6, (0.6 + 0.4 * nose) * wide, 4), (50 + long, 1.2, nose * wide, 4)]
    model.add(pick(rng, *STEELS, *PLASTICS), sweep([(-3, 0, 0), (20, 0, 0), (34, 0, drop), (62, 0, drop)], 9, 7))
    model.add(pick(rng, *STEELS, *PLASTICS), column(smooth(leaf), "x", 32).turned("x", np.pi / 2).moved(z=drop))


KINDS = (slotted, slotted, stubby, precision, t_handle, awl, chisel, file, gimlet, spanner, trowel)
PROPORTIONS = (("x", 0, inf, 0.8, 1.2), ("x", -inf, 0, 0.9, 1.12), ("yz", -inf, inf, 0.88, 1.12))
