"""The settings of `read-renderings`."""

from typing import Annotated

from pydantic import Field

from pipeline.config.settings import ObjectSettings, setting

Intensity = Annotated[int, Field(ge=0, le=255)]


class RenderingSettings(ObjectSettings):
    """How the cited renderings are read (supplement 3.6)."""

    background: tuple[Intensity, Intensity, Intensity] = setting(
        (255, 255, 255),
        "sRGB where the renderings are transparent; the supplement does not say, Pixel2Mesh has white",
        changes="definition",
    )
