"""What phones are made of: shells, screens, keys, antennas, cameras. Millimetres, z up, the front faces -y."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.toy_objects.images import icons, keys, liquid_crystal
from pipeline.toy_objects.paint import Color, Material, Model, chance, pick
from pipeline.toy_objects.shapes import Solid, ball, revolve, rod, rounded_box
from pipeline.toy_objects.vessel import body

Rng = np.random.Generator
WHITE: Color = (255, 255, 255)
SHELLS: tuple[Color, ...] = (
    (34, 36, 40),
    (60, 66, 78),
    (178, 182, 188),
    (36, 62, 116),
    (150, 34, 44),
    (226, 226, 222),
    (92, 112, 96),
)
BRIGHT: tuple[Color, ...] = ((214, 60, 120), (70, 150, 210), (120, 180, 70), (232, 140, 40), (196, 168, 110))
CHROME: tuple[Color, ...] = ((196, 200, 206), (160, 164, 172))
BLACK: Color = (22, 22, 24)
PLATE = 5.0  # depth of screens and keys, most of it sunk in the shell
DIAL = ("123", "456", "789", "*0#")


def plate(x: float, z: float, size: Sequence[float], front: float, proud: float, corner: float = 2.0, steps: int = 4) -> Solid:
    """Small slab of `size` (width, height) let into a front at y = -front, `proud` of it; a picture fills it."""
    solid = rounded_box((size[0], PLATE, size[1]), corner, min(0.6, 0.4 * proud + 0.15), "y", steps)
    return solid.moved(x, -front + PLATE / 2.0 - proud, z).projected("x", "z")


def button(x: float, z: float, radii: Sequence[float], front: float, proud: float, count: int = 24) -> Solid:
    """Oval button let into a front."""
    rows = [(-front - proud, 0.86), (-front - 0.6 * proud, 0.97), (-front - 0.3 * proud, 1.0), (-front + PLATE, 1.0)]
    solid = revolve(rows, "y", count)
    return Solid(solid.vertices * [radii[0], 1.0, radii[1]], solid.faces, solid.uv).moved(x, 0.0, z)


def keypad(
    model: Model,
    rng: Rng,
    area: Sequence[float],
    front: float,
    legends: Sequence[str] = DIAL,
    round_keys: bool | None = None,
) -> None:
    """Rows of keys with their legends over `area` (width, low z, high z)."""
    width, low, high = area
    face = np.array(((40, 42, 48), (206, 208, 210), (232, 230, 224), (88, 96, 110))[rng.integers(4)])
    ink = (245, 245, 240) if face.sum() < 380 else (24, 28, 40)
    material = Material(WHITE, keys(legends, face.tolist(), ink))
    rows, columns = len(legends), max(map(len, legends))
    pitch, tall = width / columns, (high - low) / rows
    fill = rng.uniform(0.74, 0.9)
    oval = chance(rng, 0.35) if round_keys is None else round_keys
    steps = 4 if rows * columns < 20 else 1  # a keyboard's many keys are small
    corner = rng.uniform(0.15, 0.5) * min(pitch, tall)
    size = (fill * pitch, fill * tall)
    half = (size[0] / 2.0, size[1] / 2.0)
    cap = button(0, 0, half, front, 1.3, 16) if oval else plate(0, 0, size, front, 1.3, corner, steps)
    for row in range(rows):
        for column in range(columns):
            window = (column / columns, 1 - (row + 1) / rows, (column + 1) / columns, 1 - row / rows)
            key = cap.moved((column + 0.5) * pitch - width / 2.0, 0.0, high - (row + 0.5) * tall)
            model.add(material, key.projected("x", "z", window))


def navigation(model: Model, rng: Rng, z: float, width: float, front: float) -> None:
    """Call keys and a pad, ring or stick between them, around height z."""
    trim, dark = pick(rng, *CHROME, *SHELLS), pick(rng, BLACK, *SHELLS)
    r = rng.uniform(0.13, 0.17) * width
    model.add(trim, button(0, z, (1.25 * r, r), front, 1.4))
    model.add(dark, button(0, z, (0.55 * r, 0.5 * r), front, 2.1, 16))
    for side in (-1, 1):
        x = side * 0.34 * width
        model.add(dark, plate(x, z + 0.55 * r, (0.2 * width, 0.62 * r), front, 1.2, 1.2))
        call = pick(rng, (50, 160, 70)) if side < 0 else pick(rng, (196, 44, 44))
        model.add(call, plate(x, z - 0.5 * r, (0.2 * width, 0.62 * r), front, 1.2, 1.2))


def display(rng: Rng) -> Material:
    """A lit screen of the old kind, green, blue, grey or amber, or of the new."""
    if chance(rng, 0.3):
        return Material(WHITE, icons(rng))
    grounds = ((150, 176, 96), (120, 180, 226), (190, 196, 186), (226, 160, 70))
    return Material(WHITE, liquid_crystal(rng, grounds[rng.integers(len(grounds))], (24, 34, 30)))


def screen(model: Model, rng: Rng, z: float, size: Sequence[float], front: float, image: Material | None = None) -> None:
    """A dark pane with a picture a little smaller in it, an earpiece slot not included."""
    rim = rng.uniform(1.5, 3.5)
    model.add(
        pick(rng, BLACK, (46, 50, 58)),
        plate(0, z, (size[0] + 2 * rim, size[1] + 2 * rim), front, 0.5, rng.uniform(2, 5)),
    )
    model.add(image or display(rng), plate(0, z, size, front, 0.9, 1.0))


def earpiece(model: Model, rng: Rng, z: float, front: float) -> None:
    """A slot, or a row of holes' rims, above the screen."""
    dark = pick(rng, BLACK, (70, 72, 78))
    if chance(rng, 0.5):
        model.add(dark, plate(0, z, (rng.uniform(9, 14), 2.2), front, 0.5, 1.0))
    else:
        model.add(dark, *(button(x, z, (1.1, 1.1), front, 0.7, 8) for x in np.linspace(-6, 6, int(rng.integers(3, 6)))))


def side_keys(model: Model, rng: Rng, width: float, low: float, high: float) -> None:
    """Volume and power on the flanks."""
    metal = pick(rng, *CHROME, *SHELLS)
    for side, share in ((-1, 0.72), (-1, 0.84), (1, 0.78)):
        if chance(rng, 0.8):
            key = rounded_box((4, 3.0, rng.uniform(7, 12)), 1.2, 0.6, "x", 3)
            model.add(metal, key.moved(x=side * (width / 2 - 1.2), z=low + share * (high - low)))


def antenna(model: Model, rng: Rng, x: float, z: float, y: float = 0.0, long: float | None = None) -> None:
    """Stub or whip on the top edge, standing on height z."""
    tall, r = long or rng.uniform(14, 34), rng.uniform(3.2, 4.4)
    rows = [(z - 8, 1.15 * r), (z + 2, 1.1 * r), (z + 4, 0.9 * r), (z + tall - 3, 0.8 * r), (z + tall, 0.45 * r)]
    model.add(pick(rng, BLACK, *SHELLS), revolve(rows, count=18).moved(x, y))
    if chance(rng, 0.4):
        model.add(
            pick(rng, *CHROME),
            rod(z + tall - 2, z + tall + 12, 1.9, "z", count=10).moved(x, y),
            ball((2.6, 2.6, 3), 12).moved(x, y, z + tall + 13),
        )


def back_camera(model: Model, rng: Rng, x: float, z: float, back: float) -> None:
    """Bump with one to three lenses and a flash on a back at y = back."""
    count, pitch = int(rng.integers(1, 4)), rng.uniform(11, 14)
    bump = rounded_box((pitch + 3, 6, count * pitch + 5), 5, 1.2)
    model.add(pick(rng, *SHELLS), bump.moved(x, back - 1.0, z))
    for i in range(count):
        at = z + (i - (count - 1) / 2) * pitch
        model.add(pick(rng, *CHROME), rod(back - 2, back + 3.4, 0.42 * pitch, "y", 0.12, 20).moved(x, 0, at))
        model.add(pick(rng, (16, 20, 34), spread=4), rod(back - 2, back + 4.0, 0.3 * pitch, "y", 0.3, 16).moved(x, 0, at))
    model.add(pick(rng, (250, 240, 200)), rod(back - 2, back + 0.9, 2.2, "y", 0.3, 12).moved(-x, 0, z))


def shell(rng: Rng, w: float, h: float, t: float) -> Solid:
    """Old-style body standing on z = 0: width varies with height, flat front, rounded ends."""
    top, waist, foot = rng.uniform(0.86, 1.0), rng.uniform(0.9, 1.0), rng.uniform(0.8, 1.0)
    a, b, n = w / 2, t / 2, rng.uniform(4.5, 8)
    rows = [(0, 0.7 * foot * a, 0.72 * b, n), (0.025 * h, 0.9 * foot * a, 0.94 * b, n), (0.07 * h, foot * a, b, n)]
    rows += [
        (0.5 * h, waist * a, b, n),
        (0.93 * h, top * a, b, n),
        (0.975 * h, 0.9 * top * a, 0.94 * b, n),
        (h, 0.7 * top * a, 0.72 * b, n),
    ]
    return body(rows)
