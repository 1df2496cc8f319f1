"""What can be set about `sample-surfaces`."""

from pipeline.config.settings import Settings, setting


class SurfaceSettings(Settings):
    """The settings of `sample-surfaces`."""

    points: int = setting(10_000, "the supplement's S^obj (1.1)", gt=0)
    diagonal: float = setting(0.5, "bounding-box diagonal an object is scaled to, m: the authors' 1 × 0.5", gt=0, changes="definition")
    directions: int = setting(
        256,
        "directions among which two must lead out for a point to be exterior: 64 miss 0.1 % of the surface, more find ever narrower gaps",
        ge=2,
    )
    max_faces: int = setting(500_000, "beyond it physics takes minutes an object and says little more", gt=0, changes="definition")
