"""`read-renderings`: the cited renderings of every object, with their cameras in its world (supplement 3.6)."""

from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field

from pipeline.config.settings import ObjectSettings, defining
from pipeline.config.sources import Object
from pipeline.engine.stage import Cost, Inputs, ObjectStage, Unit
from pipeline.errors import InvalidInput
from pipeline.formats.rendering_folder import PIXELS, image_name, read_renderings, rendering_files
from pipeline.kernels.vision.camera import placed_camera, viewpoint_camera
from pipeline.store.rows import Row
from schemas.base import Artifact
from schemas.renderings import RENDERINGS
from schemas.surfaces import SURFACES

Intensity = Annotated[int, Field(ge=0, le=255)]


class RenderingSettings(ObjectSettings):
    """How the cited renderings are read (supplement 3.6)."""

    background: tuple[Intensity, Intensity, Intensity] = defining(
        (255, 255, 255), "sRGB where renderings are transparent; the supplement does not say, Pixel2Mesh has white"
    )


class ReadRenderings(ObjectStage):
    """Read images of the objects that others rendered."""

    name = "read-renderings"
    summary = "Images of every object from several sides, with their cameras, from a folder laid out as ShapeNetRendering."
    output = RENDERINGS
    settings_type = RenderingSettings

    def inputs(self, settings: RenderingSettings) -> tuple[Artifact, ...]:
        return (SURFACES,)

    def files(self, settings: RenderingSettings, item: Object) -> list[Path]:
        return rendering_files(Path(item.source["renderings"])) if "renderings" in item.source else []

    def cost(self, settings: RenderingSettings) -> Cost:
        return Cost(seconds=0.3, kilobytes=200)

    def process(self, unit: Unit, inputs: Inputs, settings: RenderingSettings) -> Row:
        surface = inputs["surfaces"]
        if "renderings" not in unit.source:
            raise InvalidInput("its manifest names no renderings; use the manifest single-image, or give a shapenet source `renderings`")
        images, viewpoints = read_renderings(Path(unit.source["renderings"]))
        opacity = images[..., 3:] / 255  # (viewpoint, row, col, 1)
        if not (shows := (opacity >= 0.5).any(axis=(1, 2, 3))).all():
            image = Path(unit.source["renderings"]) / image_name(int(shows.argmin()))
            raise InvalidInput(f"{image} shows nothing; download the model's renderings again")
        return {
            "rendering": np.rint(opacity * images[..., :3] + (1 - opacity) * settings.background).astype(np.uint8),
            "silhouette": opacity[..., 0] >= 0.5,
            "rendering_camera": np.stack([placed_camera(viewpoint_camera(view, PIXELS), surface["placement"]) for view in viewpoints]),
        }
