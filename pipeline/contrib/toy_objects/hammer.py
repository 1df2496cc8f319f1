"""Hammers (claw, ball-peen, sledge, mallet, gavel, tenderiser, tack), hatchet and pickaxe.

Millimetres, the shaft along x, the head at +x.
"""

from math import inf

import numpy as np

from pipeline.contrib.toy_objects.model import BLACK, GOLD, PLASTICS, STEELS, WOODS, Model, Palette, Rng, chance, pick
from pipeline.contrib.toy_objects.solids import Solid, ball, bar, box, column, rod, smooth, sweep

IRON: Palette = (*STEELS, (70, 74, 80), (44, 46, 50))


def shaft(model: Model, rng: Rng, length: float, width: float = 26.0) -> None:
    """Add a shaft from x = -length to the head: turned wood, or a tube with a rubber grip."""
    swell, neck = rng.uniform(1.0, 1.35) * width, rng.uniform(0.6, 0.9) * width
    rows = [(-length, 0.8 * swell), (-0.96 * length, swell), (-0.7 * length, 0.85 * swell), (-0.35 * length, neck), (8, neck)]
    outline = [(x, -w / 2, w / 2, 0.8 * w) for x, w in rows]
    if chance(rng, 0.5):
        model.add(pick(rng, *WOODS), bar(outline, 2.4, pick(rng, *PLASTICS, BLACK), [(-length, -rng.uniform(0.9, 0.98) * length)]))
    else:
        grip = bar(
            [*outline[:3], (-0.45 * length, -0.4 * width, 0.4 * width, 0.7 * width)],
            2.6,
            pick(rng, *PLASTICS),
            [(-0.75 * length, -0.7 * length)],
        )
        model.add(pick(rng, *STEELS, *PLASTICS), rod(-0.5 * length, 8, 0.33 * width))
        model.add(pick(rng, BLACK, *PLASTICS), grip)


def face(low: float, high: float, radius: float, waist: float) -> Solid:
    """Make the poll of a hammer along z: a waist behind its striking face."""
    way = np.sign(high - low)
    rows = [
        (low, waist * radius),
        (0.45 * low + 0.55 * high, waist * radius),
        (high - 9 * way, radius),
        (high - 2 * way, radius),
        (high, 0.9 * radius),
    ]
    return column(rows if way > 0 else rows[::-1], "z", 28)


def claw(model: Model, rng: Rng) -> None:
    """Model a carpenter's hammer: round face, two curved claws."""
    shaft(model, rng, rng.uniform(220, 300))
    metal, out, droop = pick(rng, *IRON), rng.uniform(62, 85), rng.uniform(5, 38)
    claws = [sweep([(0, 4 * s, 12), (2, 6 * s, 0.6 * out), (-droop, 12 * s, out + 8)], 9, 11, 2.6) for s in (-1, 1)]
    model.add(metal, box((34, 30, 36), 5, 3.0, "z"), face(-10, -rng.uniform(48, 62), rng.uniform(13, 18), 0.75), *claws)


def ball_peen(model: Model, rng: Rng) -> None:
    """Model an engineer's hammer: a face, and a ball at the other end."""
    shaft(model, rng, rng.uniform(200, 300))
    metal, r, out = pick(rng, *IRON), rng.uniform(13, 19), rng.uniform(36, 52)
    model.add(metal, box((30, 28, 36), 4, 3.0, "z"), face(-10, -out - 8, r, 0.8), rod(10, out, 0.62 * r, "z"), ball((r, r, r)).moved(z=out))


def sledge(model: Model, rng: Rng) -> None:
    """Model a heavy hammer: one thick bar for a head, its edges cut off."""
    shaft(model, rng, rng.uniform(240, 420), 31)
    half, side, square = rng.uniform((52, 24, 4.0), (78, 33, 9.0))
    rows = [(-half, 0.8 * side), (10 - half, side), (half - 10, side), (half, 0.8 * side)]
    model.add(pick(rng, *IRON), column([(at, u, u, square) for at, u in rows], "z", 40))
    model.add(pick(rng, *WOODS, *IRON), rod(side - 2, side + rng.uniform(3, 12), 11))


def mallet(model: Model, rng: Rng) -> None:
    """Model a rubber or wooden mallet: a barrel or a block."""
    shaft(model, rng, rng.uniform(190, 290))
    half, r, belly = rng.uniform((42, 30, 0.9), (66, 44, 1.1))
    ends = rng.uniform(0.75, 0.92)
    barrel = column(smooth([(-half, ends * r), (4 - half, r), (0, belly * r), (half - 4, r), (half, ends * r)]), "z", 36)
    wooden = box((1.7 * r, 1.4 * r, 2 * half), 9, 4.0, "z").turned("y", rng.uniform(-0.1, 0.1))
    model.add(pick(rng, BLACK, *PLASTICS, *WOODS), barrel if chance(rng, 0.6) else wooden)
    if chance(rng, 0.4):
        model.add(pick(rng, *PLASTICS, GOLD), *(rod(s * half - 6, s * half + 6, 0.94 * ends * r, "z") for s in (-1, 1)))


def gavel(model: Model, rng: Rng) -> None:
    """Model a judge's hammer, turned from wood with rings; or a croquet mallet."""
    wood, half, r = pick(rng, *WOODS), *rng.uniform((38, 24), (58, 34))
    waves = np.linspace(-half, half, 2 * int(rng.integers(3, 6)) + 1)
    profile = np.column_stack([waves, r * np.where(np.arange(len(waves)) % 2, 0.82, 1.0)])
    length = rng.uniform(170, 260)
    handle = [(-length, 6), (4 - length, 11), (16 - length, 9), (-0.6 * length, 8), (-0.4 * length, 11), (-0.1 * length, 7), (4, 7)]
    model.add(wood, column(smooth(profile), "z", 36), column(smooth(handle), "x", 24))
    model.add(pick(rng, GOLD, BLACK, *WOODS), rod(-8, 8, 1.03 * r, "z"))


def tenderiser(model: Model, rng: Rng) -> None:
    """Model a kitchen hammer: a square head with rows of teeth on one face."""
    shaft(model, rng, rng.uniform(170, 240), 22)
    side, half, teeth = *rng.uniform((24, 26), (32, 40)), int(rng.integers(2, 5))
    metal, pitch = pick(rng, *STEELS, *WOODS), 2 * side / teeth
    model.add(metal, box((2 * side, 2 * side, 2 * half), 9, 3.0, "z"))
    cone = [(half - 2, 0.46 * pitch), (half + 0.3 * pitch, 0.24 * pitch), (half + 0.5 * pitch, 0.08 * pitch)]
    centres = [pitch * (at - (teeth - 1) / 2) for at in range(teeth)]
    model.add(metal, *(column(cone, count=8).moved(x, y) for x in centres for y in centres))


def hatchet(model: Model, rng: Rng) -> None:
    """Model an axe: a wedge with a broad curved edge, a poll behind."""
    shaft(model, rng, rng.uniform(230, 420))
    out, broad, beard, poll = rng.uniform((70, 32, 0, 12), (110, 52, 34, 34))
    rows = [(-poll, 17, 13), (14, 19, 14), (0.4 * out, 15, 9), (0.8 * out, 0.7 * broad, 5), (out - 6, broad, 2.4), (out, 0.9 * broad, 0.8)]
    table = smooth([(z, u, v, 3.0) for z, u, v in rows])
    lean = -beard * (np.clip(table[:, 0], 0, None) / out) ** 1.5
    blade = column(table, "z", 36)
    blade.vertices[:, 0] += np.interp(blade.vertices[:, 2], table[:, 0], lean)
    model.add(pick(rng, *IRON, *PLASTICS), blade)


def pickaxe(model: Model, rng: Rng) -> None:
    """Model a pick or ice axe: a curved spike; opposite it a spike, a blade or a hammer face."""
    shaft(model, rng, rng.uniform(260, 420))
    metal, out, droop = pick(rng, *IRON), rng.uniform(90, 140), rng.uniform(10, 50)
    spikes = [[(2, 0, 8 * s), (4, 0, 0.5 * out * s), (-droop, 0, out * s)] for s in (-1, 1)]
    adze = box((30, 50, 6), 5, 1.5).moved(-0.4 * droop, z=-0.75 * out)
    other = (sweep(spikes[0], 12, 14, 2.6), face(-8, -46, 15, 0.8), adze)[rng.integers(3)]
    neck = [] if other is not adze else [sweep([(2, 0, -8), (0, 0, -0.4 * out), (-0.4 * droop, 0, -0.75 * out)], 16, 13)]
    model.add(metal, box((32, 30, 34), 4, 3.0, "z"), sweep(spikes[1], 12, 14, 2.6), other, *neck)


def tack(model: Model, rng: Rng) -> None:
    """Model a slim hammer: square face, flat peen."""
    shaft(model, rng, rng.uniform(200, 290), 20)
    metal, low, out = pick(rng, *IRON), rng.uniform(34, 58), rng.uniform(45, 75)
    peen = column([(-6, 9, 10, 4), (0.4 * out, 8, 9, 4), (out - 3, 3, 14, 5), (out, 1.6, 14, 5)], "z", 28)
    model.add(metal, box((26, 24, 26), 4, 2.0, "z"), column([(-low, 12, 12, 8), (3 - low, 13, 13, 8), (-8, 9, 9, 4)], "z", 28), peen)


KINDS = (claw, claw, ball_peen, sledge, mallet, gavel, tenderiser, hatchet, pickaxe, tack)
PROPORTIONS = (("x", -inf, -20, 0.85, 1.2), ("y", -inf, inf, 0.88, 1.12), ("z", -inf, inf, 0.86, 1.16))
