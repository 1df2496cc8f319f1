"""Small texture images drawn by seed: bottle labels, phone screens, key caps.

All are (height, width, 4) uint8, first row at the top.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Color = Sequence[int]

# 3 x 5 glyphs: five octal digits, one a row, the highest bit leftmost.
GLYPHS = dict(
    pair.split("=")
    for pair in [
        "0=75557",
        "1=26227",
        "2=71747",
        "3=71717",
        "4=55711",
        "5=74717",
        "6=74757",
        "7=71122",
        "8=75757",
        "9=75717",
        "*=05250",
        "#=57575",
        ":=02020",
        "A=25755",
        "B=65656",
        "C=34443",
        "D=65556",
        "E=74647",
        "F=74644",
        "G=34553",
        "H=55755",
        "I=72227",
        "J=11152",
        "K=55655",
        "L=44447",
        "M=57755",
        "N=65555",
        "O=25552",
        "P=65644",
        "Q=25563",
        "R=65655",
        "S=34216",
        "T=72222",
        "U=55557",
        "V=55552",
        "W=55775",
        "X=55255",
        "Y=55222",
        "Z=71247",
    ]
)
WORDS = ("OAK", "RIO", "MINT", "NOVA", "ALPS", "REX", "LUNA", "BLUE", "ZEST", "VITA", "KIWI", "FOX")


def canvas(height: int, width: int, color: Color) -> Image:
    """An image of one opaque colour."""
    image = np.full((height, width, 4), 255, np.uint8)
    image[..., :3] = color
    return image


def write(image: Image, text: str, row: int, column: int, scale: int, color: Color) -> None:
    """Write `text` with its upper left corner at (row, column), every glyph pixel `scale` image pixels wide."""
    for i, letter in enumerate(text):
        bits = [[int(digit) >> shift & 1 for shift in (2, 1, 0)] for digit in GLYPHS.get(letter, "00000")]
        stamp = np.kron(np.array(bits, bool), np.ones((scale, scale), bool))
        left = column + 4 * scale * i
        patch = image[row : row + stamp.shape[0], left : left + stamp.shape[1], :3]
        patch[stamp[: patch.shape[0], : patch.shape[1]]] = color


def small_print(image: Image, rng: np.random.Generator, top: int, bottom: int, color: Color) -> None:
    """Rows of dashes that read as text too small to read, three pixels a row."""
    width = image.shape[1]
    for row in range(top, bottom - 1, 3):
        inked = np.repeat(rng.random(width // 4 + 1) < 0.75, 4)[:width]
        inked[: width // 8] = inked[-(width // 8) :] = False
        image[row, inked, :3] = color


def label(rng: np.random.Generator, paper: Color, ink: Color, accent: Color, aspect: float) -> Image:
    """A bottle label, 96 rows high and `aspect` times as wide (64 to 384): border, brand, emblem, small print."""
    height, width = 96, int(np.clip(96 * aspect, 64, 384))
    image = canvas(height, width, paper)
    edge = int(rng.integers(3, 9))
    image[:edge, :, :3] = image[-edge:, :, :3] = accent
    image[edge + 2 : edge + 4, :, :3] = ink
    word = WORDS[rng.integers(len(WORDS))]
    scale = min(6, (width - 8) // (4 * len(word)))
    write(image, word, 18, (width - 4 * scale * len(word)) // 2, scale, ink)
    row, column = np.mgrid[:height, :width]
    y, x = (row - 62) / 14.0, (column - width / 2) / 14.0
    bands = (np.abs(y) < 0.45) & (np.abs(x) < 2.0)
    emblems = (x**2 + y**2 < 1.0, np.abs(x) + np.abs(y) < 1.2, bands, np.abs(x) < 0.8 * (y + 1.0))
    emblem = emblems[rng.integers(len(emblems))] & (np.abs(y) < 1.2)
    image[emblem, :3] = accent
    small_print(image, rng, 79, height - edge - 2, ink)
    return image


def icons(rng: np.random.Generator) -> Image:
    """A smartphone's home screen, 160 x 80: wallpaper, clock, rows of icons, dock."""
    height, width = 160, 80
    top, bottom = rng.integers(20, 200, (2, 3))
    fade = np.linspace(0.0, 1.0, height)[:, None, None]
    image = canvas(height, width, (0, 0, 0))
    image[..., :3] = (top * (1.0 - fade) + bottom * fade).astype(np.uint8)
    write(image, f"{rng.integers(10, 24)}:{rng.integers(10, 60)}", 14, 11, 3, (255, 255, 255))
    columns = int(rng.integers(3, 6))
    pitch = width // columns
    size = int(0.68 * pitch)
    for row in [*range(46, height - 2 * pitch - 4, pitch + 3), height - pitch - 2]:
        for column in range(columns):
            left = column * pitch + (pitch - size) // 2
            image[row : row + size, left : left + size, :3] = rng.integers(40, 256, 3)
    return image


def liquid_crystal(rng: np.random.Generator, ground: Color, ink: Color) -> Image:
    """An old phone's display, 64 x 84: signal and battery bars, a word, the time."""
    image = canvas(64, 84, ground)
    for bar in range(4):
        image[58 - 11 * (bar + 1) : 55 - 11 * bar, 3 : 6 + 2 * bar, :3] = ink
        image[58 - 11 * (bar + 1) : 55 - 11 * bar, 78 - 2 * bar : 81, :3] = ink
    word = WORDS[rng.integers(len(WORDS))]
    write(image, word, 10, 42 - 6 * len(word), 3, ink)
    write(image, f"{rng.integers(10, 24)}:{rng.integers(10, 60)}", 34, 22, 2, ink)
    write(image, "MENU", 54, 34, 1, ink)
    return image


def keys(legends: Sequence[str], face: Color, ink: Color) -> Image:
    """An atlas of key caps, one string of `legends` a row and one letter a cell of 16 x 20."""
    image = canvas(16 * len(legends), 20 * max(map(len, legends)), face)
    for row, line in enumerate(legends):
        for column, letter in enumerate(line):
            write(image, letter, 16 * row + 3, 20 * column + 7, 2, ink)
    return image
