"""What `simulate-touch` writes: depth maps and readings of every sensor of every grasp."""

from schemas.base import Array, Artifact, coordinates

TOUCH = Artifact(
    name="touch",
    order=3,
    version=2,
    summary="What every sensor of every grasp feels: depth, tactile reading, and the surface points in its gel.",
    arrays={
        **coordinates("grasp", "sensor"),
        "depth": Array(
            dims=("object", "grasp", "sensor", "row", "col"),
            dtype="float32",
            units="m",
            description="D: distance from the sensor plane along its normal; +inf where nothing is met within range.",
            equation="1",
            infinite=True,
        ),
        "reading": Array(
            dims=("object", "grasp", "sensor", "row", "col", "rgb"),
            dtype="uint8",
            units="1/255",
            description="R: the tactile image of `depth`.",
            equation="2-5",
        ),
        "untouched": Array(
            dims=("row", "col", "rgb"),
            dtype="uint8",
            units="1/255",
            description="The reading of a sensor that nothing touches: losses mask against it.",
            equation="2-5",
        ),
        "local_points": Array(
            dims=("object", "grasp", "sensor", "point", "xyz"),
            dtype="float32",
            units="m",
            description="S^loc: world points with D < w, in row-major pixel order, zeros beyond `local_count`.",
            optional=True,
        ),
        "local_count": Array(
            dims=("object", "grasp", "sensor"),
            dtype="int32",
            units="1",
            description="How many of `local_points` there are.",
            optional=True,
        ),
    },
)
