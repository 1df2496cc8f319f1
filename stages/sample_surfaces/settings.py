"""The settings of `sample-surfaces`."""

from pipeline.config.settings import ObjectSettings, setting


class SurfaceSettings(ObjectSettings):
    """How meshes become points on their exterior surface (supplement 1.1, 1.2)."""

    points: int = setting(10_000, "the supplement's S^obj (1.1)", ge=10)
    diagonal: float = setting(
        0.5, "bounding-box diagonal that objects are scaled to, m: the authors' 1 × 0.5", ge=1e-3, le=100, changes="definition"
    )
    directions: int = setting(
        256,
        "directions of which two must be free for a point to be exterior: 64 miss 0.1 % of the surface, more find ever narrower gaps; with "
        "fewer than 16, faces of a box may see no two",
        ge=16,
    )
    max_faces: int = setting(
        500_000, "with more, physics takes minutes per object and its result hardly changes", gt=0, changes="definition"
    )
