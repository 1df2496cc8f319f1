"""Schema of `renderings`, from `read-renderings`: the cited renderings of each object from several sides, and their cameras."""

from schemas.base import Array, Artifact

RENDERINGS = Artifact(
    name="renderings",
    stage="read-renderings",
    order=6,
    version=2,
    summary="Images of every object from several sides, read from a folder laid out as ShapeNetRendering.",
    arrays={
        "rendering": Array("object viewpoint row col rgb", "uint8", "1/255", "The object before a plain background, sRGB."),
        "silhouette": Array("object viewpoint row col", "bool", "1", "Whether the object covers half of the pixel or more."),
        "rendering_camera": Array(
            "object viewpoint image_axis homogeneous",
            "float64",
            "pixel; pixel / m",
            "Projection of homogeneous world points, m, to (column, row, 1) times depth; pixel centres at 1/2.",
        ),
    },
)
