"""The settings of `render-vision`."""

from pipeline.config.settings import Settings, setting


class VisionSettings(Settings):
    """How objects and grasps become images (supplement 1.4)."""

    scene: str = setting(
        "supplement",
        "its camera, one lamp, constant light; another is another file, by name or by path ending in .yaml",
        changes="definition",
    )
    hand: str = setting("allegro_right", "the hand that `simulate-grasps` placed: it must be the same", changes="definition")
    resolution: int = setting(256, "pixels a side, the supplement's; the camera's intrinsics scale with it", ge=16, le=4096)
    occluded: bool = setting(
        True, "an image of every grasp; off, only the object alone is rendered, a sixth of the time and the bytes", changes="definition"
    )
