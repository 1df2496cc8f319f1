"""Sheets of captioned pictures in rows, as PNG files."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont, ImageOps

from pipeline.drawing.colors import Color, depth_colors
from pipeline.kernels.touch.sensor import Sensor

T = TypeVar("T")

PAGE = 8  # rows per page
PICTURE, GAP, MARGIN, LINE, HEAD = 256, 8, 24, 20, 84
"""Pixels: the height of a row's pictures, between things, around a page, a line of text, a page's head."""
INK, FAINT, PAPER, RULE = (34, 34, 38), (120, 120, 128), (255, 255, 255), (222, 222, 226)


class Tile(NamedTuple):
    """One or two square pictures below each other, with a caption above."""

    caption: str
    pictures: Sequence[NDArray[np.uint8]]  # (rows, cols, 3)
    note: str = ""  # below
    dot: Color | None = None  # before the caption
    filled: bool = False  # the dot


class SheetRow(NamedTuple):
    """A row of tiles below a title and a note."""

    title: str
    note: str
    tiles: Sequence[Tile]


def spread_evenly(items: Sequence[T], limit: int) -> list[T]:
    """Choose at most `limit` items, spread evenly from the first to the last."""
    return [items[number] for number in np.linspace(0, len(items) - 1, min(limit, len(items))).astype(int)]


def draw_sheet(
    rows: Sequence[SheetRow],
    path: Path,
    *,
    title: str,
    note: str,
    sensor: Sensor | None = None,  # gives the legend of depth maps
    page: int = PAGE,  # rows
) -> list[Path]:  # `path`, NAME-2.png, NAME-3.png, …
    """Draw rows of tiles on as many pages as needed."""
    if not rows:
        raise ValueError("a sheet without rows: no object of this dataset has been processed through all stages")
    pages = [rows[start : start + page] for start in range(0, len(rows), page)]
    files = []
    for number, shown in enumerate(pages, start=1):
        files.append(path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}"))
        width = 2 * MARGIN + max(sum(_side(tile) + GAP for tile in row.tiles) for row in shown)
        image = Image.new("RGB", (width, HEAD + sum(map(_height, shown)) + MARGIN), PAPER)
        pencil, top = ImageDraw.Draw(image), HEAD
        pencil.text((MARGIN, MARGIN - 4), title if len(pages) == 1 else f"{title}   {number} / {len(pages)}", INK, _font(20, bold=True))
        pencil.text((MARGIN, MARGIN + 24), note, FAINT, _font(13))
        if sensor is not None:
            _legend(image, sensor)
        for row in shown:
            _draw_row(image, pencil, top, row)
            top += _height(row)
        image.save(files[-1], optimize=True)
    return files


def _side(tile: Tile) -> int:
    """Compute the side of a tile's pictures: two have a line for the note below them."""
    return PICTURE if len(tile.pictures) == 1 else (PICTURE - LINE) // 2 - 1


def _height(row: SheetRow) -> int:
    noted = any(tile.note and len(tile.pictures) == 1 for tile in row.tiles)
    return LINE * (2 + noted) + PICTURE + 2 * GAP


def _draw_row(page: Image.Image, pencil: ImageDraw.ImageDraw, top: int, row: SheetRow) -> None:
    pencil.line([(MARGIN, top), (page.width - MARGIN, top)], fill=RULE)
    pencil.text((MARGIN, top + 4), row.title, INK, _font(13, bold=True))
    pencil.text((MARGIN + pencil.textlength(row.title, _font(13, bold=True)) + 12, top + 4), row.note, FAINT, _font(13))
    left, caption = MARGIN, top + LINE + 3
    for tile in row.tiles:
        indent, ink, side, below = 0, INK if tile.filled else FAINT, _side(tile), top + 2 * LINE + 2
        if tile.dot:
            pencil.ellipse([left, caption + 3, left + 8, caption + 11], tile.dot if tile.filled else PAPER, tile.dot, 2)
            indent = 13
        pencil.text((left + indent, caption), tile.caption, ink, _font(11, bold=tile.filled))
        for picture in tile.pictures:
            page.paste(scaled(picture, side), (left, below))
            below += side + 3
        pencil.text((left, below), tile.note, ink, _font(11))
        left += side + GAP


def _legend(page: Image.Image, sensor: Sensor) -> None:
    """Draw the colours of depth maps, their left end at 0 and their right end at the range."""
    pencil, small = ImageDraw.Draw(page), _font(11)
    inside, beyond, right = 160, 80, page.width - MARGIN
    left = right - inside - beyond
    ramp = np.concatenate([np.linspace(0, sensor.w, inside, endpoint=False), np.linspace(sensor.w, sensor.range, beyond)])
    colors = depth_colors(ramp[None], sensor.model_copy(update={"surface": None}))  # as in the middle of a curved gel
    page.paste(Image.fromarray(np.repeat(colors, 10, axis=0)), (left, MARGIN + 20))
    pencil.text((left, MARGIN), "depth, mm", FAINT, small)
    ends = ((left, "0", "la"), (left + inside, f"gel {sensor.w * 1e3:.1f}", "ma"), (right, f"{sensor.range * 1e3:.0f}", "ra"))
    for x, text, anchor in ends:
        pencil.text((x, MARGIN + 34), text, FAINT, small, anchor=anchor)


def scaled(
    image: NDArray[np.uint8],  # (rows, cols, 3)
    side: int,
) -> Image.Image:
    """Scale an image into a square, with white borders if it is not square."""
    picture = Image.fromarray(np.ascontiguousarray(image))
    return picture if picture.size == (side, side) else ImageOps.pad(picture, (side, side), Image.Resampling.LANCZOS, color=PAPER)


def _font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Load DejaVu Sans, which comes with matplotlib, so that every machine has it."""
    import matplotlib

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)
