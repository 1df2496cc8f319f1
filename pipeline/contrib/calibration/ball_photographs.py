"""Read photographs of a ball in a sensor's gel, and find their contacts."""

import csv
import io
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.console import pluralise
from pipeline.contrib.calibration.ball_contact import Circle, Photograph
from pipeline.contrib.calibration.find_contact import SMALLEST, find_contact
from pipeline.errors import InvalidInput
from pipeline.formats.file_content import read_text
from pipeline.formats.image_file import image_files, read_image
from pipeline.kernels.touch.marker_removal import MarkerRemoval
from pipeline.kernels.touch.photograph_faults import photograph_faults, stop_at

CIRCLES = "circles.csv"
"""File of known contacts: name, x, y, radius in pixels, from the centre of pixel (0, 0). Other contacts are detected."""
MAX_BYTES = 10 * 2**20  # largest size of `CIRCLES`
WIDER = 1.1  # radii of the ball up to which a stated contact is taken for its equator
MIN_PHOTOGRAPHS = 4  # half of them are fitted, the others tested


def read_photographs(
    folder: Path,  # image files, in it and in folders below it, and perhaps a file `CIRCLES`
    untouched_path: Path,  # the photograph with nothing in the gel; it may lie in the folder
    largest: float,  # radius of the ball, pixels
    *,
    row_scale: float = 1.0,  # height over width of a pixel
    accept_photographs: bool = False,  # use photographs that look altered as a whole beside the untouched one; else they are errors
) -> tuple[list[Photograph], NDArray[np.uint8], dict[str, str]]:  # sorted by name; the untouched one; why others are unusable, by name
    """Read photographs, fill in dots that are printed on the gel, and detect contacts."""
    if not folder.is_dir():
        raise InvalidInput(f"folder {folder} does not exist; give one with photographs of a ball in the gel")
    if largest < SMALLEST:
        raise InvalidInput(
            f"the ball's radius is {largest:.3g} pixels, {SMALLEST:g} are needed: are --ball-radius and --mm-per-pixel in mm?"
        )
    as_taken, circles = read_image(untouched_path), _read_circles(folder / CIRCLES)
    markers = MarkerRemoval(as_taken)
    untouched = markers.fill(as_taken)
    photographs: list[Photograph] = []
    unusable: dict[str, str] = {}
    altered: list[str] = []
    for path in image_files(folder.rglob("*"), untouched_path):
        name = path.relative_to(folder).as_posix()
        try:
            image = read_image(path)
            if not accept_photographs and (faults := photograph_faults(image, as_taken, name=name)):
                altered += faults
                continue
            _check_size(image, untouched)
            image = markers.fill(image)
            photographs.append(Photograph(name, image, _contact(image, untouched, largest, circles.get(name), row_scale)))
        except InvalidInput as error:
            unusable[name] = str(error)
    stop_at(altered)
    if unknown := sorted(circles.keys() - unusable.keys() - {photograph.name for photograph in photographs}):
        raise InvalidInput(
            f"{folder / CIRCLES} names {unknown[0]}, which is not a photograph in {folder}; correct its name, or remove the line"
        )
    if len(photographs) < MIN_PHOTOGRAPHS:
        causes = reasons(unusable) or "it holds no others"
        raise InvalidInput(f"{folder} has {pluralise(len(photographs), 'usable photograph')}, {MIN_PHOTOGRAPHS} are needed; {causes}")
    return photographs, untouched, unusable


def _check_size(image: NDArray[np.uint8], untouched: NDArray[np.uint8]) -> None:
    if image.shape != untouched.shape:
        size, untouched_size = (f"{pixels.shape[0]} x {pixels.shape[1]}" for pixels in (image, untouched))
        raise InvalidInput(f"it has {size} pixels, the untouched photograph {untouched_size}")


def _contact(image: NDArray[np.uint8], untouched: NDArray[np.uint8], largest: float, annotated: Circle | None, row_scale: float) -> Circle:
    if annotated is None:
        if row_scale == 1:
            return find_contact(image, untouched, largest)
        stretched = [_stretched(pixels, row_scale) for pixels in (image, untouched)]
        found = find_contact(stretched[0], stretched[1], largest)
        return Circle(found.x, (found.y + 0.5) * len(image) / len(stretched[0]) - 0.5, found.radius)
    rows, cols = image.shape[:2]
    outside = (max(-place, place - last, 0.0) for place, last in ((annotated.x, cols - 1), (annotated.y, rows - 1)))
    if math.hypot(*outside) >= annotated.radius:
        raise InvalidInput(
            f"its contact in {CIRCLES}, x {annotated.x:g}, y {annotated.y:g}, radius {annotated.radius:g}, lies outside its "
            f"{cols} x {rows} pixels; correct that line"
        )
    if annotated.radius > WIDER * largest:
        raise InvalidInput(
            f"its contact in {CIRCLES}, of {annotated.radius:g} pixels radius, is wider than the ball, {largest:.1f}: correct that line, "
            "--ball-radius or --mm-per-pixel"
        )
    return replace(annotated, radius=min(annotated.radius, largest))


def _stretched(image: NDArray[np.uint8], row_scale: float) -> NDArray[np.uint8]:
    """Give an image square pixels, as wide as they are."""
    rows, cols = image.shape[:2]
    return np.asarray(Image.fromarray(image).resize((cols, round(rows * row_scale)), Image.Resampling.BILINEAR))


def reasons(unusable: dict[str, str]) -> str:
    """Write on one line why photographs cannot be used."""
    return "; ".join(f"{name}: {reason}" for name, reason in unusable.items())


def _read_circles(path: Path) -> dict[str, Circle]:
    circles: dict[str, Circle] = {}
    try:
        rows = csv.DictReader(io.StringIO(read_text(path, MAX_BYTES), newline="")) if path.is_file() else []
        lines = [(row["name"], Circle(float(row["x"]), float(row["y"]), float(row["radius"]))) for row in rows]
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, InvalidInput):
            raise
        columns = "the columns name, x, y, radius, with numbers in pixels"
        raise InvalidInput(f"{path} needs {columns}; {type(error).__name__}: {error}") from error
    for name, circle in lines:
        if name in circles:
            raise InvalidInput(f"{path} has two lines for {name}; keep one")
        if not (math.isfinite(circle.x) and math.isfinite(circle.y) and SMALLEST <= circle.radius < math.inf):
            raise InvalidInput(
                f"{path}: {name} has x {circle.x}, y {circle.y}, radius {circle.radius}; they must be finite, the radius at least "
                f"{SMALLEST:g}: remove the line, or photograph a deeper press"
            )
        circles[name] = circle
    return circles
