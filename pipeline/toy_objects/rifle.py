"""Rifles by kind: hunting and sporting ones here (bolt, lever, pump, carbine, double), others in `service`.

Along x, the muzzle at +x, in millimetres.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.toy_objects.fittings import (
    BLUED,
    barrel,
    block,
    bolt_handle,
    grip,
    iron_sights,
    magazine,
    scope,
    shade,
    stock,
    trigger_guard,
)  # fmt: skip
from pipeline.toy_objects.paint import Model, chance, pick
from pipeline.toy_objects.service import bullpup, kalashnikov, modular, sniper
from pipeline.toy_objects.shapes import bar, curve, revolve, rod, smooth, sweep

Rng = np.random.Generator


def bolt_action(model: Model, rng: Rng) -> None:
    """Hunting or service rifle: one-piece stock, round receiver, bolt, scope or sights; short or full fore-end."""
    metal, wood = pick(rng, *BLUED), shade(rng, 0.8)
    r, muzzle = rng.uniform(15, 19), rng.uniform(560, 800)
    barrel(model, rng, metal, 60, muzzle, rng.uniform(9.5, 13))
    model.add(metal, rod(-110, 75, r, bevel=0.2, count=28))
    fore = muzzle * (rng.uniform(0.78, 0.9) if chance(rng, 0.3) else rng.uniform(0.4, 0.6))
    rear, drop = -rng.uniform(400, 460), rng.uniform(10, 50)
    comb = -12 - drop
    rows = [
        (rear, comb - rng.uniform(112, 138), comb, 44),
        (0.7 * rear, comb - 90, comb + 4, 42),
        (-215, comb - 34, comb - 6, 36),
    ]
    rows += [
        (-165, -64 - rng.uniform(0, 18), -24, 38),
        (-115, -52, -6, 44),
        (-40, -46, -3, 48),
        (70, -45, -4, 48),
        (0.6 * fore, -34, 0, 40),
    ]
    stock(model, rng, wood, [*rows, (fore - 12, -26, 0, 32), (fore, -18, -2, 22)], 2.6)
    if chance(rng, 0.5):
        model.add(
            pick(rng, (30, 28, 28)),
            bar([(fore - 34, -29, 1, 34), (fore - 5, -24, 0, 31), (fore + 4, -14, -2, 18)], 2.6),
        )
    trigger_guard(model, rng, metal, -118, -48)
    bolt_handle(model, rng, -78, r)
    if chance(rng, 0.5):
        magazine(model, rng, metal, 0, -44, 0.0, rng.uniform(10, 40))
    if chance(rng, 0.7):
        scope(model, rng, rng.uniform(-60, 0), r)
    else:
        iron_sights(model, rng, metal, 70, muzzle - 22, 14)
    if fore > 0.7 * muzzle:
        model.add(metal, *(block(x, x + 14, -30, 15, 36) for x in (0.6 * fore, fore - 30)))


def lever_action(model: Model, rng: Rng) -> None:
    """Flat receiver, finger loop, tube magazine under a round or octagonal barrel, hammer, straight wooden stock."""
    metal, wood = pick(rng, *BLUED), shade(rng, 1.0)
    flank = pick(rng, *BLUED, (196, 156, 84))
    muzzle, r = rng.uniform(440, 640), rng.uniform(10, 13)
    sides = 8 if chance(rng, 0.4) else 28
    model.add(
        metal,
        revolve([(0, r + 1), (muzzle - 2, 0.88 * r), (muzzle, 0.8 * r), (muzzle, 5), (muzzle - 30, 5)], "x", sides),
    )
    model.add(flank, bar(smooth([(-150, -44, 2, 26), (-120, -52, 14, 30), (-20, -54, 17, 32), (10, -50, 16, 32)]), 6, 28))
    reach = muzzle * rng.uniform(0.62, 0.97)
    model.add(metal, rod(0, reach, 9.5).moved(z=-23), *(block(x, x + 12, -34, 13, 24) for x in (0.9 * reach, 0.52 * muzzle)))
    fore = rng.uniform(200, 270)
    model.add(
        wood,
        bar(smooth([(6, -46, -2, 40), (0.5 * fore, -46, 0, 42), (fore - 8, -40, -2, 36), (fore, -34, -8, 28)]), 2.8, 28),
    )
    trigger_guard(model, rng, metal, -140, -50, lever=True)
    model.add(metal, sweep(curve([(-135, 0, -4), (-148, 0, 14), (-164, 0, 22)], 10), 9, np.linspace(14, 7, 10), 3))
    rear = -rng.uniform(420, 480)
    rows = [
        (rear, -rng.uniform(140, 160), -38, 40),
        (0.75 * rear, -112, -26, 40),
        (-220, -64, -12, 32),
        (-140, -42, -2, 28),
    ]
    stock(model, rng, wood, rows, 2.5)
    if chance(rng, 0.3):
        scope(model, rng, -60, 16)
    iron_sights(model, rng, metal, 60, muzzle - 20, 11)


def pump(model: Model, rng: Rng) -> None:
    """Pump action: magazine tube, sliding ribbed fore-end, humped receiver; shoulder stock or pistol grip only."""
    metal, color = pick(rng, *BLUED), shade(rng, 0.55)
    muzzle, r = rng.uniform(430, 700), rng.uniform(12, 14.5)
    model.add(metal, revolve([(0, r + 1), (muzzle, r), (muzzle, 0.7 * r), (muzzle - 60, 0.68 * r)], "x", 28))
    reach = muzzle * rng.uniform(0.55, 0.95)
    model.add(
        metal,
        rod(0, reach, 13).moved(z=-30),
        rod(reach - 6, reach + 16, 9).moved(z=-30),
        block(reach - 40, reach - 26, -42, 12, 20),
    )
    model.add(
        metal,
        bar(
            smooth([(-190, -36, -8, 28), (-160, -52, 14, 36), (-60, -54, 20, 38), (0, -52, 19, 38), (8, -46, 16, 34)]),
            4.5,
            28,
        ),
    )
    grab = rng.uniform(110, 0.42 * muzzle)
    long = rng.uniform(120, 170)
    model.add(
        color,
        revolve(smooth([(grab, 20), (grab + 10, 23), (grab + long - 10, 22), (grab + long, 18)]), "x", 28).moved(z=-30),
    )
    ribs = int(rng.integers(6, 13))
    model.add(color, *(rod(x - 3, x + 3, 25, bevel=0.08).moved(z=-30) for x in np.linspace(grab + 14, grab + long - 14, ribs)))
    trigger_guard(model, rng, metal, -150, -48)
    if chance(rng, 0.25):
        grip(model, rng, color, -175, -24)
    else:
        rear = -rng.uniform(430, 500)
        rows = [
            (rear, -rng.uniform(130, 150), -30, 42),
            (0.72 * rear, -104, -20, 42),
            (-255, -68, -18, 34),
            (-215, -62, -10, 34),
            (-170, -44, 0, 34),
        ]
        stock(model, rng, color, rows, 2.6)
    if chance(rng, 0.4):
        model.add(
            metal,
            block(20, muzzle - 10, 15, 21, 9),
            *(block(x, x + 8, 6, 17, 7) for x in np.linspace(25, muzzle - 25, 8)),
        )
    model.add(
        pick(rng, (210, 60, 40), (220, 220, 210), (200, 170, 90)),
        rod(muzzle - 14, muzzle - 4, 5).moved(z=24 if chance(rng, 0.5) else 17),
    )


def carbine(model: Model, rng: Rng) -> None:
    """Self-loader in a wooden stock: gas cylinder, upper handguard, operating slide, short magazine, sights."""
    metal, wood = pick(rng, *BLUED), shade(rng, 0.85)
    muzzle = rng.uniform(440, 620)
    barrel(model, rng, metal, 0, muzzle, rng.uniform(9.5, 12))
    fore, rear = rng.uniform(0.55, 0.7) * muzzle, -rng.uniform(380, 430)
    rows = [
        (rear, -rng.uniform(118, 136), -26, 42),
        (0.72 * rear, -98, -20, 40),
        (-215, -54, -22, 34),
        (-170, -66, -16, 36),
        (-115, -48, -5, 44),
    ]
    stock(model, rng, wood, [*rows, (60, -42, -3, 46), (0.8 * fore, -32, 2, 38), (fore, -26, 2, 32)], 2.7)
    model.add(wood, bar(smooth([(70, -4, 20, 34), (0.5 * fore + 40, -4, 20, 34), (fore, -4, 16, 28)]), 2.4))
    model.add(metal, bar(smooth([(-150, -10, 8, 28), (-120, -10, 22, 36), (50, -10, 20, 34), (72, -10, 16, 30)]), 4))
    model.add(
        metal,
        rod(fore - 20, rng.uniform(fore + 40, muzzle - 40), 8).moved(z=-19),
        block(fore - 6, fore + 10, -30, 20, 34),
    )
    model.add(metal, sweep([(20, -14, 4), (20, -38, 8)], 14, 10, 3, (1, 0, 0)))
    if chance(rng, 0.7):
        magazine(model, rng, metal, 20, -38, rng.uniform(0.0, 0.5), rng.uniform(34, 130))
    trigger_guard(model, rng, metal, -122, -44)
    iron_sights(model, rng, metal, -135, muzzle - 25, 21)
    if chance(rng, 0.3):
        scope(model, rng, -50, 26)


def double_barrel(model: Model, rng: Rng) -> None:
    """Break action: two barrels side by side or over each other, rib, hammers on some, splinter fore-end."""
    metal, wood = pick(rng, *BLUED), shade(rng, 1.0)
    muzzle, r = rng.uniform(520, 740), rng.uniform(11.5, 14)
    over = chance(rng, 0.5)
    for side in (-1, 1):
        pipe = revolve([(0, r + 2.5), (120, r + 0.5), (muzzle, r - 1), (muzzle, 0.72 * r), (muzzle - 60, 0.7 * r)], "x", 26)
        model.add(metal, pipe.moved(z=side * r - r) if over else pipe.moved(y=side * (r - 0.5)))
    top, low = r - 2, (-3 * r if over else -r)
    model.add(
        metal,
        block(5, muzzle - 5, top - 6, top + 5, 8),
        rod(muzzle - 16, muzzle - 9, 2.6, "x", count=10).moved(z=top + 6),
    )
    flank = pick(rng, (170, 172, 176), *BLUED, (190, 160, 110))
    wide = 42 if over else 4 * r + 6
    model.add(
        flank,
        bar(
            smooth(
                [
                    (-120, low - 18, -6, 28),
                    (-80, low - 22, 10, 36),
                    (-10, low - 12, r + 3, wide),
                    (8, low - 8, r + 3, wide),
                ]
            ),
            4,
            28,
        ),
    )
    fore = rng.uniform(200, 270)
    model.add(
        wood,
        bar(
            smooth(
                [
                    (10, low - 16, low + r, 0.94 * wide),
                    (0.6 * fore, low - 14, low + r, 0.84 * wide),
                    (fore, low - 5, low + r, 0.55 * wide),
                ]
            ),
            2.6,
            28,
        ),
    )
    if chance(rng, 0.5):
        for y in (-9, 9):
            model.add(metal, sweep(curve([(-70, y, 6), (-80, y, 24), (-97, y, 31)], 10), 8, np.linspace(13, 7, 10), 3))
    model.add(metal, sweep(curve([(-60, 0, 12), (-95, 0, 15), (-120, 4, 9)], 8), 10, 8, 3))
    trigger_guard(model, rng, metal, -128, low - 18)
    rear = -rng.uniform(430, 490)
    straight = rng.uniform(0, 26)
    rows = [
        (rear, -rng.uniform(140, 165), -44, 42),
        (0.72 * rear, -116, -30, 42),
        (-235, low - 34 - straight, -14, 34),
        (-180, low - 26 - straight, -8, 34),
    ]
    stock(model, rng, wood, [*rows, (-100, low - 20, 4, 36)], 2.5)


KINDS: tuple[Callable[[Model, Rng], None], ...] = (
    bolt_action, kalashnikov, modular, sniper, lever_action, pump, bullpup, carbine, double_barrel,
)  # fmt: skip
