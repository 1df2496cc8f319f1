"""A scene: camera, lamp, constant light and background, as a file in `pipeline/assets/scenes` describes them."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from pipeline.kernels.vision.camera import Camera, Vector

Share = Annotated[float, Field(ge=0, le=1)]
Light = Annotated[float, Field(ge=0)]


class _Model(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Lamp(_Model):
    """A point light whose light falls off with the square of the distance.

    `position` in the world, m; a white surface that faces it at d metres shows `intensity` / d² (linear, 1 is white); `color`
    linear RGB. It casts no shadow. What it would light brighter than white is white; the point of a surface that it stands on
    it does not light.
    """

    position: Vector
    intensity: float = Field(gt=0)
    color: tuple[Share, Share, Share]


class Scene(_Model):
    """What surrounds the object: a camera, one lamp, constant light (linear RGB), and the background's colour (sRGB, 0..1)."""

    name: str
    summary: str
    camera: Camera
    lamp: Lamp
    ambient: tuple[Light, Light, Light]
    background: tuple[Share, Share, Share]
