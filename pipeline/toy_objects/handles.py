"""Handles of knives by construction: they end at x = 0, lie along -x and rise from z = 0; millimetres."""

from __future__ import annotations

import numpy as np

from pipeline.toy_objects.paint import Color, Model, chance, pick
from pipeline.toy_objects.shapes import ball, bar, revolve, rod, smooth

Rng = np.random.Generator
STEELS: tuple[Color, ...] = ((206, 210, 214), (184, 190, 196), (222, 222, 220), (150, 156, 162))
WOODS: tuple[Color, ...] = ((112, 66, 36), (146, 94, 52), (78, 46, 30), (176, 124, 76), (56, 38, 32))
PLASTICS: tuple[Color, ...] = (
    (30, 30, 32),
    (44, 48, 54),
    (190, 36, 36),
    (240, 240, 236),
    (34, 84, 150),
    (226, 170, 40),
    (60, 120, 70),
)


def stacked(model: Model, rng: Rng, length: float, height: float, width: float) -> None:
    """Discs of leather or cord behind one another, and a pommel."""
    count = int(rng.integers(5, 12))
    tones = [
        pick(rng, (104, 62, 34), (60, 58, 40), (36, 34, 34)),
        pick(rng, (150, 100, 58), (96, 92, 66), (60, 58, 58)),
    ]
    pitch = length / count
    for i in range(count):
        swell = 0.88 + 0.16 * np.sin(np.pi * (i + 0.5) / count)
        h, w = swell * height, swell * width
        disc = [(-0.5, 0.86), (0.12, 1.0), (0.88, 1.0), (1.5, 0.86)]
        rows = [(-(i + x) * pitch, 0.5 * height - 0.5 * s * h, 0.5 * height + 0.5 * s * h, s * w) for x, s in disc]
        model.add(tones[i % 2], bar(rows[::-1], 2.4))
    knob = rng.uniform(0.5, 0.62)
    model.add(
        pick(rng, *STEELS, (190, 150, 70)),
        ball((0.4 * height, 0.6 * width, knob * height)).moved(x=-length - 4, z=0.5 * height),
    )


def scales(model: Model, rng: Rng, length: float, height: float, width: float) -> None:
    """Full tang between two slabs, held by rivets; the butt drops in some."""
    drop, belly = rng.uniform(0.0, 0.35) * height, rng.uniform(0.0, 0.16) * height
    rows = [(-length, -drop, 0.95 * height - drop), (-0.85 * length, -drop - belly, height - 0.8 * drop)]
    rows += [
        (-0.5 * length, belly, 0.97 * height),
        (-0.2 * length, 0.0, 0.93 * height),
        (0.0, 0.08 * height, 0.95 * height),
    ]
    table = smooth(rows)
    metal, wood = pick(rng, *STEELS), pick(rng, *WOODS, *PLASTICS)
    model.add(metal, bar(np.column_stack([table, np.full(len(table), 0.3 * width)]), 8.0))
    inset = np.array([0.0, 0.7, -0.7])
    slab = bar(np.column_stack([(table + inset) * [0.985, 1, 1], np.full(len(table), 0.42 * width)]), 3.0)
    model.add(wood, slab.moved(y=0.29 * width), slab.moved(y=-0.29 * width))
    for share in np.linspace(0.16, 0.84, int(rng.integers(2, 5))):
        low, high = (np.interp(-share * length, table[:, 0], table[:, i]) for i in (1, 2))
        model.add(
            metal,
            rod(-0.52 * width, 0.52 * width, 0.13 * height, "y", 0.2, 14).moved(x=-share * length, z=(low + high) / 2),
        )


def moulded(model: Model, rng: Rng, length: float, height: float, width: float) -> None:
    """One moulded piece, waves for the fingers below, a swell at the butt, perhaps a coloured end."""
    waves, depth = int(rng.integers(0, 5)), rng.uniform(0.04, 0.14) * height
    share = np.linspace(0.0, 1.0, 40)
    low = depth * np.sin(2 * np.pi * waves * share) - rng.uniform(0.0, 0.3) * height * (1 - share) ** 3
    high = height * (0.95 + rng.uniform(0.0, 0.12) * np.sin(np.pi * share))
    round_end = np.sqrt(np.clip(1.0 - (1.0 - np.clip(share / 0.1, 0.0, 1.0)) ** 2, 0.08, 1.0))
    mid = (low + high) / 2
    rows = np.column_stack(
        [
            (share - 1) * length,
            mid + (low - mid) * round_end,
            mid + (high - mid) * round_end,
            width * (0.85 + 0.15 * round_end),
        ]
    )
    color = pick(rng, *PLASTICS)
    model.add(color, bar(rows, 2.7))
    if chance(rng, 0.5):
        cut = rows[6:12] * [1, 1, 1, 1.04] + [0, -0.5, 0.5, 0]
        model.add(pick(rng, *PLASTICS, *STEELS), bar(cut, 2.7))


def octagonal(model: Model, rng: Rng, length: float, height: float, width: float) -> None:
    """Japanese handle: a long slightly swelling octagon and a ferrule of another colour."""
    swell, z = rng.uniform(1.05, 1.25), 0.5 * height
    r = 0.5 * max(width, 0.8 * height)
    collar = rng.uniform(0.16, 0.28) * length
    handle = revolve([(-length, 0.93 * swell * r), (-length + 2, swell * r), (-collar, 1.02 * r), (-1, r), (0, 0.93 * r)], "x", 8)
    ferrule = revolve([(-collar, 1.02 * r + 0.8), (-1.5, r + 0.8), (0.5, 0.9 * r)], "x", 8)
    turn = np.pi / 8
    model.add(pick(rng, *WOODS), handle.turned("x", turn).moved(z=z))
    model.add(pick(rng, (30, 28, 28), (220, 206, 176), (90, 50, 30)), ferrule.turned("x", turn).moved(z=z))


def hollow_steel(model: Model, rng: Rng, length: float, height: float, width: float) -> None:
    """All-steel handle with dark dimples or rings."""
    waist = rng.uniform(0.74, 0.95)
    rows = [
        (-length, 0.1, 0.8, 0.6),
        (-0.95 * length, -0.06, 1.0, 1.0),
        (-0.5 * length, 0.5 - waist / 2, 0.5 + waist / 2, waist),
    ]
    table = smooth([*rows, (-0.12 * length, 0.02, 0.98, 1.0), (0.0, 0.05, 0.95, 0.6)]) * [1, height, height, width]
    metal, dark = pick(rng, *STEELS), pick(rng, (50, 52, 56))
    model.add(metal, bar(table, 2.3))
    count = int(rng.integers(4, 9))
    dots = chance(rng, 0.5)
    for share in np.linspace(0.22, 0.82, count):
        low, high, wide = (np.interp(-share * length, table[:, 0], table[:, i]) for i in (1, 2, 3))
        if dots:
            model.add(
                dark,
                *(ball((2.4, 0.53 * wide, 2.4), 12).moved(-share * length, 0, z) for z in np.interp([0.32, 0.68], [0, 1], [low, high])),
            )
        else:
            ring = [(-share * length + x, low - 0.4, high + 0.4, 1.05 * wide) for x in (-1.6, 1.6)]
            model.add(dark, bar(ring, 2.3))


def bolster(model: Model, rng: Rng, height: float, width: float, long: float) -> None:
    """Forged collar between handle and blade, flowing into the blade."""
    flow = [
        (-0.4 * long, 0.02, 1.0, 1.16),
        (0.2 * long, 0.02, 1.0, 1.1),
        (0.7 * long, 0.04, 1.0, 0.6),
        (1.3 * long, 0.15, 0.98, 0.25),
    ]
    model.add(pick(rng, *STEELS), bar(smooth(flow) * [1, height, height, width], 3.0))


HANDLES = (scales, scales, moulded, octagonal, hollow_steel)
