"""Small texture images: bottle labels and phone screens, drawn from the rng."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from pipeline.toy_objects.model import Color, Material, Palette, Rng

WHITE: Color = (255, 255, 255)
WORDS = ("OAK", "RIO", "MINT", "NOVA", "ALPS", "REX", "LUNA", "BLUE", "ZEST", "VITA", "KIWI", "FOX")
PAPERS: Palette = ((242, 234, 212), (250, 250, 250), (30, 30, 36), (214, 190, 132), (120, 26, 34))
ACCENTS: Palette = ((176, 32, 44), (24, 92, 160), (196, 152, 48), (36, 128, 72), (232, 112, 32))
DISPLAYS: Palette = ((150, 176, 96), (120, 180, 226), (190, 196, 186), (226, 160, 70))


def textured(image: Image.Image) -> Material:
    """Make the material that shows an image."""
    array: NDArray[np.uint8] = np.array(image.convert("RGBA"))
    return Material(WHITE, array)


def write(image: Image.Image, centre: tuple[float, float], height: int, word: str, color: Color) -> None:
    """Write a word about `centre` (column, row), `height` pixels high."""
    ImageDraw.Draw(image).text(centre, word, color, _font(height), anchor="mm")


@cache
def _font(height: int) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(height)
    assert isinstance(font, ImageFont.FreeTypeFont)
    return font.font_variant(layout_engine=ImageFont.Layout.BASIC)  # the other engine depends on the machine's libraries


def _word(rng: Rng) -> str:
    return WORDS[rng.integers(len(WORDS))]


def _clock(rng: Rng) -> str:
    return f"{rng.integers(10, 24)}:{rng.integers(10, 60)}"


def label(rng: Rng, aspect: float) -> Material:
    """Draw a bottle label `aspect` times as wide as it is high: border, brand, emblem, small print."""
    paper, accent = PAPERS[rng.integers(len(PAPERS))], ACCENTS[rng.integers(len(ACCENTS))]
    ink = (24, 24, 28) if sum(paper) > 380 else (240, 228, 190)  # dark on light paper, else light on dark
    width, edge = int(np.clip(96 * aspect, 48, 384)), int(rng.integers(3, 9))
    image = Image.new("RGB", (width, 96), paper)
    draw, middle = ImageDraw.Draw(image), width // 2
    draw.rectangle((0, 0, width, edge), accent)
    draw.rectangle((0, 95 - edge, width, 95), accent)
    write(image, (middle, 27), min(34, int(0.3 * width)), _word(rng), ink)
    corners = ([(-15, 0), (0, -15), (15, 0), (0, 15)], [(-15, 13), (0, -13), (15, 13)], [(-26, -7), (26, -7), (26, 7), (-26, 7)])
    shape = rng.integers(4)
    if shape == 3:
        draw.ellipse((middle - 14, 46, middle + 14, 74), accent)
    else:
        draw.polygon([(middle + x, 60 + y) for x, y in corners[shape]], accent)
    for row in (79, 83):
        draw.line((0.15 * width, row, width * rng.uniform(0.6, 0.85), row), ink)
    return textured(image)


def home_screen(rng: Rng, width: int, height: int) -> Image.Image:
    """Draw a lit screen: wallpaper, clock, rows of icons."""
    top, bottom = rng.integers(20, 200, (2, 1, 3))
    fade = np.linspace(0.0, 1.0, height)[:, None]
    column = (top * (1.0 - fade) + bottom * fade).astype(np.uint8)
    image = Image.fromarray(np.ascontiguousarray(np.broadcast_to(column[:, None], (height, width, 3))))
    write(image, (width // 2, 0.15 * min(width, height) + 6), int(0.2 * min(width, height)), _clock(rng), WHITE)
    pitch = width // int(rng.integers(3, 6))
    draw = ImageDraw.Draw(image)
    for row in range(int(0.28 * min(width, height)) + 6, height - int(0.8 * pitch), pitch):
        for left in range(pitch // 6, width - int(0.6 * pitch), pitch):
            draw.rectangle((left, row, left + 0.66 * pitch, row + 0.66 * pitch), tuple(rng.integers(40, 256, 3).tolist()))
    return image


def liquid_crystal(rng: Rng, width: int, height: int) -> Image.Image:
    """Draw an old phone's display: signal and battery bars, a word, the time."""
    ink = (24, 34, 30)
    image = Image.new("RGB", (width, height), DISPLAYS[rng.integers(len(DISPLAYS))])
    draw = ImageDraw.Draw(image)
    for bar in range(4):
        low = height * (0.9 - 0.19 * bar)
        for left, right in ((0.03, 0.05 + 0.02 * bar), (0.95 - 0.02 * bar, 0.97)):
            draw.rectangle((left * width, low - 0.13 * height, right * width, low), ink)
    write(image, (width // 2, 0.32 * height), int(min(0.36 * height, 0.28 * width)), _word(rng), ink)
    write(image, (width // 2, 0.7 * height), int(min(0.3 * height, 0.22 * width)), _clock(rng), ink)
    return image
