"""Scenes: cameras, lamp, constant light and background; the labels of segmentation images."""

from enum import IntEnum
from typing import Annotated

from pydantic import AfterValidator, Field

from pipeline.entries import Entries
from pipeline.kernels.vision.camera import Camera, Coordinate

UnitInterval = Annotated[float, Field(ge=0, le=1)]
Intensity = Annotated[float, Field(ge=0, le=1e6)]


class Label(IntEnum):
    """What a pixel of a segmentation image shows."""

    BACKGROUND = 0
    OBJECT = 1
    HAND = 2


class Lamp(Entries):
    """A point light whose intensity falls off with the square of the distance; it casts no shadow."""

    position: tuple[Coordinate, Coordinate, Coordinate] = Field(description="world frame, m; a surface point there is not lit by the lamp")
    intensity: float = Field(
        gt=0, le=1e6, description="a white surface that faces the lamp at d metres shows `intensity` / d² (linear; 1 and more is white)"
    )
    color: tuple[UnitInterval, UnitInterval, UnitInterval] = Field(description="linear RGB, 0..1")


def _fit_together(cameras: tuple[Camera, ...]) -> tuple[Camera, ...]:
    names = [camera.name for camera in cameras]
    if repeated := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"two cameras are called {repeated[0]}; rename one")
    if len({camera.size for camera in cameras}) > 1:
        sizes = ", ".join(f"{camera.name}: {camera.size or 'square'}" for camera in cameras)
        raise ValueError(f"cameras have images of several sizes ({sizes}), and one array holds them; give all the same size")
    return cameras


class Scene(Entries):
    """The surroundings of an object."""

    name: str = Field(description="recorded in datasets")
    summary: str = Field(description="what it shows, in a sentence")
    cameras: Annotated[tuple[Camera, ...], Field(min_length=1), AfterValidator(_fit_together)] = Field(
        description="one or more, with images of one size; networks see the first camera's images"
    )
    depth: bool = Field(False, description="whether depth images are stored")
    lamp: Lamp = Field(description="the one lamp")
    ambient: tuple[Intensity, Intensity, Intensity] = Field(description="constant light, linear RGB")
    background: tuple[UnitInterval, UnitInterval, UnitInterval] = Field(description="colour of the background, sRGB, 0..1")

    @property
    def camera(self) -> Camera:
        """The first camera, whose images networks see."""
        return self.cameras[0]

    def square_camera(self, resolution: int) -> Camera:
        """Make a camera of square images at the first camera's pose; its field of view is the shorter side's."""
        first = self.camera
        x, y = (resolution / min(first.shape) * length for length in first.focal)
        centre = (resolution / 2, resolution / 2)
        return first.model_copy(update={"focal": (x, y), "centre": centre, "resolution": resolution, "size": None})
