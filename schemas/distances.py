"""Schema of `distances`, from `sample-distances`: signed distances of points in space to an object's surface."""

from schemas.base import Array, Artifact

DISTANCES = Artifact(
    name="distances",
    stage="sample-distances",
    order=5,
    version=2,
    summary="Points in space, near every object and around it, and their signed distance to its surface: for implicit networks.",
    arrays={
        "query_points": Array("object query xyz", "float32", "m", "Points near the surface and all over the cube around it, world frame."),
        "signed_distance": Array(
            "object query",
            "float32",
            "m",
            "Distance of `query_points` to the nearest face, negative where the winding number is above one half. Where parts of a mesh "
            "overlap, faces inside other parts count too.",
        ),
    },
)
