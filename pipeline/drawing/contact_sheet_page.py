"""The pages of a contact sheet: per object one band of images, tactile images and depth maps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont, ImageOps

from pipeline.kernels.touch.depth_maps import in_gel
from pipeline.kernels.touch.sensor import Sensor

Color = tuple[int, int, int]
T = TypeVar("T")

COLORS: tuple[Color, ...] = ((0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 60, 140), (86, 180, 233), (213, 94, 0))
"""One colour per finger (after Okabe and Ito: told apart by the colour-blind too); they repeat beyond six."""

PAGE = 8
"""Objects per page."""

PICTURE, TILE, GAP, MARGIN, TITLE, HEAD = 256, 117, 8, 24, 20, 84
"""Pixels: a picture's side (unscaled), a tactile image's, between things, around the page, a line of titles, the page's head."""

BAND = 2 * TITLE + PICTURE + 2 * GAP
"""Pixels: a band's height."""

INK, FAINT, PAPER, RULE = (34, 34, 38), (120, 120, 128), (255, 255, 255), (222, 222, 226)
MISS, BEYOND = np.array([250, 250, 250]), (np.array([205, 205, 210]), np.array([238, 238, 240]))
"""Where a depth map meets nothing; and, near to far, where it meets something beyond the gel."""


@dataclass(frozen=True)
class Band:
    """Hold the content of a sheet for one object in one grasp."""

    title: str  # the object's name and size
    note: str  # a line about the grasp: its touches, how deep rigid parts are in the object, …
    pictures: Sequence[tuple[str, NDArray[np.uint8]]]  # captions and (R, R, 3) images, left to right
    fingers: Sequence[str]  # (S,) names
    touched: NDArray[np.bool_]  # (S,) M
    tactile_images: NDArray[np.uint8]  # (S, H, W, 3) R
    depths: NDArray[np.float32]  # (S, H, W) D, m; +inf where nothing is met


def spread_evenly(items: Sequence[T], limit: int) -> list[T]:
    """Choose at most `limit` items, spread evenly from the first to the last."""
    return [items[place] for place in np.linspace(0, len(items) - 1, min(limit, len(items))).astype(int)]


def finger_colors(count: int) -> list[Color]:
    """List the colours of that number of fingers."""
    return [COLORS[k % len(COLORS)] for k in range(count)]


def draw(bands: Sequence[Band], path: Path, sensors: Sequence[Sensor], *, title: str, note: str) -> list[Path]:
    """Draw the bands on as many pages as needed; return the PNG files: `path`, then NAME-2.png, NAME-3.png, ….

    Each page has a title and a line of statistics. Thickness of gel and range of the sensors give the depth maps'
    colours.
    """
    if not bands:
        raise ValueError("a contact sheet of no objects: no object of this dataset has been processed through all stages")
    pages = [bands[start : start + PAGE] for start in range(0, len(bands), PAGE)]
    files = []
    for number, page in enumerate(pages, start=1):
        file = path if number == 1 else path.with_name(f"{path.stem}-{number}{path.suffix}")
        heading = title if len(pages) == 1 else f"{title}   {number} / {len(pages)}"
        _page(page, sensors, heading, note).save(file, optimize=True)
        files.append(file)
    return files


def depth_colors(depth: NDArray[np.floating], sensor: Sensor) -> NDArray[np.uint8]:
    """Colour a depth map (H, W): viridis in the gel (bright is deep), greys from there to the range, white where nothing is met."""
    gel, reach, met = sensor.w, sensor.range, np.isfinite(depth)
    table = matplotlib.colormaps["viridis"](np.linspace(1, 0, 256))[:, :3] * 255
    near, far = BEYOND
    share = np.clip((np.where(met, depth, reach) - gel) / (reach - gel or 1), 0, 1)[..., None]  # the range may end with the gel
    colors = np.where(met[..., None], near + (far - near) * share, MISS)
    inside = in_gel(depth, sensor)
    colors[inside] = table[np.clip(depth[inside] / gel * 255, 0, 255).astype(int)]
    return np.round(colors).astype(np.uint8)


def _page(bands: Sequence[Band], sensors: Sequence[Sensor], title: str, note: str) -> Image.Image:
    pictures, fingers = max(len(band.pictures) for band in bands), max(len(band.fingers) for band in bands)
    width = 2 * MARGIN + pictures * (PICTURE + GAP) + fingers * (TILE + GAP)
    page = Image.new("RGB", (width, HEAD + len(bands) * BAND + MARGIN), PAPER)
    pencil = ImageDraw.Draw(page)
    pencil.text((MARGIN, MARGIN - 4), title, INK, _font(20, bold=True))
    pencil.text((MARGIN, MARGIN + 24), note, FAINT, _font(13))
    _legend(page, sensors[0])
    for row, band in enumerate(bands):
        _band(page, HEAD + row * BAND, band, sensors)
    return page


def _band(page: Image.Image, top: int, band: Band, sensors: Sequence[Sensor]) -> None:
    pencil = ImageDraw.Draw(page)
    pencil.line([(MARGIN, top), (page.width - MARGIN, top)], fill=RULE)
    pencil.text((MARGIN, top + 4), band.title, INK, _font(13, bold=True))
    shift = pencil.textlength(band.title, _font(13, bold=True))
    pencil.text((MARGIN + shift + 12, top + 4), band.note, FAINT, _font(13))
    caption, body = top + TITLE + 3, top + 2 * TITLE + 2
    left = MARGIN
    for text, image in band.pictures:
        pencil.text((left, caption), text, FAINT, _font(11))
        page.paste(_scaled(image, PICTURE), (left, body))
        left += PICTURE + GAP
    fingers = zip(band.fingers, finger_colors(len(band.fingers)), band.touched, band.tactile_images, band.depths, sensors, strict=True)
    for name, color, touched, image, depth, sensor in fingers:
        ink = INK if touched else FAINT
        pencil.ellipse([left, caption + 3, left + 8, caption + 11], fill=color if touched else PAPER, outline=color, width=2)
        pencil.text((left + 13, caption), name, ink, _font(11, bold=touched))
        page.paste(_scaled(image, TILE), (left, body))
        page.paste(_scaled(depth_colors(depth, sensor), TILE), (left, body + TILE + 3))
        pencil.rectangle([left - 1, body + TILE + 2, left + TILE, body + 2 * TILE + 3], outline=RULE)
        pencil.text((left, body + 2 * TILE + 6), depth_note(touched, 1e3 * float(depth.min())), ink, _font(11))
        left += TILE + GAP


def enlarged(image: NDArray[np.uint8], masks: NDArray[np.bool_]) -> tuple[NDArray[np.uint8], str]:
    """Crop a camera image (R, C, 3) to the masks (view, R, C), if less than half as large; return the factor as text."""
    row, col = surroundings(masks)
    side = max(row.stop - row.start, col.stop - col.start)
    return (image[row, col], f", enlarged {image.shape[0] / side:.1f} ×") if 0 < 2 * side <= image.shape[0] else (image, "")


def surroundings(masks: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Find the square part of images around all of these masks (view, row, col); it is empty if the masks are."""
    pixels = np.argwhere(masks.any(axis=0))
    if not len(pixels):
        return slice(0, 0), slice(0, 0)
    middle, reach = (pixels.min(axis=0) + pixels.max(axis=0)) // 2, int(np.ptp(pixels, axis=0).max() * 0.6) + 1
    row, col = (slice(max(0, at - reach), at + reach) for at in middle)
    return row, col


def size_note(surface: Mapping[str, NDArray[Any]]) -> str:
    """Describe an object's size, along x, y and z, from its row of `surfaces`."""
    return f"{' × '.join(f'{100 * extent:.3g}' for extent in np.ptp(surface['meshes/vertices'], axis=0))} cm"


def grasp_note(row: Mapping[str, NDArray[Any]], grasp: int) -> str:
    """Describe a grasp, from an object's row of `grasps`: touches, penetration, contacts, force closure, hold test."""
    touched = row["touch_success"][grasp]
    note = f"{touched.sum()} of {len(touched)} sensors touch; rigid parts at most {1e3 * float(row['penetration'][grasp]):.2f} mm inside"
    if "closure" in list(row):
        angle, margin, area = (float(np.sum(row[name][grasp])) for name in ("opposition", "closure", "contact_area"))
        closed = f"force-closed with margin {margin:.2f}" if margin > 0 else "not force-closed"
        note += f"; {1e6 * area:.0f} mm² of contact, normals up to {angle:.0f}° apart; {closed}"
    if "held" in list(row):
        note += f"; {'held' if row['held'][grasp] else 'dropped'} in the hold test"
    if "held_directions" in list(row):
        note += f", in {row['held_directions'][grasp].sum()} of 6 directions"
    return note


def depth_note(touched: bool, nearest: float) -> str:
    """Describe the point of a sensor's depth map that is nearest to the sensor plane, at `nearest` mm."""
    if not np.isfinite(nearest):
        return "nothing in range"
    return f"touch · {nearest:.1f} mm" if touched else f"no touch · {nearest:.1f} mm"


def _legend(page: Image.Image, sensor: Sensor) -> None:
    """Draw the depth maps' colours, their left end at 0 and their right end at the range; of the first finger's sensor."""
    pencil, small = ImageDraw.Draw(page), _font(11)
    inside, beyond, high = 160, 80, 10
    right, top = page.width - MARGIN, MARGIN
    left = right - inside - beyond
    ramp = np.concatenate([np.linspace(0, sensor.w, inside, endpoint=False), np.linspace(sensor.w, sensor.range, beyond)])
    colors = depth_colors(ramp[None], sensor.model_copy(update={"surface": None}))  # as in the middle of a curved gel
    page.paste(Image.fromarray(np.repeat(colors, high, axis=0)), (left, top + 20))
    pencil.text((left, top), "depth, mm", FAINT, small)
    gel, reach = f"gel {sensor.w * 1e3:.1f}", f"{sensor.range * 1e3:.0f}"
    for x, text, anchor in ((left, "0", "la"), (left + inside, gel, "ma"), (right, reach, "ra")):
        pencil.text((x, top + 34), text, FAINT, small, anchor=anchor)


def _scaled(image: NDArray[np.uint8], side: int) -> Image.Image:
    """Scale an image (R, C, 3) into a square, with white borders if it is not square."""
    picture = Image.fromarray(np.ascontiguousarray(image))
    return picture if picture.size == (side, side) else ImageOps.pad(picture, (side, side), Image.Resampling.LANCZOS, color=PAPER)


def _font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """Load DejaVu Sans, which comes with matplotlib, so that every machine has it."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)
