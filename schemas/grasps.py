"""Schema of `grasps`, from `simulate-grasps` or `read-grasps`: poses of hand and sensors in the best grasps, statistics of attempts."""

from schemas.base import Array, Artifact, coordinates

GRASPS = Artifact(
    name="grasps",
    stage="simulate-grasps",
    order=1,
    version=5,
    summary="The best grasps of every object: poses of hand and sensors as simulated, and which sensors touch.",
    arrays={
        **coordinates("grasp", "sensor", "joint"),
        "hand_pose": Array("object grasp pose_row pose_column", "float64", "m", "Root link (URDF frame) in the world, best grasp first."),
        "joint_angles": Array("object grasp joint", "float64", "rad", "Angles as simulated, finger by finger; m of joints that slide."),
        "pregrasp_angles": Array(
            "object grasp joint", "float64", "rad", "Joint angles before closing: sensors drawn back along normals where there is room."
        ),
        "squeeze_angles": Array(
            "object grasp joint", "float64", "rad", "Joint angles with sensors `squeeze` m further along their normals: commands that hold."
        ),
        "sensor_pose": Array(
            "object grasp sensor pose_row pose_column",
            "float64",
            "m",
            "P: the sensor's frame in the world; origin at the centre of the gel's base, +z its outward normal, "
            "+x along image columns, +y along image rows.",
        ),
        "touch_success": Array(
            "object grasp sensor", "bool", "1", "M: whether it touches, 0 < min D < w - 0.1 mm; w: a curved gel's height at the pixel."
        ),
        "contact_point": Array("object grasp sensor xyz", "float64", "m", "Middle of the contact, in the world; 0 without a touch."),
        "contact_normal": Array(
            "object grasp sensor xyz", "float64", "1", "The object's unit normal there, into the object, in the world; 0 without a touch."
        ),
        "contact_area": Array(
            "object grasp sensor", "float32", "m2", "Area where the surface is deeper than 0.1 mm in the undeformed gel; 0 without a touch."
        ),
        "opposition": Array("object grasp", "float32", "degree", "Greatest angle of contacts' normals: 180 face to face, 0 without two."),
        "closure": Array("object grasp", "float32", "1", "Margin of force closure to 0.001: 0 if it cannot hold, 1 if all press alike."),
        "held": Array(
            "object grasp",
            "bool",
            "1",
            "Whether the object, freed in the grasp, stays in the hand for a second of gravity: at the end its centre is within 10 cm of "
            "where it was, and slower than 5 cm/s.",
            optional=True,
        ),
        "held_directions": Array(
            "object grasp direction", "bool", "1", "The same with gravity along -x, +x, -y, +y, -z, +z of the world.", optional=True
        ),
        "hold_distance": Array(
            "object grasp direction",
            "float32",
            "m",
            "How far the object's centre is from where it was at the end of the hold test: beyond 10 cm, after a second or, where it "
            "rests, before. One direction of gravity, -z, or six as in `held_directions`; inf after a numerical failure.",
            infinite=True,
            optional=True,
        ),
        "hold_speed": Array("object grasp direction", "float32", "m s-1", "Its speed in the last 0.25 s.", infinite=True, optional=True),
        "penetration": Array("object grasp", "float32", "m", "Depth of the deepest rigid point in the object, or of it in a rigid link."),
        "grasp_files": Array(
            "object", "string", "1", "`read-grasps`: file and number of each grasp, a line each; further grasps repeat them.", optional=True
        ),
        "refused_grasps": Array(
            "object", "string", "1", "From `read-grasps`: grasps of its files not among them, with reasons, one per line.", optional=True
        ),
        "attempts": Array("object", "int32", "1", "Placements of the hand tried, or grasps in files, before the best were chosen."),
        "attempt_success": Array("object sensor", "float32", "1", "Share of all attempts in which the sensor touched."),
    },
)
