"""Rifles of armies and marksmen: two assault families, sniper, bullpup. Along x, muzzle at +x, in millimetres."""

from __future__ import annotations

import numpy as np

from pipeline.toy_objects.fittings import (
    BLUED,
    SYNTHETICS,
    barrel,
    bipod,
    block,
    bolt_handle,
    butt_plate,
    grip,
    handguard,
    iron_sights,
    magazine,
    rail,
    scope,
    shade,
    stock,
    trigger_guard,
)  # fmt: skip
from pipeline.toy_objects.paint import Material, Model, chance, pick
from pipeline.toy_objects.shapes import bar, curve, rod, smooth, sweep, tube

Rng = np.random.Generator


def kalashnikov(model: Model, rng: Rng) -> None:
    """Stamped receiver, curved magazine, gas tube over the barrel, wooden or folding stock, raked grip."""
    metal, wood = pick(rng, *BLUED[:4]), shade(rng, 0.75)
    muzzle, front = rng.uniform(430, 560), rng.uniform(245, 285)
    barrel(model, rng, metal, 0, muzzle, rng.uniform(9, 11))
    model.add(
        metal,
        block(-190, 70, -44, 4, 34),
        bar(smooth([(-188, -2, 10, 24), (-170, -2, 24, 32), (-20, -2, 25, 32), (-6, -2, 18, 28)]), 2.8),
    )
    model.add(
        wood,
        bar(smooth([(70, -30, 12, 36), (130, -36, 12, 44), (front - 10, -30, 12, 38), (front, -24, 10, 32)]), 3.4, 28),
    )
    model.add(
        wood if chance(rng, 0.7) else metal,
        bar(smooth([(80, 12, 36, 30), (140, 12, 40, 34), (front, 12, 36, 28)]), 2.6),
    )
    model.add(
        metal,
        rod(60, front + 75, 9).moved(z=27),
        block(front + 55, front + 85, -12, 36, 22),
        rod(front, muzzle - 70, 3.2).moved(z=-18),
    )
    iron_sights(model, rng, metal, 28, muzzle - 45, 26)
    magazine(model, rng, pick(rng, *BLUED, (150, 70, 30)), 10, -40, rng.uniform(0.45, 0.85), rng.uniform(150, 200))
    trigger_guard(model, rng, metal, -118, -44)
    grip(model, rng, wood if chance(rng, 0.6) else shade(rng, 0.0), -135, -42)
    model.add(metal, sweep([(-40, -12, 8), (-40, -40, 8)], 12, 9, 3, (1, 0, 0)), block(-130, -30, -28, -18, 38))
    rear = -rng.uniform(400, 440)
    if chance(rng, 0.6):
        rows = [
            (rear, -rng.uniform(120, 140), -20, 38),
            (0.75 * rear, -94, -14, 40),
            (-225, -50, -6, 32),
            (-180, -42, -4, 32),
        ]
        stock(model, rng, wood, rows, 3.0)
    else:
        wire_stock(model, rng, metal, rear, -24)


def wire_stock(model: Model, rng: Rng, metal: Material, rear: float, z: float) -> None:
    """Folding skeleton: two struts or a triangle of tube, and a shoulder piece."""
    low = z - rng.uniform(80, 110)
    if chance(rng, 0.5):
        for y in (-14, 14):
            model.add(metal, rod(rear, -170, 6, bevel=0.2, count=12).moved(y=y, z=z))
    else:
        model.add(
            metal,
            rod(rear, -170, 7, count=14).moved(z=z),
            tube(curve([(rear + 6, 0, low + 14), (rear + 60, 0, low + 20), (-180, 0, z - 16)], 16), 6.5),
        )
    model.add(
        metal,
        sweep(curve([(rear, 0, z + 10), (rear - 6, 0, z - 20), (rear + 6, 0, low)], 14), 30, 10, 3),
        block(-200, -170, z - 18, z + 16, 36),
    )


def modular(model: Model, rng: Rng) -> None:
    """AR family: two-piece receiver, buffer tube, straight stock, handguard, carry handle or rail with optic."""
    metal, color = pick(rng, *BLUED[:4], *SYNTHETICS), pick(rng, *SYNTHETICS)
    muzzle, front = rng.uniform(400, 620), rng.uniform(230, 340)
    barrel(model, rng, metal, 0, max(muzzle, front + 60), rng.uniform(9, 12))
    model.add(
        metal,
        block(-175, 40, -6, 27, 32),
        bar(smooth([(-175, -44, -6, 28), (-110, -44, -4, 30), (-60, -50, -4, 34), (30, -52, -4, 34)]), 6),
    )
    handguard(model, rng, color, 40, front, rng.uniform(26, 33))
    magazine(
        model,
        rng,
        pick(rng, *SYNTHETICS, *BLUED),
        -8,
        -48,
        rng.uniform(0.2, 0.5) if chance(rng, 0.75) else 0.0,
        rng.uniform(70, 165),
    )
    trigger_guard(model, rng, metal, -112, -44)
    grip(model, rng, color, -122, -42)
    model.add(metal, rod(-340, -170, 15))
    rear = -rng.uniform(350, 430)
    if chance(rng, 0.5):
        rows = [
            (rear, -rng.uniform(105, 125), 20, 36),
            (0.85 * rear, -98, 20, 38),
            (-250, -26, 20, 40),
            (-195, -19, 19, 38),
        ]
        stock(model, rng, color, rows, 4.0)
    else:
        model.add(
            color,
            bar([(rear + 8, -30, 22, 40), (-230, -24, 22, 40)], 4),
            sweep(curve([(-240, 0, -16), (-300, 0, -40), (rear + 8, 0, -95)], 12), 30, 20, 4),
        )
        butt_plate(model, rng, rear + 10, -115, 22, 38)
    if chance(rng, 0.35):
        model.add(
            metal,
            block(-150, -128, 20, 64, 20),
            block(-30, -12, 20, 58, 16),
            bar(smooth([(-154, 56, 70, 22), (-80, 56, 67, 20), (-8, 52, 62, 16)]), 5),
        )
    else:
        rail(model, metal, -165, 40, 27)
        if chance(rng, 0.5):
            scope(model, rng, -70, 33)
        else:
            model.add(pick(rng, *BLUED), block(-105, -45, 30, 42, 26), rod(-115, -35, 21, bevel=0.1).moved(z=60))
            model.add(pick(rng, (60, 60, 140), (140, 50, 40)), rod(-116, -34, 16.5, bevel=0.05).moved(z=60))
    post = front + 25 if chance(rng, 0.7) else front - 20
    model.add(
        metal,
        bar([(post - 22, -15, 15, 18), (post - 4, -15, 62, 12), (post + 6, -15, 62, 12), (post + 22, -15, 15, 18)], 5),
    )
    if chance(rng, 0.4):
        grip(model, rng, color, 0.7 * front, -24)


def sniper(model: Model, rng: Rng) -> None:
    """Heavy barrel, large scope, bipod; thumb-hole stock or a chassis with cheek piece and pistol grip."""
    metal, color = pick(rng, *BLUED[:4]), shade(rng, 0.2)
    muzzle = rng.uniform(640, 860)
    barrel(model, rng, metal, 40, muzzle, rng.uniform(13, 18))
    r = rng.uniform(18, 23)
    model.add(metal, rod(-150, 60, r, bevel=0.15, count=8 if chance(rng, 0.5) else 28))
    bolt_handle(model, rng, -105, r)
    scope(model, rng, -20, r)
    rail(model, metal, -110, 60, r - 2)
    fore, rear = rng.uniform(270, 400), -rng.uniform(430, 500)
    model.add(
        color,
        bar(
            smooth(
                [
                    (-190, -44, -4, 40),
                    (-150, -56, -3, 50),
                    (60, -58, -2, 52),
                    (fore - 30, -46, -2, 48),
                    (fore, -38, -6, 40),
                ]
            ),
            3.6,
            28,
        ),
    )
    magazine(model, rng, metal, -6, -54, 0.0, rng.uniform(24, 80))
    trigger_guard(model, rng, metal, -125, -54)
    low = -rng.uniform(118, 140)
    if chance(rng, 0.5):
        stock(
            model,
            rng,
            color,
            [(rear, low, -8, 46), (0.8 * rear, low + 6, -6, 44), (-330, low + 34, -8, 42), (-300, -90, -14, 34)],
            3.0,
        )
        model.add(color, bar(smooth([(-320, -46, -10, 36), (-230, -40, -8, 38), (-170, -44, -4, 42)]), 3))
        lower = curve([(-330, 0, low + 40), (-250, 0, -122), (-190, 0, -112)], 12)
        model.add(color, sweep(lower, 34, 26, 3))
        grip(model, rng, color, -160, -42)
    else:
        grip(model, rng, color, -165, -42)
        model.add(metal, rod(rear + 10, -180, 9).moved(z=-22), rod(rear + 20, -260, 7).moved(z=low + 30))
        model.add(metal, block(-280, -255, low + 18, -12, 26))
        butt_plate(model, rng, rear + 14, low, -4, 44)
        model.add(color, bar(smooth([(-400, -20, 6, 34), (-380, -24, 12, 42), (-280, -24, 12, 42), (-260, -20, 6, 34)]), 2.6))
    if chance(rng, 0.85):
        bipod(model, rng, fore - 30, -40)


def bullpup(model: Model, rng: Rng) -> None:
    """Action in the butt: magazine behind the grip, a long shell, carrying handle or rail with a sight."""
    metal, color = pick(rng, *BLUED[:4]), pick(rng, *SYNTHETICS)
    rear, front, muzzle = -rng.uniform(330, 380), rng.uniform(190, 260), rng.uniform(330, 460)
    barrel(model, rng, metal, 100, muzzle, rng.uniform(9, 11.5))
    rows = [
        (rear, -rng.uniform(88, 112), 26, 44),
        (0.8 * rear, -92, 30, 50),
        (-150, -58, 30, 50),
        (0, -36, 28, 46),
        (0.7 * front, -44, 24, 46),
        (front, -26, 18, 36),
    ]
    stock(model, rng, color, rows, 3.4)
    magazine(
        model,
        rng,
        pick(rng, *BLUED, *SYNTHETICS),
        rng.uniform(-190, -150),
        -66,
        rng.uniform(0.15, 0.5),
        rng.uniform(90, 140),
    )
    grip(model, rng, color, 10, -30)
    trigger_guard(model, rng, color, 22, -34)
    if chance(rng, 0.5):
        high = rng.uniform(66, 84)
        path = curve([(-170, 0, 22), (-130, 0, high), (40, 0, high), (90, 0, 20)], 22)
        model.add(color, sweep(path, 24, 17, 4))
        model.add(metal, rod(-110, 30, 13).moved(z=high + 10))
    else:
        rail(model, metal, -180, 120, 30)
        if chance(rng, 0.6):
            scope(model, rng, -30, 36)
    if chance(rng, 0.5):
        grip(model, rng, color, front - 50, -34)
    model.add(metal, *(block(x, x + 46, -18, -8, 53) for x in (-260, -60)))
