"""Bottles that hold no drink: detergent, spray, pump, squeeze, medicine. Millimetres, the front faces -y."""

from __future__ import annotations

import numpy as np

from pipeline.toy_objects.labels import AMBER, CLEAR, PLASTICS, WHITE, stick
from pipeline.toy_objects.paint import Model, chance, pick
from pipeline.toy_objects.shapes import bar, curve, revolve, rod, rounded_box, smooth, sweep
from pipeline.toy_objects.vessel import body, round_rows, screw_cap

Rng = np.random.Generator


def detergent(model: Model, rng: Rng) -> None:
    """Jug with a side handle and a large measuring cap on an off-centre neck."""
    w, h = rng.uniform(62, 88), rng.uniform(190, 270)
    d, n, offset = w * rng.uniform(0.42, 0.6), rng.uniform(2.6, 4.2), -rng.uniform(0.25, 0.5)
    waist = rng.uniform(0.85, 1.0)
    rows = [(0, w - 6, d - 5, n), (6, w, d, n), (0.35 * h, w * waist, d, n), (0.62 * h, 0.92 * w, d, n)]
    rows += [(0.78 * h, 0.66 * w, 0.8 * d, 2.5), (0.86 * h, 24, 24, 2), (0.93 * h, 22, 22, 2)]
    shell = body(rows, dent=4.0)
    lean = offset * w * np.clip(shell.vertices[:, 2] / h - 0.56, 0.0, None) / 0.33  # above the label only
    shell.vertices[:, 0] += lean
    plastic = pick(rng, *PLASTICS)
    model.add(plastic, shell)
    x, z = 0.98 * w, h
    path = curve(
        [(0.02 * w, 0, 0.8 * z), (0.55 * w, 0, 0.87 * z), (x, 0, 0.76 * z), (x, 0, 0.52 * z), (0.72 * w, 0, 0.36 * z)],
        20,
    )
    model.add(plastic, sweep(path, 0.55 * d, 0.42 * d, 2.6))
    cap, shift = pick(rng, *PLASTICS), offset * w
    tall = rng.uniform(32, 52)
    model.add(cap, screw_cap(0.9 * h, 31, tall, 30).moved(x=shift), rod(0.88 * h, 0.9 * h + 2, 34, "z").moved(x=shift))
    stick(model, rng, rows, 0.12 * h, 0.55 * h, 1.6, proud=0.8)


def spray(model: Model, rng: Rng) -> None:
    """Trigger sprayer: oval body, collar, pistol head with lever and nozzle, dip tube inside."""
    w, h = rng.uniform(36, 50), rng.uniform(150, 205)
    d, n = w * rng.uniform(0.6, 0.95), rng.uniform(2.0, 3.6)
    waist = rng.uniform(0.7, 0.92)
    rows = [(0, w - 4, d - 4, n), (5, w, d, n), (0.5 * h, w, d, n), (0.72 * h, waist * w, waist * d, 2.2)]
    rows += [(0.84 * h, 0.72 * w, 0.72 * d, 2), (0.97 * h, 14, 14, 2), (h + 6, 13, 13, 2)]
    model.add(pick(rng, *PLASTICS, CLEAR), body(rows, dent=4.0))
    stick(model, rng, rows, 0.1 * h, 0.5 * h, rng.uniform(1.7, 2.4))
    head, trim = pick(rng, *PLASTICS), pick(rng, *PLASTICS, (40, 40, 44))
    model.add(trim, screw_cap(h - 6, 18.5, rng.uniform(16, 22)))
    model.add(pick(rng, (230, 230, 230)), rod(12, h, 3.5, "z", count=10))
    reach, top = rng.uniform(40, 56), h + rng.uniform(52, 66)
    rear = -rng.uniform(20, 32)
    shell = [
        (rear, top - 14, top - 6, 16),
        (rear + 6, top - 18, top - 1, 20),
        (0, top - 24, top, 23),
        (0.7 * reach, top - 18, top - 1, 20),
    ]
    model.add(head, bar(smooth([*shell, (reach, top - 15, top - 3, 15)]), 3.2))
    model.add(head, sweep([(-2, 0, h + 8), (-3, 0, h + 24), (-4, 0, top - 8)], [20, 18, 20], [26, 22, 26], 3))
    model.add(trim, rod(reach - 1, reach + rng.uniform(8, 13), 8.5, bevel=0.2).moved(z=top - 9))
    lift = 0.5 * (top - 30 + h + 6)
    lever = curve([(0.55 * reach, 0, top - 12), (0.62 * reach, 0, top - 30), (0.5 * reach, 0, lift), (0.62 * reach, 0, h + 6)], 14)
    model.add(trim, sweep(lever, np.linspace(12, 9, 14), np.linspace(8, 5.5, 14), 3))


def pump(model: Model, rng: Rng) -> None:
    """Soap dispenser: round or square body, collar, stem and a beak; dip tube inside."""
    w, h = rng.uniform(30, 42), rng.uniform(115, 190)
    n = (2.0, 2.0, 5.0)[rng.integers(3)]
    d = w * (1.0 if n == 2.0 else rng.uniform(0.6, 1.0))
    taper = rng.uniform(0.75, 1.0)
    rows = [(0, w - 3, d - 3, n), (4, w, d, n), (0.8 * h, taper * w, taper * d, n), (0.92 * h, 0.6 * w, 0.6 * d, 2.4)]
    rows += [(h - 4, 15, 15, 2), (h + 5, 14, 14, 2)]
    model.add(pick(rng, *PLASTICS, CLEAR, AMBER), body(rows, dent=4.0))
    stick(model, rng, rows, 0.18 * h, 0.7 * h, 1.5 if n > 2 else rng.uniform(2.0, 3.4))
    top = h + rng.uniform(30, 52)
    trim = pick(rng, *PLASTICS, (36, 36, 40), (196, 160, 92))
    model.add(trim, screw_cap(h, 18, 15), rod(h + 12, h + 20, 9, "z"), rod(h + 10, top, 4.8, "z"))
    model.add(pick(rng, (225, 225, 225)), rod(10, h, 3.5, "z", count=10))
    beak = rng.uniform(34, 52)
    path = curve([(0, 0, top + 3), (0.65 * beak, 0, top + 4), (beak, 0, top - 5)], 12)
    spin = rng.uniform(-0.6, 0.6)
    model.add(
        trim,
        rod(top - 5, top + 9, 13, "z", bevel=0.25),
        sweep(path, np.linspace(15, 9, 12), np.linspace(11, 8, 12), 2.8).turned("z", spin),
    )


def squeeze(model: Model, rng: Rng) -> None:
    """Sauce bottle: soft waisted body and a long cone of a nozzle, or standing on a broad flip cap."""
    w, h = rng.uniform(28, 38), rng.uniform(135, 190)
    d, waist = w * rng.uniform(0.62, 1.0), rng.uniform(0.72, 0.95)
    on_cap = chance(rng, 0.45)
    sauce = pick(rng, (196, 30, 28), (238, 190, 32), (92, 52, 28), (240, 236, 220), (76, 132, 56))
    trim = pick(rng, WHITE, (196, 30, 28), (48, 120, 60), (244, 200, 40))
    base = rng.uniform(24, 34) if on_cap else 0.0
    rows = [(0, 0.88 * w, 0.85 * d, 2.3), (6, w, d, 2.4), (0.4 * h, waist * w, waist * d, 2.3), (0.76 * h, w, d, 2.5)]
    broad, narrow = (
        [(h - 6, 0.9 * w, 0.8 * d, 2.4), (h, 0.7 * w, 0.55 * d, 2.2)],
        [(h - 14, 0.6 * w, 0.6 * d, 2), (h, 16, 16, 2)],
    )
    rows += broad if on_cap else narrow
    model.add(sauce, body(rows).moved(z=base))
    stick(model, rng, rows, 0.2 * h, 0.74 * h, rng.uniform(1.8, 2.6), base=base)
    if on_cap:
        foot = [
            (0, 0.8 * w, 0.8 * d, 2.4),
            (3, 0.86 * w, 0.86 * d, 2.4),
            (base - 3, 0.93 * w, 0.9 * d, 2.4),
            (base + 2, 0.9 * w, 0.87 * d, 2.4),
        ]
        model.add(trim, body(foot), rounded_box((18, 10, 7), 3, 2).moved(y=-0.86 * d, z=0.75 * base))
    else:
        tall = rng.uniform(38, 62)
        model.add(
            trim,
            screw_cap(h - 10, 20, 16),
            revolve(smooth([(h + 2, 16), (h + 14, 8), (h + tall, 3.2), (h + tall + 3, 2.4)])),
        )
        if chance(rng, 0.6):
            model.add(sauce, rod(h + tall - 5, h + tall + 9, 5.5, "z", bevel=0.4))


def medicine(model: Model, rng: Rng) -> None:
    """Pill jar or syrup bottle: short neck, wide ridged cap, band label."""
    syrup = chance(rng, 0.5)
    r = rng.uniform(24, 32)
    h = r * (rng.uniform(3.6, 4.6) if syrup else rng.uniform(2.2, 3.2))
    neck = r * (rng.uniform(0.42, 0.55) if syrup else rng.uniform(0.68, 0.86))
    shoulder = h * (0.7 if syrup else 0.82)
    rows = round_rows((0, r - 2.5), (2.5, r), (shoulder, r), (shoulder + 0.12 * h, neck), (h - 2, neck), (h, neck))
    model.add(pick(rng, AMBER, (214, 122, 40), WHITE, (226, 232, 234)), body(rows, dent=3.0))
    tall = rng.uniform(0.13, 0.24) * h + 6
    cap = pick(rng, WHITE, (38, 40, 46), (52, 110, 180))
    model.add(cap, screw_cap(h - 0.5 * tall, 1.18 * neck + 1, tall, int(rng.integers(18, 32))))
    model.add(cap, rod(h - 0.5 * tall - 3, h - 0.5 * tall, 1.12 * neck + 1, "z"))
    if chance(rng, 0.5):
        model.add(pick(rng, (190, 40, 44), (60, 60, 66)), rod(h + 0.4 * tall, h + 0.5 * tall + 2, 0.8 * neck, "z"))
    stick(model, rng, rows, 0.12 * h, shoulder - 4, rng.uniform(3.0, 5.9))
