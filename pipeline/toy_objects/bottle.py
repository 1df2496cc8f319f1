"""Bottles by kind: those for drinks here (wine, beer, spirit, water, soda, sport, swing-top), others in `household`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.toy_objects.household import detergent, medicine, pump, spray, squeeze
from pipeline.toy_objects.labels import AMBER, CLEAR, COBALT, GREEN, PLASTICS, WHITE, stick
from pipeline.toy_objects.paint import Model, chance, pick
from pipeline.toy_objects.shapes import curve, revolve, rod, rounded_box, smooth, sweep, tube
from pipeline.toy_objects.vessel import body, cork, crown_cap, round_rows, screw_cap, wrap

Rng = np.random.Generator


def wine(model: Model, rng: Rng) -> None:
    """Bordeaux, Burgundy, flute or sparkling: shoulders differ; foil, cork or wire hood; punt; one or two labels."""
    r, h = rng.uniform(34, 46), rng.uniform(280, 340)
    neck = rng.uniform(13, 15.5)
    form = rng.integers(3)
    shoulder = h * (rng.uniform(0.60, 0.66), rng.uniform(0.46, 0.52), rng.uniform(0.38, 0.44))[form]
    throat = h * (0.74, 0.78, 0.84)[form]
    lip = [(h - 16, neck), (h - 15, neck + 2.2), (h - 4, neck + 2.2), (h, neck + 1.4)]
    rows = round_rows((0, r - 4), (3, r - 0.5), (8, r), (shoulder, r), (throat, neck + 1), *lip)
    model.add(pick(rng, GREEN, AMBER, (28, 40, 30), CLEAR), body(rows, dent=rng.uniform(8, 30), bore=30.0))
    top = shoulder - rng.uniform(6, 14)
    low = rng.uniform(18, 40)
    stick(model, rng, rows, low, max(top, low + 60), rng.uniform(2.0, 3.6))
    foil = pick(rng, (120, 24, 34), (30, 30, 34), (196, 160, 72), (60, 86, 60))
    if chance(rng, 0.65):
        start = h - rng.uniform(50, 72)
        reach = [
            (start, np.interp(start, *smooth(rows)[:, :2].T) + 0.8),
            (h - 17, neck + 0.9),
            (h - 15, neck + 3),
            (h - 3, neck + 3),
        ]
        model.add(foil, revolve([*reach, (h + 1, neck + 1)]))
    else:
        model.add(pick(rng, (196, 156, 108)), cork(h, 0.8 * neck, rng.uniform(4, 14)))
    if chance(rng, 0.35):
        model.add(foil, wrap(rows, throat + 3, throat + 22, 5.6, proud=0.6))


def beer(model: Model, rng: Rng) -> None:
    """Longneck or stubby with a crown cap, body and neck labels."""
    stubby = chance(rng, 0.4)
    r = rng.uniform(29, 34) + 5 * stubby
    h = rng.uniform(225, 260) - 65 * stubby
    shoulder, throat = h * rng.uniform(0.54, 0.6), h * rng.uniform(0.74, 0.8)
    rows = round_rows(
        (0, r - 3), (3, r - 0.3), (7, r), (shoulder, r), (0.45 * shoulder + 0.55 * throat, 0.68 * r), (throat, 16.5),
        (h - 18, 13.5), (h - 16, 15), (h - 10, 15), (h - 8, 13.2), (h, 13),
    )  # fmt: skip
    model.add(pick(rng, AMBER, GREEN, CLEAR, (84, 44, 20)), body(rows, dent=5.0))
    model.add(pick(rng, (190, 160, 70), (180, 30, 36), (200, 204, 208), (40, 60, 120)), crown_cap(h, 13.0))
    stick(model, rng, rows, 0.15 * h, shoulder - 5, rng.uniform(2.2, 5.9))
    if chance(rng, 0.6):
        stick(model, rng, rows, throat - 10, h - 30, rng.uniform(2.4, 5.0))


def spirit(model: Model, rng: Rng) -> None:
    """Square or flat flask with a short neck and a stopper: ball, block or screw cap."""
    w, h = rng.uniform(36, 52), rng.uniform(170, 260)
    d, n = w * rng.uniform(0.45, 1.0), rng.uniform(3.5, 9)
    neck, shoulder = rng.uniform(13, 17), h * rng.uniform(0.62, 0.76)
    rows = [(0, w - 3, d - 3, n), (3, w, d, n), (0.45 * shoulder, w * rng.uniform(0.88, 1), d, n), (shoulder, w, d, n)]
    rows += [(shoulder + 12, 0.8 * w, 0.8 * d, n), (shoulder + 24, neck, neck, 2), (h - 12, neck, neck, 2)]
    rows += [(h - 10, neck + 3, neck + 3, 2), (h, neck + 3, neck + 3, 2)]
    model.add(pick(rng, CLEAR, (170, 108, 48), (206, 214, 216), COBALT), body(rows, dent=6.0, bore=25.0))
    stick(model, rng, rows, 0.2 * shoulder, 0.85 * shoulder, 1.5)
    stopper = pick(rng, (40, 28, 22), (196, 160, 72), (30, 30, 32), (150, 100, 60))
    kind = rng.integers(3)
    model.add(pick(rng, (200, 164, 116)), cork(h, 0.78 * neck, 6.0))
    if kind == 0:
        tall = rng.uniform(12, 22)
        knob = np.array([(-1, 0.4), (-0.8, 0.75), (-0.35, 0.98), (0, 1.05), (0.35, 0.98), (0.8, 0.65), (1, 0.2)])
        model.add(stopper, revolve(knob * [tall, 1.15 * neck] + [h + tall, 0]))
    elif kind == 1:
        tall = rng.uniform(18, 32)
        model.add(stopper, rounded_box((2.4 * neck, 2.4 * neck, tall), 4, 3, "z").moved(z=h + tall / 2))
    else:
        model.add(stopper, screw_cap(h - 9, neck + 4.5, rng.uniform(20, 30)))


def water(model: Model, rng: Rng) -> None:
    """PET bottle: grip rings, waist, screw cap on a collar, band label."""
    r, h = rng.uniform(29, 44), rng.uniform(190, 310)
    shoulder, waist = h * rng.uniform(0.68, 0.78), rng.uniform(0.72, 0.95)
    rings = int(rng.integers(3, 8))
    grip = np.linspace(0.08 * h, 0.4 * h, 2 * rings + 1)
    ribs = [(z, r * (waist if i % 2 else 1.0 - 0.4 * (1 - waist))) for i, z in enumerate(grip)]
    band = (0.44 * h, shoulder - 6)
    rows = round_rows((0, 0.85 * r), (4, 0.97 * r), *ribs, (band[0], r), (shoulder, r), (h - 26, 14), (h - 16, 12.5), (h - 2, 12.5))
    model.add(pick(rng, (168, 204, 226), (150, 206, 190), (206, 222, 230), (120, 170, 214)), body(rows, dent=9.0))
    cap = pick(rng, (40, 96, 190), WHITE, (206, 40, 44), (64, 160, 84))
    model.add(cap, screw_cap(h - 13, 15.5, rng.uniform(14, 19)), rod(h - 17, h - 14, 15.2, "z"))
    model.add(pick(rng, (190, 214, 226)), rod(h - 22, h - 19, 17.0, "z"))
    stick(model, rng, rows, *band, 6.1)


def soda(model: Model, rng: Rng) -> None:
    """Contour bottle: fluted below, pinched waist, label on the bulge; crown or screw cap."""
    r, h = rng.uniform(28, 36), rng.uniform(185, 250)
    waist, bulge = rng.uniform(0.74, 0.86), rng.uniform(0.5, 0.58) * h
    rows = round_rows(
        (0, 0.8 * r), (4, 0.9 * r), (0.12 * h, 0.98 * r), (rng.uniform(0.26, 0.34) * h, waist * r), (bulge - 16, r),
        (bulge + 16, r), (0.78 * h, 0.56 * r), (h - 20, 13.5), (h - 18, 15), (h - 12, 15), (h, 13),
    )  # fmt: skip
    lobes = int(rng.integers(8, 13))
    model.add(pick(rng, (150, 196, 170), (60, 28, 20), (196, 214, 212)), body(rows, 5.0, 0.0, 6 * lobes, (lobes, 0.045)))
    stick(model, rng, rows, bulge - 17, bulge + 17, rng.uniform(3.4, 6.0), proud=1.0)
    cap = pick(rng, (204, 36, 40), (220, 220, 220), (244, 190, 40))
    model.add(cap, crown_cap(h, 13.0) if chance(rng, 0.5) else screw_cap(h - 12, 16, rng.uniform(14, 20)))


def sport(model: Model, rng: Rng) -> None:
    """Drinking flask: finger grip, broad lid, pull spout or carrying loop, colour bands."""
    r, h = rng.uniform(33, 40), rng.uniform(170, 240)
    grip, pinch = rng.uniform(0.55, 0.7) * h, rng.uniform(0.76, 0.9)
    rows = round_rows(
        (0, r - 3),
        (4, r),
        (grip - 26, r),
        (grip - 12, pinch * r),
        (grip + 12, pinch * r),
        (grip + 26, r),
        (h - 8, 0.96 * r),
        (h, 0.9 * r),
    )
    model.add(pick(rng, *PLASTICS, (60, 66, 74), (186, 190, 194)), body(rows, dent=4.0))
    trim, lid = pick(rng, *PLASTICS, (36, 36, 40)), rng.uniform(14, 24)
    model.add(trim, screw_cap(h - 4, 0.97 * r, lid, 36), rod(0.1 * h, 0.14 * h, r + 0.8, "z", bevel=0.02, count=48))
    stick(model, rng, rows, 0.18 * h, grip - 28, rng.uniform(1.6, 3.0))
    z = h - 4 + lid
    if chance(rng, 0.5):
        model.add(trim, revolve(smooth([(z - 2, 0.7 * r), (z + 8, 0.35 * r), (z + 18, 0.32 * r)])))
        model.add(
            pick(rng, (230, 230, 230), (40, 40, 44)),
            rod(z + 14, z + 30, 9, "z", bevel=0.3),
            rod(z + 20, z + 25, 11.5, "z"),
        )
    else:
        t = np.linspace(0.0, np.pi, 20)
        loop = np.column_stack([0.62 * r * np.cos(t), 0 * t, z - 4 + rng.uniform(22, 34) * np.sin(t)])
        model.add(trim, sweep(loop, 14.0, 6.5, 3.0))


def swing_top(model: Model, rng: Rng) -> None:
    """Flip-top bottle: porcelain stopper with a rubber ring held by a wire bail."""
    r, h = rng.uniform(34, 44), rng.uniform(230, 310)
    neck = rng.uniform(13, 16)
    rows = round_rows(
        (0, r - 4),
        (4, r),
        (rng.uniform(0.48, 0.62) * h, r),
        (0.74 * h, 0.5 * r),
        (h - 34, neck),
        (h - 10, neck),
        (h - 8, neck + 2.5),
        (h, neck + 2),
    )
    model.add(pick(rng, GREEN, AMBER, CLEAR, COBALT), body(rows, dent=8.0, bore=20.0))
    model.add(pick(rng, (170, 60, 40)), rod(h - 2, h + 3, 1.12 * neck, "z"))
    model.add(
        pick(rng, (240, 238, 230)),
        revolve(smooth([(h + 2, 1.1 * neck), (h + 8, neck), (h + 16, 0.62 * neck), (h + 18, 0.3 * neck)])),
    )
    wire, a = pick(rng, (180, 184, 188)), neck + 5
    path = curve([(0, -a, h - 26), (0, -a - 3, h - 8), (0, -0.8 * a, h + 8), (0, -0.35 * a, h + 13)], 14)
    side = (1.0, 0.0, 0.0)
    model.add(wire, tube(path, 1.8, side), tube(path * [1, -1, 1], 1.8, side), rod(h - 29, h - 25, neck + 3.2, "z", bevel=0.1))
    model.add(wire, rod(-0.55 * a, 0.55 * a, 1.8, "y", count=10).moved(z=h + 13))
    if chance(rng, 0.8):
        stick(model, rng, rows, 0.12 * h, 0.42 * h, rng.uniform(2.0, 5.5))


KINDS: tuple[Callable[[Model, Rng], None], ...] = (
    wine, beer, spirit, water, soda, detergent, spray, pump, squeeze, medicine, sport, swing_top,
)  # fmt: skip
