"""The settings of `simulate-presses`."""

from typing import Annotated

from pydantic import AfterValidator, Field

from pipeline.config.settings import ObjectSettings, described_by, setting
from pipeline.kernels.touch.press_shapes import SHAPES, PressRanges
from pipeline.kernels.touch.sensor import MAX_PIXELS_PER_SIDE


def _rising(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"it is {list(limits)}; the least comes first, then the greatest")
    return limits


def _known(name: str) -> str:
    if name not in SHAPES:
        raise ValueError(f"there is no shape {name!r}; there are {', '.join(SHAPES)}")
    return name


Positive = Annotated[float, Field(gt=0, le=10)]
Range = Annotated[tuple[Positive, Positive], AfterValidator(_rising)]
DEFAULT = PressRanges()


class PressSettings(ObjectSettings):
    """The shapes that are pressed, and the gel."""

    sensor: Annotated[str, described_by("sensor")] = setting(
        "gelsight", "a calibrated one: photographs of your own sensor need the file of `calibrate-sensor`", changes="definition"
    )
    pixels: int | None = setting(
        160,
        "along the longer side, square ones: enough for what a gel shows, a sixteenth of a camera's bytes; null keeps the sensor's",
        ge=8,
        le=MAX_PIXELS_PER_SIDE,
        changes="definition",
    )
    presses: int = setting(72, "per object: 1800 for 25 objects, enough for a small network", ge=1, le=10_000, changes="definition")
    patches: float = setting(
        0.2, "share of the presses that are patches of the object itself; the others are `shapes`", ge=0, le=1, changes="definition"
    )
    shapes: tuple[Annotated[str, AfterValidator(_known)], ...] = setting(
        tuple(SHAPES), "all shapes: a network memorises a single one", min_length=1, changes="definition"
    )
    size: Range = setting(DEFAULT.size, "least and greatest radius of a shape, m: what fits on a gel of 2 cm", changes="definition")
    depth: Range = setting(
        DEFAULT.depth, "least and greatest depth of the deepest point in the gel, m: what hands and people press", changes="definition"
    )
    tilt: float = setting(
        8.0, "greatest tilt, degrees, of a patch, and of three shapes in ten; the others lie flat", ge=0, le=60, changes="definition"
    )
    scale: Range = setting(
        (0.04, 0.5),
        "least and greatest factor by which the object is scaled: whole toys to plain walls",
        changes="definition",
    )
    gel: Range | None = setting(
        None,
        "least and greatest factor of the membrane's width, or of an elastic gel's thickness, drawn per press; null: the sensor's gel",
        changes="definition",
    )
