"""Sets of photographs with known shapes, described in YAML: those of public repositories in `sets/`, or your own."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import Field
from skimage.draw import polygon2mask

from pipeline.contrib.calibration.ball_contact import Circle, Photograph
from pipeline.contrib.calibration.find_contact import find_contact
from pipeline.entries import Entries
from pipeline.formats.image_file import read_image

SETS = Path(__file__).parent / "sets"
ANNOTATED = 0.85
"""Share of the radius of a ball's contact, by plain geometry, in which depth is compared: the gel leaves the ball further out."""
Positive = Annotated[float, Field(gt=0)]
Pixel = tuple[float, float]


class Balls(Entries):
    """Photographs of balls of one size."""

    files: Annotated[str, Field(description="pattern of the photographs, below the set's folder")]
    radius: Annotated[Positive, Field(description="mm")]
    circles: Annotated[str | None, Field(description="file of contacts, a line each: NAME (X, Y) RADIUS, pixels; else they are found")] = (
        None
    )


class PressDescription(Entries):
    """A photograph of a known shape at a known depth."""

    file: str
    depth: Annotated[Positive, Field(description="mm")]
    at: Annotated[Pixel | None, Field(description="of a ball: its middle, pixels")] = None
    radius: Annotated[Positive | None, Field(description="of a ball, mm")] = None
    corners: Annotated[tuple[Pixel, ...] | None, Field(description="of a flat face, pixels")] = None


class SetDescription(Entries):
    """A set of photographs of one sensor."""

    name: str
    source: Annotated[str, Field(description="where the photographs are")]
    folder: Annotated[str, Field(description="of the photographs, below REAL; other paths are below it")]
    mm_per_pixel: Positive
    untouched: str
    fitted: Annotated[Balls, Field(description="balls that methods are fitted to")]
    tested: Annotated[Balls | None, Field(description="balls of another size that methods are tested on")] = None
    presses: Annotated[tuple[PressDescription, ...], Field(description="known shapes that methods are tested on")] = ()


@dataclass(frozen=True, eq=False)
class Press:
    """A photograph with its truth: (rows, cols, 3) uint8; depth in mm, true where `footprint` holds; and whether it is flat there.

    `absolute` is false where only the shape is known and not how deep it is. `contact` is None where nothing tells it but the footprint.
    """

    name: str
    image: NDArray[np.uint8]
    depth: NDArray[np.float64]
    footprint: NDArray[np.bool_]
    flat: bool
    absolute: bool
    contact: NDArray[np.bool_] | None = None

    @property
    def touched(self) -> NDArray[np.bool_]:
        """(rows, cols): its contact, or its footprint where nothing else tells it."""
        return self.footprint if self.contact is None else self.contact


@dataclass(frozen=True, eq=False)
class PhotographSet:
    """A set, read: the untouched photograph, the balls to fit to, and the presses to test on.

    Radii of balls are in mm, NaN where none are tested.
    """

    name: str
    source: str
    mm_per_pixel: float
    untouched: NDArray[np.uint8]
    untouched_path: Path
    ball_radius: float
    tested_radius: float
    balls: list[Photograph]
    presses: list[Press]
    not_found: list[str]


def read_sets(real: Path, descriptions: list[Path]) -> list[PhotographSet]:
    """Read the sets that are below a folder; print which are missing."""
    described = [SetDescription.model_validate(yaml.safe_load(path.read_text())) for path in descriptions]
    present = [description for description in described if (real / description.folder).is_dir()]
    for description in described:
        if description not in present:
            print(f"{description.name}: {real / description.folder} is missing; it is in {description.source}")
    if not present:
        raise SystemExit(f"{real} holds none of the {len(described)} sets; clone them into it")
    return [_read(real / description.folder, description) for description in present]


def _read(folder: Path, described: SetDescription) -> PhotographSet:
    untouched = read_image(folder / described.untouched)
    balls, not_found = _balls(folder, described.fitted, untouched, described.mm_per_pixel)
    presses = [_press(folder, press, described.mm_per_pixel) for press in described.presses]
    if described.tested:
        tested, tested_not_found = _balls(folder, described.tested, untouched, described.mm_per_pixel)
        presses += [ball_press(ball, described.tested.radius, described.mm_per_pixel) for ball in tested]
        not_found += tested_not_found
    path = folder / described.untouched
    scale, radii = described.mm_per_pixel, (described.fitted.radius, described.tested.radius if described.tested else np.nan)
    return PhotographSet(described.name, described.source, scale, untouched, path, *radii, balls, presses, not_found)


def _balls(folder: Path, balls: Balls, untouched: NDArray[np.uint8], scale: float) -> tuple[list[Photograph], list[str]]:
    """Read photographs of balls with their contacts; list those whose contact is not found."""
    circles = _circles(folder / balls.circles) if balls.circles else {}
    photographs, not_found = [], []
    for path in sorted(folder.glob(balls.files)):
        if circles and path.name not in circles:
            continue
        image, name = read_image(path), path.relative_to(folder).as_posix()
        try:
            photographs.append(Photograph(name, image, circles.get(path.name) or find_contact(image, untouched, balls.radius / scale)))
        except ValueError as error:
            not_found.append(f"{name}: {error}")
    return photographs, not_found


def _circles(path: Path) -> dict[str, Circle]:
    lines = re.findall(r"^(\S+) \((\d+), (\d+)\) (\d+)", path.read_text(), re.MULTILINE)
    return {name: Circle(float(x), float(y), float(radius)) for name, x, y, radius in lines}


def _press(folder: Path, described: PressDescription, scale: float) -> Press:
    image, name = read_image(folder / described.file), Path(described.file).stem
    if described.corners is not None:
        footprint = polygon2mask(image.shape[:2], [(y, x) for x, y in described.corners])
        return Press(name, image, np.full(footprint.shape, described.depth), footprint, flat=True, absolute=True)
    if described.at is None or described.radius is None:
        raise SystemExit(f"{described.file}: a press is a ball (at, radius) or a flat face (corners)")
    distance = scale * distances(image.shape[:2], *described.at)
    height = np.sqrt(np.maximum(described.radius**2 - distance**2, 0)) - described.radius + described.depth
    reach = np.sqrt(described.radius**2 - (described.radius - described.depth) ** 2)
    return Press(name, image, np.maximum(height, 0), distance < ANNOTATED * reach, flat=False, absolute=True)


def ball_press(photograph: Photograph, radius: float, scale: float) -> Press:
    """Make the truth of a ball whose contact is known: its shape there, without its depth."""
    contact = photograph.contact
    distance = distances(photograph.image.shape[:2], contact.x, contact.y)
    height = np.sqrt(np.maximum(radius**2 - (scale * distance) ** 2, 0)) - np.sqrt(max(radius**2 - (scale * contact.radius) ** 2, 0))
    footprint, circle = distance < ANNOTATED * contact.radius, distance < contact.radius
    return Press(photograph.name, photograph.image, height, footprint, flat=False, absolute=False, contact=circle)


def distances(shape: tuple[int, int], x: float, y: float) -> NDArray[np.float64]:
    """Compute each pixel's distance from a point, pixels."""
    rows, cols = np.indices(shape)
    return np.asarray(np.hypot(cols - x, rows - y))
