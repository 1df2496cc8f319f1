"""Read photographs of a ball in a sensor's gel, and find their contacts."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.console import pluralise
from pipeline.errors import InvalidInput
from pipeline.formats.image_file import image_files, read_image
from pipeline.inference.photograph_faults import photograph_faults, stop_at
from pipeline.kernels.touch.ball_contact import Circle, Photograph
from pipeline.kernels.touch.find_contact import SMALLEST, find_contact

CIRCLES = "circles.csv"
"""File of known contacts: name, x, y, radius in pixels, from the centre of pixel (0, 0). Other contacts are detected."""
MIN_PHOTOGRAPHS = 4
"""Half of them are fitted, the others tested."""


def read_photographs(
    folder: Path, untouched_path: Path, *, accept_photographs: bool = False
) -> tuple[list[Photograph], NDArray[np.uint8], dict[str, str]]:
    """Read photographs, and detect their contacts.

    Parameters
    ----------
    folder
        Image files, in it and in folders below it, and perhaps a file `CIRCLES`.
    untouched_path
        The photograph with nothing in the gel; it may lie in the folder.
    accept_photographs
        Whether to use photographs that look altered as a whole beside the untouched one, which is an error otherwise.

    Returns
    -------
    The usable photographs, sorted by name; the untouched one; and why others are left out, by name.

    Raises
    ------
    InvalidInput
        The folder does not exist, the untouched photograph or `CIRCLES` cannot be read, `CIRCLES` names another file, photographs look
        altered, or fewer than `MIN_PHOTOGRAPHS` can be used.
    """
    if not folder.is_dir():
        raise InvalidInput(f"folder {folder} does not exist; give one with photographs of a ball in the gel")
    untouched, circles = read_image(untouched_path), _read_circles(folder / CIRCLES)
    photographs: list[Photograph] = []
    left_out: dict[str, str] = {}
    altered: list[str] = []
    for path in image_files(folder.rglob("*"), untouched_path):
        name = path.relative_to(folder).as_posix()
        try:
            image = read_image(path)
            if not accept_photographs and (faults := photograph_faults(image, untouched, name=name)):
                altered += faults
                continue
            photographs.append(Photograph(name, image, _contact(image, untouched, circles.get(name))))
        except InvalidInput as error:
            left_out[name] = str(error)
    stop_at(altered)
    if unknown := sorted(circles.keys() - left_out.keys() - {photograph.name for photograph in photographs}):
        raise InvalidInput(
            f"{folder / CIRCLES} names {unknown[0]}, which is not a photograph in {folder}; correct its name, or remove the line"
        )
    if len(photographs) < MIN_PHOTOGRAPHS:
        causes = reasons(left_out) or "it holds no others"
        raise InvalidInput(f"{folder} has {pluralise(len(photographs), 'usable photograph')}, {MIN_PHOTOGRAPHS} are needed; {causes}")
    return photographs, untouched, left_out


def _contact(image: NDArray[np.uint8], untouched: NDArray[np.uint8], annotated: Circle | None) -> Circle:
    if image.shape != untouched.shape:
        size, untouched_size = (f"{pixels.shape[0]} x {pixels.shape[1]}" for pixels in (image, untouched))
        raise InvalidInput(f"it has {size} pixels, the untouched photograph {untouched_size}")
    if annotated is None:
        return find_contact(image, untouched)
    rows, cols = image.shape[:2]
    outside = (max(-place, place - last, 0.0) for place, last in ((annotated.x, cols - 1), (annotated.y, rows - 1)))
    if math.hypot(*outside) >= annotated.radius:
        raise InvalidInput(
            f"its contact in {CIRCLES}, x {annotated.x:g}, y {annotated.y:g}, radius {annotated.radius:g}, lies outside its "
            f"{cols} x {rows} pixels; correct that line"
        )
    return annotated


def reasons(left_out: dict[str, str]) -> str:
    """Write on one line why photographs are left out."""
    return "; ".join(f"{name}: {reason}" for name, reason in left_out.items())


def _read_circles(path: Path) -> dict[str, Circle]:
    if not path.is_file():
        return {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:  # spreadsheets write a byte-order mark
            lines = [(row["name"], Circle(float(row["x"]), float(row["y"]), float(row["radius"]))) for row in csv.DictReader(file)]
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidInput(
            f"{path} needs the columns name, x, y, radius, with numbers in pixels; {type(error).__name__}: {error}"
        ) from error
    circles: dict[str, Circle] = {}
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
