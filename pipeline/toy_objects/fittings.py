"""What rifles are made of: barrels, magazines, grips, guards, sights, scopes, bipods.

Millimetres; the bore lies along x at y = z = 0, the muzzle at +x.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.toy_objects.paint import Color, Material, Model, chance, pick
from pipeline.toy_objects.shapes import Solid, ball, bar, curve, revolve, rod, rounded_box, smooth, sweep

Rng = np.random.Generator
BLUED: tuple[Color, ...] = ((46, 48, 54), (62, 64, 70), (34, 34, 38), (84, 86, 90), (150, 152, 156))
WOODS: tuple[Color, ...] = ((120, 70, 38), (146, 88, 46), (92, 54, 32), (168, 112, 62), (70, 44, 30))
SYNTHETICS: tuple[Color, ...] = ((40, 42, 44), (84, 90, 66), (170, 148, 108), (98, 104, 108), (60, 68, 56))


def block(x0: float, x1: float, low: float, high: float, width: float, bevel: float = 2.0, exponent: float = 7.0) -> Solid:
    """Upright block from x0 to x1 with broken edges."""
    b = min(bevel, 0.3 * (x1 - x0), 0.3 * (high - low), 0.3 * width)
    rows = [(x, low + c, high - c, width - 2 * c) for x, c in ((x0, b), (x0 + b, 0), (x1 - b, 0), (x1, b))]
    return bar(rows, exponent, 16)


def barrel(model: Model, rng: Rng, metal: Material, x0: float, x1: float, radius: float) -> None:
    """Tapering barrel with a bored muzzle, and on it a crown, flash hider, brake or suppressor."""
    taper = rng.uniform(0.72, 1.0) * radius
    step = x0 + rng.uniform(0.1, 0.3) * (x1 - x0)
    bore = 0.5 * taper
    profile = [
        (x0, radius),
        (step, radius),
        (step + 25, 0.5 * (radius + taper)),
        (x1 - 2, taper),
        (x1, taper - 1.2),
        (x1, bore),
        (x1 - 40, bore),
    ]
    model.add(metal, revolve(profile, "x", 28))
    dark = pick(rng, *BLUED)
    kind = rng.integers(5)
    if kind == 1:
        r, end = 1.35 * taper, x1 + rng.uniform(28, 46)
        model.add(dark, revolve([(x1 - 14, r), (end - 4, 1.08 * r), (end, r), (end, bore * 1.3), (x1 + 4, bore)], "x"))
        for x in np.linspace(x1 + 2, end - 9, int(rng.integers(2, 5))):
            model.add(pick(rng, (20, 20, 22)), rod(x, x + 3, 1.13 * r))
    elif kind == 2:
        wide, start = 2.2 * taper + 4, x1 - 8
        for i in range(int(rng.integers(2, 4))):
            model.add(dark, block(start + 19 * i, start + 19 * i + 13, -1.2 * taper, 1.2 * taper, wide))
        model.add(dark, rod(start, start + 19 * i + 20, 1.15 * taper))
    elif kind == 3:
        long, r = rng.uniform(110, 190), rng.uniform(16, 21)
        model.add(
            pick(rng, *SYNTHETICS[:3]),
            rod(x1 - 20, x1 - 20 + long, r, bevel=0.15, count=30),
            rod(x1 - 30, x1 - 10, 0.75 * r),
        )


def iron_sights(model: Model, rng: Rng, metal: Material, rear: float, front: float, top: float) -> None:
    """A leaf behind and a post before, on surfaces at height `top` (rear) and the barrel (front)."""
    high = rng.uniform(12, 26)
    model.add(
        metal,
        bar([(rear, top - 6, top + 3, 14), (rear + 34, top - 6, top + 10, 13), (rear + 38, top - 6, top + 14, 13)], 6),
    )
    model.add(
        metal,
        rod(front - 9, front + 9, 12.5),
        bar(
            [
                (front - 12, 0, 12, 8),
                (front - 3, 0, top + high, 6),
                (front + 4, 0, top + high, 6),
                (front + 8, 0, 12, 8),
            ],
            5,
        ),
    )
    if chance(rng, 0.4):
        t = np.linspace(0.15 * np.pi, 1.85 * np.pi, 18) - np.pi / 2
        hood = np.column_stack([np.zeros(18), 11 * np.cos(t), top + high + 3 + 11 * np.sin(t)])
        model.add(metal, sweep(hood + np.array([front, 0, 0]), 12, 4, 3, (1, 0, 0)))


def scope(model: Model, rng: Rng, x: float, top: float) -> None:
    """Telescopic sight centred at x over a surface at height `top`: bells, turrets, rings, glass."""
    long, r = rng.uniform(220, 340), rng.uniform(12.5, 16)
    front, rear = rng.uniform(1.25, 2.0) * r, rng.uniform(1.2, 1.5) * r
    z, half = top + max(front, rear) + rng.uniform(5, 14), long / 2
    black = pick(rng, (30, 30, 32), (52, 54, 58), (84, 80, 66))
    profile = [
        (-half, 0.94 * rear),
        (-half + 4, rear),
        (-0.68 * half, rear),
        (-0.5 * half, r),
        (0.36 * half, r),
        (0.62 * half, front),
        (half - 3, front),
        (half, 0.94 * front),
    ]
    body = revolve([*profile, (half, 0.82 * front), (half - 14, 0.8 * front)], "x", 30)
    glass = pick(rng, (70, 60, 130), (40, 90, 110), (120, 70, 40))
    model.add(
        glass,
        ball((7, 0.81 * front, 0.81 * front)).moved(half - 13),
        ball((5, 0.8 * rear, 0.8 * rear)).moved(-half + 1),
    )
    model.add(black, body, rod(-9, 9, 1.16 * r).moved(-0.05 * half))
    tall = r + rng.uniform(9, 17)
    turret = [(0, 8.5), (0.7 * tall, 8.5), (0.7 * tall, 10.5), (tall - 1.5, 10.5), (tall, 9)]
    model.add(
        black,
        revolve(turret, count=20).moved(-0.05 * half),
        revolve(turret, "y", 20).turned("z", np.pi).moved(-0.05 * half),
    )
    fixed = len(model.parts) - 6
    model.parts[fixed:] = [(solid.moved(x, 0, z), material) for solid, material in model.parts[fixed:]]
    mount = pick(rng, *BLUED)
    for share in (-0.32, 0.22):
        at = x + share * half
        model.add(mount, rod(at - 8, at + 8, r + 3).moved(z=z), block(at - 9, at + 9, top - 8, z, 17))


def rail(model: Model, metal: Material, x0: float, x1: float, top: float, width: float = 19.0) -> None:
    """Toothed rail on a surface at height `top`."""
    model.add(metal, block(x0, x1, top - 5, top + 2.5, 0.75 * width))
    for x in np.arange(x0 + 2, x1 - 8, 14.0):
        model.add(metal, block(x, x + 8, top, top + 6.5, width, 1.0))


def trigger_guard(model: Model, rng: Rng, metal: Material, x: float, low: float, lever: bool = False) -> None:
    """Guard below height `low`, its rear end at x, with the trigger in it; as a cocking lever it loops on behind."""
    long, deep = rng.uniform(58, 78), rng.uniform(27, 36)
    path = [
        (x - 8, 0, low + 6),
        (x + 2, 0, low - 0.75 * deep),
        (x + 0.4 * long, 0, low - deep),
        (x + 0.85 * long, 0, low - 0.7 * deep),
        (x + long, 0, low + 6),
    ]
    if lever:
        back = rng.uniform(85, 120)
        loop = [
            (x + 4, 0, low + 2),
            (x - 0.4 * back, 0, low - 14),
            (x - back, 0, low - 32),
            (x - 0.9 * back, 0, low - 58),
            (x - 0.4 * back, 0, low - 50),
        ]
        model.add(metal, sweep(curve([*loop, (x + 6, 0, low - 26)], 30), 11, 6.5, 3))
    model.add(metal, sweep(curve(path, 22), 11, 6, 3))
    pull = curve(
        [(x + 0.55 * long, 0, low + 6), (x + 0.5 * long, 0, low - 0.35 * deep), (x + 0.6 * long, 0, low - 0.72 * deep)],
        10,
    )
    model.add(metal, sweep(pull, 7, np.linspace(8, 5.5, 10), 3))


def grip(model: Model, rng: Rng, color: Material, x: float, low: float) -> None:
    """Pistol grip hanging from height `low`, raked backwards, swelling for the palm."""
    long, rake = rng.uniform(84, 104), rng.uniform(0.2, 0.5)
    share = np.linspace(-0.16, 1.0, 14)
    path = np.column_stack([x - rake * long * np.clip(share, -1, 1), 0 * share, low - long * share])
    waves = rng.uniform(0.0, 2.4) * np.sin(share * rng.uniform(12, 20))
    model.add(color, sweep(path, 29 + 4 * np.sin(np.pi * share), 40 + 7 * share + waves, 3.2, count=24))


def magazine(model: Model, rng: Rng, color: Material, x: float, low: float, bend: float, deep: float) -> None:
    """Box magazine below height `low`; `bend` (rad) curves it forwards; ribs on the flanks and a floor plate."""
    long, wide = rng.uniform(52, 68), rng.uniform(22, 28)
    angle = np.linspace(-0.25, 1.0, 14) * bend + 1e-6
    radius = deep / bend if bend > 0.05 else 0.0
    drop = np.linspace(-0.25 * deep, deep, 14)
    lean = rng.uniform(0.0, 0.12)
    if radius:
        path = np.column_stack([x + radius * (1 - np.cos(angle)), 0 * angle, low - radius * np.sin(angle)])
    else:
        path = np.column_stack([x + lean * drop, 0 * drop, low - drop])
    model.add(color, sweep(path, wide, long, 7, count=28))
    model.add(color, sweep(path[-2:] + (path[-1] - path[-2]) * 0.6, wide + 4, long + 5, 7, count=28))
    if chance(rng, 0.6):
        for shift in np.linspace(-0.24, 0.24, int(rng.integers(2, 4))):
            model.add(color, sweep(path[3:-2] + np.array([shift * long, 0, 0]), wide + 3.5, 7, 4))


def bolt_handle(model: Model, rng: Rng, x: float, radius: float) -> None:
    """Bolt with its cocking piece behind and a handle bent down to a knob on the right."""
    steel = pick(rng, (190, 192, 196), (120, 122, 128), (60, 62, 66))
    model.add(steel, rod(x - rng.uniform(30, 50), x + 70, 0.55 * radius))
    reach, drop = rng.uniform(46, 64), rng.uniform(8, 34)
    path = curve([(x, 0, 2), (x - 2, -0.5 * reach, 0), (x - 8, -reach, -drop)], 12)
    model.add(steel, sweep(path, 9, np.linspace(11, 8, 12), 2, (1, 0, 0)), ball((9.5, 9.5, 9.5), 14).moved(*path[-1]))


def bipod(model: Model, rng: Rng, x: float, low: float) -> None:
    """Two legs spread below height `low`, in sleeves, with feet; folded forwards on some."""
    long, spread = rng.uniform(150, 220), rng.uniform(0.28, 0.45)
    fold = 0.0 if chance(rng, 0.7) else -rng.uniform(1.2, 1.35)
    dark = pick(rng, *BLUED[:4])
    model.add(dark, block(x - 14, x + 14, low - 16, low + 6, 40))
    for side in (-1, 1):
        leg = [rod(-0.55 * long, 0, 8, "z"), rod(-long, -0.4 * long, 5.5, "z"), ball((9, 9, 7), 12).moved(z=-long)]
        for solid in leg:
            model.add(dark, solid.turned("x", side * spread).turned("y", fold).moved(x, 12 * side, low - 6))


def butt_plate(model: Model, rng: Rng, rear: float, low: float, high: float, width: float) -> None:
    """Rubber or metal pad on a butt ending at x = rear."""
    thick = rng.uniform(9, 22)
    rows = [
        (rear - thick, low + 3, high - 3, 0.86 * width),
        (rear - 0.7 * thick, low, high, width),
        (rear + 3, low, high, width),
    ]
    model.add(pick(rng, (36, 30, 28), (90, 44, 34), (70, 72, 74)), bar(rows, 2.8, 28))


def handguard(model: Model, rng: Rng, color: Material, x0: float, x1: float, radius: float) -> None:
    """Round, octagonal or slab-sided fore-end around the barrel, ribbed or pierced on some."""
    kind = rng.integers(3)
    if kind == 0:
        model.add(
            color,
            revolve(
                smooth([(x0, 1.05 * radius), (x0 + 20, 1.1 * radius), (x1 - 15, 0.9 * radius), (x1, 0.8 * radius)]),
                "x",
                28,
            ),
        )
        for x in np.linspace(x0 + 15, x1 - 15, int(rng.integers(5, 11))):
            model.add(color, rod(x - 4, x + 4, 1.12 * radius, bevel=0.06))
    elif kind == 1:
        model.add(color, revolve([(x0, 0.95 * radius), (x0 + 3, radius), (x1 - 3, radius), (x1, 0.95 * radius)], "x", 8))
        hole = pick(rng, (24, 24, 26))
        for x in np.linspace(x0 + 25, x1 - 25, int(rng.integers(4, 8))):
            slot = rounded_box((16, 1.93 * radius, 8), 3.5, 0.4, steps=1)
            model.add(hole, *(slot.turned("x", a).moved(x) for a in (np.pi / 4, 3 * np.pi / 4, 0.0)))
    else:
        rows = [
            (x0, -1.15 * radius, 0.7 * radius, 1.6 * radius),
            (x0 + 8, -1.25 * radius, 0.75 * radius, 1.75 * radius),
        ]
        rows += [
            (0.5 * (x0 + x1), -1.3 * radius, 0.75 * radius, 1.8 * radius),
            (x1 - 6, -radius, 0.7 * radius, 1.5 * radius),
            (x1, -0.8 * radius, 0.6 * radius, 1.3 * radius),
        ]
        model.add(color, bar(smooth(rows), 3.4, 28))


def shade(rng: Rng, wood: float) -> Material:
    """Furniture: wood in a share `wood` of the draws, else synthetic."""
    return pick(rng, *(WOODS if chance(rng, wood) else SYNTHETICS))


def stock(model: Model, rng: Rng, color: Material, rows: Sequence[Sequence[float]], exponent: float = 2.8) -> None:
    """Butt from rows (x, low, high, width), rear first, with a plate at its end."""
    model.add(color, bar(smooth(rows), exponent, 28))
    butt_plate(model, rng, *rows[0][:4])
