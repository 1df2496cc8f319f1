"""The settings of `render-vision`."""

from pipeline.config.settings import ObjectSettings, setting


class VisionSettings(ObjectSettings):
    """How objects and grasps become images (supplement 1.4)."""

    scene: str = setting(
        "supplement",
        "the supplement's camera, one lamp, constant light; name of a shipped scene or path of a .yaml file",
        changes="definition",
    )
    hand: str | None = setting(None, "null follows the grasps: the hand that made them", changes="definition")
    resolution: int = setting(256, "pixels per side, the supplement's; the camera's intrinsics scale with it", ge=16, le=4096)
    occluded: bool = setting(
        True, "one image per grasp; false renders only the object alone, in a sixth of the time and the bytes", changes="definition"
    )
