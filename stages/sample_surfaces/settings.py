"""What can be set about `sample-surfaces`."""

from pipeline.config.settings import Settings, knob


class SurfaceSettings(Settings):
    """The knobs of `sample-surfaces`."""

    points: int = knob(10_000, "the supplement's S^obj (1.1)", gt=0)
    diagonal: float = knob(0.5, "bounding-box diagonal an object is scaled to, m: the authors' 1 × 0.5", gt=0, changes="definition")
    directions: int = knob(
        256,
        "directions among which two must lead out for a point to be exterior: 64 miss 0.1 % of the surface, more find ever narrower gaps",
        ge=2,
    )
    max_faces: int = knob(500_000, "beyond it physics takes minutes an object and says little more", gt=0, changes="definition")
