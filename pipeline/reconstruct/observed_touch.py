"""What one sensor of an observation felt."""

from functools import cached_property
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from pipeline.kernels.touch.depth_maps import CONTACT_MARGIN
from pipeline.reconstruct.observation_entries import FileEntries, GelDepth, Image, Mask, Points, Pose, SensorName, check_array, size_text


class ObservedTouch(FileEntries):
    """What a sensor felt, as a tactile image, the depth of its gel or points, and its pose."""

    tactile_image: Image | None = Field(default=None, description="8-bit RGB image of the sensor's camera, +x along columns, +y along rows")
    depth: GelDepth | None = Field(
        default=None, description="instead: how deep the gel is pressed in, 0 at rest: `NAME-depth.png` of `read-touch`, or .npy, m"
    )
    contact: Mask | None = Field(
        default=None, description="with `depth`, not 0 where something touches: `NAME-contact.png` of `read-touch`; else from 0.1 mm on"
    )
    points: Points | None = Field(
        default=None, description="instead: points, sensor frame, m, and normals out of the gel: `NAME.ply` of `read-touch`, or .npy (N, 6)"
    )
    pose: Pose = Field(description="sensor frame to the file's frame: origin in the middle of the gel's base, +z out of the gel")
    touched: bool | Literal["auto"] = Field(
        default="auto", description="whether it touches; `auto`: if the image differs from the untouched one, or depth or points say so"
    )
    sensor: SensorName | None = Field(default=None, description="name or file of this sensor's description; by default the observation's")
    untouched: Image | None = Field(default=None, description="tactile image of this sensor without contact; by default the observation's")
    name: str | None = Field(default=None, max_length=100, description="for messages: `index`, `thumb`")

    @model_validator(mode="after")
    def _is_one_kind(self) -> Self:
        given = [name for name in ("tactile_image", "depth", "points") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"a touch has one of tactile_image, depth and points; this has {' and '.join(given) or 'none of them'}")
        for name, other in (("contact", "depth"), ("untouched", "tactile_image")):
            if getattr(self, name) is not None and other not in given:
                raise ValueError(f"{name} belongs to {other}; remove it")
        if self.depth is not None:
            check_array("depth", self.depth, np.float64, 2)
            if not np.isfinite(self.depth).all():
                raise ValueError("depth holds NaN or infinity; it is how deep the gel is pressed in, 0 where it is at rest")
            if self.contact is not None and self.contact.shape != self.depth.shape:
                raise ValueError(f"contact has {size_text(self.contact)} pixels, depth {size_text(self.depth)}")
        if self.points is not None and (self.points.dtype != np.float64 or self.points.ndim != 2 or self.points.shape[1] != 6):
            raise ValueError(f"points are {self.points.dtype} {self.points.shape}; they must be float64 (N, 6): positions and normals")
        return self

    @cached_property
    def contact_pixels(self) -> NDArray[np.bool_] | None:
        """(rows, cols): where a gel of given depth touches; None without depth."""
        if self.depth is None:
            return None
        return self.depth >= CONTACT_MARGIN if self.contact is None else self.contact

    @cached_property
    def cloud(self) -> NDArray[np.float64] | None:
        """(N, 6) given points with normals; None without any."""
        return None if self.points is None or not len(self.points) else self.points
