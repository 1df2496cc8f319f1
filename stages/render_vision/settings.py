"""The settings of `render-vision`."""

from typing import Annotated

from pipeline.config.settings import ObjectSettings, described_by, setting


class VisionSettings(ObjectSettings):
    """How objects and grasps become images (supplement 1.4)."""

    scene: Annotated[str, described_by("scene")] = setting(
        "supplement",
        "the supplement's camera, one lamp, constant light; name of a shipped scene or path of a .yaml file",
        changes="definition",
    )
    hand: Annotated[str, described_by("hand")] | None = setting(
        None, "null follows the grasps: the hand that made them", changes="definition"
    )
    zoom: float | None = setting(
        None,
        "factor of the focal lengths of the scene's cameras; null shows each object as large as one of 0.5 m: 5 for an object of 0.1 m",
        ge=0.01,
        le=10_000,
        changes="definition",
    )
    resolution: int = setting(256, "pixels per side, the supplement's; the camera's intrinsics scale with it", ge=16, le=4096)
    occluded: bool = setting(
        True, "one image per grasp; false renders only the object alone, in a sixth of the time and the bytes", changes="definition"
    )
