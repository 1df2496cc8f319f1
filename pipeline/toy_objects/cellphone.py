"""Cellphones by kind: smartphone, bar, brick, flip (open and closed), slider, keyboard phone, organiser."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.toy_objects.handset import (
    BLACK,
    BRIGHT,
    CHROME,
    SHELLS,
    WHITE,
    antenna,
    back_camera,
    button,
    earpiece,
    keypad,
    navigation,
    plate,
    screen,
    shell,
    side_keys,
)  # fmt: skip
from pipeline.toy_objects.images import icons, liquid_crystal
from pipeline.toy_objects.paint import Material, Model, chance, pick
from pipeline.toy_objects.shapes import revolve, rod, rounded_box, smooth

Rng = np.random.Generator
QWERTY = ("QWERTYUIOP", "ASDFGHJKL ", "ZXCVBNM   ")


def smartphone(model: Model, rng: Rng) -> None:
    """Slab of glass: frame, pane, icons; home key, notch, punch hole or chin; camera bump behind."""
    w, h, t = rng.uniform(58, 80), rng.uniform(115, 166), rng.uniform(7.5, 11)
    corner = rng.uniform(3, 13)
    model.add(pick(rng, *SHELLS, *BRIGHT), rounded_box((w, t, h), corner, rng.uniform(1, 3.4), steps=7))
    model.add(pick(rng, *CHROME, *BRIGHT), rounded_box((w + 0.8, 0.4 * t, h + 0.8), corner, 0.8, steps=7))
    front = t / 2
    model.add(
        pick(rng, (16, 16, 18), (240, 240, 240), spread=6),
        plate(0, 0, (w - 3.5, h - 3.5), front, 0.4, max(corner - 1, 2), 7),
    )
    old = chance(rng, 0.5)
    chin = rng.uniform(12, 19) if old else rng.uniform(2.5, 5)
    brow = chin * rng.uniform(0.7, 1.0)
    size = (w - (8 if old else 6.5), h - 4 - chin - brow)
    model.add(
        Material(WHITE, icons(rng)),
        plate(0, (chin - brow) / 2, size, front, 0.8, 1.0 if old else max(corner - 3, 2), 6),
    )
    dark, metal = pick(rng, (24, 24, 26), spread=6), pick(rng, *CHROME)
    if old:
        z = -h / 2 + 2 + 0.5 * chin
        key = plate(0, z, (18, 6), front, 1.0, 3) if chance(rng, 0.4) else button(0, z, (0.3 * chin + 1, 0.3 * chin + 1), front, 0.9)
        model.add(metal, key)
        earpiece(model, rng, h / 2 - 0.5 * brow - 1, front)
    elif chance(rng, 0.5):
        model.add(dark, plate(0, h / 2 - brow - 4, (rng.uniform(16, 30), 5), front, 1.0, 2.4))
    else:
        model.add(dark, button(rng.uniform(-0.35, 0.35) * w, h / 2 - brow - 7, (2.4, 2.4), front, 1.0, 14))
    back_camera(model, rng, rng.uniform(0.18, 0.3) * w, h / 2 - rng.uniform(20, 30), t / 2)
    side_keys(model, rng, w, -h / 2, h / 2)
    model.add(dark, rounded_box((9, 3.2, 3), 1.4, 0.4, "z", 3).moved(z=-h / 2 + 1.2))


def bar_phone(model: Model, rng: Rng) -> None:
    """Candy bar: display, pad, twelve keys; a faceplate of another colour, a stub antenna on some."""
    w, h, t = rng.uniform(42, 52), rng.uniform(98, 136), rng.uniform(14, 23)
    model.add(pick(rng, *SHELLS, *BRIGHT), shell(rng, w, h, t))
    front = t / 2
    if chance(rng, 0.6):
        model.add(
            pick(rng, *SHELLS, *CHROME, *BRIGHT),
            plate(0, 0.5 * h, (0.8 * w, 0.86 * h), front, 0.8, rng.uniform(5, 16), 7),
        )
        front += 0.8
    split = rng.uniform(0.5, 0.58)
    width = 0.68 * w
    tall = rng.uniform(0.24, 0.3) * h
    screen(model, rng, 0.89 * h - 0.5 * tall, (width, tall - 6), front)
    earpiece(model, rng, 0.925 * h, front)
    navigation(model, rng, (split + 0.005) * h, 0.92 * w, front)
    keypad(model, rng, (0.76 * w, 0.09 * h, (split - 0.09) * h), front)
    side_keys(model, rng, 0.93 * w, 0, h)
    if chance(rng, 0.45):
        antenna(model, rng, (0.3 if chance(rng, 0.8) else -0.3) * w, h - 2)


def brick(model: Model, rng: Rng) -> None:
    """Early phone: deep body, battery behind, narrow display, big keys, long antenna."""
    w, h, t = rng.uniform(48, 62), rng.uniform(160, 210), rng.uniform(30, 48)
    color = pick(rng, (60, 60, 62), (206, 200, 184), (90, 92, 88), (32, 34, 38))
    model.add(color, shell(rng, w, h, t))
    depth = rng.uniform(12, 22)
    model.add(
        pick(rng, (40, 40, 42), (120, 116, 106)),
        rounded_box((0.86 * w, depth, 0.62 * h), 5, 3).moved(0, t / 2 + 0.3 * depth, 0.42 * h),
    )
    front, high = t / 2, rng.uniform(0.5, 0.6) * h
    screen(model, rng, high + 0.13 * h, (0.66 * w, 0.09 * h), front)
    keypad(model, rng, (0.76 * w, 0.12 * h, high), front)
    dark = pick(rng, BLACK, (90, 90, 90))
    count = int(rng.integers(3, 6))
    model.add(
        dark,
        *(plate(0, z, (0.5 * w, 2.6), front, 0.7, 1.2) for z in np.linspace(high + 0.25 * h, high + 0.32 * h, count)),
    )
    antenna(model, rng, 0.3 * w, h - 3, 0.1 * t, rng.uniform(40, 90))
    if chance(rng, 0.5):
        model.add(dark, rod(h - 5, h + 8, 6, "z", 0.2).moved(x=-0.22 * w))


def flip(model: Model, rng: Rng) -> None:
    """Clamshell open at an angle: keys below, hinge, leaf with the screen leaning forward."""
    w, h, t = rng.uniform(42, 54), rng.uniform(76, 98), rng.uniform(10, 15)
    lean = rng.uniform(0.15, 0.6)
    shade = pick(rng, *SHELLS, *BRIGHT)
    inner = pick(rng, *SHELLS, *CHROME)
    corner, bevel = rng.uniform(5, 15), rng.uniform(2, 4.5)
    front, hinge = t / 2, h + 1.5
    model.add(shade, rounded_box((w, t, h), corner, bevel, steps=7).moved(z=h / 2))
    model.add(inner, plate(0, 0.47 * h, (0.86 * w, 0.84 * h), front, 0.6, 0.6 * corner, 6))
    navigation(model, rng, 0.74 * h, 0.92 * w, front + 0.6)
    keypad(model, rng, (0.78 * w, 0.09 * h, 0.57 * h), front + 0.6)
    model.add(pick(rng, *CHROME, *SHELLS), rod(-0.28 * w, 0.28 * w, 0.5 * t + 0.6, "x", 0.12, 28).moved(y=-0.1 * t, z=hinge))
    model.add(shade, *(rod(a * w, (a + 0.17) * w, 0.48 * t, "x", 0.2, 24).moved(y=-0.1 * t, z=hinge) for a in (-0.47, 0.3)))
    leaf = Model()
    thin, tall = rng.uniform(0.68, 0.9) * t, h * rng.uniform(0.92, 1.04)
    leaf.add(shade, rounded_box((w, thin, tall), corner, min(bevel, 0.4 * thin), steps=7).moved(z=hinge + 2 + tall / 2))
    pane, middle = (0.68 * w, rng.uniform(0.5, 0.66) * tall), hinge + 2 + 0.5 * tall
    leaf.add(inner, plate(0, middle, (0.86 * w, 0.88 * tall), thin / 2, 0.6, 0.6 * corner, 6))
    screen(leaf, rng, middle, pane, thin / 2 + 0.6)
    earpiece(leaf, rng, hinge + 2 + 0.9 * tall, thin / 2 + 0.6)
    back = rod(thin / 2 - 3, thin / 2 + 1.8, rng.uniform(4, 6), "y", 0.15, 20).moved(0, 0, hinge + rng.uniform(0.6, 0.85) * tall)
    leaf.add(pick(rng, *CHROME), back)
    leaf.add(
        Material(WHITE, liquid_crystal(rng, (120, 150, 190), (20, 24, 40))),
        rounded_box((22, 4, 14), 2, 0.6).moved(0, thin / 2 - 1, hinge + 0.4 * tall),
    )
    model.parts.extend((solid.turned("x", lean, (0, 0, hinge)), material) for solid, material in leaf.parts)
    if chance(rng, 0.5):
        antenna(model, rng, 0.38 * w, h - 2, 0.75 * t, rng.uniform(14, 24))
    side_keys(model, rng, w, 0, h)


def folded(model: Model, rng: Rng) -> None:
    """Clamshell closed: two leaves, hinge on top, small outer display, camera and trim."""
    w, h, t = rng.uniform(44, 54), rng.uniform(82, 104), rng.uniform(20, 27)
    corner, split = rng.uniform(8, 20), rng.uniform(0.42, 0.52)
    shade = pick(rng, *SHELLS, *BRIGHT)
    model.add(shade, rounded_box((w, split * t, h), corner, 3, steps=7).moved(y=-t / 2 + split * t / 2))
    rear = (1 - split) * t - 0.8
    model.add(
        shade if chance(rng, 0.5) else pick(rng, *SHELLS),
        rounded_box((w, rear, h), corner, 3, steps=7).moved(y=t / 2 - rear / 2),
    )
    model.add(pick(rng, (50, 52, 56)), rounded_box((w - 4, 0.5 * t, h - 4), corner, 1, steps=6))
    model.add(pick(rng, *CHROME, *SHELLS), rod(-0.3 * w, 0.3 * w, 0.4 * t, "x", 0.15, 24).moved(z=h / 2 - 0.12 * t))
    front, z = t / 2, rng.uniform(0.02, 0.16) * h
    if chance(rng, 0.5):
        model.add(pick(rng, *CHROME), button(0, z, (0.36 * w, 0.36 * w), front, 0.8, 40))
        front += 0.8
    screen(model, rng, z, (0.44 * w, rng.uniform(0.28, 0.4) * w), front)
    eye = z + 0.33 * h
    model.add(pick(rng, *CHROME), rod(-t / 2 - 2.0, -t / 2 + 4, 5.5, "y", 0.15, 24).moved(z=eye))
    model.add(pick(rng, (16, 20, 34), spread=4), rod(-t / 2 - 2.7, -t / 2 + 4, 3.4, "y", 0.3, 18).moved(z=eye))
    bars = np.linspace(-0.36, -0.24, int(rng.integers(1, 5))) * h
    model.add(pick(rng, *CHROME, BLACK), *(plate(0, at, (0.4 * w, 2.2), t / 2, 1.0, 1.0) for at in bars))
    side_keys(model, rng, w, -h / 2, h / 2)
    if chance(rng, 0.55):
        antenna(model, rng, 0.34 * w, h / 2 - 3, 0.18 * t, rng.uniform(12, 26))


def slider(model: Model, rng: Rng) -> None:
    """Two leaves pushed apart: screen and pad on the front one, keys on the rear one."""
    w, h, t = rng.uniform(44, 53), rng.uniform(88, 106), rng.uniform(7.5, 9.5)
    travel, corner = rng.uniform(0.38, 0.52) * h, rng.uniform(4, 13)
    shade = pick(rng, *SHELLS, *BRIGHT)
    model.add(pick(rng, *SHELLS), rounded_box((w, t + 1, h), corner, 2.5, steps=7).moved(y=t / 2, z=h / 2))
    model.add(shade, rounded_box((w, t, h), corner, 2.5, steps=7).moved(y=-t / 2 + 0.4, z=h / 2 + travel))
    model.add(pick(rng, *CHROME), rounded_box((w + 0.8, 2.6, h - 6), corner, 0.6).moved(y=-t / 2 + 0.4, z=h / 2 + travel))
    front = t - 0.4
    tall = rng.uniform(0.48, 0.58) * h
    screen(model, rng, travel + 0.9 * h - tall / 2, (0.74 * w, tall), front)
    earpiece(model, rng, travel + 0.95 * h, front)
    navigation(model, rng, travel + 0.16 * h, 0.94 * w, front)
    keypad(model, rng, (0.84 * w, 0.05 * h, 0.98 * travel), 0.5, round_keys=chance(rng, 0.2))
    back_camera(model, rng, 0.22 * w, 0.75 * h, t + 0.5)
    side_keys(model, rng, w, travel, travel + h)


def keyboard_phone(model: Model, rng: Rng) -> None:
    """Broad phone with a small letter keyboard under a landscape screen."""
    w, h, t = rng.uniform(58, 74), rng.uniform(104, 124), rng.uniform(11, 16)
    model.add(pick(rng, *SHELLS), rounded_box((w, t, h), rng.uniform(6, 18), rng.uniform(2, 4), steps=7).moved(z=h / 2))
    model.add(pick(rng, *CHROME), rounded_box((w + 1, 0.35 * t, h + 1), 12, 1, steps=7).moved(z=h / 2))
    front, split = t / 2, rng.uniform(0.4, 0.47)
    image = Material(WHITE, np.ascontiguousarray(icons(rng)[8:66]))
    screen(model, rng, 0.76 * h, (0.74 * w, 0.26 * h), front, image)
    earpiece(model, rng, 0.94 * h, front)
    navigation(model, rng, (split + 0.055) * h, 0.86 * w, front)
    legends = (*QWERTY, "  0    #  ") if chance(rng, 0.5) else QWERTY
    keypad(model, rng, (0.9 * w, 0.06 * h, (split - 0.045) * h), front, legends)
    side_keys(model, rng, w, 0, h)
    back_camera(model, rng, 0.2 * w, 0.84 * h, t / 2)


def organiser(model: Model, rng: Rng) -> None:
    """Pocket computer with a phone in it: large pane, row of hard keys, wheel, pen in a slot, thick antenna on some."""
    w, h, t = rng.uniform(66, 82), rng.uniform(112, 138), rng.uniform(15, 22)
    model.add(pick(rng, *SHELLS), shell(rng, w, h, t))
    front = t / 2
    model.add(pick(rng, *CHROME, *SHELLS), plate(0, 0.5 * h, (0.86 * w, 0.88 * h), front, 0.7, rng.uniform(4, 12), 6))
    front += 0.7
    screen(
        model,
        rng,
        0.58 * h,
        (0.7 * w, rng.uniform(0.52, 0.6) * h),
        front,
        Material(WHITE, icons(rng)) if chance(rng, 0.6) else None,
    )
    z = 0.16 * h
    model.add(pick(rng, *CHROME), button(0, z, (0.11 * w, 0.09 * w), front, 2.2))
    xs = np.linspace(0.2, 0.34, 2) * w
    model.add(
        pick(rng, *SHELLS, BLACK),
        *(button(s * x, z, (0.055 * w, 0.045 * h), front, 1.5, 18) for s in (-1, 1) for x in xs),
    )
    model.add(pick(rng, BLACK, *CHROME), rod(0.15 * h, h + 5, 2.4, "z", 0.3, 14).moved(0.36 * w, 0.2 * t))
    if chance(rng, 0.6):
        antenna(model, rng, -0.32 * w, h - 4, 0.0, rng.uniform(16, 26))
    grip = smooth([(0.25 * h, t / 2 - 2), (0.45 * h, t / 2), (0.65 * h, t / 2 - 2)])
    model.add(pick(rng, BLACK), *(revolve(grip, count=16).moved(s * (w / 2 - t / 2 - 0.5)) for s in (-1, 1)))
    side_keys(model, rng, 0.95 * w, 0, h)


KINDS: tuple[Callable[[Model, Rng], None], ...] = (
    smartphone, smartphone, bar_phone, brick, flip, folded, slider, keyboard_phone, organiser,
)  # fmt: skip
