"""Bottles for drinks (wine, beer, spirit, water, soda, sport, swing-top) and others (detergent, spray, pump, squeeze, medicine).

Millimetres, standing on z = 0, the front faces -y. A body is rows (z, radius) or (z, half width, half depth, exponent).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.toy_objects.model import Kind, Material, Model, Palette, Rng, chance, pick
from pipeline.toy_objects.pictures import label
from pipeline.toy_objects.solids import Rows, Solid, ball, bar, box, column, curve, rod, smooth, sweep

GREEN, AMBER, CLEAR, COBALT = (38, 74, 44), (112, 62, 24), (176, 200, 204), (32, 52, 128)
WHITE, BLACK, RED, GOLD = (246, 246, 246), (36, 36, 40), (196, 30, 36), (196, 160, 72)
PLASTICS: Palette = ((228, 228, 224), (206, 62, 50), (52, 120, 190), (240, 176, 48), (92, 160, 92), (226, 130, 168))


def body(
    rng: Rng,
    material: Material,
    rows: Rows,
    printed: tuple[float, float, float],
    bands: Sequence[tuple[float, float, Material]] = (),
    lobes: int = 0,
) -> tuple[tuple[Material, ...], Solid]:
    """Make a bottle's body.

    Parameters
    ----------
    rng
        Draws the label.
    material, rows
        The bottle's own colour and its cross-sections, from the foot to the mouth.
    printed
        The label: lowest z, highest z, and the angle about the front that it covers (rad).
    bands
        Parts of another colour all around: lowest z, highest z, material.
    lobes
        Number of flutes around the lower half.

    Returns
    -------
    tuple
        The materials and the solid, for `Model.add`.
    """
    low, high, angle = printed
    table = smooth(rows, at=[low, high, *(z for *span, _ in bands for z in span)])
    flutes = 0.045 * np.sin(np.pi * np.clip(table[:, 0] / (0.55 * table[-1, 0]), 0.0, 1.0)) ** 2
    count = 6 * lobes or 40
    solid = column(table, count=count, lobes=lobes, depth=flutes).banded("z", (span for *span, _ in bands))
    x, y, z = solid.vertices.T
    turn = np.arctan2(x, -y)
    off_front = np.abs((np.arange(len(z)) % count + 0.5) / count - 0.75)  # share of a cross-section's vertices between it and the front
    where = (np.minimum(off_front, 1.0 - off_front) < angle / (4.0 * np.pi)) & (z > low - 1e-6) & (z < high + 1e-6)
    u = 0.5 + 0.5 * turn / np.abs(turn[where]).max()
    solid = solid.painted(where, np.column_stack([u, (z - low) / (high - low)]))
    aspect = angle * float(np.interp(low, table[:, 0], table[:, 1])) / (high - low)
    return (material, *(band for *_, band in bands), label(rng, aspect)), solid


def screw_cap(z: float, radius: float, height: float, ridges: int = 24) -> Solid:
    """Make a ridged cap from z upwards."""
    rows = [(z, radius), (z + 0.8 * height, radius), (z + 0.95 * height, 0.95 * radius), (z + height, 0.8 * radius)]
    return column(rows, count=3 * ridges, lobes=ridges, depth=0.025)


def crown_cap(z: float, radius: float) -> Solid:
    """Make a crimped beer cap over a mouth at height z."""
    rows = [(z - 5.5, 1.22 * radius), (z - 1.0, 1.1 * radius), (z + 1.5, radius), (z + 2.2, 0.85 * radius)]
    return column(rows, count=63, lobes=21, depth=0.04)


def wine(model: Model, rng: Rng) -> None:
    """Bordeaux, Burgundy or flute, by its shoulders; foil or cork."""
    r, h, neck, form = rng.uniform(34, 46), rng.uniform(280, 340), rng.uniform(13, 15.5), rng.integers(3)
    shoulder, throat = h * (0.63, 0.49, 0.41)[form] * rng.uniform(0.95, 1.05), h * (0.74, 0.78, 0.84)[form]
    lip = [(h - 16, neck), (h - 15, neck + 2.2), (h - 4, neck + 2.2), (h, neck + 1.4)]
    rows = [(0, r - 4), (3, r - 0.5), (8, r), (shoulder, r), (throat, neck + 1), *lip]
    foil = pick(rng, (120, 24, 34), BLACK, GOLD, (60, 86, 60))
    bands = [(h - rng.uniform(50, 72), h, foil)] if chance(rng, 0.65) else []
    low = rng.uniform(18, 40)
    printed = low, max(shoulder - rng.uniform(6, 14), low + 60), rng.uniform(2.0, 3.6)
    model.add(*body(rng, pick(rng, GREEN, AMBER, (28, 40, 30), CLEAR), rows, printed, bands))
    if not bands:
        model.add(pick(rng, (196, 156, 108)), rod(h - 1, h + rng.uniform(4, 14), 0.8 * neck, "z"))


def beer(model: Model, rng: Rng) -> None:
    """Longneck or stubby with a crown cap, a label, and a coloured band around the neck of some."""
    stubby = chance(rng, 0.4)
    r, h = rng.uniform(29, 34) + 5 * stubby, rng.uniform(225, 260) - 65 * stubby
    shoulder, throat = h * rng.uniform(0.54, 0.6), h * rng.uniform(0.74, 0.8)
    rows = [(0, r - 3), (3, r - 0.3), (7, r), (shoulder, r), (0.45 * shoulder + 0.55 * throat, 0.68 * r), (throat, 16.5)]
    rows += [(h - 18, 13.5), (h - 16, 15), (h - 10, 15), (h - 8, 13.2), (h, 13)]
    bands = [(throat - 10, h - 26, pick(rng, WHITE, RED, GOLD, COBALT, BLACK))] if chance(rng, 0.6) else []
    printed = 0.15 * h, shoulder - 5, rng.uniform(2.2, 5.9)
    model.add(*body(rng, pick(rng, AMBER, GREEN, CLEAR, (84, 44, 20)), rows, printed, bands))
    model.add(pick(rng, GOLD, RED, (200, 204, 208), COBALT), crown_cap(h, 13.0))


def spirit(model: Model, rng: Rng) -> None:
    """Square or flat bottle with a short neck and a stopper: ball, block or screw cap."""
    w, h, neck, n = rng.uniform(36, 52), rng.uniform(170, 260), rng.uniform(13, 17), rng.uniform(3.5, 9)
    d, shoulder = w * rng.uniform(0.45, 1.0), h * rng.uniform(0.62, 0.76)
    rows = [(0, w - 3, d - 3, n), (3, w, d, n), (0.45 * shoulder, w * rng.uniform(0.88, 1), d, n), (shoulder, w, d, n)]
    rows += [(shoulder + 12, 0.8 * w, 0.8 * d, n), (shoulder + 24, neck, neck, 2), (h - 12, neck, neck, 2)]
    rows += [(h - 10, neck + 3, neck + 3, 2), (h, neck + 3, neck + 3, 2)]
    glass = pick(rng, CLEAR, (170, 108, 48), (206, 214, 216), COBALT)
    model.add(*body(rng, glass, rows, (0.2 * shoulder, 0.85 * shoulder, rng.uniform(1.4, 1.9))))
    tall = rng.uniform(18, 30)
    stopper = (
        ball((1.2 * neck, 1.2 * neck, 0.6 * tall)).moved(z=h + 0.5 * tall),
        box((2.4 * neck, 2.4 * neck, tall), 6, 3, "z").moved(z=h + tall / 2),
        screw_cap(h - 9, neck + 4.5, tall),
    )
    model.add(pick(rng, (40, 28, 22), GOLD, BLACK, (150, 100, 60)), stopper[rng.integers(3)])


def water(model: Model, rng: Rng) -> None:
    """Plastic bottle: grip rings below the label, waist, screw cap on a collar."""
    r, h, rings = rng.uniform(29, 44), rng.uniform(190, 310), int(rng.integers(3, 8))
    shoulder, waist = h * rng.uniform(0.68, 0.78), rng.uniform(0.72, 0.95)
    grip = np.linspace(0.08 * h, 0.4 * h, 2 * rings + 1)
    ribs = [(z, r * (waist if i % 2 else 1.0 - 0.4 * (1 - waist))) for i, z in enumerate(grip)]
    rows = [(0, 0.85 * r), (4, 0.97 * r), *ribs, (0.44 * h, r), (shoulder, r), (h - 26, 14), (h - 23, 14)]
    rows += [(h - 22, 17), (h - 19, 17), (h - 18, 12.5), (h - 2, 12.5)]
    plastic = pick(rng, (168, 204, 226), (150, 206, 190), (206, 222, 230), (120, 170, 214))
    model.add(*body(rng, plastic, rows, (0.44 * h, shoulder - 6, 5.9)))
    model.add(pick(rng, (40, 96, 190), WHITE, RED, (64, 160, 84)), screw_cap(h - 13, 15.5, rng.uniform(14, 19)))


def soda(model: Model, rng: Rng) -> None:
    """Contour bottle: fluted below, pinched waist, label on the bulge; crown or screw cap."""
    r, h, lobes = rng.uniform(28, 36), rng.uniform(185, 250), int(rng.integers(8, 13))
    waist, bulge = rng.uniform(0.74, 0.86), rng.uniform(0.5, 0.58) * h
    rows = [(0, 0.8 * r), (4, 0.9 * r), (0.12 * h, 0.98 * r), (rng.uniform(0.26, 0.34) * h, waist * r), (bulge - 16, r)]
    rows += [(bulge + 16, r), (0.78 * h, 0.56 * r), (h - 20, 13.5), (h - 18, 15), (h - 12, 15), (h, 13)]
    printed = bulge - 17, bulge + 17, rng.uniform(3.4, 5.9)
    model.add(*body(rng, pick(rng, (150, 196, 170), (60, 28, 20), (196, 214, 212)), rows, printed, lobes=lobes))
    cap = crown_cap(h, 13.0) if chance(rng, 0.5) else screw_cap(h - 12, 16, rng.uniform(14, 20))
    model.add(pick(rng, RED, WHITE, (244, 190, 40)), cap)


def detergent(model: Model, rng: Rng) -> None:
    """Jug with a side handle and a large measuring cap on an off-centre neck."""
    w, h, offset, n = rng.uniform(62, 88), rng.uniform(190, 270), rng.uniform(-0.5, -0.25), rng.uniform(2.6, 4.2)
    d, waist = w * rng.uniform(0.42, 0.6), rng.uniform(0.85, 1.0)
    rows = [(0, w - 6, d - 5, n), (6, w, d, n), (0.35 * h, w * waist, d, n), (0.62 * h, 0.92 * w, d, n)]
    rows += [(0.78 * h, 0.66 * w, 0.8 * d, 2.5), (0.86 * h, 24, 24, 2), (0.93 * h, 22, 22, 2)]
    plastic = pick(rng, *PLASTICS)
    materials, jug = body(rng, plastic, rows, (0.12 * h, 0.55 * h, 1.6))
    jug.vertices[:, 0] += offset * w * np.clip(jug.vertices[:, 2] / h - 0.56, 0.0, None) / 0.33  # lean above the label only
    model.add(materials, jug)
    handle = [(0.02, 0.8), (0.55, 0.87), (0.98, 0.76), (0.98, 0.52), (0.72, 0.36)]
    model.add(plastic, sweep(curve([(x * w, 0, z * h) for x, z in handle], 20), 0.55 * d, 0.42 * d))
    cap = screw_cap(0.9 * h, 31, rng.uniform(32, 52), 30), rod(0.88 * h, 0.9 * h + 2, 34, "z")
    model.add(pick(rng, *PLASTICS), *(solid.moved(x=offset * w) for solid in cap))


def spray(model: Model, rng: Rng) -> None:
    """Trigger sprayer: oval body, collar, pistol head with nozzle and lever."""
    w, h, n = rng.uniform(36, 50), rng.uniform(150, 205), rng.uniform(2.0, 3.6)
    d, waist = w * rng.uniform(0.6, 0.95), rng.uniform(0.7, 0.92)
    rows = [(0, w - 4, d - 4, n), (5, w, d, n), (0.5 * h, w, d, n), (0.72 * h, waist * w, waist * d, 2.2)]
    rows += [(0.84 * h, 0.72 * w, 0.72 * d, 2), (0.97 * h, 14, 14, 2), (h, 13, 13, 2)]
    model.add(*body(rng, pick(rng, *PLASTICS, CLEAR), rows, (0.1 * h, 0.5 * h, rng.uniform(1.7, 2.4))))
    head, trim = pick(rng, *PLASTICS), pick(rng, *PLASTICS, BLACK)
    reach, rear, top = rng.uniform(40, 56), rng.uniform(-32, -20), h + rng.uniform(52, 66)
    barrel = [(rear, top - 14, top - 6, 16), (rear + 6, top - 18, top - 1, 20), (0, top - 24, top, 23), (reach, top - 15, top - 3, 15)]
    model.add(head, bar(smooth(barrel), 3.2), sweep([(-2, 0, h + 8), (-3, 0, h + 24), (-4, 0, top - 8)], 20, 25))
    lever = curve([(x * reach, 0, top - 12 - down * (top - h - 18)) for x, down in ((0.55, 0), (0.6, 0.4), (0.5, 0.7), (0.6, 1))])
    model.add(trim, screw_cap(h - 6, 18.5, rng.uniform(16, 22)), sweep(lever, 10.5, 7))
    model.add(trim, rod(reach - 1, reach + rng.uniform(8, 13), 8.5).moved(z=top - 9))


def pump(model: Model, rng: Rng) -> None:
    """Soap dispenser: round or square body, collar, stem and beak."""
    w, h, n = rng.uniform(30, 42), rng.uniform(115, 190), (2.0, 2.0, 5.0)[rng.integers(3)]
    d, taper = w * (1.0 if n == 2.0 else rng.uniform(0.6, 1.0)), rng.uniform(0.75, 1.0)
    rows = [(0, w - 3, d - 3, n), (4, w, d, n), (0.8 * h, taper * w, taper * d, n), (0.92 * h, 0.6 * w, 0.6 * d, 2.4)]
    rows += [(h - 4, 15, 15, 2), (h + 5, 14, 14, 2)]
    printed = 0.18 * h, 0.7 * h, 1.5 if n > 2 else rng.uniform(2.0, 3.4)
    model.add(*body(rng, pick(rng, *PLASTICS, CLEAR, AMBER), rows, printed))
    top, reach, trim = h + rng.uniform(30, 52), rng.uniform(34, 52), pick(rng, *PLASTICS, BLACK, GOLD)
    beak = curve([(0, 0, top + 3), (0.65 * reach, 0, top + 4), (reach, 0, top - 5)])
    model.add(trim, screw_cap(h, 18, 15), rod(h + 10, top, 4.8, "z"), rod(top - 5, top + 9, 13, "z"))
    model.add(trim, sweep(beak, np.linspace(15, 9, 14), np.linspace(11, 8, 14)).turned("z", rng.uniform(-0.6, 0.6)))


def squeeze(model: Model, rng: Rng) -> None:
    """Sauce bottle: soft waisted body under a long nozzle, or standing on a broad flip cap."""
    w, h, waist = rng.uniform(28, 38), rng.uniform(135, 190), rng.uniform(0.72, 0.95)
    d, on_cap = w * rng.uniform(0.62, 1.0), chance(rng, 0.45)
    sauce = pick(rng, RED, (238, 190, 32), (92, 52, 28), (240, 236, 220), (76, 132, 56))
    trim = pick(rng, WHITE, RED, (48, 120, 60), (244, 200, 40))
    rows = [(0, 0.88 * w, 0.85 * d, 2.3), (6, w, d, 2.4), (0.4 * h, waist * w, waist * d, 2.3), (0.76 * h, w, d, 2.5)]
    printed = 0.2 * h, 0.74 * h, rng.uniform(1.8, 2.6)
    if on_cap:
        rows += [(h - 6, 0.9 * w, 0.8 * d, 2.4), (h, 0.7 * w, 0.55 * d, 2.2)]
        tall = rng.uniform(24, 34)
        foot = [(0, 0.8 * w, 0.8 * d, 2.4), (3, 0.86 * w, 0.86 * d, 2.4), (tall + 2, 0.92 * w, 0.88 * d, 2.4)]
        materials, bottle = body(rng, sauce, rows, printed)
        model.add(materials, bottle.moved(z=tall))
        model.add(trim, column(foot), box((18, 10, 7)).moved(y=-0.86 * d, z=0.75 * tall))
    else:
        rows += [(h - 14, 0.6 * w, 0.6 * d, 2), (h, 16, 16, 2)]
        model.add(*body(rng, sauce, rows, printed))
        tall = rng.uniform(38, 62)
        nozzle = column(smooth([(h - 2, 16), (h + 14, 8), (h + tall, 3.2), (h + tall + 3, 2.4)]))
        model.add(trim, screw_cap(h - 10, 20, 16), nozzle)
        if chance(rng, 0.6):
            model.add(sauce, rod(h + tall - 5, h + tall + 9, 5.5, "z", 0.4))


def medicine(model: Model, rng: Rng) -> None:
    """Pill jar or syrup bottle: short neck, wide ridged cap, label around it."""
    r, slim = rng.uniform(24, 32), chance(rng, 0.5)
    h, neck, shoulder = (
        (rng.uniform(3.6, 4.6), rng.uniform(0.42, 0.55), 0.7) if slim else (rng.uniform(2.2, 3.2), rng.uniform(0.68, 0.86), 0.82)
    )
    h, neck, shoulder = h * r, neck * r, shoulder * h * r
    rows = [(0, r - 2.5), (2.5, r), (shoulder, r), (shoulder + 0.12 * h, neck), (h, neck)]
    tall = rng.uniform(0.13, 0.24) * h + 6
    model.add(*body(rng, pick(rng, AMBER, (214, 122, 40), WHITE, (226, 232, 234)), rows, (0.12 * h, shoulder - 4, rng.uniform(3.0, 5.9))))
    cap = screw_cap(h - 0.5 * tall, 1.18 * neck + 1, tall, int(rng.integers(18, 32)))
    top, lid = h + 0.5 * tall, pick(rng, WHITE, BLACK, (52, 110, 180))
    model.add((lid, pick(rng, RED, (60, 60, 66)) if chance(rng, 0.5) else lid), cap.banded("z", [(top, top)]))


def sport(model: Model, rng: Rng) -> None:
    """Drinking flask: finger grip, coloured band, broad lid with a pull spout or a carrying loop."""
    r, h, pinch = rng.uniform(33, 40), rng.uniform(170, 240), rng.uniform(0.76, 0.9)
    grip, lid, trim = rng.uniform(0.55, 0.7) * h, rng.uniform(14, 24), pick(rng, *PLASTICS, BLACK)
    rows = [(0, r - 3), (4, r), (grip - 26, r), (grip - 12, pinch * r), (grip + 12, pinch * r), (grip + 26, r)]
    rows += [(h - 8, 0.96 * r), (h, 0.9 * r)]
    bands, printed = [(0.08 * h, 0.13 * h, trim)], (0.18 * h, grip - 28, rng.uniform(1.6, 3.0))
    model.add(*body(rng, pick(rng, *PLASTICS, (60, 66, 74), (186, 190, 194)), rows, printed, bands))
    model.add(trim, screw_cap(h - 4, 0.97 * r, lid, 36))
    z = h - 4 + lid
    if chance(rng, 0.5):
        model.add(trim, column(smooth([(z - 2, 0.7 * r), (z + 8, 0.35 * r), (z + 18, 0.32 * r)])))
        model.add(pick(rng, WHITE, BLACK), rod(z + 14, z + 30, 10, "z", 0.3))
    else:
        angle = np.linspace(0.0, np.pi, 20)
        loop = np.column_stack([0.62 * r * np.cos(angle), 0 * angle, z - 4 + rng.uniform(22, 34) * np.sin(angle)])
        model.add(trim, sweep(loop, 14.0, 6.5))


def swing_top(model: Model, rng: Rng) -> None:
    """Flip-top bottle: porcelain stopper on a rubber ring, held by a wire bail."""
    r, h, neck = rng.uniform(34, 44), rng.uniform(230, 310), rng.uniform(13, 16)
    rows = [(0, r - 4), (4, r), (rng.uniform(0.48, 0.62) * h, r), (0.74 * h, 0.5 * r), (h - 34, neck), (h - 10, neck)]
    rows += [(h - 8, neck + 2.5), (h, neck + 2)]
    printed = 0.12 * h, 0.42 * h, rng.uniform(2.0, 5.5)
    model.add(*body(rng, pick(rng, GREEN, AMBER, CLEAR, COBALT), rows, printed))
    stopper = [(h - 1, 1.1 * neck), (h + 4, 1.1 * neck), (h + 8, neck), (h + 16, 0.62 * neck), (h + 18, 0.3 * neck)]
    model.add((pick(rng, (240, 238, 230)), pick(rng, (170, 60, 40))), column(smooth(stopper)).banded("z", [(h - 1, h + 4)]))
    wire, a = pick(rng, (180, 184, 188)), neck + 5
    bail = curve([(0, -a, h - 26), (0, -a - 2, h - 6), (0, -0.9 * a, h + 8), (0, 0, h + 17)], 10)
    model.add(wire, *(sweep(bail * [1, side, 1], 3.6, 3.6, 2.0, "x") for side in (-1, 1)), rod(h - 29, h - 25, neck + 3.2, "z"))


KINDS: tuple[Kind, ...] = (wine, beer, spirit, water, soda, detergent, spray, pump, squeeze, medicine, sport, swing_top)
