"""Small texture images: bottle labels and phone screens, drawn from the rng."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont, ImageOps

from pipeline.contrib.toy_objects.model import Palette
from pipeline.contrib.toy_objects.solids import Material

WORDS = ("OAK", "RIO", "MINT", "NOVA", "ALPS", "REX", "LUNA", "BLUE", "ZEST", "VITA", "KIWI", "FOX")
PAPERS: Palette = ((242, 234, 212), (250, 250, 250), (30, 30, 36), (214, 190, 132), (120, 26, 34))
ACCENTS: Palette = ((176, 32, 44), (24, 92, 160), (196, 152, 48), (36, 128, 72), (232, 112, 32))
DISPLAYS: Palette = ((150, 176, 96), (120, 180, 226), (190, 196, 186), (226, 160, 70))


def textured(image: Image.Image) -> Material:
    """Make the material that shows an image."""
    return Material((255, 255, 255), np.array(image.convert("RGBA")))


def write(image: Image.Image, centre: tuple[float, float], height: float, word: str) -> None:
    """Write a word about `centre` (column, row), `height` pixels high: dark on a light ground, else light."""
    ground = np.array(image.getpixel((int(centre[0]), int(centre[1]))))
    ink = (24, 26, 34) if ground.sum() > 380 else (244, 240, 228)
    ImageDraw.Draw(image).text(centre, word, ink, ImageFont.load_default(int(height)), anchor="mm")


def draw_time(rng: np.random.Generator) -> str:
    """Draw what a clock shows."""
    return f"{rng.integers(10, 24)}:{rng.integers(10, 60)}"


def label(rng: np.random.Generator, aspect: float) -> Material:
    """Draw a bottle label `aspect` times as wide as it is high: border, brand, emblem, small print."""
    paper, accent = PAPERS[rng.integers(len(PAPERS))], ACCENTS[rng.integers(len(ACCENTS))]
    width, edge = int(np.clip(96 * aspect, 48, 384)), int(rng.integers(3, 9))
    image = ImageOps.expand(Image.new("RGB", (width, 96 - 2 * edge), paper), (0, edge), accent)
    draw, middle = ImageDraw.Draw(image), width // 2
    write(image, (middle, 27), min(34, 0.3 * width), str(rng.choice(WORDS)))
    draw.regular_polygon((middle, 58, 16), int(rng.choice((3, 4, 6, 40))), float(rng.choice((0, 45))), accent)
    draw.rectangle((0.15 * width, 78, width * rng.uniform(0.6, 0.85), 81), accent)
    return textured(image)


def home_screen(rng: np.random.Generator, width: int, height: int) -> Image.Image:
    """Draw a lit screen: wallpaper, clock, rows of icons."""
    top, bottom = (tuple(color) for color in rng.integers(20, 200, (2, 3)).tolist())
    image = ImageOps.colorize(Image.linear_gradient("L").resize((width, height)), top, bottom)
    draw, side, pitch = ImageDraw.Draw(image), min(width, height), width // int(rng.integers(3, 6))
    write(image, (width // 2, 0.15 * side + 6), 0.2 * side, draw_time(rng))
    for row in range(int(0.28 * side) + 6, height - int(0.8 * pitch), pitch):
        for left in range(pitch // 6, width - int(0.6 * pitch), pitch):
            draw.rectangle((left, row, left + 0.66 * pitch, row + 0.66 * pitch), tuple(rng.integers(40, 256, 3).tolist()))
    return image


def liquid_crystal(rng: np.random.Generator, width: int, height: int) -> Image.Image:
    """Draw an old phone's display: signal and battery bars, a word, the time."""
    image = Image.new("RGB", (width, height), DISPLAYS[rng.integers(len(DISPLAYS))])
    for low in np.linspace(0.9, 0.33, 4) * height:
        for left in (0.03 * width, 0.91 * width):
            ImageDraw.Draw(image).rectangle((left, low - 0.13 * height, left + 0.06 * width, low), (24, 34, 30))
    write(image, (width // 2, 0.32 * height), min(0.36 * height, 0.28 * width), str(rng.choice(WORDS)))
    write(image, (width // 2, 0.7 * height), min(0.3 * height, 0.22 * width), draw_time(rng))
    return image
