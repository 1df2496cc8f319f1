"""Rifles: hunting and sporting (bolt, lever, pump, carbine, double barrel), armies' and marksmen's (two assault families, sniper, bullpup).

Millimetres; the bore lies along x at y = z = 0, the muzzle at +x.
"""

from __future__ import annotations

import numpy as np

from pipeline.toy_objects.model import Kind, Material, Model, Palette, Rng, chance, pick
from pipeline.toy_objects.solids import Rows, ball, bar, block, column, curve, rod, smooth, sweep

BLUED: Palette = ((46, 48, 54), (62, 64, 70), (34, 34, 38), (84, 86, 90), (150, 152, 156))
WOODS: Palette = ((120, 70, 38), (146, 88, 46), (92, 54, 32), (168, 112, 62), (70, 44, 30))
SYNTHETICS: Palette = ((40, 42, 44), (84, 90, 66), (170, 148, 108), (98, 104, 108), (60, 68, 56))
PADS: Palette = ((36, 30, 28), (90, 44, 34), (70, 72, 74))


def furniture(rng: Rng, wood: float) -> Material:
    """Draw wood with a probability of `wood`, else a synthetic."""
    return pick(rng, *(WOODS if chance(rng, wood) else SYNTHETICS))


def barrel(model: Model, rng: Rng, metal: Material, start: float, muzzle: float, radius: float) -> None:
    """Add a tapering barrel, with a muzzle brake or a suppressor on some."""
    taper, step, dark = rng.uniform(0.72, 1.0) * radius, start + rng.uniform(0.1, 0.3) * (muzzle - start), pick(rng, *BLUED[:4])
    model.add(metal, column([(start, radius), (step, radius), (step + 25, 0.5 * (radius + taper)), (muzzle, taper)], "x", 24))
    brake = [(muzzle - 10 + 9 * i, (1.1 if i % 2 else 1.6) * taper) for i in range(5)]
    suppressor = rod(muzzle - 20, muzzle + rng.uniform(90, 170), rng.uniform(16, 21))
    if chance(rng, 0.6):
        model.add(dark, column(brake, "x", 16) if chance(rng, 0.6) else suppressor)


def iron_sights(model: Model, rng: Rng, metal: Material, rear: float, front: float, top: float) -> None:
    """Add a leaf on a surface at height `top`, and a post on the barrel."""
    high = top + rng.uniform(12, 26)
    model.add(metal, bar([(rear, top - 6, top + 3, 14), (rear + 34, top - 6, top + 10, 13), (rear + 38, top - 6, top + 14, 13)], 6))
    model.add(metal, rod(front - 9, front + 9, 12.5), bar([(front - 12, 0, 12, 8), (front - 3, 0, high, 6), (front + 6, 0, high, 6)]))


def scope(model: Model, rng: Rng, x: float, top: float) -> None:
    """Add a telescopic sight centred at x over a surface at height `top`: bells, turrets, mounts."""
    half, r = rng.uniform(110, 170), rng.uniform(12.5, 16)
    front, rear = rng.uniform(1.25, 2.0) * r, rng.uniform(1.2, 1.5) * r
    z = top + front + rng.uniform(5, 14)
    profile = [(-1, rear), (-0.68, rear), (-0.5, r), (0.36, r), (0.62, front), (1, front)]
    tube = column([(share * half, radius) for share, radius in profile], "x", 24).banded("x", [(-half, -half), (half, half)])
    black, glass = pick(rng, (30, 30, 32), (52, 54, 58), (84, 80, 66)), pick(rng, (70, 60, 130), (40, 90, 110), (120, 70, 40))
    turrets = rod(-6, r + 14, 9.5, "z"), rod(-r - 14, 6, 9.5, "y")
    model.add((black, glass, glass), tube.moved(x, z=z))
    model.add(black, *(turret.moved(x - 0.05 * half, z=z) for turret in turrets))
    model.add(pick(rng, *BLUED), *(block((x + at * half - 9, x + at * half + 9), (top - 8, z), 17) for at in (-0.32, 0.22)))


def trigger_guard(model: Model, rng: Rng, metal: Material, x: float, low: float) -> None:
    """Add a guard below height `low`, its rear end at x, with the trigger in it."""
    long, deep = rng.uniform(58, 78), rng.uniform(27, 36)
    bow, trigger = [(-0.1, -0.2), (0, 0.7), (0.4, 1), (0.85, 0.7), (1, -0.2)], [(0.55, -0.2), (0.5, 0.4), (0.6, 0.7)]
    for shares, width in ((bow, 11), (trigger, 7)):
        path = curve([(x + along * long, 0, low - down * deep) for along, down in shares], 16)
        model.add(metal, sweep(path, width, 6))


def grip(model: Model, rng: Rng, color: Material, x: float, low: float) -> None:
    """Add a pistol grip that hangs from height `low`, raked backwards, swelling for the palm."""
    long, rake, share = rng.uniform(84, 104), rng.uniform(0.2, 0.5), np.linspace(-0.16, 1.0, 10)
    path = np.column_stack([x - rake * long * share, 0 * share, low - long * share])
    model.add(color, sweep(path, 29 + 4 * np.sin(np.pi * share), 40 + 7 * share, count=18))


def magazine(model: Model, rng: Rng, color: Material, x: float, low: float, *, bend: float, deep: float) -> None:
    """Add a box magazine below height `low`, its foot swept forwards by the share `bend` of its depth, with a floor plate."""
    share, wide, long = np.linspace(-0.25, 1.0, 12), rng.uniform(22, 28), rng.uniform(52, 68)
    path = np.column_stack([x + bend * deep * share * np.abs(share), 0 * share, low - deep * share * (1 - bend * bend * share * share)])
    model.add(color, sweep(path, wide, long, 7, count=20), sweep(path[-2:] + 0.6 * (path[-1] - path[-2]), wide + 4, long + 5, 7))


def bolt(model: Model, rng: Rng, x: float, radius: float) -> None:
    """Add a bolt and its handle, bent down to a knob on the right."""
    steel, reach, drop = pick(rng, (190, 192, 196), (120, 122, 128), (60, 62, 66)), rng.uniform(46, 64), rng.uniform(8, 34)
    path = curve([(x, 0, 2), (x - 2, -0.5 * reach, 0), (x - 8, -reach, -drop)], 10)
    model.add(steel, rod(x - rng.uniform(40, 60), x + 70, 0.55 * radius), sweep(path, 9, 9, 2, "x"), ball((10, 10, 10)).moved(*path[-1]))


def bipod(model: Model, rng: Rng, x: float, low: float) -> None:
    """Add two legs spread below height `low`; folded forwards on some."""
    long, spread, fold = rng.uniform(150, 220), rng.uniform(0.28, 0.45), 0.0 if chance(rng, 0.7) else -rng.uniform(1.2, 1.35)
    dark = pick(rng, *BLUED[:4])
    leg = column([(-long - 5, 9), (-long + 5, 9), (-long + 8, 5.5), (-0.5 * long, 5.5), (-0.49 * long, 8), (0, 8)], count=14)
    model.add(dark, block((x - 14, x + 14), (low - 16, low + 6), 40))
    model.add(dark, *(leg.turned("x", side * spread).turned("y", fold).moved(x, 12 * side, low - 6) for side in (-1, 1)))


def stock(model: Model, rng: Rng, color: Material, rows: Rows, exponent: float = 2.8) -> None:
    """Add furniture of rows (x, low, high, width), rear first, with a pad at its butt."""
    rear = rows[0][0]
    pad = rear + rng.uniform(9, 20)
    solid = bar(smooth(rows, at=[rear, pad]), exponent, 24).banded("x", [(rear, pad)])
    model.add((color, pick(rng, *PADS)), solid)


def shape(model: Model, material: Material, *rows: tuple[float, float, float, float], exponent: float = 3.4) -> None:
    """Add a smooth bar of rows (x, low, high, width)."""
    model.add(material, bar(smooth(rows), exponent, 24))


def bolt_action(model: Model, rng: Rng) -> None:
    """Hunting or service rifle: one-piece stock, round receiver, bolt, scope or sights; short or full fore-end."""
    metal, wood, r, muzzle = pick(rng, *BLUED), furniture(rng, 0.8), rng.uniform(15, 19), rng.uniform(560, 800)
    barrel(model, rng, metal, 60, muzzle, rng.uniform(9.5, 13))
    fore = muzzle * (rng.uniform(0.78, 0.9) if chance(rng, 0.3) else rng.uniform(0.4, 0.6))
    rear, comb = -rng.uniform(400, 460), -rng.uniform(22, 62)
    butt = [(rear, comb - rng.uniform(112, 138), comb, 44), (0.7 * rear, comb - 90, comb + 4, 42), (-215, comb - 34, comb - 6, 36)]
    grasp = [(-165, -rng.uniform(64, 82), -24, 38), (-115, -52, -6, 44), (-40, -46, -3, 48), (70, -45, -4, 48)]
    stock(model, rng, wood, [*butt, *grasp, (0.6 * fore, -34, 0, 40), (fore - 12, -26, 0, 32), (fore, -18, -2, 22)], 2.6)
    model.add(metal, rod(-110, 75, r))
    trigger_guard(model, rng, metal, -118, -48)
    bolt(model, rng, -78, r)
    if chance(rng, 0.5):
        magazine(model, rng, metal, 0, -44, bend=0.0, deep=rng.uniform(10, 40))
    if chance(rng, 0.7):
        scope(model, rng, rng.uniform(-60, 0), r)
    else:
        iron_sights(model, rng, metal, 70, muzzle - 22, 14)


def kalashnikov(model: Model, rng: Rng) -> None:
    """Stamped receiver, curved magazine, gas tube over the barrel, wooden or folding stock, raked grip."""
    metal, wood, muzzle, front = pick(rng, *BLUED[:4]), furniture(rng, 0.75), rng.uniform(430, 560), rng.uniform(245, 285)
    barrel(model, rng, metal, 0, muzzle, rng.uniform(9, 11))
    model.add(metal, block((-190, 70), (-44, 4), 34), block((front + 55, front + 85), (-12, 36), 22), rod(60, front + 75, 9).moved(z=27))
    shape(model, metal, (-188, -2, 10, 24), (-170, -2, 24, 32), (-20, -2, 25, 32), (-6, -2, 18, 28))
    shape(model, wood, (70, -30, 12, 36), (130, -36, 12, 44), (front - 10, -30, 12, 38), (front, -24, 10, 32))
    shape(model, wood if chance(rng, 0.7) else metal, (80, 12, 36, 30), (140, 12, 40, 34), (front, 12, 36, 28))
    iron_sights(model, rng, metal, 28, muzzle - 45, 26)
    magazine(model, rng, pick(rng, *BLUED, (150, 70, 30)), 10, -40, bend=rng.uniform(0.25, 0.42), deep=rng.uniform(150, 200))
    trigger_guard(model, rng, metal, -118, -44)
    grip(model, rng, wood if chance(rng, 0.6) else furniture(rng, 0.0), -135, -42)
    rear, low = -rng.uniform(400, 440), -rng.uniform(104, 140)
    if chance(rng, 0.6):
        stock(model, rng, wood, [(rear, low, -20, 38), (0.75 * rear, -94, -14, 40), (-225, -50, -6, 32), (-180, -42, -4, 32)])
    else:
        strut, butt = [(rear, 0, low + 20), (-180, 0, -38)], [(rear, 0, -12), (rear - 6, 0, -45), (rear + 6, 0, low)]
        model.add(metal, rod(rear, -170, 7).moved(z=-24), sweep(strut, 13, 13, 2), sweep(curve(butt, 10), 30, 10))


def modular(model: Model, rng: Rng) -> None:
    """AR family: straight stock behind a buffer tube, handguard, carry handle, scope or red dot, front sight."""
    metal, color = pick(rng, *BLUED[:4], *SYNTHETICS), pick(rng, *SYNTHETICS)
    front, r, rear = rng.uniform(230, 340), rng.uniform(26, 33), -rng.uniform(350, 430)
    barrel(model, rng, metal, 0, front + rng.uniform(60, 280), rng.uniform(9, 12))
    model.add(metal, block((-175, 40), (-6, 27), 32), rod(-340, -170, 15))
    shape(model, metal, (-175, -44, -6, 28), (-110, -44, -4, 30), (-60, -50, -4, 34), (30, -52, -4, 34), exponent=6)
    ribs = int(rng.integers(5, 11))  # of a round handguard; or a slab-sided one
    waves = [(40 + (front - 40) * i / (2 * ribs), r if i % 2 else 0.9 * r) for i in range(2 * ribs + 1)]
    slab = bar([(40, -r, 0.8 * r, 1.5 * r), (60, -1.1 * r, 0.8 * r, 1.7 * r), (front, -0.8 * r, 0.6 * r, 1.3 * r)])
    model.add(color, column(waves, "x", 24) if chance(rng, 0.6) else slab)
    bend = rng.uniform(0.1, 0.25) if chance(rng, 0.75) else 0.0
    magazine(model, rng, pick(rng, *SYNTHETICS, *BLUED), -8, -48, bend=bend, deep=rng.uniform(70, 165))
    trigger_guard(model, rng, metal, -112, -44)
    grip(model, rng, color, -122, -42)
    full, open_frame = [(0.85 * rear, -98, 20, 38), (-250, -26, 20, 40)], [(rear + 24, -100, 20, 36), (rear + 30, -30, 20, 38)]
    whole = chance(rng, 0.5)
    stock(model, rng, color, [(rear, -rng.uniform(105, 125), 20, 36), *(full if whole else open_frame), (-195, -22, 19, 38)], 4.0)
    if not whole:
        model.add(color, sweep([(-240, 0, -16), (-300, 0, -40), (rear + 12, 0, -95)], 22, 18, 4))
    sight = rng.integers(3)
    if sight == 0:
        model.add(metal, block((-150, -128), (20, 64), 20), block((-30, -12), (20, 58), 16), block((-154, -8), (54, 67), 20))
    elif sight == 1:
        scope(model, rng, -70, 33)
    else:
        model.add(metal, block((-165, 40), (24, 32), 18), block((-105, -45), (30, 46), 26), rod(-115, -35, 21).moved(z=60))
    post = front + (25 if chance(rng, 0.7) else -20)
    model.add(metal, bar([(post - 22, -15, 15, 18), (post - 4, -15, 62, 12), (post + 6, -15, 62, 12), (post + 22, -15, 15, 18)]))
    if chance(rng, 0.4):
        grip(model, rng, color, 0.7 * front, -24)


def sniper(model: Model, rng: Rng) -> None:
    """Heavy barrel, large scope, bipod; thumb-hole stock or a skeleton with cheek piece; pistol grip."""
    metal, color, r, muzzle = pick(rng, *BLUED[:4]), furniture(rng, 0.2), rng.uniform(18, 23), rng.uniform(640, 860)
    barrel(model, rng, metal, 40, muzzle, rng.uniform(13, 18))
    model.add(metal, rod(-150, 60, r, count=8 if chance(rng, 0.5) else 24))
    bolt(model, rng, -105, r)
    scope(model, rng, -20, r)
    fore, rear, low = rng.uniform(270, 400), -rng.uniform(430, 500), -rng.uniform(118, 140)
    shape(model, color, (-190, -44, -4, 40), (-150, -56, -3, 50), (60, -58, -2, 52), (fore - 30, -46, -2, 48), (fore, -38, -6, 40))
    magazine(model, rng, metal, -6, -54, bend=0.0, deep=rng.uniform(24, 80))
    trigger_guard(model, rng, metal, -125, -54)
    grip(model, rng, color, -162, -42)
    if chance(rng, 0.5):
        butt = [(rear, low, -8, 46), (0.8 * rear, low + 6, -6, 44), (-330, low + 34, -8, 42), (-300, -90, -14, 34)]
        stock(model, rng, color, butt, 3.0)
        shape(model, color, (-320, -46, -10, 36), (-230, -40, -8, 38), (-170, -44, -4, 42))
        model.add(color, sweep(curve([(-330, 0, low + 40), (-250, 0, -122), (-190, 0, -112)]), 34, 26))
    else:
        stock(model, rng, color, [(rear, low, -4, 44), (rear + 24, low, -4, 44), (rear + 34, low + 30, -8, 36)], 4.0)
        model.add(metal, rod(rear + 10, -180, 9).moved(z=-22), rod(rear + 20, -260, 7).moved(z=low + 36))
        model.add(metal, block((-280, -255), (low + 26, -12), 26), block((-400, -265), (-24, 12), 40))
    if chance(rng, 0.85):
        bipod(model, rng, fore - 30, -40)


def lever_action(model: Model, rng: Rng) -> None:
    """Flat receiver, finger loop, tube magazine under a round or octagonal barrel, hammer, straight wooden stock."""
    metal, wood, muzzle, r = pick(rng, *BLUED), furniture(rng, 1.0), rng.uniform(440, 640), rng.uniform(10, 13)
    model.add(metal, rod(0, muzzle, r, count=8 if chance(rng, 0.4) else 24))
    model.add(metal, rod(0, muzzle * rng.uniform(0.62, 0.97), 9.5).moved(z=-23), block((0.52 * muzzle, 0.52 * muzzle + 12), (-34, 13), 24))
    flank, fore, rear = pick(rng, *BLUED, (196, 156, 84)), rng.uniform(200, 270), -rng.uniform(420, 480)
    shape(model, flank, (-150, -44, 2, 26), (-120, -52, 14, 30), (-20, -54, 17, 32), (10, -50, 16, 32), exponent=6)
    shape(model, wood, (6, -46, -2, 40), (0.5 * fore, -46, 0, 42), (fore - 8, -40, -2, 36), (fore, -34, -8, 28))
    trigger_guard(model, rng, metal, -140, -50)
    back = -140 - rng.uniform(85, 120)
    loop = [(-136, 0, -52), (-180, 0, -64), (back, 0, -82), (back + 10, 0, -108), (-180, 0, -100), (-134, 0, -76)]
    model.add(metal, sweep(curve(loop, 28), 11, 6.5), sweep(curve([(-135, 0, -4), (-148, 0, 14), (-164, 0, 22)], 8), 9, 10))
    butt = [(rear, -rng.uniform(140, 160), -38, 40), (0.75 * rear, -112, -26, 40), (-220, -64, -12, 32), (-140, -42, -2, 28)]
    stock(model, rng, wood, butt, 2.5)
    if chance(rng, 0.3):
        scope(model, rng, -60, 16)
    else:
        iron_sights(model, rng, metal, 90, muzzle - 20, r - 1)


def pump(model: Model, rng: Rng) -> None:
    """Pump gun: wide barrel over a tube, ribbed sliding fore-end, bead; a stock, or a pistol grip on some."""
    metal, color, muzzle, r = pick(rng, *BLUED), furniture(rng, 0.6), rng.uniform(430, 700), rng.uniform(12, 14.5)
    reach, grab, long = muzzle * rng.uniform(0.55, 0.95), rng.uniform(110, 0.42 * muzzle), rng.uniform(120, 170)
    model.add(metal, rod(0, muzzle, r), rod(0, reach, 13).moved(z=-30), block((reach - 40, reach - 26), (-42, 12), 20))
    shape(model, metal, (-190, -36, -8, 28), (-160, -52, 14, 36), (-60, -54, 20, 38), (0, -52, 19, 38), (8, -46, 16, 34), exponent=4.5)
    ribs = 2 * int(rng.integers(6, 13))
    slide = column([(grab + long * i / ribs, 25 if i % 2 else 21.5) for i in range(ribs + 1)], "x", 24)
    model.add(color, slide.moved(z=-30))
    trigger_guard(model, rng, metal, -150, -48)
    if chance(rng, 0.25):
        grip(model, rng, color, -175, -24)
    else:
        rear = -rng.uniform(430, 500)
        butt = [(rear, -rng.uniform(130, 150), -30, 42), (0.72 * rear, -104, -20, 42), (-255, -68, -18, 34)]
        stock(model, rng, color, [*butt, (-215, -62, -10, 34), (-170, -44, 0, 34)], 2.6)
    model.add(pick(rng, (210, 60, 40), (220, 220, 210), (200, 170, 90)), rod(muzzle - 14, muzzle - 4, 5).moved(z=r + 3))


def bullpup(model: Model, rng: Rng) -> None:
    """Action in the butt: magazine behind the grip, a long shell, a carrying handle or a sight on a rail."""
    metal, color = pick(rng, *BLUED[:4]), pick(rng, *SYNTHETICS)
    rear, front = -rng.uniform(330, 380), rng.uniform(190, 260)
    barrel(model, rng, metal, 100, rng.uniform(330, 460), rng.uniform(9, 11.5))
    shell = [(rear, -rng.uniform(88, 112), 26, 44), (0.8 * rear, -92, 30, 50), (-150, -58, 30, 50), (0, -36, 28, 46)]
    stock(model, rng, color, [*shell, (0.7 * front, -44, 24, 46), (front, -26, 18, 36)], 3.4)
    clip = pick(rng, *BLUED, *SYNTHETICS)
    magazine(model, rng, clip, rng.uniform(-190, -150), -66, bend=rng.uniform(0.08, 0.25), deep=rng.uniform(90, 140))
    grip(model, rng, color, 10, -30)
    trigger_guard(model, rng, color, 22, -34)
    if chance(rng, 0.5):
        high = rng.uniform(66, 84)
        model.add(color, sweep(curve([(-170, 0, 22), (-130, 0, high), (40, 0, high), (90, 0, 20)], 20), 24, 17, 4))
        model.add(metal, rod(-110, 30, 13).moved(z=high + 10))
    else:
        model.add(metal, block((-180, 120), (24, 36), 19))
        if chance(rng, 0.6):
            scope(model, rng, -30, 36)
    if chance(rng, 0.5):
        grip(model, rng, color, front - 50, -34)


def carbine(model: Model, rng: Rng) -> None:
    """Self-loader in a wooden stock: gas cylinder, upper handguard, short magazine, sights."""
    metal, wood, muzzle = pick(rng, *BLUED), furniture(rng, 0.85), rng.uniform(440, 620)
    barrel(model, rng, metal, 0, muzzle, rng.uniform(9.5, 12))
    fore, rear = rng.uniform(0.55, 0.7) * muzzle, -rng.uniform(380, 430)
    butt = [(rear, -rng.uniform(118, 136), -26, 42), (0.72 * rear, -98, -20, 40), (-215, -54, -22, 34), (-170, -66, -16, 36)]
    stock(model, rng, wood, [*butt, (-115, -48, -5, 44), (60, -42, -3, 46), (0.8 * fore, -32, 2, 38), (fore, -26, 2, 32)], 2.7)
    shape(model, wood, (70, -4, 20, 34), (0.5 * fore + 40, -4, 20, 34), (fore, -4, 16, 28))
    shape(model, metal, (-150, -10, 8, 28), (-120, -10, 22, 36), (50, -10, 20, 34), (72, -10, 16, 30))
    model.add(metal, rod(fore - 20, rng.uniform(fore + 40, muzzle - 40), 8).moved(z=-19), block((fore - 6, fore + 10), (-30, 20), 34))
    if chance(rng, 0.7):
        magazine(model, rng, metal, 20, -38, bend=rng.uniform(0.0, 0.25), deep=rng.uniform(34, 130))
    trigger_guard(model, rng, metal, -122, -44)
    iron_sights(model, rng, metal, -135, muzzle - 25, 21)
    if chance(rng, 0.3):
        scope(model, rng, -50, 26)


def double_barrel(model: Model, rng: Rng) -> None:
    """Break action: two barrels side by side or over each other, splinter fore-end."""
    metal, wood, muzzle, r = pick(rng, *BLUED), furniture(rng, 1.0), rng.uniform(520, 740), rng.uniform(11.5, 14)
    over = chance(rng, 0.5)
    pipe = column([(0, r + 2.5), (120, r + 0.5), (muzzle, r - 1)], "x", 24)
    model.add(metal, *(pipe.moved(z=side * r - r) if over else pipe.moved(y=side * (r - 0.5)) for side in (-1, 1)))
    low, wide = (-3 * r, 42) if over else (-r, 4 * r + 6)
    flank, fore, top = pick(rng, (170, 172, 176), *BLUED, (190, 160, 110)), rng.uniform(200, 270), low + r
    shape(model, flank, (-120, low - 18, -6, 28), (-80, low - 22, 10, 36), (-10, low - 12, r + 3, wide), (8, low - 8, r + 3, wide))
    shape(model, wood, (10, low - 16, top, 0.94 * wide), (0.6 * fore, low - 14, top, 0.84 * wide), (fore, low - 5, top, 0.55 * wide))
    model.add(metal, block((5, muzzle - 5), (r - 8, r + 3), 8))
    trigger_guard(model, rng, metal, -128, low - 18)
    rear, straight = -rng.uniform(430, 490), rng.uniform(0, 26)
    butt = [(rear, -rng.uniform(140, 165), -44, 42), (0.72 * rear, -116, -30, 42), (-235, low - 34 - straight, -14, 34)]
    stock(model, rng, wood, [*butt, (-180, low - 26 - straight, -8, 34), (-100, low - 20, 4, 36)], 2.5)


KINDS: tuple[Kind, ...] = (bolt_action, kalashnikov, modular, sniper, lever_action, pump, bullpup, carbine, double_barrel)
