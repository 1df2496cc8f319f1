"""Schema of `touch`, from `simulate-touch`: depth maps and tactile images of every sensor of every grasp."""

from schemas.base import Array, Artifact, coordinates, depth_map
from schemas.sequences import over_time

TOUCH = Artifact(
    name="touch",
    stage="simulate-touch",
    order=3,
    version=4,
    summary="What every sensor of every grasp feels: depth, tactile image, and the surface points in its gel.",
    arrays={
        **coordinates("grasp", "sensor"),
        "depth": depth_map("object grasp sensor"),
        "tactile_image": Array("object grasp sensor row col rgb", "uint8", "1/255", "R: the tactile image of `depth`.", equation="2-5"),
        "untouched": Array("sensor row col rgb", "uint8", "1/255", "Tactile image without touch: losses mask against it.", equation="2-5"),
        "pressure": Array("object grasp sensor row col", "float32", "Pa", "Normal pressure on an elastic gel, 0 elsewhere.", optional=True),
        "force": Array("object grasp sensor", "float32", "N", "Normal force on an elastic gel.", optional=True),
        "indentation": Array("object grasp sensor", "float32", "m", "Greatest depth of the object in the undeformed gel.", optional=True),
        "local_points": Array(
            "object grasp sensor point xyz",
            "float32",
            "m",
            "S^loc: world points with D < w, the gel's height there, in row-major pixel order, zeros beyond `local_count`.",
            optional=True,
        ),
        "local_count": Array("object grasp sensor", "int32", "1", "How many of `local_points` there are.", optional=True),
        **over_time("lift", "object grasp sensor step"),
        "lift_object_pose": Array(
            "object grasp step pose_row pose_column", "float64", "m", "The object in the world; at first as it was grasped.", optional=True
        ),
        "lift_weight": Array("object grasp step", "float32", "N", "Its weight on the gels, along the world's -z.", optional=True),
        "lift_imbalance": Array(
            "object grasp step",
            "float32",
            "N",
            "Sum of that weight and of the gels' forces on the object: what holds it before it is freed, then what accelerates it; "
            "it vanishes where the object rests.",
            optional=True,
        ),
        "lift_held": Array(
            "object grasp step", "bool", "1", "False once no gel touches it, or it slid over one by more than its thickness.", optional=True
        ),
    },
)
